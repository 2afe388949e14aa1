"""What is drawn of a solution is what the solution says."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.text import Annotation
from tests.report.report_cases import pinched_block

from graspless_pin import (
    TorqueSolution,
    contact_force_bounds,
    load_scene,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.plots import friction_section, normal_force_ranges, torque_bars
from graspless_pin.plots.solutions import section_corners
from graspless_pin.visualization import LIGHT, Role

PAPER = Path(__file__).resolve().parents[2] / "examples" / "paper"


def bars(axes: Axes) -> list[Rectangle]:
    return [patch for patch in axes.patches if isinstance(patch, Rectangle)]


def marks(axes: Axes) -> list[float]:
    """Where the vertical marks stand."""
    lines = next(item for item in axes.collections if isinstance(item, LineCollection))
    return [float(segment[0, 0]) for segment in np.asarray(lines.get_segments())]


def test_the_bars_are_the_torques_and_the_marks_the_limits():
    solution = maximize_margin(pinched_block(torque_limits=([-2.0, -3.0], [1.5, 2.5])))
    axes = torque_bars(solution)
    np.testing.assert_allclose([bar.get_width() for bar in bars(axes)], solution.torques)
    assert np.abs(solution.torques).min() > 0.1
    assert marks(axes) == [-2.0, -3.0, 1.5, 2.5]
    labels = [tick.get_text() for tick in axes.get_yticklabels()]
    assert labels == ["joint_1", "joint_2"]
    bottom, top = axes.get_ylim()
    assert bottom > top, "the first joint is on top"
    # Infinite limits have none.
    solution = minimize_torque(
        pinched_block(torque_limits=([-np.inf, -3.0], [1.5, np.inf])), margin=0.2
    )
    assert marks(torque_bars(solution)) == [-3.0, 1.5]


def test_a_torque_at_its_limit_has_another_colour():
    solution = maximize_margin(pinched_block(torque_limits=([-0.5, -9.0], [9.0, 9.0])))
    assert solution.torques[0] == pytest.approx(-0.5)
    first, second = bars(torque_bars(solution))
    assert first.get_facecolor() != second.get_facecolor()


def test_the_callers_axes_are_used(sliding: TorqueSolution):
    figure = Figure()
    left, middle, right = figure.subplots(1, 3)
    assert torque_bars(sliding, left) is left
    assert friction_section(sliding, 0, middle) is middle
    bounds = contact_force_bounds(sliding.problem, sliding.torques)
    assert normal_force_ranges(bounds, sliding, right) is right


@pytest.mark.parametrize("contact", [0, 1])
def test_a_cone_section_has_the_force_inside_its_cone(sliding: TorqueSolution, contact: int):
    axes = friction_section(sliding, contact)
    problem, force = sliding.problem, sliding.contact_forces[contact]
    dot = next(line for line in axes.lines if line.get_label() == "friction force")
    local = problem.tangents[contact].T @ force
    np.testing.assert_allclose(np.ravel(np.asarray(dot.get_data(), dtype=float)), local, atol=1e-12)
    assert np.linalg.norm(local) > 1.0
    normal = problem.normals[contact] @ force
    (circle,) = (patch for patch in axes.patches if isinstance(patch, Circle))
    assert circle.radius == pytest.approx(problem.friction[contact] * normal)
    cone, kept = (patch for patch in axes.patches if isinstance(patch, Polygon))
    corners = cone.get_xy()[:-1]
    assert len(corners) == problem.cone_edges == 6
    np.testing.assert_allclose(np.linalg.norm(corners, axis=1), circle.radius)
    assert kept.get_path().contains_point(local, radius=1e-6)
    assert not kept.get_path().contains_point(corners[0])


def test_the_inner_polygon_keeps_the_margin(sliding: TorqueSolution):
    """Half way along each of its edges the nearest face of the cone is the margin away."""
    problem, contact = sliding.problem, 1
    inner = section_corners(sliding, contact, sliding.margin)
    middles = 0.5 * (inner + np.roll(inner, -1, axis=0))
    normal = problem.normals[contact] @ sliding.contact_forces[contact]
    block = problem.H[3 * contact : 3 * contact + 3]
    faces = block[:, np.abs(block).sum(axis=0) > 0.0]
    for middle in middles:
        force = normal * problem.normals[contact] + problem.tangents[contact] @ middle
        assert -(faces.T @ force).max() == pytest.approx(sliding.margin)
    assert len(section_corners(sliding, contact, 50.0)) == 0


def test_sliding_and_friction_are_opposite(sliding: TorqueSolution):
    axes = friction_section(sliding, 2)
    assert sliding.problem.is_sliding[2]
    assert "sliding, 100 % used" in axes.get_title()
    (arrow,) = axes.texts
    assert isinstance(arrow, Annotation)
    head = np.array(arrow.xy)
    dot = next(line for line in axes.lines if line.get_label() == "friction force")
    friction = np.ravel(np.asarray(dot.get_data(), dtype=float))
    cosine = head @ friction / np.linalg.norm(head) / np.linalg.norm(friction)
    assert cosine == pytest.approx(-1.0)
    assert dot.get_color() == LIGHT.roles[Role.FRICTION_AT_LIMIT]


def test_a_frictionless_contact_has_no_cone():
    axes = friction_section(maximize_margin(pinched_block(friction=[0.5, 0.5, 0.0])), 2)
    assert list(axes.patches) == [] and list(axes.texts) == []
    assert "frictionless" in axes.get_title()


@pytest.mark.parametrize("contact", [-1, 6])
def test_a_contact_that_is_not_there(sliding: TorqueSolution, contact: int):
    with pytest.raises(ArgumentError, match=r"contact: is .*the problem has contacts 0 to 5"):
        friction_section(sliding, contact)


def test_nothing_is_drawn_of_what_was_not_found(infeasible: TorqueSolution):
    with pytest.raises(NoSolutionError):
        torque_bars(infeasible)
    with pytest.raises(NoSolutionError):
        friction_section(infeasible, 0)
    bounds = contact_force_bounds(infeasible.problem, [])
    with pytest.raises(NoSolutionError, match="no force ranges"):
        normal_force_ranges(bounds)


def test_the_ranges_are_the_bounds(sliding: TorqueSolution):
    bounds = contact_force_bounds(sliding.problem, sliding.torques)
    axes = normal_force_ranges(bounds, sliding)
    lower, upper = bounds.lower[:, 0], bounds.upper[:, 0]
    assert (upper - lower).max() > 1.0
    drawn = bars(axes)
    np.testing.assert_allclose([bar.get_x() for bar in drawn], lower)
    np.testing.assert_allclose([bar.get_x() + bar.get_width() for bar in drawn], upper)
    dots = next(line for line in axes.lines if line.get_label() == "of the solution")
    normal = (sliding.problem.normals * sliding.contact_forces).sum(axis=1)
    np.testing.assert_allclose(np.asarray(dots.get_xdata(), dtype=float), normal)


def test_an_unbounded_force_ends_in_an_arrow():
    """Two fixed bodies pinch a block with friction: nothing limits the squeeze."""
    problem = pinched_block(jacobian=None, torque_limits=(-9.0, 9.0))
    bounds = contact_force_bounds(problem, [], static_friction="coulomb")
    free = np.isinf(bounds.upper[:, 0])
    assert free.all()
    axes = normal_force_ranges(bounds)
    arrows = next(line for line in axes.lines if line.get_label() == "unbounded")
    np.testing.assert_allclose(np.asarray(arrows.get_ydata(), dtype=float), [0, 1, 2])
    assert np.isfinite(np.asarray(arrows.get_xdata(), dtype=float)).all()


@pytest.mark.parametrize("name", ["cuboid_sliding_up", "sphere_on_slope"])
def test_marks_and_dots_stand_clear_of_the_ends(name: str):
    """A determined force at either end is seen whole, and the axis begins at zero."""
    solution = load_scene(PAPER / f"{name}.yaml").solve()
    bounds = contact_force_bounds(solution.problem, solution.torques)
    axes = normal_force_ranges(bounds, solution)
    left, right = axes.get_xlim()
    assert -0.1 * right < left < 0.0
    top = bounds.upper[:, 0].max()
    assert bounds.lower[:, 0].max() == pytest.approx(top)  # determined, and the rightmost
    assert right > 1.1 * top
