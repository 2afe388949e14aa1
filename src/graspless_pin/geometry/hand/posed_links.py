"""The links of a tree at one configuration: where they are, and how their points move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.geometry.hand.work_space import Kinematics
from graspless_pin.geometry.poses import finite_numbers
from graspless_pin.problem.checks import all_finite, unknown_name


class PosedLinks(NamedTuple):
    """The links of a tree at one configuration.

    Attributes:
        tree: The tree.
        kinematics: Its joint poses and Jacobian columns.
        bodies: The collision shapes in model order, each made only when it is asked for.
    """

    tree: KinematicTree
    kinematics: Kinematics
    bodies: PlacedBodies

    def pose(self, link: str) -> NDArray[np.float64]:
        """Return the (4, 4) pose ``T_world_link`` of a link's frame.

        Raises:
            ArgumentError: If there is no such link.
        """
        if link not in self.tree.link_joints:
            raise unknown_name("link", "link", link, tuple(self.tree.link_frames))
        joint = self.tree.link_joints[link]
        frame = self.tree.pinocchio_model.frames[self.tree.link_frames[link]]
        return self.kinematics.T_world_joint[joint] @ frame.placement.homogeneous

    def point_jacobians(
        self, links: Sequence[str | None], points: ArrayLike
    ) -> NDArray[np.float64]:
        """Return (K, 3, n) velocities of points fixed to links per rate of each movable joint.

        Args:
            links: K link names; None: the point stands still.
            points: (K, 3) where the points are now, world, metres.

        Raises:
            ArgumentError: If a link is unknown or ``points`` does not have one row per link.
        """
        positions = checked_points(links, points)
        return self.tree.point_jacobians(self.kinematics.J, joints_of(self.tree, links), positions)


def posed_links(tree: KinematicTree, positions: NDArray[np.float64]) -> PosedLinks:
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
    carriers = tree.link_joints
    try:
        return [0 if link is None else carriers[link] for link in links]
    except KeyError as error:
        known = tuple(tree.link_frames)
        raise unknown_name("links", "link", str(error.args[0]), known) from error


def checked_points(links: Sequence[str | None], points: ArrayLike) -> NDArray[np.float64]:
    """Return points as (K, 3), one row per link.

    Raises:
        ArgumentError: If the shape is another or a number is not finite.
    """
    if isinstance(points, np.ndarray) and points.dtype == np.float64 and all_finite((points,)):
        positions = points
    else:
        positions = finite_numbers("points", points)
    if positions.shape != (len(links), 3):
        raise ArgumentError(
            "points", f"needs shape ({len(links)}, 3), one row per link, got {positions.shape}"
        )
    return positions
