"""From one state of a scene to its answer, by what was learned of others where that will do."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from graspless_pin.algorithms.carried import Carried, WarmStart, carried, solution_carried
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search import closeness
from graspless_pin.algorithms.warm_start import COLD_START, reaches_margin, solve_from
from graspless_pin.planning.configurations import Configurations
from graspless_pin.planning.evaluation import Evaluation, StateStatus
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene import Scene
from graspless_pin.scene.plain_problems import PlainProblems
from graspless_pin.scene.scene_stability import unknown_of
from graspless_pin.solution import Status, TorqueSolution

_MOST_KEPT = 256
_MOST_ALIKE = 8
"""Warm starts of one set of contacts: trying one costs a tenth of a solver's answer."""
_UNDECIDED = (Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED, Status.STRONG_NOT_FOUND)

_Contacts = tuple[Any, ...]
"""What must be alike for what was learned of one state to serve in another."""


class CarriedState(NamedTuple):
    """A state whose optimum was carried over.

    Attributes:
        problem: Its problem, or what loops read of it.
        optimum: The optimum.
        start: What it was carried over from.
    """

    problem: QuasistaticProblem
    optimum: Carried
    start: WarmStart


class StateSolver:
    """Solves states of one scene and learns from each.

    Warm starts are kept by contacts and tried in the order of their success. Threads may share it;
    what it has learned stays behind where it is pickled.

    Attributes:
        configurations: The states that the scene can be put into.
        objective: What is optimised.
        options: How.
    """

    def __init__(
        self, configurations: Configurations, objective: Objective, options: SolveOptions
    ) -> None:
        """Begin with nothing learned."""
        self.configurations = configurations
        self.objective = objective
        self.options = options
        self._starts: dict[_Contacts, tuple[WarmStart, ...]] = {}
        self._plain = PlainProblems(configurations.scene)

    def __getstate__(self) -> dict[str, Any]:
        """Return what was given: what was learned is learned again elsewhere."""
        plain = PlainProblems(self.configurations.scene)
        return {**self.__dict__, "_starts": {}, "_plain": plain}

    def answer(self, q: Any, T_world_object: Any, twist: Any) -> Evaluation | CarriedState:
        """Solve for one state, with as few records as can be: see `Evaluator.evaluate`."""
        found = self._carried_at(q, T_world_object, twist, self.objective)
        if found is not None:
            return found
        solved = self._solved(q, T_world_object, twist)
        return solved if isinstance(solved, Evaluation) else solved[1]

    def evaluate(self, q: Any, T_world_object: Any, twist: Any) -> Evaluation:
        """Return the whole answer for one state: see `Evaluator.evaluate`."""
        solved = self._solved(q, T_world_object, twist)
        if isinstance(solved, Evaluation):
            return solved
        scene, (problem, optimum, start) = solved
        rules = self.options.rules
        return _evaluation(scene, solution_carried(problem, self.objective, rules, optimum, start))

    def _solved(
        self, q: Any, T_world_object: Any, twist: Any
    ) -> Evaluation | tuple[Scene, CarriedState]:
        """Solve for one state; what a search finds is learned."""
        state = self.configurations.problem_at(q, T_world_object, twist)
        if isinstance(state, Evaluation):
            return state
        scene, problem = state
        bodies = scene.contacts.bodies
        found = self._carried(bodies, problem, self.objective)
        if found is not None:
            return scene, found
        contacts = _contacts(bodies, problem, self.objective)
        solution, learned = solve_from(
            problem, self.objective, self.options, self._best(contacts), self._unknown(scene)
        )
        self._learn(contacts, learned)
        self._plain.learn(scene, problem)
        return _evaluation(scene, solution)

    def reaches(self, q: Any, T_world_object: Any, twist: Any, margin: float) -> bool:
        """Tell whether a state is proven to reach a margin: see `Evaluator.is_feasible`."""
        objective = Margin()
        found = self._carried_at(q, T_world_object, twist, objective)
        if found is None:
            state = self.configurations.problem_at(q, T_world_object, twist)
            if isinstance(state, Evaluation):
                return False
            scene, problem = state
            found = self._carried(scene.contacts.bodies, problem, objective)
            if found is None:
                contacts = _contacts(scene.contacts.bodies, problem, objective)
                reached, learned = reaches_margin(
                    problem, margin, self.options, self._best(contacts), self._unknown(scene)
                )
                self._learn(contacts, learned)
                self._plain.learn(scene, problem)
                return bool(reached)
        goal = margin / abs(found.optimum.unit)
        return found.optimum.value <= closeness(goal) - goal

    def _carried_at(
        self, q: Any, T_world_object: Any, twist: Any, objective: Objective
    ) -> CarriedState | None:
        """Return the optimum of a state that differs in an array of positions alone, if it can."""
        if T_world_object is not None or twist is not None or not isinstance(q, np.ndarray):
            return None
        plain = self._plain.at(q)
        return None if plain is None else self._carried(plain[0], plain[1].as_problem, objective)

    def _unknown(self, scene: Scene) -> str:
        return unknown_of(scene) if self.options.strong else ""

    def _best(self, contacts: _Contacts) -> WarmStart:
        """Return what served last, or was learned since."""
        starts = self._starts.get(contacts)
        return starts[0] if starts else COLD_START

    def _carried(
        self,
        bodies: tuple[str, ...],
        problem: QuasistaticProblem,
        objective: Objective,
    ) -> CarriedState | None:
        """Return the optimum that something learned of the same contacts leads to."""
        contacts = _contacts(bodies, problem, objective)
        starts = self._starts.get(contacts, ())
        found = carried(problem, objective, self.options, starts)
        if found is None:
            return None
        optimum, place = found
        if place:
            others = starts[:place] + starts[place + 1 :]
            self._starts[contacts] = (starts[place], *others)
        return CarriedState(problem, optimum, starts[place])

    def _learn(self, contacts: _Contacts, learned: WarmStart) -> None:
        if len(self._starts) >= _MOST_KEPT:
            self._starts = {}
        before = self._starts.get(contacts, ())
        others = [start for start in before if start.likeness is not None]
        self._starts[contacts] = (learned, *others[: _MOST_ALIKE - 1])


def _contacts(
    bodies: tuple[str, ...], problem: QuasistaticProblem, objective: Objective
) -> _Contacts:
    return objective.algorithm, bodies, problem.is_sliding.tobytes()


def _evaluation(scene: Scene, solution: TorqueSolution) -> Evaluation:
    if solution.found:
        return Evaluation(StateStatus.FOUND, "", scene, solution)
    undecided = solution.status in _UNDECIDED
    status = StateStatus.UNDECIDED if undecided else StateStatus.INFEASIBLE
    return Evaluation(status, solution.status.message, scene, solution)
