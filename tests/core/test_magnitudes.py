"""Numbers beyond what solvers bear are refused with argument, value and range."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspless_pin import (
    QuasistaticProblem,
    maximize_margin,
    minimize_torque,
    optimum_gradients,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.shapes import Box, Sphere
from graspless_pin.geometry.poses import as_pose, pose_matrix
from graspless_pin.problem.checks import LARGEST, all_finite, all_within, in_order, real_array
from graspless_pin.problem.own_arrays import problem_of_own_arrays

ARGUMENTS = {
    "positions": [[0, -0.05, 0], [0, 0.05, 0], [0, 0, -0.05]],
    "normals": [[0, 1, 0], [0, -1, 0], [0, 0, 1]],
    "external_wrench": [0, 0, -4.9, 0, 0, 0],
    "jacobian": np.ones((9, 2)),
    "friction": 0.4,
}


def problem(**changes) -> QuasistaticProblem:
    return QuasistaticProblem(**{**ARGUMENTS, **changes})


CASES = {
    "external_wrench": ([0, 0, -1e200, 0, 0, 0], "is -1e+200 at index (2,); it must be within ±1e"),
    "positions": ([[0, 0, 1e31], [0, 0, 0], [0, 0, 0]], "is 1e+31 at index (0, 2); it must be"),
    "jacobian": (np.full((9, 2), 1e300), "is 1e+300 at index (0, 0); it must be within ±1e+30"),
    "friction": (1e300, "is 1e+300 at index (0,); it must be within ±1e+30"),
    "max_normal_force": (1e-20, "is 1e-20 at index 0; it must be at least 4.9e-12: the external"),
    "torque_limits": ((-np.inf, 1e31), "upper: is 1e+31 at index (0,); it must be within"),
    "gravity_torques": ([0, -1e300], "is -1e+300 at index (1,); it must be within ±1e+30"),
    "sliding": (np.full((3, 3), 1e300), "is 1e+300 at index (0, 0); it must be within ±1e+30"),
    "cone_edges": (10**9, "is 1000000000; it must be from 3 to 1024"),
    "joint_names": (5, "is 5; it must be a sequence of names"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_number_beyond_all_bounds(name):
    value, message = CASES[name]
    with pytest.raises(ArgumentError, match=f"{name}.*{re.escape(message)}"):
        problem(**{name: value})


def test_a_steep_cone():
    with pytest.raises(ArgumentError, match=r"friction: is 20000.0 at index 0; it must be from 0"):
        problem(friction=2e4)


@pytest.mark.parametrize("value", [10**9, 10**5000], ids=["large", "endless"])
def test_whole_numbers_without_end(value):
    with pytest.raises(ArgumentError, match=r"cone_edges: is .*; it must be from 3 to 1024"):
        problem(cone_edges=value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"margin": 1e200}, "margin: is 1e+200; it must be from 0 to 1e+30"),
        ({"margin": 10**400}, "margin: is 1000"),
        ({"margin": 10**5000}, "margin: is too large a number; it must be a finite number >= 0"),
        ({"regularization": 1e20}, "regularization: is 1e+20; it must be from 0 to 1e+09"),
    ],
    ids=["margin", "whole margin", "endless margin", "regularization"],
)
def test_options_beyond_all_bounds(options, message):
    others = {name: value for name, value in options.items() if name != "margin"}
    with pytest.raises(ArgumentError, match=re.escape(message)):
        minimize_torque(problem(), options.get("margin", 0.1), **others)


def test_regularization_of_algorithm_1():
    with pytest.raises(ArgumentError, match="regularization: is 1e\\+20; it must be from 0"):
        maximize_margin(problem(), regularization=1e20)


@pytest.mark.parametrize("scale", [1e-9, 1e9])
@pytest.mark.parametrize("limit", [1e-8, 1.0, 1e8])
def test_what_is_within_reach_of_the_load_is_taken(scale, limit):
    made = problem(
        external_wrench=scale * np.array([0, 0, -4.9, 0, 0, 0]),
        max_normal_force=4.9 * scale * limit,
        torque_limits=(-limit * scale, np.inf),
    )
    assert made.max_normal_force[0] == 4.9 * scale * limit
    assert problem(positions=scale * np.array(ARGUMENTS["positions"])).contact_count == 3


def test_own_arrays_have_the_same_bounds():
    made = problem()
    own = {
        "positions": made.positions, "normals": made.normals, "jacobian": made.jacobian,
        "external_wrench": made.external_wrench, "friction": made.friction,
        "tangents": made.tangents, "sliding": made.sliding, "gravity_torques": np.zeros(2),
        "torque_limits": (made.lower_torque, made.upper_torque), "max_normal_force": 50.0,
        "cone_edges": 8, "joint_names": made.joint_names, "joint_units": made.joint_units,
    }  # fmt: skip
    assert problem_of_own_arrays(**own).contact_count == 3
    for name, value in (
        ("external_wrench", np.array([0, 0, -1e200, 0, 0, 0])),
        ("positions", np.full((3, 3), 1e31)),
        ("max_normal_force", 1e-20),
    ):
        with pytest.raises(ArgumentError, match=f"{name}: is "):
            problem_of_own_arrays(**{**own, name: value})


def test_masked_entries_are_no_numbers():
    """A plain copy would show what stands below the mask."""
    with pytest.raises(ArgumentError, match="friction: has 1 masked entries"):
        problem(friction=np.ma.array([0.4, 9.0, 0.4], mask=[False, True, False]))
    with pytest.raises(ArgumentError, match="positions: has 3 masked entries"):
        problem(positions=np.ma.array(ARGUMENTS["positions"], mask=np.eye(3, dtype=bool)))
    plain = problem(friction=np.ma.array([0.4, 0.5, 0.4]))
    assert plain.friction.tolist() == [0.4, 0.5, 0.4] and type(plain.friction) is np.ndarray


def test_gradients_of_what_is_no_solution():
    with pytest.raises(ArgumentError, match="solution: is a QuasistaticProblem; it must be a Tor"):
        optimum_gradients(problem())  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("values", [[0.0, -1.0], [LARGEST], [np.nextafter(LARGEST, np.inf)],
                                    [1.0, np.inf], [np.nan]])  # fmt: skip
def test_bounds_of_arrays(values):
    array = np.array(values)
    assert all_within((np.zeros(3), array)) == bool((np.abs(array) <= LARGEST).all())


NUMBERS = st.lists(st.sampled_from([0.0, 1.0, -1.0, np.inf, -np.inf, np.nan]), max_size=3)


@given(pairs=st.lists(st.tuples(*[st.sampled_from([0.0, 1.0, np.inf, np.nan])] * 2), max_size=3))
def test_order_is_that_of_plain_numbers(pairs):
    low, high = (np.array([pair[k] for pair in pairs], dtype=float) for k in (0, 1))
    assert in_order((low, high)) == all(a <= b for a, b in pairs)
    assert in_order((low, high), strictly=True) == all(a < b for a, b in pairs)
    assert in_order((low, high, low)) == all(a == b for a, b in pairs)


@given(first=NUMBERS, second=NUMBERS)
def test_what_is_finite_is_what_plain_numbers_say(first, second):
    every = [*first, *second]
    both = np.array(first, dtype=float), np.array(second, dtype=float)
    assert all_finite(both) == all(map(math.isfinite, every))
    assert all_within(both) == all(map(math.isfinite, every))
    assert all_finite(()) and all_within(())


def test_limits_may_be_infinite():
    assert real_array("x", [np.inf, -np.inf, 1e30], (3,)).tolist() == [np.inf, -np.inf, 1e30]


@pytest.mark.parametrize("length", [1e160, 1e13, 1e-13, 1e-200])
def test_sizes_beyond_all_bounds(length):
    with pytest.raises(ArgumentError, match="from 1e-12 to 1e\\+12 m, got"):
        Sphere(length)
    with pytest.raises(ArgumentError, match="from 1e-12 to 1e\\+12 m, got"):
        Box((1.0, length, 1.0))


def test_positions_beyond_all_bounds():
    with pytest.raises(ArgumentError, match=r"the position is .* it must be within ±1e\+12 m"):
        pose_matrix([0, 2e12, 0])
    T = np.eye(4)
    T[0, 3] = -2e12
    with pytest.raises(ArgumentError, match=r"^T: the position is "):
        as_pose("T", T)
    T[0, 3] = -1e12
    assert as_pose("T", T)[0, 3] == -1e12
