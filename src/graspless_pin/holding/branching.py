"""The proof by branching over contact states and slip directions that no outcome moves.

States of some contacts force states of others by kinematics alone: three closed corners of a face
close the fourth; two sticking contacts keep a third from slipping.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from graspless_pin.holding.bounds import (
    PATCH_TOLERANCE,
    RANK,
    States,
    closing_slack,
    closing_tolerance,
    fixed_rows,
    kinematic_dual,
)
from graspless_pin.holding.dynamics import Dynamics
from graspless_pin.holding.least_squares import nonnegative_squares
from graspless_pin.holding.patches import Patch, PatchSlip, find_patches
from graspless_pin.holding.relaxation import Relaxation, RelaxationPoint
from graspless_pin.holding.unstable_motion import coulomb_gaps, polish, settled_motion
from graspless_pin.holding.verdict import ContactState, DualBound, LoadProof, OutcomeSet, SlipRange
from graspless_pin.problem.checks import FloatArray
from graspless_pin.tree_search import TreeSearch


@dataclass(frozen=True, eq=False)
class ForcedContact:
    """A contact whose state follows from those of others by kinematics.

    Attributes:
        contact: Its index.
        state: Closed or sticking.
        duals: Multipliers that prove u_n, or u_t1 and u_t2, to be at most the tolerance.
        depends: Whether its rows depend on those of closed and sticking contacts.
        most: The bound on u_n or |u_t| that they prove, scaled.
    """

    contact: int
    state: ContactState
    duals: tuple[DualBound, ...]
    depends: bool
    most: float


def forced_state(dynamics: Dynamics, states: States) -> ForcedContact | None:
    """Return one contact whose state follows from the others'; None: there is none.

    An open or slipping contact must be proven to part or slip by the closing tolerance at most:
    such outcomes are left to its closed or sticking sibling.
    """
    tolerance, rows = closing_tolerance(dynamics), dynamics.rows
    commanded, moving = dynamics.is_commanded, (ContactState.OPEN, ContactState.SLIPPING)
    enough = np.where(states.is_in(*moving), tolerance, _LOOSEST)
    fixed = fixed_rows(dynamics, states)
    try:
        still = null_space(fixed, rcond=RANK) if len(fixed) else np.eye(rows.shape[2])
    except np.linalg.LinAlgError:
        return None
    parting = np.flatnonzero(~commanded & states.is_in(ContactState.FREE, ContactState.OPEN))
    normals = rows[parting, 0] @ still
    for index, contact in enumerate(parting):
        others = np.delete(np.arange(len(parting)), index)
        shares, error = np.zeros(len(others)), float(np.linalg.norm(normals[index]))
        if error > tolerance and len(others):
            fit = nonnegative_squares(normals[others].T, -normals[index])
            if fit is None:
                continue
            shares, error = fit, float(np.linalg.norm(fit @ normals[others] + normals[index]))
        if error <= tolerance:
            weights = np.zeros(len(rows))
            weights[parting[others]] = shares
            goal = rows[contact, 0] + weights @ rows[:, 0]
            dual = kinematic_dual(dynamics, states, goal, weights)
            most = _row_bound(dynamics, states, dual, rows[contact, 0])
            if most <= enough[contact]:
                return ForcedContact(
                    int(contact), ContactState.CLOSED, (dual,), not shares.any(), most
                )
    slipping = states.is_in(ContactState.CLOSED, ContactState.SLIPPING) & ~states.does_not_slip
    for contact in np.flatnonzero(slipping):
        if np.linalg.norm(rows[contact, 1:] @ still) <= tolerance:
            none = np.zeros(len(rows))
            duals = [kinematic_dual(dynamics, states, row, none) for row in rows[contact, 1:]]
            first, second = map(partial(_row_bound, dynamics, states), duals, rows[contact, 1:])
            most = float(np.hypot(first, second))
            if most <= enough[contact]:
                sticking = ContactState.STICKING
                return ForcedContact(int(contact), sticking, tuple(duals), depends=True, most=most)
    return None


def _row_bound(dynamics: Dynamics, states: States, dual: DualBound, row: FloatArray) -> float:
    """Return the bound on |row.y| that multipliers prove; inf if more than rounding remains."""
    rows, tolerance = dynamics.rows, closing_tolerance(dynamics)
    residual = row + dual.normal @ rows[:, 0] + np.einsum("li,lin->n", dual.tangential, rows[:, 1:])
    size = float(np.linalg.norm(residual))
    # The larger of both signs: a sticking contact may slip to either side.
    both = max(closing_slack(states, sign * dual.normal, dual.tangential) for sign in (1.0, -1.0))
    return size + both if size <= tolerance else np.inf


_SPLIT_SLACK = 0.01
"""Share of the closing tolerance by which closed and sticking contacts part or slip after a split:
their open and slipping siblings leave this much to them."""
_LOOSEST = 1e-9
"""Scaled accelerations: a larger bound does not force a state."""
_QUADRANT = 0.25 * np.pi
"""Half the width of the first sectors of slip, rad."""
NEAR_OUTCOME = 0.3
"""Violation of Coulomb's law, as a share of the power, up to which a point is polished."""
_FINGERS_FIRST = 3.0
"""Weight of contacts that joints drive: their states decide what supports have to bear."""
_LOADS_ANEW = 3
"""One in this number of sets is searched for proofs that raise the smallest normal forces."""
_SWEPT = 50
"""The forces of one in this number of sets start a search for a moving outcome, however far they
are from one: points of split patches do not come near."""
_LEAST_GAP = 1e-15
"""Least violation of Coulomb's law of any contact, as power: at rest the widest arc is split."""
_NARROW = 0.2
"""A patch whose motions span less, rad, may turn about one of its contacts."""
_NARROWEST = 1e-4
"""Half the width of a sector that is not halved any more, rad."""


