"""Verdicts on scenes, and where moving links touch supports: forces that no problem has.

And verdicts on the corners of what a scene may be: does its object stay in each of them?
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
    """Return which links that torques or commanded forces can move touch which supports.

    A problem has the contacts of the object alone. What a support does to a link counts against the
    joints' torques all the same: verdicts on what really happens cannot be had then. Links that
    stand still, as on joints under position control, may touch what they like.

    Args:
        scene: The scene.

    Returns:
        (link, support) of each pair that is no farther apart than the scene's `contact_tolerance`,
        links in model order.
    """
    if scene.hand is None:
        return ()
    bodies, moving = scene.hand.placed_bodies, _moving_links(scene.hand)
    touching = {}
    for support in scene.supports:
        pieces = support.placed_bodies
        for i, k in near_pairs(bodies, pieces, scene.contact_tolerance):
            if bodies[i].name in moving:
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
        torques: (L,) the motors' torques, as solutions give them, N m (N).
        friction: (M,) coefficients where those of one body's contacts differ; None: the scene's.
        options: Of `stability`.

    Raises:
        SceneError: See `Scene.contacts`.
        ArgumentError: If a link of the fingers has no mass and its motor no inertia.
    """
    # Loaded here: whoever solves without a verdict goes without the search and its solver.
    from graspless_pin.holding.stability import stability, undecided_verdict

    problem, why = problem_of(scene), unknown_of(scene)
    if friction is not None:
        problem = problem.with_changes(friction=friction)
    given = motor_torques(problem.joint_names, torques)
    if why:
        return known_of_scene(scene, undecided_verdict(problem, given, why, **options))
    problem = rest_problem(scene, problem, given)
    return known_of_scene(scene, stability(problem, given, **options))


def solution_verdict(
    scene: SceneFields, solution: TorqueSolution, **options: Unpack[StabilityKeywords]
) -> StabilityVerdict:
    """Return the verdict on a solution's torques: its own where they are guaranteed.

    Args:
        scene: The scene.
        solution: A solution of it that was found.
        options: Of `stability`, where it has to be asked.

    Raises:
        SceneError: See `verdict_of`.
        ArgumentError: See `verdict_of`.
    """
    known = None if solution.guarantee is None else solution.guarantee.verdict
    if known is not None:
        return known_of_scene(scene, known)
    return verdict_of(scene, solution.torques, **options)


def known_of_scene(scene: SceneFields, verdict: StabilityVerdict) -> StabilityVerdict:
    """Return a verdict on a scene's problem with what the scene tells beside it.

    Whether rest lasts hangs on how contacts roll, and a joint belongs to a finger.
    """
    from graspless_pin.holding.verdict_words import NO_FINGERS, finger_words, strong_words

    # Loaded here: scenes that are solved without a verdict go without.
    from graspless_pin.scene.minimum_stiffness import controller_words, small_motions

    verdict = replace(
        verdict, controller=controller_words(scene), joints_held=scene.controller.holds_joints
    )
    small = verdict.small_motions
    if verdict.joints_held and verdict.status is Stability.WEAK:
        message = verdict.message.replace("may fail", f"may fail with {verdict.controller}", 1)
        return replace(verdict, message=message)
    fingers = NO_FINGERS if scene.hand is None else fingers_of_motors(scene.hand)
    if verdict.moves is MovingPart.FINGER:
        return replace(verdict, message=finger_words(verdict, fingers))
    if small is None or verdict.problem.is_sliding.any():
        return verdict
    if small.unknown:
        verdict = replace(verdict, small_motions=small_motions(scene, verdict.torques))
    return replace(verdict, message=strong_words(verdict, fingers))


def rest_model_of(scene: SceneFields) -> RestModel:
    """Return what a scene tells of rest beside its problem, for torques to be guaranteed.

    Where its controller is stated, rest has to last under it; of a declared motion that is not
    asked, as nobody knows it.
    """
    from graspless_pin.holding.small_motions import RestModel
    from graspless_pin.holding.stability import stability
    from graspless_pin.scene.minimum_stiffness import linearized_motions

    if not scene.controller.is_stated or problem_of(scene).is_sliding.any():
        return RestModel(unknown_of(scene))
    return RestModel(
        unknown_of(scene),
        lambda: linearized_motions(scene),
        lambda problem, torques, **limits: known_of_scene(
            scene, stability(rest_problem(scene, problem, torques), torques, **limits)
        ),
        lasts=True,
    )


