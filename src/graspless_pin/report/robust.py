"""Robust torques over a scene's uncertainty, as text and as data of documents."""

from __future__ import annotations

import math
from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np

from graspless_pin.algorithms.robust_solution import Coverage, RobustSolution
from graspless_pin.algorithms.robust_torques import further_forces
from graspless_pin.algorithms.tolerance_tables import Tolerances
from graspless_pin.holding.verdict import Holding
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Member
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.scene.robust_answer import CORNER_TIME, SHARE_TIME, STIFFNESS, RobustAnswer
from graspless_pin.scene.scene_stability import MemberVerdicts
from graspless_pin.scene.uncertain_figures import uncertainty_entry
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.solution.tables import COLUMNS, Table, figure, torque_size, with_noun

_STILL = 1e-9
"""rad (m): smaller joint deflections are not reported."""
_OPEN = 2e-3
"""Served and unserved shares of a set that differ by less are reported as one."""
_MOST_ROWS = 16
"""Largest number of rows in the table of verdicts at corners."""
_SAME_AS_BOUND = 1e-4
"""Of a value: a bound that is nearer to it is not reported."""


def robust_text(answer: RobustAnswer) -> str:
    """Return the robust torques' figures, or why there are none, and those of the nominal scene."""
    sentences = robust_sentences(answer)
    lines = [fill(one, COLUMNS, break_on_hyphens=False) for one in sentences]
    judged = answer.at_corners
    if judged is not None and 0 < len(judged.verdicts) <= _MOST_ROWS:
        each = zip(judged.members, judged.verdicts, strict=True)
        rows = [(member.words, str(one.holding)) for member, one in each]
        lines += ["", str(Table(rows, ["corner", "the object there"])), ""]
    if not answer.found:
        members, conflict = answer.robust.members, answer.robust.conflict
        each = (f"- {members[number].words}" for number in conflict)
        lines[2:2] = [fill(one, COLUMNS, subsequent_indent="  ") for one in each]
        why = answer.nominal.explanation
        lines += ["", why] if why else []
    return "\n".join(lines)


def robust_sentences(answer: RobustAnswer) -> list[str]:
    """Return the sentences of `robust_text`, without the members in conflict."""
    robust = answer.robust
    if not answer.found:
        return _no_torques_sentences(answer)
    covered = "the whole set" if robust.samples is None else "the set except contact positions"
    lines = [
        f"Not known exactly: {answer.uncertainty}.",
        f"Torques for {covered}: {_figures_text(robust, answer)}, proven for {robust.proven_for}; "
        f"for the nominal scene alone {_figures_text(answer.nominal, answer)}.",
    ]
    samples = robust.samples
    if Coverage.CORNERS in (robust.coverage, samples and samples.where_meant):
        lines.append("Corners need different virtual slidings: between them nothing is proven.")
    if samples is not None:
        lines.append(f"Sampled, not proven: {samples}.")
    value, bound = robust.value, robust.bound
    of_which = "corners" if robust.policy is None and samples is None else "members"
    if robust.policy is not None:
        lines.append("The proof is a policy of contact forces that are affine in the unknowns.")
    if math.isfinite(bound) and abs(value - bound) > _SAME_AS_BOUND * abs(value):
        lines.append(
            f"No torques for all {of_which} are better than {bound:.4g} "
            f"{_objective_unit(answer)} (proven)."
        )
    lines.append(f"Smallest margin at: {robust.members[robust.worst].words}.")
    if robust.rest is not None:
        lines.append(
            f"Rest is the only outcome at each of {len(robust.rest.corners)} corners "
            f"({with_noun(robust.rest.tried, 'set')} of torques tried)."
        )
    if answer.at_corners is not None:
        lines += _corner_sentences(answer.at_corners)
    if robust.feedback is not None and robust.largest_deflection > _STILL:
        lines.append(
            "With the stiffness of the controller, joints deflect by up to "
            f"{robust.largest_deflection:.2g} rad (m); max |torque| includes what that adds."
        )
    return lines


def _corner_sentences(judged: MemberVerdicts) -> list[str]:
    """Return sentences on the verdicts at the corners, the worst one, and the corners left out."""
    lines, holdings = [], [str(one.holding) for one in judged.verdicts]
    if holdings and set(holdings) == {str(Holding.HOLDS)}:
        lines.append(f"At the corners of the set the object stays: holds at all {len(holdings)}.")
    elif holdings:
        tally = ", ".join(f"{word} at {holdings.count(word)}" for word in dict.fromkeys(holdings))
        worst = judged.members[judged.worst].words
        worst_message = judged.verdicts[judged.worst].message
        lines.append(
            f"Verdicts at the corners of the set: {tally}; the worst, {worst}: {worst_message}."
        )
    if judged.left_out:
        lines.append(
            f"{with_noun(judged.left_out, 'corner')} more got no verdict within {CORNER_TIME:g} s; "
            "in Python `scene.stability_of_members` has no such limit."
        )
    return [*lines, "Between the corners nothing is proven about rest."]


