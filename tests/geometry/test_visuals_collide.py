"""Links without collision shapes collide with their visual ones on request."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from graspless_pin import load_scene
from graspless_pin.cli.commands import app
from graspless_pin.findings import FindingCode
from graspless_pin.geometry.inspection import audit_urdf

URDF = """<robot name="drawn"><link name="palm">
<visual><origin xyz="0 0 0.1" rpy="0 0 1.5707963"/><geometry><mesh filename="egg.stl"/></geometry>
<material name="red"/></visual></link>
<joint name="hinge" type="revolute"><parent link="palm"/><child link="tip"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="tip"><visual><geometry><box size="1 1 1"/></geometry></visual>
<collision><geometry><sphere radius="0.01"/></geometry></collision></link></robot>"""
OBJECT = """friction: 0.5
object: {shape: {type: sphere, radius: 0.1}, mass: 1, pose: {position: [0, 0, 9]}}
"""


@pytest.fixture(autouse=True)
def hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("drawn.urdf").write_text(URDF)
    egg = trimesh.creation.icosphere(2, radius=0.03)
    egg.apply_scale([1.0, 0.5, 0.5])
    egg.export("egg.stl")


def shapes(hand_entry: str) -> dict[str, np.ndarray]:
    Path("scene.yaml").write_text(f"hand: {{{hand_entry}}}\n{OBJECT}")
    hand = load_scene("scene.yaml").hand
    assert hand is not None
    return {body.name: body.T_world_geometry for body in hand.collision_bodies()}


def test_only_links_without_a_collision_shape_take_their_visual_one() -> None:
    assert list(shapes("urdf: drawn.urdf")) == ["tip"]
    found = shapes("urdf: drawn.urdf, visuals_collide: true")
    assert list(found) == ["palm", "tip"]
    scene = load_scene("scene.yaml")
    assert scene.hand is not None
    palm, tip = scene.hand.collision_bodies()
    assert tip.geometry.radius == 0.01
    # The mesh is turned by a quarter and lifted, as its origin says.
    np.testing.assert_allclose(found["palm"][:3, 3], [0.0, 0.0, 0.1], atol=1e-9)
    points = np.array(palm.geometry.points()) @ found["palm"][:3, :3].T
    np.testing.assert_allclose(np.ptp(points, axis=0), [0.03, 0.06, 0.03], atol=1e-6)


def test_a_robot_file_may_say_so_and_a_scene_the_contrary() -> None:
    Path("drawn.yaml").write_text("name: drawn\nurdf: drawn.urdf\nvisuals_collide: true\n")
    assert list(shapes("robot: drawn.yaml")) == ["palm", "tip"]
    assert list(shapes("robot: drawn.yaml, visuals_collide: false")) == ["tip"]
    saved = load_scene("scene.yaml").with_changes(name="again").save("saved.yaml").read_text()
    assert "visuals_collide: false" in saved


def test_the_audit_names_the_key_and_is_content_with_it() -> None:
    told = {one.code: one for one in audit_urdf("drawn.urdf").findings}
    assert "visuals_collide: true" in told[FindingCode.NO_COLLISION].advice
    Path("drawn.yaml").write_text("name: drawn\nurdf: drawn.urdf\nvisuals_collide: true\n")
    codes = [one.code for one in audit_urdf("drawn.yaml").findings]
    assert FindingCode.NO_COLLISION not in codes


def test_new_writes_the_key() -> None:
    made = ["new", "drawn.urdf", "sphere:0.02", "--visuals-collide"]
    assert CliRunner().invoke(app, made, catch_exceptions=False).exit_code == 0
    scene = load_scene("scene.yaml")
    assert scene.hand is not None
    assert [body.name for body in scene.hand.collision_bodies()] == ["palm", "tip"]
