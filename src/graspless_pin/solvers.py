"""The only module that knows a solver library: solve a program and have the answer checked.

Where a solver's answer fails the check another solver is asked.
"""

from __future__ import annotations

import math
import warnings
from functools import cache
from threading import Lock
from typing import Any

import highspy
import numpy as np
import piqp
import qpsolvers
import scipy.sparse
from numpy.typing import NDArray
from proxsuite import proxqp  # pyright: ignore[reportMissingImports] - compiled, path hook

from graspless_pin.errors import SolverUnavailableError
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.answers import (
    PRIMAL_TOLERANCE,
    Answer,
    Backend,
    Multipliers,
    Outcome,
    checked_answer,
    failed,
)
from graspless_pin.programs.mode_program import ModeProgram
from graspless_pin.programs.program import Program, restored

__all__ = [
    "PRIMAL_TOLERANCE",
    "Answer",
    "Outcome",
    "available_solvers",
    "check_solver",
    "solve",
    "solve_mixed_integer",
]

_SOLVER_TOLERANCE = 1e-10
# Programs are well scaled: interior points may go closer to the boundary than PIQP's default.
_STEP_TO_BOUNDARY = 0.995
_FIRST_ITERATIONS = 20
_MOST_ITERATIONS = 250
_FALLBACKS = ("piqp", "highs", "clarabel", "proxqp")


@cache
def available_solvers() -> tuple[str, ...]:
    """Return the names that can be given as ``solver``."""
    return tuple(sorted({"piqp", "proxqp", *qpsolvers.available_solvers}))


def check_solver(name: str) -> str:
    """Return the name if such a solver is installed.

    Raises:
        SolverUnavailableError: Naming the solvers that are.
    """
    if name not in available_solvers():
        raise SolverUnavailableError(
            f"solver: {name!r} is not installed; available: {', '.join(available_solvers())}"
        )
    return name


def solve(program: Program, solver: str = "piqp", *, cutoff: float = np.inf) -> Answer:
    """Solve a program, check the answer and prove infeasibility.

    Args:
        program: The program.
        solver: The solver to ask first.
        cutoff: A value above which solutions are of no interest: a proven bound above it counts
            as infeasible.

    Returns:
        A solved, infeasible or failed answer; never an unchecked one.
    """
    cutoff = min(cutoff, program.worst)
    best_bound = -np.inf
    for name in _in_turn(solver):
        backend = _BACKENDS.get(name) or _by_qpsolvers(name)
        answer = checked_answer(program, backend, name, cutoff)
        if answer.outcome is not Outcome.FAILED:
            return answer
        best_bound = max(best_bound, answer.bound)
    return failed(best_bound)


@cache
def _in_turn(solver: str) -> tuple[str, ...]:
    """The solvers to ask, one after the other."""
    return (solver, *(other for other in _FALLBACKS if other != solver))


def _finite(*arrays: FloatArray) -> bool:
    return all(np.isfinite(array).all() for array in arrays)


class _Engine:
    """A PIQP solver that is kept for programs of one structure and told only what changes.

    Sparse, since each row but the balance knows one finger's or one contact's forces, and without
    scaling of its own, since programs are scaled: so no answer depends on what it solved before.
    """

    def __init__(self, program: Program) -> None:
        """Set up for a program and all of its structure."""
        n = len(program.c)
        self._A, self._filled_A = _columns(program.A)
        self._G, self._filled_G = _columns(program.G)
        self._P = scipy.sparse.csc_matrix((program.P.copy(), np.arange(n), np.arange(n + 1)))
        self._known = _arrays(program)
        self._piqp = piqp.SparseSolver()
        settings = self._settings = self._piqp.settings
        settings.kkt_solver = piqp.KKTSolver.sparse_ldlt_ineq_cond
        settings.preconditioner_iter = 0
        settings.eps_abs = settings.eps_rel = _SOLVER_TOLERANCE
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = _SOLVER_TOLERANCE
        settings.tau = _STEP_TO_BOUNDARY
        self._piqp.setup(
            self._P,
            program.c,
            self._A,
            program.b,
            self._G,
            program.l,
            program.u,
            program.lb,
            program.ub,
        )

    def holds(self, program: Program) -> bool:
        """Whether the matrices of the program are those that were loaded last."""
        return self._known[4] is program.G and self._known[2] is program.A

    def load(self, program: Program) -> None:
        """Turn to another program of the same structure, or to other bounds of the same one."""
        P, c, A, b, G, low, high, lb, ub = self._known
        changed: dict[str, Any] = {}
        if program.lb is not lb or program.ub is not ub:
            changed["x_l"], changed["x_u"] = program.lb, program.ub
        if program.c is not c:
            changed["c"] = program.c
        if program.b is not b:
            changed["b"] = program.b
        if program.l is not low or program.u is not high:
            changed["h_l"], changed["h_u"] = program.l, program.u
        if program.P is not P:
            self._P.data[:] = program.P
            changed["P"] = self._P
        if program.A is not A:
            self._A.data[:] = program.A.T.ravel()[self._filled_A]
            changed["A"] = self._A
        if program.G is not G:
            self._G.data[:] = program.G.T.ravel()[self._filled_G]
            changed["G"] = self._G
        if changed:
            self._piqp.update(**changed)
            self._known = _arrays(program)

    def solve(self, program: Program) -> Multipliers | None:
        """Solve, and stop early where the multipliers already prove that nothing is feasible.

        A feasible program takes some ten iterations; on an infeasible one the multipliers grow
        until the iteration limit, long after they have become a proof.
        """
        self._settings.max_iter = _FIRST_ITERATIONS
        status, result = self._piqp.solve(), self._piqp.result
        if status == piqp.PIQP_MAX_ITER_REACHED and not (
            program.dual_bound(result.y, result.z_u - result.z_l) > program.worst
        ):
            self._settings.max_iter = _MOST_ITERATIONS
            self._piqp.solve()
        # Bounds that meet are met to the solver's tolerance: the answer meets them exactly.
        x = np.minimum(np.maximum(result.x, program.lb), program.ub)
        y, z = np.array(result.y), result.z_u - result.z_l
        # One sum tells whether any entry is not finite.
        return (x, y, z) if math.isfinite(x @ x + y @ y + z @ z) else None


