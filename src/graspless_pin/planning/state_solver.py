"""Solution of single states of a scene, by warm starts from other states where possible."""

from __future__ import annotations

from copy import copy
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from graspless_pin.algorithms.batch_optimum import WarmOptimum
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search_state import OPTIMALITY_TOLERANCE
from graspless_pin.algorithms.warm_search import StartsByContacts, reaches_margin
from graspless_pin.errors import JointLimitError, StateError
from graspless_pin.planning.attached_states import (
    AttachedConfigurations,
    rotated_optimum,
    rotated_problem,
    rotated_solution,
)
from graspless_pin.planning.configurations import Configurations
from graspless_pin.planning.evaluation import Evaluation, StateStatus, WarmAnswer
from graspless_pin.planning.state_loops import AttachedLoops, StateLoops, is_reached, refusals
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene import Scene
from graspless_pin.scene.batch_states import BatchContacts
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.scene_findings import ALL_CHECKS, StateChecks
from graspless_pin.scene.scene_stability import rest_model_of
from graspless_pin.solution import UNDECIDED, TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.algorithms.robust_solution import RobustSolution
    from graspless_pin.algorithms.uncertainty import Uncertainty
    from graspless_pin.holding.small_motions import RestModel


class PosedScene(NamedTuple):
    """A scene in one of its states, before it is solved.

    Attributes:
        scene: The scene in this state; where a joint is outside its limits and only the first fault
            is searched, with the evaluator's own configuration.
        problem: Its problem; None: there is none, or torques are not required.
        faults: Statuses and messages of its faults.
    """

    scene: Scene
    problem: QuasistaticProblem | None
    faults: tuple[tuple[StateStatus, str], ...] = ()


