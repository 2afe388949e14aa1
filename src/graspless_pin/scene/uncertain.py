"""Torques for what is not known exactly of a scene: its own weight, motors and fingers."""

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
from graspless_pin.problem.members import Member, feedback_torques, joined
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
    """Return torques that serve all that a scene may be: see `Scene.solve`.

    Args:
        scene: The nominal scene.
        objective: What is optimised.
        options: How.
        uncertainty: The set.
        feedback: See `minimize_torque`; None: the stiffness that the scene's controller states.
        mode: The one mode for all members.

    Raises:
        ArgumentError: See `solve_robust`, and `weight_of`; if the centre of mass may be farther off
            than the object is large.
    """
    problem = problem_of(scene)
    if isinstance(uncertainty, Uncertainty):
        check_offsets(scene, uncertainty)
        uncertainty = by_contact_and_joint(scene, problem, uncertainty)
    known = {**_known_of(scene, problem, feedback), "slopes": _slopes(scene, uncertainty)}

    def solve_set(
        problem: QuasistaticProblem, objective: Objective, options: SolveOptions
    ) -> RobustSolution:
        return solve_robust(problem, objective, uncertainty, options, mode=mode, **known)

    if not options.strong:
        return solve_set(problem, objective, options)
    if any(figures_in(uncertainty.contact_position)):
        raise ArgumentError(
            "contact_position",
            "is sampled, and stability='strong' proves rest at vertices of the set only; leave "
            "out one of the two",
        )
    return _strong_for_members(scene, objective, options, solve_set)


SolveSet = Callable[[QuasistaticProblem, Objective, SolveOptions], RobustSolution]
"""Finds the best torques for the set about another problem, for another objective."""


def _strong_for_members(
    scene: SceneFields, objective: Objective, options: SolveOptions, solve_set: SolveSet
) -> RobustSolution:
    """Return torques for a set of which rest is the only outcome at each vertex of it.

    Guesses, as for one problem: torques for the set that need less of the supports' friction rely
    on the fingers, whose loads the torques make. Each is judged at the vertices, that one first at
    which the guess before was not kept. Between them nothing is proven about rest.

    Where a controller is stated, or feedback given, rest has to last under it.

    Args:
        scene: The nominal scene.
        objective: What is optimised.
        options: How; `verdict_nodes` bound each verdict, and `time_limit` the whole call.
        solve_set: Finds the best torques for the set.

    Returns:
        What was found, with the verdicts in `rest`: with status STRONG, with that of the best
        torques where these keep rest themselves, or with STRONG_NOT_FOUND.
    """
    # Loaded here: verdicts need their own search and solver.
    from graspless_pin.algorithms.guaranteed_torques import FIRST_NODES, weaker_supports

    limits, problem = Limits.of(options), problem_of(scene)
    options = replace(options, stability=RequiredStability.WEAK)
    best = solve_set(problem, objective, options)
    if not best.found:
        return best
    scene = under_feedback(scene, best.feedback)
    lasting = scene.controller.is_stated and not problem.is_sliding.any()

    def is_lost(verdict: StabilityVerdict) -> bool:
        return not verdict.keeps_rest(lasting=lasting)

    def verdicts_at_corners(torques: FloatArray, order: list[int], nodes: int) -> RestAtCorners:
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
            found = solve_set(weaker, aim, limits.within(options))
            if found.found and found.policy is None:
                yield found.torques, FIRST_NODES
        if options.verdict_nodes > FIRST_NODES:
            for torques, rest in tuple(tried):
                if rest.verdicts and rest.verdicts[-1].status is Stability.UNDECIDED:
                    yield torques, options.verdict_nodes

    for torques, nodes in candidates():
        rest = verdicts_at_corners(torques, order, nodes)
        tried.append((torques, rest))
        solved = _at_torques(best, torques, options, len(tried)) if rest.kept else None
        if solved is not None:
            return replace(solved, rest=replace(rest, tried=len(tried)))
        if rest.corners:
            order.insert(0, order.pop(order.index(rest.corners[-1])))
        if limits.passed:
            break
    rest = max((one for _, one in tried), key=lambda one: len(one.corners))
    # Without a policy the members that the solution is of stand first.
    first = 0 if best.policy is None else len(best.policy.corners)
    members = best.members[first:] + best.members[:first]
    judged = (*((one - first) % len(members) for one in rest.corners),)
    rest = replace(rest, kept=False, tried=len(tried), corners=judged)
    none = without_forces(best.solution, Status.STRONG_NOT_FOUND)
    return replace(best, solution=none, policy=None, members=members, rest=rest)


def _at_torques(
    best: RobustSolution, torques: FloatArray, options: SolveOptions, tried: int
) -> RobustSolution | None:
    """Return the whole set under torques, with the best's bound; None: they do not serve it."""
    from graspless_pin.algorithms.guaranteed_torques import bounded_by

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
    fixed = solve_problem(
        whole.problem, AtTorques(objective, commands), options, mode=whole.given_mode
    )
    if not (whole.found and fixed.found):
        return None
    solution = bounded_by(whole, replace(fixed, objective=objective))
    gap = abs(whole.value - solution.value)
    guarantee = Guarantee(None, whole.value, gap, tried)  # verdicts are of members
    return replace(best, solution=replace(solution, status=Status.STRONG, guarantee=guarantee))


