"""Objectives: the paper's Algorithms 1 and 2, and the base class of any other objective.

An objective defines its columns, its blocks, its unit and its sense; everything else (searches,
checks, proofs, multipliers, gradients) uses the names of its blocks. See `docs/objectives.md` for
one of your own. `scaled_program` returns the program of an objective.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import StrEnum
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, real_number
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.forces import ForceCoordinates, force_coordinates, force_rows
from graspless_pin.programs.program import FARTHEST, Columns, Program

_LARGEST_UNCHECKED = 1e6
"""Figures from 0 up to this are valid; others are checked by `real_number`."""


class Algorithm(StrEnum):
    """Which of the paper's programs was solved."""

    MARGIN = "margin"
    """Algorithm 1 (44): the largest margin."""
    TORQUE = "torque"
    """Algorithm 2 (45): the smallest largest torque at a required margin."""


class Objective(ABC):
    """An objective over all contact forces that a sliding mode admits.

    Subclasses are frozen dataclasses whose fields are the figures of the objective; two with equal
    figures are equal. See the example of `Torque`.

    Attributes:
        name: Its name in reports and documents.
        maximizes: Whether its value is maximised; the program then minimises minus its value.
        algorithm: Which of the paper's programs it is, if any.
        required_margin: Margin that the forces keep, N.
        regularization: The epsilon of (epsilon / 2) |f / F|^2 in the program.
        by_limits: Whether torques are measured as shares of the joints' limits.
        unit_text: The printed unit of its value, such as ``N``; empty: none is printed.
    """

    name: str
    maximizes: bool = False
    algorithm: ClassVar[Algorithm | None] = None
    by_limits: ClassVar[bool] = False
    unit_text: ClassVar[str] = ""
    required_margin: float = 0.0
    regularization: float = 0.0

    @abstractmethod
    def build(self, program: ProgramBuilder) -> None:
        """Add the columns, blocks and costs of the objective to a program on the forces."""

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return the factor from the scaled program's value to the objective's unit; positive."""
        return 1.0

    @property
    def sign(self) -> float:
        """-1 if it is maximised, else 1: the program minimises its value times this sign."""
        return -1.0 if self.maximizes else 1.0

    @property
    def of_margin(self) -> bool:
        """Whether its value is the margin e, N."""
        return self.algorithm is Algorithm.MARGIN

    @property
    def cutoff(self) -> float:
        """Program value above which there is no solution."""
        return np.inf

    def with_figure(self, name: str, value: float) -> Objective:
        """Return the objective with a figure replaced; itself if it has no figure of that name."""
        if is_dataclass(self) and any(field.name == name for field in fields(self)):
            return replace(self, **{name: value})
        return self


@dataclass(frozen=True)
class Margin(Objective):
    """Algorithm 1 (44): the largest margin e; the program minimises -e/F + (eps/2) |f/F|^2.

    Without a regularisation e may become negative: then -e is the distance by which the cones would
    have to be widened, and its dual proves that no force set exists. See the example of `Torque`.
    """

    name = "margin"
    maximizes = True
    algorithm = Algorithm.MARGIN
    regularization: float = 0.0

    def __post_init__(self) -> None:
        """Check the figures."""
        _check_figures(self, regularization=self.regularization)

    def build(self, program: ProgramBuilder) -> None:
        """Add the column e/F, and keep all forces by the margin e inside their cones and limits."""
        smallest_limit, epsilon = float(program.forces.limit.min()), self.regularization
        # The boxes hold for forces inside their cones, that is for e >= 0. So do the bounds proven
        # over them, and a proven bound above zero on -e proves that there are no such forces.
        e = program.columns(
            "margin",
            box=(0.0, 0.5 * min(smallest_limit, FARTHEST)),
            whole_box=(0.0, 0.5 * smallest_limit),
            low=0.0 if epsilon > 0.0 else -np.inf,
            cost=-1.0,
            unit=program.forces.coordinates.force_scale,
        )
        program.balance()
        program.cones(e)
        program.normal_limits(e)
        program.torque_limits()
        program.regularize(epsilon)

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return F, N."""
        return coordinates.force_scale

    @property
    def cutoff(self) -> float:
        """Program value above which there is no solution: the margin is negative."""
        return 0.0 if self.regularization == 0.0 else np.inf


def key_of(figure: str) -> str:
    """Return the argument's name for a figure of an objective, as in documents and messages."""
    return figure.removeprefix("required_")


def _check_figures(objective: Objective, **figures: float) -> None:
    """Convert figures to floats, and raise an error for those that are not numbers >= 0."""
    for name, value in figures.items():
        if type(value) is not float or not 0.0 <= value <= _LARGEST_UNCHECKED:
            object.__setattr__(objective, name, real_number(key_of(name), value, 0.0))


class Side(NamedTuple):
    """Rows sign * torque / unit <= level * t: t bounds all torques of one sign.

    Attributes:
        sign: 1 or -1.
        joints: (k,) indices of the joints that have such a row.
        unit: (k,) torque that is 1 in the row, N m.
        level: (k,) coefficients of t.
    """

    sign: float
    joints: NDArray[np.int_]
    unit: FloatArray
    level: FloatArray


