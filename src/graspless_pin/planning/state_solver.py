"""From one state of a scene to its answer, by what was learned of others where that will do."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.batch_optimum import optima_of_states, state_optimum
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search import CLOSED, closeness
from graspless_pin.algorithms.warm_start import reaches_margin
from graspless_pin.errors import JointLimitError, StateError
from graspless_pin.planning.configurations import Configurations
from graspless_pin.planning.evaluation import STATUSES, Evaluation, StateStatus, WarmAnswer
from graspless_pin.planning.warm_starts import WarmStarts, WarmState
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene import Scene
from graspless_pin.scene.batch_states import PlainProblems, PlainStates
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.scene_stability import rest_model_of
from graspless_pin.scene.state_findings import ALL_CHECKS, StateChecks, state_findings
from graspless_pin.solution import UNDECIDED, TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.holding.small_motions import RestModel

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


class LookedAt(NamedTuple):
    """A state before anything is solved.

    Attributes:
        scene: The scene in this state; where a joint is outside its limits and the first fault is
            all that was asked for, with the evaluator's own configuration.
        problem: Its problem; None where there is none or none was asked for.
        faults: Statuses and messages of what is wrong with it.
    """

    scene: Scene
    problem: QuasistaticProblem | None
    faults: tuple[tuple[StateStatus, str], ...] = ()


class StateSolver:
    """Solves states of one scene and learns from each.

    Warm starts are kept by contacts and tried in the order of their success. Threads may share it;
    what it has learned stays behind where it is pickled.

    Attributes:
        configurations: The states that the scene can be put into.
        objective: What is optimised.
        options: How.
        checks: What a state is refused for.
    """

    def __init__(
        self,
        configurations: Configurations,
        objective: Objective,
        options: SolveOptions,
        checks: StateChecks = ALL_CHECKS,
    ) -> None:
        """Begin with nothing learned."""
        self.configurations = configurations
        self.objective = objective
        self.options = options
        self.checks = checks
        self._starts = WarmStarts()
        self._plain = PlainProblems(configurations.scene, collisions=checks.collisions)

    def __getstate__(self) -> dict[str, Any]:
        """Return what was given: what was learned is learned again elsewhere."""
        plain = PlainProblems(self.configurations.scene, collisions=self.checks.collisions)
        return {**self.__dict__, "_starts": WarmStarts(), "_plain": plain}

    def with_objective(self, objective: Objective) -> StateSolver:
        """Return one for another objective, that has learned nothing."""
        return StateSolver(self.configurations, objective, self.options, self.checks)

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
        states, hand = None if q is None else self._plain.at(q), self.configurations.scene.hand
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
        at, off = self.configurations, self.checks.need_hand and not shapes
        of_overlaps = self.checks._replace(need_hand=False)
        doubtful = order[states.doubtful[order]].tolist()
        # Where contacts with supports are wrong, that is said of each state by itself.
        if not (off or doubtful) or self._without_problem(at.scene_at(q[order[0]], None, None)):
            return order
        if off:
            faults[order] = STATUSES.index(StateStatus.HAND_TOUCHES_NOTHING)
            return order[:0]
        for number in doubtful:
            found = state_findings(at.scene_at(q[number], None, None), of_overlaps)
            if found:
                faults[number] = STATUSES.index(StateStatus.of(found[0]))
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
            problem, objective, self.options, learned, pool.starts, order, states,
            self._plain.moves, carriers, *self._plain.frame, found.figures, found.torques,
        )  # fmt: skip
        pool.count(count)
        found.contact_counts[order[:count]] = problem.contact_count
        return count

    def solved(self, q: Any, T_world_object: Any, twist: Any) -> Evaluation | WarmState:
        """Solve for one state, with as few records as can be: see `Evaluator.evaluate`."""
        solved = self._solved(q, T_world_object, twist)
        return solved if isinstance(solved, Evaluation) else solved[1]

    def evaluate(self, q: Any, T_world_object: Any, twist: Any) -> Evaluation:
        """Return the whole answer for one state: see `Evaluator.evaluate`."""
        if T_world_object is None and twist is None:
            answer = self._batch_of_one(q, self.objective)
            if answer is not None:
                scene = self.configurations.scene_at(q, None, None)
                return Evaluation(StateStatus.FOUND, "", scene, answer)
        solved = self._solved(q, T_world_object, twist)
        if isinstance(solved, Evaluation):
            return solved
        scene, state = solved
        answer = answer_of(state, self.objective, self.options)
        return Evaluation(StateStatus.FOUND, "", scene, answer)

    def _batch_of_one(self, q: Any, objective: Objective) -> WarmAnswer | None:
        """Solve one state as many are; None: it has to be solved by itself."""
        row = self.configurations.row(q)
        states = None if row is None else self._plain.at(row[None])
        if states is None or states.counts[0] < 0 or states.doubtful[0]:
            return None
        shapes = tuple(states.shapes[0, : states.counts[0]].tolist())
        alike = self._plain.alike(shapes)
        if alike is None or (self.checks.need_hand and not shapes):
            return None
        bodies, carriers, problem = alike
        learned, pool = self._starts.for_loops(bodies, problem, objective)
        if not pool.is_due():
            return None
        figures, torques = np.empty((1, 6)), np.empty(states.weights.shape)
        optimum = state_optimum(
            problem, objective, self.options, learned, pool.starts, states, self._plain.moves,
            carriers, *self._plain.frame, figures, torques,
        )  # fmt: skip
        pool.count(optimum is not None)
        if optimum is None:
            return None
        rules, margin = self.options.rules, float(figures[0, 0])
        names, units = problem.joint_names, problem.joint_units
        return WarmAnswer(objective, rules, optimum, margin, torques[0], names, units)

    def _solved(
        self, q: Any, T_world_object: Any, twist: Any
    ) -> Evaluation | tuple[Scene, WarmState]:
        """Solve for one state; what a search finds is learned."""
        scene, problem, faults = self.looked_at(q, T_world_object, twist)
        if problem is None or faults:
            return Evaluation(*faults[0], scene, None)
        found = self._optimum(scene, problem, self.objective)
        return evaluation_of(scene, found) if isinstance(found, TorqueSolution) else (scene, found)

    def _optimum(
        self, scene: Scene, problem: QuasistaticProblem, objective: Objective
    ) -> WarmState | TorqueSolution:
        """Return the optimum that a warm start leads to, or what a search finds and teaches."""
        bodies = scene.contacts.bodies
        found = self._starts.optimum(bodies, problem, objective, self.options)
        if found is not None:
            return found
        solution = self._starts.searched(
            bodies, problem, objective, self.options, self._rest(scene)
        )
        self._plain.learn(scene, problem)
        return solution

    def margin_of(
        self, scene: Scene, problem: QuasistaticProblem, required: float
    ) -> tuple[float, StateStatus]:
        """Return the largest margin of a state, N, and what is said of it where one is required.

        Args:
            scene: The scene in the state.
            problem: Its problem.
            required: The margin that is asked for, N.

        Returns:
            The margin, -inf where there are no torques, and `StateStatus.FOUND` if it is enough.
        """
        return told_margin(self._optimum(scene, problem, Margin()), required)

    def reaches(self, q: Any, T_world_object: Any, twist: Any, margin: float) -> bool:
        """Tell whether a state is proven to reach a margin: see `Evaluator.is_feasible`."""
        if T_world_object is None and twist is None and margin >= 0.0:
            answer = self._batch_of_one(q, Margin())
            if answer is not None:
                return is_reached(answer.optimum.value, answer.optimum.unit, margin)
        return self.holds(self.looked_at(q, T_world_object, twist, solve=margin >= 0.0), margin)

    def holds(self, state: LookedAt, margin: float) -> bool:
        """Tell whether nothing is wrong with a state, and it is proven to reach a margin.

        Args:
            state: The state.
            margin: N; below zero: none is asked for.
        """
        scene, problem, faults = state
        if faults or problem is None:
            return not faults
        what = scene.contacts.bodies, problem, Margin()
        found = self._starts.optimum(*what, self.options)
        if found is None:
            start = self._starts.best(*what)
            reached, learned = reaches_margin(
                problem, margin, self.options, start, self._rest(scene)
            )
            self._starts.learn(*what, learned)
            self._plain.learn(scene, problem)
            return bool(reached)
        return is_reached(found.optimum.value, found.optimum.unit, margin)

    def looked_at(
        self, q: Any, T_world_object: Any, twist: Any, *, solve: bool = True, whole: bool = False
    ) -> LookedAt:
        """Return the scene in a state, its problem, and what is wrong with it.

        Args:
            q: See `Evaluator.evaluate`.
            T_world_object: See there.
            twist: See there.
            solve: Whether torques are asked for: without contacts that can carry forces there is no
                problem, which is a fault then.
            whole: Whether all faults are looked for; otherwise one is enough.
        """
        return looked_at(
            self.configurations, self.checks, (q, T_world_object, twist), solve=solve, whole=whole
        )

    def _rest(self, scene: Scene) -> RestModel | None:
        return rest_model_of(scene) if self.options.strong else None

    @staticmethod
    def _without_problem(scene: Scene) -> bool:
        """Return whether a scene has no problem in its state."""
        try:
            scene.problem()
        except StateError:
            return True
        return False


def looked_at(
    at: Configurations,
    checks: StateChecks,
    state: tuple[Any, Any, Any],
    *,
    solve: bool,
    whole: bool,
) -> LookedAt:
    """Return the scene in a state, its problem, and what is wrong with it.

    Args:
        at: The states.
        checks: What they are refused for.
        state: What `Evaluator.evaluate` is given.
        solve: See `StateSolver.looked_at`.
        whole: See there.
    """
    problem: QuasistaticProblem | None = None
    faults: list[tuple[StateStatus, str]] = []
    try:
        scene = at.answered_at(*state)
    except JointLimitError as error:
        faults.append((StateStatus.OUTSIDE_LIMITS, str(error)))
        if not whole:
            return LookedAt(at.scene_at(None, *state[1:]), None, tuple(faults))
        scene = at.without_limits.answered_at(*state)
    try:
        if solve:
            problem = scene.problem()
        elif checks.collisions or checks.need_hand:
            contacts_of(scene)
    except StateError as error:
        status = StateStatus(error.kind.value)
        counts = {StateStatus.OVERLAP: checks.collisions}
        counts |= dict.fromkeys((StateStatus.NO_CONTACT, StateStatus.PARTED), checks.need_hand)
        if solve or counts.get(status, False):
            faults.append((status, str(error)))
        checks = checks._replace(need_hand=False)
    if not faults or whole:
        faults += [(StateStatus.of(one), one.message) for one in state_findings(scene, checks)]
    return LookedAt(scene, problem, tuple(faults))


def told_margin(found: WarmState | TorqueSolution, required: float) -> tuple[float, StateStatus]:
    """Return the margin of an optimum, and what is said of it: see `StateSolver.margin_of`."""
    if isinstance(found, WarmState):
        problem, optimum = found
        enough = is_reached(optimum.value, optimum.unit, required)
        status = StateStatus.FOUND if enough else StateStatus.BELOW_MARGIN
        return problem.margin_of(optimum.forces), status
    slack = CLOSED * max(found.problem.scales.force, required)
    if found.found and found.margin >= required - slack:
        return found.margin, StateStatus.FOUND
    if found.status in UNDECIDED and not found.certificate.bound < required - slack:
        status = StateStatus.UNDECIDED
    else:
        status = StateStatus.BELOW_MARGIN if found.found else StateStatus.INFEASIBLE
    return found.margin if found.found else -np.inf, status


def is_reached(value: float, unit: float, margin: float) -> bool:
    """Return whether a margin is reached, N, by the value of Algorithm 1's program and its unit."""
    goal = margin / abs(unit)
    return value <= closeness(goal) - goal


def answer_of(state: WarmState, objective: Objective, options: SolveOptions) -> WarmAnswer:
    """Return the answer for a state whose optimum a warm start led to."""
    problem, optimum = state
    torques = problem.jacobian.T @ optimum.forces.ravel() + problem.gravity_torques
    margin, names, units = (
        problem.margin_of(optimum.forces),
        problem.joint_names,
        problem.joint_units,
    )
    return WarmAnswer(objective, options.rules, optimum, margin, torques, names, units)


def evaluation_of(scene: Scene, solution: TorqueSolution) -> Evaluation:
    """Return the answer for a state that a search has solved."""
    if solution.found:
        return Evaluation(StateStatus.FOUND, "", scene, solution)
    undecided = solution.status in UNDECIDED
    status = StateStatus.UNDECIDED if undecided else StateStatus.INFEASIBLE
    return Evaluation(status, solution.status.message, scene, solution)
