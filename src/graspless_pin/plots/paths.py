"""Margin and torques along a path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.planning import PathProfile
from graspless_pin.plots.canvas import axes_for, from_zero, legend_text, plain_axis, plain_text
from graspless_pin.problem.joint_units import units_text
from graspless_pin.visualization import LIGHT, Role

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FOOT = 0.02


def path_margins(profile: PathProfile, ax: Axes | None = None) -> Axes:
    """Draw the margin against time.

    Args:
        profile: Of `evaluate_path`.
        ax: Axes to draw on; None: a new figure.

    Returns:
        The axes: s to the right, N up, from zero. Crosses are waypoints without torques, dashed
        lines changes of contacts.

    Examples:
        >>> from graspless_pin import Waypoint, evaluate_path, load_scene
        >>> from graspless_pin.plots import path_margins
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> path_margins(profile).get_ylabel()
        'margin e [N]'
    """
    axes = axes_for(ax)
    margins = np.where(np.isfinite(profile.margins), profile.margins, np.nan)
    blue = LIGHT.roles[Role.NORMAL_FORCE]
    axes.plot(profile.times, margins, "o-", color=blue, markersize=4, label="margin")
    axes.set_ylabel("margin e [N]")
    from_zero(axes, margins)
    _mark_path(axes, profile)
    axes.legend(fontsize="small")
    return axes


def path_torques(profile: PathProfile, ax: Axes | None = None) -> Axes:
    """Draw each joint's motor torque against time.

    Args:
        profile: Of `evaluate_path`.
        ax: Axes to draw on; None: a new figure.

    Returns:
        The axes: s to the right, N m (N for linear and hybrid joints) up, a line a joint. Crosses
        are waypoints without torques, dashed lines changes of contacts.

    Examples:
        >>> from graspless_pin import Waypoint, evaluate_path, load_scene
        >>> from graspless_pin.plots import path_torques
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> path_torques(profile).get_ylabel()
        'motor torque [N m]'
    """
    from matplotlib import colormaps

    axes = axes_for(ax, size=(7.6, 4.4))
    count = len(profile.torque_names)
    colors = colormaps["viridis"](np.linspace(0.0, 0.9, max(count, 1)))
    styles = ("-", "--", "-.")
    for index, name in enumerate(profile.torque_names):
        axes.plot(
            profile.times,
            profile.torques[:, index],
            styles[index % len(styles)],
            color=colors[index],
            label=legend_text(plain_text(name)),
        )
    axes.set_ylabel(f"motor torque [{units_text(profile.torque_units)}]")
    plain_axis(axes.yaxis)
    _mark_path(axes, profile)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small")
    return axes


def _mark_path(axes: Axes, profile: PathProfile) -> None:
    """Time, changes of contacts and waypoints without torques."""
    for number, change in enumerate(profile.contact_changes):
        axes.axvline(
            profile.times[change.waypoint], color=LIGHT.text, linestyle="--", linewidth=0.8,
            label="_" * (number > 0) + "contacts change",
        )  # fmt: skip
    lost = profile.times[list(profile.failures)]
    axes.plot(
        lost,
        np.full(len(lost), _FOOT),
        "x",
        color=LIGHT.roles[Role.FRICTION_AT_LIMIT],
        transform=axes.get_xaxis_transform(),
        label="no torques" if len(lost) else "_no torques",
    )
    axes.set_xlabel("time [s]")
    axes.grid(alpha=0.25)
