"""Objectives of the analyses: trade-off, force sets of given torques (32), disturbances, relief.

Also those of the search for guaranteed torques (given torques, torques in half-spaces), and of
windows of squeeze (torques of least change).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.scales import bears_contacts
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.forces import ForceCoordinates, ForceRows
from graspless_pin.programs.objectives import Objective, Torque, add_largest_torque
from graspless_pin.programs.program import FARTHEST, Program


@dataclass(frozen=True)
class Tradeoff(Objective):
    """Algorithms 1 and 2 as one program: t and e/F >= 0 as variables; see `weighted_tradeoff`.

    Attributes:
        base: The objective that measures the torques.
    """

    base: Torque
    name = "tradeoff"

    def build(self, program: ProgramBuilder) -> None:
        """Add t and e/F."""
        forces = program.forces
        add_largest_torque(program, self.base.sides(forces.problem, forces.coordinates))
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


def weighted_tradeoff(
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
        farthest: Whether normal forces are bounded by `FARTHEST`, not by `largest_force_sought`.
    """

    torques: FloatArray
    farthest: bool = False
    name = "force set"

    def build(self, program: ProgramBuilder) -> None:
        """Add the balance, the given torques and the cones."""
        reach = FARTHEST if self.farthest else largest_force_sought(program.forces, self.torques)
        program.set_proof_box(program.forces.cone_box(reach))
        program.balance()
        program.held_torques(contact_torques(program.forces, self.torques))
        program.cones(0.0)
        program.bound_normals(0.0, reach)


@dataclass(frozen=True)
class FreeRays(Objective):
    """Directions of forces inside the cones with zero wrench and zero torques; no cost yet.

    Their normal components are at most 1.
    """

    name = "free rays"

    def build(self, program: ProgramBuilder) -> None:
        """Add the homogeneous balance and torque rows, and the cones."""
        forces = program.forces
        program.set_proof_box(forces.cone_box(1.0))
        program.equal("balance", forces.balance_rows, np.zeros(len(forces.balance_rows)))
        program.equal("held", forces.torque_rows, np.zeros(len(forces.torque_rows)))
        program.cones(0.0)
        program.bound_normals(0.0, 1.0)


