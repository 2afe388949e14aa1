"""Triangles of every shape: closed, outward, of the right size and where the shape is."""

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.meshes import (
    Triangles,
    simplified,
    slab_triangles,
)
from graspless_pin.geometry.bodies.shapes import (
    Box,
    Capsule,
    Cone,
    Cylinder,
    HalfSpace,
    MeshShape,
    Shape,
    Sphere,
    shape_of,
)

MUG = Path(__file__).resolve().parents[2] / "examples" / "meshes" / "mug.stl"

length = st.floats(1e-3, 3.0)
shapes = st.one_of(
    st.builds(Box, st.tuples(length, length, length)),
    st.builds(Sphere, length),
    st.builds(Cylinder, length, length),
    st.builds(Capsule, length, length),
    st.builds(Cone, length, length),
)


def solid(surface: Triangles) -> trimesh.Trimesh:
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False)


def check(surface: Triangles, shape: Shape) -> None:
    mesh = solid(surface)
    assert mesh.is_watertight
    filled = shape.filling()
    # Inscribed in circles of 32 corners, whose area is 0.994 of the circle's.
    assert 0.97 * filled.volume < mesh.volume < (1.0 + 1e-9) * filled.volume
    geometry = shape.pieces()[0]
    geometry.computeLocalAABB()
    size = np.array(geometry.aabb_local.max_ - geometry.aabb_local.min_)
    assert mesh.center_mass == pytest.approx(filled.centroid, abs=1e-2 * size.max())
    assert np.ptp(surface.vertices, axis=0) == pytest.approx(size, rel=1e-2)


@given(shapes)
@settings(max_examples=15)
def test_a_surface_is_closed_outward_and_fills_its_shape(shape):
    check(shape.surface(), shape)


@given(shapes)
@settings(max_examples=15)
def test_what_contact_detection_sees_is_drawn_the_same(shape):
    seen = shape_of(shape.pieces()[0]).surface()
    check(seen, shape)
    drawn = shape.surface()
    assert seen.vertices.min(axis=0) == pytest.approx(drawn.vertices.min(axis=0), abs=1e-12)
    assert seen.vertices.max(axis=0) == pytest.approx(drawn.vertices.max(axis=0), abs=1e-12)


def test_a_hull_is_drawn_by_its_corners_and_a_mesh_with_its_hollows():
    mug = MeshShape(MUG)
    hull = shape_of(mug.pieces()[0]).surface()
    assert solid(hull).is_watertight
    assert solid(hull).volume == pytest.approx(trimesh.load_mesh(MUG).convex_hull.volume, rel=1e-6)
    drawn, file = MeshShape(MUG, scale=2.0).surface(), trimesh.load_mesh(MUG)
    assert solid(drawn).volume == pytest.approx(8.0 * file.volume, rel=1e-6)
    assert len(drawn.faces) == len(file.faces)


def test_a_mesh_is_simplified_to_the_given_size():
    fine = Sphere(0.5).surface()
    coarse = simplified(fine, 300)
    assert 100 <= len(coarse.faces) <= 300
    assert np.linalg.norm(coarse.vertices, axis=1) == pytest.approx(0.5, abs=0.05)
    assert solid(coarse).volume > 0.8 * solid(fine).volume
    assert simplified(fine, len(fine.faces)) is fine


def test_a_half_space_is_a_slab_below_its_plane():
    slab = slab_triangles((1.0, -2.0), 0.5, 0.1)
    assert solid(slab).is_watertight
    assert slab.vertices.min(axis=0) == pytest.approx([0.5, -2.5, -0.1])
    assert slab.vertices.max(axis=0) == pytest.approx([1.5, -1.5, 0.0])
    with pytest.raises(ArgumentError, match="slab_triangles"):
        HalfSpace().surface()
    assert shape_of(HalfSpace().pieces()[0]) == HalfSpace()


def test_a_surface_moves_with_its_pose():
    turn = np.eye(4)
    turn[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    turn[:3, 3] = [1.0, 2.0, 3.0]
    moved = Box((0.2, 0.4, 0.6)).surface().moved(turn)
    assert moved.vertices.min(axis=0) == pytest.approx([0.8, 1.9, 2.7])
    assert solid(moved).volume == pytest.approx(0.2 * 0.4 * 0.6)
    with pytest.raises(ValueError, match="read-only"):
        moved.vertices[0] = math.nan
