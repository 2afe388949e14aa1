"""The check of a proof over modes: a tree whose leaves together cover all of them.

A node stands for a set of modes, which follows from its parent's: the file says how a set is split,
and never what the parts are. Nodes are listed depth first, children in their order.

Virtual motions decide some leaves. u holds the velocities of the object relative to the other
bodies at all contacts along n, t1, t2. A motion counts where selected contacts stay touching and
slide with their signs, each at least theta times |u| fast. Where v with v^T u >= theta |u| for all
such u has a projection on the possible u that is shorter than theta, there is no such motion.

A set of modes is given by the contacts that are selected, and the signs that are left to them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.bounds import largest_objective, proven_bound, violation
from graspless_pin.report.verify.fields import IN_MODE, INFEASIBLE, Part
from graspless_pin.report.verify.outcome import Check, holds
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.reading import read_mode, read_problem, stated_multipliers

_SIGNS = np.array([-1, 0, 1])
_PAIRS = np.eye(9, dtype=bool).reshape(9, 3, 3)[[4, 0, 1, 2, 3, 5, 6, 7, 8]]
"""Each pair of signs alone, (0, 0) first: of contacts that are not selected."""
_RELEASED = _PAIRS[0]


@dataclass(frozen=True, eq=False)
class ModeSet:
    """A set of modes: what each contact may do in it, whatever the others do.

    Attributes:
        allowed_pairs: (M, 3, 3) whether a contact may have each pair of the signs -1, 0, 1 along t1
            and t2; the pair (0, 0) stands for contacts that are not selected.
        free: Whether friction needs no virtual sliding at all.
    """

    allowed_pairs: np.ndarray
    free: bool = False

    @classmethod
    def every_mode(cls, problem: Problem, *, free: bool) -> ModeSet:
        """Return all modes that the rules allow; ``free``: all friction, without any rule."""
        allowed = np.ones((problem.count, 3, 3), dtype=bool)
        if problem.sign_rule != "exact":
            allowed[:, 1] = allowed[:, :, 1] = False
        allowed[:, 1, 1] = ~(problem.slides & problem.constrained)
        allowed[~problem.candidates] = _RELEASED
        return cls(allowed, free)

    @classmethod
    def one_mode(cls, problem: Problem, selected: np.ndarray, signs: np.ndarray) -> ModeSet:
        """Return the set of one mode."""
        allowed = np.zeros((problem.count, 3, 3), dtype=bool)
        allowed[np.arange(problem.count), *(np.where(selected, signs.T, 0) + 1)] = True
        return cls(allowed)

    @property
    def selected(self) -> np.ndarray:
        """(M,) contacts that every mode of it selects."""
        return ~self.allowed_pairs[:, 1, 1]

    @property
    def signs(self) -> np.ndarray:
        """(M, 2, 3) whether the signs -1, 0, 1 along t1 and t2 are left."""
        return np.stack([self.allowed_pairs.any(axis=2), self.allowed_pairs.any(axis=1)], axis=1)

    @property
    def friction(self) -> np.ndarray:
        """(M, 2, 2) whether friction may be negative, positive: opposite to the sliding."""
        return self.signs[:, :, [2, 0]] | self.free

    def restricted_to(self, contact: int, pairs: np.ndarray) -> ModeSet | None:
        """Return its modes in which a contact has one of some sign pairs; None: there are none.

        Args:
            contact: Its index.
            pairs: (3, 3) whether each is among them.
        """
        allowed = self.allowed_pairs.copy()
        allowed[contact] &= pairs
        return replace(self, allowed_pairs=allowed) if allowed[contact].any() else None


def pairs_with(component: int, sign: int) -> np.ndarray:
    """(3, 3) pairs of signs that have a given one along a tangent."""
    along = np.broadcast_to(sign == _SIGNS, (3, 3))
    return along if component else along.T


def contact_velocities(problem: Problem, twist: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """(M, 3) velocities of the object relative to the other body along n, t1, t2, m/s."""
    return np.einsum("lij,lj->li", problem.frames, problem.passive @ twist - problem.J @ rates)


def motion_check(problem: Problem, u: np.ndarray, selected: np.ndarray, signs: np.ndarray) -> Check:
    """Check that a virtual motion counts for a mode.

    Args:
        problem: The problem.
        u: (M, 3) its velocities, see `contact_velocities`.
        selected: (M,) contacts that the mode selects.
        signs: (M, 2) their signs.
    """
    name = "the mode has a virtual motion (22)"
    if not selected.any():
        return holds(name, passed=True, detail="no contact slides virtually: no motion is needed")
    size = float(np.linalg.norm(u))
    if not (np.isfinite(size) and size > 0.0):
        return holds(name, passed=False, detail="the stated motion is zero or not finite")
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
    detail = f"slowest sliding {slowest:.1e}, normal velocity {leaving:.1e} of all velocities"
    return holds(name, good, detail)


@dataclass
class TreeProof:
    """What a tree proves.

    Attributes:
        bound: Lower bound on the objective of all forces of its modes; inf: there are no forces.
        violation: The smallest common violation that its only leaf proves; 0 with more leaves.
        leaves: Number of leaves.
        programs: Number of leaves that multipliers prove.
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
        reach: The largest normal forces for which bounds are required, N; inf where the proof says
            that there are no forces at all.
    """

    problem: Problem
    reach: float

    def walk(self, nodes: list[Part], root: ModeSet) -> TreeProof:
        """Return what the nodes prove of a set of modes.

        Raises:
            ValueError: If a node is invalid.
        """
        proof, waiting, failure = TreeProof(), [root], ""
        for number, node in enumerate(nodes):
            if not waiting:
                proof.failure = f"the tree is complete without the last {len(nodes) - number} nodes"
                return proof
            state, kind = waiting.pop(), node["kind"]
            if kind == "bound":
                bound, shared = self._leaf_bound(node, state)
                proof.bound = min(proof.bound, bound)
                proof.leaves, proof.programs = proof.leaves + 1, proof.programs + 1
                proof.violation = max(shared, 0.0) if len(nodes) == 1 else 0.0
            elif state.free:
                failure = "rules out virtual motions, but friction needs none here"
            elif kind == "kinematic":
                proof.leaves += 1
                if not self._excludes(node["combination"], state):
                    failure = "does not rule out all virtual motions of its modes"
            else:
                children = (self._conflict_children if kind == "conflict" else _contact_children)(
                    node, state
                )
                failure = "does not prove that its items conflict" if children is None else ""
                waiting.extend(reversed(children or []))
            if failure:
                proof.failure = f"{node.where} {failure}"
                return proof
        if waiting:
            proof.failure = f"{len(waiting)} sets of modes have no node"
        return proof

    def _leaf_bound(self, node: Part, state: ModeSet) -> tuple[float, float]:
        """Return the bound of a leaf's multipliers, and the violation if they refute all forces."""
        problem, reach, free = self.problem, self.reach, state.friction
        m = stated_multipliers(node["multipliers"].stated, problem, node.where)
        objective = node["objective"]
        bound = proven_bound(problem, m, free, reach, objective=objective)
        if objective and bound <= largest_objective(problem, reach):
            return bound, 0.0
        refutes = objective or bound > 0.0
        if objective:  # the violation is proven without the objective
            bound = proven_bound(problem, m, free, reach, objective=False)
        return (np.inf if refutes else -np.inf), violation(problem, m, bound)

    @cached_property
    def _basis(self) -> np.ndarray:
        """Orthonormal basis of the velocities of all virtual motions, (3 M, any)."""
        problem = self.problem
        columns = problem.frames @ np.concatenate([problem.passive, problem.J], axis=2)
        matrix = columns.reshape(3 * problem.count, -1)
        sizes = np.linalg.norm(matrix, axis=0)
        left, values, _ = np.linalg.svd(
            matrix / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False
        )
        return left[:, values > tolerances.RANK * max(1.0, float(values.max()))]

    def _excludes(self, v: np.ndarray, state: ModeSet) -> bool:
        """Return whether a combination (M, 3) proves that no motion counts for any mode."""
        chosen, allowed = state.selected[:, None], state.signs
        known = chosen & (allowed.sum(axis=2) == 1)
        signs = allowed.argmax(axis=2) - 1  # of those that are known: the others have no v
        along = signs * v[:, 1:]
        if (v[~np.hstack([chosen, known])] != 0.0).any() or (along < 0.0).any():
            return False
        if self.problem.sign_rule == "nonzero":
            weight = float(np.where((signs != 0).all(axis=1), along.min(axis=1), 0.0).sum())
        else:
            weight = float(along.sum())
        # The length of its projection on the motions, with the rounding error.
        flat = v.ravel()
        seen = np.linalg.norm(self._basis.T @ flat) + tolerances.PROJECTED * np.linalg.norm(flat)
        return weight > 0.0 and bool(seen < tolerances.SLOWEST * weight)

    def _conflict_children(self, node: Part, state: ModeSet) -> list[ModeSet] | None:
        """Return the children of a conflict: each obeys the items before its own and violates that.

        None if the items do not exclude each other.
        """
        children: list[ModeSet | None] = []
        rest: ModeSet | None = state
        for contact, component, sign in node["items"]:
            if rest is None:
                break
            pairs = pairs_with(component, sign) if sign else ~_RELEASED
            children.append(rest.restricted_to(contact, ~pairs))
            rest = rest.restricted_to(contact, pairs)
        sets = [] if rest is None else _conflict_sets(node, rest)  # none: no mode obeys all items
        if rest is not None:
            combinations = node["combinations"]
            if len(sets) != len(combinations) or not all(map(self._excludes, combinations, sets)):
                return None
        return [child for child in children if child is not None]