@dataclass(frozen=True, eq=False)
class ForceBesideRay(Objective):
    """A force x of a force set and a ray d of it: x + s d is in the set for every s >= 0.

    The columns of d have the layout of those of x.

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
        lowest, highest = forces.cone_box(1.0)
        ray = program.columns("ray", size, low=low, high=high, box=(lowest, highest))
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
        """Add e/F, and keep the forces inside their cones for any e.

        The box of forces is that of `largest_force_sought`, enlarged by the normal-force limit.
        """
        forces = program.forces
        largest = float(forces.limit.max())
        reach = largest_force_sought(forces, self.torques)
        program.set_proof_box(forces.cone_box(min(reach + largest, FARTHEST)))
        unit = forces.coordinates.force_scale
        e = program.columns("margin", low=-reach, box=(-reach, largest), cost=-1.0, unit=unit)
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
    """The largest multiple s of a disturbance wrench that the contacts can balance.

    W f = -(w_ext + s direction), forces inside cones and normal-force limits.

    Attributes:
        direction: (P,) wrench per newton of disturbance.
        torques: (L,) fixed motor torques, N m; None: any within their limits.
    """

    direction: FloatArray
    torques: FloatArray | None
    name = "disturbance"
    maximizes = True

    def build(self, program: ProgramBuilder) -> None:
        """Add s over F."""
        forces = program.forces
        direction_rows = forces.weight * self.direction
        row = int(np.argmax(np.abs(direction_rows)))
        largest_multiples = []
        for box in forces.boxes:
            reach = np.abs(forces.balance_rows[row]) @ np.abs(box).max(axis=0)
            reach += abs(forces.wrench[row])
            largest_multiples.append(float(reach / abs(direction_rows[row])) + 1.0)
        s = program.columns(
            "multiple",
            low=0.0,
            box=(0.0, largest_multiples[0]),
            whole_box=(0.0, largest_multiples[-1]),
            cost=-1.0,
            unit=forces.coordinates.force_scale,
        )
        program.balance({s: direction_rows})
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

    It relaxes the limits of some joints (in the largest of their joint scales), all normal-force
    limits (in F), and the balance by an extra external wrench (in F, the largest component of a
    wrench with moments over the length scale).

    Attributes:
        required_margin: N.
        joints: The joints whose limits are relaxed, all by the same amount.
        normal: Whether the normal-force limits are relaxed.
        wrench: Whether the balance is relaxed.
    """

    required_margin: float
    joints: tuple[int, ...] = ()
    normal: bool = False
    wrench: bool = False
    name = "limit relief"

    def build(self, program: ProgramBuilder) -> None:
        """Add s, and the rows that it relaxes."""
        forces = program.forces
        margin = self.required_margin / forces.coordinates.force_scale
        most = _largest_relief(forces, margin)
        if self.normal:
            program.set_proof_box(forces.cone_box(float(forces.limit.max()) + most))
        # More relief does not help; and as this bound is imposed, the box holds for every solution.
        s = program.columns("relief", low=0.0, high=most, box=(0.0, most), cost=1.0)
        up, down = self._torque_limit_relief(forces)
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

    def _torque_limit_relief(self, forces: ForceRows) -> tuple[FloatArray, FloatArray]:
        """(L,) coefficients of s in the upper and in the lower torque limits."""
        joints, relief = list(self.joints), np.zeros(len(forces.torque_rows))
        scale = forces.coordinates.joint_scale[joints]
        relief[joints] = scale.max(initial=0.0) / scale
        # A zero limit opposite a nonzero one is a direction without drive: it is not relaxed.
        problem = forces.problem
        zero_low, zero_high = problem.lower_torque == 0.0, problem.upper_torque == 0.0
        return relief * ~(zero_high & ~zero_low), relief * ~(zero_low & ~zero_high)


def _largest_relief(forces: ForceRows, margin: float) -> float:
    """Upper bound on the relief that any limit may need: ten times the sum of scaled figures."""
    finite = np.concatenate([forces.lower, forces.upper])
    relief = 10.0 * (
        2.0 + margin + float(np.abs(forces.boxes[-1]).sum() + np.abs(forces.wrench).sum())
    )
    relief += float(np.abs(finite[np.isfinite(finite)]).max(initial=0.0))
    return relief + float(np.abs(forces.torque_rows).sum())


_FORCES_SOUGHT = 1e3
"""Bound on forces without a limit, as a multiple of the largest given scaled figure."""


def largest_force_sought(forces: ForceRows, torques: FloatArray) -> float:
    """Return the largest normal force, over F, considered where forces have no limit.

    A thousand times the largest of load, normal-force limits, and torques over their joint's scale.
    """
    limit, tau = float(forces.limit.max()), contact_torques(forces, torques)
    return min(_FORCES_SOUGHT * max(1.0, limit, float(np.abs(tau).max(initial=0.0))), FARTHEST)


def contact_torques(forces: ForceRows, torques: FloatArray) -> FloatArray:
    """Return the (L,) torques of the contacts, motor torque minus gravity, over the joint scale.

    They are zero for joints that move no contact: their motors carry only their links.
    """
    problem = forces.problem
    net = np.where(bears_contacts(problem.jacobian), torques - problem.gravity_torques, 0.0)
    return net / forces.coordinates.joint_scale


_MARGIN_WEIGHT = 0.1
"""Weight of a margin of one load relative to a depth of one joint scale."""


