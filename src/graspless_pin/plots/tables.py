"""Plots of a study's table: the margin, or another result, over one or two varied parameters.

And the boundaries between its outcomes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.plots.canvas import (
    axes_for,
    crosses_below,
    legend_text,
    plain_axis,
    plain_text,
    start_at_zero,
)
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.units import UNITS
from graspless_pin.visualization import LIGHT, Role

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_NAMED = {
    "margin_N": "margin e [N]",
    "max_torque_Nm": "largest |torque| [N m]",
    "max_torque_N": "largest |force of a prismatic joint| [N]",
    "smallest_margin_N": "margin e at worst [N]",
    "largest_margin_N": "margin e at best [N]",
    "disturbance_N": "largest balanced disturbance [N]",
    "minimum_friction_factor": "smallest sufficient factor on friction",
    "contacts": "number of contacts",
    "nodes": "nodes of the search",
    "mass": "mass of the object [kg]",
    "object.mass": "mass of the object [kg]",
    "friction": "friction coefficient",
    "solve.margin": "required margin $e_0$ [N]",
    "max_normal_force": "largest normal force [N]",
    "contact_tolerance": "contact tolerance [m]",
}
_SYMBOLS = {"deg": "°", "Nm": "N m", "mNm": "mN m", "deg/s": "°/s"}
_UNITS = {"_s": "s"} | {
    unit.suffix: _SYMBOLS.get(name, name).replace("^2", "²").replace("^3", "³")
    for name, unit in UNITS.items()
    if unit.suffix
}
"""Unit on an axis, by the ending of a column's name."""


def margin_plot(table: Any, x: str, ax: Axes | None = None, *, value: str = "margin_N") -> Axes:
    """Draw a result against one parameter: a line of found ones, marks below for the others.

    Args:
        table: A study's table: a pandas data frame, or any mapping of columns.
        x: Column of the parameter.
        ax: Axes to draw on; None: a new figure.
        value: Column of the result; NaN where nothing was found.

    Returns:
        The axes. Of several results at one parameter the line joins the means, and a band spans
        from the least to the largest. Points are not joined where samples are scattered: where
        other parameters of a study vary, too, and few samples share a value.

    Raises:
        ArgumentError: If a column is missing or not of numbers.

    Examples:
        >>> import pandas as pd
        >>> from graspless_pin.plots import margin_plot
        >>> table = pd.DataFrame({"mass_kg": [1.0, 2.0], "margin_N": [0.7, 0.4]})
        >>> len(margin_plot(table, "mass_kg").lines)
        1
    """
    parameters, results = number_column(table, "x", x), number_column(table, "value", value)
    axes = axes_for(ax)
    blue = LIGHT.roles[Role.NORMAL_FORCE]
    places = np.unique(parameters)
    groups = [results[(parameters == place) & np.isfinite(results)] for place in places]
    # A place where nothing was found breaks the line.
    means = np.array([group.mean() if len(group) else np.nan for group in groups])
    if max((len(group) for group in groups), default=0) > 1:
        low = [group.min() if len(group) else np.nan for group in groups]
        high = [group.max() if len(group) else np.nan for group in groups]
        axes.fill_between(
            places, low, high, color=blue, alpha=0.2, linewidth=0.0, label="smallest to largest"
        )
    label = "mean" if axes.collections else legend_text(quantity(value).partition(" [")[0])
    style = "o" if _is_scattered(table, x, len(places)) else "o-"
    axes.plot(places, means, style, color=blue, markersize=4, label=label)
    failed_at = np.unique(parameters[~np.isfinite(results)])
    if len(failed_at):
        crosses_below(axes, failed_at, "nothing found")
    if len(failed_at) or axes.collections:
        axes.legend(fontsize="small")
    axes.set(xlabel=quantity(x), ylabel=quantity(value))
    start_at_zero(axes, results)
    _set_scale(axes.xaxis, table, x)
    axes.grid(alpha=0.25)
    return axes


