"""Disturbances solved by hand, defaults and errors; brute force is in `test_brute_force.py`."""

import numpy as np
import pytest
from analysis_scenes import rules_of, scene_of
from force_oracle import ForceSet
from tests.core.scenes import scene

from graspless_pin import (
    QuasistaticProblem,
    Status,
    disturbance_margin,
    enumerate_modes,
    maximize_margin,
    minimum_friction,
)
from graspless_pin.errors import ArgumentError, NoSolutionError

_Q = np.sqrt(0.5)


def resting(friction: float = 0.5, wrench=(0, 0, -10, 0, 0, 0)) -> QuasistaticProblem:
    """10 N on one contact at the reference point, four cone edges along x and y."""
    return QuasistaticProblem(
        [[0, 0, 0]],
        [[0, 0, 1]],
        wrench,
        friction=friction,
        tangents=[[[1, 0], [0, 1], [0, 0]]],
        cone_edges=4,
    )


# Along an edge of the cone 0.5 * 10 N; between two of them cos 45 deg of that; the weight; up to
# the normal-force limit of 50 N.
BY_HAND = {
    "along an edge": ([1, 0, 0, 0, 0, 0], 5.0),
    "between edges": ([-2, 2, 0, 0, 0, 0], 5.0 * _Q),
    "lifting": ([0, 0, 3, 0, 0, 0], 10.0),
    "pressing": ([0, 0, -1, 0, 0, 0], 40.0),
    "turning": ([0, 0, 0, 0, 1, 0], 0.0),
    # Pressing with N more lets friction grow: s cos 45 deg = 0.5 (10 + s cos 45 deg).
    "pushed aslant": ([1, 0, -1, 0, 0, 0], 10.0 / _Q),
}


@pytest.mark.parametrize(("direction", "magnitude"), BY_HAND.values(), ids=BY_HAND)
def test_by_hand(direction, magnitude):
    found = disturbance_margin(resting(), directions=[direction])
    assert found.magnitudes[0] == pytest.approx(magnitude, abs=1e-5)


def test_the_worst_direction_is_reported():
    directions = np.array([direction for direction, _ in BY_HAND.values()])[[0, 1, 2, 3]]
    found = disturbance_margin(resting(), directions=directions, characteristic_length=0.2)
    assert found.found and found.worst == 1
    np.testing.assert_allclose(found.worst_wrench, [-2.5, 2.5, 0, 0, 0, 0], atol=1e-5)
    assert str(found).startswith("smallest disturbance margin of 4 directions: 3.536 N")


def test_default_directions_cover_forces_and_moments():
    problem = scene("sphere")
    found = disturbance_margin(problem)
    again = disturbance_margin(problem)
    np.testing.assert_array_equal(found.directions, again.directions)
    np.testing.assert_array_equal(found.magnitudes, again.magnitudes)
    np.testing.assert_array_equal(found.directions[:12], np.vstack([np.eye(6), -np.eye(6)]))
    np.testing.assert_allclose(np.linalg.norm(found.directions, axis=1), 1.0)
    assert len(found.directions) == 76
    # Quasi-uniform: no direction is far from all, and the mean vanishes.
    sample = np.random.default_rng(0).normal(size=(2000, 6))
    sample /= np.linalg.norm(sample, axis=1, keepdims=True)
    assert (sample @ found.directions.T).max(axis=1).min() > 0.4
    assert np.linalg.norm(found.directions[12:].mean(axis=0)) < 0.1
    length = np.linalg.norm(problem.positions, axis=1).max()
    assert found.characteristic_length == pytest.approx(length)
    assert found.magnitudes.min() == found.magnitudes[found.worst] > 0.0


def test_the_length_weighs_moments():
    """A moment direction counts in newton times the length: half the length, twice the newtons."""
    problem, turn = scene("rest"), np.eye(6)[3:]
    one = disturbance_margin(problem, directions=turn, characteristic_length=0.1)
    half = disturbance_margin(problem, directions=turn, characteristic_length=0.05)
    np.testing.assert_allclose(half.magnitudes, 2.0 * one.magnitudes, rtol=1e-5)


