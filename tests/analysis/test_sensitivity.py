"""Derivatives of the largest margin by hand; `tests/planning/test_gradients.py` has differences."""

import numpy as np
import pytest
from tests.core.scenes import scene

from graspless_pin import (
    QuasistaticProblem,
    margin_sensitivity,
    minimize_torque,
    optimum_gradients,
)
from graspless_pin.errors import NoSolutionError


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


def test_multipliers_without_bound_are_not_unique():
    """The third joint's limit is just what balance asks for: its multiplier may be any.

    Solvers tell one of millions. Beside it the forces that are open must be seen, too: contact 1
    may press with 17 N or with 43 N, and leans the same way along y.
    """
    planar = np.zeros((3, 6))  # moment about y, then two sums of forces along x and z
    planar[0, 3:] = 0.1, -0.1, 0.1
    planar[1, [0, 2, 5]] = -1.0, -1.0, 1.0
    planar[2, [0, 2, 5]] = -1.0, -1.0, -1.0
    levers = [[-0.05, 0.05, -0.05] * 2, [0, 0, -0.1, 0, 0, 0], [0.1, 0, 0.1, 0, 0, 0]]
    problem = QuasistaticProblem(
        [[0.0, 0.0, -0.1], [0.0, -0.1, 0.1]],
        [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0]],
        [-0.09, -0.06, 0.06],
        np.transpose(levers),
        friction=[1.0, 2.0],
        torque_limits=([-np.inf, -0.2, 0.0], [np.inf, 0.3, 1.0]),
        cone_edges=4,
        wrench_matrix=planar,
        passive_units=["N m", "N", "N"],
    )
    solution = minimize_torque(problem, 5.0, static_friction="coulomb")
    gradients = optimum_gradients(solution)
    assert gradients.unique["gravity_torques"].tolist() == [True, True, False]
    assert not gradients.unique["lower_torque"][2]
    assert not gradients.unique["jacobian"][4, 0]
    assert gradients.values.gravity_torques[0] == pytest.approx(-1.0)
