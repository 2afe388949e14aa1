"""Studies of the paper's cuboid beside a plain loop over Algorithm 1, of this version or another.

``python -m benchmarks.study_loops`` prints samples a second of the loops, in a fresh process of
either version, so this uses the public interface only.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.timing import as_new

EXAMPLES = Path(__file__).parents[1] / "examples"
LOOPED = 200
"""Samples that a loop solves: every so many of a study."""
PASSES = 3

_STEPS = {"scale": "linear", "steps": 20}
STUDIES: dict[str, dict[str, Any]] = {
    "friction, slope and finger height": {
        "height": {
            "from": 60, "to": 180, "steps": 20, "unit": "mm",
            "move": {"what": "hand", "along": [0, 0, 1], "frame": "slope", "as_in_scene": 150},
        },
        "slope": {
            "from": 20, "to": 60, "steps": 20, "unit": "deg",
            "turn": {"what": "all", "axis": [0, 1, 0], "as_in_scene": 45},
        },
        "friction.default": {"from": 0.1, "to": 0.8, "steps": 25},
    },
    "friction, mass and an effort limit": {
        "object.mass": {"from": 0.5, "to": 2.0, "steps": 20},
        "hand.effort_limits.finger_1/hinge": {"from": 5.0, "to": 20.0, "steps": 20},
        "friction.default": {"from": 0.1, "to": 0.8, "steps": 25},
    },
}  # fmt: skip
"""What varies, on grids of 10 000 samples."""


def main() -> None:
    """Print samples a second of a loop over `maximize_margin`, problems ready, by study."""
    print(json.dumps({name: loop_rate(name) for name in STUDIES}))


def study_of(name: str) -> Any:
    """One of the studies."""
    from graspless_pin.studies import Study

    data = {"scene": "paper/cuboid_at_rest.yaml", "vary": STUDIES[name]}
    return Study.from_data({**data, "compute": {"algorithm": "margin"}}, EXAMPLES)


def loop_rate(name: str) -> float:
    """Samples a second of the fastest of several passes, in one process."""
    from graspless_pin import maximize_margin

    study = study_of(name)
    some = study.samples[:: len(study.samples) // LOOPED]
    problems = [study.scene_at(sample).problem() for sample in some]
    rates = []
    for _ in range(PASSES):
        fresh = [as_new(problem) for problem in problems]
        start = time.perf_counter()
        for problem in fresh:
            maximize_margin(problem)
        rates.append(len(fresh) / (time.perf_counter() - start))
    return max(rates)


def study_rate(name: str, workers: int) -> float:
    """Samples a second of a whole study, its processes being there."""
    from benchmarks.studies import Counted
    from graspless_pin.studies import run_study
    from graspless_pin.studies.executors import local_processes

    study, rates = study_of(name), []
    processes = local_processes(workers)
    try:
        for _ in range(PASSES):
            with tempfile.TemporaryDirectory() as folder:
                options = {"executor": Counted(processes), "workers": workers, "progress": False}
                start = time.perf_counter()
                run_study(study, Path(folder) / "out.parquet", **options)
                rates.append(len(study.samples) / (time.perf_counter() - start))
    finally:
        processes.close()
    return max(rates)


if __name__ == "__main__":
    main()
