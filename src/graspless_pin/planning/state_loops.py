"""Many states of one scene in loops: the hand elsewhere, and contacts found in each state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.batch_optimum import optima_of_states, state_optimum
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search import closeness
from graspless_pin.errors import StateError
from graspless_pin.planning.configurations import Configurations
from graspless_pin.planning.evaluation import STATUSES, StateStatus, WarmAnswer
from graspless_pin.planning.warm_starts import WarmStarts
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene import Scene
from graspless_pin.scene.batch_states import PlainProblems, PlainStates
from graspless_pin.scene.state_findings import StateChecks, state_findings

_FOUND = STATUSES.index(StateStatus.FOUND)


class SolvedStates(NamedTuple):
    """What warm starts found of K states; NaN and zero where nothing.

    Attributes:
        figures: (K, 6) with the columns that `core.FIGURES` names.
        torques: (K, L).
        contact_counts: (K,).
        faults: (K,) the number of the status of each state that has a serious finding; elsewhere
            that of `StateStatus.FOUND`.
        joint_names: L names of the torques.
    """

    figures: FloatArray
    torques: FloatArray
    contact_counts: NDArray[np.int32]
    faults: NDArray[np.uint8]
    joint_names: tuple[str, ...]

    @classmethod
    def room(cls, count: int, joint_names: tuple[str, ...]) -> SolvedStates:
        """Return room for states."""
        figures, torques = np.full((count, 6), np.nan), np.full((count, len(joint_names)), np.nan)
        faults = np.full(count, _FOUND, np.uint8)
        return cls(figures, torques, np.zeros(count, np.int32), faults, joint_names)

    @property
    def sound(self) -> NDArray[np.bool_]:
        """(K,) which states have no serious finding."""
        return self.faults == _FOUND

    @property
    def found(self) -> NDArray[np.bool_]:
        """(K,) where something was."""
        return self.contact_counts > 0


def refusals(
    at: Configurations, scene: Scene, checks: StateChecks
) -> Iterator[tuple[StateStatus, str]]:
    """Yield statuses and messages of what a scene is refused for in one of its states.

    Args:
        at: The states.
        scene: The scene in this one.
        checks: What is looked for.
    """
    for one in state_findings(scene, checks):
        yield StateStatus.of(one), one.message
    deep = at.overlap(scene) if checks.collisions else ""
    if deep:
        yield StateStatus.OVERLAP, deep


def is_reached(value: float, unit: float, margin: float) -> bool:
    """Return whether a margin is reached, N, by the value of Algorithm 1's program and its unit."""
    goal = margin / abs(unit)
    return value <= closeness(goal) - goal


