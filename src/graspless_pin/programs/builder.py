"""Build a program on contact forces: named columns, named blocks of rows, and an objective.

An objective (see `objectives`) calls the methods it needs, in any order. The balance, the cones and
the limits of normal forces and torques are available in scaled units: forces over F, moments over
F times the length scale, torques over each joint's scale.

`marginals` converts the multipliers of a scaled program to those of the problem, by name, and
`scaled_weights` converts them back. The Lagrangian is the same in both: a multiplier in the
problem's units is the scaled one times the unit of the objective, over the unit of its row.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.programs.forces import ForceRows
from graspless_pin.programs.program import Block, Columns, Program, Sign, Terms

Ends = tuple[ArrayLike, ArrayLike]
"""Lower and upper bounds: a number each, or one for each column."""


_UNPLACED = slice(0)
"""Row indices of a block that is not stacked yet."""


class _BlockRows(NamedTuple):
    """Rows of one block before they are stacked."""

    block: Block
    forces: FloatArray | None
    terms: Terms
    low: ArrayLike
    high: ArrayLike
    size: int
    strict: FloatArray | None = None


class ProgramBuilder:
    """A program on the forces of a problem, built block by block.

    See the example of `Torque`.

    Attributes:
        forces: The constraints of the problem, scaled.
    """

    def __init__(self, forces: ForceRows) -> None:
        """Start with the force columns only: no rows, no bounds, no objective."""
        self.forces = forces
        size = forces.size
        self._bounds = [_bounds_array((-np.inf, np.inf), size)]
        self._boxes = [[box] for box in forces.boxes]
        self._linear: list[FloatArray] = [np.zeros(size)]
        self._curved: list[FloatArray] = [np.zeros(size)]
        self._size = size
        self._equalities: list[_BlockRows] = []
        self._rows: list[_BlockRows] = []
        self._cones: list[_BlockRows] = []
        self._bounded: list[Block] = []

    def columns(
        self,
        name: str,
        count: int = 1,
        *,
        box: Ends,
        whole_box: Ends | None = None,
        low: ArrayLike = -np.inf,
        high: ArrayLike = np.inf,
        cost: ArrayLike = 0.0,
        curvature: ArrayLike = 0.0,
        unit: float | FloatArray = 1.0,
    ) -> Columns:
        """Add columns.

        Args:
            name: Name of their block.
            count: Number of columns.
            box: Finite lower and upper bounds that every optimum obeys: proofs assume them. They
                are not imposed; an optimum outside is an `ArgumentError`.
            whole_box: The same over the second box of `ForceRows.boxes`, if there is one; None: as
                `box`.
            low: Imposed lower bounds.
            high: Imposed upper bounds.
            cost: Coefficient of each in the objective, which is minimised.
            curvature: Coefficient of half the square of each in the objective, at least 0.
            unit: Problem units per scaled unit of each column.
        """
        added = Columns(self._size, count)
        self._size += count
        self._bounds.append(_bounds_array((low, high), count))
        for parts, ends in zip(self._boxes, (box, whole_box or box), strict=False):
            parts.append(_bounds_array(ends, count))
        self._linear.append(np.full(count, cost))
        self._curved.append(np.full(count, curvature))
        self._bounded.append(Block(name, added.at, unit, Sign.EITHER, (count,)))
        return added

    def equal(
        self,
        name: str,
        forces: FloatArray | None,
        side: FloatArray,
        terms: Terms | None = None,
        *,
        unit: float | FloatArray = 1.0,
    ) -> None:
        """Add equalities ``forces @ x + terms = side``; the arguments are those of `rows`."""
        size = len(side)
        block = Block(name, _UNPLACED, unit, Sign.ANY, (size,))
        self._equalities.append(_BlockRows(block, forces, terms or {}, side, side, size))

    def rows(
        self,
        name: str,
        forces: FloatArray | None,
        high: ArrayLike,
        terms: Terms | None = None,
        *,
        low: ArrayLike | None = None,
        unit: float | FloatArray = 1.0,
        shape: tuple[int, ...] | None = None,
        places: NDArray[np.int_] | None = None,
        strict: FloatArray | None = None,
    ) -> None:
        """Add rows ``low <= forces @ x + terms <= high``.

        Args:
            name: Name of their block.
            forces: (k, n) coefficients of the forces; None: zeros.
            high: (k,) upper sides.
            terms: Coefficients of added columns.
            low: (k,) lower sides; None: there are none.
            unit: Problem units per scaled unit of each row.
            shape: Shape of the multipliers by contact or joint; None: (k,).
            places: (k,) flat indices of the rows in that shape; None: all.
            strict: (k,) see `Program`; None: ones.
        """
        size = len(forces) if forces is not None else len(np.atleast_1d(high))
        sign, least = (Sign.UPPER, -np.inf) if low is None else (Sign.EITHER, low)
        block = Block(name, _UNPLACED, unit, sign, shape or (size,), places)
        self._rows.append(_BlockRows(block, forces, terms or {}, least, high, size, strict))

    def balance(self, terms: Terms | None = None) -> None:
        """Add W f + w_ext = 0 (19), plus terms of added columns: block ``balance``."""
        forces = self.forces
        unit = forces.coordinates.force_scale / forces.weight
        self.equal("balance", forces.balance_rows, forces.wrench, terms, unit=unit)

    def cones(
        self,
        margin: Columns | float,
        weights: FloatArray | None = None,
        *,
        name: str | None = None,
        of: Columns | None = None,
    ) -> None:
        """Keep the forces a margin away from the surface of their cones (42).

        Their block is ``faces`` (their side faces) or ``round_cones``.

        Args:
            margin: A column, or the margin over F.
            weights: (M,) factors of the margin at each contact; None: ones.
            name: Name of the block in place of the default.
            of: Columns to use in place of the forces'; None: the forces' own.
        """
        forces, cones = self.forces, self.forces.cones
        level = cones.margin
        if weights is not None:
            level = level * weights.reshape(-1)[cones.owner]
        sign = -1.0 if cones.second_order else 1.0
        terms: dict[Columns, ArrayLike] = {}
        side: ArrayLike = 0.0
        if isinstance(margin, Columns):
            terms[margin] = sign * level
        else:
            side = -sign * margin * level
        if of is not None:
            terms[of] = cones.rows
        unit, coefficients = forces.coordinates.force_scale, None if of is not None else cones.rows
        # The two sides of a second-order cone are equal: the offset of its rows.
        kind = Sign.CONE if cones.second_order else Sign.UPPER
        low = side if cones.second_order else -np.inf
        block = Block(name or cones.name, _UNPLACED, unit, kind, cones.shape, cones.places)
        part = _BlockRows(block, coefficients, terms, low, side, len(cones.rows))
        (self._cones if cones.second_order else self._rows).append(part)

    def normal_limits(self, margin: Columns | float, weights: FloatArray | None = None) -> None:
        """Keep normal forces a margin away from zero and from their limits (36).

        With a column: blocks ``normal_upper`` and, where there is no cone, ``normal_lower``; with a
        number: bounds of the columns, named ``normal``. Narrow cones also get lower bounds, which
        the boxes of proofs imply.

        Args:
            margin: A column, or the margin over F.
            weights: (M,) factors of the margin at each contact; None: ones.
        """
        forces = self.forces
        level = 1.0 if weights is None else weights
        if not isinstance(margin, Columns):
            low = np.where(forces.held_above_zero, margin * level, -np.inf)
            self.bound_normals(low, forces.limit - margin * level)
            return
        columns = forces.coordinates.normal_columns
        self._bounds[0][0, columns[forces.held_above_zero & ~forces.without_cone]] = 0.0
        unit, without_cone = forces.coordinates.force_scale, np.flatnonzero(forces.without_cone)
        strict = forces.coordinates.strictness
        self.rows(
            "normal_upper", forces.normal_rows, forces.limit, {margin: level},
            unit=unit, strict=None if strict is None else strict.normal,
        )  # fmt: skip
        own = level if weights is None else weights[without_cone]
        self.rows(
            "normal_lower", -forces.normal_rows[without_cone], 0.0, {margin: own},
            unit=unit, shape=(len(forces.normal_rows),), places=without_cone,
        )  # fmt: skip

    def bound_normals(self, low: ArrayLike, high: ArrayLike) -> None:
        """Bound the normal forces: bounds named ``normal``.

        Args:
            low: (M,) lower bounds over F.
            high: (M,) upper bounds over F.
        """
        columns = self.forces.coordinates.normal_columns
        self._bounds[0][:, columns] = _bounds_array((low, high), len(columns))
        unit = self.forces.coordinates.force_scale
        self._bounded.append(Block("normal", columns, unit, Sign.EITHER, (len(columns),)))

    def torque_limits(self) -> None:
        """Keep the motors' torques J^T f + g within their limits: block ``torque``."""
        forces, strict = self.forces, self.forces.coordinates.strictness
        self.rows(
            "torque", forces.torque_rows, forces.upper,
            low=forces.lower, unit=forces.coordinates.joint_scale,
            strict=None if strict is None else strict.torque,
        )  # fmt: skip

    def held_torques(self, torque: FloatArray) -> None:
        """Fix J^T f at given values (32): block ``held``.

        Args:
            torque: (L,) torques that the contacts make, over the joint scale.
        """
        forces = self.forces
        self.equal("held", forces.torque_rows, torque, unit=forces.coordinates.joint_scale)

    def regularize(self, epsilon: float) -> None:
        """Add the regularisation (epsilon / 2) |f / F|^2 to the objective."""
        if epsilon > 0.0:
            self._curved[0] = self.forces.coordinates.curvature(epsilon)

    def set_proof_box(self, box: FloatArray) -> None:
        """Replace `ForceRows.boxes` by another (2, n) box of forces for proofs of bounds.

        Call it before columns are added.
        """
        self._boxes = [[box]]

    def program(self, *, boxes_are_stated: bool = False) -> Program:
        """Return the program.

        Args:
            boxes_are_stated: See `Program`.
        """
        parts = [*self._equalities, *self._rows, *self._cones]
        total = sum(part.size for part in parts)
        rows = np.zeros((total, self._size), order="F")
        low, high, blocks, first = np.empty(total), np.empty(total), [], 0
        strict = None if self.forces.coordinates.strictness is None else np.ones(total)
        for block, forces, terms, low_sides, high_sides, size, strict_rows in parts:
            where = slice(first, first + size)
            if forces is not None:
                rows[where, : self.forces.size] = forces
            for columns, values in terms.items():
                entries = np.asarray(values)
                rows[where, columns.at] = entries[:, None] if entries.ndim == 1 else entries
            low[where], high[where] = low_sides, high_sides
            if strict is not None and strict_rows is not None:
                strict[where] = strict_rows
            blocks.append(block._replace(at=where))
            first += size
        boxes = [np.concatenate(box, axis=1) for box in self._boxes]
        bounds, curved = np.concatenate(self._bounds, axis=1), np.concatenate(self._curved)
        return Program.of_rows(
            rows,
            sum(part.size for part in self._equalities),
            low,
            high,
            linear=not curved.any(),
            P=curved,
            c=np.concatenate(self._linear),
            lb=bounds[0],
            ub=bounds[1],
            box=boxes[0],
            whole_box=boxes[-1] if len(boxes) > 1 else None,
            cone_count=sum(part.size for part in self._cones) // 3,
            blocks=tuple(blocks),
            bounded_blocks=tuple(self._bounded),
            boxes_are_stated=boxes_are_stated,
            strict=strict,
        )


