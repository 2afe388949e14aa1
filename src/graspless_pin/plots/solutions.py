"""Plots of one solution: torques, forces, friction and tolerances.

Joint torques within their limits, and ranges of normal forces, as bars; friction in the
cross-section of its cone; tolerances by their direction across gravity.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.algorithms.force_bounds import ContactForceBounds
from graspless_pin.algorithms.tolerance_tables import Tolerances
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.plots.canvas import axes_for, legend_above, plain_axis, plain_text, polar_region
from graspless_pin.problem.checks import FloatArray, units_text
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.tables import (
    contact_states,
    decimals,
    force_rounding,
    friction_use,
    limit_shares,
)
from graspless_pin.visualization import LIGHT, Role
from graspless_pin.visualization.contacts import virtual_velocities
from graspless_pin.visualization.drawing import level_boundary
from graspless_pin.visualization.picture import across_gravity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.projections.polar import PolarAxes


_RANGE_BAR = 0.5
_EDGE_FACTOR = 1.15
_PADDING_AT_ENDS = 0.02


def normal_force_ranges(
    bounds: ContactForceBounds, solution: TorqueSolution | None = None, ax: Axes | None = None
) -> Axes:
    """Draw the range of each contact's normal force as a bar, and the solution's as a dot.

    Args:
        bounds: Ranges that were found, of `contact_force_bounds`.
        solution: A solution of the same problem; None: no dots.
        ax: Axes to draw on; None: a new figure.

    Returns:
        The axes, N: one bar for each contact, the first on top. An unbounded one leaves the axes
        and ends in an arrow. The label says where ranges are reached and not all proven.

    Raises:
        NoSolutionError: If the torques cannot be held.

    Examples:
        >>> from graspless_pin import contact_force_bounds, load_scene
        >>> from graspless_pin.plots import normal_force_ranges
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> solution = scene.solve("torque", margin=0.1)
        >>> bounds = contact_force_bounds(solution.problem, solution.torques)
        >>> normal_force_ranges(bounds, solution).get_xlabel()
        'normal force $f_n$ [N]'
    """
    if not bounds.found:
        raise NoSolutionError(f"There are no force ranges ({bounds.message}).")
    problem = bounds.problem
    lower, upper = bounds.lower[:, 0], bounds.upper[:, 0]
    axes = axes_for(ax, size=(6.4, 1.2 + 0.3 * len(lower)))
    rows = np.arange(len(lower))
    finite = upper[np.isfinite(upper)]
    edge = _EDGE_FACTOR * float(max(finite.max(initial=0.0), lower.max(), 1e-9))
    blue = LIGHT.roles[Role.NORMAL_FORCE]
    ends = np.where(np.isfinite(upper), upper, edge)
    axes.barh(
        rows, ends - lower, left=lower, height=_RANGE_BAR, color=blue, alpha=0.35, label="range"
    )
    # A determinate force has a range without width.
    axes.vlines(lower, rows - 0.5 * _RANGE_BAR, rows + 0.5 * _RANGE_BAR, color=blue, linewidth=2.0)
    free = np.isinf(upper)
    axes.plot(
        ends[free], rows[free], ">", color=blue, label="unbounded" if free.any() else "_unbounded"
    )
    if solution is not None:
        normal = np.einsum("ij,ij->i", problem.normals, solution.contact_forces)
        axes.plot(normal, rows, "o", color=LIGHT.text, markersize=5, label="of the solution")
    axes.set_yticks(rows, [f"contact {row}" for row in rows])
    unproven = "" if bounds.proven[:, 0].all() else ", as far as found"
    axes.set(
        xlabel=f"normal force $f_n$ [N]{unproven}",
        # From zero, with room for a bar or mark at the right end.
        xlim=(-_PADDING_AT_ENDS * edge, (1.0 + _PADDING_AT_ENDS) * edge),
        ylim=(len(rows) - 0.4, -0.6),
        axisbelow=True,
    )
    plain_axis(axes.xaxis)
    axes.grid(axis="x", alpha=0.25)
    if ax is None:
        legend_above(axes)
    return axes


_AT_LIMIT = 1.0 - 1e-6
_TORQUE_BAR = 0.62


def torque_bars(solution: TorqueSolution, ax: Axes | None = None) -> Axes:
    """Draw each joint's motor torque as a bar between the marks of its limits.

    A bar at its limit has another colour. An infinite limit has no mark.

    Args:
        solution: A solution that was found.
        ax: Axes to draw on; None: a new figure.

    Returns:
        The axes: one horizontal bar for each joint, the first on top; N m (N for prismatic and
        hybrid joints).

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
    axes.barh(rows, torques, height=_TORQUE_BAR, color=colors)
    axes.axvline(0.0, color=LIGHT.text, linewidth=0.8)
    limits, both = np.concatenate([lower, upper]), np.tile(rows, 2)
    marked = np.isfinite(limits)
    axes.vlines(
        limits[marked],
        both[marked] - 0.5 * _TORQUE_BAR,
        both[marked] + 0.5 * _TORQUE_BAR,
        color=LIGHT.text,
        linewidth=2.0,
        label="limits",
    )
    axes.set_yticks(rows, [plain_text(name) for name in problem.joint_names])
    label = f"motor torque [{units_text(problem.joint_units)}]"
    axes.set(xlabel=label, ylim=(count - 0.4, -0.6), axisbelow=True)
    plain_axis(axes.xaxis)
    if ax is None and marked.any():
        legend_above(axes)
    axes.grid(axis="x", alpha=0.25)
    return axes


