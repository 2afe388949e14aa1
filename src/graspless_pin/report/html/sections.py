"""The rows and figures of the page's sections."""

from __future__ import annotations

import html
import io
import re
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from graspless_pin.algorithms.force_bounds import ContactForceBounds
from graspless_pin.algorithms.robust_solution import Coverage
from graspless_pin.algorithms.tolerance_tables import Tolerances
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.verdict import DynamicOutcome, Holding
from graspless_pin.plots import (
    friction_section,
    normal_force_ranges,
    squeeze_plot,
    tolerance_plot,
    torque_bars,
)
from graspless_pin.plots.canvas import fonts_without_remarks
from graspless_pin.plots.solutions import DIRECTED
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.report.html.case import Case
from graspless_pin.report.verify.values import number
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.tables import (
    contact_states,
    decimals,
    force_rounding,
    friction_use,
    limit_shares,
    torque_rounding,
    torque_size,
    with_noun,
)
from graspless_pin.visualization import LIGHT, Picture, Role

if TYPE_CHECKING:
    from graspless_pin.planning.squeeze_window import SqueezeWindow

_SIGNS = {-1: "−", 0: "0 ", 1: "+"}
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.size": 9.0,
    "font.family": "sans-serif",
    "mathtext.fontset": "dejavusans",
    "text.usetex": False,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "legend.facecolor": "none",
    "legend.edgecolor": "none",
    "legend.framealpha": 1.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    **dict.fromkeys(
        ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"),
        LIGHT.text,
    ),
}
_NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))
_LONGEST = 2000
"""Characters of a sentence of a document that are shown."""
_SECTION_SIZE = (2.5, 2.75)
_WINDOW_SIZE = (7.0, 2.6)
_POLAR_SIZE = (3.4, 3.7)


def joint_rows(solution: TorqueSolution) -> list[dict[str, Any]]:
    """Return a row for each joint; torques are None where nothing was found."""
    problem, found = solution.problem, solution.found
    torques = solution.contact_torques if found else np.zeros(problem.joint_count)
    shares, rounding = np.full(problem.joint_count, np.nan), torque_rounding(problem, torques)
    if found:
        shares = limit_shares(solution.torques, problem.lower_torque, problem.upper_torque)
    return [
        {
            "name": name,
            "contacts": torques[index] if found else None,
            "gravity": problem.gravity_torques[index],
            "torque": solution.torques[index] if found else None,
            "lower": problem.lower_torque[index],
            "upper": problem.upper_torque[index],
            "share": shares[index],
            "rounding": rounding[index],
        }
        for index, name in enumerate(problem.joint_names)
    ]


def contact_rows(case: Case) -> list[dict[str, Any]]:
    """Return a row for each contact; forces and friction only where a solution was found."""
    solution = case.solution
    problem = solution.problem
    fingers = {
        mesh.name.split("/", 2)[2]: mesh.finger % len(LIGHT.fingers)
        for mesh in case.picture.of(Role.HAND)
        if mesh.finger is not None
    }
    rows: list[dict[str, Any]] = [
        {
            "finger": None if case.bodies is None else fingers.get(case.bodies[index]),
            "body": None if case.bodies is None else case.bodies[index],
            "position": case.points[index],
            "friction": problem.friction[index],
            "state": "sliding" if problem.is_sliding[index] else "at rest",
        }
        for index in range(problem.contact_count)
    ]
    if not solution.found:
        return rows
    forces = solution.contact_forces
    known: dict[str, Any] = {
        "force": np.einsum("mij,mi->mj", problem.frames, forces),
        "rounding": force_rounding(problem),
        "use": friction_use(problem, forces),
        "state": contact_states(problem, forces),
        "slides": [
            _virtual_sliding_text(solution, index) for index in range(problem.contact_count)
        ],
    }
    return [
        row | {key: column[index] for key, column in known.items()}
        for index, row in enumerate(rows)
    ]


def motion_rows(problem: QuasistaticProblem, motion: DynamicOutcome) -> list[dict[str, Any]]:
    """Return a row for each contact: its state in a motion, and its force in the contact frame."""
    local = np.einsum("mij,mi->mj", problem.frames, motion.contact_forces)
    return [
        {"state": str(state), "force": force}
        for state, force in zip(motion.states, local, strict=True)
    ]


def torque_figure(solution: TorqueSolution) -> str:
    """Return the torques as SVG."""
    problem = solution.problem
    top = int(np.argmax(np.abs(solution.torques)))
    torque = float(solution.torques[top])
    largest = decimals(torque, torque_size(problem, solution.torques), "+")
    alt = (
        f"Bar chart of {problem.joint_count} motor torques with marks at their limits. The "
        f"largest is {largest} at joint {problem.joint_names[top]}. The table lists all values."
    )
    size = (7.0, 0.9 + 0.24 * problem.joint_count)
    return _inline_svg("torques", alt, size, lambda ax: torque_bars(solution, ax))


