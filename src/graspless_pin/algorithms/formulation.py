"""The scaled program and kinematics of one problem and objective, shared by a search's steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.caching import Derived
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.kinematics import VirtualKinematics, kinematics_of
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.modes.sectors import Sector
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.forces import ForceCoordinates, force_coordinates
from graspless_pin.programs.objectives import Objective, ScaledProgram, scaled_program
from graspless_pin.programs.program import Program
from graspless_pin.solvers import Answer, Outcome, solve

NO_FRICTION = 1e-8
"""Friction below this share of the load counts as zero."""


@dataclass(frozen=True, eq=False)
class Formulation:
    """A program in forces, with the virtual motions that admit its friction.

    Its rows are those without (27) and (31), which are bounds of its columns: see `opposing`.

    Attributes:
        problem: The problem.
        objective: What is optimised.
        coordinates: Force coordinates and scales.
        program: The relaxation; every mode differs from it in bounds only.
        kinematics: The virtual motions.
        cutoff: Objective values above it count as infeasible.
        signed_unit: Factor from the program's value to the objective's; negative if that is
            maximised.
        layers: First column of each set of forces in the program; all sets have one mode.
    """

    problem: QuasistaticProblem
    objective: Objective
    coordinates: ForceCoordinates
    program: Program
    kinematics: VirtualKinematics
    cutoff: float
    signed_unit: float
    layers: tuple[int, ...]

    @property
    def cone_columns(self) -> NDArray[np.int_]:
        """(layers, number of cones, 2) columns of the friction at the contacts with a cone."""
        columns = self.coordinates.layout.friction_columns
        if self.layers == (0,):
            return columns[None]
        return np.array(self.layers)[:, None, None] + columns

    def friction_size(self, x: FloatArray) -> FloatArray:
        """Return (M, 2) the largest |friction| along t1 and t2 in x over all sets of forces."""
        size = np.zeros((self.problem.contact_count, 2))
        size[self.coordinates.layout.cones] = np.abs(x[self.cone_columns]).max(axis=0, initial=0.0)
        return size

    def solve(self, lb: FloatArray, ub: FloatArray, solver: str, *, cutoff: float) -> Answer:
        """Solve the program under other bounds; values above the cutoff count as infeasible."""
        return solve(self.program.with_bounds(lb, ub, min(cutoff, self.cutoff)), solver)

    def solve_along(
        self, friction: Mapping[int, Sector | None], solver: str, *, cutoff: float
    ) -> Answer:
        """Solve the program with the friction of some contacts opposite to sectors of directions.

        Args:
            friction: Sectors by contact with a cone; None: without friction.
            solver: The solver to ask first.
            cutoff: Values above it count as infeasible.

        Returns:
            An answer with friction along t1 and t2, as of `solve`.
        """
        tangent = self.coordinates.tangent_columns
        turned = _with_sector_friction(
            self.program, [(tangent[k], sector) for k, sector in friction.items()]
        )
        answer = solve(turned, solver, cutoff=min(cutoff, self.cutoff))
        if answer.outcome is not Outcome.SOLVED:
            return answer
        x = answer.x.copy()
        for contact, sector in friction.items():
            if sector is not None:
                x[tangent[contact]] = -sector.edges @ x[tangent[contact]]
        return answer.at_point(x, answer.value, answer.residual)

    def capped(self, column: str, limit: float) -> Formulation:
        """Return the formulation with an upper bound on an added column, given by its name."""
        ub = self.program.ub.copy()
        ub[self.program.column(column)] = limit
        return replace(self, program=self.program.with_bounds(self.program.lb, ub))

    def admitted(self, mode: SlidingMode, x: FloatArray) -> FloatArray:
        """Return x with the friction that a mode forbids set to zero; x itself if there is none."""
        friction = x[self.cone_columns]
        forbidden = friction * mode.signs[self.coordinates.layout.cones] >= 0.0
        forbidden &= friction != 0.0
        if not np.count_nonzero(forbidden):
            return x
        x = x.copy()
        x[self.cone_columns[forbidden]] = 0.0
        return x

    def bounds_of(self, mode: SlidingMode | None) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the variables in a mode; None: those of the relaxation."""
        if mode is None:
            return self.program.lb, self.program.ub
        signs = mode.signs[self.coordinates.layout.cones]
        return self.opposing(signs < 0, signs > 0)

    def opposing(
        self, minus: NDArray[np.bool_], plus: NDArray[np.bool_]
    ) -> tuple[FloatArray, FloatArray]:
        """Return bounds of the variables where friction opposes virtual sliding, (27) and (31).

        Sliding against t1 allows friction along t1, so ``minus`` leaves the upper bound.

        Args:
            minus: (c, 2) whether a contact with a cone may slide against t1, t2.
            plus: (c, 2) whether it may slide along t1, t2.
        """
        lb, ub = self.program.lb.copy(), self.program.ub.copy()
        for columns in self.cone_columns:
            ub[columns[~minus]] = 0.0
            lb[columns[~plus]] = 0.0
        return lb, ub

    def with_costs(self, c: FloatArray) -> Formulation:
        """Return the formulation with other costs, (n,)."""
        return replace(self, program=replace(self.program, c=c))


