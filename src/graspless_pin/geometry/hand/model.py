"""A hand of one or several mounted robots at a configuration: Jacobians, limits, shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.caching import Derived
from graspless_pin.findings import Finding
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.hand.actuation import Actuation, EffortLimit
from graspless_pin.geometry.hand.assembly import (
    AssembledMounts,
    ControlModes,
    Mount,
    assembled_mounts,
    base_poses,
    displaced_tree,
    mounts_at_poses,
)
from graspless_pin.geometry.hand.configuration import (
    PosedLinks,
    checked_points,
    independent_positions,
    independent_rates,
    joint_positions,
    joints_of,
    posed_links,
)
from graspless_pin.geometry.hand.fingers import ControlPlan
from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.geometry.poses import as_pose, invert, turning_velocities
from graspless_pin.geometry.robots.description import FingerSpec, LinkMeshes
from graspless_pin.geometry.robots.files import describe_model, describe_urdf
from graspless_pin.problem.checks import FloatArray, JointUnit, check_known, finite_array
from graspless_pin.records import Record, changed

_LONGEST_LIST = 80  # characters of a list of fingers


@dataclass(frozen=True, eq=False, repr=False)
class Hand(Record):
    """A mounted hand at a configuration. Make one with ``from_urdf`` or the other class methods.

    The L columns of every Jacobian are ``actuated_joint_names``: the actuators under force
    control. Coupled joints have no column; their torques act at the joint they follow
    (``J_a = J S``, ``tau_a = S^T tau`` for ``q = S q_a + offset``). Joints on tendons have the
    tendons' columns and, for every motion that no tendon resists, a passive one with the limits
    0 and 0. The motors' torque under contact forces f on the object is
    ``J^T f + gravity_torques(gravity)``.

    Fingers that are not named are the branches below the palm. Joints that are not below a palm,
    such as an arm's, are position-controlled unless ``control`` says otherwise. See the example of
    `load_scene`.

    Attributes:
        tree: Kinematics and shapes of all mounted robots.
        mounts: The mounts that it was assembled from, each with the robot's description and its
            pose.
        palms: The links that carry fingers or a jaw, empty if there is none.
        fingers: Fingers by (prefixed) name.
        arms: The joints that carry a palm, by the name that denotes them in ``control``.
        control: Control modes of the independent joints, and the hybrid fingers.
        actuation: The L actuators and the map from joint torques to their efforts.
        effort_limits: (lower, upper), each (L,), in N m (N for prismatic joints and tendons).
        positions: (n,) position of every movable joint, mimic joints included (rad or m).
        findings: The findings of the assembly.
    """

    tree: KinematicTree
    mounts: tuple[Mount, ...]
    palms: tuple[str, ...]
    fingers: Mapping[str, FingerSpec]
    arms: Mapping[str, tuple[str, ...]]
    control: ControlPlan
    actuation: Actuation
    effort_limits: tuple[FloatArray, FloatArray]
    positions: FloatArray
    findings: tuple[Finding, ...] = ()

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        *,
        package_dirs: Sequence[str | Path] = (),
        root_link: str | None = None,
        T_world_base: ArrayLike | None = None,
        fingers: Mapping[str, FingerSpec] | None = None,
        q: Mapping[str, float] | None = None,
        control: ControlModes | None = None,
        effort_limits: Mapping[str, EffortLimit] | None = None,
        meshes: LinkMeshes | None = None,
        srdf: str | Path | None = None,
    ) -> Hand:
        """Load a URDF file; the arguments are those of ``Mount`` and ``assemble``."""
        robot = describe_urdf(path, package_dirs)
        mount = Mount(
            robot, T_world_base, fingers=fingers, meshes=meshes, root_link=root_link, srdf=srdf
        )
        return cls.assemble([mount], q=q, control=control, effort_limits=effort_limits)

    @classmethod
    def from_model_name(
        cls,
        name: str,
        *,
        root_link: str | None = None,
        T_world_base: ArrayLike | None = None,
        fingers: Mapping[str, FingerSpec] | None = None,
        q: Mapping[str, float] | None = None,
        control: ControlModes | None = None,
        effort_limits: Mapping[str, EffortLimit] | None = None,
        meshes: LinkMeshes | None = None,
    ) -> Hand:
        """Load an example-robot-data model; the arguments are those of ``from_urdf``."""
        robot = describe_model(name)
        mount = Mount(robot, T_world_base, fingers=fingers, meshes=meshes, root_link=root_link)
        return cls.assemble([mount], q=q, control=control, effort_limits=effort_limits)

    @classmethod
    def assemble(
        cls,
        mounts: Sequence[Mount],
        *,
        q: Mapping[str, float] | None = None,
        control: ControlModes | None = None,
        effort_limits: Mapping[str, EffortLimit] | None = None,
        armature: float | Mapping[str, float] | None = None,
    ) -> Hand:
        """Assemble a hand of one or several mounted robots.

        Args:
            mounts: The robots. Their prefixes must differ.
            q: Position by joint name in radians or metres. A joint that is not named is at zero
                or, if zero is outside its limits, at the nearest limit.
            control: One mode for all joints, or modes by finger, arm or joint name; ``arm`` with
                the mount's prefix means the joints that carry its palm. The default is FORCE, and
                POSITION for joints that are not below a palm.
            effort_limits: Limits by finger, joint or tendon name (a number, or (lower, upper))
                that replace those of the robot file and the URDF.
            armature: Inertia of the motors' rotors at their joints, gear ratio squared included,
                kg m^2 (kg for prismatic joints): of all independent joints, or by finger or joint
                name; it replaces what the URDF states.

        Returns:
            The hand.

        Raises:
            ArgumentError: If a name is unknown, a value impossible or a pose not rigid.
            RobotError: If a robot cannot be found or loaded.
            MeshError: If a mesh is missing or unusable.

        Warns:
            GrasplessPinWarning: If an effort limit looks like a placeholder or is called unknown,
                or a mimic joint follows a joint that does not exist.
        """
        parts = assembled_mounts(mounts, control, armature)
        return hand_of(parts, effort_limits or {}, joint_positions(parts.joined.tree, q or {}))

    def with_configuration(self, q: Mapping[str, float] | ArrayLike) -> Hand:
        """Return this hand at another configuration.

        Args:
            q: Position by joint name, radians or metres; joints that it does not name stay. Or (a,)
                positions of the independent joints, in the order of ``control.joints``: the fast
                way.

        Raises:
            ArgumentError: If a joint is unknown, the shape is wrong, or a value is not a finite
                number, contradicts the coupling or moves a joint outside its limits.
        """
        if isinstance(q, Mapping):
            return changed(self, positions=joint_positions(self.tree, q, self.positions))
        return changed(self, positions=independent_positions(self.tree, q))

    def with_base_at(self, T_world_base: ArrayLike | Mapping[str, ArrayLike]) -> Hand:
        """Return this hand mounted elsewhere; the joint positions stay.

        Args:
            T_world_base: (4, 4) new value of `T_world_base`, m: all mounts are displaced together
                as one rigid body. Or poses by mount prefix: mounts that are not named stay.

        Raises:
            ArgumentError: If a pose is not rigid, or no mount has the prefix.

        Examples:
            >>> from graspless_pin import load_scene
            >>> scene = load_scene("examples/trihand_pivot_box.yaml")
            >>> T = scene.hand.T_world_base.copy()
            >>> T[2, 3] += 0.001  # m
            >>> raised = scene.with_changes(hand=scene.hand.with_base_at(T))
            >>> print(f"{raised.hand.T_world_base[2, 3] - scene.hand.T_world_base[2, 3]:.3f} m")
            0.001 m
        """
        if not isinstance(T_world_base, Mapping):
            T = as_pose("T_world_base", T_world_base)
            return displaced_hand(self, T @ invert(self.T_world_base))
        displacements = dict.fromkeys(self.base_poses, np.eye(4))
        check_known("T_world_base", "mount", T_world_base, displacements)
        for prefix, pose in T_world_base.items():
            T = as_pose(f"T_world_base[{prefix!r}]", pose)
            displacements[prefix] = T @ invert(self.base_poses[prefix])
        return displaced_hand(self, np.array([*displacements.values()]))

    @property
    def base_poses(self) -> Mapping[str, FloatArray]:
        """(4, 4) ``T_world_base`` by mount prefix, in mounting order."""
        return base_poses(self.mounts)

    @property
    def T_world_base(self) -> FloatArray:
        """(4, 4) pose of the root link; of the first mount, if there are several."""
        return next(iter(self.base_poses.values()))

    def __repr__(self) -> str:
        """Return one line: the robots, and the numbers of joints, actuators and fingers."""
        robots = ", ".join(getattr(one.source, "name", str(one.source)) for one in self.mounts)
        fingers = ", ".join(self.fingers)
        fingers = fingers if len(fingers) <= _LONGEST_LIST else str(len(self.fingers))
        return (
            f"<Hand {robots}: {len(self.joint_names)} joints, {len(self.actuated_joint_names)} "
            f"actuators; fingers: {fingers or 'none'}>"
        )

    @property
    def joint_names(self) -> tuple[str, ...]:
        """All n movable joints in model order, mimic joints included."""
        return self.tree.joint_names

    @property
    def actuated_joint_names(self) -> tuple[str, ...]:
        """The L actuators under force control: the columns of the Jacobian.

        Motors by the name of their joint, then tendons, then passive motions.
        """
        return self.actuation.names

    @property
    def effort_units(self) -> tuple[JointUnit, ...]:
        """The L units of the actuators' efforts."""
        return self.actuation.units

    @property
    def link_names(self) -> tuple[str, ...]:
        """All links in model order."""
        return tuple(self.tree.link_frames)

    @property
    def group_states(self) -> Mapping[str, Mapping[str, float]]:
        """Positions by joint, rad or m, by state of the SRDFs: ``GROUP/STATE`` with the prefix.

        ``hand.with_configuration(hand.group_states["hand/open"])`` is the hand in that state.
        """
        return self.tree.group_states

    @property
    def q(self) -> Mapping[str, float]:
        """Position of every movable joint by name, radians or metres."""
        return MappingProxyType(dict(zip(self.joint_names, self.positions.tolist(), strict=True)))

    def finger_of(self, link: str) -> str | None:
        """Return the finger that ``link`` belongs to, None for the palm and other links.

        Raises:
            ArgumentError: If there is no such link.
        """
        joints_of(self.tree, [link])
        return next((name for name, spec in self.fingers.items() if link in spec.links), None)

    def is_hybrid(self, link: str) -> bool:
        """Return whether ``link`` is of a hybrid finger: each contact on it has a column n.

        Raises:
            ArgumentError: If there is no such link.
        """
        return self.finger_of(link) in self.control.hybrid_fingers

    def pose_of(self, link: str, q: Mapping[str, float] | ArrayLike | None = None) -> FloatArray:
        """Return the pose of a link: forward kinematics.

        Args:
            link: Name of the link, with its mount's prefix.
            q: Configuration, as `with_configuration` takes it; None: the hand's own.

        Returns:
            (4, 4) ``T_world_link`` of the link's frame, m.

        Raises:
            ArgumentError: If there is no such link; or as of `with_configuration`.

        Examples:
            >>> from graspless_pin import load_scene
            >>> hand = load_scene("examples/trihand_pivot_box.yaml").hand
            >>> T = hand.pose_of("finger_1_tip", {"finger_1_distal": 0.5})  # rad
            >>> T.shape
            (4, 4)
        """
        return (self if q is None else self.with_configuration(q))._links.pose(link)

    def collision_bodies(self) -> tuple[CollisionBody, ...]:
        """Return the collision shapes at the hand's configuration, in model order.

        Boxes, spheres, cylinders and capsules are kept; a mesh is replaced by its convex hull. A
        body is named after its link, so a link with several shapes yields several bodies of one
        name.
        """
        return tuple(self.placed_bodies)

    @property
    def placed_bodies(self) -> PlacedBodies:
        """The bodies of `collision_bodies`, each made on first access."""
        return self._links.bodies

    def contact_jacobian(self, links: Sequence[str | None], points: ArrayLike) -> FloatArray:
        """Return the Jacobian of points that are fixed to links.

        Args:
            links: K link names; None: the point does not move.
            points: (K, 3) current positions of the points, world, metres.

        Returns:
            (3K, L) velocity in world axes per rate of each actuated joint, three rows a point:
            ``J^T f`` is the torque that exerts the forces f (3K,).

        Raises:
            ArgumentError: If a link is unknown or ``points`` does not have one row per link.
        """
        jacobians = self._links.point_jacobians(links, points)
        columns = self.actuation.from_joints
        if not self.actuation.is_identity:
            jacobians = jacobians @ columns
        return jacobians.reshape(3 * len(links), columns.shape[1])

    def gravity_torques(self, gravity: ArrayLike) -> FloatArray:
        """Return the torques that compensate the links' own weight.

        Args:
            gravity: (3,) gravitational acceleration, world, m/s^2, e.g. (0, 0, -9.8).

        Returns:
            (L,) g(q) in N m (N for prismatic joints), zero for links without mass.

        Raises:
            ArgumentError: If ``gravity`` is not three finite numbers.
        """
        acceleration = finite_array("gravity", gravity, (3,))
        torques = self.tree.gravity_torques(self.positions, acceleration)
        return torques if self.actuation.is_identity else torques @ self.actuation.from_joints

    def joint_inertia(self) -> FloatArray:
        """Return the inertia at the actuators, with all other joints fixed.

        Returns:
            (L, L) symmetric, kg m^2 (kg m, kg for prismatic joints and tendons): twice the kinetic
            energy of links and rotors is ``v^T M v`` for actuator rates v. Zero if a joint moves
            only links without mass.
        """
        columns = self.actuation.from_joints
        inertia = columns.T @ self.tree.joint_inertia(self.positions) @ columns
        return 0.5 * (inertia + inertia.T)

    def point_velocities(
        self,
        links: Sequence[str],
        points: ArrayLike,
        joint_velocities: Mapping[str, float] | None = None,
        base_twist: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the velocities of points that are fixed to links.

        Args:
            links: K link names.
            points: (K, 3) current positions of the points, world, metres.
            joint_velocities: Rate by independent joint (rad/s or m/s), whatever its control mode;
                the others do not move. Mimic joints follow.
            base_twist: (6,) [v; omega] of all bases as one rigid body, v at the origin of
                ``T_world_base``, world axes, m/s and rad/s; None: the bases do not move.

        Returns:
            (K, 3) velocities in world axes, m/s.

        Raises:
            ArgumentError: If a name is unknown or a mimic joint's, or a shape or value is wrong.
        """
        rates = independent_rates(self.tree, joint_velocities or {})
        twist = finite_array("base_twist", np.zeros(6) if base_twist is None else base_twist, (6,))
        arms = checked_points(links, points) - self.T_world_base[:3, 3]
        return (
            self._links.point_jacobians(links, points) @ (self.tree.coupling.S @ rates)
            + twist[:3]
            + turning_velocities(twist[3:], arms)
        )

    @property
    def _links(self) -> PosedLinks:
        """The links at the hand's configuration."""
        return _links_of(self)


def hand_of(
    parts: AssembledMounts, effort_limits: Mapping[str, EffortLimit], positions: FloatArray
) -> Hand:
    """Return the hand of assembled robots at (n,) positions; emit findings on its limits.

    Args:
        parts: The assembled robots.
        effort_limits: See `Hand.assemble`.
        positions: Of all joints, rad or m.
    """
    joined = parts.joined
    limits, limit_findings = parts.effort_limits(effort_limits)
    return Hand(
        joined.tree, joined.mounts, joined.palms, joined.fingers, joined.arms, parts.plan,
        parts.actuation, limits, positions, (*parts.findings, *limit_findings),
    )  # fmt: skip


def displaced_hand(hand: Hand, T: FloatArray) -> Hand:
    """Return a hand with the bases of its mounts displaced; the joint positions stay.

    Args:
        hand: The hand.
        T: (4, 4) pose, world axes, or one by mount, (N, 4, 4): each ``T_world_base`` becomes
            ``T @ T_world_base``.
    """
    each = [*np.broadcast_to(T, (len(hand.mounts), 4, 4))]
    poses = [step @ pose for step, pose in zip(each, hand.base_poses.values(), strict=True)]
    tree = displaced_tree(hand.tree, each)
    return replace(hand, tree=tree, mounts=mounts_at_poses(hand.mounts, poses))


_links_of: Derived[Hand, PosedLinks] = Derived(lambda hand: posed_links(hand.tree, hand.positions))
