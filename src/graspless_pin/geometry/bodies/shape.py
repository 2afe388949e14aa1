"""The interface of shapes: scene-file keys, coal geometry, mass properties, surface, MJCF form.

Also the shapes that are made of other data: `Hull` (of points) and `Compound` (of several shapes).
"""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import MISSING, asdict, dataclass, fields
from functools import cache, cached_property
from pathlib import Path
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Self,
    get_args,
    get_type_hints,
)

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from pydantic import Field, GetPydanticSchema, create_model

from graspless_pin.bounds import LARGEST_LENGTH, SMALLEST_LENGTH
from graspless_pin.errors import ArgumentError, MeshError
from graspless_pin.geometry.bodies.convex_sets import ConvexSet
from graspless_pin.geometry.bodies.meshes import MOST_FACES, Triangles
from graspless_pin.geometry.bodies.polytopes import hull_polytope
from graspless_pin.geometry.poses import as_numbers, as_pose, transformed
from graspless_pin.intake.fields import METRES, Entry, FilePath, Finite, Length
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import PickledByFields

Lengths = Annotated[tuple[Length, Length, Length], METRES]
"""Three positive lengths along x, y, z."""

ShapeFile = Annotated[Path, GetPydanticSchema(lambda _, handler: handler(FilePath))]
"""The file that a shape is read from: in the scene file a path relative to it."""

_LISTED = Annotated[list[tuple[Finite, Finite, Finite]], Field(min_length=4, max_length=10_000)]
Points = Annotated[FloatArray, GetPydanticSchema(lambda _, handler: handler(_LISTED))]
"""(V, 3) points that are not all in one plane; a list of lists in the scene file."""

_HALF_LENGTH_NAMES = {"size": "halfSide", "length": "halfLength"}
"""The lengths of which coal stores the half, with coal's attribute for each."""

_RANGE = f"from {SMALLEST_LENGTH:g} to {LARGEST_LENGTH:g} m"
_LEAST_THICKNESS_RATIO = 1e-6
"""Least thickness of a hull over its width; coal crashes from about 1e-7 on."""


class Filling(NamedTuple):
    """Volume, centroid and inertia per mass of what a shape encloses.

    Attributes:
        volume: m^3.
        centroid: (3,) read-only, in the shape's frame, m.
        gyration: (3, 3) read-only inertia per mass about the centroid, the shape's axes, m^2.
    """

    volume: float
    centroid: FloatArray
    gyration: FloatArray

    @classmethod
    def symmetric(cls, volume: float, squares: FloatArray, height: float = 0.0) -> Filling:
        """Return the filling of a shape whose products of inertia are zero.

        Args:
            volume: m^3.
            squares: (3,) mean squares of x, y, z about the centroid, m^2.
            height: z of the centroid, which lies on the z axis, m.
        """
        centroid, gyration = np.array([0.0, 0.0, height]), np.diag(squares.sum() - squares)
        return cls(volume, read_only(centroid), read_only(gyration))

    @classmethod
    def of_mesh(cls, mesh: Any) -> Filling:
        """Return the filling of a closed triangle mesh, a `trimesh.Trimesh`."""
        volume, gyration = float(mesh.volume), np.array(mesh.moment_inertia, dtype=float)
        gyration = 0.5 * (gyration + gyration.T) / volume
        return cls(volume, read_only(np.array(mesh.center_mass)), read_only(gyration))


