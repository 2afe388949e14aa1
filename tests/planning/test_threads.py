"""What docs/threads.md promises: objects that threads may share give each what one alone gets.

`test_evaluator.py` does the same for an `Evaluator`, the tests of the viewer for a `Viewer`.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from tests.studies.study_tools import Here

from graspless_pin import (
    Hand,
    QuasistaticProblem,
    Scene,
    contact_force_bounds,
    disturbance_margin,
    load_scene,
    maximize_margin,
    minimize_torque,
    minimum_friction,
    run_study,
    settle,
)
from graspless_pin.studies import Study

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
THREADS = 4
DOWN = np.array([0.0, 0.0, -9.81])


@pytest.fixture(autouse=True)
def restless() -> Iterator[None]:
    """Switch between threads as often as can be."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-4)
    yield
    sys.setswitchinterval(before)


def assert_shared(make: Callable[[], Any], *uses: Callable[[Any], Any]) -> None:
    """All threads use one fresh object at once, each in another order, and agree with one alone.

    Fresh, because what an object remembers is worked out by whoever asks first.
    """
    alone = make()
    expected = [use(alone) for use in uses]
    shared = make()
    start = threading.Barrier(THREADS)

    def work(first: int) -> list[Any]:
        start.wait()
        order = [(first + step) % len(uses) for step in range(len(uses))]
        results = {index: uses[index](shared) for index in order}
        return [results[index] for index in range(len(uses))]

    with ThreadPoolExecutor(THREADS) as pool:
        for found in pool.map(work, range(THREADS)):
            for one, other in zip(found, expected, strict=True):
                np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def allegro() -> Scene:
    return load_scene(EXAMPLES / "allegro_box_on_slope.yaml")


def problem() -> QuasistaticProblem:
    """A problem whose derived values nobody has asked for."""
    return load_scene(EXAMPLES / "paper" / "cuboid_sliding_up.yaml").problem()


def test_a_problem_may_be_shared():
    assert_shared(
        problem,
        lambda shared: maximize_margin(shared).torques,
        lambda shared: minimize_torque(shared, 0.1).max_torque,
        lambda shared: minimum_friction(shared).factor,
        lambda shared: shared.with_changes(friction=0.4).W,
    )


def test_a_solution_may_be_shared():
    weak = problem().with_changes(torque_limits=(-0.01, 0.01))

    assert_shared(
        lambda: minimize_torque(problem(), 0.1),
        lambda shared: contact_force_bounds(shared.problem, shared.torques).largest_margin,
        lambda shared: disturbance_margin(shared.problem, shared.torques).magnitudes,
        lambda shared: shared.contact_torques,
        lambda shared: len(str(shared)),
    )
    assert_shared(lambda: maximize_margin(weak), lambda shared: len(shared.explanation))


def test_a_scene_may_be_shared():
    assert_shared(
        allegro,
        lambda shared: shared.solve().torques,
        lambda shared: shared.problem().jacobian,
        lambda shared: [point.position for point in shared.contacts.points],
        lambda shared: shared.with_changes(object=replace(shared.object, mass=0.7)).solve().margin,
        lambda shared: settle(shared).object.T_world_object,
    )


def test_a_hand_may_be_shared():
    steps = [0.01 * step for step in range(4)]

    def moved(shared: Hand, step: float) -> Hand:
        return shared.with_configuration({"joint_1.0": shared.q["joint_1.0"] + step})

    assert_shared(
        lambda: allegro().hand,
        *(lambda shared, step=step: moved(shared, step).gravity_torques(DOWN) for step in steps),
        *(
            lambda shared, step=step: [
                body.T_world_geometry for body in moved(shared, step).collision_bodies()
            ]
            for step in steps
        ),
    )


def test_a_study_may_be_shared(tmp_path):
    content = {
        "scene": str(EXAMPLES / "paper" / "cuboid_at_rest.yaml"),
        "vary": {"friction.default": {"from": 0.2, "to": 0.6, "steps": 3}},
    }
    study = Study.from_data(content)
    assert_shared(
        lambda: Study.from_data(content),
        *(lambda shared, n=n: shared.scene_at(shared.samples[n]).solve().margin for n in range(3)),
    )

    def run(name: str) -> pd.DataFrame:
        return run_study(study, tmp_path / f"{name}.parquet", executor=Here(), progress=False)

    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(run, "ab")
    pd.testing.assert_frame_equal(first, second)
    one, two = ((tmp_path / f"{name}.parquet").read_bytes() for name in "ab")
    assert one == two