def _with_sector_friction(
    program: Program, friction: list[tuple[NDArray[np.int_], Sector | None]]
) -> Program:
    """Return the program with friction as nonnegative combinations opposite to sectors' edges.

    Args:
        program: The program in friction along t1 and t2.
        friction: Friction columns of some contacts, with their sectors; None: without friction.
    """
    rows = np.array(program.rows, order="F")
    lb, ub, (low, high) = program.lb.copy(), program.ub.copy(), program.sides
    boxes = [None if box is None else box.copy() for box in (program.box, program.whole_box)]
    for columns, sector in friction:
        lb[columns] = 0.0
        if sector is None:
            ub[columns] = 0.0
            continue
        rows[:, columns] = -rows[:, columns] @ sector.edges
        if sector.half == 0.0:
            ub[columns[1]] = 0.0
        # Components along edges at an obtuse angle may be larger than the friction.
        most = 1.0 / np.sin(min(max(2.0 * sector.half, 0.5 * np.pi), np.pi))
        for box in boxes:
            if box is not None:
                box[0, columns] = 0.0
                box[1, columns] *= most
    return Program.of_rows(
        rows, len(program.b), low, high,
        linear=True, P=program.P, c=program.c, lb=lb, ub=ub, box=boxes[0], whole_box=boxes[1],
        cone_count=program.cone_count, strict=program.strict,
    )  # fmt: skip


_PROGRAMS_PER_PROBLEM = 8


class SharedParts(NamedTuple):
    """Data shared by all formulations of a problem.

    Attributes:
        coordinates: Force coordinates and scales.
        kinematics: The virtual motions.
        programs: Programs assembled so far, by objective.
    """

    coordinates: ForceCoordinates
    kinematics: VirtualKinematics
    programs: dict[Objective, ScaledProgram]


@Derived
def shared_parts(problem: QuasistaticProblem) -> SharedParts:
    """Return the data shared by all formulations of a problem; cached while it is in use."""
    return SharedParts(force_coordinates(problem), kinematics_of(problem), {})


def formulate(
    problem: QuasistaticProblem, objective: Objective, *, layers: tuple[int, ...] = (0,)
) -> Formulation:
    """Return the formulation of a problem for an objective; programs are cached.

    Args:
        problem: The problem.
        objective: What is optimised.
        layers: See `Formulation`.

    Raises:
        ArgumentError: If the objective cannot be hashed.
    """
    shared = shared_parts(problem)
    programs = shared.programs
    try:
        scaled = programs.get(objective)
    except TypeError as error:
        raise ArgumentError(
            "objective",
            f"is a {type(objective).__name__} that cannot be hashed ({error}); make it a frozen "
            "dataclass whose fields are numbers, texts or tuples of them, or one with eq=False",
        ) from None
    if scaled is None:
        scaled = scaled_program(problem, objective, shared.coordinates)
        if len(programs) >= _PROGRAMS_PER_PROBLEM:
            programs.pop(next(iter(programs)), None)
        programs[objective] = scaled
    coordinates, program, unit = scaled
    return Formulation(
        problem, objective, coordinates, program, shared.kinematics, objective.cutoff,
        objective.sign * unit, layers,
    )  # fmt: skip
