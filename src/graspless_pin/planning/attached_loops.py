"""Many states of an object that moves with a link in loops: one problem under other loads."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import islice
from typing import Any

import numpy as np

from graspless_pin.algorithms.batch_optimum import LoadSweep, are_for
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.compiled import core
from graspless_pin.geometry.bodies.collision import BodyShapes, PlacedBodies
from graspless_pin.geometry.contact.distances import solids_of
from graspless_pin.geometry.hand.work_space import Kinematics
from graspless_pin.geometry.poses import invert
from graspless_pin.geometry.posing.overlaps import pairs_of
from graspless_pin.planning.attached_states import AttachedConfigurations
from graspless_pin.planning.evaluation import STATUSES
from graspless_pin.planning.state_loops import SolvedStates, is_reached, refusals
from graspless_pin.planning.warm_starts import WarmStarts
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene.batch_states import PlainStates, loops_of
from graspless_pin.scene.load_wrenches import carried_loads
from graspless_pin.scene.problem_data import jointed_contacts, loads_of
from graspless_pin.scene.state_findings import StateChecks

_NONE = PlacedBodies(BodyShapes((), ()), np.empty((0, 4, 4)))


class AttachedLoops:
    """Finds optima of states in the axes of the joint that carries the link.

    See `StateLoops`, whose methods these are.
    """

    def __init__(
        self,
        configurations: AttachedConfigurations,
        options: SolveOptions,
        checks: StateChecks,
        starts: WarmStarts,
    ) -> None:
        """Take the states, how they are solved, and where what was learned is kept."""
        self._at = configurations
        self._options = options
        self._checks = checks
        self._starts = starts
        self._sweeps: dict[Objective, LoadSweep] = {}

    def learn(self, *_: Any) -> None:
        """Take what served last, or was left behind by a search since."""
        for objective, sweep in list(self._sweeps.items()):
            start = self._starts.best(self._at.touching.bodies, self._problem, objective)
            sweep.learn(self._problem, start)

    def answer(self, q: FloatArray, objective: Objective) -> None:
        """Return None: a whole answer is solved by itself."""

    def optima_of_states(
        self,
        q: FloatArray | None,
        objective: Objective,
        alone: Callable[[int], object],
        enough: float | None = None,
    ) -> SolvedStates | None:
        """Do what `StateLoops.optima_of_states` does."""
        if q is None or not self._apply_to(objective):
            return None
        states, problem = PlainStates(*self._loops.at(q)), self._problem
        within = states.counts >= 0
        found = SolvedStates.room(len(q), problem.joint_names)
        for number in np.flatnonzero(within & states.doubtful).tolist():
            scene = self._at.answered_at(q[number], None, None)
            for status, _ in islice(refusals(self._at, scene, self._checks), 1):
                found.faults[number] = STATUSES.index(status)
        order = np.flatnonzero(within & found.sound)
        loads, sweep = self._loads(states, order), self._sweep(objective)
        self.learn()
        figures, torques = np.empty((len(order), 6)), np.empty((len(order), problem.joint_count))
        begin = 0
        while begin < len(order):
            end = sweep.advance(problem, loads, begin, figures, torques, enough=enough)
            solved = order[begin:end]
            found.figures[solved], found.torques[solved] = figures[begin:end], torques[begin:end]
            found.contact_counts[solved] = problem.contact_count
            if end < len(order):
                alone(int(order[end]))
                self.learn()
            begin = end + 1
        for number in np.flatnonzero(~within).tolist():
            alone(number)
        return found

    def reaches(self, q: FloatArray, margin: float) -> bool | None:
        """Do what `StateLoops.reaches` does."""
        objective = Margin()
        if not self._apply_to(objective):
            return None
        states = PlainStates(*self._loops.at(q[None]))
        if states.counts[0] < 0 or states.doubtful[0]:
            return None
        figures, torques = np.empty((1, 6)), np.empty((1, self._problem.joint_count))
        loads, sweep = self._loads(states, slice(None)), self._sweep(objective)
        if not sweep.advance(self._problem, loads, 0, figures, torques, enough=margin):
            return None
        _, value, _, _, _, unit = figures[0].tolist()
        return is_reached(value, unit, margin)

    def _loads(self, states: PlainStates, order: Any) -> FloatArray:
        """Return (K, 2M + 6 + 3L) what bears on the contacts of some states as loops take it."""
        at, problem = self._at, self._problem
        kinematics = Kinematics(states.poses[order], states.columns[order])
        wrenches, torques = carried_loads(
            at.scene, at.hand, at.joint, kinematics, at.T_joint_object
        )
        torques = torques + states.weights[order]
        if at.motors_carry:
            torques = at.carrying(kinematics, wrenches, torques)
        rows, count = np.empty((len(torques), len(self._row))), problem.contact_count
        rows[:] = self._row
        rows[:, count : count + 6] = at.in_axes(kinematics, wrenches)
        begin = count + 6 + 2 * problem.joint_count
        rows[:, begin : begin + problem.joint_count] += torques @ at.motors
        return rows

    def _apply_to(self, objective: Objective) -> bool:
        return self._loops is not None and are_for(
            self._problem.cone_model, objective, self._options
        )

    def _sweep(self, objective: Objective) -> LoadSweep:
        """Return the loops for an objective."""
        if objective not in self._sweeps:
            self._sweeps[objective] = LoadSweep(
                self._problem, objective, self._options, turning=True
            )
            self.learn()
        return self._sweeps[objective]

    @cached_property
    def _problem(self) -> QuasistaticProblem:
        """One of the problems, for what all of them share."""
        return self._at.shared_problem(self._at.scene, self._at.scene.problem())

    @cached_property
    def _row(self) -> FloatArray:
        """What of the loads no state changes; those of the joints are added to it."""
        scene = self._at.scene
        loads = loads_of(scene, jointed_contacts(scene))
        return loads._replace(gravity_torques=np.zeros(self._problem.joint_count)).row()

    @cached_property
    def _loops(self) -> Any:
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
        pairs = _pairs(at, moving[-1], len(pieces)) if self._checks.collisions else None
        return loops_of(at.scene, at.coupling(), moving, _NONE, pairs)


def _pairs(at: AttachedConfigurations, sets: Any, pieces: int) -> Any:
    """Return the pairs of links, and of links beside the object and its pieces, for loops."""
    count, tree = len(at.beside), at.hand.tree
    beside = np.flatnonzero(at.beside).tolist()
    places = [*pairs_of(tree).places, *((k, count + p) for k in beside for p in range(pieces))]
    return core.BodyPairs(sets, [i for i, _ in places], [j for _, j in places])
