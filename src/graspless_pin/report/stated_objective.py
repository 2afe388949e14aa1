"""An objective read back from a document: its columns, rows and costs as they stand there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.forces import ForceCoordinates
from graspless_pin.programs.objectives import Objective
from graspless_pin.programs.program import Columns
from graspless_pin.report.proof_data import as_number, as_numbers


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

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
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
