"""Go through a proof that nothing but a declared motion is an outcome.

Where friction rubs its power has no sign, and accelerations are bounded by linear duality alone:
for all multipliers, with lambda = p + sum (nu A_n + kappa.A_t), y = B^T f + h and u = A y,

    p.y = lambda.h + sum (B lambda).f - sum (nu u_n + kappa.u_t).

Each node states what is proven there and below. A leaf needs both signs of six accelerations of
the object, small enough together that no point of it accelerates above the limit, or goal 0,
p = 0, below zero: then there is no outcome in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.rest_bounds import (
    Kind,
    KnownStates,
    RestDynamics,
    RestMultipliers,
    least_product,
)
from graspless_pin.report.verify.rest_tree import GOALS, RestNode, uncovered

_LONG = np.longdouble
_EMPTY = -0.1
"""Multipliers of any size prove the same of no outcome: by how much is no tolerance."""


def kept_goals(dynamics: RestDynamics, lever: float, limit: float) -> np.ndarray:
    """(13, n) zero, and both signs of accelerations in units of limit / (2 sqrt(3)).

    Args:
        dynamics: The scaled dynamics.
        lever: From the centre of mass to the farthest contact point, m.
        limit: Accelerations of points up to this are none, m/s^2.
    """
    scale = np.repeat([1.0, lever], 3)[:, None] * (2.0 * np.sqrt(3.0) / limit)
    ways = scale * dynamics.accelerations[:6]
    return np.concatenate([np.zeros((1, ways.shape[1])), ways, -ways])


def kept_goal(
    dynamics: RestDynamics,
    states: KnownStates,
    multipliers: RestMultipliers,
    goal: np.ndarray,
    force_limit: float,
) -> float:
    """Return what p.y is at most in all outcomes in these states.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        multipliers: nu and kappa; lambda follows from them.
        goal: p (n,).
        force_limit: Normal forces are at most this, scaled.
    """
    rows, held = dynamics.rows.astype(_LONG), np.isfinite(dynamics.commanded)
    pushes, mu = dynamics.pushes.astype(_LONG), dynamics.friction
    nu = np.where(held, 0.0, multipliers.normal)
    nu = np.where(states.are(Kind.FREE, Kind.OPEN), np.maximum(nu, 0.0), nu).astype(_LONG)
    sticks, slips = states.are(Kind.STICKING), states.are(Kind.SLIPPING)
    kappa = multipliers.tangential.astype(_LONG)
    half_width = np.where(slips, states.half_width, np.pi)
    motion = goal + nu @ rows[:, 0] + np.einsum("li,lin->n", kappa, rows[:, 1:])
    rough = np.abs(goal) + np.abs(nu) @ np.abs(rows[:, 0])
    rough = rough + np.einsum("li,lin->n", np.abs(kappa), np.abs(rows[:, 1:]))
    c, sizes = pushes @ motion, np.abs(pushes) @ rough
    most = np.where(held, dynamics.commanded, force_limit)
    most = np.where(states.are(Kind.OPEN), 0.0, most)
    least = np.where(held, most, 0.0)
    gain = np.where(held, 0.0, c[:, 0]) - mu * least_product(c[:, 1:], states.center, half_width)
    gain = gain + tolerances.lost(sizes[:, 0] + mu * sizes[:, 1:].sum(axis=1))
    pushed = np.maximum(gain * least, gain * most)
    # What rounding leaves of -kappa.u_t, with the longest slip that such forces make.
    wrong = np.maximum(-least_product(kappa, states.center, half_width), 0.0)
    wrong = wrong + tolerances.lost(np.linalg.norm(kappa, axis=1))
    wrong = np.where(sticks, 0.0, wrong) @ np.linalg.norm(rows[:, 1:], axis=(1, 2))
    longest = np.linalg.norm(pushes, axis=2)
    fastest = most @ (longest[:, 0] + mu * longest[:, 1:].sum(axis=1))
    bound = motion @ dynamics.load + pushed.sum()
    bound += wrong * (np.linalg.norm(dynamics.load) + fastest)
    size = rough @ np.abs(dynamics.load) + np.abs(pushed).sum()
    return float(bound + tolerances.lost(size))


@dataclass(eq=False)
class KeptWalk:
    """A walk through one proof.

    Attributes:
        dynamics: The scaled dynamics.
        goals: (13, n) of `kept_goals`.
        force_limit: Normal forces that the proof has to reach, scaled.
        leaves: How many there were.
        failure: Why it is no proof; empty: it is one.
    """

    dynamics: RestDynamics
    goals: np.ndarray
    force_limit: float
    leaves: int = 0
    failure: str = ""

    def walk(self, root: RestNode) -> None:
        """Go through all nodes."""
        self._visit(root, KnownStates.unknown(len(self.dynamics.rows)), frozenset())

    def _visit(self, node: RestNode, states: KnownStates, proven: frozenset[int]) -> None:
        for goal, multipliers in node.sides:
            most = _EMPTY if goal == 0 else 1.0 + tolerances.SHARE
            bound = kept_goal(
                self.dynamics, states, multipliers, self.goals[goal], self.force_limit
            )
            if not bound <= most:
                self._fail(f"goal {goal} reaches {bound:.3g} where {most:.3g} is claimed")
            proven |= {goal}
        if not node.children:
            self.leaves += 1
            if 0 not in proven and len(proven) < GOALS - 1:
                self._fail(f"a leaf bounds {len(proven)} of {GOALS - 1} accelerations")
            return
        contact = node.children[0].contact
        if any(child.forced or child.contact != contact for child in node.children):
            self._fail(f"children of one node are of contact {contact} and others, or forced")
        why = uncovered(node.children, states, np.isfinite(self.dynamics.commanded))
        if why:
            self._fail(f"contact {contact}: {why}")
        for child in node.children:
            self._visit(child, states.changed(contact, child.kind, child.arc), proven)

    def _fail(self, why: str) -> None:
        self.failure = self.failure or why
