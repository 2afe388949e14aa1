"""Verdicts under a declared motion: cases known by hand, an enumeration, and invariances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases import GRAVITY, HALF, box_inertia
from tests.oracles.kept_cases import compared

from graspless_pin import QuasistaticProblem, Stability, StabilityVerdict, load_scene, stability
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

FORWARD = (0.1, 0.0, 0.0)


def pushed_block(
    friction: float = 0.5, height: float = 0.0, rubbing: float = 0.0
) -> QuasistaticProblem:
    """A cube of 1 kg on a table that slides along x, pushed by a linear finger of 0.1 kg."""
    corners = [(x, y, -HALF) for x in (-HALF, HALF) for y in (-HALF, HALF)]
    jacobian = np.zeros((15, 1))
    jacobian[12] = 1.0
    return QuasistaticProblem(
        [*corners, (-HALF, 0.0, height)], [(0.0, 0.0, 1.0)] * 4 + [(1.0, 0.0, 0.0)],
        [0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.0], jacobian, friction=[friction] * 4 + [rubbing],
        sliding=[FORWARD] * 4 + [(0.0, 0.0, 0.0)], joint_units=["N"],
        object_inertia=box_inertia(), joint_inertia=[[0.1]], torque_limits=(-100.0, 100.0),
    )  # fmt: skip


def rod(friction: float, load: float | None = None) -> QuasistaticProblem:
    """A rod of 1 kg that leans on two feet beside each other, which slide ahead of it along x.

    Its load balances normal forces of 10 N in all, or is a weight.
    """
    foot = np.array([1.0, 0.0, -2.0]) / math.sqrt(5.0)
    feet = foot + np.array([[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]])
    push = np.array([-friction, 0.0, 1.0])
    wrench = -10.0 * np.concatenate([push, np.cross(foot, push)])
    if load is not None:
        wrench = np.array([0.0, 0.0, -load, 0.0, 0.0, 0.0])
    return QuasistaticProblem(
        feet, [(0.0, 0.0, 1.0)] * 2, wrench, friction=friction, sliding=[(1.0, 0.0, 0.0)] * 2,
        object_inertia=np.diag([1.0, 1.0, 1.0, 1 / 3, 1 / 3, 1 / 3]),
        joint_inertia=np.zeros((0, 0)),
    )  # fmt: skip


def test_a_pushed_block_keeps_its_motion() -> None:
    said = stability(pushed_block(), [0.5 * GRAVITY])
    assert said.status is Stability.STRONG
    assert said.message.startswith("keeps its motion: nothing else is an outcome (proof: ")
    assert said.rest_forces is not None
    np.testing.assert_allclose(said.rest_forces[:4, 0], -0.5 * said.rest_forces[:4, 2], atol=1e-9)


def test_a_rigid_finger_that_rubs_may_carry_some_of_the_weight() -> None:
    said = stability(pushed_block(rubbing=0.3), [0.5 * GRAVITY])
    assert said.status is Stability.WEAK
    assert said.motion is not None
    carried = said.motion.contact_forces[4, 2]
    expected = 0.5 * carried / 1.1
    np.testing.assert_allclose(said.motion.object_acceleration[0], expected, rtol=1e-6)
    lifting = np.zeros((15, 1))
    lifting[14] = 1.0
    follows = pushed_block(rubbing=0.3).with_changes(
        jacobian=np.hstack([pushed_block().jacobian, lifting]), joint_units=["N", "N"],
        joint_inertia=np.diag([0.1, 0.1]), joint_names=["push", "lift"],
        torque_limits=(-100.0, 100.0), gravity_torques=np.zeros(2),
    )  # fmt: skip
    assert stability(follows, [0.5 * GRAVITY, 0.0]).status is Stability.STRONG


@pytest.mark.parametrize("force", [0.4 * GRAVITY, 0.6 * GRAVITY])
def test_another_force_changes_the_speed_as_newton_says(force: float) -> None:
    said = stability(pushed_block(), [force])
    assert said.status is Stability.NONE
    assert said.message.startswith("loses its motion: keeping the motion is no outcome")
    assert said.motion is not None
    expected = (force - 0.5 * GRAVITY) / 1.1
    np.testing.assert_allclose(said.motion.object_acceleration[0], expected, rtol=1e-6)
    np.testing.assert_allclose(said.motion.joint_accelerations, expected, rtol=1e-6)
    assert set(said.motion.states[:4]) <= {"closed", "open"}


@pytest.mark.parametrize(("height", "status"), [
    (0.24 * HALF, Stability.STRONG), (0.26 * HALF, Stability.NONE),
])  # fmt: skip
def test_a_block_pushed_above_its_tipping_height_tips(height: float, status: Stability) -> None:
    # Its friction 0.8 m g on the lever height + HALF against its weight on HALF.
    said = stability(pushed_block(0.8, height), [0.8 * GRAVITY])
    assert said.status is status
    if status is Stability.NONE:
        assert said.motion is not None
        assert said.motion.object_acceleration[4] > 0.0
        assert said.motion.states[:2] == ("open", "open")


def test_a_rod_that_rubs_little_keeps_its_motion() -> None:
    # A newton makes u_n = 1 + 3 cos (cos - mu sin) there: 1 for mu = 0.5, -0.8 for mu = 2.
    assert stability(rod(0.5), []).status is Stability.STRONG


def test_painleves_rod_may_lift_off() -> None:
    said = stability(rod(2.0), [])
    assert said.status is Stability.WEAK
    assert said.message.startswith("may lose its motion: the object can ")
    assert said.motion is not None
    assert said.motion.states == ("open", "open")
    assert said.motion.object_acceleration[2] == pytest.approx(-10.0)
    assert not said.motion.contact_forces.any()


def test_painleves_rod_under_its_weight_jams() -> None:
    said = stability(rod(2.0, GRAVITY), [])
    assert said.status is Stability.NONE
    assert said.motion is None
    assert "nothing else is" in said.message
    light = stability(rod(0.5, GRAVITY), [])
    assert light.status is Stability.NONE
    assert light.motion is not None
    assert light.motion.contact_forces[:, 2].sum() == pytest.approx(GRAVITY)


def test_without_load_what_rubs_is_asked_all_the_same() -> None:
    bare = rod(0.5).with_changes(external_wrench=np.zeros(6))
    assert stability(bare, []).status is Stability.STRONG


def test_sliding_without_friction_is_like_rest() -> None:
    said = stability(pushed_block(0.0, rubbing=0.0), [0.0])
    assert said.status is Stability.STRONG
    assert said.programs == 1
    assert said.proof is not None
    assert said.proof.forces is not None


def test_the_contacts_that_resist_are_named() -> None:
    problem = pushed_block()
    said = stability(problem, [0.5 * GRAVITY], node_limit=3)
    assert said.status is Stability.UNDECIDED
    assert "3 sets of outcomes examined" in said.message
    assert "what resists: contact" in said.message
    bare = problem.with_changes(object_inertia=None, joint_inertia=None)
    assert "object_inertia" in stability(bare, [0.5 * GRAVITY]).message


def commanded(friction: float, force: float, rubbing: float) -> StabilityVerdict:
    """A hybrid finger presses the sliding block on the table, another joint pushes it."""
    block = pushed_block(friction)
    jacobian = np.zeros((18, 2))
    jacobian[:15, :1], jacobian[17, 1] = block.jacobian, -1.0
    problem = QuasistaticProblem(
        [*block.positions, (0.0, 0.0, HALF)], [*block.normals, (0.0, 0.0, -1.0)],
        block.external_wrench, jacobian, friction=[*block.friction, rubbing],
        sliding=[*block.sliding, FORWARD], joint_units=["N", "N"],
        object_inertia=box_inertia(), joint_inertia=np.diag([0.1, 0.0]),
        torque_limits=(-100.0, 100.0),
    )  # fmt: skip
    return stability(problem, [force, 5.0])


def test_a_commanded_force_rubs_too() -> None:
    needed = 0.5 * (GRAVITY + 5.0)
    assert commanded(0.5, needed, 0.0).status is Stability.STRONG
    assert commanded(0.5, needed, 0.2).status is Stability.NONE
    assert commanded(0.5, needed + 1.0, 0.2).status is Stability.STRONG


@pytest.mark.sampled(6)
@pytest.mark.parametrize(("contacts", "number"), [
    *((2, number) for number in range(12)), (3, 2), (3, 6),
])  # fmt: skip
def test_verdicts_agree_with_the_enumeration_of_contact_states(contacts: int, number: int) -> None:
    status, fault = compared(contacts, 6, number)
    assert fault == ""
    assert status != "undecided"


PINCHED = """
friction: {hand: 0.8, supports: 0.4}
hand:
  mounts:
    - prefix: left/
      robot: lever_100mm
      base_pose: {position: [0, -0.03, 0.13], rpy: [3.1415927, 1.5707963, 0]}
    - prefix: right/
      robot: lever_100mm_mirrored
      base_pose: {position: [0, 0.03, 0.13], rpy: [0, 1.5707963, 0]}
