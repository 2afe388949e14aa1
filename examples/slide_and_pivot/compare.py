"""Slide and pivot planned by each planner whose library is installed: smallest margins."""

import importlib
import time

import numpy as np
from task import GOAL, START, Task

PLANNERS = {"ompl": "with_ompl", "drake": "with_drake", "torch": "with_torch"}


def rows(task):
    """Yield (planner, states, smallest margin in N, seconds) of each; None in place of states."""
    yield "straight line", np.array([START, GOAL]), 0.0
    for name, module in PLANNERS.items():
        try:
            plan = importlib.import_module(module).plan
        except ImportError as error:
            print(f"{name}: left out ({error})")
            continue
        began = time.perf_counter()
        yield name, plan(task), time.perf_counter() - began


def main():
    task = Task()
    print("planner         states   smallest margin   planned in")
    for name, states, seconds in rows(task):
        if states is None:
            print(f"{name:<14}  no path")
            continue
        margin = task.smallest_margin(task.waypoints(states))
        print(f"{name:<14}  {len(states):6d}   {margin:13.3f} N   {seconds:8.1f} s")


if __name__ == "__main__":
    main()
