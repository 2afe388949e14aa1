"""How far something may be off by its direction across gravity."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.algorithms.tolerances import Tolerances
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.errors import ArgumentError
from graspless_pin.plots.canvas import axes_for, plain_axis
from graspless_pin.problem.checks import FloatArray
from graspless_pin.visualization import LIGHT, Role
from graspless_pin.visualization.picture import across_gravity
from graspless_pin.visualization.tolerances import level_boundary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.projections.polar import PolarAxes

DIRECTED = (Quantity.CENTER, Quantity.PUSH, Quantity.MOMENT)
"""What may be off in one direction or another."""
_LEVEL = 1e-6  # of a unit vector
_MOST = 12.0
"""Of the least: what goes farther leaves the circle, or the least could not be seen."""


def tolerance_plot(
    tolerances: Tolerances,
    quantity: Quantity | str = Quantity.CENTER,
    ax: PolarAxes | None = None,
) -> Axes:
    """Draw how far the centre of mass may be off, or what push or moment is borne, by direction.

    Across gravity: directions are level ones. What is inside the line is borne; of pushes and
    moments more may be, as it is the hull of those that were looked at. The circle ends at twelve
    times the least.

    Args:
        tolerances: Of `tolerances`.
        quantity: ``centre of mass``, ``push`` or ``moment``.
        ax: Polar axes to draw on; None: a new figure.

    Returns:
        Polar axes, radius in cm, N or N m. A dot is where the least fails; the legend says what it
        is, along which direction where that is not level, and at which contacts it fails.

    Raises:
        ArgumentError: If the tolerances do not tell of the quantity, or it has no directions.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.plots import tolerance_plot
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> off = scene.tolerances(scene.solve().torques, static_friction="coulomb")
        >>> tolerance_plot(off, "push").name
        'polar'
    """
    from matplotlib.ticker import MaxNLocator

    told = {one.quantity: one for one in tolerances.each if one.quantity in DIRECTED}
    if quantity not in told:
        known = ", ".join(told) or "nothing"
        raise ArgumentError(
            "quantity", f"is '{quantity}'; these tolerances have directions of: {known}"
        )
    one = told[Quantity(quantity)]
    scale, unit = one.quantity.scale, one.quantity.unit
    level = across_gravity(tolerances.weight)
    up = np.cross(level[0], level[1])
    angles, sizes = level_boundary(one, level)
    radii = scale * sizes
    axes = axes_for(ax, size=(4.6, 4.9), projection="polar")
    blue = LIGHT.roles[Role.NORMAL_FORCE]
    axes.plot(np.append(angles, angles[0]), np.append(radii, radii[0]), color=blue)
    axes.fill(angles, radii, color=blue, alpha=0.2, linewidth=0.0)
    way = np.zeros(3) if one.direction is None else one.direction
    words = f"least: {scale * one.borne:.3g} {unit}"
    at, mark = ([np.arctan2(*(level @ way)[::-1])], [scale * one.failing]), "o"
    if abs(way @ up) > _LEVEL:
        words += f" along {_components(way)}"
        at, mark = ([], []), "None"
    if one.contacts:
        many = "s" * (len(one.contacts) > 1)
        words += f"\nfails at contact{many} {', '.join(map(str, one.contacts))}"
    axes.plot(*at, mark, color=LIGHT.roles[Role.FRICTION_AT_LIMIT], linestyle="none", label=words)
    names = [_name(way) for way in (*level, *-level)]
    axes.set_xticks(np.arange(4) * np.pi / 2.0, names)
    top = min(1.08 * float(radii.max()), _MOST * float(radii.min()) or np.inf)
    axes.set_ylim(0.0, top or 1.0)
    axes.yaxis.set_major_locator(MaxNLocator(4, prune="lower"))
    plain_axis(axes.yaxis)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.08), fontsize="small", frameon=False,
        handlelength=1.0,
    )  # fmt: skip
    verb = "may be off" if one.quantity is Quantity.CENTER else "that is borne"
    axes.set_title(f"{one.quantity} {verb}, across gravity [{unit}]", fontsize="medium")
    return axes


def _name(way: FloatArray) -> str:
    """Return the name of a unit vector: a world axis, or its components."""
    axis = int(np.abs(way).argmax())
    if abs(way[axis]) > 1.0 - _LEVEL:
        return f"{'+' if way[axis] > 0.0 else '−'}{'xyz'[axis]}"
    return _components(way)


def _components(way: FloatArray) -> str:
    return f"[{', '.join(f'{x:+.2f}' for x in way.tolist())}]".replace("-", "−")
