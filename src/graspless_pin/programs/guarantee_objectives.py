"""Objectives of the search for guaranteed torques: torques given, and torques in half-spaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.analysis_objectives import contact_torques
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.forces import ForceCoordinates
from graspless_pin.programs.objectives import Objective

_MARGIN_BESIDE = 0.1
"""What a margin of one load counts beside a depth of one joint scale."""


@dataclass(frozen=True, eq=False)
class AtTorques(Objective):
    """Another objective with the motors' torques given; see `at_torques`.

    Attributes:
        base: The objective.
        torques: (L,) N m.
        maximizes: As of the objective.
        required_margin: As of the objective, N.
        regularization: As of the objective.
    """

    base: Objective
    torques: FloatArray
    maximizes: bool
    required_margin: float
    regularization: float
    name = "at given torques"

    def build(self, program: ProgramBuilder) -> None:
        """Add what the objective does, and hold the torques."""
        self.base.build(program)
        program.held_torques(contact_torques(program.forces, self.torques))

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return the objective's."""
        return self.base.unit(problem, coordinates)

    @property
    def cutoff(self) -> float:
        """A value of the program from which on there is no solution."""
        return self.base.cutoff


def at_torques(objective: Objective, torques: FloatArray) -> AtTorques:
    """Return an objective with the motors' torques (L,) given, N m."""
    return AtTorques(
        objective,
        torques,
        objective.maximizes,
        objective.required_margin,
        objective.regularization,
    )


@dataclass(frozen=True, eq=False)
class InsideHalfSpaces(Objective):
    """Torques well inside half-spaces, up to a depth; of these, those with the largest margin.

    Attributes:
        normals: (K, L) per N m; torques with normals @ torques <= sides are inside.
        sides: (K,).
        depth: In joint scales: deeper counts no more.
        required_margin: N.
    """

    normals: FloatArray
    sides: FloatArray
    depth: float
    required_margin: float
    name = "inside half-spaces"

    def build(self, program: ProgramBuilder) -> None:
        """Add the depth, e/F and the half-spaces."""
        forces = program.forces
        unit, scale = forces.coordinates.force_scale, forces.coordinates.joint_scale
        size = np.linalg.norm(self.normals * scale, axis=1)
        rows = (self.normals * scale / size[:, None]) @ forces.torque
        sides = (self.sides - self.normals @ forces.problem.gravity_torques) / size
        most = [np.abs(rows) @ np.abs(box).max(axis=0) + np.abs(sides) for box in forces.boxes]
        far = [float(one.max(initial=0.0)) + self.depth for one in most]
        d = program.columns(
            "depth", high=self.depth, cost=-1.0,
            box=(-far[0], self.depth), whole_box=(-far[-1], self.depth),
        )  # fmt: skip
        low = self.required_margin / unit
        highest = max(low, 0.5 * float(forces.limit.min()))
        e = program.columns("margin", low=low, box=(low, highest), cost=-_MARGIN_BESIDE, unit=unit)
        program.balance()
        program.cones(e)
        program.normal_limits(e)
        program.torque_limits()
        program.rows("half-spaces", rows, sides, {d: np.ones(len(rows))})
