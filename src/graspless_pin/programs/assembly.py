"""From an objective to its program; what programs of the same structure share, for the batch."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.compiled import core
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.cone_model import Section
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.problem.scales import (
    LEAST_DIFFERENCE,
    LEAST_LEVER,
    LEAST_LIMIT,
    MOST_STRICT,
)
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.cones import ForceLayout, face_rows, layout_of, reach_of
from graspless_pin.programs.forces import ForceCoordinates, force_coordinates, force_rows
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare
from graspless_pin.programs.program import FARTHEST, Program

PAPER_OBJECTIVES = (Margin, Torque, TorqueShare)
"""Those that compiled loops assemble."""


class ScaledProgram(NamedTuple):
    """A program with what turns its figures into the problem's.

    Attributes:
        coordinates: Force coordinates and scales.
        program: The program without modes.
        unit: What one of its value is in the objective's own unit, positive.
    """

    coordinates: ForceCoordinates
    program: Program
    unit: float


def scaled_program(
    problem: QuasistaticProblem, objective: Objective, coordinates: ForceCoordinates | None = None
) -> ScaledProgram:
    """Return the program of an objective, block by block, without (27) and (31), with its scales.

    Args:
        problem: The problem.
        objective: What is optimised.
        coordinates: The problem's, scaled by its load; None: they are made.
    """
    margin = objective.required_margin
    if coordinates is None or (margin > 0.0 and not problem.external_wrench.any()):
        coordinates = force_coordinates(problem, margin)
    unit = objective.unit(problem, coordinates)
    builder = ProgramBuilder(force_rows(problem, coordinates))
    objective.build(builder)
    return ScaledProgram(coordinates, builder.program(), unit)


@dataclass(frozen=True, eq=False)
class ProgramStructure:
    """What problems share whose contacts have the same cones and slide alike.

    Attributes:
        layout: Where the force coordinates stand.
        face_count: Side faces of all cones.
        reach: (2, n) see `cone_reach`.
        sides: (n + 1, s) transposed rows x + e of faces, n^T f + e and, without a cone, -n^T f + e.
        friction: (M,) coefficients.
        section: Of their cones, a regular one.
    """

    layout: ForceLayout
    face_count: int
    reach: FloatArray
    sides: FloatArray
    friction: FloatArray
    section: Section

    def has_rows_of(self, other: ProgramStructure) -> bool:
        """Whether the programs of both have the same rows, whatever the coefficients of friction.

        Then what is active in one may be in the other. It is told by content: which objects are
        remembered depends on what was solved before.
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
    """Return what a problem with pyramids for cones shares with those like it: the same object.

    Args:
        problem: The problem.
        friction: (M,) other coefficients, above zero where its are; None: its own.
    """
    rubbing = problem.friction if friction is None else friction
    mask, sliding = problem.has_cone.tobytes(), problem.is_sliding.tobytes()
    return _structure(mask, rubbing.tobytes(), sliding, problem.cone_section)


@lru_cache(maxsize=256)
def _structure(mask: bytes, friction: bytes, _sliding: bytes, section: Section) -> ProgramStructure:
    layout = layout_of(mask)
    cones = face_rows(layout, np.frombuffer(friction)[layout.cones], section)
    n, normal = layout.size, layout.picks
    parts = [cones.rows, normal, -normal[layout.without_cone]]
    sides = np.ones((sum(map(len, parts)), n + 1), order="F")
    sides[:, :-1] = np.concatenate(parts)
    return ProgramStructure(
        layout, len(cones.rows), reach_of(mask, friction), read_only(sides.T),
        read_only(np.frombuffer(friction)), section,
    )  # fmt: skip


def shared_arguments(
    structure: ProgramStructure, objective: Objective, units: tuple[JointUnit, ...]
) -> dict[str, Any]:
    """Return what `compiled.core` takes for one of the paper's objectives."""
    kinds = core.MARGIN, core.TORQUE, core.SHARE
    return {
        "kind": kinds[[type(objective) is kind for kind in PAPER_OBJECTIVES].index(True)],
        "required": objective.required_margin,
        "turns": [unit is JointUnit.TORQUE for unit in units],
        "axes": structure.layout.axes,
        "sides": structure.sides,
        "face_count": structure.face_count,
        "reach": structure.reach,
        "has_cone": ~structure.layout.without_cone,
        "friction": structure.friction,
        "slopes": structure.friction * structure.section.distances[0],
        "directions": structure.section.directions,
        "least_lever": LEAST_LEVER,
        "rounding": LEAST_DIFFERENCE,
        "farthest": FARTHEST,
        "least_limit": LEAST_LIMIT,
        "most_strict": MOST_STRICT,
    }
