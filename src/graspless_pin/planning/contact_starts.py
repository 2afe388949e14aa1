"""Warm starts by contacts: what was learned of states serves in others with the same contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from graspless_pin.algorithms.batch_optimum import (
    WarmOptimum,
    WarmStart,
    solution_of_optimum,
    warm_optimum,
)
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.warm_search import COLD_START, solve_from
from graspless_pin.caching import Bounded
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.programs.objectives import Objective
from graspless_pin.solution import TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.holding.small_motions import RestModel

_MOST_CONTACT_SETS = 256
_MOST_MISSES = 8
_MOST_STARTS = 8
"""Warm starts of one set of contacts: trying one costs a tenth of a solver's answer."""


class ContactStarts:
    """Warm starts for the same contacts, tried in the order of their success.

    Attributes:
        for_loops: As the loops take them, that which served last first.
        misses: How many states in a row the loops did not find, or were not asked for since.
    """

    def __init__(self) -> None:
        """Begin with nothing learned."""
        self.for_loops: list[Any] = []
        self.misses = 0
        self._starts: tuple[WarmStart, ...] = ()
        self._learned: WarmStart | None = None
        self._last: WarmStart | None = None

    @property
    def best(self) -> WarmStart:
        """What served last, or was learned since."""
        return self._starts[0] if self._starts else COLD_START

    def optimum(
        self, problem: QuasistaticProblem, objective: Objective, options: SolveOptions
    ) -> WarmOptimum | None:
        """Return the optimum that something learned leads to; None: nothing does.

        Args:
            problem: The problem.
            objective: What is optimised.
            options: How it is solved.
        """
        starts = self._starts
        found = warm_optimum(problem, objective, options, starts)
        if found is None:
            return None
        optimum, place = found
        if place:
            self._starts = (starts[place], *starts[:place], *starts[place + 1 :])
        return optimum

    def searched(
        self,
        problem: QuasistaticProblem,
        objective: Objective,
        options: SolveOptions,
        rest: RestModel | None = None,
    ) -> TorqueSolution:
        """Solve a problem by a search that begins with what served last, and learn from it.

        Args:
            problem: See `optimum`.
            objective: See `optimum`.
            options: See `optimum`.
            rest: See `solve_problem`.
        """
        solution, learned = solve_from(problem, objective, options, self.best, rest)
        self.learn(learned)
        return solution

    def solved(
        self,
        problem: QuasistaticProblem,
        objective: Objective,
        options: SolveOptions,
        rest: RestModel | None = None,
    ) -> TorqueSolution:
        """Return the solution: by a warm start if one leads to it, else by a search.

        The arguments are those of `searched`.
        """
        found = self.optimum(problem, objective, options)
        if found is None:
            return self.searched(problem, objective, options, rest)
        return solution_of_optimum(problem, objective, options.rules, found)

    def learn(self, learned: WarmStart) -> None:
        """Keep what a search has left behind."""
        others = [start for start in self._starts if start.structure is not None]
        self._learned = learned
        self._starts = (learned, *others[: _MOST_STARTS - 1])

    def new_for_loops(self) -> WarmStart | None:
        """Return what a search has learned since the last time; None: nothing."""
        new = None if self._learned is self._last else self._learned
        self._last = self._learned
        return new

    def is_due(self) -> bool:
        """Return whether to ask the loops: of contacts that they often miss, now and then only."""
        if self.misses < _MOST_MISSES or self.misses % _MOST_MISSES == 0:
            return True
        self.misses += 1
        return False

    def count(self, found: int) -> None:
        """Take note of how many states the loops found before one was not."""
        self.misses = 0 if found else self.misses + 1


class StartsByContacts:
    """What was learned, by contacts. Threads may share it."""

    def __init__(self) -> None:
        """Begin with nothing learned."""
        self._known: dict[tuple[Any, ...], ContactStarts] = Bounded(_MOST_CONTACT_SETS)

    def for_contacts(
        self, bodies: tuple[Any, ...], problem: QuasistaticProblem, objective: Objective
    ) -> ContactStarts:
        """Return what is learned of the contacts of a problem.

        Args:
            bodies: What the object touches.
            problem: The problem; which contacts slide counts, too.
            objective: What is optimised.
        """
        key = objective.algorithm or objective, bodies, problem.is_sliding.tobytes()
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = ContactStarts()
        return known
