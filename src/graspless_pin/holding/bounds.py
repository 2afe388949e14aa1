r"""Upper bounds over all outcomes with contacts in given states, proven by multipliers.

For every outcome and all multipliers, with c = q + A lambda and
v = p - lambda + sum_l (nu_l a_n,l + A_t,l^T kappa_l),

    p.y + q.f <= lambda.h + sum_l c_l.f_l + max_y [v.y + beta (h.y - |y|^2)]
                 - sum_l (kappa_l.u_t,l + beta mu_l f_n,l |u_t,l|),

(plus terms of the motion of joints by themselves, `dynamics.without_free_joints`),
because y = A^T f + h, |y|^2 + sum mu f_n |u_t| <= h.y, and nu_l u_n,l >= 0 where nu_l >= 0 or
u_n,l = 0. The terms of one contact are bounded over what its state admits: forces in its cone or in
the arc opposite to its slip, f_n >= its smallest normal force, u_t in the arc of its slip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled import core
from graspless_pin.holding.dynamics import Dynamics, leak_powers
from graspless_pin.holding.least_squares import least_squares
from graspless_pin.holding.patches import Patch, PatchSlip
from graspless_pin.holding.verdict import ContactState, DualBound
from graspless_pin.problem.checks import FloatArray

RANK = 1e-9
"""Relative: rows with smaller singular values depend on the others."""
_ROUNDING = 1e-9
"""Gains per newton below this are rounding."""
_NUMBERS = {state: number for number, state in enumerate(ContactState)}
_EXACT = 1e-15
"""Gains per newton up to this are accepted: a million loads make little of them."""
_CLOSING = 1e-13
"""Largest closing tolerance, scaled acceleration: a hundred times the rounding error of dependent
rows."""
PATCH_TOLERANCE = 10.0
"""Factor on the closing tolerance: slips of a patch up to this count as sticking."""
_STILL = 1e-9
"""Smaller norms of the load are replaced by this."""
_REMEMBERED = 256
"""Most multipliers that are kept to be tried on other sets."""
_REPAIRS = 4
"""Rounds of changes of multipliers: the best force of a contact changes with them."""


@dataclass(frozen=True, eq=False)
class States:
    """The known states of all contacts: a set of outcomes.

    Attributes:
        state: M states.
        center: (M,) middle of the arc of slip directions, angle from t1, rad.
        half_width: (M,) half the width of that arc, rad; pi: any direction is possible; -1: the
            contact does not slip. Set for slipping contacts, and for contacts of patches whether
            they are open or closed.
        closes: (M,) contacts whose closing follows from that of others: relaxations need no row for
            it, and dependent rows would make large multipliers.
        sticks: (M,) contacts whose sticking follows from that of others, likewise.
        parts: (M,) u_n up to which a contact counts as closed, if above the closing tolerance.
        slips: (M,) |u_t| up to which it counts as sticking, likewise.
        patches: The known slips of patches.
    """

    state: tuple[ContactState, ...]
    center: FloatArray
    half_width: FloatArray
    closes: NDArray[np.bool_]
    sticks: NDArray[np.bool_]
    parts: FloatArray
    slips: FloatArray
    patches: tuple[PatchSlip, ...] = ()

    @classmethod
    def all_free(cls, count: int) -> States:
        """Return the set of all outcomes: every contact's state is undecided."""
        none, zeros = np.zeros(count, dtype=bool), np.zeros(count)
        free = (ContactState.FREE,) * count
        return cls(free, zeros, np.full(count, np.pi), none, none, zeros, zeros)

    def with_state(
        self,
        contact: int,
        state: ContactState,
        center: float = 0.0,
        half_width: float = np.pi,
        *,
        depends: bool = False,
        most: float = 0.0,
    ) -> States:
        """Return the states with that of one contact replaced.

        Args:
            contact: Its index.
            state: Its state.
            center: Middle of the arc of its slip directions, rad.
            half_width: Half the width of that arc, rad.
            depends: Whether its rows depend on those of closed and sticking contacts.
            most: Scaled acceleration up to which it counts as closed or sticking.
        """
        centers, widths = self.center.copy(), self.half_width.copy()
        closes, sticks = self.closes.copy(), self.sticks.copy()
        parts, slips = self.parts.copy(), self.slips.copy()
        if state in (ContactState.STICKING, ContactState.SLIPPING):
            centers[contact], widths[contact] = center, half_width
            sticks[contact] = depends and state is ContactState.STICKING
        closes[contact] |= depends and state is ContactState.CLOSED
        if state is ContactState.CLOSED:
            parts[contact] = max(parts[contact], most)
        elif state is ContactState.STICKING:
            slips[contact] = max(slips[contact], most)
        states = (*self.state[:contact], state, *self.state[contact + 1 :])
        return States(states, centers, widths, closes, sticks, parts, slips, self.patches)

    def with_patch(self, patch: PatchSlip, most: float) -> States:
        """Return the states with the slip of a patch; most: slips that count as sticking."""
        contacts, sticks, slips = [*patch.contacts], self.sticks.copy(), self.slips.copy()
        centers, widths = self.center.copy(), self.half_width.copy()
        # A contact that was split by itself has a narrower arc already.
        free = ~self.is_in(ContactState.STICKING, ContactState.SLIPPING)[contacts]
        centers[contacts] = np.where(free, patch.arcs[:, 0], centers[contacts])
        widths[contacts] = np.where(free, patch.arcs[:, 1], widths[contacts])
        if patch.cone is None:
            # The first contacts determine the planar motion: if they stick, all do.
            sticks[contacts[patch.determining_count :]] = True
            own = self.is_in(ContactState.STICKING)[contacts]
            slips[contacts] = np.where(own, slips[contacts], np.maximum(slips[contacts], most))
        patches = (*(own for own in self.patches if own.contacts != patch.contacts), patch)
        return replace(
            self, center=centers, half_width=widths, sticks=sticks, slips=slips, patches=patches
        )

    def patch_slip(self, patch: Patch) -> PatchSlip | None:
        """Return the known slip of a patch; None: it has not been split yet."""
        return next((own for own in self.patches if own.contacts == patch.contacts), None)

    @cached_property
    def does_not_slip(self) -> NDArray[np.bool_]:
        """(M,) contacts that do not slip, including open contacts of sticking patches."""
        return self.is_in(ContactState.STICKING) | (self.half_width < 0.0)

    @cached_property
    def arcs(self) -> tuple[FloatArray, FloatArray]:
        """Middle and half width (M,) of the directions of slip, rad."""
        return self.center, np.where(self.does_not_slip, np.pi, self.half_width)

    @cached_property
    def undecided(self) -> NDArray[np.bool_]:
        """(M,) contacts that may open, or slip in any direction and stick."""
        free, closed = self.is_in(ContactState.FREE), self.is_in(ContactState.CLOSED)
        return free | (closed & (self.half_width >= np.pi))

    def is_in(self, *kinds: ContactState) -> NDArray[np.bool_]:
        """Return which contacts are in one of these states."""
        return _state_mask(kinds)[self.numbers]

    @cached_property
    def numbers(self) -> NDArray[np.intp]:
        """(M,) the states' indices in the order of `ContactState`."""
        return np.array([_NUMBERS[state] for state in self.state])


