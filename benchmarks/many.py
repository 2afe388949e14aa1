"""Many states at once, against a loop over `Evaluator.evaluate`: ratios of one run."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from tabulate import tabulate

from graspless_pin import Evaluator, Scene, load_scene
from graspless_pin.scene.batch_states import BatchContactFinder

_SCENE = Path(__file__).parents[1] / "examples" / "allegro_box_on_slope.yaml"
_STATES = 100_000
_SHARE = 10
"""One worker does one state in so many in each round; the rounds take turns."""
_LOOPED = 50
"""The loop does one state in so many."""
_ROUNDS = 3
_STEP = 0.003
"""rad, root mean square over the joints, from one state of a path to the next."""
_TURN = 4
"""States until a path turns back."""
_SPREAD = 0.02
"""rad, half the range that each joint is drawn from where states are drawn."""
_DRAWS = 200_000
"""Configurations that are drawn of each finger, of which those are kept that touch."""
_MILLION = 1_000_000


def many_states() -> str:
    """100 000 states of the Allegro hand, box and slope: along paths, at random, and cold."""
    evaluator = _evaluator(load_scene(_SCENE))
    walked, stayed = (paths(evaluator, _STATES, step) for step in (_STEP, 0.1 * _STEP))
    families = {
        "paths": walked,
        "paths, contacts stay": stayed,
        "random": drawn(evaluator, _STATES),
        "cold": cold(evaluator, _STATES),
    }
    rows = [_row(name, evaluator, states) for name, states in families.items()]
    headers = ["states", "found", "loop us", "one worker us", "two workers us"]
    headers += ["geometry us", "beside it us", "checked us", "loop / one", "loop / two"]
    headers += ["one / two", "checked / one"]
    note = (
        f"{_STATES} states with two workers, {_STATES // _SHARE} with one (cold: with two, too), "
        f"{_STATES // _LOOPED} in a loop; fastest of {_ROUNDS} rounds, by the clock; evaluators "
        "have seen states like these before, but for the cold ones, which are uniform over the "
        "joint limits of each finger where it touches. Geometry: kinematics, weight and contacts, "
        "on one core; what else one worker does is beside it. Only what one worker does in the "
        "column 'checked' looks for hands off the object, in supports or in themselves. Aims: loop "
        "/ two at least 6 along paths, and 4 for cold states; one / two at least 1.7; checked / "
        "one at most 2; beside the geometry at most 15 us where contacts stay. Memory for "
        f"{_MILLION} states beyond what is given and returned: "
        f"{_megabytes(evaluator, 1):.0f} MB in one process; with two workers "
        f"{_megabytes(evaluator, 2):.0f} MB, theirs included (aim: 300)."
    )
    return f"## Many states\n\n{tabulate(rows, headers, tablefmt='github')}\n\n{note}"


def _evaluator(scene: Scene, *, checked: bool = False) -> Evaluator:
    return Evaluator(scene, algorithm="margin", collisions=checked, need_hand=checked)


def _row(name: str, evaluator: Evaluator, states: np.ndarray) -> list[str]:
    some, few = states[: _STATES // _SHARE], states[: _STATES // _LOOPED]
    cold_ones = name == "cold"
    all_of_them = some if cold_ones else states
    found = evaluator.evaluate_many(few).found.mean()
    checking = _evaluator(evaluator.scene, checked=True)
    checking.evaluate_many(few)

    def own(checked: bool = False) -> Evaluator:
        if cold_ones:
            return _evaluator(evaluator.scene, checked=checked)
        return checking if checked else evaluator

    def loop() -> None:
        one = own()
        for q in few:
            _ = one.evaluate(q).margin

    hand = BatchContactFinder(evaluator.scene, collisions=False)
    ways: list[tuple[Callable[[], object], int]] = [
        (loop, len(few)),
        (lambda: hand.contacts_at(some), len(some)),
        (lambda: own().evaluate_many(some, workers=1), len(some)),
        (lambda: own().evaluate_many(all_of_them, workers=2), len(all_of_them)),
        (lambda: own(checked=True).evaluate_many(some, workers=1), len(some)),
    ]
    seconds = np.full(len(ways), np.inf)
    for _ in range(1 if cold_ones else _ROUNDS):
        for k, (call, count) in enumerate(ways):
            start = time.perf_counter()
            call()
            seconds[k] = min(seconds[k], (time.perf_counter() - start) / count)
    looped, geometry, one, two, checked = seconds.tolist()
    each = looped, one, two, geometry, one - geometry, checked
    times = [f"{1e6 * value:.1f}" for value in each]
    ratios = [f"{ratio:.1f}" for ratio in (looped / one, looped / two, one / two, checked / one)]
    return [name, f"{100 * found:.0f} %", *times, *ratios]


def _megabytes(evaluator: Evaluator, workers: int) -> float:
    """Most memory, MB, that many states take beyond what is given and returned."""
    states = paths(evaluator, _MILLION, 0.1 * _STEP)
    process, most, ended = psutil.Process(), 0.0, threading.Event()

    def taken() -> float:
        own = process.memory_info().rss
        return own + sum(child.memory_full_info().uss for child in process.children())

    def watch() -> None:
        nonlocal most
        while not ended.wait(0.02):
            most = max(most, taken())

    before = process.memory_info().rss
    watcher = threading.Thread(target=watch)
    watcher.start()
    found = evaluator.evaluate_many(states, workers=workers)
    ended.set()
    watcher.join()
    arrays = (found.statuses, found.margins, found.torques, found.contact_counts, found.bounds)
    returned = sum(array.nbytes for array in (*arrays, found.gaps, found.residuals))
    return (most - before - returned) / 1e6


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


def cold(evaluator: Evaluator, count: int) -> np.ndarray:
    """(count, a) configurations, uniform over the limits, of fingers that touch where they can.

    Each finger is drawn by itself, with the others at the scene's configuration and what does not
    touch, or overlaps, thrown away; states put such fingers together at random.
    """
    rng, (lower, upper) = np.random.default_rng(2), evaluator.joint_limits
    hand: Any = evaluator.scene.hand
    loops: Any = BatchContactFinder(evaluator.scene)
    home = evaluator.configuration()
    shapes = hand.tree.shapes.names
    states = rng.uniform(lower, upper, (count, len(home)))
    carriers, _ = hand.tree.shape_placements
    for tip in (k for k, name in enumerate(shapes) if name.endswith("_tip")):
        own = np.flatnonzero(hand.tree.supports[carriers[tip]])
        q = np.tile(home, (_DRAWS, 1))
        q[:, own] = rng.uniform(lower[own], upper[own], (_DRAWS, len(own)))
        found = loops.at(q)
        places = np.arange(found.shapes.shape[1]) < found.counts[:, None]
        touching = q[((found.shapes == tip) & places).any(axis=1)]
        if len(touching):
            states[:, own] = touching[rng.integers(len(touching), size=count)][:, own]
    return states
