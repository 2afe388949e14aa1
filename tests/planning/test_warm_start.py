"""Searches that begin with a mode of another problem, against those that begin with none."""

from collections import Counter

import numpy as np
import pytest
from tests.core.random_scenes import general_scene, slope_scene
from tests.core.scenes import random_problem

from graspless_pin import SlidingMode, maximize_margin, minimize_torque
from graspless_pin.algorithms.options import SolveOptions, torque_objective
from graspless_pin.algorithms.warm_search import WarmStart, reaches_margin, solve_from
from graspless_pin.modes.rules import Rules
from graspless_pin.programs.objectives import Margin

FAMILIES = {
    "general": lambda seed: general_scene(seed, 5, joints=(1, 3), cone_edges=5),
    "slope": lambda seed: slope_scene(seed, 6, cone_edges=4),
    "random": lambda seed: random_problem(seed, 5),
}
STRICT = Rules.parse()


def some_mode(problem, seed):
    """Any mode, of which most have no motion behind them."""
    rng = np.random.default_rng(seed)
    selection = problem.has_cone & (rng.random(problem.contact_count) < 0.7)
    signs = rng.choice([-1, 1], (problem.contact_count, 2)) * selection[:, None]
    return SlidingMode(selection, signs)


@pytest.mark.parametrize("family", list(FAMILIES))
def test_the_answer_does_not_depend_on_the_start(family):
    found = 0
    for seed in range(12):
        problem = FAMILIES[family](seed)
        cold = maximize_margin(problem)
        least = minimize_torque(problem, 0.01)
        starts = [WarmStart(some_mode(problem, seed)), WarmStart(SlidingMode([True], [[1, 1]]))]
        if cold.found:
            starts.append(WarmStart(cold.mode))
        for start in starts:
            warm, _ = solve_from(problem, Margin(), SolveOptions(STRICT), start)
            assert warm.status is cold.status
            other, _ = solve_from(problem, torque_objective(0.01), SolveOptions(STRICT), start)
            assert other.status is least.status
            if cold.found:
                assert warm.margin == pytest.approx(cold.margin, abs=1e-5)
                assert warm.certificate.gap <= 1e-5
            if least.found:
                assert other.max_torque == pytest.approx(least.max_torque, abs=1e-5)
        found += cold.found
    assert found >= 6


@pytest.mark.parametrize("family", list(FAMILIES))
def test_a_margin_is_reached_up_to_the_largest(family):
    counts = Counter()
    for seed in range(15):
        problem = FAMILIES[family](seed)
        best = maximize_margin(problem)
        if not best.found:
            assert reaches_margin(problem, 0.0, SolveOptions(STRICT))[0] is False
            continue
        for mode in (None, some_mode(problem, seed), best.mode):
            start = WarmStart(mode)
            for share in (0.0, 0.5, 0.999):
                reached, left = reaches_margin(
                    problem, share * best.margin, SolveOptions(STRICT), start
                )
                assert reached
                assert left.mode is not None
                # The mode is a proof: it can be checked by itself.
                again = maximize_margin(problem, mode=left.mode)
                assert again.margin >= share * best.margin - 1e-5
            above = best.margin + 1e-4 * max(1.0, best.margin)
            assert reaches_margin(problem, above, SolveOptions(STRICT), start)[0] is False
        early, _ = reaches_margin(problem, 0.9 * best.margin, SolveOptions(time_limit=0.0))
        counts[early] += 1
    # Without time for a search it is either proven at once or undecided, never refuted.
    assert counts[True] >= 5
    assert counts[False] == 0
    if family != "general":
        assert counts[None] >= 1
