"""Go through a proof over modes: a tree whose leaves together leave out none.

A node stands for a part of all modes, which follows from its parent's: the file says how a part is
split, and never what its children are. Nodes are listed depth first, children in their order.

Virtual motions decide of its leaves. u holds the velocities of the object relative to the other
bodies at all contacts along n, t1, t2. A motion counts where selected contacts stay touching and
slide with their signs, each at least theta times |u| fast. Where v with v^T u >= theta |u| for all
such u has a projection on the possible u that is shorter than theta, there is no such motion.

A part of the set of all modes is told by which contacts are selected, and which signs are left to
them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.bounds import (
    largest_objective,
    proven_bound,
    violation,
)
from graspless_pin.report.verify.outcome import Check, holds
from graspless_pin.report.verify.problem import IN_MODE, INFEASIBLE, Problem
from graspless_pin.report.verify.reading import read_mode, read_problem, stated_multipliers
from graspless_pin.report.verify.values import entry, items, number, truth, whole, word

_SIGNS = (-1, 0, 1)


@dataclass(frozen=True, eq=False)
class State:
    """All modes that select some contacts, do not select others, and have some signs.

    Attributes:
        selected: (M,) contacts that every mode of it selects.
        released: (M,) contacts that none of them selects.
        left: (M, 2, 3) whether the signs -1, 0, 1 along t1 and t2 are left to a contact if it is
            selected.
        exact: Whether one sign of a contact may be 0.
        free: Whether friction needs no virtual sliding at all.
    """

    selected: np.ndarray
    released: np.ndarray
    left: np.ndarray
    exact: bool
    free: bool = False

    @classmethod
    def every_mode(cls, problem: Problem, *, free: bool) -> State:
        """Return all modes that the rules let exist; ``free``: all friction, without any rule."""
        exact = problem.sign_rule == "exact"
        left = np.ones((problem.count, 2, 3), dtype=bool)
        left[:, :, 1] = exact
        always = problem.slides & problem.constrained
        return cls(always, ~problem.candidates, left, exact, free)

    @classmethod
    def one_mode(cls, problem: Problem, selected: np.ndarray, signs: np.ndarray) -> State:
        """Return one mode alone."""
        left = signs[:, :, None] == np.array(_SIGNS)
        return cls(selected, ~selected, left, problem.sign_rule == "exact")

    @property
    def known_signs(self) -> np.ndarray:
        """(M, 2) the sign that is left if it is the only one; else 0."""
        only = self.left.sum(axis=2) == 1
        return np.where(only, self.left[:, :, 2].astype(int) - self.left[:, :, 0], 0)

    @property
    def known_zeros(self) -> np.ndarray:
        """(M, 2) components where only the sign 0 is left."""
        return self.left[:, :, 1] & (self.left.sum(axis=2) == 1)

    @property
    def friction(self) -> np.ndarray:
        """(M, 2, 2) whether friction may be negative, positive: opposite to the sliding."""
        if self.free:
            return np.ones((len(self.selected), 2, 2), dtype=bool)
        return self.left[:, :, [2, 0]] & ~self.released[:, None, None]

    def select(self, contact: int) -> State | None:
        """Return the modes of it that select a contact; None: there is none."""
        selected = self.selected.copy()
        selected[contact] = True
        return replace(self, selected=selected)._settled(contact)

    def release(self, contact: int) -> State | None:
        """Return the modes of it that do not select a contact."""
        released = self.released.copy()
        released[contact] = True
        return replace(self, released=released)._settled(contact)

    def keep(self, contact: int, component: int, sign: int) -> State | None:
        """Return the modes of it that select a contact with a sign."""
        left = self.left.copy()
        left[contact, component] &= np.array(_SIGNS) == sign
        return replace(self, left=left).select(contact)

    def without(self, contact: int, component: int, sign: int) -> State | None:
        """Return the modes of it that do not select a contact, or with another sign."""
        left = self.left.copy()
        left[contact, component, sign + 1] = False
        return replace(self, left=left)._settled(contact)

    def pairs(self, contact: int) -> list[tuple[int, int]]:
        """Return the pairs of signs that are left to a contact, in the order of -1, 0, 1."""
        first, second = (np.flatnonzero(row) - 1 for row in self.left[contact])
        return [(int(a), int(b)) for a in first for b in second if (a, b) != (0, 0)]

    def _settled(self, contact: int) -> State | None:
        """Return the state where a contact without any pair of signs is released; None: empty."""
        if self.pairs(contact):
            return None if self.selected[contact] and self.released[contact] else self
        if self.selected[contact]:
            return None
        released = self.released.copy()
        released[contact] = True
        return replace(self, released=released)


def velocities(problem: Problem, twist: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """(M, 3) of the object relative to the other body along n, t1, t2, m/s."""
    at = problem.passive @ twist - problem.J @ rates
    return np.einsum("lij,lj->li", problem.frames, at)


def motion_check(problem: Problem, u: np.ndarray, selected: np.ndarray, signs: np.ndarray) -> Check:
    """Check that a virtual motion counts for a mode.

    Args:
        problem: The problem.
        u: (M, 3) its velocities, see `velocities`.
        selected: (M,) contacts that the mode selects.
        signs: (M, 2) their signs.
    """
    name = "the mode has a virtual motion (22)"
    if not selected.any():
        return holds(name, passed=True, detail="no contact slides virtually: no motion is needed")
    size = float(np.linalg.norm(u))
    if not (np.isfinite(size) and size > 0.0):
        return holds(name, passed=False, detail="the motion is none")
    leaving = float(np.abs(u[selected, 0]).max()) / size
    along = (signs * u[:, 1:])[selected] / size
    if problem.sign_rule == "nonzero":
        slowest = float(along.sum(axis=1).min())
        backward = float(max(0.0, -along.min()))
    else:
        zero = signs[selected] == 0
        slowest = float(along[~zero].min(initial=np.inf))
        backward = float(np.abs(u[selected, 1:] / size)[zero].max(initial=0.0))
    good = (
        slowest >= tolerances.SLOWEST
        and leaving <= tolerances.STILL
        and backward <= tolerances.STILL
    )
    detail = f"slowest sliding {slowest:.1e}, parting {leaving:.1e} of all velocities"
    return holds(name, good, detail)


class Projection:
    """The orthogonal projection on all possible u."""

    def __init__(self, problem: Problem) -> None:
        """Find an orthonormal basis of the velocities of all virtual motions."""
        columns = problem.frames @ np.concatenate([problem.passive, problem.J], axis=2)
        matrix = columns.reshape(3 * problem.count, -1)
        sizes = np.linalg.norm(matrix, axis=0)
        matrix = matrix / np.where(sizes > 0.0, sizes, 1.0)
        left, values, _ = np.linalg.svd(matrix, full_matrices=False)
        self._basis = left[:, values > tolerances.RANK * max(1.0, float(values.max()))]

    def length(self, v: np.ndarray) -> float:
        """Return |P v| of a combination (M, 3), with what rounding may hide."""
        flat = v.ravel()
        return float(
            np.linalg.norm(self._basis.T @ flat) + tolerances.PROJECTED * np.linalg.norm(flat)
        )


def read_combination(given: object, problem: Problem, where: str) -> np.ndarray:
    """(M, 3) a combination that stands in a document as [contact, axis, value] entries."""
    v = np.zeros((problem.count, 3))
    for triple in items(given, where, 0, v.size):
        contact, axis, value = items(triple, where, 3, 3)
        v[whole(contact, where, 0, problem.count - 1), whole(axis, where, 0, 2)] = number(
            value, where
        )
    return v


def excludes(problem: Problem, projection: Projection, state: State, v: np.ndarray) -> bool:
    """Return whether a combination proves that no motion counts for any mode of a state.

    Args:
        problem: The problem.
        projection: Of the problem.
        state: Which contacts are selected, and the signs that are left to them.
        v: (M, 3) the combination.
    """
    chosen = state.selected
    signs = np.where(chosen[:, None], state.known_signs, 0)
    zeros = chosen[:, None] & state.known_zeros
    along = signs * v[:, 1:]
    allowed = np.zeros(v.shape, dtype=bool)
    allowed[:, 0] = chosen
    allowed[:, 1:] = (signs != 0) | zeros
    if (v[~allowed] != 0.0).any() or (along < 0.0).any():
        return False
    if problem.sign_rule == "nonzero":
        weight = float(np.where((signs != 0).all(axis=1), along.min(axis=1), 0.0).sum())
    else:
        weight = float(along.sum())
    return weight > 0.0 and projection.length(v) < tolerances.SLOWEST * weight


MOST_NODES = 10_000
_KINDS = ("bound", "kinematic", "conflict", "contact")


@dataclass
class Proof:
    """What a tree proves.

    Attributes:
        bound: What no forces that any of its modes admits stay below; inf: there are no forces.
        violation: The smallest common violation that its only leaf proves; 0 with more leaves.
        leaves: How many parts of the modes were ruled out.
        programs: How many of them by multipliers.
        failure: Why it is no proof; empty: it is one.
    """

    bound: float = np.inf
    violation: float = 0.0
    leaves: int = 0
    programs: int = 0
    failure: str = ""


@dataclass(eq=False)
class TreeWalk:
    """A walk through the nodes of one proof.

    Attributes:
        problem: The problem.
        reach: The largest normal forces that bounds are asked for, N; inf where the proof says
            that there are no forces at all.
        projection: Of the problem's virtual motions.
    """

    problem: Problem
    reach: float
    projection: Projection | None = field(default=None, init=False)

    def walk(self, nodes: object, root: State) -> Proof:
        """Return what the nodes prove of a part of all modes.

        Raises:
            ValueError: If a node is no node.
        """
        listed = items(nodes, "nodes of the proof", 1, MOST_NODES)
        proof, waiting, number = Proof(), [root], 0
        while waiting:
            if number == len(listed):
                proof.failure = f"{len(waiting)} parts of the modes have no node"
                return proof
            where, node, state = f"node {number}", listed[number], waiting.pop()
            kind = word(entry(node, "kind", where), f"the kind of {where}", _KINDS)
            number += 1
            if kind == "bound":
                bound, shared = self._bound(node, state, where)
                proof.bound = min(proof.bound, bound)
                proof.leaves, proof.programs = proof.leaves + 1, proof.programs + 1
                proof.violation = shared if len(listed) == 1 else 0.0
                continue
            if state.free:
                proof.failure = f"{where} speaks of modes where friction needs none"
                return proof
            if kind == "kinematic":
                proof.leaves += 1
                if not self._excluded(state, entry(node, "combination", where), where):
                    proof.failure = f"{where} does not rule out its motions"
                    return proof
                continue
            children = self._split(node, state, where) if kind == "conflict" else _by_contact(
                node, state, where
            )  # fmt: skip
            if children is None:
                proof.failure = f"{where} names no conflict"
                return proof
            waiting.extend(reversed(children))
        if number < len(listed):
            proof.failure = f"{len(listed) - number} nodes are left over"
        return proof

    def _bound(self, node: Any, state: State, where: str) -> tuple[float, float]:
        """Return what a leaf's multipliers prove, and the violation if they refute all forces."""
        problem = self.problem
        m = stated_multipliers(entry(node, "multipliers", where), problem, where)
        objective = truth(entry(node, "objective", where), f"objective of {where}")
        bound = proven_bound(problem, m, state.friction, self.reach, objective=objective)
        if objective and bound <= largest_objective(problem, self.reach):
            return bound, 0.0
        # What refutes all forces proves by how much without the objective.
        without_objective = bound
        if objective:
            without_objective = proven_bound(
                problem, m, state.friction, self.reach, objective=False
            )
        refutes = objective or without_objective > 0.0
        return (np.inf if refutes else -np.inf), violation(problem, m, without_objective)

    def _excluded(self, state: State, combination: object, where: str) -> bool:
        if self.projection is None:
            self.projection = Projection(self.problem)
        v = read_combination(combination, self.problem, f"the combination of {where}")
        return excludes(self.problem, self.projection, state, v)

    def _split(self, node: Any, state: State, where: str) -> list[State] | None:
        """Return the children of a conflict: each presumes the items before its own and breaks it.

        None if the items do not exclude each other.
        """
        children: list[State] = []
        rest: State | None = state
        for item in items(entry(node, "items", where), f"items of {where}", 0, 3 * len(state.left)):
            if rest is None:
                break
            contact, component, sign = _read_item(item, len(state.left), where)
            if sign:
                broken = rest.without(contact, component, sign)
                rest = rest.keep(contact, component, sign)
            else:
                broken, rest = rest.release(contact), rest.select(contact)
            if broken is not None:
                children.append(broken)
        if rest is None:
            return children  # every mode breaks one of the items already
        combinations = items(entry(node, "combinations", where), f"combinations of {where}", 1, 3)
        ways = _ways(node, rest, where)
        if len(ways) != len(combinations):
            return None
        for part, combination in zip(ways, combinations, strict=True):
            if part is not None and not self._excluded(part, combination, where):
                return None
        return children


