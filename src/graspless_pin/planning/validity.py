"""Whether a planner may use a state, and how far it is from being of no use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from graspless_pin.geometry.bodies.collision import BodyShapes, PlacedBodies
from graspless_pin.geometry.posing.overlaps import Clearance, least_clearance
from graspless_pin.planning.evaluation import StateStatus
from graspless_pin.planning.state_solver import StateSolver
from graspless_pin.problem.checks import FloatArray, read_only, real_number
from graspless_pin.records import Brief
from graspless_pin.scene import Scene

_NO_BODIES = PlacedBodies(BodyShapes((), ()), np.empty((0, 4, 4)))


@dataclass(frozen=True, eq=False, repr=False)
class StateValidity(Brief):
    """Whether a state is valid, and by how much.

    Attributes:
        reasons: All that speaks against the state; none where it is valid.
        message: The same in words, with names and figures, a line for each reason.
        margin: The largest margin that torques within the limits reach, N; -inf where nothing
            holds the object, NaN where no margin is asked for.
        clearance: Least distance of bodies that shall not touch, m, negative where they overlap;
            infinite where there are no such bodies. See `Evaluator.validity`.
        closest: The names of these two bodies; empty where there are none.
        joint_names: The a joints of a configuration.
        joint_units: ``rad`` or ``m`` of each.
        joint_distances: (a,) how far each is from its nearer limit, rad or m; negative outside,
            infinite without limits.

    Examples:
        >>> from graspless_pin import Evaluator, load_scene
        >>> evaluator = Evaluator(load_scene("examples/allegro_box_on_slope.yaml"))
        >>> print(evaluator.validity({"joint_1.0": 1.7}, margin=0.2))  # rad
        not valid:
        q['joint_1.0']: is 1.7, outside the joint's limits [-0.196, 1.61]
        margin 0.7166 N
        clearance 2.39 mm, 'palm_link' and 'link_1.0'
        joint 'joint_1.0' is nearest to its limits, -0.09 rad
    """

    reasons: tuple[StateStatus, ...]
    message: str
    margin: float
    clearance: float
    closest: tuple[str, ...]
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    joint_distances: FloatArray

    @property
    def valid(self) -> bool:
        """Whether nothing speaks against the state."""
        return not self.reasons

    def __str__(self) -> str:
        """Return whether it is valid, why not, and the figures."""
        lines = ["valid"] if self.valid else ["not valid:", self.message]
        if not np.isnan(self.margin):
            lines.append(f"margin {self.margin:.4g} N")
        if self.closest:
            names = " and ".join(map(repr, self.closest))
            lines.append(f"clearance {1e3 * self.clearance:.2f} mm, {names}")
        if len(self.joint_names):
            nearest = int(np.argmin(self.joint_distances))
            lines.append(
                f"joint {self.joint_names[nearest]!r} is nearest to its limits, "
                f"{self.joint_distances[nearest]:.4g} {self.joint_units[nearest]}"
            )
        return "\n".join(lines)


def required_margin(margin: float | None, own: float) -> float:
    """Return the margin that is asked for, N; None: the evaluator's own; -inf: none is.

    Raises:
        ArgumentError: If it is negative or no number.
    """
    if margin is None:
        return own
    return -np.inf if margin == -np.inf else real_number("margin", margin, 0.0)


def state_validity(
    solver: StateSolver, q: Any, T_world_object: Any, twist: Any, required: float
) -> StateValidity:
    """Return the validity of a state: see `Evaluator.validity`."""
    at, asked = solver.configurations, required >= 0.0
    scene, problem, found = solver.posed(q, T_world_object, twist, solve=asked, whole=True)
    faults, margin = list(found), -np.inf if asked else np.nan
    if problem is not None:
        margin, status = solver.margin_of(scene, problem, required)
        if status is StateStatus.BELOW_MARGIN:
            text = f"the largest margin is {margin:.4g} N, below the {required:.4g} N asked for"
            faults.append((status, text))
        elif status is not StateStatus.FOUND:
            faults.append((status, status.message))
    nearest = _clearance(scene)
    values, (lower, upper) = at.array({} if q is None else q), at.joint_limits
    return StateValidity(
        reasons=tuple(dict.fromkeys(status for status, _ in faults)),
        message="\n".join(text for _, text in faults),
        margin=margin,
        clearance=nearest.distance,
        closest=nearest.bodies,
        joint_names=at.joint_names,
        joint_units=at.joint_units,
        joint_distances=read_only(np.minimum(values - lower, upper - values)),
    )


def _clearance(scene: Scene) -> Clearance:
    """Return the least clearance of a scene; given contacts say where the object touches."""
    moved = scene.object.placed_bodies if scene.given_contacts is None else _NO_BODIES
    depth, gap = scene.max_penetration, scene.contact_tolerance
    return least_clearance(scene.hand, scene.supports, moved, depth, gap)
