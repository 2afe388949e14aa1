"""A kind of surface that is added by one module: contacts, distances and how it rolls."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from ellipsoid import Ellipsoid, EllipsoidSet
from hand_tools import random_pose
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from tests.geometry.contact_tools import find_contacts

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.collision import BodyShapes, CollisionBody
from graspless_pin.geometry.bodies.convex_sets import BoundedSet
from graspless_pin.geometry.bodies.shape import Polyhedron, convex_geometry
from graspless_pin.geometry.bodies.shapes import SHAPES, shape_of
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.geometry.contact.curvature import (
    face_along,
    nearest_patch,
    normal_jumps,
    radii_of_curvature,
)
from graspless_pin.geometry.contact.distances import separation, solids_of
from graspless_pin.geometry.contact.finding import contact_arrays
from graspless_pin.geometry.poses import pose_matrix

RADII = np.array([0.03, 0.02, 0.01])
GEOMETRY = coal.Ellipsoid(*RADII)
OTHERS = {
    "box": coal.Box(0.1, 0.06, 0.04),
    "sphere": coal.Sphere(0.03),
    "capsule": coal.Capsule(0.02, 0.08),
    "cylinder": coal.Cylinder(0.03, 0.07),
    "cone": coal.Cone(0.03, 0.07),
    "hull": convex_geometry(np.random.default_rng(2).normal(scale=0.03, size=(12, 3))),
    "ellipsoid": coal.Ellipsoid(0.01, 0.04, 0.02),
}


@pytest.fixture(autouse=True)
def _listed(monkeypatch):
    """One line of the list of shapes."""
    monkeypatch.setitem(SHAPES, Ellipsoid.kind, Ellipsoid)


def body(T, geometry=GEOMETRY, name="egg"):
    return CollisionBody(name, geometry, T)


def floor_of(kind):
    """A floor at z = 0: a half-space, or the top of a box."""
    if kind == "half_space":
        return body(np.eye(4), coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), "floor")
    return body(pose_matrix((0.0, 0.0, -0.1)), coal.Box(1.0, 1.0, 0.2), "floor")


@pytest.mark.parametrize("kind", ["half_space", "box"])
@pytest.mark.parametrize("gap", [4e-4, 0.0, -2e-3])
def test_it_touches_a_plane_at_its_lowest_point(kind, gap):
    """Turned by 45 degrees about y, it reaches down by the root of (a^2 + c^2) / 2."""
    a, _, c = RADII
    down = np.sqrt(0.5 * (a**2 + c**2))
    T = pose_matrix(
        (0.02, 0.01, down + gap), Rotation.from_euler("y", 45, degrees=True).as_matrix()
    )
    (found,) = find_contacts(body(T), [], [floor_of(kind)])
    # The lowest point is the gradient of the support function: (a^2 - c^2) / (2 down) aside.
    aside = 0.5 * (c**2 - a**2) / down
    assert found.position == pytest.approx([0.02 - aside, 0.01, 0.5 * gap], abs=1e-9)
    assert found.normal == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert found.distance == pytest.approx(gap, abs=1e-9)


@pytest.mark.parametrize("name", OTHERS)
def test_the_distance_to_other_bodies_is_the_largest_gap_of_all_directions(name):
    """As a search of its own finds it, and as coal has it, up to its tolerance."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        first, T = body(random_pose(rng)), random_pose(rng)
        start = nearest_patch([first], [body(T, OTHERS[name], name)])
        apart = T.copy()
        apart[:3, 3] += (rng.uniform(1e-4, 2e-2) - min(start.gaps)) * start.normal
        second = body(apart, OTHERS[name], name)
        gap = min(nearest_patch([first], [second]).gaps)
        assert gap == pytest.approx(separation(first, second).distance, abs=1e-6)
        assert gap == pytest.approx(largest_gap(first, second), abs=1e-9)


