"""An objective that is neither of the paper's: its columns, rows and costs, as stated.

The program is: minimise sum of cost y + curvature y^2 / 2 over the objective's own columns y (and
half of the forces' own curvature) so that the contact forces f obey the problem, W f + w + B y = 0,
h^T f + margin + E y <= 0 at each cone face, and low <= A f + C y <= high in the objective's own
rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.report.verify.fields import KEPT, Part
from graspless_pin.report.verify.values import MOST, entry, items

_MOST_COEFFICIENTS = 4_000_000


@dataclass(frozen=True, eq=False)
class OwnRows:
    """The objective's own rows, of all its blocks together.

    Attributes:
        blocks: Name, sign and shape of the multipliers of each block.
        unit: (q,) order of magnitude of each row.
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
    """The columns, rows and costs that an objective adds to the problem.

    Attributes:
        maximizes: Whether the stated figures are those of minus the objective.
        unit: Order of magnitude of its figures.
        value: The stated value; 0 where nothing was found.
        keeps: Which constraints of the problem it keeps.
        groups: Names of blocks of columns, each with how many there are.
        column_unit: (k,) order of magnitude of each column.
        cost: (k,) cost of each column.
        curvature: (k,) second derivative by each column.
        bounds: (2, k) bounds of the columns.
        boxes: (2, 2, k) boxes that the constraints imply: with forces within the reach, and with
            all.
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
    groups: tuple[tuple[str, int], ...]
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
        return self.keeps.union(("torque_upper", "torque_lower") if "torque" in self.keeps else ())

    @property
    def scaled_values(self) -> np.ndarray | None:
        """(k,) the answer's columns over their units; None where nothing was found."""
        return None if self.values is None else self.values / self.column_unit

    def cost_of(self, local: np.ndarray, columns: np.ndarray) -> float:
        """Return the minimised objective at forces along n, t1, t2 and columns."""
        curved = (self.force_curvature * local**2).sum() + (self.curvature * columns**2).sum()
        return float(0.5 * curved + self.cost @ columns)

    def violation(self, local: np.ndarray, columns: np.ndarray) -> float:
        """Return the largest violation of its own rows and bounds, over their units.

        Args:
            local: (M, 3) forces along n, t1, t2.
            columns: (k,) its columns.
        """
        values = np.einsum("qmi,mi->q", self.rows.forces, local) + self.rows.columns @ columns
        own = np.maximum(values - self.rows.high, self.rows.low - values) / self.rows.unit
        outside = np.maximum(columns - self.bounds[1], self.bounds[0] - columns)
        return float(np.concatenate([own, outside / self.column_unit]).max(initial=0.0))

    def force_violation(
        self, normal: np.ndarray, limit: np.ndarray, faces: np.ndarray, columns: np.ndarray
    ) -> float:
        """Return the largest violation of its margins and ranges by forces, N.

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


def read_own_objective(stated: Part, *, found: bool) -> OwnObjective:
    """Return the objective that a document states.

    Args:
        stated: The part ``objective``.
        found: Whether there is an answer.

    Raises:
        ValueError: If it is invalid.
    """
    groups = [
        group.with_sizes(k=len(items(entry(group.stated, "unit", group.where), "unit", 0, MOST)))
        for group in stated["columns"]
    ]
    stated = stated.with_sizes(k=sum(group.sizes["k"] for group in groups))

    def columns(key: str, *rows: int) -> np.ndarray:
        return np.concatenate([np.zeros((*rows, 0)), *(group[key] for group in groups)], axis=-1)

    kept, terms = frozenset(stated["keeps"]), stated["terms"]
    if not {"balance", "faces"} <= kept:
        raise ValueError("keeps of the objective must contain balance and faces")
    blocks = {key: terms[key] if key in kept else np.zeros((stated.sizes["M"], stated.sizes["k"]))
              for key in KEPT[:4]}  # fmt: skip
    own = OwnObjective(
        maximizes=stated["maximizes"],
        unit=stated["unit"],
        value=stated["value"] if found else 0.0,
        keeps=kept,
        groups=tuple((group["name"], group.sizes["k"]) for group in groups),
        column_unit=columns("unit"),
        cost=columns("cost"),
        curvature=columns("curvature"),
        bounds=_with_infinite_ends(columns("bounds", 2)),
        boxes=np.array([columns("box", 2), columns("whole_box", 2)]),
        values=columns("values") if found else None,
        **blocks,
        margins=stated["face_margins"],
        normal_range=_with_infinite_ends(stated["normal_range"].T),
        force_curvature=stated["force_curvature"],
        rows=_read_rows(stated),
    )
    if not own.unit > 0.0 or not (own.column_unit > 0.0).all():
        raise ValueError("all units of the objective must be positive")
    if (own.curvature < 0.0).any() or (own.force_curvature < 0.0).any():
        raise ValueError("the objective must be convex: no curvature may be negative")
    return own


def _read_rows(stated: Part) -> OwnRows:
    blocks, (M, k) = [], (stated.sizes[letter] for letter in "Mk")
    parts = [(np.zeros((0,)),) * 3 + (np.zeros((0, M, 3)), np.zeros((0, k)))]
    for block in stated["rows"]:
        name, sign, shape = block["name"], block["sign"], tuple(block["shape"])
        size = int(np.prod(shape))
        if size * max(3 * M, k) > _MOST_COEFFICIENTS:
            raise ValueError(f"block {name!r} of the objective has too many rows")
        block = block.with_sizes(q=size)
        low, high = _with_infinite_ends(np.array([block["low"], block["high"]]))
        unit = np.abs(np.nan_to_num(block["unit"], nan=1.0))
        if not (unit > 0.0).all():
            raise ValueError(f"all units of block {name!r} of the objective must be positive")
        if sign == "any" and (low != high).any():
            raise ValueError(f"low and high of block {name!r} with the sign 'any' must be equal")
        if sign == "upper":
            low = np.full(size, -np.inf)
        blocks.append((name, sign, shape))
        parts.append((unit, low, high, block["forces"], block["columns"]))
    return OwnRows(tuple(blocks), *(np.concatenate(one) for one in zip(*parts, strict=True)))


def _with_infinite_ends(pair: np.ndarray) -> np.ndarray:
    """Return (2, n) lower and upper ends, infinite where there is none."""
    return np.where(np.isnan(pair), [[-np.inf], [np.inf]], pair)
