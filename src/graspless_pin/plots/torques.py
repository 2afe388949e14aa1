"""Joint torques against their limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.plots.canvas import axes_for, legend_above, plain_axis, plain_text
from graspless_pin.problem.joint_units import units_text
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.utilization import limit_shares
from graspless_pin.visualization import LIGHT, Role

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_AT_LIMIT = 1.0 - 1e-6
_BAR = 0.62


def torque_bars(solution: TorqueSolution, ax: Axes | None = None) -> Axes:
    """Draw each joint's motor torque as a bar between the marks of its limits.

    A bar at its limit has another colour. An infinite limit has no mark.

    Args:
        solution: A solution that was found.
        ax: Axes to draw on; None: a new figure.

    Returns:
        The axes: one horizontal bar a joint, the first on top; N m (N for linear and hybrid
        joints).

    Raises:
        NoSolutionError: If the solution was not found.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.plots import torque_bars
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> torque_bars(scene.solve()).get_xlabel()
        'motor torque [N m]'
    """
    problem, torques = solution.problem, solution.torques
    count = problem.joint_count
    axes = axes_for(ax, size=(6.4, 1.2 + 0.26 * count))
    lower, upper = problem.lower_torque, problem.upper_torque
    is_full = limit_shares(torques, lower, upper) >= _AT_LIMIT
    colors = [
        LIGHT.roles[Role.FRICTION_AT_LIMIT if full else Role.NORMAL_FORCE] for full in is_full
    ]
    rows = np.arange(count)
    axes.barh(rows, torques, height=_BAR, color=colors)
    axes.axvline(0.0, color=LIGHT.text, linewidth=0.8)
    limits, both = np.concatenate([lower, upper]), np.tile(rows, 2)
    marked = np.isfinite(limits)
    axes.vlines(
        limits[marked],
        both[marked] - 0.5 * _BAR,
        both[marked] + 0.5 * _BAR,
        color=LIGHT.text,
        linewidth=2.0,
        label="limits",
    )
    axes.set_yticks(rows, [plain_text(name) for name in problem.joint_names])
    axes.set_ylim(count - 0.4, -0.6)
    axes.set_xlabel(f"motor torque [{units_text(problem.joint_units)}]")
    plain_axis(axes.xaxis)
    if ax is None and marked.any():
        legend_above(axes)
    axes.grid(axis="x", alpha=0.25)
    axes.set_axisbelow(True)
    return axes
