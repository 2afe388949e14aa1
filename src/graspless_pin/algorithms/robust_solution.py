"""The solution for a set of problems: torques that serve all, forces of each, and the proof."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

import numpy as np
from tabulate import tabulate

from graspless_pin.algorithms.force_policy import ForcePolicy
from graspless_pin.algorithms.uncertain_members import Weight
from graspless_pin.algorithms.uncertainty import Uncertainty
from graspless_pin.errors import NoSolutionError
from graspless_pin.holding.verdict import StabilityVerdict
from graspless_pin.problem.checks import FloatArray, JointUnit
from graspless_pin.problem.members import Member
from graspless_pin.programs.forces import force_coordinates
from graspless_pin.records import Brief
from graspless_pin.solution import Status, TorqueSolution

_AT_BOUND = 1e-6
"""Distance from a value at which a bound counts as reached, over the value or the load's unit."""


class Coverage(StrEnum):
    """Which members an answer is proven for. See the example of `Uncertainty`."""

    WHOLE_SET = "the whole set"
    """Forces of any member are means of those of the corners, or those of a policy, in one mode."""
    CORNERS = "the corners of the set"
    """Modes differ from corner to corner: between them nothing is proven."""
    SAMPLED = "the sampled members"
    """Contacts may be elsewhere: see `Samples` for what is proven beside."""

    @property
    def where_meant(self) -> str:
        """The coverage in words, for members with contacts at their nominal positions."""
        return f"{self} with contacts at their nominal positions"


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Brief):
    """Members of a set with contacts that are not at their nominal positions.

    See the example of `Uncertainty`.

    Attributes:
        count: Number of members drawn at random after the torques were found.
        served: Number of them that the torques serve; nothing is proven for other members.
        solved: Number of members drawn before, with contacts as far off as they may be: the torques
            serve all of them.
        where_meant: The members that the answer is proven for, contacts at nominal positions.
    """

    count: int
    served: int
    solved: int
    where_meant: Coverage

    def __str__(self) -> str:
        """Return the result of the sampling, in words."""
        return (
            f"{self.served} of {self.count} random members with contacts moved keep the margin, "
            f"as do all {self.solved} with every contact at its largest distance"
        )


@dataclass(frozen=True, eq=False, repr=False)
class RestAtCorners(Brief):
    """Result of a search for torques under which rest is the only outcome at each corner.

    Between the corners nothing is proven about rest. See the example of `Scene.solve`.

    Attributes:
        corners: Numbers of the members with a verdict; where no torques were found, those of the
            torques that kept rest at most corners, the last one without rest.
        verdicts: The verdicts on these members.
        kept: Whether rest is the only outcome at all corners, and none was left out.
        tried: Number of sets of torques that were judged.
    """

    corners: tuple[int, ...]
    verdicts: tuple[StabilityVerdict, ...]
    kept: bool
    tried: int


