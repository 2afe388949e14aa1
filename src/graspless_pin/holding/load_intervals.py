"""Whether rest is the only outcome of every load between two: one proof for all of them.

Loads g(t) = (1 - t) g0 + t g1. Forces of certificates at both ends, with normal forces that every
outcome of all these loads has, are one at each load between. Else an outcome of g(t) has the power
g(t).a <= max(g0.a, g1.a), so that two trees tell, each with the load free along the span.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum

import numpy as np

from graspless_pin.holding.branching import branch
from graspless_pin.holding.certificate import (
    balance,
    balance_units,
    in_loads,
    is_certificate,
    proven_loads,
    scaled_proof,
)
from graspless_pin.holding.dynamics import (
    Dynamics,
    scaled_dynamics,
    spread_towards,
    world_forces,
)
from graspless_pin.holding.equilibrium import BALANCE_TOLERANCE, least_residual
from graspless_pin.holding.relaxation import FORCE_LIMIT, Relaxation
from graspless_pin.holding.unstable_motion import find_motion
from graspless_pin.holding.verdict import LastRest, LoadProof, RestProof, SpanProof
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.inertias import commanded_forces, hybrid_contacts, whole_inertia


class Unproven(StrEnum):
    """Why rest is not proven to be the only outcome of all loads of a span."""

    MOVES = "moves"
    """The last one has a moving outcome."""
    OPEN = "open"
    """No proof was found."""


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
            direction: (P + L,) what each multiple adds to wrench and torques.
            limit: Accelerations of points of the object up to this count as rest, m/s^2.
        """
        self.problem, self.torques, self.direction = problem, torques, direction
        self._limit, self._inertia = limit, whole_inertia(problem)
        self._hybrid = hybrid_contacts(problem)

    @property
    def in_loads(self) -> FloatArray:
        """(P + L,) the direction in units of the load."""
        return self.direction / balance_units(self.problem)

    def at(self, multiple: float) -> tuple[QuasistaticProblem, FloatArray]:
        """Return the problem and the torques with so much of the direction."""
        passive = self.problem.passive_count
        wrench = self.problem.external_wrench + multiple * self.direction[:passive]
        changed = self.problem.with_changes(external_wrench=wrench)
        return changed, self.torques + multiple * self.direction[passive:]

    def last_balanced(self, most: float) -> LastRest:
        """Return the largest multiple up to ``most`` with which rest is an outcome.

        The least residual is a convex function of the multiple, and each proof of it a tangent:
        Newton's method from above.
        """
        jacobian, load = in_loads(self.problem, self.torques)
        step, friction = self.in_loads, self.problem.friction
        multiple, none, proof = most, np.full(len(jacobian), np.nan), None
        for _ in range(_MOST_STEPS):
            found = least_residual(jacobian, load + multiple * step, friction, none, np.inf)
            if found is None:
                break
            if found.is_rest:
                forces = world_forces(self.problem, found.forces * self.problem.scales.force)
                return LastRest(multiple, forces, proof)
            z, lost = scaled_proof(jacobian, friction, found.proof)
            slope = float(z @ step)
            if not slope > 0.0:
                break
            nearer = (0.5 * BALANCE_TOLERANCE + lost - float(z @ load)) / slope
            if not 0.0 <= nearer < multiple:
                break
            proof, multiple = read_only(z), nearer
        return LastRest(0.0, None, None)

    def moves(self, multiple: float) -> bool:
        """Return whether a quick search finds a motion at this load."""
        dynamics = self._dynamics(multiple)
        return dynamics is not None and find_motion(dynamics) is not None

    def proof(
        self, first: float, last: float, is_over: Callable[[int], bool]
    ) -> SpanProof | Unproven:
        """Prove that rest is the only outcome of all loads of a span.

        Args:
            first: Least multiple.
            last: Largest multiple.
            is_over: Tells after so many sets of outcomes whether each of two trees has to end.
        """
        ends = first, last
        if min(commanded_forces(*self.at(end)).min(initial=0.0) for end in ends) < 0.0:
            return Unproven.OPEN
        resting = [self._rest_forces(end) for end in ends]
        if resting[0] is None or resting[1] is None:
            return Unproven.OPEN
        rest_forces = resting[0], resting[1]
        certified = self._certified(ends, ((), ()))
        if certified is not None:
            return SpanProof(ends, rest_forces, certified)
        if self._inertia is None:
            return Unproven.OPEN
        whole = [self._dynamics(end) for end in ends]
        spreads = [
            None if own is None else spread_towards(own, other)
            for own, other in zip(whole, reversed(whole), strict=True)
        ]
        loads = self._loads(spreads[0]), self._loads(spreads[1])
        certified = self._certified(ends, loads)
        if certified is not None:
            return SpanProof(ends, rest_forces, certified)
        # The last load's first: its tree may meet a motion.
        later = self._tree(spreads[1], loads[1], is_over)
        if isinstance(later, Unproven):
            return later
        earlier = self._tree(spreads[0], loads[0], is_over)
        if isinstance(earlier, Unproven):
            return Unproven.OPEN
        return SpanProof(ends, rest_forces, (earlier, later))

    def _rest_forces(self, multiple: float) -> FloatArray | None:
        """Return (M, 3) forces of rest, N, world axes; None: there are none."""
        problem, torques = self.at(multiple)
        found = balance(problem, torques)
        if found is None or not found.is_rest:
            return None
        return world_forces(problem, found.forces * problem.scales.force)

    def _tree(
        self,
        spread: Dynamics | None,
        loads: tuple[LoadProof, ...],
        is_over: Callable[[int], bool],
    ) -> RestProof | Unproven:
        """Prove by branching that nothing moves, or tell whether something does."""
        if spread is None:
            return RestProof((), None, None, np.inf)
        relaxation = self._relaxation(spread, self._newtons([loads]))
        found = branch(spread, relaxation, is_over)
        if found.tree is None:
            return Unproven.OPEN if found.motion is None else Unproven.MOVES
        limit = FORCE_LIMIT * self.problem.scales.force
        return RestProof(loads, None, found.tree, limit)

    def _dynamics(self, multiple: float) -> Dynamics | None:
        """Return the dynamics; None without inertias, and without load: then nothing moves."""
        if self._inertia is None:
            return None
        return scaled_dynamics(*self.at(multiple), self._inertia, self._hybrid, self._limit)

    def _certified(
        self, ends: tuple[float, float], loads: tuple[tuple[LoadProof, ...], ...]
    ) -> tuple[RestProof, RestProof] | None:
        """Return certificates of both ends that lean on loads that all outcomes have."""
        least, proofs = self._newtons(loads), list[RestProof]()
        limit = FORCE_LIMIT * self.problem.scales.force
        for end, own in zip(ends, loads, strict=True):
            problem, torques = self.at(end)
            normal_forces = np.maximum(commanded_forces(problem, torques), least)
            found = balance(problem, torques, problem.friction * normal_forces)
            if found is None:
                return None
            forces = found.forces * problem.scales.force
            if not is_certificate(problem, torques, forces, normal_forces, self._dynamics(end)):
                return None
            world = world_forces(problem, forces)
            proofs.append(RestProof(own, world, None, limit if own else np.inf))
        return proofs[0], proofs[1]

    def _relaxation(self, dynamics: Dynamics, loads: FloatArray) -> Relaxation:
        least = np.where(dynamics.is_commanded, dynamics.commanded, loads / dynamics.force_unit)
        return Relaxation(dynamics, least, self._most(dynamics))

    def _most(self, dynamics: Dynamics) -> float:
        """Return the normal force up to which proofs hold, scaled."""
        return FORCE_LIMIT * self.problem.scales.force / dynamics.force_unit

    def _loads(self, dynamics: Dynamics | None) -> tuple[LoadProof, ...]:
        """Return normal forces that every outcome has, with their proofs."""
        if dynamics is None:
            return ()
        least = np.where(dynamics.is_commanded, dynamics.commanded, 0.0)
        loads, _ = proven_loads(dynamics, least, self._most(dynamics))
        return loads

    def _newtons(self, loads: Sequence[tuple[LoadProof, ...]]) -> FloatArray:
        """Return the (M,) smallest of the normal forces that several sets of proofs prove, N."""
        forces = np.zeros((len(loads), self.problem.contact_count))
        for row, proofs in zip(forces, loads, strict=True):
            for one in proofs:
                row[one.contact] = one.force
        return forces.min(axis=0)
