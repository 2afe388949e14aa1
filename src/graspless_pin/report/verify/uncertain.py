"""Check what a document says of torques for a whole set: the joined problem of its members.

That these are the corners of the stated set is taken as given. What is checked is that the joined
problem is made of them, and what its own document proves. With a policy, affine forces prove the
torques, and the joined problem of a few further members what none are better than.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.affine import policy_checks
from graspless_pin.report.verify.forces import against_mode, residual
from graspless_pin.report.verify.outcome import GUARANTEED, Check, agrees, given, holds, within
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.reading import read_forces, read_mode, read_problem
from graspless_pin.report.verify.values import (
    MOST,
    array,
    entry,
    items,
    number,
    short_text,
    text,
    truth,
    whole,
    word,
)

_AS_STATED = {
    "at_corners": "verdicts on the corners",
    "nominal": "the figures of the scene as it is meant to be",
}
"""What nothing in the document proves."""
_ARRAYS = ("frames", "limit", "v")


def uncertainty_checks(
    document: dict[str, Any], problem: Problem, run: Callable[[dict[str, Any]], list[Check]]
) -> list[Check]:
    """Return the checks of what stands under ``uncertainty``; none where nothing does.

    Args:
        document: The document.
        problem: What it says of contacts and joints.
        run: Returns the checks of another document.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    stated, where = document.get("uncertainty"), "uncertainty"
    if stated is None:
        return []
    members = items(entry(stated, "members", where), f"members of {where}", 1, MOST)
    for index, one in enumerate(members):
        text(entry(one, "words", f"member {index}"), f"words of member {index}")
    found = truth(entry(stated, "found", where), f"found of {where}")
    checks = [given("the members", f"{len(members)} of the set, as stated")]
    if not found:
        return [*checks, _of_this(document, stated, members, problem)]
    nested = entry(stated, "proof", where)
    constant = entry(stated, "feedback", where) is None
    if not isinstance(nested, dict) or "uncertainty" in nested:
        raise ValueError("proof of uncertainty is no document of a joined problem")
    joined = read_problem(nested)
    if stated.get("policy") is not None:
        each = [_member(one, index, problem) for index, one in enumerate(members)]
        bounding = items(entry(stated, "bounding", where), f"bounding of {where}", 1, MOST)
        bound = number(entry(nested["certificate"], "bound", "certificate"), "bound")
        told = number(entry(stated, "bound", where), "bound")
        checks += policy_checks(document, stated, problem, each)
        proven = [
            _is_joined(joined, problem, bounding, constant=constant),
            agrees("stated", told, bound, tolerances.SAME * abs(bound)),
            *run(nested),
        ]
        return [*checks, *(replace(one, name=f"bound: {one.name}") for one in proven)]
    held = joined.count // problem.count
    checks += [
        *_samples(stated, members, problem),
        _is_joined(joined, problem, members[:held], constant=constant),
        *_further(members[held:], held, problem, stated, nested, constant=constant),
        _torques(document, stated, nested, problem),
        *_figures(stated, nested),
        _bound(stated, nested, joined),
        *(
            given(words, "as stated")
            for key, words in _AS_STATED.items()
            if stated.get(key) is not None
        ),
        _covers(stated, nested, joined, problem.count),
    ]
    proven = run(nested)
    if "stability" not in nested:  # each member has a verdict of its own, which is not there
        proven = [
            replace(one, passed=None, detail="verdicts on members are not in the document")
            if one.name == GUARANTEED
            else one
            for one in proven
        ]
    return [*checks, *(replace(one, name=f"all members: {one.name}") for one in proven)]


def _of_this(
    document: dict[str, Any], stated: dict[str, Any], members: list[Any], joined: Problem
) -> Check:
    """Whether a document of the joined problem is that of the members, with the same answer."""
    wrenches, coefficients = (
        [number for one in members for number in items(entry(one, key, "a member"), key, 1, MOST)]
        for key in ("external_wrench", "friction")
    )
    same = [entry(stated, key, "uncertainty") == document[key] for key in ("status", "found")]
    same += [_near(joined.w[: len(wrenches)], array(wrenches, (len(wrenches),), "wrenches"))]
    same += [_near(joined.mu, array(coefficients, (len(coefficients),), "friction"))]
    return holds("this is the problem of the members", all(same), f"{stated['status']:.60}")


