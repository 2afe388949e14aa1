"""Time limits of what asks for many verdicts: what is proven by then is true, and it says so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import GRAVITY, block_between_walls, block_on_slope, hybrid_on_wall
from tests.cli.cli_tools import LINES, run

from graspless_pin import (
    Stability,
    guaranteed_disturbance,
    maximize_margin,
    robustness,
    tree_search,
    what_would_hold,
)
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

PUSH, TURN = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]


class Clock:
    """A clock that goes on by one second each time it is read."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        self.now += 1.0
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Limits count looks at the clock: no test depends on speed."""
    made = Clock()
    monkeypatch.setattr(tree_search, "time", made)
    return made


def disturbed(**options: Any) -> Any:
    return guaranteed_disturbance(
        block_on_slope(0.5, 0.0), [], [PUSH, TURN],
        characteristic_length=1.0, precision=0.1, **{"node_limit": 100, **options},
    )  # fmt: skip


def assert_true_disturbances(found: Any) -> None:
    exact = np.array([0.5 * GRAVITY, 0.05 * GRAVITY])
    seen = found.reached
    for figures in (found.guaranteed, found.failing, found.possible):
        np.testing.assert_array_equal(np.isnan(figures), ~seen)
    assert (found.guaranteed[seen] <= exact[seen] + 1e-3 * GRAVITY).all()
    assert (found.failing[seen] >= exact[seen] - 1e-9).all()
    solution = maximize_margin(block_on_slope(0.5, 0.0), static_friction="coulomb")
    document = solution_document(solution, disturbances=found)
    for claim, reached in zip(document["disturbances"]["directions"], seen, strict=True):
        assert (claim["guaranteed"] is not None) == reached
    checks = verify_document(document).checks
    assert not [line for line in checks if line.passed is False]
    missed = [line for line in checks if "was not examined" in line.name]
    assert len(missed) == np.sum(~seen)


def test_without_time_no_direction_is_looked_at() -> None:
    found = disturbed(time_limit=0.0)
    assert found.found  # one certificate
    assert not found.complete.any()
    assert len(found.brackets) == 2
    assert not found.reached.any()
    assert str(found) == "the time limit ended the search before the first of 2 directions"
    with pytest.raises(NoSolutionError, match="ended the search before the first direction"):
        assert found.worst
    assert_true_disturbances(found)


@pytest.mark.parametrize("seconds", [3.0, 6.0, 12.0, 25.0, 50.0])
def test_what_is_guaranteed_when_the_time_is_over_is_true(seconds: float, clock: Clock) -> None:
    found = disturbed(time_limit=seconds)
    assert not found.complete.all()
    assert_true_disturbances(found)


def test_a_direction_that_was_not_reached_is_told_from_one_that_bears_nothing(clock: Clock) -> None:
    found = next(
        one for one in (disturbed(time_limit=float(k)) for k in range(3, 60)) if one.reached.any()
    )
    assert found.reached.tolist() == [True, False]
    assert found.worst == 0 and str(found).endswith("; directions not reached in time: 1")


def test_with_time_enough_nothing_is_another() -> None:
    free, timed = disturbed(node_limit=20), disturbed(node_limit=20, time_limit=1e9)
    assert free.complete.all()
    assert timed.complete.all()
    np.testing.assert_array_equal(free.guaranteed, timed.guaranteed)
    assert str(free) == str(timed)


def test_robustness_without_time_says_so_and_relies_on_all() -> None:
    found = robustness(hybrid_on_wall(), [25.0], time_limit=0.0)
    assert found.verdict.status is Stability.STRONG
    assert not found.complete
    assert found.relies_on == (0, 1, 2, 3, 4)
    assert [one.complete for one in (*found.less, *found.more)] == [False, False]
    assert not any(one.reached for one in (*found.less, *found.more))
    assert np.isnan([one.guaranteed for one in (*found.less, *found.more)]).all()
    assert "not reached before the time limit" in str(found)
    assert str(found).endswith("ended the search: a larger one may give more results")


@pytest.mark.parametrize("seconds", [2.0, 5.0, 15.0, 40.0])
def test_torque_errors_that_are_borne_when_the_time_is_over_are(
    seconds: float, clock: Clock
) -> None:
    found = robustness(hybrid_on_wall(), [25.0], precision=0.4, node_limit=20, time_limit=seconds)
    exact = 25.0 - GRAVITY
    for bracket, most in ((found.less[0], exact), (found.all_less, exact / 25.0)):
        assert bracket is not None
        assert not bracket.guaranteed > most
        assert not bracket.failing < most - 1e-9
    assert found.complete == (clock.now <= seconds)


def test_changes_that_hold_are_those_found_by_then(clock: Clock) -> None:
    problem = hybrid_on_wall().with_changes(torque_limits=(0.0, 40.0))
    counts = list[int]()
    for seconds in (0.0, 60.0, 1e9):
        found = what_would_hold(problem, [9.0], node_limit=40, time_limit=seconds)
        counts.append(len(found.changes))
        assert found.complete == (seconds == 1e9)
        assert all(change.verdict.status is Stability.STRONG for change in found.changes)
    assert counts[0] == 0
    assert counts == sorted(counts)
    assert counts[-1] > 3
    assert what_would_hold(block_between_walls(0.5), []).complete


@pytest.mark.parametrize("ask", [
    lambda limit: disturbed(time_limit=limit),
    lambda limit: robustness(hybrid_on_wall(), [25.0], time_limit=limit),
    lambda limit: what_would_hold(hybrid_on_wall(), [9.0], time_limit=limit),
])  # fmt: skip
@pytest.mark.parametrize("limit", [-1.0, np.nan, "soon"])
def test_time_limits_are_checked(ask: Any, limit: Any) -> None:
    with pytest.raises(ArgumentError, match="time_limit"):
        ask(limit)


def test_the_command_line_takes_a_time_limit(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(LINES)
    result = run("robustness", file, "--nodes", "5", "--time-limit", "0")
    assert result.exit_code == 3, result.output
    assert "undecided: the object can stay" in result.output
    assert "the time limit ended the search: a larger one may give more results" in result.output
    assert run("robustness", file, "--time-limit", "-1").exit_code == 2