@dataclass(frozen=True, eq=False)
class Shape(ABC):
    """A shape: a frozen dataclass whose fields are the keys of a scene file, in metres.

    Each field is annotated with its schema: a type of `intake.fields` and a pydantic ``Field`` with
    the description. The first line of the class's docstring describes the shape there. Fields of
    the types `Length` and `Lengths` are checked when a shape is made. `shapes.SHAPES` lists the
    classes.

    Attributes:
        kind: The ``type`` of the shape in scene files.
        rolls: Whether the shape can roll on a plane.
        is_bounded: Whether the shape is bounded, and so has a mass and a surface.
        coal_type: The coal geometry that represents shapes of this class, if there is one; such a
            class implements `set_of`, too.
    """

    kind: ClassVar[str]
    rolls: ClassVar[bool] = False
    is_bounded: ClassVar[bool] = True
    coal_type: ClassVar[Any] = ()

    def __post_init__(self) -> None:
        """Check the fields that are lengths.

        Raises:
            ArgumentError: One is not a positive number.
        """
        for name, count in self.lengths().items():
            value = getattr(self, name)
            object.__setattr__(self, name, checked_lengths(name, value, count))

    def pieces(self) -> tuple[Any, ...]:
        """Make the coal geometries of the convex pieces; by default one `coal_type`.

        Raises:
            MeshError: The mesh file is missing, unreadable or encloses no volume.

        Warns:
            GrasplessPinWarning: The mesh is larger than 5 m or smaller than 1 mm, or one that is
                cut is not watertight, or its pieces cannot be kept on disk.
        """
        return (
            self.coal_type(*np.hstack([getattr(self, key) for key in self.lengths()]).tolist()),
        )

    @classmethod
    def of_coal(cls, geometry: Any) -> Self:
        """Return the shape of a coal geometry of the type `coal_type`.

        By default the lengths are read from coal's attributes of the same names.
        """
        return cls(
            *(
                2.0 * np.array(getattr(geometry, _HALF_LENGTH_NAMES[key]))
                if key in _HALF_LENGTH_NAMES
                else getattr(geometry, key)
                for key in cls.lengths()
            )
        )

    @classmethod
    def set_of(cls, geometry: Any) -> ConvexSet:
        """Return the convex set that a coal geometry fills, for contact detection."""
        raise NotImplementedError(f"{cls.__name__} has a coal_type, so it needs 'set_of'")

    def placements(self) -> FloatArray | None:
        """Return (K, 4, 4) poses of the pieces in the shape's frame; None: identities."""
        return None

    @abstractmethod
    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass.

        Raises:
            ArgumentError: The shape is a half-space.
            MeshError: The mesh file is missing, unreadable or encloses no volume.

        Warns:
            GrasplessPinWarning: A mesh is not watertight; its convex hull counts instead.
        """

    @abstractmethod
    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surface in the shape's own frame, for drawing it.

        Args:
            max_faces: A mesh file with more triangles is simplified, see `simplified`.

        Raises:
            ArgumentError: The shape is a half-space; see `slab_triangles`.
            MeshError: The mesh file is missing, unreadable or encloses no volume.

        Warns:
            MeshScaleWarning: The mesh is larger than 5 m or smaller than 1 mm.
        """

    def mjcf_geom(self) -> dict[str, Any]:
        """Return the attributes of the MJCF ``geom``; for a mesh, its ``vertex`` positions."""
        return {"type": "mesh", "vertex": self.surface().vertices}

    @classmethod
    @cache
    def entry(cls) -> type[Entry]:
        """Return the schema of the shape's mapping in a scene file; a path is a text there."""
        hints = get_type_hints(cls, include_extras=True)
        description = f"type of the shape: {cls.kind.replace('_', '-')}"
        keys: Any = {"type": (Literal[cls.kind], Field(description=description))} | {
            field.name: (hints[field.name], ... if field.default is MISSING else field.default)
            for field in fields(cls)
        }
        return create_model(
            f"{cls.kind.title().replace('_', '')}Entry",
            __base__=Entry,
            __doc__=(inspect.getdoc(cls) or "").partition("\n")[0],
            __module__=cls.__module__,
            **keys,
        )

    @classmethod
    @cache
    def lengths(cls) -> dict[str, int]:
        """Return the fields of type `Length` (1 number) and `Lengths` (3 numbers)."""
        hints = get_type_hints(cls, include_extras=True)
        return {
            field.name: 1 if get_args(hints[field.name])[0] is float else 3
            for field in fields(cls)
            if METRES in get_args(hints[field.name])
        }

    @classmethod
    def from_entry(cls, entry: Entry, resolve_path: Callable[[str], Path]) -> Self:
        """Return the shape of a validated mapping of a scene file.

        Args:
            entry: Mapping of the type that `entry` returns.
            resolve_path: Returns the file that a path in the scene file names.

        Raises:
            ArgumentError: The numbers contradict each other.
        """
        hints = get_type_hints(cls)
        return cls(
            **{
                key: resolve_path(value) if hints[key] is Path else value
                for key, value in entry
                if key in hints
            }
        )

    def as_entry(self, path_text: Callable[[Path], str]) -> dict[str, Any]:
        """Return the shape's mapping in a scene file.

        Args:
            path_text: Returns the path that the scene file states for another file.
        """
        return {"type": self.kind} | {
            key: path_text(value) if isinstance(value, Path) else value
            for key, value in asdict(self).items()
        }