def _is_joined(joined: Problem, problem: Problem, members: list[Any], *, constant: bool) -> Check:
    """Whether a problem is that of members which share their torques."""
    count, contacts, name = len(members), problem.count, "the joined problem is made of the members"
    if joined.count != count * contacts:
        return holds(name, passed=False, detail=f"{joined.count} contacts")
    size, joints = len(problem.w), len(problem.units)
    each = [_member(one, index, problem) for index, one in enumerate(members)]
    same = [_near(getattr(joined, key), np.tile(getattr(problem, key).T, count).T)
            for key in _ARRAYS]  # fmt: skip
    same += [_near(joined.p, np.concatenate([problem.p + one["moved"] for one in each]))]
    same += [_near(joined.mu, np.concatenate([one["friction"] for one in each]))]
    same += [_near(joined.w[: count * size], np.concatenate([one["wrench"] for one in each]))]
    # The balance of each member by itself.
    passive = joined.passive.reshape(count, contacts, 3, -1)
    for k in range(count):
        own = slice(k * size, (k + 1) * size)
        same.append(_near(passive[k, :, :, own], _elsewhere(problem, each[k]).passive))
        others = np.delete(passive[k, :, :, : count * size], np.r_[own], axis=2)
        same.append(not others.any())
    maps = [one["jacobian"] / one["factors"] for one in each]
    carried = [(one["gravity"] - one["offsets"]) / one["factors"] for one in each]
    driven = 1 if constant else count
    if len(joined.units) != driven * joints:
        return holds(name, passed=False, detail=f"{len(joined.units)} joints")
    blocks = joined.J.reshape(count, contacts, 3, driven, joints)
    for k in range(count):
        for d in range(driven):
            same.append(_near(blocks[k, :, :, d], maps[k] if k == d else np.zeros_like(maps[k])))
    same.append(_near(joined.gravity, np.concatenate(carried[:driven])))
    for side, limit in ((1.0, "upper"), (-1.0, "lower")):
        own = side * getattr(joined, limit)
        same.append(bool((own <= side * np.tile(getattr(problem, limit), driven)).all()))
    if constant:
        same.append(_shares_torques(joined, maps, carried, count * size))
    detail = f"{count} members of {contacts} contacts"
    return holds(name, all(same), detail + ("" if constant else "; what feedback adds is given"))


def _shares_torques(
    joined: Problem, maps: list[np.ndarray], carried: list[np.ndarray], first: int
) -> bool:
    """Whether the further rows say that all members have the torques of the first one."""
    levers = np.max([np.abs(one).max(axis=(0, 1), initial=0.0) for one in maps], axis=0)
    loaded = np.flatnonzero(levers > tolerances.IDLE * levers.max(initial=0.0))
    count, rows = len(maps), len(loaded)
    if joined.passive.shape[2] != first + (count - 1) * rows:
        return False
    wanted = np.zeros((count, *maps[0].shape[:2], (count - 1) * rows))
    loads = []
    for k in range(1, count):
        own = slice((k - 1) * rows, k * rows)
        wanted[0, :, :, own] = -maps[0][:, :, loaded]
        wanted[k, :, :, own] = maps[k][:, :, loaded]
        loads.append((carried[k] - carried[0])[loaded])
    further = joined.passive[:, :, first:].reshape(wanted.shape)
    return _near(further, wanted) and _near(joined.w[first:], np.concatenate([*loads, []]))