DIRECTED = (Quantity.CENTER, Quantity.PUSH, Quantity.MOMENT)
"""Quantities whose tolerance depends on a direction."""
_OFF_LEVEL = 1e-6  # of a unit vector
_WIDEST_CIRCLE = 12.0
"""Of the least tolerance: larger ones leave the circle, so that the least can be seen."""


def tolerance_plot(
    tolerances: Tolerances,
    quantity: Quantity | str = Quantity.CENTER,
    ax: PolarAxes | None = None,
) -> Axes:
    """Draw the tolerance of the centre of mass, of a push or of a moment, by direction.

    Across gravity: directions are level ones. All deviations inside the line are balanced; larger
    pushes and moments may be, as the line is the hull of the directions that were examined. The
    circle ends at twelve times the smallest.

    Args:
        tolerances: Of `tolerances`.
        quantity: ``centre of mass``, ``push`` or ``moment``.
        ax: Polar axes to draw on; None: a new figure.

    Returns:
        Polar axes, radius in cm, N or N m. A dot marks where the least tolerance fails; the legend
        states that tolerance, with its direction where that is not level, and the contacts at which
        it fails.

    Raises:
        ArgumentError: If the tolerances do not include the quantity, or it has no directions.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.plots import tolerance_plot
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> off = scene.tolerances(scene.solve().torques, static_friction="coulomb")
        >>> tolerance_plot(off, "push").name
        'polar'
    """
    from matplotlib.ticker import MaxNLocator

    by_quantity = {one.quantity: one for one in tolerances.each if one.quantity in DIRECTED}
    if quantity not in by_quantity:
        known = ", ".join(by_quantity) or "nothing"
        raise ArgumentError(
            "quantity", f"is '{quantity}'; these tolerances depend on a direction for: {known}"
        )
    one = by_quantity[Quantity(quantity)]
    scale, unit = one.quantity.scale, one.quantity.unit
    level = across_gravity(tolerances.weight)
    up = np.cross(level[0], level[1])
    angles, sizes = level_boundary(one, level)
    radii = scale * sizes
    names = [_direction_name(direction) for direction in (*level, *-level)]
    axes = polar_region(ax, (4.6, 4.9), angles, radii, names)
    direction = np.zeros(3) if one.direction is None else one.direction
    words = f"smallest: {scale * one.balanced:.3g} {unit}"
    at, mark = ([np.arctan2(*(level @ direction)[::-1])], [scale * one.failing]), "o"
    if abs(direction @ up) > _OFF_LEVEL:
        words += f" along {_components_text(direction)}"
        at, mark = ([], []), "None"
    if one.contacts:
        many = "s" * (len(one.contacts) > 1)
        words += f"\nfails at contact{many} {', '.join(map(str, one.contacts))}"
    axes.plot(*at, mark, color=LIGHT.roles[Role.FRICTION_AT_LIMIT], linestyle="none", label=words)
    top = min(1.08 * float(radii.max()), _WIDEST_CIRCLE * float(radii.min()) or np.inf)
    axes.set_ylim(0.0, top or 1.0)
    axes.yaxis.set_major_locator(MaxNLocator(4, prune="lower"))
    plain_axis(axes.yaxis)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.08), fontsize="small", frameon=False,
        handlelength=1.0,
    )  # fmt: skip
    axes.set_title(f"tolerance: {one.quantity}, across gravity [{unit}]", fontsize="medium")
    return axes


