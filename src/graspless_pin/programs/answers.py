"""What is proven of a program: answers that were checked, whoever gave them.

No solver's status is believed. An answer counts when it meets the constraints and its own
multipliers prove it optimal; infeasibility counts when multipliers prove it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.program import Program, elastic

PRIMAL_TOLERANCE = 1e-7
"""Largest accepted violation of a constraint, in scaled units."""
GAP_TOLERANCE = 1e-7
"""Largest accepted distance between an objective and its proven bound, in scaled units."""
_INFEASIBLE = 1e-8

Multipliers = tuple[FloatArray, FloatArray, FloatArray]
"""A solution x with multipliers of the equalities and of the rows, as a solver left them."""
Backend = Callable[[Program], Multipliers | None]
"""A solver: what it found, or None if that is nothing finite."""


class Outcome(Enum):
    """What is proven of a program."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass(frozen=True, eq=False)
class Answer:
    """A checked answer to a program.

    Attributes:
        outcome: What is proven.
        x: (n,) solution; empty unless solved.
        y: (m,) multipliers of the equalities (of the elastic program's rows if infeasible).
        z: (k,) multipliers of the inequality rows, positive on the upper side.
        value: Objective at x; inf unless solved.
        bound: Proven lower bound on the objective.
        residual: Largest violation of a constraint at x, scaled units.
        proof: Proven lower bound on the smallest common violation of all rows; > 0 if infeasible.
        solver: Name of the solver whose answer passed.
    """

    outcome: Outcome
    x: FloatArray
    y: FloatArray
    z: FloatArray
    value: float
    bound: float
    residual: float
    proof: float
    solver: str

    @property
    def gap(self) -> float:
        """Objective minus proven bound."""
        return self.value - self.bound

    def moved(self, x: FloatArray, value: float, residual: float) -> Answer:
        """Return the answer with another point and what holds there; multipliers and bound stay."""
        return Answer(
            self.outcome, x, self.y, self.z, value, self.bound, residual, self.proof, self.solver
        )


def checked_answer(program: Program, backend: Backend, name: str, cutoff: float) -> Answer:
    """Ask a solver and say what its answer proves.

    Args:
        program: The program.
        backend: The solver.
        name: Its name.
        cutoff: A value above which solutions are of no interest: a proven bound above it counts
            as infeasible.

    Returns:
        A solved or infeasible answer, or a failed one with the bound that is proven all the same.
    """
    raw = backend(program)
    if raw is None:
        return failed(-np.inf)
    answer = proven(program, raw, name, cutoff)
    if answer.outcome is not Outcome.FAILED:
        return answer
    _, y, z = raw
    proof = program.infeasibility_bound(y, z)
    if proof <= _INFEASIBLE:
        proof = _elastic_proof(program, backend)
    return _infeasible(np.inf, proof, name) if proof > _INFEASIBLE else answer


def proven(program: Program, found: Multipliers, name: str, cutoff: float) -> Answer:
    """Say what a solution and its multipliers prove by themselves.

    Args:
        program: The program.
        found: What is said to be optimal.
        name: Who says so.
        cutoff: As in `checked_answer`.

    Returns:
        A solved answer, or an infeasible one where the bound is above the cutoff, or a failed one.
    """
    x, y, z = found
    bound, value, residual = program.judged(x, y, z)
    if bound > cutoff + _INFEASIBLE:
        return _infeasible(bound, max(program.infeasibility_bound(y, z), 0.0), name)
    if value - bound <= GAP_TOLERANCE and residual <= PRIMAL_TOLERANCE:
        return Answer(Outcome.SOLVED, x, y, z, value, bound, residual, 0.0, name)
    return failed(bound)


def failed(bound: float) -> Answer:
    """Return the answer that no solver gave, with a bound that is proven all the same."""
    empty = np.zeros(0)
    return Answer(Outcome.FAILED, empty, empty, empty, np.inf, bound, np.inf, 0.0, "")


def _infeasible(bound: float, proof: float, name: str) -> Answer:
    empty = np.zeros(0)
    return Answer(Outcome.INFEASIBLE, empty, empty, empty, np.inf, bound, np.inf, proof, name)


def _elastic_proof(program: Program, backend: Backend) -> float:
    """Return the proven smallest common violation of all rows, from the elastic program."""
    relaxed = elastic(program)
    raw = backend(relaxed)
    return -np.inf if raw is None else relaxed.dual_bound(raw[1], raw[2])