@dataclass(frozen=True, eq=False, repr=False)
class RobustSolution(Brief):
    """Torques that serve a whole set of problems, and the forces of its corners.

    See the example of `Uncertainty`.

    Attributes:
        solution: Solution of the joined problem of the members that were needed: its certificate
            proves the answer, or with a policy the bound alone.
        coverage: The members that the torques are proven for; where nothing was found, the members
            that provably no torques serve.
        bound: No torques for all members are better than this, in the unit of the objective's
            value: N for Algorithm 1, N m or N for Algorithm 2. NaN where it is proven that there
            are none.
        members: K members of the set: first those of `contact_forces`, which are the solution's or
            the policy's corners.
        joint_names: L names.
        conflict: Numbers of members that no torques serve together, while torques serve any fewer
            of them. Empty where torques were found, or where it is not proven that there are none.
        feedback: (L,) joint stiffness that adds to the torques, N m/rad (N/m); None: torques are
            constant.
        uncertainty: The set.
        weight: Which part of the load is weight.
        policy: Forces that are affine in balls and in errors of many torques, which prove the
            answer for the whole set; the solution is then that of members that bound it from the
            other side. None: corners are enough.
        samples: Sampled members with moved contacts; None: contacts stay, or nothing was found.
        rest: The verdicts on corners under ``stability="strong"``; None: it was not requested.
    """

    solution: TorqueSolution
    coverage: Coverage
    bound: float
    members: tuple[Member, ...]
    joint_names: tuple[str, ...]
    conflict: tuple[int, ...] = ()
    feedback: FloatArray | None = None
    uncertainty: Uncertainty | None = None
    weight: Weight | None = None
    policy: ForcePolicy | None = None
    samples: Samples | None = None
    rest: RestAtCorners | None = None

    @property
    def proven_for(self) -> str:
        """The members that the answer is proven for, in words."""
        return str(self.coverage) if self.samples is None else self.samples.where_meant.where_meant

    @property
    def status(self) -> Status:
        """Status of the joined problem; LIMIT_REACHED where a policy does not reach the bound."""
        status = self.solution.status
        if self.policy is None:
            return status
        problem = self.members[0].problem
        unit = self.solution.objective.unit(problem, force_coordinates(problem))
        closed = abs(self.value - self.bound) <= _AT_BOUND * max(abs(self.value), unit)
        return status if closed and self.solution.found else Status.LIMIT_REACHED

    @property
    def found(self) -> bool:
        """Whether there are torques."""
        return self.policy is not None or self.solution.found

    @property
    def margin(self) -> float:
        """The margin that all members keep, N; NaN where nothing was found."""
        return self.solution.margin if self.policy is None else self.policy.least_margin

    @property
    def max_torque(self) -> float:
        """The largest |torque| that is commanded in any member; NaN where nothing was found."""
        return self.solution.max_torque if self.policy is None else self.policy.max_torque

    @property
    def max_torque_unit(self) -> JointUnit:
        """Unit of the joint with the largest |torque| in any member; N m without joints.

        Raises:
            NoSolutionError: If nothing was found.
        """
        units = self.members[0].problem.joint_units
        return units[int(self.largest_commands.argmax())] if units else JointUnit.TORQUE

    @property
    def value(self) -> float:
        """The worst value of the objective in any member, in its unit.

        Raises:
            NoSolutionError: If nothing was found.
        """
        if self.policy is not None:
            return self.policy.value(self.solution.objective)
        return self.solution.value

    @property
    def residual(self) -> float:
        """Largest violation of a constraint, scaled; with a policy, of balance for the worst d."""
        if self.policy is not None:
            return self.policy.residual()
        return self.solution.certificate.primal_residual

    @property
    def largest_commands(self) -> FloatArray:
        """(L,) the largest |torque| that is commanded of each joint in any member, N m (N).

        Raises:
            NoSolutionError: If nothing was found.
        """
        if self.policy is None:
            return np.abs(self.commands).max(axis=0)
        return self.policy.largest_commands

    @property
    def joined_members(self) -> tuple[Member, ...]:
        """The members of the joined problem that `solution` is of."""
        first = 0 if self.policy is None else len(self.policy.corners)
        count = self.solution.problem.contact_count // self.members[0].problem.contact_count
        return self.members[first : first + count]

    @property
    def commands(self) -> FloatArray:
        """(J, L) commanded torques of the solution's J members or the policy's corners, N m (N).

        Without feedback all rows are equal.

        Raises:
            NoSolutionError: If nothing was found.
        """
        forces = self.contact_forces
        commanded = [
            member.commanded(member.problem.J.T @ force.ravel())
            for member, force in zip(self.members, forces, strict=False)
        ]
        return np.array(commanded if self.feedback is not None else commanded[:1] * len(forces))

    @property
    def torques(self) -> FloatArray:
        """(L,) torques to command, N m (N); with feedback those of the nominal problem."""
        return self.commands[0]

    @property
    def torques_by_joint(self) -> Mapping[str, float]:
        """The torques to command by joint name."""
        return MappingProxyType(dict(zip(self.joint_names, self.torques.tolist(), strict=True)))

    @property
    def worst(self) -> int:
        """Number of the solution's member, or of the corner, whose forces keep the least margin.

        Raises:
            NoSolutionError: If nothing was found.
        """
        if self.policy is not None:
            return int(self.policy.margins.argmin())
        forces = zip(self.members, self.contact_forces, strict=False)
        return int(np.argmin([member.problem.margin_of(force) for member, force in forces]))

    @property
    def deflections(self) -> FloatArray:
        """(J, L) deflection of each joint in each member that produces the feedback, rad (m).

        Raises:
            NoSolutionError: If nothing was found, or there is no feedback.
        """
        if self.feedback is None:
            raise NoSolutionError("Constant torques have no deflections; solve with feedback=...")
        differences = self.commands - self.torques
        return np.divide(
            -differences, self.feedback, out=np.zeros_like(differences), where=self.feedback > 0.0
        )

    @property
    def largest_deflection(self) -> float:
        """Largest deflection of any joint in any member, rad (m).

        Raises:
            NoSolutionError: If nothing was found, or there is no feedback.
        """
        sizes = np.abs(self.deflections)
        if self.policy is not None and self.feedback is not None:
            there = self.feedback > 0.0
            sizes[:, there] += self.policy.rooms[:, there] / self.feedback[there]
        return float(sizes.max(initial=0.0))

    @property
    def contact_forces(self) -> FloatArray:
        """(J, M, 3) forces of the solution's J members or the policy's corners, N, world axes."""
        if self.policy is not None:
            return self.policy.forces
        return self.solution.contact_forces.reshape(-1, self.members[0].problem.contact_count, 3)

    def __str__(self) -> str:
        """Return the torques and the members they are proven for, or the members in conflict."""
        if not self.found:
            lines = [f"no torques for the whole set: {self.status.message}"]
            if self.rest is not None and self.rest.verdicts:
                last = self.members[self.rest.corners[-1]].words
                lines.append(f"the best torques tried are not proven to keep rest where {last}:")
                lines.append(f"  {self.rest.verdicts[-1].message}")
            if self.status is Status.UNVERIFIED:
                lines.append("contact forces affine in the unknowns are not enough; others may be")
            if len(self.conflict) == 1:
                lines.append("this member alone is infeasible:")
            elif self.conflict:
                lines.append("no torques are feasible for all of these members:")
            lines += [f"  {self.members[number].words}" for number in self.conflict]
            if len(self.conflict) > 1 and self.feedback is None:
                lines.append(
                    "along a motion that no contact resists, constant torques balance one load "
                    "only; feedback=STIFFNESS adds the torques of the joints' stiffness"
                )
            return "\n".join(lines)
        problem, commands = self.members[0].problem, self.commands
        rows = [
            (name, f"{commands[0, k]:.4g}", f"{commands[:, k].min():.4g}",
             f"{commands[:, k].max():.4g}", kind)
            for k, (name, kind) in enumerate(
                zip(problem.joint_names, problem.joint_units, strict=True)
            )
        ]  # fmt: skip
        headers = ("joint", "torque", "least", "most", "")
        if self.feedback is None:
            rows, headers = [(row[0], row[1], row[4]) for row in rows], ("joint", "torque", "")
        policy = ""
        if self.policy is not None:
            policy = (
                " by contact forces affine in the unknowns\n"
                f"no torques for the whole set are better than {self.bound:.6g}"
            )
        sampled = "" if self.samples is None else f"sampled: {self.samples}\n"
        if self.rest is not None:
            count = len(self.rest.corners)
            policy += (
                f"\nrest is the only outcome at {count} corners; it is not proven between them"
            )
        return (
            f"margin {self.margin:.6g} N, max |torque| {self.max_torque:.6g} "
            f"{self.max_torque_unit}, proven for {self.proven_for}{policy}\n{sampled}"
            f"smallest margin at: {self.members[self.worst].words}\n\n"
            f"{tabulate(rows, headers=headers, disable_numparse=True)}"
        )