def _further(
    members: list[Any],
    held: int,
    problem: Problem,
    stated: dict[str, Any],
    nested: dict[str, Any],
    *,
    constant: bool,
) -> list[Check]:
    """Whether the torques serve the members that the joined problem does not hold.

    Their forces balance within cones, with the stated margin, in the mode of the others, with the
    same torques or, with feedback, none that are larger.
    """
    if not members:
        return []
    name, detail = "the torques serve all other members", f"{len(members)} members"
    if any(entry(one, "forces", "a member") is None for one in members):
        return [given("all other members", f"{detail}, in modes that are not stated")]
    by_joint, where = entry(stated, "torques", "uncertainty"), "uncertainty"
    torques = np.array([number(one, "a torque") for one in by_joint.values()])
    margin, most = (number(entry(stated, key, where), key) for key in ("margin", "max_torque"))
    mode = None
    if not problem.coulomb:
        selected, signs = read_mode(nested, read_problem(nested))
        mode = selected[: problem.count], signs[: problem.count]
    levers = np.abs(problem.J).max(axis=(0, 1), initial=0.0)
    loaded = levers > tolerances.IDLE * levers.max(initial=0.0)
    worst = 0.0
    for index, one in enumerate(members, held):
        each = _member(one, index, problem)
        own = replace(
            _elsewhere(problem, each),
            w=each["wrench"], mu=each["friction"], J=each["jacobian"] / each["factors"],
            gravity=(each["gravity"] - each["offsets"]) / each["factors"],
            own=None, algorithm="margin", e0=margin,
        )  # fmt: skip
        forces = read_forces(one["forces"], own, f"forces of member {index}")
        off = np.abs(forces.torques - torques) if constant else np.abs(forces.torques) - most
        worst = max(
            worst,
            residual(own, forces),
            float((off / own.joint_scale)[loaded].max(initial=0.0)),
            0.0 if mode is None else against_mode(own, forces, *mode) / own.force,
        )
    return [within(name, worst, tolerances.SHARE, f"(scaled), {detail}")]


def _member(stated: Any, index: int, problem: Problem) -> dict[str, np.ndarray]:
    joints, where = (len(problem.units),), f"member {index}"
    shapes = {"external_wrench": problem.w.shape, "friction": problem.mu.shape}
    shapes |= dict.fromkeys(("gravity_torques", "torque_factors", "torque_offsets"), joints)
    found = {key: array(entry(stated, key, where), shape, f"{key} of {where}")
             for key, shape in shapes.items()}  # fmt: skip
    if (found["torque_factors"] <= 0.0).any():
        raise ValueError(f"torque_factors of {where} must be positive")
    names = ("wrench", "friction", "gravity", "factors", "offsets")
    own = dict(zip(names, found.values(), strict=True))
    if stated.get("moved") is None:
        return own | {"moved": np.zeros_like(problem.p), "jacobian": problem.J}
    if problem.given is not None:
        raise ValueError(f"{where} has contacts moved, and the document a wrench_matrix")
    moved = {"moved": problem.p.shape, "jacobian": problem.J.shape}
    return own | {key: array(entry(stated, key, where), shape, f"{key} of {where}")
                  for key, shape in moved.items()}  # fmt: skip


def _elsewhere(problem: Problem, member: dict[str, np.ndarray]) -> Problem:
    """Return a problem with the contacts where they are in a member; its Jacobian stays."""
    return replace(problem, p=problem.p + member["moved"])


def _samples(stated: dict[str, Any], members: list[Any], problem: Problem) -> list[Check]:
    """Whether contacts are moved as is stated; those that were tried later are not stated."""
    samples, where = stated.get("samples"), "samples of uncertainty"
    if samples is None:
        return []
    off = entry(entry(stated, "stated", "uncertainty"), "contact_position", "stated")
    named = [*off.values()] if isinstance(off, dict) else off if isinstance(off, list) else [off]
    most = max(number(one, "contact_position") for one in named)
    moved = [_member(one, index, problem)["moved"] for index, one in enumerate(members)]
    across = max(np.abs(np.einsum("lj,lj->l", one, problem.frames[:, 0])).max() for one in moved)
    farthest = max(np.linalg.norm(one, axis=1).max() for one in moved)
    good = across <= tolerances.SAME * most and farthest <= (1.0 + tolerances.SAME) * most
    solved, served, count = (
        whole(entry(samples, key, where), f"{key} of {where}", 0, MOST)
        for key in ("solved", "served", "count")
    )
    told = sum(one.any() for one in moved)
    detail = f"{told} members with contacts moved by up to {1000.0 * farthest:.3g} mm"
    return [
        holds("contacts are moved within their tangent planes", good and told == solved, detail),
        given("members tried later", f"{served} of {count} served; they are not in the document"),
    ]


