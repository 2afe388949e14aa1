"""Every robot of the package closes on a sphere and on a box, and its contacts are right there."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hand_tools import random_pose
from planar_fingers import body
from scipy.spatial.transform import Rotation
from test_closing import gaps
from tests.geometry.contact_tools import find_contacts

from graspless_pin.errors import GrasplessPinWarning
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.bodies.shapes import Box, Sphere
from graspless_pin.geometry.contact.distances import separation
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.closing import ClosingResult, close_hand
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.geometry.robots.files import robot_names

GAP = 1e-5
STEP = 1e-5  # rad or m, of the differences of distances
FLATNESS = 2e-4  # m: contact detection takes nearly parallel facets of a hull for one face
FROM_LIMITS = 1e-3  # rad or m, so that differences can be taken both ways


@dataclass(frozen=True)
class Grip:
    """How a hand is opened and where the object is.

    Attributes:
        link: In whose frame the object is placed.
        center: The object's, m.
        radius: Of the sphere, m.
        box: Edges, m.
        turn: Rotation vector of the box, rad.
        open: Joints that do not stand at zero.
        fingers: The fingers that close; None for all.
        control: Force control of the arm too.
        touching: Links that touch at least.
    """

    link: str
    center: tuple[float, float, float]
    radius: float
    box: tuple[float, float, float]
    turn: tuple[float, float, float] = (0.1, 0.15, 0.2)
    open: Mapping[str, float] = field(default_factory=dict)
    fingers: tuple[str, ...] | None = None
    control: str | None = None
    touching: int = 2


def _on_arm(hand: Grip, prefix: str = "", **q: float) -> Grip:
    """The same grip by the hand of a whole robot, whose joints all have a column."""
    fingers = hand.fingers and tuple(prefix + finger for finger in hand.fingers)
    return replace(hand, fingers=fingers, control="force", open={**hand.open, **q})


def _allegro(side: int) -> Grip:
    return Grip(
        "palm_link",
        (0.06, 0.01 * side, 0.045),
        0.04,
        (0.05, 0.06, 0.07),
        open={"joint_12.0": 1.3},
        fingers=("index", "middle", "thumb"),
        touching=3,
    )


def _dex3(side: str, y: float) -> Grip:
    fingers = ("thumb", "index", "middle")
    return Grip(
        f"{side}_hand_palm_link",
        (0.115, y, 0.0),
        0.03,
        (0.04, 0.04, 0.07),
        fingers=fingers,
        touching=3,
    )


def _psyonic(side: str, sign: int) -> Grip:
    return Grip(
        f"{side}PsyonicAbilityBaseLink",
        (0.015 * sign, 0.05, 0.1),
        0.02,
        (0.04, 0.035, 0.04),
        turn=(0.1, 0.15 * sign, 0.2 * sign),
        open={f"{side}_thumb_q1": -1.0},
        fingers=("index", "middle", "thumb"),
        touching=3,
    )


def _lever(length: float) -> Grip:
    center = (0.6 * length, 0.8 * length, 0.0)
    return Grip("base", center, 0.03, (0.05, 0.04, 0.06), touching=1)


# A box that is not turned lies flat on the pads of parallel jaws.
FLAT = (0.0, 0.0, 0.0)
PANDA = Grip(
    "panda_hand",
    (0.0, 0.0, 0.105),
    0.02,
    (0.04, 0.05, 0.04),
    turn=FLAT,
    open={"panda_finger_joint1": 0.039},
)
BRAVO = Grip(
    "bravo_finger_jaws_base_link",
    (0.0, 0.0, -0.1),
    0.03,
    (0.04, 0.05, 0.04),
    open={"bravo_finger1_joint": 0.6, "bravo_finger2_joint": 0.6},
)
GRIPS = {
    "allegro_right": _allegro(1),
    "allegro_left": _allegro(-1),
    "dex3_right": _dex3("right", 0.045),
    "dex3_left": _dex3("left", -0.045),
    "g1_with_hands": _on_arm(_dex3("left", -0.045), "left_"),
    "psyonic_right": _psyonic("Right", -1),
    "psyonic_left": _psyonic("Left", 1),
    "alex_psyonic_hands": _on_arm(_psyonic("Right", -1), "right_"),
    "panda_hand": PANDA,
    "panda": replace(
        _on_arm(PANDA, panda_joint2=0.3, panda_joint4=-1.8, panda_joint6=2.1), turn=(0.1, 0.15, 0.2)
    ),
    "bravo7_jaws": BRAVO,
    "bravo7_gripper": _on_arm(BRAVO),
    "talos_gripper": Grip("gripper_left_base_link", (0, 0, -0.15), 0.025, (0.08, 0.04, 0.04)),
    "tiago_pro_gripper": Grip(
        "gripper_left_base_link", (0, 0, 0.15), 0.02, (0.03, 0.04, 0.04), FLAT
    ),
    "trihand": Grip("palm", (0, 0, 0.1), 0.03, (0.04, 0.04, 0.05), touching=3),
    "lever_100mm": _lever(0.1),
    "lever_100mm_mirrored": _lever(0.1),
    "lever_150mm": _lever(0.15),
}
CASES = [(name, shape) for name in GRIPS for shape in ("sphere", "box")]


@functools.cache
def opened(name: str) -> Hand:
    """The hand, open, on a mount at a random pose."""
    grip = GRIPS[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GrasplessPinWarning)
        hand = Hand.assemble(
            [Mount(name, random_pose(np.random.default_rng(len(name))))], control=grip.control
        )
    lower, upper = hand.tree.ranges
    inside = np.clip(0.0, lower + FROM_LIMITS, upper - FROM_LIMITS)
    leaders = [hand.joint_names[index] for index in hand.tree.coupling.leaders]
    return hand.with_configuration(
        {**dict(zip(leaders, inside.tolist(), strict=True)), **grip.open}
    )


def placed(hand: Hand, grip: Grip, shape: str) -> ManipulatedObject:
    T = hand.pose_of(grip.link)
    center = T[:3, :3] @ grip.center + T[:3, 3]
    turn = T[:3, :3] @ Rotation.from_rotvec(grip.turn).as_matrix()
    return body(Sphere(grip.radius) if shape == "sphere" else Box(grip.box), center, turn)


@functools.cache
def closed(name: str, shape: str) -> tuple[ClosingResult, ManipulatedObject]:
    """Close; between coupled jaws the object yields to the first until the second touches too."""
    hand, grip = opened(name), GRIPS[name]
    target = placed(hand, grip, shape)
    result = close_hand(hand, target, fingers=grip.fingers, gap=GAP)
    for _ in range(10):
        if result.all_touch:
            break
        touching = [b for b in result.hand.collision_bodies() if b.name in result.touching]
        found = find_contacts(target.collision_bodies(), touching, ())
        push = np.sum([contact.normal for contact in found], axis=0)
        way = 0.5 * float(np.ptp([finger.distance for finger in result.fingers]))
        T = target.T_world_object
        target = body(target.shape, T[:3, 3] + way * push / np.linalg.norm(push), T[:3, :3])
        result = close_hand(hand, target, fingers=grip.fingers, gap=GAP)
    return result, target


def touching_shapes(hand: Hand, target: ManipulatedObject) -> list[int]:
    (piece,) = target.collision_bodies()
    return [
        index
        for index, shape in enumerate(hand.collision_bodies())
        if separation(shape, piece).distance <= GAP
    ]


def rates_by_differences(hand: Hand, index: int, piece: CollisionBody):
    """d(distance)/dq (L,) of one collision shape to the object, by central differences."""

    def distance(joint: str, change: float) -> float:
        at = hand.with_configuration({joint: hand.q[joint] + change})
        return separation(at.collision_bodies()[index], piece).distance

    joints = hand.actuated_joint_names
    return np.array([(distance(j, STEP) - distance(j, -STEP)) / (2 * STEP) for j in joints])


def rates_by_jacobian(hand: Hand, index: int, piece: CollisionBody):
    """-n^T J (K, L) at each of the points where one collision shape touches the object."""
    shape = hand.collision_bodies()[index]
    found = find_contacts(piece, [shape], (), merge_distance=1e-7, max_points=64)
    nearest = min(contact.distance for contact in found)
    assert nearest == pytest.approx(separation(shape, piece).distance, abs=FLATNESS)
    J = hand.contact_jacobian([shape.name] * len(found), [c.position for c in found])
    return -np.einsum("ki,kij->kj", [c.normal for c in found], J.reshape(len(found), 3, -1))


def test_every_robot_is_closed_here():
    assert set(GRIPS) == set(robot_names())


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("name", "shape"), CASES)
def test_fingers_close_until_they_touch_and_their_contacts_are_right(name, shape):
    result, target = closed(name, shape)
    assert result.all_touch, str(result)
    assert len(set(result.touching)) >= GRIPS[name].touching
    (piece,) = target.collision_bodies()
    assert min(separation(b, piece).distance for b in result.hand.collision_bodies()) >= 0.0
    for finger in result.fingers:
        assert 0.0 <= finger.distance <= GAP
    assert unwanted_overlaps(result.hand) == ()
    found = find_contacts(piece, result.hand.collision_bodies(), ())
    assert {contact.body for contact in found} >= set(result.touching)
    # The rates of the distances are those of the normals and the Jacobians.
    shapes = touching_shapes(result.hand, target)
    at_one_point = set()
    for index in shapes:
        by_points = rates_by_jacobian(result.hand, index, piece)
        lowest, highest = by_points.min(axis=0), by_points.max(axis=0)
        rates = rates_by_differences(result.hand, index, piece)
        # Any common point of a face on a face may be the nearest one: the rate is between theirs.
        assert np.all(rates >= lowest - 1e-6)
        assert np.all(rates <= highest + 1e-6)
        assert np.abs(rates).max() > 1e-2
        if np.all(highest - lowest <= 1e-6):
            at_one_point.add(index)
    assert len(at_one_point) >= (len(shapes) if shape == "sphere" else min(2, GRIPS[name].touching))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", [name for name, grip in GRIPS.items() if grip.touching > 2])
def test_wrapping_goes_on_until_nothing_can_move(name):
    grip, hand = GRIPS[name], opened(name)
    target = placed(hand, grip, "sphere")
    result = close_hand(hand, target, fingers=grip.fingers, gap=GAP, wrap=True)
    assert result.all_touch
    assert set(result.touching) >= set(closed(name, "sphere")[0].touching)
    distances = gaps(result.hand, target)
    assert min(distances.values()) >= 0.0
    assert all(distances[link] <= GAP for link in result.touching)
    leaders = {result.hand.joint_names[index] for index in result.hand.tree.coupling.leaders}
    at_limit = {joint for finger in result.fingers for joint in finger.at_limit}
    moved = [joint for joint in leaders - at_limit if result.hand.q[joint] != hand.q[joint]]
    assert moved
    for joint in moved:
        way = np.sign(result.hand.q[joint] - hand.q[joint])
        further = result.hand.with_configuration({joint: result.hand.q[joint] + 1e-2 * way})
        assert min(gaps(further, target).values()) < 0.0, joint
