"""Printed tables of joints, contacts and certificates; shares of limits, and number formats."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from tabulate import tabulate

from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, units_text
from graspless_pin.problem.scales import LIMIT_TOLERANCE
from graspless_pin.solution.certificate import Certificate

_AT_LIMIT = 1e-6
_LEAST_LEVER_SHARE = 1e-3
"""Relative to the longest lever at a contact: joints with shorter ones do not limit it."""


def joint_torque_sizes(problem: QuasistaticProblem) -> FloatArray:
    """Return the (L,) torques of the load on each joint, or its limit if that is smaller."""
    return problem.limit_tolerances[0] / LIMIT_TOLERANCE


def force_sizes(problem: QuasistaticProblem) -> FloatArray:
    """Return the (M,) load, N, or the hand's largest force at a contact of its own if smaller."""
    load = problem.scales.force
    sizes = np.full(problem.contact_count, load)
    if problem.strictness is None:
        return sizes
    blocks = problem.jacobian.reshape(problem.contact_count, 3, -1)
    levers = np.sqrt((blocks**2).sum(axis=1))
    acts = (levers > 0.0) & (
        levers >= _LEAST_LEVER_SHARE * levers.max(axis=1, initial=0.0, keepdims=True)
    )
    forces = np.where(acts, joint_torque_sizes(problem), 0.0) / np.where(acts, levers, 1.0)
    return np.where(acts.any(axis=1), np.minimum(forces.max(axis=1, initial=0.0), load), sizes)


def friction_use(problem: QuasistaticProblem, forces: FloatArray) -> FloatArray:
    """Return (M,) |tangential force| / (mu times normal force); NaN without friction or load.

    1 is the surface of the Coulomb cone, slightly outside the polyhedral cone. For other cone
    models 1 is the surface of the cone itself, which the forces of sliding contacts are on.
    """
    local = np.einsum("mji,mj->mi", problem.frames, forces)
    largest_friction, model = problem.friction * local[:, 0], problem.cone_model
    with np.errstate(divide="ignore", invalid="ignore"):
        use = model.friction_sizes(local[:, 1:], problem.cone_edges) / largest_friction
    if not model.is_coulomb:
        use[problem.is_sliding] = 1.0
    return np.where(largest_friction > 0.0, use, np.nan)


def contact_states(problem: QuasistaticProblem, forces: FloatArray) -> list[str]:
    """Return the states of the M contacts.

    A state is ``sliding``, ``frictionless``, ``at its limit`` (on its cone) or ``sticking``.
    """
    at_limit = problem.cone_distances(forces) <= _AT_LIMIT * force_sizes(problem)
    conditions = [problem.is_sliding, ~problem.has_cone, at_limit]
    return np.select(conditions, ["sliding", "frictionless", "at its limit"], "sticking").tolist()