def _conflict_sets(node: Part, remaining: ModeSet) -> list[ModeSet]:
    """Return the set that obeys all items, or one for each sign of the component left open."""
    opened = node.get("open")
    if opened is None:
        return [remaining]
    contact, component = opened
    if not remaining.selected[contact]:
        return []
    sets = [remaining.restricted_to(contact, pairs_with(component, sign)) for sign in _SIGNS]
    return [part for part in sets if part is not None]


def _contact_children(node: Part, state: ModeSet) -> list[ModeSet]:
    """Return the children of a contact: not selected, and selected with each pair of signs."""
    children = [state.restricted_to(node["contact"], pair) for pair in _PAIRS]
    return [child for child in children if child is not None]


def root_state(
    problem: Problem, status: str, mode: tuple[np.ndarray, np.ndarray] | None = None
) -> ModeSet:
    """Return the set of modes that the proof of an answer has to cover.

    Args:
        problem: The problem.
        status: Status of the answer.
        mode: Selection and signs, where the proof is of one mode.
    """
    if status in IN_MODE and mode is not None:
        return ModeSet.one_mode(problem, *mode)
    return ModeSet.every_mode(problem, free=problem.coulomb or status == "infeasible_forces")


def proven_violation(document: dict[str, Any]) -> float:
    """Return the smallest common violation of the constraints that a document's multipliers prove.

    Args:
        document: The document, with its proof.

    Returns:
        In scaled units; 0 where the proof has more than one leaf, or is none.
    """
    try:
        problem = read_problem(document)
        stated = problem.part(document)
        status, nodes = stated["status"], stated["proof"]["nodes"]
        if status not in INFEASIBLE or len(nodes) != 1 or nodes[0]["kind"] != "bound":
            return 0.0
        mode = read_mode(document, problem) if status in IN_MODE else None
        free = root_state(problem, status, mode).friction
        m = stated_multipliers(nodes[0]["multipliers"].stated, problem, nodes[0].where)
    except ValueError:
        return 0.0  # what cannot be checked proves nothing
    bound = proven_bound(problem, m, free, np.inf, objective=False, rounding=tolerances.STATED)
    return max(violation(problem, m, bound), 0.0)