def margin_heat_map(
    table: Any, x: str, y: str, ax: Axes | None = None, *, value: str = "margin_N"
) -> Axes:
    """Draw a result over two parameters as a map of coloured cells with a colour bar.

    Args:
        table: A study's table: a pandas data frame, or any mapping of columns.
        x: Column of the parameter to the right.
        y: Column of the parameter upward.
        ax: Axes to draw on; None: a new figure.
        value: Column of the result; NaN where nothing was found.

    Returns:
        The axes. Cells without any result are hatched; several in one cell are averaged, as the
        colour bar says, which begins at zero where all are equal. Of scattered samples, which fill
        few cells, coloured points are drawn instead, and crosses where nothing was found.

    Raises:
        ArgumentError: If a column is missing or not of numbers.

    Examples:
        >>> import pandas as pd
        >>> from graspless_pin.plots import margin_heat_map
        >>> rows = [(x, y, x + y) for x in (1.0, 2.0) for y in (0.3, 0.5)]
        >>> table = pd.DataFrame(rows, columns=["mass_kg", "friction", "margin_N"])
        >>> len(margin_heat_map(table, "mass_kg", "friction").collections)
        1
    """
    columns, rows = number_column(table, "x", x), number_column(table, "y", y)
    values, label = number_column(table, "value", value), quantity(value)
    axes = axes_for(ax, size=(6.4, 4.8))
    across, up = np.unique(columns), np.unique(rows)
    if len(across) * len(up) > _FEW_TO_A_SAMPLE * len(columns):
        found = np.isfinite(values)
        mesh = axes.scatter(columns[found], rows[found], c=values[found], cmap="viridis")
        if not found.all():
            axes.plot(columns[~found], rows[~found], "x", color=LIGHT.text, label="nothing found")
            axes.legend(fontsize="small")
    else:
        cells = heat_cells(columns, rows, values)
        # The hatched background shows through the cells that have no colour.
        axes.patch.set(hatch="///", edgecolor=LIGHT.text, alpha=0.25)
        mesh = axes.pcolormesh(across, up, cells, shading="nearest", cmap="viridis")
        if np.unique(np.column_stack([columns, rows]), axis=0).shape[0] < len(values):
            label = f"mean {label}"
    low, high = mesh.get_clim()
    if low is not None and high - low < _CONSTANT * max(abs(low), abs(high)):
        mesh.set_clim(0.0, high) if high > 0.0 else mesh.set_clim(low, 0.0)
    bar = axes.figure.colorbar(mesh, ax=axes)
    bar.set_label(label)
    plain_axis(bar.ax.yaxis)
    axes.set(xlabel=quantity(x), ylabel=quantity(y))
    _set_scale(axes.xaxis, table, x)
    _set_scale(axes.yaxis, table, y)
    return axes


_CONSTANT = 1e-6
"""Of the largest value: where all differ by less, colours would show rounding."""
_FEW_TO_A_SAMPLE = 4
"""Cells of a map for each sample above which samples count as scattered."""


def _set_scale(axis: Any, table: Any, column: str) -> None:
    """Give an axis a logarithmic scale where a study varied its column so; else a plain one."""
    from graspless_pin.studies.results import KEY  # not needed for plots of solutions

    study = getattr(table, "attrs", {}).get(KEY, {}).get("entry", {})
    for key, values in study.get("vary", {}).items():
        ending = column.removeprefix(key)
        if values.get("scale") == "log" and (ending == "" or ending in _UNITS):
            axis.axes.set(**{f"{axis.axis_name}scale": "log"})
            return
    plain_axis(axis)


def _is_scattered(table: Any, x: str, places: int) -> bool:
    """Return whether other parameters of a study vary, and hardly two samples share their x."""
    names = [str(one) for one in table]
    if "status" not in names or 2 * places <= len(table[x]):
        return False
    others = names[1 : names.index("status")]
    return any(name != x and len(set(table[name])) > 1 for name in others)


def heat_cells(x: FloatArray, y: FloatArray, values: FloatArray) -> np.ma.MaskedArray:
    """(rows of y, columns of x) means of the values in each cell, masked where there is none."""
    across, column = np.unique(x, return_inverse=True)
    up, row = np.unique(y, return_inverse=True)
    sums, counts = np.zeros((len(up), len(across))), np.zeros((len(up), len(across)))
    found = np.isfinite(values)
    np.add.at(sums, (row[found], column[found]), values[found])
    np.add.at(counts, (row[found], column[found]), 1.0)
    return np.ma.masked_array(sums / np.maximum(counts, 1.0), mask=counts == 0.0)


