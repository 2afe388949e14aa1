"""Edges and corners from 5 to 170 degrees touch where they are: hand-solved, in every role."""

from __future__ import annotations

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation
from tests.geometry.contact_tools import find_contacts

from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.shape import convex_geometry
from graspless_pin.geometry.poses import pose_matrix

APEXES = [5, 20, 50, 59, 61, 90, 119, 121, 170]  # degrees
GAPS = [-1e-4, -1e-6, 0.0, 1e-6, 5e-4]
LENGTH = 0.08


def ridge(apex: float, slant: float = 0.0, *, strips: int = 1, height: float = 0.02):
    """A prism whose ridge lies along x through the origin, with the apex on top.

    Args:
        apex: Angle between its two faces, degrees.
        slant: By how much the base is longer than the ridge at each end, m.
        strips: Into how many parts corners divide the ridge.
        height: m.
    """
    width = min(height * np.tan(np.radians(0.5 * apex)), 0.2)
    height = width / np.tan(np.radians(0.5 * apex))
    top = [(x, 0.0, 0.0) for x in np.linspace(-0.5, 0.5, strips + 1) * LENGTH]
    end = 0.5 * LENGTH + slant
    base = [(x, y, -height) for x in (-end, end) for y in (-width, width)]
    return convex_geometry(np.array(top + base), f"ridge of {apex} degrees")


def leaning(apex: float, share: float):
    """A turn about the ridge after which it is on top still."""
    return Rotation.from_euler("x", share * (90.0 - 0.5 * apex), degrees=True).as_matrix()


PLANKS = {
    "box": coal.Box(0.2, 0.05, 0.01),
    "hull": convex_geometry(
        np.array([(x, y, z) for x in (-0.1, 0.1) for y in (-0.025, 0.025) for z in (-5e-3, 5e-3)])
    ),
}


def contacts(mine: CollisionBody, other: CollisionBody, role: str):
    """What touches, with the normals out of ``other`` whichever of the two is the object."""
    if role == "object":  # ``mine`` is the object
        found = find_contacts(mine, [], [other])
        return [(one.position, one.normal, one.distance) for one in found]
    sides = ([mine], []) if role == "link" else ([], [mine])
    found = find_contacts(other, *sides)
    return [(one.position, -one.normal, one.distance) for one in found]


def placed(name, geometry, T_world, T):
    return CollisionBody(name, geometry, T_world @ T)


def assert_contacts(found, T_world, points, normal, gap, atol=1e-8):
    """The points (K, 3) and the normal (3,) in a frame that stands at a pose in the world."""
    assert len(found) == len(points)
    R, t = T_world[:3, :3], T_world[:3, 3]
    there = sorted(((np.array(one[0]) - t) @ R).tolist() for one in found)
    np.testing.assert_allclose(there, sorted(np.array(points).tolist()), atol=atol)
    for _, direction, distance in found:
        np.testing.assert_allclose(direction @ R, normal, atol=1e-7)
        assert distance == pytest.approx(gap, abs=atol)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("role", ["object", "support", "link"])
@pytest.mark.parametrize("plank", PLANKS)
@pytest.mark.parametrize("apex", APEXES)
def test_a_plank_on_a_ridge_touches_along_it(role, plank, apex):
    rng = np.random.default_rng(apex)
    for slant in (-0.01, 0.0, 0.005, 0.03):
        for strips in (1, 3):
            if strips == 3 and slant:
                continue
            geometry = ridge(apex, slant, strips=strips)
            for gap in GAPS:
                T = pose_matrix(rng.uniform(-1, 1, 3), Rotation.random(rng=rng).as_matrix())
                turn = leaning(apex, rng.uniform(-0.9, 0.9))
                below = placed("prism", geometry, T, pose_matrix([0, 0, 0], turn))
                angle = rng.uniform(-0.3, 0.3)
                spin = Rotation.from_euler("z", angle).as_matrix()
                above = placed("plank", PLANKS[plank], T, pose_matrix([0, 0, 5e-3 + gap], spin))
                reach = min(0.5 * LENGTH, 0.025 / abs(np.sin(angle)), 0.1 / np.cos(angle))
                ends = [[-reach, 0, 0.5 * gap], [reach, 0, 0.5 * gap]]
                found = contacts(above, below, role)
                assert_contacts(found, T, ends, [0, 0, 1], gap)


