"""Objectives, cones, proofs and multipliers as plain data, in the units of the problem, and back.

An objective is read back as its columns, rows and costs stand in the document.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.assembly import scaled_program
from graspless_pin.programs.builder import ProgramBuilder, scaled_weights
from graspless_pin.programs.forces import ForceCoordinates
from graspless_pin.programs.objectives import Objective
from graspless_pin.programs.program import Block, Columns, Program
from graspless_pin.report.verify.fields import KNOWN_CONES
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.certificate import (
    BoundLeaf,
    ConflictSplit,
    ContactSplit,
    KinematicLeaf,
    ProofNode,
)

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
        "terms": {name: _triplets(matrix) for name, matrix in kept.items()},
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
        "columns": [[int(places[row]), column, value] for row, column, value in _triplets(terms)],
    }


def _triplets(matrix: FloatArray) -> list[list[Any]]:
    """[row, column, value] of what is not zero."""
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
        "nodes": [_node(solution, node) for node in proof.tree.nodes],
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
        y: Of the scaled equalities.
        z: Of the scaled rows.

    Returns:
        By the names of their blocks; those of cone faces as ``[contact, face, value]``, those of
        round cones by contact.
    """
    found = solution.named(y, z)
    data: dict[str, Any] = {name: np.zeros(size) for name, size in _sizes(solution).items()}
    data |= found
    if "faces" in found:
        data["faces"] = _triplets(found["faces"])
    return data


def cone_data(problem: QuasistaticProblem, contact: int) -> dict[str, FloatArray]:
    """Return the cone of a contact where its normal force is 1, along t1 and t2, by key.

    Checkers know the paper's pyramids and Coulomb's cone by name; of other models they are told the
    ``cone_corners``, (r, 2), and where there is no cone the ``kinetic_friction``, (2,).
    """
    if problem.cone in KNOWN_CONES:
        return {}
    if problem.has_cone[contact]:
        return {"cone_corners": problem.friction[contact] * problem.cone_section.corners}
    return {"kinetic_friction": problem.tangents[contact].T @ problem.kinetic_directions[contact]}


def _sizes(solution: TorqueSolution) -> dict[str, int]:
    """Multipliers that documents of both algorithms have."""
    if solution.algorithm is None:
        return {}
    contacts, joints = solution.problem.contact_count, solution.problem.joint_count
    return {
        "normal_upper": contacts, "normal_lower": contacts,
        "share_upper": joints, "share_lower": joints,
    }  # fmt: skip


def read_multipliers(
    data: dict[str, Any], problem: QuasistaticProblem, objective: Objective
) -> tuple[FloatArray, FloatArray]:
    """Return the multipliers (y, z) of a scaled program from those in a document.

    Args:
        data: As `multipliers_data` gives them.
        problem: The problem.
        objective: What was optimised.

    Raises:
        KeyError, TypeError, ValueError, IndexError: If they are none.
    """
    _, program, unit = scaled_program(problem, objective)
    found = {name: as_numbers(values) for name, values in data.items() if name != "faces"}
    if not problem.cone_model.second_order:
        found["faces"] = _faces(data["faces"], problem)
    weights = scaled_weights(program.blocks, found, unit)
    count = len(program.b)
    return weights[:count], weights[count:]


def _faces(listed: list[Any], problem: QuasistaticProblem) -> FloatArray:
    """(M, r) multipliers of all faces."""
    faces = np.zeros((problem.contact_count, len(problem.cone_section.corners)))
    cones = np.flatnonzero(problem.has_cone).tolist()
    for contact, face, value in listed:
        faces[cones[cones.index(contact)], face] = as_number(value)
    return faces