class StateSolver:
    """Solves states of one scene and keeps warm starts from each.

    Warm starts are kept by contacts and tried in the order of their success. States of an object
    that moves with a link are one problem under different loads, in the axes of the joint that
    carries the link. Threads may share a solver; warm starts are not pickled.

    Attributes:
        configurations: The states that the scene can be put into.
        objective: The objective.
        options: Options of the solution.
        checks: Findings for which a state is refused.
        loops: Solves many states at once.
        uncertainty: The set for all members of which states are solved; None: the nominal scene.
    """

    uncertainty: Uncertainty | None = None

    def __init__(
        self,
        configurations: Configurations,
        objective: Objective,
        options: SolveOptions,
        checks: StateChecks = ALL_CHECKS,
    ) -> None:
        """Start without warm starts."""
        self.configurations = configurations
        self.objective = objective
        self.options = options
        self.checks = checks
        self._starts = StartsByContacts()
        loops = AttachedLoops if isinstance(configurations, AttachedConfigurations) else StateLoops
        self.loops = loops(configurations, options, checks, self._starts)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments alone, without warm starts."""
        return type(self), self._arguments(self.objective)

    def with_objective(self, objective: Objective) -> StateSolver:
        """Return a solver for another objective, without warm starts."""
        return type(self)(*self._arguments(objective))

    def _arguments(self, objective: Objective) -> tuple[Any, ...]:
        """Return the arguments of a solver like this one for an objective."""
        return self.configurations, objective, self.options, self.checks

    def with_scene(self, scene: Scene) -> StateSolver:
        """Return a solver for a pinned scene of other mass and friction; they share warm starts."""
        changed = copy(self)
        changed.configurations = self.configurations.with_scene(scene)
        return changed

    def solve(self, q: Any, T_world_object: Any, twist: Any, *, clear: bool = False) -> Evaluation:
        """Solve for one state, with few records: see `Evaluator.evaluate`.

        With an object that moves with a link, vectors may be in the link's axes; ``clear`` is that
        of `posed_scene`.
        """
        scene, problem, faults = self.posed_scene(q, T_world_object, twist, clear=clear)
        if problem is None or faults:
            return Evaluation(*faults[0], scene, None)
        shared = self._shared_problem(scene, problem)
        return self._evaluation(scene, shared, self._optimum(scene, shared, self.objective))

    def evaluate(self, q: Any, T_world_object: Any, twist: Any) -> Evaluation:
        """Return the whole answer for one state: see `Evaluator.evaluate`."""
        posed = self._posed_by_loops(q, T_world_object, twist, self.objective)
        answer = None if posed is None else self.loops.answer(posed, self.objective)
        if answer is not None:
            scene = self.configurations.scene_at(q, None, None)
            return Evaluation(StateStatus.FOUND, "", scene, answer)
        scene, problem, faults = self.posed_scene(q, T_world_object, twist, clear=_is_clear(posed))
        if problem is None or faults:
            return Evaluation(*faults[0], scene, None)
        # Where motors carry the link, the whole problem is not the one that all states share.
        key = ("whole",) * self.configurations.motors_carry
        R = None if self.options.strong else self.configurations.axes_at(scene)
        rotated = problem if R is None else rotated_problem(problem, R.T)
        optimum = self._optimum(scene, rotated, self.objective, key)
        if R is not None:
            optimum = (
                rotated_solution(optimum, problem, R)
                if isinstance(optimum, TorqueSolution)
                else rotated_optimum(optimum, R)
            )
        return self._evaluation(scene, problem, optimum)

    def _evaluation(
        self, scene: Scene, problem: QuasistaticProblem, optimum: WarmOptimum | TorqueSolution
    ) -> Evaluation:
        """Return the answer for a state from the result of a warm start or a search."""
        if not isinstance(optimum, TorqueSolution):
            margin = problem.margin_of(optimum.forces)
            torques = problem.jacobian.T @ optimum.forces.ravel() + problem.gravity_torques
            rules, names, units = self.options.rules, problem.joint_names, problem.joint_units
            answer = WarmAnswer(self.objective, rules, optimum, margin, torques, names, units)
            return Evaluation(StateStatus.FOUND, "", scene, answer)
        if optimum.found:
            return Evaluation(StateStatus.FOUND, "", scene, optimum)
        status = optimum.status
        return Evaluation(StateStatus.of_unsolved(status), status.message, scene, optimum)

    def margin_of(
        self, scene: Scene, problem: QuasistaticProblem, required: float
    ) -> tuple[float, StateStatus]:
        """Return the largest margin of a state, N, and its status for a required margin.

        Args:
            scene: The scene in the state.
            problem: Its problem.
            required: The required margin, N.

        Returns:
            The margin, -inf where there are no torques, and `StateStatus.FOUND` if it is enough.
        """
        shared = self._shared_problem(scene, problem)
        optimum = self._optimum(scene, shared, Margin())
        if isinstance(optimum, TorqueSolution):
            force = optimum.problem.scales.force
            return status_of_margin(optimum, force, optimum.certificate.bound, required)
        enough = is_reached(optimum.value, optimum.signed_unit, required)
        status = StateStatus.FOUND if enough else StateStatus.BELOW_MARGIN
        return shared.margin_of(optimum.forces), status

    def is_feasible(
        self, q: Any, T_world_object: Any, twist: Any, margin: float, *, clear: bool | None = None
    ) -> bool:
        """Decide whether a state is proven to reach a margin: see `Evaluator.is_feasible`.

        Args:
            q: See there.
            T_world_object: See there.
            twist: See there.
            margin: N; below zero: none is required.
            clear: See `posed_scene`; None: loops are tried first.
        """
        solve = margin >= 0.0
        posed = None
        if solve and clear is None:
            posed = self._posed_by_loops(q, T_world_object, twist, Margin())
        reached = None if posed is None else self.loops.reaches_margin(posed, margin)
        if reached is not None:
            return reached
        clear = clear or _is_clear(posed)
        return self.is_feasible_scene(
            self.posed_scene(q, T_world_object, twist, solve=solve, clear=clear), margin
        )

    def is_feasible_scene(self, state: PosedScene, margin: float) -> bool:
        """Decide whether a state has no faults and is proven to reach a margin.

        Args:
            state: The state.
            margin: N; below zero: none is required.
        """
        scene, problem, faults = state
        if faults or problem is None:
            return not faults
        shared, objective, options = self._shared_problem(scene, problem), Margin(), self.options
        starts = self._starts.for_contacts(scene.contacts.bodies, shared, objective)
        optimum = starts.optimum(shared, objective, options)
        if optimum is not None:
            return is_reached(optimum.value, optimum.signed_unit, margin)
        reached, learned = reaches_margin(
            shared, margin, options, starts.best, self._rest_model(scene)
        )
        starts.learn(learned)
        self.loops.learn(scene, problem)
        return bool(reached)

    def posed_scene(
        self,
        q: Any,
        T_world_object: Any,
        twist: Any,
        *,
        solve: bool = True,
        whole: bool = False,
        clear: bool = False,
    ) -> PosedScene:
        """Return the scene in a state, its problem and its faults.

        Args:
            q: See `Evaluator.evaluate`.
            T_world_object: See there.
            twist: See there.
            solve: Whether torques are required: then it is a fault if there is no problem, for lack
                of contacts that can carry forces.
            whole: Whether all faults are searched; otherwise the first one only.
            clear: Whether the hand is known to be clear of overlaps, which are not checked again.
        """
        at, checks = self.configurations, self.checks
        problem: QuasistaticProblem | None = None
        faults: list[tuple[StateStatus, str]] = []
        try:
            scene = at.solved_scene_at(q, T_world_object, twist)
        except JointLimitError as error:
            faults.append((StateStatus.OUTSIDE_LIMITS, str(error)))
            if not whole:
                return PosedScene(at.scene_at(None, T_world_object, twist), None, tuple(faults))
            scene = at.without_limits.solved_scene_at(q, T_world_object, twist)
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
        if clear:
            checks = checks._replace(collisions=False)
        if not faults or whole:
            faults += islice(refusals(at, scene, checks), None if whole else 1)
        return PosedScene(scene, problem, tuple(faults))

    def _posed_by_loops(
        self, q: Any, T_world_object: Any, twist: Any, objective: Objective
    ) -> BatchContacts | None:
        """Return the contacts of a state found in loops; None: loops cannot."""
        if T_world_object is not None or twist is not None:
            return None
        row = self.configurations.position_row(q)
        return None if row is None else self.loops.posed_states(row[None], objective)

    def _shared_problem(self, scene: Scene, problem: QuasistaticProblem) -> QuasistaticProblem:
        """Return the problem in the form that states with the same contacts share, except loads.

        With ``stability="strong"`` it is the problem itself, in world axes.
        """
        strong = self.options.strong
        return problem if strong else self.configurations.shared_problem(scene, problem)

    def _optimum(
        self,
        scene: Scene,
        problem: QuasistaticProblem,
        objective: Objective,
        alike: tuple[str, ...] = (),
    ) -> WarmOptimum | TorqueSolution:
        """Return the optimum from a warm start, or the solution of a search, which is learned from.

        Args:
            scene: The scene in a state.
            problem: The problem that is solved.
            objective: The objective.
            alike: Key beside the contacts by which warm starts are kept.
        """
        starts = self._starts.for_contacts((*scene.contacts.bodies, *alike), problem, objective)
        optimum = starts.optimum(problem, objective, self.options)
        if optimum is not None:
            return optimum
        solution = starts.search(problem, objective, self.options, self._rest_model(scene))
        self.loops.learn(scene, problem)
        return solution

    def _rest_model(self, scene: Scene) -> RestModel | None:
        return rest_model_of(scene) if self.options.strong else None


def _is_clear(posed: BatchContacts | None) -> bool:
    """Return whether loops have shown that the hand is clear of overlaps."""
    return posed is not None and not posed.doubtful[0]


def status_of_margin(
    solution: TorqueSolution | RobustSolution, force: float, bound: float, required: float
) -> tuple[float, StateStatus]:
    """Return the margin of a solution, N, and its status: see `StateSolver.margin_of`.

    Args:
        solution: The solution of a search.
        force: Scale of the load, N.
        bound: Upper bound of the margin, N; NaN where there is none.
        required: The required margin, N.
    """
    slack = OPTIMALITY_TOLERANCE * max(force, required)
    if solution.found and solution.margin >= required - slack:
        return solution.margin, StateStatus.FOUND
    if solution.status in UNDECIDED and not bound < required - slack:
        status = StateStatus.UNDECIDED
    else:
        status = StateStatus.BELOW_MARGIN if solution.found else StateStatus.INFEASIBLE
    return solution.margin if solution.found else -np.inf, status