def _arrays(program: Program) -> tuple[FloatArray, ...]:
    return (
        program.P, program.c, program.A, program.b, program.G, program.l, program.u,
        program.lb, program.ub,
    )  # fmt: skip


def _columns(matrix: FloatArray) -> tuple[Any, NDArray[np.int_]]:
    """A matrix in compressed columns, and the places of its entries, column after column."""
    filled = matrix.T != 0.0
    starts = np.concatenate([[0], np.cumsum(filled.sum(axis=1))])
    entries = matrix.T[filled], np.nonzero(filled)[1], starts
    return scipy.sparse.csc_matrix(entries, shape=matrix.shape), np.flatnonzero(filled)


class _Engines:
    """The PIQP solvers that are kept, by the structure of their programs."""

    def __init__(self) -> None:
        """Keep none yet."""
        self._lock = Lock()
        self._kept: dict[tuple[int, int, bytes], list[_Engine]] = {}

    def take(self, program: Program) -> _Engine:
        """Return an engine for the program, for this thread alone until it is put back."""
        engine = None
        with self._lock:
            kept = self._kept.setdefault(_structure(program), [])
            if kept:
                # Two, so that one stays with a problem that is asked again while others pass.
                held = [index for index, one in enumerate(kept) if one.holds(program)]
                if held or len(kept) >= _PER_STRUCTURE:
                    engine = kept.pop(held[0] if held else 0)
        if engine is None:
            return _Engine(program)
        engine.load(program)
        return engine

    def put_back(self, engine: _Engine, program: Program) -> None:
        """Keep an engine for later programs."""
        with self._lock:
            if len(self._kept) > _MOST_STRUCTURES:
                self._kept.clear()
            kept = self._kept.setdefault(_structure(program), [])
            kept.append(engine)
            del kept[:-_PER_STRUCTURE]


def _structure(program: Program) -> tuple[int, int, bytes]:
    return len(program.c), len(program.b), program.pattern


_engines = _Engines()
_PER_STRUCTURE = 2
_MOST_STRUCTURES = 32


def _piqp(program: Program) -> Multipliers | None:
    """PIQP, with a solver kept from an earlier program of the same structure if there is one."""
    engine = _engines.take(program)
    answer = engine.solve(program)
    _engines.put_back(engine, program)
    return answer


def _proxqp(program: Program) -> Multipliers | None:
    """ProxQP's object interface: its one-shot call takes feasible LPs for infeasible."""
    reduced, kept = program.without_fixed()
    n, m = reduced.A.shape[1], len(reduced.A)
    bounded = np.flatnonzero(np.isfinite(reduced.lb) | np.isfinite(reduced.ub))
    rows = np.vstack([reduced.G, np.eye(n)[bounded]])
    far = 1e20
    low = np.clip(np.concatenate([reduced.l, reduced.lb[bounded]]), -far, far)
    high = np.clip(np.concatenate([reduced.u, reduced.ub[bounded]]), -far, far)
    engine = proxqp.dense.QP(n, m, len(rows))
    engine.settings.eps_abs = _SOLVER_TOLERANCE
    engine.settings.eps_rel = 0.0
    # Feasible programs take some twenty iterations; more are spent on infeasible ones only.
    engine.settings.max_iter, engine.settings.max_iter_in = 60, 50
    # Its own test calls feasible LPs infeasible: infeasibility is proven by the elastic program.
    engine.settings.eps_primal_inf = engine.settings.eps_dual_inf = 0.0
    engine.settings.default_mu_in = engine.settings.default_mu_eq = 1e-2
    engine.init(np.diag(reduced.P), reduced.c, reduced.A, reduced.b, rows, low, high)
    engine.solve()
    x, y, z = (np.array(part) for part in (engine.results.x, engine.results.y, engine.results.z))
    return (restored(x, kept), y, z[: len(reduced.G)]) if _finite(x, y, z) else None


