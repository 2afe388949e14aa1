"""The result of the algorithms: status, torques and forces, the mode, the proof and findings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from types import MappingProxyType
from typing import Any, Never, Protocol, TypeVar

import numpy as np

from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.findings import Finding, FindingCode, causes_first
from graspless_pin.modes.rules import Rules, SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, JointUnit, units_text
from graspless_pin.programs.builder import Marginals, marginals
from graspless_pin.programs.objectives import Algorithm, Objective, ScaledProgram, scaled_program
from graspless_pin.records import changed
from graspless_pin.solution.certificate import (
    EXPLAINED,
    FOUND,
    NO_EVIDENCE,
    Certificate,
    DualVariables,
    Evidence,
    Guarantee,
    SolutionProof,
    Status,
)
from graspless_pin.solution.tables import (
    certificate_text,
    contact_table,
    figure,
    headed_text,
    joint_table,
    paragraph,
    torque_size,
)
from graspless_pin.suggestions import what_to_pass

_NO_MARGIN = 1e-6  # of the load
_ROUNDING = 1e-7  # of the load


class HasFindings(Protocol):
    """The source of a problem: a scene, or a document."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong with it."""
        ...


def solution_doubts(
    status: Status, certificate: Certificate, problem: QuasistaticProblem, margin: float | None
) -> Iterator[Finding]:
    """Yield the findings on an answer: reasons to doubt it.

    Args:
        status: Status of the solution.
        certificate: Its certificate.
        problem: The problem.
        margin: The largest margin, N; None: another figure was optimised, or nothing was found.
    """
    if status is Status.LIMIT_REACHED:
        yield Finding(
            FindingCode.NOT_OPTIMAL,
            "solution",
            f"the answer is not proven to be optimal: a better one may exist (gap "
            f"{certificate.gap:.3g})",
            "raise node_limit and time_limit if they were given, else use another solver",
        )
    if certificate.threshold_optima is not None:
        yield Finding(
            FindingCode.THRESHOLD,
            "solution",
            "this answer depends on the threshold of virtual motion",
            "compare the certificate's threshold_optima, and check that tangents are exact",
        )
    if status is Status.LOAD_TOO_LARGE:
        yield Finding(
            FindingCode.LOAD_TOO_LARGE,
            "solution",
            overload(problem),
            "check masses (kg), sizes (m) and gravity (m/s^2), or raise the limits",
        )
    load = problem.scales.force
    if margin is not None and margin <= _NO_MARGIN * load:
        printed = figure(margin, load)
        size = (
            "zero" if printed == "0" else f"{printed} N, negligible beside the load, {load:.3g} N"
        )
        yield Finding(
            FindingCode.NO_RESERVE,
            "solution",
            f"the largest margin is {size}: any disturbance may make a contact slip or open",
            "raise torque limits or friction, or add a contact",
        )


def overload(problem: QuasistaticProblem) -> str:
    """Return a text on the limit that is smallest relative to the load, and on their ratio."""
    strict, (force, _, joints) = problem.strictness, problem.scales
    if strict is None:
        return "the required margin is far larger than the limits allow"
    joint = int(strict.torque.argmax()) if problem.joint_count else -1
    if joint < 0 or strict.torque[joint] < strict.normal.max():
        contact = int(strict.normal.argmax())
        limit = float(problem.max_normal_force[contact])
        return (
            f"the load, {force:.3g} N, is {force / limit:.2g} times the normal-force limit of "
            f"contact {contact} ({limit:g} N)"
        )
    limits = problem.lower_torque[joint], problem.upper_torque[joint]
    limit, load = float(np.abs(limits).min()), float(joints[joint])
    times = f"{load / limit:.2g} times" if limit > 0.0 else "far beyond"
    return (
        f"the load causes {load:.3g} {problem.joint_units[joint]} at joint "
        f"'{problem.joint_names[joint]}', {times} its limit ({limit:g})"
    )