@cache
def _state_mask(kinds: tuple[ContactState, ...]) -> NDArray[np.bool_]:
    """Return a mask over all `ContactState`: true for the given kinds."""
    return np.array([state in kinds for state in ContactState])


def least_products(vectors: FloatArray, center: FloatArray, half_width: FloatArray) -> FloatArray:
    """Return (M,) smallest dot products of each vector (M, 2) with the unit vectors of its arc."""
    return (vectors * least_direction(vectors, center, half_width)).sum(axis=1)


def least_direction(vectors: FloatArray, center: FloatArray, half_width: FloatArray) -> FloatArray:
    """Return (M, 2) the unit vector of each arc with the smallest dot product with its vector."""
    opposite_angle = np.arctan2(-vectors[:, 1], -vectors[:, 0]) - center
    opposite_angle = (opposite_angle + np.pi) % (2.0 * np.pi) - np.pi
    angle = center + np.clip(opposite_angle, -half_width, half_width)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def repaired_multipliers(
    dynamics: Dynamics, states: States, dual: DualBound, goal: tuple[FloatArray, FloatArray]
) -> DualBound:
    """Return multipliers with the smallest change of lambda that removes gains due to rounding.

    After it no contact's force raises the bound: as forces are unbounded, multipliers with a gain
    of 1e-9 per newton would prove nothing.
    """
    unbounded = ~states.is_in(ContactState.OPEN) & ~dynamics.is_commanded
    motion = dual.motion
    for _ in range(_REPAIRS):
        c = goal[1] + dynamics.rows @ motion
        sides = dynamics.friction[:, None] * least_direction(c[:, 1:], *states.arcs)
        gain = c[:, 0] - (sides * c[:, 1:]).sum(axis=1)
        # Where c vanishes, every component must stay zero; else only the best force may not gain.
        vanishing = unbounded & (np.abs(c).max(axis=1) < _ROUNDING)
        touching = unbounded & ~vanishing & (gain > -_ROUNDING)
        gains = dynamics.rows[:, 0] - np.einsum("li,lin->ln", sides, dynamics.rows[:, 1:])
        rows = np.vstack([dynamics.rows[vanishing].reshape(-1, len(motion)), gains[touching]])
        residual = np.concatenate([c[vanishing].ravel(), gain[touching]])
        if (gain[unbounded] <= _EXACT).all():
            break
        change = least_squares(rows, -residual, 1e-13)
        if change is None:
            break
        motion = motion + change
    return DualBound(motion, dual.normal, dual.tangential)