def _direction_name(direction: FloatArray) -> str:
    """Return the name of a unit vector: a world axis, or its components."""
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) > 1.0 - _OFF_LEVEL:
        return f"{'+' if direction[axis] > 0.0 else '−'}{'xyz'[axis]}"
    return _components_text(direction)


def _components_text(direction: FloatArray) -> str:
    return f"[{', '.join(f'{x:+.2f}' for x in direction.tolist())}]".replace("-", "−")


_FRAME_FACTOR = 1.2
_ROUND = 96
_ARROW = 0.9
_LEAST_SPEED = 1e-9
_NOTHING = np.zeros((0, 2))


def friction_section(solution: TorqueSolution, contact: int, ax: Axes | None = None) -> Axes:
    """Draw the friction of one contact inside the cross-section of its cone.

    The section is at the contact's normal force: dashed mu f_n of Coulomb's law, filled the polygon
    of the program's cone, dotted the part of it where every face keeps the solution's margin. The
    friction is a dot; arrows show the directions of virtual or actual sliding of the object, which
    friction opposes.

    Args:
        solution: A solution that was found.
        contact: Index of the contact.
        ax: Axes to draw on; None: a new figure.

    Returns:
        The axes, f_t1 to the right and f_t2 up, N.

    Raises:
        NoSolutionError: If the solution was not found.
        ArgumentError: If there is no such contact.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.plots import friction_section
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> friction_section(scene.solve(), contact=0).get_xlabel()
        '$f_{t1}$ [N]'
    """
    problem = solution.problem
    if not 0 <= contact < problem.contact_count:
        raise ArgumentError(
            "contact", f"is {contact}; the problem has contacts 0 to {problem.contact_count - 1}"
        )
    force = solution.contact_forces[contact]
    normal = float(problem.normals[contact] @ force)
    friction = problem.tangents[contact].T @ force
    mu = float(problem.friction[contact])
    state = contact_states(problem, solution.contact_forces)[contact]
    axes = axes_for(ax, size=(3.4, 3.4))
    radius = max(mu * normal, float(np.linalg.norm(friction)))
    reach = radius if radius > 0.0 else 1.0
    _draw_cone(axes, solution, contact, normal)
    _draw_sliding(axes, solution, contact, _ARROW * reach)
    color = LIGHT.roles[
        Role.FRICTION_AT_LIMIT if state in ("sliding", "at its limit") else Role.FRICTION_FORCE
    ]
    axes.plot([0.0, friction[0]], [0.0, friction[1]], color=color, linewidth=2.0, zorder=3)
    axes.plot(*friction, "o", color=color, markersize=7, zorder=4, label="friction force")
    ends = -_FRAME_FACTOR * reach, _FRAME_FACTOR * reach
    axes.set(aspect="equal", xlim=ends, ylim=ends, xlabel="$f_{t1}$ [N]", ylabel="$f_{t2}$ [N]")
    axes.axhline(0.0, color=LIGHT.text, linewidth=0.5, alpha=0.4)
    axes.axvline(0.0, color=LIGHT.text, linewidth=0.5, alpha=0.4)
    use = friction_use(problem, solution.contact_forces)[contact]
    share = "" if np.isnan(use) else f", {100.0 * use:.0f} % used"
    label = decimals(normal, problem.scales.force, "", force_rounding(problem)[contact])
    axes.set_title(f"contact {contact}: {state}{share}\n$f_n$ = {label} N", fontsize="medium")
    if ax is None:
        named = [
            one for one in (*axes.lines, *axes.patches) if not str(one.get_label()).startswith("_")
        ]
        axes.legend(
            handles=named, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2,
            fontsize="x-small",
        )  # fmt: skip
    return axes