def largest_gap(first, second):
    """Over unit vectors, from the direction between the middles."""
    one, two = solids_of(BodyShapes(("one", "two"), (first.geometry, second.geometry))).sets
    assert isinstance(one, BoundedSet)
    assert isinstance(two, BoundedSet)
    R, S = first.T_world_geometry, second.T_world_geometry
    between = S[:3, 3] - R[:3, 3]

    def closeness(direction):
        n = direction / np.linalg.norm(direction)
        own, its = (n @ R[:3, :3])[None], (-n @ S[:3, :3])[None]
        return float(one.support_values(own)[0] + two.support_values(its)[0] - n @ between)

    options = {"xatol": 1e-12, "fatol": 1e-15, "maxiter": 10_000, "maxfev": 10_000}
    found = between / np.linalg.norm(between)
    for _ in range(3):
        found = minimize(closeness, found, method="Nelder-Mead", options=options).x
    return -closeness(found)


def test_contacts_in_either_order_are_the_same():
    rng = np.random.default_rng(7)
    for geometry in OTHERS.values():
        first, T = body(random_pose(rng)), random_pose(rng)
        start = nearest_patch([first], [body(T, geometry, "other")])
        touching = T.copy()
        touching[:3, 3] -= min(start.gaps) * start.normal
        second = body(touching, geometry, "other")
        (one,), (two,) = find_contacts(first, [second], []), find_contacts(second, [first], [])
        assert one.position == pytest.approx(two.position, abs=1e-6)
        assert one.normal == pytest.approx(-two.normal, abs=1e-4)


def test_it_curves_as_its_principal_radii_say():
    """At the end of an axis they are the squares of the other half axes over that one."""
    a, b, c = RADII
    tangents = np.eye(3)[:, :2]
    T = pose_matrix((0.1, 0.0, 0.0))
    found = radii_of_curvature([body(T)], np.array([0.1, 0.0, c]), np.eye(3)[2], tangents)
    assert found == pytest.approx(np.diag([a**2 / c, b**2 / c]))


def test_its_normal_does_not_jump():
    """A finger's edge on it does not touch along another face when it is shifted."""
    pin = body(pose_matrix((0.0, 0.0, 0.02)), coal.Box(0.02, 0.02, 0.02), "pin")
    touching = contact_arrays([body(np.eye(4))], [pin], BodyKind.HAND)
    assert len(touching) == 1
    assert normal_jumps([body(np.eye(4))], [pin], touching, 1e-3) == [0.0]


def test_it_has_no_face_that_looks_anywhere():
    with pytest.raises(ArgumentError, match="no face has this normal; the nearest is none"):
        face_along("pins[0]", [body(np.eye(4))], np.eye(4), np.eye(3)[2])


@pytest.mark.parametrize(
    ("aside", "higher", "places"), [(0.005, 5e-4, [0.0]), (0.1, 5e-4, [0.0, 0.1])]
)
def test_of_pieces_that_lie_in_each_other_the_lower_one_touches(aside, higher, places):
    pieces = [body(pose_matrix((0.0, 0.0, 0.01))), body(pose_matrix((aside, 0.0, 0.01 + higher)))]
    found = find_contacts(pieces, [], [floor_of("half_space")])
    assert sorted(one.position[0] for one in found) == pytest.approx(places, abs=1e-9)


def test_its_shape_is_known_from_the_geometry():
    assert shape_of(Ellipsoid((0.03, 0.02, 0.01)).pieces()[0]) == Ellipsoid((0.03, 0.02, 0.01))


def test_what_is_missing_is_told(monkeypatch):
    egg, floor = coal.Ellipsoid(*RADII), floor_of("box")
    monkeypatch.delitem(SHAPES, Ellipsoid.kind)
    with pytest.raises(SceneError, match=r"'egg': contacts cannot be .* Ellipsoid; .*`SHAPES`"):
        find_contacts(body(np.eye(4), egg), [], [floor])

    class Bare(Polyhedron):
        coal_type = coal.Ellipsoid

    monkeypatch.setitem(SHAPES, "bare", Bare)
    with pytest.raises(NotImplementedError, match="Bare has a coal_type, so it needs 'set_of'"):
        find_contacts(body(np.eye(4), egg), [], [floor])

    class Half(BoundedSet):
        support_values = EllipsoidSet.support_values

    with pytest.raises(TypeError, match=r"Half .*faces_at.*feature.*radii_of_curvature"):
        Half()  # pyright: ignore[reportAbstractUsage]
