"""Objects and supports: what is refused, and what they hand to contact detection."""

from pathlib import Path

import numpy as np
import pytest

from graspless_pin.errors import ArgumentError, MeshError
from graspless_pin.geometry.bodies import ManipulatedObject, Support
from graspless_pin.geometry.shapes import Box, HalfSpace, MeshShape, Shape

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
        np.array(center_of_mass, dtype=object),
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
        brick.collision_body().T_world_geometry,
    ):
        assert not array.flags.writeable


def test_the_geometry_is_made_once() -> None:
    brick, table = make(), Support("table", HalfSpace(), TURNED, 0.3)
    for body, pose in ((brick, brick.T_world_object), (table, table.T_world_support)):
        first, second = body.collision_body(), body.collision_body()
        assert first.geometry is second.geometry
        assert first.name == body.name
        assert np.array_equal(first.T_world_geometry, pose)


@pytest.mark.parametrize("mass", [0.0, -1.0, float("nan"), float("inf")])
def test_a_mass_that_is_not_positive_is_refused(mass: float) -> None:
    with pytest.raises(
        ArgumentError, match="mass: object 'brick' needs a positive mass in kg, got"
    ):
        make(mass=mass)


@pytest.mark.parametrize("center", [(0, 0), (0, 0, np.nan), ("a", "b", "c")])
def test_a_centre_of_mass_needs_three_numbers(center: object) -> None:
    with pytest.raises(ArgumentError, match="center_of_mass: needs three"):
        make(center_of_mass=center)


@pytest.mark.parametrize(
    "pose",
    [np.eye(3), np.diag([1.0, 1, -1, 1]), np.diag([2.0, 2, 2, 1]), np.full((4, 4), np.nan)],
    ids=["shape", "mirror", "scale", "nan"],
)
def test_a_pose_that_is_not_rigid_is_refused(pose: np.ndarray) -> None:
    with pytest.raises(ArgumentError, match="T_world_object"):
        make(T_world_object=pose)
    with pytest.raises(ArgumentError, match="T_world_support"):
        Support("table", HalfSpace(), pose)


def test_an_object_cannot_be_a_half_space() -> None:
    with pytest.raises(ArgumentError, match="'brick' cannot be a half-space"):
        make(shape=HalfSpace())


@pytest.mark.parametrize("name", ["", "  "])
def test_a_body_needs_a_name(name: str) -> None:
    with pytest.raises(ArgumentError, match="name: needs a name"):
        make(name=name)
    with pytest.raises(ArgumentError, match="name: needs a name"):
        Support(name, HalfSpace(), TURNED)


@pytest.mark.parametrize("friction", [-0.1, float("nan"), float("inf")])
def test_friction_is_zero_or_more(friction: float) -> None:
    with pytest.raises(ArgumentError, match="friction: support 'table' needs"):
        Support("table", HalfSpace(), TURNED, friction)


def test_a_missing_mesh_shows_when_the_geometry_is_needed() -> None:
    brick = make(shape=MeshShape(Path("no/such.obj")))
    with pytest.raises(MeshError, match=r"no/such.obj"):
        brick.collision_body()
