"""Axes to draw on: the caller's, or those of a new figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import GrasplessPinError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROOM = 0.08  # above the largest value, of all


def axes_for(ax: Axes | None, *, size: tuple[float, float] = (6.4, 4.0), **options: Any) -> Axes:
    """Return the caller's axes, or those of a new pyplot figure.

    Args:
        ax: The caller's axes; None: new ones.
        size: Width and height of a new figure, inches.
        options: Of the new axes, such as ``projection``.

    Raises:
        GrasplessPinError: If matplotlib is not installed.
    """
    if ax is not None:
        return ax
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise GrasplessPinError(
            f"plots need matplotlib ({error}); install it with pip install 'graspless-pin[plots]'"
        ) from None
    return pyplot.figure(figsize=size, layout="constrained").add_subplot(**options)


def plain_axis(axis: Any) -> None:
    """Let an axis state its figures as they are: no common offset, and no power of ten for it."""
    from matplotlib.ticker import ScalarFormatter

    formatter = ScalarFormatter(useOffset=False)
    formatter.set_powerlimits((-3, 5))
    axis.set_major_formatter(formatter)


def from_zero(axes: Axes, values: ArrayLike) -> None:
    """Let the upward axis begin at zero, or below it with values, and end above the largest.

    A constant is a level line then, and not its rounding.
    """
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    low, high = float(finite.min(initial=0.0)), float(finite.max(initial=0.0))
    room = _ROOM * (high - low) or 1.0
    axes.set_ylim(low - room if low < 0.0 else 0.0, high + room)
    plain_axis(axes.yaxis)


def legend_above(axes: Axes) -> None:
    """Add a legend above the axes, where it hides nothing."""
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize="small", frameon=False
    )
