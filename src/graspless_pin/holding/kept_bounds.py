"""What multipliers prove of all outcomes under a declared motion.

For every outcome in given states and all multipliers nu and kappa, with
lambda = p + sum_l (nu_l A_n,l + A_t,l^T kappa_l) and c = B lambda,

    p.y = lambda.h + sum_l c_l.f_l - sum_l (nu_l u_n,l + kappa_l.u_t,l),

because y = B^T f + h and u = A y. Friction that rubs may add power, so that nothing else bounds y:
c_l.f_l may be positive by rounding alone, and kappa stands only where slip is known.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.holding.bounds import States, least_along
from graspless_pin.holding.dynamics import Dynamics
from graspless_pin.holding.verdict import ContactState, DualBound
from graspless_pin.problem.checks import FloatArray


def point_goals(dynamics: Dynamics) -> FloatArray:
    """Return (13, n) goals: zero, and twelve of which none above one leaves all points slow.

    Those are both signs of the accelerations of the reference point and of the angular ones times
    the longest lever, each in units of limit / (2 sqrt(3)). Where no outcome has even the goal
    zero, there is none at all.
    """
    one_way = np.concatenate(
        [dynamics.acceleration[:3], dynamics.lever * dynamics.acceleration[3:6]]
    )
    one_way *= 2.0 * np.sqrt(3.0) / dynamics.limit
    return np.vstack([np.zeros(one_way.shape[1]), one_way, -one_way])


def goal_bound(dynamics: Dynamics, states: States, dual: DualBound, force_limit: float) -> float:
    """Return an upper bound of p.y over all outcomes in these states.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        dual: The multipliers of `completed`, whose lambda holds p.
        force_limit: It holds for outcomes with normal forces up to this, scaled.
    """
    rows, pushes, held = dynamics.rows, dynamics.pushes, dynamics.is_commanded
    arcs = _arcs(states)
    high = np.where(held, dynamics.commanded, force_limit)
    high = np.where(states.are(ContactState.OPEN), 0.0, high)
    low = np.where(held, high, 0.0)
    gain = _gains(dynamics, states, dual.motion)
    bound = float(dual.motion @ dynamics.load + (np.maximum(gain * low, gain * high)).sum())
    wrong = np.maximum(-least_along(dual.tangential, *arcs), 0.0)
    wrong = np.where(states.are(ContactState.STICKING), 0.0, wrong)
    sizes = np.linalg.norm(pushes, axis=2).sum(axis=1) * (1.0 + dynamics.friction)
    reach = float(np.linalg.norm(dynamics.load)) + float(high @ sizes)
    return bound + reach * float(wrong @ np.linalg.norm(rows[:, 1:], axis=(1, 2)))


def completed(dynamics: Dynamics, states: States, dual: DualBound, goal: FloatArray) -> DualBound:
    """Return multipliers with the lambda that belongs to them, and none that is not allowed."""
    may_part = states.are(ContactState.FREE, ContactState.OPEN)
    normal = np.where(may_part, np.maximum(dual.normal, 0.0), dual.normal)
    normal = np.where(dynamics.is_commanded, 0.0, normal)
    known = states.are(ContactState.STICKING, ContactState.SLIPPING)
    tangential = np.where(known[:, None], dual.tangential, 0.0)
    rows = dynamics.rows
    motion = goal + normal @ rows[:, 0] + np.einsum("li,lin->n", tangential, rows[:, 1:])
    return DualBound(motion, normal, tangential)


def _arcs(states: States) -> tuple[FloatArray, FloatArray]:
    slipping = states.are(ContactState.SLIPPING)
    return states.center, np.where(slipping, states.half_width, np.pi)


def _gains(dynamics: Dynamics, states: States, motion: FloatArray) -> FloatArray:
    """Return what a newton of each normal force gains at most, (M,)."""
    c = dynamics.pushes @ motion
    normal = np.where(dynamics.is_commanded, 0.0, c[:, 0])
    return normal - dynamics.friction * least_along(c[:, 1:], *_arcs(states))
