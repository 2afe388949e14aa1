"""Certificates of one linear program: balancing forces whose friction every outcome can bear.

If forces f* balance load and torques, with f*_n >= 0 and |f*_t| <= mu l at every contact, where l
is a normal force that every outcome has at least, then every outcome has
|y|^2 <= sum (|f*_t| - mu l) |u_t| <= 0: rest is the only one.

One proof for every load between two, g(t) = (1 - t) g0 + t g1: if both ends have certificates with
normal forces that every outcome of all these loads has, so has each load between. Otherwise an
outcome of g(t) has the power g(t).a <= max(g0.a, g1.a), so that two trees prove it, each with the
load free along the span.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import StrEnum

import numpy as np

from graspless_pin.holding.bounds import States
from graspless_pin.holding.branching import branch
from graspless_pin.holding.dynamics import (
    LEAST_LOAD,
    Dynamics,
    force_jacobian,
    free_friction,
    generalized_load,
    scaled_dynamics,
    spread_towards,
    world_forces,
)
from graspless_pin.holding.equilibrium import (
    BALANCE_TOLERANCE,
    Balance,
    farthest_forces,
    least_residual,
    normal_force_balance,
)
from graspless_pin.holding.relaxation import FORCE_LIMIT, Relaxation
from graspless_pin.holding.unstable_motion import find_motion
from graspless_pin.holding.verdict import LastRest, LoadProof, RestProof, SpanProof
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.inertias import commanded_forces, hybrid_contacts, whole_inertia
from graspless_pin.problem.scales import coordinate_units

MOST_FORCE = 1e3
"""In loads: largest normal force of admissible forces, if their limit is not lower."""
_HOPELESS = 0.03
"""In loads: once a larger residual is proven, the search for a certificate ends."""
_ROUNDS = 4
_LEAST_TORQUE = 1e-6
"""Relative to the largest torque that load or weight makes: least unit of a joint's torque."""
_EXACT = 1e-8
"""In loads: residual, and violation of friction, of a certificate that holds for every inertia."""


def balance(
    problem: QuasistaticProblem, torques: FloatArray, friction_limits: FloatArray | None = None
) -> Balance | None:
    """Find the contact forces with the least residual of the balance of load and torques.

    Where the residual is far too large for rest, or for a certificate, it need not be the least.

    Args:
        problem: Contacts, load and joints.
        torques: (L,) of the motors.
        friction_limits: (M,) largest friction force of each contact, N; None: mu f_n.
    """
    (jacobian, load), friction = scaled_balance(problem, torques), free_friction(problem)
    if friction_limits is None:
        return least_residual(jacobian, load, friction, BALANCE_TOLERANCE)
    frictionless = None if friction_limits.any() else normal_force_balance(jacobian[:, 0], load)
    if frictionless is not None:
        return frictionless
    limits = friction_limits / problem.scales.force
    return least_residual(jacobian, load, friction, _HOPELESS, limits)


