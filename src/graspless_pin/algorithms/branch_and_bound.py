"""Best-first branch and bound over contacts, driven by kinematic conflicts.

A node is the relaxation with some friction components restricted to one sign, or to zero. If no
feasible mode admits the friction of its optimum, the kinematics name a conflict: items "contact l
virtually slides with sign s along t_m" and "contact l is selected" that exclude each other. At
least one of them must give way, so the children flip the sign of one component of the friction in
the conflict, or take the friction from one contact in it. Contacts that take part in no conflict
are never branched on.
"""

from __future__ import annotations

import heapq
import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.friction_modes import Opposition, SignPair
from graspless_pin.algorithms.search import SearchResult, SearchState, finished
from graspless_pin.modes.enumeration import sign_pairs
from graspless_pin.modes.kinematics import Conflict
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solution import Status
from graspless_pin.solvers import Answer, Outcome

_GUESS_EVERY = 8
"""A mode is guessed at the first conflict and at each so many after it."""
_GUESSES = 3


@dataclass(frozen=True, eq=False)
class _Node:
    """A box of friction components and the sign pairs fixed so far."""

    lb: FloatArray
    ub: FloatArray
    decided: dict[int, SignPair]
    depth: int


def branch_and_bound(
    state: SearchState, *, node_limit: int | None = None, time_limit: float | None = None
) -> SearchResult:
    """Find the optimum over all feasible modes with a proven bound.

    Args:
        state: The search to run.
        node_limit: Stop after so many nodes; None: no limit.
        time_limit: Stop after so many seconds; None: no limit.
    """
    deadline = np.inf if time_limit is None else time.monotonic() + time_limit
    answer = state.relax()
    state.nodes += 1
    if answer.outcome is not Outcome.SOLVED:
        failed = answer.outcome is Outcome.FAILED
        return SearchResult(Status.UNVERIFIED if failed else Status.INFEASIBLE_FORCES, state)
    program = state.formulation.program
    queue = _Queue()
    if not state.closed(answer.bound):
        queue.add(answer.bound, _children(state, _Node(program.lb, program.ub, {}, 0), answer))
    # The lowest bound of the nodes that were left without being split: no optimum lies below it.
    left = np.inf if queue.nodes else answer.bound
    while queue.nodes:
        bound, _, _, node = heapq.heappop(queue.nodes)
        state.raise_bound(min(bound, left))
        if state.closed(bound):
            return finished(state)
        if (node_limit is not None and state.nodes >= node_limit) or time.monotonic() > deadline:
            return finished(state, interrupted=True)
        answer = state.solve(node.lb, node.ub)
        state.nodes += 1
        if answer.outcome is Outcome.FAILED:
            left = min(left, bound)
            continue
        if answer.outcome is not Outcome.SOLVED or state.closed(answer.bound):
            left = min(left, answer.bound)
            continue
        children = _children(state, node, answer)
        if not children:
            left = min(left, answer.bound)
        queue.add(answer.bound, children)
    state.raise_bound(left)
    return finished(state)


class _Queue:
    """Nodes to be solved, none of them twice.

    Attributes:
        nodes: A heap: best bound first; among equals the deepest, then the youngest, which dives
            to an answer.
    """

    def __init__(self) -> None:
        self.nodes: list[tuple[float, int, int, _Node]] = []
        self._seen: set[tuple[bytes, bytes, tuple[tuple[int, SignPair], ...]]] = set()

    def add(self, bound: float, children: list[_Node]) -> None:
        """Add the children of a node with its bound."""
        for child in children:
            key = (child.lb.tobytes(), child.ub.tobytes(), tuple(sorted(child.decided.items())))
            if key not in self._seen:
                self._seen.add(key)
                heapq.heappush(self.nodes, (bound, -child.depth, -len(self._seen), child))


