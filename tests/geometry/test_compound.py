"""Bodies of several shapes: the same as the one shape that they make together."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspless_pin import Evaluator, Scene, load_scene
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry import Box, Compound, Cylinder, HalfSpace, MeshShape, Sphere
from graspless_pin.geometry.bodies.shape import Hull, Shape
from graspless_pin.visualization import draw_scene

EXAMPLES = Path(__file__).parents[2] / "examples"


def at(*position: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = position
    return T


def halves(box: Box) -> Compound:
    """The box, cut across x, one half upside down."""
    x, y, z = box.size
    turned = np.diag([1.0, -1.0, -1.0, 1.0])
    half = Box((x / 2.0, y, z))
    return Compound(
        (half, half), np.array([at(-x / 4.0, 0.0, 0.0), at(x / 4.0, 0.0, 0.0) @ turned])
    )


def of_shape(scene: Scene, shape: Shape) -> Scene:
    return scene.with_changes(object=replace(scene.object, shape=shape, inertia=None))


def test_two_halves_of_a_box_are_the_box() -> None:
    scene = load_scene(EXAMPLES / "trihand_push_box.yaml").with_changes(motion=None)
    box = scene.object.shape
    assert isinstance(box, Box)
    cut = of_shape(scene, halves(box))
    whole, parts = box.filling(), cut.object.shape.filling()
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(cut.object.own_inertia, scene.object.own_inertia, rtol=1e-12)
    assert cut.solve().margin == pytest.approx(scene.solve().margin, abs=1e-6)
    corners = draw_scene(cut).meshes[0].vertices
    assert np.ptp(corners, axis=0) == pytest.approx(
        np.ptp(draw_scene(scene).meshes[0].vertices, axis=0)
    )
    again = pickle.loads(pickle.dumps(cut))  # noqa: S301 - our own
    assert again.solve().margin == cut.solve().margin


@pytest.mark.parametrize(
    ("name", "link"), [("allegro_sphere_on_slope", None), ("panda_carry_bar", "panda_hand")]
)
def test_a_shape_that_is_not_in_the_middle_of_its_frame_is_that_shape_elsewhere(
    name: str, link: str | None
) -> None:
    """In single states, in many at once, and where the object moves with a link."""
    scene = load_scene(EXAMPLES / f"{name}.yaml")
    made, off = scene.object, at(0.01, -0.02, 0.03)
    shifted = replace(
        made,
        shape=Compound((made.shape,), off[None]),
        T_world_object=made.T_world_object @ np.linalg.inv(off),
        center_of_mass=made.center_of_mass + off[:3, 3],
        inertia=made.own_inertia,
    )
    other = scene.with_changes(object=shifted)
    np.testing.assert_allclose(
        other.contacts.arrays.positions, scene.contacts.arrays.positions, atol=1e-12
    )
    assert scene.hand is not None
    pair = [Evaluator(each, attached_to=link, collisions=False) for each in (scene, other)]
    q = np.array([scene.hand.q[joint] for joint in pair[0].joint_names])
    steps = np.random.default_rng(2).uniform(0.0, 1e-3 if link is None else 0.3, (20, len(q)))
    one, two = (evaluator.evaluate_many(q - steps).margins for evaluator in pair)
    np.testing.assert_allclose(two, one, atol=1e-9)
    assert np.isfinite(one).any()


@pytest.mark.parametrize(
    ("parts", "poses", "words"),
    [
        ((), np.empty((0, 4, 4)), "at least one shape"),
        ((HalfSpace(),), np.eye(4)[None], "none of them a half-space"),
        ((Sphere(0.1), Cylinder(0.1, 0.2)), np.eye(4)[None], "one for each of 2 parts"),
        ((Sphere(0.1),), 2.0 * np.eye(4)[None], r"poses\[0\]"),
    ],
)
def test_what_is_no_compound_is_refused(parts: tuple, poses: np.ndarray, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        Compound(parts, poses)


def test_scene_files_have_compounds_and_hulls(tmp_path: Path) -> None:
    scene = load_scene(EXAMPLES / "trihand_push_box.yaml").with_changes(motion=None)
    box = scene.object.shape
    assert isinstance(box, Box)
    cut = halves(box)
    corners = cut.parts[1].surface().vertices
    cut = of_shape(scene, Compound((cut.parts[0], Hull(corners)), cut.poses))
    beside = load_scene(cut.save(tmp_path / "edited.yaml"))
    alone = load_scene(cut.with_changes(path=None).save(tmp_path / "alone.yaml"))
    for again in (beside, alone):
        shape = again.object.shape
        assert isinstance(shape, Compound) and isinstance(shape.parts[1], Hull)
        np.testing.assert_allclose(shape.poses, cut.object.shape.poses, atol=1e-12)  # pyright: ignore
        np.testing.assert_array_equal(shape.parts[1].points, corners)
        assert again.solve().margin == pytest.approx(scene.solve().margin, abs=1e-6)
    wide = beside.with_changes({"object.shape.parts.0.shape.size.1": 0.2})
    assert wide.object.shape.filling().volume == pytest.approx(box.filling().volume * 1.125)


def test_other_parts_make_another_scene(tmp_path: Path) -> None:
    """A shape that holds arrays is equal to itself alone: what was made of one is not kept."""
    scene = load_scene(EXAMPLES / "trihand_push_box.yaml").with_changes(motion=None)
    box = scene.object.shape
    assert isinstance(box, Box)
    hull = Hull(box.surface().vertices)
    assert hull != Hull(2.0 * hull.points) and halves(box) != halves(box) and hull == hull
    loaded = load_scene(of_shape(scene, hull).save(tmp_path / "scene.yaml"))
    wide = (hull.points * [1.0, 1.5, 1.0]).tolist()
    wider = loaded.with_changes({"object.shape.points": wide})
    for one, factor in ((loaded, 1.0), (wider, 1.5)):
        corners = one.contacts.arrays.positions[:, 1]
        assert np.abs(corners).max() == pytest.approx(factor * box.size[1] / 2.0, abs=1e-9)


def test_parts_have_their_files_beside_the_scene(tmp_path: Path) -> None:
    scene = load_scene(EXAMPLES / "trihand_push_box.yaml").with_changes(motion=None)
    (tmp_path / "meshes").mkdir()
    file = tmp_path / "meshes" / "cube.off"
    trimesh.creation.box(extents=[0.1, 0.1, 0.1]).export(file)
    cube = of_shape(scene, Compound((MeshShape(file),), np.eye(4)[None]))
    saved = cube.save(tmp_path / "scene.yaml")
    assert "path: meshes/cube.off" in saved.read_text()
    (tmp_path / "inside").mkdir()
    again = load_scene(saved).save(tmp_path / "inside" / "scene.yaml")
    assert "path: ../meshes/cube.off" in again.read_text()
    assert load_scene(again).solve().margin == cube.solve().margin


def test_shapes_of_other_kinds_are_in_no_scene_file(tmp_path: Path, monkeypatch) -> None:
    class Block(Box):
        kind = "block"

    scene = load_scene(EXAMPLES / "trihand_push_box.yaml")
    with pytest.raises(SceneError, match="'block', which scene files do not support"):
        of_shape(scene, Block((0.1, 0.1, 0.1))).save(tmp_path / "scene.yaml")
    nested = Compound((Compound((Sphere(0.1),), np.eye(4)[None]),), np.eye(4)[None])
    with pytest.raises(
        SceneError, match="'compound', which scene files do not support in a compound"
    ):
        of_shape(scene, nested).save(tmp_path / "scene.yaml")
    monkeypatch.setattr("graspless_pin.intake.yaml_text.MOST_ENTRIES", 300)
    many = np.random.default_rng(0).normal(size=(90, 3))
    with pytest.raises(SceneError, match=r"300 entries.*mesh file"):
        of_shape(scene, Hull(many / np.linalg.norm(many, axis=1)[:, None])).save(
            tmp_path / "scene.yaml"
        )
