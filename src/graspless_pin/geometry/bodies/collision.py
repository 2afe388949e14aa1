"""Collision bodies: convex pieces at poses, metres.

Hands, objects and supports pass their geometry to contact detection in this form.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import unchecked


@dataclass(frozen=True, eq=False)
class CollisionBody:
    """One convex piece of geometry at a pose.

    Data derived from the geometry (vertices, faces) are cached while the geometry object lives:
    keep one Python object per shape and make new bodies from it.

    Attributes:
        name: Name of the hand link, support or object that the geometry belongs to.
        geometry: coal primitive or convex hull, never a triangle soup.
        T_world_geometry: (4, 4) read-only pose of the geometry, m.
    """

    name: str
    geometry: Any
    T_world_geometry: FloatArray

    def __post_init__(self) -> None:
        """Copy the pose.

        Raises:
            ArgumentError: The pose is not a (4, 4) array.
        """
        pose = np.array(self.T_world_geometry, dtype=float)
        if pose.shape != (4, 4):
            raise ArgumentError("T_world_geometry", f"needs shape (4, 4), got {pose.shape}")
        object.__setattr__(self, "T_world_geometry", read_only(pose))


@dataclass(frozen=True, eq=False)
class BodyShapes:
    """Names and geometries of bodies, without poses. Keep one object for all their poses.

    Attributes:
        names: K names of hand links, supports or objects.
        geometries: K coal primitives or convex hulls.
    """

    names: tuple[str, ...]
    geometries: tuple[Any, ...]


class PlacedBodies(Sequence[CollisionBody]):
    """Bodies at poses, each made on first access: most links of a hand touch nothing.

    Attributes:
        shapes: Names and geometries of the K bodies.
        poses: (K, 4, 4) read-only poses of the geometries, m.
    """

    __slots__ = ("_made", "poses", "shapes")

    def __init__(self, shapes: BodyShapes, poses: FloatArray) -> None:
        """Place the shapes; ``poses`` is kept, not copied."""
        self.shapes = shapes
        self.poses = read_only(poses)
        self._made: dict[int, CollisionBody] = {}

    @classmethod
    def joined(cls, parts: Sequence[PlacedBodies]) -> PlacedBodies:
        """Return the bodies of several sequences, one after the other."""
        if len(parts) == 1:
            return parts[0]
        names = tuple(name for part in parts for name in part.shapes.names)
        geometries = tuple(shape for part in parts for shape in part.shapes.geometries)
        poses = np.concatenate([np.empty((0, 4, 4)), *(part.poses for part in parts)])
        return cls(BodyShapes(names, geometries), poses)

    @classmethod
    def of(cls, bodies: Sequence[CollisionBody]) -> PlacedBodies:
        """Return bodies given one by one as `PlacedBodies`; such are returned as they are."""
        if isinstance(bodies, PlacedBodies):
            return bodies
        shapes = BodyShapes(
            tuple([body.name for body in bodies]), tuple([body.geometry for body in bodies])
        )
        poses = np.array([body.T_world_geometry for body in bodies], dtype=float)
        placed = cls(shapes, poses.reshape(-1, 4, 4))
        placed._made.update(enumerate(bodies))
        return placed

    def __len__(self) -> int:
        """Return the number of bodies."""
        return len(self.shapes.names)

    @overload
    def __getitem__(self, index: int) -> CollisionBody: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[CollisionBody, ...]: ...
    def __getitem__(self, index: int | slice) -> CollisionBody | tuple[CollisionBody, ...]:
        """Return a body, the same object at each access, or a tuple of a slice."""
        if isinstance(index, slice):
            return tuple([self[k] for k in range(*index.indices(len(self)))])
        k = range(len(self.shapes.names))[index]
        body = self._made.get(k)
        if body is None:
            body = unchecked(  # its pose is read-only already: no copy
                CollisionBody,
                name=self.shapes.names[k],
                geometry=self.shapes.geometries[k],
                T_world_geometry=self.poses[k],
            )
            self._made[k] = body
        return body
