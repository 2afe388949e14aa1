"""Slide and pivot with OMPL: RRTConnect asks an evaluator which motions keep the margin.

Needs the extra ``ompl``. See ``task.py``.
"""

import numpy as np
from ompl import base, geometric, util
from task import GOAL, LOWER, START, UNITS, UPPER, Task

from graspless_pin import Evaluator
from graspless_pin.interfaces.ompl import attach_evaluator

REQUIRED = 0.72  # N
MOST_QUESTIONS = 20_000  # whether to go on, before giving up


def values(state):
    return np.array([state[k] for k in range(3)]) * UNITS


def slide_ends(start, end):
    """Where a motion's pivot begins, as a fraction of it."""
    first, last = state_ends = values(start)[0], values(end)[0]
    return [(1.0 - first) / (last - first)] if min(state_ends) < 1.0 < max(state_ends) else []


def plan(task, margin=REQUIRED, seed=1):
    """(K, 3) states of a path from START to GOAL that keeps a margin; None: none is found."""
    util.noOutputHandler()
    util.RNG.setSeed(seed)
    space, bounds = base.RealVectorStateSpace(3), base.RealVectorBounds(3)
    for k, (low, high) in enumerate(zip(LOWER / UNITS, UPPER / UNITS, strict=True)):
        bounds.setLow(k, low)
        bounds.setHigh(k, high)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(0.02)
    evaluator = Evaluator(task.scene, algorithm="margin")
    attach_evaluator(
        setup,
        evaluator,
        lambda state: task.configuration(values(state)),
        margin=margin,
        resolution=(0.002, 0.02),
        breakpoints=slide_ends,
    )
    ends = []
    for state in (START, GOAL):
        ends.append(space.allocState())
        for k, value in enumerate(state / UNITS):
            ends[-1][k] = value
    setup.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(information)
    planner.setRange(0.5)
    setup.setPlanner(planner)
    asked = 0

    def enough():  # a count ends the search, not a clock: the same seed gives the same path
        nonlocal asked
        asked += 1
        return asked > MOST_QUESTIONS

    setup.solve(base.PlannerTerminationCondition(enough))
    if not setup.haveExactSolutionPath():
        return None
    path = setup.getSolutionPath()
    simplifier = geometric.PathSimplifier(information)
    for _ in range(4):
        simplifier.partialShortcutPath(path, 15, 15)
        simplifier.reduceVertices(path, 10, 10)
    return np.array([values(state) for state in path.getStates()])


def main():
    task = Task()
    states = plan(task)
    if states is None:
        raise SystemExit(f"no path found that keeps {REQUIRED} N; try another seed")
    print(f"{len(states)} states; {task.smallest_margin(task.waypoints(states)):.3f} N at least")


if __name__ == "__main__":
    main()
