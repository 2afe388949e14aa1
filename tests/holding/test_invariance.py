"""What must not turn a verdict: frame, tangents, order and units; corners that are no plane."""

from __future__ import annotations

import json

import numpy as np
import pytest
from cases import (
    GRAVITY,
    HALF,
    block_between_walls,
    block_on_slope,
    pressed_in_slot,
    pressed_on_wall,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from same_problems import off_the_plane, told_otherwise
from test_declared_motions import pushed_block, rod
from tests.oracles.compared_outcomes import outcome_case
from tests.oracles.kept_cases import kept_problem
from tests.simulation.holding_scenes import room_corner, slot, solvable_scenes, wall_and_table

from graspless_pin import (
    QuasistaticProblem,
    Stability,
    StabilityVerdict,
    maximize_margin,
    stability,
)
from graspless_pin.report import solution_document
from graspless_pin.report.verify.reading import read_problem
from graspless_pin.report.verify.rest import rest_checks

NODES = 300
BY_HAND = (
    (block_on_slope(0.5, 0.35), []),
    (block_on_slope(0.5, 0.5), []),
    (block_between_walls(0.4), []),
    (pressed_on_wall(), [12.0]),
    (pressed_on_wall(), [25.0]),
    (pressed_in_slot(), [12.0]),
)
DECLARED = (
    (pushed_block(), [0.5 * GRAVITY]),
    (pushed_block(0.8, 0.2 * HALF, 0.3), [0.8 * GRAVITY]),
    (pushed_block(0.8, 0.5 * HALF), [0.8 * GRAVITY]),
    (rod(0.5), []),
    (rod(2.0), []),
)


def turns(before: StabilityVerdict, after: StabilityVerdict) -> bool:
    """Whether one of two verdicts says other than the other, and both say something."""
    said = {before.status, after.status} - {Stability.UNDECIDED}
    return len(said) > 1


def turned(problem: QuasistaticProblem, torques: np.ndarray, seed: int) -> bool:
    other, others, *_ = told_otherwise(problem, torques, np.random.default_rng(seed))
    return turns(
        stability(problem, torques, node_limit=NODES), stability(other, others, node_limit=NODES)
    )


@settings(max_examples=3)
@given(st.sampled_from(range(len(BY_HAND))), st.integers(0, 2**32 - 1))
def test_verdicts_known_by_hand_are_the_same_told_otherwise(case: int, seed: int) -> None:
    problem, torques = BY_HAND[case]
    assert not turned(problem, np.array(torques), seed)


@settings(max_examples=3)
@given(st.sampled_from(range(len(DECLARED))), st.integers(0, 2**32 - 1))
def test_verdicts_on_motions_known_by_hand_are_the_same_told_otherwise(
    case: int, seed: int
) -> None:
    problem, torques = DECLARED[case]
    other, others, *_ = told_otherwise(problem, np.array(torques), np.random.default_rng(seed))
    assert stability(other, others).status is stability(problem, torques).status


@settings(max_examples=6)
@given(st.integers(2, 4), st.integers(0, 10**6))
def test_verdicts_on_random_bodies_are_the_same_told_otherwise(contacts: int, seed: int) -> None:
    case, problem = outcome_case(contacts, seed)
    assert not turned(problem, case.torques, seed)


@settings(max_examples=4)
@given(st.integers(2, 3), st.integers(0, 10**6))
def test_verdicts_on_declared_motions_are_the_same_told_otherwise(contacts: int, seed: int) -> None:
    case, _, problem = kept_problem(contacts, seed)
    assert not turned(problem, case.torques, seed)


def is_shown(problem: QuasistaticProblem, said: StabilityVerdict) -> bool:
    """Whether the checker accepts a verdict, its motion included."""
    made = solution_document(maximize_margin(problem), verdict=said)
    for joint, torque in zip(made["joints"], said.torques.tolist(), strict=True):
        joint["torque"] = torque
    made = json.loads(json.dumps(made))
    return all(check.passed for check in rest_checks(made, read_problem(made)))


def still_said(problem: QuasistaticProblem, torques: np.ndarray, size: float, seed: int) -> bool:
    """Whether points that move so much (m) turn no verdict, but to a motion that is shown."""
    moved = off_the_plane(problem, size, np.random.default_rng(seed))
    before = stability(problem, torques, node_limit=NODES)
    after = stability(moved, torques, node_limit=NODES)
    if not turns(before, after):
        return True
    return after.status is Stability.WEAK and is_shown(moved, after)


SIZES = st.floats(-9.0, -4.0).map(lambda exponent: 10.0**exponent)


@settings(max_examples=3)
@given(st.sampled_from(range(len(BY_HAND))), SIZES, st.integers(0, 2**32 - 1))
def test_corners_that_are_no_plane_turn_no_verdict(case: int, size: float, seed: int) -> None:
    problem, torques = BY_HAND[case]
    assert still_said(problem, np.array(torques), size, seed)


@pytest.mark.parametrize("family", [room_corner, slot, wall_and_table])
@settings(max_examples=1)
@given(size=SIZES, seed=st.integers(0, 2**32 - 1))
def test_boxes_whose_corners_are_no_plane_keep_their_verdicts(family, size, seed) -> None:
    scene = next(solvable_scenes(family, [1, 5], 1))
    for share in (1.0, 0.3):
        weight, best = scene.problem().gravity_torques, scene.solve("margin").torques
        assert still_said(scene.problem(), weight + share * (best - weight), size, seed)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-7, 1e-5, 1e-4])
def test_corners_that_are_no_plane_still_hold(size: float) -> None:
    rng = np.random.default_rng(3)
    for problem, torques in (BY_HAND[0], BY_HAND[3]):
        said = stability(off_the_plane(problem, size, rng), torques)
        assert said.status in (Stability.STRONG, Stability.UNDECIDED)


def test_a_motion_that_is_none_is_not_shown() -> None:
    said = stability(block_between_walls(0.4), [])
    assert is_shown(said.problem, said)
    lighter = said.problem.with_changes(external_wrench=0.5 * said.problem.external_wrench)
    assert not is_shown(lighter, said)
