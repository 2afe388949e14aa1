"""The data that all candidates for a hand's place share, and their random starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import rigid, transformed, turned_about
from graspless_pin.geometry.posing.finger_joints import Arm, arm_above
from graspless_pin.geometry.posing.opposing import (
    OpposingPosture,
    carrier_of,
    is_fixed_jaw,
    opposing_postures,
)
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Record
from graspless_pin.scene import Scene
from graspless_pin.scene.entry_findings import box_around

_POSTURES = 24
_OPENING = 0.3, 1.0  # share of the way to the open ends
_DEPTH = 0.2, 1.1  # where on the way from palm to meeting point the object's point is
_INNER_BOX = 0.5  # share of the object's box in which its points are
_APPROACH_TILT = 0.25  # rad
_ALIGNED_SHARE = 0.5  # share of draws whose fingers close along a normal of the object
_ACROSS_APPROACH = (
    0.7  # cosine between a normal and a given approach, above which it is not closed along
)
_VARIED_TURN, _VARIED_SHIFT, _VARIED_BEND = (
    0.15,
    0.007,
    0.1,
)  # rad, m, share of the way to open: of a variation
_TURNED_SHARE = 0.5  # share of variations that turn: without turns flat fingers stay on a face


class PlacingAim(StrEnum):
    """The purpose of a hand's place. See the example of `place_hand`."""

    GRIP = "grip"
    """Two links squeeze the object; those that can carry it without its supports come first."""
    CARRY = "carry"
    """The hand can carry the object without its supports, by two links that squeeze it."""
    PRESS = "press"
    """The largest margin: a single link may press the object onto a support."""


@dataclass(frozen=True, eq=False)
class HandPart(Record):
    """A part of the hand that is placed by itself: one mounted robot, or all as one body.

    Attributes:
        fingers: Fingers that close.
        postures: Closed postures from which they are opened.
        mounts: Mounts that move with their bases; none if an arm moves the palm.
        arm: The arm; None: the bases move.
        links: Links that approach the object: those of the mounts, or those below the arm's palm.
        moved: These, and the links of the arm that moves them.
    """

    fingers: tuple[str, ...]
    postures: tuple[OpposingPosture, ...]
    mounts: tuple[int, ...]
    arm: Arm | None
    links: frozenset[str]
    moved: frozenset[str]


@dataclass(frozen=True, eq=False)
class Draw(Record):
    """The random start of a hand's part.

    Attributes:
        posture: Index of the posture from which its fingers are opened.
        opened: (a,) positions of the hand's independent joints, rad or m.
        displacement: (4, 4) T by which its palm is displaced, world axes, m.
        direction: (3,) unit vector of its approach, world axes.
        wrap: Whether fingers go on closing when one of their links touches.
    """

    posture: int
    opened: FloatArray
    displacement: FloatArray
    direction: FloatArray
    wrap: bool


@dataclass(frozen=True, eq=False)
class ClosedHand(Record):
    """A hand that was closed on the object, with its margins.

    Attributes:
        draws: The starts of its parts.
        displacements: (N, 4, 4) T by mount: its base goes from ``T_world_base`` to
            ``T @ T_world_base``.
        positions: (a,) of its independent joints, rad or m.
        touching: Its links that touch the object.
        margin: Of Algorithm 1, N.
        carrying_margin: The same without the supports and at rest, N; NaN: the hand cannot carry
            the object by itself.
    """

    draws: tuple[Draw, ...]
    displacements: FloatArray
    positions: FloatArray
    touching: tuple[str, ...]
    margin: float
    carrying_margin: float


@dataclass(frozen=True, eq=False)
class PlacingPlan(Record):
    """The data that all candidates share.

    Attributes:
        scene: The scene with the hand at its first place; the object is at rest.
        hand: Its hand.
        parts: The parts of the hand that are placed by themselves.
        normals: (F, 3) of the faces of the object's surface, world axes.
        areas: (F,) twice the areas of these faces, m^2.
        direction: (3,) unit vector of the approach, world axes; None: drawn.
        point: (3,) target of the palm, world, m; None: drawn.
        margin: Required margin, N.
        aim: The purpose of places.
        seed: Of all draws.
        parents: Closed hands that are varied; empty: hands are drawn anew.
    """

    scene: Scene
    hand: Hand
    parts: tuple[HandPart, ...]
    normals: FloatArray
    areas: FloatArray
    direction: FloatArray | None
    point: FloatArray | None
    margin: float
    aim: PlacingAim
    seed: int
    parents: tuple[ClosedHand, ...] = ()


