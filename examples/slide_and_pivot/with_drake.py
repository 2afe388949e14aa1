"""Slide and pivot with Drake: direct transcription, solved by SNOPT.

Needs the extra ``drake``. See ``task.py``.
"""

# Drake may be missing, and its types of arrays are not numpy's.
# pyright: reportMissingImports=false, reportArgumentType=false, reportCallIssue=false

from itertools import pairwise

import numpy as np
from pydrake.autodiffutils import (
    ExtractGradient,
    ExtractValue,
    InitializeAutoDiff,
)
from pydrake.solvers import (
    MathematicalProgram,
    SnoptSolver,
)
from task import GOAL, LOWER, PINS, START, UNITS, UPPER, Task

from graspless_pin import Evaluator
from graspless_pin.interfaces.drake import PinnedFunctions

STAGES = 5  # equal steps of the slide, and as many of the pivot
SMOOTHNESS = 0.01  # N per square of a step in UNITS


def state(progress, palm):
    return np.array([progress, *(UNITS[1:] * palm)])


def to_state(task, progress):
    """From lift and pitch, in UNITS, to joints with their derivatives, and to the box's pose."""

    def found(palm):
        values = ExtractValue(palm).ravel() if palm.dtype == object else palm
        at = state(progress, values)
        q = task.joints(at)
        if q is not None and palm.dtype == object:
            rates = task.joint_rates(at)[:, 1:] * UNITS[1:]
            q = InitializeAutoDiff(q, rates @ ExtractGradient(palm))[:, 0]
        return None if q is None else (q, task.box(progress).np)

    return found


def plan(task, stages=STAGES):
    """(K, 3) states from START to GOAL with the largest smallest margin; None: none is found."""
    evaluator = Evaluator(task.scene, algorithm="margin", pins=PINS)
    program, way = MathematicalProgram(), np.linspace(0.0, 2.0, 2 * stages + 1)
    palms = program.NewContinuousVariables(len(way), 2, "palm")
    smallest = program.NewContinuousVariables(1, "smallest")  # N
    program.AddLinearCost(-smallest[0])
    guess = np.linspace(START[1:], GOAL[1:], len(way)) / UNITS[1:]
    for k, progress in enumerate(way):
        fixed = k in (0, len(way) - 1)
        low, high = [guess[k] if fixed else bound / UNITS[1:] for bound in (LOWER[1:], UPPER[1:])]
        program.AddBoundingBoxConstraint(low, high, palms[k])
        # The slide is the same all along; where it ends, both motions count.
        slides, pivots = [0.0] if progress <= 1.0 else [], [progress] if progress >= 1.0 else []
        for twist in map(task.box_rate, slides + pivots):
            optimum = PinnedFunctions(evaluator, to_state(task, progress), twist=twist).optimum
            program.AddConstraint(
                lambda x, optimum=optimum: optimum(x[:2]) - x[2:],
                [0.0],
                [np.inf],
                np.append(palms[k], smallest),
            )
    steps = 2.0 * SMOOTHNESS * np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(2))
    for both in pairwise(palms):
        program.AddQuadraticCost(steps, np.zeros(4), np.concatenate(both))
    program.SetInitialGuess(palms, guess)
    program.SetInitialGuess(smallest, np.zeros(1))
    found = SnoptSolver().Solve(program)
    if not found.is_success():
        return None
    return np.array([state(*one) for one in zip(way, found.GetSolution(palms), strict=True)])


def main():
    task = Task()
    states = plan(task)
    if states is None:
        raise SystemExit("SNOPT found no path")
    print(f"{len(states)} states; {task.smallest_margin(task.waypoints(states)):.3f} N at least")


if __name__ == "__main__":
    main()