def _bounds_array(ends: Ends, count: int) -> FloatArray:
    """(2, count) lower and upper bounds."""
    bounds = np.empty((2, count))
    bounds[0], bounds[1] = ends
    return bounds


Marginals = Mapping[str, FloatArray]
"""Multipliers by the name of their block, in the objective's unit over that of the constraint.

Those of equalities have any sign, those of second-order cones are in such cones themselves. All
others are at least 0; rows and bounds with two sides have separate ones, NAME_lower and NAME_upper.
"""
_Blocks = tuple[Block, ...]


def marginals(
    blocks: tuple[_Blocks, _Blocks],
    multipliers: tuple[FloatArray, FloatArray],
    unit: float,
    signs: tuple[FloatArray, FloatArray] | None = None,
) -> Marginals:
    """Return multipliers of a minimisation by name, in the units of the problem.

    Args:
        blocks: Blocks of the rows, and of the bounds.
        multipliers: Those of all rows, A above G, positive on their upper sides; and the reduced
            costs of all columns, positive at their lower bounds.
        unit: Factor from the scaled objective to its own unit, positive.
        signs: Multipliers whose signs decide which side each belongs to; None: the multipliers
            themselves, which may differ from these in sign.
    """
    by_name: dict[str, FloatArray] = {}
    weights, reduced = multipliers
    signed, signed_reduced = signs or multipliers
    for block, values, sides in (
        *((block, weights[block.at], signed[block.at]) for block in blocks[0]),
        # A reduced cost is positive where the lower bound holds.
        *((block, -reduced[block.at], -signed_reduced[block.at]) for block in blocks[1]),
    ):
        scaled = unit * values / block.unit
        if block.sign is Sign.ANY:
            by_name[block.name] = read_only(block.in_shape(scaled))
            continue
        if block.sign is Sign.CONE:
            by_name[block.name] = read_only(block.in_shape(-scaled))
            continue
        by_name[_upper_name(block)] = read_only(block.in_shape(np.where(sides > 0.0, scaled, 0.0)))
        if block.sign is Sign.EITHER:
            lower = np.where(sides < 0.0, -scaled, 0.0)
            by_name[f"{block.name}_lower"] = read_only(block.in_shape(lower))
    return by_name


def scaled_weights(blocks: _Blocks, by_name: Marginals, unit: float) -> FloatArray:
    """Return the scaled multipliers of all rows from those by name: the inverse of `marginals`.

    Raises:
        KeyError: If a block is missing.
        ValueError: If the multipliers of one have another shape.
    """
    parts = []
    for block in blocks:
        value = np.asarray(by_name[_upper_name(block)], dtype=float)
        if block.sign is Sign.EITHER:
            value = value - np.asarray(by_name[f"{block.name}_lower"], dtype=float)
        if block.sign is Sign.CONE:
            value = -value
        if value.shape != block.shape:
            raise ValueError(f"{block.name} has the shape {value.shape}; it must be {block.shape}")
        parts.append(block.row_entries(value) * block.unit / unit)
    return np.concatenate(parts)


def _upper_name(block: Block) -> str:
    return f"{block.name}_upper" if block.sign is Sign.EITHER else block.name
