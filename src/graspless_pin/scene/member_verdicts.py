"""Verdicts on the corners of what a scene may be: does its object stay in each of them?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from tabulate import tabulate

from graspless_pin.algorithms.options import Limits, SolveOptions
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.controller import Controller
from graspless_pin.holding.verdict import Holding, StabilityVerdict
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem.checks import FloatArray, finite_array
from graspless_pin.problem.members import Member, feedback_torques, under_commands
from graspless_pin.programs.objectives import Margin
from graspless_pin.records import Brief
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.fields import SceneFields
from graspless_pin.scene.problem_data import problem_of
from graspless_pin.scene.scene_stability import verdict_of
from graspless_pin.scene.stated import Load

_FROM_BEST = (
    Holding.HOLDS, Holding.UNDECIDED, Holding.NEEDS_FEEDBACK, Holding.MAY_FAIL,
    Holding.FINGER_MOVES, Holding.FAILS,
)  # fmt: skip
_PUSH = "push of a member"
_Scene = TypeVar("_Scene", bound=SceneFields)


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
        said = self.verdicts[self.worst].holding if self.verdicts else Holding.HOLDS
        return Holding.UNDECIDED if said is Holding.HOLDS and self.left_out else said

    def __str__(self) -> str:
        """Return how many corners have which verdict, and what is said of the worst."""
        left = f"{self.left_out} corners were not asked about\n" if self.left_out else ""
        if not self.verdicts:
            return left.rstrip()
        said = [one.holding for one in self.verdicts]
        rows = [
            (str(one), said.count(one), self.members[said.index(one)].words)
            for one in reversed(_FROM_BEST)
            if one in said
        ]
        return (
            f"{tabulate(rows, ('holding', 'corners', 'the first of them'))}\n\n"
            f"{self.members[self.worst].words}: {self.verdicts[self.worst]}\n{left}"
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


def under_feedback(scene: _Scene, stiffness: FloatArray | None) -> _Scene:
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
        left = {} if limits.left is None else {"time_limit": limits.left}
        verdicts.append(verdict_of(changed, torques, friction=friction, **left, **options))
        if until(verdicts[-1]):
            break
    count = len(verdicts)
    return MemberVerdicts(tuple(members[:count]), tuple(verdicts), len(members) - count)


def scene_of_member(scene: _Scene, member: Member) -> _Scene:
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
        made = scene.object
        loads = [
            load if load.at is not None else replace(load, at=made.center_of_mass)
            for load in scene.loads
        ]
        if corner.force.any() or corner.moment.any():
            loads.append(Load(_PUSH, corner.force, corner.moment, at=made.center_of_mass))
        heavier = replace(
            made,
            mass=(1.0 + corner.mass) * made.mass,
            center_of_mass=made.center_of_mass + corner.center_of_mass,
            inertia=None if made.inertia is None else (1.0 + corner.mass) * made.inertia,
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
    made = member.factors * given + member.offsets
    if stiffness is None:
        return made
    options = SolveOptions.parse(static_friction=StaticFriction.COULOMB)
    under = under_commands(member, given, feedback_torques(problem, stiffness))
    found = solve_problem(under, Margin(), options)
    if not found.found:
        return made
    balanced = problem.J.T @ found.contact_forces.ravel() + problem.gravity_torques
    left = ~problem.jacobian.any(axis=0) & (stiffness == 0.0)
    return np.where(left, made, balanced)
