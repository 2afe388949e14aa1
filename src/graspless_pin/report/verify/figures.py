"""The figures of a document as arrays: the problem, the rules, and what is stated of the answer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from graspless_pin.report.verify.values import (
    MOST,
    array,
    entry,
    items,
    number,
    text,
    truth,
    whole,
    word,
)

CHECKED_FORMAT = 2
LONGEST_REACH = 1e8
"""Bounds need to be proven for normal forces up to so many loads."""
FOUND_STATES = ("optimal", "optimal_in_mode", "limit_reached")
INFEASIBLE = ("infeasible_forces", "infeasible_modes", "infeasible_in_mode", "infeasible_mode")
OPEN = ("not_found_in_limit", "unverified")
IN_MODE = ("optimal_in_mode", "infeasible_in_mode", "infeasible_mode")
_AT_REST = 1e-12
_LEAST_LEVER = 1e-12


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
        w: (6,) external wrench, N and N m.
        edges: Edges of each cone.
        lower: (L,) smallest torques.
        upper: (L,) largest torques.
        gravity: (L,) torques that the motors bear besides the contacts.
        units: L units.
        algorithm: ``margin`` or ``torque``.
        e0: Required margin, N; 0 in Algorithm 1.
        by_limits: Whether Algorithm 2 counts shares of the limits.
        epsilon: The regularisation.
        sign_rule: ``strict``, ``exact`` or ``nonzero``.
        constrained: Whether contacts in actual sliding have to slide virtually.
        coulomb: Whether no virtual sliding is asked for.
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

    @property
    def count(self) -> int:
        """M."""
        return len(self.p)

    @property
    def is_margin(self) -> bool:
        """Whether this is Algorithm 1."""
        return self.algorithm == "margin"

    @cached_property
    def slides(self) -> np.ndarray:
        """(M,) contacts in actual sliding."""
        return np.linalg.norm(self.v, axis=1) > _AT_REST

    @cached_property
    def cone(self) -> np.ndarray:
        """(M,) contacts with a friction cone."""
        return ~self.slides & (self.mu > 0.0)

    @cached_property
    def directions(self) -> np.ndarray:
        """(M, 3) force per newton of normal force where there is no cone, n - mu v / |v|."""
        speed = np.where(self.slides, np.linalg.norm(self.v, axis=1), 1.0)
        kinetic = np.where(self.slides, self.mu, 0.0)[:, None] * self.v / speed[:, None]
        return self.frames[:, 0] - kinetic

    @cached_property
    def candidates(self) -> np.ndarray:
        """(M,) contacts that a mode may select."""
        return self.cone | self.slides if self.constrained else self.cone

    @cached_property
    def length(self) -> float:
        """L, the distance of the farthest contact from the contacts' centre, m."""
        farthest = float(np.linalg.norm(self.p - self.p.mean(axis=0), axis=1).max())
        force, moment = self._load
        if farthest > 0.0:
            return farthest
        return moment / force if force > 0.0 and moment > 0.0 else 1.0

    @cached_property
    def force(self) -> float:
        """F, the load, N; without one the required margin or the smallest limit."""
        force, moment = self._load
        without = self.e0 if self.e0 > 0.0 and not self.is_margin else float(self.limit.min())
        return max(force, moment / self.length) or without

    @property
    def _load(self) -> tuple[float, float]:
        """Size of the external force, and of the external moment about the contacts' centre."""
        moment = self.w[3:] - np.cross(self.p.mean(axis=0), self.w[:3])
        return float(np.linalg.norm(self.w[:3])), float(np.linalg.norm(moment))

    @cached_property
    def joint_scale(self) -> np.ndarray:
        """(L,) what the load makes on each joint's longest lever, N m (N)."""
        levers = np.linalg.norm(self.J, axis=1).max(axis=0)
        longest = float(levers.max(initial=0.0))
        if longest == 0.0:
            return np.full(len(levers), self.force * self.length)
        return self.force * np.maximum(levers, _LEAST_LEVER * longest)

    @cached_property
    def shared(self) -> tuple[np.ndarray, np.ndarray]:
        """(L,) each: the torque that counts as a share of 1 upwards, downwards; 0: none does."""
        if self.is_margin:
            return np.zeros(len(self.upper)), np.zeros(len(self.upper))
        if not self.by_limits:
            return np.ones(len(self.upper)), np.ones(len(self.upper))
        up = np.where(np.isfinite(self.upper), np.maximum(self.upper, 0.0), 0.0)
        down = np.where(np.isfinite(self.lower), np.maximum(-self.lower, 0.0), 0.0)
        return up, down

    @cached_property
    def unit(self) -> float:
        """What the objective is measured against: N, N m, or a share of the limits."""
        if self.is_margin:
            return self.force
        if not self.by_limits:
            return float(self.joint_scale.max(initial=0.0)) or self.force
        up, down = self.shared
        limits = np.concatenate([up, down])
        shares = np.tile(self.joint_scale, 2)[limits > 0.0] / limits[limits > 0.0]
        return min(float(shares.max(initial=0.0)), 1.0) or 1.0

    @property
    def curvature(self) -> float:
        """Second derivative of the objective by a force, in the objective's unit per N^2."""
        return self.epsilon * self.unit / self.force**2

    def faces(self, contact: int) -> np.ndarray:
        """(r, 3) unit outward face normals in (n, t1, t2) coordinates."""
        angles = 2.0 * np.pi * (np.arange(self.edges) + 0.5) / self.edges
        slope = self.mu[contact] * np.cos(np.pi / self.edges)
        rows = np.column_stack([np.full(self.edges, -slope), np.cos(angles), np.sin(angles)])
        return rows / np.sqrt(1.0 + slope**2)

    def objective(self, forces: Forces) -> float:
        """Return what is minimised at forces: -e or t, and the regularisation."""
        curved = 0.5 * self.curvature * float((forces.f**2).sum())
        if self.is_margin:
            return curved - forces.margin
        if not self.by_limits:
            return curved + float(np.abs(forces.torques).max(initial=0.0))
        up, down = self.shared
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(up > 0.0, forces.torques / up, 0.0)
            shares = np.maximum(shares, np.where(down > 0.0, -forces.torques / down, 0.0))
        return curved + float(shares.max(initial=0.0))


