"""Curves: disturbances by direction, torque against margin, margins and torques along a path."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.algorithms.disturbances import DisturbanceMargin
from graspless_pin.algorithms.margin_torque_curve import MarginTorqueCurve
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.holding.verdict import Holding
from graspless_pin.planning import PathProfile, PathTiming, SqueezeWindow, TimingLimit
from graspless_pin.plots.canvas import (
    axes_for,
    crosses_below,
    legend_above,
    legend_text,
    plain_axis,
    plain_text,
    polar_region,
    start_at_zero,
)
from graspless_pin.problem.checks import FloatArray, units_text
from graspless_pin.visualization import LIGHT, Role

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.projections.polar import PolarAxes


COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
_IN_PLANE = 1e-9
_LEAST_COUNT = 3


def plane_directions(first: str, second: str, count: int = 72) -> FloatArray:
    """(count, 6) unit directions all around a plane of wrench space, for `disturbance_margin`.

    Args:
        first: Component at angle 0: ``fx``, ``fy``, ``fz``, ``mx``, ``my`` or ``mz``.
        second: Component at a right angle.
        count: Number of directions, evenly spaced, beginning along the first.

    Raises:
        ArgumentError: If a component is not known, both are the same or there are fewer than 3.

    Examples:
        >>> from graspless_pin.plots import plane_directions
        >>> plane_directions("fx", "fz", 4).round(1)
        array([[ 1.,  0.,  0.,  0.,  0.,  0.],
               [ 0.,  0.,  1.,  0.,  0.,  0.],
               [-1.,  0.,  0.,  0.,  0.,  0.],
               [-0.,  0., -1.,  0.,  0.,  0.]])
    """
    plane = _plane_indices(first, second)
    if count < _LEAST_COUNT:
        raise ArgumentError("count", f"is {count}; it must be at least {_LEAST_COUNT}")
    angles = 2.0 * np.pi * np.arange(count) / count
    directions = np.zeros((count, 6))
    directions[:, plane[0]], directions[:, plane[1]] = np.cos(angles), np.sin(angles)
    return directions


def disturbance_polar(
    margin: DisturbanceMargin, first: str = "fx", second: str = "fz", ax: PolarAxes | None = None
) -> Axes:
    """Draw the largest balanced disturbance by direction in a plane of wrench space.

    Args:
        margin: A disturbance margin; its directions in that plane are drawn, see
            `plane_directions`.
        first: Component at angle 0: ``fx``, ``fy``, ``fz``, ``mx``, ``my`` or ``mz``.
        second: Component at a right angle.
        ax: Polar axes to draw on; None: a new figure.

    Returns:
        Polar axes, radius in N; moments are divided by the characteristic length.

    Raises:
        ArgumentError: If fewer than 3 directions lie in the plane or a component is not known.
        NoSolutionError: If not even the undisturbed object is balanced.

    Examples:
        >>> from graspless_pin import disturbance_margin, load_scene
        >>> from graspless_pin.plots import disturbance_polar, plane_directions
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> around = disturbance_margin(problem, directions=plane_directions("fx", "fz", 8))
        >>> disturbance_polar(around).name
        'polar'
    """
    plane = _plane_indices(first, second)
    if not margin.found:
        raise NoSolutionError(f"There is no disturbance margin ({margin.status.message}).")
    others = np.delete(margin.directions, plane, axis=1)
    chosen = np.flatnonzero((np.abs(others) <= _IN_PLANE).all(axis=1))
    if len(chosen) < _LEAST_COUNT:
        raise ArgumentError(
            "margin",
            f"has {len(chosen)} directions in the plane of {first} and {second}; a polar plot "
            f"needs at least {_LEAST_COUNT}: call disturbance_margin with "
            f"directions=plane_directions({first!r}, {second!r})",
        )
    angles = np.arctan2(margin.directions[chosen, plane[1]], margin.directions[chosen, plane[0]])
    order = np.argsort(angles)
    angles, radii = angles[order], margin.magnitudes[chosen][order]
    names = [f"+{first}", f"+{second}", f"−{first}", f"−{second}"]
    axes = polar_region(ax, (4.6, 4.6), angles, radii, names)
    worst = int(np.argmin(radii))
    axes.plot(
        angles[worst],
        radii[worst],
        "o",
        color=LIGHT.roles[Role.FRICTION_AT_LIMIT],
        label=f"smallest: {radii[worst]:.4g} N",
    )
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.1, -0.12), fontsize="small")
    axes.set_title(
        f"largest balanced disturbance in the plane of {first} and {second} [N]", fontsize="medium"
    )
    return axes


def margin_torque_plot(curve: MarginTorqueCurve, ax: Axes | None = None) -> Axes:
    """Draw the least torque against the required margin.

    Args:
        curve: Of `margin_torque_curve`.
        ax: Axes to draw on; None: a new figure.

    Returns:
        The axes: e_0 in N to the right; up the minimum of the largest |torque|, curve's unit. Dots
        are where pieces meet, dotted lines jumps.

    Raises:
        NoSolutionError: If no margin is feasible.

    Examples:
        >>> from graspless_pin import load_scene, margin_torque_curve
        >>> from graspless_pin.plots import margin_torque_plot
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> margin_torque_plot(margin_torque_curve(scene.problem())).get_xlabel()
        'required margin $e_0$ [N]'
    """
    if not curve.found:
        raise NoSolutionError(f"There is no curve to draw ({curve.status.message}).")
    axes = axes_for(ax)
    blue = LIGHT.roles[Role.NORMAL_FORCE]
    axes.plot(
        curve.margins.ravel(), curve.torques.ravel(), ":", color=blue, linewidth=1.0, zorder=1
    )
    # A column a piece: the straight pieces over the dotted whole, which shows at jumps.
    axes.plot(curve.margins.T, curve.torques.T, "o-", color=blue, markersize=4, linewidth=1.8)
    least = f"minimum of the largest |torque|\n[{curve.torque_unit}]"
    axes.set(xlabel="required margin $e_0$ [N]", ylabel=least)
    start_at_zero(axes, curve.torques)
    plain_axis(axes.xaxis)
    axes.grid(alpha=0.25)
    return axes


def squeeze_plot(window: SqueezeWindow, ax: Axes | None = None, *, value: str = "margin") -> Axes:
    """Draw the margin, growth of small motions or normal forces against the squeeze of a hand.

    Args:
        window: Of `squeeze_window`.
        ax: Axes to draw on; None: a new figure.
        value: ``margin``, ``growth``, or ``normal_force``: the sum of the hand's normal forces.

    Returns:
        The axes: multiples of the window's direction to the right; up N or 1/s. The window is
        shaded, its ends name what fails there. Full dots are samples that hold, hollow ones others.

    Raises:
        ArgumentError: If the value is not known.

    Examples:
        >>> from graspless_pin import Controller, load_scene, squeeze_window
        >>> from graspless_pin.plots import squeeze_plot
        >>> scene = load_scene("examples/allegro_sphere_on_slope.yaml")
        >>> torques = scene.solve("torque", margin=0.1).torques
        >>> held = scene.with_changes(controller=Controller(1.0))
        >>> window = squeeze_window(held, torques, samples=2, precision=0.1)
        >>> squeeze_plot(window).get_xlabel()
        'change of torques, in multiples of those of the internal forces'
    """
    figures = {
        "margin": (window.margins, "margin [N]"),
        "growth": (window.growth, "growth of small\nmotions [1/s]"),
        "normal_force": (window.normal_forces, "sum of the hand's\nnormal forces [N]"),
    }
    if value not in figures:
        raise ArgumentError("value", f"is {value!r}; it must be one of {', '.join(figures)}")
    axes, (values, label) = axes_for(ax), figures[value]
    blue, holds = LIGHT.roles[Role.NORMAL_FORCE], [one is Holding.HOLDS for one in window.holding]
    axes.plot(window.amounts, values, "-", color=blue, linewidth=1.8)
    for filled, face in ((True, blue), (False, "white")):
        own = np.equal(holds, filled)
        axes.plot(
            window.amounts[own], values[own], "o", color=blue, markerfacecolor=face,
            label="holds" if filled else "does not hold",
        )  # fmt: skip
    basis = "those of the internal forces" if window.of_internal_forces else "the given direction"
    # Beyond the window samples may have no figures: the axis does not reach out for them.
    ends = [end for end in (window.lower, window.upper) if end is not None]
    shown = [*window.amounts[~np.isnan(values)], *(end.amount for end in ends)] or window.amounts
    first, last = min(shown), max(shown)
    padding = _PADDING_BESIDE * (last - first)
    axes.set(
        xlabel=f"change of torques, in multiples of {basis}",
        ylabel=label,
        xlim=(first - padding, last + padding),
    )
    start_at_zero(axes, values)
    if ends:
        axes.axvspan(ends[0].amount, ends[1].amount, color=blue, alpha=0.1, linewidth=0.0)
        for end, side in zip(ends, ("right", "left"), strict=True):
            axes.axvline(end.amount, color=blue, linestyle=":", linewidth=1.2)
            axes.annotate(
                end.reason.value.replace("_", " "), (end.amount, 1.0),
                xycoords=("data", "axes fraction"), xytext=(-4 if side == "right" else 4, -12),
                textcoords="offset points", ha=side, fontsize="small",
            )  # fmt: skip
    legend_above(axes)
    plain_axis(axes.xaxis)
    axes.grid(alpha=0.25)
    return axes


def _plane_indices(first: str, second: str) -> list[int]:
    for argument, name in (("first", first), ("second", second)):
        if name not in COMPONENTS:
            raise ArgumentError(argument, f"is {name!r}; it must be one of {', '.join(COMPONENTS)}")
    if first == second:
        raise ArgumentError(
            "second", f"is {second!r}, like the first; it must be another component"
        )
    return [COMPONENTS.index(first), COMPONENTS.index(second)]


_PADDING_BESIDE = 0.24
"""Of the width: room for the names of the ends."""


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
    start_at_zero(axes, margins)
    _mark_path(axes, profile)
    axes.legend(fontsize="small")
    return axes


def timing_plot(timing: PathTiming, ax: Axes | None = None) -> Axes:
    """Draw the speed along a path and the margin against time, and the limits of the speed.

    Args:
        timing: Of `fastest_timing`.
        ax: Axes to draw on; None: a new figure.

    Returns:
        The axes: s to the right, rad/s up, with N on a second axis. Marks show what limits the
        speed.

    Raises:
        NoSolutionError: If there is no timing.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.planning import fastest_timing
        >>> from graspless_pin.plots import timing_plot
        >>> scene = load_scene("examples/panda_stop_with_board.yaml").with_changes(
        ...     acceleration=None
        ... )
        >>> path = [{}, {"panda_joint1": 0.5}]
        >>> timing = fastest_timing(scene, path, attached_to="panda_hand", points=20)
        >>> timing_plot(timing).get_ylabel()
        'speed along the path [rad/s]'
    """
    if not timing.found:
        raise NoSolutionError(f"There is no timing to draw ({timing.reason}).")
    axes = axes_for(ax)
    axes.plot(timing.times, timing.speeds, color="0.6", linewidth=1.0)
    marks = {
        TimingLimit.CONTACTS: ("o", Role.FRICTION_AT_LIMIT),
        TimingLimit.VELOCITY: ("s", Role.NORMAL_FORCE),
        TimingLimit.ACCELERATION: ("D", Role.SLIDING),
        TimingLimit.TORQUE: ("^", Role.FRICTION_FORCE),
        TimingLimit.NOTHING: (".", Role.TOTAL_FORCE),
    }
    for limit, (mark, role) in marks.items():
        own = [one is limit for one in timing.limits]
        if any(own):
            at = timing.times[own], timing.speeds[own]
            label = "no limit here" if limit is TimingLimit.NOTHING else f"limited by {limit}"
            axes.plot(*at, mark, color=LIGHT.roles[role], markersize=4, label=label)
    axes.set(xlabel="time [s]", ylabel="speed along the path [rad/s]")
    start_at_zero(axes, timing.speeds)
    margins = axes.twinx()
    margins.plot(
        timing.times, timing.margins, "--", color=LIGHT.roles[Role.VIRTUAL_SLIDING], label="margin"
    )
    margins.set_ylabel("margin e [N]")
    start_at_zero(margins, timing.margins)
    lines = [*axes.get_lines()[1:], *margins.get_lines()]
    axes.legend(handles=lines, fontsize="small", loc="lower center")
    return axes


def path_torques(profile: PathProfile, ax: Axes | None = None) -> Axes:
    """Draw each joint's motor torque against time.

    Args:
        profile: Of `evaluate_path`.
        ax: Axes to draw on; None: a new figure.

    Returns:
        The axes: s to the right, N m (N for prismatic and hybrid joints) up, a line a joint.
        Crosses are waypoints without torques, dashed lines changes of contacts.

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
    """Label time, and mark changes of contacts and waypoints without torques."""
    for number, change in enumerate(profile.contact_changes):
        axes.axvline(
            profile.times[change.waypoint], color=LIGHT.text, linestyle="--", linewidth=0.8,
            label="_" * (number > 0) + "contacts change",
        )  # fmt: skip
    failed_at = profile.times[list(profile.failures)]
    crosses_below(axes, failed_at, "no torques" if len(failed_at) else "_no torques")
    axes.set_xlabel("time [s]")
    axes.grid(alpha=0.25)
