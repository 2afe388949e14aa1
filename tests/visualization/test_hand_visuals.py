"""Hands look as their URDF's visual shapes say, at their configuration."""

import pickle
from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspless_pin.geometry.bodies.meshes import Triangles
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.visualization.drawing import hand_triangles

URDF = """\
<robot name="finger">
  <link name="palm">
    <visual><geometry><sphere radius="0.05"/></geometry></visual>
    <collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
  </link>
  <link name="tip">
    <visual>
      <origin xyz="0 0 0.2" rpy="0 1.5707963267948966 0"/>
      <geometry><mesh filename="tip.stl" scale="{scale}"/></geometry>
    </visual>
    <collision><geometry><sphere radius="0.01"/></geometry></collision>
    <inertial><mass value="0.1"/></inertial>
  </link>
  <joint name="bend" type="revolute">
    <origin xyz="0 0 0.1"/><parent link="palm"/><child link="tip"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
</robot>
"""


def finger(folder: Path, scale: str = "0.001 0.001 0.001", *, with_mesh: bool = True) -> Hand:
    if with_mesh:
        trimesh.creation.box((10.0, 20.0, 40.0)).export(folder / "tip.stl")
    (folder / "finger.urdf").write_text(URDF.format(scale=scale), encoding="utf-8")
    return Hand.assemble([Mount(folder / "finger.urdf", prefix="a/")], q={"a/bend": np.pi / 2})


def extent(surface: Triangles) -> np.ndarray:
    return np.array([surface.vertices.min(axis=0), surface.vertices.max(axis=0)])


def volume(surface: Triangles) -> float:
    return trimesh.Trimesh(surface.vertices, surface.faces).volume


def test_visual_shapes_are_drawn_at_the_configuration(tmp_path):
    drawn = dict(hand_triangles(finger(tmp_path)))
    assert set(drawn) == {"a/palm", "a/tip"}
    assert extent(drawn["a/palm"]) == pytest.approx(np.array([[-0.05] * 3, [0.05] * 3]))
    # Turned by rpy its long edge lies along x, and by the joint along y.
    half, center = np.array([0.010, 0.020, 0.005]), np.array([0.0, 0.0, 0.3])
    assert extent(drawn["a/tip"]) == pytest.approx(np.array([-half, half]) + center)
    assert volume(drawn["a/tip"]) == pytest.approx(8e-6)
    drawn = dict(hand_triangles(finger(tmp_path, "0.001 -0.001 0.001")))
    assert volume(drawn["a/tip"]) == pytest.approx(8e-6)


def test_collision_shapes_stand_in_for_visuals_that_cannot_be_read(tmp_path):
    drawn = dict(hand_triangles(finger(tmp_path, with_mesh=False)))
    assert np.ptp(drawn["a/tip"].vertices, axis=0) == pytest.approx([0.02] * 3, rel=1e-2)
    assert np.ptp(drawn["a/palm"].vertices, axis=0) == pytest.approx([0.1] * 3)
    (tmp_path / "tip.stl").write_text("no mesh", encoding="utf-8")
    drawn = dict(hand_triangles(finger(tmp_path, with_mesh=False)))
    assert np.ptp(drawn["a/tip"].vertices, axis=0) == pytest.approx([0.02] * 3, rel=1e-2)


def test_looks_survive_pickling(tmp_path):
    hand = finger(tmp_path)
    again = dict(hand_triangles(pickle.loads(pickle.dumps(hand))))  # noqa: S301 - our own
    for link, surface in hand_triangles(hand):
        assert np.array_equal(again[link].vertices, surface.vertices)


@pytest.mark.sampled(2)
@pytest.mark.filterwarnings("ignore::graspless_pin.errors.GrasplessPinWarning")
@pytest.mark.parametrize("name", ["allegro_right", "panda_hand", "trihand", "psyonic_right"])
def test_every_link_lies_where_its_collision_shape_does(name):
    """A real hand's visual and collision shapes of one link overlap."""
    hand = Hand.assemble([Mount(name)])
    boxes: dict[str, list[np.ndarray]] = {}
    for link, surface in hand_triangles(hand):
        boxes.setdefault(link, []).append(extent(surface))
    assert boxes
    for body in hand.collision_bodies():
        seen = np.array(boxes[body.name])
        low, high = seen[:, 0].min(axis=0), seen[:, 1].max(axis=0)
        center = body.T_world_geometry[:3, 3]
        reach = 0.6 * np.linalg.norm(high - low)
        assert np.linalg.norm(np.clip(center, low, high) - center) < reach, body.name
