"""No multipliers, however they are made up, prove more than the optimum."""

from typing import Any

import numpy as np
import pytest
from scenes import scene  # pyright: ignore[reportMissingImports] - tests/core, by conftest
from verified_documents import documented

from graspless_pin import maximize_margin, minimize_torque
from graspless_pin.report.verify.bounds import Multipliers, proven_bound, read_multipliers
from graspless_pin.report.verify.figures import read_forces, read_problem

COULOMB = {
    "margin": lambda: maximize_margin(scene("up"), static_friction="coulomb"),
    "torque": lambda: minimize_torque(scene("rest"), static_friction="coulomb"),
    "shares": lambda: minimize_torque(scene("down"), static_friction="coulomb", scale="limits"),
    "regularized": lambda: maximize_margin(
        scene("rest"), static_friction="coulomb", regularization=1e-2
    ),
}


def made_up(own: Multipliers, rng: np.random.Generator) -> dict[str, Any]:
    """Multipliers like others, larger, or with any number in some places."""
    factor = rng.choice([1.0, 1.001, 2.0, 1e3, 1e12])
    made = {key: factor * value for key, value in vars(own).items()}
    for key, value in made.items():
        if rng.random() < 0.3:
            made[key] = np.abs(value + factor * rng.normal(size=value.shape))
    contacts, faces = np.nonzero(made["faces"])
    listed = [
        [int(c), int(k), float(made["faces"][c, k])] for c, k in zip(contacts, faces, strict=True)
    ]
    return {key: value.tolist() for key, value in made.items()} | {"faces": listed}


@pytest.mark.parametrize("make", COULOMB.values(), ids=COULOMB)
def test_no_multipliers_prove_more_than_the_optimum(make):
    document = documented(make())
    problem = read_problem(document)
    forces = read_forces([c["force"] for c in document["contacts"]], problem, "forces")
    best, free = problem.objective(forces), np.ones((problem.count, 2, 2), dtype=bool)
    own = read_multipliers(document["proof"]["nodes"][0]["multipliers"], problem, "own")
    assert proven_bound(problem, own, free, 50.0) == pytest.approx(best, rel=1e-6)
    assert proven_bound(problem, own, free, 50.0, objective=False) <= 0.0
    rng = np.random.default_rng(3)
    for _ in range(200):
        m = read_multipliers(made_up(own, rng), problem, "made up")
        assert proven_bound(problem, m, free, 50.0) <= best + 1e-6 * problem.unit
        assert proven_bound(problem, m, free, 50.0, objective=False) <= 0.0