def as_number(value: object) -> float:
    """Return a number of a document.

    Raises:
        TypeError: If it is none; true and false are none.
        ValueError: If it is not finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r:.40} is no number")
    if not math.isfinite(value):
        raise ValueError(f"{value} is not finite")
    return float(value)


def as_numbers(values: Any) -> FloatArray:
    """Return nested lists of numbers as an array; the errors are those of `as_number`."""

    def plain(value: Any) -> Any:
        return [plain(one) for one in value] if isinstance(value, list) else as_number(value)

    return np.array(plain(values), dtype=np.float64)


def _node(solution: TorqueSolution, node: ProofNode) -> dict[str, Any]:
    match node:
        case BoundLeaf():
            multipliers = multipliers_data(solution, node.y, node.z)
            return {"kind": "bound", "objective": node.objective, "multipliers": multipliers}
        case KinematicLeaf():
            return {"kind": "kinematic", "combination": _triplets(node.combination)}
        case ConflictSplit():
            return {
                "kind": "conflict",
                "items": [list(item) for item in node.items],
                "open": None if node.opened is None else list(node.opened),
                "combinations": [_triplets(v) for v in node.combinations],
            }
        case ContactSplit():
            return {"kind": "contact", "contact": node.contact}


@dataclass(frozen=True, eq=False)
class StatedObjective(Objective):
    """An objective that `objective_data` has written.

    Attributes:
        name: What it is called.
        data: What stands under ``objective``.
        maximizes: Whether its value is to be as large as possible.
        required_margin: Margin that the forces keep, N.
    """

    name: str
    data: Mapping[str, Any]
    maximizes: bool = False
    required_margin: float = 0.0

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:  # noqa: ARG002
        """Return the stated unit."""
        return as_number(self.data["unit"])

    @property
    def column_units(self) -> FloatArray:
        """(k,) what one of each scaled column is."""
        parts = [as_numbers(one["unit"]) for one in self.data["columns"]]
        return np.concatenate([np.zeros(0), *parts])

    @property
    def values(self) -> FloatArray:
        """(k,) the stated columns, scaled."""
        parts = [as_numbers(one["values"]) for one in self.data["columns"]]
        return np.concatenate([np.zeros(0), *parts]) / self.column_units

    def build(self, program: ProgramBuilder) -> None:
        """Add the columns, blocks and costs that the document states.

        Raises:
            ValueError: If the cones are round.
        """
        data, forces = self.data, program.forces
        if forces.cones.second_order:
            raise ValueError("an objective of one's own stands in no document with round cones")
        force = forces.coordinates.force_scale
        columns = self._columns(program)
        count, kept = len(forces.normal), data["keeps"]

        def terms(listed: Any, rows: int, unit: Any) -> dict[Columns, FloatArray]:
            matrix = np.zeros((rows, columns.size))
            for row, column, value in listed:
                matrix[row, column] = as_number(value)
            return {columns: matrix * self.column_units / np.reshape(unit, (-1, 1))}

        def of(name: str, rows: int, unit: Any = force) -> FloatArray:
            return terms(data["terms"].get(name, []), rows, unit)[columns]

        program.balance({columns: of("balance", len(forces.weight), force / forces.weight)})
        owner = forces.cones.owner
        program.rows(
            "faces", forces.cones.rows, -as_numbers(data["face_margins"])[owner] / force,
            {columns: of("faces", count)[owner]}, unit=force,
            shape=forces.cones.shape, places=forces.cones.places,
        )  # fmt: skip
        if "normal_upper" in kept:
            own = {columns: of("normal_upper", count)}
            program.rows("normal_upper", forces.normal, forces.limit, own, unit=force)
        if "normal_lower" in kept:
            without_cone = np.flatnonzero(forces.without_cone)
            own = {columns: of("normal_lower", count)[without_cone]}
            program.rows(
                "normal_lower", -forces.normal[without_cone], 0.0, own, unit=force, shape=(count,),
                places=without_cone,
            )  # fmt: skip
        if "torque" in kept:
            program.torque_limits()
        low, high = _ends(np.transpose(data["normal_range"]).tolist()) / force
        if np.isfinite([low, high]).any():
            program.bound_normals(low, high)
        for block in data["rows"]:
            shape = tuple(block["shape"])
            there = np.flatnonzero([one is not None for one in block["unit"]])
            size, place = len(block["unit"]), forces.coordinates.layout.axes.tolist()
            unit = as_numbers([block["unit"][row] for row in there])
            low, high = _ends([block["low"], block["high"]])[:, there] / unit
            on_forces = np.zeros((size, forces.size))
            for row, contact, axis, value in block["forces"]:
                on_forces[row, place.index(3 * contact + axis)] = as_number(value)
            on_forces = on_forces[there] * force / unit[:, None]
            listed = terms(block["columns"], size, 1.0)[columns][there] / unit[:, None]
            if block["sign"] == "any":
                program.equal(block["name"], on_forces, high, {columns: listed}, unit=unit)
                continue
            program.rows(
                block["name"], on_forces, high, {columns: listed}, unit=unit, shape=shape,
                low=low if block["sign"] == "either" else None, places=there,
            )  # fmt: skip
        # Forces have no costs of their own but those of a regularisation.
        curved = as_numbers(data["force_curvature"])[0, 0] * force**2 / as_number(data["unit"])
        first = forces.coordinates.normal[0]
        program.curve(float(curved / forces.coordinates.curvature(1.0)[first]))

    def _columns(self, program: ProgramBuilder) -> Columns:
        """Add all columns and return them as one."""
        first, size = program.forces.size, 0
        for one in self.data["columns"]:
            unit = as_numbers(one["unit"])
            (low, high), box = _ends(one["bounds"]) / unit, as_numbers(one["box"]) / unit
            whole = as_numbers(one["whole_box"]) / unit
            scale = unit / as_number(self.data["unit"])
            program.columns(
                one["name"], len(unit), box=(box[0], box[1]), whole_box=(whole[0], whole[1]),
                low=low, high=high, cost=as_numbers(one["cost"]) * scale,
                curvature=as_numbers(one["curvature"]) * scale * unit, unit=unit,
            )  # fmt: skip
            size += len(unit)
        return Columns(first, size)


def _ends(both: Any) -> FloatArray:
    """(2, n) lower and upper ends; null: there is none."""
    return np.array([
        [absent if one is None else as_number(one) for one in side]
        for side, absent in zip(both, (-np.inf, np.inf), strict=True)
    ])  # fmt: skip