@pytest.mark.sampled(7)
@pytest.mark.parametrize("role", ["object", "support", "link"])
@pytest.mark.parametrize("apex", APEXES)
def test_crossing_ridges_touch_where_they_cross(role, apex):
    """The normal is the cross product of the edges."""
    rng = np.random.default_rng(apex)
    for other in APEXES:
        gap = rng.choice(GAPS)
        T = pose_matrix(rng.uniform(-1, 1, 3), Rotation.random(rng=rng).as_matrix())
        below = placed(
            "below", ridge(apex), T, pose_matrix([0, 0, 0], leaning(apex, rng.uniform(-0.8, 0.8)))
        )
        crossing = Rotation.from_euler("z", rng.uniform(0.3, np.pi - 0.3))
        over = Rotation.from_euler("x", np.pi)
        turn = (crossing * over).as_matrix() @ leaning(other, rng.uniform(-0.8, 0.8))
        x, y = rng.uniform(-0.02, 0.02, 2)
        along = crossing.as_matrix()[:, 0]
        place = np.array([x, 0, gap]) + y * along
        above = placed("above", ridge(other), T, pose_matrix(place, turn))
        found = contacts(above, below, role)
        assert_contacts(found, T, [[x, 0, 0.5 * gap]], [0, 0, 1], gap)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("role", ["object", "support", "link"])
@pytest.mark.parametrize("sides", [3, 4, 7, None])
@pytest.mark.parametrize("apex", APEXES)
def test_a_corner_touches_at_one_point(role, sides, apex):
    """Of a pyramid, whose edges all fall off by more than the angle of a contact, or of a cone."""
    rng = np.random.default_rng(apex + (sides or 0))
    radius, height = 0.03 * np.sin(np.radians(0.5 * apex)), 0.03 * np.cos(np.radians(0.5 * apex))
    if sides is None:
        geometry, lowered = coal.Cone(radius, height), [0, 0, -0.5 * height]
    else:
        turns = 2 * np.pi * np.arange(sides) / sides
        base = [(radius * np.cos(turn), radius * np.sin(turn), -height) for turn in turns]
        geometry, lowered = (
            convex_geometry(np.array([(0.0, 0.0, 0.0), *base]), "pyramid"),
            [0, 0, 0],
        )
    for plank in PLANKS.values():
        for gap in GAPS:
            T = pose_matrix(rng.uniform(-1, 1, 3), Rotation.random(rng=rng).as_matrix())
            axis = np.array([*rng.normal(size=2), 0.0])
            lean = rng.uniform(0, 0.9) * (np.radians(90 - 0.5 * apex) - 0.02)
            turn = Rotation.from_rotvec(lean * axis / np.linalg.norm(axis)).as_matrix()
            below = placed("tip", geometry, T, pose_matrix(turn @ lowered, turn))
            x, y = rng.uniform(-0.02, 0.02, 2)
            above = placed("plank", plank, T, pose_matrix([x, y, 5e-3 + gap]))
            assert_contacts(contacts(above, below, role), T, [[0, 0, 0.5 * gap]], [0, 0, 1], gap)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("role", ["object", "support", "link"])
@pytest.mark.parametrize("thickness", [1e-5, 1e-4, 5e-4, 2e-3])
def test_a_blade_stands_on_its_edge(role, thickness):
    """The hull of a blade that is cut off square: its narrow side is a face."""
    rng = np.random.default_rng(int(1e5 * thickness))
    half = np.array([0.5 * LENGTH, 0.5 * thickness, 0.01])
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    geometry = convex_geometry(corners, "blade")
    for plank in PLANKS.values():
        for gap in GAPS:
            T = pose_matrix(rng.uniform(-1, 1, 3), Rotation.random(rng=rng).as_matrix())
            below = placed("blade", geometry, T, pose_matrix([0, 0, -0.01]))
            above = placed("plank", plank, T, pose_matrix([0, 0, 5e-3 + gap]))
            found = contacts(above, below, role)
            assert len(found) == (4 if thickness > 1e-3 else 2)
            R, t = T[:3, :3], T[:3, 3]
            for position, normal, distance in found:
                there = (position - t) @ R
                assert abs(abs(there[0]) - 0.5 * LENGTH) < 1e-8
                assert abs(there[1]) <= 0.5 * thickness + 1e-8
                np.testing.assert_allclose(normal @ R, [0, 0, 1], atol=1e-7)
                assert distance == pytest.approx(gap, abs=1e-8)


