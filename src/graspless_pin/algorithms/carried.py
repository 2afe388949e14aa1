"""The optimum of a state that is like one before: carried over and certified, by loops alone.

Where the same constraints are active, the same mode admits the friction and the same motion is
behind it, a state is answered by a handful of compiled loops on plain arrays, and no record is made
on the way. What they find is checked just as the answer of a solver is; where it does not pass,
nothing is said, and a search begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.compiled import contact_frames, linear_programs, virtual_motions
from graspless_pin.modes.kinematics import THRESHOLD
from graspless_pin.modes.nearest_motions import CLEARLY, judged_by
from graspless_pin.modes.rules import Rules, SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.scales import LEAST_DIFFERENCE, LEAST_LEVER
from graspless_pin.programs.active_set import EXACT, ActiveSet, refined_arrays
from graspless_pin.programs.assembly import Likeness, likeness_of, paper_arrays
from graspless_pin.programs.forces import ForceCoordinates
from graspless_pin.programs.layout import ForceLayout
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare
from graspless_pin.programs.program import FARTHEST, LARGEST_IN_C, LinearArrays
from graspless_pin.solution import Certificate, Evidence, Status, TorqueSolution

_KINDS = (Margin, Torque, TorqueShare)
_WITNESS = judged_by(CLEARLY * THRESHOLD)


@dataclass(frozen=True, eq=False)
class WarmStart:
    """What a search leaves behind for those of similar problems with the same contacts.

    Attributes:
        mode: The best mode; None: no mode was found.
        relaxation: What is active at the optimum of the program without modes; None: not known.
        in_mode: Likewise of the mode's own program.
        motion: A virtual motion behind the mode, scaled; None: not at hand.
        likeness: What the problem shares with those like it; None: the optimum cannot be carried
            over by loops alone, as cones are round, or the mode's own program was needed or leaves
            signs open.
    """

    mode: SlidingMode | None = None
    relaxation: ActiveSet | None = None
    in_mode: ActiveSet | None = None
    motion: FloatArray | None = None
    likeness: Likeness | None = None


class Carried(NamedTuple):
    """The optimum of a problem over all feasible modes, carried over from another and certified.

    Attributes:
        forces: (M, 3) contact forces, N.
        unit: Factor from the program's value to the objective's; negative if it is maximised.
        reach: See `Certificate.force_reach`.
        x: (n,) the solution of the scaled program, as the mode admits it.
        value: Of the scaled program.
        bound: What the multipliers prove of it.
        residual: Largest violation of a constraint, scaled.
        multipliers: (R,) of all rows.
        motion: A virtual motion behind the mode, scaled.
        scale: Factors from that to m/s and rad/s.
    """

    forces: FloatArray
    unit: float
    reach: float
    x: FloatArray
    value: float
    bound: float
    residual: float
    multipliers: FloatArray
    motion: FloatArray
    scale: FloatArray

    @property
    def gap(self) -> float:
        """Distance between the optimum and its proven bound, in the objective's unit."""
        return (self.value - self.bound) * abs(self.unit)


