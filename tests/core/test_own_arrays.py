"""Arrays that are taken as they are: the same problem, and impossible numbers still have names."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspless_pin import QuasistaticProblem
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import all_finite, all_true, real_array
from graspless_pin.problem.cones import default_tangents
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.problem.own_arrays import problem_of_own_arrays

ANY = st.floats(allow_nan=True, allow_infinity=True)


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
    ours = problem_of_own_arrays(**arguments())
    theirs = QuasistaticProblem(**arguments())
    assert ours.__dict__.keys() == theirs.__dict__.keys()
    for name, value in theirs.__dict__.items():
        mine = getattr(ours, name)
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(mine, value, err_msg=name)
            assert not mine.flags.writeable
        else:
            assert mine == value, name


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    "name",
    ["positions", "external_wrench", "jacobian", "friction", "sliding", "gravity_torques"],
)
def test_a_number_that_is_none_is_named(name: str, bad: float) -> None:
    given = arguments()
    given[name] = np.array(given[name])
    given[name].flat[1] = bad
    with pytest.raises(ArgumentError, match=f"^{name}: "):
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


@given(st.lists(ANY, max_size=6), st.lists(ANY, max_size=6))
def test_arrays_of_any_shape_are_finite_together(first: list[float], second: list[float]) -> None:
    arrays = np.array(first, dtype=float), np.array(second, dtype=float).reshape(-1, 1)
    assert all_finite(arrays) == bool(np.isfinite(first + second).all())
    assert all_true(np.isfinite(arrays[1])) == bool(np.isfinite(second).all())


class Labelled(np.ndarray):
    """An array of a kind of its own, whose products need not be numpy's."""


def test_arguments_become_plain_copies():
    values = np.ones((2, 3))
    checked = real_array("values", values.view(Labelled), (2, 3))
    assert type(checked) is np.ndarray
    assert not checked.flags.writeable
    values[0, 0] = 2.0
    assert checked[0, 0] == 1.0
