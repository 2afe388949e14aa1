"""Example scenes for the tests of planning, and small changes of their states."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from graspless_pin.planning import Evaluator
from graspless_pin.planning.state_solver import StateSolver
from graspless_pin.scene import load_scene

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@cache
def example(name: str) -> Any:
    """A scene that is known to have a hand."""
    return load_scene(EXAMPLES / f"{name}.yaml")


def with_hybrid_finger(name: str, folder: Path) -> Any:
    """The scene whose first finger is under hybrid control."""
    data = yaml.safe_load((EXAMPLES / f"{name}.yaml").read_text(encoding="utf-8"))
    data["hand"]["control"] = {"finger_1": "hybrid"}
    file = folder / "scene.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return load_scene(file)


def nearby(evaluator: Evaluator, rng: np.random.Generator, spread: float) -> np.ndarray:
    """A configuration near the scene's, within the limits."""
    q = evaluator.configuration()
    lower, upper = evaluator.joint_limits
    return np.clip(q + rng.normal(0.0, spread, len(q)), lower, upper)


def turned(T: np.ndarray, angle: float, axis=(0.0, 1.0, 0.0), point=(0.0, 0.0, 0.0)) -> np.ndarray:
    """A pose after a turn about a fixed axis through a point, rad and m."""
    move = np.eye(4)
    move[:3, :3] = Rotation.from_rotvec(angle * np.asarray(axis)).as_matrix()
    move[:3, 3] = np.asarray(point) - move[:3, :3] @ np.asarray(point)
    return move @ T


def shifted(T: np.ndarray, step) -> np.ndarray:
    moved = np.array(T)
    moved[:3, 3] += step
    return moved


def solved_alone(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What is added to as states are solved by a search, and not by loops."""
    alone: list[Any] = []
    solved = StateSolver.solve
    monkeypatch.setattr(
        StateSolver, "solve", lambda *a, **how: alone.append(a) or solved(*a, **how)
    )
    return alone
