"""Bounds that multipliers prove for all outcomes in which contacts are in given states.

An outcome is a set of accelerations of object and joints and of contact forces that obeys the laws
of rigid bodies and of Coulomb. Scaled as `RestDynamics` says, y = A^T f + h, u = A y, and
|y|^2 + sum mu f_n |u_t| = h.y. For any multipliers lambda, nu and kappa, and beta >= 0, with
c = q + A lambda and v = p - lambda + sum (nu A_n + kappa.A_t), the goal p.y + q.f is therefore at
most

    lambda.h + sum c.f + v.y + beta (h.y - |y|^2) - sum (kappa.u_t + beta mu f_n |u_t|) - nu.u_n.

The free motion of joints while contacts are open, w, may be separated: then y' = y - w has
y' = A^T f + h - w, and |y'|^2 + sum mu f_n |u_t| = (h - w).y' less the power of forces along w.

For any load h + theta s between two, the outcomes considered are those that have
|y|^2 + sum mu f_n |u_t| <= h.y, and lambda.h is the largest of lambda.(h + theta s).

The power of kinetic friction has no sign: then linear duality alone bounds the accelerations. For
all multipliers, with lambda = p + sum (nu A_n + kappa.A_t) and y = B^T f + h,

    p.y = lambda.h + sum (B lambda).f - sum (nu u_n + kappa.u_t).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.rest_patches import PatchSlip

_LONG = np.longdouble


class Kind(StrEnum):
    """The known state of one contact in a set of outcomes."""

    FREE = "free"
    OPEN = "open"
    CLOSED = "closed"
    STICKING = "sticking"
    SLIPPING = "slipping"


@dataclass(frozen=True, eq=False)
class RestDynamics:
    """Equations of motion with M = C C^T, g the load on object and joints, H = |C^-1 g|.

    Attributes:
        rows: (M, 3, n) A = G C^-T / alpha along n, t1, t2; zero along a commanded normal.
        pushes: (M, 3, n) B, y = B^T f + h: A, but along n - mu v/|v| and zeros where one slides.
        load: (n,) h = C^-1 g / H, a unit vector.
        friction: (M,), zero where one slides.
        commanded: (M,) forces that hybrid fingers command, scaled; NaN elsewhere.
        force_unit: H / alpha, N, with alpha the longest row of G C^-T.
        accelerations: (P + L, n) H C^-T, zero for hybrid fingers' columns.
        points: (M + k, 3, n) from y to accelerations, m/s^2, of `Problem.points`.
        passive: P.
        load_change: (n,) s, what theta from 0 to 1 adds to the load; zero: there is one load.
        free_motion: (n,) w, the free motion of joints, which y and the load are without.
    """

    rows: np.ndarray
    pushes: np.ndarray
    load: np.ndarray
    friction: np.ndarray
    commanded: np.ndarray
    force_unit: float
    accelerations: np.ndarray
    points: np.ndarray
    passive: int
    load_change: np.ndarray
    free_motion: np.ndarray

    @property
    def reach(self) -> float:
        """The largest acceleration of a point at |y| = 1, m/s^2."""
        return float(np.linalg.norm(self.points, ord=2, axis=(1, 2)).max())

    def towards(self, other: RestDynamics | None) -> RestDynamics:
        """Return them for any load up to that of other dynamics of these bodies; None: no load."""
        load = np.zeros_like(self.load)
        if other is not None:
            load = other.force_unit / self.force_unit * other.load
        return replace(self, load_change=load - self.load)


def contact_motion(problem: Problem) -> np.ndarray:
    """(M, 3, P + L) G in contact frames: accelerations of the object relative to the others.

    Entries of a stated map that are rounding become zero: else forces without bound resist a
    motion.
    """
    motion = problem.frames @ np.concatenate([problem.passive, -problem.J], axis=2)
    if problem.stated_map is not None:
        size = np.linalg.norm(motion, axis=1, keepdims=True)
        motion[np.abs(motion) <= tolerances.PRODUCT * size] = 0.0
    return motion


def force_motion(problem: Problem) -> np.ndarray:
    """(M, 3, P + L) G for forces: along n - mu v/|v| and zeros where a contact slides."""
    motion, slides = contact_motion(problem), problem.slides
    along = np.einsum("lij,lj->li", problem.frames, problem.kinetic_directions)[slides]
    motion[slides, 0] = np.einsum("li,lik->lk", along, motion[slides])
    motion[slides, 1:] = 0.0
    return motion


def commanded_contacts(problem: Problem, joint_inertia: np.ndarray) -> np.ndarray:
    """(L,) contact whose normal force a column commands; -1: a joint."""
    contacts = np.full(len(problem.units), -1)
    acts = (problem.J != 0.0).any(axis=1).reshape(problem.count, -1)
    for column in np.flatnonzero(~joint_inertia.any(axis=0)).tolist():
        where = np.flatnonzero(acts[:, column]).tolist()
        if len(where) == 1 and acts[where[0]].sum() == 1:
            off = problem.J[where[0], :, column] - problem.frames[where[0], 0]
            contacts[column] = where[0] if np.abs(off).max() <= tolerances.UNIT else -1
    return contacts


def rest_dynamics(
    problem: Problem, load: np.ndarray, inertia: np.ndarray, hybrid: np.ndarray
) -> RestDynamics | None:
    """Return the scaled dynamics; None without a load and without declared sliding with friction.

    Args:
        problem: Contacts and joints.
        load: (P + L,) external wrench, and torques less those that bear the links' weight.
        inertia: (P + L, P + L).
        hybrid: (L,) of `commanded_contacts`.
    """
    motion, acting, given = contact_motion(problem), force_motion(problem), load.copy()
    passive = len(problem.w)
    commanded = np.full(problem.count, np.nan)
    for column in np.flatnonzero(hybrid >= 0):
        contact = hybrid[column]
        commanded[contact] = load[passive + column]
        given[:passive] += load[passive + column] * acting[contact, 0, :passive]
        motion[contact, 0] = acting[contact, 0] = 0.0
    kept = np.concatenate([np.ones(passive, dtype=bool), hybrid < 0])
    back = np.linalg.inv(np.linalg.cholesky(inertia[np.ix_(kept, kept)])).T
    h = back.T @ given[kept]
    size = float(np.linalg.norm(h))
    if size == 0.0:
        if not (problem.slides & (problem.mu > 0.0)).any():
            return None
        size = 1.0
    rows = motion[:, :, kept] @ back
    alpha = float(np.linalg.norm(rows, axis=2).max()) or 1.0  # 0: no contact moves
    accelerations = np.zeros((len(load), len(h)))
    accelerations[kept] = size * back
    points = problem.points @ accelerations[:passive]
    friction = np.where(problem.slides, 0.0, problem.mu)
    return RestDynamics(rows / alpha, acting[:, :, kept] @ back / alpha, h / size, friction,
                    commanded * alpha / size, size / alpha, accelerations, points, passive,
                    np.zeros_like(h), np.zeros_like(h))  # fmt: skip


_LEAK = 0.1
"""Of the power of rest: largest power of contacts along a separated motion."""


def without_free_joints(
    dynamics: RestDynamics, opened: np.ndarray, still: float, force_limit: float
) -> RestDynamics:
    """Return the dynamics without the free motion of joints while some contacts are open.

    That is the part of the load along motions in which no passive coordinate and no other contact
    takes part. Any w is sound, as `leaked_power` counts the power of contacts along it.

    Args:
        dynamics: The scaled dynamics, with nothing separated yet.
        opened: (M,) contacts that are open.
        still: The power up to which nothing moves, scaled.
        force_limit: Normal forces are at most this, scaled.
    """
    passive, size = dynamics.passive, len(dynamics.load)
    if size == passive or dynamics.load_change.any():
        return dynamics
    rows = dynamics.rows[~opened].reshape(-1, size)
    rows = np.concatenate([rows, dynamics.accelerations[:passive]])
    lengths = np.linalg.norm(rows, axis=1)
    rows = rows[lengths > 0.0] / lengths[lengths > 0.0, None]
    _, sizes, turns = np.linalg.svd(rows)
    free = turns[int((sizes > tolerances.FREE_RANK * sizes.max()).sum()) :]
    w = free.T @ (free @ dynamics.load)
    w[np.abs(w) < tolerances.FREE_ENTRY * np.abs(w).max()] = 0.0
    changed = replace(dynamics, load=dynamics.load - w, free_motion=w)
    if (
        np.linalg.norm(w) <= tolerances.LEAST_ASIDE
        or leaked_power(changed, opened, force_limit) >= _LEAK * still
    ):
        return dynamics
    return changed


def leaked_power(dynamics: RestDynamics, opened: np.ndarray, force_limit: float) -> float:
    """Return the largest power of contacts that are not open along the separated motion, scaled."""
    w, rows = dynamics.free_motion.astype(_LONG), dynamics.rows[~opened].astype(_LONG)
    moved = np.abs(rows @ w) + tolerances.rounding_error(np.abs(rows) @ np.abs(w))
    share = np.sqrt(1.0 + dynamics.friction[~opened] ** 2)
    return float(force_limit * (share * np.linalg.norm(moved, axis=1)).sum())


@dataclass(frozen=True, eq=False)
class RestMultipliers:
    """Multipliers of the dynamics (n,), the normal (M,) and the tangential accelerations (M, 2)."""

    motion: np.ndarray
    normal: np.ndarray
    tangential: np.ndarray

    def reversed(self) -> RestMultipliers:
        """Return the negated multipliers."""
        return RestMultipliers(-self.motion, -self.normal, -self.tangential)


@dataclass(frozen=True, eq=False)
class KnownStates:
    """The known states of all contacts in a set of outcomes.

    Attributes:
        kinds: M states: an open contact has no force; a closed one does not part; a sticking one
            does not slip, either; a slipping one slips in its arc, with friction against it.
        center: (M,) middle of the arc, from t1 to t2, rad.
        half_width: (M,) rad; pi: any direction. Of contacts in patches that slip, in any state.
        parts: (M,) largest u_n of a contact that counts as closed.
        slips: (M,) largest |u_t| of a contact that counts as sticking.
        still: (M,) contacts that do not slip with their patch, in any state.
        patches: Known slips of patches.
    """

    kinds: tuple[Kind, ...]
    center: np.ndarray
    half_width: np.ndarray
    parts: np.ndarray
    slips: np.ndarray
    still: np.ndarray
    patches: tuple[PatchSlip, ...] = ()

    @classmethod
    def all_free(cls, count: int) -> KnownStates:
        """Return the states of all outcomes."""
        zeros = np.zeros(count)
        whole, nowhere = np.full(count, np.pi), np.zeros(count, dtype=bool)
        return cls((Kind.FREE,) * count, zeros, whole, zeros, zeros, nowhere)

    def is_in(self, *kinds: Kind) -> np.ndarray:
        """Return which contacts are in one of some states, (M,)."""
        return np.array([kind in kinds for kind in self.kinds])

    def with_state(
        self, contact: int, kind: Kind, arc: tuple[float, float] = (0.0, np.pi), most: float = 0.0
    ) -> KnownStates:
        """Return these states with one contact's replaced.

        Args:
            contact: Its index.
            kind: Its state.
            arc: Middle and half width of the arc of its slip, rad.
            most: Largest parting or slip that the state still allows.
        """
        kinds = (*self.kinds[:contact], kind, *self.kinds[contact + 1 :])
        center, half_width = self.center.copy(), self.half_width.copy()
        if kind in (Kind.SLIPPING, Kind.STICKING):
            center[contact], half_width[contact] = arc
        changed = replace(self, kinds=kinds, center=center, half_width=half_width)
        name = {Kind.CLOSED: "parts", Kind.STICKING: "slips"}.get(kind)
        if name is None:
            return changed
        allowed = getattr(self, name).copy()
        allowed[contact] = max(float(allowed[contact]), most)
        return replace(changed, **{name: allowed})

    def known_slip(self, patch: PatchSlip) -> PatchSlip | None:
        """Return the known slip of a patch; None: nothing is known."""
        return next((one for one in self.patches if one.contacts == patch.contacts), None)

    def with_patch(self, patch: PatchSlip, most: float) -> KnownStates:
        """Return these states with the slip of a patch; up to ``most`` counts as no slip."""
        contacts = [*patch.contacts]
        patches = (*(one for one in self.patches if one.contacts != patch.contacts), patch)
        if patch.cone is None:
            still, slips = self.still.copy(), self.slips.copy()
            still[contacts] = True
            sticks = self.is_in(Kind.STICKING)[contacts]  # known more closely on its own
            slips[contacts] = np.where(sticks, slips[contacts], np.maximum(slips[contacts], most))
            return replace(self, still=still, slips=slips, patches=patches)
        center, half_width = self.center.copy(), self.half_width.copy()
        # Of a contact that was split on its own the arc is known more closely.
        free = ~self.is_in(Kind.SLIPPING)[contacts]
        center[contacts] = np.where(free, patch.arcs[:, 0], center[contacts])
        half_width[contacts] = np.where(free, patch.arcs[:, 1], half_width[contacts])
        return replace(self, center=center, half_width=half_width, patches=patches)


def least_product(vectors: np.ndarray, center: np.ndarray, half_width: np.ndarray) -> np.ndarray:
    """(M,) smallest product of each vector (M, 2) with a unit vector of its arc."""
    turned = np.arctan2(vectors[:, 1], vectors[:, 0]) - center
    away = np.abs((turned + np.pi) % (2.0 * np.pi) - np.pi)
    return np.linalg.norm(vectors, axis=1) * np.cos(np.minimum(away + half_width, np.pi))


def allowed_normals(dynamics: RestDynamics, states: KnownStates, normal: np.ndarray) -> np.ndarray:
    """(M,) the admissible part of the stated nu, in the longest format.

    Negative ones are zero where a contact may part, and all where a normal is commanded.
    """
    may_part = states.is_in(Kind.FREE, Kind.OPEN)
    nu = np.where(may_part, np.maximum(normal, 0.0), normal)
    return np.where(np.isfinite(dynamics.commanded), 0.0, nu).astype(_LONG)


def largest_force_terms(
    dynamics: RestDynamics,
    states: KnownStates,
    half_width: np.ndarray,
    slope: tuple[np.ndarray, np.ndarray],
    commanded: np.ndarray,
    loads: np.ndarray,
    force_limit: float,
) -> np.ndarray:
    """(M,) upper bound on c.f at each contact, with the rounding error.

    Friction is mu f_n against the slip: within the cone, or on the arc.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        half_width: (M,) of the arcs of slip around the states' centers, rad; pi: within the cone.
        slope: (M, 3) c, and the sums of its terms' sizes.
        commanded: (M,) c along n where the normal force is commanded: that is in the load.
        loads: (M,) normal forces that every outcome has at least, scaled.
        force_limit: Normal forces are at most this, scaled.
    """
    (c, sizes), fixed, mu = slope, np.isfinite(dynamics.commanded), dynamics.friction
    gain = np.where(fixed, commanded, c[:, 0])
    gain = gain - mu * least_product(c[:, 1:], states.center, half_width)
    gain = gain + tolerances.rounding_error(sizes[:, 0] + mu * sizes[:, 1:].sum(axis=1))
    least, most = (np.where(fixed, dynamics.commanded, one) for one in (loads, force_limit))
    return np.where(states.is_in(Kind.OPEN), 0.0, np.maximum(gain * least, gain * most))


def largest_goal(
    dynamics: RestDynamics,
    states: KnownStates,
    loads: np.ndarray,
    multipliers: RestMultipliers,
    goal: tuple[np.ndarray, np.ndarray],
    force_limit: float,
) -> float:
    """Return an upper bound on p.y + q.f over all outcomes in these states.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        loads: (M,) normal forces that every outcome has at least, scaled.
        multipliers: lambda, nu and kappa.
        goal: p (n,) and q (M, 3).
        force_limit: Normal forces are at most this, scaled.
    """
    (p, q), mu = goal, dynamics.friction
    rows, motion = dynamics.rows.astype(_LONG), multipliers.motion.astype(_LONG)
    sticks = states.is_in(Kind.STICKING) | states.still
    center, half_width = states.center, np.where(sticks, np.pi, states.half_width)
    nu = allowed_normals(dynamics, states, multipliers.normal)
    kappa = multipliers.tangential.astype(_LONG)
    slope = q + rows @ motion, np.abs(q) + np.abs(rows) @ np.abs(motion)
    pushed = largest_force_terms(dynamics, states, half_width, slope, q[:, 0], loads, force_limit)
    towards = np.maximum(motion @ dynamics.load_change, 0.0)
    parting = np.maximum(-nu, 0.0) * states.parts
    slipping = (np.linalg.norm(kappa, axis=1) * states.slips)[sticks]
    bound = motion @ dynamics.load + pushed.sum() + towards + parting.sum() + slipping.sum()
    size = np.abs(motion) @ (np.abs(dynamics.load) + np.abs(dynamics.load_change))
    size += np.abs(pushed).sum() + parting.sum() + slipping.sum()
    # beta mu f_n |u_t| covers -kappa.u_t, or the longest slip does, since |y| <= 1.
    wrong = np.where(sticks, 0.0, np.maximum(-least_product(kappa, center, half_width), 0.0))
    lengths = np.linalg.norm(rows[:, 1:], axis=(1, 2))
    v = p - motion + nu @ rows[:, 0] + np.einsum("li,lin->n", kappa, rows[:, 1:])
    size += np.abs(p).sum() + np.abs(motion).sum() + np.abs(nu) @ np.abs(rows[:, 0]).sum(axis=1)
    size += (np.abs(kappa)[:, :, None] * np.abs(rows[:, 1:])).sum()
    size += np.where(sticks, 0.0, np.linalg.norm(kappa, axis=1)) @ lengths
    bound += (v + motion) @ dynamics.free_motion
    size += (np.abs(v) + np.abs(motion)) @ np.abs(dynamics.free_motion)
    opened = states.is_in(Kind.OPEN)
    leak = leaked_power(dynamics, opened, force_limit) if dynamics.free_motion.any() else 0.0
    least = np.where(np.isfinite(dynamics.commanded), dynamics.commanded, loads)
    bound += _power_bound(wrong, mu * least, wrong * lengths, v, dynamics.load, leak)
    return float(bound + tolerances.rounding_error(size))


def _power_bound(
    wrong: np.ndarray,
    power: np.ndarray,
    longest: np.ndarray,
    v: np.ndarray,
    h: np.ndarray,
    leak: float,
) -> np.longdouble:
    """Return the least over beta of max_y [v.y + beta (h.y + leak - |y|^2)] plus uncovered slips.

    A slip that beta does not cover counts as the longest slip.
    """
    best = _LONG(np.inf)
    usual = np.linalg.norm(v) / np.maximum(np.sqrt(h @ h + 4.0 * leak), tolerances.LEAST_LOAD)
    needed = np.where(power > 0.0, wrong / np.where(power > 0.0, power, 1.0), np.inf)
    needed = np.where(wrong > 0.0, needed, 0.0)
    for beta in (usual, *needed[(needed > usual) & np.isfinite(needed)]):
        ball = ((v + beta * h) ** 2).sum() / (4.0 * beta) + beta * leak if beta > 0.0 else 0.0
        best = min(best, ball + longest[needed > beta].sum())
    return best


def declared_motion_goals(dynamics: RestDynamics, problem: Problem, limit: float) -> np.ndarray:
    """(2 P + 1, n) goals p: while p.y is at most 1 for each, all points count as at rest.

    The first one is zero. The others are both signs of each passive acceleration times its lever,
    over the share of the limit that `Problem.goal_weight` leaves to it.

    Args:
        dynamics: The scaled dynamics.
        problem: The problem of the dynamics: its levers count.
        limit: Accelerations of points up to this are none, m/s^2.
    """
    scale = problem.levers[:, None] * (problem.goal_weight / limit)
    scaled = scale * dynamics.accelerations[: dynamics.passive]
    return np.concatenate([np.zeros((1, scaled.shape[1])), scaled, -scaled])


def declared_motion_bound(
    dynamics: RestDynamics,
    states: KnownStates,
    multipliers: RestMultipliers,
    goal: np.ndarray,
    force_limit: float,
) -> float:
    """Return an upper bound on p.y over all outcomes in these states, under declared sliding.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        multipliers: nu and kappa; lambda follows from them.
        goal: p (n,).
        force_limit: Normal forces are at most this, scaled.
    """
    rows, pushes = dynamics.rows.astype(_LONG), dynamics.pushes.astype(_LONG)
    nu, mu = allowed_normals(dynamics, states, multipliers.normal), dynamics.friction
    sticks, slips = states.is_in(Kind.STICKING), states.is_in(Kind.SLIPPING)
    kappa = multipliers.tangential.astype(_LONG)
    half_width = np.where(slips, states.half_width, np.pi)
    motion = goal + nu @ rows[:, 0] + np.einsum("li,lin->n", kappa, rows[:, 1:])
    rough = np.abs(goal) + np.abs(nu) @ np.abs(rows[:, 0])
    rough = rough + np.einsum("li,lin->n", np.abs(kappa), np.abs(rows[:, 1:]))
    slope, zeros = (pushes @ motion, np.abs(pushes) @ rough), np.zeros(len(rows))
    pushed = largest_force_terms(dynamics, states, half_width, slope, zeros, zeros, force_limit)
    # A bound on -kappa.u_t, with the longest slip that such forces cause.
    wrong = np.maximum(-least_product(kappa, states.center, half_width), 0.0)
    wrong = wrong + tolerances.rounding_error(np.linalg.norm(kappa, axis=1))
    wrong = np.where(sticks, 0.0, wrong) @ np.linalg.norm(rows[:, 1:], axis=(1, 2))
    fixed, opened = np.isfinite(dynamics.commanded), states.is_in(Kind.OPEN)
    most = np.where(opened, 0.0, np.where(fixed, dynamics.commanded, force_limit))
    longest = np.linalg.norm(pushes, axis=2)
    fastest = most @ (longest[:, 0] + mu * longest[:, 1:].sum(axis=1))
    bound = motion @ dynamics.load + pushed.sum()
    bound += wrong * (np.linalg.norm(dynamics.load) + fastest)
    size = rough @ np.abs(dynamics.load) + np.abs(pushed).sum()
    return float(bound + tolerances.rounding_error(size))


def least_force(
    dynamics: RestDynamics,
    states: KnownStates,
    loads: np.ndarray,
    proof: tuple[int, RestMultipliers],
    limit: float,
) -> float:
    """Return a lower bound on the normal force at a contact over all outcomes, scaled.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        loads: (M,) normal forces that are known, scaled.
        proof: The contact, and multipliers.
        limit: Normal forces up to which it has to hold, scaled.
    """
    contact, multipliers = proof
    q = np.zeros(dynamics.rows.shape[:2])
    q[contact, 0] = -1.0
    goal = np.zeros(len(dynamics.load)), q
    return -largest_goal(dynamics, states, loads, multipliers, goal, limit)
