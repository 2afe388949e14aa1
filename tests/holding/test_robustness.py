"""How much rest bears, and what would make it hold: figures that are known by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import GRAVITY, block_between_walls, block_on_slope, hybrid_on_wall, pressed_on_wall
from tests.cli.cli_tools import LINES, run

from graspless_pin import QuasistaticProblem, Robustness, Stability, robustness, what_would_hold
from graspless_pin.algorithms import what_would_hold as changes_that_hold
from graspless_pin.errors import ArgumentError


@pytest.fixture(scope="module")
def commanded() -> Robustness:
    # 25 N bear the weight with the finger's friction alone: certificates prove all but the ends.
    return robustness(hybrid_on_wall(), [25.0], precision=0.4, node_limit=20)


def test_torque_errors_are_borne_up_to_what_friction_needs(commanded: Robustness) -> None:
    (less,), (more,) = commanded.less, commanded.more
    exact = 25.0 - GRAVITY
    # The finger's own friction is a certificate down to 19.62 N.
    assert 0.9 * (25.0 - 2.0 * GRAVITY) <= less.guaranteed <= exact
    np.testing.assert_allclose(less.failing, exact, rtol=1e-2)
    assert more.guaranteed == more.possible
    assert more.failing == np.inf
    assert commanded.all_less is not None
    np.testing.assert_allclose(commanded.all_less.failing, exact / 25.0, rtol=1e-2)
    assert commanded.all_more is not None
    assert commanded.all_more.failing == np.inf


def test_the_rest_relies_on_the_finger_alone(commanded: Robustness) -> None:
    assert 4 in commanded.relies_on
    assert len(commanded.without) == 5
    for contact, verdict in enumerate(commanded.without):
        assert verdict is not None
        assert verdict.problem.contact_count == 4
        assert (verdict.status is Stability.STRONG) == (contact not in commanded.relies_on)
    assert "contacts without which rest is not proven:" in str(commanded)
    assert "joint_1: tolerates -" in str(commanded)


def test_with_time_enough_nothing_is_another(commanded: Robustness) -> None:
    found = robustness(hybrid_on_wall(), [25.0], precision=0.4, node_limit=20, time_limit=1e9)
    assert found.complete
    assert found.relies_on == commanded.relies_on
    assert str(found) == str(commanded)


def test_joints_that_nothing_holds_are_told_of_together() -> None:
    # A motor bears its link's weight beside a stool, another link floats: both move at any error.
    beside = QuasistaticProblem(
        [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]],
        [[0.0, 0.0, 1.0]] * 3,
        [0.0, 0.0, -4.9, 0.0, 0.0, 0.0],
        friction=0.5,
        jacobian=np.zeros((9, 2)),
        gravity_torques=[2.0, 0.0],
        joint_inertia=1e-3 * np.eye(2),
        object_inertia=np.diag([0.5, 0.5, 0.5, 1e-3, 1e-3, 1e-3]),
    )
    told = str(robustness(beside, [2.0, 0.0]))
    assert "joint_1, joint_2: rely on joint feedback" in told
    assert "an error of 0.002 N m, 0.1 % of the largest torque, already fails" in told
    assert "all torques together: rely on joint feedback: an error of 0.1 % already fails" in told
    assert "e-" not in told


def test_nothing_is_said_of_what_may_move() -> None:
    found = robustness(block_between_walls(0.5), [])
    assert found.without == found.less == ()
    assert str(found) == found.verdict.message


def test_what_no_change_mends_is_not_mended() -> None:
    assert what_would_hold(block_between_walls(0.5), []).changes == ()


def test_each_change_of_a_weak_grip_was_tried() -> None:
    # Twice the torque is not enough, three times is beyond the limit: what is between is found.
    problem = hybrid_on_wall().with_changes(torque_limits=(0.0, 25.0))
    changes = what_would_hold(problem, [9.0], node_limit=40).changes
    words = " | ".join(str(change) for change in changes)
    for part in ("contact torques", "a preload", "maximize_margin", "friction at contact 4"):
        assert part in words
    for change in changes:
        assert change.verdict.status is Stability.STRONG
    assert GRAVITY <= changes[0].torques[0] <= 2.0 * GRAVITY * 1.05
    rubbed = next(change for change in changes if "at contact 4" in change.words)
    # 9 N press on finger and wall: less friction balances no weight.
    assert 2.0 * GRAVITY / 9.0 - 1.0 <= rubbed.problem.friction[4] / 0.5 <= 3.0


def test_torques_beyond_their_limits_are_not_made_larger() -> None:
    """Nor smaller under that name: others that are within them hold."""
    problem = hybrid_on_wall().with_changes(torque_limits=(0.0, 25.0))
    words = [str(change) for change in what_would_hold(problem, [30.0], node_limit=40).changes]
    assert words == ["torques of maximize_margin with stability='strong'"]


@pytest.mark.parametrize("columns", [1, 2])
def test_all_joints_behind_a_contact_are_held_where_they_are_several(
    columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = hybrid_on_wall()
    problem = problem.with_changes(
        jacobian=np.tile(problem.jacobian, columns), joint_inertia=np.eye(columns),
        joint_names=None, joint_units=None, torque_limits=(0.0, 1.0), gravity_torques=None,
    )  # fmt: skip
    tried = list[str]()
    monkeypatch.setattr(
        changes_that_hold, "_verified_change", lambda _, words, __: tried.append(words)
    )
    monkeypatch.setattr(changes_that_hold, "_smallest_change", lambda *_: None)
    assert what_would_hold(problem, np.zeros(columns), node_limit=1).changes == ()
    held = [words for words in tried if "control" in words]
    each = [f"joint joint_{k + 1} under position control" for k in range(columns)]
    several = ["all joints that act on contact 4 under position control"] * (columns > 1)
    assert held == [*each, *several]


@pytest.mark.parametrize("least", [0.05, 0.3, 0.5, 0.9])
def test_the_smallest_change_is_found_by_halving_from_none_at_all(
    least: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried = list[float]()

    def holds(size: float, words: str, nodes: int) -> str | None:
        tried.append(size)
        return words if size >= least else None

    monkeypatch.setattr(changes_that_hold, "_verified_change", holds)
    smallest: Any = changes_that_hold._smallest_change  # of numbers instead of changed problems
    found = smallest(lambda size: size, (0.5, 1.0), str, 1)
    assert least <= float(str(found)) <= least + 0.02
    assert min(tried) > 0.0


def test_what_slides_is_refused() -> None:
    sliding = block_on_slope(0.5, 0.4).with_changes(sliding=np.tile([0.1, 0.0, 0.0], (4, 1)))
    for ask in (robustness, what_would_hold):
        with pytest.raises(ArgumentError, match="has sliding contacts"):
            ask(sliding, [])
    with pytest.raises(ArgumentError, match="torques"):
        what_would_hold(pressed_on_wall(), [])


def test_the_command_line_names_the_motion_by_which_contacts_slide() -> None:
    result = run("robustness", "examples/trihand_push_box.yaml")
    assert result.exit_code == 2
    assert "trihand_push_box.yaml: motion: contacts slide in the declared motion" in result.stderr
    assert "leave the key out" in result.stderr


def test_the_command_line_lists_the_gaps_of_what_is_relied_on(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(LINES.replace("position: [0, 0, 0]", "position: [0, 0, 2.0e-4]"))
    result = run("robustness", file, "--nodes", "5")
    assert result.exit_code == 0, result.output
    assert "contacts without which rest is not proven" in result.output
    assert "must first close its gap of 0.2 mm" in result.output
