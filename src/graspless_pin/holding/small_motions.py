"""Small motions about a rest: how fast they grow, and which joint feedback stabilises them.

Contacts that neither slip nor open leave the velocities N z of object and joints, G N = 0. About
the rest M_z z'' + D_z z' + (K_geo + N_q^T K N_q) z = 0 with M_z = N^T M N, the joints' damping in
D_z and their feedback K. K_geo, the geometric stiffness, is linear in the contact forces: levers,
normals and contact points change as the bodies roll. With friction forces at rolling contacts it is
not symmetric, and the eigenvalues decide.

Torques may leave contact forces open. Stability is then that under the worst admissible forces; if
rest is stable under others, it may hold or fail. Worst and best forces are searched by successive
linear programs (Frank and Wolfe's method) on the growth rate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eig, eigh, solve_continuous_lyapunov
from scipy.optimize import brentq

from graspless_pin.holding.certificate import MOST_FORCE, scaled_balance
from graspless_pin.holding.dynamics import free_friction, world_forces
from graspless_pin.holding.equilibrium import farthest_forces
from graspless_pin.holding.stability import stability
from graspless_pin.holding.verdict import StabilityVerdict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.program import MatrixInequality

Intervals = tuple[tuple[float, float], ...]
"""(low, high) each, ascending."""
GROWTH_LIMIT = 0.1
"""Motions that grow no faster than this do not count as growing, 1/s."""
_DOUBLINGS = 60
_GAIN_ACCURACY = 1e-7
"""Relative accuracy of the ends of stable feedback."""
_MOST_ROUNDS = 8
_MOST_STARTS = 6
_FASTER = 1e-6
"""Relative increase of the growth that a round has to make for another one to follow."""
_PROVEN = 0.5
"""Smallest eigenvalue of the right-hand side of Lyapunov's equation after rounding; exactly 1."""
_LEAST_STIFFNESS = 1e-12
"""N m: least scale of an entry of the stiffness."""
_INFLUENCE = 1e-9
"""Relative to the largest entry: smaller changes of the stiffness by forces count as none."""


