"""Exact outcomes near a point of linear programs over sectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linprog
from tests.oracles.rest_cases import Array, Outcome, Scaled, State, unit, worst_violation

EXACT = 1e-9
"""Residual of an outcome in accelerations of one, and of forces that are called balanced."""
_TURNS = 12
_TURN = 0.5
"""Largest turn of a direction of slip in one step, rad."""
_KEPT = 0.1
"""Share of the object's motion that a polished outcome has to keep."""
_CORNERS = 64


class Polish:
    """Exact outcomes near a point of one combination: directions of slip by successive LPs."""

    def __init__(self, scaled: Scaled, leaf: Sequence[State]) -> None:
        self.scaled = scaled
        self.leaf = leaf
        self.slipping = [i for i, s in enumerate(leaf) if s.kind == "slip"]

    def exact(self, y: Array, forces: Array) -> Outcome | None:
        """Return an outcome whose violation is at most `EXACT`, or None."""
        u = self.scaled.rows @ y
        for vectors in (u[:, 1:], -forces[:, 1:]):
            angles = np.arctan2(vectors[:, 1], vectors[:, 0])
            point = self._directed(angles, y, forces)
            if point is None:
                continue
            outcome = self.scaled.outcome(*point)
            if worst_violation(self.scaled.case, outcome) <= EXACT:
                return outcome
            if not self.slipping:
                return None
        return None

    def _directed(self, angles: Array, y: Array, forces: Array) -> tuple[Array, Array] | None:
        """Turn directions of slip until friction is opposite to each."""
        scaled, slipping = self.scaled, self.slipping
        width, count, k = len(scaled.load), scaled.count, len(self.slipping)
        speeds = np.linalg.norm((scaled.rows @ y)[slipping, 1:], axis=1)
        moved = scaled.moves @ y
        ahead = scaled.moves.T @ moved
        normal = forces[slipping, 0]
        angles = angles[slipping]
        for _ in range(_TURNS):
            equal, right = self._linear(angles, speeds, normal)
            below = self._inner_cones(forces)
            below.append(np.concatenate([-ahead, np.zeros(3 * count + 2 * k)])[None])
            limits = np.zeros(sum(map(len, below)))
            limits[-1] = -_KEPT * (moved @ moved)
            soft = np.vstack([np.zeros((len(right) - 4 * k, 4 * k)), np.eye(4 * k)])
            size = equal.shape[1]
            bounds = [(None, None)] * (width + 3 * count)
            bounds += [(0.0, None)] * k + [(-_TURN, _TURN)] * k + [(0.0, None)] * (8 * k)
            answer = linprog(
                np.concatenate([np.zeros(size), np.ones(8 * k)]),
                A_ub=np.pad(np.vstack(below), ((0, 0), (0, 8 * k))),
                b_ub=limits,
                A_eq=np.hstack([equal, soft, -soft]),
                b_eq=right,
                bounds=bounds,
                options={"primal_feasibility_tolerance": 1e-10},
            )
            if answer.status != 0:
                return None
            y, forces, speeds, turned = self._parts(answer.x[:size])
            normal = forces[slipping, 0]
            angles = angles + turned
            if k == 0 or np.abs(turned).max() < 1e-12:
                break
        return self._sharpened(y, forces, angles, speeds)

    def _sharpened(
        self, y: Array, forces: Array, angles: Array, speeds: Array
    ) -> tuple[Array, Array]:
        """Newton steps of least length on the equations alone."""
        for _ in range(3):
            equal, right = self._linear(angles, speeds, forces[self.slipping, 0])
            point = np.concatenate([y, forces.ravel(), speeds, np.zeros(len(angles))])
            step = np.linalg.lstsq(equal, right - equal @ point, rcond=1e-12)[0]
            y, forces, speeds, turned = self._parts(point + step)
            angles = angles + turned
        return y, forces

    def _parts(self, point: Array) -> tuple[Array, Array, Array, Array]:
        width, count, k = len(self.scaled.load), self.scaled.count, len(self.slipping)
        y, forces, speeds, turned = np.split(point, np.cumsum([width, 3 * count, k]))
        return y, forces.reshape(count, 3), speeds, turned

    def _linear(self, angles: Array, speeds: Array, normal: Array) -> tuple[Array, Array]:
        """Return equations of (y, f, speeds of slip, turns), four of each slip linearised, last."""
        scaled, slipping = self.scaled, self.slipping
        width, count, k = len(scaled.load), scaled.count, len(self.slipping)
        size = width + 3 * count + 2 * k
        dynamics = np.hstack([np.eye(width), -flat(scaled.rows).T, np.zeros((width, 2 * k))])
        rows, right = [dynamics], [scaled.load]
        for i, state in enumerate(self.leaf):
            on_velocity, _ = scaled.velocity_rows(i, state)
            rows.append(np.pad(on_velocity, ((0, 0), (0, size - width))))
            on_force, _ = scaled.force_rows(i, state, ())
            rows.append(np.pad(on_force, ((0, 0), (width + 3 * i, size - width - 3 * i - 3))))
        right.append(np.zeros(sum(map(len, rows[1:]))))
        for i in np.flatnonzero(scaled.commanded):
            rows.append(np.eye(size)[None, width + 3 * i])
            right.append(scaled.press[i : i + 1])
        for j, i in enumerate(slipping):
            along, across = unit(angles[j]), unit(angles[j] + 0.5 * np.pi)
            mu = scaled.friction[i]
            rubbing, moving = np.zeros((2, size)), np.zeros((2, size))
            left = width + 3 * i
            rubbing[:, left] = mu * along
            rubbing[:, left + 1 : left + 3] = np.eye(2)
            rubbing[:, size - k + j] = mu * normal[j] * across
            moving[:, :width] = scaled.rows[i, 1:]
            moving[:, size - 2 * k + j] = -along
            moving[:, size - k + j] = -speeds[j] * across
            rows += [rubbing, moving]
            right.append(np.zeros(4))
        return np.vstack(rows), np.concatenate(right)

    def _inner_cones(self, forces: Array) -> list[Array]:
        """Inequalities of (y, f, ...): no pull, no penetration, cones of sticking contacts."""
        scaled = self.scaled
        width, count, k = len(scaled.load), scaled.count, len(self.slipping)
        size = width + 3 * count + 2 * k
        below = []
        for i, state in enumerate(self.leaf):
            rows = np.array([[-1.0, 0.0, 0.0]])
            if state.kind == "stick" and scaled.friction[i] > 0.0:
                # A polygon inside the circle that has a corner where the force is.
                steps = (np.arange(_CORNERS) + 0.5) * 2.0 * np.pi / _CORNERS
                mu = scaled.friction[i] * np.cos(np.pi / _CORNERS)
                start = np.arctan2(forces[i, 2], forces[i, 1])
                rows = np.vstack([rows, *([-mu, *unit(start + step)] for step in steps)])
            below.append(np.pad(rows, ((0, 0), (width + 3 * i, size - width - 3 * i - 3))))
            if state.kind == "open":
                below.append(np.pad(-scaled.rows[i, :1], ((0, 0), (0, size - width))))
        return below


def flat(rows: Array) -> Array:
    return rows.reshape(-1, rows.shape[-1])
