"""The answer of an evaluator for one state, and the statuses of states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, Unpack

import numpy as np

from graspless_pin.algorithms.batch_optimum import WarmOptimum, solution_of_optimum
from graspless_pin.errors import NoSolutionError, StateFault
from graspless_pin.holding.verdict import StabilityKeywords, StabilityVerdict
from graspless_pin.modes.rules import Rules
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, JointUnit, read_only
from graspless_pin.programs.objectives import Objective
from graspless_pin.records import Brief
from graspless_pin.scene import Scene, SceneContacts
from graspless_pin.solution import UNDECIDED, Status, TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.algorithms.robust_solution import RobustSolution


class StateStatus(Enum):
    """Status of a state; the value is the message. See the example of `Evaluator`.

    Only `Evaluator.validity` returns ``BELOW_MARGIN``.
    """

    FOUND = "torques were found"
    INFEASIBLE = "no torques hold the object in this state"
    UNDECIDED = "a node or time limit, or a program that no solver answered, ended the search"
    OUTSIDE_LIMITS = "a joint is outside its limits"
    NO_CONTACT = StateFault.NO_CONTACT.value
    OVERLAP = StateFault.OVERLAP.value
    BLOCKED = StateFault.BLOCKED.value
    PARTED = StateFault.PARTED.value
    AMBIGUOUS = StateFault.AMBIGUOUS.value
    BELOW_MARGIN = "the largest margin is below the required margin"
    HAND_TOUCHES_NOTHING = "no link of the hand touches the object"
    HAND_THROUGH_SUPPORT = "a hand link and a support overlap by more than max_penetration"
    HAND_THROUGH_ITSELF = "hand links overlap by more than max_penetration"

    @classmethod
    def of_unsolved(cls, status: Status) -> StateStatus:
        """Return the status of a state without torques: undecided or infeasible."""
        return cls.UNDECIDED if status in UNDECIDED else cls.INFEASIBLE

    @property
    def message(self) -> str:
        """The message in words."""
        return self.value


STATUSES = tuple(StateStatus)
"""Arrays of many states hold indices into these."""


class WarmAnswer(NamedTuple):
    """The optimum of a state from a warm start: the solution is made when it is first read.

    Attributes:
        objective: The objective.
        rules: The reading of the virtual-sliding constraint.
        optimum: The optimum.
        margin: N.
        torques: (L,) N m or N.
        joint_names: L names of the torques.
        joint_units: L units of the torques.
    """

    objective: Objective
    rules: Rules
    optimum: WarmOptimum
    margin: float
    torques: FloatArray
    joint_names: tuple[str, ...]
    joint_units: tuple[JointUnit, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(Brief):
    """The answer for one state, with or without torques: see ``found``.

    See the example of `Evaluator`.

    Attributes:
        status: The status.
        reason: Why there are no torques, with the bodies' names; empty if there are.
        scene: The scene in this state; where a joint is outside its limits, with the evaluator's
            own configuration.
    """

    status: StateStatus
    reason: str
    scene: Scene
    _found: TorqueSolution | WarmAnswer | RobustSolution | None

    @property
    def found(self) -> bool:
        """Whether there are torques to read."""
        return self.status is StateStatus.FOUND

    @property
    def joint_names(self) -> tuple[str, ...]:
        """L names of the torques; empty without a problem."""
        return () if self._found is None else _joint_record(self._found).joint_names

    @property
    def joint_units(self) -> dict[str, JointUnit]:
        """Unit of each torque by name; empty without a problem."""
        if self._found is None:
            return {}
        joints = _joint_record(self._found)
        return dict(zip(joints.joint_names, joints.joint_units, strict=True))

    @property
    def has_contacts(self) -> bool:
        """Whether the state was solved, with or without torques: else there is no solution."""
        return self._found is not None

    @property
    def robust(self) -> RobustSolution | None:
        """The solution for all members of an evaluator's uncertainty; None: it has none."""
        found = self._found
        return None if found is None or isinstance(found, TorqueSolution | WarmAnswer) else found

    @cached_property
    def solution(self) -> TorqueSolution:
        """The solution with its problem, forces, mode and proof, found or not.

        With an uncertainty it is that of the joined problem of the members that were needed.

        Raises:
            NoSolutionError: If the state has no contacts to solve for, or is refused; with the
                reason.
        """
        found = self._found
        if found is None:
            raise NoSolutionError(f"This state was not solved ({self.reason}).")
        if isinstance(found, TorqueSolution):
            return found
        if not isinstance(found, WarmAnswer):
            return found.solution
        problem = self.scene.problem()
        return solution_of_optimum(problem, found.objective, found.rules, found.optimum)

    def proof_figures(self) -> tuple[int, float, float, float]:
        """Return number of contacts, bound, gap and residual of a state that was solved.

        See `EvaluatedStates`.
        """
        found = self._found
        if isinstance(found, WarmAnswer):
            optimum = found.optimum
            bound = optimum.bound * optimum.signed_unit
            return len(optimum.forces), bound, optimum.gap, optimum.residual
        if found is None or isinstance(found, TorqueSolution):
            problem, proof = self.solution.problem, self.solution.certificate
            return problem.contact_count, proof.bound, proof.gap, proof.primal_residual
        gap = abs(found.bound - found.value) if found.found else np.nan
        return found.members[0].problem.contact_count, found.bound, gap, found.residual

    @property
    def contacts(self) -> SceneContacts:
        """The contacts that carry force.

        Raises:
            NoSolutionError: As for `solution`.
        """
        if self._found is None:
            _ = self.solution
        return self.scene.contacts

    @cached_property
    def margin(self) -> float:
        """The margin e, N; -inf where there are no torques: below every required margin."""
        return self._found.margin if self._found is not None and self.found else -np.inf

    @cached_property
    def torques(self) -> FloatArray:
        """(L,) motor torques, N m (N for prismatic and hybrid joints).

        Raises:
            NoSolutionError: If there are none; with the reason.
        """
        if self._found is None or not self.found:
            raise NoSolutionError(f"This state has no torques ({self.reason}); check .found first.")
        return read_only(self._found.torques)

    @property
    def torques_by_joint(self) -> Mapping[str, float]:
        """The same by name.

        Raises:
            NoSolutionError: If there are none; with the reason.
        """
        torques = self.torques.tolist()
        return MappingProxyType(dict(zip(self.joint_names, torques, strict=True)))

    def stability(self, **options: Unpack[StabilityKeywords]) -> StabilityVerdict:
        """Decide whether the object stays with the torques: see `Scene.stability`.

        Args:
            options: Of `graspless_pin.stability`.

        Raises:
            NoSolutionError: If there are no torques; with the reason.
        """
        return self.scene.stability(self.torques, **options)


def _joint_record(
    found: TorqueSolution | WarmAnswer | RobustSolution,
) -> QuasistaticProblem | WarmAnswer:
    if isinstance(found, WarmAnswer):
        return found
    return found.problem if isinstance(found, TorqueSolution) else found.members[0].problem
