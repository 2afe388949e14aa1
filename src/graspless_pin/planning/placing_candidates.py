"""Candidates for a hand's place: drawn from a seed, brought to the object, closed and judged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import GrasplessPinError, StateError, internal_error
from graspless_pin.findings import heard
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.contact.broad_phase import solids_of
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.pickling import Record
from graspless_pin.geometry.poses import invert, transformed
from graspless_pin.geometry.posing.approaching import (
    back_until_free,
    centering_shift,
    moved_bodies,
    shortfall,
)
from graspless_pin.geometry.posing.closing import ClosingResult, close_hand
from graspless_pin.geometry.posing.finger_joints import driving_columns, groups_of_fingers
from graspless_pin.geometry.posing.opposing import OpposingPosture, carrier_links
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.holding.least_squares import nonnegative_squares
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.contact_map import contact_map
from graspless_pin.scene import Scene
from graspless_pin.scene.moved import displaced_hand
from graspless_pin.solution import UNDECIDED, Status

_CLEAR_OF_OBJECT = 2e-4  # m, of the open hand
_OPENING = 0.3, 1.0  # share of the way to the open ends
_DEPTH = 0.2, 1.1  # where on the way from palm to meeting point the object's point is
_INNER = 0.5  # share of the object's box in which its points are
_TILT = 0.25  # rad
_ALIGNED = 0.5  # share of draws whose fingers close along a normal of the object
_ACROSS = 0.7  # cosine between a normal and a given approach, above which it is not closed along
_TURN, _SHIFT, _BEND = 0.15, 0.007, 0.1  # rad, m, share of the way to open: of a variation
_TURNED = 0.5  # share of variations that turn: flat fingers that lie on a face may stay there
_CENTERINGS = 12
_CENTERED = 2e-5  # m
_CONE_EDGES = 8  # of the cones whose forces may squeeze
_BALANCED = 1e-6  # share of the squeeze
NODES = 200
"""Most nodes of the search for a candidate's torques."""


class PlacingAim(StrEnum):
    """What a place of a hand is to be good for. See the example of `place_hand`."""

    GRIP = "grip"
    """Two links squeeze the object; those that can carry it without its supports come first."""
    CARRY = "carry"
    """The hand can carry the object without its supports, by two links that squeeze it."""
    PRESS = "press"
    """The largest margin, by whatever means: one link may press the object onto a support."""


