"""Checks of robust torques over an uncertain set: of the joined problem of its members.

That these are the corners of the stated set is taken as given. It is checked that the joined
problem consists of them, and what its own document proves. With a policy, affine forces prove the
torques, and the joined problem of a few further members proves their bound.

Affine forces of member k are f_k + F_k d, for all d in a product of unit balls. A linear function
of d differs from its value at d = 0 by at most the sum of the lengths of its coefficients in each
ball. The effect of d on loads and the errors of torques are taken as given, as the members are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import Part, stacked
from graspless_pin.report.verify.forces import against_mode, residual
from graspless_pin.report.verify.outcome import Check, Claim, agrees, given, holds, within
from graspless_pin.report.verify.problem import Forces, Problem
from graspless_pin.report.verify.reading import read_mode, read_problem
from graspless_pin.report.verify.values import MOST, array, entry, items, number

_AS_STATED = {
    "at_corners": "verdicts on the corners",
    "nominal": "the figures of the nominal scene",
    "served_share": "the share that is served",
    "with_feedback": "what feedback would do",
}
"""Keys that nothing in the document proves."""
_ARRAYS = ("frames", "limit", "v")
_OF_MEMBER = (
    "external_wrench", "friction", "gravity_torques", "torque_factors", "torque_offsets"
)  # fmt: skip

Member = dict[str, np.ndarray]
"""Data of a member, by key: see `_read_member`."""


def uncertainty_checks(
    document: dict[str, Any], problem: Problem, run: Callable[[dict[str, Any]], list[Check]]
) -> list[Check]:
    """Return the checks of ``uncertainty``; none where the document has none.

    Args:
        document: The document.
        problem: Its problem.
        run: Returns the checks of another document.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    whole = problem.part(document)
    stated = whole.get("uncertainty")
    if stated is None:
        return []
    members = stated["members"]
    for one in members:
        one["words"]  # raises if it is invalid
    checks = [given("the members", f"{len(members)} members of the set, as stated")]
    if not stated["found"]:
        return [*checks, _same_problem_check(document, stated, members, problem)]
    each = [_read_member(one, problem) for one in members]
    nested, constant = stated["proof"], stated.maybe("feedback") is None
    if not isinstance(nested, dict) or "uncertainty" in nested:
        raise ValueError("proof of uncertainty must be the document of the joined problem")
    joined = read_problem(nested)
    proof = joined.part(nested)
    by_joint, joints = stated["torques"], whole["joints"]
    torques = np.array([number(entry(by_joint, one["name"], "torques"), "a torque")
                        for one in joints])  # fmt: skip
    if stated.get("policy") is not None:
        bound = proof["certificate"].maybe("bound")
        of_joined = {key: getattr(joined, key) for key in ("algorithm", "e0", "by_limits", "own")}
        own = replace(problem, **of_joined)
        checks += policy_checks(stated, own, each, [torques, stacked(joints, "torque")])
        bounding = [_read_member(one, problem) for one in stated["bounding"]]
        proven = [
            _join_check(joined, problem, bounding, constant=constant),
            Check("stated", None, "its search reached its limit before it found forces")
            if bound is None
            else agrees("stated", stated["bound"], bound, tolerances.SAME * abs(bound)),
            *run(nested),
        ]
        return [*checks, *(replace(one, name=f"bound: {one.name}") for one in proven)]
    size = joined.count // problem.count
    checks += [
        *_sample_checks(stated, each, problem),
        _join_check(joined, problem, each[:size], constant=constant),
        *_other_member_checks(
            members[size:], each[size:], problem, stated, nested, torques, constant=constant
        ),
        _same_torques_check(
            [stacked(proof["joints"][: len(joints)], "torque"), torques],
            stacked(joints, "torque"),
            problem,
        ),
        *_figure_checks(stated, proof),
        _bound_check(stated, proof, joined),
        *(
            given(words, "as stated")
            for key, words in _AS_STATED.items()
            if stated.get(key) is not None
        ),
        _coverage_check(stated, nested, joined, problem.count),
    ]
    proven = run(nested)
    if "stability" not in nested:  # each member has its own verdict, which is not stated
        proven = [
            replace(one, passed=None, detail="verdicts on members are not in the document")
            if one.claim is Claim.GUARANTEE
            else one
            for one in proven
        ]
    return [*checks, *(replace(one, name=f"all members: {one.name}") for one in proven)]