def fixed_rows(dynamics: Dynamics, states: States) -> FloatArray:
    """Return (k, n) rows along which closed contacts do not part and sticking ones do not slip.

    Dependent rows are left out: what was proven from other rows holds to a tolerance only, which
    would grow if proofs were built on it.
    """
    rows, (closed, sticking) = dynamics.rows, _fixed_contacts(dynamics, states)
    return np.vstack([rows[closed, 0], rows[sticking, 1:].reshape(-1, rows.shape[2])])


def kinematic_dual(
    dynamics: Dynamics, states: States, goal: FloatArray, normal: FloatArray
) -> DualBound:
    """Return multipliers of the fixed rows alone (lambda = 0) that cancel a goal best.

    They solve a least-squares problem.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        goal: (n,) p plus the normal rows times their multipliers.
        normal: (M,) multipliers of those rows.
    """
    fixed = fixed_rows(dynamics, states)
    weights = least_squares(fixed.T, -goal, RANK)
    if weights is None:
        weights = np.zeros(len(fixed))
    nu, kappa = normal.copy(), np.zeros((len(normal), 2))
    closed, sticking = _fixed_contacts(dynamics, states)
    nu[closed] += weights[: closed.sum()]
    kappa[sticking] = weights[closed.sum() :].reshape(-1, 2)
    return DualBound(np.zeros(len(goal)), nu, kappa)


