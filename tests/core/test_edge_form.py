"""The algorithms against the paper's definition: brute force over all (B, S) in edge weights."""

from functools import cache

import numpy as np
import pytest
from edge_form import best_over, feasible_modes, letters_of, optimum_in_mode
from scenes import assert_holds, random_problem, structured_arguments

from graspless_pin import QuasistaticProblem, enumerate_modes, maximize_margin, minimize_torque

SEARCHES = ("auto", "enumerate")

# What a problem is made of (kind, seed, contacts, of these sliding), then the rules to try.
BOTH = ("exempt", "constrained")
CASES = [
    (("free", 3, 2, 0), ("strict",), BOTH[:1]),
    (("free", 0, 2, 1), ("strict", "exact", "nonzero"), BOTH),
    (("free", 5, 3, 2), ("strict", "nonzero"), BOTH),
    (("planar", 0, 3, 0), ("strict", "nonzero"), BOTH[:1]),
    (("planar", 1, 3, 0), ("strict",), BOTH[:1]),
    (("planar", 2, 3, 0), ("exact",), BOTH[:1]),
    (("planar", 5, 3, 0), ("strict", "nonzero"), BOTH[:1]),
    (("planar", 3, 3, 1), ("strict",), BOTH),
    (("planar", 5, 3, 1), ("strict", "exact"), BOTH),
    (("planar", 6, 4, 2), ("strict",), BOTH),
    (("pinch", 5, 4, 2), ("strict",), BOTH[:1]),
    (("slab", 4, 4, 2), ("strict",), BOTH),
    (("slab", 7, 3, 0), ("nonzero",), BOTH[:1]),
]
RUNS = [
    (case, sign, sliding)
    for case, signs, slidings in CASES
    for sign in signs
    for sliding in slidings
]


@cache
def make(kind: str, seed: int, contacts: int, slides: int) -> tuple[QuasistaticProblem, float]:
    """A problem and a margin that plain Coulomb friction allows on it."""
    if kind == "free":
        problem = random_problem(seed, contacts, slides=slides)
    else:
        problem = QuasistaticProblem(**structured_arguments(seed, kind, contacts, slides=slides))
    largest = optimum_in_mode(problem, None, None)
    assert largest is not None
    return problem, 0.6 * largest


@cache
def optima(case, sign: str, sliding: str) -> tuple[int, float | None, float | None]:
    """How many modes there are, and the best margin and torque over them."""
    problem, required = make(*case)
    modes = feasible_modes(problem, sign, sliding)
    return len(modes), best_over(problem, modes, None), best_over(problem, modes, required)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("case", "sign", "sliding"), RUNS)
def test_all_modes_and_both_optima(case, sign, sliding):
    (problem, required), rules = make(*case), {"sign_rule": sign, "sliding_rule": sliding}
    count, margin, torque = optima(case, sign, sliding)
    assert len(list(enumerate_modes(problem, **rules))) == count
    for search in SEARCHES:
        largest = maximize_margin(problem, **rules, search=search)
        smallest = minimize_torque(problem, required, **rules, search=search)
        assert largest.found == (margin is not None)
        assert smallest.found == (torque is not None)
        if margin is not None:
            assert largest.margin == pytest.approx(margin, rel=1e-6, abs=1e-6)
            assert_holds(largest)
        if torque is not None:
            assert smallest.max_torque == pytest.approx(torque, rel=1e-6, abs=1e-6)
            assert_holds(smallest)


@pytest.mark.sampled(0)
def test_the_cases_differ_from_each_other():
    """Some optima are worse than Coulomb's, some do not exist, and rules differ."""
    worse_margins, worse_torques, missing, by_rule = 0, 0, 0, {}
    for case, sign, sliding in RUNS:
        (problem, required), (_, margin, torque) = make(*case), optima(case, sign, sliding)
        coulomb = optimum_in_mode(problem, None, None), optimum_in_mode(problem, None, required)
        assert coulomb[0] is not None and coulomb[1] is not None
        worse_margins += margin is not None and margin < coulomb[0] - 1e-3
        worse_torques += torque is not None and torque > coulomb[1] + 1e-3
        missing += torque is None
        by_rule.setdefault(case, set()).add(str((margin, torque)))
    differing = sum(len(optima) > 1 for optima in by_rule.values())
    assert min(worse_margins, worse_torques, missing, differing) >= 3


@pytest.mark.parametrize("case", [("free", seed, 3, seed % 3) for seed in range(6)])
def test_coulomb_friction_is_one_program_in_edge_weights(case):
    problem, required = make(*case)
    largest = maximize_margin(problem, static_friction="coulomb")
    smallest = minimize_torque(problem, required, static_friction="coulomb")
    assert largest.margin == pytest.approx(optimum_in_mode(problem, None, None), rel=1e-6)
    torque = optimum_in_mode(problem, None, required)
    assert smallest.max_torque == pytest.approx(torque, rel=1e-6, abs=1e-6)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", [0, 3])
def test_one_given_mode(seed):
    problem, required = make("planar", seed, 3, 0)
    some_found = False
    for mode in enumerate_modes(problem):
        letters = letters_of(mode)
        margin = optimum_in_mode(problem, letters, None)
        solution = maximize_margin(problem, mode=mode)
        assert solution.found == (margin is not None)
        if margin is not None:
            assert solution.margin == pytest.approx(margin, rel=1e-6, abs=1e-6)
            assert solution.mode == mode
            some_found = True
        torque = optimum_in_mode(problem, letters, required)
        assert minimize_torque(problem, required, mode=mode).found == (torque is not None)
    assert some_found


@pytest.mark.sampled(1)
@pytest.mark.parametrize("case", [("pinch", 4, 3, 0), ("pinch", 2, 3, 0), ("planar", 5, 3, 0)])
def test_smallest_share_of_the_limits(case):
    problem, required = make(*case)
    modes = feasible_modes(problem, "strict", "exempt")
    expected_share = best_over(problem, modes, required, by_limits=True)
    assert expected_share is not None
    for search in SEARCHES:
        solution = minimize_torque(problem, required, scale="limits", search=search)
        assert_holds(solution)
        tau = solution.torques
        shares = np.where(tau >= 0.0, tau / problem.upper_torque, tau / problem.lower_torque)
        assert shares.max() == pytest.approx(expected_share, rel=1e-6, abs=1e-6)
        assert solution.certificate.bound == pytest.approx(expected_share, rel=1e-5)


def test_both_scales_differ_where_limits_do():
    problem, required = make("pinch", 4, 3, 0)
    absolute = minimize_torque(problem, required)
    by_limits = minimize_torque(problem, required, scale="limits")
    assert by_limits.max_torque > absolute.max_torque + 0.01