class StateLoops:
    """Finds optima of states by what was learned of others with the same contacts."""

    def __init__(
        self,
        configurations: Configurations,
        options: SolveOptions,
        checks: StateChecks,
        starts: WarmStarts,
    ) -> None:
        """Take the states, how they are solved, and where what was learned is kept."""
        self._at = configurations
        self._options = options
        self._checks = checks
        self._starts = starts
        self._plain = PlainProblems(configurations.scene, collisions=checks.collisions)

    def learn(self, scene: Scene, problem: QuasistaticProblem) -> None:
        """Keep what a problem that was solved by itself shares with those of the same contacts."""
        self._plain.learn(scene, problem)

    def optima_of_states(
        self,
        q: FloatArray | None,
        objective: Objective,
        alone: Callable[[int], object],
        enough: float | None = None,  # noqa: ARG002 - here optima are as cheap
    ) -> SolvedStates | None:
        """Solve many states by warm starts in loops alone, and others one by one as they come.

        Args:
            q: (K, a) configurations in which nothing else differs from the scene; None: something
                does.
            objective: What is optimised.
            alone: Called with the number of each state that has to be solved by itself, so that
                what is learned there serves those after it.
            enough: Margin of which it is enough to know whether it is reached, N; None: optima are
                looked for.

        Returns:
            What was found; None: nothing can be, and nothing was called.
        """
        states, hand = None if q is None else self._plain.at(q), self._at.scene.hand
        if states is None or q is None or hand is None:
            return None
        found = SolvedStates.room(len(q), hand.joint_names)
        for shapes, order in states.groups():
            order = self._sound(shapes, order, q, states, found.faults)
            begin = 0
            while begin < len(order):
                begin += self._advance(shapes, objective, order[begin:], states, found)
                if begin < len(order):
                    alone(int(order[begin]))
                    begin += 1
        for number in np.flatnonzero(states.counts < 0).tolist():
            alone(number)
        return found

    def answer(self, q: FloatArray, objective: Objective) -> WarmAnswer | None:
        """Solve one state as many are; None: it has to be solved by itself.

        Args:
            q: (a,) configuration.
            objective: What is optimised.
        """
        states = self._plain.at(q[None])
        if states is None or states.counts[0] < 0 or states.doubtful[0]:
            return None
        shapes = tuple(states.shapes[0, : states.counts[0]].tolist())
        alike = self._plain.alike(shapes)
        if alike is None or (self._checks.need_hand and not shapes):
            return None
        bodies, carriers, problem = alike
        learned, pool = self._starts.for_loops(bodies, problem, objective)
        if not pool.is_due():
            return None
        figures, torques = np.empty((1, 6)), np.empty(states.weights.shape)
        optimum = state_optimum(
            problem, objective, self._options, learned, pool.starts, states, self._plain.moves,
            carriers, *self._plain.frame, figures, torques,
        )  # fmt: skip
        pool.count(optimum is not None)
        if optimum is None:
            return None
        rules, margin = self._options.rules, float(figures[0, 0])
        names, units = problem.joint_names, problem.joint_units
        return WarmAnswer(objective, rules, optimum, margin, torques[0], names, units)

    def reaches(self, q: FloatArray, margin: float) -> bool | None:
        """Tell whether one state is proven to reach a margin, N; None: see `answer`."""
        answer = self.answer(q, Margin())
        if answer is None:
            return None
        return is_reached(answer.optimum.value, answer.optimum.unit, margin)

    def _sound(
        self,
        shapes: tuple[int, ...],
        order: NDArray[np.intp],
        q: FloatArray,
        states: PlainStates,
        faults: NDArray[np.uint8],
    ) -> NDArray[np.intp]:
        """Return those of some states that have no serious finding, and enter it for the others.

        Args:
            shapes: The hand's shapes that touch in all of them.
            order: Their numbers.
            q: (K, a) configurations.
            states: What loops have found.
            faults: See `SolvedStates`.
        """
        at, off = self._at, self._checks.need_hand and not shapes
        of_overlaps = self._checks._replace(need_hand=False)
        doubtful = order[states.doubtful[order]].tolist()
        # Where contacts with supports are wrong, that is said of each state by itself.
        if not (off or doubtful) or self._without_problem(at.scene_at(q[order[0]], None, None)):
            return order
        if off:
            faults[order] = STATUSES.index(StateStatus.HAND_TOUCHES_NOTHING)
            return order[:0]
        for number in doubtful:
            for status, _ in islice(
                refusals(at, at.scene_at(q[number], None, None), of_overlaps), 1
            ):
                faults[number] = STATUSES.index(status)
        return order[faults[order] == _FOUND]

    def _advance(
        self,
        shapes: tuple[int, ...],
        objective: Objective,
        order: NDArray[np.intp],
        states: PlainStates,
        found: SolvedStates,
    ) -> int:
        """Solve states with the same contacts; how many before one needs more."""
        alike = self._plain.alike(shapes)
        if alike is None:
            return 0
        bodies, carriers, problem = alike
        learned, pool = self._starts.for_loops(bodies, problem, objective)
        if not pool.is_due():
            return 0
        count = optima_of_states(
            problem, objective, self._options, learned, pool.starts, order, states,
            self._plain.moves, carriers, *self._plain.frame, found.figures, found.torques,
        )  # fmt: skip
        pool.count(count)
        found.contact_counts[order[:count]] = problem.contact_count
        return count

    @staticmethod
    def _without_problem(scene: Scene) -> bool:
        """Return whether a scene has no problem in its state."""
        try:
            scene.problem()
        except StateError:
            return True
        return False
