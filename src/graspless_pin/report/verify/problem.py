"""The problem of a document as arrays, and contact forces with what follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from graspless_pin.report.verify.fields import WHOLE, Part
from graspless_pin.report.verify.own_objective import OwnObjective

MESSAGES = {
    "optimal": "optimal over all feasible virtual-sliding modes",
    "optimal_in_mode": "optimal in the given virtual-sliding mode",
    "limit_reached": "the best found",
    "infeasible_forces": "infeasible: no contact forces",
    "infeasible_modes": "infeasible: forces that balance exist, but none",
    "infeasible_in_mode": "infeasible in the given virtual-sliding mode",
    "infeasible_mode": "the given virtual-sliding mode has no virtual motion",
    "not_found_in_limit": "nothing found",
    "unverified": "no solver gave",
    "load_too_large": "the load is too large",
    "strong": "the best found of the torques that guarantee rest",
    "strong_not_found": "no torques found that guarantee rest",
    "infeasible_strong": "infeasible: no torques guarantee rest",
}
"""How the message of each status begins."""
# What counts as zero in the data: smaller figures are rounding.
_AT_REST = 1e-12
"""Slower sliding counts as none, m/s."""
_LEAST_LEVER = 1e-12
"""Of the longest lever of all joints: shorter ones are raised to this."""
_LEAST_MARGIN = 1e-20
"""Of the smallest limit of normal forces: smaller required margins count as zero."""
_NO_ARM = 1e-12
"""Of the size of their terms: smaller distances and moments are rounding."""


@dataclass(frozen=True, eq=False)
class Problem:
    """The data of the problem, which all checks start from, and the rules.

    Attributes:
        p: (M, 3) contact points about the reference point, m.
        frames: (M, 3, 3) rows n, t1, t2.
        mu: (M,) friction coefficients.
        limit: (M,) largest normal forces, N.
        v: (M, 3) sliding velocities, m/s.
        J: (M, 3, L) contact Jacobian.
        w: (P,) load on the passive coordinates, N and N m: [force; moment] on one object.
        edges: Edges of each cone; 0: they are round.
        corners: (M, r, 2) friction along t1 and t2 at the edges of cones that are neither round nor
            the paper's pyramids, over the normal force; zeros without a cone.
        kinetic: (M, 2) such friction where there is no cone.
        coulombs_law: Whether the cones stand for Coulomb's law.
        lower: (L,) smallest torques.
        upper: (L,) largest torques.
        gravity: (L,) torques that the motors bear besides the contacts.
        units: L units.
        is_moment: (P,) which passive coordinates have loads in N m.
        stated_map: (M, 3, P) from their velocities to those at contacts, world axes; None: they are
            the twist of one object.
        algorithm: ``margin``, ``torque`` or, with an objective of its own, ``own``.
        e0: Required margin, N; 0 in Algorithm 1.
        by_limits: Whether Algorithm 2 counts shares of the limits.
        epsilon: The regularisation.
        sign_rule: ``strict``, ``exact`` or ``nonzero``.
        constrained: Whether contacts in actual sliding have to slide virtually.
        coulomb: Whether friction needs no virtual sliding.
        own: The objective that the document states; None: it is one of the paper's.
    """

    p: np.ndarray
    frames: np.ndarray
    mu: np.ndarray
    limit: np.ndarray
    v: np.ndarray
    J: np.ndarray
    w: np.ndarray
    edges: int
    lower: np.ndarray
    upper: np.ndarray
    gravity: np.ndarray
    units: tuple[str, ...]
    algorithm: str
    e0: float
    by_limits: bool
    epsilon: float
    sign_rule: str
    constrained: bool
    coulomb: bool
    is_moment: np.ndarray
    stated_map: np.ndarray | None
    own: OwnObjective | None = None
    corners: np.ndarray | None = None
    kinetic: np.ndarray | None = None
    coulombs_law: bool = True

    @property
    def count(self) -> int:
        """M, the number of contacts."""
        return len(self.p)

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Sizes of the dimensions of shapes by letter, see `fields`."""
        M, L, P = self.count, len(self.units), len(self.w)
        k = 0 if self.own is None else len(self.own.cost)
        return {"M": M, "L": L, "P": P, "r": self.edges, "k": k}

    def part(self, stated: object, where: str = WHOLE, kind: str = "document") -> Part:
        """Return a mapping of this problem's document as a part."""
        return Part(kind, stated, where, self.sizes)

    @cached_property
    def passive(self) -> np.ndarray:
        """(M, 3, P) map from passive velocities to those at contacts, world axes; W^T."""
        if self.stated_map is not None:
            return self.stated_map
        x, y, z = self.p.T
        o = np.zeros_like(x)
        turning = np.array([[o, z, -y], [-z, o, x], [y, -x, o]]).transpose(2, 0, 1)
        return np.concatenate([np.broadcast_to(np.eye(3), turning.shape), turning], axis=2)

    @cached_property
    def passive_scale(self) -> np.ndarray:
        """(P,) scale of each row of the balance under the load, N and N m."""
        return np.where(self.is_moment, self.force * self.length, self.force)

    @cached_property
    def points(self) -> np.ndarray:
        """(M + k, 3, P) map to the velocities that decide rest: of contacts and object's centre.

        Of a stated map they are those at contacts, and each passive coordinate's own times its
        lever, one below the other.
        """
        if self.stated_map is None:
            centre = np.concatenate([np.eye(3), np.zeros((3, 3))], axis=1)
            return np.concatenate([self.passive, centre[None]])
        own = np.zeros((len(self.w), 3, len(self.w)))
        own[:, 0] = np.diag(self.levers)
        return np.concatenate([self.passive, own])

    @cached_property
    def levers(self) -> np.ndarray:
        """(P,) m (1): largest acceleration of a point by a unit of each passive acceleration.

        Of a stated map `length` for loads in N m, and for those in N the longest three entries at a
        contact, or 1.
        """
        if self.stated_map is None:
            return np.repeat([1.0, float(np.linalg.norm(self.p, axis=1).max())], 3)
        longest = np.linalg.norm(self.stated_map, axis=1).max(axis=0)
        return np.where(self.is_moment, self.length, np.maximum(longest, 1.0))

    @cached_property
    def goal_weight(self) -> float:
        """Divisor of the limit for each acceleration, so that no point exceeds the limit.

        Of an object three linear ones up to limit / (2 sqrt(3)) are a vector up to limit / 2, and
        so are the angular ones times the longest lever.
        """
        return 2.0 * np.sqrt(3.0) if self.stated_map is None else float(len(self.w))

    def mass(self, inertia: np.ndarray) -> float:
        """Return the largest mass of the passive coordinates, kg.

        Args:
            inertia: (P, P) or more, of them and then of the joints.
        """
        own = inertia.diagonal()[: len(self.w)]
        if self.is_moment.all():
            return float(own.max()) / self.length**2
        return float(own[~self.is_moment].max())

    @property
    def is_round(self) -> bool:
        """Whether the cones are round."""
        return self.edges == 0

    @property
    def is_margin(self) -> bool:
        """Whether this is Algorithm 1."""
        return self.algorithm == "margin"

    @property
    def maximizes(self) -> bool:
        """Whether stated figures are those of minus the objective."""
        return self.is_margin if self.own is None else self.own.maximizes

    @cached_property
    def slides(self) -> np.ndarray:
        """(M,) contacts in actual sliding."""
        return np.linalg.norm(self.v, axis=1) > _AT_REST

    @cached_property
    def has_cone(self) -> np.ndarray:
        """(M,) contacts with a friction cone."""
        return ~self.slides & (self.mu > 0.0)

    @cached_property
    def kinetic_directions(self) -> np.ndarray:
        """(M, 3) force per newton of normal force where there is no cone, n - mu v / |v|."""
        if self.kinetic is not None:
            return self.frames[:, 0] + np.einsum("lj,ljk->lk", self.kinetic, self.frames[:, 1:])
        speed = np.where(self.slides, np.linalg.norm(self.v, axis=1), 1.0)
        kinetic = np.where(self.slides, self.mu, 0.0)[:, None] * self.v / speed[:, None]
        return self.frames[:, 0] - kinetic

    @cached_property
    def candidates(self) -> np.ndarray:
        """(M,) contacts that a mode may select."""
        return self.has_cone | self.slides if self.constrained else self.has_cone

    @cached_property
    def length(self) -> float:
        """L, the distance of the farthest contact from the contacts' centre, m.

        Of a stated map it is the longest lever of a load in N m: three entries at a contact.
        """
        if self.stated_map is not None:
            longest = float(
                np.linalg.norm(self.stated_map, axis=1)[:, self.is_moment].max(initial=0.0)
            )
            force, moment = self._load_sizes
            return longest or (moment / force if force > 0.0 and moment > 0.0 else 1.0)
        farthest = float(np.linalg.norm(self.p - self.p.mean(axis=0), axis=1).max())
        force, moment = self._load_sizes
        reach = float(np.linalg.norm(self.p, axis=1).max())
        if farthest > _NO_ARM * reach:
            return farthest
        least = _NO_ARM * (float(np.linalg.norm(self.w[3:])) + reach * force)
        return moment / force if force > 0.0 and moment > least else 1.0

    @cached_property
    def force(self) -> float:
        """F, the load, N; without one the required margin, or else the smallest limit."""
        force, moment = self._load_sizes
        limit = float(self.limit.min())
        counts = 0.0 < self.e0 >= _LEAST_MARGIN * limit
        by_margin = counts and not self.is_margin and not self.w.any()
        return max(force, moment / self.length) or (self.e0 if by_margin else limit)

    @property
    def _load_sizes(self) -> tuple[float, float]:
        """Size of the external force, and of the external moment about the contacts' centre.

        Beside a stated map, of all loads in N and of all in N m.
        """
        if self.stated_map is not None:
            parts = self.w[~self.is_moment], self.w[self.is_moment]
            return float(np.linalg.norm(parts[0])), float(np.linalg.norm(parts[1]))
        moment = self.w[3:] - np.cross(self.p.mean(axis=0), self.w[:3])
        return float(np.linalg.norm(self.w[:3])), float(np.linalg.norm(moment))

    @cached_property
    def joint_scale(self) -> np.ndarray:
        """(L,) torque of the load at each joint's longest lever, N m (N)."""
        levers = np.linalg.norm(self.J, axis=1).max(axis=0)
        longest = float(levers.max(initial=0.0))
        if longest == 0.0:
            return np.full(len(levers), self.force * self.length)
        return self.force * np.maximum(levers, _LEAST_LEVER * longest)

    @cached_property
    def share_torques(self) -> tuple[np.ndarray, np.ndarray]:
        """(L,) each: torque that is a share of 1 upwards and downwards; 0: the side has none."""
        if self.algorithm != "torque":
            return np.zeros(len(self.upper)), np.zeros(len(self.upper))
        if not self.by_limits:
            return np.ones(len(self.upper)), np.ones(len(self.upper))
        up = np.where(np.isfinite(self.upper), np.maximum(self.upper, 0.0), 0.0)
        down = np.where(np.isfinite(self.lower), np.maximum(-self.lower, 0.0), 0.0)
        return up, down

    @cached_property
    def unit(self) -> float:
        """Scale of the objective: N, N m, or a share of the limits."""
        if self.own is not None:
            return self.own.unit
        if self.is_margin:
            return self.force
        if not self.by_limits:
            return float(self.joint_scale.max(initial=0.0)) or self.force
        up, down = self.share_torques
        limits = np.concatenate([up, down])
        shares = np.tile(self.joint_scale, 2)[limits > 0.0] / limits[limits > 0.0]
        return min(float(shares.max(initial=0.0)), 1.0) or 1.0

    @cached_property
    def curvature(self) -> np.ndarray:
        """(M, 3) second derivatives of the objective by forces, in its unit per N^2."""
        if self.own is not None:
            return self.own.force_curvature
        curved = np.ones((self.count, 3))
        curved[:, 0] = np.where(self.has_cone, 1.0, (self.kinetic_directions**2).sum(axis=1))
        return self.epsilon * self.unit / self.force**2 * curved

    def has_normal_rows(self, name: str) -> bool:
        """Whether limits of normal forces are rows: ``normal_upper`` or ``normal_lower``."""
        return self.is_margin if self.own is None else name in self.own.keeps

    @cached_property
    def normal_range(self) -> tuple[np.ndarray, np.ndarray]:
        """(M,) each: bounds of the normal forces, N."""
        if self.own is not None:
            least, most = self.own.normal_range
            return np.maximum(least, 0.0), np.minimum(most, self.limit)
        return np.where(self.has_cone, 0.0, self.e0), self.limit - self.e0

    @cached_property
    def face_margins(self) -> np.ndarray:
        """(M,) constant margins in the rows of the cones' faces, N."""
        return np.full(self.count, self.e0) if self.own is None else self.own.margins

    def faces(self, contact: int) -> np.ndarray:
        """(r, 3) unit outward face normals in (n, t1, t2) coordinates; none of round cones."""
        if self.is_round:
            return np.zeros((0, 3))
        if self.corners is not None:
            return faces_between(self.corners[contact])
        angles = 2.0 * np.pi * (np.arange(self.edges) + 0.5) / self.edges
        slope = self.mu[contact] * np.cos(np.pi / self.edges)
        rows = np.column_stack([np.full(self.edges, -slope), np.cos(angles), np.sin(angles)])
        return rows / np.sqrt(1.0 + slope**2)

    def objective(self, forces: Forces) -> float:
        """Return the minimised objective at forces: -e or t, plus the regularisation."""
        if self.own is not None:
            return self.own.cost_of(forces.local, forces.columns)
        curved = 0.5 * self.epsilon * self.unit / self.force**2 * float((forces.f**2).sum())
        if self.is_margin:
            return curved - forces.margin
        return curved + self.largest_share(forces.torques, -forces.torques)

    def largest_share(self, upward: np.ndarray, downward: np.ndarray) -> float:
        """Return the t of Algorithm 2 at torques: the largest torque, or share of a limit.

        Args:
            upward: (..., L) largest torques upward.
            downward: (..., L) largest torques downward, positive that way.
        """
        up, down = self.share_torques
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = [
                np.where(limit > 0.0, torques / limit, 0.0)
                for limit, torques in ((up, upward), (down, downward))
            ]
        return float(np.concatenate(shares).max(initial=0.0))