def _torques(
    document: dict[str, Any], stated: dict[str, Any], nested: dict[str, Any], problem: Problem
) -> Check:
    """Whether the document's torques are those for all members."""
    by_joint = entry(stated, "torques", "uncertainty")
    names = [short_text(entry(one, "name", "a joint"), "a name") for one in document["joints"]]
    proven, own, told = (
        np.array([number(value, "a torque") for value in values])
        for values in (
            [entry(one, "torque", "a joint") for one in nested["joints"][: len(names)]],
            [entry(one, "torque", "a joint") for one in document["joints"]],
            [entry(by_joint, name, "torques") for name in names],
        )
    )
    sizes = problem.joint_scale
    off = max(float((np.abs(one - own) / sizes).max(initial=0.0)) for one in (proven, told))
    good = off <= tolerances.SHARE
    return holds("the torques are those for all members", good, f"{off:.2e} (scaled)")


def _figures(stated: dict[str, Any], nested: dict[str, Any]) -> list[Check]:
    """Whether the figures that are stated are those of the joined problem."""
    same = [entry(stated, key, "uncertainty") == nested.get(key) for key in ("status", "found")]
    checks = [holds("status for all members", all(same), f"{stated['status']:.60}")]
    for key in ("margin", "max_torque"):
        told, own = (number(entry(one, key, "uncertainty"), key) for one in (stated, nested))
        checks.append(agrees(f"{key} for all members", told, own, tolerances.SAME * abs(own)))
    return checks


def _bound(stated: dict[str, Any], nested: dict[str, Any], joined: Problem) -> Check:
    """Compare what no torques are better than with what the joined problem proves."""
    name = "what no torques for all members are better than"
    told, certificate = entry(stated, "bound", "uncertainty"), nested["certificate"]
    proven, gap = (entry(certificate, key, "certificate") for key in ("bound", "gap"))
    if told is None or proven is None:
        return given(name, "not stated")
    bound, own = number(told, "bound"), number(proven, "bound")
    sign = 1.0 if joined.maximizes else -1.0
    reached = own - sign * number(gap, "gap")
    if sign * (bound - reached) < -tolerances.objective(joined, own, reached):
        return holds(name, passed=False, detail=f"{bound:.6g}, and these reach {reached:.6g}")
    same = agrees(name, bound, own, tolerances.SAME * abs(own))
    return same if same.passed else given(name, "of another program, which is not stated")


def _covers(
    stated: dict[str, Any], nested: dict[str, Any], joined: Problem, contacts: int
) -> Check:
    """Whether the loads between corners are served: in one mode, or under plain Coulomb."""
    coverage = entry(stated, "coverage", "uncertainty")
    if coverage == "sampled":  # where contacts are meant to be, more is claimed
        coverage = entry(entry(stated, "samples", "uncertainty"), "where_meant", "samples")
    coverage = word(coverage, "coverage", ("whole_set", "corners"))
    if coverage == "corners" or joined.coulomb:
        return holds("coverage", passed=True, detail=coverage)
    selected, signs = read_mode(nested, joined)
    common = (selected.reshape(-1, contacts) == selected[:contacts]).all()
    common &= (signs.reshape(-1, contacts, 2) == signs[:contacts]).all()
    return holds("coverage: all members in one mode", common, coverage)


def _near(one: np.ndarray, other: np.ndarray) -> bool:
    size = float(np.abs(other).max(initial=0.0))
    return one.shape == other.shape and bool((np.abs(one - other) <= tolerances.SAME * size).all())
