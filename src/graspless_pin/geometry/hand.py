"""A hand of one or several mounted URDFs at a configuration: Jacobians, limits, shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.collision import CollisionBody
from graspless_pin.geometry.configuration import joint_positions
from graspless_pin.geometry.effort_limits import (
    EffortLimit,
    expand_overrides,
    resolve_effort_limits,
)
from graspless_pin.geometry.fingers import (
    ControlMode,
    ControlPlan,
    FingerSpec,
    plan_control,
)
from graspless_pin.geometry.mounts import Mount, join_mounts
from graspless_pin.geometry.robots import (
    describe_model,
    describe_urdf,
)
from graspless_pin.geometry.tree import KinematicTree, unknown_name

Control = ControlMode | str | Mapping[str, ControlMode | str]


@dataclass(frozen=True, eq=False)
class Hand:
    """A mounted hand at a configuration. Make one with ``from_urdf`` and its sisters.

    The L columns of every Jacobian are ``actuated_joint_names``: the independent joints under
    force control. Mimic joints have no column; what they feel counts at the joint they follow
    (``J_a = J S``, ``tau_a = S^T tau`` for ``q = S q_a + offset``). The motors' torque under
    contact forces f on the object is ``J^T f + gravity_torques(gravity)``.

    Attributes:
        tree: Kinematics and shapes of all mounted robots.
        base_poses: (4, 4) ``T_world_base`` by mount prefix, in mounting order.
        fingers: Fingers by (prefixed) name.
        control: Control modes of the independent joints, and the hybrid fingers.
        effort_limits: (lower, upper), each (L,), in N m (N for prismatic joints).
        positions: (n,) position of every movable joint, mimic joints included (rad or m).
    """

    tree: KinematicTree
    base_poses: Mapping[str, NDArray[np.float64]]
    fingers: Mapping[str, FingerSpec]
    control: ControlPlan
    effort_limits: tuple[NDArray[np.float64], NDArray[np.float64]]
    positions: NDArray[np.float64]

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        *,
        package_dirs: Sequence[str | Path] = (),
        T_world_base: ArrayLike | None = None,
        fingers: Mapping[str, FingerSpec] | None = None,
        q: Mapping[str, float] | None = None,
        control: Control | None = None,
        effort_limits: Mapping[str, EffortLimit] | None = None,
    ) -> Hand:
        """Load a URDF file; the arguments are those of ``Mount`` and ``assemble``."""
        mount = Mount(describe_urdf(path, package_dirs), T_world_base, fingers=fingers)
        return cls.assemble([mount], q=q, control=control, effort_limits=effort_limits)

    @classmethod
    def from_model_name(
        cls,
        name: str,
        *,
        T_world_base: ArrayLike | None = None,
        fingers: Mapping[str, FingerSpec] | None = None,
        q: Mapping[str, float] | None = None,
        control: Control | None = None,
        effort_limits: Mapping[str, EffortLimit] | None = None,
    ) -> Hand:
        """Load an example-robot-data model; the arguments are those of ``from_urdf``."""
        mount = Mount(describe_model(name), T_world_base, fingers=fingers)
        return cls.assemble([mount], q=q, control=control, effort_limits=effort_limits)

    @classmethod
    def assemble(
        cls,
        mounts: Sequence[Mount],
        *,
        q: Mapping[str, float] | None = None,
        control: Control | None = None,
        effort_limits: Mapping[str, EffortLimit] | None = None,
    ) -> Hand:
        """Assemble a hand of one or several mounted robots.

        Args:
            mounts: The robots. Their prefixes must differ.
            q: Position by joint name in radians or metres. A joint that is not named stands at
                zero or, where zero is outside its limits, at the nearest limit.
            control: One mode for all joints, or modes by finger or joint name; the default is
                FORCE.
            effort_limits: Limits by finger or joint name (a number, or (lower, upper)) that
                replace those of the robot file and the URDF.

        Returns:
            The hand.

        Raises:
            ArgumentError: If a name is unknown, a value impossible or a pose not rigid.
            RobotError: If a robot cannot be found or loaded.
            MeshError: If a mesh is missing or unusable.

        Warns:
            PlaceholderEffortWarning: If a force-controlled joint's limit is the URDF's and looks
                like a placeholder.
            GrasplessPinWarning: If a mimic joint follows a joint that does not exist.
        """
        parts = join_mounts(mounts)
        tree = parts.tree
        overrides = parts.effort_limits | expand_overrides(tree, parts.fingers, effort_limits or {})
        plan = plan_control(tree, parts.fingers, control)
        return cls(
            tree=tree,
            base_poses=MappingProxyType(parts.base_poses),
            fingers=MappingProxyType(parts.fingers),
            control=plan,
            effort_limits=resolve_effort_limits(tree, plan.force_controlled, overrides),
            positions=joint_positions(tree, q or {}),
        )

    def with_configuration(self, q: Mapping[str, float]) -> Hand:
        """Return this hand at another configuration; joints that ``q`` does not name stay.

        Args:
            q: Position by joint name in radians or metres.

        Raises:
            ArgumentError: As for ``assemble``.
        """
        return replace(self, positions=joint_positions(self.tree, q, self.positions))

    @property
    def T_world_base(self) -> NDArray[np.float64]:
        """(4, 4) pose of the root link; of the first mount, if there are several."""
        return next(iter(self.base_poses.values()))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """All n movable joints in model order, mimic joints included."""
        return self.tree.joint_names

    @property
    def actuated_joint_names(self) -> tuple[str, ...]:
        """The L independent joints under force control: the columns of the Jacobian."""
        return self.control.force_controlled

    @property
    def link_names(self) -> tuple[str, ...]:
        """All links in model order."""
        return tuple(self.tree.link_frames)

    @property
    def q(self) -> Mapping[str, float]:
        """Position of every movable joint by name, radians or metres."""
        return MappingProxyType(dict(zip(self.joint_names, self.positions.tolist(), strict=True)))

    def finger_of(self, link: str) -> str | None:
        """Return the finger that ``link`` belongs to, None for the palm and other links.

        Raises:
            ArgumentError: If there is no such link.
        """
        self._joints_of([link])
        return next((name for name, spec in self.fingers.items() if link in spec.links), None)

    def is_hybrid(self, link: str) -> bool:
        """Return whether contacts on ``link`` are a hybrid finger's: a column n each.

        Raises:
            ArgumentError: If there is no such link.
        """
        return self.finger_of(link) in self.control.hybrid_fingers

    def link_pose(self, link: str) -> NDArray[np.float64]:
        """Return the (4, 4) pose ``T_world_link`` of a link's frame.

        Raises:
            ArgumentError: If there is no such link.
        """
        joint = self._joints_of([link])[0]
        frame = self.tree.model.frames[self.tree.link_frames[link]]
        return np.array((self._data.oMi[joint] * frame.placement).homogeneous)

    def collision_bodies(self) -> tuple[CollisionBody, ...]:
        """Return the collision shapes at the hand's configuration, in model order.

        Boxes, spheres, cylinders and capsules stay what they are; a mesh is its convex hull. A
        body is named after its link, so a link with several shapes gives several bodies of one
        name.
        """
        poses = [np.array(placement.homogeneous) for placement in self._data.oMi]
        return tuple(
            CollisionBody(item.link, item.shape, poses[item.joint] @ item.T_joint_geometry)
            for item in self.tree.geometries
        )

    def contact_jacobian(self, links: Sequence[str], points: ArrayLike) -> NDArray[np.float64]:
        """Return the Jacobian of points that are fixed to links.

        Args:
            links: K link names.
            points: (K, 3) where the points are now, world, metres.

        Returns:
            (3K, L) velocity in world axes per rate of each actuated joint, three rows a point:
            ``J^T f`` is the torque that pushes with the forces f (3K,).

        Raises:
            ArgumentError: If a link is unknown or ``points`` does not have one row per link.
        """
        by_joint = self._independent_jacobians(links, points)[:, :, self._columns]
        return by_joint.reshape(3 * len(links), len(self._columns))

    def gravity_torques(self, gravity: ArrayLike) -> NDArray[np.float64]:
        """Return the torques that carry the links' own weight.

        Args:
            gravity: (3,) gravitational acceleration, world, m/s^2, e.g. (0, 0, -9.8).

        Returns:
            (L,) g(q) in N m (N for prismatic joints), zero for links without mass.

        Raises:
            ArgumentError: If ``gravity`` is not three finite numbers.
        """
        acceleration = np.asarray(gravity, dtype=np.float64)
        if acceleration.shape != (3,) or not np.isfinite(acceleration).all():
            raise ArgumentError("gravity", f"needs 3 finite numbers, got {gravity!r}")
        tree = self.tree
        joints = range(1, tree.model.njoints)
        centers = np.array([self._data.oMi[j].act(tree.model.inertias[j].lever) for j in joints])
        masses = np.array([tree.model.inertias[j].mass for j in joints])
        J = tree.point_jacobians(self._data.J, joints, centers.reshape(-1, 3))
        torques = -np.einsum("k,i,kij->j", masses, acceleration, J)
        return (tree.coupling.S.T @ torques)[self._columns]

    def point_velocities(
        self,
        links: Sequence[str],
        points: ArrayLike,
        joint_velocities: Mapping[str, float] | None = None,
        base_twist: ArrayLike | None = None,
    ) -> NDArray[np.float64]:
        """Return the velocities of points that are fixed to links.

        Args:
            links: K link names.
            points: (K, 3) where the points are now, world, metres.
            joint_velocities: Rate by independent joint (rad/s or m/s), whatever its control mode;
                the others stand still. Mimic joints follow.
            base_twist: (6,) [v; omega] of all bases as one rigid body, v at the origin of
                ``T_world_base``, world axes, m/s and rad/s; None stands still.

        Returns:
            (K, 3) velocities in world axes, m/s.

        Raises:
            ArgumentError: If a name is unknown or a mimic joint's, or a shape or value is wrong.
        """
        leaders = [self.joint_names[index] for index in self.tree.coupling.leaders]
        rates = np.zeros(len(leaders))
        for name, rate in (joint_velocities or {}).items():
            if name not in leaders:
                raise unknown_name("joint_velocities", "independent joint", name, leaders)
            rates[leaders.index(name)] = rate
        twist = np.zeros(6) if base_twist is None else np.asarray(base_twist, dtype=np.float64)
        if twist.shape != (6,) or not np.isfinite(twist).all():
            raise ArgumentError("base_twist", f"needs 6 finite numbers, got {base_twist!r}")
        if not np.isfinite(rates).all():
            raise ArgumentError("joint_velocities", f"needs finite numbers, got {joint_velocities}")
        arms = _points(links, points) - self.T_world_base[:3, 3]
        return (
            self._independent_jacobians(links, points) @ rates
            + twist[:3]
            + np.cross(twist[3:], arms)
        )

    @cached_property
    def _data(self) -> Any:
        """Pinocchio's data with joint placements and the joint Jacobian at the configuration."""
        data = self.tree.model.createData()
        pin.computeJointJacobians(self.tree.model, data, self.tree.configuration(self.positions))
        return data

    @cached_property
    def _columns(self) -> list[int]:
        """Where the actuated joints are among the independent ones."""
        modes = self.control.joints.values()
        return [column for column, mode in enumerate(modes) if mode is ControlMode.FORCE]

    def _independent_jacobians(
        self, links: Sequence[str], points: ArrayLike
    ) -> NDArray[np.float64]:
        """Return (K, 3, a) Jacobians for all independent joints."""
        positions = _points(links, points)
        J = self.tree.point_jacobians(self._data.J, self._joints_of(links), positions)
        return J @ self.tree.coupling.S

    def _joints_of(self, links: Sequence[str]) -> list[int]:
        """Return the Pinocchio joint that carries each link."""
        frames = self.tree.link_frames
        for link in links:
            if link not in frames:
                raise unknown_name("links", "link", link, self.link_names)
        return [int(self.tree.model.frames[frames[link]].parentJoint) for link in links]


def _points(links: Sequence[str], points: ArrayLike) -> NDArray[np.float64]:
    """Return ``points`` as (K, 3), one row per link."""
    positions = np.asarray(points, dtype=np.float64)
    if positions.shape != (len(links), 3):
        raise ArgumentError(
            "points", f"needs shape ({len(links)}, 3), one row per link, got {positions.shape}"
        )
    if not np.isfinite(positions).all():
        raise ArgumentError("points", f"needs finite numbers, got {positions.tolist()}")
    return positions
