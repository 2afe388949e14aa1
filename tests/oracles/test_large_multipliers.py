"""Multipliers of any size prove what their digits allow, and no more."""

from tests.oracles.judging import Outcome, judge
from tests.oracles.scale_scenes import scale_case


def test_rounding_of_endless_multipliers_makes_nothing_infeasible():
    """A solver left multipliers of 1e100 for a scene with a margin of 0.24 N."""
    assert judge(scale_case(1478)).outcome in (Outcome.AGREE, Outcome.UNVERIFIED)
