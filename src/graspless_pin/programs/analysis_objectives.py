"""Objectives of the analyses: trade-off, force sets of given torques (32), disturbances, relief.

And those of the search for guaranteed torques: torques given, and torques in half-spaces; and of
windows of squeeze: torques that change least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.scales import bears_contacts
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.forces import ForceCoordinates, ForceRows
from graspless_pin.programs.objectives import Objective, Torque, add_largest
from graspless_pin.programs.program import FARTHEST, Program


@dataclass(frozen=True)
class Tradeoff(Objective):
    """Algorithms 1 and 2 as one program: t and e/F >= 0 as variables, t minimised; see `aimed`.

    Attributes:
        base: What the torques are measured by.
    """

    base: Torque
    name = "tradeoff"

    def build(self, program: ProgramBuilder) -> None:
        """Add t and e/F."""
        forces = program.forces
        add_largest(program, self.base.sides(forces.problem, forces.coordinates))
        e = program.columns(
            "margin",
            low=0.0,
            box=(0.0, 0.5 * float(forces.limit.min())),
            unit=forces.coordinates.force_scale,
        )
        program.balance()
        program.cones(e)
        program.normal_limits(e)
        program.torque_limits()

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return the unit of t."""
        return self.base.unit(problem, coordinates)


def aimed(
    program: Program, torque: float, margin: float, low: float = 0.0, high: float = np.inf
) -> Program:
    """Return the trade-off with the objective torque * t + margin * e / F, low <= e / F <= high."""
    c, lb, ub = np.zeros_like(program.c), program.lb.copy(), program.ub.copy()
    t, e = program.column("largest"), program.column("margin")
    c[t], c[e], lb[e], ub[e] = torque, margin, low, high
    return replace(program, c=c, lb=lb, ub=ub)


@dataclass(frozen=True, eq=False)
class ForceSet(Objective):
    """The force set (32) of given torques, which has no normal-force limit; no cost yet.

    Attributes:
        torques: (L,) motors' torques, N m.
        farthest: Whether normal forces are looked at up to `FARTHEST`, not `largest_force_sought`.
    """

    torques: FloatArray
    farthest: bool = False
    name = "force set"

    def build(self, program: ProgramBuilder) -> None:
        """Add the balance, the torques and the cones."""
        reach = FARTHEST if self.farthest else largest_force_sought(program.forces, self.torques)
        program.set_proof_box(program.forces.cone_box(reach))
        program.balance()
        program.held_torques(contact_torques(program.forces, self.torques))
        program.cones(0.0)
        program.bound_normals(0.0, reach)


@dataclass(frozen=True)
class FreeRays(Objective):
    """Directions of forces that make no wrench and no torques and stay in the cones; no cost yet.

    Their normal components are at most 1.
    """

    name = "free rays"

    def build(self, program: ProgramBuilder) -> None:
        """Add the balance and the torques of nothing, and the cones."""
        forces = program.forces
        program.set_proof_box(forces.cone_box(1.0))
        program.equal("balance", forces.balance_rows, np.zeros(len(forces.balance_rows)))
        program.equal("held", forces.torque_rows, np.zeros(len(forces.torque_rows)))
        program.cones(0.0)
        program.bound_normals(0.0, 1.0)


@dataclass(frozen=True, eq=False)
class ForceBesideRay(Objective):
    """A force set beside its own rays: x in the set, and d so that x + s d is for every s >= 0.

    The columns of d are those of x over again.

    Attributes:
        base: The force set.
    """

    base: Objective
    name = "force beside a ray"

    def build(self, program: ProgramBuilder) -> None:
        """Add the force set and the columns and rows of the rays."""
        self.base.build(program)
        forces, size = program.forces, program.forces.size
        low, high = np.full((2, size), [[-np.inf], [np.inf]])
        low[forces.coordinates.normal_columns], high[forces.coordinates.normal_columns] = 0.0, 1.0
        least, most = forces.cone_box(1.0)
        ray = program.columns("ray", size, low=low, high=high, box=(least, most))
        program.equal(
            "ray balance", None, np.zeros(len(forces.balance_rows)), {ray: forces.balance_rows}
        )
        program.equal(
            "ray held", None, np.zeros(len(forces.torque_rows)), {ray: forces.torque_rows}
        )
        program.cones(0.0, name="ray cones", of=ray)


