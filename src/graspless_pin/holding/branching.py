"""The proof by branching: what each contact does, and where it slips, until nothing moves.

What the states of some contacts force on others, by kinematics alone.

Three closed corners of a face close the fourth; two contacts that stick keep a third from slipping.
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
    """A contact that can only be in one state.

    Attributes:
        contact: Its index.
        state: Closed or sticking.
        duals: What proves it: that u_n is at most the tolerance, or that u_t1 and u_t2 are.
        depends: Whether its rows depend on those of closed and sticking contacts.
        most: What they prove u_n or |u_t| to be at most, scaled.
    """

    contact: int
    state: ContactState
    duals: tuple[DualBound, ...]
    depends: bool
    most: float


def forced_state(dynamics: Dynamics, states: States) -> ForcedContact | None:
    """Return one contact whose state follows from the others', None where there is none.

    An open or a slipping contact may part or slip by the closing tolerance at most, since that is
    left to its closed or sticking sibling.
    """
    tolerance, rows = closing_tolerance(dynamics), dynamics.rows
    commanded, moving = dynamics.is_commanded, (ContactState.OPEN, ContactState.SLIPPING)
    enough = np.where(states.are(*moving), tolerance, _LOOSEST)
    fixed = fixed_rows(dynamics, states)
    try:
        still = null_space(fixed, rcond=RANK) if len(fixed) else np.eye(rows.shape[2])
    except np.linalg.LinAlgError:
        return None
    parting = np.flatnonzero(~commanded & states.are(ContactState.FREE, ContactState.OPEN))
    normals = rows[parting, 0] @ still
    for index, contact in enumerate(parting):
        others = np.delete(np.arange(len(parting)), index)
        shares, error = np.zeros(len(others)), float(np.linalg.norm(normals[index]))
        if error > tolerance and len(others):
            found = nonnegative_squares(normals[others].T, -normals[index])
            if found is None:
                continue
            shares, error = found, float(np.linalg.norm(found @ normals[others] + normals[index]))
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
    slipping = states.are(ContactState.CLOSED, ContactState.SLIPPING) & ~states.does_not_slip
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
    """Return what multipliers prove of a row; inf where they leave more of it than rounding."""
    rows, tolerance = dynamics.rows, closing_tolerance(dynamics)
    residual = row + dual.normal @ rows[:, 0] + np.einsum("li,lin->n", dual.tangential, rows[:, 1:])
    size = float(np.linalg.norm(residual))
    # Either way: a sticking contact may slip to both sides.
    both = max(closing_slack(states, sign * dual.normal, dual.tangential) for sign in (1.0, -1.0))
    return size + both if size <= tolerance else np.inf


_SPLIT_SLACK = 0.01
"""Of the closing tolerance: what open and slipping contacts leave to closed and sticking ones, but
for what many others add up to."""
_LOOSEST = 1e-9
"""Scaled accelerations: what is known to no less tells nothing."""
_QUADRANT = 0.25 * np.pi
"""Half the width of the first sectors of slip."""
NEAR_OUTCOME = 0.3
"""Share of the power that a point may miss Coulomb's law by where an outcome is looked for."""
_FINGERS_FIRST = 3.0
"""Weight of contacts that joints drive: what fingers do decides what supports have to bear."""
_LOADS_ANEW = 3
"""Sets of outcomes, of which each such one is asked for larger normal forces."""
_SWEPT = 50
"""Sets of outcomes, of which each such one's forces begin a search for a moving outcome, however
far they are from one: points of split patches do not come near."""
_LEAST_GAP = 1e-15
"""Power by which any contact counts as missing Coulomb's law: at rest what is widest is split."""
_NARROW = 0.2
"""Motions of a patch that span less, rad, may be about one of its contacts."""
_NARROWEST = 1e-4
"""Half the width of a sector that is not halved any more, rad."""


