"""Timing by ratios: what is measured and its yardstick take turns, so that noise hits both."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import lru_cache
from inspect import signature

import numpy as np
import piqp

from graspless_pin import QuasistaticProblem
from graspless_pin.algorithms.formulation import Objective, formulate
from graspless_pin.programs.program import Program
from graspless_pin.solution import Algorithm

Timer = Callable[[], float]

_MOST_ROUNDS = 15
_LEAST_ROUNDS = 3


def timed(call: Callable[[], object]) -> float:
    """Seconds that one call takes."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def timer(call: Callable[[], object]) -> Timer:
    """A function that times one call each time."""
    return lambda: timed(call)


def medians(timers: Sequence[Timer], *, budget: float) -> list[float]:
    """Median seconds of each, measured in turns.

    Args:
        timers: What to measure.
        budget: Seconds to spend, though never on fewer than three rounds; a round that alone
            takes longer than the budget is not repeated.
    """
    rounds: list[list[float]] = []
    while len(rounds) < _MOST_ROUNDS:
        rounds.append([measure() for measure in timers])
        spent = sum(map(sum, rounds))
        if spent > budget and (len(rounds) >= _LEAST_ROUNDS or len(rounds) * budget < spent):
            break
    return [float(value) for value in np.median(rounds, axis=0)]


def relaxed_program(problem: QuasistaticProblem) -> Program:
    """The relaxed LP of Algorithm 1 in forces, as the package states it."""
    objective = Objective(Algorithm.MARGIN, margin=0.0, by_limits=False, regularization=0.0)
    return formulate(problem, objective).program


def bare_solve(program: Program) -> None:
    """One dense PIQP solve, set-up included, with its default settings: the unit of the tables.

    The package itself solves with the sparse one and keeps it, so a whole search can take less.
    """
    engine = piqp.DenseSolver()
    engine.setup(
        _hessian(program),
        program.c,
        program.A,
        program.b,
        program.G,
        program.l,
        program.u,
    )  # the margin program imposes no bound on a single variable
    engine.solve()


@lru_cache(maxsize=8)
def _hessian(program: Program) -> np.ndarray:
    """diag(P), made in the first round alone: a median does not see it."""
    return np.asfortranarray(np.diag(program.P))


def as_new(problem: QuasistaticProblem) -> QuasistaticProblem:
    """A problem of the same arrays that no algorithm has seen."""
    arguments = signature(QuasistaticProblem).parameters.keys() - {"torque_limits"}
    values = {name: getattr(problem, name) for name in arguments}
    limits = problem.lower_torque, problem.upper_torque
    return QuasistaticProblem(**values, torque_limits=limits)
