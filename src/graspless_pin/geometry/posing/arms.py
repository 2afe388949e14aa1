"""Arms that bring a palm to a pose, or as near as they come, while their bases stay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Record

_WRIST = 3
_LEVER = 0.1  # m: how far from the palm a radian counts as much as it moves there
_STARTS = 4
_REACHED = 1e-7  # m: no other start is tried
_INSIDE = 1e-6  # share of a joint's range that the solver keeps off its ends at the start


@dataclass(frozen=True, eq=False)
class Arm(Record):
    """The joints between a robot's base and a palm.

    Attributes:
        joint: Pinocchio index of the joint that carries the palm.
        columns: The independent joints that move it.
    """

    joint: int
    columns: tuple[int, ...]

    def moved_links(self, tree: KinematicTree) -> frozenset[str]:
        """Return all links that the arm moves."""
        joints = tree.coupling.S[:, list(self.columns)].any(axis=1)
        return frozenset(
            link for link, own in tree.link_joints.items() if (tree.supports[own] & joints).any()
        )

    def links(self, tree: KinematicTree) -> frozenset[str]:
        """Return the links that the palm carries, its own among them."""
        return frozenset(
            link
            for link, own in tree.link_joints.items()
            if own and tree.supports[own, self.joint - 1]
        )


def arm_above(hand: Hand, carrier: int) -> Arm | None:
    """Return the arm that carries a body; None: its base or a wrist of three joints carries it.

    Args:
        hand: The hand.
        carrier: Pinocchio index of the joint that the palm hangs on, 0 for the base.
    """
    tree = hand.tree
    moving = np.flatnonzero(tree.supports[carrier]) if carrier else np.array([], dtype=int)
    lower, upper = tree.ranges
    columns = [k for k in tree.coupling.drivers(moving.tolist()) if upper[k] > lower[k]]
    return Arm(carrier, tuple(columns)) if len(columns) > _WRIST else None


def brought_palm(
    hand: Hand, arm: Arm, T_world_palm: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Bring a palm to a pose, or as near as its arm gets it: least squares from several starts.

    Args:
        hand: The hand; the first start is where its arm is.
        arm: The arm.
        T_world_palm: (4, 4) wanted pose of the joint that carries the palm.
        rng: Where further starts are drawn from.

    Returns:
        (a,) positions of the independent joints, and the (4, 4) pose that they bring it to.
    """
    tree, columns = hand.tree, list(arm.columns)
    positions = tree.coupling.independent(hand.positions)
    lower, upper = (ends[columns] for ends in tree.ranges)
    lower = np.where(np.isfinite(lower), lower, positions[columns] - np.pi)
    upper = np.where(np.isfinite(upper), upper, positions[columns] + np.pi)
    feet = np.vstack([np.zeros(3), _LEVER * np.eye(3)])  # points of the palm
    wanted = feet @ T_world_palm[:3, :3].T + T_world_palm[:3, 3]
    S = tree.coupling.S[:, columns]

    def at(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        positions[columns] = values
        kinematics = tree.kinematics(tree.coupling.all_positions(positions))
        return kinematics.T_world_joint[arm.joint], kinematics.J * tree.supports[arm.joint]

    def points(values: FloatArray) -> FloatArray:
        T = at(values)[0]
        return feet @ T[:3, :3].T + T[:3, 3]

    def jacobian(values: FloatArray) -> FloatArray:
        J = at(values)[1] @ S
        turns = np.cross(J[3:].T, points(values)[:, None])
        return np.asarray(J[:3] + turns.transpose(0, 2, 1), dtype=np.float64).reshape(
            -1, len(values)
        )

    best, least = positions[columns].copy(), np.inf
    margin = _INSIDE * (upper - lower)
    for attempt in range(_STARTS):
        start = best if attempt == 0 else rng.uniform(lower, upper)
        found = least_squares(
            lambda values: (points(values) - wanted).ravel(),
            np.clip(start, lower + margin, upper - margin),
            jac=jacobian,  # pyright: ignore[reportArgumentType] - a function will do
            bounds=(lower, upper), xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=60,
        )  # fmt: skip
        miss = float(np.linalg.norm(found.fun))
        if miss < least:
            best, least = found.x, miss
        if least <= _REACHED:
            break
    T_there = at(best)[0]
    return positions, T_there
