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
POINTS = 25


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


@pytest.mark.parametrize("name", ["sphere", "rest", "up", "down"])
def test_the_papers_scenes(name):
    assert_right(margin_torque_curve(scene(name)))


RULES: tuple[dict[str, Any], ...] = (
    {"sign_rule": "exact"},
    {"sign_rule": "nonzero"},
    {"static_friction": "coulomb"},
    {"scale": "limits"},
    {"solver": "highs"},
)


@pytest.mark.parametrize("options", RULES, ids=lambda options: "-".join(options.values()))
def test_every_reading_of_the_rules(options: dict[str, Any]):
    assert_right(margin_torque_curve(scene("rest"), **options), **options)


def test_sliding_contacts_constrained():
    options: dict[str, Any] = {"sign_rule": "exact", "sliding_rule": "constrained"}
    assert_right(margin_torque_curve(scene("up"), **options), **options)


@pytest.mark.parametrize("contacts", [3, 4, 5])
@pytest.mark.parametrize("seed", range(6))
def test_random_scenes(seed, contacts):
    assert_right(margin_torque_curve(random_problem(seed, contacts)))


@pytest.mark.parametrize("kind", ["slab", "pinch", "planar"])
def test_scenes_whose_kinematics_bite(kind):
    assert_right(margin_torque_curve(QuasistaticProblem(**structured_arguments(1, kind, 5))))


def test_many_contacts():
    assert_right(margin_torque_curve(slope_scene(3, 12)))


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
    curve = margin_torque_curve(problem)
    for margin, torque, mode in zip(
        curve.margins.mean(axis=1), curve.torques.mean(axis=1), curve.modes, strict=True
    ):
        assert mode in set(enumerate_modes(problem, maximal=True))
        solved = minimize_torque(problem, margin, mode=mode)
        assert solved.max_torque == pytest.approx(torque, abs=AGREE)


def test_the_figures_of_the_paper():
    curve = margin_torque_curve(scene("rest"))
    assert curve.torque_at(0.1) == pytest.approx(0.9618, abs=5e-5)
    assert curve.largest_margin == pytest.approx(1.6504, abs=5e-5)
    assert curve.torques[-1, 1] == pytest.approx(4.8348, abs=2e-4)
    assert str(curve).startswith("margin 0 to 1.65 N for 0.8196 to 4.835 of torque [N m], 4 pieces")


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
    with pytest.raises(NoSolutionError, match="There is no curve to read"):
        curve.torque_at(0.1)
    with pytest.raises(NoSolutionError, match="There is no curve to read"):
        _ = curve.largest_margin


def test_a_limit_is_told():
    curve = margin_torque_curve(scene("rest"), node_limit=1)
    assert curve.status in (Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT)


def test_reading_between_and_beyond():
    curve = margin_torque_curve(scene("up"))
    assert np.isnan(curve.torque_at(curve.largest_margin + 1e-3))
    assert curve.torque_at([[0.0, 1.0]]).shape == (1, 2)
    with pytest.raises(ArgumentError, match=r"margin: is -0\.1"):
        curve.torque_at([0.2, -0.1])
    assert not curve.margins.flags.writeable and not curve.torques.flags.writeable


@pytest.mark.parametrize(
    ("options", "message"),
    [({"scale": "x"}, "scale: is 'x'"), ({"node_limit": 0}, "node_limit: ")],
)
def test_bad_options(options, message):
    with pytest.raises(ArgumentError, match=message):
        margin_torque_curve(scene("up"), **options)


def test_unknown_solver():
    with pytest.raises(SolverUnavailableError, match="simplex"):
        margin_torque_curve(scene("up"), solver="simplex")


def test_a_curve_says_what_its_torques_are_of():
    assert margin_torque_curve(scene("rest")).torque_unit == "N m"
    assert margin_torque_curve(scene("rest"), scale="limits").torque_unit == "share of the limit"
