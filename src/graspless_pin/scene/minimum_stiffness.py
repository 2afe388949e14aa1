"""Minimum position feedback for a stable rest, and the growth rate of small motions without it."""

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
    no_slip_basis,
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
"""Relative to the motion: smaller parts count as zero."""
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
            read-only: where torques do not determine them, the worst ones that were found.
        growth_by_surface: Growth with the facets of convex hulls of meshes (``facets``), and with
            smooth surfaces fitted to them (``fitted``); the figures above are the worse of both.
            Empty where no mesh touches.
        armature: Rotor inertia added at each joint, kg m^2, scaled as the stiffness.
        damping: Damping at each joint, N m s/rad, scaled as the stiffness.
        assumed: Stated contacts at which the shapes do not touch: their points are assumed to stay
            fixed on both bodies.
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


class _MotionAnalysis(NamedTuple):
    """Small motions for one model of the surfaces, under the worst contact forces found."""

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

    The object is at rest under constant torques, and its contacts roll without slipping: whether
    rest can be left by slipping or opening is another question. Contacts that the declared motion
    parts carry no force; a declared motion with sliding contacts is ignored. Joints that carry no
    touching link are held.

    Args:
        scene: The scene.
        torques: (L,) motor torques that hold the object in balance, N m (N).
        armature: Added to the inertia of each joint, kg m^2, over (0.1 m)^2 at joints that slide.
        damping: Damping at each joint, N m s/rad, likewise.

    Raises:
        ArgumentError: If the torques do not hold the object in balance, the joints' inertia is
            singular, or a figure is out of range.
        SceneError: If one contact point represents a line or a face along which the bodies roll.

    Examples:
        >>> from graspless_pin import load_scene, minimum_stiffness
        >>> scene = load_scene("examples/allegro_sphere_on_slope.yaml")
        >>> found = minimum_stiffness(scene, scene.solve().torques)
        >>> print(f"{found.stiffness:.1f} N m/rad")
        0.4 N m/rad
    """
    added, damping = real_number("armature", armature, 0.0), real_number("damping", damping, 0.0)
    scene = checked_scene(scene).with_changes(controller=Controller(0.0, damping))
    problem, models = _analyses_by_model(scene, torques, added)
    worst = _worst_model(models)
    carriers = _carriers(scene, problem)
    names = [problem.joint_names[joint] for joint in carriers]
    per_joint = dict.fromkeys(names, 0.0)
    if worst.growth > 0.0:
        per_joint = {
            name: _least_stable(worst.motion.stable_feedback(worst.stiffness, row))
            for name, row in zip(names, np.eye(len(names)), strict=True)
        }
    return MinimumStiffness(
        _least_stable(worst.stable) * _unit_factor(scene, problem),
        MappingProxyType(per_joint),
        worst.growth,
        read_only(worst.fastest) if worst.growth > 0.0 else None,
        read_only(worst.forces),
        _growth_by_model(models),
        added,
        damping,
        assumed_contacts(scene),
    )


def small_motions(scene: SceneFields, torques: ArrayLike | Mapping[str, float]) -> SmallMotions:
    """Return the growth of small motions under the scene's controller, or why it is unknown.

    Args:
        scene: The scene.
        torques: (L,) motor torques, N m (N).
    """
    try:
        with capture():
            problem, models = _analyses_by_model(scene, torques, ARMATURE)
    except GrasplessPinError as error:
        reason = str(error).removeprefix(f"{label_of(scene)}: ").partition("; ")[0]
        return SmallMotions.not_known(reason)
    worst = _worst_model(models)
    grows = worst.growth > 0.0
    neutral = [_motion_text(scene, problem, motion) for motion in worst.neutral.T]
    factor = _unit_factor(scene, problem)
    return SmallMotions(
        _least_stable(worst.stable) * factor,
        worst.growth,
        _stiffness_unit(scene, problem),
        _motion_text(scene, problem, worst.fastest) if grows else "",
        growth_by_surface=_growth_by_model(models),
        motion=read_only(worst.fastest) if grows else None,
        neutral=tuple(dict.fromkeys(neutral)),
        least_growth=worst.least_growth,
        stable=tuple((low * factor, high * factor) for low, high in worst.stable),
        proofs={} if grows else _growth_proofs(scene, problem, models),
        assumed=assumed_contacts(scene) if len(worst.motion.inertia) else (),
    )


def _growth_proofs(
    scene: SceneFields, problem: QuasistaticProblem, models: Mapping[str, _MotionAnalysis]
) -> Mapping[str, GrowthProof]:
    """Return proofs that no motion grows, by model of the surfaces; empty without all of them."""
    carriers = _carriers(scene, problem)
    proofs = {}
    for name, analysis in models.items():
        motion = analysis.motion
        lyapunov = lyapunov_matrix(
            motion.inertia, motion.total_stiffness(analysis.stiffness), motion.drag, GROWTH_LIMIT
        )
        if lyapunov is None:
            return {}
        proofs[name] = GrowthProof(
            read_only(motion.velocities),
            read_only(analysis.bearing),
            read_only(analysis.stiffness),
            (*carriers.tolist(),),
            read_only(motion.gains),
            read_only(motion.damping),
            read_only(ARMATURE * _carrier_shares(scene, problem)),
            GROWTH_LIMIT,
            read_only(lyapunov),
        )
    return proofs


def controller_words(scene: SceneFields) -> str:
    """Return the feedback at the joints that carry touching links as text; empty if not stated."""
    if scene.controller.holds_joints:
        return JOINTS_HELD
    problem = problem_of(scene)
    gains, _ = _carrier_gains(scene, problem)
    gains = gains / _carrier_shares(scene, problem) * _unit_factor(scene, problem)
    names = [problem.joint_names[joint] for joint in _carriers(scene, problem)]
    fingers = {} if scene.hand is None else fingers_of_motors(scene.hand)
    words = gain_words(gains.tolist(), _stiffness_unit(scene, problem), names, fingers)
    return words or (CONSTANT_TORQUES if scene.controller.is_given else "")


def _stiffness_unit(scene: SceneFields, problem: QuasistaticProblem) -> str:
    """Return the unit of the stiffness of all joints that carry touching links."""
    if not len(_carriers(scene, problem)):
        return ""
    return "N m/rad" if _unit_factor(scene, problem) == 1.0 else "N/m"


def _unit_factor(scene: SceneFields, problem: QuasistaticProblem) -> float:
    """Return the factor from stiffness per radian to the common unit: per metre if all slide."""
    shares = _carrier_shares(scene, problem)
    return float(shares.min()) if len(shares) else 1.0


def _carrier_shares(scene: SceneFields, problem: QuasistaticProblem) -> FloatArray:
    """Return `gain_shares` of the joints that carry touching links."""
    units = [problem.joint_units[joint] for joint in _carriers(scene, problem)]
    return gain_shares([unit is JointUnit.FORCE for unit in units])


def _carrier_gains(
    scene: SceneFields, problem: QuasistaticProblem
) -> tuple[FloatArray, FloatArray]:
    """Return stiffness K and damping D, each (c,), of the joints that carry touching links."""
    controller, fingers = scene.controller, dict[str, str]()
    if scene.hand is not None:
        controller.check(scene.hand.actuation.names, (*scene.hand.fingers,))
        fingers = fingers_of_motors(scene.hand)
    names = [problem.joint_names[joint] for joint in _carriers(scene, problem)]
    return controller.gains(names, _carrier_shares(scene, problem), fingers)


def _growth_by_model(models: Mapping[str, _MotionAnalysis]) -> Mapping[str, float]:
    """Return the growth rate (1/s) by model of the surfaces; empty with one model."""
    return {name: analysis.growth for name, analysis in models.items()} if len(models) > 1 else {}


def _worst_model(models: Mapping[str, _MotionAnalysis]) -> _MotionAnalysis:
    return max(
        models.values(), key=lambda one: (one.growth > 0.0, _least_stable(one.stable), one.growth)
    )


def _least_stable(stable: Intervals) -> float:
    """Return the lower end of the last interval of stable feedback; inf without any."""
    return stable[-1][0] if stable else np.inf


def _motion_text(scene: SceneFields, problem: QuasistaticProblem, motion: FloatArray) -> str:
    """Return in words what moves in a small motion (6 + L,), and how."""
    shares = motion / motion_units(problem)
    linear, angular = (float(np.linalg.norm(part)) for part in (shares[:3], shares[3:6]))
    if max(linear, angular) < _PART_OF_MOTION * float(np.abs(shares).max()):
        return "the fingers buckle"
    if angular < _PART_OF_MOTION * linear:
        return "the object shifts"
    if scene.object.shape.rolls and linear > _PART_OF_MOTION * angular:
        return "the object rolls"
    axis, load = motion[3:6], problem.external_wrench[:3]
    cosine = abs(float(axis @ load)) / float(
        np.linalg.norm(axis) * max(np.linalg.norm(load), _LEAST_NORM)
    )
    return "the object turns" if cosine > _COSINE_ALONG_LOAD else "the object tilts"


def _analyses_by_model(
    scene: SceneFields, torques: ArrayLike | Mapping[str, float], armature: float
) -> tuple[QuasistaticProblem, Mapping[str, _MotionAnalysis]]:
    """Return a scene's problem at rest, and its small motions by model of the surfaces.

    The growth is under the controller; stable feedback is equal at all joints and replaces it.

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
    rest = balance(problem, torque)
    if rest is None or not rest.is_rest:
        raise ArgumentError(
            "torques", "cannot be balanced by contact forces inside the friction cones"
        )
    bearing = bearing_forces(problem, torque, rest.forces)
    motions = _linearized_by_model(scene, problem, armature, bearing[:, 0] > LEAST_LOAD)
    bearing, forces = (
        world_forces(problem, scaled * problem.scales.force) for scaled in (bearing, rest.forces)
    )
    models = {}
    for name, motion in motions.items():
        worst, best = (
            extreme_forces(motion, problem, torque, forces, worst=worst) for worst in (True, False)
        )
        stiffness = motion.stiffness(worst)
        growth, fastest = motion.fastest_growth(stiffness)
        if growth > 0.0:
            fastest = fastest / fastest[np.argmax(np.abs(fastest))]
        models[name] = _MotionAnalysis(
            motion,
            bearing,
            stiffness,
            worst,
            growth,
            fastest,
            stable=motion.stable_feedback(stiffness, _carrier_shares(scene, problem)),
            neutral=motion.neutral_motions(stiffness),
            least_growth=motion.fastest_growth(motion.stiffness(best))[0],
        )
    return problem, models


