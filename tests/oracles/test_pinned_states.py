"""A slice of `make pinned`, and that it would notice a derivative that is off."""

import pytest
from tests.oracles.pinned_states import WORST, compared

from graspless_pin.geometry.contact.curvature import Rates
from graspless_pin.planning import pinned_contacts


@pytest.mark.parametrize(
    ("scene", "algorithm"),
    [
        ("allegro_sphere_on_slope", "torque"),
        ("panda_slide_cuboid_up_slope", "margin"),
        ("paper/cuboid_at_rest", "margin"),
    ],
)
def test_gradients_are_the_differences_of_solves(scene, algorithm):
    counts, worst = compared(scene, algorithm, 2)
    assert counts["states with torques"] == 2
    for kind, limit in WORST.items():
        assert counts[kind] >= 6
        assert worst[kind] <= limit


def test_a_rate_that_is_off_is_noticed(monkeypatch):
    right = pinned_contacts.pin_rates

    def wrong(*given):
        one = right(*given)
        return Rates(*one[:2], 1.01 * one.middle, one.smooth)

    monkeypatch.setattr(pinned_contacts, "pin_rates", wrong)
    _, worst = compared("paper/cuboid_at_rest", "margin", 2)
    assert worst["optimum"] > WORST["optimum"]
    assert worst["gaps"] <= WORST["gaps"]