def hand_parts(
    hand: Hand,
    fingers: Sequence[str],
    rng: np.random.Generator,
    *,
    together: bool,
    move_base: bool,
) -> tuple[HandPart, ...]:
    """Return the parts of a hand that are placed by themselves.

    Args:
        hand: The hand.
        fingers: Fingers that close: see `fingers_that_close`.
        rng: Generator from which postures are drawn.
        together: Whether all mounts move as one body.
        move_base: Whether robots with arms move with their bases, too.

    Raises:
        ArgumentError: If the arms of these fingers differ, or a mount has a single finger.
    """
    tree = hand.tree
    of_finger = {name: tree.mount_of[hand.fingers[name].joints[0]] for name in fingers}
    groups = {k: [name for name in fingers if of_finger[name] == k] for k in of_finger.values()}
    arms = {k: None if move_base else _common_arm(hand, own) for k, own in groups.items()}
    if together and any(arms.values()):
        raise ArgumentError(
            "together", "moves the bases of arms, which requires move_base (--move-base), too"
        )
    lone = [own[0] for own in groups.values() if len(own) == 1 and not is_fixed_jaw(hand, own[0])]
    if len(tree.bases) > 1 and lone and not together:
        raise ArgumentError(
            "together",
            f"{', '.join(lone)} are the only fingers of their mounts, and can only grip together "
            "with the others as one body; set together (--together)",
        )
    if together or len(tree.bases) == 1:
        arm = arms[next(iter(arms))]
        mounts = () if arm else tuple(range(len(tree.bases)))
        return (_hand_part(hand, tuple(fingers), mounts, arm, rng),)
    return tuple(
        _hand_part(hand, tuple(own), () if arms[k] else (k,), arms[k], rng)
        for k, own in groups.items()
    )


def _common_arm(hand: Hand, fingers: Sequence[str]) -> Arm | None:
    """Return the arm that carries some fingers of one robot; None: there is none."""
    carriers = {name: arm_above(hand, carrier_of(hand, name)) for name in fingers}
    joints = {0 if arm is None else arm.joint for arm in carriers.values()}
    if len(joints) > 1:
        raise ArgumentError(
            "fingers",
            f"{', '.join(carriers)} belong to different palms of one robot: name those of one palm "
            "(--finger), or move the whole robot with its base: move_base (--move-base)",
        )
    return carriers[fingers[0]]


def _hand_part(
    hand: Hand,
    fingers: tuple[str, ...],
    mounts: tuple[int, ...],
    arm: Arm | None,
    rng: np.random.Generator,
) -> HandPart:
    tree = hand.tree
    links = frozenset(link for link in tree.link_frames if tree.mount_of.get(link) in mounts)
    moved = links
    if arm is not None:
        links, moved = arm.links(tree), arm.moved_links(tree)
    postures = opposing_postures(hand, fingers, _POSTURES, rng)
    return HandPart(fingers, postures, mounts, arm, links, moved)


def draw_start(plan: PlacingPlan, index: int, number: int, rng: np.random.Generator) -> Draw:
    """Draw the start of a part of the hand in a candidate.

    Args:
        plan: The plan.
        index: Index of the part.
        number: Number of the candidate.
        rng: Generator for this part and candidate.
    """
    if plan.parents:
        return _varied_draw(plan, index, plan.parents[number % len(plan.parents)].draws[index], rng)
    postures = plan.parts[index].postures
    chosen = int(rng.integers(len(postures)))
    posture = postures[chosen]
    opened = posture.closed + rng.uniform(*_OPENING) * (posture.opened - posture.closed)
    R = _random_turn(plan, posture, rng)
    direction = R @ posture.axis if plan.direction is None else plan.direction
    low, high = box_around(plan.scene.object)
    inside = 0.5 * (low + high) + rng.uniform(-0.5, 0.5, 3) * _INNER_BOX * (high - low)
    point = plan.point
    if point is None:
        point = transformed(plan.scene.object.T_world_object, inside)
    grip = posture.palm + rng.uniform(*_DEPTH) * (posture.meeting - posture.palm)
    T = rigid(point - R @ grip, R)
    return Draw(chosen, opened, T, direction, bool(rng.random() < 0.5))


def _random_turn(
    plan: PlacingPlan, posture: OpposingPosture, rng: np.random.Generator
) -> FloatArray:
    """Return a random rotation (3, 3) of the hand; half of them close along an object's normal."""
    if rng.random() < _ALIGNED_SHARE:
        areas = plan.areas
        if plan.direction is not None:
            areas = np.where(np.abs(plan.normals @ plan.direction) < _ACROSS_APPROACH, areas, 0.0)
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
    tilt = Rotation.from_rotvec(rng.normal(size=3) * _APPROACH_TILT)
    roll = Rotation.from_rotvec(rng.uniform(0.0, 2.0 * np.pi) * direction)
    facing = Rotation.align_vectors(direction[None], posture.axis[None])[0]
    return (roll * facing * tilt).as_matrix()


def _varied_draw(plan: PlacingPlan, index: int, draw: Draw, rng: np.random.Generator) -> Draw:
    """Return a random variation of a draw."""
    posture = plan.parts[index].postures[draw.posture]
    rotation_vector = rng.normal(size=3) * _VARIED_TURN * (rng.random() < _TURNED_SHARE)
    turn = Rotation.from_rotvec(rotation_vector).as_matrix()
    center = plan.scene.object.center_of_mass_world
    change = turned_about(center, turn, rng.normal(size=3) * _VARIED_SHIFT)
    bend = _VARIED_BEND * rng.normal(size=len(draw.opened)) * (posture.opened - posture.closed)
    ends = np.sort([posture.closed, posture.opened], axis=0)
    opened = np.clip(draw.opened + bend, *ends)
    direction = draw.direction if plan.direction is not None else turn @ draw.direction
    return Draw(draw.posture, opened, change @ draw.displacement, direction, not draw.wrap)
