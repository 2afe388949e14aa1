"""How much position feedback makes a scene's rest stable, and how fast it is lost without."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError, GrasplessPinError
from graspless_pin.findings import capture
from graspless_pin.holding.certificate import balance, bearing_forces
from graspless_pin.holding.controller import (
    ARMATURE,
    CONSTANT_TORQUES,
    DAMPING,
    JOINTS_HELD,
    Controller,
    GrowthProof,
    SmallMotions,
    gain_shares,
    gain_words,
)
from graspless_pin.holding.dynamics import (
    LEAST_LOAD,
    motion_units,
    without_slip,
    world_forces,
)
from graspless_pin.holding.small_motions import (
    GROWTH_LIMIT,
    Intervals,
    LinearizedMotion,
    extreme_forces,
    lyapunov_matrix,
)
from graspless_pin.problem.checks import (
    FloatArray,
    JointUnit,
    motor_torques,
    read_only,
    real_number,
)
from graspless_pin.problem.inertias import moving_joints
from graspless_pin.problem.quasistatic import QuasistaticProblem
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.fields import SceneFields, checked_scene, label_of
from graspless_pin.scene.geometric_stiffness import (
    assumed_contacts,
    geometric_stiffness,
    moving_bodies,
    refuse_flat_on_flat,
    rolling_by_model,
)
from graspless_pin.scene.problem_data import fingers_of_motors, problem_of, rest_problem

_MOTION_ROUNDING = 1e-10
_PART_OF_MOTION = 1e-3
"""Of the motion: a smaller part of it is none."""
_COSINE_ALONG_LOAD = float(np.cos(np.radians(20.0)))
_LEAST_NORM = 1e-300


@dataclass(frozen=True, eq=False)
class MinimumStiffness:
    """The position feedback that makes a rest stable to second order.

    See the example of `minimum_stiffness`.

    Attributes:
        stiffness: Smallest k, N m/rad, of the same feedback at every joint that carries a touching
            link, over (0.1 m)^2 at joints that slide, and N/m where all slide; 0 where none is
            needed, inf where none is enough.
        per_joint: The same of feedback at one joint alone, by its name.
        growth: Rate at which a small motion grows without feedback, 1/s; 0 where none does.
        motion: (P + L,) velocity of the motion that grows fastest, read-only: of the object
            [linear; angular], then of the joints, the largest entry one; None where none grows.
        forces: (M, 3) the admissible contact forces under which that is so, N, world axes,
            read-only: where torques leave forces open, the worst ones that were found.
        growth_by_surface: Growth where convex hulls of meshes are taken as they are (``facets``),
            and as the smooth surfaces that they stand for (``fitted``); the figures above are the
            worse of both. Empty where no mesh touches.
        armature: Rotor inertia that was added at each joint, kg m^2, as the stiffness.
        damping: Damping at each joint, N m s/rad, as the stiffness.
        assumed: Contacts that are stated where no shapes touch so: that their points stay on both
            bodies is assumed.
    """

    stiffness: float
    per_joint: Mapping[str, float]
    growth: float
    motion: FloatArray | None
    forces: FloatArray
    growth_by_surface: Mapping[str, float]
    armature: float
    damping: float
    assumed: tuple[int, ...]


class _Found(NamedTuple):
    """What small motions of one model of the surfaces do under the worst forces."""

    motion: LinearizedMotion
    bearing: FloatArray
    stiffness: FloatArray
    forces: FloatArray
    growth: float
    fastest: FloatArray
    stable: Intervals
    neutral: FloatArray
    least_growth: float


def minimum_stiffness(
    scene: SceneFields,
    torques: ArrayLike | Mapping[str, float],
    *,
    armature: float = ARMATURE,
    damping: float = DAMPING,
) -> MinimumStiffness:
    """Find the smallest position feedback with which a scene's rest is stable to second order.

    The object is at rest under constant torques, and its contacts roll without slipping as far as
    they go: whether rest can be left by slipping or opening is another question. Contacts that the
    declared motion parts bear nothing; one along which contacts slide is left out. Joints that
    carry no touching link are held.

    Args:
        scene: The scene.
        torques: (L,) of the motors, N m (N), that hold the object in balance.
        armature: Added to the inertia of each joint, kg m^2, over (0.1 m)^2 at joints that slide.
        damping: At each joint, N m s/rad, likewise.

    Raises:
        ArgumentError: If the torques do not hold the object in balance, the joints' inertia is
            singular, or a figure is out of range.
        SceneError: If a single contact stands for a line or a face along which the bodies roll.

    Examples:
        >>> from graspless_pin import load_scene, minimum_stiffness
        >>> scene = load_scene("examples/allegro_sphere_on_slope.yaml")
        >>> found = minimum_stiffness(scene, scene.solve().torques)
        >>> print(f"{found.stiffness:.1f} N m/rad")
        0.4 N m/rad
    """
    added, damping = real_number("armature", armature, 0.0), real_number("damping", damping, 0.0)
    scene = checked_scene(scene).with_changes(controller=Controller(0.0, damping))
    problem, models = _by_surface(scene, torques, added)
    worst = _worst(models)
    carriers = _carriers(scene, problem)
    names = [problem.joint_names[joint] for joint in carriers]
    alone = dict.fromkeys(names, 0.0)
    if worst.growth > 0.0:
        alone = {
            name: _least(worst.motion.stable_feedback(worst.stiffness, row))
            for name, row in zip(names, np.eye(len(names)), strict=True)
        }
    return MinimumStiffness(
        _least(worst.stable) * _per_all(scene, problem),
        MappingProxyType(alone),
        worst.growth,
        read_only(worst.fastest) if worst.growth > 0.0 else None,
        read_only(worst.forces),
        _growths(models),
        added,
        damping,
        assumed_contacts(scene),
    )


def small_motions(scene: SceneFields, torques: ArrayLike | Mapping[str, float]) -> SmallMotions:
    """Return what becomes of small motions under the scene's controller, or why nobody knows.

    Args:
        scene: The scene.
        torques: (L,) of the motors, N m (N).
    """
    try:
        with capture():
            problem, models = _by_surface(scene, torques, ARMATURE)
    except GrasplessPinError as error:
        why = str(error).removeprefix(f"{label_of(scene)}: ").partition("; ")[0]
        return SmallMotions.not_known(why)
    worst = _worst(models)
    growing = worst.growth > 0.0
    neutral = [_moving_words(scene, problem, motion) for motion in worst.neutral.T]
    per_all = _per_all(scene, problem)
    return SmallMotions(
        _least(worst.stable) * per_all,
        worst.growth,
        _unit(scene, problem),
        _moving_words(scene, problem, worst.fastest) if growing else "",
        growth_by_surface=_growths(models),
        motion=read_only(worst.fastest) if growing else None,
        neutral=tuple(dict.fromkeys(neutral)),
        least_growth=worst.least_growth,
        stable=tuple((low * per_all, high * per_all) for low, high in worst.stable),
        proofs={} if growing else _proofs(scene, problem, models),
        assumed=assumed_contacts(scene) if len(worst.motion.inertia) else (),
    )


def _proofs(
    scene: SceneFields, problem: QuasistaticProblem, models: Mapping[str, _Found]
) -> Mapping[str, GrowthProof]:
    """Return what proves that nothing grows, by model of the surfaces; empty: it is not proven."""
    carriers = _carriers(scene, problem)
    proofs = {}
    for name, one in models.items():
        motion = one.motion
        lyapunov = lyapunov_matrix(
            motion.inertia, motion.total_stiffness(one.stiffness), motion.drag, GROWTH_LIMIT
        )
        if lyapunov is None:
            return {}
        proofs[name] = GrowthProof(
            read_only(motion.velocities),
            read_only(one.bearing),
            read_only(one.stiffness),
            (*carriers.tolist(),),
            read_only(motion.gains),
            read_only(motion.damping),
            read_only(ARMATURE * _shares(scene, problem)),
            GROWTH_LIMIT,
            read_only(lyapunov),
        )
    return proofs


def controller_words(scene: SceneFields) -> str:
    """Return the feedback at the joints that carry touching links; empty: none is stated."""
    if scene.controller.holds_joints:
        return JOINTS_HELD
    problem = problem_of(scene)
    gains, _ = _gains(scene, problem)
    gains = gains / _shares(scene, problem) * _per_all(scene, problem)
    names = [problem.joint_names[joint] for joint in _carriers(scene, problem)]
    fingers = {} if scene.hand is None else fingers_of_motors(scene.hand)
    words = gain_words(gains.tolist(), _unit(scene, problem), names, fingers)
    return words or (CONSTANT_TORQUES if scene.controller.is_stated else "")


def _unit(scene: SceneFields, problem: QuasistaticProblem) -> str:
    """Return the unit of the stiffness of all joints that carry touching links."""
    if not len(_carriers(scene, problem)):
        return ""
    return "N m/rad" if _per_all(scene, problem) == 1.0 else "N/m"


def _per_all(scene: SceneFields, problem: QuasistaticProblem) -> float:
    """Return what makes a stiffness per radian that of all joints: per metre where all slide."""
    shares = _shares(scene, problem)
    return float(shares.min()) if len(shares) else 1.0


def _shares(scene: SceneFields, problem: QuasistaticProblem) -> FloatArray:
    """Return `gain_shares` of the joints that carry touching links."""
    units = [problem.joint_units[joint] for joint in _carriers(scene, problem)]
    return gain_shares([unit is JointUnit.FORCE for unit in units])


def _gains(scene: SceneFields, problem: QuasistaticProblem) -> tuple[FloatArray, FloatArray]:
    """Return K and D, each (c,), of the joints that carry touching links."""
    controller, fingers = scene.controller, dict[str, str]()
    if scene.hand is not None:
        controller.check(scene.hand.actuation.names, (*scene.hand.fingers,))
        fingers = fingers_of_motors(scene.hand)
    names = [problem.joint_names[joint] for joint in _carriers(scene, problem)]
    return controller.gains(names, _shares(scene, problem), fingers)


def _growths(models: Mapping[str, _Found]) -> Mapping[str, float]:
    """Return the growth by model of the surfaces, where there are several."""
    return {name: one.growth for name, one in models.items()} if len(models) > 1 else {}


def _worst(models: Mapping[str, _Found]) -> _Found:
    return max(models.values(), key=lambda one: (one.growth > 0.0, _least(one.stable), one.growth))


def _least(stable: Intervals) -> float:
    """Return from where on the last interval of stable feedback goes; inf: there is none."""
    return stable[-1][0] if stable else np.inf


def _moving_words(scene: SceneFields, problem: QuasistaticProblem, motion: FloatArray) -> str:
    """Return what a small motion (6 + L,) moves, and how."""
    shares = motion / motion_units(problem)
    linear, angular = (float(np.linalg.norm(part)) for part in (shares[:3], shares[3:6]))
    if max(linear, angular) < _PART_OF_MOTION * float(np.abs(shares).max()):
        return "the fingers buckle"
    if angular < _PART_OF_MOTION * linear:
        return "the object shifts"
    if scene.object.shape.rolls and linear > _PART_OF_MOTION * angular:
        return "the object rolls"
    axis, load = motion[3:6], problem.external_wrench[:3]
    along = abs(float(axis @ load)) / float(
        np.linalg.norm(axis) * max(np.linalg.norm(load), _LEAST_NORM)
    )
    return "the object turns" if along > _COSINE_ALONG_LOAD else "the object tilts"


def _by_surface(
    scene: SceneFields, torques: ArrayLike | Mapping[str, float], armature: float
) -> tuple[QuasistaticProblem, Mapping[str, _Found]]:
    """Return a scene's problem at rest, and its small motions by how meshes are taken.

    Growth is that under the controller, the least feedback that of all joints alike without it.

    Raises:
        ArgumentError: See `minimum_stiffness`.
        SceneError: See `minimum_stiffness`.
    """
    problem = problem_of(scene)
    if problem.is_sliding.any():
        scene = scene.with_changes(motion=None)
        problem = problem_of(scene)
    torque = motor_torques(problem.joint_names, torques)
    problem = rest_problem(scene, problem, torque)
    found = balance(problem, torque)
    if found is None or not found.is_rest:
        raise ArgumentError(
            "torques", "do not hold the object in balance: no contact forces within friction do"
        )
    bearing = bearing_forces(problem, torque, found.forces)
    motions = _linearized(scene, problem, armature, bearing[:, 0] > LEAST_LOAD)
    bearing, forces = (
        world_forces(problem, one * problem.scales.force) for one in (bearing, found.forces)
    )
    models = {}
    for name, motion in motions.items():
        worst, best = (
            extreme_forces(motion, problem, torque, forces, worst=worst) for worst in (True, False)
        )
        stiffness = motion.stiffness(worst)
        growth, fastest = motion.fastest(stiffness)
        if growth > 0.0:
            fastest = fastest / fastest[np.argmax(np.abs(fastest))]
        models[name] = _Found(
            motion,
            bearing,
            stiffness,
            worst,
            growth,
            fastest,
            stable=motion.stable_feedback(stiffness, _shares(scene, problem)),
            neutral=motion.neutral(stiffness),
            least_growth=motion.fastest(motion.stiffness(best))[0],
        )
    return problem, models


def linearized_motions(scene: SceneFields) -> tuple[LinearizedMotion, ...]:
    """Return small motions under the scene's controller, by model of surfaces.

    Empty where they are not known, or a motion is declared.
    """
    problem = problem_of(scene)
    if problem.is_sliding.any():
        return ()
    try:
        with capture():
            return (*_linearized(scene, problem, ARMATURE).values(),)
    except GrasplessPinError:
        return ()


def _linearized(
    scene: SceneFields,
    problem: QuasistaticProblem,
    armature: float,
    bears: NDArray[np.bool_] | None = None,
) -> Mapping[str, LinearizedMotion]:
    """Return small motions under the scene's controller, by model of the surfaces.

    Args:
        scene: The scene.
        problem: Its problem of rest.
        armature: See `minimum_stiffness`.
        bears: (M,) contacts that bear load, and that no motion slips or opens; None: all.

    Raises:
        ArgumentError: See `minimum_stiffness`.
        SceneError: See `minimum_stiffness`.
    """
    velocities, inertia = _motions(scene, problem, armature, bears)
    gains, damping = _gains(scene, problem)
    bodies, carriers = moving_bodies(scene, problem, velocities), 6 + _carriers(scene, problem)
    motions = {}
    for name, rolling in rolling_by_model(scene, problem).items():
        refuse_flat_on_flat(scene, problem, rolling, velocities, bodies, bears)
        force_stiffness, constant = geometric_stiffness(scene, problem, rolling, velocities, bodies)
        motions[name] = LinearizedMotion(
            inertia, force_stiffness, constant, velocities[carriers], velocities, gains, damping
        )
    return motions


def _motions(
    scene: SceneFields,
    problem: QuasistaticProblem,
    armature: float,
    bears: NDArray[np.bool_] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return N (6 + L, d) and N^T M N; the arguments are those of `_linearized`.

    Raises:
        ArgumentError: See `minimum_stiffness`.
    """
    carriers = _carriers(scene, problem)
    joints = np.isin(np.arange(problem.joint_count), carriers)
    basis, kept, units = without_slip(problem, np.append(np.ones(6, bool), joints), bears=bears)
    basis[np.abs(basis) < _MOTION_ROUNDING] = 0.0  # no feedback acts on what rounding moves
    velocities = np.zeros((6 + problem.joint_count, basis.shape[1]))
    velocities[kept] = units[:, None] * basis
    inertia = np.zeros((len(basis), len(basis)))
    inertia[:6, :6] = problem.object_inertia
    own = problem.joint_inertia
    if own is not None and len(carriers):
        slides = [unit is JointUnit.FORCE for unit in problem.joint_units]
        rotors = np.diag(armature * gain_shares(slides))
        moving_joints(problem.with_changes(joint_inertia=own + rotors))
        inertia[6:, 6:] = (own + rotors)[np.ix_(carriers, carriers)]
    return velocities, velocities[kept].T @ inertia @ velocities[kept]


def _carriers(scene: SceneFields, problem: QuasistaticProblem) -> NDArray[np.intp]:
    """Return the (c,) columns of J that move a link which touches the object."""
    hand = scene.hand
    if hand is None or scene.controller.holds_joints:
        return np.zeros(0, dtype=np.intp)
    found = contacts_of(scene).arrays
    touching = [hand.tree.link_joints[link] for link in {*found.bodies[: found.hand_count]}]
    moved = hand.tree.supports[touching].any(axis=0)
    columns = (hand.actuation.from_joints[moved] != 0.0).any(axis=0)
    return np.flatnonzero(columns[: problem.joint_count])