def _guess(state: SearchState, answer: Answer) -> None:
    """Look for a good mode near the friction of an answer: often it is as good as the answer.

    An interior-point optimum has friction everywhere, so where many forces are optimal its own
    friction is rarely the one that a motion stands behind.
    """
    for _ in range(_GUESSES):
        mode = state.reader.propose(answer.x)
        if mode is None:
            return
        guess = state.solve(*state.formulation.bounds_of(mode))
        if guess.outcome is not Outcome.SOLVED or guess.value >= state.best_value:
            return
        state.best, state.mode = guess, mode
        if state.closed(answer.bound):
            return
        answer = guess


def _children(state: SearchState, node: _Node, answer: Answer) -> list[_Node]:
    """Keep the node's optimum if a mode admits it; otherwise split the node."""
    verdict = state.reader.read(answer.x, node.decided)
    state.modes_examined += 1
    if not isinstance(verdict, SlidingMode) and state.modes_examined % _GUESS_EVERY == 1:
        _guess(state, answer)
        if state.closed(answer.bound):
            return []
    if isinstance(verdict, Conflict):
        return _resolving(state, node, verdict)
    if isinstance(verdict, Opposition):
        columns = state.formulation.friction_columns(verdict.contact)[:, verdict.component]
        return [_signed(node, columns, 1), _signed(node, columns, -1)]
    if isinstance(verdict, SlidingMode) and state.accept(answer, verdict):
        return []
    return _deciding(state, node, answer)


def _resolving(state: SearchState, node: _Node, conflict: Conflict) -> list[_Node]:
    """Children that each take one item out of a conflict."""
    has_cone = state.formulation.problem.has_cone
    children = []
    released: set[int] = set()
    rest = node
    for contact, component, sign in conflict.signs:
        if not has_cone[contact]:
            continue
        if contact in node.decided:
            released.add(contact)
            continue
        columns = state.formulation.friction_columns(contact)[:, component]
        # The virtual sliding has this sign because the friction has the other one: flip it here,
        # and keep it in the children that follow, so that they do not overlap.
        children.append(_signed(rest, columns, sign))
        rest = replace(_signed(rest, columns, -sign), depth=node.depth)
    released.update(contact for contact in conflict.contacts if has_cone[contact])
    children.extend(_released(state, rest, contact) for contact in sorted(released))
    return children


def _signed(node: _Node, columns: NDArray[np.int_], sign: int) -> _Node:
    """The child in which friction components have one sign or vanish."""
    lb, ub = node.lb.copy(), node.ub.copy()
    if sign > 0:
        lb[columns] = np.maximum(lb[columns], 0.0)
    else:
        ub[columns] = np.minimum(ub[columns], 0.0)
    return _Node(lb, ub, node.decided, node.depth + 1)


def _released(state: SearchState, node: _Node, contact: int) -> _Node:
    """The child in which a contact has no friction."""
    lb, ub = node.lb.copy(), node.ub.copy()
    columns = state.formulation.friction_columns(contact)
    lb[columns] = ub[columns] = 0.0
    decided = {key: pair for key, pair in node.decided.items() if key != contact}
    return _Node(lb, ub, decided, node.depth + 1)


def _deciding(state: SearchState, node: _Node, answer: Answer) -> list[_Node]:
    """Children that fix the mode of the undecided contact with the most friction, one each."""
    formulation = state.formulation
    size: dict[int, float] = {}
    for contact in formulation.cone_contacts:
        columns = formulation.friction_columns(contact)
        released = (node.lb[columns] == 0.0).all() and (node.ub[columns] == 0.0).all()
        if contact not in node.decided and not released:
            size[contact] = float(np.abs(answer.x[columns]).sum())
    if not size:
        return []
    contact = max(size, key=lambda candidate: size[candidate])
    columns = formulation.friction_columns(contact)
    children = [_released(state, node, contact)]
    for pair in sign_pairs(state.rules.sign):
        child = node
        for component, sign in enumerate(pair):
            # Friction is opposite to the virtual sliding, and vanishes along a zero component.
            for way in {0: (1, -1), 1: (-1,), -1: (1,)}[sign]:
                child = _signed(child, columns[:, component], way)
        decided = {**node.decided, contact: pair}
        children.append(replace(child, decided=decided, depth=node.depth + 1))
    return children
