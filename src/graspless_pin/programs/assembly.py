"""From an objective to its program; Algorithm 1 by compiled loops where there are any."""

from __future__ import annotations

import numpy as np

from graspless_pin.compiled import linear_programs
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.cones import cone_rows
from graspless_pin.programs.forces import ForceCoordinates, force_rows
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.programs.program import FARTHEST, Program


def built(
    objective: Objective, problem: QuasistaticProblem, coordinates: ForceCoordinates
) -> Program:
    """Return the program of an objective, block by block, without (27) and (31)."""
    builder = ProgramBuilder(force_rows(problem, coordinates))
    objective.build(builder)
    return builder.program()


def assembled(
    objective: Objective, problem: QuasistaticProblem, coordinates: ForceCoordinates
) -> Program:
    """Return the program of an objective; one made by compiled loops names no blocks.

    The loops stack the rows in the order in which `Margin` builds them.
    """
    far = problem.max_normal_force.max() > FARTHEST * coordinates.force_scale
    if linear_programs is None or type(objective) is not Margin or far:
        return built(objective, problem, coordinates)
    shared, epsilon = cone_rows(problem), objective.regularization
    lb, P = shared.free[0], shared.flat
    if epsilon > 0.0:
        lb, P = lb.copy(), np.append(coordinates.curvature(epsilon), 0.0)
        lb[-1] = 0.0
    columns, low, high, box = linear_programs.margin_program(
        problem.positions,
        coordinates.directions,
        problem.jacobian,
        coordinates.layout.axes,
        shared.sides.T,
        len(shared.faces),
        shared.reach,
        problem.max_normal_force,
        problem.external_wrench,
        problem.lower_torque,
        problem.upper_torque,
        problem.gravity_torques,
        coordinates.force_scale,
        coordinates.joint_scale,
        coordinates.length_scale,
    )
    rows: FloatArray = columns.T
    return Program.of_rows(
        rows,
        len(problem.external_wrench),
        low,
        high,
        linear=epsilon == 0.0,
        P=P,
        c=shared.minus_last,
        lb=lb,
        ub=shared.free[1],
        box=box,
    )
