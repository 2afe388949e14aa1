"""Slices of `make planning-tasks`: what OMPL plans is what the checker and MuJoCo see."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

pytest.importorskip("ompl", reason="OMPL is not installed: pip install 'graspless-pin[ompl]'")
pytest.importorskip(
    "mujoco", reason="MuJoCo is not installed: pip install 'graspless-pin[simulate]'"
)
from benchmarks.planning_tasks import SEED, TASKS, Plan, plan
from benchmarks.verified_paths import verified_path
from ompl import util

from graspless_pin import Evaluator

RESOLUTION = 0.004, 0.008  # m, rad
VERIFIED = 16


def planned(names: tuple[str, ...]) -> list[tuple[Plan, Plan]]:
    """Plan tasks with and without a margin, in a process of its own, where OMPL's seed counts."""
    util.RNG.setSeed(SEED)
    tasks = [TASKS[name]() for name in names]
    return [
        (plan(task, task.margin, RESOLUTION), plan(task, -np.inf, RESOLUTION)) for task in tasks
    ]


def test_paths_keep_the_margin_that_is_asked_for():
    names = "crate", "bar"
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as processes:
        plans = processes.submit(planned, names).result()
    below = []
    for name, (kept, free) in zip(names, plans, strict=True):
        task = TASKS[name]()
        for found in (kept, free):
            np.testing.assert_array_equal(found.corners[0], task.start)
            np.testing.assert_allclose(found.corners[-1], task.goal, atol=1e-6)
            some = found.states[:: max(1, len(found.states) // VERIFIED)]
            seen = verified_path(task.scene, some, carried=task.link is not None)
            assert not seen.objections and not seen.outside
            assert seen.clearance > 0.0
            assert found is free or not seen.below(task.margin)
            below.append(seen.below(task.margin))
    assert any(below)  # without the margin


def test_what_is_seen_of_a_path_that_nobody_planned():
    """The bar goes through the wall, and is held level."""
    task = TASKS["bar"]()
    arm, whole = Evaluator(task.scene, attached_to=task.link), Evaluator(task.scene)
    level = {"panda_joint2": -0.185178, "panda_joint4": -2.4965187, "panda_joint6": 2.3113407}
    level |= {"panda_joint1": -0.7, "panda_joint7": 0.7853982}
    states = []
    for q in ({}, {"panda_joint1": 0.0}, level):
        there = arm.scene_at(q)
        assert there.hand is not None
        states.append((whole.configuration(there.hand.q), there.object.T_world_object))
    assert arm.first_invalid({}, {"panda_joint1": 0.7}) is not None
    seen = verified_path(task.scene, states, carried=True)
    assert np.isneginf(seen.margins).tolist() == [False, True, True]
    assert seen.clearance < -0.01 and "wall" in seen.closest
    assert "overlap" in seen.objections[0] and len(seen.objections) == 1
    off = [(states[0][0] + 3.0, states[0][1]), states[0]]
    assert verified_path(task.scene, off, carried=True).outside == 1
