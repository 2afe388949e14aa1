"""One Pinocchio model of all mounted URDFs, with couplings and collision geometry of its own."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError, GrasplessPinWarning, MeshError, RobotError
from graspless_pin.geometry.urdf import UNBOUNDED, Mimic, UrdfDocument

FloatArray = NDArray[np.float64]

FLATNESS = 1e-7
"""Thickness over length below which a mesh (single-precision vertices) has no volume."""


@dataclass(frozen=True, eq=False)
class LinkGeometry:
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


@dataclass(frozen=True, eq=False)
class Coupling:
    """Mimic joints as an affine map: all n joint positions are ``q = S q_a + offset``.

    Velocities follow ``S v_a`` and the actuators feel ``S^T tau``.

    Attributes:
        leaders: Indices of the a independent joints among the n joints.
        S: (n, a) coupling matrix, the identity without mimic joints.
        offset: (n,) radians or metres.
    """

    leaders: tuple[int, ...]
    S: FloatArray
    offset: FloatArray


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Everything about a hand that does not depend on its configuration.

    Every movable joint has one degree of freedom, so joint i of ``joint_names`` is Pinocchio's
    joint i + 1 and velocity coordinate i.

    Attributes:
        model: ``pinocchio.Model`` with mimic joints independent.
        joint_names: (n) movable joints in model order.
        link_frames: Frame index by link name.
        geometries: Collision shapes in model order.
        coupling: Mimic joints.
        lower: (n,) lower position limits, -inf where there is none (radians or metres).
        upper: (n,) upper position limits, inf where there is none.
    """

    model: Any
    joint_names: tuple[str, ...]
    link_frames: Mapping[str, int]
    geometries: tuple[LinkGeometry, ...]
    coupling: Coupling
    lower: FloatArray
    upper: FloatArray

    @cached_property
    def supports(self) -> NDArray[np.bool_]:
        """(n + 1, n) whether joint j moves what is attached to Pinocchio joint i."""
        mask = np.zeros((self.model.njoints, self.model.nv), dtype=bool)
        for joint in range(1, self.model.njoints):
            mask[joint] = mask[self.model.parents[joint]]
            mask[joint, joint - 1] = True
        return mask

    def configuration(self, positions: FloatArray) -> FloatArray:
        """Return Pinocchio's configuration vector of (n,) joint positions.

        Continuous joints take two entries there, the cosine and the sine of their angle.
        """
        q = np.empty(self.model.nq)
        for index, position in enumerate(positions):
            start = self.model.idx_qs[index + 1]
            if self.model.nqs[index + 1] == 2:
                q[start : start + 2] = np.cos(position), np.sin(position)
            else:
                q[start] = position
        return q

    def point_jacobians(self, J_world: FloatArray, joints: Any, points: FloatArray) -> FloatArray:
        """Return (K, 3, n) velocities of K body-fixed points per joint rate, world axes.

        Args:
            J_world: (6, n) spatial joint columns about the world origin (``data.J``).
            joints: (K,) Pinocchio joint that carries each point.
            points: (K, 3) world positions in metres.
        """
        linear, angular = J_world[:3].T, J_world[3:].T
        velocities = linear + np.cross(angular, points[:, None, :])
        velocities = velocities * self.supports[np.asarray(joints, dtype=int)][:, :, None]
        return velocities.transpose(0, 2, 1)


def build_tree(parts: Sequence[tuple[UrdfDocument, FloatArray]]) -> KinematicTree:
    """Build one tree of several URDFs, each fixed to the world at its pose.

    Args:
        parts: (document, (4, 4) ``T_world_base``) of each; names must differ between documents.

    Returns:
        The tree.

    Raises:
        RobotError: If Pinocchio refuses a document or mimic joints follow each other in a circle.
        MeshError: If a mesh cannot be read or has no volume.

    Warns:
        GrasplessPinWarning: If a mimic joint follows a joint that does not exist.
    """
    model, geometry_model = pin.Model(), pin.GeometryModel()
    for document, T_world_base in parts:
        part, part_geometry = _load(document)
        model, geometry_model = pin.appendModel(
            model, part, geometry_model, part_geometry, 0, pin.SE3(np.array(T_world_base))
        )
    joint_names = tuple(model.names)[1:]
    mimics = [mimic for document, _ in parts for mimic in document.mimics]
    single = np.array([model.nqs[joint] == 1 for joint in range(1, model.njoints)], dtype=bool)
    starts = [model.idx_qs[joint] for joint in range(1, model.njoints)]
    lower = np.where(single, model.lowerPositionLimit[starts], -np.inf)
    upper = np.where(single, model.upperPositionLimit[starts], np.inf)
    return KinematicTree(
        model=model,
        joint_names=joint_names,
        link_frames={
            frame.name: index
            for index, frame in enumerate(model.frames)
            if frame.type == pin.FrameType.BODY
        },
        geometries=tuple(_link_geometry(model, item) for item in geometry_model.geometryObjects),
        coupling=_coupling(joint_names, mimics),
        lower=np.where(lower <= -UNBOUNDED, -np.inf, lower),
        upper=np.where(upper >= UNBOUNDED, np.inf, upper),
    )