def random_corners(rng: np.random.Generator) -> np.ndarray:
    """Corners of a tetrahedron, a wedge, a sliver, a plate or a flat cloud, m."""
    match rng.integers(5):
        case 0:
            return 0.03 * rng.normal(size=(4, 3))
        case 1:
            width = min(0.03 * np.tan(np.radians(rng.uniform(2.5, 85.0))), 0.1)
            base = [(x, y, -0.03) for x in (-0.04, 0.04) for y in (-width, width)]
            return np.array([(-0.04, 0, 0), (0.04, 0, 0), *base]) * [rng.uniform(0.7, 1.5), 1, 1]
        case 2:
            return rng.uniform(-0.05, 0.05, (8, 3)) * [1, *10 ** rng.uniform(-2, 0, 2)]
        case 3:
            return (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5) * [0.1, 0.04, 0.01]
        case _:
            cloud = rng.normal(size=(rng.integers(5, 60), 3))
            size = 0.04 * 10 ** rng.uniform(-1.5, 0, 3)
            return cloud / np.linalg.norm(cloud, axis=1)[:, None] * size


def touching_at(mine: np.ndarray, other: np.ndarray, way: np.ndarray):
    """How far (m) the hull of ``other`` goes along a way before it leaves that of ``mine``.

    Returns:
        That and the normal (3,) there, out of ``mine``; None: they pass each other.
    """
    count = len(mine) + len(other)
    rows = np.zeros((5, count + 1))
    rows[:3] = np.column_stack([mine.T, -other.T, -way])
    rows[3, : len(mine)] = rows[4, len(mine) : count] = 1.0
    cost = np.zeros(count + 1)
    cost[-1] = -1.0
    bounds = [(0.0, None)] * count + [(None, None)]
    tight = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    found = linprog(cost, A_eq=rows, b_eq=[0, 0, 0, 1, 1], bounds=bounds, options=tight)
    if found.status:
        return None
    normal = found.eqlin.marginals[:3]
    return found.x[-1], normal * np.sign(normal @ way) / np.linalg.norm(normal)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("first", range(0, 400, 100))
def test_bodies_that_meet_anywhere_have_the_contact_of_a_linear_program(first):
    met = 0
    for seed in range(first, first + 50):
        rng = np.random.default_rng(seed)
        shapes = [random_corners(rng) for _ in range(2)]
        turns = [Rotation.random(rng=rng).as_matrix() for _ in range(2)]
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        mine, other = (corners @ turn.T for corners, turn in zip(shapes, turns, strict=True))
        shift = mine.mean(axis=0) - other.mean(axis=0) + rng.uniform(-0.02, 0.02, 3)
        found = touching_at(mine, other + shift, way)
        if found is None or found[1] @ way < 0.3:
            continue
        met += 1
        far, normal = found
        gap = rng.choice(GAPS)
        shift = shift + far * way + gap * normal  # the point of the first touch stays the nearest
        gap = float(((other + shift) @ normal).min() - (mine @ normal).max())
        bodies = [
            CollisionBody(name, convex_geometry(corners, name), pose_matrix(place, turn))
            for name, corners, turn, place in zip(
                ("mine", "other"), shapes, turns, (np.zeros(3), shift), strict=True
            )
        ]
        for role in ("object", "support", "link"):
            touching = contacts(bodies[1], bodies[0], role)
            least = min(distance for *_, distance in touching)
            # Of bodies that overlap, another direction may lead out sooner.
            assert gap < 0.0 or least >= gap - 1e-8, seed
            if gap >= 0.0 or least <= gap + 1e-8:
                # Features tilted by up to `PARALLEL_ANGLE` touch as if they were parallel.
                assert least <= gap + 2e-4, seed
                for _, direction, _ in touching:
                    np.testing.assert_allclose(direction, normal, atol=1e-6, err_msg=str(seed))
    assert met > 20
