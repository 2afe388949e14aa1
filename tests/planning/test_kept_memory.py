"""What a kept `Evaluation` costs: the memory of 200 of them, as tracemalloc counts it."""

import gc
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
from planning_scenes import example

from graspless_pin.compiled import core
from graspless_pin.planning import Evaluation, Evaluator
from graspless_pin.scene import Scene

MOST = 20_000 if core is not None else 22_000
"""Bytes; the numpy beside the loops keeps a little more."""
KEPT = 200


@pytest.fixture(scope="module")
def scene() -> Scene:
    return example("allegro_box_on_slope")


def cost(evaluate: Callable[[], Evaluation]) -> float:
    """Bytes per evaluation of many that are kept, with all that was made to answer them."""
    for _ in range(10):
        evaluate()
    gc.collect()
    tracemalloc.start()
    try:
        kept = [evaluate() for _ in range(KEPT)]
        for evaluation in kept:
            if evaluation.found:
                assert np.isfinite(evaluation.margin)
                assert np.isfinite(evaluation.torques).all()
        gc.collect()
        return tracemalloc.get_traced_memory()[0] / len(kept)
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("algorithm", "moved"), [("margin", "object"), ("torque", "both")])
def test_a_kept_evaluation_is_small(scene, algorithm, moved):
    evaluator = Evaluator(scene, algorithm=algorithm)
    rng = np.random.default_rng(0)
    home, pose = evaluator.configuration(), np.array(scene.object.T_world_object)
    uphill = pose[:3, 0].copy()

    def evaluate() -> Evaluation:
        q = home + 1e-4 * rng.uniform(-1.0, 1.0, len(home)) if moved != "object" else None
        T = None
        if moved != "hand":
            T = pose.copy()
            T[:3, 3] -= rng.uniform(0.0, 1e-4) * uphill
        return evaluator.evaluate(q, T)

    assert evaluate().found
    assert cost(evaluate) < MOST


def test_a_kept_evaluation_without_torques_is_small(scene):
    evaluator = Evaluator(scene, algorithm="torque", required_margin=20.0)
    home, rng = evaluator.configuration(), np.random.default_rng(0)

    def evaluate() -> Evaluation:
        return evaluator.evaluate(home + 1e-4 * rng.uniform(-1.0, 1.0, len(home)))

    evaluation = evaluate()
    assert evaluation.has_contacts
    assert not evaluation.found
    assert cost(evaluate) < MOST
