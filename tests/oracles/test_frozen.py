"""What `make frozen` calls a difference."""

from tests.oracles.frozen import differences


def kinds(new, base):
    return [kind for kind, _ in differences({"one": new}, {"one": base})]


def test_values_agree_within_the_gap_that_a_search_left():
    base = {"status": "optimal", "values": [1.0, 1.0], "loose": 0.0}
    assert kinds({**base, "values": [1.0 + 5e-8, 1.0]}, base) == []
    assert kinds({**base, "values": [1.0 + 5e-7, 1.0]}, base) == ["value"]
    assert kinds({**base, "values": [1.0 + 5e-7, 1.0], "loose": 1e-6}, base) == []
    assert kinds({**base, "values": ["inf", 1.0]}, base) == ["value"]
    assert kinds({**base, "values": [None, 1.0]}, base) == []  # not proven


def test_only_what_was_open_may_be_decided():
    assert kinds({"status": "strong"}, {"status": "undecided"}) == ["decided"]
    assert kinds({"status": "undecided"}, {"status": "strong"}) == ["status"]
    assert kinds({"status": "optimal"}, {"status": "infeasible"}) == ["status"]


def test_commands_are_held_by_their_exit_code_and_shown_by_their_text():
    base = {"exit": 0, "text": "holds"}
    assert kinds({"exit": 0, "text": "stays"}, base) == ["text"]
    assert kinds({"exit": 1, "text": "holds"}, base) == ["exit code"]
    assert kinds(base, {"exit": 2, "text": "holds"}) == ["read"]


def test_lost_answers_are_told():
    assert [kind for kind, _ in differences({}, {"one": {}})] == ["lost"]
