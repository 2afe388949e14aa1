"""A body at rest, an outcome, and the rows of each contact state, for their enumeration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

Array = np.ndarray
_ROUNDING = 1e-12
"""What is left of a load that commanded forces balance."""
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
        joint_inertia: (L, L); a zero row is a hybrid finger's, whose torque is the normal force
            that it commands at one contact: it follows along the normal, and only along it.
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
    def point_motions(self) -> Array:
        """(1 + M, 3, 6) from the object's acceleration to its centre's and its contact points'."""
        x, y, z = np.vstack([np.zeros(3), self.positions]).T
        o = np.zeros_like(x)
        turning = np.array([[o, z, -y], [-z, o, x], [y, -x, o]]).transpose(2, 0, 1)
        return np.concatenate([np.broadcast_to(np.eye(3), turning.shape), turning], axis=2)

    @cached_property
    def relative_motion(self) -> Array:
        """(3M, 6 + L) G: accelerations of the object relative to the other bodies."""
        return np.hstack([self.point_motions[1:].reshape(-1, 6), -self.jacobian])

    def object_motion(self, acceleration: Array) -> float:
        """Return the largest acceleration of the centre of mass and the contact points, m/s^2."""
        return float(np.linalg.norm(self.point_motions @ acceleration[:6], axis=1).max())


class Outcome(NamedTuple):
    """Accelerations (6 + L,) of object and joints and forces (M, 3) on the object, world axes."""

    acceleration: Array
    forces: Array


class State(NamedTuple):
    """State of one contact: "free" is any, "open", "stick", "slip" between two angles.

    "closed" slides as declared, or without friction.
    """

    kind: str
    low: float = 0.0
    high: float = 0.0

    def halves(self) -> tuple[State, State]:
        middle = 0.5 * (self.low + self.high)
        return State("slip", self.low, middle), State("slip", middle, self.high)


def unit(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


class ContactRows:
    """What states say of a contact: equations and inequalities, all with zero on the right.

    Attributes:
        rows: (M, 3, n) from accelerations to those along n, t1 and t2 of each contact.
        friction: (M,) coefficients.
    """

    rows: Array
    friction: Array

    def velocity_rows(self, contact: int, state: State) -> tuple[Array, Array]:
        normal, *across = self.rows[contact]  # a commanded contact has zeros along its normal
        if state.kind in ("free", "open"):
            return np.empty((0, len(normal))), -normal[None]
        if state.kind == "closed" or self.friction[contact] == 0.0:
            return normal[None], np.empty((0, len(normal)))
        if state.kind == "stick":
            return self.rows[contact], np.empty((0, len(normal)))
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


class Scaled(ContactRows):
    """The case in accelerations y with |y|^2 + sum mu f_n |u_t| = h y, so that |y - h/2| <= 1/2."""

    def __init__(self, case: RestCase) -> None:
        self.case = case
        self.count = len(case.normals)
        hybrid = ~case.joint_inertia.any(axis=1)
        self.joints = np.concatenate([np.ones(6, dtype=bool), ~hybrid])
        inertia = np.zeros((len(self.joints), len(self.joints)))
        inertia[:6, :6], inertia[6:, 6:] = case.object_inertia, case.joint_inertia
        self.root = np.linalg.cholesky(inertia[np.ix_(self.joints, self.joints)])
        self.frames = np.stack([_frame(normal) for normal in case.normals])
        motion = case.relative_motion.reshape(self.count, 3, -1)
        given = np.concatenate([case.external_wrench, case.torques])
        loaded = given.copy()
        self.press = np.full(self.count, np.nan)
        for joint in 6 + np.flatnonzero(hybrid):
            (contact,) = np.flatnonzero(motion[:, :, joint].any(axis=1))
            self.press[contact] = given[joint]
            given[:6] += given[joint] * case.normals[contact] @ motion[contact, :, :6]
        load = np.linalg.solve(self.root, given[self.joints])
        size = float(np.linalg.norm(load))
        alone = np.linalg.norm(np.linalg.solve(self.root, loaded[self.joints]))
        self.size = size if size > _ROUNDING * alone else 0.0
        self.load = load / (self.size or 1.0)
        self.commanded = ~np.isnan(self.press)
        rows = self.frames @ motion[:, :, self.joints] @ np.linalg.inv(self.root).T
        rows[self.commanded, 0] = 0.0
        self.lengths = np.linalg.norm(rows, axis=2).max(axis=1)
        self.rows = rows / self.lengths[:, None, None]
        self.press *= self.lengths / (self.size or 1.0)
        self.friction = case.friction
        self.moves = case.point_motions @ np.linalg.inv(self.root).T[:6] * self.size
        self.moves = self.moves.reshape(-1, len(self.load))

    def outcome(self, y: Array, forces: Array) -> Outcome:
        motion = self.case.relative_motion.reshape(self.count, 3, -1)
        acceleration = np.zeros(len(self.joints))
        acceleration[self.joints] = self.size * np.linalg.solve(self.root.T, y)
        for joint in np.flatnonzero(~self.joints):
            (contact,) = np.flatnonzero(motion[:, :, joint].any(axis=1))
            normal = self.case.normals[contact]
            acceleration[joint] = normal @ motion[contact, :, :6] @ acceleration[:6]
        local = forces * (self.size / self.lengths)[:, None]
        return Outcome(acceleration, np.einsum("mij,mi->mj", self.frames, local))

    def scaled(self, outcome: Outcome) -> tuple[Array, Array]:
        y = self.root.T @ outcome.acceleration[self.joints] / self.size
        local = np.einsum("mij,mj->mi", self.frames, outcome.forces)
        return y, local * (self.lengths / self.size)[:, None]

    def pull(self, forces: Array) -> Array:
        return np.einsum("mij,mi->j", self.rows, forces)

    def bound(self, components: Array) -> float:
        """Return the object's largest acceleration where no component of `moves` is larger."""
        return float(np.linalg.norm(components.reshape(-1, 3), axis=1).max())


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
    parts += [np.abs(forces[:, 0] - scaled.press)[scaled.commanded], np.abs(parts.pop(0))]
    return max(0.0, *(float(part.max(initial=0.0)) for part in parts))
