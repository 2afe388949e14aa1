"""The check of a proof over contact states: a tree whose leaves together cover all outcomes.

A node narrows the state of one contact. Whether its children cover it is worked out here: an
outcome without force at a contact counts as open there, one without parting as closed, one without
slip as sticking, and the arcs of slip have to cover the rest. Where a node is its parent's only
child, its multipliers prove the largest parting or slip of the contact, which proofs of closed and
sticking contacts allow for. Nodes are listed depth first.

A proof of rest states least normal forces first, then a certificate or such a tree.

Where a declared motion is the outcome, a leaf bounds the accelerations of all passive coordinates
with both signs, so that no point of the object accelerates above the limit, or goal 0, p = 0, below
zero: then there is no outcome in it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import Part
from graspless_pin.report.verify.outcome import Check, holds, within
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.rest_bounds import (
    Kind,
    KnownStates,
    RestDynamics,
    RestMultipliers,
    declared_motion_bound,
    declared_motion_goals,
    largest_goal,
    leaked_power,
    least_force,
    without_free_joints,
)
from graspless_pin.report.verify.rest_load import RestLoad
from graspless_pin.report.verify.rest_patches import (
    PatchSlip,
    read_patch,
    slip_tolerance,
    uncovered_motions,
    unproven_arcs,
)

_DEEPEST = 400
_EMPTY = -0.1
"""Largest bound on goal 0 that proves a leaf empty: multipliers of any size prove the same."""
_PASSED_OVER = {Kind.OPEN: Kind.CLOSED, Kind.SLIPPING: Kind.STICKING}
"""States that add no outcome to those of another state, where that one is forced."""


class NoProofError(Exception):
    """The nodes of a proof do not prove its claim."""


@dataclass(frozen=True, eq=False)
class RestNode:
    """A node of a proof: a set of outcomes, as stated."""

    contact: int
    kind: Kind
    arc: tuple[float, float]
    bound: RestMultipliers | None
    forced: list[RestMultipliers]
    sides: list[tuple[int, RestMultipliers]]
    children: list[RestNode] = field(default_factory=list)
    loads: list[LeastLoad] = field(default_factory=list)
    patch: PatchSlip | None = None


LeastLoad = tuple[int, float, RestMultipliers]
"""A contact, the normal force that every outcome has there at least, N, and what proves it."""


def _read_multipliers(stated: Part) -> RestMultipliers:
    return RestMultipliers(stated["motion"], stated["normal"], stated["tangential"])


def _read_loads(stated: Part) -> list[LeastLoad]:
    return [(one["contact"], one["force"], _read_multipliers(one["multipliers"]))
            for one in stated["loads"]]  # fmt: skip


def read_rest_tree(proof: Part, dynamics: RestDynamics) -> RestNode:
    """Return the root of the tree that the nodes of a proof form.

    Raises:
        ValueError: If they form none.
    """
    first, *others = proof.with_sizes(n=len(dynamics.load))["nodes"]
    root, count = _read_node(first, is_root=True)
    waiting = [(root, count)]
    for stated in others:
        while waiting and waiting[-1][1] == 0:
            waiting.pop()
        if not waiting:
            raise ValueError(f"{stated.where} has no parent: the tree is complete without it")
        parent, missing = waiting.pop()
        node, count = _read_node(stated, is_root=False)
        parent.children.append(node)
        waiting += [(parent, missing - 1), (node, count)]
        if len(waiting) > _DEEPEST:
            raise ValueError(f"{stated.where} is deeper than {_DEEPEST} nodes")
    if any(missing for _, missing in waiting):
        raise ValueError(f"{proof.where} lacks nodes")
    return root


def _read_node(stated: Part, *, is_root: bool) -> tuple[RestNode, int]:
    """Return a node without its children, and their number."""
    contact, kind, where = stated["contact"], Kind(stated["state"]), stated.where
    if (contact < 0 or kind == Kind.FREE) != is_root:
        raise ValueError(f"{where} must state a contact, and a state other than free" if not is_root
                         else f"{where} is the root: its state must be free")  # fmt: skip
    own = stated.get("patch")
    center, half_width = stated["slip"] if kind == Kind.SLIPPING and own is None else (0.0, np.pi)
    patch = None if own is None else read_patch(own)
    if patch is not None:
        expected = Kind.STICKING if patch.cone is None else Kind.SLIPPING
        if (contact, kind) != (patch.contacts[0], expected):
            raise ValueError(f"{where} has another contact or state than its patch")
    if not 0.0 <= half_width <= np.pi:
        raise ValueError(f"slip of {where} has the half width {half_width:.6g}; it must be 0 to pi")
    bound = stated.maybe("multipliers")
    node = RestNode(
        contact,
        kind,
        (float(center), float(half_width)),
        None if bound is None else _read_multipliers(bound),
        [_read_multipliers(one) for one in stated["forced"]],
        [(one["goal"], _read_multipliers(one["multipliers"])) for one in stated["sides"]],
        loads=_read_loads(stated),
        patch=patch,
    )
    return node, stated["children"]


@dataclass(eq=False)
class RestWalk:
    """A walk through one proof.

    Attributes:
        dynamics: The scaled dynamics.
        loads: (M,) normal forces that every outcome has at least, scaled.
        force_limit: Normal forces that the proof has to reach, scaled.
        still: The power up to which nothing moves, scaled.
        bound: The largest h.y over the leaves, without the free motion of joints.
        leaves: Number of leaves.
        known: The dynamics without free joints, by the contacts that are open.
    """

    dynamics: RestDynamics
    loads: np.ndarray
    force_limit: float
    still: float
    bound: float = 0.0
    leaves: int = 0
    known: dict[bytes, RestDynamics] = field(default_factory=dict)

    def walk(self, root: RestNode) -> None:
        """Check all nodes.

        Raises:
            NoProofError: If they leave out outcomes.
        """
        if self._visit(root, KnownStates.all_free(len(self.dynamics.rows)), self.loads):
            raise NoProofError("no node covers the outcomes that some nodes leave to others")

    def _visit(
        self, node: RestNode, states: KnownStates, loads: np.ndarray
    ) -> dict[tuple[int, str], float]:
        """Check a node; return the parting or slip that closed or sticking siblings must bear."""
        loads = self._with_proven_loads(node, states, loads)
        if not node.children:
            self._visit_leaf(node, states, loads)
            return {}
        first = node.children[0]
        if any(child.contact != first.contact for child in node.children):
            raise NoProofError(f"children of one node have contact {first.contact} and others")
        patches = [child.patch for child in node.children if child.patch is not None]
        if patches:
            return self._split_patch(node, patches, states, loads)
        if len(node.children) == 1:
            return self._visit_only_child(first, states, loads)
        is_loaded = np.isfinite(self.dynamics.commanded) | (loads > 0.0)
        why = uncovered_states(node.children, states, is_loaded)
        if why:
            raise NoProofError(f"contact {first.contact}: {why}")
        needed: dict[tuple[int, str], float] = {}
        # Outcomes that the others pass over are left to these, which come last.
        for child in sorted(
            node.children, key=lambda one: one.kind in (Kind.CLOSED, Kind.STICKING)
        ):
            allowed = needed.pop((child.contact, child.kind), 0.0)
            changed = states.with_state(child.contact, child.kind, child.arc, allowed)
            for key, value in self._visit(child, changed, loads).items():
                needed[key] = max(needed.get(key, 0.0), value)
        return needed

    def _split_patch(
        self, node: RestNode, patches: list[PatchSlip], states: KnownStates, loads: np.ndarray
    ) -> dict[tuple[int, str], float]:
        """Check the children of a node that splits a patch; return what `_visit` returns."""
        first = patches[0]
        if len(patches) < len(node.children):
            raise NoProofError(
                f"only some children of one node have a patch of contact {first.contacts[0]}"
            )
        why = uncovered_motions(patches, states.known_slip(first))
        if why:
            raise NoProofError(f"the patch of contact {first.contacts[0]}: {why}")
        allowed, needed = slip_tolerance(self.still), dict[tuple[int, str], float]()
        for child, patch in zip(node.children, patches, strict=True):
            wrong = unproven_arcs(patch, self.dynamics.rows, allowed)
            if wrong:
                raise NoProofError(f"arcs of slip of contacts {wrong} do not hold all slips")
            for key, value in self._visit(child, states.with_patch(patch, allowed), loads).items():
                needed[key] = max(needed.get(key, 0.0), value)
        return needed

    def _with_proven_loads(
        self, node: RestNode, states: KnownStates, loads: np.ndarray
    ) -> np.ndarray:
        """Return least normal forces with those that a node proves, each by the ones before it."""
        for contact, force, multipliers in node.loads:
            proven = least_force(
                self._dynamics_in(states), states, loads, (contact, multipliers), self.force_limit
            )
            if np.isfinite(proven):
                least = min(force / self.dynamics.force_unit, proven)
                loads = loads.copy()
                loads[contact] = max(loads[contact], least)
        return loads

    def _visit_leaf(self, node: RestNode, states: KnownStates, loads: np.ndarray) -> None:
        if node.bound is None:
            raise NoProofError("a leaf has no multipliers")
        own = self._dynamics_in(states)
        goal = own.load, np.zeros(own.rows.shape[:2])
        proven = largest_goal(own, states, loads, node.bound, goal, self.force_limit)
        if own.free_motion.any():
            proven += leaked_power(own, states.is_in(Kind.OPEN), self.force_limit)
        self.leaves += 1
        self.bound = max(self.bound, proven) if np.isfinite(proven) else np.inf

    def _dynamics_in(self, states: KnownStates) -> RestDynamics:
        """Return the dynamics without the free motion of joints in some states."""
        opened = states.is_in(Kind.OPEN)
        key = opened.tobytes()
        if key not in self.known:
            self.known[key] = without_free_joints(
                self.dynamics, opened, self.still, self.force_limit
            )
        return self.known[key]

    def _visit_only_child(
        self, child: RestNode, states: KnownStates, loads: np.ndarray
    ) -> dict[tuple[int, str], float]:
        """Check an only child, whose multipliers prove the state of its contact."""
        contact, known = child.contact, states.kinds[child.contact]
        rows, zeros = self.dynamics.rows[contact], np.zeros(self.dynamics.rows.shape[:2])

        def largest_along(row: np.ndarray, multipliers: RestMultipliers) -> float:
            goal = row, zeros
            return largest_goal(self.dynamics, states, loads, multipliers, goal, self.force_limit)

        count, kind = len(child.forced), child.kind
        if kind == Kind.CLOSED and known in (Kind.FREE, Kind.OPEN) and count == 1:
            tolerance = largest_along(rows[0], child.forced[0])
        elif kind == Kind.STICKING and known in (Kind.CLOSED, Kind.SLIPPING) and count == 2:
            pairs = [(row, one) for row, one in zip(rows[1:], child.forced, strict=True)]
            pairs += [(-row, one.reversed()) for row, one in pairs]
            sides = np.array([largest_along(row, one) for row, one in pairs])
            tolerance = float(np.linalg.norm(np.maximum(sides[:2], sides[2:])))
        else:
            raise NoProofError(
                f"{count} multipliers cannot prove contact {contact} ({known}) to be {child.kind}"
            )
        tolerance = max(tolerance, 0.0)
        if not np.isfinite(tolerance):
            raise NoProofError(f"the multipliers do not prove contact {contact} to be {child.kind}")
        if _PASSED_OVER.get(known) == child.kind and not child.children and child.bound is None:
            return {(contact, child.kind): tolerance}
        return self._visit(child, states.with_state(contact, child.kind, most=tolerance), loads)


def _count_kept_leaves(
    node: RestNode,
    states: KnownStates,
    proven: frozenset[int],
    dynamics: RestDynamics,
    goals: np.ndarray,
    force_limit: float,
) -> int:
    """Check a proof that a declared motion is the only outcome; return its number of leaves.

    Args:
        node: The root of the proof, or of a part of it.
        states: The known states there.
        proven: Goals that are bounded there already.
        dynamics: The scaled dynamics.
        goals: (2 P + 1, n) of `declared_motion_goals`.
        force_limit: Normal forces that the proof has to reach, scaled.

    Raises:
        NoProofError: If they leave out outcomes.
    """
    for goal, multipliers in node.sides:
        claimed = _EMPTY if goal == 0 else 1.0 + tolerances.SHARE
        bound = declared_motion_bound(dynamics, states, multipliers, goals[goal], force_limit)
        if not bound <= claimed:
            raise NoProofError(
                f"goal {goal} has the bound {bound:.3g}; it must be at most {claimed:.3g}"
            )
        proven |= {goal}
    if not node.children:
        wanted = len(goals) - 1
        if 0 not in proven and len(proven) < wanted:
            raise NoProofError(f"a leaf bounds only {len(proven)} of {wanted} accelerations")
        return 1
    contact = node.children[0].contact
    if any(child.forced or child.contact != contact for child in node.children):
        raise NoProofError(f"children of one node have contact {contact} and others, or are forced")
    why = uncovered_states(node.children, states, np.isfinite(dynamics.commanded))
    if why:
        raise NoProofError(f"contact {contact}: {why}")
    leaves = 0
    for child in node.children:
        own = states.with_state(contact, child.kind, child.arc)
        leaves += _count_kept_leaves(child, own, proven, dynamics, goals, force_limit)
    return leaves


def uncovered_states(children: list[RestNode], states: KnownStates, held: np.ndarray) -> str:
    """Return in words which states the children of a node leave out; empty: none.

    Args:
        children: Of one contact.
        states: The known states at the node.
        held: (M,) contacts that never open.
    """
    contact = children[0].contact
    known, kinds = states.kinds[contact], sorted(child.kind for child in children)
    if kinds == [Kind.CLOSED, Kind.OPEN]:
        return "" if known == Kind.FREE else f"it is known to be {known} already"
    arcs = [child.arc for child in children if child.kind == Kind.SLIPPING]
    if len(children) - len(arcs) > 1 or set(kinds) - {Kind.SLIPPING, Kind.STICKING}:
        return f"it cannot be split into {', '.join(kinds)}"
    if known == Kind.CLOSED or (known == Kind.FREE and held[contact]):
        whole_arc = 0.0, np.pi
        if Kind.STICKING not in kinds:
            return "no child is the case in which it sticks"
    elif known == Kind.SLIPPING:
        whole_arc = float(states.center[contact]), float(states.half_width[contact])
    else:
        return f"it is {known}, so it cannot be split by its slip"
    return "" if _arcs_cover(whole_arc, arcs) else "the arcs of the children leave out slips"


def _arcs_cover(outer: tuple[float, float], arcs: list[tuple[float, float]]) -> bool:
    """Return whether arcs cover another one."""
    center, half_width = outer
    spans = []
    for middle, half in arcs:
        start = (middle - half - (center - half_width)) % (2.0 * np.pi)
        spans += [(start + turn, start + turn + 2.0 * half) for turn in (-2.0 * np.pi, 0.0)]
    covered = 0.0
    for start, end in sorted(spans):
        if start <= covered + tolerances.ANGLE:
            covered = max(covered, end)
    return covered >= 2.0 * half_width - tolerances.ANGLE


def force_limit(proof: Part, wanted: float) -> tuple[float, Check]:
    """Return the normal forces up to which a proof holds, N, and the check that they suffice.

    No limit is stated where the proof uses none: it has neither loads nor a tree.
    """
    limit, name = proof.maybe("force_limit"), "force limit of the proof"
    if limit is None:
        uses_limit = proof.maybe("loads") or proof.maybe("nodes")
        detail = "the proof uses one, but states none" if uses_limit else "not used"
        return wanted, holds(name, not uses_limit, detail)
    detail = f"{limit:.6g} N, required {wanted:.6g} N"
    return limit, holds(name, limit >= (1.0 - tolerances.SAME) * wanted, detail)


def stated_loads(
    proof: Part, bodies: RestLoad, dynamics: RestDynamics | None, limit: float
) -> tuple[np.ndarray, list[Check]]:
    """(M,) least normal forces over all outcomes, N, and the checks of their proofs.

    Args:
        proof: The stated proof.
        bodies: With the load.
        dynamics: The equations of motion that the multipliers are of.
        limit: Normal forces that the proofs have to hold for, N.
    """
    loads, checks = bodies.commanded, list[Check]()
    if dynamics is None:
        if proof["loads"]:
            raise ValueError(f"loads of {proof.where} require inertias and a load")
        return loads, checks
    unit, states = dynamics.force_unit, KnownStates.all_free(bodies.problem.count)
    for contact, force, multipliers in _read_loads(proof.with_sizes(n=len(dynamics.load))):
        found = unit * least_force(
            dynamics, states, loads / unit, (contact, multipliers), limit / unit
        )
        good = force <= found + tolerances.ARITHMETIC * bodies.undisturbed.force
        detail = f"stated {force:.9g}, proven {found:.9g} N"
        checks.append(holds(f"least normal force of contact {contact}", good, detail))
        if good:
            loads[contact] = max(loads[contact], min(force, found))
    return loads, checks


def certificate_check(
    name: str, bodies: RestLoad, forces: np.ndarray, loads: np.ndarray, limit: float
) -> Check:
    """Check that forces balance with no more friction than least normal forces allow.

    Args:
        name: Of the check.
        bodies: With the load.
        forces: (M, 3) in contact frames, N.
        loads: (M,) N.
        limit: Accelerations of points up to this count as rest, m/s^2.
    """
    beyond_cone = np.linalg.norm(forces[:, 1:], axis=1) - bodies.problem.mu * loads
    beyond_cone, pulling = np.maximum(beyond_cone, 0.0), np.maximum(-forces[:, 0], 0.0)
    dynamics, size = bodies.dynamics, bodies.undisturbed.force
    if dynamics is None:
        worst = max(bodies.unbalanced_load(forces), beyond_cone.max() / size, pulling.max() / size)
        return within(name, worst, tolerances.EXACT, "of the load")
    rows, unit = dynamics.rows.astype(np.longdouble), dynamics.force_unit
    residual = np.einsum("lin,li->n", rows, forces / unit) + dynamics.load
    sizes = np.einsum("lin,li->n", np.abs(rows), np.abs(forces) / unit) + np.abs(dynamics.load)
    y = float(np.linalg.norm(residual) + tolerances.rounding_error(sizes.sum()))
    y += float(beyond_cone @ np.linalg.norm(dynamics.rows[:, 1:], ord=2, axis=(1, 2))) / unit
    y += float(pulling @ np.linalg.norm(rows[:, 0], axis=1)) / unit
    return within(name, y * dynamics.reach, limit, "m/s^2 at most")


def tree_check(
    name: str, proof: Part, dynamics: RestDynamics, loads: np.ndarray, limits: tuple[float, float]
) -> Check:
    """Check a tree of contact states.

    Args:
        name: Of the check.
        proof: The stated proof.
        dynamics: The equations of motion.
        loads: (M,) normal forces that every outcome has, N.
        limits: Of accelerations, m/s^2, and of normal forces, N.
    """
    unit, (still, most_force) = dynamics.force_unit, limits
    most_power = (still / dynamics.reach) ** 2
    walk = RestWalk(dynamics, loads / unit, most_force / unit, most_power)
    try:
        walk.walk(read_rest_tree(proof, dynamics))
    except NoProofError as error:
        return holds(name, passed=False, detail=str(error))
    shown = f"{walk.leaves} leaves, power {walk.bound:.3g}, limit {most_power:.3g} (scaled)"
    return holds(name, walk.bound <= (1.0 + tolerances.SHARE) * most_power, shown)


def kept_tree_check(
    name: str,
    proof: Part,
    dynamics: RestDynamics,
    problem: Problem,
    limits: tuple[float, float],
) -> Check:
    """Check a tree that proves a declared motion the only outcome; arguments as of `tree_check`."""
    still, most_force = limits
    goals, unknown = (
        declared_motion_goals(dynamics, problem, still),
        KnownStates.all_free(problem.count),
    )
    reach, root = most_force / dynamics.force_unit, read_rest_tree(proof, dynamics)
    try:
        leaves = _count_kept_leaves(root, unknown, frozenset(), dynamics, goals, reach)
    except NoProofError as error:
        return holds(name, passed=False, detail=str(error))
    return holds(name, passed=True, detail=f"{leaves} leaves")
