"""From an objective to its program; Algorithms 1 and 2 by compiled loops where there are any."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled import linear_programs
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.cones import edge_cones, reach_of
from graspless_pin.programs.forces import ForceCoordinates, force_coordinates, force_rows
from graspless_pin.programs.layout import ForceLayout, layout_of
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare
from graspless_pin.programs.program import FARTHEST, LinearArrays, Program


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
    by_loops = type(objective) in (Margin, Torque, TorqueShare) and not problem.is_round
    if linear_programs is None or far or not by_loops:
        return built(objective, problem, coordinates)
    likeness, epsilon = likeness_of(problem), objective.regularization
    arrays, box, is_far = paper_arrays(objective, problem, coordinates, likeness)
    columns, low, high, c, lb, ub = arrays
    P = likeness.flat
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


class Likeness(NamedTuple):
    """What problems share whose contacts have the same cones and slide alike.

    Attributes:
        layout: Where the force coordinates stand.
        face_count: Side faces of all cones.
        reach: (2, n) see `cone_reach`.
        sides: (n + 1, s) transposed rows x + e of faces, n^T f + e and, without a cone, -n^T f + e.
        free: (2, n + 1) -inf and inf.
        last: (n + 1,) one for the last variable, else zero.
        minus_last: (n + 1,) minus that.
        flat: (n + 1,) zeros.
    """

    layout: ForceLayout
    face_count: int
    reach: FloatArray
    sides: FloatArray
    free: FloatArray
    last: FloatArray
    minus_last: FloatArray
    flat: FloatArray

    def has_rows_of(self, other: Likeness) -> bool:
        """Whether the programs of both have the same rows, whatever the coefficients of friction.

        Then what is active in one may be in the other. It is told by content: which objects are
        remembered depends on what was solved before.
        """
        own, others = self.layout, other.layout
        return self is other or (
            self.face_count == other.face_count
            and own.size == others.size
            and (own is others or own.cones.tobytes() == others.cones.tobytes())
        )


def likeness_of(problem: QuasistaticProblem) -> Likeness:
    """Return what a problem with pyramids for cones shares with those like it: the same object."""
    mask, friction = problem.has_cone.tobytes(), problem.friction.tobytes()
    return _likeness(mask, friction, problem.is_sliding.tobytes(), problem.cone_edges)


@lru_cache(maxsize=256)
def _likeness(mask: bytes, friction: bytes, _sliding: bytes, edges: int) -> Likeness:
    layout = layout_of(mask)
    cones = edge_cones(layout, np.frombuffer(friction)[layout.cones], edges)
    n, normal = layout.size, layout.picks
    parts = [cones.rows, normal, -normal[layout.bare]]
    sides = np.ones((sum(map(len, parts)), n + 1), order="F")
    sides[:, :-1] = np.concatenate(parts)
    free = np.full((2, n + 1), np.inf)
    free[0] = -np.inf
    last = np.zeros(n + 1)
    last[-1] = 1.0
    arrays = sides.T, free, last, -last, np.zeros(n + 1)
    for array in arrays:
        read_only(array)
    return Likeness(layout, len(cones.rows), reach_of(mask, friction), *arrays)


def paper_arrays(
    objective: Objective,
    problem: QuasistaticProblem,
    coordinates: ForceCoordinates,
    likeness: Likeness,
) -> tuple[LinearArrays, FloatArray, bool]:
    """Return what the compiled loops make of Algorithm 1 or 2.

    Args:
        objective: `Margin`, `Torque` or `TorqueShare`.
        problem: The problem, with pyramids for cones.
        coordinates: Its force coordinates.
        likeness: See `likeness_of`.

    Returns:
        The program; its (2, n + 1) box; and whether a side is far or a row has none.
    """
    largest = _NOT_LARGEST
    if isinstance(objective, Torque):
        largest = _largest(objective, problem, coordinates)
    columns, low, high, box, bounds, is_far = linear_programs.paper_program(
        problem.positions,
        coordinates.directions,
        problem.jacobian,
        likeness.layout.axes,
        likeness.sides,
        likeness.face_count,
        likeness.reach,
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
    if largest is _NOT_LARGEST:
        lb, ub = likeness.free
        return (columns, low, high, likeness.minus_last, lb, ub), box, is_far
    lb, ub = bounds
    return (columns, low, high, likeness.last, lb, ub), box, is_far


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
