"""Mass and centre of mass: closed forms, meshes against them, and meshes without a volume."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from graspless_pin.errors import ArgumentError, GrasplessPinWarning, MeshError
from graspless_pin.geometry import ManipulatedObject
from graspless_pin.geometry.bodies.decomposition import Convex
from graspless_pin.geometry.bodies.shapes import (
    Box,
    Capsule,
    Cone,
    Cylinder,
    HalfSpace,
    MeshShape,
    Shape,
    Sphere,
)

SHAPES: list[Shape] = [
    Box((0.1, 0.2, 0.3)),
    Sphere(0.1),
    Cylinder(0.1, 0.5),
    Capsule(0.1, 0.5),
    Cone(0.1, 0.5),
]


def made_of(shape: Shape, **given: Any) -> ManipulatedObject:
    return ManipulatedObject.from_shape("object", shape, np.eye(4), **given)


def inside(shape: Shape, points: np.ndarray) -> np.ndarray:
    """Which of (N, 3) points lie in a shape, by its definition."""
    x, y, z = points.T
    rho = np.hypot(x, y)
    match shape:
        case Box((a, b, c)):
            return (abs(x) < a / 2) & (abs(y) < b / 2) & (abs(z) < c / 2)
        case Sphere(radius):
            return np.hypot(rho, z) < radius
        case Cylinder(radius, length):
            return (rho < radius) & (abs(z) < length / 2)
        case Capsule(radius, length):
            return np.hypot(rho, np.maximum(abs(z) - length / 2, 0.0)) < radius
        case Cone(radius, length):
            return (rho < radius * (0.5 - z / length)) & (abs(z) < length / 2)
        case _:
            raise AssertionError(shape)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_volume_centre_and_inertia_agree_with_a_sum_over_points(shape: Shape) -> None:
    across, up = np.arange(-0.0975, 0.1, 0.005), np.arange(-0.3975, 0.4, 0.005)
    points = np.array(np.meshgrid(across, across, up)).reshape(3, -1).T
    within = points[inside(shape, points)]
    volume, centroid, _ = shape.filling()
    assert volume == pytest.approx(len(within) * 0.005**3, rel=0.03)
    assert np.allclose(centroid, within.mean(axis=0), atol=5e-3)
    arms = within - within.mean(axis=0)
    second = arms.T @ arms / len(arms)
    found = made_of(shape, mass=3.0).own_inertia
    assert np.allclose(found, 3.0 * (np.trace(second) * np.eye(3) - second), rtol=0.02, atol=1e-6)
    assert not found.flags.writeable


def ell(folder: Path, *, inverted: bool = False) -> Path:
    """An L of two bars in millimetres: 40 x 10 x 10 along x, and 10 x 10 x 30 on its left end."""
    flat = trimesh.creation.box(bounds=[[0, 0, 0], [40, 10, 10]])
    tall = trimesh.creation.box(bounds=[[0, 0, 0], [10, 10, 40]])
    mesh = trimesh.boolean.union([flat, tall])
    if inverted:
        mesh.invert()
    mesh.export(folder / "ell.stl")
    return folder / "ell.stl"


@pytest.mark.parametrize("inverted", [False, True])
def test_a_mesh_counts_with_its_own_volume_not_its_hulls(tmp_path: Path, inverted: bool) -> None:
    for convex in ("hull", "decompose"):
        shape = MeshShape(ell(tmp_path, inverted=inverted), 0.001, convex)
        found = made_of(shape, density=1000.0)
        assert found.mass == pytest.approx(0.007)
        # 4 parts at (20, 5, 5) and 3 at (5, 5, 25) millimetres.
        assert np.allclose(found.center_of_mass, [95 / 7e3, 5e-3, 95 / 7e3], atol=1e-7)
        assert not found.center_of_mass.flags.writeable
        # Bars of 4 and 3 g (10 mm square) by the theorem of parallel axes, in g mm^2.
        flat = 4.0 * np.diag([200.0, 1700.0, 1700.0]) / 12.0
        tall = 3.0 * np.diag([1000.0, 1000.0, 200.0]) / 12.0
        apart = np.array([15.0, 0.0, -20.0])
        reduced = 12.0 / 7.0 * (apart @ apart * np.eye(3) - np.outer(apart, apart))
        assert np.allclose(found.own_inertia, 1e-9 * (flat + tall + reduced), rtol=1e-6, atol=1e-13)


def test_a_mesh_scaled_along_each_axis_is_scaled_in_volume_and_centre(tmp_path: Path) -> None:
    found = made_of(MeshShape(ell(tmp_path), (0.001, 0.002, 0.003)), density=1000.0)
    assert found.mass == pytest.approx(0.042)
    assert np.allclose(found.center_of_mass, [95 / 7e3, 10e-3, 285 / 7e3], atol=1e-7)


def test_an_open_mesh_counts_with_its_hull_and_says_so(tmp_path: Path) -> None:
    mesh = trimesh.creation.box(bounds=[[0, 0, 0], [0.1, 0.1, 0.2]])
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(tmp_path / "open.ply")
    with pytest.warns(GrasplessPinWarning, match=r"open.ply' is not watertight: volume and centre"):
        volume, centroid, _ = MeshShape(tmp_path / "open.ply").filling()
    assert volume == pytest.approx(0.002)
    assert np.allclose(centroid, [0.05, 0.05, 0.1])


@pytest.mark.parametrize("fault", ["stated twice", "both sides", "split by a corner's twin"])
@pytest.mark.parametrize("convex", ["hull", "decompose"])
def test_triangles_that_close_nothing_do_not_open_a_mesh(
    tmp_path: Path, convex: Convex, fault: str
) -> None:
    path = ell(tmp_path)
    sound = MeshShape(path, 0.001, convex).filling()
    mesh = trimesh.load_mesh(path)
    corners, faces = mesh.vertices, mesh.faces
    if fault == "split by a corner's twin":  # the two triangles at an edge become four
        first, last = mesh.edges_unique[0]
        corners = np.vstack([corners, 0.999999999999 * corners[first] + 1e-12 * corners[last]])
        at_edge = (faces == first).any(axis=1) & (faces == last).any(axis=1)
        halves = [np.where(faces[at_edge] == end, len(corners) - 1, faces[at_edge])
                  for end in (first, last)]  # fmt: skip
        faces = np.vstack([faces[~at_edge], *halves])
    else:
        faces = np.vstack([faces, faces if fault == "stated twice" else faces[:, ::-1]])
    trimesh.Trimesh(corners, faces, process=False).export(tmp_path / "faulty.ply")
    found = MeshShape(tmp_path / "faulty.ply", 0.001, convex).filling()
    for one, other in zip(found, sound, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-12)


def test_parts_that_fill_the_same_space_twice_are_noticed(tmp_path: Path) -> None:
    twice = trimesh.util.concatenate(
        [trimesh.creation.box([0.1] * 3), trimesh.creation.box([0.099] * 3)]
    )
    twice.export(tmp_path / "twice.ply")
    with pytest.warns(GrasplessPinWarning, match="has parts that overlap or lie inside each other"):
        volume, _, _ = MeshShape(tmp_path / "twice.ply").filling()
    assert volume == pytest.approx(0.001)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("convex", ["hull", "decompose"])
def test_parts_count_and_hollows_do_not_whichever_way_they_are_turned(
    tmp_path: Path, convex: Convex, mirrored: bool
) -> None:
    """A weight whose two blocks face opposite ways; the larger is hollow in one of the meshes."""
    large = trimesh.creation.box(bounds=[[0, 0, 0], [0.1, 0.1, 0.1]])
    small = trimesh.creation.box(bounds=[[0.2, 0, 0], [0.3, 0.1, 0.05]])
    hollow = trimesh.creation.box(bounds=[[0.02, 0.02, 0.02], [0.08, 0.08, 0.07]])
    hollow.invert()
    (large if mirrored else small).invert()
    if mirrored:
        hollow.invert()
    trimesh.util.concatenate([large, small]).export(tmp_path / "two.ply")
    shape = MeshShape(tmp_path / "two.ply", convex=convex)
    volume, centroid, _ = shape.filling()
    assert volume == pytest.approx(1.5e-3)
    assert np.allclose(centroid, [(0.05 + 0.125) / 1.5, 0.05, (0.05 + 0.0125) / 1.5])
    assert len(shape.pieces()) == (2 if convex == "decompose" else 1)
    trimesh.util.concatenate([hollow, small, large]).export(tmp_path / "hollow.ply")
    volume, centroid, _ = MeshShape(tmp_path / "hollow.ply").filling()
    assert volume == pytest.approx(1.5e-3 - 1.8e-4)
    assert np.allclose(centroid[0], (0.05 + 0.125 - 0.18 * 0.05) / (1.5 - 0.18))


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_mass_and_density_are_positive(value: float) -> None:
    with pytest.raises(ArgumentError, match="mass: needs a positive number of kg"):
        made_of(Sphere(0.1), mass=value)
    with pytest.raises(ArgumentError, match=r"density: needs a positive number of kg/m\^3"):
        made_of(Sphere(0.1), density=value)


def test_what_has_no_volume_has_no_mass(tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="a half-space has no mass"):
        HalfSpace().filling()
    with pytest.raises(MeshError, match="does not exist"):
        made_of(MeshShape(tmp_path / "none.stl"), mass=1.0)
