"""Objectives, cones, proofs and multipliers as plain data in the units of the problem, and back.

An objective is rebuilt from the columns, rows and costs that its document states.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.builder import ProgramBuilder, scaled_weights
from graspless_pin.programs.forces import ForceCoordinates
from graspless_pin.programs.objectives import Objective, scaled_program
from graspless_pin.programs.program import Block, Columns, Program
from graspless_pin.report.verify.fields import KEPT, KNOWN_CONES, SIZED, Part
from graspless_pin.report.verify.own_objective import OwnObjective
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.values import array
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.certificate import (
    BoundLeaf,
    ConflictSplit,
    ContactSplit,
    KinematicLeaf,
    ProofNode,
)


def objective_data(solution: TorqueSolution) -> dict[str, Any]:
    """Return the columns, rows and costs that an objective adds, for its document.

    Args:
        solution: A solution whose objective is neither of the paper's two algorithms.

    Returns:
        ``name``, ``maximizes``, the ``unit`` that its figures are of order one in, ``value``; the
        ``columns`` with costs, bounds and boxes; ``terms`` of columns in the balance, the cones and
        the limits of normal forces, which it ``keeps``; constant ``face_margins`` and
        ``normal_range``; its own ``rows``; and ``force_curvature``.

    Raises:
        ArgumentError: If two blocks have one name, the cones are round, or the forces have no cones
            or normal limits.
    """
    coordinates, program, unit = solution.program
    size, force = coordinates.layout.size, coordinates.force_scale
    blocks = {block.name: block for block in program.blocks}
    _check_blocks(solution, program, blocks)
    groups, scale = _added_blocks(program, size)
    values = added_columns(solution) if solution.found else None
    count = solution.problem.contact_count

    def column_bounds(pair: FloatArray) -> FloatArray:
        return pair[:, size:] * scale

    def column_terms(block: Block) -> FloatArray:
        """Return the coefficients of added columns in the rows of a block, in its unit."""
        units = np.broadcast_to(block.unit, len(program.rows[block.at]))
        return units[:, None] * program.rows[block.at][:, size:] / scale

    box = column_bounds(program.box)
    whole = box if program.whole_box is None else column_bounds(program.whole_box)
    imposed = column_bounds(np.array([program.lb, program.ub]))
    cost, curvature = unit * program.c[size:] / scale, unit * program.P[size:] / scale**2
    force_curvature = np.zeros(3 * count)
    force_curvature[coordinates.layout.axes] = unit * program.P[:size] / force**2
    normal = force * np.array([program.lb, program.ub])[:, coordinates.normal_columns]
    faces = blocks["faces"]
    margins = faces.in_shape(-faces.unit * program.sides[1][faces.at])[:, 0] + 0.0
    kept = {name: column_terms(blocks[name]) for name in KEPT if name in blocks}
    for name in kept.keys() - {"balance", "torque"}:  # by contact: equal at all its faces
        spread = [blocks[name].in_shape(one).reshape(count, -1)[:, 0] for one in kept[name].T]
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
                "unit": scale[span],
                "cost": cost[span],
                "curvature": curvature[span],
                "bounds": imposed[:, span],
                "box": box[:, span],
                "whole_box": whole[:, span],
                "values": None if values is None else values[span],
            }
            for block in groups
            for span in [_added_column_slice(block, size)]
        ],
        "terms": {name: _nonzero_triplets(matrix) for name, matrix in kept.items()},
        "face_margins": margins,
        "normal_range": normal.T,
        "force_curvature": force_curvature.reshape(count, 3),
        "rows": [
            _row_block_data(block, program, column_terms(block), coordinates.layout.axes, force)
            for block in program.blocks
            if block.name not in KEPT
        ],
    }


def added_columns(solution: TorqueSolution) -> FloatArray | None:
    """(k,) values of the objective's own columns in their units; None: there are none."""
    coordinates, program, _ = solution.program
    values = solution.evidence.added
    return None if values is None else values * _added_blocks(program, coordinates.layout.size)[1]


def _added_blocks(program: Program, size: int) -> tuple[list[Block], FloatArray]:
    """Return the blocks of added columns, and the (k,) unit of each column."""
    groups = [block for block in program.bounded_blocks if block.name != "normal"]
    scale = np.ones(len(program.c) - size)
    for block in groups:
        scale[_added_column_slice(block, size)] = block.unit
    return groups, scale


def _check_blocks(solution: TorqueSolution, program: Program, blocks: dict[str, Block]) -> None:
    names = Counter(block.name for block in program.blocks)
    twice = [name for name, count in names.items() if count > 1]
    bounded = "normal_upper" in blocks or any(b.name == "normal" for b in program.bounded_blocks)
    is_round = solution.problem.cone_model.second_order
    if is_round or twice or not (bounded and {"balance", "faces"} <= blocks.keys()):
        why = "it lacks the balance, the cones or the limits of normal forces"
        if is_round:
            why = "the friction cones are round; solve with cone: edges"
        elif twice:
            why = f"it has two blocks with the name '{twice[0]}'"
        raise ArgumentError(
            "solution",
            f"its objective '{solution.objective.name}' cannot be written as a document: {why}",
        )


