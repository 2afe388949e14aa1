"""ProxQP through its own interface, and any other solver through qpsolvers."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import qpsolvers
import scipy.sparse
from numpy.typing import NDArray
from proxsuite import proxqp  # pyright: ignore[reportMissingImports] - compiled, path hook

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.answers import Backend, Multipliers, without_fixed
from graspless_pin.programs.program import Program
from graspless_pin.solvers.piqp_engines import SOLVER_TOLERANCE

_OPTIONS: dict[str, dict[str, Any]] = {
    "clarabel": {
        "tol_gap_abs": SOLVER_TOLERANCE,
        "tol_gap_rel": SOLVER_TOLERANCE,
        "tol_feas": SOLVER_TOLERANCE,
    },
    "highs": {
        "primal_feasibility_tolerance": 1e-10,
        "dual_feasibility_tolerance": 1e-10,
        # It does not end if free variables without curvature leave many optima.
        "qp_iteration_limit": 10_000,
    },
}
_SPARSE_SOLVERS = ("highs", "clarabel", "osqp", "scs")


def by_proxqp(program: Program) -> Multipliers:
    """Return ProxQP's answer by its object interface: its one-shot call misjudges feasible LPs."""
    reduced, kept = without_fixed(program)
    n, m = reduced.A.shape[1], len(reduced.A)
    bounded = np.flatnonzero(np.isfinite(reduced.lb) | np.isfinite(reduced.ub))
    rows = np.vstack([reduced.G, np.eye(n)[bounded]])
    infinity = 1e20
    low = np.clip(np.concatenate([reduced.l, reduced.lb[bounded]]), -infinity, infinity)
    high = np.clip(np.concatenate([reduced.u, reduced.ub[bounded]]), -infinity, infinity)
    engine = proxqp.dense.QP(n, m, len(rows))
    engine.settings.eps_abs = SOLVER_TOLERANCE
    engine.settings.eps_rel = 0.0
    # Feasible programs take some twenty iterations; only infeasible ones take more.
    engine.settings.max_iter, engine.settings.max_iter_in = 60, 50
    # Its own test calls feasible LPs infeasible: infeasibility is proven by the elastic program.
    engine.settings.eps_primal_inf = engine.settings.eps_dual_inf = 0.0
    engine.settings.default_mu_in = engine.settings.default_mu_eq = 1e-2
    engine.init(np.diag(reduced.P), reduced.c, reduced.A, reduced.b, rows, low, high)
    engine.solve()
    x, y, z = (np.array(part) for part in (engine.results.x, engine.results.y, engine.results.z))
    return _with_fixed_variables(x, kept), y, z[: len(reduced.G)]


def by_qpsolvers(name: str) -> Backend:
    """Return a backend that calls a solver by its name in qpsolvers."""

    def backend(program: Program) -> Multipliers | None:
        reduced, kept = without_fixed(program)
        up, down = np.isfinite(reduced.u), np.isfinite(reduced.l)
        rows = np.vstack([reduced.G[up], -reduced.G[down]])
        sides = np.concatenate([reduced.u[up], -reduced.l[down]])
        as_matrix = scipy.sparse.csc_matrix if name in _SPARSE_SOLVERS else np.ascontiguousarray
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
        if solution.x is None:
            return None
        y = np.zeros(len(reduced.A)) if solution.y is None or not has_equalities else solution.y
        z = np.zeros(len(reduced.G))
        if solution.z is not None and has_rows and len(solution.z) == len(rows):
            z[up] += solution.z[: up.sum()]
            z[down] -= solution.z[up.sum() :]
        return _with_fixed_variables(solution.x, kept), np.asarray(y), z

    return backend


def _with_fixed_variables(x: FloatArray, kept: NDArray[np.bool_] | None) -> FloatArray:
    """Return a solution of `without_fixed` with zeros for the variables that it dropped."""
    if kept is None:
        return x
    full = np.zeros(len(kept))
    full[kept] = x
    return full
