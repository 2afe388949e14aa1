"""Analyses of other passive coordinates than one free object's: two boxes, a block on a rail."""

import numpy as np
import pytest
from tests.core.two_bodies import CORNERS, HEIGHT, MASSES, THREE, G, balances, on_a_rail, stacked

from graspless_pin import (
    QuasistaticProblem,
    Status,
    Uncertainty,
    compare_rules,
    contact_force_bounds,
    disturbance_margin,
    enumerate_modes,
    explain,
    free_motions,
    margin_sensitivity,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
    minimum_friction,
    optimum_gradients,
    robustness,
    solve_each_mode,
    stability,
    tolerances,
    what_would_hold,
)
from graspless_pin.errors import ArgumentError

RAIL = on_a_rail(20.0)


def test_disturbances_of_a_rail_are_those_of_its_friction():
    """Two fingers of 20 N bear up to 20 N of friction, of which the weight takes 9.8 N."""
    found = disturbance_margin(RAIL)
    assert found.directions.tolist() == [[1.0], [-1.0]]
    assert found.magnitudes == pytest.approx([20.0 + G, 20.0 - G], abs=1e-5)
    assert found.worst_wrench == pytest.approx([G - 20.0], abs=1e-5)
    assert str(found).endswith("(force [-10.2] N)")


def test_a_stack_bears_what_the_friction_below_each_box_bears():
    """The upper box slips on the lower one first; a push on the lower one takes both along."""
    problem, upper = QuasistaticProblem(**stacked(0.0)), MASSES[1]
    found = disturbance_margin(problem, directions=np.eye(12)[[0, 6]])
    assert found.magnitudes == pytest.approx([0.5 * sum(MASSES) * G, 0.5 * upper * G], abs=1e-5)
    one, two = (
        disturbance_margin(problem, directions=np.eye(12)[[3]], characteristic_length=length)
        for length in (1.0, 2.0)
    )
    assert two.magnitudes == pytest.approx(0.5 * one.magnitudes, rel=1e-6)
    with pytest.raises(ArgumentError, match=r"directions.*\(1, 6\).*\(any, 12\)"):
        disturbance_margin(problem, directions=np.eye(6)[:1])


def test_ranges_of_forces_on_a_rail():
    torques = np.full(2, 15.0)
    found = contact_force_bounds(RAIL, torques)
    assert found.status is Status.OPTIMAL
    assert found.lower[:, 0] == pytest.approx(15.0)
    assert found.upper[:, 0] == pytest.approx(15.0)
    # (31): friction is up at both contacts, so that neither bears more than the weight.
    assert (found.lower[:, 1] >= -1e-6).all()


@pytest.mark.parametrize("friction", [(0.5, 0.5), (0.5, 0.3), (0.3, 0.5)])
def test_the_least_friction_of_a_stack_is_that_of_its_slope(friction):
    factor = minimum_friction(QuasistaticProblem(**stacked(0.2, friction))).factor
    assert factor == pytest.approx(np.tan(0.2) / min(friction), rel=1e-3)


def test_the_least_friction_on_a_rail():
    assert minimum_friction(RAIL).factor == pytest.approx(G / 20.0, rel=1e-3)


def test_gradients_are_those_of_differences():
    problem = QuasistaticProblem(**stacked(0.3, (0.5, 0.4), push=3.0))
    gradients = optimum_gradients(maximize_margin(problem))
    values, unique = gradients.values, gradients.unique
    assert values.external_wrench.shape == (12,)
    np.testing.assert_array_equal(values.positions, 0.0)
    step, looked_at = 1e-5, 0
    for entry in np.flatnonzero(unique["external_wrench"]):
        ends = [
            maximize_margin(
                problem.with_changes(
                    external_wrench=problem.external_wrench + sign * step * np.eye(12)[entry]
                )
            ).margin
            for sign in (1.0, -1.0)
        ]
        slope = (ends[0] - ends[1]) / (2.0 * step)
        assert values.external_wrench[entry] == pytest.approx(slope, abs=2e-3)
        looked_at += abs(slope) > 1e-2
    assert looked_at > 0
    changed = problem.W.copy()
    changed[6, 24] += 1e-4
    by_matrix = (
        maximize_margin(problem.with_changes(wrench_matrix=changed)).margin
        - maximize_margin(problem).margin
    ) / 1e-4
    product = values.external_wrench[6] * gradients.point.forces[8, 0]
    assert product == pytest.approx(by_matrix, abs=2e-2)
    assert margin_sensitivity(problem).load == pytest.approx(gradients.load)


@pytest.mark.parametrize("off", [{"mass": 0.1}, {"force": 0.1}, {"moment": 0.01}, {"tilt": 0.01}])
def test_nothing_is_taken_as_off_of_two_objects(off):
    with pytest.raises(ArgumentError, match="problem: has a wrench_matrix"):
        maximize_margin(QuasistaticProblem(**stacked(0.0)), uncertainty=Uncertainty(**off))


def test_no_tolerances_are_told_of_two_objects():
    problem = QuasistaticProblem(**stacked(0.0))
    with pytest.raises(ArgumentError, match="problem: has a wrench_matrix"):
        tolerances(problem, [])


