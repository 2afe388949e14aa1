"""Joint positions by name, checked against limits and couplings.

Also the links of a tree at one configuration: their poses and point Jacobians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError, JointLimitError
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.hand.coupling import FOLLOWER_TOLERANCE
from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.geometry.hand.work_space import Kinematics
from graspless_pin.geometry.poses import as_numbers, finite_numbers
from graspless_pin.problem.checks import (
    FloatArray,
    all_true,
    as_floats,
    check_known,
    real_number,
)


def joint_positions(
    tree: KinematicTree, q: Mapping[str, float], start: FloatArray | None = None
) -> FloatArray:
    """Return the positions of all joints of a tree.

    Args:
        tree: The kinematic tree with n movable joints.
        q: Position by joint name in radians or metres. A mimic joint may be named if its value
            agrees with the joint it follows.
        start: (n,) positions of the joints that ``q`` does not name; None is zero, clamped to the
            limits: for an independent joint, including those of its followers.

    Returns:
        (n,) read-only positions in model order.

    Raises:
        ArgumentError: If a joint is unknown, or a value is not a finite number, is outside the
            joint's limits or contradicts the coupling.
    """
    coupling, index_of = tree.coupling, tree.joint_index
    check_known("q", "joint", q, index_of)
    indices = [index_of[name] for name in q]
    positions = np.clip(0.0, tree.lower, tree.upper) if start is None else start.copy()
    if start is None:
        leaders, (low, high) = np.array(coupling.leaders, dtype=int), tree.ranges
        is_consistent = low <= high  # otherwise a joint and its followers contradict each other
        positions[leaders[is_consistent]] = np.clip(0.0, low[is_consistent], high[is_consistent])
    values = as_floats([*q.values()])
    if values is None or values.ndim != 1:
        values = [real_number(f"q[{name!r}]", value, -np.inf) for name, value in q.items()]
    positions[indices] = values
    if len(coupling.leaders) < len(positions):
        given = positions[indices].tolist()
        positions = coupling.all_positions(coupling.independent(positions))
        for index, value in zip(indices, given, strict=True):
            if abs(value - positions[index]) > FOLLOWER_TOLERANCE:
                name, leader_names = tree.joint_names[index], _leader_names_text(tree, index)
                raise ArgumentError(
                    f"q[{name!r}]",
                    f"is {value:g}, but this joint mimics {leader_names} and is at "
                    f"{positions[index]:g}; give only {leader_names}",
                )
    return _checked_positions(tree, positions, q)


def independent_positions(tree: KinematicTree, values: ArrayLike) -> FloatArray:
    """Return the positions of all joints of a tree for those of its independent joints.

    Args:
        tree: The kinematic tree with a independent and n movable joints.
        values: (a,) radians or metres, in model order.

    Returns:
        (n,) read-only positions in model order.

    Raises:
        ArgumentError: If the shape is wrong, or a value is not a finite number or moves a joint
            outside its limits.
    """
    coupling = tree.coupling
    count = len(coupling.leaders)
    positions = as_numbers("q", values)
    if positions.shape != (count,):
        raise ArgumentError(
            "q",
            f"needs shape ({count},), one number per independent joint, got {positions.shape}",
        )
    if count < len(tree.joint_names):
        positions = coupling.all_positions(positions)
    return _checked_positions(tree, positions)


def independent_rates(
    tree: KinematicTree, rates: Mapping[str, float], argument: str = "joint_velocities"
) -> FloatArray:
    """Return the (a,) rates of a tree's independent joints, zero for joints that are not named.

    Args:
        tree: The kinematic tree.
        rates: rad/s or m/s by independent joint, or their time derivatives.
        argument: Name of the argument in errors.

    Raises:
        ArgumentError: If a name is unknown or a coupled joint's, or a rate is not finite.
    """
    leaders = tree.leader_names
    check_known(argument, "independent joint", rates, leaders)
    values = np.zeros(len(leaders))
    for name, rate in rates.items():
        values[leaders.index(name)] = real_number(f"{argument}[{name!r}]", rate, -np.inf)
    return values


def _checked_positions(
    tree: KinematicTree, positions: FloatArray, q: Mapping[str, float] | None = None
) -> FloatArray:
    """Return (n,) read-only positions; refuse a joint that ``q`` moves outside its limits.

    None means all independent joints.
    """
    leaders, (lower, upper) = tree.coupling.leaders, tree.tolerated_limits
    positions.setflags(write=False)
    if all_true((lower <= positions) & (positions <= upper)):
        return positions
    if q is None:
        q = {tree.joint_names[joint]: positions[joint] for joint in leaders}
    given = [tree.joint_index[name] for name in q]
    for name, value in zip(q, positions[given].tolist(), strict=True):
        real_number(f"q[{name!r}]", value, -np.inf)
    outside = ~((lower <= positions) & (positions <= upper))
    moved = np.any(tree.coupling.S[:, np.isin(leaders, given)] != 0.0, axis=1)
    for index in np.flatnonzero(moved & outside).tolist():
        cause = "" if index in leaders else f" because it mimics {_leader_names_text(tree, index)}"
        raise JointLimitError(
            f"q[{tree.joint_names[index]!r}]",
            f"is {positions[index]:g}{cause}, outside the joint's limits "
            f"[{tree.lower[index]:g}, {tree.upper[index]:g}]{_unit_text(tree, index, positions)}",
        )
    return positions


def _unit_text(tree: KinematicTree, index: int, positions: FloatArray) -> str:
    """Return a text with the unit of a position outside its limits, and the limits in degrees."""
    if tree.joint_kinds[index] == "prismatic":
        return " m"
    angle, lower, upper = positions[index], tree.lower[index], tree.upper[index]
    radians = math.radians(angle)
    if abs(angle) > 2.0 * math.pi and lower <= radians <= upper:
        return f" rad; angles are radians: {angle:g} degrees are {radians:.4g}"
    return f" rad ({math.degrees(lower):.4g} to {math.degrees(upper):.4g} deg)"


def _leader_names_text(tree: KinematicTree, index: int) -> str:
    """Return the names of the independent joints that a coupled joint follows, as a text."""
    return ", ".join(repr(tree.leader_names[column]) for column in tree.coupling.drivers([index]))


class PosedLinks(NamedTuple):
    """The links of a tree at one configuration.

    Attributes:
        tree: The tree.
        kinematics: Its joint poses and Jacobian columns.
        bodies: The collision shapes in model order, each made on first access.
    """

    tree: KinematicTree
    kinematics: Kinematics
    bodies: PlacedBodies

    def pose(self, link: str) -> FloatArray:
        """Return the (4, 4) pose ``T_world_link`` of a link's frame.

        Raises:
            ArgumentError: If there is no such link.
        """
        check_known("link", "link", [link], self.tree.link_frames)
        T_world_joint = self.kinematics.T_world_joint[self.tree.link_joints[link]]
        frame = self.tree.pinocchio_model.frames[self.tree.link_frames[link]]
        return T_world_joint @ frame.placement.homogeneous

    def point_jacobians(self, links: Sequence[str | None], points: ArrayLike) -> FloatArray:
        """Return (K, 3, n) velocities of points fixed to links per rate of each movable joint.

        Args:
            links: K link names; None: the point does not move.
            points: (K, 3) current positions of the points, world, metres.

        Raises:
            ArgumentError: If a link is unknown or ``points`` does not have one row per link.
        """
        positions = checked_points(links, points)
        return self.tree.point_jacobians(self.kinematics.J, joints_of(self.tree, links), positions)


def posed_links(tree: KinematicTree, positions: FloatArray) -> PosedLinks:
    """Return the links of a tree at (n,) joint positions."""
    kinematics = tree.kinematics(positions)
    joints, placements = tree.shape_placements
    poses = kinematics.T_world_joint.take(joints, axis=0) @ placements
    return PosedLinks(tree, kinematics, PlacedBodies(tree.shapes, poses))


def joints_of(tree: KinematicTree, links: Sequence[str | None]) -> list[int]:
    """Return the Pinocchio joint that carries each link; 0, the world's, for None.

    Raises:
        ArgumentError: If a link is unknown.
    """
    check_known("links", "link", (one for one in links if one is not None), tree.link_joints)
    return [0 if link is None else tree.link_joints[link] for link in links]


def checked_points(links: Sequence[str | None], points: ArrayLike) -> FloatArray:
    """Return points as (K, 3), one row per link.

    Raises:
        ArgumentError: If the shape is wrong or a number is not finite.
    """
    positions = finite_numbers("points", points)
    if positions.shape != (len(links), 3):
        raise ArgumentError(
            "points", f"needs shape ({len(links)}, 3), one row per link, got {positions.shape}"
        )
    return positions
