"""Torques for sets with balls, or too many corners, by forces affine in what is unknown."""

from __future__ import annotations

from collections.abc import Sequence

from graspless_pin.algorithms.affine_policy import best_policy
from graspless_pin.algorithms.common_mode import common_mode, tiled
from graspless_pin.algorithms.force_policy import ForcePolicy, Unknowns, extreme_members
from graspless_pin.algorithms.joined_optimum import (
    COMMON_NODES,
    NODES,
    best_of,
    bound_of,
    conflict_of,
    ended_by_time,
    limited,
    spread,
)
from graspless_pin.algorithms.options import Limits, SolveOptions
from graspless_pin.algorithms.robust_solution import Coverage, RobustSolution
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.rules import SlidingMode, StaticFriction
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Member, joined
from graspless_pin.programs.objectives import Margin, Objective, Torque
from graspless_pin.records import changed
from graspless_pin.solution import Status

_AT_ONCE = 16
"""Members, far from each other, that bound the torques or are in conflict, if no policy tells."""
_CRITICAL = 3
"""Members that need affine forces most, and as many far from each other, bound their torques."""
_SHARING = 6
"""Members that a mode is looked for that they have in common."""


def torques_by_policy(
    corners: Sequence[Member],
    unknowns: Unknowns,
    objective: Objective,
    options: SolveOptions,
    limits: Limits,
    *,
    directions: FloatArray | None = None,
    mode: SlidingMode | None = None,
) -> RobustSolution:
    """Return torques that affine forces prove for a whole set, and what none are better than.

    Args:
        corners: K members, with the nominal one first if commands are fed back.
        unknowns: What of the set is not in its corners.
        objective: What is optimised.
        options: How.
        limits: When to stop.
        directions: (L, d) what feedback may add to commands, see `feedback_torques`.
        mode: The one mode for all members.

    Raises:
        ArgumentError: If affine forces do not serve such an objective or rule.
    """
    if not isinstance(objective, Margin | Torque) or objective.regularization > 0.0:
        raise ArgumentError(
            "uncertainty",
            "has balls, or too many corners; they need the objective margin or torque, without a "
            "regularization",
        )
    coulomb = options.rules.static_friction is StaticFriction.COULOMB
    if not coulomb:
        options.rules.need_signs("an uncertainty with balls, or too many corners,")
    modes = [mode]
    if mode is None and not coulomb:
        modes = _common_modes(corners, unknowns, objective, options, limits, directions)
    policy, free = best_policy(
        corners, unknowns, objective, directions=directions, modes=modes, limits=limits
    )
    names = corners[0].problem.joint_names
    if policy is not None:
        chosen = _bounding(policy)
        together, how = joined(chosen, directions), limited(limits.within(options), NODES)
        every = None if mode is None else tiled(mode, len(chosen))
        bounding = solve_problem(together, objective, how, mode=every)
        return RobustSolution(
            bounding, Coverage.WHOLE_SET, bounding.certificate.bound, (*corners, *chosen), names,
            policy=policy,
        )  # fmt: skip
    extremes = extreme_members(corners[:1], unknowns, free[:1])
    if not free:
        extremes = _far_members(corners, unknowns, _AT_ONCE)
    together, how = joined(extremes, directions), limits.within(options)
    solution, coverage = best_of(together, objective, how, extremes, mode)
    bound = bound_of(together, objective, how, extremes, solution, mode)
    conflict: tuple[int, ...] = ()
    if solution.status is Status.INFEASIBLE_FORCES:
        conflict = conflict_of(solution, extremes, objective, options, limits, directions)
    elif limits.passed:
        solution = ended_by_time(solution)
    elif solution.found:  # for these members alone
        solution = changed(solution, status=Status.UNVERIFIED, _forces=None, _mode=None)
    return RobustSolution(solution, coverage, bound, tuple(extremes), names, conflict)


def _common_modes(
    corners: Sequence[Member],
    unknowns: Unknowns,
    objective: Objective,
    options: SolveOptions,
    limits: Limits,
    directions: FloatArray | None,
) -> list[SlidingMode | None]:
    """Return modes in which affine forces are looked for: of members far off, and of corners."""
    found: dict[bytes, SlidingMode | None] = {}
    for some in (_far_members(corners, unknowns, _SHARING), spread(corners, _SHARING)[0]):
        how = limited(limits.within(options), COMMON_NODES)
        mode = common_mode(joined(some, directions), some, objective, how)
        if mode is not None:
            found[mode.selection.tobytes() + mode.signs.tobytes()] = mode
    return list(found.values())


def _far_members(corners: Sequence[Member], unknowns: Unknowns, count: int) -> list[Member]:
    """Return members far from each other: corners, and ends of what is unknown."""
    some = spread(corners, count)[0]
    return spread([*corners, *extreme_members(some, unknowns)], count)[0]


def _bounding(policy: ForcePolicy) -> list[Member]:
    """Return the members that need a policy's torques most, with the nominal one for feedback."""
    chosen = policy.critical(_CRITICAL)
    if policy.directions is not None or not chosen:
        chosen.insert(0, policy.corners[0])
    return chosen
