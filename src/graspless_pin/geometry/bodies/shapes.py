"""The shapes of objects and supports, and the list of them. Metres, axes as in URDF."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
from pydantic import Field

from graspless_pin.errors import ArgumentError
from graspless_pin.findings import Finding, FindingCode, capture, emit
from graspless_pin.geometry.bodies.convex_sets import ConvexSet, Plane, SolidOfRevolution
from graspless_pin.geometry.bodies.decomposition import (
    DEFAULT_CONCAVITY,
    DEFAULT_TIME_LIMIT,
    WAYS,
    Concavity,
    Convex,
    Cut,
    DecomposeTimeLimit,
    MaxPieces,
    convex_pieces,
)
from graspless_pin.geometry.bodies.meshes import (
    DENSE_MESH,
    HULL_TOLERANCE,
    MOST_FACES,
    Triangles,
    file_state,
    file_triangles,
    hull_points,
    scaled_mesh,
    unit_surface,
    with_outward_faces,
)
from graspless_pin.geometry.bodies.polytopes import box_polytope
from graspless_pin.geometry.bodies.shape import (
    Filling,
    Hull,
    Lengths,
    Shape,
    ShapeFile,
    checked_lengths,
    convex_geometry,
)
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.intake.fields import Length
from graspless_pin.problem.checks import one_of

_SECTIONS = 32  # of a circle
_SIMULATED_SECTIONS = 252
"""The hull exceeds the radius by 0.01 % at its edges; 32 sections would exceed it by 0.5 %, so that
fingers feel the edges. All edges meet in the tip, and coal allows no vertex with more than 254
(`convex_geometry`)."""
_CAPSULE_SECTIONS = (16, 32)
_SPHERE_SUBDIVISIONS = 3  # 1280 triangles


@dataclass(frozen=True)
class Box(Shape):
    """A box with full edge lengths.

    Its centre is its frame's origin.

    Attributes:
        size (tuple[float, float, float]): Full edge lengths along x, y, z, m.

    Examples:
        >>> from graspless_pin.geometry import Box
        >>> Box((0.06, 0.04, 0.02))  # m
        Box(size=(0.06, 0.04, 0.02))
    """

    kind = "box"
    coal_type = coal.Box
    size: Annotated[Lengths, Field(description="[m] full edge lengths along x, y, z")]

    @classmethod
    def set_of(cls, geometry: Any) -> ConvexSet:
        """See `Shape.set_of`."""
        return box_polytope(np.array(geometry.halfSide, dtype=float))

    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass."""
        return Filling.symmetric(math.prod(self.size), np.square(self.size) / 12.0)

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surface."""
        return unit_surface("box", self.size)

    def mjcf_geom(self) -> dict[str, Any]:
        """Return the attributes of MJCF."""
        return {"type": "box", "size": [0.5 * length for length in self.size]}


@dataclass(frozen=True)
class Sphere(Shape):
    """A sphere.

    Its centre is its frame's origin. See the example of `Box`.

    Attributes:
        radius (float): m.
    """

    kind = "sphere"
    rolls = True
    coal_type = coal.Sphere
    radius: Annotated[Length, Field(description="[m] from the origin of its frame")]

    @classmethod
    def set_of(cls, geometry: Any) -> ConvexSet:
        """See `Shape.set_of`."""
        return SolidOfRevolution(0.0, 0.0, 0.0, geometry.radius)

    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass."""
        return Filling.symmetric(
            4.0 / 3.0 * math.pi * self.radius**3, np.full(3, self.radius**2 / 5.0)
        )

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surface."""
        return unit_surface("icosphere", self.radius, _SPHERE_SUBDIVISIONS)

    def mjcf_geom(self) -> dict[str, Any]:
        """Return the attributes of MJCF."""
        return {"type": "sphere", "size": [self.radius]}


@dataclass(frozen=True)
class Cylinder(Shape):
    """A cylinder along z, its full height.

    It is centred at its frame's origin. See the example of `Box`.

    Attributes:
        radius (float): m.
        length (float): Full height, m.
    """

    kind = "cylinder"
    rolls = True
    coal_type = coal.Cylinder
    radius: Annotated[Length, Field(description="[m] about z")]
    length: Annotated[
        Length, Field(description="[m] full height, half of it on each side of the origin")
    ]

    @classmethod
    def set_of(cls, geometry: Any) -> ConvexSet:
        """See `Shape.set_of`."""
        return SolidOfRevolution(geometry.radius, geometry.radius, geometry.halfLength)

    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass."""
        return Filling.symmetric(
            math.pi * self.radius**2 * self.length,
            np.array([self.radius**2 / 4.0, self.radius**2 / 4.0, self.length**2 / 12.0]),
        )

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surface."""
        return unit_surface(
            "cylinder", (self.radius, self.radius, self.length), 1.0, 1.0, sections=_SECTIONS
        )

    def mjcf_geom(self) -> dict[str, Any]:
        """Return the attributes of MJCF."""
        return {"type": "cylinder", "size": [self.radius, 0.5 * self.length]}


@dataclass(frozen=True)
class Capsule(Shape):
    """A capsule along z; the length is the cylinder's without its ends.

    It is centred at its frame's origin, and its ends are half spheres. See the example of `Box`.

    Attributes:
        radius (float): m.
        length (float): Height of the cylinder without its ends, m.
    """

    kind = "capsule"
    rolls = True
    coal_type = coal.Capsule
    radius: Annotated[Length, Field(description="[m] of the cylinder and of its round ends")]
    length: Annotated[Length, Field(description="[m] of the cylinder, without its ends")]

    @classmethod
    def set_of(cls, geometry: Any) -> ConvexSet:
        """See `Shape.set_of`."""
        return SolidOfRevolution(0.0, 0.0, geometry.halfLength, geometry.radius)

    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass."""
        radius, length = self.radius, self.length
        volume = math.pi * radius**2 * (length + 4.0 / 3.0 * radius)
        cap_share = 4.0 * radius / (3.0 * length + 4.0 * radius)  # share of the caps in the volume
        square_across = radius**2 * ((1.0 - cap_share) / 4.0 + cap_share / 5.0)
        cap_square_along = length**2 / 4.0 + 3.0 / 8.0 * length * radius + radius**2 / 5.0
        square_along = (1.0 - cap_share) * length**2 / 12.0 + cap_share * cap_square_along
        return Filling.symmetric(volume, np.array([square_across, square_across, square_along]))

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surface."""
        return unit_surface(
            "capsule", self.radius, self.length / self.radius, 1.0, count=_CAPSULE_SECTIONS
        )

    def mjcf_geom(self) -> dict[str, Any]:
        """Return the attributes of MJCF."""
        return {"type": "capsule", "size": [self.radius, 0.5 * self.length]}


@dataclass(frozen=True)
class Cone(Shape):
    """A cone, tip up along z.

    Its tip is at z = +length/2 and its base at z = -length/2. See the example of `Box`.

    Attributes:
        radius (float): Radius of the base, m.
        length (float): Full height, m.
    """

    kind = "cone"
    coal_type = coal.Cone
    radius: Annotated[Length, Field(description="[m] of the base")]
    length: Annotated[
        Length, Field(description="[m] from the base to the tip, the origin in its middle")
    ]

    @classmethod
    def set_of(cls, geometry: Any) -> ConvexSet:
        """See `Shape.set_of`."""
        return SolidOfRevolution(geometry.radius, 0.0, geometry.halfLength)

    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass."""
        return Filling.symmetric(
            math.pi * self.radius**2 * self.length / 3.0,
            np.array([self.radius**2, self.radius**2, self.length**2 / 4.0]) * 3.0 / 20.0,
            -0.25 * self.length,
        )

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surface."""
        factors = self.radius, self.radius, self.length
        return unit_surface("cone", factors, 1.0, 1.0, sections=_SECTIONS, lowered=0.5)

    def mjcf_geom(self) -> dict[str, Any]:
        """Return the vertices of a circumscribed hull: MuJoCo has no cones."""
        corner = self.radius / math.cos(math.pi / _SIMULATED_SECTIONS)
        factors = corner, corner, self.length
        hull = unit_surface("cone", factors, 1.0, 1.0, sections=_SIMULATED_SECTIONS, lowered=0.5)
        return {"type": "mesh", "vertex": hull.vertices}


@dataclass(frozen=True)
class MeshShape(Shape):
    """A mesh file, as its convex hull or cut into convex pieces; relative to the scene file.

    In Python the path is relative to the working folder. See the example of `Box`.

    Attributes:
        path (Path): STL, OBJ, DAE, GLB, glTF, PLY or OFF file, in its own coordinates. A DAE is in
            the unit that it states, and the axis that it says is up becomes z.
        scale (float | tuple[float, float, float]): Metres per unit of the file, or per the unit
            that a DAE states; one number, or three along x, y, z.
        convex (str): ``hull`` fills all hollows; ``decompose`` cuts the mesh into convex pieces,
            which keeps them (see `decomposition`).
        concavity (float): For ``decompose``: largest depth of a hollow that may still be filled, as
            a share of half the largest extent, 0.01 to 1.
        decompose_time_limit (float): Time limit of the decomposition, s, at most 1e6.
        max_pieces (int | None): Largest number of convex pieces; None: no limit but the concavity.
    """

    kind = "mesh"
    path: Annotated[ShapeFile, Field(description="STL, OBJ, DAE, PLY, OFF, GLB or glTF file")]
    scale: Annotated[
        Length | Lengths,
        Field(
            description="[m] length of one unit of the file: 0.001 for millimetres; a DAE that "
            "states its unit is converted to metres, and its up axis becomes z"
        ),
    ] = 1.0
    convex: Annotated[
        Convex,
        Field(
            description="hull: its convex hull; decompose: convex pieces of a non-convex mesh, "
            "cached"
        ),
    ] = "hull"
    concavity: Concavity = DEFAULT_CONCAVITY
    decompose_time_limit: DecomposeTimeLimit = DEFAULT_TIME_LIMIT
    max_pieces: MaxPieces | None = None

    def __post_init__(self) -> None:
        """Check the numbers; the file is read only when its geometry is needed.

        Raises:
            ArgumentError: The scale is not one or three positive numbers, or the choice of convex
                parts is unknown or out of range.
        """
        object.__setattr__(self, "path", Path(self.path))
        count = 1 if np.ndim(self.scale) == 0 else 3
        object.__setattr__(self, "scale", checked_lengths("scale", self.scale, count))
        one_of(WAYS, "convex", self.convex)
        self.cut()

    def cut(self) -> Cut:
        """Return the settings of the convex decomposition."""
        return Cut(self.concavity, self.decompose_time_limit, self.max_pieces)

    def pieces(self) -> tuple[Any, ...]:
        """Make the coal geometry of the hull, or of all convex pieces."""
        if self.convex == "hull":
            points = hull_points(self.path, self.scale)
            return (convex_geometry(points, f"mesh file '{self.path}'"),)
        with capture() as findings:
            hull_points(self.path, self.scale)
        # The hull is not used: whether it was simplified does not matter.
        emit(*(finding for finding in findings if finding.code is not FindingCode.SIMPLIFIED_HULL))
        pieces, cut_findings = _decomposed_pieces(self, file_state(self.path))
        emit(*cut_findings)
        return pieces

    def filling(self) -> Filling:
        """Return the filling of the mesh; of an open mesh, that of its convex hull."""
        import trimesh

        hull = trimesh.convex.convex_hull(hull_points(self.path, self.scale))
        mesh = scaled_mesh(self.path, self.scale)
        if mesh.is_watertight and mesh.is_winding_consistent:
            mesh = with_outward_faces(mesh)
            lost_volume = (
                HULL_TOLERANCE * hull.scale * hull.area if len(mesh.vertices) > DENSE_MESH else 0.0
            )
            if 0.0 < float(mesh.volume) <= float(hull.volume) * (1.0 + 1e-9) + lost_volume:
                return Filling.of_mesh(mesh)
            problem = "has parts that overlap or lie inside each other"
        else:
            problem = "is not watertight"
        emit(
            Finding(
                FindingCode.OPEN_MESH,
                str(self.path),
                f"mesh '{self.path}' {problem}: volume and centre of mass, and the inertia, are "
                "those of its convex hull",
                "repair the mesh, or give mass, centre of mass and inertia",
                ("object", "shape"),
            )
        )
        return Filling.of_mesh(hull)

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the triangles of the file, not those of its convex pieces."""
        hull_points(self.path, self.scale)  # reports faults of the file
        return file_triangles(self.path, self.scale, max_faces)


