"""States with pinned contacts on a line, and their figures from evaluators of changed scenes."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm
from tests.oracles.pinned_states import pins_of

from graspless_pin import Evaluator, load_scene, maximize_margin, minimize_torque
from graspless_pin.programs.objectives import Algorithm

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES, PAGE = ROOT / "examples", ROOT / "docs" / "planning.md"


def generators() -> np.ndarray:
    """(6, 4, 4) of the rigid motions, in world axes about the world's origin."""
    found = np.zeros((6, 4, 4))
    found[[0, 1, 2], [0, 1, 2], 3] = 1.0
    found[3:, :3, :3] = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2)
    return found


class Steps(NamedTuple):
    """A start and a direction in which all inputs change at once.

    Attributes:
        evaluator: With pins.
        start: (a,) positions, (6,) screw before the scene's pose, (B,) coefficients and mass.
        way: Likewise.
    """

    evaluator: Evaluator
    start: tuple[np.ndarray, ...]
    way: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, name: str, seed: int, algorithm: str = "margin") -> Steps:
        """Near the state of an example, at rest."""
        scene = load_scene(EXAMPLES / f"{name}.yaml").with_changes(motion=None)
        evaluator = Evaluator(scene, pins=pins_of(scene), algorithm=algorithm, collisions=False)
        rng, q = np.random.default_rng(seed), evaluator.configuration()
        low, high = evaluator.joint_limits
        count = len(dict.fromkeys(evaluator.pinned().bodies))
        start = (
            np.clip(q + rng.normal(0.0, 0.01, len(q)), low + 1e-3, high - 1e-3),
            rng.normal(0.0, 0.002, 6),
            rng.uniform(0.6, 0.8, count),
            np.array(rng.uniform(0.9, 1.1) * scene.object.mass),
        )
        return cls(evaluator, start, tuple([rng.normal(size=one.shape) for one in start]))

    def at(self, step: float) -> tuple[np.ndarray, ...]:
        """Inputs of the operators after a step; their second is a pose."""
        q, screw, friction, mass = (
            one + step * way for one, way in zip(self.start, self.way, strict=True)
        )
        pose = (
            expm(np.tensordot(screw, generators(), 1)) @ self.evaluator.scene.object.T_world_object
        )
        return q, pose, friction, mass

    def rows(self, *steps: float) -> list[np.ndarray]:
        """Inputs after some steps, with a leading axis of these; their second is a screw."""
        return [
            np.array([one + step * way for step in steps])
            for one, way in zip(self.start, self.way, strict=True)
        ]

    def solved(self, step: float, mode: Any) -> np.ndarray:
        """(1 + P + L,) optimum in a mode, gaps and torques, of a scene of its own."""
        q, pose, friction, mass = self.at(step)
        own, scene = self.evaluator, self.evaluator.scene
        table = dict(zip(dict.fromkeys(own.pinned().bodies), friction.tolist(), strict=True))
        changed = scene.with_changes(
            friction=table,
            object=replace(scene.object, mass=float(mass)),
            supports=tuple([replace(one, friction=table[one.name]) for one in scene.supports]),
        )
        fresh = Evaluator(changed, pins=pins_of(scene)).scene_at(q, pose)
        problem, gaps = fresh.problem(), own.pinned(q, pose).gaps
        if own.algorithm is Algorithm.MARGIN:
            found = maximize_margin(problem, mode=mode)
            return np.hstack([found.margin, gaps, found.torques])
        found = minimize_torque(problem, margin=own.required_margin, mode=mode)
        return np.hstack([found.max_torque, gaps, found.torques])


def page_example(module: str) -> None:
    """Run the one block of the page on planning that imports a module."""
    blocks = re.findall(r"(?ms)^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"))
    (block,) = [one for one in blocks if f"from {module} import" in one]
    exec(compile(block, str(PAGE), "exec"), {})  # noqa: S102 - our own text