class Polyhedron(Shape):
    """The convex hull of vertices; a subclass implements `vertices` only."""

    @abstractmethod
    def vertices(self) -> FloatArray:
        """Return the (V, 3) vertices in the shape's own frame, m, not all in one plane."""

    def pieces(self) -> tuple[Any, ...]:
        """Make the coal geometry of the hull."""
        return (convex_geometry(self.vertices(), f"the {self.kind}"),)

    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass."""
        import trimesh

        return Filling.of_mesh(trimesh.convex.convex_hull(self.vertices()))

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surface of the hull."""
        import trimesh

        hull = trimesh.convex.convex_hull(self.vertices())
        return Triangles(hull.vertices, hull.faces)

    def mjcf_geom(self) -> dict[str, Any]:
        """Return its vertices for a mesh of MJCF."""
        return {"type": "mesh", "vertex": self.vertices()}


@dataclass(frozen=True, eq=False)
class Hull(Polyhedron):
    """The convex hull of points.

    Used for the collision mesh of a link, a convex piece of an object, and a mesh inside an MJCF.

    Attributes:
        points: (V, 3), m.
    """

    kind = "hull"
    coal_type = coal.ConvexBase
    points: Annotated[
        Points, Field(description="[m] its corners, in its frame; points inside have no effect")
    ]

    def __post_init__(self) -> None:
        """Store the points as an array."""
        object.__setattr__(self, "points", np.asarray(self.points))

    @classmethod
    def of_coal(cls, geometry: Any) -> Self:
        """See `Shape.of_coal`."""
        return cls(np.array(geometry.points()))

    @classmethod
    def set_of(cls, geometry: Any) -> ConvexSet:
        """See `Shape.set_of`."""
        return hull_polytope(np.array(geometry.points(), dtype=float))

    def vertices(self) -> FloatArray:
        """Return the points."""
        return self.points