def _same_problem_check(
    document: dict[str, Any], stated: Part, members: list[Part], joined: Problem
) -> Check:
    """Check that the document's problem is the joined one of the members, with the same answer."""
    wrenches, coefficients = (
        [one for part in members
         for one in items(entry(part.stated, key, part.where), key, 1, MOST)]
        for key in ("external_wrench", "friction")
    )  # fmt: skip
    same = [stated[key] == document[key] for key in ("status", "found")]
    same += [_agree(joined.w[: len(wrenches)], array(wrenches, (len(wrenches),), "wrenches"))]
    same += [_agree(joined.mu, array(coefficients, (len(coefficients),), "friction"))]
    return holds("the document is that of the joined problem", all(same), f"{stated['status']:.60}")


def _join_check(joined: Problem, problem: Problem, each: list[Member], *, constant: bool) -> Check:
    """Check that the joined problem consists of the members, which share their torques."""
    count, contacts, name = len(each), problem.count, "the joined problem is made of the members"
    if joined.count != count * contacts:
        return holds(name, passed=False, detail=f"{joined.count} contacts")
    size, joints, driven = len(problem.w), len(problem.units), 1 if constant else count
    if len(joined.units) != driven * joints:
        return holds(name, passed=False, detail=f"{len(joined.units)} joints")
    rows, shape = count * size, (count, contacts, 3)
    load, friction, moved, carried = (
        np.concatenate([one[key] for one in each])
        for key in ("external_wrench", "friction", "moved", "carried")
    )
    same = [
        *(_agree(getattr(joined, key), np.tile(getattr(problem, key).T, count).T)
          for key in _ARRAYS),
        _agree(joined.p, np.tile(problem.p.T, count).T + moved),
        _agree(joined.mu, friction),
        _agree(joined.w[:rows], load),
        _agree(joined.gravity, carried[: driven * joints]),
        # The balance of each member by itself, and its torques.
        _are_blocks(joined.passive[:, :, :rows].reshape(*shape, count, size),
                    [_moved_problem(problem, one).passive for one in each]),
        _are_blocks(joined.J.reshape(*shape, driven, joints), [one["map"] for one in each]),
        (joined.upper <= np.tile(problem.upper, driven)).all(),
        (joined.lower >= np.tile(problem.lower, driven)).all(),
        not constant or _shares_torques(joined, each, rows),
    ]  # fmt: skip
    detail = f"{count} members of {contacts} contacts"
    return holds(name, all(same), detail + ("" if constant else "; feedback is taken as given"))


def _are_blocks(found: np.ndarray, own: list[np.ndarray]) -> bool:
    """Return whether an array (K, M, 3, d, n) has each member's own block, and zeros elsewhere."""
    return all(
        _agree(found[k, :, :, d], one if k == d else np.zeros_like(one))
        for k, one in enumerate(own)
        for d in range(found.shape[3])
    )


def _loaded_joints(maps: list[np.ndarray]) -> np.ndarray:
    """(L,) whether joints bear contact forces in any of these Jacobians (M, 3, L)."""
    levers = np.max([np.abs(one).max(axis=(0, 1), initial=0.0) for one in maps], axis=0)
    return levers > tolerances.IDLE * levers.max(initial=0.0)


