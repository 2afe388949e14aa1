"""Derivatives of the largest margin from multipliers, against finite differences."""

from collections import Counter
from functools import cache

import numpy as np
import pytest
from analysis_scenes import PAIRS
from tests.core.random_scenes import general_scene, slope_scene
from tests.core.scenes import random_problem, scene

from graspless_pin import (
    QuasistaticProblem,
    margin_sensitivity,
    maximize_margin,
)
from graspless_pin.errors import NoSolutionError
from graspless_pin.modes.rules import RuleOptions

NAMES = (
    *("sphere", "rest", "up", "down"),
    *(f"general {seed}" for seed in range(12)),
    *(f"slope {seed}" for seed in range(12)),
    *(f"random {seed}" for seed in range(12)),
    *(f"tight {seed}" for seed in range(6)),
)


def problem_of(name: str) -> QuasistaticProblem:
    family, _, number = name.partition(" ")
    seed = int(number or 0)
    if family == "general":
        return general_scene(seed, 2 + seed % 3, joints=(1, 3), cone_edges=5)
    if family == "slope":
        return slope_scene(seed, 3 + seed % 2, cone_edges=4)
    if family == "random":
        return random_problem(seed, 2 + seed % 3, slides=seed % 2)
    if family == "tight":
        problem = general_scene(20 + seed, 3, joints=(1, 2), cone_edges=5)
        solution = maximize_margin(problem, static_friction="coulomb")
        press = np.einsum("ij,ij->i", problem.normals, solution.contact_forces)
        return problem.with_changes(max_normal_force=press + 0.7 * solution.margin)
    return scene(name)


def options_of(index: int) -> RuleOptions:
    if index % 7 == 6:
        return {"static_friction": "coulomb"}
    sign_rule, sliding_rule = PAIRS[index % 6]
    return {"sign_rule": sign_rule, "sliding_rule": sliding_rule}


def steps(problem: QuasistaticProblem, sensitivity):
    """(what, derivative, changes by a step, step) for every figure that has a derivative."""
    p = problem
    for contact, one in enumerate(np.eye(p.contact_count)):
        mu, limit = sensitivity.friction[contact], sensitivity.max_normal_force[contact]
        yield "friction", mu, lambda h, d=one: {"friction": p.friction + h * d}, 1e-4
        yield (
            "normal limit",
            limit,
            lambda h, d=one: {"max_normal_force": p.max_normal_force + h * d},
            1e-3,
        )
    for component, one in enumerate(np.eye(6)):
        slope = sensitivity.external_wrench[component]
        step = 1e-3 if component < 3 else 1e-4
        yield "wrench", slope, lambda h, d=one: {"external_wrench": p.external_wrench + h * d}, step
    yield (
        "load",
        sensitivity.load,
        lambda h: {"external_wrench": (1.0 + h) * p.external_wrench},
        1e-4,
    )
    for joint, one in enumerate(np.eye(p.joint_count)):
        low, high = p.lower_torque, p.upper_torque
        yield (
            "upper torque",
            sensitivity.upper_torque[joint],
            lambda h, d=one, low=low, high=high: {"torque_limits": (low, high + h * d)},
            1e-4,
        )
        yield (
            "lower torque",
            sensitivity.lower_torque[joint],
            lambda h, d=one, low=low, high=high: {"torque_limits": (low + h * d, high)},
            1e-4,
        )


@cache
def compared(index: int) -> Counter[str]:
    """Compare one scene; count the comparisons that were made, and those that are not zero."""
    problem, options = problem_of(NAMES[index]), options_of(index)
    if not maximize_margin(problem, **options).found:
        return Counter({"infeasible": 1})
    sensitivity = margin_sensitivity(problem, **options)
    best = sensitivity.solution.margin
    counts: Counter[str] = Counter()
    for what, derivative, change, step in steps(problem, sensitivity):
        beside = [
            maximize_margin(problem.with_changes(**change(sign * step)), **options)
            for sign in (1.0, -1.0)
        ]
        if not all(solution.found for solution in beside):
            counts["at the edge"] += 1
            continue
        right, left = (beside[0].margin - best) / step, (best - beside[1].margin) / step
        tolerance = 1e-3 * max(1.0, abs(right), abs(left)) + 1e-6 / step
        if abs(right - left) > tolerance:
            counts["degenerate"] += 1
            low, high = sorted((left, right))
            assert low - tolerance <= derivative <= high + tolerance, what
            continue
        assert derivative == pytest.approx((right + left) / 2.0, abs=tolerance), what
        counts[what] += 1
        counts[f"{what}, not zero"] += abs(derivative) > 10.0 * tolerance
    return counts


