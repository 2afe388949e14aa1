"""Brute force over modes: the forces that one mode allows, in edge weights, by scipy's linprog.

Nothing here uses the package but the data of a problem and the listing of modes: the edges of the
cones, the balance and the faces are worked out again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.optimize import linprog

from graspless_pin import QuasistaticProblem, SlidingMode

Array = NDArray[np.float64]
UNSOLVED = {2: -np.inf, 3: np.inf}
"""linprog's status of an infeasible and of an unbounded program, and the maximum that it means."""


class ForceSet:
    """The contact forces f = E k, k >= 0, that one mode allows.

    Attributes:
        E: (3M, K) edges of all cones; one kinetic edge where a contact slides.
        distances: (D, 3M) rows whose values are the distances of f to the sides of its cone and
            to contact loss, N.
    """

    def __init__(
        self,
        problem: QuasistaticProblem,
        mode: SlidingMode | None,
        *,
        torques: ArrayLike | None = None,
        normal_limit: bool = True,
    ) -> None:
        """State the set.

        Args:
            problem: The problem.
            mode: Its mode; None: plain Coulomb friction.
            torques: Motor torques that are given; None: any within the limits.
            normal_limit: Whether the normal-force limits hold.
        """
        count = problem.contact_count
        edges, distances = [], []
        for contact in range(count):
            own = edges_of(problem, contact)
            edges.append(placed(own, contact, count).T)
            distances.append(placed(problem.normals[contact][None], contact, count))
            if len(own) > 1:
                sides = np.cross(own, np.roll(own, -1, axis=0))
                sides *= np.sign(sides @ problem.normals[contact])[:, None]
                sides /= np.linalg.norm(sides, axis=1, keepdims=True)
                distances.append(placed(sides, contact, count))
        self.problem, self.E = problem, np.hstack(edges)
        self.distances = np.vstack(distances)
        self.normal = component_rows(problem)[::3]
        at = problem.positions
        moments = [np.cross(at, axis).T for axis in np.eye(3)]
        balance = np.zeros((6, count, 3))
        balance[:3] = np.eye(3)[:, None]
        balance[3:] = np.stack(moments, axis=2)
        equal, sides = [balance.reshape(6, -1)], [-problem.external_wrench]
        below: list[Array] = [np.zeros((0, 3 * count))]
        most: list[Array] = [np.zeros(0)]
        if normal_limit:
            below.append(self.normal)
            most.append(problem.max_normal_force)
        if torques is None:
            for sign, limit in ((1.0, problem.upper_torque), (-1.0, problem.lower_torque)):
                finite = np.isfinite(limit)
                below.append(sign * problem.jacobian.T[finite])
                most.append(sign * (limit - problem.gravity_torques)[finite])
        else:
            equal.append(problem.jacobian.T)
            sides.append(np.asarray(torques, dtype=float) - problem.gravity_torques)
        if mode is not None:
            for contact in np.flatnonzero((problem.friction > 0.0) & ~problem.is_sliding):
                rows = placed(problem.tangents[contact].T, int(contact), count)
                for row, sign in zip(rows, mode.signs[contact], strict=True):
                    if sign == 0:
                        equal.append(row[None])
                        sides.append(np.zeros(1))
                    else:
                        below.append(float(sign) * row[None])
                        most.append(np.zeros(1))
        self.A, self.b = np.vstack(equal) @ self.E, np.concatenate(sides)
        self.G, self.h = np.vstack(below) @ self.E, np.concatenate(most)

    def feasible(self) -> bool:
        """Whether any force is allowed."""
        return self.maximum(np.zeros(len(self.E))) == 0.0

    def maximum(self, c: Array) -> float:
        """Largest c^T f: inf where unbounded, -inf where no force is allowed."""
        result = linprog(-c @ self.E, self.G, self.h, self.A, self.b)
        if result.status == 4 and np.any(c):  # HiGHS: infeasible or unbounded
            return np.inf if self.feasible() else -np.inf
        return -result.fun if result.status == 0 else UNSOLVED[result.status]

    def maxima(self, rows: Array) -> Array:
        """`maximum` of every row; in one go where the set is bounded."""
        total = self.maximum(self.normal.sum(axis=0))
        if not np.isfinite(total):
            if total < 0.0:
                return np.full(len(rows), -np.inf)
            return np.array([self.maximum(row) for row in rows])
        many = sparse.identity(len(rows))
        costs = rows @ self.E
        result = linprog(
            -costs.ravel(),
            sparse.csc_matrix(sparse.kron(many, self.G)), np.tile(self.h, len(rows)),
            sparse.csc_matrix(sparse.kron(many, self.A)), np.tile(self.b, len(rows)),
        )  # fmt: skip
        assert result.status == 0, result.message
        return np.einsum("ij,ij->i", costs, result.x.reshape(costs.shape))

    def best_case(self) -> tuple[float, Array]:
        """Largest margin (36), -inf where there is none, and forces that have it."""
        limits = np.concatenate([np.zeros(len(self.distances)), self.problem.max_normal_force])
        rows = np.vstack([-self.distances, self.normal]) @ self.E
        G = np.block([[self.G, np.zeros((len(self.G), 1))], [rows, np.ones((len(rows), 1))]])
        A = np.hstack([self.A, np.zeros((len(self.A), 1))])
        c = np.append(np.zeros(A.shape[1] - 1), -1.0)
        bounds = [*[(0.0, None)] * (A.shape[1] - 1), (None, None)]
        result = linprog(c, G, np.concatenate([self.h, limits]), A, self.b, bounds)
        if result.status != 0:
            return UNSOLVED[result.status], np.zeros(0)
        return -result.fun, self.E @ result.x[:-1]

    def multiples(self, wrench: Array) -> tuple[float, float] | None:
        """Smallest and largest s >= 0 that balance w_ext + s wrench; None if there is none."""
        push = np.append(wrench, np.zeros(len(self.A) - 6))
        A = np.hstack([self.A, push[:, None]])
        G = np.hstack([self.G, np.zeros((len(self.G), 1))])
        c = np.append(np.zeros(A.shape[1] - 1), 1.0)
        ends = []
        for sign in (1.0, -1.0):
            result = linprog(sign * c, G, self.h, A, self.b)
            if result.status == 2:
                return None
            assert result.status == 0, result.message
            ends.append(float(result.x[-1]))
        return ends[0], ends[1]


