"""Disturbances that certainly do no harm: thresholds known by hand, and what happens below them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cases import (
    GRAVITY,
    HALF,
    block_between_walls,
    block_on_slope,
    dynamics_of,
    hybrid_on_wall,
    pressed_on_wall,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from same_problems import told_otherwise
from tests.oracles.compared_outcomes import outcome_case
from tests.oracles.outcomes import enumerate_outcomes

from graspless_pin import (
    GuaranteedDisturbance,
    QuasistaticProblem,
    Stability,
    guaranteed_disturbance,
)
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.holding.bounds import States, outcome_bound
from graspless_pin.holding.dynamics import spread_towards
from graspless_pin.holding.unstable_motion import find_motion
from graspless_pin.holding.verdict import DualBound

PUSH = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]


def box_in_slot(floor: float = 0.4, walls: float = 0.5) -> QuasistaticProblem:
    """A cube on a floor between two walls that touch it and press nothing."""
    slot = block_between_walls(walls)
    sides = [(-HALF, 0.0, 0.0), (HALF, 0.0, 0.0)]
    corners = [(x, y, -HALF) for x in (-HALF, HALF) for y in (-HALF, HALF)]
    return slot.with_changes(
        positions=[*corners, *sides],
        normals=[(0.0, 0.0, 1.0)] * 4 + [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)],
        friction=[floor] * 4 + [walls] * 2,
        jacobian=None, tangents=None, sliding=None, max_normal_force=50.0,
    )  # fmt: skip


def along(
    problem: QuasistaticProblem, torques: ArrayLike, *directions: ArrayLike, **options: Any
) -> GuaranteedDisturbance:
    return guaranteed_disturbance(
        problem, torques, np.array(directions), **{"precision": 0.1, **options}
    )


def check(found: GuaranteedDisturbance, exact: ArrayLike, width: float = 0.11) -> None:
    """Both ends are on their sides of the exact threshold, and near each other."""
    exact = np.asarray(exact)
    # Slower than the resolution of 0.001 loads is no motion.
    assert (found.guaranteed <= exact + 1e-3 * GRAVITY).all()
    assert (found.failing >= exact - 1e-9).all()
    assert (found.failing - found.guaranteed <= width * found.failing).all()


def test_a_block_that_is_pushed_slides_lifts_and_tips_where_newton_says() -> None:
    weight = 9.81
    found = along(
        block_on_slope(0.5, 0.0), [], PUSH, [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0],
        characteristic_length=1.0,
    )  # fmt: skip
    check(found, [0.5 * weight, weight, HALF * weight])
    np.testing.assert_allclose(found.possible, found.failing, rtol=1e-3)
    assert [one.status for one in found.failures if one is not None] == [Stability.NONE] * 3


def test_a_hundredth_of_all_forces_bears_a_hundredth() -> None:
    block = block_on_slope(0.5, 0.0)
    assert block.object_inertia is not None
    light = block.with_changes(
        external_wrench=0.01 * block.external_wrench,
        object_inertia=0.01 * block.object_inertia,
        max_normal_force=0.01 * block.max_normal_force,
    )
    heavy, found = along(block, [], PUSH), along(light, [], PUSH)
    assert found.failing[0] < 1.0
    # Where in its precision a bracket ends depends on rounding.
    np.testing.assert_allclose(100.0 * found.failing, heavy.failing, rtol=0.1)
    np.testing.assert_allclose(100.0 * found.guaranteed, heavy.guaranteed, rtol=0.1)
    assert (found.failing - found.guaranteed <= 0.11 * found.failing).all()


def test_what_presses_on_a_support_is_borne_as_far_as_was_looked() -> None:
    found = along(block_on_slope(0.5, 0.0), [], [0, 0, -1, 0, 0, 0], largest=20.0)
    assert found.guaranteed[0] == found.possible[0] == found.largest == 20.0
    assert found.failing[0] == np.inf
    assert found.failures == (None,)
    assert "no other outcome was found up to 20 N" in str(found)


def test_walls_that_might_squeeze_hold_in_the_best_case_only() -> None:
    found = along(box_in_slot(), [], PUSH, [0, 0, 1, 0, 0, 0], largest=50.0)
    check(found, [0.4 * GRAVITY, GRAVITY])
    np.testing.assert_allclose(found.possible, 50.0)
    assert [one.status for one in found.failures if one is not None] == [Stability.WEAK] * 2
    assert "contact forces can balance up to 50 N" in str(found)


def test_a_finger_bears_what_its_friction_and_the_wall_s_do() -> None:
    found = along(pressed_on_wall(), [20.0], [0, 0, -1, 0, 0, 0])
    check(found, [20.0 - GRAVITY])


def test_a_commanded_force_guarantees_its_own_friction_whatever_the_inertia() -> None:
    bare = hybrid_on_wall().with_changes(object_inertia=None)
    found = along(bare, [25.0], [0, 0, -1, 0, 0, 0])
    np.testing.assert_allclose(found.guaranteed, 12.5 - GRAVITY, rtol=0.1)
    assert found.guaranteed[0] <= 12.5 - GRAVITY
    np.testing.assert_allclose(found.failing, 25.0 - GRAVITY, rtol=1e-3)


def test_nothing_is_guaranteed_of_what_may_move_anyway() -> None:
    found = along(block_between_walls(0.5), [], PUSH)
    assert not found.found
    assert np.isnan(found.guaranteed).all()
    assert "nothing guaranteed: may fail" in str(found)
    with pytest.raises(NoSolutionError, match="guaranteed"):
        _ = found.worst


def test_a_search_that_ends_early_guarantees_less_and_nothing_wrong() -> None:
    quick = along(block_on_slope(0.5, 0.0), [], PUSH, node_limit=3)
    assert quick.guaranteed[0] < 0.25 * GRAVITY
    np.testing.assert_allclose(quick.failing, 0.5 * GRAVITY, rtol=1e-3)
    # Certificates take no nodes.
    assert along(block_on_slope(0.5, 0.0), [], PUSH, node_limit=0).guaranteed[0] >= 0.0


@pytest.mark.parametrize("number", [2])
def test_no_outcome_of_the_enumeration_is_inside_what_is_guaranteed(number: int) -> None:
    case, problem = outcome_case(3, number)
    rng = np.random.default_rng(number)
    largest = 2.0 * problem.scales.force
    found = along(problem, case.torques, *rng.normal(size=(1, 6)), largest=largest)
    scale = np.repeat([1.0, found.characteristic_length], 3)
    for index, unit in enumerate(found.directions):
        for multiple, expected in (
            (rng.uniform(0.0, 1.0) * found.guaranteed[index], ("strong", "between")),
            (found.failing[index], ("weak", "none", "between")),
        ):
            wrench = case.external_wrench + multiple * scale * unit
            answer = enumerate_outcomes(replace(case, external_wrench=wrench), sectors=8)
            assert answer.status in expected


def test_bounds_of_spread_loads_hold_for_outcomes_of_each_load_between() -> None:
    rng = np.random.default_rng(1)
    tight = np.inf
    for first, last in (((4.0, 1.0), (8.0, -3.0)), ((6.0, 0.0), (6.0, 6.0))):
        block = block_on_slope(0.3, 0.0)
        ends, between = np.array([first, last]), rng.uniform(0.0, 1.0, 6)
        loads = ends[0] + between[:, None] * (ends[1] - ends[0])
        wrenches = [[*load, -GRAVITY, 0.0, 0.0, 0.0] for load in (*ends, *loads)]
        one, other, *others = (
            dynamics_of(block.with_changes(external_wrench=wrench)) for wrench in wrenches
        )
        for own in others:
            found = find_motion(own)
            assert found is not None
            y = own.scaled_acceleration(found)
            # The end whose power is larger has the outcome.
            here, there = sorted(
                (one, other), key=lambda end: -end.force_unit * float(end.load @ y)
            )
            spread = spread_towards(here, there)
            ratio = own.force_unit / here.force_unit
            forces, y = ratio * found, ratio * y
            for _ in range(100):
                size = 10.0 ** rng.uniform(-3.0, 1.0)
                count = len(forces)
                dual = DualBound(
                    size * rng.normal(size=6), size * rng.normal(size=count),
                    size * rng.normal(size=(count, 2)),
                )  # fmt: skip
                goal = rng.normal(size=6), rng.normal(size=(count, 3))
                reached = float(goal[0] @ y + (goal[1] * forces).sum())
                states = States.all_free(count)
                bound = outcome_bound(spread, states, 0.5 * forces[:, 0], dual, goal, 10.0)
                assert bound >= reached - 1e-9
                tight = min(tight, bound - reached)
    assert tight < 5.0


@settings(max_examples=2)
@given(st.integers(0, 2**32 - 1))
def test_frame_units_and_order_change_nothing(seed: int) -> None:
    block = box_in_slot().with_changes(
        positions=[(-HALF, -HALF, -HALF), (HALF, -HALF, -HALF), (0.0, HALF, -HALF)],
        normals=[(0.0, 0.0, 1.0)] * 3, friction=0.4,
        jacobian=None, tangents=None, sliding=None, max_normal_force=50.0,
    )  # fmt: skip
    told = told_otherwise(block, np.zeros(0), np.random.default_rng(seed))
    direction = np.array([0.3, 0.0, 1.0, 0.0, 0.1, 0.0])
    one, two = along(block, [], direction), along(told.problem, [], told.both @ direction)
    for name in ("guaranteed", "failing", "possible"):
        np.testing.assert_allclose(getattr(two, name), told.force * getattr(one, name), rtol=0.1)


@pytest.mark.parametrize(("options", "name"), [
    ({"directions": [[0.0] * 6]}, "directions"),
    ({"largest": -1.0}, "largest"),
    ({"characteristic_length": 0.0}, "characteristic_length"),
    ({"precision": 0.0}, "precision"),
    ({"precision": 0.9}, "precision"),
    ({"node_limit": -1}, "node_limit"),
])  # fmt: skip
def test_bad_options_are_named(options: dict[str, Any], name: str) -> None:
    given_options = {"directions": [PUSH], **options}
    with pytest.raises(ArgumentError, match=name):
        guaranteed_disturbance(block_on_slope(0.5, 0.0), [], **given_options)


def test_what_slides_is_refused_and_arrays_are_frozen() -> None:
    sliding = block_on_slope(0.5, 0.4).with_changes(sliding=np.tile([0.1, 0.0, 0.0], (4, 1)))
    with pytest.raises(ArgumentError, match="sliding contacts"):
        along(sliding, [], PUSH)
    found = along(block_on_slope(0.5, 0.0), [], [0, 0, -1, 0, 0, 0])
    for array in (found.directions, found.guaranteed, found.failing, found.possible):
        assert not array.flags.writeable
