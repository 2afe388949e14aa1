"""Candidates for a hand's place: moved to the object, closed, and checked for their margins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import GrasplessPinError, StateError, internal_error
from graspless_pin.findings import capture
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.hand.model import Hand, displaced_hand
from graspless_pin.geometry.poses import invert, translated
from graspless_pin.geometry.posing.closing import (
    ClosingResult,
    centering_shift,
    close_hand,
    moved_bodies,
    retraction_distance,
    shortfall,
)
from graspless_pin.geometry.posing.finger_joints import (
    driving_columns,
    groups_of_fingers,
    palm_inverse_kinematics,
)
from graspless_pin.geometry.posing.opposing import carrier_links
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.holding.least_squares import nonnegative_squares
from graspless_pin.planning.placing_plan import (
    ClosedHand,
    Draw,
    HandPart,
    PlacingAim,
    PlacingPlan,
    draw_start,
)
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.quasistatic import contact_map
from graspless_pin.scene import Scene
from graspless_pin.scene.contact_arrays import support_bodies
from graspless_pin.scene.entry_findings import box_around
from graspless_pin.scene.scene_findings import hand_overlaps
from graspless_pin.solution import UNDECIDED, Status

_CLEAR_OF_OBJECT = 2e-4  # m, of the open hand
_APPROACHES = 4  # attempts of an arm to bring its palm to a place where the open hand is clear
_PALM_OFF, _PALM_TURNED = 0.03, 0.5  # m, rad: with a larger error the place is out of reach
_CENTERINGS = 12
_CENTERED = 2e-5  # m
_CONE_EDGES = 8  # of the cones of squeezing forces
_SQUEEZE_ERROR = 1e-6  # share of the squeeze
CANDIDATE_NODES = 200
"""Most nodes of the search for a candidate's torques."""


