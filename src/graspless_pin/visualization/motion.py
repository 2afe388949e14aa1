"""Motions that are played: of outcomes, of small motions that grow, and of virtual slidings."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import SceneError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.finger_joints import hand_with_moved_actuators
from graspless_pin.holding.verdict import DynamicOutcome
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import Record
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution
from graspless_pin.visualization.contacts import draw_contacts, with_outcome
from graspless_pin.visualization.drawing import draw_bodies, object_radius
from graspless_pin.visualization.picture import Picture, Role

_TIMES = 31
_OUTCOME_DISTANCE = 0.6  # of the object's radius: largest displacement of its points
_OUTCOME_TURN = 0.6  # rad, of object and joints
_SLID, _SLID_TURN = 0.35, 0.4  # the same of virtual slidings and small motions
_GROWN = 30.0  # of its first size: the last size of a small motion that is shown
_STILL = (Role.HAND, Role.SUPPORT, Role.AXES, Role.GRAVITY, Role.FORCE_SCALE)


@dataclass(frozen=True, eq=False)
class MovingPicture(Record):
    """A picture whose meshes move.

    Attributes:
        picture: The picture at first.
        times: (K,) s from rest on, evenly spaced.
        paths: (K, 4, 4) poses of each body that moves, relative to where the picture has it, world
            frame; the object's first.
        path_of: Index of the path of a mesh, by its name; the others stand still.
    """

    picture: Picture
    times: FloatArray
    paths: tuple[FloatArray, ...]
    path_of: Mapping[str, int]


def draw_motion(
    problem: QuasistaticProblem,
    motion: DynamicOutcome,
    *,
    scene: Scene | None = None,
    origin: FloatArray | None = None,
) -> MovingPicture:
    """Draw the motion of an outcome, as if its first accelerations lasted.

    Object and joints move along their accelerations until a point of the object has moved by 0.6 of
    its radius, or something has turned by 0.6 rad. A joint that comes to its limit ends the hand's
    motion. Contacts move with the object: balls stick, diamonds slip, pale balls open.

    Args:
        problem: The problem of the outcome.
        motion: The outcome.
        scene: The scene of the problem; None: only contacts and forces are drawn.
        origin: (3,) the problem's reference point in a picture without scene, m; None: zero.

    Raises:
        MeshError: A mesh file is missing or unreadable.
    """
    if scene is None:
        center = np.zeros(3) if origin is None else origin
        contacts_alone = draw_contacts(problem, origin=center)
        drawn = (Role.CONTACT, Role.CONE, Role.SLIDING)
        kept = tuple(mesh for mesh in contacts_alone.meshes if mesh.role not in drawn)
        marks = tuple(mark for mark in contacts_alone.marks if mark.contact is None)
        picture, size = (
            replace(contacts_alone, meshes=kept, marks=marks),
            contacts_alone.radius / 1.2,
        )
    else:
        center, picture = scene.object.center_of_mass_world, draw_bodies(scene)
        size = object_radius(picture)
    times = np.linspace(0.0, _duration(motion, size), _TIMES)
    amounts = 0.5 * times[:, None] ** 2
    return _moving_picture(
        with_outcome(picture, problem, motion, center, size),
        None if scene is None else scene.hand,
        times,
        _object_path(amounts * motion.object_acceleration, center),
        amounts * motion.joint_accelerations,
    )


def draw_virtual_sliding(
    picture: Picture, solution: TorqueSolution, hand: Hand | None, origin: FloatArray
) -> MovingPicture | None:
    """Return a picture of a solution that moves along the virtual motion behind its mode.

    Enlarged: a point at the radius of the contacts moves by 0.35 of that, or something turns by 0.4
    rad. The contacts move with the object.

    Args:
        picture: Of `draw_scene` or `draw_contacts`.
        solution: Its solution.
        hand: The hand; None: it is not drawn.
        origin: (3,) the problem's reference point in the picture, m.

    Returns:
        The motion; None where no virtual sliding is required, or the coordinates are not those of
        one free object.
    """
    if not picture.of(Role.VIRTUAL_SLIDING) or solution.motion is None:
        return None
    if solution.problem.wrench_matrix is not None:
        return None
    times = np.linspace(0.0, _enlargement(solution.problem, solution.motion), _TIMES)
    return _moved_along(picture, solution.motion, times, times, hand, origin)


def draw_small_motion(
    picture: Picture,
    problem: QuasistaticProblem,
    motion: FloatArray,
    growth: float,
    hand: Hand | None,
    origin: FloatArray,
) -> MovingPicture:
    """Return a picture that moves along a growing small motion, enlarged like a virtual sliding.

    Args:
        picture: Of `draw_scene` or `draw_contacts`.
        problem: The problem of the unstable rest.
        motion: (6 + L,) the motion, of any size.
        growth: Its rate, 1/s.
        hand: The hand; None: it is not drawn.
        origin: (3,) the problem's reference point in the picture, m.
    """
    times = np.linspace(0.0, np.log(_GROWN) / growth, _TIMES)
    amounts = _enlargement(problem, motion) * np.expm1(growth * times) / (_GROWN - 1.0)
    return _moved_along(picture, motion, times, amounts, hand, origin)


def _enlargement(problem: QuasistaticProblem, motion: FloatArray) -> float:
    """Return the factor of a shown motion (6 + L,), within the limits of object and joints."""
    velocity, bends = motion[:6], motion[6:]
    size = float(np.linalg.norm(problem.positions, axis=1).max())
    speed = float(np.linalg.norm(velocity[:3]) + size * np.linalg.norm(velocity[3:]))
    rates = [*np.abs(bends).tolist(), float(np.linalg.norm(velocity[3:]))]
    limits = (_SLID * size, speed), *((_SLID_TURN, rate) for rate in rates)
    return min((distance / rate for distance, rate in limits if rate > 0.0), default=1.0)


def _moved_along(
    picture: Picture,
    motion: FloatArray,
    times: FloatArray,
    amounts: FloatArray,
    hand: Hand | None,
    origin: FloatArray,
) -> MovingPicture:
    """Return a picture that moves along a motion (6 + L,), by amounts (K,)."""
    path = _object_path(amounts[:, None] * motion[:6], origin)
    return _moving_picture(picture, hand, times, path, amounts[:, None] * motion[6:])


def _moving_picture(
    picture: Picture, hand: Hand | None, times: FloatArray, path: FloatArray, bends: FloatArray
) -> MovingPicture:
    """Return a picture whose object and contacts move along a path, and whose links follow joints.

    Args:
        picture: The picture.
        hand: Its hand; None: there is none.
        times: (K,) s.
        path: (K, 4, 4) poses of the object, relative to where it is.
        bends: (K, L) displacements of the joints.
    """
    paths = [path]
    path_of = {mesh.name: 0 for mesh in picture.meshes if mesh.role not in _STILL}
    if hand is not None:
        for link, link_path in _link_paths(hand, bends).items():
            names = [m.name for m in picture.of(Role.HAND) if m.name.split("/", 2)[2] == link]
            path_of |= dict.fromkeys(names, len(paths))
            paths.append(link_path)
    return MovingPicture(picture, read_only(times), tuple(map(read_only, paths)), path_of)


def _duration(motion: DynamicOutcome, size: float) -> float:
    """Return the time after which the motion reaches its limits, s."""
    turning = [float(np.linalg.norm(motion.object_acceleration[3:]))]
    turning += np.abs(motion.joint_accelerations).tolist()
    limits = (
        (_OUTCOME_DISTANCE * size, motion.point_acceleration),
        *((_OUTCOME_TURN, rate) for rate in turning),
    )
    return min(float(np.sqrt(2.0 * distance / rate)) for distance, rate in limits if rate > 0.0)


def _object_path(displacements: FloatArray, center: FloatArray) -> FloatArray:
    """(K, 4, 4) poses after (K, 6) displacements: a turn about the centre, and its shift."""
    path = np.tile(np.eye(4), (len(displacements), 1, 1))
    path[:, :3, :3] = Rotation.from_rotvec(displacements[:, 3:]).as_matrix()
    path[:, :3, 3] = center + displacements[:, :3] - path[:, :3, :3] @ center
    return path


def _link_paths(hand: Hand, bends: FloatArray) -> dict[str, FloatArray]:
    """Return the path (K, 4, 4) of each link that moves, by the hand's forward kinematics."""
    bent = hand
    hands: list[Hand] = []
    for bend in bends:
        with suppress(SceneError):  # at a limit the hand stays
            bent = hand_with_moved_actuators(hand, bend)
        hands.append(bent)
    links = (*hand.tree.link_frames,)
    # Hand by hand: the poses of all its links are computed at once.
    first, *poses = (np.array([one.pose_of(link) for link in links]) for one in [hand, *hands])
    paths = zip(links, np.swapaxes(np.array(poses) @ np.linalg.inv(first), 0, 1), strict=True)
    return {link: path for link, path in paths if not np.allclose(path, np.eye(4), atol=1e-9)}
