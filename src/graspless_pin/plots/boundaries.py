"""Where the outcome of a study changes, over two of the things that it varied."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.plots.canvas import axes_for, legend_text, plain_axis, plain_text
from graspless_pin.plots.tables import number_column, quantity
from graspless_pin.problem.checks import FloatArray
from graspless_pin.visualization import LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WORDS = {
    ("found", "True"): "found",
    ("found", "False"): "nothing found",
    ("mode", "nan"): "nothing found",
    ("verdict", "nan"): "nothing found",
    ("holding", "nan"): "nothing found",
}
_MOST_NAMED = 12
"""Outcomes that a legend has room for."""


def outcome_boundary(
    table: Any, x: str, y: str, ax: Axes | None = None, *, outcome: str = "found"
) -> Axes:
    """Draw samples over two parameters in the colour of their outcome, and lines between these.

    Args:
        table: A study's table: a pandas data frame, or any mapping of columns.
        x: Column of the parameter to the right.
        y: Column of the parameter that goes up.
        ax: Axes to draw on; None: a new figure.
        outcome: Column of the outcome: ``found``, ``status``, ``contacts``, ``verdict``, ``mode``
            or any other with few values.

    Returns:
        The axes. Lines go half way between neighbours of different outcomes: where the outcome
        really changes is known as well as these are near to each other.

    Raises:
        ArgumentError: If a column is missing, parameters are not numbers or lie on one line, or
            samples at one place differ.

    Examples:
        >>> import pandas as pd
        >>> from graspless_pin.plots import outcome_boundary
        >>> rows = [(x, y, x > y) for x in (1.0, 2.0) for y in (0.5, 1.5)]
        >>> table = pd.DataFrame(rows, columns=["mass_kg", "friction", "found"])
        >>> len(outcome_boundary(table, "mass_kg", "friction").collections)
        3
    """
    from matplotlib.collections import LineCollection

    across, up = number_column(table, "x", x), number_column(table, "y", y)
    if outcome not in table:
        known = ", ".join(str(key) for key in table)
        raise ArgumentError("outcome", f"is {outcome!r}; the table has the columns {known}")
    outcomes = np.array([str(value) for value in table[outcome]])
    places, first, where = np.unique(
        np.column_stack([across, up]), axis=0, return_index=True, return_inverse=True
    )
    if (outcomes != outcomes[first][where.ravel()]).any():
        raise ArgumentError(
            "table", f"has samples of different {outcome!r} at one place; choose rows that vary "
            f"only {x!r} and {y!r}"
        )  # fmt: skip
    names, kinds = np.unique(outcomes[first], return_inverse=True)
    segments = boundary_segments(places, kinds)
    axes = axes_for(ax, size=(6.4, 4.8))
    from matplotlib import colormaps

    colors = colormaps["viridis"](np.linspace(0.1, 0.9, max(len(names), 2)))
    named = len(names) <= _MOST_NAMED
    for kind, name in enumerate(names):
        here = places[kinds == kind]
        label = legend_text(_in_words(outcome, name)) if named else None
        axes.scatter(*here.T, s=6.0, color=colors[kind], linewidths=0.0, label=label)
    axes.add_collection(LineCollection([*segments], colors=LIGHT.text, linewidths=1.2))
    axes.set_xlabel(quantity(x))
    axes.set_ylabel(quantity(y))
    plain_axis(axes.xaxis)
    plain_axis(axes.yaxis)
    if named and len(names) > 1:
        # Above, where it hides no sample.
        axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=min(len(names), 4),
            fontsize="small", markerscale=2.5, frameon=False,
        )  # fmt: skip
    return axes


def _in_words(outcome: str, name: str) -> str:
    return _WORDS.get((outcome, name)) or plain_text(name)


def boundary_segments(places: FloatArray, kinds: NDArray[np.integer[Any]]) -> FloatArray:
    """(segments, 2 ends, 2) lines between places of different kinds, half way between neighbours.

    Neighbours are those of a Delaunay triangulation in which both parameters count alike.

    Args:
        places: (samples, 2) different places.
        kinds: (samples,) a number for each outcome.

    Raises:
        ArgumentError: If all places lie on one line.
    """
    from scipy.spatial import Delaunay, QhullError

    low = places.min(axis=0)
    extent = np.ptp(places, axis=0)
    try:
        corners = Delaunay((places - low) / np.where(extent > 0.0, extent, 1.0)).simplices
    except (QhullError, ValueError):
        raise ArgumentError("table", "has its samples on one line; vary two parameters") from None
    edges = [(0, 1), (1, 2), (2, 0)]
    middles = np.stack(
        [0.5 * (places[corners[:, a]] + places[corners[:, b]]) for a, b in edges], axis=1
    )
    corner_kinds = kinds[corners]
    crossed = np.stack([corner_kinds[:, a] != corner_kinds[:, b] for a, b in edges], axis=1)
    two = crossed.sum(axis=1) == 2
    pairs = middles[two][crossed[two]].reshape(-1, 2, 2)
    three = crossed.all(axis=1)
    centers = np.repeat(places[corners[three]].mean(axis=1)[:, None], 3, axis=1)
    stars = np.stack([middles[three], centers], axis=2).reshape(-1, 2, 2)
    return np.concatenate([pairs, stars])