def _shares_torques(joined: Problem, each: list[Member], first: int) -> bool:
    """Return whether the further rows equate the torques of all members with the first one's."""
    maps = [one["map"] for one in each]
    loaded = np.flatnonzero(_loaded_joints(maps))
    count, rows = len(maps), len(loaded)
    if joined.passive.shape[2] != first + (count - 1) * rows:
        return False
    wanted = np.zeros((count, *maps[0].shape[:2], (count - 1) * rows))
    for k in range(1, count):
        own = slice((k - 1) * rows, k * rows)
        wanted[0, :, :, own] = -maps[0][:, :, loaded]
        wanted[k, :, :, own] = maps[k][:, :, loaded]
    loads = [(one["carried"] - each[0]["carried"])[loaded] for one in each[1:]]
    further = joined.passive[:, :, first:].reshape(wanted.shape)
    return _agree(further, wanted) and _agree(joined.w[first:], np.concatenate([*loads, []]))


def _other_member_checks(
    members: list[Part],
    each: list[Member],
    problem: Problem,
    stated: Part,
    nested: dict[str, Any],
    torques: np.ndarray,
    *,
    constant: bool,
) -> list[Check]:
    """Check that the torques serve the members outside the joined problem.

    Their forces balance within cones, with the stated margin, in the mode of the others, with the
    same torques or, with feedback, none that are larger.
    """
    if not members:
        return []
    name, detail = "the torques serve all other members", f"{len(members)} members"
    if any(one.maybe("forces") is None for one in members):
        return [given("all other members", f"{detail}, in modes that the document does not state")]
    mode = None
    if not problem.coulomb:
        selected, signs = read_mode(nested, read_problem(nested))
        mode = selected[: problem.count], signs[: problem.count]
    loaded, worst = _loaded_joints([problem.J]), 0.0
    for one, member in zip(members, each, strict=True):
        own = replace(
            _moved_problem(problem, member), w=member["external_wrench"], mu=member["friction"],
            J=member["map"], gravity=member["carried"], own=None, algorithm="margin",
            e0=stated["margin"],
        )  # fmt: skip
        forces = Forces(own, one["forces"])
        off = np.abs(forces.torques)
        off = np.abs(forces.torques - torques) if constant else off - stated["max_torque"]
        worst = max(
            worst,
            residual(own, forces),
            float((off / own.joint_scale)[loaded].max(initial=0.0)),
            0.0 if mode is None else against_mode(own, forces, *mode) / own.force,
        )
    return [within(name, worst, tolerances.SHARE, f"(scaled), {detail}")]


def _read_member(stated: Part, problem: Problem) -> Member:
    """Return the data of a member; contacts that are not stated as moved stay.

    Adds ``map``, the Jacobian of the commanded torques, (M, 3, L), and ``carried``, the commanded
    torques without contact forces, (L,).
    """
    found = {key: stated[key] for key in _OF_MEMBER}
    factors = found["torque_factors"]
    if (factors <= 0.0).any():
        raise ValueError(f"torque_factors of {stated.where} must be positive")
    if stated.get("moved") is None:
        found |= {"moved": np.zeros_like(problem.p), "jacobian": problem.J}
    elif problem.stated_map is not None:
        raise ValueError(f"moved of {stated.where} is not supported together with wrench_matrix")
    else:
        found |= {key: stated[key] for key in ("moved", "jacobian")}
    found["map"] = found["jacobian"] / factors
    found["carried"] = (found["gravity_torques"] - found["torque_offsets"]) / factors
    return found


def _moved_problem(problem: Problem, member: Member) -> Problem:
    """Return a problem with the contact positions of a member; its Jacobian stays."""
    return replace(problem, p=problem.p + member["moved"])