def _no_torques_sentences(answer: RobustAnswer) -> list[str]:
    robust, nominal = answer.robust, answer.nominal
    together = "No torques serve all these members together (without any one of them, some do):"
    if len(robust.conflict) < 2:
        together = "No torques serve this member:" if robust.conflict else ""
    lines = [
        f"Not known exactly: {answer.uncertainty}.",
        together or _no_torques_reason(robust),
    ]
    share = answer.served_share
    part = answer.uncertainty.scaled(share) if share > 0.0 else None
    if answer.unserved_share - share > _OPEN:
        lines.append(
            f"At least {100.0 * share:.3g} % of the set is served"
            f"{'' if part is None else f': {part}'}. Whether more is, up to "
            f"{100.0 * answer.unserved_share:.3g} %, was not decided within {SHARE_TIME:g} s."
        )
    elif part is not None:
        lines.append(f"Up to {100.0 * share:.3g} % of the set is served: {part}.")
    elif share == 0.0:
        lines.append("No part of the set is served, however small.")
    if answer.with_feedback is not None:
        lines.append(_feedback_sentence(answer.with_feedback))
    if not nominal.found:
        return [*lines, f"For the nominal scene alone: {nominal.status.message}."]
    return [*lines, f"For the nominal scene alone: {_figures_text(nominal, answer)}."]


def _no_torques_reason(robust: RobustSolution) -> str:
    if robust.status is Status.NOT_FOUND_IN_LIMIT:
        return (
            "Whether torques serve the whole set is not decided: a node or time limit ended the "
            "search. Raise the limit, or make the set smaller."
        )
    if robust.rest is not None and robust.status is Status.STRONG_NOT_FOUND:
        text = "Torques serve the whole set, but none were found with rest as the only outcome at "
        text += f"each corner ({robust.rest.tried} tried). It is not proven that there are none."
        if robust.rest.verdicts:
            last = robust.members[robust.rest.corners[-1]].words
            text += f" Rest is lost where {last}: {robust.rest.verdicts[-1].message}."
        return text
    if robust.status is Status.UNVERIFIED:
        return "Not decided: no torques are proven for the whole set. Make the set smaller."
    return f"No torques for the whole set: {robust.status.message}."


def _feedback_sentence(robust: RobustSolution) -> str:
    if robust.status is Status.NOT_FOUND_IN_LIMIT:
        return "Whether position feedback at the joints serves the set was not decided in time."
    if not robust.found:
        return "Position feedback at the joints does not serve the set either."
    most = robust.largest_deflection
    return (
        f"Position feedback at the joints serves the set: max |torque| {robust.max_torque:.4g} "
        f"{robust.max_torque_unit}; with {STIFFNESS:g} N m/rad (controller: {STIFFNESS:g}) joints "
        f"deflect by up to {most:.2g} rad (m). K times the stiffness divides that by K."
    )


def _figures_text(found: TorqueSolution | RobustSolution, answer: RobustAnswer) -> str:
    """Return margin and largest torque in words, or that there are none."""
    if not found.found:
        return "there are none"
    problem = answer.nominal.problem
    torques = found.torques if isinstance(found, TorqueSolution) else found.commands.ravel()
    size = torque_size(problem, np.resize(torques, problem.joint_count))
    return (
        f"margin e = {figure(found.margin, problem.scales.force)} N, max |torque| = "
        f"{figure(found.max_torque, size)} {found.max_torque_unit}"
    )


def _objective_unit(answer: RobustAnswer) -> str:
    objective = answer.nominal.objective
    if objective.algorithm is Algorithm.MARGIN:
        return "N"
    if objective.by_limits:
        return "of the limits"
    unit = str(answer.robust.max_torque_unit)
    return unit if objective.algorithm else "in the unit of the objective"


def robust_data(answer: RobustAnswer) -> dict[str, Any]:
    """Return the data under ``uncertainty`` of a document.

    Returns:
        ``stated`` (the set, as scene files say it), ``status``, ``message``, ``found``,
        ``words`` (sentences that say so),
        ``coverage`` (``whole_set``, ``corners`` or ``sampled``), ``samples`` (None, or ``count``,
        ``served``, ``solved`` and ``where_meant``, which is another coverage), ``margin`` (N),
        ``max_torque``, ``max_torque_unit``, ``bound``, ``torques`` by joint, ``feedback`` by joint
        (None: constant torques), ``largest_deflection`` (rad or m), ``members`` (with ``moved`` and
        ``jacobian`` of those whose contacts move, and ``forces`` of those outside the joined
        problem; None: modes differ from corner to corner), or with a ``policy`` its corners, with
        ``bounding``, the members of the joined problem, ``conflict``
        (numbers of members), ``served_share`` and ``unserved_share``, ``at_corners``
        (verdicts; None: not computed), ``with_feedback``, and ``nominal``.
        Figures that do not exist are None.
    """
    robust, nominal, found = answer.robust, answer.nominal, answer.found
    with_feedback = answer.with_feedback
    return {
        "stated": {
            name: value
            for name, value in uncertainty_entry(answer.uncertainty).items()
            if value is not None
        },
        "status": robust.status.name.lower(),
        "message": robust.status.message,
        "words": robust_sentences(answer),
        "found": found,
        "coverage": robust.coverage.name.lower(),
        "samples": None
        if robust.samples is None
        else {**vars(robust.samples), "where_meant": robust.samples.where_meant.name.lower()},
        **_figures_data(robust),
        "bound": robust.bound,
        "feedback": None
        if robust.feedback is None
        else dict(zip(robust.joint_names, robust.feedback.tolist(), strict=True)),
        "largest_deflection": _largest_deflection(robust),
        **_proof_member_data(robust),
        "conflict": list(robust.conflict),
        "served_share": answer.served_share,
        "unserved_share": answer.unserved_share,
        "at_corners": None
        if answer.at_corners is None
        else _corner_verdict_data(answer.at_corners),
        "with_feedback": None
        if with_feedback is None
        else {
            "stiffness": STIFFNESS,
            "found": with_feedback.found,
            **_figures_data(with_feedback),
            "largest_deflection": _largest_deflection(with_feedback),
        },
        "nominal": {
            "status": nominal.status.name.lower(),
            "found": nominal.found,
            **_figures_data(nominal),
        },
    }