_Value = TypeVar("_Value")


@dataclass(frozen=True, eq=False, repr=False)
class TorqueSolution:
    """The answer of Algorithm 1 or 2. Infeasible is an answer: then ``found`` is False.

    Reading torques, forces or mode of a solution that was not found raises `NoSolutionError` with
    the reason; its margin and its largest torque are NaN, for tables. A solution has no truth
    value: use ``found``. See the example of `maximize_margin`.

    Attributes:
        status: The outcome of the search.
        objective: The objective.
        rules: The reading of the virtual-sliding constraint.
        certificate: How well it is proven.
        problem: The problem that was solved.
        given_mode: The only mode that was searched; None: all modes were.
        evidence: Parts of the proof that the search kept.
        guarantee: Result of the search for torques under which rest is the only outcome; None: that
            was not requested, or there is not even a best case.
    """

    status: Status
    objective: Objective
    rules: Rules
    certificate: Certificate
    problem: QuasistaticProblem
    given_mode: SlidingMode | None = None
    evidence: Evidence = NO_EVIDENCE
    guarantee: Guarantee | None = None
    _forces: FloatArray | None = None
    _mode: SlidingMode | None = None
    _explanation: str | None = None
    _source: HasFindings | None = None

    def with_source(self, source: Any) -> TorqueSolution:
        """Return the solution with its scene or document, whose findings are added to its own."""
        return changed(self, _source=source)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings on the solution's scene and on the solution; the gravest first."""
        best = self.margin if self.found and self.algorithm is Algorithm.MARGIN else None
        doubts = solution_doubts(self.status, self.certificate, self.problem, best)
        return causes_first([*(() if self._source is None else self._source.findings), *doubts])

    @property
    def found(self) -> bool:
        """Whether there is a solution to read."""
        return self.status in FOUND

    def __bool__(self) -> Never:
        """Raise an error: that torques were found does not mean that the object stays.

        Raises:
            TypeError: Always.
        """
        raise TypeError(
            "a solution has no truth value: solution.found says whether torques were found, and "
            "scene.stability(solution.torques) whether the object stays"
        )

    @cached_property
    def explanation(self) -> str:
        """Why nothing is feasible, and the smallest changes that would help.

        Empty if a solution was found, or if the status says all.

        Computed when first read: it solves several changed problems, within 1000 nodes for each and
        10 s for all; `explain` does so within other limits.
        """
        if self.found or self._explanation is not None:
            return self._explanation or ""
        return _algorithms_function("explanation", "explained_briefly")(self)

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

    @cached_property
    def proof(self) -> SolutionProof:
        """The complete proof, over all modes, as in documents.

        Completed when first read: see `proof_of` for the effort.
        """
        return _algorithms_function("solution_proof", "proof_of")(self)

    @cached_property
    def motion(self) -> FloatArray | None:
        """(P + L,) virtual motion [V; theta_dot] of the mode, m/s and rad/s.

        None if the rules require none, or there is none. Computed when first read, if the search
        kept none.
        """
        return _algorithms_function("solution_proof", "motion_of")(self)

    @cached_property
    def value(self) -> float:
        """The objective's value in its own unit; with a regularisation, that of both together."""
        coordinates, program, unit = self.program
        x = np.concatenate([coordinates.scaled(self.contact_forces), self.added_columns])
        return self.objective.sign * unit * program.value(x)

    @cached_property
    def multipliers(self) -> Marginals:
        """Multipliers of the minimisation by the names of its blocks, in the problem's units."""
        return self.named(*self.scaled_multipliers)

    @property
    def scaled_multipliers(self) -> DualVariables:
        """Multipliers (y, z) of the scaled program in which the solution was found.

        Raises:
            NoSolutionError: If nothing was found, or torques with status STRONG: they are no
                optimum of one program.
        """
        if self.status is Status.STRONG:
            raise NoSolutionError("Guaranteed torques (status STRONG) have no multipliers.")
        return self._read(self.evidence.in_mode)

    @property
    def added_columns(self) -> FloatArray:
        """Values of the columns that the objective adds to the forces', scaled."""
        return self._read(self.evidence.added if self.found else None)

    def named(self, y: FloatArray, z: FloatArray) -> Marginals:
        """Return multipliers of the rows of the solution's program by name, in SI units.

        Args:
            y: (m,) of its equalities, scaled.
            z: (k,) of its other rows; those of infinite sides are a solver's noise, and left out.
        """
        _, program, unit = self.program
        weights, (low, high) = np.concatenate([y, z]), program.sides
        weights = np.where(np.isfinite(np.where(weights > 0.0, high, low)), weights, 0.0)
        return marginals((program.blocks, ()), (weights, np.zeros(0)), unit)

    @property
    def program(self) -> ScaledProgram:
        """The scaled program without modes, built at each call."""
        return scaled_program(self.problem, self.objective)

    @property
    def contact_forces(self) -> FloatArray:
        """(M, 3) contact forces on the object, N, world axes.

        One optimal choice among the statically indeterminate forces, not a prediction.
        """
        return self._read(self._forces)

    @property
    def mode(self) -> SlidingMode:
        """The virtual-sliding mode (B, S) whose optimum this is.

        With Coulomb friction no mode is required, and this only describes the friction.
        """
        return self._read(self._mode)

    @property
    def contact_torques(self) -> FloatArray:
        """(L,) joint torques J^T f of the contact forces (18), units as `torques`."""
        return self.problem.J.T @ self.contact_forces.ravel()

    @property
    def torques(self) -> FloatArray:
        """(L,) motor torques J^T f + g, N m (N for prismatic and hybrid joints)."""
        return self.contact_torques + self.problem.gravity_torques

    @property
    def torques_by_joint(self) -> Mapping[str, float]:
        """`torques` by name: joints with their mount's prefix, tendons and hybrid fingers."""
        names = self.problem.joint_names
        return MappingProxyType(dict(zip(names, self.torques.tolist(), strict=True)))

    @property
    def margin(self) -> float:
        """The margin e of the contact forces, (36) and (42), N; NaN if no solution was found.

        A margin below zero by rounding is returned as 0, so that it can be required again.
        """
        if not self.found:
            return math.nan
        margin, load = self.problem.margin_of(self.contact_forces), self.problem.scales.force
        return 0.0 if -_ROUNDING * load < margin < 0.0 else margin

    @property
    def max_torque(self) -> float:
        """Largest |motor torque|, in `max_torque_unit`; 0 without joints, NaN if none was found."""
        return float(np.abs(self.torques).max(initial=0.0)) if self.found else math.nan

    @property
    def max_torque_unit(self) -> JointUnit:
        """Unit of the joint with the largest |motor torque|; N m without joints."""
        units = self.problem.joint_units
        return units[int(np.abs(self.torques).argmax())] if units else JointUnit.TORQUE

    def __repr__(self) -> str:
        """Return one line: objective, status, margin and largest torque."""
        found = ""
        if self.found:
            found = f", margin={self.margin:.6g}, max_torque={self.max_torque:.6g}"
        size = f"{self.problem.contact_count} contacts, {self.problem.joint_count} joints"
        return f"<TorqueSolution {self.objective.name}: {self.status.name}{found}, {size}>"

    def __str__(self) -> str:
        """Return the solution as text; see `text`."""
        return self.text()

    def text(self, bodies: Sequence[str] | None = None, remarks: Sequence[str] = ()) -> str:
        """Return the tables of joints and contacts with the certificate, or why there are none.

        Args:
            bodies: M names of what touches the object at each contact; None: left out.
            remarks: Lines to print before the tables.
        """
        if not self.found:
            return f"{self._failure_text()}\n\n{self._certificate_text()}"
        parts: list[object] = ["\n".join([self._headline(), *remarks])]
        if self.problem.joint_count:
            parts.append(joint_table(self.problem, self.contact_torques))
        parts.append(contact_table(self.problem, self.contact_forces, self.mode, bodies))
        return "\n\n".join(str(part) for part in [*parts, self._certificate_text()])

    def _repr_html_(self) -> str:
        """Return the same as `text` as HTML, for notebooks."""
        last = paragraph(self._certificate_text())
        if not self.found:
            return f"{paragraph(self._failure_text())}\n{last}"
        parts = [paragraph(self._headline())]
        if self.problem.joint_count:
            parts.append(joint_table(self.problem, self.contact_torques).html())
        parts.append(contact_table(self.problem, self.contact_forces, self.mode).html())
        return "\n".join([*parts, last])

    def _failure_text(self) -> str:
        """Return why nothing was found: the status, unless the explanation includes it."""
        why = self.explanation
        is_explained = why and self.status in EXPLAINED
        first = f"not found: {'infeasible' if is_explained else self.status.message}"
        return f"{first}\n\n{why}" if why else first

    def _headline(self) -> str:
        """Return two lines: the algorithm and the status, then margin and largest torque."""
        margin = f"at margin {self.required_margin:g} N"
        name, of_margin = self.objective.name, self.objective.of_margin
        if self.algorithm is Algorithm.MARGIN:
            title = "Algorithm 1, largest margin"
        elif self.algorithm is Algorithm.TORQUE:
            title = f"Algorithm 2, smallest torque {margin}"
        else:
            title = f"largest margin {name}" if of_margin else f"{name} {margin}"
        size = torque_size(self.problem, self.torques)
        value = "" if self.algorithm or of_margin else f", value = {self.value:g}"
        return (
            f"{headed_text(title, self.status.message)}\n"
            f"margin e = {figure(self.margin, self.problem.scales.force)} N, max |torque| = "
            f"{figure(self.max_torque, size)} {self.max_torque_unit}"
            f"{value} {self.objective.unit_text if value else ''}".rstrip()
        )

    def _certificate_text(self) -> str:
        unit, size = "N", self.problem.scales.force
        if self.algorithm is None and not self.objective.of_margin:
            unit, size = self.objective.unit_text or "in its own unit", 1.0
        elif self.objective.by_limits:
            unit, size = "of the limit", 1.0
        elif self.algorithm is Algorithm.TORQUE:
            torques = self.torques if self.found else np.zeros(self.problem.joint_count)
            unit = self.max_torque_unit if self.found else units_text(self.problem.joint_units)
            size = torque_size(self.problem, torques)
        text = certificate_text(self.certificate, self.problem, unit, size, found=self.found)
        if self.found and self.guarantee is not None:
            gap, best = (
                figure(one, size) for one in (self.guarantee.gap, self.guarantee.best_case)
            )
            text += f"\nguaranteed: {gap} {unit} from the best case ({best} {unit})"
        if self.found and self.rules.by_direction:
            inner, outer = (figure(one, size) for one in (self.value, self.certificate.bound))
            text += f"\nrule of directions, round cones: inner value {inner}, outer {outer} {unit}"
        return text

    def _read(self, value: _Value | None) -> _Value:
        if value is None:
            raise NoSolutionError(
                f"There is no solution to read ({self.status.message}); check .found first."
            )
        return value


def checked_solution(solution: object) -> TorqueSolution:
    """Return the argument if it is a solution.

    Raises:
        ArgumentError: If it is not.
    """
    if not isinstance(solution, TorqueSolution):
        words = what_to_pass("solution", solution, "TorqueSolution")
        raise ArgumentError("solution", words)
    return solution


def _algorithms_function(module: str, name: str) -> Any:
    """Return a function of `algorithms`, imported late since that package imports this one."""
    return getattr(import_module(f"graspless_pin.algorithms.{module}"), name)
