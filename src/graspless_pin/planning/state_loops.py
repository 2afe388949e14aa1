"""Many states of one scene in loops: the hand elsewhere, and contacts found in each state.

Of an object that moves with a link, all states are one problem under other loads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.batch_optimum import LoadSweep, optima_of_states, state_optimum
from graspless_pin.algorithms.batch_programs import are_for
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.robust_solution import Coverage
from graspless_pin.algorithms.search_state import optimality_tolerance
from graspless_pin.algorithms.warm_search import StartsByContacts
from graspless_pin.compiled import core
from graspless_pin.errors import StateError
from graspless_pin.geometry.bodies.collision import BodyShapes, PlacedBodies
from graspless_pin.geometry.contact.distances import solids_of
from graspless_pin.geometry.hand.work_space import Kinematics
from graspless_pin.geometry.poses import invert
from graspless_pin.geometry.posing.overlaps import pairs_of
from graspless_pin.planning.attached_states import AttachedConfigurations
from graspless_pin.planning.configurations import Configurations
from graspless_pin.planning.evaluation import STATUSES, Evaluation, StateStatus, WarmAnswer
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.cones import CONE_MODELS
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene import Scene
from graspless_pin.scene.batch_states import BatchContactFinder, BatchContacts, loops_of
from graspless_pin.scene.load_wrenches import carried_loads
from graspless_pin.scene.problem_data import jointed_contacts, loads_of, possible_columns
from graspless_pin.scene.scene_findings import StateChecks, state_findings

_FOUND = STATUSES.index(StateStatus.FOUND)
COVERAGES = None, *Coverage
_StateGroup = tuple[NDArray[np.intp], Callable[[int], int]]
"""Numbers of states that one loop takes, and what solves them from one of these on: it returns how
many before one needs more."""


class StateFigures(NamedTuple):
    """What is found of K states; NaN where nothing is.

    Attributes:
        codes: (K,) numbers of the statuses among `STATUSES`.
        figures: (K, 6) with the columns that `core.FIGURES` names; margins are -inf where there are
            no torques.
        torques: (K, L) of all torques that any state may have.
        contact_counts: (K,); 0 where there is no problem.
        coverages: (K,) numbers among `COVERAGES`.
    """

    codes: NDArray[np.uint8]
    figures: FloatArray
    torques: FloatArray
    contact_counts: NDArray[np.int32]
    coverages: NDArray[np.uint8]

    @classmethod
    def empty(cls, count: int, torque_count: int) -> StateFigures:
        """Return arrays for `count` states, filled with NaN; none has a problem."""
        figures, torques = np.full((count, 6), np.nan), np.full((count, torque_count), np.nan)
        figures[:, 0] = -np.inf
        codes, counts = np.full(count, _FOUND, np.uint8), np.zeros(count, np.int32)
        return cls(codes, figures, torques, counts, np.zeros(count, np.uint8))

    def enter(self, number: int, evaluation: Evaluation, torque_names: tuple[str, ...]) -> None:
        """Enter what was found of one state.

        Args:
            number: Of the state.
            evaluation: The answer.
            torque_names: L names of the columns of the torques.
        """
        self.codes[number] = STATUSES.index(evaluation.status)
        if not evaluation.has_contacts:
            return
        self.contact_counts[number], bound, gap, residual = evaluation.proof_figures()
        if evaluation.robust is not None:
            self.coverages[number] = COVERAGES.index(evaluation.robust.coverage)
        self.figures[number, 2] = bound
        if evaluation.found:
            self.figures[number] = evaluation.margin, np.nan, bound, gap, residual, np.nan
            columns = columns_among(torque_names, evaluation.joint_names)
            self.torques[number, columns] = evaluation.torques

    def enter_refusal(
        self, number: int, at: Configurations, scene: Scene, checks: StateChecks
    ) -> None:
        """Enter the first of the `refusals` of a scene in one of the states, if there is any."""
        for status, _ in islice(refusals(at, scene, checks), 1):
            self.codes[number] = STATUSES.index(status)


def columns_among(all_names: tuple[str, ...], names: tuple[str, ...]) -> NDArray[np.intp]:
    """Return where some torques stand among all."""
    return np.array([all_names.index(name) for name in names], dtype=np.intp)


def refusals(
    at: Configurations, scene: Scene, checks: StateChecks
) -> Iterator[tuple[StateStatus, str]]:
    """Yield statuses and messages of what a scene is refused for in one of its states.

    Args:
        at: The states.
        scene: The scene in this one.
        checks: What is looked for.
    """
    for finding in state_findings(scene, checks):
        yield StateStatus[finding.code.name], finding.message
    deep = at.object_overlap(scene) if checks.collisions else ""
    if deep:
        yield StateStatus.OVERLAP, deep


def is_reached(value: float, signed_unit: float, margin: float) -> bool:
    """Return whether a margin is reached, N, by the value of Algorithm 1's program and its unit."""
    goal = margin / abs(signed_unit)
    return value <= optimality_tolerance(goal) - goal


