"""From states of an object that moves with a link to their answers: one loop for many of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from graspless_pin.algorithms.batch_optimum import LoadSweep, are_for
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.warm_start import reaches_margin
from graspless_pin.compiled import core
from graspless_pin.geometry.bodies.collision import BodyShapes, PlacedBodies
from graspless_pin.geometry.contact.broad_phase import solids_of
from graspless_pin.geometry.poses import invert, transformed
from graspless_pin.geometry.posing.overlaps import pairs_of
from graspless_pin.planning.attached_states import AttachedConfigurations
from graspless_pin.planning.evaluation import STATUSES, Evaluation, StateStatus
from graspless_pin.planning.state_solver import (
    LookedAt,
    SolvedStates,
    answer_of,
    evaluation_of,
    is_reached,
    looked_at,
    told_margin,
)
from graspless_pin.planning.turned import turned_optimum, turned_problem, turned_solution
from graspless_pin.planning.warm_starts import WarmStarts, WarmState
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene import Scene
from graspless_pin.scene.load_wrenches import acting_forces
from graspless_pin.scene.problem_data import jointed_contacts, loads_of
from graspless_pin.scene.scene_stability import rest_model_of
from graspless_pin.scene.state_findings import ALL_CHECKS, StateChecks, state_findings
from graspless_pin.solution import TorqueSolution


class AttachedSolver:
    """Solves states of one scene whose object moves with a link, and learns from each.

    All of them are one problem under other loads, in the axes of the joint that carries the link.
    Threads may share it; what it has learned stays behind where it is pickled.

    Attributes:
        configurations: The states.
        objective: What is optimised.
        options: How.
        checks: What a state is refused for.
    """

    def __init__(
        self,
        configurations: AttachedConfigurations,
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
        self._sweeps: dict[Objective, LoadSweep] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what was given: what was learned is learned again elsewhere."""
        given = self.configurations, self.objective, self.options, self.checks
        return type(self), given

    def with_objective(self, objective: Objective) -> AttachedSolver:
        """Return one for another objective, that has learned nothing."""
        return AttachedSolver(self.configurations, objective, self.options, self.checks)

    def optima_of_states(
        self,
        q: FloatArray | None,
        objective: Objective,
        alone: Callable[[int], object],
        enough: float | None = None,
    ) -> SolvedStates | None:
        """Do what `StateSolver.optima_of_states` does."""
        if q is None or not self._has_loops(objective):
            return None
        loads, within, doubtful = self._loops.loads(q)
        problem, sweep = self._problem, self._sweep(objective)
        found = SolvedStates.room(len(q), problem.joint_names)
        for number in np.flatnonzero(doubtful).tolist():
            wrong = self._refused(self.configurations.answered_at(q[number], None, None))
            if wrong is not None:
                found.faults[number] = STATUSES.index(wrong)
        order = np.flatnonzero(within & found.sound)
        loads = loads[order]
        figures, torques = np.empty((len(order), 6)), np.empty((len(order), problem.joint_count))
        begin = 0
        while begin < len(order):
            sweep.learn(problem, self._starts.best(self._bodies, problem, objective))
            end = sweep.advance(problem, loads, begin, figures, torques, enough=enough)
            solved = order[begin:end]
            found.figures[solved], found.torques[solved] = figures[begin:end], torques[begin:end]
            found.contact_counts[solved] = problem.contact_count
            if end < len(order):
                alone(int(order[end]))
            begin = end + 1
        for number in np.flatnonzero(~within).tolist():
            alone(number)
        return found

    def solved(self, q: Any, T_world_object: Any, twist: Any) -> Evaluation | WarmState:
        """Do what `StateSolver.solved` does; vectors are in no particular axes."""
        scene, problem, faults = self.looked_at(q, T_world_object, twist)
        if problem is None or faults:
            return Evaluation(*faults[0], scene, None)
        found = self._found(scene, self._carried(scene, problem), self._bodies, self.objective)
        return found if isinstance(found, WarmState) else evaluation_of(scene, found)

    def evaluate(self, q: Any, T_world_object: Any, twist: Any) -> Evaluation:
        """Return the whole answer for one state: see `Evaluator.evaluate`."""
        scene, problem, faults = self.looked_at(q, T_world_object, twist)
        if problem is None or faults:
            return Evaluation(*faults[0], scene, None)
        R = np.eye(3) if self.options.strong else self.configurations.axes_at(scene)
        # Where motors carry the link, this is not the problem that all states share.
        alike = self._bodies + (self.configurations.link,) * self.configurations.motors_carry
        found = self._found(scene, turned_problem(problem, R.T), alike, self.objective)
        if isinstance(found, WarmState):
            there = WarmState(problem, turned_optimum(found.optimum, R))
            answer = answer_of(there, self.objective, self.options)
            return Evaluation(StateStatus.FOUND, "", scene, answer)
        return evaluation_of(scene, turned_solution(found, problem, R))

    def margin_of(
        self, scene: Scene, problem: QuasistaticProblem, required: float
    ) -> tuple[float, StateStatus]:
        """Do what `StateSolver.margin_of` does."""
        own = self._carried(scene, problem)
        return told_margin(self._found(scene, own, self._bodies, Margin()), required)

    def reaches(self, q: Any, T_world_object: Any, twist: Any, margin: float) -> bool:
        """Tell whether a state is proven to reach a margin: see `Evaluator.is_feasible`."""
        objective = Margin()
        alone = T_world_object is None and twist is None and margin >= 0.0
        if alone and self._has_loops(objective):
            row = self.configurations.row(q)
            if row is not None:
                loads, within, doubtful = self._loops.loads(row[None])
                figures, torques = np.empty((1, 6)), np.empty((1, self._problem.joint_count))
                sweep = self._sweep(objective)
                if (
                    within[0]
                    and not doubtful[0]
                    and sweep.advance(self._problem, loads, 0, figures, torques, enough=margin)
                ):
                    _, value, _, _, _, unit = figures[0].tolist()
                    return is_reached(value, unit, margin)
        return self.holds(self.looked_at(q, T_world_object, twist, solve=margin >= 0.0), margin)

    def holds(self, state: LookedAt, margin: float) -> bool:
        """Do what `StateSolver.holds` does."""
        scene, problem, faults = state
        if faults or problem is None:
            return not faults
        objective = Margin()
        what = self._bodies, self._carried(scene, problem), objective
        found = self._starts.optimum(*what, self.options)
        if found is not None:
            return is_reached(found.optimum.value, found.optimum.unit, margin)
        reached, learned = reaches_margin(
            what[1], margin, self.options, self._starts.best(*what), self._rest(scene)
        )
        self._starts.learn(*what, learned)
        if self._has_loops(objective):
            self._sweep(objective).learn(what[1], learned)
        return bool(reached)

    def looked_at(
        self, q: Any, T_world_object: Any, twist: Any, *, solve: bool = True, whole: bool = False
    ) -> LookedAt:
        """Do what `StateSolver.looked_at` does."""
        state = q, T_world_object, twist
        found = looked_at(self.configurations, self.checks, state, solve=solve, whole=whole)
        if found.faults and not whole:
            return found
        reason = self.configurations.overlap(found.scene) if self.checks.collisions else ""
        more = ((StateStatus.OVERLAP, reason),) if reason else ()
        return found._replace(faults=(*found.faults, *more))

    def _refused(self, scene: Scene) -> StateStatus | None:
        """Return why a posed scene is not solved; None: it is."""
        found = state_findings(scene, self.checks)
        if found:
            return StateStatus.of(found[0])
        deep = self.checks.collisions and self.configurations.overlap(scene)
        return StateStatus.OVERLAP if deep else None

    def _carried(self, scene: Scene, problem: QuasistaticProblem) -> QuasistaticProblem:
        """Return the problem of a state as all states have it; rest is judged in world axes."""
        return (
            problem if self.options.strong else self.configurations.carried_problem(scene, problem)
        )

    def _found(
        self,
        scene: Scene,
        problem: QuasistaticProblem,
        bodies: tuple[str, ...],
        objective: Objective,
    ) -> WarmState | TorqueSolution:
        """Return the optimum that something learned leads to, else what a search finds."""
        what = bodies, problem, objective, self.options
        found = self._starts.optimum(*what)
        return self._starts.searched(*what, self._rest(scene)) if found is None else found

    def _rest(self, scene: Scene) -> Any:
        return rest_model_of(scene) if self.options.strong else None

    @property
    def _bodies(self) -> tuple[str, ...]:
        return self.configurations.touching.bodies

    @cached_property
    def _problem(self) -> QuasistaticProblem:
        """One of the problems, for what all of them share."""
        scene = self.configurations.scene
        return self.configurations.carried_problem(scene, scene.problem())

    def _has_loops(self, objective: Objective) -> bool:
        return self._loops is not None and are_for(
            self._problem.cone_model, objective, self.options
        )

    def _sweep(self, objective: Objective) -> LoadSweep:
        if objective not in self._sweeps:
            self._sweeps[objective] = LoadSweep(
                self._problem, objective, self.options, turning=True
            )
        return self._sweeps[objective]

    @cached_property
    def _loops(self) -> Any:
        """What finds the loads of many states; None: nothing was compiled."""
        return carried_loops(self.configurations, collisions=self.checks.collisions)


