"""Hands from xacro files, against the URDF that they stand for."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cutting_here import Here

from graspless_pin.errors import RobotError
from graspless_pin.geometry.hand import reading
from graspless_pin.geometry.hand.reading import read_robot
from graspless_pin.geometry.hand.tree import build_tree
from graspless_pin.geometry.inspection import audit_urdf
from graspless_pin.geometry.robots.files import describe_urdf

PARTS = """
<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:property name="length" value="0.04"/>
  <xacro:macro name="finger" params="side sign">
    <link name="${side}"><collision><origin xyz="0 0 ${length / 2}"/><geometry>
      <box size="0.01 0.01 ${length}"/></geometry></collision></link>
    <joint name="${side}_joint" type="revolute"><parent link="palm"/><child link="${side}"/>
      <origin xyz="${sign * 0.03} 0 0"/><axis xyz="0 1 0"/>
      <limit lower="${-radians(30)}" upper="0.5" effort="$(arg effort)" velocity="1"/></joint>
  </xacro:macro>
</robot>
"""
HAND = """
<robot name="claw" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="effort" default="0.7"/>
  <xacro:include filename="$(find claw_parts)/parts.xacro"/>
  <link name="palm"/>
  <xacro:finger side="left" sign="1"/>
  <xacro:finger side="right" sign="-1"/>
</robot>
"""


@pytest.fixture
def claw(tmp_path: Path) -> Path:
    """Return the hand's file; the package that it includes is in another folder."""
    parts = tmp_path / "ros" / "claw_parts"
    parts.mkdir(parents=True)
    (parts / "parts.xacro").write_text(PARTS)
    path = tmp_path / "claw.urdf.xacro"
    path.write_text(HAND)
    return path


def test_a_xacro_file_is_the_hand_that_it_stands_for(claw: Path, tmp_path: Path) -> None:
    described = describe_urdf(claw, [tmp_path / "ros"])
    document = read_robot(replace(described, xacro_args={"effort": "0.9"}))
    tree = build_tree([(document, np.eye(4))])
    assert tree.joint_names == ("left_joint", "right_joint")
    np.testing.assert_allclose(tree.lower, -np.pi / 6)
    np.testing.assert_allclose(tree.pinocchio_model.upperEffortLimit, 0.9)
    left, right = tree.geometries
    np.testing.assert_allclose(left.T_joint_geometry[:3, 3], [0.0, 0.0, 0.02])
    np.testing.assert_allclose(right.shape.halfSide, [0.005, 0.005, 0.02])


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Expand files in this process, which then goes back to its folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(reading, "ChildProcess", Here)


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("name", ["claw.xacro", "CLAW.XACRO"])
def test_one_that_declares_no_xacro_is_one_by_its_name(claw: Path, name: str) -> None:
    plain = claw.with_name(name)
    plain.write_text("<robot name='claw'><link name='${1 + 1}'/></robot>")
    assert read_robot(describe_urdf(plain)).root == "2"


@pytest.mark.usefixtures("here")
def test_a_robot_file_gives_packages_and_arguments(claw: Path, tmp_path: Path) -> None:
    robot = tmp_path / "claw.yaml"
    robot.write_text("name: claw\nurdf: claw.urdf.xacro\nxacro_args: {effort: '0.5'}\n")
    (claw.parent / "ros" / "claw_parts").rename(claw.parent / "claw_parts")
    claw.write_text(HAND.replace("$(find claw_parts)", "claw_parts"))
    report = audit_urdf(robot)
    assert report.loads
    assert report.joints == ("left_joint", "right_joint")


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(("old", "new", "said"), [
    ("claw_parts", "other_parts", "other_parts"),
    ('<xacro:arg name="effort" default="0.7"/>', "", "effort.*under xacro_args in a robot file"),
    ('sign="1"', "", "sign"),
])  # fmt: skip
def test_what_cannot_be_expanded_is_said(
    claw: Path, tmp_path: Path, old: str, new: str, said: str
) -> None:
    claw.write_text(HAND.replace(old, new))
    with pytest.raises(RobotError, match=f"xacro cannot expand this file .*{said}") as caught:
        read_robot(describe_urdf(claw, [tmp_path / "ros"]))
    assert str(claw) in str(caught.value)


def test_one_that_takes_for_ever_ends(
    claw: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "_XACRO_SECONDS", 1.0)
    endless = '<xacro:macro name="again"><xacro:again/><xacro:again/></xacro:macro><xacro:again/>'
    claw.write_text(HAND.replace('<link name="palm"/>', endless + '<link name="palm"/>'))
    with pytest.raises(RobotError, match=r"xacro (did not|cannot) expand this file"):
        read_robot(describe_urdf(claw, [tmp_path / "ros"]))


def test_without_xacrodoc_it_says_what_to_install(
    claw: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(RobotError, match=r"pip install 'graspless-pin\[xacro\]'"):
        read_robot(describe_urdf(claw))
