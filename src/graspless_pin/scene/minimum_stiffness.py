"""How much position feedback makes a scene's rest stable, and how fast it is lost without.

Contacts that roll leave the velocities N z of object and joints, G N = 0. Under the generalised
load Q (weight, torques less the links' weight) they accelerate with N^T M N z'' = N^T Q. At rest
N^T Q = 0; a little aside it is -K z, where K is worked out from scenes that are moved by a little:
contact points roll on the surfaces there, levers and weights change. Feedback of k N m/rad adds
k N_q^T N_q to K.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError, GrasplessPinError, SceneError
from graspless_pin.findings import capture
from graspless_pin.geometry.contact.convex_sets import is_hull
from graspless_pin.geometry.posing.displaced_hands import bent_hand
from graspless_pin.holding.dynamics import NEGLIGIBLE, motion_units
from graspless_pin.holding.verdict import SmallMotions
from graspless_pin.problem.checks import FloatArray, finite_array, read_only, real_number
from graspless_pin.problem.contact_map import contact_map
from graspless_pin.problem.inertias import moving_joints
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.problem.quasistatic import QuasistaticProblem
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.fields import SceneFields, checked_scene
from graspless_pin.scene.problem_data import problem_of

ARMATURE, DAMPING = 1e-4, 0.02
"""Of each joint unless told otherwise, kg m^2 and N m s/rad."""
STEP = 1e-3
"""How far scenes are moved, in the units of `free_motions`: twice that is the stated radius."""
_ALIKE = 0.05
_BALANCED = 1e-3
_STILL = 1e-3
_TURNING = 1e-6
_DOUBLINGS = 60
_HALVINGS = 24
_PART = 1e-3
"""Of the motion: a smaller part of it is none."""
_ALONG = float(np.cos(np.radians(20.0)))
_TINY = 1e-300
_PER = {JointUnit.TORQUE: "/rad", JointUnit.FORCE: "/m"}


@dataclass(frozen=True, eq=False)
class MinimumStiffness:
    """The position feedback that makes a rest stable to second order.

    See the example of `minimum_stiffness`.

    Attributes:
        stiffness: Smallest k, N m/rad (N/m for linear joints), of the same feedback at every joint
            that carries a touching link; 0 where none is needed, inf where none is enough.
        per_joint: The same of feedback at one joint alone, by its name.
        growth: Rate at which a small motion grows without feedback, 1/s; 0 where none does.
        motion: (6 + L,) velocity of the motion that grows fastest, read-only: of the object
            [linear; angular], then of the joints, the largest entry one; None where none grows.
        armature: Rotor inertia that was added at each joint, kg m^2.
        damping: Damping at each joint, N m s/rad.
    """

    stiffness: float
    per_joint: Mapping[str, float]
    growth: float
    motion: FloatArray | None
    armature: float
    damping: float


class _Linearised(NamedTuple):
    """Small motions z about the rest: inertia z'' + damping feedback z' + stiffness z = 0.

    Attributes:
        inertia: (d, d) N^T M N.
        stiffness: (d, d) K.
        joints: (c, d) N_q: rates of the joints that carry touching links.
        velocities: (6 + L, d) N.
        slowest: Growth up to this is none, 1/s.
    """

    inertia: FloatArray
    stiffness: FloatArray
    joints: FloatArray
    velocities: FloatArray
    slowest: float

    def steps(self, pattern: FloatArray, factors: FloatArray, damping: float) -> FloatArray:
        """Return (K, 2 d, 2 d) A of (z, z')' = A (z, z') under K multiples of (c,) feedback."""
        count = len(self.inertia)
        feedback = self.joints.T @ (pattern[:, None] * self.joints)
        parts = [self.stiffness, damping * self.joints.T @ self.joints, feedback]
        rolled = -np.linalg.solve(self.inertia, np.hstack(parts))
        found = np.zeros((len(factors), 2 * count, 2 * count))
        found[:, :count, count:] = np.eye(count)
        found[:, count:] = rolled[:, : 2 * count]
        found[:, count:, :count] += factors[:, None, None] * rolled[:, 2 * count :]
        return found

    def fastest(self, damping: float) -> tuple[float, FloatArray]:
        """Return the fastest growth without feedback, 1/s, and its motion (6 + L,)."""
        count = len(self.inertia)
        if count == 0:
            return 0.0, np.zeros(len(self.velocities))
        step = self.steps(np.zeros(len(self.joints)), np.zeros(1), damping)[0]
        values, vectors = np.linalg.eig(step)
        fastest = int(np.argmax(np.real(values)))
        motion = self.velocities @ np.real(vectors[:count, fastest])
        rate = float(np.real(values[fastest]))
        return (rate if rate > self.slowest else 0.0), motion

    def grows(self, pattern: FloatArray, factors: FloatArray, damping: float) -> NDArray[np.bool_]:
        """Return the (K,) multiples of feedback under which something grows."""
        values = np.linalg.eigvals(self.steps(pattern, factors, damping))
        return np.real(values).max(axis=1) > self.slowest


def minimum_stiffness(
    scene: SceneFields, torques: ArrayLike, *, armature: float = ARMATURE, damping: float = DAMPING
) -> MinimumStiffness:
    """Find the smallest position feedback with which a scene's rest is stable to second order.

    The object is at rest under constant torques, without the declared motion, and its contacts
    roll without slipping as far as they go: whether rest can be left by slipping or opening is
    another question. Joints that carry no touching link are held.

    Args:
        scene: A scene whose contacts are found from shapes; where bodies turn on each other, no
            shape may be a mesh.
        torques: (L,) of the motors, N m (N), that hold the object in balance.
        armature: Added to the inertia of each joint, kg m^2 (kg).
        damping: At each joint, N m s/rad (N s/m).

    Raises:
        ArgumentError: If the torques do not hold the object in balance, the joints' inertia is
            singular, or a figure is out of range.
        SceneError: If contacts are stated, a finger is hybrid, a mesh turns on something, contacts
            come or go a little aside, or surfaces are not smooth within a thousandth of the
            contacts' distance.

    Examples:
        >>> from graspless_pin import load_scene, minimum_stiffness
        >>> scene = load_scene("examples/allegro_sphere_on_slope.yaml")
        >>> found = minimum_stiffness(scene, scene.solve().torques)
        >>> print(f"{found.stiffness:.1f} N m/rad")
        0.4 N m/rad
    """
    added, damping = real_number("armature", armature, 0.0), real_number("damping", damping, 0.0)
    scene, problem, at = _rest(scene, torques, added)
    growth, motion = at.fastest(damping)
    names = [problem.joint_names[joint] for joint in _carriers(scene, problem)]
    alone = dict.fromkeys(names, 0.0)
    if growth > 0.0:
        alone = {
            name: _smallest(at, row, damping)
            for name, row in zip(names, np.eye(len(names)), strict=True)
        }
        motion = motion / motion[np.argmax(np.abs(motion))]
    return MinimumStiffness(
        _smallest(at, np.ones(len(names)), damping) if growth > 0.0 else 0.0,
        MappingProxyType(alone),
        growth,
        read_only(motion) if growth > 0.0 else None,
        added,
        damping,
    )


def small_motions(scene: SceneFields, torques: ArrayLike) -> SmallMotions:
    """Return what `minimum_stiffness` says of all joints together, or why it says nothing.

    Args:
        scene: The scene.
        torques: (L,) of the motors, N m (N).
    """
    try:
        with capture():
            scene, problem, at = _rest(scene, torques, ARMATURE)
    except GrasplessPinError as error:
        why = str(error).removeprefix(f"{scene.name}: ").partition("; ")[0]
        return SmallMotions.not_known(why)
    growth, motion = at.fastest(DAMPING)
    if growth == 0.0:
        return SmallMotions(0.0, 0.0)
    carriers = _carriers(scene, problem)
    units = {problem.joint_units[joint] for joint in carriers}
    return SmallMotions(
        _smallest(at, np.ones(len(carriers)), DAMPING),
        growth,
        " or ".join(f"{unit}{_PER[unit]}" for unit in JointUnit if unit in units),
        _moving_words(scene, problem, motion),
    )


def _moving_words(scene: SceneFields, problem: QuasistaticProblem, motion: FloatArray) -> str:
    """Return what a small motion (6 + L,) moves, and how."""
    shares = motion / motion_units(problem)
    linear, angular = (float(np.linalg.norm(part)) for part in (shares[:3], shares[3:6]))
    if max(linear, angular) < _PART * float(np.abs(shares).max()):
        return "the fingers buckle"
    if angular < _PART * linear:
        return "the object shifts"
    if scene.object.shape.rolls and linear > _PART * angular:
        return "the object rolls"
    axis, load = motion[3:6], problem.external_wrench[:3]
    along = abs(float(axis @ load)) / float(np.linalg.norm(axis) * max(np.linalg.norm(load), _TINY))
    return "the object turns" if along > _ALONG else "the object tilts"


def _rest(
    scene: SceneFields, torques: ArrayLike, armature: float
) -> tuple[SceneFields, QuasistaticProblem, _Linearised]:
    """Return a scene at rest, its problem, and the small motions about it.

    Raises:
        ArgumentError: See `minimum_stiffness`.
        SceneError: See `minimum_stiffness`.
    """
    scene = checked_scene(scene).with_changes(motion=None)
    problem = problem_of(scene)
    torque = finite_array("torques", torques, (problem.joint_count,))
    if scene.given_contacts is not None:
        raise SceneError(f"{scene.name}: contacts are stated, and nobody knows how they roll")
    if scene.hand is not None and scene.hand.control.hybrid_fingers:
        raise SceneError(f"{scene.name}: a hybrid finger follows the object; control it by force")
    return scene, problem, _linearised(scene, problem, torque, armature)


def _linearised(
    scene: SceneFields, problem: QuasistaticProblem, torques: FloatArray, armature: float
) -> _Linearised:
    """Return the small motions of a scene about its rest."""
    carriers = _carriers(scene, problem)
    kept = np.concatenate([np.arange(6), 6 + carriers])
    units = motion_units(problem)[kept]
    rows, load = _rolling(problem, torques, kept, units)
    basis = null_space(rows, rcond=NEGLIGIBLE)
    scale = problem.scales.force * problem.scales.length
    off = float(np.abs(basis.T @ load).max(initial=0.0)) / scale
    if off > _BALANCED:
        raise ArgumentError(
            "torques",
            f"do not hold the object in balance: {off:.3g} of the load's moment is left over",
        )
    velocities = np.zeros((6 + problem.joint_count, basis.shape[1]))
    velocities[kept] = units[:, None] * basis
    _refuse_rolling_meshes(scene, velocities)
    near, far = (
        _stiffness(scene, problem, torques, (kept, units, basis), step) for step in (STEP, 2 * STEP)
    )
    if np.abs(far - near).max(initial=0.0) > _ALIKE * np.abs(near).max(initial=0.0) + 1e-6 * scale:
        raise SceneError(
            f"{scene.name}: surfaces are not smooth where contacts roll: within "
            f"{2 * STEP * problem.scales.length:.2g} m the stiffness changes by more than "
            f"{_ALIKE:.0%}"
        )
    inertia = np.zeros((len(kept), len(kept)))
    inertia[:6, :6] = problem.object_inertia
    own = problem.joint_inertia
    if own is not None and len(carriers):
        rotors = armature * np.eye(problem.joint_count)
        moving_joints(problem.with_changes(joint_inertia=own + rotors))
        inertia[6:, 6:] = (own + rotors)[np.ix_(carriers, carriers)]
    reduced = velocities[kept].T @ inertia @ velocities[kept]
    lightest = float(np.linalg.eigvalsh(reduced).min(initial=np.inf))
    return _Linearised(
        reduced,
        (4.0 * near - far) / 3.0,
        velocities[6 + carriers],
        velocities,
        _STILL * float(np.sqrt(scale / lightest)),
    )


def _carriers(scene: SceneFields, problem: QuasistaticProblem) -> NDArray[np.intp]:
    """Return the (c,) columns of J that move a link which touches the object."""
    hand = scene.hand
    if hand is None:
        return np.zeros(0, dtype=np.intp)
    touching = [hand.tree.link_joints[link] for link in _touching_links(scene)]
    moved = hand.tree.supports[touching].any(axis=0)
    columns = (hand.actuation.from_joints[moved] != 0.0).any(axis=0)
    return np.flatnonzero(columns[: problem.joint_count])


def _touching_links(scene: SceneFields) -> list[str]:
    found = contacts_of(scene).arrays
    return sorted(set(found.bodies[: found.hand_count]))


def _rolling(
    problem: QuasistaticProblem, torques: FloatArray, kept: NDArray[np.intp], units: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the rows that vanish where contacts roll, and the load, both scaled."""
    rows = contact_map(problem) * np.repeat([1.0, -1.0], [6, problem.joint_count])
    still = np.ones((problem.contact_count, 3), dtype=bool)
    still[:, 1:] = problem.has_cone[:, None]
    load = np.concatenate([problem.external_wrench, torques - problem.gravity_torques])
    return rows[still][:, kept] * (units / problem.scales.length), load[kept] * units


def _stiffness(
    scene: SceneFields,
    problem: QuasistaticProblem,
    torques: FloatArray,
    at_rest: tuple[NDArray[np.intp], FloatArray, FloatArray],
    step: float,
) -> FloatArray:
    """Return K by central differences of N^T Q, scaled; N is projected from that at rest."""
    kept, units, basis = at_rest
    rank = len(kept) - basis.shape[1]
    stiffness = np.zeros((basis.shape[1],) * 2)
    for column, motion in enumerate(basis.T):
        velocity = np.zeros(6 + problem.joint_count)
        velocity[kept] = units * motion
        sides = []
        for side in (step, -step):
            there = problem_of(_moved(scene, side * velocity))
            if there.contact_count != problem.contact_count:
                raise SceneError(f"{scene.name}: contacts come or go where others roll")
            rows, load = _rolling(there, torques, kept, units)
            _, values, right = np.linalg.svd(rows, full_matrices=True)
            if rank < len(values) and values[rank] > 0.01 * step * values[0]:
                raise SceneError(
                    f"{scene.name}: contacts let the object roll at first, and block it soon after"
                )
            sides.append(basis.T @ (right[rank:].T @ (right[rank:] @ load)))
        stiffness[:, column] = (sides[1] - sides[0]) / (2.0 * step)
    return stiffness


def _moved(scene: SceneFields, change: FloatArray) -> SceneFields:
    """Return the scene with object and actuators moved by (6 + L,) m and rad.

    Raises:
        SceneError: If a joint would leave its limits.
    """
    T = np.array(scene.object.T_world_object)
    T[:3, :3] = Rotation.from_rotvec(change[3:6]).as_matrix() @ T[:3, :3]
    center = scene.object.center_of_mass_world + change[:3]
    T[:3, 3] = center - T[:3, :3] @ scene.object.center_of_mass
    hand = None if scene.hand is None else bent_hand(scene.hand, change[6:])
    return scene.with_changes(object=scene.object.with_pose(T), hand=hand)


def _refuse_rolling_meshes(scene: SceneFields, velocities: FloatArray) -> None:
    """Refuse meshes that turn about tangents of their contacts: only their facets are known.

    Raises:
        SceneError: Naming the body.
    """
    found, hand = contacts_of(scene).arrays, scene.hand
    meshes = {support.name for support in scene.supports if any(map(is_hull, support.geometries))}
    if hand is not None:
        meshes |= {item.link for item in hand.tree.geometries if is_hull(item.shape)}
    own = scene.object.name if any(map(is_hull, scene.object.geometries)) else None
    for change in STEP * velocities.T:
        for body, normal in zip(found.bodies, found.normals, strict=True):
            turn = change[3:6]
            if hand is not None and body in hand.tree.link_frames:
                R = hand.link_pose(body)[:3, :3]
                there = bent_hand(hand, change[6:]).link_pose(body)[:3, :3]
                turn = turn - Rotation.from_matrix(there @ R.T).as_rotvec()
            mesh = body if body in meshes else own
            if mesh is not None and np.linalg.norm(np.cross(turn, normal)) > _TURNING * STEP:
                raise SceneError(
                    f"{scene.name}: {mesh!r} is a mesh and turns where {body!r} touches the object;"
                    " its curvature there is not known: use a box, sphere, cylinder, capsule or "
                    "cone"
                )


def _smallest(at: _Linearised, pattern: FloatArray, damping: float) -> float:
    """Return the smallest factor on a pattern of feedback beyond which nothing grows; inf: none."""
    size = float(np.abs(at.stiffness).max())
    reach = float(np.square(at.joints).sum(axis=0).max()) if len(at.joints) else 0.0
    if reach == 0.0:
        return np.inf
    factors = size / reach * np.exp2(np.arange(-_DOUBLINGS // 2, _DOUBLINGS // 2, dtype=float))
    growing = at.grows(pattern, factors, damping)
    if growing[-1]:
        return np.inf
    last = len(growing) - 1 - int(np.argmax(growing[::-1])) if growing.any() else 0
    low, high = factors[last], factors[last + 1]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        grew = at.grows(pattern, np.array([middle]), damping)[0]
        low, high = (middle, high) if grew else (low, middle)
    return float(high)