def _ways(node: Any, rest: State, where: str) -> list[State | None]:
    """Return the state of all items, or one for each sign of a component that they leave no way."""
    if node.get("open") is None:
        return [rest]
    contact, component = items(node["open"], f"open of {where}", 2, 2)
    contact, component, _ = _read_item([contact, component, 0], len(rest.left), where)
    if not rest.selected[contact]:
        return []
    signs = np.flatnonzero(rest.left[contact, component]) - 1
    return [rest.keep(contact, component, int(sign)) for sign in signs]


def _read_item(item: object, count: int, where: str) -> tuple[int, int, int]:
    """Contact, component and sign; the sign 0 stands for a contact that is selected."""
    contact, component, sign = items(item, f"an item of {where}", 3, 3)
    return (
        whole(contact, f"a contact of {where}", 0, count - 1),
        whole(component, f"a component of {where}", 0, 1),
        whole(sign, f"a sign of {where}", -1, 1),
    )


def _by_contact(node: Any, state: State, where: str) -> list[State]:
    """Return the children of a contact: not selected, and selected with each pair of signs."""
    contact = whole(entry(node, "contact", where), f"contact of {where}", 0, len(state.left) - 1)
    children = [] if state.selected[contact] else [state.release(contact)]
    if not state.released[contact]:
        for a, b in state.pairs(contact):
            first = state.keep(contact, 0, a)
            children.append(first and first.keep(contact, 1, b))
    return [child for child in children if child is not None]


