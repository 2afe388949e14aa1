"""What an object does that does not stay: its motion from rest on, and what each contact does."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import SceneError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.pickling import Record
from graspless_pin.holding.verdict import DynamicOutcome
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.scene import Scene
from graspless_pin.scene.moved import bent_hand
from graspless_pin.visualization.contacts import draw_contacts, outcome_meshes
from graspless_pin.visualization.drawing import draw_bodies, object_radius
from graspless_pin.visualization.picture import Picture, Role

_TIMES = 31
_WAY = 0.6  # of the object's radius: how far a point of it goes
_TURN = 0.6  # rad, of object and joints


@dataclass(frozen=True, eq=False)
class MovingPicture(Record):
    """A picture whose meshes move.

    Attributes:
        picture: What there is to see at first.
        times: (K,) s from rest on, evenly spaced.
        paths: (K, 4, 4) poses of each body that moves, relative to where the picture has it, world
            frame; the object's first.
        path_of: Which of them a mesh goes, by name; the others stand still.
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
    """Draw what an outcome does, were its first accelerations to last.

    Object and joints go along their accelerations until a point of the object has gone 0.6 of its
    radius, or something has turned by 0.6 rad. A joint that comes to its limit ends the hand's
    motion. Contacts go along with the object: balls stick, diamonds slip, pale balls open.

    Args:
        problem: What the motion is an outcome of.
        motion: The motion.
        scene: The scene of the problem; None: contacts and forces are drawn alone.
        origin: (3,) the problem's reference point in a picture without scene, m; None: zero.

    Raises:
        MeshError: A mesh file is missing or unreadable.
    """
    if scene is None:
        center = np.zeros(3) if origin is None else origin
        picture = draw_contacts(problem, origin=center)
        size = picture.radius / 1.2
        kept = [mesh for mesh in picture.meshes if mesh.role is not Role.CONTACT]
    else:
        center, picture = scene.object.center_of_mass_world, draw_bodies(scene)
        size, kept = object_radius(picture), list(picture.meshes)
    contacts = outcome_meshes(problem, motion, center, size)
    times = np.linspace(0.0, _duration(motion, size), _TIMES)
    paths = [_object_path(motion, center, times)]
    path_of = {mesh.name: 0 for mesh in (*picture.of(Role.OBJECT), *contacts)}
    if scene is not None and scene.hand is not None:
        for link, path in _link_paths(scene.hand, motion, times).items():
            names = [m.name for m in picture.of(Role.HAND) if m.name.split("/", 2)[2] == link]
            path_of |= dict.fromkeys(names, len(paths))
            paths.append(path)
    shown = replace(picture, meshes=(*kept, *contacts))
    return MovingPicture(shown, read_only(times), tuple(map(read_only, paths)), path_of)


def _duration(motion: DynamicOutcome, size: float) -> float:
    """Return when the motion has been seen, s."""
    turning = [float(np.linalg.norm(motion.object_acceleration[3:]))]
    turning += np.abs(motion.joint_accelerations).tolist()
    ways = (_WAY * size, motion.point_acceleration), *((_TURN, rate) for rate in turning)
    return min(float(np.sqrt(2.0 * way / rate)) for way, rate in ways if rate > 0.0)


def _object_path(motion: DynamicOutcome, center: FloatArray, times: FloatArray) -> FloatArray:
    """Return (K, 4, 4): the object turns about its centre, which goes along."""
    ways = 0.5 * times[:, None] ** 2 * motion.object_acceleration
    path = np.tile(np.eye(4), (len(times), 1, 1))
    path[:, :3, :3] = Rotation.from_rotvec(ways[:, 3:]).as_matrix()
    path[:, :3, 3] = center + ways[:, :3] - path[:, :3, :3] @ center
    return path


def _link_paths(hand: Hand, motion: DynamicOutcome, times: FloatArray) -> dict[str, FloatArray]:
    """Return (K, 4, 4) of each link that moves, by the hand's forward kinematics."""
    bent = hand
    hands: list[Hand] = []
    for time in times:
        with suppress(SceneError):  # at a limit it stays
            bent = bent_hand(hand, 0.5 * time**2 * motion.joint_accelerations)
        hands.append(bent)
    paths = {}
    for link in hand.tree.link_frames:
        back = np.linalg.inv(hand.link_pose(link))
        path = np.array([there.link_pose(link) @ back for there in hands])
        if not np.allclose(path, np.eye(4), atol=1e-9):
            paths[link] = path
    return paths
