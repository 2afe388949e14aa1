"""The package's own plots, as pages show them."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import cast

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from graspless_pin import (
    contact_force_bounds,
    disturbance_margin,
    margin_torque_curve,
    tolerances,
)
from graspless_pin.plots import (
    disturbance_polar,
    friction_section,
    margin_torque_plot,
    normal_force_ranges,
    outcome_boundary,
    plane_directions,
    tolerance_plot,
    torque_bars,
)
from graspless_pin.solution import TorqueSolution
from graspless_pin.studies import Study, run_study


def _section(solution: TorqueSolution, figure: Figure) -> Axes:
    return friction_section(solution, 0, figure.add_subplot())


def _torques(solution: TorqueSolution, figure: Figure) -> Axes:
    return torque_bars(solution, figure.add_subplot())


def _ranges(solution: TorqueSolution, figure: Figure) -> Axes:
    bounds = contact_force_bounds(solution.problem, solution.torques)
    return normal_force_ranges(bounds, solution, figure.add_subplot())


def _disturbance(solution: TorqueSolution, figure: Figure) -> Axes:
    directions = plane_directions("fx", "fz", 48)
    margin = disturbance_margin(solution.problem, solution.torques, directions)
    axes = cast("PolarAxes", figure.add_subplot(projection="polar"))
    return disturbance_polar(margin, "fx", "fz", axes)


def _curve(solution: TorqueSolution, figure: Figure) -> Axes:
    return margin_torque_plot(margin_torque_curve(solution.problem), figure.add_subplot())


def _tolerances(solution: TorqueSolution, figure: Figure) -> Axes:
    found = tolerances(solution.problem, solution.torques, static_friction="coulomb")
    left, right = figure.subplots(1, 2, subplot_kw={"projection": "polar"})
    tolerance_plot(found, "centre of mass", left)
    return tolerance_plot(found, "push", right)


PLOTS: dict[str, tuple[Callable[[TorqueSolution, Figure], Axes], tuple[float, float]]] = {
    "section": (_section, (3.6, 3.6)),
    "torques": (_torques, (6.4, 4.6)),
    "ranges": (_ranges, (6.4, 3.2)),
    "disturbance": (_disturbance, (4.2, 4.2)),
    "curve": (_curve, (6.0, 3.6)),
    "tolerances": (_tolerances, (7.6, 4.3)),
}
"""How each kind is drawn, and its width and height in inches."""


def draw_plot(kind: str, solution: TorqueSolution) -> bytes:
    """Return a plot as a PNG on white, which reads in both themes.

    Args:
        kind: One of `PLOTS`.
        solution: What it is of.
    """
    draw, size = PLOTS[kind]
    figure = _white(size)
    draw(solution, figure)
    return _png(figure)


def draw_boundary(study: Study) -> bytes:
    """Return where the outcome of a study changes, over what varies first and next, as a PNG."""
    with tempfile.TemporaryDirectory() as folder:
        table = run_study(study, Path(folder) / "results.parquet", progress=False)
    figure = _white((6.4, 4.2))
    across, up = [variable.column for variable in study.variables][:2]
    border = study.entry.sampling.border or "found"
    outcome_boundary(table, across, up, figure.add_subplot(), outcome=border)
    return _png(figure)


def _white(size: tuple[float, float]) -> Figure:
    return Figure(figsize=size, layout="constrained", facecolor="white")


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130, metadata={"Software": None})
    return buffer.getvalue()
