"""From one state of a scene to its answer, by what was learned of others where that will do."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.algorithms.carried import solution_carried
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search import closeness
from graspless_pin.algorithms.warm_start import reaches_margin
from graspless_pin.planning.configurations import Configurations
from graspless_pin.planning.evaluation import Evaluation, StateStatus
from graspless_pin.planning.warm_starts import CarriedState, WarmStarts
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene import Scene
from graspless_pin.scene.plain_problems import PlainProblems
from graspless_pin.scene.scene_stability import unknown_of
from graspless_pin.solution import Status, TorqueSolution

_UNDECIDED = (Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED, Status.STRONG_NOT_FOUND)


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
        self._starts = WarmStarts()
        self._plain = PlainProblems(configurations.scene)

    def __getstate__(self) -> dict[str, Any]:
        """Return what was given: what was learned is learned again elsewhere."""
        plain = PlainProblems(self.configurations.scene)
        return {**self.__dict__, "_starts": WarmStarts(), "_plain": plain}

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
        found = self._starts.carried(bodies, problem, self.objective, self.options)
        if found is not None:
            return scene, found
        solution = self._starts.searched(
            bodies, problem, self.objective, self.options, self._unknown(scene)
        )
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
            what = scene.contacts.bodies, problem, objective
            found = self._starts.carried(*what, self.options)
            if found is None:
                start = self._starts.best(*what)
                reached, learned = reaches_margin(
                    problem, margin, self.options, start, self._unknown(scene)
                )
                self._starts.learn(*what, learned)
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
        if plain is None:
            return None
        return self._starts.carried(plain[0], plain[1].as_problem, objective, self.options)

    def _unknown(self, scene: Scene) -> str:
        return unknown_of(scene) if self.options.strong else ""


def _evaluation(scene: Scene, solution: TorqueSolution) -> Evaluation:
    if solution.found:
        return Evaluation(StateStatus.FOUND, "", scene, solution)
    undecided = solution.status in _UNDECIDED
    status = StateStatus.UNDECIDED if undecided else StateStatus.INFEASIBLE
    return Evaluation(status, solution.status.message, scene, solution)
