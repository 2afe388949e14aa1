"""Programs prove what they claim, solvers are checked, and the regularised QP is what it says."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest
import qpsolvers
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scenes import SOLVERS, cuboid_arguments, random_problem, scene, sphere_arguments
from scipy.optimize import linprog
from scipy.sparse import csc_matrix

from graspless_pin import (
    QuasistaticProblem,
    SlidingMode,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.programs.answers import checked_answer, elastic_program
from graspless_pin.programs.program import Program
from graspless_pin.solvers import (
    Outcome,
    piqp_engines,
    solve,
)
from graspless_pin.solvers.simplex import Simplex, SimplexOutcome

SEEDS = st.integers(0, 100_000)


def random_program(seed: int, *, feasible: bool = True, quadratic: bool = False) -> Program:
    """Six variables in the unit box, two equalities, five rows; feasible through a known point."""
    rng = np.random.default_rng(seed)
    inside = rng.uniform(-0.8, 0.8, 6)
    A, G = rng.normal(size=(2, 6)), rng.normal(size=(5, 6))
    upper = G @ inside + rng.uniform(0.0, 1.0, 5)
    lower = np.where(rng.random(5) < 0.5, G @ inside - rng.uniform(0.0, 1.0, 5), -np.inf)
    b = A @ inside
    if not feasible:
        # The row A_0 x = b_0 against G_0 x = A_0 x <= b_0 - 0.1.
        G[0], upper[0], lower[0] = A[0], b[0] - 0.1, -np.inf
    box = np.array([-np.ones(6), np.ones(6)])
    P = rng.uniform(0.0, 1.0, 6) * (rng.random(6) < 0.7) if quadratic else np.zeros(6)
    return Program(P, rng.normal(size=6), A, b, G, lower, upper, box[0], box[1], box)


def by_linprog(program: Program) -> float | None:
    """Optimum of a linear program, by scipy."""
    up, down = np.isfinite(program.u), np.isfinite(program.l)
    result = linprog(
        program.c,
        np.vstack([program.G[up], -program.G[down]]),
        np.concatenate([program.u[up], -program.l[down]]),
        program.A if len(program.A) else None,
        program.b if len(program.b) else None,
        list(zip(program.lb, program.ub, strict=True)),
    )
    assert result.status in (0, 2)
    return float(result.fun) if result.status == 0 else None


def by_clarabel(program: Program) -> tuple[np.ndarray, float]:
    """Solution and optimum of a quadratic program, by Clarabel."""
    up, down = np.isfinite(program.u), np.isfinite(program.l)
    sparse = qpsolvers.Problem(
        np.diag(program.P), program.c,
        np.vstack([program.G[up], -program.G[down]]),
        np.concatenate([program.u[up], -program.l[down]]),
        program.A, program.b, program.lb, program.ub,
    )  # fmt: skip
    x = qpsolvers.solve_problem(
        as_sparse(sparse), "clarabel", tol_gap_abs=1e-11, tol_gap_rel=1e-11
    ).x
    assert x is not None
    return x, float(0.5 * x @ (program.P * x) + program.c @ x)


def as_sparse(problem: qpsolvers.Problem) -> qpsolvers.Problem:
    """The same problem with sparse matrices."""
    return qpsolvers.Problem(
        csc_matrix(problem.P), problem.q, csc_matrix(problem.G), problem.h,
        csc_matrix(problem.A), problem.b, problem.lb, problem.ub,
    )  # fmt: skip


@settings(max_examples=100)
@given(SEEDS, st.booleans(), st.floats(0.01, 100.0))
def test_any_multipliers_prove_a_lower_bound(seed, quadratic, size):
    program = random_program(seed, quadratic=quadratic)
    rng = np.random.default_rng(seed + 1)
    optimum = by_clarabel(program)[1] if quadratic else by_linprog(program)
    assert optimum is not None
    bound = program.dual_bound(size * rng.normal(size=2), size * rng.normal(size=5))
    assert bound <= optimum + 1e-7


@settings(max_examples=60)
@given(SEEDS, st.booleans())
def test_the_bound_of_optimal_multipliers_is_tight(seed, quadratic):
    program = random_program(seed, quadratic=quadratic)
    answer = solve(program)
    optimum = by_clarabel(program)[1] if quadratic else by_linprog(program)
    assert answer.outcome is Outcome.SOLVED
    assert answer.value == pytest.approx(optimum, abs=1e-6)
    assert program.dual_bound(answer.y, answer.z) == pytest.approx(optimum, abs=1e-6)
    assert program.residual(answer.x) <= 1e-7
    assert program.value(answer.x) == pytest.approx(answer.value, abs=1e-12)


@settings(max_examples=60)
@given(SEEDS, st.floats(0.01, 100.0))
def test_no_multipliers_prove_a_feasible_program_infeasible(seed, size):
    program = random_program(seed)
    rng = np.random.default_rng(seed + 1)
    y, z = size * rng.normal(size=2), size * rng.normal(size=5)
    assert program.infeasibility_bound(y, z) <= 1e-12


@settings(max_examples=60)
@given(SEEDS, st.booleans())
def test_the_elastic_program_tells_feasible_from_infeasible(seed, feasible):
    relaxed = elastic_program(random_program(seed, feasible=feasible))
    violation = by_linprog(relaxed)
    assert violation is not None
    if feasible:
        assert violation == pytest.approx(0.0, abs=1e-9)
    else:
        # A_0 x = b_0 and A_0 x <= b_0 - 0.1 are 0.05 apart at best.
        assert violation >= 0.05 - 1e-9
    answer = solve(relaxed)
    assert answer.outcome is Outcome.SOLVED
    assert answer.bound == pytest.approx(violation, abs=1e-6)


def test_a_cone_is_violated_by_what_its_first_entry_lacks():
    fixed = np.array([1.0, 3.0, 4.0])
    one = Program(
        P=np.zeros(3), c=np.zeros(3), A=np.zeros((0, 3)), b=np.zeros(0), G=np.eye(3),
        l=np.zeros(3), u=np.zeros(3), lb=fixed, ub=fixed, box=np.array([fixed, fixed]),
        cone_count=1,
    )  # fmt: skip
    answer = solve(elastic_program(one))
    assert answer.outcome is Outcome.SOLVED
    assert answer.value == pytest.approx(5.0 - 1.0, abs=1e-6)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("seed", range(5))
def test_infeasibility_is_proven(seed, solver):
    program = random_program(seed, feasible=False)
    assert by_linprog(program) is None
    answer = solve(program, solver)
    assert answer.outcome is Outcome.INFEASIBLE
    assert answer.x.size == 0
    violation = by_linprog(elastic_program(program))
    assert violation is not None
    assert 0.0 < answer.proof <= violation + 1e-6


def test_a_solver_whose_multipliers_prove_infeasibility_is_asked_once():
    program = random_program(1, feasible=False)
    proof, asked = solve(program), []

    def backend(asked_for):
        asked.append(asked_for)
        return np.zeros(len(program.c)), proof.y, proof.z

    answer = checked_answer(program, backend, "", np.inf)
    assert answer.outcome is Outcome.INFEASIBLE
    assert len(asked) == 1


def test_many_optima_along_free_variables_come_to_an_end():
    """HiGHS goes on for ever with this program, so that a process of its own asks."""
    A = np.array(
        [[0, 0, 0, 0, 0, 0, -1], [0.3, 0, 0, 0, 0, 0, 0], [0, 1, 0, 1, 0, 0, 0],
         [0.5, 0.9, 0, -0.9, 0, -0.6, 0], [0, 0, 0.6, 0, 0.6, 0, 0], [-0.4, 0, 0.9, 0, -0.9, 0, 0]]
    )  # fmt: skip
    ub = np.full(7, np.inf)
    ub[[1, 3]] = 17.0
    none = np.zeros(0)
    program = Program(
        P=np.eye(7)[6], c=np.zeros(7), A=A, b=np.eye(6)[2], G=np.zeros((0, 7)), l=none, u=none,
        lb=-np.full(7, np.inf), ub=ub, box=np.outer([-20.0, 20.0], np.ones(7)),
    )  # fmt: skip
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        asked = pool.submit(solve, program, "highs")
        try:
            answer = asked.result(timeout=100.0)
        finally:
            for child in pool._processes.values():
                child.kill()
    assert answer.outcome is Outcome.SOLVED
    assert answer.value == pytest.approx(0.0, abs=1e-9)


def test_a_row_of_zeros_makes_another_structure(monkeypatch):
    """Where entries are is kept in whole bytes, which a few zeros more may fill."""
    first = random_program(3)
    second = replace(
        first, G=np.vstack([first.G, np.zeros(6)]), l=np.append(first.l, -np.inf),
        u=np.append(first.u, 1.0),
    )  # fmt: skip
    assert first.pattern == second.pattern
    monkeypatch.setattr(piqp_engines, "_kept", {})
    for known in (first, first, second, second, first):
        program = replace(known, A=known.A.copy(), G=known.G.copy())
        _, _, z = piqp_engines.by_piqp(program)
        assert len(z) == len(program.l)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("quadratic", [False, True])
def test_all_solvers_agree(solver, quadratic):
    for seed in range(5):
        program = random_program(seed, quadratic=quadratic)
        optimum = by_clarabel(program)[1] if quadratic else by_linprog(program)
        answer = solve(program, solver)
        assert answer.outcome is Outcome.SOLVED
        assert answer.solver == solver
        assert answer.value == pytest.approx(optimum, abs=1e-6)


def test_bounds_that_exclude_each_other_are_infeasible():
    program = random_program(0)
    low, high = program.lb.copy(), program.ub.copy()
    low[2], high[2] = 0.5, 0.4
    assert solve(program.with_bounds(low, high)).outcome is Outcome.INFEASIBLE


def test_a_cutoff_below_the_optimum_counts_as_infeasible():
    program = random_program(1)
    optimum = by_linprog(program)
    assert optimum is not None
    assert solve(program, cutoff=optimum - 0.1).outcome is Outcome.INFEASIBLE
    assert solve(program, cutoff=optimum + 0.1).outcome is Outcome.SOLVED


def regularised_margin(
    problem: QuasistaticProblem, mode: SlidingMode, epsilon: float
) -> np.ndarray:
    """Contact forces of min -e/F + eps/2 |f/F|^2 in one mode, in (f, e) by Clarabel, unscaled."""
    load = problem.scales.force
    size = 3 * problem.contact_count
    kept = np.diag(problem.D_star) == 0.0
    signs = mode.signs.ravel()
    cones = np.repeat(problem.has_cone, 2)
    signed = cones & (signs != 0)
    silent = cones & (signs == 0)
    rows = [
        np.hstack([problem.H.T[kept], np.ones((kept.sum(), 1))]),
        np.hstack([-problem.N.T, np.ones((problem.contact_count, 1))]),
        np.hstack([problem.N.T, np.ones((problem.contact_count, 1))]),
        np.hstack([(signs[:, None] * problem.T.T)[signed], np.zeros((signed.sum(), 1))]),
        np.hstack([problem.J.T, np.zeros((problem.joint_count, 1))]),
        np.hstack([-problem.J.T, np.zeros((problem.joint_count, 1))]),
        np.append(np.zeros(size), -1.0)[None],
    ]  # fmt: skip
    sides = [
        np.zeros(kept.sum()), np.zeros(problem.contact_count), problem.max_normal_force,
        np.zeros(signed.sum()),
        problem.upper_torque - problem.gravity_torques,
        problem.gravity_torques - problem.lower_torque,
        [0.0],
    ]  # fmt: skip
    equal = [problem.W, problem.T.T[silent]]
    b = [-problem.external_wrench, np.zeros(silent.sum())]
    for contact in np.flatnonzero(problem.is_sliding):
        direction = problem.kinetic_directions[contact]
        own = np.zeros((3, size))
        own[:, 3 * contact : 3 * contact + 3] = np.eye(3) - np.outer(
            direction, problem.normals[contact]
        )
        # The equation along n is empty; the two tangential ones fix the direction.
        equal.append(problem.tangents[contact].T @ own)
        b.append(np.zeros(2))
    A = np.vstack(equal)
    quadratic = qpsolvers.Problem(
        np.diag(np.append(np.full(size, epsilon / load), 0.0)), np.append(np.zeros(size), -1.0),
        np.vstack(rows), np.concatenate(sides),
        np.hstack([A, np.zeros((len(A), 1))]), np.concatenate(b), None, None,
    )  # fmt: skip
    x = qpsolvers.solve_problem(
        as_sparse(quadratic), "clarabel", tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12
    ).x
    assert x is not None
    return x[:-1].reshape(-1, 3)


@pytest.mark.parametrize("epsilon", [1e-2, 0.3])
@pytest.mark.parametrize("name", ["sphere", "rest", "up"])
def test_the_regularised_optimum_is_that_of_an_independent_solve(name, epsilon):
    problem = scene(name)
    solution = maximize_margin(problem, regularization=epsilon)
    assert solution.found
    expected = regularised_margin(problem, solution.mode, epsilon)
    np.testing.assert_allclose(solution.contact_forces, expected, atol=2e-3)
    scale = problem.scales.force

    def objective(forces):
        return -problem.margin_of(forces) / scale + 0.5 * epsilon * (forces**2).sum() / scale**2

    assert objective(solution.contact_forces) == pytest.approx(objective(expected), abs=1e-6)


@pytest.mark.parametrize(
    ("algorithm", "arguments", "epsilon"),
    [
        (maximize_margin, cuboid_arguments(), 0.1),
        (maximize_margin, cuboid_arguments(-1.0), 0.5),
        (minimize_torque, sphere_arguments(), 1.0),
        (minimize_torque, sphere_arguments(), 10.0),
    ],
)
def test_one_epsilon_means_the_same_at_5_newton_and_at_50(algorithm, arguments, epsilon):
    large = QuasistaticProblem(**arguments, max_normal_force=50.0, torque_limits=(-10.0, 10.0))
    light = {**arguments, "external_wrench": 0.1 * np.array(arguments["external_wrench"])}
    small = QuasistaticProblem(**light, max_normal_force=5.0, torque_limits=(-1.0, 1.0))
    required = [{}, {}] if algorithm is maximize_margin else [{"margin": 0.5}, {"margin": 0.05}]
    one = algorithm(large, regularization=epsilon, **required[0])
    two = algorithm(small, regularization=epsilon, **required[1])
    plain = algorithm(large, **required[0])
    np.testing.assert_allclose(0.1 * one.contact_forces, two.contact_forces, atol=1e-3)
    assert two.margin == pytest.approx(0.1 * one.margin, rel=1e-4)
    assert two.max_torque == pytest.approx(0.1 * one.max_torque, rel=1e-4)
    assert np.abs(one.contact_forces - plain.contact_forces).max() > 0.1


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_solves_the_regularised_program(solver):
    problem = scene("rest")
    expected = maximize_margin(problem, regularization=0.1)
    solution = maximize_margin(problem, regularization=0.1, solver=solver)
    if solver != "highs":
        assert solution.certificate.solver == solver
    np.testing.assert_allclose(solution.contact_forces, expected.contact_forces, atol=1e-3)


@pytest.mark.parametrize("search", ["auto", "enumerate"])
@settings(max_examples=25)
@given(seed=SEEDS)
def test_the_certificate_bounds_the_optimum(seed, search):
    problem = random_problem(seed, 3, slides=seed % 3)
    largest = maximize_margin(problem, search=search)
    assume(largest.found)
    proof = largest.certificate
    assert proof.bound >= largest.margin - 1e-6
    assert proof.bound - largest.margin <= 1e-5
    assert abs(proof.gap) <= 1e-5 and abs(proof.duality_gap) <= 1e-6
    assert proof.primal_residual <= 1e-7
    smallest = minimize_torque(problem, 0.5 * largest.margin, search=search)
    assert smallest.found
    assert smallest.certificate.bound <= smallest.max_torque + 1e-6
    assert smallest.max_torque - smallest.certificate.bound <= 1e-5


def test_rows_that_highs_does_not_take_are_no_program(monkeypatch):
    """It drops them and says so in its status alone."""
    monkeypatch.setattr("graspless_pin.solvers.simplex.core", None)
    simplex = Simplex(np.ones(1), np.zeros(1), np.full(1, np.inf))
    simplex.add_rows(np.full((1, 1), 1e16), np.ones(1), np.full(1, np.inf))
    assert simplex.solves == 0
    assert simplex.solve().outcome is SimplexOutcome.FAILED
    assert simplex.solves == 1
