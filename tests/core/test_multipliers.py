"""Multipliers in the units of the problem: their Lagrangian bounds the optimum tightly."""

import numpy as np
import pytest
from scenes import scene

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque
from graspless_pin.programs.marginals import Marginals


def problem_of(name: str, gravity: float) -> QuasistaticProblem:
    """A scene whose limits differ by side and joint, and whose motors carry weight of their own."""
    problem = scene(name)
    return problem.with_changes(
        torque_limits=([-3.0, -7.0], [2.0, 11.0]), gravity_torques=[gravity, 0.3 * gravity]
    )


def least_over_forces(problem: QuasistaticProblem, slope: np.ndarray, margin: float) -> float:
    """Smallest slope^T f where every normal force is between the margin and its limit less that."""
    total = 0.0
    for contact in range(problem.contact_count):
        part = slope[3 * contact : 3 * contact + 3]
        along = float(part @ problem.normals[contact])
        # The cones' faces are rows of their own: nothing else holds the friction.
        np.testing.assert_allclose(part @ problem.tangents[contact], 0.0, atol=1e-7)
        ends = margin, problem.max_normal_force[contact] - margin
        total += min(along * end for end in ends)
    return total


def lagrangian(problem: QuasistaticProblem, m: Marginals) -> tuple[np.ndarray, float]:
    """Slope by the forces, and constant, of what all rows but the shares and the margin add."""
    gravity, none = problem.gravity_torques, np.zeros(problem.joint_count)
    shares = m.get("share_upper", none) - m.get("share_lower", none)
    slope = problem.W.T @ m["balance"] + problem.H @ m["faces"][problem.has_cone].ravel()
    slope += problem.J @ (m["torque_upper"] - m["torque_lower"] + shares)
    constant = m["balance"] @ problem.external_wrench
    constant += m["torque_upper"] @ (gravity - problem.upper_torque)
    constant += m["torque_lower"] @ (problem.lower_torque - gravity)
    return slope, float(constant + shares @ gravity)


@pytest.mark.parametrize("gravity", [-1.5, 0.0, 1.5])
@pytest.mark.parametrize("scale", ["absolute", "limits"])
@pytest.mark.parametrize("name", ["sphere", "rest"])
def test_the_lagrangian_bound_of_the_largest_torque_is_tight(name, scale, gravity):
    problem, margin = problem_of(name, gravity), 0.1
    found = minimize_torque(problem, margin, scale=scale, static_friction="coulomb")
    assert found.found
    by_limits = scale == "limits"
    m = found.multipliers
    upper, lower = np.ones(2), -np.ones(2)
    if by_limits:
        upper, lower = problem.upper_torque, problem.lower_torque
    largest = max((found.torques / upper).max(), (found.torques / lower).max())
    # t itself: its cost, less what the rows of shares make of it.
    assert m["share_upper"] @ upper - m["share_lower"] @ lower == pytest.approx(1.0, abs=1e-7)
    for name, part in m.items():
        assert name == "balance" or (part >= 0.0).all()
    slope, constant = lagrangian(problem, m)
    constant += margin * float(m["faces"].sum())
    assert constant + least_over_forces(problem, slope, margin) == pytest.approx(largest, abs=1e-6)
    # The side that is at the largest share is the one that has the multiplier.
    both = np.concatenate([found.torques / upper, found.torques / lower])
    shares = np.concatenate([m["share_upper"], m["share_lower"]])
    assert (both[shares > 1e-5] > largest - 1e-5).all()


def test_both_sides_have_been_looked_at():
    sides = set()
    for gravity in (-1.5, 1.5):
        problem = problem_of("rest", gravity)
        found = minimize_torque(problem, 0.1, scale="limits", static_friction="coulomb")
        m = found.multipliers
        sides |= {"upper"} if m["share_upper"].max() > 1e-3 else set()
        sides |= {"lower"} if m["share_lower"].max() > 1e-3 else set()
    assert sides == {"upper", "lower"}


@pytest.mark.parametrize("gravity", [-1.5, 0.0, 1.5])
@pytest.mark.parametrize("name", ["sphere", "rest"])
def test_the_lagrangian_bound_of_the_margin_is_tight(name, gravity):
    problem = problem_of(name, gravity)
    found = maximize_margin(problem, static_friction="coulomb")
    assert found.found
    m = found.multipliers
    slope, constant = lagrangian(problem, m)
    slope += problem.N @ m["normal_upper"]
    constant -= float(m["normal_upper"] @ problem.max_normal_force)
    assert m["faces"].sum() + m["normal_upper"].sum() == pytest.approx(1.0, abs=1e-7)
    assert constant + least_over_forces(problem, slope, 0.0) == pytest.approx(
        -found.margin, abs=1e-6
    )
