"""Branch and bound, enumeration and a mixed-integer program find the same optimum, or none do."""

from collections.abc import Callable
from functools import partial
from itertools import product

import numpy as np
import pytest
from random_scenes import general_scene, infeasible_scene, slope_scene
from scenes import SIGN_RULES, SLIDING_RULES, assert_holds, scene
from tests.oracles.mixed_integer import solve_by_mixed_integer

from graspless_pin import (
    QuasistaticProblem,
    Status,
    TorqueSolution,
    maximize_margin,
    minimize_torque,
)

PAIRS = tuple(product(SIGN_RULES, SLIDING_RULES))
ALGORITHMS = (maximize_margin, partial(minimize_torque, margin=0.1))

# (family, seed, contacts): 100 of 2 to 8 contacts, most of them small enough to list all modes.
SMALL = (
    *(("general", seed, 2 + seed % 4) for seed in range(17)),
    *(("general", seed, 6 + seed % 3) for seed in range(35, 38)),
    *(("weak fingers", seed, 2 + seed % 3) for seed in range(14)),
    ("weak fingers", 28, 5),
    *(("slope", seed, 4 + seed % 2) for seed in range(45)),
    *(("slope", seed, 3) for seed in range(90, 93)),
    *(("slope", seed, 6) for seed in range(96, 98)),
    *(("infeasible", seed, 2 + seed % 7) for seed in range(15)),
)
LARGE = tuple((("general", "slope")[seed % 2], seed, 10 + 3 * seed % 15) for seed in range(15))


def problem_of(family: str, seed: int, contacts: int) -> QuasistaticProblem:
    if family == "weak fingers":
        return general_scene(seed, contacts, joints=(1, 2))
    makers = {"general": general_scene, "slope": slope_scene, "infeasible": infeasible_scene}
    return makers[family](seed, contacts)


def cases_of(seed: int) -> tuple[tuple[tuple[str, str], Callable[..., TorqueSolution]], ...]:
    """Each algorithm with a rule pair of its own: all twelve combinations over the seeds."""
    return tuple((PAIRS[(seed // 3 + 3 * i) % 6], ALGORITHMS[i]) for i in range(2))


def optimum(solution: TorqueSolution) -> float | None:
    if not solution.found:
        return None
    return solution.margin if solution.algorithm == "margin" else solution.max_torque


def differ(first: float | None, second: float | None) -> bool:
    if first is None or second is None:
        return first is not second
    return first != pytest.approx(second, rel=1e-4, abs=1e-6)


def assert_agreement(
    problem: QuasistaticProblem,
    algorithm: Callable[..., TorqueSolution],
    pair: tuple[str, str],
    *,
    enumerate_too: bool = False,
) -> None:
    """Hold the default search against the mixed-integer program, and against enumeration."""
    solve = partial(algorithm, sign_rule=pair[0], sliding_rule=pair[1])
    where = f"{algorithm}, {pair}"
    first = solve(problem)
    counts = first.certificate
    assert counts.modes_examined <= counts.nodes <= counts.force_programs, where
    others = []
    if enumerate_too:
        listed = solve(problem, search="enumerate")
        assert listed.status is first.status, where
        others.append(listed)
    oracle = solve_by_mixed_integer(
        problem, str(first.algorithm), sign_rule=pair[0], sliding_rule=pair[1]
    )
    assert (oracle is not None) is first.found, where
    if oracle is not None:
        # Its binaries are not believed, nor its forces to 1e-6: its mode is solved on its own.
        in_mode = solve(problem, mode=oracle.mode)
        assert in_mode.status is Status.OPTIMAL_IN_MODE, where
        assert optimum(in_mode) == pytest.approx(oracle.value, rel=1e-4, abs=1e-6), where
        others.append(in_mode)
    for solution in (first, *others):
        # 1e-9 N or N m is zero: a scene may hold without any torque.
        if first.found:
            assert optimum(solution) == pytest.approx(optimum(first), rel=1e-6, abs=1e-9), where
    if first.found:
        assert first.status is Status.OPTIMAL
        assert_holds(first)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
@pytest.mark.parametrize("name", ["sphere", "rest", "up", "down"])
def test_paper_scenes(name, pair, algorithm):
    assert_agreement(scene(name), algorithm, pair, enumerate_too=True)


@pytest.mark.sampled(16)
@pytest.mark.parametrize(("family", "seed", "contacts"), SMALL)
def test_small_random_scenes(family, seed, contacts):
    problem = problem_of(family, seed, contacts)
    for pair, algorithm in cases_of(seed):
        assert_agreement(problem, algorithm, pair, enumerate_too=True)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("family", "seed", "contacts"), LARGE)
def test_large_random_scenes(family, seed, contacts):
    problem = problem_of(family, seed, contacts)
    pair, algorithm = PAIRS[seed // 2 % 6], ALGORITHMS[seed % 5 % 2]
    assert_agreement(problem, algorithm, pair)


@pytest.mark.parametrize(
    ("seed", "algorithm"), [(0, partial(minimize_torque, margin=0.1)), (105, maximize_margin)]
)
def test_virtual_motions_of_very_different_speeds(seed, algorithm):
    """Where one contact must virtually slide thousands of times as fast as another."""
    problem = problem_of("weak fingers", seed, 6)
    assert_agreement(problem, algorithm, ("strict", "exempt"))


@pytest.mark.sampled(0)
def test_small_scenes_cover_found_and_not_found():
    assert len(SMALL) == 100 and {contacts for _, _, contacts in SMALL} == set(range(2, 9))
    cases = {case for _, seed, _ in SMALL for case in cases_of(seed)}
    assert cases == set(product(PAIRS, ALGORITHMS))
    statuses = [
        minimize_torque(problem_of(*key), 0.1, sliding_rule="constrained").status for key in SMALL
    ]
    assert statuses.count(Status.OPTIMAL) >= 50
    assert statuses.count(Status.INFEASIBLE_FORCES) >= 12
    assert statuses.count(Status.INFEASIBLE_MODES) >= 3


@pytest.mark.sampled(0)
def test_virtual_sliding_rule_binds_on_slopes():
    """In many scenes strict, nonzero and Coulomb friction give three or two different answers."""
    scenes = [problem_of("slope", seed, 4 + seed % 2) for seed in range(90)]
    strict_nonzero, nonzero_coulomb, all_three = set(), set(), set()
    for algorithm, (index, problem) in product(ALGORITHMS, enumerate(scenes)):
        strict, nonzero = (
            optimum(algorithm(problem, sign_rule=rule, sliding_rule="constrained"))
            for rule in ("strict", "nonzero")
        )
        coulomb = optimum(algorithm(problem, static_friction="coulomb"))
        if differ(strict, nonzero):
            strict_nonzero.add(index)
        if differ(nonzero, coulomb):
            nonzero_coulomb.add(index)
        if differ(strict, nonzero) and differ(nonzero, coulomb):
            all_three.add(index)
    counts = len(strict_nonzero), len(nonzero_coulomb), len(all_three)
    assert np.all(np.array(counts) >= (20, 6, 2)), counts