def scaled_balance(
    problem: QuasistaticProblem, torques: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return `force_jacobian` (M, 3, P + L) and the load g (P + L,), scaled.

    Forces are in units of the load, entries of the balance in those of `balance_units`.
    """
    unit, force = balance_units(problem), problem.scales.force
    return force * force_jacobian(problem) / unit, generalized_load(problem, torques) / unit


def balance_units(problem: QuasistaticProblem) -> FloatArray:
    """Return (P + L,) units of the balance: the size that the load gives to each entry.

    The unit of a joint with next to no lever is a small share of the largest torque that load or
    weight makes at any joint, so that rounding errors of torques do not count.
    """
    units = coordinate_units(problem.scales, problem.passive_units)
    joints = units[problem.passive_count :]
    largest = np.maximum(joints, np.abs(problem.gravity_torques)).max(initial=0.0)
    np.maximum(joints, _LEAST_TORQUE * largest, out=joints)
    return units


def residual_lower_bound(
    problem: QuasistaticProblem, torques: FloatArray, motion: FloatArray
) -> float:
    """Return a lower bound on the residual of the balance over all contact forces, in loads.

    Args:
        problem: Contacts, load and joints.
        torques: (L,) of the motors.
        motion: (P + L,) z with sum |z| <= 1, along which no contact force does negative work.
    """
    jacobian, load = scaled_balance(problem, torques)
    z, lost = scaled_proof(jacobian, problem.friction, motion)
    return float(z @ load) - lost


def scaled_proof(
    jacobian: FloatArray, friction: FloatArray, motion: FloatArray
) -> tuple[FloatArray, float]:
    """Return z scaled to sum |z| <= 1, and the most that contact forces take from z.g, in loads.

    Normal forces are at most `FORCE_LIMIT`.

    Args:
        jacobian: (M, 3, k) of forces, as `scaled_balance` returns it.
        friction: (M,) coefficients.
        motion: (k,) z.
    """
    z = motion / max(1.0, float(np.abs(motion).sum()))
    c = jacobian @ z
    short = np.maximum(friction * np.hypot(c[:, 1], c[:, 2]) - c[:, 0], 0.0)
    return z, FORCE_LIMIT * float(short.sum())


def is_certificate(
    problem: QuasistaticProblem,
    torques: FloatArray,
    forces: FloatArray,
    loads: FloatArray,
    dynamics: Dynamics | None,
) -> bool:
    """Return whether forces prove that rest is the only outcome.

    Args:
        problem: Contacts, load and joints.
        torques: (L,) of the motors.
        forces: (M, 3) N, in contact frames.
        loads: (M,) smallest normal forces of all outcomes, N.
        dynamics: The scaled dynamics; None: it has to hold for every inertia.
    """
    excess = np.hypot(forces[:, 1], forces[:, 2]) - problem.friction * loads
    excess, pulling = np.maximum(excess, 0.0), np.maximum(-forces[:, 0], 0.0)
    if dynamics is None:
        scale = problem.scales.force
        jacobian, load = scaled_balance(problem, torques)
        residual = np.einsum("lik,li->k", jacobian, forces / scale) + load
        return max(np.abs(residual).max(), excess.max() / scale, pulling.max() / scale) <= _EXACT
    unit, rows = dynamics.force_unit, dynamics.rows
    y = np.linalg.norm(dynamics.scaled_acceleration(forces / unit))
    y += excess / unit @ np.linalg.norm(rows[:, 1:], ord=2, axis=(1, 2))
    y += pulling / unit @ np.linalg.norm(rows[:, 0], axis=1)
    return bool(y <= dynamics.resolution)


def balance_and_certificate(
    problem: QuasistaticProblem,
    torques: FloatArray,
    normal_forces: FloatArray,
    loads: tuple[LoadProof, ...],
    dynamics: Dynamics | None,
) -> tuple[Balance | None, RestProof | None]:
    """Return the forces with the least residual, and the certificate if they are one.

    Args:
        problem: Contacts, load and joints.
        torques: (L,) of the motors.
        normal_forces: (M,) smallest normal forces of all outcomes, N.
        loads: Their proofs; commanded forces need none.
        dynamics: The scaled dynamics; None: it has to hold for every inertia.
    """
    balanced = balance(problem, torques, problem.friction * normal_forces)
    if balanced is None:
        return None, None
    forces = balanced.forces * problem.scales.force
    if not is_certificate(problem, torques, forces, normal_forces, dynamics):
        return balanced, None
    limit = FORCE_LIMIT * problem.scales.force if loads else np.inf
    return balanced, RestProof(loads, world_forces(problem, forces), None, limit)


def force_limit(problem: QuasistaticProblem, dynamics: Dynamics) -> float:
    """Return the normal force up to which proofs hold, scaled."""
    return FORCE_LIMIT * problem.scales.force / dynamics.force_unit


def proven_loads(
    dynamics: Dynamics, least: FloatArray, most: float
) -> tuple[tuple[LoadProof, ...], int]:
    """Return proofs of positive normal forces of all outcomes, and the number of linear programs.

    Each contact's smallest force is bounded in turn, in rounds: with the forces proven so far
    friction takes more of the load's power, so that other contacts have to bear more.

    Args:
        dynamics: The scaled dynamics.
        least: (M,) smallest normal forces of all outcomes known before, scaled.
        most: Proofs hold for normal forces up to this, scaled.
    """
    states = States.all_free(dynamics.contact_count)
    relaxation, proofs = Relaxation(dynamics, least, most), list[LoadProof]()
    for _ in range(_ROUNDS):
        larger = relaxation.larger_loads(states)
        proofs += larger
        if not larger:
            break
        relaxation = relaxation.with_loads(larger)
    return tuple(proofs), relaxation.programs


def with_proven_loads(forces: FloatArray, loads: Iterable[LoadProof]) -> FloatArray:
    """Return normal forces (M,), N, raised to the proven ones where these are larger."""
    forces = forces.copy()
    for proof in loads:
        forces[proof.contact] = max(forces[proof.contact], proof.force)
    return forces


def bearing_forces(
    problem: QuasistaticProblem, torques: FloatArray, forces: FloatArray
) -> FloatArray:
    """Return forces of rest in which every contact bears load that does in some forces of rest.

    Args:
        problem: Contacts and loads, at rest.
        torques: (L,) N m (N).
        forces: (M, 3) of a rest, in contact frames, in loads.

    Returns:
        (M, 3) in contact frames, in loads.
    """
    jacobian, load = scaled_balance(problem, torques)
    largest = np.minimum(problem.max_normal_force / problem.scales.force, MOST_FORCE)
    rests = [forces]
    for contact in np.flatnonzero(forces[:, 0] <= LEAST_LOAD).tolist():
        if np.mean(rests, axis=0)[contact, 0] <= LEAST_LOAD:
            cost = np.zeros_like(forces)
            cost[contact, 0] = -1.0
            loaded = farthest_forces(jacobian, load, free_friction(problem), cost, largest)
            if loaded is not None and loaded[contact, 0] > LEAST_LOAD:
                rests.append(loaded)
    return np.mean(rests, axis=0)


class Unproven(StrEnum):
    """Why rest is not proven to be the only outcome of all loads of a span."""

    MOVES = "moves"
    """The last load of the span has a moving outcome."""
    OPEN = "open"
    """No proof was found."""


_MOST_STEPS = 50
"""Steps of Newton's method for the largest load that forces balance."""


class LoadLine:
    """The loads and torques of a problem along a line, and proofs of rest under them."""

    def __init__(
        self, problem: QuasistaticProblem, torques: FloatArray, direction: FloatArray, limit: float
    ) -> None:
        """Begin at the problem's own load.

        Args:
            problem: At rest.
            torques: (L,) of the motors.
            direction: (P + L,) change of wrench and torques for a multiple of one.
            limit: Accelerations of points of the object up to this count as rest, m/s^2.
        """
        self.problem, self.torques, self.direction = problem, torques, direction
        self._limit, self._inertia = limit, whole_inertia(problem)
        self._hybrid = hybrid_contacts(problem)

    @property
    def scaled_direction(self) -> FloatArray:
        """(P + L,) the direction in units of the load."""
        return self.direction / balance_units(self.problem)

    def at_load(self, multiple: float) -> tuple[QuasistaticProblem, FloatArray]:
        """Return the problem and the torques at a multiple of the direction."""
        passive = self.problem.passive_count
        wrench = self.problem.external_wrench + multiple * self.direction[:passive]
        changed = self.problem.with_changes(external_wrench=wrench)
        return changed, self.torques + multiple * self.direction[passive:]

    def last_balanced(self, most: float) -> LastRest:
        """Return the largest multiple up to ``most`` with which rest is an outcome.

        The least residual is a convex function of the multiple, and each proof of it a tangent:
        Newton's method from above.
        """
        jacobian, load = scaled_balance(self.problem, self.torques)
        step, friction = self.scaled_direction, self.problem.friction
        multiple, proof = most, None
        for _ in range(_MOST_STEPS):
            least = least_residual(jacobian, load + multiple * step, friction, np.inf)
            if least is None:
                break
            if least.is_rest:
                forces = world_forces(self.problem, least.forces * self.problem.scales.force)
                return LastRest(multiple, forces, proof)
            z, lost = scaled_proof(jacobian, friction, least.proof)
            slope = float(z @ step)
            if not slope > 0.0:
                break
            nearer = (0.5 * BALANCE_TOLERANCE + lost - float(z @ load)) / slope
            if not 0.0 <= nearer < multiple:
                break
            proof, multiple = read_only(z), nearer
        return LastRest(0.0, None, None)

    def has_motion(self, multiple: float) -> bool:
        """Return whether a quick search finds a motion at this load."""
        dynamics = self._dynamics(multiple)
        return dynamics is not None and find_motion(dynamics) is not None

    def prove_span(
        self, first: float, last: float, is_over: Callable[[int], bool]
    ) -> SpanProof | Unproven:
        """Prove that rest is the only outcome of all loads of a span.

        Args:
            first: Least multiple.
            last: Largest multiple.
            is_over: Returns for a number of sets of outcomes whether each of two trees has to end.
        """
        ends = first, last
        if min(commanded_forces(*self.at_load(end)).min(initial=0.0) for end in ends) < 0.0:
            return Unproven.OPEN
        resting = [self._rest_forces(end) for end in ends]
        if resting[0] is None or resting[1] is None:
            return Unproven.OPEN
        rest_forces = resting[0], resting[1]
        certificates = self._end_certificates(ends, ((), ()))
        if certificates is not None:
            return SpanProof(ends, rest_forces, certificates)
        if self._inertia is None:
            return Unproven.OPEN
        whole = [self._dynamics(end) for end in ends]
        spreads = [
            None if own is None else spread_towards(own, other)
            for own, other in zip(whole, reversed(whole), strict=True)
        ]
        loads = self._proven_loads(spreads[0]), self._proven_loads(spreads[1])
        certificates = self._end_certificates(ends, loads)
        if certificates is not None:
            return SpanProof(ends, rest_forces, certificates)
        # The tree of the last load comes first: it may find a motion.
        later = self._branching_proof(spreads[1], loads[1], is_over)
        if isinstance(later, Unproven):
            return later
        earlier = self._branching_proof(spreads[0], loads[0], is_over)
        if isinstance(earlier, Unproven):
            return Unproven.OPEN
        return SpanProof(ends, rest_forces, (earlier, later))

    def _rest_forces(self, multiple: float) -> FloatArray | None:
        """Return (M, 3) forces of rest, N, world axes; None: there are none."""
        problem, torques = self.at_load(multiple)
        rest = balance(problem, torques)
        if rest is None or not rest.is_rest:
            return None
        return world_forces(problem, rest.forces * problem.scales.force)

    def _branching_proof(
        self,
        spread: Dynamics | None,
        loads: tuple[LoadProof, ...],
        is_over: Callable[[int], bool],
    ) -> RestProof | Unproven:
        """Return the proof by branching that no outcome moves, or why there is none."""
        if spread is None:  # there is no load at all, and nothing moves
            return RestProof((), None, None, np.inf)
        proven = self._common_proven_forces([loads]) / spread.force_unit
        least = np.where(spread.is_commanded, spread.commanded, proven)
        relaxation = Relaxation(spread, least, force_limit(self.problem, spread))
        result = branch(spread, relaxation, is_over)
        if result.tree is None:
            return Unproven.OPEN if result.motion is None else Unproven.MOVES
        return RestProof(loads, None, result.tree, FORCE_LIMIT * self.problem.scales.force)

    def _dynamics(self, multiple: float) -> Dynamics | None:
        """Return the scaled dynamics; None without inertias, or if there is no load at all."""
        if self._inertia is None:
            return None
        return scaled_dynamics(*self.at_load(multiple), self._inertia, self._hybrid, self._limit)

    def _end_certificates(
        self, ends: tuple[float, float], loads: tuple[tuple[LoadProof, ...], ...]
    ) -> tuple[RestProof, RestProof] | None:
        """Return certificates of both ends, by normal forces that outcomes of all loads have."""
        least, proofs = self._common_proven_forces(loads), list[RestProof]()
        for end, own in zip(ends, loads, strict=True):
            problem, torques = self.at_load(end)
            normal_forces = np.maximum(commanded_forces(problem, torques), least)
            _, proof = balance_and_certificate(
                problem, torques, normal_forces, own, self._dynamics(end)
            )
            if proof is None:
                return None
            proofs.append(proof)
        return proofs[0], proofs[1]

    def _proven_loads(self, dynamics: Dynamics | None) -> tuple[LoadProof, ...]:
        """Return proofs of the smallest normal forces of all outcomes."""
        if dynamics is None:
            return ()
        least = np.where(dynamics.is_commanded, dynamics.commanded, 0.0)
        return proven_loads(dynamics, least, force_limit(self.problem, dynamics))[0]

    def _common_proven_forces(self, loads: Sequence[tuple[LoadProof, ...]]) -> FloatArray:
        """Return (M,) the normal forces that each of several sets of proofs proves, N."""
        none = np.zeros(self.problem.contact_count)
        return np.min([with_proven_loads(none, proofs) for proofs in loads], axis=0)