@pytest.mark.parametrize("index", range(len(NAMES)), ids=NAMES)
def test_derivatives_are_finite_differences(index):
    counts = compared(index)
    assert counts["infeasible"] or counts.total() >= 10


def test_most_comparisons_are_not_degenerate():
    counts = sum((compared(index) for index in range(len(NAMES))), Counter())
    kinds = ("friction", "normal limit", "wrench", "load", "upper torque", "lower torque")
    made = sum(counts[kind] for kind in kinds)
    assert made > 500 and counts["degenerate"] < 0.1 * made
    assert counts["infeasible"] <= len(NAMES) // 4
    least = dict(zip(kinds, (80, 8, 120, 25, 4, 1), strict=True))
    assert all(counts[f"{kind}, not zero"] >= least[kind] for kind in kinds), counts


def test_signs():
    """More friction never hurts on these, wider limits never do."""
    sensitivity = margin_sensitivity(scene("rest"))
    assert (sensitivity.friction >= -1e-6).all() and sensitivity.friction.max() > 1.0
    assert (sensitivity.upper_torque >= 0.0).all() and (sensitivity.lower_torque <= 0.0).all()
    assert (sensitivity.max_normal_force >= 0.0).all()


def test_by_hand():
    """A point under 10 N, r = 4: the margin is that of the cone, 10 s / sqrt(1 + s^2)."""
    problem = QuasistaticProblem(
        [[0, 0, 0]], [[0, 0, 1]], [0, 0, -10, 0, 0, 0], friction=0.5, cone_edges=4
    )
    s, c = 0.5 * np.sqrt(0.5), np.sqrt(0.5)
    sensitivity = margin_sensitivity(problem)
    assert sensitivity.solution.margin == pytest.approx(10 * s / np.hypot(1, s))
    assert sensitivity.friction[0] == pytest.approx(10 * c / np.hypot(1, s) ** 3, rel=1e-4)
    assert sensitivity.external_wrench[2] == pytest.approx(-s / np.hypot(1, s), rel=1e-5)
    assert sensitivity.load == pytest.approx(sensitivity.solution.margin, rel=1e-5)
    assert sensitivity.per_mass(10 / 9.8) == pytest.approx(9.8 * s / np.hypot(1, s), rel=1e-5)
    assert sensitivity.max_normal_force[0] == pytest.approx(0.0, abs=1e-6)


def test_a_sliding_contact_without_friction_has_a_derivative_too():
    """A block slides on a frictionless table; a wall with mu = 0 at rest has no cone to widen."""
    problem = QuasistaticProblem(
        [[0, 0, 0], [0, 0, 0]],
        [[0, 0, 1], [1, 0, 0]],
        [-8, 0, -10, 0, 0, 0],
        friction=[0.0, 0.0],
        sliding=[[0, 0.1, 0], [0, 0, 0]],
        max_normal_force=[50.0, 50.0],
    )
    slid = margin_sensitivity(problem.with_changes(sliding=[[0.1, 0, 0], [0, 0, 0]]))
    # Kinetic friction -10 mu along x presses the wall more: n_2 = 8 + 10 mu is the margin.
    assert slid.solution.margin == pytest.approx(8.0)
    np.testing.assert_allclose(slid.friction, [10.0, 0.0], atol=1e-5)


def test_an_infeasible_problem_has_none():
    lifted = scene("sphere").with_changes(external_wrench=[0, 0, 99, 0, 0, 0])
    with pytest.raises(NoSolutionError, match="no optimum to differentiate"):
        margin_sensitivity(lifted)
