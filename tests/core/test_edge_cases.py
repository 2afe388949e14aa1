"""Cases at the edge of what the core is asked for, each with its answer known by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import scene

from graspless_pin import (
    QuasistaticProblem,
    Status,
    contact_force_bounds,
    explain,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.bounds import LARGEST, LARGEST_REGULARIZATION
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import real_number
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document


def pinch(limit: float = 10.0, friction: float = 0.0, **options: Any) -> QuasistaticProblem:
    """Two opposite contacts on a weightless object, the first by a joint on a lever of 0.5 m."""
    jacobian = np.zeros((6, 1))
    jacobian[1, 0] = -0.5
    return QuasistaticProblem(
        [[0, -0.05, 0], [0, 0.05, 0]], [[0, 1, 0], [0, -1, 0]], np.zeros(6), jacobian,
        friction=friction, max_normal_force=limit, torque_limits=(-np.inf, np.inf), **options,
    )  # fmt: skip


@pytest.mark.parametrize("limit", [1e-6, 10.0, 4e5])
def test_without_friction_the_largest_margin_is_half_the_limit(limit):
    """It presses half as hard as it may: as far from no force as from the limit."""
    solution = maximize_margin(pinch(limit))
    assert solution.status.name == "OPTIMAL"
    assert solution.margin == pytest.approx(limit / 2.0, rel=1e-6)
    assert solution.certificate.bound == pytest.approx(limit / 2.0, rel=1e-6)
    curve = margin_torque_curve(pinch(limit))
    assert curve.found and curve.largest_margin == pytest.approx(limit / 2.0, rel=1e-6)
    assert curve.torque_at(limit / 4.0) == pytest.approx(limit / 8.0, rel=1e-5)


@pytest.mark.parametrize(("margin", "reach"), [(0.1, 1e7), (3.0, 3e8), (50.0, 1e9)])
def test_without_a_load_the_required_margin_is_the_scale(margin, reach):
    solution = minimize_torque(pinch(1e9, 0.5), margin)
    assert solution.found
    assert solution.certificate.force_reach == pytest.approx(reach)
    assert maximize_margin(pinch(1e9, 0.5)).certificate.force_reach == 1e9


@pytest.mark.parametrize("cone", ["edges", "round"])
@pytest.mark.parametrize("wrench", [(0, 0, -10, 0, 1.2, 0), (0, 0, 10, 0, 0, 0)])
@pytest.mark.parametrize("friction", [1e-2, 1e-4, 1e-7, 1e-8, 1e-12, 1e-16, 0.0])
def test_however_little_friction_there_is_no_contact_pulls(friction, wrench, cone):
    """A box tips where a moment is larger than its weight on a lever, and is lifted off."""
    feet = [(x, y, -0.05) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    problem = QuasistaticProblem(feet, [[0.0, 0.0, 1.0]] * 4, wrench, friction=friction, cone=cone)
    for two in (friction, [friction, friction, 0.5, 0.5]):
        own = problem.with_changes(friction=two)
        for solution in (maximize_margin(own), minimize_torque(own, 0.0)):
            assert solution.status is Status.INFEASIBLE_FORCES
            assert verify_document(solution_document(solution)).passed


@pytest.mark.parametrize("friction", [1e-3, 9e-4, 1e-6])
def test_the_margin_of_narrow_cones_is_known(friction):
    """Each of four feet has a quarter of the weight, mu / sqrt(1 + mu^2) of it to its cone."""
    feet = [(x, y, -0.05) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    problem = QuasistaticProblem(
        feet, [[0.0, 0.0, 1.0]] * 4, [0, 0, -10.0, 0, 0, 0], friction=friction, cone="round"
    )
    solution = maximize_margin(problem, static_friction="coulomb")
    wanted = 2.5 * friction / np.hypot(1.0, friction)
    assert solution.margin == pytest.approx(wanted, rel=1e-6, abs=1e-9)
    assert verify_document(solution_document(solution)).passed


@pytest.mark.parametrize("shift", [0.010169491525423728, 0.02, 0.031])
def test_a_margin_that_was_found_can_be_asked_for(shift):
    """The centre of mass is on the line between two of three feet: the third bears nothing."""
    feet = [[-0.1, -0.1 * (1 + shift), -0.05], [0.1, 0.1 * (1 + shift), -0.05], [-0.1, 0.1, -0.05]]
    problem = QuasistaticProblem(feet, [[0.0, 0.0, 1.0]] * 3, [0, 0, -9.81, 0, 0, 0], friction=0.4)
    best = maximize_margin(problem)
    assert 0.0 <= best.margin == pytest.approx(0.0, abs=1e-8)
    assert minimize_torque(problem, best.margin).found


def test_only_the_external_force_is_held_against_the_smallest_limit():
    """A moment may be of any size: it depends on the reference point."""
    positions, normals = [[0, 0, 0]], [[0, 0, 1.0]]
    for wrench in ([0, 0, -1.0, 1e14, 1e14, 1e14], [1e11, 1e11, 1e11, 0, 0, 0]):
        QuasistaticProblem(positions, normals, wrench, friction=0.5, max_normal_force=1.0)
    for axis in range(3):
        wrench = np.zeros(6)
        wrench[axis] = 1.1e12
        wrench[3:] = 1e20
        with pytest.raises(ArgumentError, match=r"max_normal_force: .* must be at least 1\.1:"):
            QuasistaticProblem(positions, normals, wrench, friction=0.5, max_normal_force=1.0)


@pytest.mark.parametrize(
    ("name", "most"), [("regularization", LARGEST_REGULARIZATION), ("margin", LARGEST)]
)
def test_the_largest_number_is_taken(name, most):
    assert real_number(name, most, 0.0) == most
    with pytest.raises(ArgumentError, match=name):
        real_number(name, np.nextafter(most, np.inf), 0.0)
    assert real_number(name, np.nextafter(most, np.inf), 0.0, finite=False) > most


def test_components_that_vary_by_a_millionth_of_the_load_are_determined():
    problem = scene("up")
    bounds = contact_force_bounds(problem, maximize_margin(problem).torques)
    load = problem.scales.force
    for width, open_ in ((0.9e-6, False), (1.1e-6, True), (1e-4, True), (0.0, False)):
        one = replace(bounds, upper=bounds.lower + width * load)
        assert one.indeterminate.all() == open_ and one.indeterminate.any() == open_


def heavy(limit: float = 0.5, **options: Any) -> QuasistaticProblem:
    """Two fingers pinch a weight of 10 N with joints that only close, too weakly."""
    jacobian = np.zeros((6, 2))
    jacobian[1, 0], jacobian[4, 1] = -0.1, 0.1
    return QuasistaticProblem(
        [[0, -0.05, 0], [0, 0.05, 0]], [[0, 1, 0], [0, -1, 0]], [0, 0, -10.0, 0, 0, 0], jacobian,
        friction=0.5, torque_limits=([-limit, -limit], [0.0, 0.0]), **options,
    )  # fmt: skip


def suggestion(problem: QuasistaticProblem, words: str):
    solution = maximize_margin(problem, static_friction="coulomb")
    assert not solution.found
    return next(one for one in explain(solution).suggestions if words in one.text)


def test_a_limit_of_zero_on_one_side_stays():
    """Each needs at least 10 N, that is 1 N m."""
    found = suggestion(heavy(), "every torque limit")
    assert found.problem.upper_torque.tolist() == [0.0, 0.0]
    more = float(found.text.split("larger by ")[1].split()[0])
    np.testing.assert_allclose(found.problem.lower_torque, -0.5 - more)
    assert 0.5 <= more < 0.6
    mirrored = heavy().with_changes(
        jacobian=-heavy().jacobian, torque_limits=([0.0, 0.0], [0.5, 0.5])
    )
    found = suggestion(mirrored, "every torque limit")
    assert found.problem.lower_torque.tolist() == [0.0, 0.0]
    np.testing.assert_allclose(found.problem.upper_torque, 0.5 + more)


def test_a_limit_of_nothing_on_both_sides_opens_on_both():
    still = heavy().with_changes(torque_limits=(0.0, 0.0))
    found = suggestion(still, "every torque limit")
    assert (found.problem.upper_torque > 0.9).all() and (found.problem.lower_torque < -0.9).all()
