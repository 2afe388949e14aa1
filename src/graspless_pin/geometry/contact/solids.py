"""The convex sets of bodies and what the search for touching pairs asks of them, kept by shapes."""

from __future__ import annotations

import weakref
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspless_pin.geometry.bodies.collision import BodyShapes
from graspless_pin.geometry.contact.convex_sets import ConvexSet, Plane, Polytope, convex_set

Array = NDArray[np.float64]

_ENDLESS = 1e12  # m; finite, as zero times infinity is not a number


@dataclass(frozen=True, eq=False)
class Solids:
    """K convex sets in the frames of their geometries.

    Attributes:
        sets: K sets.
        ranks: Which of two bodies comes first: half-spaces before polytopes before curved shapes,
            large before small, then by name.
        centers: (K, 3, 1) centres of boxes around them, m.
        half_extents: (K, 3) half the edge lengths of these boxes, m.
        reaches: (K,) radii of spheres around them about these centres, m.
        centered: Whether all centres are the origins of their frames.
        has_plane: Whether one of them is a half-space.
        only_planes: Whether all of them are.
    """

    sets: tuple[ConvexSet, ...]
    ranks: tuple[tuple[int, float, str], ...]
    centers: Array
    half_extents: Array
    reaches: Array
    centered: bool
    has_plane: bool
    only_planes: bool


_known: weakref.WeakKeyDictionary[BodyShapes, Solids] = weakref.WeakKeyDictionary()


def solids_of(shapes: BodyShapes) -> Solids:
    """The sets of some shapes, remembered for as long as the shapes live.

    Raises:
        SceneError: A geometry is of a kind that contacts cannot be found for.
        MeshError: The points of a hull all lie in one plane.
    """
    known = _known.get(shapes)
    if known is None:
        known = _known[shapes] = _solids(shapes)
    return known


def _solids(shapes: BodyShapes) -> Solids:
    sets = tuple(
        convex_set(name, geometry)
        for name, geometry in zip(shapes.names, shapes.geometries, strict=True)
    )
    bounded = [None if isinstance(one, Plane) else one for one in sets]
    centers = np.array([np.zeros(3) if one is None else one.center for one in bounded])
    halves = [np.full(3, _ENDLESS) if one is None else one.half_extents for one in bounded]
    return Solids(
        sets,
        tuple(_rank(name, one) for name, one in zip(shapes.names, sets, strict=True)),
        centers.reshape(-1, 3, 1),
        np.array(halves).reshape(-1, 3),
        np.array([_ENDLESS if one is None else one.radius for one in bounded]),
        not centers.any(),
        any(one is None for one in bounded),
        all(one is None for one in bounded),
    )


def _rank(name: str, solid: ConvexSet) -> tuple[int, float, str]:
    if isinstance(solid, Plane):
        return 0, 0.0, name
    return (1 if isinstance(solid, Polytope) else 2), -solid.radius, name