def linearized_motions(scene: SceneFields) -> tuple[LinearizedMotion, ...]:
    """Return linearised motions under the scene's controller, one for each model of the surfaces.

    Empty where they cannot be computed, or contacts slide.
    """
    problem = problem_of(scene)
    if problem.is_sliding.any():
        return ()
    try:
        with capture():
            return (*_linearized_by_model(scene, problem, ARMATURE).values(),)
    except GrasplessPinError:
        return ()


def _linearized_by_model(
    scene: SceneFields,
    problem: QuasistaticProblem,
    armature: float,
    bears: NDArray[np.bool_] | None = None,
) -> Mapping[str, LinearizedMotion]:
    """Return linearised motions under the scene's controller, by model of the surfaces.

    Args:
        scene: The scene.
        problem: Its problem of rest.
        armature: See `minimum_stiffness`.
        bears: (M,) contacts that bear load: motions neither slip nor open there; None: all.

    Raises:
        ArgumentError: See `minimum_stiffness`.
        SceneError: See `minimum_stiffness`.
    """
    velocities, inertia = _no_slip_motions(scene, problem, armature, bears)
    gains, damping = _carrier_gains(scene, problem)
    bodies, carriers = moving_bodies(scene, problem, velocities), 6 + _carriers(scene, problem)
    motions = {}
    for name, rolling in rolling_by_model(scene, problem).items():
        refuse_flat_on_flat(scene, problem, rolling, velocities, bodies, bears)
        force_stiffness, constant = geometric_stiffness(scene, problem, rolling, velocities, bodies)
        motions[name] = LinearizedMotion(
            inertia, force_stiffness, constant, velocities[carriers], velocities, gains, damping
        )
    return motions


