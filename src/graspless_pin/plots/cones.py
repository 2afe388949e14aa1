"""The friction cone of one contact, cut at its normal force."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.errors import ArgumentError
from graspless_pin.plots.canvas import axes_for
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.tables import contact_state, force_rounding, friction_use, shown
from graspless_pin.visualization import LIGHT, Role
from graspless_pin.visualization.contacts import virtual_velocities

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROOM = 1.2
_ROUND = 96
_ARROW = 0.9
_MOVES = 1e-9
_NOTHING = np.zeros((0, 2))


def friction_section(solution: TorqueSolution, contact: int, ax: Axes | None = None) -> Axes:
    """Draw the friction of one contact inside the cross-section of its cone.

    The cut is at the contact's normal force: dashed mu f_n of Coulomb's law, filled the polygon
    of the program's cone, dotted what is left of it where every face keeps the solution's margin.
    The friction is a dot; arrows show the directions of virtual or actual sliding of the object,
    which friction opposes.

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
    state = contact_state(problem, solution.contact_forces, contact)
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
    axes.set_aspect("equal")
    axes.set_xlim(-_ROOM * reach, _ROOM * reach)
    axes.set_ylim(-_ROOM * reach, _ROOM * reach)
    axes.axhline(0.0, color=LIGHT.text, linewidth=0.5, alpha=0.4)
    axes.axvline(0.0, color=LIGHT.text, linewidth=0.5, alpha=0.4)
    axes.set_xlabel("$f_{t1}$ [N]")
    axes.set_ylabel("$f_{t2}$ [N]")
    use = friction_use(problem, solution.contact_forces)[contact]
    share = "" if np.isnan(use) else f", {100.0 * use:.0f} % used"
    label = shown(normal, problem.scales.force, "", force_rounding(problem)[contact])
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
    """(r, 2) corners f_t1, f_t2 (N) of the cone's cut at the contact's normal force.

    A round cone has as many as a circle needs to look like one.

    Args:
        solution: A solution that was found.
        contact: Index of a contact that has a cone.
        margin: Distance that every side face keeps, N; no corners where it leaves nothing.
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
            corners = _cut(corners, direction, distance)
    return corners


def _cut(corners: FloatArray, direction: FloatArray, most: float) -> FloatArray:
    """Return the corners of the part of a convex polygon that is no farther along a direction."""
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
    if speed <= _MOVES:
        return
    axes.annotate(
        "",
        length * along / speed,
        (0.0, 0.0),
        arrowprops={"arrowstyle": "-|>", "color": LIGHT.roles[role], "linewidth": 1.6},
        label=role.label,
    )
