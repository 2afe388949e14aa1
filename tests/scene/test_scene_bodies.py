"""Moving supports, materials, density and cut meshes in a scene file."""

from collections import Counter

import numpy as np
import pytest
import trimesh
from scene_tools import loaded
from tests.geometry.cutting_here import cut_here

from graspless_pin.errors import SceneError

BELT = {
    "object": {
        "shape": {"type": "box", "size": [0.2, 0.2, 0.2]},
        "density": 125.0,
        "pose": {"position": [0.0, 0.0, 0.1]},
        "material": "steel",
    },
    "supports": [
        {
            "name": "belt",
            "shape": {"type": "half_space"},
            "velocity": {"linear": [0.5, 0.0, 0.0]},
            "material": "rubber",
        }
    ],
    "friction": 0.1,
    "materials": {"rubber": {"steel": 0.6}},
}


def scene(tmp_path, **changes):
    return loaded(tmp_path, BELT | changes)


def test_a_belt_slides_under_a_box_at_rest(tmp_path):
    problem = scene(tmp_path).problem()
    np.testing.assert_allclose(problem.sliding, np.tile([-0.5, 0.0, 0.0], (4, 1)))
    np.testing.assert_allclose(problem.friction, 0.6)
    np.testing.assert_allclose(problem.external_wrench[:3], [0.0, 0.0, -9.81])


def test_a_box_that_rides_on_the_belt_sticks(tmp_path):
    motion = {"object_twist": {"linear": [0.5, 0.0, 0.0]}}
    assert not scene(tmp_path, motion=motion).problem().is_sliding.any()


def test_an_unknown_material_names_its_line(tmp_path):
    with pytest.raises(SceneError, match=r"scene\.yaml:\d+: object\.material: .*glass.*rubber"):
        scene(tmp_path, object=BELT["object"] | {"material": "glass"})


def test_mass_and_density_exclude_each_other(tmp_path):
    with pytest.raises(SceneError, match="mass"):
        scene(tmp_path, object=BELT["object"] | {"mass": 1.0})


def box(size, position, **more):
    return {"shape": {"type": "box", "size": size}, "pose": {"position": position}, **more}


def test_a_box_on_a_belt_beside_a_step_against_a_wall(tmp_path):
    """0.12 x 0.08 x 0.06 m; the wall stands at x = 0.06, the step at y = 0.04 is half as high."""
    belt = box([1.0, 1.0, 0.1], [0, 0, -0.05], name="belt", velocity={"linear": [0.2, 0, 0]})
    wall = box([0.1, 1.0, 1.0], [0.11, 0, 0.5], name="wall")
    step = box([0.1, 0.04, 0.03], [0, 0.06, 0.015], name="step")
    thing = box([0.12, 0.08, 0.06], [0, 0, 0.03], mass=1.0)
    made = scene(tmp_path, object=thing, supports=[belt, wall, step])
    expected = {
        "belt": [(x, y, 0.0) for x in (-0.06, 0.06) for y in (-0.04, 0.04)],
        "wall": [(0.06, y, z) for y in (-0.04, 0.04) for z in (0.0, 0.06)],
        "step": [(x, 0.04, z) for x in (-0.05, 0.05) for z in (0.0, 0.03)],
    }
    normals = {"belt": [0, 0, 1], "wall": [-1, 0, 0], "step": [0, -1, 0]}
    points = made.contacts.points
    assert Counter(made.contacts.bodies) == dict.fromkeys(expected, 4)
    for name, corners in expected.items():
        found = sorted(
            tuple(point.position.round(9).tolist()) for point in points if point.body == name
        )
        np.testing.assert_allclose(found, sorted(corners), atol=1e-8)
    for point, sliding in zip(points, made.contacts.sliding, strict=True):
        np.testing.assert_allclose(point.normal, normals[point.body], atol=1e-9)
        np.testing.assert_allclose(sliding, [-0.2, 0, 0] if point.body == "belt" else [0, 0, 0])
    solution = made.solve("margin")
    assert solution.found
    # The belt drags the box with all of its friction, and the wall holds against it.
    bodies = np.array(made.contacts.bodies)
    on_belt, on_wall = (solution.contact_forces[bodies == name] for name in ("belt", "wall"))
    np.testing.assert_allclose(on_belt[:, 0], 0.1 * on_belt[:, 2], atol=1e-6)
    assert on_belt[:, 2].sum() > 0.0
    assert (on_wall[:, 0] < 0.0).all()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("suffix", ["stl", "obj", "dae", "ply", "glb"])
def test_a_block_stands_in_a_second_object_that_is_fixed(tmp_path, monkeypatch, suffix):
    """A tray of 0.01 m walls; cut into pieces, it takes the block in: of its hull it is full."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cut_here(monkeypatch)
    outside = trimesh.creation.box(bounds=[[-0.1, -0.06, 0.0], [0.1, 0.06, 0.05]])
    inside = trimesh.creation.box(bounds=[[-0.09, -0.05, 0.01], [0.09, 0.05, 0.06]])
    file = tmp_path / f"tray.{suffix}"
    trimesh.boolean.difference([outside, inside]).export(file)
    if suffix == "dae":  # whatever was given, trimesh writes that y is up
        file.write_text(file.read_text().replace("Y_UP", "Z_UP"))
    shape = {"type": "mesh", "path": f"tray.{suffix}", "convex": "decompose"}
    tray = {"name": "tray", "shape": shape, "pose": {"position": [0.5, 0, 0]}}
    block = box([0.04, 0.1, 0.06], [0.51, 0, 0.04], mass=0.5)
    made = scene(tmp_path, object=block, supports=[tray])
    by_normal = Counter(tuple(point.normal.round(3).tolist()) for point in made.contacts.points)
    assert by_normal == {(0.0, 0.0, 1.0): 4, (0.0, 1.0, 0.0): 4, (0.0, -1.0, 0.0): 4}
    floor = np.array([p.position for p in made.contacts.points if p.normal[2] > 0.9])
    np.testing.assert_allclose(floor[:, 2], 0.01, atol=1e-4)
    assert made.solve("margin").found
    full = scene(tmp_path, object=block, supports=[tray | {"shape": shape | {"convex": "hull"}}])
    with pytest.raises(SceneError, match="support 'tray' and object 'object' overlap"):
        full.problem()


def test_the_points_of_a_face_are_bounded_on_request(tmp_path):
    can: dict[str, object] = {
        "shape": {"type": "cylinder", "radius": 0.1, "length": 0.2},
        "mass": 1.0,
        "material": "steel",
    }
    can["pose"] = {"position": [0.0, 0.0, 0.1]}
    for count, expected in ((None, 8), (8, 8), (5, 5), (3, 3)):
        given = {} if count is None else {"points_per_patch": count}
        made = scene(tmp_path, object=can, **given)
        points = np.array([point.position for point in made.contacts.points])
        assert len(points) == expected
        np.testing.assert_allclose(np.hypot(points[:, 0], points[:, 1]), 0.1, atol=1e-9)
        assert made.problem().contact_count == expected
    fewer = made.with_changes(points_per_patch=4)
    assert len(fewer.contacts.bodies) == 4
    with pytest.raises(SceneError, match=r"points_per_patch: found 2; needs a whole number >= 3"):
        scene(tmp_path, object=can, points_per_patch=2)
