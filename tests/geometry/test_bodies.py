"""Objects and supports: what is refused, and what they hand to contact detection."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspless_pin.errors import ArgumentError, GrasplessPinWarning
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import Box, Cone, HalfSpace, MeshShape, Shape

BRICK = Box((0.1, 0.2, 0.3))
TURNED = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


def make(
    *,
    name: str = "brick",
    shape: Shape = BRICK,
    mass: float = 1.0,
    center_of_mass: object = (0.0, 0.0, 0.0),
    T_world_object: object = TURNED,
) -> ManipulatedObject:
    return ManipulatedObject(
        name,
        shape,
        mass,
        np.asarray(center_of_mass),
        np.asarray(T_world_object),
    )


def test_the_centre_of_mass_moves_with_the_pose() -> None:
    brick = make(center_of_mass=(0.1, 0.2, 0.3))
    assert np.allclose(brick.center_of_mass_world, [0.8, 2.1, 3.3])


def test_arrays_are_read_only_copies() -> None:
    pose = TURNED.copy()
    brick = make(T_world_object=pose)
    pose[:] = 0.0
    assert np.array_equal(brick.T_world_object, TURNED)
    for array in (
        brick.center_of_mass,
        brick.T_world_object,
        brick.collision_bodies()[0].T_world_geometry,
    ):
        assert not array.flags.writeable


NOT_RIGID = (np.eye(3), np.diag([1.0, 1, -1, 1]), np.diag([2.0, 2, 2, 1]), np.full((4, 4), np.nan))
NEITHER = (float("nan"), float("inf"))


@pytest.mark.parametrize(
    ("argument", "values", "message"),
    [
        (
            "mass",
            (0.0, -1.0, True, "1", *NEITHER),
            "mass: object 'brick' needs a positive mass in kg, got",
        ),
        (
            "center_of_mass",
            ((0, 0), (0, 0, np.nan), ("a", "b", "c"), (True, False, True)),
            "center_of_mass: ",
        ),
        ("T_world_object", NOT_RIGID, "T_world_object"),
        ("shape", (HalfSpace(),), "'brick' cannot be a half-space"),
        ("name", ("", "  "), "name: needs a text"),
    ],
)
def test_what_no_object_has_is_refused(argument: str, values: tuple, message: str) -> None:
    for value in values:
        with pytest.raises(ArgumentError, match=message):
            make(**{argument: value})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *[(("table", HalfSpace(), pose), "T_world_support") for pose in NOT_RIGID],
        *[((name, HalfSpace(), TURNED), "name: needs a text") for name in ("", "  ")],
        *[
            (("table", HalfSpace(), TURNED, friction), "friction: support 'table' needs")
            for friction in (-0.1, *NEITHER)
        ],
    ],
)
def test_what_no_support_has_is_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        Support(*arguments)


def test_an_object_of_given_density_is_filled_evenly() -> None:
    brick = ManipulatedObject.from_shape("brick", BRICK, TURNED, density=500.0, material="clay")
    assert brick.mass == pytest.approx(3.0)
    assert np.array_equal(brick.center_of_mass, np.zeros(3))
    assert brick.material == "clay"
    top = ManipulatedObject.from_shape("top", Cone(0.03, 0.2), TURNED, mass=2.0)
    assert np.allclose(top.center_of_mass, [0, 0, -0.05])
    off = ManipulatedObject.from_shape(
        "off", BRICK, TURNED, density=500.0, center_of_mass=(0, 0, 1)
    )
    assert (off.mass, off.center_of_mass[2]) == (pytest.approx(3.0), 1.0)


def test_mass_and_centre_that_are_given_need_no_mesh_volume(tmp_path: Path) -> None:
    # An open box: its volume would be asked for with a warning.
    box = trimesh.creation.box(extents=[0.1, 0.1, 0.1])
    box.update_faces(np.arange(len(box.faces)) > 1)
    box.export(tmp_path / "open.stl")
    shape = MeshShape(tmp_path / "open.stl")
    given = ManipulatedObject.from_shape(
        "box", shape, TURNED, mass=1.0, center_of_mass=(0.0, 0.0, 0.0)
    )
    assert given.mass == 1.0
    with pytest.warns(GrasplessPinWarning, match="give mass, centre of mass and inertia"):
        assert given.own_inertia[0, 0] == pytest.approx(0.01 / 6)
    with pytest.warns(GrasplessPinWarning, match="is not watertight: volume and centre of mass"):
        ManipulatedObject.from_shape("box", shape, TURNED, mass=1.0)


def test_an_inertia_is_the_shapes_or_the_stated_one() -> None:
    """A box of 1, 2 and 3 dm, turned: about its own axes and about those of the world."""
    shape = Box((0.1, 0.2, 0.3))
    brick = ManipulatedObject.from_shape("brick", shape, TURNED, mass=12.0)
    own = np.diag([0.13, 0.10, 0.05])
    np.testing.assert_allclose(brick.own_inertia, own, atol=1e-15)
    R = TURNED[:3, :3]
    expected = np.zeros((6, 6))
    expected[:3, :3], expected[3:, 3:] = 12.0 * np.eye(3), R @ own @ R.T
    np.testing.assert_allclose(brick.spatial_inertia(), expected, atol=1e-12)
    np.testing.assert_array_equal(brick.spatial_inertia(), brick.spatial_inertia().T)
    # Mass and shape may be replaced; what is derived follows.
    np.testing.assert_allclose(replace(brick, mass=24.0).own_inertia, 2.0 * own)
    still = brick.with_pose(np.eye(4)).spatial_inertia()
    np.testing.assert_allclose(still[3:, 3:], own, atol=1e-15)
    for stated in ((0.3, 0.4, 0.5), np.diag([0.3, 0.4, 0.5])):
        made = ManipulatedObject.from_shape("brick", shape, np.eye(4), mass=12.0, inertia=stated)
        np.testing.assert_array_equal(made.spatial_inertia()[3:, 3:], np.diag([0.3, 0.4, 0.5]))
        np.testing.assert_array_equal(replace(made, mass=1.0).own_inertia, np.diag([0.3, 0.4, 0.5]))
        assert not pickle.loads(pickle.dumps(made)).inertia.flags.writeable  # noqa: S301


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        ((1.0, 1.0, 2.5), r"principal moments 1, 1 and 2.5 kg m\^2; none may be larger"),
        ((1.0, 0.0, 1.0), r"is 0.0 at index \(1, 1\); the diagonal must be positive"),
        ([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]], r"the matrix must be symmetric"),
        ([1.0, 2.0], r"has shape \(2,\); expected \(3, 3\)"),
        ("heavy", r"must be an array of real numbers"),
    ],
)
def test_inertias_of_no_body_are_refused(inertia, message: str) -> None:
    with pytest.raises(ArgumentError, match=rf"^inertia: .*{message}"):
        ManipulatedObject.from_shape("brick", BRICK, TURNED, mass=1.0, inertia=inertia)


def test_either_mass_or_density_is_needed() -> None:
    with pytest.raises(ArgumentError, match="either a mass in kg or a density, found neither"):
        ManipulatedObject.from_shape("brick", BRICK, TURNED)
    with pytest.raises(ArgumentError, match="found both"):
        ManipulatedObject.from_shape(
            "brick", BRICK, TURNED, mass=1.0, density=1.0, center_of_mass=(0, 0, 0)
        )


def test_a_support_stands_still_unless_it_is_given_a_velocity() -> None:
    assert np.array_equal(Support("table", HalfSpace(), TURNED).velocity, np.zeros(6))
    velocity = np.array([0.1, 0, 0, 0, 0, 0.2])
    belt = Support("belt", HalfSpace(), TURNED, velocity=velocity, material="rubber")
    velocity[:] = 5.0
    assert np.array_equal(belt.velocity, [0.1, 0, 0, 0, 0, 0.2])
    assert not belt.velocity.flags.writeable
    with pytest.raises(ArgumentError, match="velocity: has shape"):
        Support("belt", HalfSpace(), TURNED, velocity=np.zeros(3))


def test_a_shape_of_several_pieces_gives_bodies_of_one_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cubes = [trimesh.creation.box(extents=[0.1] * 3) for _ in range(2)]
    cubes[1].apply_translation([0.3, 0, 0])
    trimesh.util.concatenate(cubes).export(tmp_path / "cubes.stl")
    pair = make(shape=MeshShape(tmp_path / "cubes.stl", convex="decompose"))
    bodies = pair.collision_bodies()
    assert [body.name for body in bodies] == ["brick", "brick"]
    assert all(np.array_equal(body.T_world_geometry, TURNED) for body in bodies)
    moved = replace(pair, T_world_object=np.eye(4)).collision_bodies()
    assert [a.geometry is b.geometry for a, b in zip(bodies, moved, strict=True)] == [True, True]
    hull = make(shape=MeshShape(tmp_path / "cubes.stl"))
    assert len(hull.collision_bodies()) == 1