_OPTIONS: dict[str, dict[str, Any]] = {
    "clarabel": {
        "tol_gap_abs": _SOLVER_TOLERANCE,
        "tol_gap_rel": _SOLVER_TOLERANCE,
        "tol_feas": _SOLVER_TOLERANCE,
    },
    "highs": {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
}
_SPARSE = ("highs", "clarabel", "osqp", "scs")


def _by_qpsolvers(name: str) -> Backend:
    """Return a backend that goes through qpsolvers."""

    def backend(program: Program) -> Multipliers | None:
        reduced, kept = program.without_fixed()
        up, down = np.isfinite(reduced.u), np.isfinite(reduced.l)
        rows = np.vstack([reduced.G[up], -reduced.G[down]])
        sides = np.concatenate([reduced.u[up], -reduced.l[down]])
        as_matrix = scipy.sparse.csc_matrix if name in _SPARSE else np.ascontiguousarray
        has_rows, has_equalities = len(rows) > 0, len(reduced.A) > 0
        quadratic = qpsolvers.Problem(
            as_matrix(np.diag(reduced.P)), reduced.c,
            as_matrix(rows) if has_rows else None, sides if has_rows else None,
            as_matrix(reduced.A) if has_equalities else None,
            reduced.b if has_equalities else None,
            reduced.lb, reduced.ub,
        )  # fmt: skip
        try:
            with warnings.catch_warnings():
                # Interfaces warn of formats and statuses; the answer is checked anyway.
                warnings.simplefilter("ignore")
                solution = qpsolvers.solve_problem(quadratic, name, **_OPTIONS.get(name, {}))
        except (qpsolvers.SolverError, qpsolvers.ProblemError, qpsolvers.ParamError):
            return None
        if solution.x is None or not _finite(solution.x):
            return None
        y = np.zeros(len(reduced.A)) if solution.y is None or not has_equalities else solution.y
        z = np.zeros(len(reduced.G))
        if solution.z is not None and has_rows and len(solution.z) == len(rows):
            z[up] += solution.z[: up.sum()]
            z[down] -= solution.z[up.sum() :]
        return (restored(solution.x, kept), np.asarray(y), z) if _finite(y, z) else None

    return backend


_BACKENDS: dict[str, Backend] = {"piqp": _piqp, "proxqp": _proxqp}


def solve_mixed_integer(
    program: ModeProgram, time_limit: float | None = None
) -> tuple[FloatArray | None, float, bool]:
    """Solve a mixed-integer program with HiGHS.

    Args:
        program: The program.
        time_limit: Seconds; None: no limit.

    Returns:
        The best solution (None if there is none), the proven bound on the objective, and whether
        the search was completed.
    """
    columns: Any = scipy.sparse.csc_matrix(program.G)
    model = highspy.HighsLp()
    model.num_col_, model.num_row_ = len(program.c), len(program.G)
    model.col_cost_, model.col_lower_, model.col_upper_ = program.c, program.lb, program.ub
    model.row_lower_, model.row_upper_ = program.l, program.u
    model.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    model.a_matrix_.start_ = columns.indptr
    model.a_matrix_.index_ = columns.indices
    model.a_matrix_.value_ = columns.data
    kinds = highspy.HighsVarType.kContinuous, highspy.HighsVarType.kInteger
    model.integrality_ = [kinds[int(binary)] for binary in program.binary]
    engine = highspy.Highs()
    engine.setOptionValue("output_flag", False)  # noqa: FBT003
    engine.setOptionValue("threads", 1)
    engine.setOptionValue("mip_rel_gap", 0.0)
    engine.setOptionValue("mip_abs_gap", 1e-9)
    engine.setOptionValue("mip_feasibility_tolerance", 1e-9)
    engine.setOptionValue("primal_feasibility_tolerance", 1e-9)
    if time_limit is not None:
        engine.setOptionValue("time_limit", float(time_limit))
    engine.passModel(model)
    engine.run()
    status, info = engine.getModelStatus(), engine.getInfo()
    completed = status in (
        highspy.HighsModelStatus.kOptimal,
        highspy.HighsModelStatus.kInfeasible,
    )
    has_solution = info.primal_solution_status == highspy.SolutionStatus.kSolutionStatusFeasible
    x = np.array(engine.getSolution().col_value) if has_solution else None
    return x, float(info.mip_dual_bound), completed
