"""Seeded small scenes of every scale: forces and lengths from 1e-9 to 1e9, limits of any width.

Up to 4 contacts and 4 joints. The families are generic or degenerate (coplanar supports, parallel
and opposite fingers, all in one plane, tangents turned by a hair). Numbers come in sixteenths and
scales in powers of two where that keeps degenerate scenes exactly so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.oracles.exact_optimum import Question

from graspless_pin import QuasistaticProblem

Array = NDArray[np.float64]

FAMILIES = ("generic", "slab", "pinch", "planar", "corner")
_LARGEST_POWER = 30  # 2^30 is 1e9
_FREE = np.inf


@dataclass(frozen=True, eq=False)
class Case:
    """A problem and what is asked of it.

    Attributes:
        seed: Of the random numbers.
        family: How the contacts lie.
        arguments: Of `QuasistaticProblem`.
        question: What is asked.
    """

    seed: int
    family: str
    arguments: dict[str, Any]
    question: Question

    @property
    def problem(self) -> QuasistaticProblem:
        """A new problem."""
        return QuasistaticProblem(**self.arguments)


def weak_case(seed: int) -> Case:
    """Return a scene whose supports bear the load, and whose hand is weaker by up to 1e8 times."""
    rng = np.random.default_rng([31, seed])
    share = 2.0 ** -int(rng.integers(0, 28))
    return _case(seed, share, weak_contacts=bool(rng.random() < 0.5))


def scale_case(seed: int) -> Case:
    """Return the scene of a seed."""
    return _case(seed, 1.0, weak_contacts=False)


def _case(seed: int, share: float, *, weak_contacts: bool) -> Case:
    """Return a scene whose hand has a share of the usual torques, and so perhaps its contacts."""
    rng = np.random.default_rng([12, seed])
    family = FAMILIES[seed % len(FAMILIES)]
    fingers, positions, frames = _contacts(rng, family)
    count = len(positions)
    friction = _sixteenths(rng, 3, 17, count) * (rng.random(count) > 0.12)
    sliding = _sliding(rng, family, positions, frames, count - fingers)
    forces = _inner_forces(rng, frames, friction, sliding)
    forces[:fingers] *= share
    jacobian, linear = _fingers(rng, fingers, frames)
    gravity = _sixteenths(rng, -8, 9, jacobian.shape[1]) * (rng.random() < 0.3)
    kind = rng.random()
    if kind < 0.08:
        wrench = np.zeros(6)
    elif kind < 0.2:
        wrench = np.array([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]) * _sixteenths(rng, 8, 64, 1)
    else:
        moment = np.cross(positions, forces).sum(axis=0)
        wrench = -np.concatenate([forces.sum(axis=0), moment])
    load = max(np.abs(wrench).max(), np.abs(forces).max() if kind < 0.2 else 0.0)
    gravity = gravity * share
    need = jacobian.T @ forces.ravel() + gravity
    lower, upper = (share * side for side in _torque_limits(rng, need / share, load))
    limits = _normal_limits(rng, np.einsum("ij,ij->i", frames[:, :, 0], forces), load)
    margin = 0.0
    if rng.random() >= 0.2:
        margin = float(_sixteenths(rng, 1, 8, 1)[0]) * load / 64.0
        margin *= share if wrench.any() else 1.0
    if weak_contacts:
        least = max(1e-9 * load, 4.0 * margin)
        limits[:fingers] = np.maximum(limits[:fingers] * share, least)
    force, length = (_scale(rng) for _ in range(2))
    torque = np.where(linear, force, force * length)
    return Case(
        seed,
        family,
        {
            "positions": positions * length,
            "normals": frames[:, :, 0],
            "external_wrench": wrench * force * np.repeat([1.0, length], 3),
            "jacobian": jacobian * np.where(linear, 1.0, length),
            "friction": friction,
            "tangents": frames[:, :, 1:],
            "sliding": sliding * length,
            "torque_limits": (lower * torque, upper * torque),
            "max_normal_force": limits * force,
            "cone_edges": int(rng.choice([3, 4, 5, 6, 8, 12], p=[0.2, 0.3, 0.1, 0.2, 0.15, 0.05])),
            "joint_units": ["N" if one else "N m" for one in linear],
            "gravity_torques": gravity * torque,
        },
        Question(
            algorithm=str(rng.choice(["margin", "torque"])),
            margin=margin * force,
            by_limits=bool(rng.random() < 0.3),
            sign_rule=str(rng.choice(["strict", "exact", "nonzero"], p=[0.5, 0.25, 0.25])),
            sliding_rule=str(rng.choice(["exempt", "constrained"], p=[0.7, 0.3])),
            static_friction=str(rng.choice(["virtual_sliding", "coulomb"], p=[0.88, 0.12])),
        ),
    )


def _sixteenths(rng: np.random.Generator, low: int, high: int, size: int) -> Array:
    return rng.integers(low, high, size) / 16.0


def _scale(rng: np.random.Generator) -> float:
    """1 in a third of the scenes, else any up to 1e9 either way."""
    if rng.random() < 1.0 / 3.0:
        return 1.0
    return 2.0 ** int(rng.integers(-_LARGEST_POWER, _LARGEST_POWER + 1))


def _contacts(rng: np.random.Generator, family: str) -> tuple[int, Array, Array]:
    """How many contacts are fingers, which come first; (M, 3) positions; (M, 3, 3) n, t1, t2."""
    count = int(rng.integers(2, 5))
    fingers = int(rng.integers(1, count + 1))
    if family == "generic":
        normals = rng.normal(size=(count, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        positions = -normals + 0.3 * rng.normal(size=(count, 3))
        first = np.cross(normals, rng.normal(size=(count, 3)))
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        return fingers, positions, np.stack([normals, first, np.cross(normals, first)], axis=2)
    up, along = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    fingers = min(fingers, 2)
    spread = _sixteenths(rng, -16, 17, 3 * count).reshape(count, 3)
    positions, normals, first = spread.copy(), np.tile(up, (count, 1)), np.tile(along, (count, 1))
    positions[:, 2] = -1.0
    if family == "slab":
        normals[:fingers] = -up
        positions[:fingers, 2] = 1.0
    elif family == "pinch":
        fingers = 2
        side = np.array([0.0, 1.0, 0.0])
        normals[:2], positions[:2] = [side, -side], [-side, side]
        if rng.random() < 0.5:
            positions[:2, ::2] += spread[0, ::2] * rng.choice([0.25, 0.5])
    elif family == "planar":
        across = rng.random(count) < 0.5
        normals[across], first[across] = along, -up
        positions = np.where(across[:, None], [-1.0, 0.0, 1.0] * spread, [1.0, 0.0, -1.0] * spread)
        positions[across, 0], positions[~across, 2] = -1.0, -1.0
        flip = rng.random(count) < 0.4
        normals[flip] *= -1.0
        positions[flip] *= -1.0
    else:
        normals[:fingers], first[:fingers] = -along, up
        positions[:fingers, 0], positions[:fingers, 2] = 1.0, spread[:fingers, 2]
        wall = int(rng.integers(fingers, count + 1))
        normals[fingers:wall], first[fingers:wall] = along, up
        positions[fingers:wall, 0], positions[fingers:wall, 2] = -1.0, spread[fingers:wall, 2]
    frames = np.stack([normals, first, np.cross(normals, first)], axis=2)
    turn = rng.random()
    if turn < 0.4:
        frames[:, :, 1:] = _turned(frames[:, :, 1:], rng.uniform(0.0, 2.0 * np.pi, count))
    elif turn < 0.5:
        hair = 10.0 ** rng.uniform(-9.0, -3.0)
        frames[:, :, 1:] = _turned(frames[:, :, 1:], np.full(count, hair))
    if rng.random() < 0.5:
        slope = rng.uniform(0.0, 1.5)
        c, s = np.cos(slope), np.sin(slope)
        rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        positions, frames = positions @ rotation.T, rotation @ frames
    if rng.random() < 0.2:
        positions += _sixteenths(rng, -64, 65, 3)
    return fingers, positions, frames


def _turned(tangents: Array, angles: Array) -> Array:
    """Tangents turned about their normals."""
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    first, second = tangents[:, :, 0], tangents[:, :, 1]
    return np.stack([c * first + s * second, c * second - s * first], axis=2)


def _sliding(
    rng: np.random.Generator, family: str, positions: Array, frames: Array, supports: int
) -> Array:
    """Velocities of supports under a declared motion; zeros in most scenes."""
    sliding = np.zeros_like(positions)
    if supports == 0 or rng.random() > 0.3:
        return sliding
    if family in ("slab", "pinch"):
        chosen = slice(len(positions) - supports, None)
    else:
        chosen = slice(len(positions) - 1, None)
    twist = np.concatenate([frames[-1] @ [0.0, *_sixteenths(rng, -16, 17, 2)], np.zeros(3)])
    if rng.random() < 0.3:
        twist[3:] = frames[-1, :, 0] * _sixteenths(rng, -8, 9, 1)
    own = frames[chosen]
    velocity = twist[:3] + np.cross(twist[3:], positions[chosen])
    components = np.einsum("ijk,ij->ik", own[:, :, 1:], velocity)
    components[np.abs(components) < 1e-6] = 0.0
    sliding[chosen] = 0.25 * np.einsum("ijk,ik->ij", own[:, :, 1:], components)
    return sliding


def _inner_forces(
    rng: np.random.Generator, frames: Array, friction: Array, sliding: Array
) -> Array:
    """(M, 3) forces inside the cones, on their edges where a contact slides, N."""
    count = len(frames)
    press = _sixteenths(rng, 32, 128, count)
    share = rng.choice([0.0, 0.25, 0.5], count)[:, None] * rng.choice([-1.0, 0.0, 1.0], (count, 2))
    tangential = np.einsum("ijk,ik->ij", frames[:, :, 1:], share / 2.0)
    speed = np.linalg.norm(sliding, axis=1)
    slides = speed > 0.0
    tangential[slides] = -sliding[slides] / speed[slides, None]
    return press[:, None] * (frames[:, :, 0] + friction[:, None] * tangential)


def _fingers(
    rng: np.random.Generator, fingers: int, frames: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """(3M, L) Jacobian of at most 4 joints, and which joints are linear."""
    joints = int(rng.integers(0, 5))
    jacobian = np.zeros((3 * len(frames), joints))
    linear = rng.random(joints) < 0.25
    plain = rng.random() < 0.5
    for joint in range(joints):
        finger = joint % fingers
        own = slice(3 * finger, 3 * finger + 3)
        if plain and joint < fingers:
            jacobian[own, joint] = -0.5 * frames[finger, :, 0]
        else:
            jacobian[own, joint] = _sixteenths(rng, -16, 17, 3)
    return jacobian, linear


def _torque_limits(rng: np.random.Generator, need: Array, load: float) -> tuple[Array, Array]:
    """Limits of every kind around the torques of the inner forces."""
    lower, upper = np.empty_like(need), np.empty_like(need)
    common = rng.choice(_TORQUE_KINDS)
    mixed = rng.random() < 0.5
    for joint, torque in enumerate(need.tolist()):
        size = max(abs(torque), load / 4.0)
        kind = rng.choice(_TORQUE_KINDS) if mixed else common
        low, high = -2.0 * size, 2.0 * size
        if kind == "fixed":
            low = high = torque
        elif kind == "none":
            low = high = 0.0
        elif kind == "infinite":
            low, high = -_FREE, _FREE
        elif kind == "one side":
            low, high = (-_FREE, torque + size / 8.0)
        elif kind == "away from zero":
            low, high = sorted([torque, 1.5 * torque])
        elif kind == "huge":
            high = size * 10.0 ** rng.uniform(2.0, 12.0)
            low = -high
        elif kind == "tiny":
            high = size * 10.0 ** rng.uniform(-9.0, -0.5)
            low = -high
        elif kind == "narrow":
            width = size * 10.0 ** rng.uniform(-9.0, -1.0)
            low, high = torque - width, torque + width
        lower[joint], upper[joint] = low, high
    return lower, upper


_TORQUE_KINDS = (
    *("ample",) * 5, *("infinite",) * 3, *("huge",) * 4, *("one side",) * 2,
    "fixed", "narrow", "tiny", "none", "away from zero",
)  # fmt: skip


def _normal_limits(rng: np.random.Generator, press: Array, load: float) -> Array:
    """Normal-force limits of every size from 1e-9 to 1e12 of the load."""
    count = len(press)
    common = 10.0 ** rng.uniform(0.3, 12.0)
    limits = np.empty(count)
    mixed = rng.random() < 0.5
    kinds = rng.choice(["ample", "huge", "tight", "tiny"], count, p=[0.47, 0.36, 0.15, 0.02])
    if not mixed:
        kinds[:] = kinds[0]
    for contact, kind in enumerate(kinds):
        if kind == "ample":
            limits[contact] = rng.choice([2.0, 4.0, 16.0]) * max(press[contact], load)
        elif kind == "huge":
            limits[contact] = load * (10.0 ** rng.uniform(1.0, 12.0) if mixed else common)
        elif kind == "tight":
            limits[contact] = press[contact] * rng.uniform(1.0, 1.3)
        else:
            limits[contact] = load * 10.0 ** rng.uniform(-9.0, -1.0)
    return limits
