"""Loads and accelerations in MuJoCo: what the least torques hold, and what less does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.scene.scene_tools import EXAMPLES, loaded

from graspless_pin import Scene, load_scene
from graspless_pin.scene import Acceleration
from graspless_pin.simulation import simulate
from graspless_pin.simulation.model import STIFF

ARM = {"panda_joint1": 1.0, "panda_joint4": 0.5}
FASTER = {"panda_joint1": 3.0, "panda_joint2": 2.0}


def stays(scene: Scene, torques: np.ndarray) -> bool:
    (run,) = simulate(scene, torques, contact_models=[STIFF], seconds=0.3).runs
    return run.outcome == "held"


@pytest.mark.parametrize(
    "acceleration",
    [
        Acceleration(linear=[2.0, 0.0, 0.0]),
        Acceleration(angular=[0.0, 0.0, 4.0], angular_velocity=[0.0, 0.0, 2.0]),
        Acceleration(joint_velocities=ARM, joint_accelerations=FASTER),
    ],
    ids=["the base starts", "the base turns", "the arm moves"],
)
def test_a_gripper_holds_with_the_least_force_and_no_less(acceleration: Acceleration) -> None:
    scene = load_scene(EXAMPLES / "panda_stop_with_board.yaml").with_changes(
        controller=2.0, acceleration=acceleration
    )
    least, own = scene.solve("torque", margin=0.0).torques, scene.problem().gravity_torques
    assert stays(scene, own + 1.1 * (least - own))
    assert not stays(scene, own + 0.95 * (least - own))


def on_the_floor(load: dict[str, Any], folder: Any) -> Scene:
    data = {
        "friction": 0.8,
        "object": {"shape": {"type": "box", "size": [0.2, 0.2, 0.2]}, "mass": 1.0,
                   "pose": {"position": [0, 0, 0.1]}},
        "supports": [{"name": "floor", "shape": {"type": "half_space"}}],
        "loads": [{"name": "load", **load}],
    }  # fmt: skip
    return loaded(folder, data)


@pytest.mark.parametrize(
    ("load", "tips"),
    [
        ({"mass": 1.9, "at": [0.15, 0.0, 0.0]}, False),
        ({"mass": 2.1, "at": [0.15, 0.0, 0.0]}, True),
        ({"moment": [0.0, 0.95 * 0.981, 0.0]}, False),
        ({"moment": [0.0, 1.05 * 0.981, 0.0]}, True),
        ({"force": [0.0, 0.0, -18.0], "at": [0.15, 0.0, 0.0], "axes": "object"}, False),
        ({"force": [0.0, 0.0, -21.0], "at": [0.15, 0.0, 0.0], "axes": "object"}, True),
        ({"field": [9.0, 0.0, 0.0]}, True),
        ({"field": [7.0, 0.0, 0.0]}, False),
    ],
)
def test_what_tips_a_box_of_1_kg(load: dict[str, Any], tips: bool, tmp_path: Any) -> None:
    """About an edge 0.1 m away; of what hangs 0.05 m beyond the edge twice its own weight."""
    scene = on_the_floor(load, tmp_path)
    assert stays(scene, np.zeros(0)) is not tips
    verdict = scene.stability(np.zeros(0))
    assert (str(verdict.status) == "strong") is not tips
