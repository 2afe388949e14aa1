"""Hold the gradients of pinned contacts against differences of full solves: `make pinned`.

Configurations and poses are drawn around those of example scenes, so that gaps and overlaps of
millimetres come about. Each figure is solved anew in the state's mode at both ends of steps in
random directions.
What is marked as a kink, or has one within the step, is counted, and not compared.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin import Evaluator, Scene, load_scene, maximize_margin, minimize_torque
from graspless_pin.geometry import BodyKind

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCENES = (
    "allegro_box_on_slope",  # spheres on a box that lies on a slope
    "allegro_sphere_on_slope",  # spheres on a sphere
    "trihand_pivot_box",  # a box on an edge
    "panda_slide_cuboid_up_slope",  # faces on faces, a joint that follows another
    "paper/cuboid_at_rest",  # two robots of one joint
)
ALGORITHMS = ("margin", "torque")
STEP = 1e-5
DIRECTIONS = 3
"""Of joints and pose together, drawn for each state."""
SPREAD_Q, SPREAD_X, SPREAD_TURN = 0.03, 0.003, 0.03  # rad, m, rad
BEND = 0.02
"""Of the largest derivative: where the slopes before and after differ by more, there is a kink."""
WORST = {"gaps": 1e-4, "optimum": 0.5 * BEND, "torques": 0.5 * BEND}
"""Of the largest derivative: the solver's gap over the step, and what a smaller kink makes."""


def pins_of(scene: Scene) -> list[tuple[str, str]]:
    """Return a pin for each pair that touches; faces of links stay on the links."""
    arrays = scene.contacts.arrays
    kinds = dict(zip(arrays.bodies, arrays.kinds, strict=True))
    own = scene.object.name
    return [(body, own) if kind is BodyKind.HAND else (own, body) for body, kind in kinds.items()]


def displaced(scene: Scene, T: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """The object's pose after a twist about its centre of mass, m and rad."""
    center = scene.object.with_pose(T).center_of_mass_world
    turn = Rotation.from_rotvec(twist[3:]).as_matrix()
    moved = np.array(T)
    moved[:3, :3] = turn @ T[:3, :3]
    moved[:3, 3] = turn @ (T[:3, 3] - center) + center + twist[:3]
    return moved


def figures(evaluator: Evaluator, q: np.ndarray, T: np.ndarray, mode: Any) -> dict[str, Any]:
    """Gaps of a state, and where torques are found in a mode the optimum and them."""
    state = evaluator.pinned(q, T)
    found = {"gaps": state.gaps}
    if mode is None or not state.evaluation.has_contacts:
        return found
    problem = state.evaluation.scene.problem()
    if evaluator.algorithm == "margin":
        solution = maximize_margin(problem, mode=mode)
    else:
        solution = minimize_torque(problem, margin=evaluator.required_margin, mode=mode)
    if solution.found:
        best = solution.margin if evaluator.algorithm == "margin" else solution.max_torque
        found |= {"optimum": np.array(best), "torques": solution.torques}
    return found


def compared(name: str, algorithm: str, count: int, seed: int = 0) -> tuple[Counter, dict]:
    """Return how many derivatives were compared or marked, and the largest deviation of each kind.

    Args:
        name: The example.
        algorithm: Of the evaluator.
        count: States.
        seed: Of the draw.
    """
    scene = load_scene(EXAMPLES / f"{name}.yaml").with_changes(motion=None)
    evaluator = Evaluator(scene, pins=pins_of(scene), algorithm=algorithm, collisions=False)
    rng, counts, worst = np.random.default_rng(seed), Counter(), dict.fromkeys(WORST, 0.0)
    start, (lower, upper) = evaluator.configuration(), evaluator.joint_limits
    size = len(start)
    spread = np.array([SPREAD_X] * 3 + [SPREAD_TURN] * 3)
    for _ in range(count):
        q = np.clip(start + rng.normal(0.0, SPREAD_Q, size), lower + 1e-4, upper - 1e-4)
        T = displaced(scene, scene.object.T_world_object, rng.normal(size=6) * spread)
        state = evaluator.pinned(q, T)
        mode, told = None, {"gaps": state.by_gaps}
        if state.evaluation.found:
            mode = state.evaluation.solution.mode
            told |= {"optimum": state.by_optimum, "torques": state.by_torques}
        counts["states with torques"] += state.evaluation.found
        rows = {name: np.concatenate([one.q, one.pose], axis=-1) for name, one in told.items()}
        middle = figures(evaluator, q, T, mode)
        for way in rng.normal(size=(DIRECTIONS, size + 6)):
            ends = [
                figures(evaluator, q + step[:size], displaced(scene, T, step[size:]), mode)
                for step in (STEP * way, -STEP * way)
            ]
            for kind, derivatives in told.items():
                if any(kind not in end for end in (middle, *ends)):
                    counts[f"{kind} without torques beside"] += 1
                    continue
                slope = (ends[0][kind] - ends[1][kind]) / (2.0 * STEP)
                scale = max(float(np.abs(rows[kind]).max()), 1e-3)
                bend = np.abs(ends[0][kind] + ends[1][kind] - 2.0 * middle[kind]) / STEP
                straight = bend <= BEND * scale
                counts[f"{kind} with a kink within the step"] += int((~straight).sum())
                unique = derivatives.unique.all(axis=-1) & straight
                off = np.abs(rows[kind] @ way - slope)[unique]
                worst[kind] = max(worst[kind], float(off.max(initial=0.0)) / scale)
                counts[kind] += int(unique.sum())
                counts[f"{kind} marked"] += int((~derivatives.unique.all(axis=-1)).sum())
    return counts, worst


def main() -> None:
    """Compare states of all scenes and both algorithms; exit with 1 if any derivative is off."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("states", nargs="?", type=int, default=100, help="of each scene")
    count = parser.parse_args().states
    failed = False
    for name in SCENES:
        for algorithm in ALGORITHMS:
            counts, worst = compared(name, algorithm, count // len(ALGORITHMS))
            print(f"{name}, {algorithm}: {dict(counts)}; {worst}", flush=True)
            failed |= any(worst[kind] > limit for kind, limit in WORST.items())
    sys.exit(failed)


if __name__ == "__main__":
    main()
