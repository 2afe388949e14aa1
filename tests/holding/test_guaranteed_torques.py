"""Torques of which rest is the only outcome: in a slot whose best case may drop its box."""

from __future__ import annotations

import numpy as np
import pytest
from cases import block_between_walls, pressed_on_wall
from tests.simulation.holding_scenes import holding_scenes

from graspless_pin import (
    GuaranteedTorques,
    QuasistaticProblem,
    Stability,
    Torque,
    guaranteed_torques,
    stability,
)
from graspless_pin.errors import ArgumentError, NoSolutionError


@pytest.fixture(scope="module")
def slot() -> QuasistaticProblem:
    (scene,) = holding_scenes("slot", 1)
    return scene.problem()


@pytest.fixture(scope="module")
def found(slot: QuasistaticProblem) -> GuaranteedTorques:
    return guaranteed_torques(slot)


def test_the_best_case_in_a_slot_may_fail_and_others_do_not(
    slot: QuasistaticProblem, found: GuaranteedTorques
) -> None:
    assert stability(slot, found.best_case.torques).status is Stability.WEAK
    assert found.found
    assert found.verdict is not None
    assert found.verdict.status is Stability.STRONG
    assert stability(slot, found.torques).status is Stability.STRONG
    assert found.tried > 1
    assert 0.0 <= found.friction_share < 1.0


def test_the_margin_is_that_of_the_problem_s_own_cones(
    slot: QuasistaticProblem, found: GuaranteedTorques
) -> None:
    assert found.solution is not None
    forces = found.solution.contact_forces
    unbalanced = slot.W @ forces.ravel() + slot.external_wrench
    assert np.abs(unbalanced).max() < 1e-6 * slot.scales.force
    assert 0.0 < found.margin < found.best_case.margin
    assert "rest is the only outcome" in str(found)
    assert f"{found.best_case.margin:.4g} N" in str(found)


def test_torques_that_hold_are_left_as_they_are() -> None:
    problem = pressed_on_wall().with_changes(torque_limits=(0.0, 40.0))
    found = guaranteed_torques(problem)
    assert found.tried == 1
    assert found.solution is found.best_case
    least = guaranteed_torques(problem, Torque(0.1))
    assert least.found
    assert least.torques[0] <= found.torques[0]


def test_where_none_is_found_it_says_whether_that_is_proven() -> None:
    hopeless = guaranteed_torques(block_between_walls(0.5), static_friction="coulomb")
    assert not hopeless.found
    assert hopeless.verdict is not None
    assert hopeless.verdict.status is Stability.WEAK
    assert "not proven" in str(hopeless)
    with pytest.raises(NoSolutionError, match="not proven"):
        _ = hopeless.torques
    weak = guaranteed_torques(pressed_on_wall().with_changes(torque_limits=(0.0, 1.0)))
    assert not weak.found
    assert weak.tried == 0
    assert "not even the best case" in str(weak)


def test_bad_arguments_are_named() -> None:
    with pytest.raises(ArgumentError, match="problem"):
        guaranteed_torques("slot")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="objective"):
        guaranteed_torques(pressed_on_wall(), "margin")  # type: ignore[arg-type]
