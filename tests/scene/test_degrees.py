"""Keys in degrees say the same as those in radians, wherever a scene file has angles."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scene_tools import EXAMPLES, hand_of, loaded

from graspless_pin import load_scene
from graspless_pin.errors import SceneError, StudyError
from graspless_pin.studies import Study

ALLEGRO = (EXAMPLES / "allegro_box_on_slope.yaml").read_text()
DEGREES = (
    ALLEGRO.replace("rpy: [0, -2.617994, 0]", "rpy_deg: [0, -150, 0] # palm")
    .replace("rpy: [0, 0.5235988, 0]", "rpy_deg: [0, 30, 0]")
    .replace("    joint_1.0: 0.3\n", "")
    .replace("  q:\n", "  q_deg: {joint_1.0: 17.5} # bent\n  q:\n")
)


def test_degrees_mean_what_radians_mean(tmp_path: Path) -> None:
    scene = loaded(tmp_path, DEGREES)
    radians = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    assert hand_of(scene).q["joint_1.0"] == math.radians(17.5)
    np.testing.assert_allclose(
        hand_of(scene).T_world_base, hand_of(radians).T_world_base, atol=1e-6
    )
    np.testing.assert_allclose(
        scene.supports[0].T_world_support, radians.supports[0].T_world_support, atol=1e-7
    )


def test_saved_files_keep_the_form_and_all_that_did_not_change(tmp_path: Path) -> None:
    scene = loaded(tmp_path, DEGREES)
    assert scene.save(tmp_path / "same.yaml").read_text() == DEGREES
    bent = scene.with_changes(
        hand=hand_of(scene).with_configuration({"joint_1.0": math.radians(20), "joint_2.0": 0.6})
    )
    text = bent.save(tmp_path / "bent.yaml").read_text()
    assert "q_deg: {joint_1.0: 20.0} # bent" in text
    assert "joint_2.0: 0.6\n" in text
    assert "rpy_deg: [0, -150, 0] # palm" in text
    again = load_scene(tmp_path / "bent.yaml")
    np.testing.assert_allclose(hand_of(again).positions, hand_of(bent).positions, atol=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("joint_1.0: 17.5", "joint_2.0: 17.5", "found joint 'joint_2.0' in q and in q_deg"),
        ("joint_1.0: 17.5", "joint_1.0: 175", "hand.q_deg['joint_1.0']: is 3.05"),
        ("joint_1.0: 17.5", "joint_1.7: 17.5", "joint_1.7"),
        ("rpy_deg: [0, 30, 0]", "rpy_deg: [0, 30]", "supports[0].pose.rpy_deg"),
        ("rpy_deg: [0, 30, 0]", "{rpy: [0, 1, 0], rpy_deg: [0, 30, 0]}", "rpy and rpy_deg"),
    ],
)
def test_what_does_not_do_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = DEGREES.replace(f"{{{old}}}" if new.startswith("{") else old, new)
    with pytest.raises(SceneError) as caught:
        loaded(tmp_path, text)
    assert message in str(caught.value)


@pytest.mark.parametrize("degrees", [1, 30])
def test_a_linear_joint_has_no_degrees(tmp_path: Path, degrees: int) -> None:
    text = (
        f"friction: 0.3\nhand: {{robot: panda_hand, q_deg: {{panda_finger_joint1: {degrees}}}}}\n"
        "object: {shape: {type: sphere, radius: 0.1}, mass: 1, pose: {position: [0, 0, 1]}}\n"
    )
    with pytest.raises(SceneError, match="panda_finger_joint1: is a prismatic joint; give metres"):
        loaded(tmp_path, text)


def test_a_study_varies_angles_of_either_form(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(DEGREES)
    vary = {
        "slope": {"key": "supports.slope.pose.rpy.1", "values": [20, 30], "unit": "deg"},
        "bend": {"key": "hand.q.joint_1.0", "values": [0.2, 0.3], "unit": "rad"},
    }
    study = Study.from_data({"scene": "scene.yaml", "vary": vary}, tmp_path)
    tree = study.tree_at((20, 0.2))
    assert tree["supports"][0]["pose"]["rpy"] == pytest.approx([0.0, math.radians(20), 0.0])
    assert tree["hand"]["q"]["joint_1.0"] == 0.2 and "q_deg" not in tree["hand"]
    with pytest.raises(StudyError, match="use rpy instead, in rad, or in a study with unit: deg"):
        Study.from_data(
            {"scene": "scene.yaml", "vary": {"x": {"key": "object.pose.rpy_deg.1", "values": [1]}}},
            tmp_path,
        )