def _fixed_contacts(
    dynamics: Dynamics, states: States
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return masks (M,) of contacts that stay closed and that stick, by their own states alone."""
    closed = states.is_in(ContactState.CLOSED, ContactState.STICKING, ContactState.SLIPPING)
    return closed & ~dynamics.is_commanded & ~states.closes, states.does_not_slip & ~states.sticks


def closing_tolerance(dynamics: Dynamics) -> float:
    """Return the scaled acceleration up to which a contact counts as closed or as sticking.

    Without a tolerance, four corners in one plane known to 16 digits would not close each other.
    A bound grows by the tolerance times the multipliers, some thousand for narrow arcs of slip.
    """
    return min(1e-3 * dynamics.resolution**2, _CLOSING)


def allowed_normals(dynamics: Dynamics, states: States, normal: FloatArray) -> FloatArray:
    """Return nu (M,) restricted to valid values: not negative where a contact may part."""
    may_part = states.is_in(ContactState.FREE, ContactState.OPEN)
    allowed = np.where(may_part, np.maximum(normal, 0.0), normal)
    return np.where(dynamics.is_commanded, 0.0, allowed)


def closing_slack(
    states: States, normal: FloatArray, tangential: FloatArray, least: float = 0.0
) -> float:
    """Return how much the tolerances of closed and sticking contacts add to a bound.

    Args:
        states: Of the contacts.
        normal: (M,) nu.
        tangential: (M, 2) kappa.
        least: Lower limit of the tolerance of each contact, scaled acceleration.
    """
    parting = np.maximum(-normal, 0.0) @ np.maximum(states.parts, least)
    slipping = np.where(states.does_not_slip, np.maximum(states.slips, least), 0.0)
    return float(parting + slipping @ np.hypot(*tangential.T))


def newton_gains(dynamics: Dynamics, states: States, c: FloatArray) -> FloatArray:
    """Return (M,) the largest gain of c_l.f_l per newton of each normal force; c: (M, 3)."""
    normal = np.where(dynamics.is_commanded, 0.0, c[:, 0])
    return normal - dynamics.friction * least_products(c[:, 1:], *states.arcs)


def outcome_bound(
    dynamics: Dynamics,
    states: States,
    loads: FloatArray,
    dual: DualBound,
    goal: tuple[FloatArray, FloatArray],
    force_limit: float,
) -> float:
    """Return an upper bound of p.y + q.f over all outcomes in these states.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        loads: (M,) smallest normal forces of all outcomes, scaled.
        dual: The multipliers.
        goal: p (n,) and q (M, 3).
        force_limit: The bound holds for outcomes with normal forces up to this, scaled.
    """
    p, q = goal
    mu, commanded = dynamics.friction, dynamics.is_commanded
    opened, sticking = states.is_in(ContactState.OPEN), states.does_not_slip
    normal, rows = allowed_normals(dynamics, states, dual.normal), dynamics.rows
    # Contact forces.
    per_newton = newton_gains(dynamics, states, q + rows @ dual.motion)
    low = np.where(commanded, dynamics.commanded, loads)
    high = np.where(commanded, dynamics.commanded, force_limit)
    forces = np.where(opened, 0.0, per_newton * np.where(per_newton > 0.0, high, low)).sum()
    bound = float(dual.motion @ dynamics.load) + float(forces)
    bound += closing_slack(states, normal, dual.tangential, closing_tolerance(dynamics))
    # The worst load of the spread.
    rise = float(dual.motion @ dynamics.load_change + per_newton @ dynamics.commanded_change)
    bound += max(rise, 0.0)
    # Slips against kappa are bounded by friction's power, or by the longest possible slip.
    v = p - dual.motion + normal @ rows[:, 0] + np.einsum("li,lin->n", dual.tangential, rows[:, 1:])
    wrong = np.where(sticking, 0.0, np.maximum(-least_products(dual.tangential, *states.arcs), 0.0))
    power = mu * np.where(opened, 0.0, low + np.minimum(dynamics.commanded_change, 0.0))
    longest = wrong * np.linalg.norm(rows[:, 1:], axis=(1, 2))
    bound += float((v + dual.motion) @ dynamics.free_motion)
    leak = force_limit * float(leak_powers(dynamics, dynamics.free_motion)[~opened].sum())
    return bound + _least_over_beta(wrong, power, longest, v, dynamics.load, leak)


def _least_over_beta(
    wrong: FloatArray,
    power: FloatArray,
    longest: FloatArray,
    v: FloatArray,
    load: FloatArray,
    leak: float,
) -> float:
    """Return the minimum over beta of max_y v.y + beta (h.y + leak - |y|^2), plus terms of slips.

    A contact with beta < wrong / power adds the bound from its longest slip instead.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(wrong > 0.0, wrong / power, 0.0)
    size, along = float(np.linalg.norm(v)), float(v @ load)
    square = float(load @ load) + 4.0 * leak
    least = size / max(np.sqrt(square), _STILL)
    best = np.inf
    for beta in {least, *needed[(needed > least) & (needed < np.inf)].tolist()}:
        ball = 0.25 * (size * size / beta + 2.0 * along + beta * square) if beta > 0.0 else 0.0
        best = min(best, ball + float(longest[needed > beta].sum()))
    return best


class OutcomeBounds:
    """Bounds for one dynamics; multipliers that proved one set are tried on others."""

    def __init__(self, dynamics: Dynamics, loads: FloatArray, force_limit: float) -> None:
        """Start without remembered multipliers. Arguments as of `outcome_bound`."""
        count, n = dynamics.contact_count, len(dynamics.load)
        self._dynamics, self._loads, self._force_limit = dynamics, loads, force_limit
        self._proven: list[DualBound] = []
        self._motions = np.zeros((_REMEMBERED, n))
        self._normals = np.zeros((_REMEMBERED, count))
        self._tangentials = np.zeros((_REMEMBERED, count, 2))
        self._compiled = None
        # A verdict takes 1.3 to 2 times as long with `outcome_bound`, which stays for installations
        # without compiled loops, and to test the loops with.
        if core is not None:
            self._compiled = core.Bounds(
                dynamics.rows, dynamics.load, dynamics.friction, dynamics.commanded,
                dynamics.load_change, dynamics.commanded_change, loads, closing_tolerance(dynamics),
                force_limit, dynamics.free_motion, leak_powers(dynamics, dynamics.free_motion),
            )  # fmt: skip

    def bound(self, states: States, dual: DualBound, goal: tuple[FloatArray, FloatArray]) -> float:
        """Return the value of `outcome_bound`."""
        if self._compiled is None:
            return outcome_bound(self._dynamics, states, self._loads, dual, goal, self._force_limit)
        return self._compiled.bound(
            states.numbers, states.center, states.half_width, states.parts, states.slips,
            dual.motion, dual.normal, dual.tangential, *goal,
        )  # fmt: skip

    def remember(self, dual: DualBound) -> None:
        """Keep multipliers to be tried on other sets; the oldest are dropped when full."""
        place = len(self._proven)
        if place == _REMEMBERED:
            self._proven.pop(0)
            for kept in (self._motions, self._normals, self._tangentials):
                kept[:-1] = kept[1:].copy()
            place -= 1
        self._motions[place], self._normals[place] = dual.motion, dual.normal
        self._tangentials[place] = dual.tangential
        self._proven.append(dual)

    def for_dynamics(self, dynamics: Dynamics, loads: FloatArray) -> OutcomeBounds:
        """Return bounds for other dynamics and loads, with the same remembered multipliers."""
        bounds = OutcomeBounds(dynamics, loads, self._force_limit)
        for dual in self._proven:
            bounds.remember(dual)
        return bounds

    def remembered_proof(self, states: States, goal: FloatArray, enough: float) -> DualBound | None:
        """Return remembered multipliers with which p.y is at most ``enough``; None: there are none.

        Args:
            states: Of the contacts.
            goal: p (n,).
            enough: The bound to be proven.
        """
        if self._compiled is None:
            whole = goal, np.zeros((len(self._loads), 3))
            proving = (dual for dual in reversed(self._proven)
                       if self.bound(states, dual, whole) <= enough)  # fmt: skip
            return next(proving, None)
        place = self._compiled.first(
            states.numbers, states.center, states.half_width, states.parts, states.slips,
            self._motions, self._normals, self._tangentials, goal, len(self._proven), enough,
        )  # fmt: skip
        return None if place < 0 else self._proven[place]
