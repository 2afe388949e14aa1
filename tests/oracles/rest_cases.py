"""A body at rest, an outcome, and the rows of each contact state, for their enumeration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

Array = np.ndarray
TANGENTS = 16
"""Faces around the round cone of a contact that sticks, before cuts."""


@dataclass(frozen=True, eq=False)
class RestCase:
    """A body at rest, its contacts, and the joints behind them.

    Attributes:
        positions: (M, 3) contact points about the centre of mass, m.
        normals: (M, 3) unit normals into the object.
        friction: (M,) Coulomb coefficients.
        external_wrench: (6,) on the object, N and N m.
        jacobian: (3M, L) with tau = J^T f at rest.
        torques: (L,) motors' torques less those that bear the links' weight, N m.
        object_inertia: (6, 6) about the centre of mass.
        joint_inertia: (L, L).
    """

    positions: Array
    normals: Array
    friction: Array
    external_wrench: Array
    jacobian: Array
    torques: Array
    object_inertia: Array
    joint_inertia: Array

    @property
    def load_over_mass(self) -> float:
        """The acceleration that the external force gives the free object, m/s^2."""
        mass = float(np.trace(self.object_inertia[:3, :3])) / 3.0
        return float(np.linalg.norm(self.external_wrench[:3])) / mass

    @cached_property
    def relative_motion(self) -> Array:
        """(3M, 6 + L) G: accelerations of the object relative to the other bodies."""
        x, y, z = self.positions.T
        o = np.zeros_like(x)
        turning = np.array([[o, z, -y], [-z, o, x], [y, -x, o]]).transpose(2, 0, 1)
        moving = np.broadcast_to(np.eye(3), turning.shape)
        object_side = np.concatenate([moving, turning], axis=2).reshape(-1, 6)
        return np.hstack([object_side, -self.jacobian])

    def object_motion(self, acceleration: Array) -> float:
        """Return the acceleration that no point of the object exceeds, m/s^2.

        The object reaches as far from its centre of mass as its contacts do.
        """
        turning = float(np.linalg.norm(acceleration[3:6])) * self.radius
        return float(np.linalg.norm(acceleration[:3])) + turning

    @property
    def radius(self) -> float:
        """Distance of the farthest contact from the centre of mass, m."""
        return float(np.linalg.norm(self.positions, axis=1).max())


class Outcome(NamedTuple):
    """Accelerations (6 + L,) of object and joints and forces (M, 3) on the object, world axes."""

    acceleration: Array
    forces: Array


class State(NamedTuple):
    """State of one contact: "free" is any, "open", "stick", "slip" between two angles."""

    kind: str
    low: float = 0.0
    high: float = 0.0

    def halves(self) -> tuple[State, State]:
        middle = 0.5 * (self.low + self.high)
        return State("slip", self.low, middle), State("slip", middle, self.high)


def unit(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


class Scaled:
    """The case in accelerations y with |y|^2 + sum mu f_n |u_t| = h y, so that |y - h/2| <= 1/2."""

    def __init__(self, case: RestCase) -> None:
        self.case = case
        self.count = len(case.normals)
        joints = len(case.torques)
        inertia = np.zeros((6 + joints, 6 + joints))
        inertia[:6, :6], inertia[6:, 6:] = case.object_inertia, case.joint_inertia
        self.root = np.linalg.cholesky(inertia)
        load = np.linalg.solve(self.root, np.concatenate([case.external_wrench, case.torques]))
        self.size = float(np.linalg.norm(load))
        self.load = load / (self.size or 1.0)
        self.frames = np.stack([_frame(normal) for normal in case.normals])
        motion = case.relative_motion.reshape(self.count, 3, -1)
        rows = self.frames @ motion @ np.linalg.inv(self.root).T
        self.lengths = np.linalg.norm(rows, axis=2).max(axis=1)
        self.rows: Array = rows / self.lengths[:, None, None]
        self.friction = case.friction
        self.moves = np.linalg.inv(self.root).T[:6] * self.size
        self.moves[3:] *= case.radius

    def outcome(self, y: Array, forces: Array) -> Outcome:
        acceleration = self.size * np.linalg.solve(self.root.T, y)
        local = forces * (self.size / self.lengths)[:, None]
        return Outcome(acceleration, np.einsum("mij,mi->mj", self.frames, local))

    def scaled(self, outcome: Outcome) -> tuple[Array, Array]:
        y = self.root.T @ outcome.acceleration / self.size
        local = np.einsum("mij,mj->mi", self.frames, outcome.forces)
        return y, local * (self.lengths / self.size)[:, None]

    def pull(self, forces: Array) -> Array:
        return np.einsum("mij,mi->j", self.rows, forces)

    def bound(self, components: Array) -> float:
        """Return the object's largest acceleration where no component of `moves` is larger."""
        return float(np.linalg.norm(components[:3]) + np.linalg.norm(components[3:]))

    # Rows on (y, f, t) of one contact: equations and inequalities, all with zero on the right.

    def velocity_rows(self, contact: int, state: State) -> tuple[Array, Array]:
        normal, *across = self.rows[contact]
        if state.kind in ("free", "open"):
            return np.empty((0, len(normal))), -normal[None]
        if state.kind == "stick":
            tangential = np.array(across) if self.friction[contact] > 0.0 else across[:0]
            return np.vstack([normal, *tangential]), np.empty((0, len(normal)))
        inward = np.array([[np.sin(state.low), -np.cos(state.low)],
                           [-np.sin(state.high), np.cos(state.high)]])  # fmt: skip
        return normal[None], inward @ np.array(across)

    def force_rows(self, contact: int, state: State, cuts: Sequence[float]) -> tuple[Array, Array]:
        """(n, 3) rows on (f_n, f_1, f_2)."""
        mu = self.friction[contact]
        if state.kind == "open":
            return np.eye(3), np.empty((0, 3))
        if mu == 0.0:
            return np.eye(3)[1:], np.array([[-1.0, 0.0, 0.0]])
        if state.kind == "stick":
            angles = [*(2.0 * np.pi * np.arange(TANGENTS) / TANGENTS), *cuts]
            faces = [[-mu, *unit(angle)] for angle in angles]
            return np.empty((0, 3)), np.array([[-1.0, 0.0, 0.0], *faces])
        middle, half = 0.5 * (state.low + state.high), 0.5 * (state.high - state.low)
        faces = [[-mu, *-unit(angle)] for angle in (state.low, middle, state.high)]
        chord = [mu * np.cos(half), *unit(middle)]
        return np.empty((0, 3)), np.array([[-1.0, 0.0, 0.0], *faces, chord])


def _frame(normal: Array) -> Array:
    """Rows n, t1, t2."""
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, axis)
    first /= np.linalg.norm(first)
    return np.array([normal, first, np.cross(normal, first)])


def worst_violation(case: RestCase, outcome: Outcome) -> float:
    """Return by how much accelerations and forces break the conditions, in scaled units.

    Of friction the power that it lacks is measured, mu f_n |u_t| + f_t u_t.
    """
    scaled = Scaled(case)
    y, forces = scaled.scaled(outcome)
    u = scaled.rows @ y
    rubbing = np.linalg.norm(forces[:, 1:], axis=1)
    most = scaled.friction * forces[:, 0]
    lost = most * np.linalg.norm(u[:, 1:], axis=1) + np.einsum("ij,ij->i", forces, u)
    parts = [y - scaled.pull(forces) - scaled.load, -u[:, 0], -forces[:, 0], rubbing - most]
    parts += [np.abs(forces[:, 0] * u[:, 0]), np.abs(lost)]
    parts[0] = np.abs(parts[0])
    return max(0.0, *(float(part.max()) for part in parts))