def _load(document: UrdfDocument) -> tuple[Any, Any]:
    """Return Pinocchio's model and collision model of one document."""
    for link, file in document.meshes:
        try:
            coal.MeshLoader().load(str(file), np.ones(3))
        except Exception as error:  # coal raises its own C++ exceptions as plain ones
            raise MeshError(
                f"{document.label}: the collision mesh {file} of link {link!r} cannot be read; "
                "export it again as STL, OBJ or DAE"
            ) from error
    try:
        model = pin.buildModelFromXML(document.text)
        geometry_model = pin.buildGeomFromUrdfString(
            model, document.text, pin.GeometryType.COLLISION
        )
    except ValueError as error:  # what was found wrong went to standard error
        raise RobotError(f"{document.label}: Pinocchio cannot load this URDF ({error})") from error
    for index, frame in enumerate(model.frames):
        if index > 0 and frame.type != pin.FrameType.BODY:
            # A joint may be called like a link; appendModel looks frames up by name alone.
            frame.name = f"joint {frame.name}"
    return model, geometry_model


def _link_geometry(model: Any, item: Any) -> LinkGeometry:
    """Take one geometry object over, a mesh as its convex hull."""
    link = model.frames[item.parentFrame].name
    shape = item.geometry
    if isinstance(shape, coal.BVHModelBase):
        shape = _convex_hull(shape, f"the collision mesh {item.meshPath} of link {link!r}")
    T_joint_geometry = np.array(item.placement.homogeneous)
    T_joint_geometry.setflags(write=False)
    return LinkGeometry(link, int(item.parentJoint), shape, T_joint_geometry)


def _convex_hull(mesh: Any, what: str) -> Any:
    """Return the convex hull of a mesh; coal would crash on a flat one."""
    vertices = np.array(mesh.vertices())
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    if len(extents) < 3 or extents[2] <= FLATNESS * extents[0]:
        raise MeshError(f"{what} has no volume; give it a thickness or use a box")
    error: Exception | None = None
    # A flat face of hundreds of corners is one fan of triangles with "Qt", of which coal refuses
    # the hub; joggling ("QJ") splits the face otherwise and leaves the corners where they are.
    for option in ("Qt", "QJ"):
        try:
            mesh.buildConvexHull(True, option)  # noqa: FBT003 - a C++ signature
        except (RuntimeError, ValueError) as failure:
            error = failure
        else:
            return mesh.convex
    raise MeshError(f"{what} has no usable convex hull; simplify it ({error})") from error


def _coupling(joint_names: Sequence[str], mimics: Sequence[Mimic]) -> Coupling:
    """Resolve mimic joints in any order, chains included."""
    follows = {mimic.joint: mimic for mimic in mimics}
    dangling = [mimic for mimic in mimics if mimic.leader not in joint_names]
    if dangling:
        listed = ", ".join(f"{mimic.joint!r} -> {mimic.leader!r}" for mimic in dangling)
        warnings.warn(
            f"mimic joints follow joints that do not exist or are fixed: {listed}; they are "
            "treated as independent, correct the names in the URDF",
            GrasplessPinWarning,
            stacklevel=2,
        )
        for mimic in dangling:
            del follows[mimic.joint]
    leaders = tuple(index for index, name in enumerate(joint_names) if name not in follows)
    column = {joint_names[index]: number for number, index in enumerate(leaders)}
    S = np.zeros((len(joint_names), len(leaders)))
    offset = np.zeros(len(joint_names))
    for index, name in enumerate(joint_names):
        multiplier, shift, chain = 1.0, 0.0, [name]
        while chain[-1] in follows:
            mimic = follows[chain[-1]]
            shift += multiplier * mimic.offset
            multiplier *= mimic.multiplier
            if mimic.leader in chain:
                raise RobotError(
                    f"mimic joints follow each other in a circle: "
                    f"{' -> '.join([*chain, mimic.leader])}; let one of them lead"
                )
            chain.append(mimic.leader)
        S[index, column[chain[-1]]] = multiplier
        offset[index] = shift
    S.setflags(write=False)
    offset.setflags(write=False)
    return Coupling(leaders, S, offset)


def unknown_name(argument: str, kind: str, name: str, known: Sequence[str]) -> ArgumentError:
    """Return the error for a name that is not among the known ones, which it lists."""
    listed = ", ".join(known) if known else "none"
    return ArgumentError(argument, f"unknown {kind} {name!r}; known: {listed}")
