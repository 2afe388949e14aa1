"""Time the rows that two versions of the package are compared by: ``python -m benchmarks.rows``.

This runs in a fresh process of either version, so it uses the public interface only. What a version
lacks is left out and said so. The output is one JSON object: see `main`.
"""

from __future__ import annotations

import json
import platform
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.timing import as_new

Pass = Callable[[], float]
"""Does a row's work once and returns its seconds of processor time, which what else runs on the
machine changes little."""

EXAMPLES = Path(__file__).parents[1] / "examples"
PAPER = ("sphere_on_slope", "cuboid_at_rest", "cuboid_sliding_up", "cuboid_sliding_down")
POSED = "allegro_box_on_slope"
WALKED = (POSED, "two_hands_slide_crate", "trihand_pivot_box", "paper/cuboid_at_rest")
JUDGED = ("paper/sphere_on_slope", "paper/cuboid_at_rest", "trihand_pivot_box")
SIZES = (6, 12, 24)
SEEDS = 20
"""Scenes of a row: which of several equally good forces a solver finds first is luck, and may cost
one of them three further programs."""
POSES = 20
STEP = 0.003
"""rad, the root mean square over the joints from one state to the next, or the step of a pose."""
SAMPLES = (8, 8)
BUDGET = 0.2
"""Seconds to spend on a row of one process."""
LEAST_PASSES, MOST_PASSES = 3, 200

STUDY = """\
name: a small study
scene: {scene}
vary:
  friction.default: {{from: 0.2, to: 0.7, steps: {frictions}}}
  object.mass: {{from: 0.5, to: 2.0, steps: {masses}}}
compute:
  algorithm: margin
"""


def main() -> None:
    """Print what was measured, as JSON.

    ``seconds`` by row, ``missing``: why a row or group has none, ``package``: where it was loaded
    from, ``loops``: whether they are compiled, ``versions`` of Python and of all distributions.
    """
    seconds: dict[str, float] = {}
    missing: dict[str, str] = {}
    for name, group in GROUPS.items():
        try:
            for row, measure in group():
                try:
                    seconds[row] = fastest(measure)
                except Exception as error:  # another version may fail in any way
                    missing[row] = _reason(error)
        except Exception as error:
            missing[name] = _reason(error)
    print(json.dumps({"seconds": seconds, "missing": missing, **_about()}))


def fastest(measure: Pass, budget: float = BUDGET) -> float:
    """Seconds of the fastest of several passes: what else runs on a machine only adds time."""
    measure()
    spent: list[float] = []
    while len(spent) < MOST_PASSES and (len(spent) < LEAST_PASSES or sum(spent) < budget):
        spent.append(measure())
    return min(spent)


def paper_rows() -> Iterator[tuple[str, Pass]]:
    """The paper's scenes: solved again, and the first call on a new problem object."""
    from graspless_pin import load_scene

    for name in PAPER:
        problem = load_scene(EXAMPLES / "paper" / f"{name}.yaml").problem()
        for number, solve in _algorithms().items():
            title = f"{name.replace('_', ' ')}, algorithm {number}"
            yield f"{title}, again", partial(_busy, partial(solve, problem))
            yield f"{title}, first call", partial(_first_calls, solve, [problem])


def random_rows() -> Iterator[tuple[str, Pass]]:
    """Random scenes, the first call on each."""
    from tests.core.random_scenes import general_scene, slope_scene

    families: dict[str, Callable[[int, int], Any]] = {
        "fingers of 3 or 4 joints": partial(general_scene, joints=(3, 4)),
        "fingers of 2 to 4 joints": general_scene,
        "box on a slope": slope_scene,
    }
    for family, make in families.items():
        for contacts in SIZES:
            problems = [make(seed, contacts) for seed in range(SEEDS)]
            for number, solve in _algorithms().items():
                row = f"{SEEDS} random scenes, {family}, {contacts} contacts, algorithm {number}"
                yield row, partial(_first_calls, solve, problems)