@dataclass
class UnprovenSet:
    """A set of outcomes on the way to its proof."""

    contact: int
    states: States
    relaxation: Relaxation | None = None
    """With the smallest normal forces that are known here; None: it is done with."""
    forced: tuple[DualBound, ...] = ()
    loads: tuple[LoadProof, ...] = ()
    children: list[UnprovenSet] = field(default_factory=list)
    dual: DualBound | None = None
    is_closed: bool = False
    """Whether kinematics force no more than is known already."""
    patch: PatchSlip | None = None
    """What is known of the patch that its parent was split at."""
    remaining: list[int] = field(default_factory=list)
    """Under a declared motion, the goals that are not proven yet."""
    sides: list[tuple[int, DualBound]] = field(default_factory=list)
    """And those that are."""
    siblings: dict[tuple[int, ContactState], tuple[UnprovenSet, Relaxation]] = field(
        default_factory=dict
    )
    """Of this set and of those around it, by contact and state, those in which it is closed or
    sticks, and what they began with: what open and slipping contacts leave is left to them."""

    @property
    def state(self) -> ContactState:
        """What is known of the contact, or of the slip of its patch."""
        if self.patch is not None:
            return ContactState.STICKING if self.patch.cone is None else ContactState.SLIPPING
        return ContactState.FREE if self.contact < 0 else self.states.state[self.contact]

    def pop_relaxation(self) -> Relaxation:
        """Return the relaxation, which is not kept any longer: trees have thousands of nodes."""
        relaxation, self.relaxation = self.relaxation, None
        if relaxation is None:
            raise RuntimeError("a set of outcomes is looked at once")
        return relaxation

    def take_over_slack(self, most: float, relaxation: Relaxation, enough: float) -> bool:
        """Have the contact part or slip by so much; return whether the set is looked at anew.

        Args:
            most: What is left to this set, scaled.
            relaxation: With which it began.
            enough: No set is looked at a third time for less.
        """
        known = self.states.slips if self.state is ContactState.STICKING else self.states.parts
        if most <= known[self.contact]:
            return False
        again = self.relaxation is None
        self.states = self.states.changed(self.contact, self.state, most=enough if again else most)
        if again:
            self.relaxation, self.children, self.dual, self.loads = relaxation, [], None, ()
        return again

    def proof_node(self) -> OutcomeSet:
        """Return the node of the proof."""
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
    """How far a search through all sets of outcomes came.

    Attributes:
        tree: The proof that nothing moves, or that nothing moves otherwise than declared; None
            where it is not finished.
        motion: (M, 3) scaled forces of an outcome that does, where one was met.
        nodes: Sets of which linear programs were asked for.
        remaining: Sets that were left.
        programs: Linear programs solved.
        resisting: Under a declared motion, the states of the contacts in the first set that was
            left, where one was.
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
    """Prove that nothing moves, or find what does.

    Args:
        dynamics: The scaled dynamics.
        relaxation: Its relaxations.
        is_over: Tells after so many of these nodes whether the search has to end.
    """
    root = UnprovenSet(-1, States.unknown(dynamics.contact_count), relaxation)
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
        relaxation = node.pop_relaxation().without_free_joints(node.states.are(ContactState.OPEN))
        goal, aside = (relaxation.dynamics.load, nothing), relaxation.dynamics.aside
        threshold = relaxation.proof_threshold(node.states)
        node.dual = relaxation.bounds.proving(node.states, goal[0], threshold)
        if node.dual is not None:
            continue
        nodes += 1
        if nodes % _LOADS_ANEW == 0 and not dynamics.spread.any():
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
    """Add what kinematics force.

    Outcomes in which an open contact does not part are among those in which it is closed, and a
    slipping one that does not slip sticks: but for what rounding hides, which is left to these.

    Returns:
        The last node, whether siblings hold all of it, and those that have to be looked at anew.
    """
    while (forced := forced_state(dynamics, node.states)) is not None:
        contact, state = forced.contact, forced.state
        known = node.states.state[contact]
        states = node.states.changed(contact, state, depends=forced.depends, most=forced.most)
        child = UnprovenSet(
            contact, states, node.pop_relaxation(), forced.duals, siblings=node.siblings
        )
        node.children = [child]
        node = child
        if known in (ContactState.OPEN, ContactState.SLIPPING):
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
        nodes = [UnprovenSet(contact, each, relaxation) for each in parts]
        rest = [one for one in nodes if one.state in (ContactState.CLOSED, ContactState.STICKING)]
        siblings = siblings | {(contact, one.state): (one, relaxation) for one in rest}
    else:
        was_closed, contact = True, patch.contacts[0]
        most = PATCH_TOLERANCE * closing_tolerance(dynamics)
        nodes = [
            UnprovenSet(contact, states.with_patch(part, most), relaxation, patch=part)
            for part in patch.split(states.patch_slip(patch), y)
        ]
    for node in nodes:
        # What opens adds nothing to what kinematics fix, nor does what is closed and slips.
        slips = node.state is ContactState.SLIPPING and was_closed
        node.is_closed = node.state is ContactState.OPEN or slips
        node.siblings = siblings
    return nodes


def _nearby_outcome(
    dynamics: Dynamics, relaxed: RelaxationPoint, y: FloatArray
) -> FloatArray | None:
    """Return a moving outcome near the best point of a relaxation, whose motion is y."""
    if relaxed.load_left < 0.5 or dynamics.point_acceleration(y) <= dynamics.limit:
        return None
    power = float(dynamics.load @ y)
    gaps = coulomb_gaps(dynamics, relaxed.forces, dynamics.slips(y))
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
    """Split the contact whose force and slip miss Coulomb's law most.

    Args:
        dynamics: The scaled dynamics.
        loads: (M,) normal forces that every outcome has at least, scaled.
        states: Of the contacts.
        y: (n,) the motion of a point.
        forces: (M, 3) its contact forces, scaled.
        patches: Contacts whose slips are split together: of each it is split whether it opens.
        least: Of those that miss it by less, weighted, none is split.

    Returns:
        The contact, and states that together leave out nothing; none where no contact is left.
    """
    never_opens = dynamics.is_commanded | (loads > 0.0)
    may_open = states.are(ContactState.FREE) & ~never_opens
    whole = ~states.are(ContactState.OPEN, ContactState.STICKING)
    whole &= ~(states.are(ContactState.SLIPPING) & (states.half_width <= _NARROWEST))
    # Without friction it does not matter where a closed contact slips.
    whole &= (dynamics.friction > 0.0) | (states.are(ContactState.FREE) & ~dynamics.is_commanded)
    u = dynamics.slips(y)
    gaps, slips = coulomb_gaps(dynamics, forces, u), np.hypot(u[:, 1], u[:, 2])
    gaps = gaps + 1e-9 * slips + _LEAST_GAP
    for patch in patches:
        members = np.array(patch.contacts)
        members = members[~_is_lone(states, patch)[members]]
        whole[members] &= may_open[members]
        gaps[members] = np.abs(forces[members, 0] * u[members, 0]) + _LEAST_GAP
    # A narrow sector has little left to give.
    widths = np.where(may_open, _QUADRANT, np.minimum(states.half_width, _QUADRANT))
    score = np.where(whole, gaps * _contact_weights(dynamics) * widths, -1.0)
    contact = int(np.argmax(score))
    if not whole[contact] or score[contact] < least:
        return contact, []
    most, may_part = _SPLIT_SLACK * closing_tolerance(dynamics), not never_opens[contact]
    return contact, _child_states(states, contact, u[contact, 1:], most, may_open=may_part)


def _is_lone(states: States, patch: Patch) -> NDArray[np.bool_]:
    """Return the (M,) contacts that are split by themselves, as a patch turns about them."""
    known = states.patch_slip(patch)
    if known is None or known.cone is None or known.width > _NARROW:
        return np.zeros(len(states.state), dtype=bool)
    return (states.half_width >= np.pi) | states.are(ContactState.STICKING, ContactState.SLIPPING)


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
    """Return the patch whose friction misses Coulomb's law most, and by how much, weighted."""
    found: tuple[Patch | None, float] = None, 0.0
    if not patches:
        return found
    u, weights = dynamics.slips(y), _contact_weights(dynamics)
    u[:, 0] = 0.0
    gaps = coulomb_gaps(dynamics, forces, u) + 1e-9 * np.hypot(u[:, 1], u[:, 2])
    gaps += _LEAST_GAP
    for patch in patches:
        known = states.patch_slip(patch)
        width = np.pi if known is None else known.width
        if width > _NARROWEST:
            members = [*patch.contacts]
            score = float((gaps * ~_is_lone(states, patch))[members].sum()) * min(width, _QUADRANT)
            score *= weights[patch.contacts[0]]
            if score > found[1]:
                found = patch, score
    return found


def _child_states(
    states: States, contact: int, slip: FloatArray, most: float, *, may_open: bool
) -> list[States]:
    """Return open and closed, or sticking and four sectors of slip, or two halves of a sector.

    Closed and sticking contacts part or slip by so much.
    """
    state, slipping = states.state[contact], ContactState.SLIPPING
    if state is ContactState.FREE and may_open:
        opened = states.changed(contact, ContactState.OPEN)
        return [opened, states.changed(contact, ContactState.CLOSED, most=most)]
    if state is slipping:
        half, middle = 0.5 * float(states.half_width[contact]), float(states.center[contact])
        sectors, first = [(middle - half, half), (middle + half, half)], []
    else:
        middle = float(np.arctan2(slip[1], slip[0]))
        sectors = [(middle + k * 2.0 * _QUADRANT, _QUADRANT) for k in range(4)]
        first = [states.changed(contact, ContactState.STICKING, most=most)]
    return first + [states.changed(contact, slipping, *sector) for sector in sectors]
