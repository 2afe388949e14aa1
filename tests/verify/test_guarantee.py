"""What documents say of guaranteed torques is checked, and no false claim passes."""

from __future__ import annotations

import copy
import json
from functools import cache
from typing import Any

import pytest
from tests.holding.cases import block_between_walls, pressed_in_slot
from verified_documents import failed

from graspless_pin import Torque, optimize
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document


@cache
def _document(kind: str) -> dict[str, Any]:
    problem = block_between_walls(0.5)
    if kind != "infeasible_strong":
        most = 5.0 if kind == "strong_not_found" else 40.0
        problem = pressed_in_slot().with_changes(torque_limits=(0.0, most))
    found = optimize(problem, Torque(0.1), stability="strong", static_friction="coulomb")
    assert found.status.name.lower() == kind
    return json.loads(json.dumps(solution_document(found)))


def document(kind: str) -> dict[str, Any]:
    return copy.deepcopy(_document(kind))


def test_guaranteed_torques_are_proven_and_their_gaps_worked_out_again() -> None:
    made = document("strong")
    checked = verify_document(made)
    assert checked.proven, str(checked)
    names = {one.name for one in checked.checks}
    assert {"the torques are guaranteed", "rest is the only outcome"} <= names
    assert {"gap as stated", "gap to the best case as stated"} <= names
    details = {one.name: one.detail for one in checked.checks}
    assert details["the best case is within its bound"].endswith(" N")
    torque = made["joints"][0]["torque"]
    assert made["guarantee"]["gap"] == pytest.approx(torque - made["guarantee"]["best_case"])


def test_that_there_are_none_is_proven_without_joints_and_said_to_be_open_elsewhere() -> None:
    assert verify_document(document("infeasible_strong")).proven
    open_still = verify_document(document("strong_not_found"))
    assert open_still.passed
    assert not open_still.proven


@pytest.mark.parametrize(("key", "change", "check"), [
    ("gap", lambda gap: 0.5 * gap, "gap to the best case as stated"),
    ("gap", lambda _: 0.0, "gap to the best case as stated"),
    ("best_case", lambda best: 0.5 * best, "the best case is within its bound"),
    ("best_case", lambda best: best + 1e-4, "gap to the best case as stated"),
    ("best_case", lambda _: 100.0, "the best case is no worse than the answer"),
])  # fmt: skip
def test_false_costs_are_found(key: str, change: Any, check: str) -> None:
    made = document("strong")
    made["guarantee"][key] = change(made["guarantee"][key])
    assert check in failed(made)


def test_a_guarantee_needs_a_strong_verdict() -> None:
    made = document("strong")
    made["stability"]["status"] = "undecided"
    assert "the torques are guaranteed" in failed(made)
    del made["stability"]
    assert failed(made) == ["the torques are guaranteed"]


def test_a_smaller_gap_to_the_bound_is_found() -> None:
    made = document("strong")
    made["certificate"]["gap"] *= 0.5
    assert "gap as stated" in failed(made)
    made = document("strong")
    made["certificate"]["bound"] = made["joints"][0]["torque"]
    made["certificate"]["gap"] = 0.0
    assert {"bound over all friction", "the best case is within its bound"} <= set(failed(made))


def test_a_guarantee_is_not_left_out() -> None:
    made = document("strong")
    del made["guarantee"]
    with pytest.raises(ValueError, match="guarantee"):
        verify_document(made)
    made = document("infeasible_strong")
    made["stability"]["status"] = "undecided"
    assert "no torques are guaranteed" in failed(made)
    made = document("strong_not_found")
    made["status"], made["message"] = "infeasible_strong", "infeasible: rest is the only outcome"
    assert "no torques are guaranteed" in failed(made)
