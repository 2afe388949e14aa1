"""Search for moving outcomes: Gauss-Seidel sweeps from several forces, then Newton's method."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled import core
from graspless_pin.holding.dynamics import Dynamics, contact_jacobian, world_forces
from graspless_pin.holding.least_squares import least_squares
from graspless_pin.holding.verdict import ContactState, DynamicOutcome
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only

_STARTS = 12
_SWEEPS = 400
_LOOK = 25
"""Sweeps between checks whether all starts go to rest."""
_SLOW = 0.1
"""Share of the acceleration limit below which a start is taken to go to rest."""
_POLISH_STEPS = 20
_EXACT = 1e-13
_DIVERGING = 1e3
_SETTLED = 1e-10
"""Forces that change by less have converged."""
_LONG_SWEEPS = 4000
_LONG_SETTLED = 1e-14
"""Convergence of the search from one point, whose result is not polished: where a contact sticks
with friction at its limit, the last Newton step of least norm may leave the cone."""
_DIVERGED = 1e6
"""Forces that change by more diverge, as where contacts jam: the sweeps end."""
_TOLERANCE = 1e-9
"""Scaled: violation of the laws of contact that an outcome may have, however large its forces."""
_STILL = 1e-12
_NEGLIGIBLE = 1e-6
"""Relative: contacts of an outcome with smaller forces are open, those with smaller slips stick."""
_CREEPING = 1e-3
"""Share of the acceleration limit below which a slipping contact is called sticking."""
_SURFACE = 0.999
"""Share of mu f_n from which a contact may be slipping."""


def is_outcome(dynamics: Dynamics, forces: FloatArray) -> bool:
    """Return whether scaled forces (M, 3) and the motion that they cause are a moving outcome."""
    y = dynamics.scaled_acceleration(forces)
    if dynamics.point_acceleration(y) <= dynamics.limit:
        return False
    u, mu, normal = dynamics.contact_motion(y), dynamics.friction, dynamics.normal_forces(forces)
    parting = np.where(dynamics.is_commanded, 0.0, u[:, 0])
    slips = np.hypot(u[:, 1], u[:, 2])
    if not (np.isfinite(y).all() and np.isfinite(normal).all()):
        return False
    side = np.hypot(forces[:, 1], forces[:, 2])
    if (normal < 0.0).any() or (side > mu * normal * (1.0 + 1e-9) + _STILL).any():
        return False
    # Contacts that part have no force; friction of those that slip is opposite to the slip.
    directions = u[:, 1:] / np.maximum(slips, _STILL)[:, None]
    against = np.linalg.norm(forces[:, 1:] + (mu * normal)[:, None] * directions, axis=1)
    gaps = np.maximum(np.minimum(normal, parting), np.minimum(against, slips))
    return bool(parting.min() >= -_TOLERANCE and gaps.max() <= _TOLERANCE)


def coulomb_gaps(dynamics: Dynamics, forces: FloatArray, slips: FloatArray) -> FloatArray:
    """Return (M,) the violation of Coulomb's law by each contact's force and slip, as power."""
    gaps = (forces[:, 1:] * slips[:, 1:]).sum(axis=1)
    gaps += dynamics.friction * dynamics.normal_forces(forces) * np.hypot(slips[:, 1], slips[:, 2])
    return np.abs(gaps) + np.where(dynamics.is_commanded, 0.0, np.abs(forces[:, 0] * slips[:, 0]))


def find_motion(dynamics: Dynamics) -> FloatArray | None:
    """Return scaled forces (M, 3) of a moving outcome; None: the search found none."""
    return next(search_motions(dynamics), None)


def search_motions(dynamics: Dynamics) -> Iterator[FloatArray]:
    """Yield scaled forces (M, 3) of moving outcomes, each with other contact states.

    The first start is without forces: contacts that close without preload.
    """
    rng = np.random.default_rng(0)
    count = dynamics.contact_count
    starts = np.zeros((_STARTS, count, 3))
    starts[1:, :, 0] = (
        rng.exponential(size=(_STARTS - 1, count)) * np.logspace(-1.0, 1.5, _STARTS - 1)[:, None]
    )
    turn = rng.normal(size=(_STARTS - 1, count, 2))
    turn *= rng.random((_STARTS - 1, count, 1)) / np.linalg.norm(turn, axis=2, keepdims=True)
    starts[1:, :, 1:] = turn * (dynamics.friction[:, None] * starts[1:, :, :1])
    tried: set[bytes] = set()
    for forces in _swept_forces(dynamics, starts):
        if dynamics.point_acceleration(dynamics.scaled_acceleration(forces)) > dynamics.limit:
            polished = polish(dynamics, forces, tried)
            if polished is not None:
                yield polished


def settled_motion(dynamics: Dynamics, forces: FloatArray) -> FloatArray | None:
    """Return the moving outcome to which sweeps from scaled forces (M, 3) converge, or None."""
    settled = _swept_forces(dynamics, forces[None], _LONG_SWEEPS, _LONG_SETTLED)[0]
    return settled if is_outcome(dynamics, settled) else None


def _swept_forces(
    dynamics: Dynamics, starts: FloatArray, sweeps: int = _SWEEPS, settled: float = _SETTLED
) -> FloatArray:
    """Return (K, M, 3) forces after projected Gauss-Seidel sweeps with De Saxce's shift.

    All starts are swept side by side, until no force changes by more than `settled`, or for
    `sweeps` sweeps.
    """
    rows, pushes, mu = dynamics.rows, dynamics.pushes, dynamics.friction
    blocks = np.einsum("lin,ljn->lij", rows, pushes)
    steps = 1.0 / np.maximum(np.linalg.norm(blocks, ord=2, axis=(1, 2)), 1e-12)
    rows, pushes = steps[:, None, None] * rows, pushes.transpose(0, 2, 1).copy()
    is_commanded, commanded = dynamics.is_commanded, dynamics.commanded
    # The starts are the last axis: forces (M, 3, K) and their motions (n, K).
    forces = starts.transpose(1, 2, 0).copy()
    forces[is_commanded, 0] = commanded[is_commanded, None]
    changes = np.zeros_like(forces)
    y = np.einsum("lni,lik->nk", pushes, forces) + dynamics.load[:, None]
    still = _SLOW * dynamics.limit
    # Verdicts with a motion take up to three times as long with the sweeps in numpy, which stay for
    # installations without compiled loops, and to test the loops with.
    if core is not None:
        core.swept(
            rows, pushes.transpose(0, 2, 1), mu, commanded, dynamics.points, forces, y, sweeps,
            _LOOK, still, settled, _DIVERGED, _STILL,
        )  # fmt: skip
        return forces.transpose(2, 0, 1)
    for sweep in range(sweeps):
        if sweep % _LOOK == _LOOK - 1 and max(map(dynamics.point_acceleration, y.T)) < still:
            break
        for contact, coefficient in enumerate(mu.tolist()):
            u, old = rows[contact] @ y, forces[contact]
            trial = old - u
            side = np.hypot(trial[1], trial[2])
            if is_commanded[contact]:
                trial[0] = commanded[contact]
            else:
                trial[0] -= coefficient * np.hypot(u[1], u[2])
                on_surface = (trial[0] + coefficient * side) / (1.0 + coefficient * coefficient)
                trial[0] = np.maximum(np.maximum(trial[0], on_surface), 0.0)
            trial[1:] *= np.minimum(1.0, coefficient * trial[0] / np.maximum(side, _STILL))
            np.subtract(trial, old, out=changes[contact])
            y += pushes[contact] @ changes[contact]
            forces[contact] = trial
        change = float(np.abs(changes).max())
        if change < settled or change > _DIVERGED:
            break
    return forces.transpose(2, 0, 1)


def polish(
    dynamics: Dynamics, forces: FloatArray, tried: set[bytes] | None = None
) -> FloatArray | None:
    """Return forces of the outcome in the contact states that some forces suggest, or None.

    Gauss-Newton steps of least norm on these equations: closed contacts do not accelerate apart,
    sticking ones not sideways, slipping ones have f_t = -mu f_n u_t / |u_t|.

    Args:
        dynamics: The scaled dynamics.
        forces: (M, 3) scaled, to start from.
        tried: Contact states that are not tried again; those of this call are added.
    """
    tried = set() if tried is None else tried
    u = dynamics.contact_motion(dynamics.scaled_acceleration(forces))
    size = float(np.abs(u).max())
    if size == 0.0:
        return None
    normal, slips = dynamics.normal_forces(forces), np.hypot(u[:, 1], u[:, 2])
    opened = ~dynamics.is_commanded & (normal <= 1e-3 * np.maximum(u[:, 0], 0.0) + _STILL)
    on_surface = np.hypot(forces[:, 1], forces[:, 2]) >= _SURFACE * dynamics.friction * normal
    smooth = dynamics.friction == 0.0
    for sliding in (slips > 1e-3 * size, slips > 1e-5 * size, slips > 1e-7 * size, on_surface):
        slipping = (sliding | smooth) & ~opened
        states = opened.tobytes() + slipping.tobytes()
        if states in tried:
            continue
        tried.add(states)
        polished = _newton_polish(dynamics, forces, opened, slipping)
        if polished is not None:
            return polished
    return None


def _newton_polish(
    dynamics: Dynamics,
    forces: FloatArray,
    opened: NDArray[np.bool_],
    slipping: NDArray[np.bool_],
) -> FloatArray | None:
    mu, is_commanded = dynamics.friction, dynamics.is_commanded
    f = np.where(opened[:, None], 0.0, forces)
    f[is_commanded, 0] = dynamics.commanded[is_commanded]
    free = np.flatnonzero(~opened)
    count, n = len(free), len(dynamics.load)
    own, pushes = dynamics.rows[free], dynamics.pushes[free].reshape(3 * count, n)
    delassus = (own @ pushes.T).reshape(count, 3, 3 * count)
    identity = np.eye(3 * count).reshape(count, 3, 3 * count)
    coefficient, slides, fixed = mu[free], slipping[free], is_commanded[free]
    least = np.inf
    for _ in range(_POLISH_STEPS):
        u, g = own @ dynamics.scaled_acceleration(f), f[free]
        slip = np.hypot(u[:, 1], u[:, 2])
        moving = slides & (slip > 0.0)
        d = u[:, 1:] / np.where(slip > 0.0, slip, 1.0)[:, None]
        friction = (coefficient * g[:, 0])[:, None]
        across = np.eye(2) - d[:, :, None] * d[:, None, :]
        across *= (friction[:, 0] / np.where(slip > 0.0, slip, 1.0))[:, None, None]
        residual, jacobian = u, delassus.copy()
        law = g[:, 1:] + friction * d
        slope = identity[:, 1:] + across @ delassus[:, 1:]
        slope += coefficient[:, None, None] * d[:, :, None] * identity[:, :1]
        residual[moving, 1:], jacobian[moving, 1:] = law[moving], slope[moving]
        residual[fixed, 0], jacobian[fixed, 0] = 0.0, identity[fixed, 0]
        size = float(np.abs(residual).max(initial=0.0))
        if size < _EXACT or size > _DIVERGING * least:
            break
        least = min(least, size)
        change = least_squares(jacobian.reshape(3 * count, -1), -residual.ravel(), 1e-12)
        if change is None:
            return None
        f[free] += change.reshape(-1, 3)
    f[:, 0] = np.where(is_commanded, dynamics.commanded, np.maximum(f[:, 0], 0.0))
    return f if is_outcome(dynamics, f) else None


def outcome_record(
    problem: QuasistaticProblem, dynamics: Dynamics, forces: FloatArray
) -> DynamicOutcome:
    """Return the record of a moving outcome, in SI units and world axes."""
    y, passive = dynamics.scaled_acceleration(forces), problem.passive_count
    a, u = dynamics.acceleration @ y, dynamics.contact_motion(y)
    speeds = np.linalg.norm(contact_jacobian(problem)[:, 1:] @ a, axis=1)
    local = forces * dynamics.force_unit
    opened = local[:, 0] <= _NEGLIGIBLE * problem.scales.force
    # Where only joints move, accelerations at contacts are rounding errors.
    slips = np.hypot(u[:, 1], u[:, 2]) > _NEGLIGIBLE * float(np.abs(u).max())
    slips &= speeds > _CREEPING * dynamics.limit
    states = np.where(opened, ContactState.OPEN, ContactState.STICKING)
    states[~opened & slips] = ContactState.SLIPPING
    states[~opened & problem.is_sliding] = ContactState.CLOSED
    return DynamicOutcome(
        read_only(a[:passive].copy()), read_only(a[passive:].copy()), world_forces(problem, local),
        tuple(ContactState(state) for state in states), dynamics.point_acceleration(y),
    )  # fmt: skip
