"""A slice of `make states`, and that it would notice a batch that is wrong."""

import pytest
from tests.oracles import verified_states
from tests.oracles.verified_states import verified

from graspless_pin.planning import StateStatus


@pytest.mark.parametrize(
    ("scene", "algorithm"), [("allegro_box_on_slope", "margin"), ("paper/cuboid_at_rest", "torque")]
)
def test_the_checker_verifies_states_of_a_batch(scene, algorithm):
    told = list(verified(scene, algorithm, 6))
    assert len(told) == 6
    assert [said for _, said in told if said] == []
    assert any(status is StateStatus.FOUND for status, _ in told)


def test_an_optimum_that_is_off_is_noticed(monkeypatch):
    monkeypatch.setattr(verified_states, "SAME", -1.0)
    told = list(verified("trihand_push_box", "margin", 2))
    assert all("in the batch" in said for status, said in told if status is StateStatus.FOUND)
    assert any(said for _, said in told)