def limit_shares(torques: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return (L,) shares of the limit on the side of each torque; NaN if that side has none."""
    limit = np.where(torques >= 0.0, upper, lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = torques / limit
    return np.where(np.isfinite(limit) & (limit != 0.0), share, np.nan)


_LEAST_EVERYDAY, _MOST_EVERYDAY = 0.01, 1e6
"""Range of loads for which tables print four decimals."""
_ZERO_SHARE = 1e-7
"""Relative to the size of comparable figures: smaller figures are a solver's zero."""
_LEAST_IN_DECIMALS = 5e-5
"""Smaller figures round to zero in four decimals."""
_NO_MATHEMATICS = 'class="tex2jax_ignore mathjax_ignore"'
"""Prevents notebooks from typesetting text between dollar signs, which names may contain."""
COLUMNS = 80
"""Width of the narrowest terminal, in characters."""
_LEAST_NAME_WIDTH = 12
"""Smallest width of a column of names, in characters."""
_JOINT_HEADERS = ["joint", "contacts", "gravity", "torque", "lower", "upper", "of limit"]
_CONTACT_LEGEND = (
    "point from the centre of mass; normal force in N; of mu: share of friction used\n"
    "slides: signs of the virtual sliding (B, S) along t1 and t2, .. none"
)


class Table(NamedTuple):
    """A table to be printed.

    Attributes:
        rows: Its cells.
        headers: One for each column.
        legend: A line below it.
        floats: Format of cells that are floats.
        texts: Columns of texts, never parsed as numbers. The first one is wrapped if the table is
            wider than a terminal of 80 characters.
        figures: Columns of formatted numbers, which are printed as they are.
    """

    rows: Sequence[Sequence[Any]]
    headers: Sequence[str]
    legend: str = ""
    floats: str = "g"
    texts: tuple[int, ...] = ()
    figures: tuple[int, ...] = ()

    def __str__(self) -> str:
        """Return the table as text."""
        table = self._table_text()
        excess = max(map(len, table.splitlines())) - COLUMNS
        if excess > 0 and self.texts:
            names = self.texts[0]
            width = max(len(str(row[names])) for row in self.rows) - excess
            widths: list[int | None] = [None] * len(self.headers)
            widths[names] = max(width, len(self.headers[names]), _LEAST_NAME_WIDTH)
            table = self._table_text(widths)
        return f"{table}\n{self.legend}" if self.legend else table

    def _table_text(self, widths: Sequence[int | None] | None = None) -> str:
        aligned = [
            "right" if place in self.figures else "global" for place in range(len(self.headers))
        ]
        return tabulate(
            self.rows, self.headers, floatfmt=self.floats, stralign="left", colalign=aligned,
            disable_numparse=[*self.texts, *self.figures], maxcolwidths=widths,
        )  # fmt: skip

    def html(self) -> str:
        """Return the table as HTML, for notebooks; all text is escaped."""
        cells = [
            [f"{cell:{self.floats}}" if isinstance(cell, float) else cell for cell in row]
            for row in self.rows
        ]
        table = str(tabulate(cells, self.headers, tablefmt="html", disable_numparse=True))
        table = table.replace("<table", f"<table {_NO_MATHEMATICS}", 1)
        return f"{table}\n{paragraph(self.legend)}" if self.legend else table


def paragraph(text: str) -> str:
    """Return text as an HTML paragraph that keeps the line breaks."""
    lines = "<br>".join(html.escape(line) for line in text.splitlines())
    return f"<p {_NO_MATHEMATICS}>{lines}</p>"


def joint_table(problem: QuasistaticProblem, from_contacts: FloatArray) -> Table:
    """Return the table of joints: torque from contacts and gravity, total, limits, share of limit.

    If joints differ in their unit, the unit has a column of its own.

    Args:
        problem: The problem.
        from_contacts: (L,) torques J^T f of the contact forces.
    """
    torques = from_contacts + problem.gravity_torques
    size = torque_size(problem, torques)
    shares = limit_shares(torques, problem.lower_torque, problem.upper_torque)
    rounding = torque_rounding(problem, from_contacts)
    columns: list[Sequence[str]] = [
        problem.joint_names,
        *(
            [
                decimals(value, size, "+", resolution)
                for value, resolution in zip(column.tolist(), rounding, strict=True)
            ]
            for column in (from_contacts, problem.gravity_torques, torques)
        ),
        *(
            [decimals(value, size, "+", 0.0) for value in column.tolist()]
            for column in (problem.lower_torque, problem.upper_torque)
        ),
        [f"{100.0 * share:.1f} %" if np.isfinite(share) else "-" for share in shares],
    ]
    headers = list(_JOINT_HEADERS)
    if len(set(problem.joint_units)) > 1:
        columns.insert(1, [unit.value for unit in problem.joint_units])
        headers.insert(1, "unit")
    legend = f"torques in {units_text(problem.joint_units)}"
    last = len(headers) - 1
    figures = tuple(range(last - 5, last))
    return Table(list(zip(*columns, strict=True)), headers, legend, "g", (0,), figures)


def contact_table(
    problem: QuasistaticProblem,
    forces: FloatArray,
    mode: SlidingMode,
    bodies: Sequence[str] | None = None,
) -> Table:
    """Return the table of contacts: point, normal force, used share of friction, virtual sliding.

    Args:
        problem: The problem.
        forces: (M, 3) contact forces, N.
        mode: The virtual-sliding mode.
        bodies: M names of what touches the object at each contact; None: left out.
    """
    load, length, _ = problem.scales
    normal = np.einsum("ij,ij->i", problem.normals, forces)
    shares, tokens = _friction_cells(problem, forces), str(mode).split(" ")
    rows, rounding = [], force_rounding(problem)
    for contact in range(problem.contact_count):
        where = " ".join(coordinate(x, length) for x in problem.positions[contact].tolist())
        name = [bodies[contact]] if bodies is not None else []
        force = decimals(float(normal[contact]), load, "", rounding[contact])
        rows.append([contact, *name, where, force, shares[contact], tokens[contact]])
    headers = ["#", "point [m]", "normal", "of mu", "slides"]
    if bodies is not None:
        headers.insert(1, "touching")
    return Table(rows, headers, _CONTACT_LEGEND, "g", (1,), (headers.index("normal"),))


def _friction_cells(problem: QuasistaticProblem, forces: FloatArray) -> list[str]:
    """Return the share of friction of each sticking contact, and the state of each other one."""
    words = {"at its limit": "limit", "frictionless": "-"}
    shares = []
    each = zip(contact_states(problem, forces), friction_use(problem, forces), strict=True)
    for state, use in each:
        share = "-" if np.isnan(use) else f"{100.0 * use:.0f} %"
        shares.append(share if state == "sticking" else words.get(state, state))
    return shares


def certificate_text(
    proof: Certificate, problem: QuasistaticProblem, unit: str, size: float, *, found: bool
) -> str:
    """Return a certificate as a few lines of text.

    Args:
        proof: The certificate.
        problem: The problem.
        unit: Unit of the bound.
        size: Size of comparable figures, which determines the digits.
        found: Whether there is an answer.
    """
    lines = []
    if found:
        own = f", duality gap {proof.duality_gap:.1e}" if np.isfinite(proof.duality_gap) else ""
        lines.append(
            f"certificate: primal residual {proof.primal_residual:.1e}{own} (scaled)\n"
            f"proven bound {figure(proof.bound, size)} {unit}, gap {proof.gap + 0.0:.1e} {unit}"
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
            f"{figure(value, size)} {unit}" if np.isfinite(value) else "infeasible"
            for value in proof.threshold_optima
        )
        lines.append(
            "this answer depends on the threshold of virtual motion (see docs/rules.md): with a "
            f"tenth of the threshold it is {slow}, with ten times the threshold it is {fast}"
        )
    lines.append(
        f"search: {with_noun(proof.nodes, 'node')}, "
        f"{with_noun(proof.modes_examined, 'mode')}, "
        f"{with_noun(proof.force_programs, 'force program')}, "
        f"{with_noun(proof.kinematic_programs, 'kinematic program')}"
        + (f", answer by {proof.solver}" if proof.solver else "")
    )
    return "\n".join(lines)


def headed_text(head: str, text: str) -> str:
    """Return ``head: text`` in one line, or in two if that is wider than 80 characters."""
    between = " " if len(head) + len(text) + 2 <= COLUMNS else "\n"
    return f"{head}:{between}{text}"


def decimals(value: float, size: float, sign: str = "", rounding: float | None = None) -> str:
    """Return a formatted figure: four decimals, or five digits if the size is far from 1.

    Rounding of zero is printed as 0, and figures too small for four decimals with two digits.

    Args:
        value: The figure.
        size: Size of comparable figures: the load, its torque on the longest lever, or a length.
        sign: ``+`` to print the sign always.
        rounding: Figures up to this are rounding of zero; None: 1e-7 of the size.
    """
    if abs(value) <= (_ZERO_SHARE * size if rounding is None else rounding):
        return "0"
    if not _is_ordinary(size):
        return f"{value:{sign}.5g}"
    return f"{value:{sign}.1e}" if abs(value) < _LEAST_IN_DECIMALS else f"{value:{sign}.4f}"


def coordinate(value: float, length: float) -> str:
    """Return a formatted coordinate with its sign; the length is the size of comparable ones."""
    return f"{round(value, 4) + 0.0:+.4f}" if _is_ordinary(length) else decimals(value, length, "+")


def figure(value: float, size: float) -> str:
    """Return six digits of a figure, or 0 if it is rounding beside figures of the given size."""
    return f"{0.0 if abs(value) <= _ZERO_SHARE * size else value:.6g}"


def brief_figure(value: float, size: float) -> str:
    """Return four digits of a figure, as `figure` does."""
    return f"{float(figure(value, size)):.4g}"


def torque_rounding(problem: QuasistaticProblem, from_contacts: FloatArray) -> list[float]:
    """Return for each of L joints the largest torque that is rounding of zero.

    Args:
        problem: The problem.
        from_contacts: (L,) torques J^T f of the contact forces.
    """
    sizes = [joint_torque_sizes(problem), np.abs(problem.gravity_torques), np.abs(from_contacts)]
    return [_ZERO_SHARE * size for size in np.maximum.reduce(sizes).tolist()]


def force_rounding(problem: QuasistaticProblem) -> list[float]:
    """Return for each of M contacts the largest force that is rounding of zero."""
    return [_ZERO_SHARE * size for size in force_sizes(problem).tolist()]


def torque_size(problem: QuasistaticProblem, torques: FloatArray) -> float:
    """Return the largest of the torques and of the `joint_torque_sizes`; 1 without joints."""
    sizes = [joint_torque_sizes(problem), np.abs(torques)]
    return float(np.concatenate(sizes).max(initial=0.0)) or 1.0


def _is_ordinary(size: float) -> bool:
    return _LEAST_EVERYDAY <= size <= _MOST_EVERYDAY


def with_noun(number: int, noun: str) -> str:
    """Return a number with its noun, singular or plural: ``1 joint``, ``2 joints``."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def from_to(low: float, high: float, precision: float, sign: str = "") -> str:
    """Return a range as text, ``0 to 5``; an end within ``precision`` times its width of 0 is 0."""
    rounding = precision * abs(high - low)
    return " to ".join("0" if abs(end) <= rounding else f"{end:{sign}.3g}" for end in (low, high))