def _sample_checks(stated: Part, each: list[Member], problem: Problem) -> list[Check]:
    """Check that contacts move as stated; members that were tried later are not stated."""
    samples = stated.get("samples")
    if samples is None:
        return []
    off = entry(stated["stated"], "contact_position", "stated")
    named = [*off.values()] if isinstance(off, dict) else off if isinstance(off, list) else [off]
    most = max(number(one, "contact_position") for one in named)
    moved = [one["moved"] for one in each]
    across = max(np.abs(np.einsum("lj,lj->l", one, problem.frames[:, 0])).max() for one in moved)
    farthest = max(np.linalg.norm(one, axis=1).max() for one in moved)
    good = across <= tolerances.SAME * most and farthest <= (1.0 + tolerances.SAME) * most
    solved, served, count = (samples[key] for key in ("solved", "served", "count"))
    shifted = sum(one.any() for one in moved)
    detail = f"{shifted} members with contacts moved by up to {1000.0 * farthest:.3g} mm"
    return [
        holds("contacts are moved within their tangent planes", good and shifted == solved, detail),
        given("members tried later", f"{served} of {count} served; they are not in the document"),
    ]


def _same_torques_check(others: list[np.ndarray], own: np.ndarray, problem: Problem) -> Check:
    """Check that the document's torques, the stated robust ones and the proven ones agree."""
    off = float((np.abs(others - own) / problem.joint_scale).max(initial=0.0))
    return within("the torques are those for all members", off, tolerances.SHARE, "(scaled)")


def _figure_checks(stated: Part, proof: Part) -> list[Check]:
    """Check that the stated figures are those of the joined problem."""
    same = [stated[key] == proof[key] for key in ("status", "found", "max_torque_unit")]
    checks = [holds("status and unit for all members", all(same), f"{stated['status']:.60}")]
    for key in ("margin", "max_torque"):
        claimed, own = stated[key], proof[key]
        checks.append(agrees(f"{key} for all members", claimed, own, tolerances.SAME * abs(own)))
    return checks


def _bound_check(stated: Part, proof: Part, joined: Problem) -> Check:
    """Check the stated bound on all torques against the one of the joined problem."""
    name = "bound on all torques for all members"
    bound = stated.maybe("bound")
    own, gap = (proof["certificate"].maybe(key) for key in ("bound", "gap"))
    if bound is None or own is None:
        return given(name, "not stated")
    sign = 1.0 if joined.maximizes else -1.0
    reached = own - sign * gap
    if sign * (bound - reached) < -tolerances.objective(joined, own, reached):
        return holds(name, passed=False, detail=f"{bound:.6g}; these torques reach {reached:.6g}")
    same = agrees(name, bound, own, tolerances.SAME * abs(own))
    return same if same.passed else given(name, "of a program that is not in the document")


def _coverage_check(stated: Part, nested: dict[str, Any], joined: Problem, contacts: int) -> Check:
    """Check that the loads between corners are served: in one mode, or under plain Coulomb."""
    coverage = stated["coverage"]
    if coverage == "sampled":  # with contacts at their nominal positions, more is claimed
        coverage = stated["samples"]["where_meant"]
    if coverage == "corners" or joined.coulomb:
        return holds("coverage", passed=True, detail=coverage)
    selected, signs = read_mode(nested, joined)
    common = (selected.reshape(-1, contacts) == selected[:contacts]).all()
    common &= (signs.reshape(-1, contacts, 2) == signs[:contacts]).all()
    return holds("coverage: all members in one mode", common, coverage)


def _agree(a: np.ndarray, b: np.ndarray) -> bool:
    size = float(np.abs(b).max(initial=0.0))
    return a.shape == b.shape and bool((np.abs(a - b) <= tolerances.SAME * size).all())


