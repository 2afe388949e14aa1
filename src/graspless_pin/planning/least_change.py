"""Torques of joints that follow others: the least change that keeps balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.builder import ProgramBuilder
from graspless_pin.programs.objectives import Objective

_REST = SolveOptions.parse(static_friction=StaticFriction.COULOMB)
_FRICTION_USED = 0.9
"""Of the coefficients: what joints that follow let contacts use, where balance leaves them that."""
_SHARE_HALVINGS = 8


@dataclass(frozen=True)
class _LeastChange(Objective):
    """The torques of balance that are nearest to given ones, in squares of shares of limits."""

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


def torques_that_follow(
    problem: QuasistaticProblem, torques: FloatArray, held: NDArray[np.bool_], direction: FloatArray
) -> FloatArray:
    """Return torques of balance with those of some joints held; as they are where none balance.

    The least change alone would use up the friction of some contact: a reserve is kept if it can.

    Args:
        problem: The problem; its torque limits are kept.
        torques: (L,) that balance may change, N m (N).
        held: (L,) joints whose torques stay.
        direction: (L,) along which nothing changes, in the norm scaled by the limits.
    """
    lower, upper = problem.lower_torque.copy(), problem.upper_torque.copy()
    lower[held] = upper[held] = torques[held]
    least = _LeastChange((*torques.tolist(),), (*direction.tolist(),))

    def within(share: float) -> FloatArray | None:
        friction = share * problem.friction
        changed = problem.with_changes(torque_limits=(lower, upper), friction=friction)
        solution = solve_problem(changed, least, _REST)
        return np.where(held, torques, solution.torques) if solution.found else None

    found = within(_FRICTION_USED)
    if found is not None:
        return found
    found, (low, high) = within(1.0), (_FRICTION_USED, 1.0)
    if found is None:
        return torques
    for _ in range(_SHARE_HALVINGS):  # the least share, so that torques do not jump
        middle = 0.5 * (low + high)
        nearer = within(middle)
        low, high = (middle, high) if nearer is None else (low, middle)
        found = found if nearer is None else nearer
    return found