@dataclass(frozen=True, eq=False)
class Compound(PickledByFields, Shape):
    """Shapes at poses in one frame, as the geoms of a body in MuJoCo are.

    Attributes:
        parts: S bounded shapes.
        poses: (S, 4, 4) of each in the frame of the compound, m.

    Examples:
        >>> import numpy as np
        >>> from graspless_pin.geometry import Box, Compound, Cylinder
        >>> head, handle = Box((0.08, 0.03, 0.03)), Cylinder(0.01, 0.2)  # m
        >>> T_head = np.eye(4)
        >>> T_head[2, 3] = 0.115  # m
        >>> hammer = Compound((head, handle), [T_head, np.eye(4)])
        >>> print(f"{1e6 * hammer.filling().volume:.0f} cm^3")
        135 cm^3
    """

    kind = "compound"
    parts: tuple[Shape, ...]
    poses: FloatArray

    def __post_init__(self) -> None:
        """Check the parts and copy the poses.

        Raises:
            ArgumentError: There is no part, one has no end, or a pose is not rigid.
        """
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts or not all(part.is_bounded for part in self.parts):
            raise ArgumentError("parts", "needs at least one shape, none of them a half-space")
        if len(self.poses) != len(self.parts):
            raise ArgumentError("poses", f"needs one for each of {len(self.parts)} parts")
        poses = [as_pose(f"poses[{k}]", T) for k, T in enumerate(self.poses)]
        object.__setattr__(self, "poses", read_only(np.array(poses)))

    @cached_property
    def _pieces(self) -> tuple[tuple[Any, ...], ...]:
        return tuple(part.pieces() for part in self.parts)

    def pieces(self) -> tuple[Any, ...]:
        """Make the coal geometries of all parts, each in its part's own frame."""
        return tuple(piece for part_pieces in self._pieces for piece in part_pieces)

    def placements(self) -> FloatArray:
        """Return the (K, 4, 4) poses of the pieces."""
        return np.repeat(self.poses, [len(part_pieces) for part_pieces in self._pieces], axis=0)

    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass; overlapping parts count twice."""
        fillings = [part.filling() for part in self.parts]
        volumes = np.array([part_filling.volume for part_filling in fillings])
        shares = volumes / volumes.sum()
        rotations = self.poses[:, :3, :3]
        centers = np.array(
            [
                transformed(T, part_filling.centroid)
                for T, part_filling in zip(self.poses, fillings, strict=True)
            ]
        )
        centroid = shares @ centers
        gyration = np.zeros((3, 3))
        for share, R, part_filling, arm in zip(
            shares, rotations, fillings, centers - centroid, strict=True
        ):
            steiner = arm @ arm * np.eye(3) - np.outer(arm, arm)
            gyration += share * (R @ part_filling.gyration @ R.T + steiner)
        return Filling(float(volumes.sum()), read_only(centroid), read_only(gyration))

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surfaces of all parts."""
        faces_per_part = max(max_faces // len(self.parts), 1)
        surfaces = [
            part.surface(faces_per_part).moved(T)
            for part, T in zip(self.parts, self.poses, strict=True)
        ]
        starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
        faces = [surface.faces + start for surface, start in zip(surfaces, starts, strict=False)]
        return Triangles(np.vstack([surface.vertices for surface in surfaces]), np.vstack(faces))

    def as_entry(self, path_text: Callable[[Path], str]) -> dict[str, Any]:
        """Return the shape's mapping in a scene file: see `Shape.as_entry`."""
        placed = zip(self.parts, self.poses, strict=True)
        return {
            "type": self.kind,
            "parts": [
                {
                    "shape": part.as_entry(path_text),
                    "pose": {"position": T[:3, 3], "matrix": T[:3, :3]},
                }
                for part, T in placed
            ],
        }


def convex_geometry(points: FloatArray, label: str = "the mesh") -> Any:
    """Make the coal geometry of the convex hull of points that are not all in one plane.

    Args:
        points: (V, 3), m.
        label: The name of the points in messages.

    Raises:
        MeshError: coal cannot represent the hull, as with more than 254 edges at one vertex, or
            would crash because the hull is nearly flat.
    """
    centered = points - points.mean(axis=0)
    principal_axes = np.linalg.svd(centered, full_matrices=False)[2]
    size = float(np.ptp(centered, axis=0).max())
    thickness = float(np.ptp(centered @ principal_axes[-1]))
    if thickness < _LEAST_THICKNESS_RATIO * size:  # coal would end the process
        raise MeshError(
            f"{label} is almost flat: {thickness:.3g} m thick and {size:.3g} m wide; give it a "
            f"thickness of at least {_LEAST_THICKNESS_RATIO:g} of its width"
        )
    corners: Any = coal.StdVec_Vec3s()
    corners.extend(points)
    error: Exception | None = None
    # With "Qt" a flat face of hundreds of vertices becomes one fan of triangles, whose hub has too
    # many edges for coal; joggling ("QJ") splits the face differently and keeps the vertices.
    for option in ("Qt", "QJ"):
        try:
            return coal.Convex.convexHull(corners, True, option)  # noqa: FBT003 - keep triangles
        except (RuntimeError, ValueError) as failure:
            error = failure
    reason = " ".join(str(error).rpartition("message:")[2].split())
    if reason.startswith("Too many neighbors"):
        reason = "more than 254 of its edges meet at one vertex, such as the tip of a cone"
    raise MeshError(f"{label} has no usable convex hull ({reason}); simplify it") from error


def checked_lengths(name: str, value: Any, count: int) -> Any:
    """Return one checked length, or three along x, y, z as a tuple.

    Raises:
        ArgumentError: The value is not a positive number, or not three of them.
    """
    if count == 3:
        array = as_numbers(name, value, "three positive numbers")
        is_valid = (array >= SMALLEST_LENGTH) & (array <= LARGEST_LENGTH)
        if array.shape != (3,) or not is_valid.all():
            numbers = array.tolist()
            raise ArgumentError(name, f"needs three positive numbers {_RANGE}, got {numbers}")
        return tuple(array.tolist())
    if not isinstance(value, (int, float, np.floating)) or isinstance(value, bool):
        raise ArgumentError(name, f"needs a positive number, got {value!r}")
    if not SMALLEST_LENGTH <= value <= LARGEST_LENGTH:
        raise ArgumentError(name, f"needs a positive number {_RANGE}, got {value!r}")
    return value
