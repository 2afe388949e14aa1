"""A scene whose object and actuators have gone a given way, and a hand at another place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.hand.displacement import displaced_tree
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.scene import Scene


def moved_scene(scene: Scene, change: FloatArray) -> Scene:
    """Return the scene with object and actuators moved by (6 + L,) m and rad.

    Raises:
        SceneError: If a joint would leave its limits.
    """
    T = np.array(scene.object.T_world_object)
    T[:3, :3] = Rotation.from_rotvec(change[3:6]).as_matrix() @ T[:3, :3]
    center = scene.object.center_of_mass_world + change[:3]
    T[:3, 3] = center - T[:3, :3] @ scene.object.center_of_mass
    hand = None if scene.hand is None else bent_hand(scene.hand, change[6:])
    return scene.with_changes(object=scene.object.with_pose(T), hand=hand)


def displaced_hand(hand: Hand, T: FloatArray) -> Hand:
    """Return the hand with the bases of its mounts moved; the joints stay.

    Args:
        hand: The hand.
        T: (4, 4) pose, world axes, or one by mount, (N, 4, 4): each ``T_world_base`` becomes
            ``T @ T_world_base``.
    """
    ways = np.broadcast_to(T, (len(hand.mounts), 4, 4))
    poses = {
        prefix: way @ pose
        for way, (prefix, pose) in zip(ways, hand.base_poses.items(), strict=True)
    }
    mounts = tuple(replace(one, T_world_base=poses[one.prefix]) for one in hand.mounts)
    tree = displaced_tree(hand.tree, list(ways))
    return replace(hand, tree=tree, base_poses=poses, mounts=mounts)


def bent_hand(hand: Hand, change: FloatArray) -> Hand:
    """Return the hand with its actuators moved by (L,) rad or m; entries after them are left out.

    Raises:
        SceneError: If a joint would leave its limits.
    """
    columns = hand.actuation.from_independent
    moved = hand.positions[list(hand.tree.coupling.leaders)] + columns @ change[: columns.shape[1]]
    try:
        return hand.with_positions(moved)
    except ArgumentError as error:
        raise SceneError(f"a joint stands at its limit: {error}") from error