def carried(
    problem: QuasistaticProblem,
    objective: Objective,
    options: SolveOptions,
    starts: Sequence[WarmStart],
) -> tuple[Carried, int] | None:
    """Return the optimum of a problem if what is active, the mode and the motion are as before.

    Args:
        problem: The problem; only its arrays are read.
        objective: What is optimised.
        options: How the problem is solved.
        starts: What similar problems left behind, the most promising first.

    Returns:
        The optimum, proven like any other, and the place of what it was carried over from; None
        where none serves, more than the best case is asked for, or nothing was compiled.
    """
    if (
        linear_programs is None
        or not starts
        or type(objective) not in _KINDS
        or objective.regularization > 0.0
        or (objective.required_margin > 0.0 and not problem.external_wrench.any())
        or problem.is_round
        or options.strong
        or options.rules.by_direction
    ):
        return None
    likeness, most = likeness_of(problem), problem.max_normal_force
    force, length, joints = contact_frames.scales(
        problem.positions, problem.external_wrench, problem.jacobian, most, LEAST_LEVER,
        LEAST_DIFFERENCE,
    )  # fmt: skip
    directions = contact_frames.force_directions(
        problem.normals, problem.tangents, problem.friction, problem.sliding, problem.has_cone
    )
    coordinates = ForceCoordinates(directions, likeness.layout, force, joints, length)
    arrays, box, _ = paper_arrays(objective, problem, coordinates, likeness)
    reach = max(most.tolist())
    if reach > FARTHEST * force or arrays[0].size > LARGEST_IN_C:
        return None
    for place, start in enumerate(starts):
        if start.likeness is not None and start.likeness.has_rows_of(likeness):
            found = _optimum(problem, arrays, box, objective.cutoff, likeness.layout, start)
            if found is not None:
                unit = objective.unit(problem, coordinates)
                unit = -unit if objective.maximizes else unit
                reach = min(reach, FARTHEST * force)
                own = contact_frames.forces(found[0], likeness.layout.axes, directions, force)
                return Carried(own, unit, reach, *found), place
    return None


def _optimum(
    problem: QuasistaticProblem,
    arrays: LinearArrays,
    box: FloatArray,
    cutoff: float,
    layout: ForceLayout,
    start: WarmStart,
) -> tuple[Any, ...] | None:
    """Return the last attributes of `Carried`, if an earlier optimum leads to them."""
    near, mode, motion = start.relaxation, start.mode, start.motion
    if near is None or mode is None or motion is None or len(near.x) != len(arrays[0]):
        return None
    refined = refined_arrays(arrays, near)
    if refined is None:
        return None
    x, _, multipliers = refined
    x = contact_frames.without_forbidden(x, layout.friction[None], layout.cones, mode.signs)
    y, z = multipliers[:6], multipliers[6:]
    bound, value, residual = linear_programs.judged(*arrays, box, x, y, z)
    if not max(residual, abs(value - bound)) <= EXACT * max(1.0, abs(value)):
        return None
    if value > cutoff:
        return None
    effects = contact_frames.contact_map(
        problem.positions, problem.normals, problem.tangents, problem.jacobian
    )
    map_of_motions, scale = virtual_motions.scaled_map(effects)
    if len(motion) != len(scale):
        return None
    if mode.contacts:
        seen = virtual_motions.witness(
            map_of_motions, mode.contacts, mode.own_signs.ravel(), motion, 0, *_WITNESS
        )
        if seen is None:
            return None
        motion = seen[1]
    return x, value, bound, residual, multipliers, motion, scale


def solution_carried(
    problem: QuasistaticProblem,
    objective: Objective,
    rules: Rules,
    found: Carried,
    start: WarmStart,
) -> TorqueSolution:
    """Return a carried optimum as a solution.

    Args:
        problem: The problem.
        objective: What was optimised.
        rules: The reading of the virtual-sliding constraint.
        found: The optimum.
        start: What it was carried over from.
    """
    proof = found.multipliers[:6], found.multipliers[6:]
    certificate = Certificate(
        primal_residual=found.residual,
        duality_gap=found.value - found.bound,
        bound=found.bound * found.unit,
        gap=found.gap,
        infeasibility=0.0,
        force_reach=found.reach,
        modes_examined=1,
        nodes=1,
        force_programs=1,
        kinematic_programs=1,
        solver="" if start.relaxation is None else start.relaxation.solver,
    )
    found.forces.setflags(write=False)
    size = 0 if start.likeness is None else start.likeness.layout.size
    added = found.x[size:].copy()
    evidence = Evidence(proof, proof, added, None, found.scale * found.motion)
    return TorqueSolution(
        status=Status.OPTIMAL,
        objective=objective,
        rules=rules,
        certificate=certificate,
        problem=problem,
        evidence=evidence,
        _forces=found.forces,
        _mode=start.mode,
    )
