"""Torques for a scene's uncertainty, with its weight, motors and fingers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.joined_optimum import without_forces
from graspless_pin.algorithms.options import RequiredStability, SolveOptions
from graspless_pin.algorithms.robust_solution import RestAtCorners, RobustSolution
from graspless_pin.algorithms.robust_torques import (
    Feedback,
    corners_of,
    joint_stiffness,
    solve_robust,
)
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.algorithms.tolerance_tables import Tolerances
from graspless_pin.algorithms.tolerances import tolerances
from graspless_pin.algorithms.uncertain_members import Weight
from graspless_pin.algorithms.uncertainty import Uncertainty, figures_in
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.joint_columns import STILL
from graspless_pin.holding.verdict import Stability, StabilityVerdict
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, motor_torques
from graspless_pin.problem.matrices import wrench_map
from graspless_pin.problem.members import Member, feedback_torques, join_members
from graspless_pin.programs.analysis_objectives import AtTorques
from graspless_pin.programs.objectives import Objective
from graspless_pin.scene.entry_findings import box_around, likely_lengths
from graspless_pin.scene.fields import SceneFields, label_of
from graspless_pin.scene.load_wrenches import acting_forces, object_motion
from graspless_pin.scene.problem_data import (
    fingers_of_motors,
    joint_columns,
    jointed_contacts,
    problem_of,
)
from graspless_pin.scene.scene_stability import torques_at_rest, under_feedback, verdicts_under
from graspless_pin.scene.uncertain_figures import by_contact_and_joint
from graspless_pin.solution import Guarantee, Status, TorqueSolution
from graspless_pin.tree_search import Limits


def solve_uncertain(
    scene: SceneFields,
    objective: Objective,
    options: SolveOptions,
    uncertainty: Uncertainty,
    *,
    feedback: Feedback | None = None,
    mode: SlidingMode | None = None,
) -> RobustSolution:
    """Return torques that serve the whole set of a scene's uncertainty: see `Scene.solve`.

    Args:
        scene: The nominal scene.
        objective: The objective.
        options: Options of the search.
        uncertainty: The set.
        feedback: See `minimize_torque`; None: the stiffness that the scene's controller states.
        mode: The common mode of all members.

    Raises:
        ArgumentError: See `solve_robust`, `weight_of` and `check_offsets`.
    """
    problem = problem_of(scene)
    if isinstance(uncertainty, Uncertainty):
        check_offsets(scene, uncertainty)
        uncertainty = by_contact_and_joint(scene, problem, uncertainty)
    arguments = {
        **_scene_arguments(scene, problem, feedback),
        "slopes": _jacobian_slopes(scene, uncertainty),
    }

    def solve_set(
        problem: QuasistaticProblem, objective: Objective, options: SolveOptions
    ) -> RobustSolution:
        return solve_robust(problem, objective, uncertainty, options, mode=mode, **arguments)

    if not options.strong:
        return solve_set(problem, objective, options)
    if any(figures_in(uncertainty.contact_position)):
        raise ArgumentError(
            "contact_position",
            "is sampled, but stability='strong' proves rest at corners of the set only; leave "
            "out one of them",
        )
    return _strong_torques(scene, objective, options, solve_set)


SolveSet = Callable[[QuasistaticProblem, Objective, SolveOptions], RobustSolution]
"""Finds the best torques for the set about a given problem, for a given objective."""


def _strong_torques(
    scene: SceneFields, objective: Objective, options: SolveOptions, solve_set: SolveSet
) -> RobustSolution:
    """Return torques for a set under which rest is the only outcome at each corner.

    Candidates are found as for one problem: torques that need less friction at supports rely on the
    fingers, whose forces the torques determine. Each candidate gets verdicts at the corners, first
    at the one where the previous candidate failed. Between corners nothing is proven about rest.

    Where a controller is stated, or feedback given, rest has to last under it.

    Args:
        scene: The nominal scene.
        objective: The objective.
        options: Options; `verdict_nodes` bound each verdict, and `time_limit` the whole call.
        solve_set: Finds the best torques for the set.

    Returns:
        The robust solution, with the verdicts in `rest`. Its status is STRONG, that of the best
        torques where these keep rest themselves, or STRONG_NOT_FOUND.
    """
    # Imported here, as verdicts need their own search and solver.
    from graspless_pin.algorithms.guaranteed_torques import FIRST_NODES, weaker_supports

    limits, problem = Limits.from_options(options), problem_of(scene)
    options = replace(options, stability=RequiredStability.WEAK)
    best = solve_set(problem, objective, options)
    if not best.found:
        return best
    scene = under_feedback(scene, best.feedback)
    lasting = scene.controller.is_given and not problem.is_sliding.any()

    def is_lost(verdict: StabilityVerdict) -> bool:
        return not verdict.keeps_rest(lasting=lasting)

    def verdicts_at_corners(torques: FloatArray, order: list[int], nodes: int) -> RestAtCorners:
        """Return verdicts on corners in an order, up to the first where rest is lost."""
        members = [best.members[number] for number in order]
        judged = verdicts_under(
            scene, members, torques, best.feedback, limits=limits, until=is_lost,
            node_limit=min(nodes, options.verdict_nodes),
        )  # fmt: skip
        is_kept = not judged.left_out and not any(map(is_lost, judged.verdicts))
        asked_corners = order[: len(judged.verdicts)]
        return RestAtCorners(tuple(asked_corners), judged.verdicts, is_kept, 0)

    order = [*range(len(best.members))]
    tried: list[tuple[FloatArray, RestAtCorners]] = []

    def candidates() -> Iterator[tuple[FloatArray, int]]:
        """Yield candidate torques, each with the node limit of its verdicts."""
        yield best.torques, FIRST_NODES
        guesses = weaker_supports(problem, objective) if best.policy is None else ()
        for weaker_problem, weaker_objective in guesses:
            result = solve_set(weaker_problem, weaker_objective, limits.with_time_left(options))
            if result.found and result.policy is None:
                yield result.torques, FIRST_NODES
        if options.verdict_nodes > FIRST_NODES:
            for torques, rest in tuple(tried):
                if rest.verdicts and rest.verdicts[-1].status is Stability.UNDECIDED:
                    yield torques, options.verdict_nodes

    for torques, nodes in candidates():
        rest = verdicts_at_corners(torques, order, nodes)
        tried.append((torques, rest))
        solved = _set_at_torques(best, torques, options, len(tried)) if rest.kept else None
        if solved is not None:
            return replace(solved, rest=replace(rest, tried=len(tried)))
        if rest.corners:
            order.insert(0, order.pop(order.index(rest.corners[-1])))
        if limits.is_time_over:
            break
    rest = max((one for _, one in tried), key=lambda one: len(one.corners))
    # Without a policy the members of the solution come first.
    offset = 0 if best.policy is None else len(best.policy.corners)
    members = best.members[offset:] + best.members[:offset]
    corners = (*((one - offset) % len(members) for one in rest.corners),)
    rest = replace(rest, kept=False, tried=len(tried), corners=corners)
    unsolved = without_forces(best.solution, Status.STRONG_NOT_FOUND)
    return replace(best, solution=unsolved, policy=None, members=members, rest=rest)


def _set_at_torques(
    best: RobustSolution, torques: FloatArray, options: SolveOptions, tried: int
) -> RobustSolution | None:
    """Return the robust solution under given torques; None if they do not serve the set."""
    from graspless_pin.algorithms.guaranteed_torques import bounded_by

    if torques is best.torques or np.array_equal(torques, best.torques):
        return best
    directions, objective = None, best.solution.objective
    commands = torques
    if best.feedback is not None:
        directions = feedback_torques(best.members[0].problem, best.feedback)
        joint_torques = [torques_at_rest(one, torques, best.feedback) for one in best.members]
        commands = np.concatenate(
            [(one - member.offsets) / member.factors
             for one, member in zip(joint_torques, best.members, strict=True)]
        )  # fmt: skip
    whole: TorqueSolution = best.solution
    if len(best.joined_members) < len(best.members):
        whole = solve_problem(join_members(best.members, directions), objective, options)
    fixed = solve_problem(
        whole.problem, AtTorques(objective, commands), options, mode=whole.given_mode
    )
    if not (whole.found and fixed.found):
        return None
    solution = bounded_by(whole, replace(fixed, objective=objective))
    gap = abs(whole.value - solution.value)
    guarantee = Guarantee(
        None, whole.value, gap, tried
    )  # no verdict of its own: each member has one
    return replace(best, solution=replace(solution, status=Status.STRONG, guarantee=guarantee))


def _scene_arguments(
    scene: SceneFields, problem: QuasistaticProblem, feedback: Feedback | None = None
) -> dict[str, Any]:
    """Return weight, feedback and fingers as arguments of `solve_robust` and `tolerances`.

    The default of feedback is the scene's controller, if that states a stiffness.
    """
    controller = scene.controller
    if feedback is None and controller.is_given and not controller.holds_joints:
        feedback = controller
    return {
        "weight": weight_of(scene, problem.joint_count),
        "feedback": feedback,
        "fingers": {} if scene.hand is None else fingers_of_motors(scene.hand),
    }


def _jacobian_slopes(scene: SceneFields, uncertainty: Uncertainty) -> FloatArray | None:
    """Return the change of J as contacts move by 1 m along each axis: see `moved_members`."""
    if not isinstance(uncertainty, Uncertainty) or not any(
        figures_in(uncertainty.contact_position)
    ):
        return None
    state = jointed_contacts(scene)
    touching, jacobian = state.contacts.arrays, state.joints.jacobian
    # The Jacobian is linear in the positions of points on rigid links.
    shifted = [replace(touching, positions=touching.positions + axis) for axis in np.eye(3)]
    return np.array([joint_columns(scene.hand, one).jacobian - jacobian for one in shifted])


def corners_in(
    scene: SceneFields, uncertainty: Uncertainty
) -> tuple[tuple[Member, ...], FloatArray | None]:
    """Return the corners of a set without balls, and the joint stiffness of the controller.

    Args:
        scene: The nominal scene.
        uncertainty: The set.
    """
    problem = problem_of(scene)
    figures, arguments = (
        by_contact_and_joint(scene, problem, uncertainty),
        _scene_arguments(scene, problem),
    )
    stiffness = joint_stiffness(problem, arguments["feedback"], arguments["fingers"])
    return corners_of(problem, figures, arguments["weight"], stiffness)


def required_uncertainty(scene: SceneFields) -> Uncertainty:
    """Return the uncertainty that a scene states.

    Raises:
        ArgumentError: If it states none.
    """
    if scene.uncertainty is None:
        raise ArgumentError(
            "uncertainty",
            f"is True, but {label_of(scene)} has no uncertainty; give an Uncertainty, or the "
            "key 'uncertainty' in the scene file",
        )
    return scene.uncertainty


def tolerances_of(
    scene: SceneFields,
    torques: ArrayLike | Mapping[str, float],
    feedback: Feedback | None = None,
    **options: Any,
) -> Tolerances:
    """Return the tolerances of motor torques: see `Scene.tolerances`.

    Args:
        scene: The nominal scene.
        torques: (L,) N m (N), or by joint.
        feedback: See `tolerances`; None: the stiffness that the scene's controller states.
        options: See `tolerances`.

    Raises:
        ArgumentError: See `tolerances`, and `weight_of`.
        NoSolutionError: See `tolerances`.
    """
    problem = problem_of(scene)
    commanded = motor_torques(problem.joint_names, torques)
    return tolerances(problem, commanded, **_scene_arguments(scene, problem, feedback), **options)


def check_offsets(scene: SceneFields, uncertainty: Uncertainty) -> None:
    """Refuse offsets of the centre of mass or of contacts that are larger than the object.

    Raises:
        ArgumentError: If one is larger.
    """
    lowest, highest = box_around(scene.object)
    size = highest - lowest
    offset = uncertainty.center_of_mass + uncertainty.center_of_mass_radius
    farthest = max(figures_in(uncertainty.contact_position), default=0.0)
    if farthest > size.max():
        raise ArgumentError(
            "uncertainty",
            f"contact_position may be off by {farthest:g} m, but object {scene.object.name!r} is "
            f"{size.max():.4g} m large; give metres",
        )
    if (offset > size).any():
        axis = int(np.argmax(offset / size))
        raise ArgumentError(
            "uncertainty",
            f"center_of_mass may be off by {offset[axis]:g} m along {'xyz'[axis]}, but object "
            f"{scene.object.name!r} is {size[axis]:.4g} m large there; give metres"
            f"{likely_lengths(offset, size)}",
        )


def weight_of(scene: SceneFields, joint_count: int) -> Weight:
    """Return the weights in a scene's load and torques, which an uncertainty changes.

    Args:
        scene: The scene.
        joint_count: L, the number of its problem's joints.

    Raises:
        ArgumentError: If the object turns as it moves: then its inertia would count, too.
    """
    target, size = scene.object, float(np.linalg.norm(scene.gravity))
    motion = object_motion(scene)
    if motion.velocity[3:].any() or motion.acceleration[3:].any():
        raise ArgumentError(
            "scene", "has an object that turns: uncertain mass properties require one that does not"
        )
    fields = sum((load.field for load in scene.loads), np.zeros(3))
    steady = target.mass * (fields - motion.acceleration[:3])
    payloads = [payload for payload in acting_forces(scene, STILL) if payload.of_gravity]
    payload_map = sum(
        (np.linalg.norm(payload.force) * wrench_map(payload.lever[None]) for payload in payloads),
        np.zeros((6, 3)),
    )
    carried = np.zeros((joint_count, 3))
    if scene.hand is not None and scene.count_own_weight:
        link_torques = np.array([scene.hand.gravity_torques(size * axis) for axis in np.eye(3)]).T
        carried[: len(link_torques)] = link_torques
    axes = target.T_world_object[:3, :3]
    force = target.mass * scene.gravity
    return Weight(force, steady, np.zeros(3), axes, payload_map, carried, target.mass)
