"""Many states at once, against a loop over `Evaluator.evaluate`: ratios of one run."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from tabulate import tabulate

from graspless_pin import Evaluator, load_scene

_SCENE = Path(__file__).parents[1] / "examples" / "allegro_box_on_slope.yaml"
_STATES = 100_000
_SHARE = 10
"""The loop and one worker do one state in so many in each round; the rounds take turns."""
_ROUNDS = 3
_STEP = 0.003
"""rad, root mean square over the joints, from one state of a path to the next."""
_TURN = 4
"""States until a path turns back."""
_SPREAD = 0.02
"""rad, half the range that each joint is drawn from where states are drawn."""


def many_states() -> str:
    """100 000 states of the Allegro hand, box and slope: along paths, and drawn at random."""
    evaluator = Evaluator(load_scene(_SCENE), algorithm="margin")
    families = {"paths": paths(evaluator, _STATES, _STEP),
                "paths, contacts stay": paths(evaluator, _STATES, 0.1 * _STEP),
                "random": drawn(evaluator, _STATES)}  # fmt: skip
    rows = [_row(name, evaluator, states) for name, states in families.items()]
    headers = [
        "states",
        "found",
        "loop us",
        "geometry us",
        "one worker us",
        "two workers us",
        "loop / one",
        "loop / two",
        "one / two",
    ]
    note = (
        f"{_STATES} states with two workers, {_STATES // _SHARE} otherwise; fastest of {_ROUNDS} "
        "rounds, by the clock; one and two workers warm. Geometry: the state and `problem()` in a "
        "loop. Aims: loop / two at least 6 along paths and 4 at random; one / two at least 1.7."
    )
    return f"## Many states\n\n{tabulate(rows, headers, tablefmt='github')}\n\n{note}"


def _row(name: str, evaluator: Evaluator, states: np.ndarray) -> list[str]:
    some = states[: _STATES // _SHARE]
    found = evaluator.evaluate_many(states, workers=2).found.mean()
    evaluator.evaluate_many(some, workers=1)
    looped = Evaluator(evaluator.scene, algorithm="margin")
    ways: list[tuple[Callable[[], object], int]] = [
        (lambda: [looped.evaluate(q).margin for q in some], len(some)),
        (lambda: [_geometry(looped, q) for q in some], len(some)),
        (lambda: evaluator.evaluate_many(some, workers=1), len(some)),
        (lambda: evaluator.evaluate_many(states, workers=2), len(states)),
    ]
    rounds = [[_seconds(call) / count for call, count in ways] for _ in range(_ROUNDS)]
    loop, geometry, one, two = np.min(rounds, axis=0).tolist()
    times = [f"{1e6 * value:.1f}" for value in (loop, geometry, one, two)]
    ratios = [f"{ratio:.1f}" for ratio in (loop / one, loop / two, one / two)]
    return [name, f"{100 * found:.0f} %", *times, *ratios]


def _geometry(evaluator: Evaluator, q: np.ndarray) -> None:
    try:
        evaluator.scene_at(q).problem()
    except ValueError:  # a state without a problem
        return


def _seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def paths(evaluator: Evaluator, count: int, step: float) -> np.ndarray:
    """(count, a) configurations along paths from the scene's in random directions and back."""
    rng = np.random.default_rng(0)
    home = evaluator.configuration()
    directions = rng.normal(size=(-(-count // (2 * _TURN)), len(home)))
    directions *= step / np.sqrt(np.mean(directions**2, axis=1, keepdims=True))
    far = np.concatenate([np.arange(_TURN), np.arange(_TURN, 0, -1)])
    walked = home + far[:, None] * directions[:, None]
    return np.clip(walked.reshape(-1, len(home))[:count], *evaluator.joint_limits)


def drawn(evaluator: Evaluator, count: int) -> np.ndarray:
    """(count, a) configurations at random about the scene's."""
    rng = np.random.default_rng(1)
    home = evaluator.configuration()
    offsets = rng.uniform(-_SPREAD, _SPREAD, (count, len(home)))
    return np.clip(home + offsets, *evaluator.joint_limits)
