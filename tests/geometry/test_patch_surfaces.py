"""Points of patches lie on both surfaces, however the bodies bend, and edges keep both ends."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from tests.geometry.contact_tools import find_contacts

from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.poses import pose_matrix


def box(name, size, position=(0.0, 0.0, 0.0), turn=None):
    return CollisionBody(name, coal.Box(*size), pose_matrix(position, turn))


@pytest.mark.sampled(45)
@pytest.mark.parametrize("gap", [-1e-5, 0.0, 1e-6, 5e-5, 9e-4])
@pytest.mark.parametrize("outside", [0.0, 1e-9, 9e-8, 1.1e-7, 2e-7, 4e-7, 1e-6, 1e-5, 1e-4])
@pytest.mark.parametrize("shorter", [0.0, 0.02])
def test_an_edge_beside_an_edge_touches_along_it(gap, outside, shorter):
    """Two cubes, one on top of the other, that have just slid past each other's edge."""
    top = box("top", (0.1, 0.1 - shorter, 0.1), (0.1 + outside, 0.0, 0.1 + gap))
    found = find_contacts(top, [], [box("below", (0.1, 0.1, 0.1))], tolerance=1e-3)
    half = 0.05 - 0.5 * shorter
    assert [round(abs(point.position[1]), 9) for point in found] == [half, half]
    for point in found:
        assert abs(point.position[0] - 0.05) <= 0.5 * outside + 1e-9
        assert abs(point.position[2] - 0.05) <= 0.5 * abs(gap) + 1e-9


def dome(rng, radius, width=0.04, count=400):
    """Corners of a plate of 5 mm with a back that bends by less than a patch's angles."""
    across = rng.uniform(-0.5 * width, 0.5 * width, (count, 2))
    rise = -0.5 * (across**2).sum(axis=1) / radius + 1e-6 * rng.normal(size=count)
    corners = [[x, y, -5e-3] for x in (-0.5, 0.5) for y in (-0.5, 0.5)] @ np.diag([width, width, 1])
    return np.vstack([np.column_stack([across, rise]), corners])


def height_over(hull, points):
    """Largest height of points over a hull's faces: zero on its surface."""
    return (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)


OTHERS = {
    "plate": coal.Box(0.1, 0.1, 0.02),
    "edge": coal.Box(0.1, 0.002, 0.02),
    "ball": coal.Sphere(0.03),
    "can": coal.Cylinder(0.03, 0.06),
    "floor": coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0),
    "dome": None,
}


@pytest.mark.sampled(9)
@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("radius", [1.0, 4.0, 20.0])
def test_points_of_bent_surfaces_are_on_them(other, radius):
    rng = np.random.default_rng(int(radius))
    corners = dome(rng, radius)
    hull = ConvexHull(corners)
    shape = OTHERS[other] or convex_geometry(dome(rng, 2.0), other)
    for _ in range(4):
        T = pose_matrix(rng.uniform(-0.1, 0.1, 3), Rotation.random(rng=rng).as_matrix())
        tilt = Rotation.from_rotvec([*rng.uniform(-2e-3, 2e-3, 2), 0.0]).as_matrix()
        if other == "ball":
            tilt = np.eye(3)
        depth = {"plate": 0.01, "edge": 0.01, "ball": 0.03, "can": 0.03}.get(other, 0.0)
        upright = Rotation.from_euler("x", 180, degrees=True).as_matrix() @ tilt
        place = [*rng.uniform(-2e-3, 2e-3, 2), depth + rng.uniform(-1e-4, 2e-4)]
        own = CollisionBody("bent", convex_geometry(corners, "bent"), T)
        there = CollisionBody("other", shape, T @ pose_matrix(place, upright))
        found = find_contacts(own, [], [there], tolerance=1e-3)
        assert found
        points = np.array([point.position for point in found])
        normals = np.array([point.normal for point in found])
        gaps = np.array([point.distance for point in found])[:, None]
        mine = (points + 0.5 * gaps * normals - T[:3, 3]) @ T[:3, :3]
        np.testing.assert_allclose(height_over(hull, mine), 0.0, atol=1e-9)
        if other in ("plate", "edge", "floor"):
            theirs = points - 0.5 * gaps * normals - there.T_world_geometry[:3, 3]
            heights = theirs @ there.T_world_geometry[:3, 2]
            np.testing.assert_allclose(heights, depth, atol=1e-9)


def test_a_bent_surface_that_is_near_only_between_its_corners_touches_at_one_point():
    """The corners of the patch are 80 um farther than its middle, and the tolerance is 50 um."""
    own = CollisionBody(
        "bent", convex_geometry(dome(np.random.default_rng(0), 4.0), "bent"), np.eye(4)
    )
    plate = box("plate", (0.1, 0.1, 0.02), (0.0, 0.0, 0.01 + 4e-5))
    (point,) = find_contacts(own, [], [plate], tolerance=5e-5)
    assert np.linalg.norm(point.position[:2]) < 5e-3
    assert 2e-5 < point.distance < 6e-5


@pytest.mark.sampled(4)
@pytest.mark.parametrize("step", [0.0, 2e-5, 6e-5])
@pytest.mark.parametrize("slit", [2e-5, 4e-4])
def test_points_of_joined_pieces_are_on_them(step, slit):
    """Halves of a hexagon on two plates with the same step, corners of both closer than 1 mm."""
    half = np.array([[0.5 * slit, -0.012], [0.01, -0.006], [0.01, 0.006], [0.5 * slit, 0.012]])
    corners = [
        np.array([[side * x, y, z + up] for x, y in half.tolist() for z in (0.0, 0.01)])
        for side, up in ((1.0, 0.0), (-1.0, step))
    ]
    hulls = [ConvexHull(piece) for piece in corners]
    shapes = [convex_geometry(piece, "disc") for piece in corners]
    plates = [
        box("plate", (0.1, 0.1, 0.02), (0.05 * side, 0.0, -0.01 + up))
        for side, up in ((1, 0.0), (-1, step))
    ]
    for tilt in ([0.0, 0.0, 0.0], [1e-3, 0.0, 0.0], [-5e-4, 5e-4, 2e-2], [0.0, -1e-3, -1e-2]):
        T = pose_matrix([0.0, 0.0, 2e-5], Rotation.from_rotvec(tilt).as_matrix())
        found = find_contacts([CollisionBody("disc", one, T) for one in shapes], [], plates)
        assert len(found) >= 3
        for point in found:
            to_object = 0.5 * point.distance * point.normal
            at = (point.position + to_object - T[:3, 3]) @ T[:3, :3]
            off = min(float(height_over(hull, at[None])[0]) for hull in hulls)
            x, _, height = point.position - to_object
            on_plate = height - step if x < 0.0 else min(height, abs(height - step), key=abs)
            assert abs(off) < 5e-6 and abs(on_plate) < 5e-6