def window_figures(window: SqueezeWindow) -> list[str]:
    """Return margin, growth of small motions and normal forces over the squeeze, as SVGs."""
    good = int(np.count_nonzero(np.equal(window.holding, Holding.HOLDS)))
    drawn = {
        "margin": "The margin",
        "growth": "The growth of small motions",
        "normal_force": "The sum of the hand's normal forces",
    }
    return [
        _inline_svg(
            f"squeeze-{value}",
            f"{name} against the squeeze, at {len(window.amounts)} amounts, of which {good} hold. "
            "The window is shaded, and labels at its ends say what fails there.",
            _WINDOW_SIZE,
            partial(squeeze_plot, window, value=value),
        )
        for value, name in drawn.items()
    ]


def tolerance_figures(tolerances: Tolerances) -> list[str]:
    """Return the tolerances by direction, as SVGs."""
    return [
        _inline_svg(
            f"off-{one.quantity.name.lower()}",
            f"How far the {one.quantity} may be off, by direction perpendicular to gravity: at "
            f"least {one.quantity.scale * one.balanced:.3g} {one.quantity.unit}. The table states "
            "the direction in which it fails first.",
            _POLAR_SIZE,
            partial(tolerance_plot, tolerances, one.quantity),
            projection="polar",
        )
        for one in tolerances.each
        if one.quantity in DIRECTED
    ]


def friction_figures(solution: TorqueSolution) -> list[str]:
    """Return the friction of each contact in the cross-section of its cone, as SVGs."""
    problem = solution.problem
    figures, rounding = [], force_rounding(problem)
    size = "radius" if problem.cone_model.is_coulomb else "up to"
    states = contact_states(problem, solution.contact_forces)
    local = np.einsum("mij,mi->mj", problem.frames, solution.contact_forces)
    for contact, (normal, *along) in enumerate(local.tolist()):
        first, second, radius = (
            decimals(float(one), problem.scales.force, "", rounding[contact])
            for one in (*along, problem.friction[contact] * normal)
        )
        alt = (
            f"Contact {contact}, {states[contact]}: friction ({first}, {second}) N along t1 and "
            f"t2, in a cone of {size} {radius} N."
        )
        draw = partial(friction_section, solution, contact)
        figures.append(_inline_svg(f"friction-{contact}", alt, _SECTION_SIZE, draw))
    return figures


def range_rows(
    bounds: ContactForceBounds, figure: Callable[..., str]
) -> list[list[dict[str, Any]]]:
    """Return a row for each contact: the ranges of f_n, f_t1, f_t2 in words.

    A range is open where the torques do not determine the force, or it is not proven that they do.
    An unproven range has a star: it may be wider.

    Args:
        bounds: The ranges.
        figure: Returns a force with its ``rounding`` in words.
    """
    is_open, roundings = bounds.indeterminate | ~bounds.proven, force_rounding(bounds.problem)
    columns = bounds.lower, bounds.upper, is_open, bounds.proven
    rows = []
    for *each, rounding in zip(*columns, roundings, strict=True):
        cells = []
        for lower, upper, open_, proven in zip(*each, strict=True):
            ends = [figure(end, rounding=rounding) for end in (lower, upper)]
            words = " to ".join(ends) if open_ else ends[0]
            if np.isinf([lower, upper]).all():
                words = "unbounded"
            cells.append({"words": words if proven else f"{words} *", "open": open_})
        rows.append(cells)
    return rows