class StateLoops:
    """Finds optima of states by what was learned of others with the same contacts."""

    def __init__(
        self,
        configurations: Configurations,
        options: SolveOptions,
        checks: StateChecks,
        starts: StartsByContacts,
    ) -> None:
        """Take the states, how they are solved, and where what was learned is kept."""
        self._at = configurations
        self._options = options
        self._checks = checks
        self._starts = starts

    @cached_property
    def _finder(self) -> BatchContactFinder:
        """What finds contacts in loops, and keeps what states with the same contacts share."""
        return BatchContactFinder(self._at.scene, collisions=self._checks.collisions)

    def learn(self, scene: Scene, problem: QuasistaticProblem) -> None:
        """Keep what a problem that was solved by itself shares with those of the same contacts."""
        self._finder.store(scene, problem)

    def optima_of_states(
        self,
        q: FloatArray | None,
        objective: Objective,
        found: StateFigures,
        alone: Callable[[int, bool], object],
        enough: float | None = None,
    ) -> None:
        """Solve many states by warm starts in loops alone, and others one by one as they come.

        Args:
            q: (K, a) configurations in which nothing else differs from the scene; None: something
                does, and each state goes alone.
            objective: What is optimised.
            found: Where what loops find is entered: with contacts, or with a fault.
            alone: Called with the number of each state that has to be solved by itself, so that
                what is learned there serves those after it; and whether the hand is known to be
                deep in nothing there.
            enough: Margin of which it is enough to know whether it is reached, N, where that is
                cheaper; None: optima are looked for.
        """
        states = None if q is None else self.posed(q, objective)
        clear = [False] * len(found.codes)
        remaining = [*range(len(clear))]
        if q is not None and states is not None:
            clear = (~states.doubtful).tolist()
            remaining = np.flatnonzero(states.counts < 0).tolist()
            for order, advance in self._state_groups(q, states, objective, enough, found):
                begin = 0
                while begin < len(order):
                    begin += advance(begin)
                    if begin < len(order):
                        number = int(order[begin])
                        alone(number, clear[number])
                        begin += 1
        for number in remaining:
            alone(number, clear[number])

    def posed(self, q: FloatArray, objective: Objective) -> BatchContacts | None:  # noqa: ARG002
        """Return configurations (K, a) posed by loops; None: they cannot be."""
        return None if self._at.scene.hand is None else self._finder.at(q)

    def _state_groups(
        self,
        q: FloatArray,
        states: BatchContacts,
        objective: Objective,
        enough: float | None,  # noqa: ARG002 - here optima are as cheap
        found: StateFigures,
    ) -> Iterator[_StateGroup]:
        """Yield states with the same contacts, those alone that have no serious finding.

        Args:
            q: (K, a) configurations.
            states: What loops have found of them.
            objective: What is optimised.
            enough: See `optima_of_states`.
            found: Where what is found is entered.
        """
        for shapes, touching in states.groups():
            order = self._without_findings(shapes, touching, q, states, found)
            yield order, partial(self._solve_group, shapes, objective, order, states, found)

    def answer(self, states: BatchContacts, objective: Objective) -> WarmAnswer | None:
        """Solve one state as many are; None: it has to be solved by itself.

        Args:
            states: It alone, posed by loops.
            objective: What is optimised.
        """
        if states.counts[0] < 0 or states.doubtful[0]:
            return None
        shapes = tuple(states.shapes[0, : states.counts[0]].tolist())
        shared = self._finder.shared_data(shapes)
        if shared is None or (self._checks.need_hand and not shapes):
            return None
        bodies, carriers, problem = shared
        starts = self._starts.for_contacts(bodies, problem, objective)
        if not starts.is_due():
            return None
        figures, torques = np.empty((1, 6)), np.empty(states.weights.shape)
        optimum = state_optimum(
            problem, objective, self._options, starts.new_for_loops(), starts.for_loops, states,
            self._finder.moves, carriers, *self._finder.frame, figures, torques,
        )  # fmt: skip
        starts.count(optimum is not None)
        if optimum is None:
            return None
        rules, margin = self._options.rules, float(figures[0, 0])
        names, units = problem.joint_names, problem.joint_units
        return WarmAnswer(objective, rules, optimum, margin, torques[0], names, units)

    def reaches(self, states: BatchContacts, margin: float) -> bool | None:
        """Tell whether one state is proven to reach a margin, N; None: see `answer`."""
        answer = self.answer(states, Margin())
        if answer is None:
            return None
        return is_reached(answer.optimum.value, answer.optimum.signed_unit, margin)

    def _without_findings(
        self,
        shapes: tuple[int, ...],
        order: NDArray[np.intp],
        q: FloatArray,
        states: BatchContacts,
        found: StateFigures,
    ) -> NDArray[np.intp]:
        """Return those of some states that have no serious finding, and enter it for the others.

        Args:
            shapes: The hand's shapes that touch in all of them.
            order: Their numbers.
            q: (K, a) configurations.
            states: What loops have found.
            found: Where findings are entered.
        """
        at, off = self._at, self._checks.need_hand and not shapes
        of_overlaps = self._checks._replace(need_hand=False)
        doubtful = order[states.doubtful[order]].tolist()
        # Where contacts with supports are wrong, that is said of each state by itself.
        if not (off or doubtful) or self._has_no_problem(at.scene_at(q[order[0]], None, None)):
            return order
        if off:
            found.codes[order] = STATUSES.index(StateStatus.HAND_TOUCHES_NOTHING)
            return order[:0]
        for number in doubtful:
            found.enter_refusal(number, at, at.scene_at(q[number], None, None), of_overlaps)
        return order[found.codes[order] == _FOUND]

    def _solve_group(
        self,
        shapes: tuple[int, ...],
        objective: Objective,
        order: NDArray[np.intp],
        states: BatchContacts,
        found: StateFigures,
        begin: int,
    ) -> int:
        """Solve states with the same contacts from one on; how many before one needs more."""
        shared = self._finder.shared_data(shapes)
        if shared is None:
            return 0
        bodies, carriers, problem = shared
        starts = self._starts.for_contacts(bodies, problem, objective)
        if not starts.is_due():
            return 0
        order = order[begin:]
        count = optima_of_states(
            problem, objective, self._options, starts.new_for_loops(), starts.for_loops, order,
            states, self._finder.moves, carriers, *self._finder.frame, found.figures, found.torques,
        )  # fmt: skip
        starts.count(count)
        found.contact_counts[order[:count]] = problem.contact_count
        return count

    @staticmethod
    def _has_no_problem(scene: Scene) -> bool:
        """Return whether a scene has no problem in its state."""
        try:
            scene.problem()
        except StateError:
            return True
        return False


