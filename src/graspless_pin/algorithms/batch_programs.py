"""The programs of compiled loops: the objectives and options they cover, and what programs share.

Loops assemble the paper's programs on their own, in `compiled/paper_programs.pxi`. The data that
all states with the same contacts share are passed to them once, as a `ProgramStructure`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from graspless_pin.algorithms.options import Search, SolveOptions
from graspless_pin.compiled import core
from graspless_pin.modes.kinematics import THRESHOLD
from graspless_pin.modes.rules import StaticFriction, required_contacts
from graspless_pin.modes.virtual_motions import CLEARLY, GUESSES, witness_criteria
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, JointUnit, read_only
from graspless_pin.problem.cone_model import ConeModel, Section
from graspless_pin.problem.scales import LEAST_DIFFERENCE, LEAST_LEVER, LEAST_LIMIT, MOST_STRICT
from graspless_pin.programs.active_set import CORRECTIONS, DAMPING, EXACT
from graspless_pin.programs.forces import ForceLayout, face_rows, layout_of, unit_force_bounds
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare
from graspless_pin.programs.program import FARTHEST
from graspless_pin.solvers import ANY_SOLVER, PRIMAL_TOLERANCE

PAPER_OBJECTIVES = (Margin, Torque, TorqueShare)
"""Objectives that compiled loops assemble, in the order of their kinds in `compiled.core`."""


@dataclass(frozen=True, eq=False)
class ProgramStructure:
    """Data shared by the programs of all problems whose contacts have the same cones.

    Attributes:
        layout: Layout of the force coordinates.
        face_count: Number of side faces of all cones.
        reach: (2, n) see `unit_force_bounds`.
        sides: (n + 1, s) transposed rows of the margin e: d^T f + e of each face with normal d,
            n^T f + e of each contact, and -n^T f + e of each contact without a cone.
        friction: (M,) coefficients.
        section: The regular section of their cones.
    """

    layout: ForceLayout
    face_count: int
    reach: FloatArray
    sides: FloatArray
    friction: FloatArray
    section: Section

    def has_rows_of(self, other: ProgramStructure) -> bool:
        """Whether the programs of both have the same rows, whatever the coefficients of friction.

        Then the active set of one applies to the other. Compared by content, as which objects are
        cached depends on what was solved before.
        """
        own, others = self.layout, other.layout
        return self is other or (
            self.face_count == other.face_count
            and own.size == others.size
            and (own is others or own.cones.tobytes() == others.cones.tobytes())
        )


def structure_of(
    problem: QuasistaticProblem, friction: FloatArray | None = None
) -> ProgramStructure:
    """Return the structure of a problem with pyramids for cones: one object for equal problems.

    Args:
        problem: The problem.
        friction: (M,) other coefficients, above zero where the problem's are; None: its own.
    """
    coefficients = problem.friction if friction is None else friction
    return _structure(problem.has_cone.tobytes(), coefficients.tobytes(), problem.cone_section)


@lru_cache(maxsize=256)
def _structure(mask: bytes, friction: bytes, section: Section) -> ProgramStructure:
    layout = layout_of(mask)
    cones = face_rows(layout, np.frombuffer(friction)[layout.cones], section)
    n, normal = layout.size, layout.normal_rows
    parts = [cones.rows, normal, -normal[layout.without_cone]]
    sides = np.ones((sum(map(len, parts)), n + 1), order="F")
    sides[:, :-1] = np.concatenate(parts)
    return ProgramStructure(
        layout, len(cones.rows), unit_force_bounds(mask, friction), read_only(sides.T),
        read_only(np.frombuffer(friction)), section,
    )  # fmt: skip


def may_begin(problem: QuasistaticProblem, options: SolveOptions) -> bool:
    """Whether loops may look for an optimum without a warm start."""
    rules = options.rules
    return bool(
        options.solver == ANY_SOLVER
        and options.search is Search.AUTO
        and rules.static_friction is not StaticFriction.COULOMB
        and not required_contacts(problem, rules).any()
    )


def loops_cover(cone: ConeModel, objective: Objective, options: SolveOptions) -> bool:
    """Return whether loops cover the cones, the objective and the options."""
    return not (
        core is None
        or not cone.regular
        or type(objective) not in PAPER_OBJECTIVES
        or objective.regularization > 0.0
        or options.strong
        or options.rules.by_direction
    )


@lru_cache(maxsize=192)
def loops_of(
    loops_class: str,
    structure: ProgramStructure,
    objective: Objective,
    units: tuple[JointUnit, ...],
) -> Any:
    """Return loops of a class of `compiled.core`; cached by the arguments.

    Args:
        loops_class: Name of the class.
        structure: Data shared by the problems.
        objective: One of the paper's.
        units: (L,) units of the joints' torques.
    """
    kinds = core.MARGIN, core.TORQUE, core.SHARE
    return getattr(core, loops_class)(
        kind=kinds[PAPER_OBJECTIVES.index(type(objective))],
        required=objective.required_margin,
        turns=[unit is JointUnit.TORQUE for unit in units],
        axes=structure.layout.axes,
        sides=structure.sides,
        face_count=structure.face_count,
        reach=structure.reach,
        has_cone=~structure.layout.without_cone,
        friction=structure.friction,
        slopes=structure.friction * structure.section.distances[0],
        directions=structure.section.directions,
        least_lever=LEAST_LEVER,
        rounding=LEAST_DIFFERENCE,
        farthest=FARTHEST,
        least_limit=LEAST_LIMIT,
        most_strict=MOST_STRICT,
        guesses=GUESSES,
        judged_by=witness_criteria(CLEARLY * THRESHOLD),
        damping=DAMPING,
        corrections=CORRECTIONS,
        exact=EXACT,
        close=PRIMAL_TOLERANCE,
        cutoff=objective.cutoff,
    )
