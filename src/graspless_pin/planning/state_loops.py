"""Many states of one scene in compiled loops: other configurations, contacts found in each state.

With an object that moves with a link, all states are one problem under different loads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.batch_optimum import LoadSweep, optima_of_states, state_optimum
from graspless_pin.algorithms.batch_programs import loops_cover
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
from graspless_pin.geometry.posing.overlaps import overlap_pairs
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
"""Numbers of states with the same contacts, and a function that solves them from one of these on:
it returns how many it solved before one that has to be solved by itself."""


class StateFigures(NamedTuple):
    """Results of K states; NaN where there are none.

    Attributes:
        codes: (K,) indices of the statuses in `STATUSES`.
        figures: (K, 6) with the columns of `core.FIGURES`; margins are -inf where there are no
            torques.
        torques: (K, L) of all torques that any state may have.
        contact_counts: (K,); 0 where there is no problem.
        coverages: (K,) indices into `COVERAGES`.
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
        """Enter the answer for one state.

        Args:
            number: Number of the state.
            evaluation: Its answer.
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
        """Enter the first of the `refusals` of a scene in one state, if there is any."""
        for status, _ in islice(refusals(at, scene, checks), 1):
            self.codes[number] = STATUSES.index(status)


def columns_among(all_names: tuple[str, ...], names: tuple[str, ...]) -> NDArray[np.intp]:
    """Return the indices of some torques among all."""
    return np.array([all_names.index(name) for name in names], dtype=np.intp)


def refusals(
    at: Configurations, scene: Scene, checks: StateChecks
) -> Iterator[tuple[StateStatus, str]]:
    """Yield statuses and messages of the findings for which a state is refused.

    Args:
        at: The states of the scene.
        scene: The scene in this one.
        checks: The checks that are made.
    """
    for finding in state_findings(scene, checks):
        yield StateStatus[finding.code.name], finding.message
    deep = at.object_overlap(scene) if checks.collisions else ""
    if deep:
        yield StateStatus.OVERLAP, deep


def is_reached(value: float, signed_unit: float, margin: float) -> bool:
    """Return whether the optimum of Algorithm 1 reaches a margin, N.

    Args:
        value: Of its program, which is minimised, in units of ``signed_unit``.
        signed_unit: Unit of the program's value, N, with a sign.
        margin: N.
    """
    goal = margin / abs(signed_unit)
    return value <= optimality_tolerance(goal) - goal


class StateLoops:
    """Finds optima of states by warm starts from other states with the same contacts."""

    def __init__(
        self,
        configurations: Configurations,
        options: SolveOptions,
        checks: StateChecks,
        starts: StartsByContacts,
    ) -> None:
        """Set the states, the options and checks of their solution, and the warm starts."""
        self._at = configurations
        self._options = options
        self._checks = checks
        self._starts = starts

    @cached_property
    def _finder(self) -> BatchContactFinder:
        """Finds contacts in compiled loops, and keeps the data shared by the same contacts."""
        return BatchContactFinder(self._at.scene, collisions=self._checks.collisions)

    def learn(self, scene: Scene, problem: QuasistaticProblem) -> None:
        """Keep the data of a solved problem that states with the same contacts share."""
        self._finder.store(scene, problem)

    def optima_of_states(
        self,
        q: FloatArray | None,
        objective: Objective,
        results: StateFigures,
        alone: Callable[[int, bool], object],
        enough: float | None = None,
    ) -> None:
        """Solve many states by warm starts in compiled loops, and the others one by one in between.

        Args:
            q: (K, a) configurations, if nothing else differs from the scene; None: each state is
                solved by itself.
            objective: The objective.
            results: Arrays into which loops enter results and refusals.
            alone: Called with the number of each state that has to be solved by itself, before
                those after it, which profit from its warm start; and with whether the hand is known
                to be clear of overlaps there.
            enough: Margin, N: where it is cheaper, only whether it is reached is decided; None:
                optima are searched.
        """
        states = None if q is None else self.posed_states(q, objective)
        clear = [False] * len(results.codes)
        remaining = [*range(len(clear))]
        if q is not None and states is not None:
            clear = (~states.doubtful).tolist()
            remaining = np.flatnonzero(states.counts < 0).tolist()
            for order, advance in self._state_groups(q, states, objective, enough, results):
                begin = 0
                while begin < len(order):
                    begin += advance(begin)
                    if begin < len(order):
                        number = int(order[begin])
                        alone(number, clear[number])
                        begin += 1
        for number in remaining:
            alone(number, clear[number])

    def posed_states(self, q: FloatArray, objective: Objective) -> BatchContacts | None:  # noqa: ARG002
        """Return the contacts of configurations (K, a), found in loops; None: loops cannot."""
        return None if self._at.scene.hand is None else self._finder.contacts_at(q)

    def _state_groups(
        self,
        q: FloatArray,
        states: BatchContacts,
        objective: Objective,
        enough: float | None,  # noqa: ARG002 - here optima are as cheap
        results: StateFigures,
    ) -> Iterator[_StateGroup]:
        """Yield groups of states with the same contacts and without serious findings.

        Args:
            q: (K, a) configurations.
            states: Their contacts.
            objective: The objective.
            enough: See `optima_of_states`.
            results: Arrays into which results and refusals are entered.
        """
        for shapes, touching in states.groups():
            order = self._without_findings(shapes, touching, q, states, results)
            yield order, partial(self._solve_group, shapes, objective, order, states, results)

    def answer(self, states: BatchContacts, objective: Objective) -> WarmAnswer | None:
        """Solve a single state in loops; None: it has to be solved by itself.

        Args:
            states: The contacts of this one state.
            objective: The objective.
        """
        if states.counts[0] < 0 or states.doubtful[0]:
            return None
        shapes = tuple(states.shapes[0, : states.counts[0]].tolist())
        shared = self._finder.shared_data(shapes)
        if shared is None or (self._checks.need_hand and not shapes):
            return None
        bodies, carriers, problem = shared
        starts = self._starts.for_contacts(bodies, problem, objective)
        if not starts.is_worth_trying():
            return None
        figures, torques = np.empty((1, 6)), np.empty(states.weights.shape)
        optimum = state_optimum(
            problem, objective, self._options, starts.new_start(), starts.compiled_starts, states,
            self._finder.moves, carriers, *self._finder.frame, figures, torques,
        )  # fmt: skip
        starts.record_found(optimum is not None)
        if optimum is None:
            return None
        rules, margin = self._options.rules, float(figures[0, 0])
        names, units = problem.joint_names, problem.joint_units
        return WarmAnswer(objective, rules, optimum, margin, torques[0], names, units)

    def reaches_margin(self, states: BatchContacts, margin: float) -> bool | None:
        """Decide whether a single state reaches a margin, N; None: see `answer`."""
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
        results: StateFigures,
    ) -> NDArray[np.intp]:
        """Return the states without serious findings, and enter refusals for the others.

        Args:
            shapes: The hand's shapes that touch in all of the states.
            order: Numbers of the states.
            q: (K, a) configurations.
            states: Their contacts.
            results: Arrays into which refusals are entered.
        """
        at, off = self._at, self._checks.need_hand and not shapes
        of_overlaps = self._checks._replace(need_hand=False)
        doubtful = order[states.doubtful[order]].tolist()
        # Where contacts with supports are wrong, the error is that of each state by itself.
        if not (off or doubtful) or self._has_no_problem(at.scene_at(q[order[0]], None, None)):
            return order
        if off:
            results.codes[order] = STATUSES.index(StateStatus.HAND_TOUCHES_NOTHING)
            return order[:0]
        for number in doubtful:
            results.enter_refusal(number, at, at.scene_at(q[number], None, None), of_overlaps)
        return order[results.codes[order] == _FOUND]

    def _solve_group(
        self,
        shapes: tuple[int, ...],
        objective: Objective,
        order: NDArray[np.intp],
        states: BatchContacts,
        results: StateFigures,
        begin: int,
    ) -> int:
        """Solve states with the same contacts from one on; return how many loops could solve."""
        shared = self._finder.shared_data(shapes)
        if shared is None:
            return 0
        bodies, carriers, problem = shared
        starts = self._starts.for_contacts(bodies, problem, objective)
        if not starts.is_worth_trying():
            return 0
        order = order[begin:]
        count = optima_of_states(
            problem, objective, self._options, starts.new_start(), starts.compiled_starts, order,
            states, self._finder.moves, carriers, *self._finder.frame, results.figures,
            results.torques,
        )  # fmt: skip
        starts.record_found(count)
        results.contact_counts[order[:count]] = problem.contact_count
        return count

    @staticmethod
    def _has_no_problem(scene: Scene) -> bool:
        """Return whether a scene has no problem, as its contacts cannot be used."""
        try:
            scene.problem()
        except StateError:
            return True
        return False


_NO_BODIES = PlacedBodies.of(())


class AttachedLoops(StateLoops):
    """Finds optima of states with an object that moves with a link, in the link's axes."""

    _at: AttachedConfigurations

    def learn(self, scene: Scene | None = None, problem: QuasistaticProblem | None = None) -> None:  # noqa: ARG002
        """Take over the best warm starts, also those of searches since the last call."""
        for objective, sweep in list(self._sweeps.items()):
            starts = self._starts.for_contacts(self._at.touching.bodies, self._problem, objective)
            sweep.learn(self._problem, starts.best)

    def answer(self, states: BatchContacts, objective: Objective) -> None:
        """Return None: whole answers are solved one by one."""

    def reaches_margin(self, states: BatchContacts, margin: float) -> bool | None:
        """Decide whether a single state reaches a margin, N; None: loops cannot."""
        if states.counts[0] < 0 or states.doubtful[0]:
            return None
        figures, torques = np.empty((1, 6)), np.empty((1, self._problem.joint_count))
        loads, sweep = self._load_rows(states, slice(None)), self._load_sweep(Margin())
        if not sweep.advance(self._problem, loads, 0, figures, torques, enough=margin):
            return None
        _, value, _, _, _, unit = figures[0].tolist()
        return is_reached(value, unit, margin)

    def posed_states(self, q: FloatArray, objective: Objective) -> BatchContacts | None:
        """Return the poses of configurations (K, a); None: also if loops lack the objective."""
        cone = CONE_MODELS[self._at.scene.cone]
        if self._posing_loops is None or not loops_cover(cone, objective, self._options):
            return None
        return BatchContacts(*self._posing_loops.at(q))

    def _state_groups(
        self,
        q: FloatArray,
        states: BatchContacts,
        objective: Objective,
        enough: float | None,
        results: StateFigures,
    ) -> Iterator[_StateGroup]:
        within, problem = states.counts >= 0, self._problem
        for number in np.flatnonzero(within & states.doubtful).tolist():
            scene = self._at.solved_scene_at(q[number], None, None)
            results.enter_refusal(number, self._at, scene, self._checks)
        order = np.flatnonzero(within & (results.codes == _FOUND))
        loads, sweep = self._load_rows(states, order), self._load_sweep(objective)
        figures, torques = np.empty((len(order), 6)), np.empty((len(order), problem.joint_count))
        columns = columns_among((*possible_columns(self._at.hand),), problem.joint_names)

        def advance(begin: int) -> int:
            self.learn()
            end = sweep.advance(problem, loads, begin, figures, torques, enough=enough)
            solved = order[begin:end]
            results.figures[solved] = figures[begin:end]
            results.torques[solved[:, None], columns] = torques[begin:end]
            results.contact_counts[solved] = problem.contact_count
            return end - begin

        yield order, advance

    def _load_rows(self, states: BatchContacts, order: Any) -> FloatArray:
        """Return (K, 2M + 6 + 3L) rows of load data of some states, as loops take them."""
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
        """Return the loop over loads for an objective."""
        sweeps = self._sweeps
        if objective not in sweeps:
            sweeps[objective] = LoadSweep(
                self._problem, objective, self._options, only_load_changes=True
            )
            self.learn()
        return sweeps[objective]

    @cached_property
    def _sweeps(self) -> dict[Objective, LoadSweep]:
        """The loops over loads, by objective."""
        return {}

    @cached_property
    def _problem(self) -> QuasistaticProblem:
        """The problem of the scene's own state, for the data that all states share."""
        return self._at.shared_problem(self._at.scene, self._at.scene.problem())

    @cached_property
    def _constant_loads(self) -> FloatArray:
        """The load data that are the same in all states; gravity torques are added to them."""
        scene = self._at.scene
        loads = loads_of(scene, jointed_contacts(scene))
        return loads._replace(gravity_torques=np.zeros(self._problem.joint_count)).row()

    @cached_property
    def _posing_loops(self) -> Any:
        """The compiled loops that pose the hand; None: nothing was compiled."""
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
            solids_of(joined).compiled_sets,
        )
        pairs = _checked_pairs(at, moving[-1], len(pieces)) if self._checks.collisions else None
        return loops_of(at.scene, at.coupling(), moving, _NO_BODIES, pairs)


def _checked_pairs(at: AttachedConfigurations, sets: Any, pieces: int) -> Any:
    """Return the pairs of shapes checked for overlaps: of links, and of links and the object."""
    count, tree = len(at.moves_apart), at.hand.tree
    apart = np.flatnonzero(at.moves_apart).tolist()
    pairs = [*overlap_pairs(tree).tolist(), *((k, count + p) for k in apart for p in range(pieces))]
    return core.BodyPairs(sets, [i for i, _ in pairs], [j for _, j in pairs])
