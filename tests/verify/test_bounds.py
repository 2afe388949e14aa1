"""No multipliers, however they are made up, prove more than the optimum."""

from typing import Any

import numpy as np
import pytest
from own_objectives import SOLUTIONS
from tests.core.scenes import scene
from verified_documents import documented

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque, optimize
from graspless_pin.report.verify.bounds import proven_bound
from graspless_pin.report.verify.problem import Forces
from graspless_pin.report.verify.reading import read_problem, stated_multipliers

COULOMB = {
    "margin": lambda: maximize_margin(scene("up"), static_friction="coulomb"),
    "torque": lambda: minimize_torque(scene("rest"), 0.1, static_friction="coulomb"),
    "shares": lambda: minimize_torque(
        scene("down"), 0.1, static_friction="coulomb", scale="limits"
    ),
    "regularized": lambda: maximize_margin(
        scene("rest"), static_friction="coulomb", regularization=1e-2
    ),
}


OWN = ("squared shares", "of uneven limits", "weighted margin", "helped")


def made_up(stated: dict[str, Any], signed: set[str], rng: np.random.Generator) -> dict[str, Any]:
    """Multipliers like others, larger, or with any number in some places."""
    factor, made = rng.choice([1.0, 1.001, 2.0, 1e3, 1e12]), {}
    for key, values in stated.items():
        if key == "faces":
            made[key] = [[c, k, v * factor * rng.choice([0.5, 1.0, 2.0])] for c, k, v in values]
            continue
        flat = factor * np.array(values, dtype=float)
        if rng.random() < 0.3:
            flat = flat + factor * rng.normal(size=flat.shape)
        made[key] = (flat if key in signed else np.abs(flat)).tolist()
    return made


@pytest.mark.parametrize("name", [*COULOMB, *OWN])
def test_no_multipliers_prove_more_than_the_optimum(name):
    if name in OWN:
        own = SOLUTIONS[name]()
        document = documented(optimize(own.problem, own.objective, static_friction="coulomb"))
    else:
        document = documented(COULOMB[name]())
    problem = read_problem(document)
    columns, blocks = (problem.own.values, problem.own.rows.blocks) if problem.own else (None, ())
    rows = np.array([contact["force"] for contact in document["contacts"]])
    best = problem.objective(Forces(problem, rows, columns))
    free = np.ones((problem.count, 2, 2), dtype=bool)
    stated = document["proof"]["nodes"][0]["multipliers"]
    own = stated_multipliers(stated, problem, "own")
    assert proven_bound(problem, own, free, 50.0) == pytest.approx(best, rel=1e-6)
    assert proven_bound(problem, own, free, 50.0, objective=False) <= 0.0
    signed = {"balance", *(key for key, sign, _ in blocks if sign == "any")}
    rng = np.random.default_rng(3)
    for _ in range(30):
        m = stated_multipliers(made_up(stated, signed, rng), problem, "made up")
        assert proven_bound(problem, m, free, 50.0) <= best + 1e-6 * problem.unit
        assert proven_bound(problem, m, free, 50.0, objective=False) <= 0.0


def turning(seed: int) -> QuasistaticProblem:
    """A joint that turns with the object about one axis: its torque is what the load makes.

    All figures are such that the torque is exactly that, and so are both of its limits.
    """
    rng = np.random.default_rng(seed)
    points = rng.integers(-(2**25), 2**25, size=(4, 3)) / 2.0**28
    axis = np.array([0.0, 3.0, 5.0])
    frames = np.eye(3)[[[2, 0, 1], [2, 0, 1], [1, 2, 0], [1, 2, 0]]]
    forces = rng.integers(2**14, 2**15, size=(4, 1)) / 2.0**10 * frames[:, 0]
    wrench = -np.concatenate([forces.sum(axis=0), np.cross(points, forces).sum(axis=0)])
    torque = float(-axis @ wrench[3:])
    return QuasistaticProblem(
        points, frames[:, 0], wrench, np.cross(axis, points).reshape(-1, 1), friction=0.0,
        tangents=frames[:, 1:].transpose(0, 2, 1), torque_limits=(torque, torque),
    )  # fmt: skip


@pytest.mark.sampled(6)
@pytest.mark.parametrize("seed", range(20))
def test_multipliers_that_cancel_prove_nothing_by_their_rounding(seed):
    """The torque follows from the balance: multipliers of both, however large, cancel exactly."""
    found = maximize_margin(turning(seed), static_friction="coulomb")
    assert found.found
    problem = read_problem(documented(found))
    everywhere = np.ones((problem.count, 2, 2), dtype=bool)
    rng = np.random.default_rng(seed)
    for sign in (1.0, -1.0):
        size = float(rng.integers(2**48, 2**49)) * 2.0**20
        none = {key: np.zeros(n).tolist() for key, n in (
            ("balance", 6), ("normal_upper", 4), ("normal_lower", 4), ("torque_upper", 1),
            ("torque_lower", 1), ("share_upper", 1), ("share_lower", 1),
        )}  # fmt: skip
        balance = [0.0, 0.0, 0.0, 0.0, -3.0 * sign * size, -5.0 * sign * size]
        side = "torque_upper" if sign > 0.0 else "torque_lower"
        m = stated_multipliers(
            {**none, "faces": [], "balance": balance, side: [size]}, problem, "made up"
        )
        assert proven_bound(problem, m, everywhere, 50.0, objective=False) <= 0.0
