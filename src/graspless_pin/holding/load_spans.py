"""Whether rest is the only outcome of every load between two: one proof for all of them.

Loads g(t) = (1 - t) g0 + t g1. Forces of certificates at both ends, with normal forces that every
outcome of all these loads has, are one at each load between. Else an outcome of g(t) has the power
g(t).a <= max(g0.a, g1.a), so that two trees tell, each with the load free along the span.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from graspless_pin.holding.branching import branch
from graspless_pin.holding.certificate import balance, in_loads, is_certificate, proven_loads
from graspless_pin.holding.dynamics import Dynamics, scaled_dynamics, spread_towards
from graspless_pin.holding.moving import find_motion
from graspless_pin.holding.relaxation import FORCE_LIMIT, Relaxation
from graspless_pin.holding.rest import BALANCE_TOLERANCE, least_residual
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.inertias import hybrid_contacts, whole_inertia


class SpanAnswer(StrEnum):
    """What is known of all loads of a span."""

    ONLY_REST = "only_rest"
    """Rest is the only outcome of each."""
    MOVES = "moves"
    """The last one has a moving outcome."""
    OPEN = "open"
    """Neither was proven."""


_MOST_STEPS = 50
"""Of Newton's method for the largest load that forces balance."""


class LoadLine:
    """The loads and torques of a problem along a line, of which rest may be the only outcome."""

    def __init__(
        self, problem: QuasistaticProblem, torques: FloatArray, direction: FloatArray, limit: float
    ) -> None:
        """Begin at the problem's own load.

        Args:
            problem: At rest.
            torques: (L,) of the motors.
            direction: (6 + L,) what each multiple adds to wrench and torques.
            limit: Accelerations of points of the object up to this count as rest, m/s^2.
        """
        self.problem, self.torques, self.direction = problem, torques, direction
        self._limit, self._inertia = limit, whole_inertia(problem)
        self._hybrid = hybrid_contacts(problem)
        rows = problem.jacobian.reshape(problem.contact_count, 3 * problem.joint_count)
        self._fingers: NDArray[np.bool_] = np.any(rows, axis=1)
        self._fingers[self._hybrid[self._hybrid >= 0]] = False

    @property
    def in_loads(self) -> FloatArray:
        """(6 + L,) the direction in units of the load."""
        force, length, joints = self.problem.scales
        return self.direction / np.concatenate([np.repeat([force, force * length], 3), joints])

    def at(self, multiple: float) -> tuple[QuasistaticProblem, FloatArray]:
        """Return the problem and the torques with so much of the direction."""
        wrench = self.problem.external_wrench + multiple * self.direction[:6]
        changed = self.problem.with_changes(external_wrench=wrench)
        return changed, self.torques + multiple * self.direction[6:]

    def last_balanced(self, most: float) -> float:
        """Return the largest multiple up to ``most`` with which rest is an outcome.

        The least residual is a convex function of the multiple, and each proof of it a tangent:
        Newton's method from above.
        """
        jacobian, load = in_loads(self.problem, self.torques)
        step, friction = self.in_loads, self.problem.friction
        multiple, none = most, np.full(len(jacobian), np.nan)
        for _ in range(_MOST_STEPS):
            found = least_residual(jacobian, load + multiple * step, friction, none, np.inf)
            if found is None:
                break
            if found.residual <= BALANCE_TOLERANCE:
                return multiple
            slope = float(found.proof @ step)
            if slope <= 0.0:
                break
            multiple = (0.5 * BALANCE_TOLERANCE - float(found.proof @ load)) / slope
        return 0.0

    def moves(self, multiple: float) -> bool:
        """Return whether a quick search finds a motion at this load."""
        dynamics = self._dynamics(multiple)
        return dynamics is not None and find_motion(dynamics) is not None

    def answer(self, first: float, last: float, node_limit: int) -> SpanAnswer:
        """Tell whether rest is the only outcome of all loads of a span.

        Args:
            first: Least multiple.
            last: Largest multiple.
            node_limit: Sets of outcomes that each of two trees may look at.
        """
        ends = first, last
        if min(self._commanded(end).min(initial=0.0) for end in ends) < 0.0:
            return SpanAnswer.OPEN
        for end in ends:
            found = balance(*self.at(end))
            if found is None or found.residual > BALANCE_TOLERANCE:
                return SpanAnswer.OPEN
        if self._certified(ends, np.zeros(len(self._fingers))):
            return SpanAnswer.ONLY_REST
        if self._inertia is None:
            return SpanAnswer.OPEN
        whole = [self._dynamics(end) for end in ends]
        # The last load's first: its tree may meet a motion.
        spreads = [
            spread_towards(own, other)
            for own, other in zip(reversed(whole), whole, strict=True)
            if own is not None
        ]
        loads = [self._loads(spread) for spread in spreads]
        if self._certified(ends, np.min(loads, axis=0)):
            return SpanAnswer.ONLY_REST
        for spread, least in zip(spreads, loads, strict=True):
            relaxation = self._relaxation(spread, least)
            found = branch(spread, relaxation, lambda nodes: nodes >= node_limit)
            if found.tree is None:
                moves = found.motion is not None and spread is spreads[0] and whole[1] is not None
                return SpanAnswer.MOVES if moves else SpanAnswer.OPEN
        return SpanAnswer.ONLY_REST

    def _dynamics(self, multiple: float) -> Dynamics | None:
        """Return the dynamics; None without inertias, and without load: then nothing moves."""
        if self._inertia is None:
            return None
        return scaled_dynamics(*self.at(multiple), self._inertia, self._hybrid, self._limit)

    def _commanded(self, multiple: float) -> FloatArray:
        """Return the (M,) normal forces that hybrid fingers command, N; zero elsewhere."""
        forces = np.zeros(len(self._fingers))
        columns = np.flatnonzero(self._hybrid >= 0)
        excess = self.at(multiple)[1] - self.problem.gravity_torques
        forces[self._hybrid[columns]] = excess[columns]
        return forces

    def _certified(self, ends: tuple[float, float], loads: FloatArray) -> bool:
        """Return whether one linear program at each end proves rest, with loads that all have."""
        for end in ends:
            problem, torques = self.at(end)
            borne = np.maximum(self._commanded(end), loads)
            found = balance(problem, torques, problem.friction * borne)
            if found is None:
                return False
            forces = found.forces * problem.scales.force
            if not is_certificate(problem, torques, forces, borne, self._dynamics(end)):
                return False
        return True

    def _relaxation(self, dynamics: Dynamics, loads: FloatArray) -> Relaxation:
        least = np.where(dynamics.is_commanded, dynamics.commanded, loads / dynamics.force_unit)
        most = FORCE_LIMIT * self.problem.scales.force / dynamics.force_unit
        return Relaxation(dynamics, least, most)

    def _loads(self, dynamics: Dynamics) -> FloatArray:
        """Return normal forces of the fingers that every outcome has, (M,) N."""
        loads = np.zeros(len(self._fingers))
        relaxation = self._relaxation(dynamics, loads)
        for proof in proven_loads(dynamics, relaxation, np.flatnonzero(self._fingers)):
            loads[proof.contact] = proof.force
        return loads
