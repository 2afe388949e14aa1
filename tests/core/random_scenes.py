"""Seeded random problems of any size, for tests that compare searches and for the benchmarks.

Three families: `general_scene` (a sphere or box in fingers of several joints), `slope_scene` (a box
on a slope with so few joints that the virtual-sliding rule binds) and `infeasible_scene`. The same
arguments give the same arrays on every machine up to rounding.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from graspless_pin import QuasistaticProblem

_SIZE = 0.1
_LEVER = 0.1
_GRAVITY = 9.8
_MOST_SUPPORTS = 8

Array = NDArray[np.float64]


def general_scene(
    seed: int, contacts: int, *, joints: tuple[int, int] = (2, 4), cone_edges: int = 8
) -> QuasistaticProblem:
    """A sphere or box touched by fingers of several joints and by supports without a joint.

    The wrench is that of random forces inside the friction cones, so forces that balance it exist;
    whether the torque limits allow any depends on the seed.

    Args:
        seed: Of the random numbers.
        contacts: M >= 2; each is a support's or the one contact of a finger.
        joints: Least and most joints of a finger. From three on a fingertip can move any way.
        cone_edges: Edges of each friction cone.
    """
    rng = np.random.default_rng([1, seed, contacts])
    supports = int(rng.integers(0, 1 + min(contacts // 2, 2)))
    supports = max(supports, min(contacts // 6, _MOST_SUPPORTS))
    normals, positions = _surface(rng, contacts, supports, box=bool(rng.integers(2)))
    friction = rng.uniform(0.3, 0.8, contacts)
    tangents = _tangents(rng, normals)
    share = np.sqrt(rng.uniform(0.0, 0.8, contacts))
    forces = _inner_forces(rng, normals, tangents, friction, share, cone_edges)
    jacobian, owner = _serial_fingers(rng, positions, normals, range(supports, contacts), joints)
    gravity = rng.uniform(-0.05, 0.05, jacobian.shape[1])
    need = np.abs(jacobian.T @ forces.ravel() + gravity)
    most = np.array([need[owner == finger].max() for finger in owner])
    limit = rng.uniform(0.8, 4.0) * most + 0.02
    return QuasistaticProblem(
        positions,
        normals,
        -_wrench(positions, forces),
        jacobian,
        friction=friction,
        tangents=tangents,
        torque_limits=(-limit, limit),
        max_normal_force=rng.uniform(15.0, 40.0, contacts),
        cone_edges=cone_edges,
        gravity_torques=gravity,
    )


def slope_arguments(seed: int, contacts: int, *, cone_edges: int = 8) -> dict[str, Any]:
    """Arguments of `slope_scene`."""
    rng = np.random.default_rng([2, seed, contacts])
    fingers = 1 if contacts <= 3 else int(rng.integers(1, 1 + max(2, contacts // 4)))
    supports = contacts - fingers
    half = rng.uniform(0.05, 0.1, 3)
    # Slope frame: x up the slope, y across it, z along its normal; the box's centre is the origin.
    corners = np.array([[1, 1], [-1, -1], [-1, 1], [1, -1]])[:supports]
    inner = rng.uniform(-0.9, 0.9, (supports - len(corners), 2))
    below = np.vstack([corners, inner]) * half[:2]
    positions = np.vstack([np.column_stack([below, np.full(supports, -half[2])]),
                           np.zeros((fingers, 3))])  # fmt: skip
    normals = np.tile([0.0, 0.0, 1.0], (contacts, 1))
    # Fingers press on the sides (as a pair), on the lower face or on the top.
    faces = [[0, 1, 0], [0, -1, 0]] if rng.random() < 0.7 else [[1, 0, 0], [0, 0, -1]]
    spot = np.zeros(3)
    for finger in range(fingers):
        normal = np.array(faces[finger % 2], dtype=np.float64)
        if finger % 2 == 0 or rng.random() < 0.5:
            spot = rng.uniform(-0.8, 0.8, 3) * half
        at = spot * (normal == 0.0)
        positions[supports + finger], normals[supports + finger] = at - half * normal, normal
    tangents = _tangents(rng, normals, turned=0.4)
    friction = np.full(contacts, rng.uniform(0.1, 0.6))
    friction[supports:] = rng.uniform(0.3, 1.0)
    sliding = np.zeros((contacts, 3))
    if rng.random() < 0.35:
        spin = rng.normal() * (rng.random() < 0.3)
        sliding[:supports] = 0.05 * np.array([rng.choice([-1.0, 1.0]), 0.0, 0.0])
        sliding[:supports, :2] += spin * np.column_stack([-below[:, 1], below[:, 0]])
    share = rng.uniform(0.5, 0.95, contacts)
    forces = _inner_forces(rng, normals, tangents, friction, share, cone_edges)
    slides = np.linalg.norm(sliding, axis=1) > 0.0
    unit = sliding[slides] / np.linalg.norm(sliding[slides], axis=1, keepdims=True)
    press = np.einsum("ij,ij->i", forces, normals)[slides, None]
    forces[slides] = press * (normals[slides] - friction[slides, None] * unit)
    # Half of the wrenches are a weight on a slope, half those of random forces inside the cones.
    if rng.random() < 0.5:
        angle, weight = rng.uniform(0.3, 1.2), _GRAVITY * rng.uniform(0.3, 1.5)
        wrench = np.array([-weight * np.sin(angle), 0.0, -weight * np.cos(angle), 0.0, 0.0, 0.0])
    else:
        wrench = -_wrench(positions, forces)
    jacobian = np.zeros((contacts, 3, fingers))
    lower, upper = np.zeros(fingers), np.zeros(fingers)
    kinds = rng.choice(3, fingers, p=[0.6, 0.2, 0.2])
    kinds[0] = min(kinds[0], 1)
    for finger, kind in enumerate(kinds):
        contact = supports + finger
        if kind == 0:  # a lever of one joint
            jacobian[contact, :, finger] = -_LEVER * normals[contact]
            lower[finger], upper[finger] = -rng.uniform(1.0, 5.0), rng.uniform(0.0, 1.0)
        elif kind == 1:  # hybrid: a commanded normal force
            jacobian[contact, :, finger] = normals[contact]
            upper[finger] = rng.uniform(10.0, 40.0)
    jacobian, lower, upper = jacobian[:, :, kinds < 2], lower[kinds < 2], upper[kinds < 2]
    rotation = Rotation.random(rng=rng).as_matrix()
    return {
        "positions": positions @ rotation.T,
        "normals": normals @ rotation.T,
        "external_wrench": (wrench.reshape(2, 3) @ rotation.T).ravel(),
        "jacobian": (rotation @ jacobian).reshape(3 * contacts, -1),
        "friction": friction,
        "tangents": rotation @ tangents,
        "sliding": sliding @ rotation.T,
        "torque_limits": (lower, upper),
        "max_normal_force": 50.0,
        "cone_edges": cone_edges,
    }


def slope_scene(seed: int, contacts: int, *, cone_edges: int = 8) -> QuasistaticProblem:
    """A box on a slope under levers of one joint, hybrid and stiff fingers: few virtual motions.

    All but a few contacts are on the slope, the box's corners first; in a third of the scenes
    they slide, and sometimes the box turns while it slides. The slope's direction is random.

    Args:
        seed: Of the random numbers.
        contacts: M >= 3.
        cone_edges: Edges of each friction cone.
    """
    return QuasistaticProblem(**slope_arguments(seed, contacts, cone_edges=cone_edges))


def infeasible_scene(seed: int, contacts: int, *, cone_edges: int = 8) -> QuasistaticProblem:
    """A scene that no forces can balance, at least almost always: too little torque or friction.

    Args:
        seed: Even: a general scene whose motors are too weak to hold even their own fingers; odd:
            a scene of the same kind whose friction is too small.
        contacts: M >= 2.
        cone_edges: Edges of each friction cone.
    """
    scene = general_scene(seed, contacts, cone_edges=cone_edges)
    weak = seed % 2 == 0
    factor = 0.02 if weak else 1.0
    return QuasistaticProblem(
        scene.positions,
        scene.normals,
        scene.external_wrench,
        scene.jacobian,
        friction=scene.friction * (1.0 if weak else 0.02),
        tangents=scene.tangents,
        torque_limits=(factor * scene.lower_torque, factor * scene.upper_torque),
        max_normal_force=scene.max_normal_force,
        cone_edges=cone_edges,
    )


def _surface(
    rng: np.random.Generator, contacts: int, supports: int, *, box: bool
) -> tuple[Array, Array]:
    """(M, 3) normals into the object and positions; the first contacts lie below."""
    if not box:
        normals = rng.normal(size=(contacts, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        normals[:supports, 2] = np.abs(normals[:supports, 2])
        return normals, -_SIZE * normals
    face = rng.integers(1, 6, contacts)
    face[:supports] = 0
    axis, side = 2 - face // 2, np.where(face % 2 == 0, 1.0, -1.0)
    normals = np.zeros((contacts, 3))
    normals[np.arange(contacts), axis] = side
    positions = rng.uniform(-0.9 * _SIZE, 0.9 * _SIZE, (contacts, 3))
    positions[np.arange(contacts), axis] = -_SIZE * side
    return normals, positions


def _tangents(rng: np.random.Generator, normals: Array, *, turned: float = 1.0) -> Array:
    """(M, 3, 2) tangents: a share of them turned at random, the others along x, or y."""
    axis = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    chance = rng.random((len(normals), 1))
    raw = np.where(chance < turned, rng.normal(size=normals.shape), axis)
    first: Array = raw - np.einsum("ij,ij->i", raw, normals)[:, None] * normals
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second: Array = np.cross(normals, first)
    return np.stack([first, second], axis=2)


def _inner_forces(
    rng: np.random.Generator,
    normals: Array,
    tangents: Array,
    friction: Array,
    share: Array,
    edges: int,
) -> Array:
    """(M, 3) random forces that use the given share of the friction cones."""
    count = len(normals)
    press, turn = rng.uniform(1.0, 8.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    inside = share * np.cos(np.pi / edges)
    direction = np.einsum("lij,lj->li", tangents, np.column_stack([np.cos(turn), np.sin(turn)]))
    return press[:, None] * (normals + (friction * inside)[:, None] * direction)


def _wrench(positions: Array, forces: Array) -> Array:
    return np.concatenate([forces.sum(axis=0), np.cross(positions, forces).sum(axis=0)])


def _serial_fingers(
    rng: np.random.Generator,
    positions: Array,
    normals: Array,
    contacts: range,
    joints: tuple[int, int],
) -> tuple[Array, NDArray[np.int_]]:
    """(3M, L) Jacobian of random revolute chains that end at one contact each, and their owners."""
    columns, owner = [], []
    for contact in contacts:
        count = int(rng.integers(joints[0], joints[1] + 1))
        origins = positions[contact] - np.outer(np.arange(count, 0, -1) * 0.04, normals[contact])
        origins += 0.01 * rng.normal(size=(count, 3))
        axes = rng.normal(size=(count, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        for axis, origin in zip(axes, origins, strict=True):
            column = np.zeros_like(positions)
            column[contact] = np.cross(axis, positions[contact] - origin)
            columns.append(column.ravel())
            owner.append(contact)
    return np.array(columns).reshape(-1, positions.size).T, np.array(owner, dtype=int)