def section_corners(solution: TorqueSolution, contact: int, margin: float = 0.0) -> FloatArray:
    """(r, 2) corners f_t1, f_t2 (N) of the cone's section at the contact's normal force.

    A round cone is drawn as a polygon with many corners.

    Args:
        solution: A solution that was found.
        contact: Index of a contact that has a cone.
        margin: Distance to every side face, N; no corners where nothing is left.
    """
    problem, model = solution.problem, solution.problem.cone_model
    normal = float(problem.normals[contact] @ solution.contact_forces[contact])
    mu = float(problem.friction[contact])
    if model.second_order:
        radius = mu * normal - margin * np.sqrt(1.0 + mu**2)
        return radius * model.section(_ROUND).corners if radius > 0.0 else _NOTHING
    section = problem.cone_section
    corners = mu * normal * section.corners if mu * normal > 0.0 else _NOTHING
    if margin > 0.0:
        slopes = mu * section.distances
        # A face at distance e: slope f_n - (outward tangential force) = e sqrt(1 + slope^2).
        most = slopes * normal - margin * np.sqrt(1.0 + slopes**2)
        for direction, distance in zip(section.directions.T, most, strict=True):
            corners = _clipped_polygon(corners, direction, distance)
    return corners


def _clipped_polygon(corners: FloatArray, direction: FloatArray, most: float) -> FloatArray:
    """Return the corners of a convex polygon, clipped at a distance along a direction."""
    kept = []
    for first, second in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        before, after = direction @ first - most, direction @ second - most
        if before <= 0.0:
            kept.append(first)
        if before * after < 0.0:
            kept.append(first + before / (before - after) * (second - first))
    return np.array(kept).reshape(-1, 2)


def _draw_cone(axes: Axes, solution: TorqueSolution, contact: int, normal: float) -> None:
    from matplotlib.patches import Circle, Polygon

    problem = solution.problem
    mu = float(problem.friction[contact])
    if mu * normal > 0.0 and problem.cone_model.is_coulomb:
        axes.add_patch(
            Circle((0.0, 0.0), mu * normal, fill=False, linestyle="--", edgecolor=LIGHT.text,
                   linewidth=0.8, label=r"$\mu f_n$")
        )  # fmt: skip
    if not problem.has_cone[contact]:
        return
    cone = LIGHT.roles[Role.CONE]
    corners = section_corners(solution, contact)
    if len(corners):
        axes.add_patch(Polygon(corners, facecolor=cone, alpha=0.3, label="friction cone"))
    kept = section_corners(solution, contact, max(solution.margin, 0.0))
    if len(kept):
        axes.add_patch(
            Polygon(kept, fill=False, linestyle=":", edgecolor=LIGHT.text, label="with the margin")
        )


def _draw_sliding(axes: Axes, solution: TorqueSolution, contact: int, length: float) -> None:
    problem = solution.problem
    if problem.is_sliding[contact]:
        role, velocity = Role.SLIDING, problem.sliding[contact]
    else:
        role, velocity = Role.VIRTUAL_SLIDING, virtual_velocities(solution)[contact]
    along = problem.tangents[contact].T @ velocity
    speed = float(np.linalg.norm(along))
    if speed <= _LEAST_SPEED:
        return
    axes.annotate(
        "",
        length * along / speed,
        (0.0, 0.0),
        arrowprops={"arrowstyle": "-|>", "color": LIGHT.roles[role], "linewidth": 1.6},
        label=role.label,
    )