def _known_of(
    scene: SceneFields, problem: QuasistaticProblem, feedback: Feedback | None = None
) -> dict[str, Any]:
    """Return weight, feedback and fingers, as `solve_robust` and `tolerances` take them.

    Feedback that is not given is the scene's controller, if that states a stiffness.
    """
    own = scene.controller
    if feedback is None and own.is_stated and not own.holds_joints:
        feedback = own
    return {
        "weight": weight_of(scene, problem.joint_count),
        "feedback": feedback,
        "fingers": {} if scene.hand is None else fingers_of_motors(scene.hand),
    }


def _slopes(scene: SceneFields, uncertainty: Uncertainty) -> FloatArray | None:
    """Return what the Jacobian gains where contacts are moved: see `moved_members`."""
    if not isinstance(uncertainty, Uncertainty) or not any(
        figures_in(uncertainty.contact_position)
    ):
        return None
    state = jointed_contacts(scene)
    touching, jacobian = state.contacts.arrays, state.joints.jacobian
    # Points move as their body does: the Jacobian is linear in where they are.
    moved = [replace(touching, positions=touching.positions + along) for along in np.eye(3)]
    return np.array([joint_columns(scene.hand, one).jacobian - jacobian for one in moved])


def corners_in(
    scene: SceneFields, uncertainty: Uncertainty
) -> tuple[tuple[Member, ...], FloatArray | None]:
    """Return the corners of a set without balls, and what a scene's controller adds to commands.

    Args:
        scene: The nominal scene.
        uncertainty: The set.
    """
    problem = problem_of(scene)
    figures, known = by_contact_and_joint(scene, problem, uncertainty), _known_of(scene, problem)
    stiffness = joint_stiffness(problem, known["feedback"], known["fingers"])
    return corners_of(problem, figures, known["weight"], stiffness)


def stated_by(scene: SceneFields) -> Uncertainty:
    """Return what a scene says that is not known exactly.

    Raises:
        ArgumentError: If it says nothing.
    """
    if scene.uncertainty is None:
        raise ArgumentError(
            "uncertainty",
            f"is True, and {label_of(scene)} says nothing of what is not known exactly; give an "
            "Uncertainty, or the file the key 'uncertainty'",
        )
    return scene.uncertainty


def tolerances_of(
    scene: SceneFields,
    torques: ArrayLike | Mapping[str, float],
    feedback: Feedback | None = None,
    **options: Any,
) -> Tolerances:
    """Return how far each thing may be off: see `Scene.tolerances`.

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
    given = motor_torques(problem.joint_names, torques)
    return tolerances(problem, given, **_known_of(scene, problem, feedback), **options)


def check_offsets(scene: SceneFields, uncertainty: Uncertainty) -> None:
    """Refuse offsets of the centre of mass or of contacts that are larger than the object.

    Raises:
        ArgumentError: It may.
    """
    lowest, highest = box_around(scene.object)
    size = highest - lowest
    off = uncertainty.center_of_mass + uncertainty.center_of_mass_radius
    farthest = max(figures_in(uncertainty.contact_position), default=0.0)
    if farthest > size.max():
        raise ArgumentError(
            "uncertainty",
            f"contact_position may be off by {farthest:g} m, and object {scene.object.name!r} is "
            f"{size.max():.4g} m large; give metres",
        )
    if (off > size).any():
        axis = int(np.argmax(off / size))
        raise ArgumentError(
            "uncertainty",
            f"center_of_mass may be off by {off[axis]:g} m along {'xyz'[axis]}, and object "
            f"{scene.object.name!r} is {size[axis]:.4g} m large there; give metres"
            f"{likely_lengths(off, size)}",
        )


def weight_of(scene: SceneFields, links: int) -> Weight:
    """Return which part of a scene's load and torques is weight, for what is uncertain of it.

    Args:
        scene: The scene.
        links: L, the number of its problem's joints.

    Raises:
        ArgumentError: If something turns as it accelerates: then mass is not all that counts.
    """
    target, size = scene.object, float(np.linalg.norm(scene.gravity))
    motion = object_motion(scene)
    if motion.velocity[3:].any() or motion.acceleration[3:].any():
        raise ArgumentError(
            "scene", "turns as it moves: what is not known of a mass counts where nothing turns"
        )
    fields = sum((load.field for load in scene.loads), np.zeros(3))
    steady = target.mass * (fields - motion.acceleration[:3])
    payloads = [one for one in acting_forces(scene, STILL) if one.of_gravity]
    other = sum(
        (np.linalg.norm(one.force) * wrench_map(one.lever[None]) for one in payloads),
        np.zeros((6, 3)),
    )
    carried = np.zeros((links, 3))
    if scene.hand is not None and scene.count_own_weight:
        own = np.array([scene.hand.gravity_torques(size * axis) for axis in np.eye(3)]).T
        carried[: len(own)] = own
    axes = target.T_world_object[:3, :3]
    force = target.mass * scene.gravity
    return Weight(force, steady, np.zeros(3), axes, other, carried, target.mass)