@dataclass(frozen=True, eq=False)
class LinearizedMotion:
    """Small motions z about a rest, and how their stiffness depends on the contact forces.

    Attributes:
        inertia: (d, d) N^T M N.
        force_stiffness: (M, 3, d, d) of unit contact forces along the world's axes.
        constant_stiffness: (d, d) the part of K_geo from the links' weights.
        joint_rates: (c, d) N_q: of the joints that carry touching links.
        velocities: (P + L, d) N.
        gains: (c,) K of the controller, N m/rad (N/m).
        damping: (c,) D, N m s/rad (N s/m).
    """

    inertia: FloatArray
    force_stiffness: FloatArray
    constant_stiffness: FloatArray
    joint_rates: FloatArray
    velocities: FloatArray
    gains: FloatArray
    damping: FloatArray

    def stiffness(self, forces: FloatArray) -> FloatArray:
        """Return K_geo (d, d) under contact forces (M, 3), N, world axes."""
        return self.constant_stiffness + np.einsum("mi,miab->ab", forces, self.force_stiffness)

    def total_stiffness(self, stiffness: FloatArray) -> FloatArray:
        """Return K_geo + N_q^T K N_q (d, d) under the controller."""
        return stiffness + self.feedback(self.gains)

    @property
    def drag(self) -> FloatArray:
        """(d, d) D_z = N_q^T D N_q."""
        return self.feedback(self.damping)

    def inequality(self, forces: FloatArray, rate: float, share: float) -> MatrixInequality:
        """Return the matrix inequality on forces that keeps growth below a rate.

        K_geo + N_q^T K N_q + r D_z + r^2 M_z >= 0, of symmetric parts: sufficient if K_geo is
        symmetric, otherwise a guess.

        Args:
            forces: (M, 3) added to the unknown contact forces, N, world axes.
            rate: r, 1/s.
            share: Of the controller's gains that counts.

        Returns:
            The inequality of the 3 M forces, N, world axes, scaled to entries of order one.
        """
        constant = self.stiffness(forces) + share * self.feedback(self.gains)
        constant += rate * self.drag + rate**2 * self.inertia
        by_force = self.force_stiffness.reshape(-1, *constant.shape)
        largest = np.abs(by_force).max(axis=0, initial=0.0).diagonal()
        unit = 1.0 / np.sqrt(np.maximum(np.abs(constant.diagonal()) + largest, _LEAST_STIFFNESS))
        scaled = (np.outer(unit, unit) * matrix for matrix in (constant, by_force))
        return MatrixInequality(*(0.5 * (part + part.swapaxes(-1, -2)) for part in scaled))

    def system(self, stiffness: FloatArray, pattern: FloatArray, factors: FloatArray) -> FloatArray:
        """Return A of (z, z')' = A (z, z') under multiples of some gains.

        Args:
            stiffness: (d, d) K_geo, plus that of feedback that is not scaled.
            pattern: (c,) gains that are scaled.
            factors: (K,) multiples of them.

        Returns:
            (K, 2 d, 2 d).
        """
        count = len(self.inertia)
        parts = [stiffness, self.drag, self.feedback(pattern)]
        rolled = -np.linalg.solve(self.inertia, np.hstack(parts))
        A = np.zeros((len(factors), 2 * count, 2 * count))
        A[:, :count, count:] = np.eye(count)
        A[:, count:] = rolled[:, : 2 * count]
        A[:, count:, :count] += factors[:, None, None] * rolled[:, 2 * count :]
        return A

    def feedback(self, gains: FloatArray) -> FloatArray:
        """Return N_q^T K N_q (d, d) of the joints' gains (c,)."""
        return self.joint_rates.T @ (gains[:, None] * self.joint_rates)

    def fastest_growth(self, stiffness: FloatArray) -> tuple[float, FloatArray]:
        """Return the largest growth rate, 1/s, zero up to `GROWTH_LIMIT`, and its motion (P + L,).

        Args:
            stiffness: (d, d) K_geo.
        """
        rate, shape, _ = self.fastest_mode(stiffness)
        return (rate if rate > GROWTH_LIMIT else 0.0), self.velocities @ shape

    def neutral_motions(self, stiffness: FloatArray) -> FloatArray:
        """Return (P + L, k) motions without stiffness under the controller, for K_geo (d, d)."""
        if not len(stiffness):
            return np.zeros((len(self.velocities), 0))
        unit = np.sqrt(np.diag(self.inertia))
        _, values, turns = np.linalg.svd(self.total_stiffness(stiffness) / np.outer(unit, unit))
        still = values <= GROWTH_LIMIT**2
        return self.velocities @ (turns[still].T / unit[:, None])

    def fastest_mode(self, stiffness: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Return the largest growth rate, 1/s, its motion (d,) and its gradient (d, d) by K_geo."""
        count = len(self.inertia)
        if count == 0:
            return 0.0, np.zeros(0), np.zeros((0, 0))
        A = self.system(stiffness, self.gains, np.ones(1))[0]
        found: Any = eig(A, left=True, right=True)
        values, left, right = found
        most = int(np.argmax(np.real(values)))
        w, v = left[:, most], right[:, most]
        scale = np.vdot(w, v)
        gradient = np.zeros((count, count))
        if abs(scale) > np.finfo(float).eps:
            back = np.linalg.solve(self.inertia, np.conj(w[count:]))
            gradient = -np.real(np.outer(back, v[:count]) / scale)
        return float(np.real(values[most])), np.real(v[:count]), gradient

    def stable_feedback(self, stiffness: FloatArray, pattern: FloatArray) -> Intervals:
        """Return the intervals of factors on gains with which no motion grows, ascending.

        Factors are tried in steps of two, up to 1e8 times the ratio of stiffness to feedback; the
        last interval ends at infinity if no motion grows at the largest one.

        Args:
            stiffness: (d, d) K_geo.
            pattern: (c,) gains that replace the controller's.
        """
        count = len(self.inertia)
        still, step = self.system(stiffness, pattern, np.array([0.0, 1.0]))
        step = step - still

        def growth(factors: FloatArray) -> FloatArray:
            systems = still + factors[:, None, None] * step
            return np.real(np.linalg.eigvals(systems)).max(axis=1, initial=0.0) - GROWTH_LIMIT

        reach = float(self.feedback(pattern).diagonal().max(initial=0.0))
        if reach == 0.0 or count == 0:
            return () if growth(np.zeros(1))[0] > 0.0 else ((0.0, np.inf),)
        size = float(np.abs(stiffness).max(initial=0.0))
        powers = np.arange(-_DOUBLINGS // 2, _DOUBLINGS // 2, dtype=float)
        factors = np.append(0.0, size / reach * np.exp2(powers))
        grows = growth(factors) > 0.0
        ends = [0.0]
        for index in np.flatnonzero(grows[1:] != grows[:-1]).tolist():
            low, high = factors[index : index + 2].tolist()
            root = _sign_change(lambda k: float(growth(np.array([k]))[0]), low, high)
            # Just on the stable side.
            side = 1.0 if grows[index] else -1.0
            ends.append(min(max(root * (1.0 + 2.0 * side * _GAIN_ACCURACY), low), high))
        ends.append(np.inf)
        inner = ends[1:] if grows[0] else ends
        return tuple(zip(inner[::2], inner[1::2], strict=False))


def _sign_change(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function changes its sign between two points, by Brent's method."""
    first, last = function(low), function(high)
    if first * last >= 0.0:  # by rounding: a root is at an end
        return low if abs(first) < abs(last) else high
    root: Any = brentq(function, low, high, rtol=np.float64(_GAIN_ACCURACY))
    return float(root)


def scaled_system(
    inertia: FloatArray, stiffness: FloatArray, damping: FloatArray, rate: float
) -> tuple[FloatArray, float]:
    """Return A of small motions, scaled to unit inertia, and the frequency w that time counts in.

    With M_z = L L^T, y = L^T z and w^2 the largest entry of L^-1 K L^-T, the state is (w y, y') and
    A = [[0, 1], [-L^-1 K L^-T / w^2, -L^-1 D L^-T / w]] in units of w.

    Args:
        inertia: (d, d) M_z.
        stiffness: (d, d) K, including that of feedback.
        damping: (d, d) D_z.
        rate: The least w, 1/s.
    """
    root = np.linalg.cholesky(inertia)
    own, drag = (
        np.linalg.solve(root, np.linalg.solve(root, matrix.T).T) for matrix in (stiffness, damping)
    )
    w = max(float(np.sqrt(np.abs(own).max(initial=0.0))), rate)
    count = len(inertia)
    system = np.zeros((2 * count, 2 * count))
    system[:count, count:] = np.eye(count)
    system[count:] = np.hstack([-own / w**2, -drag / w])
    return system, w


def lyapunov_matrix(
    inertia: FloatArray, stiffness: FloatArray, damping: FloatArray, rate: float
) -> FloatArray | None:
    """Return P > 0 with A^T P + P A = 2 r P - 1, which proves that no motion grows faster than r.

    It solves Lyapunov's equation for A - r, see `scaled_system`; None if a motion grows as fast.

    Args:
        inertia: (d, d) M_z.
        stiffness: (d, d) K, including that of feedback.
        damping: (d, d) D_z.
        rate: r, 1/s.
    """
    if not len(inertia):
        return np.zeros((0, 0))
    system, w = scaled_system(inertia, stiffness, damping, rate)
    shifted = system - rate / w * np.eye(len(system))
    if np.linalg.eigvals(shifted).real.max() >= 0.0:
        return None
    P = np.asarray(solve_continuous_lyapunov(shifted.T, -np.eye(len(shifted))))
    P = 0.5 * (P + P.T)
    decay = -(shifted.T @ P + P @ shifted)
    is_proof = min(np.linalg.eigvalsh(P)[0], np.linalg.eigvalsh(decay)[0] - _PROVEN) > 0.0
    return P if is_proof else None


def extreme_forces(
    motion: LinearizedMotion,
    problem: QuasistaticProblem,
    torques: FloatArray,
    forces: FloatArray,
    *,
    worst: bool,
) -> FloatArray:
    """Search the admissible contact forces under which small motions grow fastest, or least.

    Args:
        motion: The small motions.
        problem: Contacts and loads, at rest.
        torques: (L,) N m (N).
        forces: (M, 3) forces of rest to start from, world axes, N.
        worst: Whether growth is maximised; else it is minimised.

    Returns:
        (M, 3) world axes, N; the start if the torques leave no forces open that change stiffness.
    """
    jacobian, load = scaled_balance(problem, torques)
    _, values, turns = np.linalg.svd(jacobian.reshape(3 * len(forces), -1).T)
    rank = int((values > _INFLUENCE * values.max(initial=0.0)).sum())
    in_frames = np.einsum("mji,mjab->miab", problem.frames, motion.force_stiffness)
    open_forces = turns[rank:].reshape(-1, len(forces), 3)
    influence = np.einsum("kmi,miab->kab", open_forces, in_frames)
    size = float(np.abs(in_frames).max(initial=0.0))
    if np.abs(influence).max(initial=0.0) <= _INFLUENCE * size:
        return forces
    unit, sign = problem.scales.force, 1.0 if worst else -1.0
    most = np.minimum(problem.max_normal_force / unit, MOST_FORCE)

    def growth(forces: FloatArray) -> tuple[float, FloatArray]:
        """Return the growth rate, signed to be maximised, and its gradient by the stiffness."""
        rate, _, gradient = motion.fastest_mode(motion.stiffness(forces))
        return sign * rate, sign * gradient

    def forces_along(gradient: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Return growth, forces and its gradient at the forces farthest along a gradient."""
        cost = -np.einsum("ab,miab->mi", gradient, in_frames)
        farthest = farthest_forces(jacobian, load, free_friction(problem), cost, most)
        if farthest is None:
            return -np.inf, forces, gradient
        new_forces = world_forces(problem, farthest * unit)
        rate, next_gradient = growth(new_forces)
        return rate, new_forces, next_gradient

    rate, gradient = growth(forces)
    best = max(
        (
            forces_along(-_softest_direction(motion, side * change))
            for change in _largest_changes(influence)
            for side in (1, -1)
        ),
        key=lambda change: change[0],
    )
    if best[0] > rate:
        rate, forces, gradient = best
    for _ in range(_MOST_ROUNDS):
        new_rate, new_forces, next_gradient = forces_along(gradient)
        if new_rate <= rate + _FASTER * max(abs(rate), GROWTH_LIMIT):
            return forces
        rate, forces, gradient = new_rate, new_forces, next_gradient
    return forces


def _largest_changes(influence: FloatArray) -> FloatArray:
    """Return the largest of the changes of the stiffness (k, d, d), at most `_MOST_STARTS`."""
    return influence[np.argsort(-np.abs(influence).max(axis=(1, 2)))[:_MOST_STARTS]]


def _softest_direction(motion: LinearizedMotion, stiffness: FloatArray) -> FloatArray:
    """Return z z^T (d, d) of the motion z with the smallest eigenvalue of a stiffness."""
    symmetric = 0.5 * (stiffness + stiffness.T)
    _, vectors = eigh(symmetric, motion.inertia, subset_by_index=[0, 0])
    return np.outer(vectors[:, 0], vectors[:, 0])


@dataclass(frozen=True, eq=False)
class RestModel:
    """The data on rest, beside the problem, for a search for guaranteed torques.

    Attributes:
        unknown: Why there is no verdict on torques; empty: there is one.
        motions: Returns the small motions that must not grow, one for each model of the surfaces.
        verdict: `stability`, with small motions.
        lasts: Whether rest has to last under the controller; else the first instant alone counts.
    """

    unknown: str = ""
    motions: Callable[[], Sequence[LinearizedMotion]] = tuple
    verdict: Callable[..., StabilityVerdict] = stability
    lasts: bool = False

    def is_kept(self, verdict: StabilityVerdict) -> bool:
        """Return whether rest is the only outcome, and if required, lasts."""
        return verdict.keeps_rest(lasting=self.lasts)
