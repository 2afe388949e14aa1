"""Hands that were moved: their bases, or their actuators by a little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.hand.assembly import displaced_tree
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray


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
