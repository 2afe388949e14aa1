"""Verdicts: cases that are known by hand, what they rest on, and bad arguments."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from cases import (
    GRAVITY,
    block_between_walls,
    block_on_slope,
    hybrid_on_wall,
    pressed_on_wall,
)
from tests.simulation.holding_scenes import slope, slot

from graspless_pin import QuasistaticProblem, Stability, StabilityVerdict, stability
from graspless_pin.errors import ArgumentError

CRITICAL = math.atan(0.5)


def verdict(problem: QuasistaticProblem, *torques: float, **options: Any) -> StabilityVerdict:
    return stability(problem, torques, **options)


@pytest.mark.parametrize(("angle", "status"), [
    (0.0, Stability.STRONG),
    (0.99 * CRITICAL, Stability.STRONG),
    (1.01 * CRITICAL, Stability.NONE),
])  # fmt: skip
def test_a_block_slides_above_the_angle_of_friction(angle: float, status: Stability) -> None:
    assert verdict(block_on_slope(0.5, angle)).status is status


def test_a_block_that_slides_accelerates_as_newton_says() -> None:
    angle = 1.5 * CRITICAL
    motion = verdict(block_on_slope(0.5, angle)).motion
    assert motion is not None
    expected = GRAVITY * (math.sin(angle) - 0.5 * math.cos(angle))
    np.testing.assert_allclose(motion.object_acceleration, [expected, 0, 0, 0, 0, 0], atol=1e-9)
    assert set(motion.states) == {"slipping"}
    np.testing.assert_allclose(motion.contact_forces[:, 2].sum(), GRAVITY * math.cos(angle))


def test_a_block_between_walls_that_nothing_presses_may_fall() -> None:
    said = verdict(block_between_walls(0.5))
    assert said.status is Stability.WEAK
    assert said.rest_forces is not None
    assert said.motion is not None
    assert said.motion.object_acceleration[2] < 0.0
    assert "may fail" in str(said)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("inertia", [1e-5, 1e-4, 1.0])
@pytest.mark.parametrize(("force", "status"), [
    (9.7, Stability.NONE), (11.0, Stability.STRONG), (25.0, Stability.STRONG),
])  # fmt: skip
def test_a_finger_holds_a_block_on_a_wall(force: float, status: Stability, inertia: float) -> None:
    assert verdict(pressed_on_wall(inertia=inertia), force).status is status


def test_certificates_need_few_programs() -> None:
    assert verdict(block_on_slope(0.5, 0.0)).programs == 1
    assert "1 LP" in str(verdict(block_on_slope(0.5, 0.0)))
    said = verdict(pressed_on_wall(), 25.0)
    assert said.proof is not None
    assert said.proof.forces is not None
    assert said.proof.loads[0].force > GRAVITY / 0.5


def test_a_commanded_force_is_a_load_that_holds_for_every_inertia() -> None:
    said = verdict(hybrid_on_wall(), 25.0)
    assert said.status is Stability.STRONG
    assert said.programs == 1
    assert verdict(hybrid_on_wall().with_changes(object_inertia=None), 25.0).status is (
        Stability.STRONG
    )
    assert verdict(hybrid_on_wall(), 9.7).status is Stability.NONE


def test_without_inertias_only_what_holds_for_each_is_said() -> None:
    for make, torques, status in (
        (block_on_slope(0.5, 0.0), (), Stability.STRONG),
        (block_on_slope(0.5, 0.2), (), Stability.UNDECIDED),
        (pressed_on_wall(), (25.0,), Stability.UNDECIDED),
        (pressed_on_wall(), (5.0,), Stability.NONE),
    ):
        bare = make.with_changes(object_inertia=None, joint_inertia=None)
        said = verdict(bare, *torques)
        assert said.status is status
        assert math.isnan(said.acceleration_limit)
        if status is Stability.UNDECIDED:
            assert "object_inertia" in said.message


def test_no_load_moves_nothing() -> None:
    still = block_on_slope(0.5, 0.0).with_changes(external_wrench=np.zeros(6))
    assert verdict(still).status is Stability.STRONG


def test_a_limit_counts_nodes_and_says_how_far_it_came() -> None:
    first, again = (verdict(pressed_on_wall(), 11.0, node_limit=20) for _ in range(2))
    assert first.status is Stability.UNDECIDED
    assert first.nodes == 20
    # What more would take is an estimate from the time that these nodes took.
    assert first.message == again.message and first.next_nodes == again.next_nodes
    assert "20" in first.message
    assert verdict(pressed_on_wall(), 11.0, time_limit=0.0).status is Stability.UNDECIDED


def test_a_coarser_resolution_takes_a_slow_slide_for_rest() -> None:
    slow = block_on_slope(0.5, 0.0).with_changes(external_wrench=[4.95, 0, -9.81, 0, 0, 0])
    said = verdict(slow)
    assert said.status is Stability.NONE
    assert said.motion is not None
    np.testing.assert_allclose(said.motion.object_acceleration[0], 0.045, rtol=1e-6)
    assert verdict(slow, acceleration_resolution=1e-2).motion is None


@pytest.mark.parametrize(("options", "name"), [
    ({"acceleration_resolution": 0.0}, "acceleration_resolution"),
    ({"acceleration_resolution": 0.011}, "acceleration_resolution"),
    ({"node_limit": -1}, "node_limit"),
    ({"time_limit": -1.0}, "time_limit"),
])  # fmt: skip
def test_bad_options_are_named(options: dict[str, Any], name: str) -> None:
    with pytest.raises(ArgumentError, match=name):
        verdict(block_on_slope(0.5, 0.0), **options)


def test_bad_torques_and_problems_are_named() -> None:
    with pytest.raises(ArgumentError, match="torques"):
        verdict(pressed_on_wall())
    with pytest.raises(ArgumentError, match="problem"):
        stability("scene.yaml", [])  # type: ignore[arg-type]
    massless = pressed_on_wall().with_changes(
        jacobian=np.hstack([pressed_on_wall().jacobian, np.ones((15, 1))]),
        joint_units=["N", "N"], joint_inertia=np.diag([0.01, 0.0]),
        torque_limits=(-10.0, 10.0), gravity_torques=np.zeros(2), joint_names=["a", "b"],
    )  # fmt: skip
    with pytest.raises(ArgumentError, match="'b'"):
        verdict(massless, 5.0, 0.0)


def test_rest_forces_balance_the_load_however_coarse_the_resolution() -> None:
    said = verdict(block_on_slope(0.5, 1e-4))
    assert said.status is Stability.STRONG
    assert said.rest_forces is not None
    problem = said.problem
    left = problem.W @ said.rest_forces.ravel() + problem.external_wrench
    assert np.abs(left).max() < 1e-6 * problem.scales.force
    assert verdict(block_on_slope(0.0, 1e-4)).status is Stability.NONE


def test_kinematics_with_large_multipliers_close_sets_so_that_the_motion_is_reached() -> None:
    scene = slot(np.random.default_rng([0, 3, 6]))
    problem, weight = scene.problem(), scene.problem().gravity_torques
    torques = weight + 0.3 * (scene.solve("margin").torques - weight)
    said = stability(problem, torques)
    assert said.status is Stability.WEAK
    assert said.nodes < 1000


def test_sets_that_kept_proofs_close_do_not_count() -> None:
    scene = slope(np.random.default_rng([0, 0, 10]))
    torques = scene.solve("torque").torques
    said = stability(scene.problem(), torques, node_limit=2500)
    assert said.status is Stability.STRONG
    assert said.nodes <= said.programs


@pytest.mark.parametrize(
    ("turning", "status"),
    [((0.1, 0.1), Stability.WEAK), ((0.114, 0.176), Stability.STRONG)],
)
def test_a_contact_without_friction_that_always_bears_is_closed(
    turning: tuple[float, float], status: Stability
) -> None:
    """Two bodies in a plane, whose 16 combinations of contact states were gone through by LP."""
    normal = np.array([[0, 1, -0.5, 0, -1, 0.5], [0, 0, 0, 1, 0, -0.25], [-1, 0, -2, 1, 0, 0.5]])
    along = np.array([[1, 0, -0.5, -1, 0, 2], [0, 0, 0, 0, -1, -0.5], [0, 1, 0.5, 0, -1, -0.5]])
    ways = np.stack([normal.T, along.T, np.zeros((6, 3))], axis=2).reshape(6, 9)
    problem = QuasistaticProblem(
        np.zeros((3, 3)), [(1.0, 0.0, 0.0)] * 3, along[0] - [1.0, 0.2, 1.0] @ normal,
        friction=[1.2, 0.0, 0.0], wrench_matrix=ways, passive_units=["N", "N", "N m"] * 2,
        tangents=np.tile([[0, 0], [1, 0], [0, 1]], (3, 1, 1)),
        object_inertia=np.diag([1.0, 1.0, turning[0], 1.0, 1.0, turning[1]]),
    )  # fmt: skip
    assert verdict(problem).status is status
