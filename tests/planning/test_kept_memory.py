"""What a kept `Evaluation` costs: the memory of 100 of them, as tracemalloc counts it."""

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
KEPT = 100


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


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("algorithm", "moved", "required"),
    [("margin", "object", 0.0), ("torque", "both", 0.0), ("torque", "hand", 20.0)],
)
def test_a_kept_evaluation_is_small(scene, algorithm, moved, required):
    """With torques, and without where none bear the margin."""
    evaluator = Evaluator(scene, algorithm=algorithm, margin=required)
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

    evaluation = evaluate()
    assert evaluation.has_contacts and evaluation.found == (required == 0.0)
    assert cost(evaluate) < MOST
