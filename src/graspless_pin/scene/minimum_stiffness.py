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

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.contact.convex_sets import is_hull
from graspless_pin.holding.free_motions import NEGLIGIBLE, motion_units
from graspless_pin.problem.checks import FloatArray, finite_array, read_only, real_number
from graspless_pin.problem.contact_map import contact_map
from graspless_pin.problem.inertias import moving_joints
from graspless_pin.problem.quasistatic import QuasistaticProblem
from graspless_pin.scene.load import checked_scene
from graspless_pin.scene.moved import bent_hand, moved_scene
from graspless_pin.scene.scene import Scene

STEP = 1e-3
"""How far scenes are moved, in the units of `free_motions`: twice that is the stated radius."""
_ALIKE = 0.05
_BALANCED = 1e-3
_STILL = 1e-3
_TURNING = 1e-6
_DOUBLINGS = 60
_HALVINGS = 40


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

    def growth(self, feedback: FloatArray, damping: float) -> tuple[float, FloatArray]:
        """Return the fastest growth under (c,) feedback, 1/s, and its motion (6 + L,)."""
        count = len(self.inertia)
        if count == 0:
            return 0.0, np.zeros(len(self.velocities))
        forces = np.hstack([
            self.stiffness + self.joints.T @ (feedback[:, None] * self.joints),
            damping * self.joints.T @ self.joints,
        ])  # fmt: skip
        step = np.vstack([
            np.eye(count, 2 * count, count), -np.linalg.solve(self.inertia, forces)
        ])  # fmt: skip
        values, vectors = np.linalg.eig(step)
        fastest = int(np.argmax(np.real(values)))
        motion = self.velocities @ np.real(vectors[:count, fastest])
        rate = float(np.real(values[fastest]))
        return (rate if rate > self.slowest else 0.0), motion


def minimum_stiffness(
    scene: Scene, torques: ArrayLike, *, armature: float = 1e-4, damping: float = 0.02
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
    scene = checked_scene(scene).with_changes(motion=None)
    problem = scene.problem()
    torque = finite_array("torques", torques, (problem.joint_count,))
    added, damping = real_number("armature", armature, 0.0), real_number("damping", damping, 0.0)
    if scene.given_contacts is not None:
        raise SceneError(f"{scene.name}: contacts are stated, and nobody knows how they roll")
    if scene.hand is not None and scene.hand.control.hybrid_fingers:
        raise SceneError(f"{scene.name}: a hybrid finger follows the object; control it by force")
    at = _linearised(scene, problem, torque, added)
    none = np.zeros(len(at.joints))
    growth, motion = at.growth(none, damping)
    names = [problem.joint_names[joint] for joint in _carriers(scene, problem)]
    alone = dict.fromkeys(names, 0.0)
    if growth > 0.0:
        alone = {
            name: _smallest(at, row, damping)
            for name, row in zip(names, np.eye(len(names)), strict=True)
        }
        motion = motion / motion[np.argmax(np.abs(motion))]
    return MinimumStiffness(
        _smallest(at, none + 1.0, damping) if growth > 0.0 else 0.0,
        MappingProxyType(alone),
        growth,
        read_only(motion) if growth > 0.0 else None,
        added,
        damping,
    )


def _linearised(
    scene: Scene, problem: QuasistaticProblem, torques: FloatArray, armature: float
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


def _carriers(scene: Scene, problem: QuasistaticProblem) -> NDArray[np.intp]:
    """Return the (c,) columns of J that move a link which touches the object."""
    hand = scene.hand
    if hand is None:
        return np.zeros(0, dtype=np.intp)
    touching = [hand.tree.link_joints[link] for link in _touching_links(scene)]
    moved = hand.tree.supports[touching].any(axis=0)
    columns = (hand.actuation.from_joints[moved] != 0.0).any(axis=0)
    return np.flatnonzero(columns[: problem.joint_count])


def _touching_links(scene: Scene) -> list[str]:
    found = scene.contacts.arrays
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
    scene: Scene,
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
            there = moved_scene(scene, side * velocity).problem()
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


def _refuse_rolling_meshes(scene: Scene, velocities: FloatArray) -> None:
    """Refuse meshes that turn about tangents of their contacts: only their facets are known.

    Raises:
        SceneError: Naming the body.
    """
    found, hand = scene.contacts.arrays, scene.hand
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
    factors = size / reach * 2.0 ** np.arange(-_DOUBLINGS // 2, _DOUBLINGS // 2)
    grows = [at.growth(factor * pattern, damping)[0] > 0.0 for factor in factors]
    if grows[-1]:
        return np.inf
    last = len(grows) - 1 - int(np.argmax(grows[::-1])) if any(grows) else 0
    low, high = factors[last], factors[last + 1]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        grew = at.growth(middle * pattern, damping)[0] > 0.0
        low, high = (middle, high) if grew else (low, middle)
    return float(high)