def edges_of(problem: QuasistaticProblem, contact: int) -> Array:
    """(r, 3) edges of one cone with a normal component of 1; one where the direction is known."""
    normal, mu = problem.normals[contact], float(problem.friction[contact])
    speed = float(np.linalg.norm(problem.sliding[contact]))
    if speed > 0.0:
        return (normal - mu * problem.sliding[contact] / speed)[None]
    if mu == 0.0:
        return normal[None]
    turn = 2.0 * np.pi * np.arange(problem.cone_edges) / problem.cone_edges
    return normal + mu * np.column_stack([np.cos(turn), np.sin(turn)]) @ problem.tangents[contact].T


def placed(rows: Array, contact: int, count: int) -> Array:
    """(k, 3M) rows on all forces of (k, 3) rows on one contact's."""
    wide = np.zeros((len(rows), count, 3))
    wide[:, contact] = rows
    return wide.reshape(len(rows), 3 * count)


def component_rows(problem: QuasistaticProblem) -> Array:
    """(3M, 3M) rows that give f_n, f_t1, f_t2 of each contact in turn."""
    frames = np.concatenate([problem.normals[:, None], problem.tangents.transpose(0, 2, 1)], axis=1)
    count = problem.contact_count
    return np.vstack([placed(frame, contact, count) for contact, frame in enumerate(frames)])