class PlacingFault(StrEnum):
    """Why a candidate is no place for the hand, in the order of the checks.

    See the example of `place_hand`.
    """

    words: str

    def __new__(cls, value: str, words: str) -> Self:
        """Make a member of its value and its words."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.words = words
        return member

    INTERNAL_ERROR = "internal-error", "an internal error occurred"
    OUT_OF_REACH = "out-of-reach", "the arm cannot move the palm there from its base"
    SUPPORT_IN_THE_WAY = "support-in-the-way", "a support is in the way of the open hand"
    OBJECT_IN_THE_WAY = "object-in-the-way", "the object is in the way of the open hand"
    TOUCHES_NOTHING = "touches-nothing", "the fingers close without touching the object"
    HAND_ON_SUPPORT = "hand-on-support", "the closed hand touches a support"
    HAND_THROUGH_ITSELF = "hand-through-itself", "the closed hand collides with itself"
    ONE_FINGER_ONLY = "one-finger-only", "only one finger touches the object"
    UNUSABLE_CONTACTS = "unusable-contacts", "the contacts cannot be used"
    NOTHING_OPPOSES = "nothing-opposes", "no two links squeeze the object between them"
    CANNOT_CARRY = "cannot-carry", "the hand cannot carry the object by itself"
    INFEASIBLE = "infeasible", "no torques within the limits hold the object"
    LOAD_TOO_LARGE = "load-too-large", "the load is too large for the limits of the joints"
    UNDECIDED = "undecided", "the search for torques ended without an answer"
    MARGIN_TOO_SMALL = "margin-too-small", "the margin is smaller than required"


@dataclass(frozen=True, eq=False)
class TriedCandidate:
    """The result of one candidate.

    Attributes:
        number: Number of the candidate.
        fault: Why it is no place for the hand; None: it is one.
        closed: The closed hand; None: there are no torques.
        error: The exception of an internal error, in words; empty: there was none.
    """

    number: int
    fault: PlacingFault | None
    closed: ClosedHand | None = None
    error: str = ""


def try_candidate(plan: PlacingPlan, number: int) -> TriedCandidate:
    """Try one candidate; the result depends on the plan and its number alone."""
    try:
        with capture():
            return _close_and_judge(plan, number)
    except GrasplessPinError:
        raise
    except Exception as error:  # costs this candidate, not the search, and is reported
        return TriedCandidate(number, PlacingFault.INTERNAL_ERROR, error=internal_error(error))


def _close_and_judge(plan: PlacingPlan, number: int) -> TriedCandidate:
    hand = plan.hand
    positions = hand.tree.coupling.independent(hand.positions)
    displacements = np.repeat(np.eye(4)[None], len(hand.base_poses), axis=0)
    draws = []
    for index, part in enumerate(plan.parts):
        rng = np.random.default_rng([plan.seed, number, *([index] if index else [])])
        draw = draw_start(plan, index, number, rng)
        closed_part = _close_at_object(plan, part, draw, rng)
        if isinstance(closed_part, PlacingFault):
            return TriedCandidate(number, closed_part)
        closing, T = closed_part
        columns = [k for name in part.fingers for k in driving_columns(hand, name)]
        columns += [] if part.arm is None else part.arm.columns
        positions[columns] = _idle_fingers_opened(part, draw, closing)[columns]
        displacements[list(part.mounts)] = T
        draws.append(draw)
    closed = hand.with_configuration(positions)
    hand = displaced_hand(closed, displacements)
    tolerance = plan.scene.contact_tolerance
    moved = frozenset().union(*(part.moved for part in plan.parts))
    if shortfall(_link_shapes(hand, moved), support_bodies(plan.scene), 1.5 * tolerance) > 0.0:
        return TriedCandidate(number, PlacingFault.HAND_ON_SUPPORT)
    # The overlaps of one rigid part do not depend on its place; pairs are cached for the first one.
    if unwanted_overlaps(closed if len(plan.parts) == 1 else hand, tolerance=tolerance):
        return TriedCandidate(number, PlacingFault.HAND_THROUGH_ITSELF)
    scene = plan.scene.with_changes(hand=hand)
    if hand_overlaps(scene):  # links that do not move, such as an arm's base, are in a support
        return TriedCandidate(number, PlacingFault.HAND_ON_SUPPORT)
    try:
        grip = _judge_grip(plan, scene, hand)
    except StateError:
        grip = PlacingFault.UNUSABLE_CONTACTS
    if isinstance(grip, PlacingFault):
        return TriedCandidate(number, grip)
    closed_hand = ClosedHand(tuple(draws), displacements, positions, *grip)
    fault = None
    if plan.aim is PlacingAim.CARRY and not closed_hand.carrying_margin >= plan.margin:
        fault = PlacingFault.CANNOT_CARRY
    elif closed_hand.margin < plan.margin:
        fault = PlacingFault.MARGIN_TOO_SMALL
    return TriedCandidate(number, fault, closed_hand)


def _judge_grip(
    plan: PlacingPlan, scene: Scene, hand: Hand
) -> PlacingFault | tuple[tuple[str, ...], float, float]:
    """Return the links that touch, the margin and the margin without supports, or a fault.

    Raises:
        StateError: If the contacts cannot be used.
    """
    touching = tuple(
        dict.fromkeys(body for body in scene.contacts.bodies if body in hand.link_names)
    )
    grips = plan.aim is not PlacingAim.PRESS
    fingers = {hand.finger_of(link) or link for link in touching}
    if len(fingers) < min(2, len(hand.fingers)) or (grips and len(touching) < 2):
        return PlacingFault.ONE_FINGER_ONLY
    alone = scene if not scene.supports else scene.with_changes(supports=(), motion=None)
    if grips and not can_squeeze(alone.problem(), alone.contacts.bodies):
        return PlacingFault.NOTHING_OPPOSES
    carrying = alone.solve("margin", node_limit=CANDIDATE_NODES)
    if plan.aim is PlacingAim.CARRY and not carrying.found:
        return PlacingFault.CANNOT_CARRY
    solution = carrying if alone is scene else scene.solve("margin", node_limit=CANDIDATE_NODES)
    if not solution.found:
        if solution.status is Status.LOAD_TOO_LARGE:
            return PlacingFault.LOAD_TOO_LARGE
        undecided = solution.status in UNDECIDED
        return PlacingFault.UNDECIDED if undecided else PlacingFault.INFEASIBLE
    return touching, solution.margin, carrying.margin if carrying.found else np.nan


def can_squeeze(problem: QuasistaticProblem, bodies: Sequence[str]) -> bool:
    """Return whether two bodies can squeeze the object: contact forces balance each other.

    Args:
        problem: Contacts with their friction; its load and joints are not used.
        bodies: M names of the touching bodies.
    """
    corners = problem.cone_model.section(_CONE_EDGES).corners
    along = contact_map(problem)[:, :, :6]
    edges = along[:, None, 0] + problem.friction[:, None, None] * (corners @ along[:, 1:])
    wrenches = edges.reshape(-1, 6).T
    size = float(np.abs(problem.positions).max())
    wrenches[3:] /= size
    squeeze = nonnegative_squares(
        np.vstack([wrenches, np.ones(wrenches.shape[1])]), np.append(np.zeros(6), 1.0)
    )
    if squeeze is None or np.linalg.norm(wrenches @ squeeze) > _SQUEEZE_ERROR * squeeze.sum():
        return False
    shares = squeeze.reshape(len(bodies), -1).sum(axis=1)
    return len({bodies[index] for index in np.flatnonzero(shares).tolist()}) > 1


def _close_at_object(
    plan: PlacingPlan, part: HandPart, draw: Draw, rng: np.random.Generator
) -> tuple[ClosingResult, FloatArray] | PlacingFault:
    """Move an open part of the hand to the object and close it there.

    Without an arm the hand stays and the object is moved relative to it, which is equivalent and
    faster.

    Returns:
        The closed hand, and the displacement of the part's mounts to the object; or a fault.
    """
    scene, posture = plan.scene, part.postures[draw.posture]
    pieces = scene.object.placed_bodies
    low, high = box_around(scene.object)
    farthest = float(np.linalg.norm(posture.meeting - posture.palm) + np.linalg.norm(high - low))
    obstacles = (
        (pieces, _CLEAR_OF_OBJECT),
        (support_bodies(scene), 2.0 * scene.contact_tolerance),
    )
    stance = _stance(part, plan.hand.with_configuration(draw.opened), draw.displacement, rng)
    for _ in range(_APPROACHES):
        if stance is None:
            return PlacingFault.OUT_OF_REACH
        hand, T = stance
        open_hand = moved_bodies(_link_shapes(hand, part.links), T)
        back, last = retraction_distance(open_hand, obstacles, draw.direction, farthest)
        if back is None:
            return (PlacingFault.OBJECT_IN_THE_WAY, PlacingFault.SUPPORT_IN_THE_WAY)[last]
        stance = _stance(part, hand, translated(T, -back * draw.direction), rng) if back else stance
        if part.arm is None or not back:
            break
    else:
        return PlacingFault.OBJECT_IN_THE_WAY
    rates = {
        name: float(rate)
        for name, rate in zip(
            plan.hand.control.joints, posture.closing_rates(draw.opened), strict=True
        )
        if rate != 0.0
    }
    together = _coupled_jaws(plan.hand, part.fingers)
    for remaining in reversed(range(_CENTERINGS)):
        if stance is None:
            return PlacingFault.OUT_OF_REACH
        hand, T = stance
        if remaining < _CENTERINGS - 1:
            open_hand = moved_bodies(_link_shapes(hand, part.links), T)
            if shortfall(open_hand, pieces, 0.0) > 0.0:
                break
        target = scene.object.with_pose(invert(T) @ scene.object.T_world_object)
        closing = close_hand(hand, target, fingers=part.fingers, wrap=draw.wrap, rates=rates)
        if not closing.touching:
            return PlacingFault.TOUCHES_NOTHING
        shift = _jaw_shift(closing, together, target.placed_bodies)
        if not remaining or np.linalg.norm(shift) < _CENTERED:
            return closing, T
        stance = _stance(part, hand, translated(T, T[:3, :3] @ shift), rng)
    return PlacingFault.OBJECT_IN_THE_WAY


def _stance(
    part: HandPart, hand: Hand, T: FloatArray, rng: np.random.Generator
) -> tuple[Hand, FloatArray] | None:
    """Return the hand and the displacement of its bases that displace a part by T together.

    Without an arm these are the same hand and T. An arm moves the palm as near to its goal as it
    can, and the bases stay; None: that is not near enough.
    """
    if part.arm is None:
        return hand, T
    goal = T @ hand.tree.kinematics(hand.positions).T_world_joint[part.arm.joint]
    positions, palm = palm_inverse_kinematics(hand, part.arm, goal, rng)
    turn = Rotation.from_matrix(goal[:3, :3].T @ palm[:3, :3]).magnitude()
    if np.linalg.norm(goal[:3, 3] - palm[:3, 3]) > _PALM_OFF or turn > _PALM_TURNED:
        return None
    return hand.with_configuration(positions), np.eye(4)


def _link_shapes(hand: Hand, links: frozenset[str]) -> PlacedBodies:
    """Return the collision shapes of some links."""
    bodies = hand.placed_bodies
    if links.issuperset(bodies.shapes.names):
        return bodies
    return PlacedBodies.of([body for body in bodies if body.name in links])


def _coupled_jaws(hand: Hand, fingers: Sequence[str]) -> list[list[Sequence[str]]]:
    """Return the links of the jaws on each motor that closes several; one jaw may be fixed."""
    if len(fingers) == 1:
        return [[hand.fingers[fingers[0]].links, carrier_links(hand, fingers[0])]]
    groups = groups_of_fingers(hand, fingers)
    return [[hand.fingers[name].links for name in group] for group in groups if len(group) > 1]


def _jaw_shift(
    closing: ClosingResult, together: Sequence[Sequence[Sequence[str]]], pieces: PlacedBodies
) -> FloatArray:
    """Return (3,) shift of a hand with which jaws on one motor touch on both sides, m."""
    touching = set(closing.touching)
    for jaws in together:
        if any(touching.intersection(links) for links in jaws):
            shift = centering_shift(closing.hand, jaws, pieces)
            if shift is not None:
                return shift
    return np.zeros(3)


def _idle_fingers_opened(part: HandPart, draw: Draw, closing: ClosingResult) -> FloatArray:
    """Return (a,) positions in which the fingers that touch nothing are open again."""
    hand = closing.hand
    positions = hand.tree.coupling.independent(hand.positions)
    idle = {closed.finger for closed in closing.fingers if not closed.touching}
    for group in groups_of_fingers(hand, part.fingers):
        if idle.issuperset(group):
            for finger in group:
                columns = driving_columns(hand, finger)
                positions[columns] = draw.opened[columns]
    return positions
