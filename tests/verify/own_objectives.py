"""Objectives that are none of the paper's: those of the documentation, and one that uses it all."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tests.core.scenes import scene

from graspless_pin import Objective, ProgramBuilder, QuasistaticProblem, optimize
from graspless_pin.programs.forces import ForceCoordinates

_PAGE = Path(__file__).parents[2] / "docs" / "objectives.md"


def _documented() -> dict[str, Any]:
    """The classes that the page defines, as they stand there."""
    code = re.findall(r"```python title[^\n]*\n(.*?)```", _PAGE.read_text(), re.DOTALL)
    names: dict[str, Any] = {"__name__": "page"}
    exec(compile("\n".join(code), str(_PAGE), "exec", dont_inherit=True), names)  # noqa: S102
    return names


_CLASSES = _documented()
SquaredShares = _CLASSES["SquaredShares"]
WeightedMargin = _CLASSES["WeightedMargin"]


@dataclass(frozen=True)
class Helped(Objective):
    """The least help in the balance and overload of the first joint, with a little of all forces.

    It has columns in the balance, rows with two sides of some joints, weights in its constant
    margins and no torque limits.
    """

    required_margin: float = 0.05
    help_costs: float = 2.0
    regularization: float = 1e-3
    name = "helped"

    def build(self, program: ProgramBuilder) -> None:
        forces = program.forces
        margin = self.required_margin / forces.coordinates.force_scale
        weights = np.linspace(1.0, 1.5, len(forces.normal_rows))
        help_ = program.columns(
            "help", 2, low=[-2.0, 0.0], high=np.inf, box=([-2.0, 0.0], [20.0, 20.0]),
            curvature=self.help_costs, unit=forces.coordinates.force_scale,
        )  # fmt: skip
        over = program.columns("overload", low=0.0, box=(0.0, 1e3), cost=1.0)
        push = np.zeros((len(forces.balance_rows), 2))
        push[0, 0] = push[2, 1] = 1.0
        program.balance({help_: push})
        program.cones(margin, weights)
        program.normal_limits(margin, weights)
        first = np.array([0])
        program.rows(
            "first", forces.torque_rows[first], 0.1 + forces.gravity[first], {over: -1.0},
            low=np.array([-3.0]), unit=forces.coordinates.joint_scale[first],
            shape=(len(forces.torque_rows),), places=first,
        )  # fmt: skip
        program.regularize(self.regularization)

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        return 3.0 * coordinates.force_scale


@dataclass(frozen=True)
class LargestOf(Objective):
    """Algorithm 2, written as a user would: t is above each torque and its negative."""

    required_margin: float = 0.1
    name = "largest of"

    def build(self, program: ProgramBuilder) -> None:
        forces = program.forces
        margin = self.required_margin / forces.coordinates.force_scale
        t = program.columns("largest", box=(-1e3, 1e3), cost=1.0)
        program.balance()
        program.cones(margin)
        program.normal_limits(margin)
        program.torque_limits()
        scale = forces.coordinates.joint_scale
        for name, sign in (("up", 1.0), ("down", -1.0)):
            torque, side = (
                sign * scale[:, None] * forces.torque_rows,
                -sign * scale * forces.gravity,
            )
            program.rows(name, torque, side, {t: -1.0})


@dataclass(frozen=True)
class LeastSideways(Objective):
    """The smallest possible largest friction along t2, in rows of single force components."""

    name = "least sideways"

    def build(self, program: ProgramBuilder) -> None:
        forces = program.forces
        largest = program.columns("largest", low=0.0, box=(0.0, 1e3), cost=1.0)
        program.balance()
        program.cones(0.0)
        program.normal_limits(0.0)
        program.torque_limits()
        along = np.eye(forces.size)[forces.coordinates.tangent_columns[:, 1]]
        for name, sign in (("up", 1.0), ("down", -1.0)):
            program.rows(name, sign * along, np.zeros(len(along)), {largest: -1.0})

    def unit(self, problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
        return coordinates.force_scale


LIMITED = {"torque_limits": ([-3.0, -7.0], [2.0, 11.0]), "gravity_torques": [0.4, -0.2]}
WEIGHTS = (2.0, 1.0, 1.0, 1.0, 1.0, 1.0)
SOLUTIONS = {
    "squared shares": lambda: optimize(scene("rest"), SquaredShares(0.1)),
    "of uneven limits": lambda: optimize(scene("rest").with_changes(**LIMITED), SquaredShares(0.1)),
    "weighted margin": lambda: optimize(scene("rest"), WeightedMargin(WEIGHTS)),
    "helped": lambda: optimize(scene("rest"), Helped()),
    "helped down": lambda: optimize(scene("down"), Helped(), sign_rule="exact"),
    "coulomb": lambda: optimize(scene("rest"), SquaredShares(0.1), static_friction="coulomb"),
    "in a mode": lambda: optimize(
        scene("rest"), SquaredShares(0.1), mode=optimize(scene("rest"), SquaredShares(0.1)).mode
    ),
    "infeasible forces": lambda: optimize(scene("rest"), SquaredShares(40.0)),
    "infeasible modes": lambda: optimize(
        scene("up"), WeightedMargin(WEIGHTS), sliding_rule="constrained"
    ),
}
"""A solution of each kind."""
