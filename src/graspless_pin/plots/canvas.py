"""What all plots share: axes, and the texts and numbers on them."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import optional_import
from graspless_pin.intake.text import printable
from graspless_pin.problem.checks import FloatArray
from graspless_pin.visualization import LIGHT, Role

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.projections.polar import PolarAxes

_CROSS_HEIGHT = 0.02  # of the axes
_PADDING_ABOVE = 0.08  # above the largest value, of all
_LONGEST_NAME = 40  # letters; beyond, the axes have no room left


def axes_for(ax: Axes | None, *, size: tuple[float, float] = (6.4, 4.0), **options: Any) -> Axes:
    """Return the caller's axes, or those of a new pyplot figure.

    Args:
        ax: The caller's axes; None: new ones.
        size: Width and height of a new figure, inches.
        options: Keywords of the new axes, such as ``projection``.

    Raises:
        GrasplessPinError: If matplotlib is not installed.
    """
    if ax is not None:
        return ax
    with optional_import("plots need matplotlib", "plots"):
        from matplotlib import pyplot
    return pyplot.figure(figsize=size, layout="constrained").add_subplot(**options)


def plain_text(name: str) -> str:
    """Return a name from a file as a text that matplotlib draws literally, on one line.

    Between dollar signs matplotlib reads mathematics, and fails on other text. Long names are cut
    in their middle, and unprintable characters are written as their codes.
    """
    letters = printable(" ".join(name.split()))
    if len(letters) > _LONGEST_NAME:
        half = _LONGEST_NAME // 2
        letters = f"{letters[:half]}…{letters[1 - half :]}"
    return letters.replace("$", r"\$")


def legend_text(text: str) -> str:
    """Return a text for a legend, which leaves out one that begins with ``_``."""
    return f" {text}" if text.startswith("_") else text


@contextmanager
def fonts_without_remarks() -> Iterator[None]:
    """Suppress matplotlib's warnings of letters that its fonts lack: names may have any."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"Glyph \d+ .*missing from")
        yield


def plain_axis(axis: Any) -> None:
    """Let an axis show its figures without a common offset, and without a power of ten."""
    from matplotlib.ticker import ScalarFormatter

    formatter = ScalarFormatter(useOffset=False)
    formatter.set_powerlimits((-3, 5))
    axis.set_major_formatter(formatter)


def start_at_zero(axes: Axes, values: ArrayLike) -> None:
    """Let the upward axis begin at zero, or below negative values, and end above the largest.

    So a constant is a level line, and not its rounding.
    """
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    low, high = float(finite.min(initial=0.0)), float(finite.max(initial=0.0))
    padding = _PADDING_ABOVE * (high - low) or 1.0
    axes.set_ylim(low - padding if low < 0.0 else 0.0, high + padding)
    plain_axis(axes.yaxis)


def polar_region(
    ax: PolarAxes | None,
    size: tuple[float, float],
    angles: FloatArray,
    radii: FloatArray,
    names: Sequence[str],
) -> PolarAxes:
    """Draw a filled outline around the middle of polar axes, and return these.

    Args:
        ax: The caller's axes; None: new ones.
        size: Width and height of a new figure, inches.
        angles: (K,) ascending, rad.
        radii: (K,) radius of the outline there.
        names: Names of the directions at 0, 90, 180 and 270 degrees.
    """
    axes = cast("PolarAxes", axes_for(ax, size=size, projection="polar"))
    blue = LIGHT.roles[Role.NORMAL_FORCE]
    axes.plot(np.append(angles, angles[0]), np.append(radii, radii[0]), color=blue)
    axes.fill(angles, radii, color=blue, alpha=0.2, linewidth=0.0)
    axes.set_xticks(np.arange(4) * np.pi / 2.0, names)
    return axes


def crosses_below(axes: Axes, places: FloatArray, label: str) -> None:
    """Mark places without a value, at the lower end of the axes."""
    axes.plot(
        places, np.full(len(places), _CROSS_HEIGHT), "x", color=LIGHT.roles[Role.FRICTION_AT_LIMIT],
        transform=axes.get_xaxis_transform(), label=label,
    )  # fmt: skip


def legend_above(axes: Axes) -> None:
    """Add a legend above the axes, where it covers nothing."""
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize="small", frameon=False
    )
