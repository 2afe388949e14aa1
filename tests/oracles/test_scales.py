"""A slice of `make scales`: no answer at any scale is wrong, and next to none is missing."""

from tests.oracles.judging import Outcome, ask, judge
from tests.oracles.scale_scenes import scale_case
from tests.oracles.scales import judged, passes

from graspless_pin import Status, contact_force_bounds, margin_torque_curve

SLICE = range(30, 37)


def test_scenes_of_every_scale_agree_with_the_exact_optimum():
    lines = [judged(seed) for seed in SLICE]
    assert passes(lines), [line for line in lines if line.outcome != "agree"]
    assert sum(line.found for line in lines) >= 3


def test_rounding_of_endless_multipliers_makes_nothing_infeasible():
    """A solver left multipliers of 1e100 for a scene with a margin of 0.24 N."""
    assert judge(scale_case(1478)).outcome in (Outcome.AGREE, Outcome.UNVERIFIED)


def test_forces_that_rounding_alone_allows_are_no_error():
    """Torques next to nothing with tiny levers: a margin beyond all limits is not looked for."""
    case = scale_case(143)
    bounds = contact_force_bounds(case.problem, ask(case.problem, case.question).torques)
    assert bounds.status in (Status.OPTIMAL, Status.LIMIT_REACHED, Status.UNVERIFIED)


def test_a_torque_that_costs_nothing_is_not_held_against_its_box():
    """The largest margin is asked of Algorithm 2's program: its torque ends at 1e13."""
    curve = margin_torque_curve(scale_case(858).problem, node_limit=20)
    assert curve.status in (Status.OPTIMAL, Status.LIMIT_REACHED, Status.UNVERIFIED)
