"""Hulls of dense meshes: few corners, and how far they are off is measured."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
import trimesh
from tests.oracles import dense_meshes
from tests.oracles.dense_meshes import ring

from graspless_pin import Hand
from graspless_pin.findings import FindingCode, capture
from graspless_pin.geometry.bodies import decomposition
from graspless_pin.geometry.bodies.meshes import (
    DENSE_CUT,
    DENSE_MESH,
    HULL_TOLERANCE,
    hull_corners,
)
from graspless_pin.geometry.bodies.shapes import MeshShape

egg = functools.cache(dense_meshes.egg)


def standing_out(vertices: np.ndarray, corners: np.ndarray) -> float:
    """Return how far vertices stand out over the planes of a hull's faces, by brute force."""
    equations = trimesh.convex.convex_hull(corners)
    normals, points = equations.face_normals, equations.triangles[:, 0]
    offsets = np.einsum("fi,fi->f", normals, points)
    return max(float((part @ normals.T - offsets).max()) for part in np.array_split(vertices, 200))


def test_a_dense_mesh_keeps_few_corners_and_says_how_far_they_are_off() -> None:
    mesh = egg(6)
    vertices = np.array(mesh.vertices)
    size = float(np.ptp(vertices, axis=0).max())
    corners, (found,) = hull_corners(vertices, "the egg")
    assert found.code is FindingCode.SIMPLIFIED_HULL
    assert len(vertices) == 40_962 and 5_000 < len(corners) < 12_000
    assert {tuple(row) for row in corners} <= {tuple(row) for row in vertices}
    off = standing_out(vertices[::16], corners)
    assert 0.5 * HULL_TOLERANCE * size < off < 1.001 * HULL_TOLERANCE * size
    told = float(found.message.split("up to ")[1].split(" mm")[0]) * 1e-3
    assert 0.95 * off <= told < 1.5 * off  # two digits; a little more than over the planes


def test_a_sharp_tip_is_measured_to_the_hull_and_not_to_the_planes_of_its_faces() -> None:
    """A point of a needle may stand far out and yet barely over the planes of its flanks."""
    rng = np.random.default_rng(2)
    z = rng.uniform(0.0, 1.0, 3 * DENSE_MESH) ** 0.5
    turn = rng.uniform(0.0, 2.0 * np.pi, len(z))
    radius = 0.02 * (1.0 - z)
    vertices = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), z])
    corners, (found,) = hull_corners(vertices, "the needle")
    told = float(found.message.split("up to ")[1].split(" mm")[0]) * 1e-3
    assert told >= 0.95 * (vertices[:, 2].max() - corners[:, 2].max())
    assert told >= 0.95 * standing_out(vertices, corners)


def test_other_meshes_keep_all_corners() -> None:
    vertices = np.array(egg(5).vertices)
    corners, found = hull_corners(vertices, "the egg")
    assert len(vertices) == len(corners) == 10_242 <= DENSE_MESH and not found


def test_a_dense_mesh_is_cut_with_fewer_triangles_and_says_how_far_they_are_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = ring(80)
    assert len(mesh.faces) > DENSE_CUT
    given: list[trimesh.Trimesh] = []
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(
        decomposition,
        "_cut_pieces",
        lambda solid, *_: [given.append(solid), np.array(solid.vertices)][1:],
    )
    with capture() as told:
        for _ in range(2):  # it is said of pieces that are kept, too
            decomposition.convex_pieces(mesh, "the ring")
    assert [one.code for one in told] == 2 * [FindingCode.SIMPLIFIED_HULL]
    (solid,), found = given, told[0]
    assert solid.is_watertight and 0.9 * DENSE_CUT < len(solid.faces) <= DENSE_CUT
    assert solid.volume == pytest.approx(mesh.volume, rel=2e-3)
    mesh.export(tmp_path / "ring.ply")
    with capture() as told:  # nothing of the hull, which stands for nothing
        MeshShape(tmp_path / "ring.ply", convex="decompose").pieces()
    assert [one.code for one in told] == [FindingCode.SIMPLIFIED_HULL]
    assert "it is replaced by 10000 triangles" in told[0].message
    near = trimesh.proximity.closest_point_naive(solid, mesh.vertices[::200])[1]
    off = float(found.message.split("up to ")[1].split(" mm")[0]) * 1e-3
    assert float(near.max()) <= 1.05 * off < 2e-4


def test_objects_and_links_say_so_and_masses_are_of_the_whole_mesh(tmp_path: Path) -> None:
    egg(6).export(tmp_path / "egg.stl")
    shape = MeshShape(tmp_path / "egg.stl")
    with capture() as of_object:
        geometry = shape.pieces()[0]
        filled = shape.filling()
    assert {one.code for one in of_object} == {FindingCode.SIMPLIFIED_HULL}
    volume = 4.0 / 3.0 * np.pi * 0.05 * 0.04 * 0.03
    assert filled.volume == pytest.approx(volume, rel=2e-4)
    (tmp_path / "egg.urdf").write_text(
        '<robot name="egg"><link name="palm"><collision><geometry><mesh filename="egg.stl"/>'
        "</geometry></collision></link></robot>"
    )
    with capture() as of_link:
        hand = Hand.from_urdf(tmp_path / "egg.urdf")
    assert [one.code for one in of_link] == [FindingCode.SIMPLIFIED_HULL]
    assert "of link 'palm'" in of_link[0].message
    assert hand.collision_bodies()[0].geometry.num_points == geometry.num_points