def number_column(table: Any, argument: str, name: str) -> FloatArray:
    """(rows,) a column of numbers of a study's table, NaN where there is none.

    Args:
        table: The table.
        argument: The argument that names the column, for messages.
        name: The column's name.

    Raises:
        ArgumentError: If it is missing or not of numbers.
    """
    try:
        column = table[name]
    except KeyError:
        known = ", ".join(str(key) for key in table)
        raise ArgumentError(argument, f"is {name!r}; the table has the columns {known}") from None
    try:
        # A pandas column of integers may have missing values of its own kind.
        if hasattr(column, "to_numpy"):
            return column.to_numpy(dtype=float, na_value=np.nan)
        return np.asarray(column, dtype=float)
    except (TypeError, ValueError) as error:
        raise ArgumentError(
            argument, f"is {name!r}, a column that does not hold numbers ({error})"
        ) from None


def quantity(column: str) -> str:
    """Return the quantity in a column of a study's table, in words with its unit.

    Args:
        column: Its name: of a result, of a key such as ``object.mass``, or one that ends in its
            unit, such as ``slope_deg``. Any other becomes its `plain_text`.
    """
    if column in _NAMED:
        return _NAMED[column]
    first, _, rest = column.partition(".")
    if first == "friction" and rest:
        return f"friction coefficient, {plain_text(rest)}"
    ending = max(filter(column.endswith, _UNITS), key=len, default=column)
    if name := column.removesuffix(ending):
        # Names of joints and keys stay as they are, behind a word where one stands before them.
        most = 1 if name.startswith("torque_") else 0 if "." in name else -1
        return f"{plain_text(name.replace('_', ' ', most))} [{_UNITS[ending]}]"
    return plain_text(column)


_WORDS = {
    ("found", "True"): "found",
    ("found", "False"): "nothing found",
    ("mode", "nan"): "nothing found",
    ("verdict", "nan"): "nothing found",
    ("holding", "nan"): "nothing found",
}
_MOST_NAMED = 12
"""Largest number of outcomes in a legend."""


def outcome_boundary(
    table: Any, x: str, y: str, ax: Axes | None = None, *, outcome: str = "found"
) -> Axes:
    """Draw samples over two parameters in the colour of their outcome, with boundaries between.

    Args:
        table: A study's table: a pandas data frame, or any mapping of columns.
        x: Column of the parameter to the right.
        y: Column of the parameter upward.
        ax: Axes to draw on; None: a new figure.
        outcome: Column of the outcome: ``found``, ``status``, ``contacts``, ``verdict``, ``mode``
            or any other with few values.

    Returns:
        The axes. Boundaries are half way between neighbours of different outcomes: the distance of
        these is how well a boundary is known.

    Raises:
        ArgumentError: If a column is missing, parameters are not numbers or lie on one line, or
            samples with equal parameters differ.

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
            "table", f"has samples with equal {x!r} and {y!r} but different {outcome!r}; keep only "
            "rows in which no other variable varies"
        )  # fmt: skip
    names, kinds = np.unique(outcomes[first], return_inverse=True)
    segments = boundary_segments(places, kinds)
    axes = axes_for(ax, size=(6.4, 4.8))
    from matplotlib import colormaps

    colors = colormaps["viridis"](np.linspace(0.1, 0.9, max(len(names), 2)))
    named = len(names) <= _MOST_NAMED
    for kind, name in enumerate(names):
        here = places[kinds == kind]
        label = legend_text(_WORDS.get((outcome, name)) or plain_text(name)) if named else None
        axes.scatter(*here.T, s=6.0, color=colors[kind], linewidths=0.0, label=label)
    axes.add_collection(LineCollection([*segments], colors=LIGHT.text, linewidths=1.2))
    axes.set(xlabel=quantity(x), ylabel=quantity(y))
    _set_scale(axes.xaxis, table, x)
    _set_scale(axes.yaxis, table, y)
    if named:
        # Above, where it covers no sample.
        axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=min(len(names), 4),
            fontsize="small", markerscale=2.5, frameon=False,
        )  # fmt: skip
    return axes


def boundary_segments(places: FloatArray, kinds: NDArray[np.integer[Any]]) -> FloatArray:
    """(segments, 2 ends, 2) boundaries half way between neighbouring places of different kinds.

    Neighbours are those of a Delaunay triangulation, with both parameters scaled to equal extents.

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
        raise ArgumentError(
            "table", "has all samples on one line; two parameters must vary"
        ) from None
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
    spokes = np.stack([middles[three], centers], axis=2).reshape(-1, 2, 2)
    return np.concatenate([pairs, spokes])
