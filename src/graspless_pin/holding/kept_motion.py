"""Whether a declared motion is kept: nothing else is an outcome, or what else is.

All contact states are gone through: open or closed, and sticking or slipping in sectors where a
contact does not slide by the declared motion. In each set of outcomes linear programs bound every
component of the object's acceleration: the power of friction that rubs has no sign.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from graspless_pin.holding.bounds import States
from graspless_pin.holding.branching import NEAR, slip_range, split
from graspless_pin.holding.dynamics import Dynamics
from graspless_pin.holding.kept_bounds import completed, goal_bound, point_goals
from graspless_pin.holding.kept_programs import KeptPrograms
from graspless_pin.holding.moving import coulomb_gaps, polish
from graspless_pin.holding.verdict import ContactState, DualBound, OutcomeSet
from graspless_pin.problem.checks import FloatArray

_EMPTY = -0.5
"""Where zero is bounded by this, there is no outcome; minus one but for rounding."""


@dataclass
class _Node:
    """A set of outcomes on the way to its proof, with the goals that are left in it."""

    contact: int
    states: States
    left: list[int]
    sides: list[tuple[int, DualBound]] = field(default_factory=list)
    children: list[_Node] = field(default_factory=list)

    def finished(self) -> OutcomeSet:
        """Return the node of the proof."""
        states, contact = self.states, self.contact
        state = ContactState.FREE if contact < 0 else states.state[contact]
        children = tuple(child.finished() for child in self.children)
        slip = slip_range(states, contact)
        return OutcomeSet(contact, state, slip, children, sides=tuple(self.sides))


@dataclass(frozen=True, eq=False)
class Kept:
    """How far the search came.

    Attributes:
        tree: The proof that nothing else happens; None where it is not finished.
        motion: (M, 3) scaled forces of an outcome that moves the object otherwise, if one was met.
        resisting: The states of the contacts in the first set that was left, where one was.
        nodes: Sets looked at.
        left: Sets that were left.
        programs: Linear programs solved.
    """

    tree: OutcomeSet | None
    motion: FloatArray | None
    resisting: tuple[ContactState, ...]
    nodes: int
    left: int
    programs: int


def other_motion(dynamics: Dynamics, force_limit: float, is_over: Callable[[int], bool]) -> Kept:
    """Prove that no outcome moves the object otherwise than declared, or find one.

    Args:
        dynamics: The scaled dynamics.
        force_limit: Proofs have to hold for normal forces up to this, scaled.
        is_over: Tells after so many nodes whether the search has to end.
    """
    programs, goals = KeptPrograms(dynamics), point_goals(dynamics)
    count = dynamics.contact_count
    root = _Node(-1, States.unknown(count), list(range(1, len(goals))))
    waiting, given_up, nodes = [root], [], 0
    while waiting and not is_over(nodes):
        node = waiting.pop()
        nodes += 1
        point = _bounded(dynamics, programs, goals, node, force_limit)
        if point is None:
            continue
        y, forces = point
        contact, parts = split(dynamics, np.zeros(count), node.states, y, forces)
        gaps = float(coulomb_gaps(dynamics, forces, dynamics.slips(y)).sum())
        if not parts or gaps <= NEAR * float(y @ y):
            motion = polish(dynamics, forces)
            if motion is not None:
                return Kept(None, motion, (), nodes, len(waiting), programs.programs)
        node.children = [_Node(contact, states, list(node.left)) for states in parts]
        if not parts:
            given_up.append(node)
        waiting += reversed(node.children)
    left = [*given_up, *reversed(waiting)]
    tree = None if left else root.finished()
    resisting = left[0].states.state if left else ()
    return Kept(tree, None, resisting, nodes, len(left), programs.programs)


def _bounded(
    dynamics: Dynamics,
    programs: KeptPrograms,
    goals: FloatArray,
    node: _Node,
    force_limit: float,
) -> tuple[FloatArray, FloatArray] | None:
    """Prove what can be proven of a node; return y and forces of the first goal that is left."""
    states = node.states
    programs.set(states)
    for index in (0, *node.left):
        answer = programs.largest(goals[index], states)
        if answer is None:
            return np.zeros(len(dynamics.load)), np.zeros((dynamics.contact_count, 3))
        dual, forces, y = answer
        dual = completed(dynamics, states, dual, goals[index])
        bound = goal_bound(dynamics, states, dual, force_limit)
        if bound <= (1.0 if index else _EMPTY):
            node.sides.append((index, dual))
            if not index:
                return None
        elif index:
            node.left = node.left[node.left.index(index) :]
            return y, forces
        else:
            programs.keep_load()
    return None