@dataclass(frozen=True)
class HalfSpace(Shape):
    """Everything at z <= 0 of its frame: a floor, table or slope.

    The outward normal is +z. See the example of `Box`.
    """

    kind = "half_space"
    is_bounded = False
    coal_type = coal.Halfspace

    def pieces(self) -> tuple[Any, ...]:
        """Make the coal geometry."""
        return (coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0),)

    @classmethod
    def set_of(cls, geometry: Any) -> ConvexSet:
        """See `Shape.set_of`."""
        return Plane(np.array(geometry.n, dtype=float), float(geometry.d))

    def filling(self) -> Filling:
        """Raise ArgumentError: a half-space encloses no volume."""
        raise ArgumentError("shape", "a half-space has no mass; use a bounded shape")

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Raise ArgumentError: a half-space is unbounded."""
        raise ArgumentError("shape", "a half-space is unbounded; draw it with slab_triangles")

    def mjcf_geom(self) -> dict[str, Any]:
        """Return the attributes of MJCF."""
        return {"type": "plane", "size": [0.0, 0.0, 1.0]}


SHAPES: dict[str, type[Shape]] = {
    shape.kind: shape
    for shape in (Box, Sphere, Cylinder, Capsule, Cone, MeshShape, Hull, HalfSpace)
}
"""The shape classes by their ``type`` in scene files; add a new class to this list.

