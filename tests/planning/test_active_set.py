"""Optima carried over from a neighbouring problem, against solving it afresh."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.core.random_scenes import general_scene, slope_scene
from tests.core.scenes import assert_holds

from graspless_pin import maximize_margin
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.options import SolveOptions, torque_objective
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.algorithms.warm_search import WarmStart, solve_from
from graspless_pin.modes.rules import Rules
from graspless_pin.programs.active_set import active_set_of, optimum_on_active_set
from graspless_pin.programs.objectives import Margin
from graspless_pin.solvers import Outcome, solve

SEEDS = st.integers(0, 10_000)
STRICT = Rules.parse()
OBJECTIVES = {"margin": Margin(), "torque": torque_objective(0.01)}


def moved(problem, size, seed):
    """A problem whose weight and Jacobian differ by a part of their size."""
    rng = np.random.default_rng(seed)
    return problem.with_changes(
        external_wrench=problem.external_wrench
        * (1.0 + size * rng.normal(size=problem.external_wrench.shape)),
        jacobian=problem.jacobian * (1.0 + size * rng.normal(size=problem.jacobian.shape)),
    )


def relaxations(seed, contacts, size, objective, *, slope=False, in_mode=False):
    problem = (slope_scene if slope else general_scene)(seed, contacts)
    shared = [formulate(one, objective) for one in (problem, moved(problem, size, seed))]
    best = maximize_margin(problem) if in_mode else None
    if best is None or not best.found:
        return [one.program for one in shared]
    return [one.program.with_bounds(*one.bounds_of(best.mode), np.inf) for one in shared]


@settings(max_examples=25)
@given(
    SEEDS,
    st.integers(3, 9),
    st.booleans(),
    st.sampled_from([1e-6, 1e-4, 1e-2, 0.3]),
    st.sampled_from(list(OBJECTIVES)),
)
def test_what_is_carried_over_is_what_a_solver_finds(seed, contacts, slope, size, algorithm):
    first, second = relaxations(seed, contacts, size, OBJECTIVES[algorithm], slope=slope)
    answer = solve(first)
    if answer.outcome is not Outcome.SOLVED:
        return
    near = active_set_of(first, answer)
    assert near is not None
    # As `solve` has it: a bound above all that the box allows counts as infeasible.
    found = optimum_on_active_set(second, near, second.cutoff)
    if found is None:
        return
    known, onward = found
    fresh = solve(second)
    assert known.outcome is fresh.outcome
    if known.outcome is Outcome.INFEASIBLE:
        return
    # What a violation that passes the check is worth: its size times the multipliers.
    worth = (
        sum(np.abs(fresh.y)) + sum(np.abs(fresh.z)) + sum(np.abs(known.y)) + sum(np.abs(known.z))
    )
    slack = 1e-9 + worth * max(fresh.residual, known.residual)
    assert known.bound <= fresh.value + slack
    assert known.value == pytest.approx(fresh.value, abs=2e-7 + slack)
    # The certificate is of this program, recomputed here from its arrays alone.
    x = known.x
    assert np.abs(second.A @ x - second.b).max() <= 1e-7
    assert (second.G @ x <= second.u + 1e-7).all()
    assert (second.G @ x >= second.l - 1e-7).all()
    again = optimum_on_active_set(second, onward, np.inf)
    assert again is not None
    np.testing.assert_allclose(again[0].x, x, atol=1e-7)


@pytest.mark.parametrize("algorithm", list(OBJECTIVES))
@pytest.mark.parametrize("kind", ["general", "slope", "in a mode"])
def test_a_little_further_the_same_constraints_are_mostly_active(kind, algorithm):
    """Of relaxations, and of programs with the bounds of the best mode."""
    tried = carried_over = 0
    for seed in range(12):
        options = {"slope": kind == "slope", "in_mode": kind == "in a mode"}
        first, second = relaxations(seed, 6, 1e-5, OBJECTIVES[algorithm], **options)
        answer = solve(first)
        if answer.outcome is Outcome.SOLVED:
            near = active_set_of(first, answer)
            assert near is not None
            tried += 1
            found = optimum_on_active_set(second, near, np.inf)
            if found is not None:
                carried_over += 1
                x = found[0].x
                assert (x >= second.lb - 1e-7).all() and (x <= second.ub + 1e-7).all()
                assert found[0].value == pytest.approx(solve(second).value, abs=3e-7)
    assert tried >= 8
    assert carried_over >= (0.4 if kind == "in a mode" else 0.8) * tried


def test_an_optimum_above_the_cutoff_proves_that_nothing_is_below_it():
    first, second = relaxations(1, 6, 1e-6, OBJECTIVES["margin"])
    answer = solve(first)
    near = active_set_of(first, answer)
    assert near is not None
    found = optimum_on_active_set(second, near, answer.value - 1e-3)
    assert found is not None
    assert found[0].outcome is Outcome.INFEASIBLE
    assert found[0].bound == pytest.approx(answer.value, abs=1e-4)


def test_nothing_is_carried_over_to_a_program_of_another_size_or_a_quadratic_one():
    first, _ = relaxations(1, 6, 1e-6, OBJECTIVES["margin"])
    near = active_set_of(first, solve(first))
    assert near is not None
    other = relaxations(1, 7, 1e-6, OBJECTIVES["margin"])[0]
    assert optimum_on_active_set(other, near, np.inf) is None
    quadratic = relaxations(1, 6, 1e-6, Margin(1e-3))[0]
    assert optimum_on_active_set(quadratic, near, np.inf) is None
    assert active_set_of(quadratic, solve(quadratic)) is None


@pytest.mark.parametrize("algorithm", list(OBJECTIVES))
def test_along_a_path_each_answer_is_that_of_a_fresh_search(algorithm):
    """Every step starts from what the step before left behind, right or not."""
    objective = OBJECTIVES[algorithm]
    found = 0
    for seed in range(3):
        problem = general_scene(seed, 5)
        left = WarmStart()
        for step in range(6):
            state = moved(problem, 0.02 * step, seed)
            warm, left = solve_from(state, objective, SolveOptions(STRICT), left)
            cold, _ = solve_from(state, objective, SolveOptions(STRICT))
            assert warm.status is cold.status
            if cold.found:
                found += 1
                figure = "margin" if algorithm == "margin" else "max_torque"
                expected = getattr(cold, figure)
                assert getattr(warm, figure) == pytest.approx(expected, abs=1e-5)
                assert warm.certificate.gap <= 1e-5
                assert_holds(warm)
                in_mode = solve_problem(state, objective, SolveOptions(STRICT), mode=warm.mode)
                assert in_mode.found  # so there is a motion behind the mode
    assert found >= 7
