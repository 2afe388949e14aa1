"""States whose torques mean nothing: the hand is off the object, or deep in something.

`Scene.findings`, evaluators, studies, paths and `place_hand` have to tell the same.
"""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planning_scenes import example
from tests.cli.cli_tools import LINES

from graspless_pin import Evaluator, Waypoint, compiled, evaluate_path, load_scene, place_hand
from graspless_pin.errors import NoSolutionError
from graspless_pin.findings import Severity, is_serious
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import Box
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.planning import StateStatus, joint_trajectory
from graspless_pin.planning.placing_candidates import PlacingFault
from graspless_pin.scene import batch_states
from graspless_pin.studies import Study
from graspless_pin.studies.sample_evaluation import evaluate_each

WALL = """
  - name: wall
    shape: {type: box, size: [0.04, 0.04, 0.04]}
    pose: {position: [0, THERE, 0]}
"""
"""It reaches to THERE + 20 mm, and the tip, a ball that touches the box, from y = -0.12 on."""


def lever(tmp_path: Path, here: float = -0.1, wall: float | None = None) -> Path:
    text = LINES.replace("[-0.1, -0.1, 0.0]", f"[-0.1, {here}, 0.0]")
    text += "" if wall is None else WALL.removeprefix("\n").replace("THERE", str(wall))
    file = tmp_path / "lever.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def told(scene) -> set[str]:
    return {one.code.name for one in scene.findings if one.severity is Severity.SERIOUS}


def test_a_hand_167_mm_away_holds_nothing(tmp_path):
    file = lever(tmp_path, here=-0.267)
    scene = load_scene(file)
    assert told(scene) == {"HAND_TOUCHES_NOTHING"} and scene.solve().found

    evaluator = Evaluator(scene)
    state = evaluator.evaluate()
    assert state.status is StateStatus.HAND_TOUCHES_NOTHING
    assert state.reason == "no link of the hand touches object 'box'"
    assert not state.found and state.margin == -np.inf
    assert not evaluator.is_feasible(margin=0.1)
    assert not evaluator.are_feasible(np.zeros((3, 1)), margin=0.1).any()
    with pytest.raises(NoSolutionError, match="no link of the hand touches"):
        _ = state.torques

    released = Evaluator(scene, need_hand=False)
    assert released.evaluate().found and released.is_feasible(margin=0.1)

    rows = rows_of(file)
    assert [row["findings"] for row in rows] == ["hand-touches-nothing"] * 5
    assert all(row["found"] for row in rows)
    assert all("findings" not in row for row in rows_of(file, need_hand=False))


def rows_of(file: Path, **compute) -> list:
    vary = {"object.mass": {"from": 1.0, "to": 2.0, "steps": 5}}
    study = Study.from_data({"scene": str(file), "vary": vary, "compute": compute})
    return [*evaluate_each(study, [*enumerate(study.samples)])]


@pytest.mark.parametrize(("depth", "deep"), [(4.99e-3, False), (5.01e-3, True)])
def test_a_tip_in_a_wall_counts_from_max_penetration_on(tmp_path, depth, deep):
    file = lever(tmp_path, wall=-0.14 + depth)
    scene = load_scene(file)
    assert told(scene) == ({"HAND_THROUGH_SUPPORT"} if deep else set())
    evaluator = Evaluator(scene)
    state = evaluator.evaluate()
    assert state.found is not deep
    assert evaluator.is_feasible(margin=0.1) is not deep
    assert evaluator.are_feasible(np.zeros((2, 1)), margin=0.1).tolist() == [not deep] * 2
    if deep:
        assert state.status is StateStatus.HAND_THROUGH_SUPPORT
        assert state.reason == "hand link 'tip' and support 'wall' overlap by 5.01 mm"
    assert Evaluator(scene, collisions=False).is_feasible(margin=0.1)
    assert Evaluator(scene.with_changes(max_penetration=0.006)).is_feasible(margin=0.1)
    codes = {row.get("findings") for row in rows_of(file)}
    assert codes == {"hand-through-support" if deep else None}
    assert {row.get("findings") for row in rows_of(file, collisions=False)} == {None}


def test_an_arm_that_stands_in_a_support_is_not_feasible():
    """As an arm did whose links stood 44 and 105 mm in one."""
    scene = example("panda_arm_drag_board")
    assert Evaluator(scene).is_feasible(margin=0.0)
    forearm = next(one for one in scene.hand.placed_bodies if one.name == "panda_link5")
    block = Support("block", Box((0.2, 0.2, 0.2)), pose_matrix(forearm.T_world_geometry[:3, 3]))
    blocked = scene.with_changes(supports=(*scene.supports, block))
    assert "HAND_THROUGH_SUPPORT" in told(blocked)
    state = Evaluator(blocked).evaluate()
    assert state.status is StateStatus.HAND_THROUGH_SUPPORT
    assert not Evaluator(blocked).is_feasible(margin=0.0)
    assert Evaluator(blocked, collisions=False).is_feasible(margin=0.0)


SCENES = {
    # spread of the joints, rad or m, and how far from a fingertip's contact a block stands, m
    "allegro_box_on_slope": (0.5, 0.075),
    "panda_slide_cuboid_up_slope": (0.05, 0.05),
    "two_hands_slide_crate": (0.3, 0.05),
    "trihand_push_box": (0.6, 0.05),
}