def unknown_of(scene: SceneFields) -> str:
    """Return why no verdict on torques of a scene can be had; empty: one can."""
    if why := CONE_MODELS[checked_cone(scene.cone)].no_verdict:
        return why
    if scene.controller.holds_joints:
        hybrid = () if scene.hand is None else scene.hand.control.hybrid_fingers
        reason = f"undecided: joints hold their positions, but {', '.join(hybrid)} follows"
        return reason if hybrid else ""
    touching = hand_support_contacts(scene)
    if not touching:
        return ""
    pairs = ", ".join(f"{link} on {support}" for link, support in touching)
    return f"undecided: the hand touches supports ({pairs}); what they do to its torques is unknown"


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
    """Whether an object stays at each corner of a set, under torques that serve all of it.

    Between the corners nothing is proven about rest: members whose forces are means of the corners'
    may move all the same.

    Attributes:
        members: K corners that were asked about.
        verdicts: On each of them, as on a scene that is changed so.
        left_out: Corners that were not asked about: the time was over, or one does not hold.

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
        """Number of a member whose verdict is the worst; `undecided` is worse than `holds` alone.

        Of several with that verdict it is the first.
        """
        return int(np.argmax([_FROM_BEST.index(one.holding) for one in self.verdicts]))

    @property
    def holding(self) -> Holding:
        """The verdict on that member: `holds` where all hold, and none was left out."""
        holding = self.verdicts[self.worst].holding if self.verdicts else Holding.HOLDS
        return Holding.UNDECIDED if holding is Holding.HOLDS and self.left_out else holding

    def __str__(self) -> str:
        """Return how many corners have which verdict, and what is said of the worst."""
        unasked = f"{self.left_out} corners were not asked about\n" if self.left_out else ""
        if not self.verdicts:
            return unasked.rstrip()
        holdings = [one.holding for one in self.verdicts]
        rows = [
            (str(one), holdings.count(one), self.members[holdings.index(one)].words)
            for one in reversed(_FROM_BEST)
            if one in holdings
        ]
        return (
            f"{tabulate(rows, ('holding', 'corners', 'the first of them'))}\n\n"
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

    Members with contacts moved are left out.

    Args:
        scene: The nominal scene. Its controller counts, but with feedback the gains of
            the robust torques.
        robust: Torques that serve what it may be.
        time_limit: Seconds for all corners together; None: as long as they take.
        options: Of `stability`, for each.

    Raises:
        ArgumentError: If the torques are of another scene, or none were found.
    """
    # Loaded here: what is known exactly goes without.
    from graspless_pin.algorithms.robust_solution import RobustSolution

    problem = problem_of(scene)
    if not isinstance(robust, RobustSolution) or not robust.found:
        found = "has no torques" if isinstance(robust, RobustSolution) else f"is {robust!r:.80}"
        raise ArgumentError(
            "robust", f"{found}; give what scene.solve(..., uncertainty=...) has found"
        )
    first = robust.members[0].problem
    if first.joint_names != problem.joint_names or first.contact_count != problem.contact_count:
        raise ArgumentError(
            "robust", "is of another scene: joints or contacts differ; solve this one"
        )
    scene, limits = under_feedback(scene, robust.feedback), Limits.from_now(None, time_limit)
    members = tuple([one for one in robust.members if one.moved is None])
    return verdicts_under(scene, members, robust.torques, robust.feedback, limits=limits, **options)


def under_feedback(scene: AnyScene, stiffness: FloatArray | None) -> AnyScene:
    """Return a scene under its controller with other gains (L,), by joint; None: its own."""
    if stiffness is None:
        return scene
    names = problem_of(scene).joint_names
    known = () if scene.hand is None else scene.hand.actuation.names
    gains = dict(zip(names, stiffness.tolist(), strict=True))
    own = {name: gain for name, gain in gains.items() if name in known}
    return scene.with_changes(controller=Controller(own, scene.controller.damping))


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
        scene: The nominal scene, under the controller that runs.
        members: The members.
        commanded: (L,) N m (N).
        stiffness: (L,) joint stiffness that adds to the torques, N m/rad (N/m); None: none.
        limits: When to stop.
        until: Tells of a verdict whether to stop after it.
        options: Of `stability`, for each.
    """
    verdicts: list[StabilityVerdict] = []
    for member in members:
        if limits.passed:
            break
        changed, friction = scene_of_member(scene, member), member.problem.friction
        own = replace(member, problem=problem_of(changed).with_changes(friction=friction))
        torques = torques_at_rest(own, commanded, stiffness)
        time_limit = {} if limits.seconds_left is None else {"time_limit": limits.seconds_left}
        verdicts.append(verdict_of(changed, torques, friction=friction, **time_limit, **options))
        if until(verdicts[-1]):
            break
    count = len(verdicts)
    return MemberVerdicts(tuple(members[:count]), tuple(verdicts), len(members) - count)


def scene_of_member(scene: AnyScene, member: Member) -> AnyScene:
    """Return a scene changed to what a member is: object, gravity, push and friction.

    Inertia goes with the mass, about the centre of mass where that is. What acted on the centre of
    mass still acts at the nominal one. Bodies have one coefficient each: the least of their
    contacts.

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
    others = {"hand": min(links.values())} if links and changed.hand_material is not None else {}
    return changed.with_changes(
        friction={**others, **changed.friction, **links}, hand_material=None, supports=supports
    )


def torques_at_rest(
    member: Member, commanded: ArrayLike, stiffness: FloatArray | None = None
) -> FloatArray:
    """Return (L,) what joints make in a member under commanded torques, N m (N).

    Joint stiffness adds what the small motion asks for that equilibrium picks, where there are
    forces for it. Joints that bear no contact force carry their links by it.

    Args:
        member: The member.
        commanded: (L,) torques, the same for all members, N m (N).
        stiffness: (L,) of the joints, N m/rad (N/m); None: none.
    """
    problem = member.problem
    given = finite_array("commanded", commanded, (problem.joint_count,))
    torques = member.factors * given + member.offsets
    if stiffness is None:
        return torques
    options = SolveOptions.parse(static_friction=StaticFriction.COULOMB)
    under = under_commands(member, given, feedback_torques(problem, stiffness))
    found = solve_problem(under, Margin(), options)
    if not found.found:
        return torques
    balanced = problem.J.T @ found.contact_forces.ravel() + problem.gravity_torques
    uncoupled = ~problem.jacobian.any(axis=0) & (stiffness == 0.0)
    return np.where(uncoupled, torques, balanced)
