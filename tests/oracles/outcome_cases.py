"""Seeded random bodies at rest, as plain arrays: supports and fingers, balanced and not.

Four layouts: a slope, a slot between opposing walls, a corner, and contacts anywhere. The same
generator gives the same arrays on every machine up to rounding.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation
from tests.oracles.rest_cases import RestCase

Array = np.ndarray
_GRAVITY = 9.81


class Layout(StrEnum):
    """Where the supports are."""

    SLOPE = "slope"
    SLOT = "slot"
    CORNER = "corner"
    ANYWHERE = "anywhere"


_SUPPORTS = {
    Layout.SLOPE: [[0, 0, 1]],
    Layout.SLOT: [[1, 0, 0], [-1, 0, 0]],
    Layout.CORNER: [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
}
_FINGERS = {
    Layout.SLOPE: [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, -1]],
    Layout.SLOT: [[0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [1, 0, 0]],
    Layout.CORNER: [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
}


def random_rest_case(
    rng: np.random.Generator, contacts: int, fingers: int, joints: int
) -> RestCase:
    """Return a box or a sphere at rest, its supports first.

    The load is that of random forces within the cones, or a weight, and in a quarter of the cases
    another one; the torques are those of these forces, scaled ones, or random ones.

    Args:
        rng: Random numbers.
        contacts: M, from 1.
        fingers: Contacts, the last ones, with joints behind them.
        joints: Of each finger; none: hybrid fingers.
    """
    layout = Layout(rng.choice(list(Layout)))
    half = rng.uniform(0.02, 0.08, 3)
    positions, normals = _contacts(rng, layout, half, contacts, contacts - fingers)
    friction = rng.uniform(0.1, 1.0, contacts)
    friction[rng.random(contacts) < 0.1] = 0.0
    mass = rng.uniform(0.1, 2.0)
    turning = mass * np.diag([half @ half - x * x for x in half]) / 3.0
    share = rng.uniform(0.0, 1.0, contacts)
    forces = _forces(rng, normals, friction * share, 0.5 * _GRAVITY * mass)
    tilt = rng.uniform(0.0, 1.0)
    weight = _GRAVITY * mass * np.array([np.sin(tilt), 0.0, -np.cos(tilt), 0.0, 0.0, 0.0])
    wrench = -_wrench(positions, forces)
    if layout is Layout.SLOPE and fingers <= 1 and rng.random() < 0.5:
        wrench = weight - 0.3 * (fingers > 0) * _wrench(positions[-1:], forces[-1:])
    elif rng.random() < 0.25:
        wrench = weight
    jacobian, inertia = _fingers(rng, positions, normals, range(contacts - fingers, contacts),
                                 joints)  # fmt: skip
    torques = jacobian.T @ forces.ravel()
    kind = rng.random()
    if kind < 0.3:
        torques = torques * rng.uniform(0.2, 2.5)
    elif kind < 0.4:
        torques = torques + 0.3 * rng.normal(size=len(torques)) * np.abs(torques)
    turn = Rotation.random(rng=rng).as_matrix() if rng.random() < 0.5 else np.eye(3)
    both = np.kron(np.eye(2), turn)
    body = np.zeros((6, 6))
    body[:3, :3], body[3:, 3:] = mass * np.eye(3), turning
    return RestCase(
        positions @ turn.T,
        normals @ turn.T,
        friction,
        both @ wrench,
        np.kron(np.eye(contacts), turn) @ jacobian,
        torques,
        both @ body @ both.T,
        inertia,
    )


def _contacts(
    rng: np.random.Generator, layout: Layout, half: Array, contacts: int, supports: int
) -> tuple[Array, Array]:
    """(M, 3) positions and normals."""
    if layout is Layout.ANYWHERE:
        normals = rng.normal(size=(contacts, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return -half.max() * normals, normals
    below, beside = _SUPPORTS[layout], _FINGERS[layout]
    chosen = [below[i % len(below)] for i in range(supports)]
    chosen += [beside[rng.integers(len(beside))] for _ in range(contacts - supports)]
    normals = np.array(chosen, dtype=np.float64)
    spots = rng.uniform(-0.9, 0.9, (contacts, 3)) * half
    return np.where(normals == 0.0, spots, -half * normals), normals


def _forces(rng: np.random.Generator, normals: Array, rubbing: Array, scale: float) -> Array:
    """(M, 3) random pressures, and that share of them across, in random directions."""
    across = np.cross(normals, rng.normal(size=normals.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    press = scale * rng.uniform(0.2, 2.0, (len(normals), 1))
    return press * (normals + rubbing[:, None] * across)


def _wrench(positions: Array, forces: Array) -> Array:
    return np.concatenate([forces.sum(axis=0), np.cross(positions, forces).sum(axis=0)])


def _fingers(
    rng: np.random.Generator, positions: Array, normals: Array, contacts: range, joints: int
) -> tuple[Array, Array]:
    """Return (3M, L) Jacobian and (L, L) inertia of chains of hinges, a mass at each fingertip."""
    if joints == 0:
        pushes = np.zeros((len(normals), 3, len(contacts)))
        pushes[contacts, :, np.arange(len(contacts))] = normals[contacts]
        return pushes.reshape(positions.size, -1), np.zeros((len(contacts), len(contacts)))
    count = len(contacts) * joints
    jacobian, inertia = np.zeros((len(normals), 3, count)), np.diag(rng.uniform(1e-4, 1e-2, count))
    for finger, contact in enumerate(contacts):
        own = slice(finger * joints, (finger + 1) * joints)
        origins = positions[contact] - np.outer(np.arange(joints, 0, -1) * 0.04, normals[contact])
        origins += 0.01 * rng.normal(size=(joints, 3))
        axes = rng.normal(size=(joints, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        jacobian[contact, :, own] = np.cross(axes, positions[contact] - origins).T
        arm = jacobian[contact, :, own]
        inertia[own, own] += rng.uniform(0.02, 0.2) * arm.T @ arm
    return jacobian.reshape(positions.size, count), inertia