A `shape.Compound` consists of such shapes.
"""


def shape_of(geometry: Any) -> Shape:
    """Return the shape of a coal geometry, a primitive or a convex hull.

    Every coal half-space becomes a `HalfSpace`, whatever its normal and offset.

    Raises:
        ArgumentError: The geometry is neither a primitive nor a convex hull.
    """
    kind = kind_of(geometry)
    if kind is None:
        raise ArgumentError(
            "geometry", f"needs a bounded primitive or a convex hull, got {type(geometry).__name__}"
        )
    return kind.of_coal(geometry)


def kind_of(geometry: Any) -> type[Shape] | None:
    """Return the class of `SHAPES` that a coal geometry represents; None if there is none."""
    return next((kind for kind in SHAPES.values() if isinstance(geometry, kind.coal_type)), None)


@lru_cache(maxsize=32)
def _decomposed_pieces(
    shape: MeshShape, _state: tuple[str, int, int]
) -> tuple[tuple[Any, ...], tuple[Finding, ...]]:
    """Decompose a mesh; cached, so that an object that only moves is not cut again."""
    mesh = scaled_mesh(shape.path, shape.scale)
    label = f"mesh file '{shape.path}'"
    with capture() as findings:
        pieces = convex_pieces(mesh, label, shape.cut())
    return tuple(convex_geometry(piece, label) for piece in pieces), tuple(findings)


def _fix_box_factor() -> None:
    """Fix the scale factor of coal's box support function to 1 in every process.

    The factor is 1 or 1 + 1e-10. The first direction evaluated in a process selects it, once for
    half-spaces and once for GJK: 1 if no component of the direction is zero. Without this call
    distances would differ between processes.
    """
    box, T = coal.Box(1.0, 1.0, 1.0), pose_matrix((0.0, 0.0, 5.0), (0.3, 0.5, 0.7))
    box_placement = coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3]))
    # The order matters: GJK starts along the x axis of its first shape.
    for shape in coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), coal.Ellipsoid(1.0, 1.0, 1.0):
        result = coal.DistanceResult()
        coal.distance(shape, coal.Transform3s(), box, box_placement, coal.DistanceRequest(), result)


_fix_box_factor()
