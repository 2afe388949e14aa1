"""The robust answer to a scene with an uncertainty, and figures shown with it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from graspless_pin.algorithms.attainable_tolerances import largest_share
from graspless_pin.algorithms.options import RequiredStability, SolveOptions
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.algorithms.uncertainty import Uncertainty
from graspless_pin.programs.analysis_objectives import AtTorques
from graspless_pin.programs.objectives import Margin
from graspless_pin.records import Brief, changed
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.scene_stability import MemberVerdicts, verdicts_of_members
from graspless_pin.scene.uncertain import required_uncertainty
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.tree_search import Limits

SHARE_TIME = 20.0  # s
"""Time limit for the share of the set that torques serve."""
CORNER_TIME, CORNER_NODES = 20.0, 1000
"""Seconds for the verdicts on all corners, and node limit (sets of outcomes) of each."""
STIFFNESS = 1.0  # N m/rad
"""Joint stiffness of `with_feedback`; whether a set is served does not depend on its size."""


@dataclass(frozen=True, eq=False, repr=False)
class RobustAnswer(Brief):
    """Torques that serve the whole set of a scene's uncertainty.

    Attributes:
        uncertainty: The scene's uncertainty.
        robust: The robust solution for the whole set.
        nominal: The solution of the nominal scene.
        at_torques: Solution of the nominal scene under the robust torques, with the contact forces
            of the largest margin; None without torques.
        served_share: Largest share of the set that torques serve: 1 where torques were found, NaN
            where it is unknown or no share is served.
        unserved_share: Smallest share for which no torques were found, within a thousandth of
            `served_share` unless the time limit was reached; NaN where it is unknown.
        with_feedback: Robust solution with joint stiffness `STIFFNESS`; None: not computed.
        at_corners: Verdicts on the corners of the set; None: not computed.
    """

    uncertainty: Uncertainty
    robust: RobustSolution
    nominal: TorqueSolution
    at_torques: TorqueSolution | None
    served_share: float
    unserved_share: float = math.nan
    with_feedback: RobustSolution | None = None
    at_corners: MemberVerdicts | None = None

    @property
    def found(self) -> bool:
        """Whether there are torques."""
        return self.robust.found

    @property
    def solution(self) -> TorqueSolution:
        """The solution under the torques; without torques that of the joined problem, not found."""
        if self.at_torques is None or not self.found:
            reason = str(self.robust) if self.nominal.found else self.nominal.explanation
            return changed(self.robust.solution, "explanation", _explanation=reason)
        return self.at_torques


def robust_answer(
    scene: Scene,
    algorithm: str | None = None,
    *,
    share_time: float = SHARE_TIME,
    **options: Any,
) -> RobustAnswer:
    """Solve a scene for its uncertainty and nominally; without torques find the share served.

    Args:
        scene: The scene, with an uncertainty.
        algorithm: See `Scene.solve`.
        share_time: Seconds for the share that is served, where the whole set is not.
        options: See `Scene.solve`; feedback is that of the scene's controller.

    Raises:
        ArgumentError: See `Scene.solve`.
    """
    uncertainty = required_uncertainty(scene)

    def solve_share(share: float = 1.0, **further: Any) -> RobustSolution:
        merged = {**options, **further}
        return scene.solve(algorithm, uncertainty=uncertainty.scaled(share), **merged)

    robust, weak = solve_share(), RequiredStability.WEAK.value
    nominal = scene.solve(algorithm, **options)
    if robust.found:
        _, settings = scene.objective_and_options(algorithm, **options)
        return RobustAnswer(
            uncertainty, robust, nominal, _at_robust_torques(scene, robust, settings), 1.0
        )
    share, unserved, with_feedback = math.nan, math.nan, None
    if robust.status not in (Status.NOT_FOUND_IN_LIMIT, Status.STRONG_NOT_FOUND):
        # The share is computed without proofs of rest, which are for torques of the whole set.
        solve_weak = partial(solve_share, stability=weak)
        share, unserved = _served_share(solve_weak, robust, share_time, options.get("time_limit"))
        if nominal.found and robust.feedback is None and nominal.problem.joint_count:
            limit = options.get("time_limit")
            seconds = share_time if limit is None else min(share_time, limit)
            with_feedback = solve_weak(feedback=STIFFNESS, time_limit=seconds)
    return RobustAnswer(uncertainty, robust, nominal, None, share, unserved, with_feedback)


def _served_share(
    solve_share: Callable[..., RobustSolution],
    robust: RobustSolution,
    seconds: float,
    each_limit: float | None,
) -> tuple[float, float]:
    """Return the largest share of a set that is served, and the smallest that is not.

    Args:
        solve_share: Solves for a share of the set.
        robust: The result for the whole set: no torques.
        seconds: Time limit of all searches, which ends the bisection.
        each_limit: Time limit of each search; None: only that of all.
    """
    limits = Limits.from_now(None, seconds)

    def solve_in_time(share: float) -> RobustSolution:
        return solve_share(
            share,
            time_limit=min(one for one in (limits.seconds_left, each_limit) if one is not None),
        )

    result = largest_share(solve_in_time, robust, limits)
    return result.served, result.failing


def with_corner_verdicts(
    scene: Scene, answer: RobustAnswer, node_limit: int | None = None
) -> RobustAnswer:
    """Return an answer with verdicts on the corners of its set, within `CORNER_TIME`.

    Args:
        scene: The scene.
        answer: The robust answer.
        node_limit: Node limit (sets of outcomes) of each verdict; None: `CORNER_NODES`.
    """
    robust = answer.robust
    if not answer.found:
        return answer
    if robust.rest is not None:  # asked already, in another order
        pairs = zip(robust.rest.corners, robust.rest.verdicts, strict=True)
        known = sorted(pairs, key=lambda one: one[0])
        members = tuple(robust.members[number] for number, _ in known)
        return replace(answer, at_corners=MemberVerdicts(members, tuple(one for _, one in known)))
    nodes = CORNER_NODES if node_limit is None else node_limit
    verdicts = verdicts_of_members(scene, robust, time_limit=CORNER_TIME, node_limit=nodes)
    return replace(answer, at_corners=verdicts)


def solution_for_all(
    scene: Scene, algorithm: str | None = None, **options: Any
) -> tuple[TorqueSolution, RobustSolution]:
    """Return the solution of a scene under its robust torques, and the robust solution.

    Without torques the solution has the scene's own contacts, and explains why.

    Args:
        scene: The scene, with an uncertainty.
        algorithm: See `Scene.solve`.
        options: See `Scene.solve`.

    Raises:
        ArgumentError: See `Scene.solve`.
    """
    robust = scene.solve(algorithm, uncertainty=True, **options)
    if robust.found:
        _, settings = scene.objective_and_options(algorithm, **options)
        return _at_robust_torques(scene, robust, settings), robust
    joined = changed(robust.solution, "explanation", _explanation=str(robust))
    return without_torques(scene.solve(algorithm, **options), joined), robust


def without_torques(nominal: TorqueSolution, joined: TorqueSolution) -> TorqueSolution:
    """Return a solution without torques for the scene's own contacts.

    Args:
        nominal: Solution of the nominal scene.
        joined: Solution of the joined members, not found, with its explanation.
    """
    return changed(
        nominal,
        status=joined.status,
        certificate=joined.certificate,
        _forces=None,
        _mode=None,
        _explanation=joined.explanation,
    )


def _at_robust_torques(
    scene: Scene, robust: RobustSolution, settings: SolveOptions
) -> TorqueSolution:
    """Return the scene's solution under robust torques: the forces of the largest margin."""
    settings = replace(settings, stability=RequiredStability.WEAK)  # the torques are given
    solution = solve_problem(scene.problem(), AtTorques(Margin(), robust.torques), settings)
    return solution.with_source(scene)