@dataclass(frozen=True, eq=False)
class HeldMargin(Objective):
    """Algorithm 1 with the motors' torques given: the margin of either sign.

    Attributes:
        torques: (L,) N m.
    """

    torques: FloatArray
    name = "margin of held torques"
    maximizes = True

    def build(self, program: ProgramBuilder) -> None:
        """Add e/F; the forces stay in their cones whatever it is beyond the normal-force limit.

        Forces are looked for as far as `largest_force_sought`.
        """
        forces = program.forces
        largest = float(forces.limit.max())
        most = largest_force_sought(forces, self.torques)
        program.set_proof_box(forces.cone_box(min(most + largest, FARTHEST)))
        unit = forces.coordinates.force_scale
        e = program.columns("margin", low=-most, box=(-most, largest), cost=-1.0, unit=unit)
        program.balance()
        program.held_torques(contact_torques(forces, self.torques))
        program.cones(e)
        program.normal_limits(e)
        program.cones(0.0, name="inside")
        program.bound_normals(0.0, np.inf)

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return F, N."""
        return coordinates.force_scale


@dataclass(frozen=True, eq=False)
class Disturbance(Objective):
    """The largest multiple s of a disturbance wrench that the contacts still balance.

    W f = -(w_ext + s direction), forces inside cones and normal-force limits.

    Attributes:
        direction: (P,) wrench per newton of disturbance.
        torques: (L,) motors' torques that stay, N m; None: any within their limits.
    """

    direction: FloatArray
    torques: FloatArray | None
    name = "disturbance"
    maximizes = True

    def build(self, program: ProgramBuilder) -> None:
        """Add s over F."""
        forces = program.forces
        push = forces.weight * self.direction
        largest = int(np.argmax(np.abs(push)))
        most = []
        for box in forces.boxes:
            reach = np.abs(forces.balance_rows[largest]) @ np.abs(box).max(axis=0)
            reach += abs(forces.wrench[largest])
            most.append(float(reach / abs(push[largest])) + 1.0)
        s = program.columns(
            "multiple",
            low=0.0,
            box=(0.0, most[0]),
            whole_box=(0.0, most[-1]),
            cost=-1.0,
            unit=forces.coordinates.force_scale,
        )
        program.balance({s: push})
        if self.torques is None:
            program.torque_limits()
        else:
            program.held_torques(contact_torques(forces, self.torques))
        program.cones(0.0)
        program.bound_normals(0.0, forces.limit)

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return F, N."""
        return coordinates.force_scale


@dataclass(frozen=True)
class LimitRelief(Objective):
    """The smallest change s >= 0 of some limits that makes a required margin feasible.

    It is given to the limits of some joints (in the largest of their joint scales), to all
    normal-force limits (in F), and as an extra external wrench (in F, the largest component of a
    wrench with moments over the length scale).

    Attributes:
        required_margin: N.
        joints: The joints whose limits give way, by the same amount.
        normal: Whether the normal-force limits give way.
        wrench: Whether the balance is helped.
    """

    required_margin: float
    joints: tuple[int, ...] = ()
    normal: bool = False
    wrench: bool = False
    name = "limit relief"

    def build(self, program: ProgramBuilder) -> None:
        """Add s, and rows that give way by it."""
        forces = program.forces
        margin = self.required_margin / forces.coordinates.force_scale
        most = _at_hand(forces, margin)
        if self.normal:
            program.set_proof_box(forces.cone_box(float(forces.limit.max()) + most))
        # More than that is no help, and the box holds of every solution as the limit is imposed.
        s = program.columns("relief", low=0.0, high=most, box=(0.0, most), cost=1.0)
        up, down = self._given(forces)
        program.cones(margin)
        program.rows("torque_upper", forces.torque_rows, forces.upper, {s: -up})
        program.rows("torque_lower", -forces.torque_rows, -forces.lower, {s: -down})
        program.rows(
            "normal_upper", forces.normal_rows, forces.limit - margin, {s: -float(self.normal)}
        )
        for name, sign in (("balance_upper", 1.0), ("balance_lower", -1.0)):
            program.rows(
                name, sign * forces.balance_rows, sign * forces.wrench, {s: -float(self.wrench)}
            )
        program.bound_normals(np.where(forces.held_above_zero, margin, -np.inf), np.inf)

    def _given(self, forces: ForceRows) -> tuple[FloatArray, FloatArray]:
        """(L,) by how much the upper and the lower torque limits give way."""
        joints, given = list(self.joints), np.zeros(len(forces.torque_rows))
        scale = forces.coordinates.joint_scale[joints]
        given[joints] = scale.max(initial=0.0) / scale
        # A limit of zero beside a nonzero one is a direction that cannot be pushed: it stays.
        problem = forces.problem
        zero_low, zero_high = problem.lower_torque == 0.0, problem.upper_torque == 0.0
        return given * ~(zero_high & ~zero_low), given * ~(zero_low & ~zero_high)


def _at_hand(forces: ForceRows, margin: float) -> float:
    """Ten times everything at hand, scaled: as much as any limit may have to give."""
    finite = np.concatenate([forces.lower, forces.upper])
    most = 10.0 * (
        2.0 + margin + float(np.abs(forces.boxes[-1]).sum() + np.abs(forces.wrench).sum())
    )
    most += float(np.abs(finite[np.isfinite(finite)]).max(initial=0.0))
    return most + float(np.abs(forces.torque_rows).sum())


