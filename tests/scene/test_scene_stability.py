"""Verdicts on scenes: what `solve` leads with, what documents hold, and hands on supports."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from graspless_pin import Stability, load_scene
from graspless_pin.cli.commands import app
from graspless_pin.errors import ArgumentError
from graspless_pin.scene.scene_stability import hand_support_contacts
from graspless_pin.simulation import simulation_model

ROOT = Path(__file__).parents[2]
CUBOID = str(ROOT / "examples/paper/cuboid_at_rest.yaml")
SLIDING = str(ROOT / "examples/paper/cuboid_sliding_up.yaml")


def _printed(*arguments: str) -> list[str]:
    return CliRunner().invoke(app, ["solve", *arguments]).output.splitlines()


def test_solve_leads_with_whether_the_object_stays() -> None:
    lines = _printed(CUBOID)
    assert lines[1].startswith("holds: the object provably stays at rest (")
    assert _printed(SLIDING)[1].startswith("keeps its motion: nothing else is an outcome (proof: ")
    assert not any("provably" in line for line in _printed(CUBOID, "--no-verdict"))


def test_few_nodes_leave_it_undecided_and_say_how_to_ask_for_more() -> None:
    said = " ".join(_printed(CUBOID, "--algorithm", "torque", "--verdict-nodes", "30"))
    assert "undecided: the object can stay, but motion was not ruled out (30 sets of" in said
    assert re.search(r"; try --verdict-nodes 1000 \(about [1-9]\d* (s|min)\)", said)
    scene = load_scene(CUBOID)
    torques = scene.solve("torque", margin=0.1).torques
    few = scene.stability(torques, node_limit=30)
    assert few.next_nodes == 1000 and few.seconds > 0.0
    assert re.search(r"; try node_limit=1000 \(about ", str(few)) and "try" not in few.message
    # More than a limit of none: nobody knows yet how long a node takes.
    none = scene.stability(torques, node_limit=0)
    assert str(none).endswith("try node_limit=1000")
    # What a time limit ended is not asked to look at more.
    brief = scene.stability(torques, time_limit=0.0)
    assert brief.status is Stability.UNDECIDED and brief.next_nodes == 0


def test_nothing_is_decided_where_the_hand_touches_a_support(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = load_scene(CUBOID)
    assert hand_support_contacts(scene) == ()
    torques = scene.solve().torques
    assert scene.stability(torques).status is Stability.STRONG
    monkeypatch.setattr(
        "graspless_pin.scene.scene_stability.hand_support_contacts",
        lambda _: (("tip", "slope"),),
    )
    said = scene.stability(torques)
    assert said.status is Stability.UNDECIDED
    assert "tip on slope" in said.message
    with pytest.raises(TypeError, match="nodes"):
        scene.stability(torques, nodes=3)
    with pytest.raises(ArgumentError, match="node_limit"):
        scene.stability(torques, node_limit=-1)


def test_a_massless_link_costs_the_verdict_and_not_the_solution(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(*_: object) -> None:
        raise ArgumentError("joint_inertia", "is singular at joint 'knuckle'")

    monkeypatch.setattr("graspless_pin.problem.inertias.moving_joints", refuse)
    lines = _printed(CUBOID)
    assert lines[1] == "no verdict: joint_inertia: is singular at joint 'knuckle'"
    assert any("margin e = " in line for line in lines)
    report = ["report", CUBOID, "--no-ranges", "-o", str(tmp_path / "report.html")]
    result = CliRunner().invoke(app, report)
    assert result.exit_code == 0
    assert result.stderr == f"note: {lines[1]}\n"


def test_torques_may_be_given_by_joint() -> None:
    """As solutions tell them; each joint is needed."""
    scene = load_scene(CUBOID)
    solution = scene.solve()
    by_joint: dict[str, float] = dict(reversed([*solution.torques_by_joint.items()]))
    np.testing.assert_array_equal(scene.stability(by_joint).torques, solution.torques)
    np.testing.assert_array_equal(
        simulation_model(scene, by_joint).commands,
        simulation_model(scene, solution.torques).commands,
    )
    borne = [
        scene.tolerances(one, quantities=["more mass"]).each[0].balanced
        for one in (by_joint, solution.torques)
    ]
    assert borne[0] == borne[1]
    for wrong, told in (
        ({"thumb": 1.0}, "torques: unknown joint 'thumb'; known: finger_1/hinge"),
        ({"finger_1/hinge": 1.0}, "torques: has no entry for 'finger_6/hinge'; give all joints"),
    ):
        with pytest.raises(ArgumentError, match=re.escape(told)):
            scene.stability(wrong)
