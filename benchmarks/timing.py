"""Timing by ratios: what is measured and its yardstick take turns, so that noise hits both."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from inspect import signature
from types import SimpleNamespace

import numpy as np

from graspless_pin import QuasistaticProblem
from graspless_pin.modes import kinematics

Timer = Callable[[], float]

_MOST_ROUNDS = 15
_LEAST_ROUNDS = 3
_NOTHING = SimpleNamespace()  # what a version has that keeps no motions


def timed(call: Callable[[], object], clock: Timer = time.perf_counter) -> float:
    """Seconds that one call takes by a clock."""
    start = clock()
    call()
    return clock() - start


def timer(call: Callable[[], object], clock: Timer = time.perf_counter) -> Timer:
    """A function that times one call each time."""
    return lambda: timed(call, clock)


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


def as_new(problem: QuasistaticProblem) -> QuasistaticProblem:
    """A problem of the same arrays that no algorithm has seen, nor another one like it last."""
    vars(getattr(kinematics, "_OF_THREAD", _NOTHING)).clear()
    arguments = signature(QuasistaticProblem).parameters.keys() - {"torque_limits"}
    values = {name: getattr(problem, name) for name in arguments}
    limits = problem.lower_torque, problem.upper_torque
    return QuasistaticProblem(**values, torque_limits=limits)