def _no_slip_motions(
    scene: SceneFields,
    problem: QuasistaticProblem,
    armature: float,
    bears: NDArray[np.bool_] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return motions without slip N (6 + L, d), and N^T M N: see `_linearized_by_model`.

    Raises:
        ArgumentError: See `minimum_stiffness`.
    """
    carriers = _carriers(scene, problem)
    joints = np.isin(np.arange(problem.joint_count), carriers)
    basis, kept, units = no_slip_basis(problem, np.append(np.ones(6, bool), joints), bears=bears)
    basis[np.abs(basis) < _MOTION_ROUNDING] = 0.0  # so that no feedback acts on rounding
    velocities = np.zeros((6 + problem.joint_count, basis.shape[1]))
    velocities[kept] = units[:, None] * basis
    inertia = np.zeros((len(basis), len(basis)))
    inertia[:6, :6] = problem.object_inertia
    joint_inertia = problem.joint_inertia
    if joint_inertia is not None and len(carriers):
        is_prismatic = [unit is JointUnit.FORCE for unit in problem.joint_units]
        rotors = np.diag(armature * gain_shares(is_prismatic))
        moving_joints(problem.with_changes(joint_inertia=joint_inertia + rotors))
        inertia[6:, 6:] = (joint_inertia + rotors)[np.ix_(carriers, carriers)]
    return velocities, velocities[kept].T @ inertia @ velocities[kept]


def _carriers(scene: SceneFields, problem: QuasistaticProblem) -> NDArray[np.intp]:
    """Return the (c,) indices of the columns of J that move a touching link."""
    hand = scene.hand
    if hand is None or scene.controller.holds_joints:
        return np.zeros(0, dtype=np.intp)
    contacts = contacts_of(scene).arrays
    touching = [hand.tree.link_joints[link] for link in {*contacts.bodies[: contacts.hand_count]}]
    moved = hand.tree.supports[touching].any(axis=0)
    columns = (hand.actuation.from_joints[moved] != 0.0).any(axis=0)
    return np.flatnonzero(columns[: problem.joint_count])
