"""Small studies of the paper's cuboid, and an executor that computes on the spot."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import yaml

from graspless_pin.studies import Study, run_study

ROOT = Path(__file__).resolve().parents[2]
PAPER = ROOT / "examples" / "paper"
CUBOID = PAPER / "cuboid_at_rest.yaml"

SLOPE = {
    "from": 30,
    "to": 60,
    "steps": 3,
    "unit": "deg",
    "turn": {"what": "all", "axis": [0, 1, 0], "as_in_scene": 45},
}
HEIGHT = {
    "from": 120,
    "to": 150,
    "steps": 2,
    "unit": "mm",
    "move": {"what": "hand", "along": [0, 0, 1], "frame": "slope", "as_in_scene": 150},
}
FRICTION = {"from": 0.2, "to": 0.6, "steps": 3}


def data(vary: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    """The content of a study file of the cuboid at rest."""
    standard = {"height": HEIGHT, "slope": SLOPE, "friction.default": FRICTION}
    return {"scene": str(CUBOID), "vary": standard if vary is None else vary, **more}


def study(vary: dict[str, Any] | None = None, **more: Any) -> Study:
    return Study.from_data(data(vary, **more))


def study_file(folder: Path, content: dict[str, Any]) -> Path:
    file = folder / "study.yaml"
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return file


class Here(Executor):
    """Computes a chunk when it is submitted, and counts the samples."""

    def __init__(self, limit: int | None = None) -> None:
        self.samples: list[int] = []
        self.limit = limit

    def submit(self, fn, /, *args, **kwargs):
        future: Future[Any] = Future()
        samples = args[-1]
        if self.limit is not None and len(self.samples) + len(samples) > self.limit:
            future.set_exception(RuntimeError("pulled the plug"))
            return future
        self.samples += [number for number, _ in samples]
        future.set_result(fn(*args, **kwargs))
        return future


def run(made: Study, file: Any, here: Any = None, **options: Any) -> Any:
    """The table of a study that is computed on the spot."""
    return run_study(made, file, executor=here or Here(), progress=False, **options)