class PlacingFault(StrEnum):
    """Why a hand cannot be where it was tried, in the order in which that is found out.

    See the example of `place_hand`.
    """

    words: str

    def __new__(cls, value: str, words: str) -> Self:
        """Make a member of its value and how it is told."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.words = words
        return member

    INTERNAL_ERROR = "internal-error", "an internal error left it out"
    SUPPORT_IN_THE_WAY = "support-in-the-way", "a support is in the way of the open hand"
    OBJECT_IN_THE_WAY = "object-in-the-way", "the object is in the way of the open hand"
    TOUCHES_NOTHING = "touches-nothing", "the fingers close without touching the object"
    HAND_ON_SUPPORT = "hand-on-support", "the closed hand touches a support"
    HAND_THROUGH_ITSELF = "hand-through-itself", "the closed hand is in itself"
    ONE_FINGER_ONLY = "one-finger-only", "one finger alone touches the object"
    UNUSABLE_CONTACTS = "unusable-contacts", "the contacts cannot be used"
    NOTHING_OPPOSES = "nothing-opposes", "no two links squeeze the object between them"
    CANNOT_CARRY = "cannot-carry", "the hand cannot carry the object by itself"
    INFEASIBLE = "infeasible", "no torques within the limits hold the object"
    LOAD_TOO_LARGE = "load-too-large", "the load is too large for the limits of the joints"
    UNDECIDED = "undecided", "the search for torques ended without an answer"
    MARGIN_TOO_SMALL = "margin-too-small", "the margin is smaller than required"


@dataclass(frozen=True, eq=False)
class Draw(Record):
    """Where a hand begins.

    Attributes:
        posture: Which of the postures its fingers are opened from.
        opened: (a,) positions of its independent joints, rad or m.
        displacement: (4, 4) T: its bases go from ``T_world_base`` to ``T @ T_world_base``.
        direction: (3,) unit vector of its approach, world axes.
        wrap: Whether fingers go on beyond a link that touches.
    """

    posture: int
    opened: FloatArray
    displacement: FloatArray
    direction: FloatArray
    wrap: bool


@dataclass(frozen=True, eq=False)
class ClosedHand(Record):
    """A hand that was closed on the object and solved.

    Attributes:
        draw: Where it began.
        displacement: (4, 4) T: its bases go from ``T_world_base`` to ``T @ T_world_base``.
        positions: (a,) of its independent joints, rad or m.
        touching: Its links that touch the object.
        margin: Of Algorithm 1, N.
        carrying_margin: The same without the supports and at rest, N; NaN: the hand cannot carry
            the object by itself.
    """

    draw: Draw
    displacement: FloatArray
    positions: FloatArray
    touching: tuple[str, ...]
    margin: float
    carrying_margin: float


@dataclass(frozen=True, eq=False)
class TriedCandidate:
    """What became of one candidate.

    Attributes:
        number: Which one.
        fault: Why it is no place for the hand; None: it is one.
        closed: The closed hand, where there are torques.
        error: What was raised, where that is the fault.
    """

    number: int
    fault: PlacingFault | None
    closed: ClosedHand | None = None
    error: str = ""


@dataclass(frozen=True, eq=False)
class PlacingPlan(Record):
    """What all candidates share.

    Attributes:
        scene: The scene with the hand where it is now; the object rests.
        hand: Its hand.
        fingers: Fingers that close.
        postures: Postures to open them from.
        normals: (F, 3) of the object's surface, world axes.
        areas: (F,) of the surface that has them, m^2.
        direction: (3,) unit vector of the approach, world axes; None: drawn.
        point: (3,) that the palm goes for, world, m; None: drawn.
        margin: That is required, N.
        aim: What places are to be good for.
        seed: Of all draws.
        parents: Closed hands to vary; empty: hands are drawn anew.
    """

    scene: Scene
    hand: Hand
    fingers: tuple[str, ...]
    postures: tuple[OpposingPosture, ...]
    normals: FloatArray
    areas: FloatArray
    direction: FloatArray | None
    point: FloatArray | None
    margin: float
    aim: PlacingAim
    seed: int
    parents: tuple[ClosedHand, ...] = ()


def try_candidates(plan: PlacingPlan, numbers: Sequence[int]) -> Iterator[TriedCandidate]:
    """Yield what becomes of some candidates."""
    for number in numbers:
        yield try_candidate(plan, number)


def try_candidate(plan: PlacingPlan, number: int) -> TriedCandidate:
    """Try one candidate; it depends on the plan and its number alone."""
    try:
        with heard():
            return _tried(plan, number)
    except GrasplessPinError:
        raise
    except Exception as error:  # costs this candidate, not the search, and is told
        return TriedCandidate(number, PlacingFault.INTERNAL_ERROR, error=internal_error(error))


def _tried(plan: PlacingPlan, number: int) -> TriedCandidate:
    draw = _drawn(plan, number)
    brought = _brought(plan, draw)
    if isinstance(brought, PlacingFault):
        return TriedCandidate(number, brought)
    closing, T = brought
    hand = displaced_hand(_idle_fingers_opened(plan, draw, closing), T)
    tolerance = plan.scene.contact_tolerance
    if shortfall(hand.placed_bodies, _supports(plan.scene), 1.5 * tolerance) > 0.0:
        return TriedCandidate(number, PlacingFault.HAND_ON_SUPPORT)
    if unwanted_overlaps(hand, tolerance=tolerance):
        return TriedCandidate(number, PlacingFault.HAND_THROUGH_ITSELF)
    scene = plan.scene.with_changes(hand=hand)
    try:
        judged = _judged(plan, scene, hand)
    except StateError:
        judged = PlacingFault.UNUSABLE_CONTACTS
    if isinstance(judged, PlacingFault):
        return TriedCandidate(number, judged)
    positions = hand.positions[list(hand.tree.coupling.leaders)]
    closed = ClosedHand(draw, T, positions, *judged)
    fault = None
    if plan.aim is PlacingAim.CARRY and not carries(closed, plan.margin):
        fault = PlacingFault.CANNOT_CARRY
    elif closed.margin < plan.margin:
        fault = PlacingFault.MARGIN_TOO_SMALL
    return TriedCandidate(number, fault, closed)


def carries(closed: ClosedHand, margin: float) -> bool:
    """Return whether the hand carries the object by itself with a margin, N."""
    return closed.carrying_margin >= margin


def _judged(
    plan: PlacingPlan, scene: Scene, hand: Hand
) -> PlacingFault | tuple[tuple[str, ...], float, float]:
    """Return the links that touch, the margin and that without the supports.

    Raises:
        StateError: If the contacts cannot be used.
    """
    touching = tuple(dict.fromkeys(one for one in scene.contacts.bodies if one in hand.link_names))
    grips = plan.aim is not PlacingAim.PRESS
    fingers = {hand.finger_of(link) or link for link in touching}
    if len(fingers) < min(2, len(hand.fingers)) or (grips and len(touching) < 2):
        return PlacingFault.ONE_FINGER_ONLY
    alone = scene if not scene.supports else scene.with_changes(supports=(), motion=None)
    if grips and not squeezed(alone.problem(), alone.contacts.bodies):
        return PlacingFault.NOTHING_OPPOSES
    carrying = alone.solve("margin", node_limit=NODES)
    if plan.aim is PlacingAim.CARRY and not carrying.found:
        return PlacingFault.CANNOT_CARRY
    solution = carrying if alone is scene else scene.solve("margin", node_limit=NODES)
    if not solution.found:
        if solution.status is Status.LOAD_TOO_LARGE:
            return PlacingFault.LOAD_TOO_LARGE
        undecided = solution.status in UNDECIDED
        return PlacingFault.UNDECIDED if undecided else PlacingFault.INFEASIBLE
    return touching, solution.margin, carrying.margin if carrying.found else np.nan


def squeezed(problem: QuasistaticProblem, bodies: Sequence[str]) -> bool:
    """Return whether two bodies squeeze the object: contact forces that balance each other.

    Args:
        problem: Contacts with their friction; its load and joints do not count.
        bodies: M names of what touches.
    """
    angles = 2.0 * np.pi * np.arange(_CONE_EDGES) / _CONE_EDGES
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    along = contact_map(problem)[:, :, :6]
    edges = along[:, None, 0] + problem.friction[:, None, None] * (ways @ along[:, 1:])
    wrenches = edges.reshape(-1, 6).T
    size = float(np.abs(problem.positions).max())
    wrenches[3:] /= size
    squeeze = nonnegative_squares(
        np.vstack([wrenches, np.ones(wrenches.shape[1])]), np.append(np.zeros(6), 1.0)
    )
    if squeeze is None or np.linalg.norm(wrenches @ squeeze) > _BALANCED * squeeze.sum():
        return False
    shares = squeeze.reshape(len(bodies), -1).sum(axis=1)
    return len({bodies[index] for index in np.flatnonzero(shares).tolist()}) > 1


def _drawn(plan: PlacingPlan, number: int) -> Draw:
    rng = np.random.default_rng([plan.seed, number])
    if plan.parents:
        return _varied(plan, plan.parents[number % len(plan.parents)].draw, rng)
    index = int(rng.integers(len(plan.postures)))
    posture = plan.postures[index]
    opened = posture.closed + rng.uniform(*_OPENING) * (posture.opened - posture.closed)
    R = _turned(plan, posture, rng)
    direction = R @ posture.axis if plan.direction is None else plan.direction
    low, high = _box(plan.scene)
    inside = 0.5 * (low + high) + rng.uniform(-0.5, 0.5, 3) * _INNER * (high - low)
    point = plan.point
    if point is None:
        point = transformed(plan.scene.object.T_world_object, inside)
    grip = posture.palm + rng.uniform(*_DEPTH) * (posture.meeting - posture.palm)
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = point - T[:3, :3] @ grip
    return Draw(index, opened, T, direction, bool(rng.random() < 0.5))


def _turned(plan: PlacingPlan, posture: OpposingPosture, rng: np.random.Generator) -> FloatArray:
    """Return a random (3, 3) turn of the hand; half of them close along a normal of the object."""
    if rng.random() < _ALIGNED:
        areas = plan.areas
        if plan.direction is not None:
            areas = np.where(np.abs(plan.normals @ plan.direction) < _ACROSS, areas, 0.0)
        if areas.sum() > 0.0:
            normal = rng.choice(plan.normals, p=areas / areas.sum())
            if plan.direction is None:
                roll = Rotation.from_rotvec(rng.uniform(0.0, 2.0 * np.pi) * normal)
                facing = Rotation.align_vectors(normal[None], posture.closing[None])[0]
                return (roll * facing).as_matrix()
            pair = np.stack([plan.direction, normal]), np.stack([posture.axis, posture.closing])
            return Rotation.align_vectors(*pair, weights=[np.inf, 1.0])[0].as_matrix()
    direction = plan.direction
    if direction is None:
        drawn = rng.normal(size=3)
        direction = drawn / np.linalg.norm(drawn)
    tilt = Rotation.from_rotvec(rng.normal(size=3) * _TILT)
    roll = Rotation.from_rotvec(rng.uniform(0.0, 2.0 * np.pi) * direction)
    facing = Rotation.align_vectors(direction[None], posture.axis[None])[0]
    return (roll * facing * tilt).as_matrix()


def _varied(plan: PlacingPlan, draw: Draw, rng: np.random.Generator) -> Draw:
    """Return a draw near another one."""
    posture = plan.postures[draw.posture]
    way = rng.normal(size=3) * _TURN * (rng.random() < _TURNED)
    turn = Rotation.from_rotvec(way).as_matrix()
    center = plan.scene.object.center_of_mass_world
    change = np.eye(4)
    change[:3, :3] = turn
    change[:3, 3] = center - turn @ center + rng.normal(size=3) * _SHIFT
    bend = _BEND * rng.normal(size=len(draw.opened)) * (posture.opened - posture.closed)
    ends = np.sort([posture.closed, posture.opened], axis=0)
    opened = np.clip(draw.opened + bend, *ends)
    direction = draw.direction if plan.direction is not None else turn @ draw.direction
    return Draw(draw.posture, opened, change @ draw.displacement, direction, not draw.wrap)


def _brought(plan: PlacingPlan, draw: Draw) -> tuple[ClosingResult, FloatArray] | PlacingFault:
    """Bring the open hand to the object and close it there.

    The hand stays where it is and the object comes to it, which is the same and quicker.

    Returns:
        The hand closed where it is, and the displacement that takes it to the object.
    """
    scene, posture = plan.scene, plan.postures[draw.posture]
    pieces, hand = scene.object.placed_bodies, plan.hand.with_positions(draw.opened)
    low, high = _box(scene)
    farthest = float(np.linalg.norm(posture.meeting - posture.palm) + np.linalg.norm(high - low))
    obstacles = (
        (pieces, _CLEAR_OF_OBJECT),
        (_supports(scene), 2.0 * scene.contact_tolerance),
    )
    open_hand = moved_bodies(hand.placed_bodies, draw.displacement)
    back, last = back_until_free(open_hand, obstacles, draw.direction, farthest)
    if back is None:
        return (PlacingFault.OBJECT_IN_THE_WAY, PlacingFault.SUPPORT_IN_THE_WAY)[last]
    T = np.array(draw.displacement)
    T[:3, 3] -= back * draw.direction
    rates = {
        name: float(rate)
        for name, rate in zip(
            plan.hand.control.joints, posture.closing_rates(draw.opened), strict=True
        )
        if rate != 0.0
    }
    together = _jaws(hand, plan.fingers)
    for left in reversed(range(_CENTERINGS)):
        target = scene.object.with_pose(invert(T) @ scene.object.T_world_object)
        closing = close_hand(hand, target, fingers=plan.fingers, wrap=draw.wrap, rates=rates)
        if not closing.touching:
            return PlacingFault.TOUCHES_NOTHING
        shift = _shift_of(closing, together, target.placed_bodies)
        if not left or np.linalg.norm(shift) < _CENTERED:
            return closing, T
        T[:3, 3] += T[:3, :3] @ shift
        if shortfall(moved_bodies(hand.placed_bodies, T), pieces, 0.0) > 0.0:
            break
    return PlacingFault.OBJECT_IN_THE_WAY


def _jaws(hand: Hand, fingers: Sequence[str]) -> list[list[Sequence[str]]]:
    """Return the links of jaws that have to be centred, by motor: a finger may have a fixed one."""
    if len(fingers) == 1:
        return [[hand.fingers[fingers[0]].links, carrier_links(hand, fingers[0])]]
    groups = groups_of_fingers(hand, fingers)
    return [[hand.fingers[name].links for name in group] for group in groups if len(group) > 1]


def _shift_of(
    closing: ClosingResult, together: Sequence[Sequence[Sequence[str]]], pieces: PlacedBodies
) -> FloatArray:
    """Return (3,) how to shift a hand so that jaws with one motor touch on two sides, m."""
    touching = set(closing.touching)
    for jaws in together:
        if any(touching.intersection(links) for links in jaws):
            shift = centering_shift(closing.hand, jaws, pieces)
            if shift is not None:
                return shift
    return np.zeros(3)


def _idle_fingers_opened(plan: PlacingPlan, draw: Draw, closing: ClosingResult) -> Hand:
    """Return the closed hand with the fingers that touch nothing open again, out of the way."""
    positions = closing.hand.positions[list(plan.hand.tree.coupling.leaders)].copy()
    idle = {one.finger for one in closing.fingers if not one.touching}
    for group in groups_of_fingers(plan.hand, plan.fingers):
        if idle.issuperset(group):
            for finger in group:
                columns = driving_columns(plan.hand, finger)
                positions[columns] = draw.opened[columns]
    return closing.hand.with_positions(positions)


def _supports(scene: Scene) -> PlacedBodies:
    return PlacedBodies.joined([support.placed_bodies for support in scene.supports])


def _box(scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest corner of the box around the object along its own axes, m."""
    solids = solids_of(scene.object.shapes)
    low = (solids.centers - solids.half_extents).min(axis=0)
    return low, (solids.centers + solids.half_extents).max(axis=0)
