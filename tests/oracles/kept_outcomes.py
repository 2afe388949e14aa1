"""Which outcomes exist under a declared motion, by full enumeration of contact states.

Numpy and scipy only, and nothing of the package. As in `outcomes`, but at contacts that slide by
the declared motion the force is f_n (n - mu v/|v|) whatever the acceleration, and the power of
friction bounds nothing: in each combination of open, closed, sticking and slipping in one of K
sectors, every component of the object's acceleration is maximised by LP. Sectors that leave open
whether anything moves are halved, and every motion is worked out exactly before it counts.
"""

from __future__ import annotations

import itertools
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, linprog
from tests.oracles.rest_cases import Array, ContactRows, RestCase, State

_TOLERANCE = 1e-7
_HALVINGS = 60
_AROUND = 2.0 * np.pi * np.arange(64) / 64


class KeptAnswer(NamedTuple):
    """What exists.

    Attributes:
        kept: Whether forces balance without acceleration; None: too near to tell.
        moving: Whether an outcome moves the object otherwise; None: the sectors leave it open.
        fastest: The largest acceleration of a point in the outcomes that were met, m/s^2.
    """

    kept: bool | None
    moving: bool | None
    fastest: float


class KeptEnumeration(ContactRows):
    """All combinations of contact states of one case.

    Args:
        case: What moves as declared.
        sliding: (M, 3) velocities; a zero row is a contact that does not slide.
        sectors: K directions of slip.
        resolution: m/s^2, accelerations of points up to this are none.
    """

    def __init__(self, case: RestCase, sliding: Array, sectors: int, resolution: float) -> None:
        self.case, self.resolution = case, resolution
        self.count = len(case.normals)
        speeds = np.linalg.norm(sliding, axis=1)
        self.slides = speeds > 0.0
        aside = np.roll(case.normals, 1, axis=1) + np.array([0.3, 0.5, 0.7])
        first = np.cross(case.normals, aside)
        first /= np.linalg.norm(first, axis=1)[:, None]
        self.frames = np.stack([case.normals, first, np.cross(case.normals, first)], axis=1)
        against = sliding / np.where(self.slides, speeds, 1.0)[:, None]
        local = np.einsum("lij,lj->li", self.frames, against)
        self.kinetic = np.array([1.0, 0.0, 0.0]) - case.friction[:, None] * local
        size = 6 + len(case.torques)
        self.rows = self.frames @ case.relative_motion.reshape(self.count, 3, size)
        self.motion, self.friction = self.rows.reshape(-1, size), case.friction
        inertia = np.zeros((size, size))
        inertia[:6, :6], inertia[6:, 6:] = case.object_inertia, case.joint_inertia
        self.inertia = inertia
        self.load = np.concatenate([case.external_wrench, case.torques])
        self.weight = float(np.linalg.norm(case.external_wrench[:3]))
        edges = np.linspace(0.0, 2.0 * np.pi, sectors + 1)
        self.sectors = [State("slip", *pair) for pair in itertools.pairwise(edges.tolist())]

    def run(self) -> KeptAnswer:
        """Go through all combinations."""
        moving: bool | None = False
        fastest = 0.0
        for leaf in itertools.product(*(self._states(i) for i in range(self.count))):
            found = self._leaf(list(leaf))
            if found is None:
                moving = moving or None
            elif found > 0.0:
                moving, fastest = True, max(fastest, found)
        return KeptAnswer(self._kept(), moving, fastest)

    def _states(self, contact: int) -> list[State]:
        if self.slides[contact]:
            return [State("open"), State("closed")]
        if self.case.friction[contact] == 0.0:
            return [State("open"), State("closed")]
        return [State("open"), State("stick"), *self.sectors]

    def _kept(self) -> bool | None:
        leaf = [State("closed" if s else "stick") for s in self.slides]
        size, width = len(self.load), 3 * self.count
        below, equal = self._forces(leaf)
        scale = self.weight
        answer = linprog(
            np.concatenate([np.zeros(width), [1.0]]),
            A_ub=np.vstack([
                np.hstack([self.motion.T, -np.ones((size, 1))]),
                np.hstack([-self.motion.T, -np.ones((size, 1))]),
                np.pad(below, ((0, 0), (0, 1))),
            ]),
            b_ub=np.concatenate([-self.load, self.load, np.zeros(len(below))]) / scale,
            A_eq=np.pad(equal, ((0, 0), (0, 1))), b_eq=np.zeros(len(equal)),
            bounds=[(None, None)] * width + [(0.0, None)],
        )  # fmt: skip
        assert answer.status == 0
        return True if answer.fun < 1e-8 else False if answer.fun > 1e-4 else None

    def _forces(self, leaf: list[State]) -> tuple[Array, Array]:
        """Rows on the forces: what is at most zero, and what is zero."""
        below, equal = [], []
        for i, state in enumerate(leaf):
            own = self.force_rows(i, state, _AROUND.tolist())
            if self.slides[i] and state.kind == "closed":
                own = np.column_stack([-self.kinetic[i, 1:], np.eye(2)]), -np.eye(3)[:1]
            for rows, into in zip(own, (equal, below), strict=True):
                into.append(np.pad(rows, ((0, 0), (3 * i, 3 * (self.count - i - 1)))))
        return np.vstack(below), np.vstack(equal)

    def _rows(self, leaf: list[State]) -> tuple[Array, Array, Array, Array]:
        """Return A_ub, b_ub, A_eq, b_eq on (a, f): accelerations, and forces in weights."""
        size = len(self.load)
        below, equal = self._forces(leaf)
        pairs = [self.velocity_rows(i, state) for i, state in enumerate(leaf)]
        level, down = zip(*pairs, strict=True)
        dynamics = np.hstack([self.inertia / self.weight, -self.motion.T])
        equal = np.vstack([dynamics, np.pad(equal, ((0, 0), (size, 0))),
                           *(np.pad(r, ((0, 0), (0, 3 * self.count))) for r in level)])  # fmt: skip
        below = np.vstack([np.pad(below, ((0, 0), (size, 0))),
                           *(np.pad(r, ((0, 0), (0, 3 * self.count))) for r in down)])  # fmt: skip
        right = np.zeros(len(equal))
        right[:size] = self.load / self.weight
        return below, np.zeros(len(below)), equal, right

    def _leaf(self, leaf: list[State]) -> float | None:
        """Return how fast the object moves in an outcome; 0: not at all; None: not told."""
        waiting, is_told = [leaf], True
        for _ in range(_HALVINGS):
            if not waiting:
                return 0.0 if is_told else None
            one = waiting.pop()
            point = self._point(one)
            if point is None:
                continue
            moved = self._exact(one, point)
            if moved is not None:
                return moved
            widths = [s.high - s.low if s.kind == "slip" else 0.0 for s in one]
            widest = int(np.argmax(widths))
            if widths[widest] < 1e-4:
                is_told = False
                continue
            waiting += [[*one[:widest], half, *one[widest + 1 :]] for half in one[widest].halves()]
        return None

    def _point(self, leaf: list[State]) -> Array | None:
        """Return (a, f) of a point that moves; None: there is none."""
        below, zero, equal, right = self._rows(leaf)
        size = len(self.load)
        width = size + 3 * self.count
        solve = partial(linprog, A_ub=below, b_ub=zero, A_eq=equal, b_eq=right)
        lever = np.repeat([1.0, float(np.linalg.norm(self.case.positions, axis=1).max())], 3)
        anywhere = [(None, None)] * width
        if solve(np.zeros(width), bounds=anywhere).status == 2:
            return None
        for sign, k in itertools.product((1.0, -1.0), range(6)):
            cost = np.zeros(width)
            cost[k] = -sign * lever[k]
            answer = solve(cost, bounds=anywhere)
            if answer.status == 3:
                answer = solve(cost, bounds=[(-1e3, 1e3)] * size + anywhere[size:])
            if answer.status == 0 and -answer.fun > self.resolution / (2.0 * np.sqrt(3.0)):
                return np.asarray(answer.x)
        return None

    def _exact(self, leaf: list[State], point: Array) -> float | None:
        """Return how fast the exact outcome near a point moves the object; None: there is none."""
        size = len(self.load)

        def law(x: Array) -> Array:
            a, f = x[:size], x[size:].reshape(-1, 3)
            u = (self.motion @ a).reshape(-1, 3)
            left = [(self.inertia @ a - self.load) / self.weight - self.motion.T @ f.ravel()]
            for i, state in enumerate(leaf):
                mu = self.case.friction[i]
                if state.kind == "open":
                    left.append(f[i])
                    continue
                left.append(u[i, :1])
                if self.slides[i]:
                    left.append(f[i, 1:] - self.kinetic[i, 1:] * f[i, 0])
                elif mu == 0.0:
                    left.append(f[i, 1:])
                elif state.kind == "stick":
                    left.append(u[i, 1:])
                else:
                    slip = np.hypot(*u[i, 1:]) + 1e-300
                    left.append(f[i, 1:] + mu * f[i, 0] * u[i, 1:] / slip)
            return np.concatenate(left)

        found = least_squares(law, point, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        a, f = found.x[:size], found.x[size:].reshape(-1, 3)
        u = (self.motion @ a).reshape(-1, 3)
        sides = np.hypot(f[:, 1], f[:, 2])
        most = np.where(self.slides, np.inf, self.case.friction * f[:, 0])
        moved = self.case.object_motion(a)
        # Where a force hardly is one, or a slip, rounding decides.
        fair = np.abs(found.fun).max() < 1e-9 and u[:, 0].min() > -_TOLERANCE * max(1.0, moved)
        fair = fair and f[:, 0].min() > -_TOLERANCE and (sides - most).max() < _TOLERANCE
        return moved if fair and moved > self.resolution else None
