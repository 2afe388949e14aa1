"""States whose contacts stay under other loads: one loop answers as searches do."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest
from random_scenes import general_scene, slope_scene
from scenes import scene

from graspless_pin import Margin, QuasistaticProblem, SolveOptions, Torque, TorqueShare, compiled
from graspless_pin.algorithms.batch_optimum import LoadSweep
from graspless_pin.algorithms.batch_programs import loops_cover
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.problem.cones import CONE_MODELS

pytestmark = pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")

SCENES = {
    "sphere": partial(scene, "sphere"),
    "up": partial(scene, "up"),
    "down": partial(scene, "down"),
    "rest": partial(scene, "rest"),
    **{f"general {seed}": partial(general_scene, seed, 5) for seed in range(4)},
    **{f"slope {seed}": partial(slope_scene, seed, 6) for seed in range(4)},
}
OBJECTIVES = [Margin(), Torque(required_margin=0.05), TorqueShare(required_margin=0.05)]
HIGHS = SolveOptions.parse(solver="highs")
COUNT = 10
VALUE, UNIT = 1, 5


class Found(NamedTuple):
    figures: Any
    torques: Any
    found: Any


def loaded(problem: QuasistaticProblem, seed: int) -> tuple[list[QuasistaticProblem], Any]:
    """Problems of the same contacts, and what differs in them as loops take it."""
    rng = np.random.default_rng(seed)
    problems, rows = [], []
    for _ in range(COUNT):
        limits = -rng.uniform(20.0, 50.0, problem.joint_count), rng.uniform(20.0, 50.0)
        one = problem.with_changes(
            friction=problem.friction * rng.uniform(0.6, 1.6, problem.contact_count),
            external_wrench=problem.external_wrench * rng.uniform(0.5, 1.5),
            torque_limits=(limits[0], np.full(problem.joint_count, limits[1])),
            gravity_torques=rng.uniform(-0.1, 0.1, problem.joint_count),
            max_normal_force=rng.uniform(30.0, 60.0, problem.contact_count),
        )
        problems.append(one)
        rows.append(np.concatenate([
            one.friction, one.external_wrench, one.lower_torque, one.upper_torque,
            one.gravity_torques, one.max_normal_force,
        ]))  # fmt: skip
    return problems, np.array(rows)


def found_of(problem, objective, rows, *, together=True) -> Found:
    """What loops find of states in order; those that they do not are left out."""
    optima = LoadSweep(problem, objective, SolveOptions())
    figures, torques = np.full((len(rows), 6), np.nan), np.zeros((len(rows), problem.joint_count))
    begin = 0
    while begin < len(rows):
        last = len(rows) if together else begin + 1
        end = optima.advance(problem, rows[:last], begin, figures[:last], torques[:last])
        begin = max(end, begin + 1) if not together else end + 1
    found = np.isfinite(figures[:, 0])
    return Found(figures[found], torques[found], found)


@pytest.mark.sampled(14)
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda one: type(one).__name__)
def test_what_is_found_is_the_optimum_of_each_problem(name, objective):
    problems, rows = loaded(SCENES[name](), 3)
    seen = found_of(problems[0], objective, rows)
    expected = [one for one, known in zip(problems, seen.found, strict=True) if known]
    for one, figures, torques in zip(expected, seen.figures, seen.torques, strict=True):
        solution = solve_problem(one, objective, HIGHS)
        assert solution.found
        sign = -1.0 if objective.maximizes else 1.0
        value = sign * figures[VALUE] * abs(figures[UNIT])
        assert value == pytest.approx(solution.value, rel=1e-7, abs=1e-9)
        assert (one.lower_torque - 1e-7 <= torques).all()
        assert (torques <= one.upper_torque + 1e-7).all()
        assert figures[0] >= objective.required_margin - 1e-7
        if objective == Margin():
            assert figures[0] == pytest.approx(solution.margin, rel=1e-7, abs=1e-9)
        if type(objective) is Torque:
            assert np.abs(torques).max() == pytest.approx(solution.value, rel=1e-7, abs=1e-9)


@pytest.mark.sampled(0)
def test_most_states_are_found():
    found = [
        found_of(make(), objective, loaded(make(), 3)[1]).found.mean()
        for make in SCENES.values()
        for objective in OBJECTIVES
    ]
    assert np.mean(found) >= 0.5


@pytest.mark.parametrize("objective", OBJECTIVES, ids=lambda one: type(one).__name__)
def test_what_is_found_depends_on_the_states_before_it_alone(objective):
    """Bit for bit: not on how many are asked for at once, nor on what other states were."""
    problem = scene("rest")
    _, rows = loaded(problem, 5)
    expected = found_of(problem, objective, rows)
    found_of(problem, objective, loaded(problem, 6)[1])
    again = found_of(problem.with_changes(friction=0.9), objective, rows)
    single = found_of(problem, objective, rows, together=False)
    for other in (again, single):
        np.testing.assert_array_equal(other.found, expected.found)
        np.testing.assert_array_equal(other.figures, expected.figures)
        np.testing.assert_array_equal(other.torques, expected.torques)


@pytest.mark.parametrize("wrong", ["rows", "columns", "figures", "torques", "begin"])
def test_arrays_that_do_not_fit_are_refused(wrong):
    problem = scene("rest")
    _, rows = loaded(problem, 5)
    figures, torques, begin = np.empty((COUNT, 6)), np.empty((COUNT, problem.joint_count)), 0
    if wrong == "rows":
        rows = rows[:-1]
    elif wrong == "columns":
        rows = rows[:, :-1]
    elif wrong == "figures":
        figures = figures[:, :5].copy()
    elif wrong == "torques":
        torques = np.empty((COUNT, problem.joint_count + 1))
    else:
        begin = -1
    with pytest.raises(ValueError, match="needs"):
        LoadSweep(problem, Margin(), SolveOptions()).advance(problem, rows, begin, figures, torques)


def test_loops_are_for_the_best_case_of_the_papers_programs():
    pyramid, margin, usual = CONE_MODELS["edges"], Margin(), SolveOptions()
    assert loops_cover(pyramid, margin, usual)
    assert not loops_cover(CONE_MODELS["round"], margin, usual)
    assert not loops_cover(pyramid, Margin(regularization=1e-3), usual)
    assert not loops_cover(pyramid, margin, SolveOptions.parse(stability="strong"))
    assert not loops_cover(pyramid, margin, SolveOptions.parse(sign_rule="direction"))
