"""The proof by branching: what each contact does, and where it slips, until nothing moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from graspless_pin.holding.bounds import States
from graspless_pin.holding.closure import forced_state
from graspless_pin.holding.dynamics import Dynamics
from graspless_pin.holding.moving import polish
from graspless_pin.holding.relaxation import Relaxation, Relaxed
from graspless_pin.holding.verdict import ContactState, DualBound, OutcomeSet, SlipRange
from graspless_pin.problem.checks import FloatArray

_QUADRANT = 0.25 * np.pi
"""Half the width of the first sectors of slip."""
_NEAR = 0.3
"""Share of the power that a point may miss Coulomb's law by where an outcome is looked for."""
_NARROWEST = 1e-4
"""Half the width of a sector that is not halved any more, rad."""


@dataclass
class _Node:
    """A set of outcomes on the way to its proof."""

    contact: int
    state: ContactState
    states: States
    forced: tuple[DualBound, ...] = ()
    children: list[_Node] = field(default_factory=list)
    relaxed: Relaxed | None = None

    def finished(self) -> OutcomeSet:
        """Return the node of the proof."""
        slip = None
        if self.state is ContactState.SLIPPING:
            center, half_width = (
                float(part[self.contact]) for part in (self.states.center, self.states.half_width)
            )
            slip = SlipRange(center, half_width)
        children = tuple(child.finished() for child in self.children)
        dual = None if self.relaxed is None or children else self.relaxed.dual
        return OutcomeSet(self.contact, self.state, slip, children, dual, self.forced)


@dataclass(frozen=True, eq=False)
class Branched:
    """How far branching came.

    Attributes:
        tree: The proof; None where it is not finished.
        motion: (M, 3) scaled forces of a moving outcome, where one was met.
        nodes: Nodes looked at.
        left: Nodes that were left.
    """

    tree: OutcomeSet | None
    motion: FloatArray | None
    nodes: int
    left: int


def branch(dynamics: Dynamics, relaxation: Relaxation, is_over: Callable[[int], bool]) -> Branched:
    """Prove that nothing moves, or find what does.

    Args:
        dynamics: The scaled dynamics.
        relaxation: Its relaxations.
        is_over: Tells after so many nodes whether the search has to end.
    """
    root = _Node(-1, ContactState.FREE, States.unknown(dynamics.contact_count))
    goal = dynamics.load, np.zeros((dynamics.contact_count, 3))
    threshold = dynamics.resolution**2
    open_nodes, nodes, given_up = [root], 0, 0
    while open_nodes:
        if is_over(nodes):
            return Branched(None, None, nodes, len(open_nodes) + given_up)
        node = open_nodes.pop()
        nodes += 1
        node, is_covered = _closed(dynamics, node)
        if is_covered:
            continue
        node.relaxed = relaxation.solve(node.states, goal)
        if node.relaxed is not None and node.relaxed.bound <= threshold:
            continue
        if node.relaxed is not None:
            motion = _near(dynamics, node.relaxed)
            if motion is not None:
                return Branched(None, motion, nodes, len(open_nodes))
        node.children = _split(dynamics, relaxation.loads, node)
        if not node.children:
            given_up += 1
        open_nodes += reversed(node.children)
    return Branched(None if given_up else root.finished(), None, nodes, given_up)


def _closed(dynamics: Dynamics, node: _Node) -> tuple[_Node, bool]:
    """Add what kinematics force; return the last node, and whether siblings hold all of it.

    Outcomes in which an open contact does not part are among those in which it is closed, and a
    slipping one that does not slip sticks.
    """
    while (forced := forced_state(dynamics, node.states)) is not None:
        contact, state = forced.contact, forced.state
        known = node.states.state[contact]
        states = node.states.changed(contact, state, depends=forced.depends)
        child = _Node(contact, state, states, forced.duals)
        node.children = [child]
        node = child
        if known in (ContactState.OPEN, ContactState.SLIPPING):
            return node, True
    return node, False


def _near(dynamics: Dynamics, relaxed: Relaxed) -> FloatArray | None:
    """Return a moving outcome near the best point of a relaxation."""
    if relaxed.load_left < 0.5 or dynamics.point_acceleration(relaxed.y) <= dynamics.limit:
        return None
    power = float(dynamics.load @ relaxed.y)
    if float(_gaps(dynamics, relaxed).sum()) > _NEAR * power:
        return None
    return polish(dynamics, relaxed.forces)


def _gaps(dynamics: Dynamics, relaxed: Relaxed) -> FloatArray:
    """Return by how much each contact's force and slip miss Coulomb's law, as power; (M,)."""
    f, u = relaxed.forces, dynamics.slips(relaxed.y)
    held = dynamics.is_commanded
    normal = np.where(held, np.nan_to_num(dynamics.commanded), f[:, 0])
    gaps = (f[:, 1:] * u[:, 1:]).sum(axis=1)
    gaps += dynamics.friction * normal * np.hypot(u[:, 1], u[:, 2])
    return np.abs(gaps) + np.where(held, 0.0, np.abs(f[:, 0] * u[:, 0]))


def _split(dynamics: Dynamics, loads: FloatArray, node: _Node) -> list[_Node]:
    """Return the children: at the contact whose force and slip miss Coulomb's law most."""
    states = node.states
    splittable = ~states.are(ContactState.OPEN, ContactState.STICKING)
    splittable &= ~(states.are(ContactState.SLIPPING) & (states.half_width <= _NARROWEST))
    if not splittable.any():
        return []
    slips = gaps = np.zeros(dynamics.contact_count)
    u = np.zeros((dynamics.contact_count, 3))
    if node.relaxed is not None:
        u, gaps = dynamics.slips(node.relaxed.y), _gaps(dynamics, node.relaxed)
        slips = np.hypot(u[:, 1], u[:, 2])
    # A narrow sector has little left to give.
    score = np.where(splittable, (gaps + 1e-9 * slips) * states.half_width, -1.0)
    contact = int(np.argmax(score))
    return _children(states, contact, u[contact, 1:], loads, dynamics)


def _children(
    states: States, contact: int, slip: FloatArray, loads: FloatArray, dynamics: Dynamics
) -> list[_Node]:
    state, held = states.state[contact], bool(dynamics.is_commanded[contact])
    if state is ContactState.FREE and not held:
        kinds = [ContactState.CLOSED] if loads[contact] > 0.0 else [
            ContactState.OPEN, ContactState.CLOSED,
        ]  # fmt: skip
        if len(kinds) > 1:
            return [_Node(contact, kind, states.changed(contact, kind)) for kind in kinds]
        states = states.changed(contact, ContactState.CLOSED)
        state = ContactState.CLOSED
    if state in (ContactState.CLOSED, ContactState.FREE):
        middle = float(np.arctan2(slip[1], slip[0]))
        sectors = [(middle + k * 2.0 * _QUADRANT, _QUADRANT) for k in range(4)]
        sticking = states.changed(contact, ContactState.STICKING)
        first = [_Node(contact, ContactState.STICKING, sticking)]
    else:
        half = 0.5 * float(states.half_width[contact])
        middle = float(states.center[contact])
        sectors, first = [(middle - half, half), (middle + half, half)], []
    slipping = ContactState.SLIPPING
    return first + [
        _Node(contact, slipping, states.changed(contact, slipping, center, half_width))
        for center, half_width in sectors
    ]
