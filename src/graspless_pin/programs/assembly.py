"""From an objective to its program; Algorithms 1 and 2 by compiled loops where there are any."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled import linear_programs
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.cones import cone_rows
from graspless_pin.programs.forces import ForceCoordinates, force_coordinates, force_rows
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare
from graspless_pin.programs.program import FARTHEST, Program


def built(
    objective: Objective, problem: QuasistaticProblem, coordinates: ForceCoordinates
) -> Program:
    """Return the program of an objective, block by block, without (27) and (31)."""
    builder = ProgramBuilder(force_rows(problem, coordinates))
    objective.build(builder)
    return builder.program()


class ScaledProgram(NamedTuple):
    """A program with what turns its figures into the problem's.

    Attributes:
        coordinates: Force coordinates and scales.
        program: The program without modes.
        unit: What one of its value is in the objective's own unit, positive.
    """

    coordinates: ForceCoordinates
    program: Program
    unit: float


def scaled_program(problem: QuasistaticProblem, objective: Objective) -> ScaledProgram:
    """Return the program of an objective, block by block, with its scales."""
    coordinates = force_coordinates(problem, objective.required_margin)
    program = built(objective, problem, coordinates)
    return ScaledProgram(coordinates, program, objective.unit(problem, coordinates))


def assembled(
    objective: Objective, problem: QuasistaticProblem, coordinates: ForceCoordinates
) -> Program:
    """Return the program of an objective; one made by compiled loops names no blocks.

    The loops stack the rows in the order in which `Margin` and `Torque` build them.
    """
    far = max(problem.max_normal_force.tolist()) > FARTHEST * coordinates.force_scale
    if linear_programs is None or type(objective) not in (Margin, Torque, TorqueShare) or far:
        return built(objective, problem, coordinates)
    shared, epsilon = cone_rows(problem), objective.regularization
    largest = _NOT_LARGEST
    if isinstance(objective, Torque):
        largest = _largest(objective, problem, coordinates)
    columns, low, high, box, bounds, is_far = linear_programs.paper_program(
        problem.positions,
        coordinates.directions,
        problem.jacobian,
        coordinates.layout.axes,
        shared.sides.T,
        len(shared.faces),
        shared.reach,
        problem.has_cone,
        problem.max_normal_force,
        problem.external_wrench,
        problem.lower_torque,
        problem.upper_torque,
        problem.gravity_torques,
        coordinates.force_scale,
        coordinates.joint_scale,
        coordinates.length_scale,
        FARTHEST,
        *largest,
    )
    (lb, ub), P, c = bounds, shared.flat, shared.last
    if largest is _NOT_LARGEST:
        (lb, ub), c = shared.free, shared.minus_last
    if epsilon > 0.0:
        P, lb = np.append(coordinates.curvature(epsilon), 0.0), lb.copy()
        lb[-1] = 0.0
    rows: FloatArray = columns.T
    return Program.of_rows(
        rows,
        len(problem.external_wrench),
        low,
        high,
        linear=epsilon == 0.0,
        P=P,
        c=c,
        lb=lb,
        ub=ub,
        box=box,
        is_far=is_far,
    )


_Largest = tuple[float, NDArray[np.int_], FloatArray, FloatArray]
"""A margin over the force scale; joints, factors and levels of the rows of the largest torque."""
_NOT_LARGEST: _Largest = -1.0, np.zeros(0, int), np.zeros(0), np.zeros(0)


def _largest(
    objective: Torque, problem: QuasistaticProblem, coordinates: ForceCoordinates
) -> _Largest:
    sides, scale = objective.sides(problem, coordinates), coordinates.joint_scale
    return (
        objective.required_margin / coordinates.force_scale,
        np.concatenate([side.joints for side in sides]),
        np.concatenate([side.sign * scale[side.joints] / side.unit for side in sides]),
        np.concatenate([side.level for side in sides]),
    )