@dataclass
class UnprovenSet:
    """A node of the search: a set of outcomes that is not proven yet."""

    contact: int
    states: States
    relaxation: Relaxation | None = None
    """With the smallest normal forces known here; None: it has been used."""
    forced: tuple[DualBound, ...] = ()
    loads: tuple[LoadProof, ...] = ()
    children: list[UnprovenSet] = field(default_factory=list)
    dual: DualBound | None = None
    is_closed: bool = False
    """Whether kinematics are known to force no further state."""
    patch: PatchSlip | None = None
    """The slip of the patch that its parent was split at."""
    remaining: list[int] = field(default_factory=list)
    """Under a declared motion, the goals that are not proven yet."""
    sides: list[tuple[int, DualBound]] = field(default_factory=list)
    """And the proven goals, with their multipliers."""
    siblings: dict[tuple[int, ContactState], tuple[UnprovenSet, Relaxation]] = field(
        default_factory=dict
    )
    """By contact and state, the siblings of this set and of its ancestors in which that contact is
    closed or sticks, with their first relaxations. Outcomes that open and slipping contacts leave
    out are left to them."""

    @property
    def state(self) -> ContactState:
        """The state of the contact, or of its patch: sticking or slipping."""
        if self.patch is not None:
            return ContactState.STICKING if self.patch.cone is None else ContactState.SLIPPING
        return ContactState.FREE if self.contact < 0 else self.states.state[self.contact]

    def pop_relaxation(self) -> Relaxation:
        """Return the relaxation and release it: trees have thousands of nodes."""
        relaxation, self.relaxation = self.relaxation, None
        if relaxation is None:
            raise RuntimeError("a set of outcomes is searched only once")
        return relaxation

    def take_over_slack(self, most: float, relaxation: Relaxation, enough: float) -> bool:
        """Raise the tolerance of the contact; return whether the set has to be searched again.

        Args:
            most: Bound on u_n or |u_t| of the outcomes that are left to this set, scaled.
            relaxation: With which it began.
            enough: Tolerance that it gets when it is searched again: no third time is needed.
        """
        tolerances = self.states.slips if self.state is ContactState.STICKING else self.states.parts
        if most <= tolerances[self.contact]:
            return False
        again = self.relaxation is None
        self.states = self.states.with_state(
            self.contact, self.state, most=enough if again else most
        )
        if again:
            self.relaxation, self.children, self.dual, self.loads = relaxation, [], None, ()
        return again

    def proof_node(self) -> OutcomeSet:
        """Return this node of the proof, with its children."""
        slip = None
        if self.patch is None and self.state is ContactState.SLIPPING:
            states, contact = self.states, self.contact
            slip = SlipRange(float(states.center[contact]), float(states.half_width[contact]))
        children = tuple(child.proof_node() for child in self.children)
        return OutcomeSet(
            self.contact, self.state, slip, children, self.dual, self.forced, self.loads,
            tuple(self.sides), self.patch,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of a search through all sets of outcomes.

    Attributes:
        tree: The proof that nothing moves, or nothing but the declared motion; None: unfinished.
        motion: (M, 3) scaled forces of an outcome that moves; None: none was found.
        nodes: Sets for which linear programs were solved.
        remaining: Sets that were left unproven.
        programs: Linear programs solved.
        resisting: Under a declared motion, the states of the contacts in the first unproven set,
            if there is one.
    """

    tree: OutcomeSet | None
    motion: FloatArray | None
    nodes: int
    remaining: int
    programs: int
    resisting: tuple[ContactState, ...] = ()


def branch(
    dynamics: Dynamics, relaxation: Relaxation, is_over: Callable[[int], bool]
) -> SearchResult:
    """Prove by branch and bound that no outcome moves, or find one that does.

    Args:
        dynamics: The scaled dynamics.
        relaxation: Its relaxation.
        is_over: Returns for a number of nodes whether the search has to end.
    """
    root = UnprovenSet(-1, States.all_free(dynamics.contact_count), relaxation)
    nothing = np.zeros((dynamics.contact_count, 3))
    tolerance = PATCH_TOLERANCE * closing_tolerance(dynamics)
    patches = find_patches(dynamics.rows, dynamics.friction, tolerance)
    search, nodes, given_up = TreeSearch([root]), 0, 0
    for _, node in search:
        if is_over(nodes):
            open_count = 1 + len(search) + given_up
            return SearchResult(None, None, nodes, open_count, relaxation.programs)
        if not node.is_closed:
            node, is_covered, again = _add_forced_states(dynamics, node)
            search.add(again)
            if is_covered:
                continue
        relaxation = node.pop_relaxation().without_free_joints(node.states.is_in(ContactState.OPEN))
        goal, aside = (relaxation.dynamics.load, nothing), relaxation.dynamics.free_motion
        threshold = relaxation.proof_threshold(node.states)
        node.dual = relaxation.bounds.remembered_proof(node.states, goal[0], threshold)
        if node.dual is not None:
            continue
        nodes += 1
        if nodes % _LOADS_ANEW == 0 and not dynamics.load_change.any():
            node.loads = tuple(relaxation.larger_loads(node.states))
            if node.loads:
                relaxation = relaxation.with_loads(node.loads)
        relaxed = relaxation.solve(node.states, goal)
        y, forces = aside, nothing
        if relaxed is not None:
            if relaxed.bound <= threshold:
                node.dual = relaxed.dual
                relaxation.bounds.remember(relaxed.dual)
                continue
            y, forces = relaxed.y + aside, relaxed.forces
            motion = _nearby_outcome(dynamics, relaxed, y)
            if motion is None and nodes % _SWEPT == 0:
                motion = settled_motion(dynamics, forces)
            if motion is not None:
                return SearchResult(None, motion, nodes, len(search), relaxation.programs)
        node.children = _split_set(dynamics, node, relaxation, y, forces, patches)
        if not node.children:
            given_up += 1
        search.add(reversed(node.children))
    tree = None if given_up else root.proof_node()
    return SearchResult(tree, None, nodes, given_up, relaxation.programs)


def _add_forced_states(
    dynamics: Dynamics, node: UnprovenSet
) -> tuple[UnprovenSet, bool, list[UnprovenSet]]:
    """Add child nodes for all contact states that kinematics force.

    If an open contact is forced to be closed, or a slipping one to stick, the sibling in that state
    holds all outcomes of the node; its tolerance takes over the rounding.

    Returns:
        The last node, whether siblings cover it, and the siblings that must be searched again.
    """
    while (forced := forced_state(dynamics, node.states)) is not None:
        contact, state = forced.contact, forced.state
        before = node.states.state[contact]
        states = node.states.with_state(contact, state, depends=forced.depends, most=forced.most)
        child = UnprovenSet(
            contact, states, node.pop_relaxation(), forced.duals, siblings=node.siblings
        )
        node.children = [child]
        node = child
        if before in (ContactState.OPEN, ContactState.SLIPPING):
            sibling, relaxation = node.siblings[contact, state]
            again = sibling.take_over_slack(forced.most, relaxation, closing_tolerance(dynamics))
            return node, True, [sibling] * again
    return node, False, []


def _split_set(
    dynamics: Dynamics,
    parent: UnprovenSet,
    relaxation: Relaxation,
    y: FloatArray,
    forces: FloatArray,
    patches: Sequence[Patch],
) -> list[UnprovenSet]:
    """Split a set where a point violates Coulomb's law most. Arguments as of `split_contact`."""
    states, siblings = parent.states, parent.siblings
    patch, least = _widest_patch(dynamics, states, y, forces, patches)
    contact, parts = split_contact(dynamics, relaxation.loads, states, y, forces, patches, least)
    if parts or patch is None:
        was_closed = states.state[contact] is not ContactState.FREE
        nodes = [UnprovenSet(contact, part, relaxation) for part in parts]
        fixed = [n for n in nodes if n.state in (ContactState.CLOSED, ContactState.STICKING)]
        siblings = siblings | {(contact, node.state): (node, relaxation) for node in fixed}
    else:
        was_closed, contact = True, patch.contacts[0]
        most = PATCH_TOLERANCE * closing_tolerance(dynamics)
        nodes = [
            UnprovenSet(contact, states.with_patch(part, most), relaxation, patch=part)
            for part in patch.split(states.patch_slip(patch), y)
        ]
    for node in nodes:
        # Opening a contact adds no fixed row, nor does slip of a contact that was closed.
        slips = node.state is ContactState.SLIPPING and was_closed
        node.is_closed = node.state is ContactState.OPEN or slips
        node.siblings = siblings
    return nodes


def _nearby_outcome(
    dynamics: Dynamics, relaxed: RelaxationPoint, y: FloatArray
) -> FloatArray | None:
    """Return forces (M, 3) of a moving outcome near the best point of a relaxation, or None."""
    if relaxed.load_left < 0.5 or dynamics.point_acceleration(y) <= dynamics.limit:
        return None
    power = float(dynamics.load @ y)
    gaps = coulomb_gaps(dynamics, relaxed.forces, dynamics.contact_motion(y))
    if float(gaps.sum()) > NEAR_OUTCOME * power:
        return None
    return polish(dynamics, relaxed.forces)


def split_contact(
    dynamics: Dynamics,
    loads: FloatArray,
    states: States,
    y: FloatArray,
    forces: FloatArray,
    patches: Sequence[Patch] = (),
    least: float = 0.0,
) -> tuple[int, list[States]]:
    """Split the contact whose force and slip violate Coulomb's law most.

    Args:
        dynamics: The scaled dynamics.
        loads: (M,) smallest normal forces of all outcomes, scaled.
        states: Of the contacts.
        y: (n,) the motion of a point.
        forces: (M, 3) its contact forces, scaled.
        patches: Contacts whose slips are split together; alone they are only split into open and
            closed.
        least: Contacts with a smaller weighted violation are not split.

    Returns:
        The contact, and states that together cover the set; empty where no contact can be split.
    """
    never_opens = dynamics.is_commanded | (loads > 0.0)
    may_open = states.is_in(ContactState.FREE) & ~never_opens
    whole = ~states.is_in(ContactState.OPEN, ContactState.STICKING)
    whole &= ~(states.is_in(ContactState.SLIPPING) & (states.half_width <= _NARROWEST))
    # Without friction the slip direction of a closed contact does not matter.
    whole &= (dynamics.friction > 0.0) | (states.is_in(ContactState.FREE) & ~dynamics.is_commanded)
    u = dynamics.contact_motion(y)
    gaps, slips = coulomb_gaps(dynamics, forces, u), np.hypot(u[:, 1], u[:, 2])
    gaps = gaps + 1e-9 * slips + _LEAST_GAP
    for patch in patches:
        members = np.array(patch.contacts)
        members = members[~_is_lone(states, patch)[members]]
        whole[members] &= may_open[members]
        gaps[members] = np.abs(forces[members, 0] * u[members, 0]) + _LEAST_GAP
    # Splitting a narrow sector gains little.
    widths = np.where(may_open, _QUADRANT, np.minimum(states.half_width, _QUADRANT))
    score = np.where(whole, gaps * _contact_weights(dynamics) * widths, -1.0)
    contact = int(np.argmax(score))
    if not whole[contact] or score[contact] < least:
        return contact, []
    most, may_part = _SPLIT_SLACK * closing_tolerance(dynamics), not never_opens[contact]
    return contact, _child_states(states, contact, u[contact, 1:], most, may_open=may_part)


def _is_lone(states: States, patch: Patch) -> NDArray[np.bool_]:
    """Return the (M,) contacts that are split by themselves: the patch may turn about them."""
    slip = states.patch_slip(patch)
    if slip is None or slip.cone is None or slip.width > _NARROW:
        return np.zeros(len(states.state), dtype=bool)
    return (states.half_width >= np.pi) | states.is_in(ContactState.STICKING, ContactState.SLIPPING)


def _contact_weights(dynamics: Dynamics) -> FloatArray:
    driven = dynamics.rows[:, :, len(dynamics.levers) :].any(axis=(1, 2))
    return np.where(driven, _FINGERS_FIRST, 1.0)


def _widest_patch(
    dynamics: Dynamics,
    states: States,
    y: FloatArray,
    forces: FloatArray,
    patches: Sequence[Patch],
) -> tuple[Patch | None, float]:
    """Return the patch whose friction violates Coulomb's law most, and its weighted violation."""
    widest: tuple[Patch | None, float] = None, 0.0
    if not patches:
        return widest
    u, weights = dynamics.contact_motion(y), _contact_weights(dynamics)
    u[:, 0] = 0.0
    gaps = coulomb_gaps(dynamics, forces, u) + 1e-9 * np.hypot(u[:, 1], u[:, 2])
    gaps += _LEAST_GAP
    for patch in patches:
        slip = states.patch_slip(patch)
        width = np.pi if slip is None else slip.width
        if width > _NARROWEST:
            members = [*patch.contacts]
            score = float((gaps * ~_is_lone(states, patch))[members].sum()) * min(width, _QUADRANT)
            score *= weights[patch.contacts[0]]
            if score > widest[1]:
                widest = patch, score
    return widest


def _child_states(
    states: States, contact: int, slip: FloatArray, most: float, *, may_open: bool
) -> list[States]:
    """Return open and closed, or sticking and four sectors of slip, or two halves of a sector.

    Closed and sticking contacts part or slip by ``most`` at most.
    """
    state, slipping = states.state[contact], ContactState.SLIPPING
    if state is ContactState.FREE and may_open:
        opened = states.with_state(contact, ContactState.OPEN)
        return [opened, states.with_state(contact, ContactState.CLOSED, most=most)]
    if state is slipping:
        half, middle = 0.5 * float(states.half_width[contact]), float(states.center[contact])
        sectors, first = [(middle - half, half), (middle + half, half)], []
    else:
        middle = float(np.arctan2(slip[1], slip[0]))
        sectors = [(middle + k * 2.0 * _QUADRANT, _QUADRANT) for k in range(4)]
        first = [states.with_state(contact, ContactState.STICKING, most=most)]
    return first + [states.with_state(contact, slipping, *sector) for sector in sectors]
