"""Disturbances by direction, and torque against margin."""

from dataclasses import replace

import numpy as np
import pytest

from graspless_pin import Holding, QuasistaticProblem, TorqueSolution, disturbance_margin
from graspless_pin.algorithms.margin_torque_curve import margin_torque_curve
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.planning import EndReason, SqueezeWindow, WindowEnd
from graspless_pin.plots import (
    disturbance_polar,
    margin_torque_plot,
    plane_directions,
    squeeze_plot,
)
from graspless_pin.problem.checks import JointUnit


@pytest.fixture(scope="module")
def pressed() -> QuasistaticProblem:
    """A frictionless contact on either side in x and one below and above in z, each up to 5 N."""
    normals = np.array([[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    return QuasistaticProblem(
        -0.1 * normals, normals, np.zeros(6), friction=0.0, max_normal_force=[5, 3, 4, 2]
    )


def test_the_polar_plot_is_the_box_of_the_limits(pressed: QuasistaticProblem):
    """Forces along x between -5 and 3 N and along z between -4 and 2 N are balanced: a box."""
    directions = plane_directions("fx", "fz", 16)
    margin = disturbance_margin(pressed, directions=directions)
    axes = disturbance_polar(margin, "fx", "fz")
    angles, radii = axes.lines[0].get_data()
    angles, radii = np.asarray(angles), np.asarray(radii)
    assert len(angles) == 17 and angles[0] == angles[-1] and radii[0] == radii[-1]
    # A contact pushes along its normal: a disturbance along -x is held by the one with +x.
    x, z = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        expected = np.minimum(np.where(x > 0, 3 / abs(x), 5 / abs(x)),
                              np.where(z > 0, 2 / abs(z), 4 / abs(z)))  # fmt: skip
    np.testing.assert_allclose(radii, expected, atol=1e-4)
    (least,) = (item for item in axes.lines if str(item.get_label()).startswith("smallest: "))
    assert np.ravel(least.get_ydata())[0] == pytest.approx(2.0, abs=1e-4)


def test_other_directions_are_left_out(pressed: QuasistaticProblem):
    directions = np.vstack([plane_directions("fx", "fz", 4), np.eye(6)[3:]])
    axes = disturbance_polar(disturbance_margin(pressed, directions=directions))
    assert len(np.asarray(axes.lines[0].get_xdata())) == 5
    margin = disturbance_margin(pressed, directions=np.eye(6)[:2])
    with pytest.raises(ArgumentError, match=r"has 1 directions .*=plane_directions\('fx', 'fz'\)"):
        disturbance_polar(margin)


def test_directions_go_around():
    directions = plane_directions("mz", "fy", 4)
    expected = np.zeros((4, 6))
    expected[[0, 2], 5] = 1.0, -1.0
    expected[[1, 3], 1] = 1.0, -1.0
    np.testing.assert_allclose(directions, expected, atol=1e-15)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fx", "x"), "second: is 'x'; it must be one of fx, fy, fz, mx, my, mz"),
        (("fx", "fx"), "second: is 'fx', like the first"),
        (("fx", "fz", 2), "count: is 2"),
    ],
)
def test_a_plane_that_is_none(arguments, message):
    with pytest.raises(ArgumentError, match=message):
        plane_directions(*arguments)


def test_nothing_to_draw(infeasible: TorqueSolution):
    margin = disturbance_margin(infeasible.problem, directions=plane_directions("fx", "fz", 4))
    with pytest.raises(NoSolutionError, match="no disturbance margin"):
        disturbance_polar(margin)
    with pytest.raises(NoSolutionError, match="no curve to draw"):
        margin_torque_plot(margin_torque_curve(infeasible.problem))


def test_the_trade_off_is_the_curve(sliding: TorqueSolution):
    curve = margin_torque_curve(sliding.problem)
    axes = margin_torque_plot(curve)
    whole, *pieces = axes.lines
    assert len(pieces) == len(curve.margins)
    np.testing.assert_allclose(np.asarray(whole.get_xdata()), curve.margins.ravel())
    ends = np.array([np.asarray(line.get_xydata())[[0, -1]] for line in pieces])
    np.testing.assert_allclose(ends[:, :, 0], curve.margins)
    np.testing.assert_allclose(ends[:, :, 1], curve.torques)
    assert ends[-1, -1, 0] == pytest.approx(sliding.margin, abs=1e-5)


@pytest.mark.parametrize(
    ("units", "scale", "label"),
    [
        (None, "absolute", "N m"),
        (("N", "N"), "absolute", "N"),
        (("N m", "N"), "absolute", "N m; N for prismatic and hybrid joints"),
        (("N m", "N"), "limits", "share of the limit"),
    ],
)
def test_the_trade_off_is_in_the_joints_units(sliding: TorqueSolution, units, scale, label):
    problem = sliding.problem.with_changes(joint_units=units)
    curve = margin_torque_curve(problem, scale=scale)
    assert margin_torque_plot(curve).get_ylabel() == f"minimum of the largest |torque|\n[{label}]"
    assert f" of torque [{label}]" in str(curve)


def test_a_window_of_squeeze_shows_its_ends_and_samples():
    window = SqueezeWindow(
        direction=np.ones(1),
        lower=WindowEnd(-0.4, np.ones(1), 2.0, EndReason.MAY_SLIP, "may fail: ..."),
        upper=WindowEnd(0.7, np.ones(1), 7.0, EndReason.LIMIT, "joint 'a' is at its effort limit"),
        others=(),
        amounts=np.array([-1.0, -0.5, 0.0, 0.7]),
        torques=np.ones((4, 1)),
        normal_forces=np.array([np.nan, 1.0, 3.0, 7.0]),
        holding=(Holding.FAILS, Holding.MAY_FAIL, Holding.HOLDS, Holding.HOLDS),
        margins=np.array([np.nan, 0.1, 0.3, 0.5]),
        growth=np.array([np.nan, np.nan, 0.0, 0.0]),
        controller="",
        message="holds: ...",
        joint_names=("a",),
        joint_units=(JointUnit.TORQUE,),
    )
    axes = squeeze_plot(window)
    line, holds, others = axes.lines[:3]
    np.testing.assert_array_equal(line.get_ydata(), window.margins)
    np.testing.assert_array_equal(holds.get_xdata(), [0.0, 0.7])
    np.testing.assert_array_equal(others.get_xdata(), [-1.0, -0.5])
    assert [text.get_text() for text in axes.texts] == ["may slip", "limit"]
    ends = [np.asarray(end.get_xdata()).item(0) for end in axes.lines[3:]]
    assert ends == [-0.4, 0.7]
    assert -1.0 < axes.get_xlim()[0] < -0.5, "the sample at -1 has no margin"
    end = WindowEnd(-1.0, np.ones(1), 2.0, EndReason.FINGER_MOVES, "fails: ...")
    widest = squeeze_plot(replace(window, lower=end))
    widest.figure.canvas.draw()
    for name in widest.texts:  # beside the axis and its ticks
        box = name.get_window_extent()
        assert widest.bbox.x0 < box.x0 and box.x1 < widest.bbox.x1
    assert squeeze_plot(window, value="growth").get_ylabel() == "growth of small\nmotions [1/s]"
    pressed = squeeze_plot(window, value="normal_force")
    np.testing.assert_array_equal(pressed.lines[0].get_ydata(), window.normal_forces)
    assert pressed.get_ylabel() == "sum of the hand's\nnormal forces [N]"
    with pytest.raises(ArgumentError, match="value: is 'force'"):
        squeeze_plot(window, value="force")