def _corner_verdict_data(judged: MemberVerdicts) -> dict[str, Any]:
    """Return the verdicts at the corners, without their proofs."""
    return {
        "holding": str(judged.holding),
        "left_out": judged.left_out,
        "corners": [
            {"words": member.words, "holding": str(one.holding), "message": one.message}
            for member, one in zip(judged.members, judged.verdicts, strict=True)
        ],
    }


def tolerances_data(tolerances: Tolerances) -> list[dict[str, Any]]:
    """Return the tolerance of each quantity as plain data in SI units; infinite ends are None."""
    entries: list[dict[str, Any]] = [
        {
            "quantity": str(one.quantity),
            "balanced": one.balanced,
            "failing": one.failing if math.isfinite(one.failing) else None,
            "direction": None if one.direction is None else one.direction.tolist(),
            "contacts": list(one.contacts),
            "joints": [tolerances.problem.joint_names[joint] for joint in one.joints],
            "deflection": one.deflection if math.isfinite(one.deflection) else None,
        }
        for one in tolerances.each
    ]
    names = tolerances.problem.joint_names
    for entry, one in zip(entries, tolerances.attainable, strict=False):
        entry["attainable"] = {
            "balanced": one.balanced,
            "failing": one.failing if math.isfinite(one.failing) else None,
            "torques": dict(zip(names, one.torques.tolist(), strict=True)),
            "conflict": [member.words for member in one.conflict],
            "free_motion": None if one.free_motion is None else one.free_motion.tolist(),
            "complete": one.complete,
        }
    return entries


def _figures_data(found: TorqueSolution | RobustSolution) -> dict[str, Any]:
    keys = ("margin", "max_torque", "max_torque_unit")
    if not found.found:
        return dict.fromkeys((*keys, "torques"))
    return {key: getattr(found, key) for key in keys} | {"torques": dict(found.torques_by_joint)}


def _largest_deflection(robust: RobustSolution) -> float | None:
    if robust.feedback is None or not robust.found:
        return None
    return robust.largest_deflection


def _proof_member_data(robust: RobustSolution) -> dict[str, Any]:
    """Return the members of the joined problem; or affine forces and their bounding members."""
    policy = robust.policy
    if policy is None:
        return {"members": _all_member_data(robust)}
    unknowns = policy.unknowns
    return {
        "members": _member_data(policy.corners),
        "policy": {
            "words": [f"{name}, {unit}" for name, unit in unknowns.words],
            "loads": unknowns.loads,
            "balls": unknowns.balls,
            "joints": unknowns.joints,
            "shares": unknowns.shares,
            "offsets": unknowns.offsets,
            "forces": policy.forces,
            "slopes": policy.slopes,
            "errors": policy.errors,
            "directions": policy.directions,
        },
        "bounding": _member_data(robust.joined_members),
    }


def _all_member_data(robust: RobustSolution) -> list[dict[str, Any]]:
    """Return the data of all members, the joined problem's first; without torques only these."""
    joined = robust.joined_members
    if not robust.found:
        return _member_data(joined)
    entries, forces = _member_data(robust.members), further_forces(robust)
    for number, one in enumerate(entries[len(joined) :]):
        one["forces"] = None if forces is None else forces[number]
    return entries


def _member_data(members: Sequence[Member]) -> list[dict[str, Any]]:
    """Return the figures of each member, with moved contacts and their Jacobian where they move."""
    return [
        {
            "words": one.words,
            "external_wrench": one.problem.external_wrench,
            "friction": one.problem.friction,
            "gravity_torques": one.problem.gravity_torques,
            "torque_factors": one.factors,
            "torque_offsets": one.offsets,
            **(
                {}
                if one.moved is None
                else {"moved": one.moved, "jacobian": _contact_jacobians(one.problem)}
            ),
        }
        for one in members
    ]


def _contact_jacobians(problem: QuasistaticProblem) -> FloatArray:
    """Return the Jacobian by contact, (M, 3, L)."""
    return problem.jacobian.reshape(problem.contact_count, 3, problem.joint_count)