class AffineForces:
    """The affine forces that a document states, and what they prove.

    Attributes:
        commands: (K, L) N m (N) at d = 0.
        largest: (L,) the largest |command| in any member.
        margin: Smallest margin of all forces, N.
        value: Value of the objective, in its unit.
    """

    def __init__(self, stated: Part, problem: Problem, members: list[Member]) -> None:
        """Read the arrays.

        Args:
            stated: The part ``policy``.
            problem: Contacts and joints.
            members: Data of each member.

        Raises:
            ValueError: If a key is missing, or a value of a wrong type or size.
        """
        balls = items(entry(stated.stated, "balls", stated.where), "balls", 1, MOST)
        stated = stated.with_sizes(K=len(members), D=len(balls))
        self.balls, self.joints = (np.array(stated[key]) for key in ("balls", "joints"))
        self.loads, self.errors, self.forces, self.slopes, self.shares, self.offsets = (
            stated[key] for key in ("loads", "errors", "forces", "slopes", "shares", "offsets")
        )
        rows, L = entry(stated.stated, "directions", stated.where), len(problem.units)
        self.directions = None
        if rows is not None:
            first = items(rows, "directions", L, L)[:1]
            width = sum(len(items(one, "a direction", 0, MOST)) for one in first)
            self.directions = stated.with_sizes(w=width)["directions"]
        self.problem, self.members = problem, members
        maps, carried = (np.array([one[key] for one in members]) for key in ("map", "carried"))
        self.commands = np.einsum("klij,kli->kj", maps, self.forces) + carried
        self.added = np.einsum("klij,klid->kjd", maps, self.slopes) - self.errors
        # Constant torques are those of the first member.
        driven = slice(None) if self.directions is not None else slice(1)
        self.room = self.largest_value(self.added[driven]) if self.directions is not None else 0.0
        self.driven = self.commands[driven]
        self.largest = (np.abs(self.driven) + self.room).max(axis=0)
        self.margin = min(map(self._member_margin, range(len(members))))

    def largest_value(self, parts: np.ndarray) -> np.ndarray:
        """(...,) largest value that (..., D) coefficients add for any d."""
        return np.sum(
            [np.linalg.norm(parts[..., self.balls == one], axis=-1) for one in set(self.balls)],
            axis=0,
        )

    def _member_margin(self, k: int) -> float:
        own = replace(self.problem, mu=self.members[k]["friction"])
        local = np.einsum("lij,lj->li", own.frames, self.forces[k])
        slopes = np.einsum("lij,ljd->lid", own.frames, self.slopes[k])
        deviation, normal = self.largest_value(slopes[:, 0]), local[:, 0]
        least = [float((normal - deviation).min()), float((own.limit - normal - deviation).min())]
        for c in np.flatnonzero(own.has_cone).tolist():
            rows = own.faces(c)
            least.append(-float((rows @ local[c] + self.largest_value(rows @ slopes[c])).max()))
        return min(least)

    @property
    def value(self) -> float:
        """Value of the objective, in its unit."""
        if self.problem.is_margin:
            return self.margin
        if not self.problem.by_limits:
            return float(self.largest.max(initial=0.0))
        return self.problem.largest_share(self.room + self.driven, self.room - self.driven)

    def checks(self) -> list[Check]:
        """Return the checks of balance, friction, shared torques, errors and limits."""
        problem, scale = self.problem, self.problem.joint_scale
        passive = problem.passive.reshape(-1, len(problem.w)).T
        flat = self.slopes.reshape(*self.forces.shape[:1], -1, len(self.balls))
        wrenches = np.array([one["external_wrench"] for one in self.members])
        residual = np.abs(self.forces.reshape(len(flat), -1) @ passive.T + wrenches)
        residual += self.largest_value(passive @ flat + self.loads)
        worst = max(map(self._excess_without_cone, range(len(flat))))
        named, counts = np.unique(self.joints[self.joints >= 0], return_counts=True)
        alone = np.bincount(self.balls)[self.balls[self.joints >= 0]]
        own = np.arange(len(self.errors))[:, None] == self.joints
        proper = bool((counts == 1).all() and (alone == 1).all() and (self.errors >= 0.0).all())
        proper &= not (self.errors[~own].any() or self.loads[:, :, self.joints >= 0].any())
        deficit = self.shares * self.largest + self.offsets - self.errors.sum(axis=1)
        low, high = tolerances.torque_limits(problem)
        beyond = np.maximum(self.driven + self.room - problem.upper - high,
                            problem.lower - low - self.driven + self.room)  # fmt: skip
        return [
            given("loads and errors", f"{len(self.balls)} unknowns, {len(named)} errors of joints"),
            within("balance", float((residual / problem.passive_scale).max()), tolerances.SHARE,
                   "of the load"),
            within("forces without a cone", worst / problem.force, tolerances.SHARE, "of the load"),
            within("required margin", problem.e0 - self.margin, tolerances.force(problem),
                   "N short"),
            self._same_commands_check(),
            holds("each error belongs to one joint", proper, f"{len(named)} joints"),
            within("errors are as large as stated", float((deficit / scale).max(initial=0.0)),
                   tolerances.SHARE, ""),
            holds("torque limits", not (beyond > 0.0).any(), f"{beyond.max(initial=0.0):.2e}"),
        ]  # fmt: skip

    def _excess_without_cone(self, k: int) -> float:
        """Return the largest distance of forces without a cone from their direction, N."""
        own = replace(self.problem, mu=self.members[k]["friction"])
        along, off = own.kinetic_directions, ~own.has_cone
        normals = own.frames[:, 0]
        apart = self.forces[k] - along * (normals * self.forces[k]).sum(axis=1)[:, None]
        turned = np.einsum("lj,ljd->ld", normals, self.slopes[k])
        slopes = self.slopes[k] - along[:, :, None] * turned[:, None]
        return float((np.abs(apart) + self.largest_value(slopes))[off].max(initial=0.0))

    def _same_commands_check(self) -> Check:
        """Check that all members have the same commands, but for what feedback adds."""
        loaded, note = _loaded_joints([self.problem.J]), ""
        shared = np.eye(len(loaded))[loaded]
        if self.directions is not None:
            columns, sizes, _ = np.linalg.svd(self.directions)
            shared = columns[:, int((sizes > tolerances.SAME * sizes.max(initial=0.0)).sum()) :].T
            note = "; feedback is taken as given"
        off = np.abs((self.commands - self.commands[0]) @ shared.T)
        off = (off + self.largest_value(shared @ self.added)) @ np.abs(shared)
        most = float((off / self.problem.joint_scale).max(initial=0.0))
        check = within("all members have the same commands", most, tolerances.SHARE, "")
        return replace(check, detail=check.detail + note)


