"""Nearest points of bodies at any gap, and their derivatives against differences."""

from itertools import combinations_with_replacement

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from ellipsoid import Ellipsoid
from hand_tools import random_pose

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.shapes import SHAPES as SHAPES_OF_SCENES
from graspless_pin.geometry.contact.curvature import (
    Velocities,
    face_along,
    half_space,
    nearest_patch,
    nearest_rates,
    rates_over_face,
)
from graspless_pin.geometry.poses import pose_matrix, transformed

STEP = 1e-6
SHAPES = {
    "box": coal.Box(0.1, 0.06, 0.04),
    "sphere": coal.Sphere(0.03),
    "capsule": coal.Capsule(0.02, 0.08),
    "cylinder": coal.Cylinder(0.03, 0.07),
    "cone": coal.Cone(0.03, 0.07),
    "plane": coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0),
    "ellipsoid": coal.Ellipsoid(0.06, 0.05, 0.04),
}

ROUNDED = {"sphere", "capsule", "plane", "ellipsoid"}


@pytest.fixture(autouse=True)
def _ellipsoids(monkeypatch):
    """A kind of surface that the package does not have."""
    monkeypatch.setitem(SHAPES_OF_SCENES, Ellipsoid.kind, Ellipsoid)


def placed(name, T):
    return [CollisionBody(name, SHAPES[name], T)]


def apart(rng, one, other, gap):
    """Two bodies at random poses with a gap between them."""
    first, second = random_pose(rng), random_pose(rng)
    patch = nearest_patch(placed(one, first), placed(other, second))
    second = second.copy()
    second[:3, 3] += (gap - min(patch.gaps)) * patch.normal
    return first, second


def moved(T, axis, step):
    """A pose after a small twist about the world's origin, [linear; angular]."""
    twist = np.zeros(6)
    twist[axis] = step
    turn = np.eye(4)
    x, y, z = twist[3:]
    turn[:3, :3] += [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    turn[:3, :3] = np.linalg.qr(turn[:3, :3])[0] * np.sign(np.diag(np.linalg.qr(turn[:3, :3])[1]))
    turn[:3, 3] = twist[:3]
    return turn @ T


def of_twists(point, which):
    """Velocities of a point of the first or second body by both twists about the origin."""
    linear, angular = np.zeros((3, 12)), np.zeros((3, 12))
    own = slice(6 * which, 6 * which + 6)
    linear[:, own] = np.hstack([np.eye(3), np.cross(np.eye(3), point).T])
    angular[:, own] = np.hstack([np.zeros((3, 3)), np.eye(3)])
    return Velocities(linear, angular)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("gap", [-0.004, 0.002, 0.05])
@pytest.mark.parametrize("names", list(combinations_with_replacement(SHAPES, 2)), ids="-".join)
def test_rates_are_the_differences_of_nearest_points(names, gap):
    if names == ("plane", "plane"):
        with pytest.raises(SceneError, match="both flat"):
            nearest_patch(placed("plane", np.eye(4)), placed("plane", np.eye(4)))
        return
    if gap < 0.0 and not ROUNDED & {*names}:
        return  # the shallowest way out of an overlap is not one that bodies roll along
    rng = np.random.default_rng(5)
    for _ in range(2):
        poses = apart(rng, names[0], names[1], gap)
        bodies = placed(names[0], poses[0]), placed(names[1], poses[1])
        patch = nearest_patch(*bodies)
        assert min(patch.gaps) == pytest.approx(gap, abs=1e-6)
        middle, n = patch.points[0], patch.normal
        ends = middle - 0.5 * patch.gaps[0] * n, middle + 0.5 * patch.gaps[0] * n
        velocities = of_twists(ends[0], 0), of_twists(ends[1], 1)
        rates = nearest_rates(bodies[0], bodies[1], patch, velocities)
        expected = []
        for which in (0, 1):
            for axis in range(6):
                found = []
                for sign in (1.0, -1.0):
                    there = list(poses)
                    there[which] = moved(poses[which], axis, sign * STEP)
                    found.append(
                        nearest_patch(placed(names[0], there[0]), placed(names[1], there[1]))
                    )
                high, low = (
                    np.concatenate([one.gaps[:1], one.normal, one.points[0]]) for one in found
                )
                expected.append((high - low) / (2.0 * STEP))
        gaps, normals, middles = np.split(np.array(expected).T, [1, 4])
        assert rates.smooth
        # Rims and edges that are near bend the normal the more the smaller the gap.
        np.testing.assert_allclose(rates.gap, gaps[0], atol=1e-6)
        np.testing.assert_allclose(rates.normal, normals, atol=2e-4)
        np.testing.assert_allclose(rates.middle, middles, atol=2e-6)


def test_a_point_over_a_face_that_turns():
    rng = np.random.default_rng(0)
    first, second = random_pose(rng), random_pose(rng)
    local, normal = rng.normal(size=3), np.array([0.6, 0.0, 0.8])

    def at(one, other):
        out, place = other[:3, :3] @ normal, transformed(one, local)
        height = float(out @ (place - other[:3, 3])) - 0.3
        return height, -out, place - 0.5 * height * out

    height, n, middle = at(first, second)
    point = of_twists(middle - 0.5 * height * n, 0)
    rates = rates_over_face(n, height, point, of_twists(middle + 0.5 * height * n, 1))
    for column in range(12):
        ends = []
        for sign in (1.0, -1.0):
            there = [first, second]
            there[column // 6] = moved(there[column // 6], column % 6, sign * STEP)
            ends.append(np.hstack(at(*there)))
        slope = (ends[0] - ends[1]) / (2.0 * STEP)
        np.testing.assert_allclose(rates.gap[column], slope[0], atol=1e-8)
        np.testing.assert_allclose(rates.normal[:, column], slope[1:4], atol=1e-8)
        np.testing.assert_allclose(rates.middle[:, column], slope[4:], atol=1e-8)


def test_parallel_faces_have_no_derivative():
    bodies = placed("plane", np.eye(4)), placed("box", pose_matrix([0.0, 0.0, 0.1]))
    patch = nearest_patch(*bodies)
    assert len(patch.gaps) == 4
    still = Velocities(np.zeros((3, 1)), np.zeros((3, 1)))
    assert not nearest_rates(*bodies, patch, (still, still)).smooth


def test_a_face_is_found_by_its_direction():
    T = random_pose(np.random.default_rng(1))
    normal, offset = face_along("pins[0]", placed("box", T), T, np.array([0.0, -2.0, 0.0]))
    np.testing.assert_allclose(normal, [0.0, -1.0, 0.0], atol=1e-12)
    assert offset == pytest.approx(0.03)
    below = half_space("box", normal, offset, T)
    patch = nearest_patch(placed("sphere", T @ pose_matrix([9.0, -0.1, 9.0])), [below])
    assert patch.gaps == pytest.approx([0.1 - 0.03 - 0.03])
    with pytest.raises(ArgumentError, match=r"pins\[0\]: is .*no face has this normal"):
        face_along("pins[0]", placed("box", T), T, np.array([0.0, 1.0, 1.0]))
    with pytest.raises(ArgumentError, match="the nearest is none"):
        face_along("pins[0]", placed("sphere", T), T, np.array([0.0, 1.0, 1.0]))
