"""The one way from the multipliers of a scaled program to those of the problem, by name, and back.

The Lagrangian is the same in both: a multiplier in the problem's units is the scaled one times the
unit of the objective, over the unit of its row.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.programs.program import Block, Sign

Marginals = Mapping[str, FloatArray]
"""Multipliers by the name of their block, in the objective's unit over that of the constraint.

Those of equalities have any sign, those of second-order cones are in such cones themselves. All
others are at least 0; those of rows and bounds with two sides are told apart as NAME_lower and
NAME_upper.
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
        blocks: Of the rows, and of the bounds.
        multipliers: Of all rows, A above G, positive on their upper sides; and the reduced costs
            of all columns, positive at their lower bounds.
        unit: What one of the scaled objective is, positive.
        signs: Multipliers whose signs tell the sides; None: the same. Others that differ from them
            may have turned their signs.
    """
    found: dict[str, FloatArray] = {}
    weights, reduced = multipliers
    own, own_reduced = signs or multipliers
    for block, values, sides in (
        *((one, weights[one.at], own[one.at]) for one in blocks[0]),
        # A reduced cost is positive where the lower bound holds.
        *((one, -reduced[one.at], -own_reduced[one.at]) for one in blocks[1]),
    ):
        scaled = unit * values / block.unit
        if block.sign is Sign.ANY:
            found[block.name] = read_only(block.spread(scaled))
            continue
        if block.sign is Sign.CONE:
            found[block.name] = read_only(block.spread(-scaled))
            continue
        found[_upper(block)] = read_only(block.spread(np.where(sides > 0.0, scaled, 0.0)))
        if block.sign is Sign.EITHER:
            lower = np.where(sides < 0.0, -scaled, 0.0)
            found[f"{block.name}_lower"] = read_only(block.spread(lower))
    return found


def scaled_weights(blocks: _Blocks, found: Marginals, unit: float) -> FloatArray:
    """Return the scaled multipliers of all rows from those by name; what `marginals` takes.

    Raises:
        KeyError: If a block is missing.
        ValueError: If the multipliers of one have another shape.
    """
    parts = []
    for block in blocks:
        value = np.asarray(found[_upper(block)], dtype=float)
        if block.sign is Sign.EITHER:
            value = value - np.asarray(found[f"{block.name}_lower"], dtype=float)
        if block.sign is Sign.CONE:
            value = -value
        if value.shape != block.shape:
            raise ValueError(f"{block.name} has the shape {value.shape}, not {block.shape}")
        parts.append(block.gathered(value) * block.unit / unit)
    return np.concatenate(parts)


def _upper(block: Block) -> str:
    return f"{block.name}_upper" if block.sign is Sign.EITHER else block.name
