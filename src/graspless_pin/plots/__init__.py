"""Plots of solutions and analyses with matplotlib: each function returns the `Axes` it drew on.

Needs the extra ``plots``. Without ``ax`` a new pyplot figure is made; with it only those axes are
touched, so that the caller can combine and style plots.
"""

from graspless_pin.plots.curves import (
    disturbance_polar,
    margin_torque_plot,
    path_margins,
    path_torques,
    plane_directions,
    squeeze_plot,
    timing_plot,
)
from graspless_pin.plots.solutions import (
    friction_section,
    normal_force_ranges,
    tolerance_plot,
    torque_bars,
)
from graspless_pin.plots.tables import margin_heat_map, margin_plot, outcome_boundary

__all__ = [
    "disturbance_polar",
    "friction_section",
    "margin_heat_map",
    "margin_plot",
    "margin_torque_plot",
    "normal_force_ranges",
    "outcome_boundary",
    "path_margins",
    "path_torques",
    "plane_directions",
    "squeeze_plot",
    "timing_plot",
    "tolerance_plot",
    "torque_bars",
]
