"""Scenes go through pickles and into other processes, and answer there as they do here."""

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import pytest
from scene_tools import BOX, EXAMPLES, PAPER, assert_same, content, hand_of, loaded

from graspless_pin import Scene, load_scene

FILES = sorted([*EXAMPLES.glob("*.yaml"), *PAPER.glob("*.yaml")])


def copied(scene: Scene) -> Scene:
    return pickle.loads(pickle.dumps(scene))  # noqa: S301 - our own bytes


@pytest.mark.sampled(3)
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_copy_gives_the_same_problem(file):
    scene = load_scene(file)
    fresh = copied(scene)
    assert_same(fresh.problem(), scene.problem())
    used = copied(scene)  # with all that it has found by now
    assert used.contacts.bodies == scene.contacts.bodies
    assert_same(used.problem(), scene.problem())


def test_what_is_read_only_stays_so(tmp_path):
    data = content(BOX)
    data["materials"] = {"rubber": {"steel": 0.6}}
    copy = copied(loaded(tmp_path, data))
    for array in (
        copy.object.T_world_object,
        copy.object.center_of_mass,
        copy.supports[0].T_world_support,
        copy.supports[0].velocity,
        hand_of(copy).positions,
        *hand_of(copy).effort_limits,
        hand_of(copy).T_world_base,
        hand_of(copy).tree.lower,
        hand_of(copy).collision_bodies()[0].T_world_geometry,
    ):
        assert not array.flags.writeable
    with pytest.raises(TypeError):
        copy.materials.coefficients[frozenset("a")] = 1.0  # pyright: ignore[reportIndexIssue]
    assert copy.materials.friction("steel", "rubber") == 0.6


def margin(scene: Scene) -> float:
    return scene.solve("margin").margin


def test_a_process_pool_solves_scenes():
    scene = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    # Spawned processes share nothing with this one.
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = list(pool.map(margin, [scene]))
    assert there == pytest.approx([margin(scene)], abs=1e-9)
