"""Call one solver after the other until an answer passes the check."""

from __future__ import annotations

from functools import cache

import numpy as np

from graspless_pin.errors import SolverUnavailableError
from graspless_pin.programs.answers import (
    Answer,
    Backend,
    Multipliers,
    Outcome,
    checked_answer,
    failed_answer,
)
from graspless_pin.programs.program import Program
from graspless_pin.solvers.conic_backends import by_clarabel, by_cuts
from graspless_pin.solvers.piqp_engines import by_piqp
from graspless_pin.suggestions import nearest_name

ANY_SOLVER = "auto"
"""PIQP for linear and quadratic programs, Clarabel for second-order ones."""
_FALLBACKS = ("piqp", "highs", "clarabel", "proxqp")
_CONIC_FALLBACKS = ("clarabel", "piqp", "highs")


def _by_proxqp(program: Program) -> Multipliers | None:
    from graspless_pin.solvers.other_backends import by_proxqp

    return by_proxqp(program)


_BACKENDS: dict[str, Backend] = {"piqp": by_piqp, "proxqp": _by_proxqp}


@cache
def available_solvers() -> tuple[str, ...]:
    """Return the valid names of ``solver`` besides ``auto``."""
    import qpsolvers

    return tuple(sorted({*_BACKENDS, *qpsolvers.available_solvers}))


def check_solver(name: str) -> str:
    """Return the name of a solver if it is installed.

    Raises:
        SolverUnavailableError: Naming the solvers that are.
    """
    if name != ANY_SOLVER and name not in available_solvers():
        closest = nearest_name(name, (ANY_SOLVER, *available_solvers()))
        meant = "" if closest is None else f"did you mean {closest!r}? "
        raise SolverUnavailableError(
            f"solver: {name!r} is unknown or not installed; {meant}available: "
            f"{', '.join(available_solvers())}"
        )
    return name


def solve(program: Program, solver: str = ANY_SOLVER, *, cutoff: float = np.inf) -> Answer:
    """Solve a program, check the answer and prove infeasibility.

    Args:
        program: The program.
        solver: The solver to call first; solvers of linear programs get second-order programs by
            tangent cuts.
        cutoff: A value above which solutions are of no interest: a proven bound above it counts
            as infeasible.

    Returns:
        A solved, infeasible or failed answer; never an unchecked one.
    """
    cutoff = min(cutoff, program.cutoff)
    best_bound = -np.inf
    names = _solver_order(solver, program.cone_count > 0)
    # A program that is not resolved can only be proven infeasible: two solvers are called at most.
    for name in names if program.is_resolved else names[:2]:
        answer = checked_answer(program, _backend(name, program.cone_count > 0), name, cutoff)
        if answer.outcome is not Outcome.FAILED:
            return answer
        best_bound = max(best_bound, answer.bound)
    return failed_answer(best_bound)


@cache
def _solver_order(solver: str, conic: bool) -> tuple[str, ...]:
    """Return the names of the solvers in the order in which to call them."""
    fallbacks = _CONIC_FALLBACKS if conic else _FALLBACKS
    if solver == ANY_SOLVER:
        return fallbacks
    return (solver, *(name for name in fallbacks if name != solver))


def _backend(name: str, conic: bool) -> Backend:
    """Return the backend of a solver for linear and quadratic, or for second-order programs."""
    if conic and name == "clarabel":
        return by_clarabel
    backend = _BACKENDS.get(name)
    if backend is None:
        from graspless_pin.solvers.other_backends import by_qpsolvers

        backend = by_qpsolvers(name)
    return by_cuts(backend) if conic else backend
