"""What compiled interior points answer is what a search answers, with the same kind of proof."""

import json
from functools import partial
from typing import Any

import numpy as np
import pytest
from random_scenes import general_scene, slope_scene
from scenes import scene

from graspless_pin import (
    QuasistaticProblem,
    SlidingRule,
    StaticFriction,
    Status,
    compiled,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

pytestmark = pytest.mark.skipif(compiled.cold_optima is None, reason="nothing was compiled")

LOOPS = "loops"
SCENES = {
    "sphere": partial(scene, "sphere"),
    "up": partial(scene, "up"),
    "down": partial(scene, "down"),
    "rest": partial(scene, "rest"),
    **{f"general {seed}": partial(general_scene, seed, 5) for seed in range(12)},
    **{f"slope {seed}": partial(slope_scene, seed, 6) for seed in range(12)},
}
ALGORITHMS: dict[str, Any] = {
    "margin": maximize_margin,
    "torque": partial(minimize_torque, margin=0.1),
    "share": partial(minimize_torque, margin=0.1, scale="limits"),
}


def bounded(problem: QuasistaticProblem) -> QuasistaticProblem:
    """The problem with limits on all torques, so that there are shares of them."""
    limits = np.full(problem.joint_count, 50.0)
    return problem.with_changes(torque_limits=(-limits, limits))


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_answers_are_those_of_a_search(name: str, algorithm: str) -> None:
    problem, solve = bounded(SCENES[name]()), ALGORITHMS[algorithm]
    found = solve(problem)
    expected = solve(problem, solver="highs")
    assert found.status is expected.status
    if not found.found:
        return
    assert found.value == pytest.approx(expected.value, rel=1e-7, abs=1e-9)
    assert found.certificate.bound == pytest.approx(expected.certificate.bound, rel=1e-7, abs=1e-7)
    if found.certificate.solver != LOOPS:
        return
    # The mode is one of the problem: alone it is feasible, and has the same optimum.
    alone = solve(problem, mode=found.mode)
    assert alone.status is Status.OPTIMAL_IN_MODE
    assert alone.value == pytest.approx(found.value, rel=1e-7, abs=1e-9)
    document = json.loads(json.dumps(solution_document(found), allow_nan=False))
    assert verify_document(document).proven


def test_most_small_scenes_need_no_search() -> None:
    answered = [
        solve(make()).certificate.solver == LOOPS
        for make in SCENES.values()
        for solve in (maximize_margin, ALGORITHMS["torque"])
    ]
    assert sum(answered) >= 0.6 * len(answered)


def test_what_is_asked_again_is_answered_alike() -> None:
    problem = scene("rest")
    one, other = maximize_margin(problem), maximize_margin(problem)
    np.testing.assert_array_equal(one.torques, other.torques)
    np.testing.assert_array_equal(one.mode.signs, other.mode.signs)


@pytest.mark.parametrize(
    "options",
    [
        {"solver": "piqp"},
        {"search": "enumerate"},
        {"static_friction": StaticFriction.COULOMB},
        {"sliding_rule": SlidingRule.CONSTRAINED},
        {"regularization": 1e-3},
    ],
    ids=str,
)
def test_what_the_loops_do_not_know_is_searched(options: dict[str, Any]) -> None:
    problem = scene("up")  # it slides
    assert maximize_margin(problem).certificate.solver == LOOPS
    assert maximize_margin(problem, **options).certificate.solver != LOOPS


def test_large_problems_round_cones_and_given_modes_are_searched() -> None:
    assert maximize_margin(general_scene(0, 24)).certificate.solver != LOOPS
    assert maximize_margin(scene("up").with_changes(cone="round")).certificate.solver != LOOPS
    mode = maximize_margin(scene("up")).mode
    assert maximize_margin(scene("up"), mode=mode).certificate.solver != LOOPS


def test_multipliers_tell_what_limits_cost() -> None:
    problem = scene("rest")
    ours, theirs = maximize_margin(problem), maximize_margin(problem, solver="piqp")
    assert ours.multipliers.keys() == theirs.multipliers.keys()
    value = {
        name: float(np.abs(ours.multipliers[name]).sum() - np.abs(theirs.multipliers[name]).sum())
        for name in ours.multipliers
    }
    assert max(map(abs, value.values())) < 1e-5
