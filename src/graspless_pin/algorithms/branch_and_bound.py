"""Best-first branch and bound over contacts, driven by kinematic conflicts.

Branch and bound as of Land and Doig (Econometrica 28(3), 1960). The conflicts play the part of
combinatorial Benders cuts (Codato and Fischetti, Oper. Res. 54(4), 2006): an infeasible set of
kinematic conditions tells which decisions cannot stand together. A node is the relaxation with some
friction components restricted to one sign, or to zero. If no feasible mode admits the friction of
its optimum, the kinematics name a conflict: items "contact l virtually slides with sign s along
t_m" and "contact l is selected" that exclude each other. At least one of them must give way, so the
children flip the sign of one component of the friction in the conflict, or take the friction from
one contact in it. Contacts that take part in no conflict are never branched on.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.mode_oracle import Opposition, SignPair
from graspless_pin.algorithms.options import NO_LIMITS, Limits
from graspless_pin.algorithms.search import (
    SearchResult,
    SearchState,
    closeness,
    finished,
)
from graspless_pin.modes.enumeration import sign_pairs
from graspless_pin.modes.feasibility import Conflict, Requirement
from graspless_pin.modes.propagation import Decisions
from graspless_pin.modes.rules import SignRule, SlidingMode, StaticFriction
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solution import Status
from graspless_pin.solvers import Answer, Outcome
from graspless_pin.tree_search import TreeSearch

_GUESS_EVERY = 8
"""A mode is guessed at the first conflict and at each so many after it."""
_GUESSES = 3
_FORESEE_FROM = 8
"""Nodes after which it pays to ask what each contact could still do, where few motions are left."""


class _Node(NamedTuple):
    """A box of friction components, and what is presumed of the modes in it.

    Attributes:
        lb: (n,) lower bounds of the variables.
        ub: (n,) upper bounds.
        decided: Sign pairs fixed so far.
        decisions: Contacts selected and released, and signs.
    """

    lb: FloatArray
    ub: FloatArray
    decided: dict[int, SignPair]
    decisions: Decisions

    @property
    def key(self) -> tuple[object, ...]:
        """What tells it from other nodes."""
        decided = tuple(sorted(self.decided.items()))
        return self.lb.tobytes(), self.ub.tobytes(), decided, self.decisions.key


def branch_and_bound(state: SearchState, limits: Limits = NO_LIMITS) -> SearchResult:
    """Find the optimum over all feasible modes with a proven bound.

    Args:
        state: The search to run.
        limits: When to stop.
    """
    answer = state.relax()
    state.nodes += 1
    if answer.outcome is not Outcome.SOLVED:
        failed = answer.outcome is Outcome.FAILED
        return SearchResult(Status.UNVERIFIED if failed else Status.INFEASIBLE_FORCES, state)
    program = state.formulation.program
    count = state.formulation.problem.contact_count
    root = _Node(program.lb, program.ub, {}, Decisions.none(count))
    children = None if state.closed(answer.bound) else _children(state, root, answer)
    # The lowest bound of the nodes that were left without being split: no optimum lies below it.
    left = answer.bound if children is None else np.inf
    seen: set[tuple[object, ...]] = set()
    search = TreeSearch(_unseen(children, seen), answer.bound)
    for bound, node in search:
        state.raise_bound(min(bound, left))
        if state.closed(bound):
            return finished(state)
        if limits.end(state.nodes):
            return finished(state, interrupted=True)
        node = _drawn(state, node)
        if node is None:
            continue
        answer = state.solve(node.lb, node.ub)
        state.nodes += 1
        if answer.outcome is Outcome.FAILED:
            left = min(left, max(bound, answer.bound))
            continue
        if answer.outcome is not Outcome.SOLVED or state.closed(answer.bound):
            left = min(left, answer.bound)
            continue
        children = _children(state, node, answer)
        if children is None:
            left = min(left, answer.bound)
        search.add(_unseen(children, seen), _level(bound, answer.bound))
    state.raise_bound(left)
    return finished(state)


def _unseen(children: list[_Node] | None, seen: set[tuple[object, ...]]) -> Iterator[_Node]:
    """Yield the children that were not met before, under other parents."""
    for child in children or ():
        if child.key not in seen:
            seen.add(child.key)
            yield child


def _level(before: float, bound: float) -> float:
    """Return the proven bound by which the children of a node come in turn.

    Where a mode is as good as the relaxation, the bounds of all nodes are equal but for rounding,
    which would lead the search from one to another instead of down to an answer.

    Args:
        before: The one of the node itself.
        bound: What its program proves.
    """
    return bound if bound > before + 0.5 * closeness(before) else before


def _guess(state: SearchState, answer: Answer) -> None:
    """Look for a good mode near the friction of an answer: often it is as good as the answer.

    An interior-point optimum has friction everywhere, so where many forces are optimal its own
    friction is rarely the one that a motion stands behind.
    """
    for _ in range(_GUESSES):
        mode = state.oracle.heuristic_mode(answer.x)
        if mode is None or mode == state.mode:
            return  # it is the best already
        guess = state.solve(*state.formulation.bounds_of(mode))
        if guess.outcome is not Outcome.SOLVED or guess.value >= state.best_value:
            return
        state.keep(guess, mode)
        if state.closed(answer.bound):
            return
        answer = guess


def _children(state: SearchState, node: _Node, answer: Answer) -> list[_Node] | None:
    """Keep the node's optimum if a mode admits it; otherwise split the node.

    None where nothing in the node is better than what was kept, or it cannot be split; no children
    where it holds no mode.
    """
    verdict = state.oracle.mode_for(answer.x, node.decided)
    state.modes_examined += 1
    if not isinstance(verdict, SlidingMode) and state.modes_examined % _GUESS_EVERY == 1:
        _guess(state, answer)
        if state.closed(answer.bound):
            return None
    if isinstance(verdict, Conflict):
        return _resolving(state, node, verdict, answer.x)
    if isinstance(verdict, Opposition):
        ways = [_turned(state, node, verdict.contact, verdict.component, way) for way in (1, -1)]
        return [child for child in ways if child is not None]
    if isinstance(verdict, SlidingMode) and state.accept(answer, verdict):
        return None
    return _deciding(state, node, answer)


def _resolving(state: SearchState, node: _Node, conflict: Conflict, x: FloatArray) -> list[_Node]:
    """Children that each take one item out of a conflict.

    A child presumes that the items before its own stay as they are, so that no two overlap.
    """
    has_cone = state.formulation.problem.has_cone
    signs = [item for item in conflict.signs if has_cone[item[0]]]
    released = {contact for contact, _, _ in signs if contact in node.decided}
    released.update(contact for contact in conflict.contacts if has_cone[contact])
    signs = [item for item in signs if item[0] not in node.decided]
    # First what can only be flipped, then the largest friction: those children are worst.
    size = _friction(state, x)
    signs.sort(key=lambda item: (not node.decisions.selected[item[0]], -size[item[0], item[1]]))
    children: list[_Node | None] = []
    rest: _Node | None = node
    for contact, component, sign in signs:
        if rest is None:
            break
        # The virtual sliding has this sign because the friction has the other one: flip it here.
        children.append(_turned(state, rest, contact, component, -sign))
        kept = rest.decisions.sign(contact, component, sign)
        rest = _presuming(rest, kept and kept.select(contact))
    for contact in sorted(released):
        if rest is None:
            break
        children.append(_presuming(rest, rest.decisions.release(contact)))
        rest = _presuming(rest, rest.decisions.select(contact))
    return [child for child in children if child is not None]


def _friction(state: SearchState, x: FloatArray) -> FloatArray:
    """(M, 2) size of the friction components."""
    size = np.zeros((state.formulation.problem.contact_count, 2))
    size[state.formulation.cone_index] = np.abs(x[state.formulation.cone_columns]).max(axis=0)
    return size


def _presuming(node: _Node, decisions: Decisions | None) -> _Node | None:
    """Return the node with other decisions, None if they contradict each other."""
    return None if decisions is None else node._replace(decisions=decisions)


def _turned(
    state: SearchState, node: _Node, contact: int, component: int, sign: int
) -> _Node | None:
    """Return the child in which a contact, if selected, slides one way along a tangent."""
    if state.rules.sign is not SignRule.EXACT:
        return _presuming(node, node.decisions.sign(contact, component, sign))
    # There the sliding may be zero as well, which is no sign.
    return _signed(node, state.formulation.friction_columns(contact)[:, component], -sign)


def _drawn(state: SearchState, node: _Node) -> _Node | None:
    """Return the node with all that follows from its decisions, None if no mode is left in it."""
    if state.rules.static_friction is StaticFriction.COULOMB:
        return node
    problem = state.formulation.problem
    few_motions = problem.passive_count + problem.joint_count <= problem.contact_count
    foresee = few_motions and state.nodes >= _FORESEE_FROM
    decisions = state.consequences.propagate(node.decisions, probe=foresee)
    if decisions is None:
        return None
    lb, ub = node.lb.copy(), node.ub.copy()
    cones = state.formulation.cone_index
    released, signs = decisions.released[cones, None], decisions.signs[cones]
    # (31): friction is opposite to the virtual sliding; (27): it vanishes without (docs/model.md).
    high, low = released | (signs > 0), released | (signs < 0)
    for columns in state.formulation.cone_columns:
        ub[columns[high]] = np.minimum(ub[columns[high]], 0.0)
        lb[columns[low]] = np.maximum(lb[columns[low]], 0.0)
    decided = {key: pair for key, pair in node.decided.items() if not decisions.released[key]}
    return _Node(lb, ub, decided, decisions)


def _signed(node: _Node, columns: NDArray[np.int_], sign: int) -> _Node:
    """Return the child in which friction components have one sign or vanish."""
    lb, ub = node.lb.copy(), node.ub.copy()
    if sign > 0:
        lb[columns] = np.maximum(lb[columns], 0.0)
    else:
        ub[columns] = np.minimum(ub[columns], 0.0)
    return _Node(lb, ub, node.decided, node.decisions)


def _deciding(state: SearchState, node: _Node, answer: Answer) -> list[_Node] | None:
    """Children that fix the mode of the undecided contact with the most friction, one each.

    Where all are decided, none if no motion is behind what is; else None.
    """
    formulation = state.formulation
    size: dict[int, float] = {}
    for contact in formulation.cone_contacts:
        columns = formulation.friction_columns(contact)
        released = (node.lb[columns] == 0.0).all() and (node.ub[columns] == 0.0).all()
        if contact not in node.decided and not released:
            size[contact] = float(np.abs(answer.x[columns]).sum())
    if not size:
        decided = [Requirement(contact, pair) for contact, pair in node.decided.items()]
        state.oracle.kinematic_programs += 1
        moves = formulation.kinematics.feasible(decided, state.rules.sign)
        return None if moves else []
    contact = max(size, key=lambda candidate: size[candidate])
    columns = formulation.friction_columns(contact)
    children = [_presuming(node, node.decisions.release(contact))]
    for pair in sign_pairs(state.rules.sign):
        decisions: Decisions | None = node.decisions.select(contact)
        for component, sign in enumerate(pair):
            if sign and decisions is not None:
                decisions = decisions.sign(contact, component, sign)
        child = _presuming(node, decisions)
        if child is not None:
            for component in np.flatnonzero(np.array(pair) == 0):
                # Friction vanishes along a zero component.
                for way in (1, -1):
                    child = _signed(child, columns[:, component], way)
            children.append(child._replace(decided={**node.decided, contact: pair}))
    return [child for child in children if child is not None]
