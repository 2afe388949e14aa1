"""Scenes whose bodies have sharp edges go through every command that finds contacts."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from cli_tools import LINES, run, spoilt

from graspless_pin.geometry import BodyKind
from graspless_pin.scene import load_scene
from graspless_pin.viewer import answer_settings, initial_settings

APEXES = [5, 50, 59, 90, 170]  # degrees
SUPPORTS = """\
  - {name: left, shape: {type: mesh, path: prism.stl}, pose: {position: [-0.06, 0, -0.1]}}
  - {name: right, shape: {type: mesh, path: prism.stl}, pose: {position: [0.06, 0, -0.1]}}
"""


@pytest.fixture(params=APEXES)
def scene_file(request, tmp_path):
    """The box of the lever's scene on the ridges of two prisms along y."""
    half = min(0.05 * np.tan(np.radians(0.5 * request.param)), 0.04)
    low = -half / np.tan(np.radians(0.5 * request.param))
    base = [(x, y, low) for x in (-half, half) for y in (-0.15, 0.15)]
    prism = trimesh.convex.convex_hull(np.array([(0, -0.15, 0), (0, 0.15, 0), *base]))
    prism.export(tmp_path / "prism.stl")
    file = tmp_path / "scene.yaml"
    file.write_text(LINES[: LINES.index("  - name: floor")] + SUPPORTS, encoding="utf-8")
    return file


def test_solve(scene_file):
    assert run("solve", scene_file, "--no-verdict").exit_code == 0
    ends = {(x, y, -0.1) for x in (-0.06, 0.06) for y in (-0.1, 0.1)}
    on_ridges = [
        one for one in load_scene(scene_file).contacts.arrays if one.kind is BodyKind.SUPPORT
    ]
    assert {tuple(one.position.round(6).tolist()) for one in on_ridges} == ends
    for one in on_ridges:
        np.testing.assert_allclose(one.normal, [0, 0, 1], atol=1e-9)


def test_settle(scene_file, tmp_path):
    text = scene_file.read_text(encoding="utf-8")
    raised = spoilt("pose: {position: [0, 0, 0]}", "pose: {position: [0, 0, 0.3]}", text)
    scene_file.write_text(raised, encoding="utf-8")
    assert run("settle", scene_file, "-o", tmp_path / "settled.yaml").exit_code == 0
    settled = load_scene(tmp_path / "settled.yaml")
    np.testing.assert_allclose(settled.object.T_world_object[:3, 3], 0.0, atol=2e-6)


def test_view(scene_file):
    scene = load_scene(scene_file)
    shown = answer_settings(scene, initial_settings(scene))
    assert shown.solution is not None and shown.solution.found, shown.reason