def drawn(name: str, count: int, wall: bool) -> tuple:
    """A scene with a block behind a fingertip, and random configurations of its hand."""
    rng, scene, (spread, away) = np.random.default_rng(11), example(name), SCENES[name]
    evaluator = Evaluator(scene)
    if wall:
        first = scene.contacts.arrays
        at = first.positions[0] - away * first.normals[0] + [0.0, 0.0, 0.02]
        block = Support("block", Box((0.08, 0.05, 0.06)), pose_matrix(at, (0.3, 0.5, 0.7)))
        scene = scene.with_changes(supports=(*scene.supports, block))
    home = evaluator.configuration()
    spreads = rng.choice([0.0, 0.01, 1.0], count, p=[0.2, 0.4, 0.4])[:, None] * spread
    q = home + spreads * rng.uniform(-1.0, 1.0, (count, len(home)))
    return scene, np.clip(q, *evaluator.joint_limits)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("wall", [False, True], ids=["", "block"])
@pytest.mark.parametrize("name", SCENES)
def test_scenes_and_evaluators_tell_the_same(name, wall):
    scene, states = drawn(name, 24, wall)
    one, many = Evaluator(scene), Evaluator(scene)
    found = many.evaluate_many(states, workers=1)
    feasible = many.are_feasible(states, margin=0.01, workers=1)
    seen = Counter()
    for k, q in enumerate(states):
        expected = told(one.scene_at(q))
        status = found.statuses[k]
        assert one.evaluate(q).status is status
        assert one.is_feasible(q, margin=0.01) == feasible[k]
        if expected:
            if status not in (StateStatus.NO_CONTACT, StateStatus.OVERLAP):
                assert status.name in expected
            assert not feasible[k]
        else:
            assert status in (StateStatus.FOUND, StateStatus.INFEASIBLE, StateStatus.OVERLAP)
        seen[status] += 1
    assert seen[StateStatus.HAND_THROUGH_SUPPORT if wall else StateStatus.FOUND]


@pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")
@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", SCENES)
def test_loops_and_numpy_find_the_same_overlaps(name, by_numpy):
    scene, states = drawn(name, 30, wall=True)
    evaluator = Evaluator(scene)

    def overlaps() -> list:
        hands: list[Any] = [evaluator.scene_at(q).hand for q in states]
        return [unwanted_overlaps(one, scene.supports, tolerance=0.003) for one in hands]

    ours, theirs = overlaps(), by_numpy(overlaps)
    assert any(ours)
    for mine, other in zip(ours, theirs, strict=True):
        assert [replace(one, depth=0.0) for one in mine] == [
            replace(one, depth=0.0) for one in other
        ]
        depths = [one.depth for one in mine], [one.depth for one in other]
        np.testing.assert_allclose(*depths, rtol=0.0, atol=1e-9)


def test_paths_tell_the_number_of_a_state(tmp_path):
    scene = load_scene(lever(tmp_path))
    profile = evaluate_path(scene, [Waypoint(), Waypoint(q={"hinge": 0.5}), Waypoint()])
    assert profile.failures == (1,) and not profile.found
    assert profile.failure_reason(1) == "no link of the hand touches object 'box'"
    assert "at 1 s: no torques at waypoint 1, no link of the hand touches" in str(profile)
    with pytest.raises(NoSolutionError, match="waypoint 1"):
        joint_trajectory(profile)


@pytest.mark.parametrize("sunk", [False, True])
def test_no_place_has_the_base_of_its_arm_in_a_support(sunk):
    """The base does not move: it stands in a support wherever the hand is placed."""
    scene = example("panda_arm_drag_board").with_changes(motion=None)
    plinth = Support("plinth", Box((0.2, 0.2, 0.02)), np.eye(4))
    supports = (*scene.supports, plinth) if sunk else scene.supports
    scene = scene.with_changes(supports=supports)
    found = place_hand(scene, candidates=4, aim="press", verdict_nodes=0, workers=1)
    assert bool(found.places) is not sunk
    assert not any(is_serious(place.scene.findings) for place in found.places)
    assert (PlacingFault.HAND_ON_SUPPORT in found.faults) is sunk


@pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")
def test_states_that_loops_leave_alone_are_refused_for_deep_links_all_the_same(monkeypatch):
    """What loops prove of them spares the search for overlaps, and hides none."""
    scene, rng = example("trihand_pivot_box"), np.random.default_rng(3)
    evaluator = Evaluator(scene)
    spread = rng.uniform(-1.0, 1.0, (200, len(evaluator.joint_names)))
    q = np.clip(evaluator.configuration() + spread, *evaluator.joint_limits)
    posed = batch_states.BatchContactFinder(scene).contacts_at(q)
    assert posed is not None
    found = evaluator.evaluate_many(q, workers=1).statuses
    left = found[posed.counts < 0]
    assert StateStatus.HAND_THROUGH_ITSELF in left and StateStatus.FOUND in left
    for at, doubtful in zip(map(evaluator.scene_at, q), posed.doubtful, strict=True):
        assert at.hand is not None
        deep = unwanted_overlaps(at.hand, at.supports, tolerance=at.max_penetration)
        assert doubtful or not deep
    monkeypatch.setattr(batch_states, "core", None)
    assert Evaluator(scene).evaluate_many(q, workers=1).statuses.tolist() == found.tolist()
