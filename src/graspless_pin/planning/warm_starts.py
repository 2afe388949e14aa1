"""What was learned of states serves in others with the same contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from graspless_pin.algorithms.batch_optimum import (
    WarmOptimum,
    WarmStart,
    solution_of_optimum,
    warm_optimum,
)
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.warm_start import COLD_START, solve_from
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.programs.objectives import Objective
from graspless_pin.solution import TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.holding.small_motions import RestModel

_MOST_KEPT = 256
_MOST_MISSES = 8
_MOST_ALIKE = 8
"""Warm starts of one set of contacts: trying one costs a tenth of a solver's answer."""

_Contacts = tuple[Any, ...]
"""What must be alike for what was learned of one state to serve in another."""


class WarmState(NamedTuple):
    """A state whose optimum a warm start led to.

    Attributes:
        problem: Its problem.
        optimum: The optimum.
    """

    problem: QuasistaticProblem
    optimum: WarmOptimum


class LoopStarts:
    """What loops have learned of the same contacts.

    Attributes:
        starts: As the loops take them, that which served last first.
        last: The last that was taken from a search.
        misses: How many states in a row they did not find, or were not asked for since.
    """

    def __init__(self) -> None:
        """Begin with nothing learned."""
        self.starts: list[Any] = []
        self.last: WarmStart | None = None
        self.misses = 0

    def is_due(self) -> bool:
        """Return whether to ask the loops: of contacts that they often miss, now and then only."""
        if self.misses < _MOST_MISSES or self.misses % _MOST_MISSES == 0:
            return True
        self.misses += 1
        return False

    def count(self, found: int) -> None:
        """Take note of how many states were found before one was not."""
        self.misses = 0 if found else self.misses + 1


class WarmStarts:
    """Warm starts by contacts, tried in the order of their success. Threads may share them."""

    def __init__(self) -> None:
        """Begin with nothing learned."""
        self._starts: dict[_Contacts, tuple[WarmStart, ...]] = {}
        self._learned: dict[_Contacts, WarmStart] = {}
        self._pools: dict[_Contacts, LoopStarts] = {}

    def for_loops(
        self, bodies: tuple[Any, ...], problem: QuasistaticProblem, objective: Objective
    ) -> tuple[WarmStart | None, LoopStarts]:
        """Return what a search has learned since the last time, and what loops have.

        Args:
            bodies: See `best`.
            problem: See `best`.
            objective: See `best`.
        """
        contacts = _contacts(bodies, problem, objective)
        pool = self._pools.setdefault(contacts, LoopStarts())
        learned = self._learned.get(contacts)
        new = None if learned is pool.last else learned
        pool.last = learned
        return new, pool

    def best(
        self, bodies: tuple[Any, ...], problem: QuasistaticProblem, objective: Objective
    ) -> WarmStart:
        """Return what served last with the same contacts, or was learned since.

        Args:
            bodies: What the object touches.
            problem: The problem.
            objective: What is optimised.
        """
        starts = self._starts.get(_contacts(bodies, problem, objective))
        return starts[0] if starts else COLD_START

    def optimum(
        self,
        bodies: tuple[Any, ...],
        problem: QuasistaticProblem,
        objective: Objective,
        options: SolveOptions,
    ) -> WarmState | None:
        """Return the optimum that something learned of the same contacts leads to.

        Args:
            bodies: See `best`.
            problem: See `best`.
            objective: See `best`.
            options: How it is solved.
        """
        contacts = _contacts(bodies, problem, objective)
        starts = self._starts.get(contacts, ())
        found = warm_optimum(problem, objective, options, starts)
        if found is None:
            return None
        optimum, place = found
        if place:
            others = starts[:place] + starts[place + 1 :]
            self._starts[contacts] = (starts[place], *others)
        return WarmState(problem, optimum)

    def searched(
        self,
        bodies: tuple[Any, ...],
        problem: QuasistaticProblem,
        objective: Objective,
        options: SolveOptions,
        rest: RestModel | None = None,
    ) -> TorqueSolution:
        """Solve a problem by a search that begins with what served last, and learn from it.

        Args:
            bodies: See `best`.
            problem: See `best`.
            objective: See `best`.
            options: How it is solved.
            rest: See `solve_problem`.
        """
        start = self.best(bodies, problem, objective)
        solution, learned = solve_from(problem, objective, options, start, rest)
        self.learn(bodies, problem, objective, learned)
        return solution

    def learn(
        self,
        bodies: tuple[Any, ...],
        problem: QuasistaticProblem,
        objective: Objective,
        learned: WarmStart,
    ) -> None:
        """Keep what a search has left behind."""
        if len(self._starts) >= _MOST_KEPT:
            self._starts, self._learned, self._pools = {}, {}, {}
        contacts = _contacts(bodies, problem, objective)
        self._learned[contacts] = learned
        before = self._starts.get(contacts, ())
        others = [start for start in before if start.structure is not None]
        self._starts[contacts] = (learned, *others[: _MOST_ALIKE - 1])

    def solved(
        self,
        bodies: tuple[Any, ...],
        problem: QuasistaticProblem,
        objective: Objective,
        options: SolveOptions,
        rest: RestModel | None = None,
    ) -> TorqueSolution:
        """Return the solution: by a warm start if one leads to it, else by a search."""
        found = self.optimum(bodies, problem, objective, options)
        if found is None:
            return self.searched(bodies, problem, objective, options, rest)
        return solution_of_optimum(problem, objective, options.rules, found.optimum)


def _contacts(
    bodies: tuple[Any, ...], problem: QuasistaticProblem, objective: Objective
) -> _Contacts:
    return objective.algorithm or objective, bodies, problem.is_sliding.tobytes()
