"""Stability verdicts on scenes, and on the corners of the set of a scene's uncertainty.

Contacts of moving links with supports, whose forces are in no problem, make a verdict undecided.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike
from tabulate import tabulate

from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.contact.distances import near_pairs, separation
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.holding.controller import Controller
from graspless_pin.holding.verdict import (
    Holding,
    MovingPart,
    Stability,
    StabilityKeywords,
    StabilityVerdict,
)
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem.checks import FloatArray, finite_array, motor_torques
from graspless_pin.problem.cones import CONE_MODELS, checked_cone
from graspless_pin.problem.members import Member, feedback_torques, under_commands
from graspless_pin.programs.objectives import Margin
from graspless_pin.records import Brief
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.fields import AnyScene, SceneFields
from graspless_pin.scene.problem_data import fingers_of_motors, problem_of, rest_problem
from graspless_pin.scene.stated import Load
from graspless_pin.solution import TorqueSolution
from graspless_pin.tree_search import Limits

if TYPE_CHECKING:
    from graspless_pin.algorithms.robust_solution import RobustSolution
    from graspless_pin.holding.small_motions import RestModel

_FROM_BEST = (
    Holding.HOLDS, Holding.UNDECIDED, Holding.NEEDS_FEEDBACK, Holding.MAY_FAIL,
    Holding.FINGER_MOVES, Holding.FAILS,
)  # fmt: skip
_PUSH = "push of a member"


def hand_support_contacts(scene: SceneFields) -> tuple[tuple[str, str], ...]:
    """Return the contacts of supports with links that torques or commanded forces can move.

    A problem has only the contacts of the object. The force of a support on a link acts on the
    joints, too, so that no verdict is possible. Fixed links, such as those on joints under position
    control, may touch supports.

    Args:
        scene: The scene.

    Returns:
        (link, support) of each pair that is no farther apart than the scene's `contact_tolerance`,
        links in model order.
    """
    if scene.hand is None:
        return ()
    bodies, moving_links = scene.hand.placed_bodies, _moving_links(scene.hand)
    touching = {}
    for support in scene.supports:
        pieces = support.placed_bodies
        for i, k in near_pairs(bodies, pieces, scene.contact_tolerance):
            if bodies[i].name in moving_links:
                gap = separation(bodies[i], pieces[k]).distance
                if gap <= scene.contact_tolerance:
                    touching[bodies[i].name, support.name] = i
    return tuple(sorted(touching, key=lambda pair: touching[pair]))


def verdict_of(
    scene: SceneFields,
    torques: ArrayLike | Mapping[str, float],
    *,
    friction: FloatArray | None = None,
    **options: Unpack[StabilityKeywords],
) -> StabilityVerdict:
    """Tell whether a scene's object stays at rest with these torques.

    Args:
        scene: The scene.
        torques: (L,) motor torques, as in solutions, N m (N).
        friction: (M,) coefficients, which may differ at contacts of one body; None: the scene's.
        options: Of `stability`.

    Raises:
        SceneError: See `Scene.contacts`.
        ArgumentError: If a finger link without mass has a motor without inertia.
    """
    # Imported here: solving without a verdict does not need its search and solver.
    from graspless_pin.holding.stability import stability, undecided_verdict

    problem, reason = problem_of(scene), no_verdict_reason(scene)
    if friction is not None:
        problem = problem.with_changes(friction=friction)
    motors = motor_torques(problem.joint_names, torques)
    if reason:
        return verdict_with_scene_data(scene, undecided_verdict(problem, motors, reason, **options))
    problem = rest_problem(scene, problem, motors)
    return verdict_with_scene_data(scene, stability(problem, motors, **options))


def solution_verdict(
    scene: SceneFields, solution: TorqueSolution, **options: Unpack[StabilityKeywords]
) -> StabilityVerdict:
    """Return the verdict on a solution's torques: the solution's own where they are guaranteed.

    Args:
        scene: The scene.
        solution: A solution of it with torques.
        options: Options of `stability`, if it has to be called.

    Raises:
        SceneError: See `verdict_of`.
        ArgumentError: See `verdict_of`.
    """
    guaranteed = None if solution.guarantee is None else solution.guarantee.verdict
    if guaranteed is not None:
        return verdict_with_scene_data(scene, guaranteed)
    return verdict_of(scene, solution.torques, **options)


def verdict_with_scene_data(scene: SceneFields, verdict: StabilityVerdict) -> StabilityVerdict:
    """Return a verdict on a scene's problem, completed by the scene: controller, fingers, rolling.

    Whether rest lasts depends on how contacts roll, which a problem does not have.
    """
    from graspless_pin.holding.verdict_words import NO_FINGERS, finger_words, strong_words

    # Imported here: scenes that are solved without a verdict do not need it.
    from graspless_pin.scene.minimum_stiffness import controller_words, small_motions

    verdict = replace(
        verdict, controller=controller_words(scene), joints_held=scene.controller.holds_joints
    )
    motions = verdict.small_motions
    if verdict.joints_held and verdict.status is Stability.WEAK:
        message = verdict.message.replace("may fail", f"may fail with {verdict.controller}", 1)
        return replace(verdict, message=message)
    fingers = NO_FINGERS if scene.hand is None else fingers_of_motors(scene.hand)
    if verdict.moves is MovingPart.FINGER:
        return replace(verdict, message=finger_words(verdict, fingers))
    if motions is None or verdict.problem.is_sliding.any():
        return verdict
    if motions.unknown:
        verdict = replace(verdict, small_motions=small_motions(scene, verdict.torques))
    return replace(verdict, message=strong_words(verdict, fingers))


def rest_model_of(scene: SceneFields) -> RestModel:
    """Return the model of rest of a scene, for guaranteed torques.

    Under a stated controller, rest has to last; with a declared motion this is unknown and not
    required.
    """
    from graspless_pin.holding.small_motions import RestModel
    from graspless_pin.holding.stability import stability
    from graspless_pin.scene.minimum_stiffness import linearized_motions

    if not scene.controller.is_given or problem_of(scene).is_sliding.any():
        return RestModel(no_verdict_reason(scene))
    return RestModel(
        no_verdict_reason(scene),
        lambda: linearized_motions(scene),
        lambda problem, torques, **limits: verdict_with_scene_data(
            scene, stability(rest_problem(scene, problem, torques), torques, **limits)
        ),
        lasts=True,
    )


def no_verdict_reason(scene: SceneFields) -> str:
    """Return why a scene has no verdict on torques; empty if it can have one."""
    if why := CONE_MODELS[checked_cone(scene.cone)].no_verdict:
        return why
    if scene.controller.holds_joints:
        hybrid = () if scene.hand is None else scene.hand.control.hybrid_fingers
        reason = (
            f"undecided: joints keep their positions, but hybrid finger {', '.join(hybrid)} moves"
        )
        return reason if hybrid else ""
    touching = hand_support_contacts(scene)
    if not touching:
        return ""
    pairs = ", ".join(f"{link} on {support}" for link, support in touching)
    return f"undecided: the hand touches supports ({pairs}), whose effect on its torques is unknown"


def _moving_links(hand: Hand) -> set[str]:
    """Return the links that force-controlled joints move, and those of hybrid fingers."""
    rows = np.flatnonzero(hand.actuation.from_joints.any(axis=1))
    links = {
        link
        for link, carrier in hand.tree.link_joints.items()
        if hand.tree.supports[carrier, rows].any()
    }
    return links.union(*(hand.fingers[name].links for name in hand.control.hybrid_fingers))


@dataclass(frozen=True, eq=False, repr=False)
class MemberVerdicts(Brief):
    """Verdicts on the corners of a set, under torques that serve the whole set.

    Between the corners nothing is proven about rest: members whose forces are means of the corners'
    may move all the same.

    Attributes:
        members: The K corners with a verdict.
        verdicts: The verdict on each of them, as on a scene changed to it.
        left_out: Number of corners without a verdict: the time was over, or another one failed.

    Examples:
        >>> from graspless_pin import Uncertainty, load_scene
        >>> scene = load_scene("examples/allegro_sphere_on_slope.yaml")
        >>> unknown = Uncertainty(mass=0.2, center_of_mass=0.005)  # 20 %, m
        >>> options = {"margin": 0.05, "static_friction": "coulomb"}
        >>> robust = scene.solve("torque", uncertainty=unknown, feedback=2.0, **options)
        >>> str(scene.stability_of_members(robust).holding)
        'holds'
    """

    members: tuple[Member, ...]
    verdicts: tuple[StabilityVerdict, ...]
    left_out: int = 0

    @property
    def worst(self) -> int:
        """Index of the first member with the worst verdict.

        `undecided` is worse than `holds` only.
        """
        return int(np.argmax([_FROM_BEST.index(one.holding) for one in self.verdicts]))

    @property
    def holding(self) -> Holding:
        """The worst verdict: `holds` if all corners hold and none was left out."""
        holding = self.verdicts[self.worst].holding if self.verdicts else Holding.HOLDS
        return Holding.UNDECIDED if holding is Holding.HOLDS and self.left_out else holding

    def __str__(self) -> str:
        """Return a table of the numbers of corners by verdict, and the text of the worst one."""
        unasked = f"{self.left_out} corners have no verdict\n" if self.left_out else ""
        if not self.verdicts:
            return unasked.rstrip()
        holdings = [one.holding for one in self.verdicts]
        rows = [
            (str(one), holdings.count(one), self.members[holdings.index(one)].words)
            for one in reversed(_FROM_BEST)
            if one in holdings
        ]
        return (
            f"{tabulate(rows, ('holding', 'corners', 'first of them'))}\n\n"
            f"{self.members[self.worst].words}: {self.verdicts[self.worst]}\n{unasked}"
            "between the corners nothing is proven about rest"
        )


def verdicts_of_members(
    scene: SceneFields,
    robust: RobustSolution,
    *,
    time_limit: float | None = None,
    **options: Any,
) -> MemberVerdicts:
    """Return a verdict on each corner of a set: see `Scene.stability_of_members`.

    Members with moved contacts are left out.

    Args:
        scene: The nominal scene, with its controller; gains of the robust torques replace its own.
        robust: The robust solution.
        time_limit: Seconds for all corners together; None: no limit.
        options: Options of `stability`, for each.

    Raises:
        ArgumentError: If the torques are of another scene, or there are none.
    """
    # Imported here: scenes without uncertainty do not need it.
    from graspless_pin.algorithms.robust_solution import RobustSolution

    problem = problem_of(scene)
    if not isinstance(robust, RobustSolution) or not robust.found:
        fault = "has no torques" if isinstance(robust, RobustSolution) else f"is {robust!r:.80}"
        raise ArgumentError(
            "robust", f"{fault}; give a result of scene.solve(..., uncertainty=...) with torques"
        )
    first = robust.members[0].problem
    if first.joint_names != problem.joint_names or first.contact_count != problem.contact_count:
        raise ArgumentError(
            "robust", "is a solution of another scene: joints or contacts differ; solve this scene"
        )
    scene, limits = under_feedback(scene, robust.feedback), Limits.from_now(None, time_limit)
    members = tuple([member for member in robust.members if member.moved is None])
    return verdicts_under(scene, members, robust.torques, robust.feedback, limits=limits, **options)


def under_feedback(scene: AnyScene, stiffness: FloatArray | None) -> AnyScene:
    """Return a scene whose controller has the stiffness (L,) at its joints; None: unchanged."""
    if stiffness is None:
        return scene
    names = problem_of(scene).joint_names
    motors = () if scene.hand is None else scene.hand.actuation.names
    gains = dict(zip(names, stiffness.tolist(), strict=True))
    motor_gains = {name: gain for name, gain in gains.items() if name in motors}
    return scene.with_changes(controller=Controller(motor_gains, scene.controller.damping))


def verdicts_under(
    scene: SceneFields,
    members: Sequence[Member],
    commanded: FloatArray,
    stiffness: FloatArray | None,
    *,
    limits: Limits,
    until: Callable[[StabilityVerdict], bool] = lambda _: False,
    **options: Any,
) -> MemberVerdicts:
    """Return verdicts on members under commanded torques, one after the other.

    Args:
        scene: The nominal scene, with the controller that acts.
        members: The members.
        commanded: (L,) commanded torques, N m (N).
        stiffness: (L,) joint stiffness that adds to the torques, N m/rad (N/m); None: none.
        limits: Limits of time and nodes.
        until: Returns whether to stop after a verdict.
        options: Options of `stability`, for each.
    """
    verdicts: list[StabilityVerdict] = []
    for member in members:
        if limits.is_time_over:
            break
        variant, friction = scene_of_member(scene, member), member.problem.friction
        own = replace(member, problem=problem_of(variant).with_changes(friction=friction))
        torques = torques_at_rest(own, commanded, stiffness)
        time_limit = {} if limits.seconds_left is None else {"time_limit": limits.seconds_left}
        verdicts.append(verdict_of(variant, torques, friction=friction, **time_limit, **options))
        if until(verdicts[-1]):
            break
    count = len(verdicts)
    return MemberVerdicts(tuple(members[:count]), tuple(verdicts), len(members) - count)


def scene_of_member(scene: AnyScene, member: Member) -> AnyScene:
    """Return a scene changed to a member: object, gravity, push and friction.

    The inertia scales with the mass, about the member's centre of mass. Loads at the centre of mass
    stay at the nominal one. Each body has one coefficient: the least of its contacts.

    Args:
        scene: The nominal scene.
        member: One of its members.
    """
    changed, corner = scene, member.corner
    if corner is not None:
        target = scene.object
        loads = [
            load if load.at is not None else replace(load, at=target.center_of_mass)
            for load in scene.loads
        ]
        if corner.force.any() or corner.moment.any():
            loads.append(Load(_PUSH, corner.force, corner.moment, at=target.center_of_mass))
        heavier = replace(
            target,
            mass=(1.0 + corner.mass) * target.mass,
            center_of_mass=target.center_of_mass + corner.center_of_mass,
            inertia=None if target.inertia is None else (1.0 + corner.mass) * target.inertia,
        )
        changed = scene.with_changes(
            object=heavier,
            loads=loads,
            gravity=np.linalg.norm(scene.gravity) * corner.down,
        )
    friction = member.problem.friction
    if np.array_equal(problem_of(changed).friction, friction):
        return changed
    touching, least = contacts_of(changed).arrays, dict[str, float]()
    for body, coefficient in zip(touching.bodies, friction.tolist(), strict=True):
        least[body] = min(least.get(body, np.inf), coefficient)
    supports = [
        replace(support, friction=least[support.name]) if support.name in least else support
        for support in changed.supports
    ]
    links = {body: least[body] for body in touching.bodies[: touching.hand_count]}
    by_group = {"hand": min(links.values())} if links and changed.hand_material is not None else {}
    return changed.with_changes(
        friction={**by_group, **changed.friction, **links}, hand_material=None, supports=supports
    )


def torques_at_rest(
    member: Member, commanded: ArrayLike, stiffness: FloatArray | None = None
) -> FloatArray:
    """Return the (L,) joint torques in a member under commanded torques, N m (N).

    Joint stiffness adds the torques of the small motion into equilibrium, where contact forces for
    it exist. At joints that bear no contact force it carries the links.

    Args:
        member: The member.
        commanded: (L,) torques, the same for all members, N m (N).
        stiffness: (L,) joint stiffness, N m/rad (N/m); None: none.
    """
    problem = member.problem
    command = finite_array("commanded", commanded, (problem.joint_count,))
    torques = member.factors * command + member.offsets
    if stiffness is None:
        return torques
    options = SolveOptions.parse(static_friction=StaticFriction.COULOMB)
    commanded_problem = under_commands(member, command, feedback_torques(problem, stiffness))
    solution = solve_problem(commanded_problem, Margin(), options)
    if not solution.found:
        return torques
    balanced = problem.J.T @ solution.contact_forces.ravel() + problem.gravity_torques
    is_uncoupled = ~problem.jacobian.any(axis=0) & (stiffness == 0.0)
    return np.where(is_uncoupled, torques, balanced)