def joined_ranges(
    ruled: list[list[dict[str, Any]]], at_rest: list[list[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """Return the rows of one table; where ranges at rest differ, they stand in a second row.

    Args:
        ruled: Rows of `range_rows` under the virtual-sliding rule.
        at_rest: Those over all forces of rest.
    """
    rows = []
    for contact, (cells, others) in enumerate(zip(ruled, at_rest, strict=True)):
        over = "both" if cells == others else "by the rule"
        rows.append({"contact": contact, "over": over, "cells": cells})
        if over != "both":
            findings = [
                {"words": "same", "open": False} if cell == other else other
                for cell, other in zip(cells, others, strict=True)
            ]
            rows.append({"contact": contact, "over": "any at rest", "cells": findings})
    return rows


def range_figure(bounds: ContactForceBounds, solution: TorqueSolution) -> str:
    """Return the ranges of the normal forces as SVG."""
    count = int(bounds.indeterminate[:, 0].sum())
    alt = (
        f"Ranges of {len(bounds.lower)} normal forces, with dots at the solution's; the torques do "
        f"not determine {count} of them. The table lists all values."
    )
    size = (7.0, 0.9 + 0.28 * len(bounds.lower))
    return _inline_svg("ranges", alt, size, lambda ax: normal_force_ranges(bounds, solution, ax))


def unknown_rows(case: Case) -> dict[str, Any] | None:
    """Return the robust answer that the document states, as table data; None: it states none.

    Returns:
        ``coverage`` and ``words`` (sentences), ``conflict`` (members in words), and ``joints``:
        name, robust torque, torque of the nominal scene.
    """
    stated = case.document.get("uncertainty")
    if not isinstance(stated, dict):
        return None
    try:
        members, nominal = stated["members"], stated["nominal"]["torques"] or {}
        covered, samples = Coverage[str(stated["coverage"]).upper()].value, stated.get("samples")
        if samples is not None:
            covered = Coverage[str(samples["where_meant"]).upper()].where_meant
        return {
            "coverage": covered,
            "words": [str(one)[:_LONGEST] for one in stated["words"]],
            "conflict": [str(members[one]["words"])[:_LONGEST] for one in stated["conflict"]],
            "joints": [
                (
                    name,
                    number(torque, "torques"),
                    number(nominal[name], "torques") if name in nominal else None,
                )
                for name, torque in (stated["torques"] or {}).items()
            ],
        }
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise ArgumentError("document", f"uncertainty: is not complete ({error!r})") from None


def check_rows(case: Case) -> list[dict[str, str]]:
    """Return a row for each check of the document.

    Raises:
        ArgumentError: If the document is not complete.
    """
    words = {"ok": "passed"}
    return [
        {"name": check.name, "verdict": words.get(check.mark, check.mark), "detail": check.detail}
        for check in case.verification.checks
    ]


def scene_in_words(picture: Picture) -> str:
    """Return the text alternative of the 3-D view of a scene."""
    counts = Counter(mesh.role for mesh in picture.meshes)
    names = {
        role: ", ".join(mesh.name.split("/")[-1] for mesh in picture.of(role))
        for role in (Role.OBJECT, Role.SUPPORT)
    }
    parts = []
    if counts[Role.HAND]:
        links = {mesh.name.split("/", 2)[2] for mesh in picture.of(Role.HAND)}
        parts.append(f"a hand of {with_noun(len(links), 'link')}")
    if counts[Role.OBJECT]:
        parts.append(f"the object {names[Role.OBJECT]}")
    if counts[Role.SUPPORT]:
        parts.append(f"supported by {names[Role.SUPPORT]}")
    parts.append(f"{counts[Role.CONTACT]} contact points with friction cones")
    if counts[Role.NORMAL_FORCE]:
        parts.append("arrows of the contact forces on the object")
    if counts[Role.CENTER_OF_MASS]:
        parts.append("the centre of mass and the horizontal region in which it may lie")
    return "Shows " + ", ".join(parts) + "."


def _virtual_sliding_text(solution: TorqueSolution, contact: int) -> str:
    """Return the virtual sliding of a contact in words."""
    mode = solution.mode
    if not mode.selection[contact]:
        return "none"
    first, second = (_SIGNS[int(sign)] for sign in mode.signs[contact])
    return f"{first}t1, {second}t2"


def _inline_svg(
    name: str,
    alt: str,
    size: tuple[float, float],
    draw: Callable[[Any], object],
    projection: str | None = None,
) -> str:
    """Return a plot as an SVG element with a text alternative.

    Args:
        name: Prefix of all ids, unique in the page.
        alt: The text alternative.
        size: Width and height, inches; the page may shrink it.
        draw: Draws on the axes that it is given.
        projection: Of the axes.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(_STYLE), fonts_without_remarks():
        figure = Figure(figsize=size, layout="constrained")
        draw(figure.add_subplot(projection=projection))
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata=_NO_METADATA)
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", svg)
    for role, color in LIGHT.roles.items():
        if color != LIGHT.text:
            svg = svg.replace(color, f"var(--{role})")
    svg = svg.replace(LIGHT.text, "currentColor")
    width = f"{72.0 * size[0]:.0f}pt"
    box = re.search(r'viewBox="[^"]*"', svg)
    if box is None:  # pragma: no cover - matplotlib always writes one
        raise ValueError("an SVG without a viewBox")
    title = f'<title id="{name}-title">{html.escape(alt)}</title>'
    start = (
        f'<svg {box[0]} role="img" aria-labelledby="{name}-title" style="max-width: {width}" '
        f'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">{title}'
    )
    return start + svg[svg.index(">") + 1 :]