def test_a_stack_relies_on_all_of_its_three_corners():
    problem = QuasistaticProblem(**stacked(0.0, corners=THREE))
    found = robustness(problem, [])
    assert found.verdict.status.name == "STRONG"
    assert found.relies_on == tuple(range(6))


def test_a_rail_bears_errors_of_torques():
    found = robustness(RAIL, [20.0, 20.0], precision=0.05)
    # Both weaker: friction bears the weight down to 9.8 N of each.
    assert found.all_less is not None
    assert found.all_less.guaranteed <= 1.0 - G / 20.0
    assert found.all_less.guaranteed == pytest.approx(1.0 - G / 20.0, rel=0.06)
    # One finger alone bears the weight by as much as it is pressed by.
    assert len(found.relies_on) <= 2


def test_why_a_stack_slides_is_told_with_what_would_help():
    problem = QuasistaticProblem(**stacked(0.6))
    told = explain(maximize_margin(problem))
    assert "on the passive coordinates" in str(told)
    assert told.suggestions
    for suggestion in told.suggestions:
        assert maximize_margin(suggestion.problem, **suggestion.rules.options()).found
    assert "force [0.8" in str(explain(maximize_margin(on_a_rail(9.0))))


def test_what_would_hold_a_block_on_a_rail():
    found = what_would_hold(RAIL, [9.0, 9.0], time_limit=60.0)
    assert found.changes
    for change in found.changes:
        assert stability(change.problem, change.torques).status.name == "STRONG"


def test_modes_of_a_rail_slide_along_it():
    """Each contact slides up, down or not at all, and never both ways at once."""
    modes = {
        tuple(map(tuple, mode.signs.tolist()))
        for mode in enumerate_modes(RAIL)
        if mode.selection.any()
    }
    # Tangents at the second contact point along the rail as those at the first.
    assert ((1, 1), (1, 1)) in modes
    assert ((1, 1), (-1, -1)) not in modes
    best = max(one.margin for one in solve_each_mode(RAIL) if one.found)
    assert best == pytest.approx(maximize_margin(RAIL).margin, abs=1e-7)


def test_rules_and_curves_of_a_stack():
    problem = QuasistaticProblem(**stacked(0.3, push=3.0))
    margins = [one.margin for one in compare_rules(problem).solutions.values()]
    assert max(margins) >= maximize_margin(problem).margin - 1e-7
    curve = margin_torque_curve(problem)
    assert curve.found
    for margin, torque in zip(curve.margins[:, 1], curve.torques[:, 1], strict=True):
        least = minimize_torque(problem, margin - 1e-6).max_torque
        assert torque == pytest.approx(least, abs=1e-4)


@pytest.mark.parametrize(("angle", "status"), [(0.0, "STRONG"), (0.3, "STRONG"), (0.6, "NONE")])
def test_verdicts_on_one_box_do_not_hang_on_how_its_map_is_given(angle, status):
    both = stacked(angle)
    normals = np.asarray(both["normals"][:4])
    one = QuasistaticProblem(
        both["positions"][:4] - 0.5 * HEIGHT * normals, normals, both["external_wrench"][:6],
        friction=0.5, object_inertia=both["object_inertia"][:6, :6],
    )  # fmt: skip
    for problem in (one, one.with_changes(wrench_matrix=one.W)):
        verdict = stability(problem, [])
        assert verdict.status.name == status
    if verdict.motion is not None:
        expected = stability(one, []).motion
        assert expected is not None
        np.testing.assert_allclose(
            verdict.motion.object_acceleration, expected.object_acceleration, atol=1e-9
        )


def test_no_motion_of_a_stack_is_free_but_that_of_a_smooth_one():
    """On one smooth plane the whole stack glides: two ways, and about the normal."""
    assert len(free_motions(QuasistaticProblem(**stacked(0.0)))) == 0
    assert len(free_motions(QuasistaticProblem(**stacked(0.0, (0.0, 0.5))))) == 3
    assert len(free_motions(QuasistaticProblem(**stacked(0.0, (0.0, 0.0))))) == 6


@pytest.mark.parametrize("corners", [CORNERS, THREE])
def test_a_stack_that_slides_is_told_to(corners):
    """The stack slips at the smoother one of its interfaces."""
    for friction, slipping in (((0.5, 0.3), None), ((0.3, 0.6), range(len(corners)))):
        arguments = stacked(0.6, friction, corners=corners)
        verdict = stability(QuasistaticProblem(**arguments), [])
        assert not balances(arguments)
        assert verdict.status.name == "NONE"
        assert "the object can slip" in verdict.message
        assert verdict.motion is not None
        acceleration = verdict.motion.object_acceleration
        steepest = G * (np.sin(0.6) - friction[0] * np.cos(0.6))
        if slipping is not None:
            # Both boxes go down together, as one of the whole weight.
            for body in (0, 1):
                linear = acceleration[6 * body : 6 * body + 3]
                assert np.linalg.norm(linear) == pytest.approx(steepest, rel=1e-6)
        else:
            upper = G * (np.sin(0.6) - friction[1] * np.cos(0.6))
            assert np.linalg.norm(acceleration[6:9]) == pytest.approx(upper, rel=1e-6)