@pytest.mark.parametrize("name", ["sphere", "up"])
def test_fixed_torques_hold_less_than_free_ones(name):
    problem = scene(name)
    ways = np.vstack([np.eye(6), -np.eye(6)])
    free = disturbance_margin(problem, directions=ways)
    held = disturbance_margin(problem, maximize_margin(problem).torques, ways)
    assert (held.magnitudes <= free.magnitudes + 1e-5).all()
    assert (held.magnitudes < free.magnitudes - 0.1).any()


def test_an_object_that_only_a_push_balances_is_not_balanced():
    """Without friction a push of 5 N along x balances exactly -5 N, and nothing else does."""
    problem = resting(0.0, (-5, 0, -10, 0, 0, 0))
    found = disturbance_margin(problem, directions=[[1, 0, 0, 0, 0, 0]])
    assert not found.found and found.status in (Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES)
    assert np.isnan(found.magnitudes).all()
    assert str(found).startswith("not found: infeasible")
    with pytest.raises(NoSolutionError, match="no disturbance margin"):
        _ = found.worst


def test_a_disturbance_beyond_a_gap_does_not_count():
    """Between two balanced disturbances of one direction lie some that no mode balances."""
    problem = scene_of("structured", 5, 3)
    rules = rules_of(("strict", "constrained"))
    best = ForceSet(problem, maximize_margin(problem, **rules).mode)
    torques = problem.jacobian.T @ best.best_case()[1] + problem.gravity_torques
    direction = np.random.default_rng(49).normal(size=(3, 6))[2]
    wrench = direction / np.linalg.norm(direction) * np.repeat([1.0, 0.1], 3)
    modes = enumerate_modes(problem, sign_rule="strict", sliding_rule="constrained", maximal=True)
    intervals = [
        ends
        for mode in modes
        if (ends := ForceSet(problem, mode, torques=torques).multiples(wrench)) is not None
    ]
    assert max(last for first, last in intervals if first < 1e-6) < 1e-6
    assert min(first for first, _ in intervals if first > 1e-6) > 0.01
    found = disturbance_margin(problem, torques, [direction], characteristic_length=0.1, **rules)
    assert found.found and found.magnitudes[0] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("friction", [0.2, 0.5, 3.0, 100.0])
def test_least_friction_on_a_slope_by_hand(friction):
    """A point on a slope of 30 degrees, an edge of the cone uphill, needs mu = tan 30 deg."""
    wrench = [-5.0, 0, -5.0 * np.sqrt(3), 0, 0, 0]
    least = minimum_friction(resting(friction, wrench))
    assert least.found
    assert least.factor == pytest.approx(np.tan(np.pi / 6) / friction, rel=1e-5)


def test_least_friction_that_is_none_or_never_enough():
    assert minimum_friction(resting()).factor == 0.0
    lifted = minimum_friction(resting(wrench=(0, 0, 1, 0, 0, 0)))
    assert not lifted.found and np.isnan(lifted.factor)
    # 0.01 would have to be 58 times as large: beyond what is looked for.
    assert not minimum_friction(resting(0.01, (-5.0, 0, -5.0 * np.sqrt(3), 0, 0, 0))).found


def test_least_kinetic_friction_is_found_where_it_balances():
    """Sliding downhill at constant speed takes mu = tan 30 deg exactly."""
    problem = resting(0.4, (-5.0, 0, -5.0 * np.sqrt(3), 0, 0, 0))
    exact = problem.with_changes(sliding=[[-0.1, 0, 0]], friction=np.tan(np.pi / 6))
    assert minimum_friction(exact).factor == pytest.approx(1.0, abs=1e-6)


WRONG = {
    "directions": ({"directions": [[1.0, 0, 0]]}, "directions: "),
    "zero": ({"directions": np.zeros((1, 6))}, "directions: is zero at index 0"),
    "torques": ({"torques": [1.0]}, "torques: "),
    "length": ({"characteristic_length": 0.0}, "characteristic_length: is 0.0"),
    "negative": ({"characteristic_length": -1.0}, "characteristic_length: is -1.0"),
    "rule": ({"sliding_rule": "free"}, "sliding_rule: is 'free'"),
}


@pytest.mark.parametrize(("options", "message"), WRONG.values(), ids=WRONG)
def test_bad_arguments_are_named(options, message):
    with pytest.raises(ArgumentError) as caught:
        disturbance_margin(scene("rest"), **options)
    assert str(caught.value).startswith(message)
