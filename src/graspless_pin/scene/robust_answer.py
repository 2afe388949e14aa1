"""The answer to a scene that says what is not known exactly of it, and what stands beside it."""

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
from graspless_pin.scene.uncertain import stated_by
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.tree_search import Limits

SHARE_TIME = 20.0  # s
"""For the share of a set that is served."""
CORNER_TIME, CORNER_NODES = 20.0, 1000
"""Seconds for the verdicts on all corners, and sets of outcomes that each may look at."""
STIFFNESS = 1.0  # N m/rad
"""Of the joints, where it is told what feedback adds: whether it serves a set is so for any."""


@dataclass(frozen=True, eq=False, repr=False)
class RobustAnswer(Brief):
    """Torques for all that is not known of a scene.

    Attributes:
        uncertainty: What the scene says.
        robust: What was found for the whole set.
        nominal: The solution of the nominal scene.
        at_torques: The same scene under the torques for the set: the forces of the largest margin.
            None where nothing was found.
        served_share: The largest share of the set that is served: 1 where torques were found, NaN
            where it is not known or there is none.
        unserved_share: The smallest share for which no torques were found: it is farther from
            `served_share` than a thousandth where the time for it ended; NaN where it is not known.
        with_feedback: What joint stiffness of `STIFFNESS` makes of it; None: it was not asked.
        at_corners: Whether the object stays at the corners of the set; None: it was not asked.
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
        """That under the torques; where there are none, that of the joined problem, not found."""
        if self.at_torques is None or not self.found:
            why = str(self.robust) if self.nominal.found else self.nominal.explanation
            return changed(self.robust.solution, "explanation", _explanation=why)
        return self.at_torques


def robust_answer(
    scene: Scene,
    algorithm: str | None = None,
    *,
    share_time: float = SHARE_TIME,
    **options: Any,
) -> RobustAnswer:
    """Return what `Scene.solve` finds for what is not known of a scene, and what stands beside it.

    Args:
        scene: The scene; it says what is not known.
        algorithm: See `Scene.solve`.
        share_time: Seconds for the share that is served, where not all of the set is.
        options: See `Scene.solve`; feedback is that of the scene's controller.

    Raises:
        ArgumentError: See `Scene.solve`.
    """
    unknown = stated_by(scene)

    def solve_share(share: float = 1.0, **further: Any) -> RobustSolution:
        asked = {**options, **further}
        return scene.solve(algorithm, uncertainty=unknown.scaled(share), **asked)

    robust, weak = solve_share(), RequiredStability.WEAK.value
    nominal = scene.solve(algorithm, **options)
    if robust.found:
        _, how = scene.asked(algorithm, **options)
        return RobustAnswer(unknown, robust, nominal, _at_torques(scene, robust, how), 1.0)
    share, unserved, with_feedback = math.nan, math.nan, None
    if robust.status not in (Status.NOT_FOUND_IN_LIMIT, Status.STRONG_NOT_FOUND):
        # Which part is served is a question of forces; rest is asked of torques for all of it.
        of_part = partial(solve_share, stability=weak)
        share, unserved = _share_of(of_part, robust, share_time, options.get("time_limit"))
        if nominal.found and robust.feedback is None and nominal.problem.joint_count:
            limit = options.get("time_limit")
            seconds = share_time if limit is None else min(share_time, limit)
            with_feedback = of_part(feedback=STIFFNESS, time_limit=seconds)
    return RobustAnswer(unknown, robust, nominal, None, share, unserved, with_feedback)


def _share_of(
    solve_share: Callable[..., RobustSolution],
    robust: RobustSolution,
    seconds: float,
    each: float | None,
) -> tuple[float, float]:
    """Return the shares of a set that are served and not served, as near as time allows.

    Args:
        solve_share: Returns what is found for a share of it.
        robust: What was found for all of it: no torques.
        seconds: For all searches.
        each: For one; None: all of them.
    """
    limits = Limits.from_now(None, seconds)

    def within(share: float) -> RobustSolution:
        return solve_share(
            share, time_limit=min(one for one in (limits.seconds_left, each) if one is not None)
        )

    found = largest_share(within, robust, limits)
    return found.served, found.failing


def with_corner_verdicts(
    scene: Scene, answer: RobustAnswer, node_limit: int | None = None
) -> RobustAnswer:
    """Return an answer with what happens at the corners of its set, as far as found in time.

    Args:
        scene: The scene.
        answer: Torques for all that is not known of it.
        node_limit: Sets of outcomes that each verdict may look at; None: `CORNER_NODES`.
    """
    robust = answer.robust
    if not answer.found:
        return answer
    if robust.rest is not None:  # asked already, one that was often lost first
        each = zip(robust.rest.corners, robust.rest.verdicts, strict=True)
        known = sorted(each, key=lambda one: one[0])
        members = tuple(robust.members[number] for number, _ in known)
        return replace(answer, at_corners=MemberVerdicts(members, tuple(one for _, one in known)))
    nodes = CORNER_NODES if node_limit is None else node_limit
    found = verdicts_of_members(scene, robust, time_limit=CORNER_TIME, node_limit=nodes)
    return replace(answer, at_corners=found)


def solution_for_all(
    scene: Scene, algorithm: str | None = None, **options: Any
) -> tuple[TorqueSolution, RobustSolution]:
    """Return the solution of a scene under the torques for its whole set, and what they are.

    Where there are no torques, the solution has the scene's own contacts, and tells why.

    Args:
        scene: The scene; it says what is not known.
        algorithm: See `Scene.solve`.
        options: See `Scene.solve`.

    Raises:
        ArgumentError: See `Scene.solve`.
    """
    robust = scene.solve(algorithm, uncertainty=True, **options)
    if robust.found:
        _, how = scene.asked(algorithm, **options)
        return _at_torques(scene, robust, how), robust
    joined = changed(robust.solution, "explanation", _explanation=str(robust))
    return without_torques(scene.solve(algorithm, **options), joined), robust


def without_torques(nominal: TorqueSolution, joined: TorqueSolution) -> TorqueSolution:
    """Return a solution of the scene's own contacts, for which there are no torques.

    Args:
        nominal: That of the nominal scene.
        joined: That of the members together, not found; it tells why.
    """
    return changed(
        nominal,
        status=joined.status,
        certificate=joined.certificate,
        _forces=None,
        _mode=None,
        _explanation=joined.explanation,
    )


def _at_torques(scene: Scene, robust: RobustSolution, how: SolveOptions) -> TorqueSolution:
    """Return the scene under robust torques: the forces of the largest margin."""
    how = replace(how, stability=RequiredStability.WEAK)  # the torques are given
    solution = solve_problem(scene.problem(), AtTorques(Margin(), robust.torques), how)
    return solution.of_source(scene)
