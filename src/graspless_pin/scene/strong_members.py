"""Torques for a whole set of which rest is the only outcome at each of its corners.

Guesses, as for one problem: torques for the set that need less of the supports' friction rely on
the fingers, whose loads the torques make. Each is judged at the corners, that one first at which
the guess before was not kept. Between the corners nothing is proven about rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from graspless_pin.algorithms.guaranteed_torques import FIRST_NODES, bounded_by, weaker_supports
from graspless_pin.algorithms.joined_optimum import without_forces
from graspless_pin.algorithms.options import Limits, RequiredStability, SolveOptions
from graspless_pin.algorithms.robust_solution import RestAtCorners, RobustSolution
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.holding.verdict import Stability, StabilityVerdict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import feedback_torques, joined
from graspless_pin.programs.analysis_objectives import at_torques
from graspless_pin.programs.objectives import Objective
from graspless_pin.scene.fields import SceneFields
from graspless_pin.scene.member_verdicts import torques_at_rest, under_feedback, verdicts_under
from graspless_pin.scene.problem_data import problem_of
from graspless_pin.solution import Guarantee, Status, TorqueSolution

Solved = Callable[[QuasistaticProblem, Objective, SolveOptions], RobustSolution]
"""Finds the best torques for the set about another problem, for another objective."""


def strong_for_members(
    scene: SceneFields, objective: Objective, options: SolveOptions, solved: Solved
) -> RobustSolution:
    """Return torques for a set of which rest is the only outcome at each corner.

    Where a controller is stated, or feedback given, rest has to last under it.

    Args:
        scene: The nominal scene.
        objective: What is optimised.
        options: How; `verdict_nodes` bound each verdict, and `time_limit` the whole call.
        solved: Finds the best torques for the set.

    Returns:
        What was found, with the verdicts in `rest`: with status STRONG, with that of the best
        torques where these keep rest themselves, or with STRONG_NOT_FOUND.
    """
    limits, problem = Limits.of(options), problem_of(scene)
    options = replace(options, stability=RequiredStability.WEAK)
    best = solved(problem, objective, options)
    if not best.found:
        return best
    scene = under_feedback(scene, best.feedback)
    lasting = scene.controller.is_stated and not problem.is_sliding.any()

    def is_lost(verdict: StabilityVerdict) -> bool:
        return not verdict.keeps_rest(lasting=lasting)

    def judged(torques: FloatArray, order: list[int], nodes: int) -> RestAtCorners:
        """Return verdicts in an order of corners, up to the first where rest is lost."""
        members = [best.members[number] for number in order]
        found = verdicts_under(
            scene, members, torques, best.feedback, limits=limits, until=is_lost,
            node_limit=min(nodes, options.verdict_nodes),
        )  # fmt: skip
        kept = not found.left_out and not any(map(is_lost, found.verdicts))
        asked = order[: len(found.verdicts)]
        return RestAtCorners(tuple(asked), found.verdicts, kept, 0)

    order = [*range(len(best.members))]
    tried: list[tuple[FloatArray, RestAtCorners]] = []

    def candidates() -> Iterator[tuple[FloatArray, int]]:
        """Yield torques, and how many nodes a verdict on them may have."""
        yield best.torques, FIRST_NODES
        guesses = weaker_supports(problem, objective) if best.policy is None else ()
        for weaker, aim in guesses:
            found = solved(weaker, aim, limits.within(options))
            if found.found and found.policy is None:
                yield found.torques, FIRST_NODES
        if options.verdict_nodes > FIRST_NODES:
            for torques, rest in tuple(tried):
                if rest.verdicts and rest.verdicts[-1].status is Stability.UNDECIDED:
                    yield torques, options.verdict_nodes

    for torques, nodes in candidates():
        rest = judged(torques, order, nodes)
        tried.append((torques, rest))
        held = _held(best, torques, options, len(tried)) if rest.kept else None
        if held is not None:
            return replace(held, rest=replace(rest, tried=len(tried)))
        if rest.corners:
            order.insert(0, order.pop(order.index(rest.corners[-1])))
        if limits.passed:
            break
    rest = max((one for _, one in tried), key=lambda one: len(one.corners))
    rest = replace(rest, kept=False, tried=len(tried))
    none = without_forces(best.solution, Status.STRONG_NOT_FOUND)
    return replace(best, solution=none, policy=None, rest=rest)


def _held(
    best: RobustSolution, torques: FloatArray, options: SolveOptions, tried: int
) -> RobustSolution | None:
    """Return the whole set under torques, with the best's bound; None: they do not serve it."""
    if torques is best.torques or np.array_equal(torques, best.torques):
        return best
    directions, objective = None, best.solution.objective
    commands = torques
    if best.feedback is not None:
        directions = feedback_torques(best.members[0].problem, best.feedback)
        made = [torques_at_rest(one, torques, best.feedback) for one in best.members]
        commands = np.concatenate(
            [(one - member.offsets) / member.factors
             for one, member in zip(made, best.members, strict=True)]
        )  # fmt: skip
    whole: TorqueSolution = best.solution
    if len(best.joined_members) < len(best.members):
        whole = solve_problem(joined(best.members, directions), objective, options)
    held = solve_problem(
        whole.problem, at_torques(objective, commands), options, mode=whole.given_mode
    )
    if not (whole.found and held.found):
        return None
    solution = bounded_by(whole, replace(held, objective=objective))
    gap = abs(whole.value - solution.value)
    guarantee = Guarantee(None, whole.value, gap, tried)  # verdicts are of members
    return replace(best, solution=replace(solution, status=Status.STRONG, guarantee=guarantee))
