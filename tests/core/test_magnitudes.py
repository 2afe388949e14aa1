"""Numbers that are none or beyond what solvers bear are refused with argument, value and range."""

import re
from typing import Any

import numpy as np
import pytest

from graspless_pin import (
    QuasistaticProblem,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.shapes import Box, Sphere
from graspless_pin.geometry.poses import as_pose, pose_matrix
from graspless_pin.problem.checks import JointUnit, real_array
from graspless_pin.problem.cones import default_tangents
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


CASES = [
    ("external_wrench", [0, 0, -1e200, 0, 0, 0], "is -1e+200 at index (2,); it must be within ±1e"),
    ("positions", [[0, 0, 1e31], [0, 0, 0], [0, 0, 0]], "is 1e+31 at index (0, 2); it must be"),
    ("jacobian", np.full((9, 2), 1e300), "is 1e+300 at index (0, 0); it must be within ±1e+30"),
    ("friction", 1e300, "is 1e+300 at index (0,); it must be within ±1e+30"),
    ("max_normal_force", 1e-20, "is 1e-20 at index 0; it must be at least 4.9e-12: the external"),
    ("torque_limits", (-np.inf, 1e31), "upper: is 1e+31 at index (0,); it must be within"),
    ("gravity_torques", [0, -1e300], "is -1e+300 at index (1,); it must be within ±1e+30"),
    ("sliding", np.full((3, 3), 1e300), "is 1e+300 at index (0, 0); it must be within ±1e+30"),
    ("cone_edges", 10**9, "is 1000000000; it must be from 3 to 1024"),
    ("joint_names", 5, "is 5; it must be a sequence of names"),
    ("friction", 2e4, "is 20000.0 at index 0; it must be from 0"),
    ("cone_edges", 10**5000, "it must be from 3 to 1024"),
]


@pytest.mark.parametrize(("name", "value", "message"), CASES, ids=range(len(CASES)))
def test_a_number_beyond_all_bounds(name, value, message):
    with pytest.raises(ArgumentError, match=f"{name}.*{re.escape(message)}"):
        problem(**{name: value})


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
    with pytest.raises(ArgumentError, match=re.escape(message)):
        minimize_torque(problem(), **({"margin": 0.1} | options))
    if "margin" not in options:
        with pytest.raises(ArgumentError, match=re.escape(message)):
            maximize_margin(problem(), **options)


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


def test_masked_entries_are_no_numbers():
    """A plain copy would show what stands below the mask."""
    with pytest.raises(ArgumentError, match="friction: has 1 masked entries"):
        problem(friction=np.ma.array([0.4, 9.0, 0.4], mask=[False, True, False]))
    with pytest.raises(ArgumentError, match="positions: has 3 masked entries"):
        problem(positions=np.ma.array(ARGUMENTS["positions"], mask=np.eye(3, dtype=bool)))
    plain = problem(friction=np.ma.array([0.4, 0.5, 0.4]))
    assert plain.friction.tolist() == [0.4, 0.5, 0.4] and type(plain.friction) is np.ndarray


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


def arguments() -> dict:
    normals = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    return {
        "positions": np.array([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]]),
        "normals": normals,
        "external_wrench": np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0]),
        "jacobian": np.arange(18.0).reshape(6, 3),
        "friction": np.array([0.3, 0.5]),
        "tangents": default_tangents(normals),
        "sliding": np.zeros((2, 3)),
        "torque_limits": (np.array([-1.0, 0.0, -np.inf]), np.array([1.0, 0.0, np.inf])),
        "max_normal_force": 20.0,
        "cone_edges": 8,
        "joint_names": ("a", "b", "c"),
        "joint_units": (JointUnit.TORQUE, JointUnit.FORCE, JointUnit.TORQUE),
        "gravity_torques": np.array([0.1, 0.2, 0.3]),
    }


def test_own_arrays_make_the_problem_of_the_constructor() -> None:
    given = arguments()
    ours = problem_of_own_arrays(**given)
    assert ours.positions is given["positions"]  # taken as it is
    theirs = QuasistaticProblem(**arguments())
    assert ours.__dict__.keys() == theirs.__dict__.keys()
    for name, value in theirs.__dict__.items():
        mine = getattr(ours, name)
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(mine, value, err_msg=name)
            assert not mine.flags.writeable
        else:
            assert mine == value, name


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e200])
@pytest.mark.parametrize(
    "name",
    ["positions", "external_wrench", "jacobian", "friction", "sliding", "gravity_torques"],
)
def test_a_number_that_is_none_is_named(name: str, bad: float) -> None:
    given = arguments()
    given[name] = np.array(given[name])
    given[name].flat[1] = bad
    with pytest.raises(ArgumentError, match=rf"^{name}: is (NaN|-?inf|1e\+200) at index"):
        problem_of_own_arrays(**given)


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("friction", np.array([0.3, 1e5])),
        ("cone_edges", 5000),
        ("max_normal_force", 1e31),
        ("torque_limits", (np.array([-1.0, 0.0, -1e35]), np.array([1.0, 0.0, 1e30]))),
    ],
)
def test_own_arrays_have_the_bounds_of_the_constructor(name: str, bad: Any) -> None:
    with pytest.raises(ArgumentError, match=f"^{name.removesuffix('_limits')}"):
        problem_of_own_arrays(**{**arguments(), name: bad})


def test_coefficients_of_friction_may_be_zero_but_not_negative() -> None:
    given = arguments()
    given["friction"] = np.array([0.3, 0.0])
    assert problem_of_own_arrays(**given).friction is given["friction"]  # taken as it is
    given["friction"] = np.array([0.3, -0.1])
    with pytest.raises(ArgumentError, match=r"^friction: "):
        problem_of_own_arrays(**given)


@pytest.mark.parametrize(
    ("limits", "fits"),
    [
        (([-1, -1, -1], [1, 1, 1]), True),
        (([0, -1, -np.inf], [0, 1, np.inf]), True),
        (([-1, 2, -1], [1, 1, 1]), False),
        (([-1, np.nan, -1], [1, 1, 1]), False),
        (([-1, np.inf, -1], [1, np.inf, 1]), False),
        (([-1, -np.inf, -1], [1, -np.inf, 1]), False),
    ],
)
def test_limits_are_possible_ones(limits, fits: bool) -> None:
    given = arguments()
    given["torque_limits"] = tuple(np.array(side, dtype=float) for side in limits)
    if fits:
        problem = problem_of_own_arrays(**given)
        np.testing.assert_array_equal(problem.upper_torque, limits[1])
    else:
        with pytest.raises(ArgumentError, match="torque_limits"):
            problem_of_own_arrays(**given)


class Labelled(np.ndarray):
    """An array of a kind of its own, whose products need not be numpy's."""


def test_arguments_become_plain_copies():
    values = np.ones((2, 3))
    checked = real_array("values", values.view(Labelled), (2, 3))
    assert type(checked) is np.ndarray
    assert not checked.flags.writeable
    values[0, 0] = 2.0
    assert checked[0, 0] == 1.0
