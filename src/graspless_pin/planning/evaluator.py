"""Margins and torques of many states of one scene: for planners and other inner loops."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.options import SolveKeywords, objective_and_options, refuse_useless
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.rules import Rules
from graspless_pin.planning.attached_states import AttachedConfigurations
from graspless_pin.planning.configurations import Configuration, Configurations, PinEntry
from graspless_pin.planning.edges import (
    RESOLUTION,
    Edge,
    MotionFault,
    MotionMargins,
    StateValidity,
    required_margin,
    state_validity,
)
from graspless_pin.planning.evaluation import Evaluation
from graspless_pin.planning.many_states import (
    EvaluatedStates,
    Progress,
    checked_states,
    evaluated_states,
    feasible_states,
)
from graspless_pin.planning.pinned_contacts import PinnedState, pinned_state
from graspless_pin.planning.state_solver import StateSolver
from graspless_pin.problem.checks import FloatArray, real_number, truth_values
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.scene import Scene
from graspless_pin.scene.fields import checked_scene
from graspless_pin.scene.scene_findings import StateChecks
from graspless_pin.scene.stated import Motion

if TYPE_CHECKING:
    from graspless_pin.algorithms.uncertainty import Uncertainty


class Evaluator:
    """Evaluates states of a scene: hand configurations, object poses and motions.

    What does not depend on the state is made once: kinematic models, collision shapes, and, in the
    solver, the structure of the programs. The active constraints, the mode and the virtual motion
    of the last answer with the same contacts are tried first, and proven like any answer. The
    optimum does not depend on them; where several sets of torques are equally good, which of them
    is returned may.

    A state in which the object cannot be held, touches nothing, overlaps with something or is
    driven into something has an answer with a status and a reason. So has one with a serious
    finding of `Scene.findings`: the hand touches nothing, or its links are deeper than the scene's
    ``max_penetration`` in supports or in each other. A wrong argument is an error.

    One evaluator may be shared by threads, and pickled for other processes; its warm starts are not
    pickled.

    Attributes:
        scene: The scene that the states are of.
        required_margin: Margin that Algorithm 2 and `is_feasible` ask for, N.
        attached_to: The link that the object moves with; None: with none.

    Examples:
        >>> from graspless_pin import Evaluator, load_scene
        >>> evaluator = Evaluator(load_scene("examples/trihand_pivot_box.yaml"))
        >>> state = evaluator.evaluate({"finger_1_distal": 0.6805})  # rad
        >>> print(f"{state.status}: {state.margin:.3f} N")
        StateStatus.FOUND: 1.131 N
    """

    def __init__(
        self,
        scene: Scene,
        *,
        algorithm: str | None = None,
        margin: float | None = None,
        scale: str | None = None,
        regularization: float | None = None,
        collisions: bool = True,
        need_hand: bool = True,
        position_limits: bool = True,
        pins: Sequence[PinEntry] | None = None,
        attached_to: str | None = None,
        uncertainty: Uncertainty | bool | None = None,
        **options: Unpack[SolveKeywords],
    ) -> None:
        """Set the scene and the options of all solves; the scene's own are the defaults.

        Args:
            scene: The scene; what is not given to `evaluate` is as in it.
            algorithm: ``margin`` (Algorithm 1), ``torque`` (Algorithm 2) or another objective's
                name.
            margin: The attribute `required_margin`.
            scale: See `minimize_torque`.
            regularization: See `maximize_margin`; positive: torques change continuously from
                state to state as long as the contacts do.
            collisions: Whether states are refused in which links are deep in supports or in each
                other, see `unwanted_overlaps`. False for a planner that checks them itself.
            need_hand: Whether states are refused in which the hand does not touch the object. False
                where it may be released onto a support.
            position_limits: Whether states are refused in which a joint is outside its limits.
            pins: Pairs of bodies, e.g. ``("finger_tip", "box")`` and ``("box", "table")``, that
                count as touching in every state, at their nearest points, whatever the gap; then no
                other contacts are looked for. One of a pair is the object. A third entry, (3,) in
                the second body's axes, points out of the face of it that counts. Where a pair
                touches along a face or a line in the scene itself, the corners of that stay where
                they are on the first body. None: what touches is found in each state.
            attached_to: Name of the link that the object moves with, held by the hand alone as in
                the scene; None: it moves with none. States are then configurations of all joints
                but those behind the link.
            uncertainty: What is not known exactly: then torques are one vector for the whole set,
                and margins are those that all members keep, see `Scene.solve`. True: what the scene
                says of it. None: the nominal scene.
            options: See `SolveOptions.parse`; and figures of another objective.

        Raises:
            ArgumentError: If an option is not known or none of the algorithm's, or a figure is out
                of range; if there is no link ``attached_to``, it stands still, or not all that
                touches the object moves with it; or if there is an uncertainty beside pins or
                ``stability="strong"``, or it is none of the scene's.
            SceneError: If the object shall move with a link and the scene has no contacts.
            SolverUnavailableError: If the solver is not installed.
        """
        checked_scene(scene)
        truth_values(collisions=collisions, need_hand=need_hand, position_limits=position_limits)
        given = {"algorithm": algorithm, "margin": margin, "scale": scale, **options}
        given["regularization"] = regularization
        stated = {name: value for name, value in given.items() if value is not None}
        chosen = {**scene.solve_options, **stated}
        self.required_margin = real_number("margin", chosen.get("margin", 0.1), 0.0)
        self.scene = scene
        self.attached_to = attached_to
        how = objective_and_options(**chosen)
        stated.pop("margin", None)  # `is_feasible` needs it under any algorithm
        refuse_useless(stated, chosen.get("algorithm", "margin"))
        checks = StateChecks(collisions, need_hand)
        at: Configurations
        if attached_to is None:
            at = Configurations(scene, pins)
        elif pins is None:
            at = AttachedConfigurations(scene, attached_to)
        else:
            raise ArgumentError(
                "pins",
                "are not supported together with attached_to, which moves contacts; give one",
            )
        at = at if position_limits else at.without_limits
        if uncertainty is None or uncertainty is False:
            self._solver = StateSolver(at, *how, checks)
        else:
            # Imported here: only evaluators with an uncertainty need it.
            from graspless_pin.planning.uncertain_states import UncertainStateSolver
            from graspless_pin.scene.uncertain import required_uncertainty

            unknowns = required_uncertainty(scene) if uncertainty is True else uncertainty
            self._solver = UncertainStateSolver(at, *how, checks, unknowns)

    @property
    def algorithm(self) -> Algorithm | None:
        """The algorithm of `evaluate`: 1 or 2; None: another objective."""
        return self._solver.objective.algorithm

    @property
    def uncertainty(self) -> Uncertainty | None:
        """The set for all of which states are solved; None: the nominal scene."""
        return self._solver.uncertainty

    @property
    def rules(self) -> Rules:
        """The reading of the virtual-sliding constraint."""
        return self._solver.options.rules

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The a joints of a configuration given as an array, in this order.

        All movable joints of the hand in its order, without those that follow others.
        """
        return self._solver.configurations.joint_names

    @property
    def joint_limits(self) -> tuple[FloatArray, FloatArray]:
        """(lower, upper), each (a,), rad or m; infinite where there is no limit."""
        return self._solver.configurations.joint_limits

    def with_regularization(self, regularization: float) -> Evaluator:
        """Return an evaluator of the same scene and options with another regularisation.

        Args:
            regularization: See `maximize_margin`.

        Raises:
            ArgumentError: If it is negative or not finite, or the objective has none.
        """
        changed = copy(self)
        epsilon = real_number("regularization", regularization, 0.0)
        objective = self._solver.objective.with_figure("regularization", epsilon)
        if objective.regularization != epsilon:
            raise ArgumentError("regularization", f"has no effect with {objective.name!r}")
        changed._solver = self._solver.with_objective(objective)
        return changed

    def evaluate(
        self,
        q: Configuration | None = None,
        T_world_object: ArrayLike | None = None,
        twist: ArrayLike | Motion | None = None,
    ) -> Evaluation:
        """Solve for one state.

        Args:
            q: Positions by joint name (the others stay as in the scene), or (a,) positions of
                `joint_names`, rad or m; None: as in the scene.
            T_world_object: (4, 4) pose of the object; None: as in the scene.
            twist: (6,) [v; omega] of the object about its centre of mass, world axes, m/s and
                rad/s, with the fingers moving along; or a `Motion`, with the hand's own motion;
                None: as in the scene; zeros: at rest.

        Returns:
            Margin, torques and contacts, or why there are none.

        Raises:
            ArgumentError: If a joint is unknown, a number not finite, a shape wrong, or the pose
                not rigid.
            SceneError: If the scene cannot be used in any state: a body without a coefficient of
                friction, a shape that cannot be used.
        """
        return self._solver.evaluate(q, T_world_object, twist)

    def pinned(
        self,
        q: Configuration | None = None,
        T_world_object: ArrayLike | None = None,
        twist: ArrayLike | Motion | None = None,
        *,
        friction: ArrayLike | None = None,
        mass: float | None = None,
    ) -> PinnedState:
        """Return gaps, margin and torques of a state with their gradients, for optimisers.

        Args:
            q: See `evaluate`.
            T_world_object: See `evaluate`.
            twist: See `evaluate`.
            friction: (B,) coefficients of the bodies that are pinned, each once in the order of
                `PinnedState.bodies`; None: as in the scene.
            mass: Of the object, kg; None: as in the scene.

        Raises:
            ArgumentError: As for `evaluate`; if the evaluator has no pins; if a joint stands
                outside its limits; or if a coefficient is negative or the mass not positive.
            SceneError: As for `evaluate`.
        """
        return pinned_state(self._solver, q, T_world_object, twist, friction, mass)

    def evaluate_many(
        self,
        q: Configuration | Sequence[Configuration] | None = None,
        T_world_object: ArrayLike | None = None,
        twist: ArrayLike | Motion | None = None,
        *,
        evaluations: Sequence[int] = (),
        workers: int | None = None,
        progress: Progress | None = None,
    ) -> EvaluatedStates:
        """Solve for K states, in any order; return the results of `evaluate` as arrays.

        The optima do not depend on the order of the states or on the number of processes; where
        many torques are equally good, which of them is returned may, and under Algorithm 2 their
        margin.

        Args:
            q: (K, a) positions of `joint_names`, rad or m, or K mappings; or what `evaluate` takes,
                for all states.
            T_world_object: (K, 4, 4) poses of the object, m; or what `evaluate` takes.
            twist: (K, 6) twists, m/s and rad/s; or what `evaluate` takes.
            evaluations: Numbers of the states whose whole `Evaluation` is returned, too.
            workers: Number of processes; 1: this one alone; None: others, too, if the processor
                time of the first states shows that they are worth their start, at most as many as
                cores. They are kept ready for a minute.
            progress: Called now and then with the number of states that are done, and with K.

        Raises:
            ArgumentError: As for `evaluate`, with the state's number; or if not all arguments have
                as many states.
            SceneError: As for `evaluate`.
            CrashError: If a process dies.
        """
        states = checked_states(self._solver.configurations, q, T_world_object, twist)
        return evaluated_states(self._solver, states, evaluations, workers, progress)

    def are_feasible(
        self,
        q: Configuration | Sequence[Configuration] | None = None,
        T_world_object: ArrayLike | None = None,
        twist: ArrayLike | Motion | None = None,
        *,
        margin: float | None = None,
        workers: int | None = None,
        progress: Progress | None = None,
    ) -> NDArray[np.bool_]:
        """Return `is_feasible` of K states: (K,).

        The arguments, and what they may raise, are those of `evaluate_many`; ``margin`` is that of
        `is_feasible`.
        """
        required = required_margin(margin, self.required_margin)
        states = checked_states(self._solver.configurations, q, T_world_object, twist)
        return feasible_states(self._solver, states, required, workers, progress)

    def is_feasible(
        self,
        q: Configuration | None = None,
        T_world_object: ArrayLike | None = None,
        twist: ArrayLike | Motion | None = None,
        *,
        margin: float | None = None,
    ) -> bool:
        """Decide whether a state is valid: it can be held with a margin within the torque limits.

        It stops at the first reason against the state, and at the first proof: a mode that reaches
        the margin, or a bound over all modes below it. That is cheaper than `validity`, which
        returns all reasons, and than `evaluate`, which searches the best mode.

        Args:
            q: See `evaluate`.
            T_world_object: See `evaluate`.
            twist: See `evaluate`.
            margin: Margin to reach, N; None: `required_margin`; -inf: none, and no torques.

        Returns:
            True with a proof; False also where a node or time limit ended the search before one,
            for a state without contacts that could hold the object, and for one with a serious
            finding.

        Raises:
            ArgumentError: As for `evaluate`, or the margin is negative.
            SceneError: As for `evaluate`.
        """
        required = required_margin(margin, self.required_margin)
        return self._solver.is_feasible(q, T_world_object, twist, required)

    def validity(
        self,
        q: Configuration | None = None,
        T_world_object: ArrayLike | None = None,
        twist: ArrayLike | Motion | None = None,
        *,
        margin: float | None = None,
    ) -> StateValidity:
        """Return whether a state is valid, all reasons against it, and its distances from them.

        Reasons against it are a joint outside its limits, collisions, a hand that touches nothing,
        and a margin that is too small. A collision is an overlap deeper than the scene's
        ``max_penetration``: of a link and a support, of two links that `unwanted_overlaps`
        compares, or of the object and anything. Smaller overlaps count as touching, as they do for
        contacts. The clearance is measured from the bodies' surfaces, whatever that depth is.

        Args:
            q: See `evaluate`.
            T_world_object: See `evaluate`.
            twist: See `evaluate`.
            margin: See `is_feasible`, which says yes where this says that the state is valid.

        Returns:
            All reasons, the margin, the clearance and the distances to the joints' limits. These
            are computed for a state outside its joints' limits, too.

        Raises:
            ArgumentError: As for `is_feasible`.
            SceneError: As for `evaluate`.
        """
        required = required_margin(margin, self.required_margin)
        return state_validity(self._solver, q, T_world_object, twist, required)

    def is_valid_motion(
        self,
        q0: Configuration | None = None,
        q1: Configuration | None = None,
        T0_world_object: ArrayLike | None = None,
        T1_world_object: ArrayLike | None = None,
        *,
        margin: float | None = None,
        resolution: tuple[float, float] = RESOLUTION,
    ) -> bool:
        """Decide whether the motion from one state to another is valid: an edge of a planner.

        The arguments, and what they may raise, are those of `first_invalid`, which returns None
        where this is true. The end is checked first.
        """
        edge = self._edge((q0, q1), (T0_world_object, T1_world_object), margin, resolution)
        return edge.state(1.0).valid and edge.fault() is None

    def first_invalid(
        self,
        q0: Configuration | None = None,
        q1: Configuration | None = None,
        T0_world_object: ArrayLike | None = None,
        T1_world_object: ArrayLike | None = None,
        *,
        margin: float | None = None,
        resolution: tuple[float, float] = RESOLUTION,
    ) -> MotionFault | None:
        """Find where the motion from one state to another stops being valid.

        The object goes along the screw motion between its poses, and has that motion's twist in
        every state, so that contacts slide, roll and part as it says: the way back may be valid
        where the way there is not. Fingers move along with the object. The joints' positions are
        interpolated linearly. Contacts are found along the way: states are evaluated eight
        resolutions apart, and where the contacts or the validity of two neighbours differ, states
        between them until they are within the resolution. Contacts that come and go in between are
        missed. A motion that ends by touching a body is not driven into it: within
        ``contact_tolerance`` of its end the object is at rest.

        Args:
            q0: Configuration at the start, see `evaluate`.
            q1: Configuration at the end.
            T0_world_object: (4, 4) pose of the object at the start; None: as in the scene.
            T1_world_object: (4, 4) pose at the end, turned by less than half a turn; None: the
                object stays, at rest.
            margin: See `is_feasible`.
            resolution: (m, rad): of the way of the object's centre of mass and of sliding joints,
                and of the turns of the object and of revolute joints.

        Returns:
            The first state that is not valid, and where; None: the motion is valid.

        Raises:
            ArgumentError: As for `is_feasible`; or the resolution is not positive.
            SceneError: As for `evaluate`.
        """
        edge = self._edge((q0, q1), (T0_world_object, T1_world_object), margin, resolution)
        return edge.fault()

    def motion_margins(
        self,
        q0: Configuration | None = None,
        q1: Configuration | None = None,
        T0_world_object: ArrayLike | None = None,
        T1_world_object: ArrayLike | None = None,
        *,
        resolution: tuple[float, float] = RESOLUTION,
    ) -> MotionMargins:
        """Find the largest margins along the motion from one state to another: a planner's costs.

        They are those of the states that `first_invalid` looks at with a margin of 0, up to the
        first that is not valid. The arguments, and what they may raise, are those of
        `first_invalid`.
        """
        poses = T0_world_object, T1_world_object
        return self._edge((q0, q1), poses, 0.0, resolution).margins()

    def _edge(
        self,
        configurations: tuple[Configuration | None, Configuration | None],
        poses: tuple[ArrayLike | None, ArrayLike | None],
        margin: float | None,
        resolution: tuple[float, float],
    ) -> Edge:
        """Return the motion between two states."""
        required = required_margin(margin, self.required_margin)
        return Edge(self._solver, configurations, poses, required, resolution)

    def scene_at(
        self,
        q: Configuration | None = None,
        T_world_object: ArrayLike | None = None,
        twist: ArrayLike | Motion | None = None,
    ) -> Scene:
        """Return the scene in one state.

        Args:
            q: See `evaluate`.
            T_world_object: See `evaluate`.
            twist: See `evaluate`.

        Raises:
            ArgumentError: As for `evaluate`, or a joint stands outside its limits.
        """
        return self._solver.configurations.scene_at(q, T_world_object, twist)

    def configuration(self, q: Configuration | None = None) -> FloatArray:
        """Return a configuration as an array.

        Args:
            q: See `evaluate`.

        Returns:
            (a,) positions of `joint_names`, rad or m.

        Raises:
            ArgumentError: As for `evaluate`.
        """
        return self._solver.configurations.array({} if q is None else q)