_FORCES_SOUGHT = 1e3
"""Forces without a limit are looked for up to so many times what bears on the contacts."""


def largest_force_sought(forces: ForceRows, torques: FloatArray) -> float:
    """Return up to which normal force, over F, forces without a limit are looked for.

    A thousand times the largest of load, normal-force limits, and torques over their joint's scale.
    """
    limit, tau = float(forces.limit.max()), contact_torques(forces, torques)
    return min(_FORCES_SOUGHT * max(1.0, limit, float(np.abs(tau).max(initial=0.0))), FARTHEST)


def contact_torques(forces: ForceRows, torques: FloatArray) -> FloatArray:
    """Return (L,) torques that the contacts make beside gravity, over the joint scale.

    Of joints that move no contact they are zero: what carries their links is their own.
    """
    problem = forces.problem
    made = np.where(bears_contacts(problem.jacobian), torques - problem.gravity_torques, 0.0)
    return made / forces.coordinates.joint_scale


_MARGIN_BESIDE = 0.1
"""What a margin of one load counts beside a depth of one joint scale."""


@dataclass(frozen=True, eq=False)
class AtTorques(Objective):
    """Another objective with the motors' torques given.

    Attributes:
        base: The objective.
        torques: (L,) N m.
    """

    base: Objective
    torques: FloatArray
    name = "at given torques"

    def __post_init__(self) -> None:
        """Take over what the objective says of its program."""
        for name in ("maximizes", "required_margin", "regularization"):
            object.__setattr__(self, name, getattr(self.base, name))

    def build(self, program: ProgramBuilder) -> None:
        """Add what the objective does, and hold the torques."""
        self.base.build(program)
        program.held_torques(contact_torques(program.forces, self.torques))

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return the objective's."""
        return self.base.unit(problem, coordinates)

    @property
    def of_margin(self) -> bool:
        """Whether its value is the margin e, N."""
        return self.base.of_margin

    def with_figure(self, name: str, value: float) -> AtTorques:
        """Return it with another figure of the objective."""
        return replace(self, base=self.base.with_figure(name, value))

    @property
    def cutoff(self) -> float:
        """A value of the program from which on there is no solution."""
        return self.base.cutoff


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
        rows = (self.normals * scale / size[:, None]) @ forces.torque_rows
        sides = (self.sides - self.normals @ forces.problem.gravity_torques) / size
        most = [np.abs(rows) @ np.abs(box).max(axis=0) + np.abs(sides) for box in forces.boxes]
        depths = [float(reach.max(initial=0.0)) + self.depth for reach in most]
        d = program.columns(
            "depth", high=self.depth, cost=-1.0,
            box=(-depths[0], self.depth), whole_box=(-depths[-1], self.depth),
        )  # fmt: skip
        low = self.required_margin / unit
        highest = max(low, 0.5 * float(forces.limit.min()))
        e = program.columns("margin", low=low, box=(low, highest), cost=-_MARGIN_BESIDE, unit=unit)
        program.balance()
        program.cones(e)
        program.normal_limits(e)
        program.torque_limits()
        program.rows("half-spaces", rows, sides, {d: np.ones(len(rows))})


@dataclass(frozen=True)
class LeastChange(Objective):
    """The torques of balance that are nearest to given ones, in squares of shares of limits.

    Attributes:
        torques: L given ones, N m (N).
        direction: L, along which nothing changes, in the norm scaled by the limits.
    """

    name = "least change"
    torques: tuple[float, ...]
    direction: tuple[float, ...]

    def build(self, program: ProgramBuilder) -> None:
        """Add the changes, whose squares are summed, and the rows of Algorithm 2.

        Their sum of squares has one least point, which moves on evenly where the squeeze does; the
        largest of them alone would leave the others open, and torques would jump.
        """
        forces, scale = program.forces, program.forces.coordinates.joint_scale
        limits = np.minimum(
            np.maximum(np.abs(forces.problem.lower_torque), np.abs(forces.problem.upper_torque)),
            1e3 * scale,
        )
        share = scale / np.where(limits > 0.0, limits, scale)
        rest = forces.gravity - np.array(self.torques) / scale
        most = [
            share * (np.abs(forces.torque_rows) @ box[1] + np.abs(rest)) for box in forces.boxes
        ]
        changes = program.columns(
            "changes", len(share), curvature=1.0, box=(-most[0], most[0]),
            whole_box=(-most[-1], most[-1]),
        )  # fmt: skip
        is_change = {changes: -np.eye(len(share))}
        program.equal("changes", share[:, None] * forces.torque_rows, -share * rest, is_change)
        # No change along the direction: the squeeze is as it is asked for.
        along = share**2 * np.array(self.direction) / scale
        along = along / np.linalg.norm(along)
        program.equal("squeeze", (along @ forces.torque_rows)[None], np.array([-along @ rest]))
        program.balance()
        program.cones(0.0)
        program.normal_limits(0.0)
        program.torque_limits()