_NO_BODIES = PlacedBodies.of(())


class AttachedLoops(StateLoops):
    """Finds optima of states in the axes of the joint that carries the link."""

    _at: AttachedConfigurations

    def learn(self, scene: Scene | None = None, problem: QuasistaticProblem | None = None) -> None:  # noqa: ARG002
        """Take what served last, or was left behind by a search since."""
        for objective, sweep in list(self._sweeps.items()):
            starts = self._starts.for_contacts(self._at.touching.bodies, self._problem, objective)
            sweep.learn(self._problem, starts.best)

    def answer(self, states: BatchContacts, objective: Objective) -> None:
        """Return None: a whole answer is solved by itself."""

    def reaches(self, states: BatchContacts, margin: float) -> bool | None:
        """Do what `StateLoops.reaches` does, with no more than one state needs."""
        if states.counts[0] < 0 or states.doubtful[0]:
            return None
        figures, torques = np.empty((1, 6)), np.empty((1, self._problem.joint_count))
        loads, sweep = self._load_rows(states, slice(None)), self._load_sweep(Margin())
        if not sweep.advance(self._problem, loads, 0, figures, torques, enough=margin):
            return None
        _, value, _, _, _, unit = figures[0].tolist()
        return is_reached(value, unit, margin)

    def posed(self, q: FloatArray, objective: Objective) -> BatchContacts | None:
        """Do what `StateLoops.posed` does; None: loops are not for this objective, too."""
        cone = CONE_MODELS[self._at.scene.cone]
        if self._posing_loops is None or not are_for(cone, objective, self._options):
            return None
        return BatchContacts(*self._posing_loops.at(q))

    def _state_groups(
        self,
        q: FloatArray,
        states: BatchContacts,
        objective: Objective,
        enough: float | None,
        found: StateFigures,
    ) -> Iterator[_StateGroup]:
        within, problem = states.counts >= 0, self._problem
        for number in np.flatnonzero(within & states.doubtful).tolist():
            scene = self._at.solved_scene_at(q[number], None, None)
            found.enter_refusal(number, self._at, scene, self._checks)
        order = np.flatnonzero(within & (found.codes == _FOUND))
        loads, sweep = self._load_rows(states, order), self._load_sweep(objective)
        figures, torques = np.empty((len(order), 6)), np.empty((len(order), problem.joint_count))
        columns = columns_among((*possible_columns(self._at.hand),), problem.joint_names)

        def advance(begin: int) -> int:
            self.learn()
            end = sweep.advance(problem, loads, begin, figures, torques, enough=enough)
            solved = order[begin:end]
            found.figures[solved] = figures[begin:end]
            found.torques[solved[:, None], columns] = torques[begin:end]
            found.contact_counts[solved] = problem.contact_count
            return end - begin

        yield order, advance

    def _load_rows(self, states: BatchContacts, order: Any) -> FloatArray:
        """Return (K, 2M + 6 + 3L) what bears on the contacts of some states as loops take it."""
        at, problem = self._at, self._problem
        kinematics = Kinematics(states.poses[order], states.columns[order])
        wrenches, torques = carried_loads(
            at.scene, at.hand, at.joint, kinematics, at.T_joint_object
        )
        torques = torques + states.weights[order]
        if at.motors_carry:
            torques = at.torques_with_load(kinematics, wrenches, torques)
        rows, count = np.empty((len(torques), len(self._constant_loads))), problem.contact_count
        rows[:] = self._constant_loads
        rows[:, count : count + 6] = at.wrenches_in_link_axes(kinematics, wrenches)
        begin = count + 6 + 2 * problem.joint_count
        rows[:, begin : begin + problem.joint_count] += torques @ at.motor_map
        return rows

    def _load_sweep(self, objective: Objective) -> LoadSweep:
        """Return the loops for an objective."""
        sweeps = self._sweeps
        if objective not in sweeps:
            sweeps[objective] = LoadSweep(
                self._problem, objective, self._options, only_load_changes=True
            )
            self.learn()
        return sweeps[objective]

    @cached_property
    def _sweeps(self) -> dict[Objective, LoadSweep]:
        """The loops by objective."""
        return {}

    @cached_property
    def _problem(self) -> QuasistaticProblem:
        """One of the problems, for what all of them share."""
        return self._at.shared_problem(self._at.scene, self._at.scene.problem())

    @cached_property
    def _constant_loads(self) -> FloatArray:
        """What of the loads no state changes; those of the joints are added to it."""
        scene = self._at.scene
        loads = loads_of(scene, jointed_contacts(scene))
        return loads._replace(gravity_torques=np.zeros(self._problem.joint_count)).row()

    @cached_property
    def _posing_loops(self) -> Any:
        """The loops that pose the hand; None: nothing was compiled."""
        if core is None:
            return None
        at, tree = self._at, self._at.hand.tree
        pieces = at.scene.object.placed_bodies
        T_object_pieces = invert(at.scene.object.T_world_object) @ pieces.poses
        carriers, placements = tree.shape_placements
        joined = BodyShapes(
            (*tree.shapes.names, *pieces.shapes.names),
            (*tree.shapes.geometries, *pieces.shapes.geometries),
        )
        moving = (
            np.concatenate([carriers, np.full(len(pieces), at.joint)]),
            np.concatenate([placements, at.T_joint_object @ T_object_pieces]),
            solids_of(joined).for_loops,
        )
        pairs = _checked_pairs(at, moving[-1], len(pieces)) if self._checks.collisions else None
        return loops_of(at.scene, at.coupling(), moving, _NO_BODIES, pairs)


def _checked_pairs(at: AttachedConfigurations, sets: Any, pieces: int) -> Any:
    """Return the pairs of links, and of links beside the object and its pieces, for loops."""
    count, tree = len(at.moves_apart), at.hand.tree
    beside = np.flatnonzero(at.moves_apart).tolist()
    places = [*pairs_of(tree).tolist(), *((k, count + p) for k in beside for p in range(pieces))]
    return core.BodyPairs(sets, [i for i, _ in places], [j for _, j in places])
