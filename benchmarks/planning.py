"""The evaluator of many states: against loading each state, and in bare LP solves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from benchmarks.programs import bare_solve, relaxed_program
from benchmarks.timing import Timer, medians, timed
from graspless_pin import load_scene, maximize_margin
from graspless_pin.planning import Evaluator

_EXAMPLES = Path(__file__).parents[1] / "examples"
_SCENES = (
    "two_hands_slide_crate",
    "allegro_box_on_slope",
    "trihand_pivot_box",
    "paper/cuboid_at_rest",
    "paper/cuboid_sliding_up",
)
_PATHS = 4
_STATES = 8
_STEP = 0.003
"""rad, root mean square over the joints, from one state to the next on a path."""


def evaluator() -> str:
    """`Evaluator.evaluate` of Algorithm 1 along paths on which all joints move."""
    rows = [_row(name) for name in _SCENES]
    headers = [
        "scene",
        "fresh us",
        "evaluate us",
        "fresh / evaluate",
        "geometry us",
        "bare LP us",
        "(evaluate - geometry) / bare LP",
        "is_feasible us",
    ]
    note = (
        f"Medians over {_PATHS * _STATES} states on {_PATHS} straight paths. Fresh: `load_scene`, "
        "the state, `problem()` and `maximize_margin`; geometry: the state and `problem()`; bare "
        "LP: PIQP, set-up included. The aims are 3 and 2."
    )
    return f"## Evaluator\n\n{tabulate(rows, headers, tablefmt='github')}\n\n{note}"


def _row(name: str) -> list[str]:
    path = _EXAMPLES / f"{name}.yaml"
    warm = Evaluator(load_scene(path), algorithm="margin")
    states = _states(warm)
    programs = [relaxed_program(warm.scene_at(q).problem()) for q in states]
    margin = 0.5 * warm.evaluate().margin

    def fresh(q: np.ndarray) -> float:
        scene = load_scene(path)
        hand = scene.hand
        if hand is None:
            raise ValueError("the scene has no hand")
        named = dict(zip(warm.joint_names, q.tolist(), strict=True))
        return maximize_margin(
            scene.with_changes(hand=hand.with_configuration(named)).problem()
        ).margin

    timers: list[Timer] = [
        _warm(fresh, states),
        _warm(lambda q: warm.evaluate(q).margin, states),
        _warm(lambda q: warm.scene_at(q).problem(), states),
        _warm(bare_solve, programs),
        _warm(lambda q: warm.is_feasible(q, margin=margin), states),
    ]
    loaded, ours, geometry, lp, decided = medians(timers, budget=2.0)
    return [
        name,
        f"{1e6 * loaded:.0f}",
        f"{1e6 * ours:.0f}",
        f"{loaded / ours:.1f}",
        f"{1e6 * geometry:.0f}",
        f"{1e6 * lp:.0f}",
        f"{(ours - geometry) / lp:.1f}",
        f"{1e6 * decided:.0f}",
    ]


def _warm(call: Callable[[Any], object], items: Sequence[Any]) -> Timer:
    """A function that takes the median over items, once the processor's caches are warm again."""

    def measure() -> float:
        for item in items:
            call(item)
        return float(np.median([timed(partial(call, item)) for item in items]))

    return measure


def _states(warm: Evaluator) -> list[np.ndarray]:
    """Configurations in which torques are found, there and back along paths from the scene's."""
    rng = np.random.default_rng(0)
    lower, upper = warm.joint_limits
    home = warm.configuration()
    states: list[np.ndarray] = []
    while len(states) < _PATHS * _STATES:
        step = rng.normal(size=len(home))
        step *= _STEP / np.sqrt(np.mean(step**2))
        there = [np.clip(home + k * step, lower, upper) for k in range(_STATES // 2 + 1)]
        if all(warm.evaluate(q).found for q in there):
            states += there + there[-2:0:-1]
    return states
