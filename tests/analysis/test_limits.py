"""Every analysis that searches can be limited, and says what it did not come to."""

from typing import Any

import numpy as np
import pytest
from tests.core.scenes import scene

from graspless_pin import (
    QuasistaticProblem,
    Status,
    compare_rules,
    contact_force_bounds,
    disturbance_margin,
    margin_sensitivity,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
    minimum_friction,
    what_would_hold,
)
from graspless_pin.errors import ArgumentError

NO_TIME: dict[str, Any] = {"time_limit": 0.0}
ONE_NODE: dict[str, Any] = {"node_limit": 1}
ENDED = (Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT)


@pytest.mark.parametrize("limit", [NO_TIME, ONE_NODE])
def test_force_bounds_say_what_is_not_proven(limit):
    problem = scene("rest")
    bounds = contact_force_bounds(problem, minimize_torque(problem, 0.1).torques, **limit)
    assert bounds.status in ENDED
    assert not bounds.proven.all()


def test_disturbances_that_were_not_proven_are_no_number():
    problem = scene("rest")
    full = disturbance_margin(problem, directions=np.eye(6))
    assert full.found
    limited = disturbance_margin(problem, directions=np.eye(6), node_limit=2)
    known = np.isfinite(limited.magnitudes)
    np.testing.assert_allclose(limited.magnitudes[known], full.magnitudes[known], rtol=1e-6)
    assert limited.found == known.all()
    over = disturbance_margin(problem, directions=np.eye(6), **NO_TIME)
    assert over.status in ENDED
    assert np.isnan(over.magnitudes).all()


def test_what_ended_early_says_so():
    problem = scene("rest")
    assert minimum_friction(problem).proven
    limited = minimum_friction(problem, **NO_TIME)
    assert not limited.proven and np.isnan(limited.factor)
    assert margin_torque_curve(problem, **ONE_NODE).status in ENDED
    assert margin_torque_curve(problem, **NO_TIME).status is not Status.OPTIMAL
    compared = compare_rules(problem, "torque", **ONE_NODE).solutions.values()
    assert {solution.status for solution in compared} & set(ENDED)


def test_searches_for_more_friction_stop_at_the_largest_that_there_may_be():
    """The floor holds on to nothing that is lifted, whatever its friction is."""
    legs = [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]]
    lifted = [0.0, 0.0, 4.9, 0.0, 0.0, 0.0]
    problem = QuasistaticProblem(legs, [[0.0, 0.0, 1.0]] * 3, lifted, friction=1000.0)
    assert np.isnan(minimum_friction(problem).factor)
    assert "an extra external wrench" in maximize_margin(problem).text()
    heavy = problem.with_changes(
        object_inertia=np.diag([0.5] * 3 + [1e-3] * 3), joint_inertia=np.zeros((0, 0))
    )
    assert not what_would_hold(heavy, []).changes


def test_the_sensitivity_takes_limits():
    problem = scene("sphere")
    limited = margin_sensitivity(problem, node_limit=1000, time_limit=60.0)
    np.testing.assert_allclose(limited.friction, margin_sensitivity(problem).friction)


@pytest.mark.parametrize(
    "analysis",
    [disturbance_margin, minimum_friction, margin_torque_curve, compare_rules, maximize_margin],
)
@pytest.mark.parametrize("limit", [{"node_limit": 0}, {"time_limit": -1.0}])
def test_impossible_limits_are_refused(analysis, limit):
    with pytest.raises(ArgumentError, match=next(iter(limit))):
        analysis(scene("rest"), **limit)


@pytest.mark.parametrize("limit", [50.0, 0.016, 0.0099])
def test_a_small_limit_hides_no_force(limit):
    """The force set has no normal-force limit, and 30 N stand on legs that are to bear so little.

    The legs at the corners bear 15, 7.5 and 7.5 N without the middle one, and it may bear all.
    """
    legs = [[0.1, 0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05], [0, 0, -0.05]]
    load = [0, 0, -30.0, 0, 0, 0]
    for count, upper in ((3, [15.0, 7.5, 7.5]), (4, [15.0, 7.5, 7.5, 30.0])):
        table = QuasistaticProblem(
            legs[:count], [[0, 0, 1]] * count, load, friction=0.5, max_normal_force=limit
        )
        bounds = contact_force_bounds(table, [], static_friction="coulomb")
        assert bounds.status is Status.OPTIMAL and bounds.proven.all()
        np.testing.assert_allclose(bounds.upper[:, 0], upper, rtol=1e-6)
        if count == 3:
            # They may push each other apart up to their friction, or not.
            room = 7.5 * np.sin(np.arctan(0.5 * np.cos(np.pi / table.cone_edges)))
            assert bounds.smallest_margin == pytest.approx(min(0.0, limit - 15.0), abs=1e-6)
            assert bounds.largest_margin == pytest.approx(min(room, limit - 15.0), abs=1e-6)