class Forces:
    """Contact forces and what follows from them.

    Attributes:
        f: (M, 3) N.
        local: (M, 3) along n, t1, t2.
        made: (L,) torques that the contacts make.
        torques: (L,) torques of the motors.
    """

    def __init__(self, problem: Problem, f: np.ndarray) -> None:
        """Work out components and torques."""
        self.f, self._problem = f, problem
        self.local = np.einsum("lij,lj->li", problem.frames, f)
        self.made = np.einsum("lij,li->j", problem.J, f)
        self.torques = self.made + problem.gravity

    @cached_property
    def outside(self) -> float:
        """The farthest that a force lies outside its cone, N; negative: all are inside."""
        return max(
            (
                float((self._problem.faces(c) @ self.local[c]).max())
                for c in np.flatnonzero(self._problem.cone).tolist()
            ),
            default=-np.inf,
        )

    @cached_property
    def margin(self) -> float:
        """The margin e that the forces keep, N."""
        normal = self.local[:, 0]
        room = min(float(normal.min()), float((self._problem.limit - normal).min()))
        return min(room, -self.outside)


def read_problem(document: dict[str, Any]) -> Problem:
    """Return the problem of a document.

    Raises:
        ValueError: Naming the key that is missing or wrong.
    """
    where = "the document"
    contacts = items(entry(document, "contacts", where), "contacts", 1, MOST)
    joints = items(entry(document, "joints", where), "joints", 0, MOST)
    edges = whole(entry(document, "cone_edges", where), "cone_edges", 3, MOST)
    rules = entry(document, "rules", where)
    algorithm = word(entry(document, "algorithm", where), "algorithm", ("margin", "torque"))

    def column(key: str, shape: tuple[int, ...]) -> np.ndarray:
        rows = [array(entry(c, key, f"contact {i}"), shape, f"{key} of contact {i}")
                for i, c in enumerate(contacts)]  # fmt: skip
        return np.array(rows).reshape(len(contacts), *shape)

    def limits(key: str, absent: float) -> np.ndarray:
        found = [entry(j, key, f"joint {i}") for i, j in enumerate(joints)]
        return np.array([absent if x is None else number(x, f"joint's {key}") for x in found])

    sign_rules, sliding_rules = ("strict", "exact", "nonzero"), ("exempt", "constrained")
    friction_rules = ("virtual_sliding", "coulomb")
    options = {"sign_rule": sign_rules, "sliding_rule": sliding_rules,
               "static_friction": friction_rules}  # fmt: skip
    said = {key: word(entry(rules, key, "rules"), key, known) for key, known in options.items()}
    scale = word(entry(document, "scale", where), "scale", ("absolute", "limits"))
    frames = np.concatenate([column("normal", (3,))[:, None], column("tangents", (2, 3))], axis=1)
    problem = Problem(
        p=column("position", (3,)) - read_origin(document),
        frames=frames,
        mu=column("friction", ()),
        limit=column("max_normal_force", ()),
        v=column("sliding", (3,)),
        J=column("jacobian", (3, len(joints))),
        w=array(entry(document, "external_wrench", where), (6,), "external_wrench"),
        edges=edges,
        lower=limits("lower", -np.inf),
        upper=limits("upper", np.inf),
        gravity=limits("torque_gravity", np.nan),
        units=tuple(
            word(entry(j, "unit", f"joint {i}"), "unit", ("N m", "N")) for i, j in enumerate(joints)
        ),
        algorithm=algorithm,
        e0=number(entry(document, "required_margin", where), "required_margin"),
        by_limits=algorithm == "torque" and scale == "limits",
        epsilon=number(entry(document, "regularization", where), "regularization"),
        sign_rule=said["sign_rule"],
        constrained=said["sliding_rule"] == "constrained",
        coulomb=said["static_friction"] == "coulomb",
    )
    for name, wrong in {
        "friction must not be negative": problem.mu < 0.0,
        "max_normal_force must be positive": problem.limit <= 0.0,
        "torque_gravity must be a number": ~np.isfinite(problem.gravity),
        "lower must not be above upper": problem.lower > problem.upper,
        "required_margin must not be negative": np.array(problem.e0 < 0.0),
        "required_margin is 0 in Algorithm 1": np.array(problem.is_margin and problem.e0 != 0.0),
        "regularization must not be negative": np.array(problem.epsilon < 0.0),
    }.items():
        if wrong.any():
            raise ValueError(name)
    for index, joint in enumerate(joints):
        text(entry(joint, "name", f"joint {index}"), "a joint's name")
    return problem


def read_origin(document: dict[str, Any]) -> np.ndarray:
    """(3,) the point that moments are about, in the axes of the contact points."""
    if "object" not in document:
        return np.zeros(3)
    return array(entry(document["object"], "center_of_mass", "object"), (3,), "center_of_mass")


def read_mode(document: dict[str, Any], problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """(M,) contacts that the stated mode selects, and (M, 2) their signs."""
    selected, signs = [], []
    for index, contact in enumerate(document["contacts"]):
        where = f"contact {index}"
        selected.append(truth(entry(contact, "selected", where), f"selected of {where}"))
        pair = items(entry(contact, "signs", where), f"signs of {where}", 2, 2)
        signs.append([whole(sign, f"a sign of {where}", -1, 1) for sign in pair])
    return np.array(selected, dtype=bool), np.array(signs, dtype=int).reshape(problem.count, 2)


def read_forces(rows: object, problem: Problem, where: str) -> Forces:
    """Return forces that stand in a document."""
    return Forces(problem, array(rows, (problem.count, 3), where))
