"""Margin and torques along a path."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from graspless_pin import load_scene
from graspless_pin.planning import PathProfile, Waypoint, evaluate_path
from graspless_pin.plots import path_margins, path_torques

PAPER = Path(__file__).resolve().parents[2] / "examples" / "paper"


@pytest.fixture(scope="module")
def profile() -> PathProfile:
    """The paper's cuboid is held for two waypoints, then leaves the slope, then the fingers."""
    scene = load_scene(PAPER / "cuboid_at_rest.yaml")
    away = scene.object.T_world_object.copy()
    away[:3, 3] += 0.5 * np.array([1.0, 0.0, 1.0])
    held = [Waypoint(time=time) for time in (0.0, 0.5, 1.0)]
    return evaluate_path(scene, [*held, Waypoint(T_world_object=away, time=2.0)])


def lines(axes) -> dict[str, np.ndarray]:
    return {
        str(line.get_label()): np.asarray(line.get_xydata(), dtype=float) for line in axes.lines
    }


def test_margins(profile: PathProfile):
    axes = path_margins(profile)
    drawn = lines(axes)["margin"]
    assert profile.failures == (2, 3)
    np.testing.assert_array_equal(drawn[:, 0], profile.times)
    found = np.isfinite(profile.margins)
    np.testing.assert_array_equal(drawn[found, 1], profile.margins[found])
    assert np.isnan(drawn[~found, 1]).all()
    crosses = lines(axes)["no torques"]
    assert crosses[:, 0].tolist() == [1.0, 2.0]


def test_a_constant_is_a_level_line_on_an_axis_from_zero(profile: PathProfile):
    """No common offset, and no rounding spread over the whole height."""
    margin = float(profile.margins[0])
    level = replace(profile, margins=margin + 1e-13 * np.arange(len(profile.margins)))
    axes = path_margins(level)
    axes.figure.canvas.draw()
    low, high = axes.get_ylim()
    assert (low, high) == (0.0, pytest.approx(1.08 * margin))
    assert axes.yaxis.get_offset_text().get_text() == ""
    assert axes.get_legend() is not None


def test_torques(profile: PathProfile):
    axes = path_torques(profile)
    drawn = lines(axes)
    assert len(profile.torque_names) == 2
    for index, name in enumerate(profile.torque_names):
        np.testing.assert_array_equal(drawn[name][:, 1], profile.torques[:, index])
    assert np.isfinite(profile.torques[:2]).all()
    ends = [np.asarray(line.get_xydata(), dtype=float) for line in axes.lines]
    upright = [points[0, 0] for points in ends if points[:, 1].tolist() == [0.0, 1.0]]
    assert upright == [1.0, 2.0], "where the contacts change"


def test_joints_of_any_name_stand_in_the_legend(profile: PathProfile):
    """A dollar begins no mathematics, and an underscore leaves no line out."""
    axes = path_torques(replace(profile, torque_names=("$\\frac$", "_x^{")))
    axes.figure.canvas.draw()
    legend = axes.get_legend()
    assert legend is not None
    told = [text.get_text().strip() for text in legend.get_texts()]
    assert told[:2] == ["\\$\\frac\\$", "_x^{"]
