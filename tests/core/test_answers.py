"""Explanations that help, documents that verify, and the range around an optimum."""

import copy
import json

import numpy as np
import pytest
from random_scenes import infeasible_scene
from scenes import scene

from graspless_pin import (
    QuasistaticProblem,
    compare_rules,
    contact_force_bounds,
    explain,
    margin_sensitivity,
    maximize_margin,
    minimize_torque,
    minimum_friction,
    solve_each_mode,
)
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

INFEASIBLE = [infeasible_scene(seed, contacts) for seed in range(6) for contacts in (3, 5)]


@pytest.mark.parametrize("problem", INFEASIBLE)
def test_every_suggestion_makes_the_scene_feasible(problem):
    solution = maximize_margin(problem)
    assert not solution.found
    explanation = explain(solution)
    assert explanation.suggestions
    for suggestion in explanation.suggestions:
        assert maximize_margin(suggestion.problem, **suggestion.rules.options()).found
    assert explanation.cause in solution.explanation


def test_where_nothing_can_carry_the_weight_help_from_outside_is_all_that_is_suggested():
    problem = QuasistaticProblem(
        [[0.05, 0, 0], [-0.05, 0, 0]],
        [[-1.0, 0, 0], [1.0, 0, 0]],
        [0, 0, -5.0, 0, 0, 0],
        friction=0.0,
    )
    suggestions = explain(maximize_margin(problem)).suggestions
    assert len(suggestions) == 1
    np.testing.assert_allclose(suggestions[0].problem.external_wrench, 0.0, atol=0.06)


def test_a_margin_that_is_too_large_is_answered_by_the_largest_one():
    problem = scene("rest")
    best = maximize_margin(problem).margin
    explanation = explain(minimize_torque(problem, 2.0 * best))
    (lower,) = (one for one in explanation.suggestions if "required margin" in one.text)
    assert 0.999 * best < lower.margin <= best
    assert minimize_torque(lower.problem, lower.margin).found


def test_the_sliding_cuboid_names_its_conflict_and_weaker_rules():
    explanation = explain(maximize_margin(scene("up"), sliding_rule="constrained"))
    assert len(explanation.conflicting_contacts) >= 2
    text = str(explanation)
    assert "nonzero" in text and "coulomb" in text


def test_the_smallest_torque_limit_is_tight():
    weak = scene("rest").with_changes(torque_limits=([-0.2, -10.0], [0.2, 10.0]))
    solution = minimize_torque(weak, 0.1)
    first = explain(solution).suggestions[0]
    assert "joint_1's limit would have to be 0.9618" in first.text
    upper = 0.999 * first.problem.upper_torque[0]
    tighter = weak.with_changes(torque_limits=([-upper, -10.0], [upper, 10.0]))
    assert not minimize_torque(tighter, 0.1).found


@pytest.mark.parametrize("name", ["sphere", "rest", "up", "down"])
def test_documents_verify_and_tampering_shows(name):
    for solution in (maximize_margin(scene(name)), minimize_torque(scene(name), 0.1)):
        document = json.loads(json.dumps(solution_document(solution)))
        assert verify_document(document).proven
        for change in (
            lambda d: d["contacts"][0]["force"].__setitem__(0, d["contacts"][0]["force"][0] + 0.1),
            lambda d: d["joints"][0].__setitem__("torque", d["joints"][0]["torque"] + 0.1),
            lambda d: d.__setitem__("margin", d["margin"] + 0.01),
            lambda d: d["contacts"][0].__setitem__("friction", 0.01),
            lambda d: d["proof"]["motion"].update(
                object=[0.0] * 6, joints=[0.0] * len(d["joints"])
            ),
            lambda d: d["proof"]["nodes"][-1]["multipliers"]["balance"].__setitem__(0, 9.0),
            lambda d: d["multipliers"]["balance"].__setitem__(0, 9.0),
        ):
            spoilt = copy.deepcopy(document)
            change(spoilt)
            if spoilt["contacts"] == document["contacts"] and not solution.mode.selection.any():
                # Without a virtual sliding any motion will do, the one at rest too.
                spoilt["proof"]["motion"] = document["proof"]["motion"]
            if spoilt == document:
                continue
            assert not verify_document(spoilt).passed


def test_an_optimum_lies_within_the_bounds_of_its_torques():
    solution = minimize_torque(scene("rest"), 0.1)
    bounds = contact_force_bounds(scene("rest"), solution.torques)
    frames = np.concatenate(
        [solution.problem.normals[:, :, None], solution.problem.tangents], axis=2
    )
    local = np.einsum("lij,li->lj", frames, solution.contact_forces)
    assert (local >= bounds.lower - 1e-5).all() and (local <= bounds.upper + 1e-5).all()
    assert bounds.smallest_margin <= 0.1 + 1e-6
    assert bounds.largest_margin == pytest.approx(0.1, abs=1e-5)


def test_opposed_stiff_fingers_squeeze_without_bound():
    pinch = QuasistaticProblem(
        [[0, -0.05, 0], [0, 0.05, 0]], [[0, 1, 0], [0, -1, 0]], [0, 0, -1, 0, 0, 0], friction=0.5
    )
    bounds = contact_force_bounds(pinch, [])
    assert np.isinf(bounds.upper[:, 0]).all()
    np.testing.assert_allclose(bounds.lower[:, 0], 1.0, atol=1e-6)
    assert bounds.smallest_margin == -np.inf


def test_the_least_friction_is_just_enough():
    problem = scene("rest")
    factor = minimum_friction(problem).factor
    assert maximize_margin(problem.with_changes(friction=1.001 * factor * problem.friction)).found
    assert not maximize_margin(
        problem.with_changes(friction=0.999 * factor * problem.friction)
    ).found


@pytest.mark.parametrize("name", ["up", "down"])
def test_sensitivities_are_slopes(name):
    problem, step = scene(name), 1e-5
    slopes = margin_sensitivity(problem)
    for contact in range(problem.contact_count):
        change = step * (np.arange(problem.contact_count) == contact)
        high = maximize_margin(problem.with_changes(friction=problem.friction + change)).margin
        low = maximize_margin(problem.with_changes(friction=problem.friction - change)).margin
        assert slopes.friction[contact] == pytest.approx((high - low) / (2 * step), abs=1e-3)


def test_the_best_mode_is_the_optimum_and_rules_are_compared():
    best = max(s.margin for s in solve_each_mode(scene("up")) if s.found)
    assert best == pytest.approx(maximize_margin(scene("up")).margin, rel=1e-6)
    margins = {
        (str(rules.sign), str(rules.sliding)): solution.margin if solution.found else None
        for rules, solution in compare_rules(scene("up")).solutions.items()
        if rules.static_friction == "virtual_sliding"
    }
    assert margins["strict", "constrained"] is None
    assert margins["exact", "constrained"] == pytest.approx(0.0866, abs=1e-4)