@dataclass(frozen=True, eq=False)
class AtTorques(Objective):
    """An objective with the motors' torques given.

    Attributes:
        base: The objective.
        torques: (L,) N m.
    """

    base: Objective
    torques: FloatArray
    name = "at given torques"

    def __post_init__(self) -> None:
        """Copy the attributes of the objective."""
        for name in ("maximizes", "required_margin", "regularization"):
            object.__setattr__(self, name, getattr(self.base, name))

    def build(self, program: ProgramBuilder) -> None:
        """Build the objective, and fix the torques."""
        self.base.build(program)
        program.held_torques(contact_torques(program.forces, self.torques))

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        """Return the unit of the objective."""
        return self.base.unit(problem, coordinates)

    @property
    def of_margin(self) -> bool:
        """Whether its value is the margin e, N."""
        return self.base.of_margin

    def with_figure(self, name: str, value: float) -> AtTorques:
        """Return it with a figure of the objective replaced."""
        return replace(self, base=self.base.with_figure(name, value))

    @property
    def cutoff(self) -> float:
        """Program value above which there is no solution."""
        return self.base.cutoff


@dataclass(frozen=True, eq=False)
class InsideHalfSpaces(Objective):
    """Torques deep inside half-spaces, up to a given depth; a larger margin is the second aim.

    Attributes:
        normals: (K, L) per N m; torques with normals @ torques <= sides are inside.
        sides: (K,).
        depth: Upper bound on the depth, in joint scales.
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
        reaches = [np.abs(rows) @ np.abs(box).max(axis=0) + np.abs(sides) for box in forces.boxes]
        depths = [float(reach.max(initial=0.0)) + self.depth for reach in reaches]
        d = program.columns(
            "depth", high=self.depth, cost=-1.0,
            box=(-depths[0], self.depth), whole_box=(-depths[-1], self.depth),
        )  # fmt: skip
        low = self.required_margin / unit
        highest = max(low, 0.5 * float(forces.limit.min()))
        e = program.columns("margin", low=low, box=(low, highest), cost=-_MARGIN_WEIGHT, unit=unit)
        program.balance()
        program.cones(e)
        program.normal_limits(e)
        program.torque_limits()
        program.rows("half-spaces", rows, sides, {d: np.ones(len(rows))})


@dataclass(frozen=True)
class LeastChange(Objective):
    """The balancing torques nearest to given ones: least sum of squared changes over limits.

    Attributes:
        torques: L given torques, N m (N).
        direction: L components; no change along it, in the norm scaled by the limits.
    """

    name = "least change"
    torques: tuple[float, ...]
    direction: tuple[float, ...]

    def build(self, program: ProgramBuilder) -> None:
        """Add the changes, whose squares are summed, and the rows of Algorithm 2.

        The minimum of the sum of squares is unique, and continuous in the squeeze; the largest
        change alone would leave the others undetermined, and torques would jump.
        """
        forces, scale = program.forces, program.forces.coordinates.joint_scale
        limits = np.minimum(
            np.maximum(np.abs(forces.problem.lower_torque), np.abs(forces.problem.upper_torque)),
            1e3 * scale,
        )
        share = scale / np.where(limits > 0.0, limits, scale)
        offset = forces.gravity - np.array(self.torques) / scale
        reach = [
            share * (np.abs(forces.torque_rows) @ box[1] + np.abs(offset)) for box in forces.boxes
        ]
        changes = program.columns(
            "changes", len(share), curvature=1.0, box=(-reach[0], reach[0]),
            whole_box=(-reach[-1], reach[-1]),
        )  # fmt: skip
        is_change = {changes: -np.eye(len(share))}
        program.equal("changes", share[:, None] * forces.torque_rows, -share * offset, is_change)
        # No change along the direction: the squeeze is the given one.
        row = share**2 * np.array(self.direction) / scale
        row = row / np.linalg.norm(row)
        program.equal("squeeze", (row @ forces.torque_rows)[None], np.array([-row @ offset]))
        program.balance()
        program.cones(0.0)
        program.normal_limits(0.0)
        program.torque_limits()