object:
  shape: {type: box, size: [0.06, 0.06, 0.06]}
  mass: 0.3
  pose: {position: [0, 0, 0.03]}
"""
TABLE = "supports: [{name: table, shape: {type: half_space}}]\n"


@pytest.mark.parametrize(
    "motion", ["linear: [0, 0, 0.05]", "linear: [0, 0, 0.02], angular: [0, 0.1, 0]"]
)
def test_contacts_that_a_motion_parts_have_no_part_in_small_motions(tmp_path, motion) -> None:
    """A block that is lifted off a table stays in its pinch as one that hangs there alone."""
    file = tmp_path / "scene.yaml"
    verdicts = []
    for below in (TABLE + f"motion: {{object_twist: {{{motion}}}}}\n", ""):
        file.write_text(PINCHED + below)
        scene = load_scene(file)
        solution = scene.solve()
        verdicts.append(scene.stability(solution.torques))
        assert verify_document(solution_document(solution, scene, verdicts[-1])).passed
    lifted, hanging = verdicts
    assert lifted.status is hanging.status is Stability.STRONG
    assert lifted.holding is hanging.holding
    assert lifted.growth_rate == pytest.approx(hanging.growth_rate, abs=1e-6)
    assert lifted.stiffness_needed == pytest.approx(hanging.stiffness_needed, rel=1e-6)
    assert lifted.small_motions is not None and lifted.small_motions.proofs