def carried_loops(at: AttachedConfigurations, *, collisions: bool) -> Any:
    """Return `core.CarriedStates` of a scene; None: they do not apply.

    They do where something was compiled, and loads are forces at the centre of mass that stay as
    the link turns.

    Args:
        at: Its states.
        collisions: Whether states are looked for in which bodies may be in each other.
    """
    scene, hand, tree = at.scene, at.hand, at.hand.tree
    if core is None or scene.acceleration is not None:
        return None
    if any(one.turns or one.lever.any() or one.moment.any() for one in acting_forces(scene)):
        return None
    state = jointed_contacts(scene)
    loads = loads_of(scene, state)
    motors = np.zeros((len(tree.joint_names), len(state.joints.names)))
    motors[:, : hand.actuation.from_joints.shape[1]] = hand.actuation.from_joints
    T_joint_world = invert(tree.kinematics(hand.positions).T_world_joint[at.joint])
    pieces = scene.object.placed_bodies
    carriers, placements = tree.shape_placements
    joined = BodyShapes(
        (*tree.shapes.names, *pieces.shapes.names),
        (*tree.shapes.geometries, *pieces.shapes.geometries),
    )
    sets = solids_of(joined).for_loops
    around = PlacedBodies.joined([support.placed_bodies for support in scene.supports])
    coupling, offset = at.coupling()
    return core.CarriedStates(
        joint=at.joint,
        carries=tree.moves[at.joint],
        motors=motors,
        center=transformed(T_joint_world, scene.object.center_of_mass_world),
        wrench=loads.wrench,
        own_wrench=np.zeros(6),
        row=loads._replace(gravity_torques=np.zeros(motors.shape[1])).row(),
        coupling=coupling,
        offset=offset,
        lower=tree.tolerated[0],
        upper=tree.tolerated[1],
        gravity=scene.gravity if scene.count_own_weight else np.zeros(3),
        carriers=np.concatenate([carriers, np.full(len(pieces), at.joint)]),
        shapes=np.concatenate([placements, T_joint_world @ pieces.poses]),
        links=sets,
        pieces=solids_of(BodyShapes((), ())).for_loops,
        poses=np.empty((0, 4, 4)),
        pairs=_pairs(at, sets, len(pieces)) if collisions else None,
        around=solids_of(around.shapes).for_loops,
        around_poses=around.poses,
        tolerance=scene.contact_tolerance,
        max_penetration=scene.max_penetration,
        **tree.chains,
    )


def _pairs(at: AttachedConfigurations, sets: Any, pieces: int) -> Any:
    """Return the pairs of links, and of links beside the object and its pieces, for loops."""
    count, tree = len(at.beside), at.hand.tree
    beside = np.flatnonzero(at.beside).tolist()
    places = [*pairs_of(tree).places, *((k, count + p) for k in beside for p in range(pieces))]
    return core.BodyPairs(sets, [i for i, _ in places], [j for _, j in places])