def _added_column_slice(block: Block, size: int) -> slice:
    """Return the slice of a block within the added columns."""
    assert isinstance(block.at, slice)  # noqa: S101 - for the type checker: `Columns.at`
    return slice(block.at.start - size, block.at.stop - size)


def _row_block_data(
    block: Block, program: Program, terms: FloatArray, axes: NDArray[np.int_], force: float
) -> dict[str, Any]:
    """Return the data of a block of own rows: one row for each multiplier of the block."""
    units = np.broadcast_to(block.unit, len(terms)).astype(float)
    low, high = (units * side[block.at] for side in program.sides)
    count = int(np.prod(block.shape))
    places = np.arange(count) if block.places is None else block.places
    full = np.full((3, count), [[np.nan], [-np.inf], [np.inf]])
    full[:, places] = units, low, high
    on_forces = units[:, None] * program.rows[block.at][:, : len(axes)] / force
    return {
        "name": block.name,
        "sign": block.sign.name.lower(),
        "shape": list(block.shape),
        "unit": full[0],
        "low": full[1],
        "high": full[2],
        "forces": [
            [int(places[row]), *divmod(int(axes[column]), 3), value]
            for row, column, value in _nonzero_triplets(on_forces)
        ],
        "columns": [
            [int(places[row]), column, value] for row, column, value in _nonzero_triplets(terms)
        ],
    }


def _nonzero_triplets(matrix: FloatArray) -> list[list[Any]]:
    """Return [row, column, value] of each nonzero entry."""
    return [
        [int(row), int(column), float(matrix[row, column])] for row, column in np.argwhere(matrix)
    ]


def proof_data(solution: TorqueSolution) -> dict[str, Any]:
    """Return the proof of a solution for its document.

    Args:
        solution: The solution.

    Returns:
        ``complete`` and, if it is not, what is ``missing``; the virtual ``motion`` behind the mode;
        the ``nodes`` of the proof over all modes; ``forces`` and ``mode_multipliers`` where they
        are part of it.
    """
    proof = solution.proof
    motion, passive = proof.motion, solution.problem.passive_count
    data: dict[str, Any] = {
        "complete": proof.tree.complete,
        "missing": proof.tree.missing,
        "motion": None
        if motion is None
        else {"object": motion[:passive], "joints": motion[passive:]},
        "nodes": [_node_data(solution, node) for node in proof.tree.nodes],
    }
    if proof.forces is not None:
        data["forces"] = proof.forces
        if solution.algorithm is None:
            data["columns"] = added_columns(solution)
    if proof.in_mode is not None:
        data["mode_multipliers"] = multipliers_data(solution, *proof.in_mode)
    return data


def multipliers_data(solution: TorqueSolution, y: FloatArray, z: FloatArray) -> dict[str, Any]:
    """Return multipliers of a solution's program, in SI units.

    Args:
        solution: The solution.
        y: Multipliers of the scaled equalities.
        z: Multipliers of the scaled rows.

    Returns:
        Multipliers by the name of their block; those of cone faces as ``[contact, face, value]``,
        those of round cones by contact.
    """
    named, problem = solution.named(y, z), solution.problem
    sizes = {"M": problem.contact_count, "L": problem.joint_count}
    # Documents of either algorithm state the multipliers of both.
    known = {} if solution.algorithm is None else SIZED
    data: dict[str, Any] = {name: np.zeros(sizes[size]) for name, size in known.items()}
    data |= named
    if "faces" in named:
        data["faces"] = _nonzero_triplets(named["faces"])
    return data


def cone_data(problem: QuasistaticProblem, contact: int) -> dict[str, FloatArray]:
    """Return the section of a contact's cone at a normal force of 1, along t1 and t2, by key.

    Empty for the paper's pyramids and Coulomb's cone, which checkers know by name. Of other models
    the ``cone_corners``, (r, 2), or the ``kinetic_friction``, (2,), where a contact has no cone.
    """
    if problem.cone in KNOWN_CONES:
        return {}
    if problem.has_cone[contact]:
        return {"cone_corners": problem.friction[contact] * problem.cone_section.corners}
    return {"kinetic_friction": problem.tangents[contact].T @ problem.kinetic_directions[contact]}


def read_multipliers(
    given: Part, stated: Problem, problem: QuasistaticProblem, objective: Objective
) -> tuple[FloatArray, FloatArray]:
    """Return the multipliers (y, z) of a scaled program from those in a document.

    Args:
        given: Multipliers as `multipliers_data` writes them.
        stated: The problem as its document states it.
        problem: The same problem, as the solver reads it.
        objective: The optimised objective.

    Raises:
        KeyError, ValueError: If one is missing, or of a wrong type or shape.
    """
    _, program, unit = scaled_program(problem, objective)
    blocks = () if stated.own is None else stated.own.rows.blocks
    own = {f"{name}{end}": shape for name, _, shape in blocks for end in ("", "_upper", "_lower")}
    named = {"balance": given["balance"]} | {
        key: array(value, own[key], f"{key} of {given.where}") if key in own else given[key]
        for key, value in given.stated.items()
    }
    weights = scaled_weights(program.blocks, named, unit)
    count = len(program.b)
    return weights[:count], weights[count:]