def policy_checks(
    stated: Part, problem: Problem, members: list[Member], torques: list[np.ndarray]
) -> list[Check]:
    """Return the checks of forces that are affine in the unknowns.

    Args:
        stated: The part ``uncertainty``.
        problem: Contacts and joints, with the options for all members.
        members: Data of each corner.
        torques: (L,) each, of the set and of the document, N m (N).

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    affine = AffineForces(stated["policy"], problem, members)
    checks = affine.checks()
    checks += [
        _same_torques_check(torques, affine.commands[0], problem),
        agrees("margin", stated["margin"], affine.margin, tolerances.force(problem), "N"),
        agrees("max_torque", stated["max_torque"], float(affine.largest.max(initial=0.0)),
               float(tolerances.SHARE * problem.joint_scale.max(initial=0.0))),
    ]  # fmt: skip
    status, bound = stated["status"], stated["bound"]
    closed = abs(affine.value - bound) <= 2.0 * tolerances.objective(problem, affine.value, bound)
    known = status == "limit_reached" or (closed and status in ("optimal", "optimal_in_mode"))
    checks.append(holds("status", known, f"{status:.60}, {affine.value:.9g}, bound {bound:.9g}"))
    if not problem.coulomb:
        checks.append(Check("one mode", None, "no proof that friction opposes a virtual sliding"))
    return [replace(one, name=f"affine forces: {one.name}") for one in checks]
