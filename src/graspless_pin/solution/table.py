"""A solution as readable tables: joints, contacts, margin, mode and certificate."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from tabulate import tabulate

from graspless_pin.problem.joint_units import units_text

if TYPE_CHECKING:
    from graspless_pin.solution.records import TorqueSolution

_AT_LIMIT = 1e-6
_LEAST, _MOST = 0.01, 1e6
"""Loads whose figures have four decimals in tables; there 1e-8 counts as zero."""
_NOTHING = 1e-6
_JOINT_HEADERS = ["joint", "contacts", "gravity", "torque", "lower", "upper", "of limit"]
_CONTACT_LEGEND = (
    "friction: share of what mu allows; slides: signs of the virtual sliding (B, S) along t1 and "
    "t2, .. none"
)


def solution_text(solution: TorqueSolution, bodies: Sequence[str] | None = None) -> str:
    """Return the tables of a solution, or why there is none.

    Args:
        solution: The solution.
        bodies: M names of what touches the object at each contact; None: left out.
    """
    if not solution.found:
        why = f"\n\n{solution.explanation}\n" if solution.explanation else ""
        return f"not found: {solution.status.message}{why}\n{certificate_text(solution)}"
    parts = [headline(solution)]
    if solution.problem.joint_count:
        parts.append(joint_table(solution))
    parts += [contact_table(solution, bodies), certificate_text(solution)]
    return "\n\n".join(parts)


def solution_html(solution: TorqueSolution) -> str:
    """Return what `solution_text` does as HTML, for notebooks."""
    if not solution.found:
        why = f"{solution.status.message}\n{solution.explanation}".strip()
        return f"{paragraph(f'not found: {why}')}\n{paragraph(certificate_text(solution))}"
    parts = [paragraph(headline(solution))]
    if solution.problem.joint_count:
        rows, headers, legend = _joint_rows(solution)
        parts.append(table_html(rows, headers, legend, digits_of(_torque_size(solution), "+")))
    rows, headers = _contact_rows(solution, None)
    digits = digits_of(solution.problem.scales.force)
    parts.append(table_html(rows, headers, _CONTACT_LEGEND, digits))
    parts.append(paragraph(certificate_text(solution)))
    return "\n".join(parts)


def table_html(
    rows: Sequence[Sequence[Any]], headers: Sequence[str], note: str = "", floats: str = "g"
) -> str:
    """Return a table as HTML with a note below it, for notebooks; all text is escaped."""
    table = tabulate(rows, headers, tablefmt="html", floatfmt=floats, disable_numparse=True)
    return f"{table}\n{paragraph(note)}" if note else table


def paragraph(text: str) -> str:
    """Return text as an HTML paragraph; every line stays one."""
    return f"<p>{'<br>'.join(html.escape(line) for line in text.splitlines())}</p>"


def headline(solution: TorqueSolution) -> str:
    """Return one or two lines: what was solved and the two figures that matter."""
    margin = f"at margin {solution.required_margin:g} N"
    what = {
        "margin": "Algorithm 1, largest margin",
        "torque": f"Algorithm 2, smallest torque {margin}",
    }.get(solution.algorithm or "", f"{solution.objective.name} {margin}")
    return (
        f"{what}: {solution.status.message}\n"
        f"margin e = {_figure(solution.margin, solution.problem.scales.force)} N, max |torque| = "
        f"{_figure(solution.max_torque, _torque_size(solution))} {solution.max_torque_unit}"
    )


def joint_table(solution: TorqueSolution) -> str:
    """Return the joints: torque from contacts, from gravity, total, limits, share of the limit."""
    rows, headers, legend = _joint_rows(solution)
    table = tabulate(
        rows, headers, floatfmt=digits_of(_torque_size(solution), "+"), stralign="left"
    )
    return f"{table}\n{legend}"


def _joint_rows(solution: TorqueSolution) -> tuple[list[tuple[Any, ...]], list[str], str]:
    """Rows, headers and legend; with a column for the unit where joints differ in it."""
    problem = solution.problem
    torques, size = solution.torques, _torque_size(solution)
    shares = limit_shares(torques, problem.lower_torque, problem.upper_torque)
    columns = [
        problem.joint_names,
        _plain(solution.contact_torques, size),
        _plain(problem.gravity_torques, size),
        _plain(torques, size),
        problem.lower_torque,
        problem.upper_torque,
        [f"{100.0 * share:.1f} %" if np.isfinite(share) else "-" for share in shares],
    ]
    headers = list(_JOINT_HEADERS)
    if len(set(problem.joint_units)) > 1:
        columns.insert(1, [unit.value for unit in problem.joint_units])
        headers.insert(1, "unit")
    legend = f"torques in {units_text(problem.joint_units)}"
    return list(zip(*columns, strict=True)), headers, legend


def digits_of(size: float, sign: str = "") -> str:
    """Return the format of figures of a size: four decimals, or five digits where it is far from 1.

    Args:
        size: The load, or what it makes on the longest lever; a length.
        sign: ``+`` to print it always.
    """
    return f"{sign}.4f" if _is_everyday(size) else f"{sign}.5g"


def _is_everyday(size: float) -> bool:
    return _LEAST <= size <= _MOST


def _torque_size(solution: TorqueSolution) -> float:
    """Return what the load makes on the longest lever, or a larger torque; 1 without joints."""
    sizes = [solution.problem.scales.joints, np.abs(solution.torques)]
    return float(np.concatenate(sizes).max(initial=0.0)) or 1.0


def _plain(values: np.ndarray, size: float) -> np.ndarray:
    """Round to the digits shown, without negative zeros; what rounding left of zero is zero."""
    if _is_everyday(size):
        return np.round(values, 4) + 0.0
    return np.where(np.abs(values) < _NOTHING * size, 0.0, values)


def _figure(value: float, size: float) -> str:
    """Six digits of a figure beside others of a size; a billionth of these is rounding of zero."""
    if _is_everyday(size):
        return f"{round(value, 8) + 0.0:.6g}"
    return f"{0.0 if abs(value) < 1e-2 * _NOTHING * size else value:.6g}"


def contact_table(solution: TorqueSolution, bodies: Sequence[str] | None) -> str:
    """Return the contacts: point, normal force, friction and its use, state, virtual sliding."""
    rows, headers = _contact_rows(solution, bodies)
    table = tabulate(
        rows,
        headers,
        floatfmt=digits_of(solution.problem.scales.force),
        stralign="left",
        disable_numparse=[1],
    )
    return f"{table}\n{_CONTACT_LEGEND}"


def _contact_rows(
    solution: TorqueSolution, bodies: Sequence[str] | None
) -> tuple[list[list[Any]], list[str]]:
    problem = solution.problem
    forces, mode = solution.contact_forces, solution.mode
    load, length, _ = problem.scales
    normal = _plain(np.einsum("ij,ij->i", problem.normals, forces), load)
    digits = digits_of(length, "+")
    use = friction_use(solution)
    tokens = str(mode).split(" ")
    rows = []
    for contact in range(problem.contact_count):
        share = "-" if np.isnan(use[contact]) else f"{100.0 * use[contact]:.0f} %"
        where = " ".join(f"{x:{digits}}" for x in _plain(problem.positions[contact], length))
        row = [contact, where, normal[contact], share, contact_state(solution, contact)]
        name = [bodies[contact]] if bodies is not None else []
        rows.append([*row[:1], *name, *row[1:], tokens[contact]])
    headers = [
        "#",
        "point from the centre of mass [m]",
        "normal [N]",
        "friction",
        "state",
        "slides",
    ]
    if bodies is not None:
        headers.insert(1, "touching")
    return rows, headers


def friction_use(solution: TorqueSolution) -> np.ndarray:
    """(M,) |tangential force| / (mu times normal force); NaN where there is no friction or load.

    1 is the edge of the Coulomb cone; the polyhedral cone inside it ends a little earlier.
    """
    problem = solution.problem
    normal = np.einsum("ij,ij->i", problem.normals, solution.contact_forces)
    tangential = solution.contact_forces - normal[:, None] * problem.normals
    most = problem.friction * normal
    with np.errstate(divide="ignore", invalid="ignore"):
        use = np.linalg.norm(tangential, axis=1) / most
    return np.where(most > 0.0, use, np.nan)


def contact_state(solution: TorqueSolution, contact: int) -> str:
    """Return ``sliding``, ``frictionless``, ``at its limit`` (on a cone face) or ``sticking``."""
    problem = solution.problem
    if problem.is_sliding[contact]:
        return "sliding"
    if not problem.has_cone[contact]:
        return "frictionless"
    force = solution.contact_forces.ravel()
    columns = np.abs(problem.H[3 * contact : 3 * contact + 3]).sum(axis=0) > 0.0
    distance = -(problem.H[:, columns].T @ force).max()
    return "at its limit" if distance <= _AT_LIMIT * problem.scales.force else "sticking"


def limit_shares(torques: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """(L,) share of the limit on the side where each torque is; NaN where that side has none."""
    limit = np.where(torques >= 0.0, upper, lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = torques / limit
    return np.where(np.isfinite(limit) & (limit != 0.0), share, np.nan)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def certificate_text(solution: TorqueSolution) -> str:
    """Return the certificate in a few lines."""
    proof = solution.certificate
    problem, lines = solution.problem, []
    unit, size = "N", problem.scales.force
    if solution.algorithm is None:
        unit, size = "of its own unit", 1.0
    elif solution.found and solution.algorithm == "torque":
        unit, size = solution.max_torque_unit, _torque_size(solution)
    if solution.found:
        if solution.objective.by_limits:
            unit, size = "of the limit", 1.0
        lines.append(
            f"certificate: primal residual {proof.primal_residual:.1e}, duality gap "
            f"{proof.duality_gap:.1e} (scaled); proven bound {_figure(proof.bound, size)} {unit}, "
            f"gap {proof.gap + 0.0:.1e} {unit}"
        )
    elif proof.infeasibility > 0.0:
        lines.append(
            f"certificate: every choice of forces violates some constraint by at least "
            f"{proof.infeasibility:.3g} (scaled)"
        )
    if proof.force_reach < problem.max_normal_force.max():
        lines.append(f"the bound is proven for normal forces up to {proof.force_reach:.3g} N")
    if proof.threshold_optima is not None:
        slow, fast = (
            f"{_figure(value, size)} {unit}" if np.isfinite(value) else "infeasible"
            for value in proof.threshold_optima
        )
        lines.append(
            "this answer hangs on what counts as a virtual motion (see docs/rules.md): with a "
            f"tenth of the threshold it is {slow}, with ten times {fast}"
        )
    lines.append(
        f"search: {_count(proof.nodes, 'node')}, "
        f"{_count(proof.modes_examined, 'mode')} examined, "
        f"{_count(proof.force_programs, 'force program')}, "
        f"{_count(proof.kinematic_programs, 'kinematic program')}"
        + (f", answer by {proof.solver}" if proof.solver else "")
    )
    return "\n".join(lines)