def add_largest_torque(program: ProgramBuilder, sides: tuple[Side, ...]) -> Columns:
    """Add t, the largest of all torques or shares: blocks ``share_upper``, ``share_lower``.

    The blocks have these names in both cases, since they are keys of documents.
    """
    forces = program.forces
    scale, count = forces.coordinates.joint_scale, len(forces.torque_rows)
    highest = []
    for box in forces.boxes:
        largest_torques = (np.abs(forces.torque_rows) @ box[1] + np.abs(forces.gravity)) * scale
        levels = [largest_torques[joints] / (unit * level) for _, joints, unit, level in sides]
        highest.append(float(np.concatenate(levels).max(initial=0.0)) + 1.0)
    t = program.columns(
        "largest", low=0.0, box=(0.0, highest[0]), whole_box=(0.0, highest[-1]), cost=1.0
    )
    for (sign, joints, unit, level), name in zip(
        sides, ("share_upper", "share_lower"), strict=True
    ):
        factor = sign * scale[joints] / unit
        program.rows(
            name,
            factor[:, None] * forces.torque_rows[joints],
            -factor * forces.gravity[joints],
            {t: -level},
            unit=unit,
            shape=(count,),
            places=joints,
        )
    return t


@dataclass(frozen=True)
class Torque(Objective):
    """Algorithm 2 (45): the smallest largest |torque| of all motors at a required margin.

    The program minimises t + (eps/2) |f/F|^2; t is scaled by the largest torque that the load makes
    on any joint. The motors' torques J^T f + g obey their limits.

    Examples:
        >>> from graspless_pin import Torque, load_scene, optimize
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> print(f"{optimize(problem, Torque(required_margin=0.1)).max_torque:.4f} N m")
        0.9618 N m
    """

    name = "torque"
    algorithm = Algorithm.TORQUE
    required_margin: float = 0.1
    regularization: float = 0.0

    def __post_init__(self) -> None:
        """Check the figures."""
        _check_figures(
            self, required_margin=self.required_margin, regularization=self.regularization
        )

    def build(self, program: ProgramBuilder) -> None:
        """Add t, the rows that bound the torques by it, and the required margin."""
        forces = program.forces
        sides = self.sides(forces.problem, forces.coordinates)
        e = self.required_margin / forces.coordinates.force_scale
        add_largest_torque(program, sides)
        program.balance()
        program.cones(e)
        program.normal_limits(e)
        program.torque_limits()
        program.regularize(self.regularization)

    def sides(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> tuple[Side, ...]:
        """Return the rows t >= |J^T f + g|, which make t the largest torque."""
        count = problem.joint_count
        joints_units_levels = (
            np.arange(count),
            np.full(count, self.unit(problem, coordinates)),
            np.ones(count),
        )
        return Side(1.0, *joints_units_levels), Side(-1.0, *joints_units_levels)

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return the torque scale, N m."""
        return coordinates.torque_scale


@dataclass(frozen=True)
class TorqueShare(Torque):
    """Algorithm 2 with each torque as a share of its joint's own limit.

    See the example of `Torque`.
    """

    by_limits = True

    def sides(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> tuple[Side, ...]:
        """Return the rows t >= (J^T f + g) / limit, scaled so that no entry is above 1.

        A limit of zero, or one on the wrong side of zero, remains a constraint and has no share.
        """
        sides, unit, scale = [], self.unit(problem, coordinates), coordinates.joint_scale
        for sign, limit in ((1.0, problem.upper_torque), (-1.0, -problem.lower_torque)):
            joints = np.flatnonzero(np.isfinite(limit) & (limit > 0.0))
            size = np.maximum(scale[joints] / limit[joints] / unit, 1.0)
            sides.append(Side(sign, joints, unit * size * limit[joints], 1.0 / size))
        return tuple(sides)

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return the largest of the load's torques, each divided by its joint's limit; at most 1.

        With this unit, limits far above the load cost no precision.
        """
        limits = np.concatenate([problem.upper_torque, -problem.lower_torque])
        counts = np.isfinite(limits) & (limits > 0.0)
        shares = np.tile(coordinates.joint_scale, 2)[counts] / limits[counts]
        return min(float(shares.max(initial=0.0)), 1.0) or 1.0


class ScaledProgram(NamedTuple):
    """A scaled program, with the scales that convert its figures to the problem's units.

    Attributes:
        coordinates: Force coordinates and scales.
        program: The program without modes.
        unit: Factor from its value to the objective's own unit, positive.
    """

    coordinates: ForceCoordinates
    program: Program
    unit: float


def scaled_program(
    problem: QuasistaticProblem, objective: Objective, coordinates: ForceCoordinates | None = None
) -> ScaledProgram:
    """Return the program of an objective without (27) and (31), and its scales.

    Args:
        problem: The problem.
        objective: The objective.
        coordinates: The problem's force coordinates, scaled by its load; None: computed here.
    """
    margin = objective.required_margin
    if coordinates is None or (margin > 0.0 and not problem.external_wrench.any()):
        coordinates = force_coordinates(problem, margin)
    unit = objective.unit(problem, coordinates)
    builder = ProgramBuilder(force_rows(problem, coordinates))
    objective.build(builder)
    # The boxes of the paper's objectives follow from the limits; with a cutoff they need not hold.
    stated = objective.algorithm is None and objective.cutoff == np.inf
    return ScaledProgram(coordinates, builder.program(boxes_are_stated=stated), unit)