def faces_between(corners: np.ndarray) -> np.ndarray:
    """(r, 3) unit outward face normals in (n, t1, t2) coordinates of a cone with these edges.

    Args:
        corners: (r, 2) friction at the edges over the normal force, counterclockwise.
    """
    x, y = (np.roll(corners, -1, axis=0) - corners).T
    rows = np.column_stack([-(corners * np.column_stack([y, -x])).sum(axis=1), y, -x])
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


class Forces:
    """Contact forces and what follows from them.

    Attributes:
        f: (M, 3) N.
        local: (M, 3) along n, t1, t2.
        contact_torques: (L,) torques of the contact forces.
        torques: (L,) torques of the motors.
        columns: (k,) columns of the objective's own.
    """

    def __init__(self, problem: Problem, f: np.ndarray, columns: np.ndarray | None = None) -> None:
        """Work out components and torques."""
        self.columns = np.zeros(0) if columns is None else columns
        self.f, self._problem = f, problem
        self.local = np.einsum("lij,lj->li", problem.frames, f)
        self.contact_torques = np.einsum("lij,li->j", problem.J, f)
        self.torques = self.contact_torques + problem.gravity

    @cached_property
    def faces(self) -> np.ndarray:
        """(M,) distance of each force outside its cone, N; negative inside, -inf without a cone."""
        mu = self._problem.mu
        if self._problem.is_round:
            away = np.linalg.norm(self.local[:, 1:], axis=1) - mu * self.local[:, 0]
            return np.where(self._problem.has_cone, away / np.sqrt(1.0 + mu**2), -np.inf)
        outside = np.full(self._problem.count, -np.inf)
        for c in np.flatnonzero(self._problem.has_cone).tolist():
            outside[c] = (self._problem.faces(c) @ self.local[c]).max()
        return outside

    @property
    def outside(self) -> float:
        """The largest distance of a force outside its cone, N; negative: all are inside."""
        return float(self.faces.max())

    @cached_property
    def margin(self) -> float:
        """The margin e that the forces keep, N."""
        normal = self.local[:, 0]
        margin = min(float(normal.min()), float((self._problem.limit - normal).min()))
        return min(margin, -self.outside)
