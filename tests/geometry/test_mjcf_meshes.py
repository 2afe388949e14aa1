"""Meshes of an MJCF are read from the files that MuJoCo reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspless_pin import Hand

FINGER = """
<mujoco>
  <compiler COMPILER/>
  <asset><mesh name="pad" file="FILE"/></asset>
  <worldbody><body name="palm">
    <geom size="0.01"/>
    <body name="finger" pos="0 0 0.1">
      <joint name="bend" axis="0 1 0"/><geom type="mesh" mesh="pad"/>
    </body>
  </body></worldbody>
  <actuator><motor joint="bend" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
ATTACHED = """
<mujoco>
  <asset><model name="inner" file="inner/finger.xml"/></asset>
  <worldbody><frame><attach model="inner" body="palm" prefix="my_"/></frame></worldbody>
</mujoco>
"""
PAD = (0.02, 0.04, 0.06)


def write_pad(file: Path, size: tuple[float, float, float] = PAD) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box(size).export(file)


def size_of_pad(path: Path, link: str) -> np.ndarray:
    (body,) = (one for one in Hand.from_urdf(path).collision_bodies() if one.name == link)
    return np.ptp(body.geometry.points(), axis=0)


@pytest.mark.parametrize("other_pad", [False, True])
def test_of_an_attached_model_whose_folder_is_another(tmp_path: Path, *, other_pad: bool) -> None:
    write_pad(tmp_path / "inner" / "parts" / "pad.stl")
    if other_pad:  # what the outer file would mean by that name
        write_pad(tmp_path / "pad.stl", (0.1, 0.1, 0.1))
    finger = FINGER.replace("COMPILER", 'meshdir="parts"').replace("FILE", "pad.stl")
    (tmp_path / "inner" / "finger.xml").write_text(finger)
    outer = tmp_path / "outer.xml"
    outer.write_text(ATTACHED)
    np.testing.assert_allclose(size_of_pad(outer, "my_finger"), PAD, rtol=1e-6)


@pytest.mark.parametrize("other_pad", [False, True])
def test_without_the_folders_that_strippath_leaves_out(tmp_path: Path, *, other_pad: bool) -> None:
    write_pad(tmp_path / "parts" / "pad.stl")
    if other_pad:
        write_pad(tmp_path / "parts" / "old" / "pad.stl", (0.1, 0.1, 0.1))
    finger = tmp_path / "finger.xml"
    compiler = 'meshdir="parts" strippath="true"'
    finger.write_text(FINGER.replace("COMPILER", compiler).replace("FILE", "old/pad.stl"))
    np.testing.assert_allclose(size_of_pad(finger, "finger"), PAD, rtol=1e-6)
