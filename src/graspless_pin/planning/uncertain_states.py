"""States of a scene with an uncertainty: one vector of torques for all members of the set.

Compiled loops do not solve the joined problems of all members: each state is solved by itself.
Whether a margin is reached is decided sooner where forces near those of an earlier state, or its
mode, prove it, or where the nominal problem, or the joined one under plain Coulomb friction, rules
it out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.algorithms.joined_optimum import common_motions, member_margins, mode_of_member
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.robust_solution import Coverage, RobustSolution
from graspless_pin.algorithms.uncertainty import Uncertainty, figures_in
from graspless_pin.caching import Bounded
from graspless_pin.errors import ArgumentError, UndecidedMotionError
from graspless_pin.modes.kinematics import Conflict, requirements_of
from graspless_pin.modes.rules import SlidingMode, StaticFriction
from graspless_pin.planning.configurations import Configurations
from graspless_pin.planning.evaluation import Evaluation, StateStatus
from graspless_pin.planning.state_solver import PosedScene, StateSolver, status_of_margin
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Member
from graspless_pin.programs.forces import force_coordinates
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene import Scene
from graspless_pin.scene.scene_findings import StateChecks
from graspless_pin.scene.uncertain import check_offsets, corners_in, solve_uncertain
from graspless_pin.scene.uncertain_figures import check_names_in
from graspless_pin.tree_search import Limits

_CANCELS = 1e-9
"""Relative rounding error of a figure, to the load or to the largest figure of its kind."""


class EarlierForces(NamedTuple):
    """Contact forces of an earlier state.

    Attributes:
        mean: (M, 3) mean over members under the same commands, along n, t1 and t2, N.
        margin: Margin that each member keeps, N.
        mode: The common mode of the members; None: plain Coulomb friction.
    """

    mean: FloatArray
    margin: float
    mode: SlidingMode | None


def earlier_forces_serve(
    members: Sequence[Member],
    earlier: EarlierForces,
    margin: float,
    options: SolveOptions,
    *,
    directions: FloatArray | None = None,
) -> bool:
    """Return whether torques near those of earlier forces keep a margin for all members.

    Args:
        members: K members, with as many contacts as there are earlier forces.
        earlier: Forces of an earlier state.
        margin: N.
        options: Options of the solution.
        directions: Directions of feedback torques, see `feedback_torques`.

    Returns:
        True with a proof; False leaves it open.
    """
    if margin > earlier.margin:
        return False
    commands, mode = _balancing_commands(members, earlier), earlier.mode
    if commands is None:
        return False
    margins = member_margins(
        members, commands, options, Limits.from_options(options), directions=directions, mode=mode,
        enough=margin,
    )  # fmt: skip
    slack = _CANCELS * max(margin, members[0].problem.scales.force)
    served = bool((margins >= margin - slack).all())
    if mode is None or not served:
        return served
    motions = common_motions(members[0].problem, len(members))
    try:
        verdict = motions.solve(requirements_of(mode), options.rules.sign)
    except UndecidedMotionError:
        return False
    return not isinstance(verdict, Conflict)


def _balancing_commands(members: Sequence[Member], earlier: EarlierForces) -> FloatArray | None:
    """Return (L,) commands for forces near earlier ones that balance the mean load, or None."""
    first, mode = members[0].problem, earlier.mode
    coordinates = force_coordinates(first)
    layout, kept = coordinates.layout, np.ones(coordinates.layout.size, dtype=bool)
    if mode is not None:
        kept[layout.friction_columns] = mode.signs[layout.cones] != 0
    basis = coordinates.basis[:, kept]
    load = np.mean([member.problem.external_wrench for member in members], axis=0)
    balance = np.linalg.pinv(first.W @ basis, rcond=_CANCELS)
    least = basis @ (balance @ -load)
    inner = coordinates.basis @ earlier.mean.ravel()[layout.axes]
    inner -= basis @ (balance @ (first.W @ inner))
    start, added = members[0].commanded(first.J.T @ least), first.J.T @ inner / members[0].factors
    # The largest margin is mostly at torque limits: then only a part of the inner forces is added.
    slack = np.where(added > 0.0, first.upper_torque - start, start - first.lower_torque)
    needed = np.abs(added)
    counts = needed > _CANCELS * needed.max(initial=0.0)
    share = (1.0 - _CANCELS) * float((slack[counts] / needed[counts]).min(initial=1.0))
    commands, loaded = start + share * added, first.J.any(axis=0)
    within = (commands >= first.lower_torque) & (commands <= first.upper_torque)
    return commands if within[loaded].all() else None


_MOST_KEPT = 256
"""Most sets of contacts whose forces are kept."""


class UncertainStateSolver(StateSolver):
    """Solves states for all members of an uncertainty, each state by itself.

    Attributes:
        uncertainty: The set.
    """

    def __init__(
        self,
        configurations: Configurations,
        objective: Objective,
        options: SolveOptions,
        checks: StateChecks,
        uncertainty: Uncertainty,
    ) -> None:
        """Set the arguments of `StateSolver`, and the set.

        Raises:
            ArgumentError: If it is no `Uncertainty`, or does not fit all states of the scene; if
                contacts are pinned; or if ``stability`` is ``"strong"``.
        """
        if not isinstance(uncertainty, Uncertainty):
            raise ArgumentError(
                "uncertainty",
                f"is {uncertainty!r:.80}; give an Uncertainty, or True for that of the scene",
            )
        if configurations.pins is not None:
            raise ArgumentError(
                "pins",
                "are not supported together with an uncertainty, which has no gradients; give one",
            )
        options.need_weak(
            "verdicts at all corners take too long for many states",
            "leave it out, and call `Scene.solve` with it for those that matter",
        )
        _check_figures(configurations.scene, uncertainty)
        super().__init__(configurations, objective, options, checks)
        self.uncertainty = self._set = uncertainty
        self._earlier: dict[tuple[Any, ...], EarlierForces] = Bounded(_MOST_KEPT)

    def _arguments(self, objective: Objective) -> tuple[Any, ...]:
        """Return the arguments of a solver like this one for an objective."""
        return *super()._arguments(objective), self._set

    def solve(self, q: Any, T_world_object: Any, twist: Any, *, clear: bool = False) -> Evaluation:  # noqa: ARG002
        """Solve for one state: the same as `evaluate`."""
        return self.evaluate(q, T_world_object, twist)

    def evaluate(self, q: Any, T_world_object: Any, twist: Any) -> Evaluation:
        """Return the answer for all members in one state: see `Evaluator.evaluate`."""
        scene, problem, faults = self.posed_scene(q, T_world_object, twist)
        if problem is None or faults:
            return Evaluation(*faults[0], scene, None)
        robust = self._robust_solution(scene, self.objective)
        if robust.found:
            return Evaluation(StateStatus.FOUND, "", scene, robust)
        return Evaluation(StateStatus.of_unsolved(robust.status), str(robust), scene, robust)

    def margin_of(
        self,
        scene: Scene,
        problem: QuasistaticProblem,  # noqa: ARG002 - members are made of the scene
        required: float,
    ) -> tuple[float, StateStatus]:
        """Return the largest margin that one vector of torques keeps for all members."""
        return _margin_and_status(self._robust_solution(scene, Margin()), required)

    def is_feasible(
        self,
        q: Any,
        T_world_object: Any,
        twist: Any,
        margin: float,
        *,
        clear: bool | None = None,  # noqa: ARG002 - loops solve the nominal problem alone
    ) -> bool:
        """Decide whether a state is proven to reach a margin for all members."""
        posed = None
        if margin >= 0.0 and self._is_coulomb:
            posed = self._posed_by_loops(q, T_world_object, twist, Margin())
        if posed is not None and self.loops.reaches_margin(posed, margin) is False:
            return False
        return self.is_feasible_scene(
            self.posed_scene(q, T_world_object, twist, solve=margin >= 0.0), margin
        )

    def is_feasible_scene(self, state: PosedScene, margin: float) -> bool:
        """Decide whether a state has no faults, and one torque vector reaches a margin for all."""
        scene, problem, faults = state
        if faults or problem is None:
            return not faults
        earlier = self._earlier.get(_contact_key(scene))
        if earlier is not None:
            members, directions = corners_in(scene, self._set)
            if earlier_forces_serve(members, earlier, margin, self.options, directions=directions):
                return True
        if self._is_coulomb:
            # The nominal load is a mean of the corners' loads: its margin is at least as large.
            if not super().is_feasible_scene(state, margin):
                return False
        elif not self.options.rules.by_direction:
            coulomb = replace(self.options.rules, static_friction=StaticFriction.COULOMB)
            mode = None if earlier is None else earlier.mode
            if mode is not None and self._reaches_margin(
                self._robust_solution(scene, Margin(), mode), margin
            ):
                return True
            relaxed = replace(self.options, rules=coulomb)
            if not self._reaches_margin(
                self._robust_solution(scene, Margin(), options=relaxed), margin
            ):
                return False
        return self._reaches_margin(self._robust_solution(scene, Margin()), margin)

    @staticmethod
    def _reaches_margin(robust: RobustSolution, margin: float) -> bool:
        return _margin_and_status(robust, margin)[1] is StateStatus.FOUND

    @property
    def _is_coulomb(self) -> bool:
        return self.options.rules.static_friction is StaticFriction.COULOMB

    def _robust_solution(
        self,
        scene: Scene,
        objective: Objective,
        mode: SlidingMode | None = None,
        options: SolveOptions | None = None,
    ) -> RobustSolution:
        """Solve the scene of a state for all members, and keep their mean forces.

        Args:
            scene: The scene in the state.
            objective: The objective.
            mode: The one mode for all members; None: any.
            options: Options of the solution; None: those of this solver.
        """
        how = options or self.options
        robust = solve_uncertain(scene, objective, how, self._set, mode=mode)
        whole = robust.found and robust.coverage is Coverage.WHOLE_SET
        if how is self.options and whole and robust.policy is None:
            first, mean = robust.members[0], robust.contact_forces.mean(axis=0)
            local = (mean[:, None] @ first.problem.frames)[:, 0]
            mode = mode_of_member(robust.solution.given_mode, first)
            self._earlier[_contact_key(scene)] = EarlierForces(local, robust.margin, mode)
        return robust


def _margin_and_status(robust: RobustSolution, required: float) -> tuple[float, StateStatus]:
    # The load of one member: that of the joined problem is the sum over all members.
    force = robust.members[0].problem.scales.force
    return status_of_margin(robust, force, robust.bound, required)


def _contact_key(scene: Scene) -> tuple[Any, ...]:
    """Return the key of states with the same contacts, by which forces and modes are kept."""
    contacts = scene.contacts
    return contacts.bodies, contacts.sliding.any(axis=1).tobytes()


def _check_figures(scene: Scene, uncertainty: Uncertainty) -> None:
    """Refuse figures of an uncertainty that do not fit all states of a scene.

    Raises:
        ArgumentError: Naming them.
    """
    check_offsets(scene, uncertainty)
    check_names_in(scene, uncertainty)
    if any(figures_in(uncertainty.contact_position)):
        raise ArgumentError(
            "contact_position",
            "is sampled, which takes too long for many states; leave it out, and call "
            "`Scene.solve(..., uncertainty=...)` for those that matter",
        )
    friction = uncertainty.friction
    if not isinstance(friction, Mapping) and friction.ndim:
        raise ArgumentError(
            "friction",
            "is given for each contact, but every state has its own contacts; give one figure, or "
            "figures by hand link and support",
        )
