"""Shapes: checked sizes, coal geometries, mesh files good and bad."""

from pathlib import Path

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
import trimesh

from graspless_pin.errors import ArgumentError, MeshError
from graspless_pin.geometry.bodies.meshes import scaled_mesh
from graspless_pin.geometry.bodies.shapes import (
    Box,
    Capsule,
    Cone,
    Cylinder,
    HalfSpace,
    MeshShape,
    Shape,
    Sphere,
    convex_geometry,
)


@pytest.mark.parametrize(
    ("shape", "extent"),
    [
        (Box((0.1, 0.2, 0.3)), (0.1, 0.2, 0.3)),
        (Sphere(0.1), (0.2, 0.2, 0.2)),
        (Cylinder(0.1, 0.5), (0.2, 0.2, 0.5)),
        (Capsule(0.1, 0.5), (0.2, 0.2, 0.7)),
        (Cone(0.1, 0.5), (0.2, 0.2, 0.5)),
    ],
)
def test_the_coal_geometry_has_the_extent_of_the_shape(
    shape: Shape, extent: tuple[float, float, float]
) -> None:
    geometry = shape.pieces()[0]
    geometry.computeLocalAABB()
    box = geometry.aabb_local
    assert np.allclose([box.width(), box.height(), box.depth()], extent, atol=1e-9)


def test_a_half_space_is_solid_below_z() -> None:
    geometry = HalfSpace().pieces()[0]
    assert np.array_equal(geometry.n, [0, 0, 1])
    assert geometry.d == 0


@pytest.mark.parametrize("value", [0.0, -0.1, float("nan"), float("inf"), "wide", True])
def test_a_length_that_is_not_positive_is_refused(value: float) -> None:
    for make in (
        lambda: Sphere(value),
        lambda: Cylinder(value, 1.0),
        lambda: Capsule(value, 1.0),
        lambda: Cone(value, 1.0),
    ):
        with pytest.raises(ArgumentError, match="radius: needs a positive number"):
            make()
    with pytest.raises(ArgumentError, match="length: needs a positive number"):
        Cylinder(1.0, value)


@pytest.mark.parametrize(
    "size", [(0.1, 0.0, 0.1), (0.1, 0.1), (0.1, -1, 0.1), "big", (1, 1, np.inf)]
)
def test_a_box_needs_three_positive_lengths(size: tuple[float, float, float]) -> None:
    with pytest.raises(ArgumentError, match="size: needs three positive numbers"):
        Box(size)


@pytest.mark.parametrize("scale", [0.0, -1.0, (1.0, 1.0), (1.0, 0.0, 1.0)])
def test_a_mesh_needs_a_positive_scale(scale: float) -> None:
    with pytest.raises(ArgumentError, match="scale"):
        MeshShape(Path("part.stl"), scale)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb", "off", "dae"])
def test_a_mesh_becomes_its_scaled_hull(tmp_path: Path, suffix: str) -> None:
    # An L of two boxes: 0.2 x 0.1 x 0.2 around, with a notch that the hull bridges.
    ell = trimesh.util.concatenate(
        [
            trimesh.creation.box(bounds=[[0, 0, 0], [200, 100, 50]]),
            trimesh.creation.box(bounds=[[0, 0, 0], [50, 100, 200]]),
        ]
    )
    path = tmp_path / f"ell.{suffix}"
    ell.export(path)
    if suffix == "dae":  # trimesh writes Y_UP, whatever is up
        path.write_text(path.read_text().replace("Y_UP", "Z_UP"))
    shape = MeshShape(path, 0.001)
    hull = shape.pieces()[0]
    assert isinstance(hull, coal.Convex)
    outline = ((0, 0), (0.2, 0), (0.2, 0.05), (0.05, 0.2), (0, 0.2))
    expected = {(x, y, z) for x, z in outline for y in (0, 0.1)}
    assert {tuple(np.round(p, 6).tolist()) for p in hull.points()} == expected


def test_a_mesh_can_be_scaled_along_each_axis(tmp_path: Path) -> None:
    trimesh.creation.box(extents=[1, 1, 1]).export(tmp_path / "cube.stl")
    shape = MeshShape(tmp_path / "cube.stl", (0.1, 0.2, 0.3))
    corners = np.array(shape.pieces()[0].points())
    assert np.allclose(np.ptp(corners, axis=0), [0.1, 0.2, 0.3])


@pytest.mark.parametrize("scale", [1e-9, 1e-7, 1e-4, 1.0, 1e9, 1e10, 1e12])
def test_corners_of_a_mesh_of_any_size_stay_apart(tmp_path: Path, scale: float) -> None:
    trimesh.creation.box(extents=[0.3, 0.2, 0.1]).export(tmp_path / "brick.stl")
    mesh = scaled_mesh(tmp_path / "brick.stl", scale)
    assert len(mesh.vertices) == 8
    assert np.allclose(np.ptp(mesh.vertices, axis=0), scale * np.array([0.3, 0.2, 0.1]))


@pytest.mark.parametrize("sections", [250, 300])
def test_a_mesh_may_have_a_flat_face_of_hundreds_of_corners(tmp_path: Path, sections: int) -> None:
    trimesh.creation.cylinder(0.05, 0.1, sections=sections).export(tmp_path / "drum.ply")
    points = np.array(MeshShape(tmp_path / "drum.ply").pieces()[0].points())
    assert len(points) == 2 * sections
    assert np.allclose(np.hypot(points[:, 0], points[:, 1]), 0.05, atol=1e-7)
    assert np.allclose(np.abs(points[:, 2]), 0.05, atol=1e-7)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb", "off", "dae"])
def test_an_unreadable_mesh_is_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"broken.{suffix}"
    path.write_bytes(b"this is no mesh")
    with pytest.raises(MeshError, match=f"broken.{suffix}"):
        MeshShape(path).pieces()[0]


@pytest.mark.parametrize("tilted", [False, True])
@pytest.mark.parametrize("thickness", [1e-5, 1e-7, 1e-9, 1e-15])
def test_hulls_that_are_next_to_flat_are_refused(thickness: float, tilted: bool) -> None:
    """Over thinner ones coal ends the process."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, thickness)])
    if tilted:
        corners = corners @ trimesh.transformations.euler_matrix(0.3, 0.5, 0.7)[:3, :3].T
    if thickness > 1e-6:
        assert convex_geometry(corners).num_points == 8
        return
    with pytest.raises(MeshError, match=r"the mesh is almost flat: \S+ m thick and 1.* m wide"):
        convex_geometry(corners)


def test_a_corner_of_too_many_edges_is_told_in_words(tmp_path: Path) -> None:
    path = tmp_path / "cone.stl"
    trimesh.creation.cone(0.03, 0.06, sections=300).export(path)
    with pytest.raises(MeshError, match="more than 254 of its edges meet at one vertex") as caught:
        MeshShape(path).pieces()
    assert "\n" not in str(caught.value)


def test_the_hull_that_stands_for_a_cone_in_mujoco_is_one_for_coal() -> None:
    corners = Cone(0.03, 0.06).mjcf_geom()["vertex"]
    assert convex_geometry(corners).num_points == len(corners) - 1  # the middle of its base
