"""An objective of a user's own as plain data: columns, rows and costs, in the problem's units."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.blocks import Block
from graspless_pin.programs.program import Program
from graspless_pin.solution import TorqueSolution

_RECOMPUTED = ("balance", "faces", "normal_upper", "normal_lower", "torque")
"""Blocks of which the checker works out all but the terms of added columns."""


def objective_data(solution: TorqueSolution) -> dict[str, Any]:
    """Return what an objective adds to the problem, for its document.

    Args:
        solution: Of an objective that is neither of the paper's algorithms.

    Returns:
        ``name``, ``maximizes``, the ``unit`` that its figures are of order one in, ``value``; the
        ``columns`` with costs, bounds and boxes; ``terms`` of columns in the balance, the cones and
        the limits of normal forces, which it ``keeps``; constant ``face_margins`` and
        ``normal_range``; its own ``rows``; and ``force_curvature``.

    Raises:
        ArgumentError: If two blocks have one name, or the forces have no cones or normal limits.
    """
    coordinates, program, unit = solution.program
    size, force = coordinates.layout.size, coordinates.force_scale
    blocks = {block.name: block for block in program.blocks}
    _check_blocks(solution, program, blocks)
    groups, scale = _columns(program, size)
    values = added_columns(solution) if solution.found else None
    count = solution.problem.contact_count

    def ends(both: FloatArray) -> FloatArray:
        return both[:, size:] * scale

    def terms(block: Block) -> FloatArray:
        """Return the coefficients of added columns in the rows of a block, in its unit."""
        units = np.broadcast_to(block.unit, len(program.rows[block.at]))
        return units[:, None] * program.rows[block.at][:, size:] / scale

    box = ends(program.box)
    whole = box if program.whole_box is None else ends(program.whole_box)
    imposed = ends(np.array([program.lb, program.ub]))
    cost, curvature = unit * program.c[size:] / scale, unit * program.P[size:] / scale**2
    bent = np.zeros(3 * count)
    bent[coordinates.layout.axes] = unit * program.P[:size] / force**2
    normal = force * np.array([program.lb, program.ub])[:, coordinates.normal]
    faces = blocks["faces"]
    margins = faces.spread(-faces.unit * program.sides[1][faces.at])[:, 0] + 0.0
    kept = {name: terms(blocks[name]) for name in _RECOMPUTED if name in blocks}
    kept["faces"] = np.array([faces.spread(one)[:, 0] for one in kept["faces"].T]).T.reshape(
        count, len(scale)
    )
    for name in {"normal_upper", "normal_lower"} & kept.keys():
        spread = [blocks[name].spread(one) for one in kept[name].T]
        kept[name] = np.array(spread).T.reshape(count, len(scale))
    return {
        "name": solution.objective.name,
        "maximizes": solution.objective.maximizes,
        "unit": unit,
        "value": solution.value if solution.found else None,
        "keeps": list(kept),
        "columns": [
            {
                "name": block.name,
                "unit": scale[at],
                "cost": cost[at],
                "curvature": curvature[at],
                "bounds": imposed[:, at],
                "box": box[:, at],
                "whole_box": whole[:, at],
                "values": None if values is None else values[at],
            }
            for block in groups
            for at in [_inside(block, size)]
        ],
        "terms": {name: _entries(matrix) for name, matrix in kept.items()},
        "face_margins": margins,
        "normal_range": normal.T,
        "force_curvature": bent.reshape(count, 3),
        "rows": [
            _rows(block, program, terms(block), coordinates.layout.axes, force)
            for block in program.blocks
            if block.name not in _RECOMPUTED
        ],
    }


def added_columns(solution: TorqueSolution) -> FloatArray | None:
    """(k,) values of the objective's own columns in their units; None: there are none."""
    coordinates, program, _ = solution.program
    values = solution.evidence.added
    return None if values is None else values * _columns(program, coordinates.layout.size)[1]


def _columns(program: Program, size: int) -> tuple[list[Block], FloatArray]:
    """Return the blocks of added columns, and (k,) what one of each is in its unit."""
    groups = [block for block in program.bounded_blocks if block.name != "normal"]
    scale = np.ones(len(program.c) - size)
    for block in groups:
        scale[_inside(block, size)] = block.unit
    return groups, scale


def _check_blocks(solution: TorqueSolution, program: Program, blocks: dict[str, Block]) -> None:
    names = Counter(block.name for block in program.blocks)
    twice = [name for name, count in names.items() if count > 1]
    bounded = "normal_upper" in blocks or any(b.name == "normal" for b in program.bounded_blocks)
    is_round = solution.problem.cone_model.second_order
    if is_round or twice or not (bounded and {"balance", "faces"} <= blocks.keys()):
        why = "does not keep the balance, the cones and the limits of normal forces"
        if is_round:
            why = "has round cones"
        elif twice:
            why = f"has two blocks of the name '{twice[0]}'"
        raise ArgumentError(
            "solution",
            f"is of the objective '{solution.objective.name}', which {why}; no document holds it",
        )


def _inside(block: Block, size: int) -> slice:
    """Return where a block of added columns stands among these."""
    assert isinstance(block.at, slice)  # noqa: S101 - for the type checker: `Columns.at`
    return slice(block.at.start - size, block.at.stop - size)


def _rows(
    block: Block, program: Program, terms: FloatArray, axes: NDArray[np.int_], force: float
) -> dict[str, Any]:
    """Return rows of an objective's own, one for each place of the block's multipliers."""
    units = np.broadcast_to(block.unit, len(terms)).astype(float)
    low, high = (units * side[block.at] for side in program.sides)
    count = int(np.prod(block.shape))
    places = np.arange(count) if block.places is None else block.places
    full = np.full((3, count), [[np.nan], [-np.inf], [np.inf]])
    full[:, places] = units, low, high
    on_forces = units[:, None] * program.rows[block.at][:, : len(axes)] / force
    contact, axis = np.divmod(axes, 3)
    return {
        "name": block.name,
        "sign": block.sign.name.lower(),
        "shape": list(block.shape),
        "unit": full[0],
        "low": full[1],
        "high": full[2],
        "forces": [
            [
                int(places[row]),
                int(contact[column]),
                int(axis[column]),
                float(on_forces[row, column]),
            ]
            for row, column in np.argwhere(on_forces)
        ],
        "columns": [[int(places[row]), column, value] for row, column, value in _entries(terms)],
    }


def _entries(matrix: FloatArray) -> list[list[Any]]:
    """[row, column, value] of what is not zero."""
    return [
        [int(row), int(column), float(matrix[row, column])] for row, column in np.argwhere(matrix)
    ]