def root_of(
    problem: Problem, status: str, mode: tuple[np.ndarray, np.ndarray] | None = None
) -> State:
    """Return the part of all modes that the proof of an answer speaks of.

    Args:
        problem: The problem.
        status: Of the answer.
        mode: What it selects with which signs, where it is of one mode.
    """
    if status in IN_MODE and mode is not None:
        return State.one_mode(problem, *mode)
    return State.every_mode(problem, free=problem.coulomb or status == "infeasible_forces")


def proven_violation(document: dict[str, Any]) -> float:
    """Return the smallest common violation that a document may state: its multipliers prove it.

    Args:
        document: The document, with its proof.

    Returns:
        In scaled units; 0 where the proof has more than one leaf, or is none.
    """
    try:
        return max(_of_only_leaf(document), 0.0)
    except ValueError:
        return 0.0  # what cannot be checked proves nothing


def _of_only_leaf(document: dict[str, Any]) -> float:
    status, nodes = document["status"], entry(document["proof"], "nodes", "proof")
    if status not in INFEASIBLE or len(nodes) != 1 or nodes[0]["kind"] != "bound":
        return 0.0
    problem = read_problem(document)
    mode = read_mode(document, problem) if status in IN_MODE else None
    free = root_of(problem, status, mode).friction
    m = stated_multipliers(nodes[0]["multipliers"], problem, "node 0")
    bound = proven_bound(problem, m, free, np.inf, objective=False, rounding=tolerances.STATED)
    return violation(problem, m, bound)
