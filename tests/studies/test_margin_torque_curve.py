"""The trade-off between margin and torque against Algorithm 2, solved point by point."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.core.random_scenes import slope_scene
from tests.core.scenes import random_problem, scene, structured_arguments

from graspless_pin import (
    QuasistaticProblem,
    Status,
    enumerate_modes,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms.margin_torque_curve import MarginTorqueCurve, margin_torque_curve
from graspless_pin.errors import ArgumentError, NoSolutionError, SolverUnavailableError

AGREE = 2e-6  # N m; solvers meet each program to 1e-7 of the largest torque limit, 10 N m
POINTS = 11


def assert_right(curve: MarginTorqueCurve, **options) -> None:
    """Algorithm 2 agrees inside, at and beside every breakpoint; the end is Algorithm 1's."""
    problem = curve.problem
    best = maximize_margin(problem, **{k: v for k, v in options.items() if k != "scale"})
    assert curve.status is Status.OPTIMAL
    assert curve.margins[0, 0] == 0.0
    assert curve.largest_margin == pytest.approx(best.margin, abs=1e-5)
    begins, ends = curve.margins.T
    np.testing.assert_array_equal(begins[1:], ends[:-1])
    assert (ends > begins).all()
    flat = curve.torques.ravel()
    assert (np.diff(flat) >= -AGREE).all()
    middles = 0.5 * (begins + ends)
    beside = np.concatenate([begins + 1e-4, ends - 1e-4])
    beside = beside[(beside > 0.0) & (beside < ends[-1])]
    wanted = np.concatenate([np.linspace(0.0, 0.999 * ends[-1], POINTS), middles, beside])
    found = [minimize_torque(problem, margin, **options) for margin in wanted]
    scale = options.get("scale", "absolute")
    torque = [least.certificate.bound if scale == "limits" else least.max_torque for least in found]
    steep = 1.0 + np.interp(wanted, middles, curve.slopes)
    assert (np.abs(curve.torque_at(wanted) - torque) / steep).max() < AGREE


RULES: tuple[dict[str, Any], ...] = (
    {"sign_rule": "exact"},
    {"sign_rule": "nonzero"},
    {"static_friction": "coulomb"},
    {"scale": "limits"},
    {"solver": "highs"},
)
SEEDED = {
    **{f"random {s} {n}": random_problem(s, n) for s in range(6) for n in (3, 4, 5)},
    **{
        kind: QuasistaticProblem(**structured_arguments(1, kind, 5))
        for kind in ("slab", "pinch", "planar")
    },
}


@pytest.mark.parametrize(
    ("problem", "options"),
    [
        *(pytest.param(scene(name), {}, id=name) for name in ("sphere", "rest", "up", "down")),
        *(pytest.param(scene("rest"), one, id="-".join(one.values())) for one in RULES),
        pytest.param(scene("up"), {"sign_rule": "exact", "sliding_rule": "constrained"}, id="all"),
        pytest.param(slope_scene(3, 8), {}, id="many contacts"),
        *(
            pytest.param(problem, {}, id=name, marks=pytest.mark.sampled(5))
            for name, problem in SEEDED.items()
        ),
    ],
)
def test_algorithm_2_agrees_everywhere(problem, options):
    assert_right(margin_torque_curve(problem, **options), **options)


@pytest.mark.parametrize(("seed", "contacts"), [(0, 4), (2, 5)])
def test_jumps_where_a_mode_ends(seed, contacts):
    """Just before a jump Algorithm 2 has the lower torque, just after it the higher one."""
    problem = random_problem(seed, contacts)
    curve = margin_torque_curve(problem)
    jumps = curve.torques[1:, 0] - curve.torques[:-1, 1]
    at = int(np.argmax(jumps))
    assert jumps[at] > 0.05
    margin = curve.margins[at, 1]
    before, after = (minimize_torque(problem, margin + step).max_torque for step in (-1e-5, 1e-5))
    assert before == pytest.approx(curve.torques[at, 1], abs=1e-3)
    assert after == pytest.approx(curve.torques[at + 1, 0], abs=1e-3)
    assert curve.torque_at(margin) == curve.torques[at, 1]


def test_each_piece_is_its_modes_optimum():
    problem = scene("rest")
    curve, modes = margin_torque_curve(problem), {*enumerate_modes(problem, maximal=True)}
    for margin, torque, mode in zip(
        curve.margins.mean(axis=1), curve.torques.mean(axis=1), curve.modes, strict=True
    ):
        assert mode in modes
        solved = minimize_torque(problem, margin, mode=mode)
        assert solved.max_torque == pytest.approx(torque, abs=AGREE)


def test_the_figures_of_the_paper():
    curve = margin_torque_curve(scene("rest"))
    assert curve.torque_at(0.1) == pytest.approx(0.9618, abs=5e-5)
    assert curve.largest_margin == pytest.approx(1.6504, abs=5e-5)
    assert curve.torques[-1, 1] == pytest.approx(4.8348, abs=2e-4)
    assert str(curve).startswith("margin 0 to 1.65 N for 0.8196 to 4.835 of torque [N m], 4 pieces")
    assert margin_torque_curve(scene("rest")).torque_unit == "N m"
    assert margin_torque_curve(scene("rest"), scale="limits").torque_unit == "share of the limit"


def test_a_piece_without_width_has_no_slope():
    """Nor has a curve that ends where it begins, at a margin of zero."""
    curve = margin_torque_curve(scene("rest"))
    point = replace(curve, margins=np.zeros((1, 2)), torques=np.ones((1, 2)), modes=(None,))
    assert point.slopes.tolist() == [0.0]
    assert point.torque_at([0.0]).tolist() == [1.0] and point.largest_margin == 0.0


def test_what_has_no_curve():
    weak = scene("rest").with_changes(torque_limits=(-0.1, 0.1))
    curve = margin_torque_curve(weak)
    assert not curve.found and curve.status is Status.INFEASIBLE_FORCES
    assert curve.margins.shape == (0, 2) and curve.slopes.shape == (0,)
    assert str(curve).startswith("not found: infeasible")
    with pytest.raises(NoSolutionError, match="There is no margin-torque curve"):
        curve.torque_at(0.1)
    with pytest.raises(NoSolutionError, match="There is no margin-torque curve"):
        _ = curve.largest_margin
    curve = margin_torque_curve(scene("rest"), node_limit=1)
    assert curve.status in (Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT)


def test_reading_between_and_beyond():
    curve = margin_torque_curve(scene("up"))
    assert np.isnan(curve.torque_at(curve.largest_margin + 1e-3))
    best = maximize_margin(scene("up")).margin
    for beside in (best, curve.largest_margin + 1e-9):
        assert curve.torque_at(beside) == pytest.approx(curve.torques[-1, 1], rel=1e-6)
    assert curve.torque_at([[0.0, 1.0]]).shape == (1, 2)
    with pytest.raises(ArgumentError, match=r"margin: is -0\.1"):
        curve.torque_at([0.2, -0.1])
    assert not curve.margins.flags.writeable and not curve.torques.flags.writeable
    with pytest.raises(SolverUnavailableError, match="simplex"):
        margin_torque_curve(scene("up"), solver="simplex")
    with pytest.raises(ArgumentError, match="scale: is 'x'"):
        margin_torque_curve(scene("up"), scale="x")
    with pytest.raises(ArgumentError, match="node_limit: "):
        margin_torque_curve(scene("up"), node_limit=0)