def posed_rows() -> Iterator[tuple[str, Pass]]:
    """`Scene.problem()` of scenes that were only just posed."""
    from graspless_pin import Evaluator, load_scene

    scene = load_scene(EXAMPLES / f"{POSED}.yaml")
    evaluator = Evaluator(scene)
    hand, names = scene.hand, evaluator.joint_names
    if hand is None:
        raise ValueError("the scene has no hand")
    home = evaluator.configuration()
    rng = np.random.default_rng(0)
    states = [home + rng.uniform(-1e-4, 1e-4, len(home)) for _ in range(POSES)]
    uphill = np.array(scene.object.T_world_object[:3, 0])
    boxes = []
    for _ in states:
        T = np.array(scene.object.T_world_object)
        T[:3, 3] -= rng.uniform(0.0, 1e-4) * uphill
        boxes.append(scene.object.with_pose(T))

    def hands() -> list[Any]:
        """Hands of which nothing is known yet: what one keeps of its pose is part of the work."""
        named = [dict(zip(names, q.tolist(), strict=True)) for q in states]
        return [hand.with_configuration(q) for q in named]

    def moved() -> float:
        posed = [scene.with_changes(hand=item) for item in hands()]
        return _busy(lambda: [item.problem() for item in posed])

    def both() -> float:
        pairs = zip(hands(), boxes, strict=True)
        posed = [scene.with_changes(hand=item, object=box) for item, box in pairs]
        return _busy(lambda: [item.problem() for item in posed])

    yield f"{POSES} times Scene.problem(), the hand moved", moved
    yield f"{POSES} times Scene.problem(), hand and object moved", both


def evaluator_rows() -> Iterator[tuple[str, Pass]]:
    """A warm `Evaluator` along a path there and back."""
    from graspless_pin import Evaluator, load_scene

    for name in WALKED:
        warm = Evaluator(load_scene(EXAMPLES / f"{name}.yaml"), algorithm="margin")
        lower, upper = warm.joint_limits
        home = warm.configuration()
        step = np.random.default_rng(0).normal(size=len(home))
        step *= STEP / np.sqrt(np.mean(step**2))
        there = [np.clip(home + k * step, lower, upper) for k in range(5)]
        states = there + there[-2:0:-1]
        margin = 0.5 * warm.evaluate().margin
        title = f"{len(states)} states of {name.rpartition('/')[2].replace('_', ' ')}"
        yield f"{title}, evaluate", partial(_each, warm.evaluate, states)
        yield (
            f"{title}, is_feasible",
            partial(_each, partial(warm.is_feasible, margin=margin), states),
        )


def verdict_rows() -> Iterator[tuple[str, Pass]]:
    """Verdicts on torques: by a certificate alone, by loads of fingers, and by branching."""
    from graspless_pin import load_scene, stability

    for name in JUDGED:
        scene = load_scene(EXAMPLES / f"{name}.yaml")
        problem, torques = scene.problem(), scene.solve("margin").torques
        title = f"{name.rpartition('/')[2].replace('_', ' ')}, verdict"
        yield title, partial(_busy, partial(stability, problem, torques))


def study_rows() -> Iterator[tuple[str, Pass]]:
    """A small study in this process, from its file to its table."""
    from graspless_pin import load_study, run_study

    scene = EXAMPLES / "paper" / "cuboid_at_rest.yaml"
    text = STUDY.format(scene=scene, frictions=SAMPLES[0], masses=SAMPLES[1])

    def study() -> float:
        with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
            file, output = Path(folder, "study.yaml"), Path(folder, "out.csv")
            file.write_text(text, encoding="utf-8")
            options = {"executor": executor, "workers": 1, "progress": False}
            return _busy(lambda: run_study(load_study(file), output, **options))

    yield f"a study of {SAMPLES[0] * SAMPLES[1]} samples", study


GROUPS: dict[str, Callable[[], Iterator[tuple[str, Pass]]]] = {
    "the paper's scenes": paper_rows,
    "random scenes": random_rows,
    "posed scenes": posed_rows,
    "the evaluator": evaluator_rows,
    "verdicts": verdict_rows,
    "a study": study_rows,
}


def _algorithms() -> dict[int, Callable[[Any], object]]:
    from graspless_pin import maximize_margin, minimize_torque

    return {1: maximize_margin, 2: partial(minimize_torque, margin=0.1)}


def _first_calls(solve: Callable[[Any], object], problems: Sequence[Any]) -> float:
    fresh = [as_new(problem) for problem in problems]
    return _busy(lambda: [solve(problem) for problem in fresh])


def _each(call: Callable[[Any], object], items: Sequence[Any]) -> float:
    return _busy(lambda: [call(item) for item in items])


def _busy(call: Callable[[], object]) -> float:
    """Seconds of processor time that one call takes."""
    start = time.process_time()
    call()
    return time.process_time() - start


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".splitlines()[0][:200]


def _about() -> dict[str, Any]:

    try:
        from graspless_pin import compiled

        loops = compiled.core is not None
    except (ImportError, AttributeError):
        loops = False
    installed = {item.name: item.version for item in distributions()}
    return {
        "loops": loops,
        "versions": {"Python": platform.python_version(), **installed},
    }


if __name__ == "__main__":
    main()
