"""What the algorithms return: a status, torques and forces, the mode and the proof."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import TypeVar

import numpy as np

from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.modes.rules import Rules, SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.programs.assembly import built
from graspless_pin.programs.forces import ForceCoordinates, force_coordinates
from graspless_pin.programs.marginals import Marginals, marginals
from graspless_pin.programs.objectives import Algorithm, Objective
from graspless_pin.programs.program import Program
from graspless_pin.solution.table import solution_html, solution_text

_Value = TypeVar("_Value")


class Status(Enum):
    """What is known of the problem; the value is the message."""

    OPTIMAL = "optimal over all feasible virtual-sliding modes"
    OPTIMAL_IN_MODE = "optimal in the given virtual-sliding mode"
    LIMIT_REACHED = (
        "the best found; the search ended before its proof (a node or time limit, or a program "
        "that no solver answered)"
    )
    INFEASIBLE_FORCES = (
        "infeasible: no contact forces inside the cones, normal-force and torque limits balance "
        "the external wrench with the required margin"
    )
    INFEASIBLE_MODES = (
        "infeasible: forces that balance exist, but none whose friction opposes a kinematically "
        "feasible virtual sliding"
    )
    INFEASIBLE_IN_MODE = "infeasible in the given virtual-sliding mode"
    INFEASIBLE_MODE = "the given virtual-sliding mode has no virtual motion behind it"
    NOT_FOUND_IN_LIMIT = "nothing found when a node or time limit ended the search"
    UNVERIFIED = "no solver gave an answer that passes the check"

    @property
    def message(self) -> str:
        """The message in words."""
        return self.value


FOUND = frozenset({Status.OPTIMAL, Status.OPTIMAL_IN_MODE, Status.LIMIT_REACHED})


@dataclass(frozen=True)
class Certificate:
    """How well the answer is proven.

    Values are in scaled units (forces and margin over the load F, torques over what F makes on a
    joint's longest lever; see `problem.scales`) unless a unit is given.

    Attributes:
        primal_residual: Largest violation of any constraint by the returned forces.
        duality_gap: Objective minus the bound that the multipliers of its program prove.
        bound: Proven bound on the optimum over all modes: an upper bound on the margin in N
            (Algorithm 1), a lower bound on the largest torque (Algorithm 2: N m, or a share of
            the limits). With a regularisation it bounds the regularised objective.
        gap: Distance between the returned objective and that bound, same unit.
        infeasibility: Proven smallest common violation of all constraints where infeasible.
        modes_examined: Virtual-sliding modes that were solved or ruled out one by one.
        nodes: Nodes of the search.
        force_programs: LPs or QPs in forces that were solved, or carried over and proven.
        kinematic_programs: Kinematic feasibility problems that were solved.
        solver: The solver whose answer passed the check, or, where an `Evaluator` carried the
            optimum of another state over, the one that answered there.
        force_reach: The largest normal force up to which the bound is proven, N: the largest limit,
            or 1e8 times the load.
        threshold_optima: The optimum with a tenth and with ten times the threshold of what counts
            as a virtual motion, in the bound's unit, NaN where nothing is feasible; None: both are
            the same as here.
    """

    primal_residual: float
    duality_gap: float
    bound: float
    gap: float
    infeasibility: float
    modes_examined: int
    nodes: int
    force_programs: int
    kinematic_programs: int
    solver: str
    force_reach: float = np.inf
    threshold_optima: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class ProofMultipliers:
    """Multipliers of the scaled programs, for writing a proof that others can check.

    Attributes:
        relaxation: (y, z) of the program without modes: they bound every mode.
        mode: (y, z) of the program in which the solution was found.
        added: Values of the columns that the objective adds to the forces', scaled.
    """

    relaxation: tuple[FloatArray, FloatArray]
    mode: tuple[FloatArray, FloatArray]
    added: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class TorqueSolution:
    """The answer of Algorithm 1 or 2. Infeasible is an answer: then ``found`` is False.

    Asking a solution that was not found for torques, forces, margin or mode raises
    `NoSolutionError` with the reason.

    Attributes:
        status: What is known.
        objective: What was optimised.
        rules: The reading of the virtual-sliding constraint.
        certificate: The proof.
        problem: The problem that was solved.
        given_mode: The mode that alone was asked for; None: all modes were.
    """

    status: Status
    objective: Objective
    rules: Rules
    certificate: Certificate
    problem: QuasistaticProblem
    given_mode: SlidingMode | None = None
    _forces: FloatArray | None = None
    _mode: SlidingMode | None = None
    _multipliers: ProofMultipliers | None = None
    _explain: Callable[[TorqueSolution], object] | None = None

    @property
    def found(self) -> bool:
        """Whether there is a solution to read."""
        return self.status in FOUND

    @cached_property
    def explanation(self) -> str:
        """Why nothing is feasible and the smallest changes that would help; empty if found.

        Worked out when first asked for: it solves several changed problems.
        """
        if self.found or self._explain is None:
            return ""
        return str(self._explain(self))

    @property
    def algorithm(self) -> Algorithm | None:
        """Which of the paper's programs was solved; None for another objective."""
        return self.objective.algorithm

    @property
    def required_margin(self) -> float:
        """e_0 of Algorithm 2, N; 0 for Algorithm 1."""
        return self.objective.required_margin

    @property
    def regularization(self) -> float:
        """The epsilon of the QP; 0: the bare LP."""
        return self.objective.regularization

    @property
    def proof(self) -> ProofMultipliers:
        """The scaled multipliers behind the certificate."""
        return self._read(self._multipliers)

    @cached_property
    def value(self) -> float:
        """The objective's value in its own unit; with a regularisation, that of both together."""
        coordinates, program, unit = self._program
        x = np.concatenate([coordinates.scaled(self.contact_forces), self.proof.added])
        return (-unit if self.objective.maximizes else unit) * program.value(x)

    @cached_property
    def multipliers(self) -> Marginals:
        """Multipliers of the minimisation by the names of its blocks, in the problem's units."""
        y, z = self.proof.mode
        return self.named(y, z)

    def named(self, y: FloatArray, z: FloatArray) -> Marginals:
        """Return multipliers of the rows of the solution's program by name, in SI units.

        Args:
            y: (m,) of its equalities, scaled.
            z: (k,) of its other rows.
        """
        _, program, unit = self._program
        weights = np.concatenate([y, z])
        return marginals((program.blocks, ()), (weights, np.zeros(0)), unit)

    @property
    def _program(self) -> tuple[ForceCoordinates, Program, float]:
        """The scaled program without modes, made anew, and the unit of its value."""
        coordinates = force_coordinates(self.problem, self.required_margin)
        program = built(self.objective, self.problem, coordinates)
        return coordinates, program, self.objective.unit(self.problem, coordinates)

    @property
    def contact_forces(self) -> FloatArray:
        """(M, 3) contact forces on the object, N, world axes.

        One best choice among the indeterminate forces, not a prediction.
        """
        return self._read(self._forces)

    @property
    def mode(self) -> SlidingMode:
        """The virtual-sliding mode (B, S) whose optimum this is.

        With Coulomb friction no mode is asked for, and this only describes the friction.
        """
        return self._read(self._mode)

    @property
    def contact_torques(self) -> FloatArray:
        """(L,) joint torques that hold the contact forces, J^T f (18), units as `torques`."""
        return self.problem.J.T @ self.contact_forces.ravel()

    @property
    def torques(self) -> FloatArray:
        """(L,) motor torques J^T f + g, N m (N for linear and hybrid joints)."""
        return self.contact_torques + self.problem.gravity_torques

    @property
    def margin(self) -> float:
        """The margin e that the contact forces keep, (36) and (42), N."""
        return self.problem.margin_of(self.contact_forces)

    @property
    def max_torque(self) -> float:
        """Largest |motor torque|, in `max_torque_unit`; 0 without joints."""
        return float(np.abs(self.torques).max(initial=0.0))

    @property
    def max_torque_unit(self) -> JointUnit:
        """Unit of the joint with the largest |motor torque|; N m without joints."""
        units = self.problem.joint_units
        return units[int(np.abs(self.torques).argmax())] if units else JointUnit.TORQUE

    def __repr__(self) -> str:
        """Return one line: what was solved and the figures that matter."""
        found = ""
        if self.found:
            found = f", margin={self.margin:.6g}, max_torque={self.max_torque:.6g}"
        size = f"{self.problem.contact_count} contacts, {self.problem.joint_count} joints"
        return f"<TorqueSolution {self.objective.name}: {self.status.name}{found}, {size}>"

    def __str__(self) -> str:
        """Return a readable table."""
        return solution_text(self)

    def _repr_html_(self) -> str:
        """Return the tables as HTML, for notebooks."""
        return solution_html(self)

    def _read(self, value: _Value | None) -> _Value:
        if value is None:
            raise NoSolutionError(
                f"There is no solution to read ({self.status.message}); check .found first."
            )
        return value


def checked_solution(solution: object) -> TorqueSolution:
    """Return a solution.

    Raises:
        ArgumentError: If it is none.
    """
    if not isinstance(solution, TorqueSolution):
        kind = type(solution).__name__
        raise ArgumentError("solution", f"is a {kind}; it must be what the algorithms return")
    return solution