def _node_data(solution: TorqueSolution, node: ProofNode) -> dict[str, Any]:
    match node:
        case BoundLeaf():
            multipliers = multipliers_data(solution, node.y, node.z)
            return {"kind": "bound", "objective": node.objective, "multipliers": multipliers}
        case KinematicLeaf():
            return {"kind": "kinematic", "combination": _nonzero_triplets(node.combination)}
        case ConflictSplit():
            return {
                "kind": "conflict",
                "items": [list(item) for item in node.items],
                "open": None if node.opened is None else list(node.opened),
                "combinations": [_nonzero_triplets(v) for v in node.combinations],
            }
        case ContactSplit():
            return {"kind": "contact", "contact": node.contact}


@dataclass(frozen=True, eq=False)
class StatedObjective(Objective):
    """An objective rebuilt from the data of `objective_data`.

    Attributes:
        name: Its name.
        stated: Its columns, rows and costs, as the document states them.
        maximizes: Whether its value is maximised.
        required_margin: Margin that the forces keep, N.
    """

    name: str
    stated: OwnObjective
    maximizes: bool = False
    required_margin: float = 0.0

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:  # noqa: ARG002
        """Return the stated unit."""
        return self.stated.unit

    def build(self, program: ProgramBuilder) -> None:
        """Add the columns, blocks and costs that the document states.

        Raises:
            ValueError: If the cones are round, or a row has a force where there is none.
        """
        own, forces = self.stated, program.forces
        if forces.cones.second_order:
            raise ValueError("an objective of your own is not supported together with round cones")
        force, kept = forces.coordinates.force_scale, own.keeps
        columns = self._add_columns(program)

        def terms(matrix: FloatArray, unit: Any = force) -> dict[Columns, FloatArray]:
            return {columns: matrix * own.column_unit / np.reshape(unit, (-1, 1))}

        program.balance(terms(own.balance, force / forces.weight))
        owner = forces.cones.owner
        program.rows(
            "faces", forces.cones.rows, -own.margins[owner] / force, terms(own.faces[owner]),
            unit=force, shape=forces.cones.shape, places=forces.cones.places,
        )  # fmt: skip
        if "normal_upper" in kept:
            upper = terms(own.normal_upper)
            program.rows("normal_upper", forces.normal_rows, forces.limit, upper, unit=force)
        if "normal_lower" in kept:
            without_cone = np.flatnonzero(forces.without_cone)
            program.rows(
                "normal_lower", -forces.normal_rows[without_cone], 0.0,
                terms(own.normal_lower[without_cone]), unit=force, shape=(len(forces.normal_rows),),
                places=without_cone,
            )  # fmt: skip
        if "torque" in kept:
            program.torque_limits()
        if np.isfinite(own.normal_range).any():
            program.bound_normals(*(own.normal_range / force))
        rows, first = own.rows, 0
        flat = rows.forces.reshape(-1, 3 * len(forces.normal_rows))
        axes = forces.coordinates.layout.axes
        if np.delete(flat, axes, axis=1).any():
            raise ValueError("a row of the objective has friction at a contact without a cone")
        for name, sign, shape in rows.blocks:
            begin, first = first, first + int(np.prod(shape))
            at = np.arange(begin, first)
            # A place with two infinite sides has no row.
            at = at[np.isfinite(rows.low[at]) | np.isfinite(rows.high[at])]
            unit = rows.unit[at]
            on_forces = flat[np.ix_(at, axes)] * force / unit[:, None]
            low, high = rows.low[at] / unit, rows.high[at] / unit
            listed = terms(rows.columns[at], unit)
            if sign == "any":
                program.equal(name, on_forces, high, listed, unit=unit)
                continue
            program.rows(
                name, on_forces, high, listed, unit=unit, shape=shape,
                low=low if sign == "either" else None, places=at - begin,
            )  # fmt: skip
        # The only costs of forces themselves are those of a regularisation.
        curved = own.force_curvature[0, 0] * force**2 / own.unit
        normal = forces.coordinates.normal_columns[0]
        program.regularize(float(curved / forces.coordinates.curvature(1.0)[normal]))

    def _add_columns(self, program: ProgramBuilder) -> Columns:
        """Add all own columns; return them as one block."""
        own, first, at = self.stated, program.forces.size, slice(0, 0)
        for name, count in own.groups:
            at = slice(at.stop, at.stop + count)
            unit = own.column_unit[at]
            (low, high), (box, whole) = own.bounds[:, at] / unit, own.boxes[:, :, at] / unit
            scale = unit / own.unit
            program.columns(
                name, count, box=(box[0], box[1]), whole_box=(whole[0], whole[1]), low=low,
                high=high, cost=own.cost[at] * scale, curvature=own.curvature[at] * scale * unit,
                unit=unit,
            )  # fmt: skip
        return Columns(first, at.stop)
