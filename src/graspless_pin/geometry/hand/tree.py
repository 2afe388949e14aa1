"""One tree of all mounted robots: couplings, limits, and the collision shapes of their links.

Primitive shapes are kept; meshes are made convex.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray

from graspless_pin.errors import MeshError
from graspless_pin.findings import emit
from graspless_pin.geometry.bodies.collision import BodyShapes
from graspless_pin.geometry.bodies.decomposition import Cut, convex_pieces
from graspless_pin.geometry.bodies.meshes import (
    DENSE_MESH,
    hull_corners,
    scale_findings,
)
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.hand.coupling import (
    FOLLOWER_TOLERANCE,
    LIMIT_TOLERANCE,
    Coupling,
    consistent_limits,
    independent_ranges,
    resolve_couplings,
)
from graspless_pin.geometry.hand.robot_model import (
    NEEDED_SCALE,
    LinkMesh,
    LinkShape,
    RobotModel,
    is_flat,
    load_link_mesh,
)
from graspless_pin.geometry.hand.robot_units import unit_findings
from graspless_pin.geometry.hand.work_space import (
    Kinematics,
    WorkSpace,
    joint_motions,
    pinocchio_model,
)
from graspless_pin.geometry.robots.description import JointCoupling
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import Brief, Record


@dataclass(frozen=True, eq=False)
class LinkGeometry(Record):
    """A collision shape that moves with a link.

    Attributes:
        link: Name of the link.
        joint: Pinocchio index of the joint that carries it, 0 for the base.
        shape: coal geometry, a primitive or a convex hull.
        T_joint_geometry: (4, 4) pose in the joint's frame.
    """

    link: str
    joint: int
    shape: Any
    T_joint_geometry: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class KinematicTree(Brief, Record):
    """The part of a hand that does not depend on its configuration.

    Every movable joint has one degree of freedom, so joint i of ``joint_names`` is Pinocchio's
    joint i + 1 and velocity coordinate i.

    Attributes:
        pinocchio_model: ``pinocchio.Model`` with coupled joints independent; its armature holds
            the inertias of the motors' rotors.
        joint_names: (n) movable joints in model order.
        link_frames: Frame index by link name.
        geometries: Collision shapes in model order.
        coupling: Coupled joints.
        lower: (n,) lower position limits, -inf without a limit (rad or m).
        upper: (n,) upper position limits, inf without a limit.
        visuals: Visual shapes by link, if a file states any; for drawing only.
        bases: For each mounted robot: names of its joints and frames, and the Pinocchio inertia of
            its fixed links, in world axes.
        disabled_pairs: Pairs of links whose collision is ignored (``disable_collisions``).
        groups: Joints by group of SRDFs.
        group_states: Positions by joint, rad or m, by state of SRDFs, ``GROUP/STATE``.
        missing: See `RobotModel.missing`.
        compensated_links: Links with a mass whose weight an MJCF compensates (``gravcomp``).
    """

    pinocchio_model: Any
    joint_names: tuple[str, ...]
    link_frames: Mapping[str, int]
    geometries: tuple[LinkGeometry, ...]
    coupling: Coupling
    lower: FloatArray
    upper: FloatArray
    visuals: Mapping[str, tuple[LinkShape, ...]] = field(default_factory=dict)
    bases: tuple[tuple[frozenset[str], Any], ...] = ()
    disabled_pairs: frozenset[frozenset[str]] = frozenset()
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    group_states: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)
    compensated_links: tuple[str, ...] = ()

    @cached_property
    def joint_index(self) -> Mapping[str, int]:
        """Index among the n movable joints by name."""
        return {name: index for index, name in enumerate(self.joint_names)}

    @cached_property
    def mount_of(self) -> Mapping[str, int]:
        """Index of the mounted robot that a joint or frame belongs to, by its name."""
        return {name: k for k, (names, _) in enumerate(self.bases) for name in names}

    @cached_property
    def leader_names(self) -> tuple[str, ...]:
        """(a) names of the independent joints."""
        return tuple(self.joint_names[index] for index in self.coupling.leaders)

    @cached_property
    def joint_kinds(self) -> tuple[str, ...]:
        """``revolute``, ``continuous`` or ``prismatic`` for each of the n movable joints."""
        kinds = []
        for joint in range(1, self.pinocchio_model.njoints):
            if self.pinocchio_model.nqs[joint] == 2:
                kinds.append("continuous")
            else:
                name = self.pinocchio_model.joints[joint].shortname()
                kinds.append("prismatic" if name.startswith("JointModelP") else "revolute")
        return tuple(kinds)

    @cached_property
    def tolerated_limits(self) -> tuple[FloatArray, FloatArray]:
        """(n,) lowest and highest positions within the limits and tolerances, all finite."""
        slack = np.full(len(self.joint_names), FOLLOWER_TOLERANCE)
        slack[list(self.coupling.leaders)] = LIMIT_TOLERANCE
        most = np.finfo(float).max
        return np.maximum(self.lower - slack, -most), np.minimum(self.upper + slack, most)

    @cached_property
    def ranges(self) -> tuple[FloatArray, FloatArray]:
        """(a,) lowest and highest positions of the independent joints, `independent_ranges`."""
        return independent_ranges(self.coupling, self.lower, self.upper)

    @cached_property
    def rate_limits(self) -> FloatArray:
        """(a,) rate limits of the independent joints, rad/s or m/s, infinite if not stated.

        The limits of the joints that follow them are included.
        """
        velocity_limits = np.array(self.pinocchio_model.velocityLimit)
        with np.errstate(divide="ignore"):
            leader_limits = velocity_limits[:, None] / np.abs(self.coupling.S)
        return read_only(leader_limits.min(axis=0, initial=np.inf))

    @cached_property
    def locked(self) -> frozenset[str]:
        """The independent joints that are fixed, since their limits are equal."""
        lower, upper = self.ranges
        fixed = np.flatnonzero(np.abs(upper - lower) <= LIMIT_TOLERANCE)
        return frozenset(self.leader_names[column] for column in fixed)

    @property
    def armature(self) -> FloatArray:
        """(n,) inertia of each joint's rotor, gear ratio squared included, kg m^2 (kg)."""
        return np.array(self.pinocchio_model.armature)

    @cached_property
    def link_joints(self) -> Mapping[str, int]:
        """Pinocchio index of the joint that carries each link, 0 for the base."""
        frames = self.pinocchio_model.frames
        return {link: int(frames[index].parentJoint) for link, index in self.link_frames.items()}

    @cached_property
    def parent_links(self) -> Mapping[str, str | None]:
        """The parent link of each link, None for a root link."""
        frames = self.pinocchio_model.frames
        parents: dict[str, str | None] = {}
        for link, index in self.link_frames.items():
            above = frames[frames[index].parentFrame]  # the frame of the joint, or the universe
            name = frames[above.parentFrame].name
            parents[link] = name if name in self.link_frames else None
        return parents

    @cached_property
    def supports(self) -> NDArray[np.bool_]:
        """(n + 1, n) whether joint j moves the body of Pinocchio joint i."""
        mask = np.zeros((self.pinocchio_model.njoints, self.pinocchio_model.nv), dtype=bool)
        for joint in range(1, self.pinocchio_model.njoints):
            mask[joint, np.array(self.pinocchio_model.supports[joint])[1:] - 1] = True
        return mask

    @cached_property
    def masses(self) -> tuple[FloatArray, FloatArray]:
        """(n + 1,) mass of each Pinocchio joint's body, kg, and (n + 1, 3) its centre, m.

        The centres are in the joints' frames; the first entry is the base.
        """
        inertias = self.pinocchio_model.inertias.tolist()
        centers = np.array([inertia.lever for inertia in inertias]).reshape(-1, 3)
        return read_only(np.array([inertia.mass for inertia in inertias])), read_only(centers)

    @cached_property
    def rotational_inertias(self) -> FloatArray:
        """(n + 1, 3, 3) inertia of each joint's body about its centre, the joint's axes, kg m^2."""
        inertias = self.pinocchio_model.inertias.tolist()
        return read_only(np.array([one.inertia for one in inertias]).reshape(-1, 3, 3))

    @cached_property
    def shape_placements(self) -> tuple[NDArray[np.intp], FloatArray]:
        """(G,) Pinocchio joint and (G, 4, 4) pose in its frame of every collision shape."""
        joints = np.array([item.joint for item in self.geometries], dtype=np.intp)
        poses = np.array([item.T_joint_geometry for item in self.geometries]).reshape(-1, 4, 4)
        return joints, poses

    @cached_property
    def shapes(self) -> BodyShapes:
        """Names and geometries of the collision shapes, for contact detection."""
        return BodyShapes(
            tuple(item.link for item in self.geometries),
            tuple(item.shape for item in self.geometries),
        )

    def configuration(self, positions: FloatArray) -> FloatArray:
        """Return Pinocchio's configuration vector for (n,) joint positions.

        A continuous joint has two entries in it, the cosine and the sine of its angle. Without
        such joints the same array is returned.
        """
        starts, angles = self._q_starts
        if not len(angles):
            return positions
        q = np.empty(self.pinocchio_model.nq)
        q[starts] = positions
        q[starts[angles]] = np.cos(positions[angles])
        q[starts[angles] + 1] = np.sin(positions[angles])
        return q

    def kinematics(self, positions: FloatArray) -> Kinematics:
        """Return joint poses and Jacobian columns at (n,) joint positions."""
        return self._work_space.kinematics(self.configuration(positions))

    def point_jacobians(
        self, J_world: FloatArray, joints: Sequence[int], points: FloatArray
    ) -> FloatArray:
        """Return (K, 3, n) velocities of K body-fixed points per joint rate, world axes.

        Args:
            J_world: (6, n) spatial joint columns about the world origin (``data.J``).
            joints: (K,) Pinocchio joint that carries each point.
            points: (K, 3) world positions in metres.
        """
        # v + omega x p for every joint's column; np.cross would be much slower.
        v, (x, y, z) = J_world[:3], J_world[3:]
        p = points[:, :, None]
        columns = np.empty((len(points), *v.shape))
        columns[:, 0] = v[0] + y * p[:, 2] - z * p[:, 1]
        columns[:, 1] = v[1] + z * p[:, 0] - x * p[:, 2]
        columns[:, 2] = v[2] + x * p[:, 1] - y * p[:, 0]
        columns *= self.moves[list(joints)][:, None]
        return columns

    def gravity_torques(self, positions: FloatArray, gravity: FloatArray) -> FloatArray:
        """Return the (n,) torques that compensate the links' weight at (n,) joint positions.

        Args:
            positions: rad or m.
            gravity: (3,) gravitational acceleration, world axes, m/s^2.
        """
        return self._work_space.gravity_torques(self.configuration(positions), gravity)

    def gravity_rates(self, positions: FloatArray, gravity: FloatArray) -> FloatArray:
        """Return the (n, n) derivatives of `gravity_torques` by the joint positions."""
        return self._work_space.gravity_rates(self.configuration(positions), gravity)

    def joint_inertia(self, positions: FloatArray) -> FloatArray:
        """Return the (n, n) joint-space inertia at (n,) joint positions, rotors included."""
        return self._work_space.joint_inertia(self.configuration(positions))

    @cached_property
    def _q_starts(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """First index of each joint in q, and the indices of the continuous joints."""
        starts = np.array(self.pinocchio_model.idx_qs, dtype=np.intp)[1:]
        return starts, np.flatnonzero(np.array(self.pinocchio_model.nqs)[1:] == 2)

    @cached_property
    def moves(self) -> FloatArray:
        """(n + 1, n) one if joint j moves the body of Pinocchio joint i, else 0: `supports`."""
        return self.supports.astype(np.float64)

    @cached_property
    def chains(self) -> Mapping[str, Any]:
        """Arguments of `compiled.core` that describe the joints and their bodies, by name."""
        parents, placements, axes = joint_motions(self)
        masses, centers = self.masses
        return MappingProxyType({
            "parents": parents, "placements": placements, "axes": axes, "masses": masses,
            "centers": centers,
        })  # fmt: skip

    @cached_property
    def _work_space(self) -> WorkSpace:
        return WorkSpace(self.pinocchio_model)


def build_tree(
    robots: Sequence[tuple[RobotModel, FloatArray]],
    couplings: Iterable[JointCoupling] = (),
    *,
    with_shapes: bool = True,
    cuts: Mapping[str, Cut] = MappingProxyType({}),
) -> KinematicTree:
    """Build one tree of several robots, each fixed to the world at its pose.

    Args:
        robots: (robot, (4, 4) ``T_world_base``) of each; names must differ between robots.
        couplings: Couplings that replace the robots' own for the same joints.
        with_shapes: Whether to read meshes and keep the collision shapes.
        cuts: Settings of the convex decomposition by link; other meshes become hulls.

    Returns:
        The tree.

    Raises:
        RobotError: If mimic joints follow each other in a circle.
        MeshError: If a mesh is missing, cannot be read or has no volume.

    Warns:
        GrasplessPinWarning: If a mimic joint follows a joint that does not exist, if its limits
            block a joint that it follows, or if values suggest another unit.
    """
    model, bases = pinocchio_model(robots)
    joints = {joint.name: joint for robot, _ in robots for joint in robot.joints}
    joint_names = tuple(model.names)[1:]
    follows = {item.joint: item for robot, _ in robots for item in robot.couplings}
    follows |= {item.joint: item for item in couplings}
    coupling = resolve_couplings(joint_names, follows.values())
    lower, upper = consistent_limits(
        joint_names,
        coupling,
        np.array([joints[name].lower for name in joint_names]),
        np.array([joints[name].upper for name in joint_names]),
    )
    link_frames = {
        frame.name: index
        for index, frame in enumerate(model.frames)
        if frame.type == pin.FrameType.BODY
    }
    geometries: list[LinkGeometry] = []
    for robot, _ in robots if with_shapes else ():
        own = link_geometries(model, robot, link_frames, cuts)
        emit(*unit_findings(robot, _link_boxes(model, own, link_frames)))
        geometries += own
    return KinematicTree(
        pinocchio_model=model,
        joint_names=joint_names,
        link_frames=link_frames,
        geometries=tuple(geometries),
        coupling=coupling,
        lower=lower,
        upper=upper,
        visuals={
            link.name: link.visuals for robot, _ in robots for link in robot.links if link.visuals
        },
        bases=bases,
        disabled_pairs=frozenset().union(*[robot.disabled_pairs for robot, _ in robots]),
        groups={name: own for robot, _ in robots for name, own in robot.groups.items()},
        group_states={name: own for robot, _ in robots for name, own in robot.group_states.items()},
        missing={name: own for robot, _ in robots for name, own in robot.missing.items()},
        compensated_links=tuple(
            link.name for robot, _ in robots for link in robot.links if link.gravcomp and link.mass
        ),
    )


def link_geometries(
    model: Any,
    robot: RobotModel,
    link_frames: Mapping[str, int],
    cuts: Mapping[str, Cut] = MappingProxyType({}),
) -> tuple[LinkGeometry, ...]:
    """Return the collision shapes of a robot's links, in the order of their frames.

    Args:
        model: ``pinocchio.Model``.
        robot: The robot.
        link_frames: Index of the model's frames by link.
        cuts: Settings of the convex decomposition by link; other meshes become hulls.

    Raises:
        MeshError: If a mesh is missing, cannot be read, has no volume or cannot be cut.

    Warns:
        GrasplessPinWarning: A mesh is larger than 5 m or smaller than 1 mm.
            A mesh that is cut is not watertight, or its pieces cannot be kept.
    """
    geometries = []
    for link in sorted(robot.links, key=lambda candidate: link_frames[candidate.name]):
        frame = model.frames[link_frames[link.name]]
        for item in link.collisions:
            T = (frame.placement * pin.SE3(np.array(item.T_link_shape))).homogeneous
            pieces = (
                _mesh_pieces(robot.label, link.name, item.shape, cuts.get(link.name))
                if isinstance(item.shape, LinkMesh)
                else item.shape.pieces()
            )
            geometries += [
                LinkGeometry(link.name, int(frame.parentJoint), shape, np.array(T))
                for shape in pieces
            ]
    return tuple(geometries)


def _mesh_pieces(label: str, link: str, mesh: LinkMesh, cut: Cut | None) -> tuple[Any, ...]:
    """Return the coal geometries of a mesh: its hull, or its convex pieces."""
    surface = load_link_mesh(label, link, mesh)
    what = f"the collision mesh {mesh.file} of link {link!r}"
    points = [np.array(surface.vertices, dtype=np.float64)]
    if is_flat(points[0]):
        raise MeshError(f"{what} has no volume; give it a thickness or use a box")
    emit(*scale_findings(what, what, points[0], NEEDED_SCALE))
    if cut is not None:
        points = convex_pieces(surface, what, cut)
    elif len(points[0]) > DENSE_MESH:
        points[0], findings = hull_corners(points[0], what)
        emit(*findings)
    return tuple(convex_geometry(corners, what) for corners in points)


def _link_boxes(
    model: Any, shapes: Iterable[LinkGeometry], link_frames: Mapping[str, int]
) -> dict[str, FloatArray]:
    """Return the bounding boxes of the links' shapes, see `unit_findings`."""
    corners: dict[str, list[FloatArray]] = {}
    for geometry in shapes:
        geometry.shape.computeLocalAABB()
        box = geometry.shape.aabb_local
        local = np.array([box.min_, box.max_])[np.indices((2, 2, 2)).reshape(3, -1).T, range(3)]
        T_link_joint = model.frames[link_frames[geometry.link]].placement.inverse().homogeneous
        T = T_link_joint @ geometry.T_joint_geometry
        corners.setdefault(geometry.link, []).append(local @ T[:3, :3].T + T[:3, 3])
    joined = {link: np.concatenate(parts) for link, parts in corners.items()}
    return {link: np.array([own.min(axis=0), own.max(axis=0)]) for link, own in joined.items()}
