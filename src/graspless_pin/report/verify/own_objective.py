"""An objective that is neither of the paper's: its columns, rows and costs, taken as they stand.

The program is: minimise sum of cost y + curvature y^2 / 2 over the objective's own columns y (and
half of the forces' own curvature) so that the contact forces f obey the problem, W f + w + B y = 0,
h^T f + margin + E y <= 0 at each cone face, and low <= A f + C y <= high in the objective's own
rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from graspless_pin.report.verify.values import (
    MOST,
    array,
    entry,
    items,
    number,
    short_text,
    truth,
    whole,
    word,
)

_MOST_COEFFICIENTS = 4_000_000
_KEPT = ("balance", "faces", "normal_upper", "normal_lower", "torque")
_SIGNS = ("any", "upper", "either")


@dataclass(frozen=True, eq=False)
class OwnRows:
    """Rows of the objective's own, those of all its blocks in one.

    Attributes:
        blocks: Name, sign and shape of the multipliers of each block.
        unit: (q,) what one of each row is of order of.
        low: (q,) lower sides, -inf where there is none.
        high: (q,) upper sides.
        forces: (q, M, 3) coefficients of the forces along n, t1, t2.
        columns: (q, k) coefficients of the objective's columns.
    """

    blocks: tuple[tuple[str, str, tuple[int, ...]], ...]
    unit: np.ndarray
    low: np.ndarray
    high: np.ndarray
    forces: np.ndarray
    columns: np.ndarray


@dataclass(frozen=True, eq=False)
class OwnObjective:
    """What an objective adds to the problem.

    Attributes:
        maximizes: Whether the stated figures are those of minus the objective.
        unit: What its figures are of order of.
        value: The stated value; 0 where nothing was found.
        keeps: Which constraints of the problem it keeps.
        column_unit: (k,) what one of each column is of order of.
        cost: (k,) of each column.
        curvature: (k,) of each column.
        bounds: (2, k) imposed on the columns.
        boxes: (2, 2, k) that the constraints imply: with forces within the reach, and all.
        values: (k,) the answer's columns; None where nothing was found.
        balance: (P, k) coefficients of the columns in the balance.
        faces: (M, k) in the rows of the cones' faces, for each contact.
        normal_upper: (M, k) in n^T f <= limit.
        normal_lower: (M, k) in -n^T f <= 0 where there is no cone.
        margins: (M,) constant margin in the faces, N.
        normal_range: (2, M) bounds of the normal forces.
        force_curvature: (M, 3) second derivative of the objective by the forces along n, t1, t2.
        rows: Its own rows.
    """

    maximizes: bool
    unit: float
    value: float
    keeps: frozenset[str]
    column_unit: np.ndarray
    cost: np.ndarray
    curvature: np.ndarray
    bounds: np.ndarray
    boxes: np.ndarray
    values: np.ndarray | None
    balance: np.ndarray
    faces: np.ndarray
    normal_upper: np.ndarray
    normal_lower: np.ndarray
    margins: np.ndarray
    normal_range: np.ndarray
    force_curvature: np.ndarray
    rows: OwnRows

    @property
    def multipliers(self) -> frozenset[str]:
        """Names of the multipliers of the limits that it keeps."""
        torque = ("torque_upper", "torque_lower") if "torque" in self.keeps else ()
        return self.keeps.union(torque)

    def cost_of(self, local: np.ndarray, columns: np.ndarray) -> float:
        """Return the minimised value of forces along n, t1, t2 and of columns."""
        bent = (self.force_curvature * local**2).sum() + (self.curvature * columns**2).sum()
        return float(0.5 * bent + self.cost @ columns)

    def beyond(self, local: np.ndarray, columns: np.ndarray) -> float:
        """Return the farthest that its own rows and bounds are violated, over their units.

        Args:
            local: (M, 3) forces along n, t1, t2.
            columns: (k,) its columns.
        """
        values = np.einsum("qmi,mi->q", self.rows.forces, local) + self.rows.columns @ columns
        own = np.maximum(values - self.rows.high, self.rows.low - values) / self.rows.unit
        outside = np.maximum(columns - self.bounds[1], self.bounds[0] - columns)
        return float(np.concatenate([own, outside / self.column_unit]).max(initial=0.0))

    def beyond_forces(
        self, normal: np.ndarray, limit: np.ndarray, faces: np.ndarray, columns: np.ndarray
    ) -> float:
        """Return how far forces are beyond its margins and ranges, N.

        Args:
            normal: (M,) normal forces.
            limit: (M,) their limits.
            faces: (M,) the largest h^T f of each contact, -inf without a cone.
            columns: (k,) its columns.
        """
        parts = [faces + self.margins + self.faces @ columns]
        parts += [normal - self.normal_range[1], self.normal_range[0] - normal]
        if "normal_upper" in self.keeps:
            parts.append(normal + self.normal_upper @ columns - limit)
        if "normal_lower" in self.keeps:
            without_cone = np.isneginf(faces)
            parts.append(np.where(without_cone, self.normal_lower @ columns - normal, -np.inf))
        return float(np.concatenate(parts).max(initial=0.0))


def read_own_objective(given: object, counts: tuple[int, int], *, found: bool) -> OwnObjective:
    """Return the objective that a document states.

    Args:
        given: What stands under ``objective``.
        counts: M and P.
        found: Whether there is an answer.

    Raises:
        ValueError: If it is none.
    """
    where, (count, passive) = "objective", counts
    short_text(entry(given, "name", where), "the objective's name")
    groups = items(entry(given, "columns", where), "columns of the objective", 0, MOST)
    sizes = [len(items(entry(one, "unit", "a column"), "unit", 0, MOST)) for one in groups]
    k = sum(sizes)

    def columns(key: str, rows: int = 0, *, bounds: bool = False) -> np.ndarray:
        parts = [np.zeros((rows or 1, 0))]
        for one, size in zip(groups, sizes, strict=True):
            listed = entry(one, key, "a column")
            listed = listed if rows else [listed]
            parts.append(
                _ends(listed, size, key) if bounds else array(listed, (rows or 1, size), key)
            )
        joined = np.concatenate(parts, axis=1)
        return joined if rows else joined[0]

    keeps = items(entry(given, "keeps", where), "keeps of the objective", 2, len(_KEPT))
    kept = frozenset(word(one, "what the objective keeps", _KEPT) for one in keeps)
    if not {"balance", "faces"} <= kept:
        raise ValueError("the objective does not keep the balance and the cones")
    terms = entry(given, "terms", where)

    def of(name: str, size: int) -> np.ndarray:
        listed = entry(terms, name, "terms") if name in kept else []
        return _matrix(listed, (size, k), f"terms of {name}")

    unit = number(entry(given, "unit", where), "unit of the objective")
    column_unit = columns("unit")
    if not unit > 0.0 or not (column_unit > 0.0).all():
        raise ValueError("a unit of the objective is not positive")
    curvature = columns("curvature")
    bent = array(entry(given, "force_curvature", where), (count, 3), "force_curvature")
    if (curvature < 0.0).any() or (bent < 0.0).any():
        raise ValueError("the objective is not convex")
    ranges = items(entry(given, "normal_range", where), "normal_range", count, count)
    return OwnObjective(
        maximizes=truth(entry(given, "maximizes", where), "maximizes"),
        unit=unit,
        value=number(entry(given, "value", where), "value") if found else 0.0,
        keeps=kept,
        column_unit=column_unit,
        cost=columns("cost"),
        curvature=curvature,
        bounds=columns("bounds", 2, bounds=True),
        boxes=np.array([columns("box", 2), columns("whole_box", 2)]),
        values=columns("values") if found else None,
        balance=of("balance", passive),
        faces=of("faces", count),
        normal_upper=of("normal_upper", count),
        normal_lower=of("normal_lower", count),
        margins=array(entry(given, "face_margins", where), (count,), "face_margins"),
        normal_range=np.array([_ends(np.transpose([one]).tolist(), 1, "normal_range")[:, 0]
                               for one in ranges]).T,
        force_curvature=bent,
        rows=_read_rows(entry(given, "rows", where), count, k),
    )  # fmt: skip


def _read_rows(given: object, count: int, k: int) -> OwnRows:
    blocks, parts = [], [(np.zeros((0,)),) * 3 + (np.zeros((0, count, 3)), np.zeros((0, k)))]
    for block in items(given, "rows of the objective", 0, MOST):
        name = short_text(entry(block, "name", "a block"), "the name of a block")
        sign = word(entry(block, "sign", name), f"sign of {name}", _SIGNS)
        lengths = items(entry(block, "shape", name), f"shape of {name}", 1, 3)
        shape = tuple(whole(one, f"shape of {name}", 0, MOST) for one in lengths)
        size = int(np.prod(shape))
        if size * max(3 * count, k) > _MOST_COEFFICIENTS:
            raise ValueError(f"{name} has too many rows")
        low, high = _ends([entry(block, key, name) for key in ("low", "high")], size, name)
        unit = np.abs(
            np.nan_to_num(_ends([entry(block, "unit", name)] * 2, size, name)[0], neginf=1.0)
        )
        if not (unit > 0.0).all():
            raise ValueError(f"{name} has a unit that is not positive")
        if sign == "any" and (low != high).any():
            raise ValueError(f"{name} is no block of equalities")
        if sign == "upper":
            low = np.full(size, -np.inf)
        forces = np.zeros((size, count, 3))
        most = forces.size
        for one in items(entry(block, "forces", name), f"forces of {name}", 0, most):
            row, contact, axis, value = items(one, f"a coefficient of {name}", 4, 4)
            place = (whole(row, name, 0, size - 1), whole(contact, name, 0, count - 1),
                     whole(axis, name, 0, 2))  # fmt: skip
            forces[place] = number(value, f"a coefficient of {name}")
        matrix = _matrix(entry(block, "columns", name), (size, k), f"columns of {name}")
        blocks.append((name, sign, shape))
        parts.append((unit, low, high, forces, matrix))
    return OwnRows(tuple(blocks), *(np.concatenate(one) for one in zip(*parts, strict=True)))


def _ends(given: Any, size: int, where: str) -> np.ndarray:
    """(2, size) lower and upper ends; null: there is none."""
    ends = np.empty((2, size))
    for row, absent in enumerate((-np.inf, np.inf)):
        listed = items(items(given, where, 2, 2)[row], where, size, size)
        ends[row] = [absent if one is None else number(one, where) for one in listed]
    return ends


def _matrix(given: object, shape: tuple[int, int], where: str) -> np.ndarray:
    """Return a matrix of [row, column, value] entries."""
    matrix = np.zeros(shape)
    for triple in items(given, where, 0, matrix.size):
        row, column, value = items(triple, where, 3, 3)
        place = whole(row, where, 0, shape[0] - 1), whole(column, where, 0, shape[1] - 1)
        matrix[place] = number(value, where)
    return matrix
