"""The fastest timing of an arm's path that does not lose what its hand holds.

Time-optimal path parametrisation by reachability analysis (TOPP-RA: H. Pham, Q.-C. Pham, 2018).
With s the way along the path, u = s'' and x = s'^2, inertial forces are linear in (u, x). At each
point of the path the pairs for which contact forces exist are a polygon: the rows of the contacts.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from graspless_pin.errors import ArgumentError, GrasplessPinError
from graspless_pin.geometry.hand.inertial_forces import STILL, hand_motions
from graspless_pin.geometry.pickling import Record
from graspless_pin.planning.carried_object import LOST, CarriedObject, ContactProgram
from graspless_pin.planning.configurations import Configuration, Configurations
from graspless_pin.problem.checks import FloatArray, real_number, whole_number
from graspless_pin.scene import Scene
from graspless_pin.scene.fields import checked_scene
from graspless_pin.scene.load_wrenches import object_wrench
from graspless_pin.suggestions import names_in_words

_FASTEST = 1e3
"""Along the path, rad/s: where no joint that moves has a limit."""
_AT_LIMIT = 1e-3
"""Of a limit, or of the box around the polygon: what is nearer limits."""


class TimingLimit(StrEnum):
    """What keeps a path from being followed faster. See the example of `fastest_timing`."""

    VELOCITY = "joint velocity"
    ACCELERATION = "joint acceleration"
    TORQUE = "joint torque"
    CONTACTS = "contacts"
    NOTHING = "nothing"
    """Only that speeds before or after are limited."""


@dataclass(frozen=True, eq=False)
class PathTiming(Record):
    """The fastest timing of a path. See the example of `fastest_timing`.

    Where there is none, arrays have the points of the path and no times: NaN.

    Attributes:
        reason: Why there is none; empty: there is one.
        joint_names: a independent joints, those of `Evaluator.joint_names`.
        times: (N,) s, from rest to rest.
        speeds: (N,) along the path, rad/s (the length of joints' velocities).
        positions: (N, a) rad or m.
        velocities: (N, a) rad/s or m/s.
        accelerations: (N, a) from this point on, rad/s^2 or m/s^2.
        margins: (N,) largest margin of contact forces at these accelerations under plain Coulomb
            friction, N.
        limits: N limits that the timing is at there, or at the end of the interval that begins.
        limiting_contacts: At each point the contacts that have no more room than the margin.
        bodies: What touches the object, by contact.
    """

    reason: str
    joint_names: tuple[str, ...]
    times: FloatArray
    speeds: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray
    margins: FloatArray
    limits: tuple[TimingLimit, ...]
    limiting_contacts: tuple[tuple[int, ...], ...]
    bodies: tuple[str, ...]

    @property
    def found(self) -> bool:
        """Whether there is a timing."""
        return not self.reason

    @property
    def duration(self) -> float:
        """Of the whole path, s; NaN where there is no timing."""
        return float(self.times[-1])

    def __str__(self) -> str:
        """Return how long it takes and what limits it."""
        if not self.found:
            return f"no timing: {self.reason}"
        shares = {limit: self.limits.count(limit) / len(self.limits) for limit in TimingLimit}
        told = [f"{limit} {100.0 * share:.0f} %" for limit, share in shares.items() if share]
        return f"{self.duration:.3f} s, limited by {', '.join(told)} of {len(self.times)} points"


def fastest_timing(
    scene: Scene,
    path: ArrayLike | Sequence[Configuration],
    *,
    velocity_limits: float | Mapping[str, float],
    acceleration_limits: float | Mapping[str, float] | None = None,
    torque_limits: Mapping[str, float] | None = None,
    margin: float = 0.0,
    torques: ArrayLike | Mapping[str, float] | None = None,
    points: int = 100,
) -> PathTiming:
    """Find the shortest time along an arm's path in which what the hand holds stays in it.

    The path is a cubic spline through the configurations; it begins and ends at rest. The object
    moves with the links that touch it, with the contacts that it has in the scene. Contact forces
    have to exist that keep the margin under plain Coulomb friction: any force inside the cones is
    believed, whether or not a virtual sliding calls for it. Loads of the scene count. Obstacles do
    not: `Evaluator.first_invalid` looks for collisions.

    Args:
        scene: A scene at rest in which a hand alone holds the object.
        path: K configurations, at least two: (K, a) positions of `Evaluator.joint_names`, rad or m,
            or one as `Evaluator.evaluate` takes it each. Links that touch must not move against
            each other.
        velocity_limits: Largest velocity of all joints, or by independent joint, rad/s or m/s.
        acceleration_limits: Likewise, rad/s^2 or m/s^2; None: no limit.
        torque_limits: Largest torque by independent joint, N m or N, of arm joints that J has no
            column for; None: only the hand's motors are limited.
        margin: That contact forces keep, N.
        torques: (L,) the motors' torques, which stay constant, or by name, N m or N; None: any
            within their limits.
        points: On the path, at which all limits are kept.

    Returns:
        The timing, or why there is none.

    Raises:
        ArgumentError: If a joint is unknown or outside its limits, a number out of range, a torque
            beyond its limits, a shape wrong, or links that touch move against each other.
        SceneError: If supports touch the object, no link does, or the scene moves or accelerates.
        GrasplessPinError: If TOPP-RA is not installed.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.planning import fastest_timing
        >>> scene = load_scene("examples/panda_stop_with_board.yaml").with_changes(
        ...     acceleration=None
        ... )
        >>> path = [{}, {"panda_joint1": 0.4}, {"panda_joint1": 1.0, "panda_joint2": 0.3}]
        >>> timing = fastest_timing(scene, path, velocity_limits=2.0, points=40)  # rad/s
        >>> timing.found, timing.duration < 2.0
        (True, True)
    """
    checked_scene(scene)
    carried = CarriedObject.of(scene, torques, real_number("margin", margin, 0.0))
    configurations = Configurations(carried.scene)
    names = configurations.joint_names
    no_limit: Mapping[str, float] = {}
    limits = _JointLimits(
        _by_joint("velocity_limits", velocity_limits, names),
        _by_joint(
            "acceleration_limits",
            no_limit if acceleration_limits is None else acceleration_limits,
            names,
        ),
        _by_joint("torque_limits", torque_limits or no_limit, names),
    )
    knots = _waypoints(configurations, path)
    ways = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    where = np.linspace(0.0, ways[-1], whole_number("points", points, 3))
    spline = CubicSpline(ways, knots, bc_type="natural")
    program = ContactProgram(carried)
    along = [_point(carried, program, spline, s, limits) for s in where]
    positions, slopes, bends = (np.array(spline(where, order)) for order in range(3))
    nothing = np.full(len(where), np.nan)
    blank = PathTiming(
        "", names, nothing, nothing, positions, np.nan * slopes, np.nan * slopes, nothing,
        (TimingLimit.NOTHING,) * len(where), ((),) * len(where), carried.scene.contacts.bodies,
    )  # fmt: skip
    for k, point in enumerate(along):
        if point is None:
            q = ", ".join(f"{value:.4g}" for value in positions[k].tolist())
            why = f"no torques within the limits hold the object at point {k}, q = [{q}]"
            return replace(blank, reason=f"{why}, whatever the speed")
    told = [point for point in along if point is not None]
    for end, point in (("start", told[0]), ("end", told[-1])):
        at_rest, _ = program.margin(point.wrench, point.torques, 0.0, 0.0)
        if not at_rest >= margin - LOST * carried.problem.scales.force:
            asked = f" with a margin of {margin:g} N" if margin else ""
            why = f"the torques do not hold the object at rest at the {end}{asked}"
            return replace(blank, reason=why)
    speeds = _fastest_speeds(told, where, knots, ways)
    if speeds is None:
        return replace(blank, reason="no timing keeps all limits from rest to rest")
    squared = speeds**2
    changes = np.diff(squared) / (2.0 * np.diff(where))
    changes = np.append(changes, changes[-1])
    found = [
        program.margin(point.wrench, point.torques, u, x)
        for point, u, x in zip(told, changes, squared, strict=True)
    ]
    margins, limiting = zip(*found, strict=True)
    if not min(margins) >= carried.margin - LOST * carried.problem.scales.force:
        lost = int(np.argmin(margins))
        return replace(blank, reason=f"no contact forces were found at point {lost} of the timing")
    last = len(where) - 1
    between = 2.0 * np.diff(where) / (speeds[:-1] + speeds[1:])
    return replace(
        blank,
        times=np.concatenate([[0.0], np.cumsum(between)]),
        speeds=speeds,
        velocities=slopes * speeds[:, None],
        accelerations=slopes * changes[:, None] + bends * squared[:, None],
        margins=np.array(margins),
        limits=tuple(
            _limit((told[k], told[min(k + 1, last)]), u, squared[[k, min(k + 1, last)]])
            for k, u in enumerate(changes)
        ),
        limiting_contacts=limiting,
    )


class _JointLimits(NamedTuple):
    """What a independent joints may do; infinite where there is no limit.

    Attributes:
        velocity: (a,) rad/s or m/s.
        acceleration: (a,) rad/s^2 or m/s^2.
        torque: (a,) N m or N.
    """

    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray


class _PathPoint(NamedTuple):
    """A point of a path: what is asked of contact forces, and what limits u and x there.

    Attributes:
        wrench: (6, 3) external and inertial wrench in world axes at the start, as a sum of
            (1, u, x).
        torques: (L, 3) what the motors bear besides the contacts, likewise.
        rows: (k, 2) of (u, x).
        sides: (k,) rows @ (u, x) <= sides.
        kinds: k limits that the rows stand for.
    """

    wrench: FloatArray
    torques: FloatArray
    rows: FloatArray
    sides: FloatArray
    kinds: tuple[TimingLimit, ...]


def _limit(ends: Sequence[_PathPoint], u: float, squared: FloatArray) -> TimingLimit:
    """Return a limit that is reached at either end of an interval: a joint's, if there is one."""
    reached = set[TimingLimit]()
    for point, x in zip(ends, squared, strict=True):
        sizes = np.abs(point.rows) @ np.abs([u, x]) + np.abs(point.sides)
        left = point.sides - point.rows @ [u, x]
        reached |= {point.kinds[k] for k in np.flatnonzero(left <= _AT_LIMIT * sizes)}
    return next((one for one in TimingLimit if one in reached), TimingLimit.NOTHING)


def _point(
    carried: CarriedObject,
    program: ContactProgram,
    spline: CubicSpline,
    s: float,
    limits: _JointLimits,
) -> _PathPoint | None:
    """Return the limits at a point of a path; None where nothing holds the object at any speed."""
    q, slope, bend = (np.asarray(spline(s, order)) for order in range(3))
    scene = carried.moved(q)
    hand = scene.hand
    assert hand is not None  # noqa: S101 - as in the scene
    tree, names = hand.tree, list(carried.hand.control.joints)
    slopes, bends = (dict(zip(names, one.tolist(), strict=True)) for one in (slope, bend))
    by_u, by_x = hand_motions(hand, STILL, {}, slopes), hand_motions(hand, STILL, slopes, bends)
    carrier = tree.link_joints[carried.links[0]]
    at_rest = object_wrench(scene, STILL)
    wrenches = np.column_stack(
        [at_rest, *(object_wrench(scene, one.joints[carrier]) - at_rest for one in (by_u, by_x))]
    )
    own = np.column_stack(
        [
            tree.gravity_torques(hand.positions, scene.gravity),
            by_u.joint_torques(hand),
            by_x.joint_torques(hand),
        ]
    )
    if not scene.count_own_weight:
        own = np.zeros_like(own)
    # The start's axes: contacts are there as they were.
    R = carried.scene.object.T_world_object[:3, :3] @ scene.object.T_world_object[:3, :3].T
    turned = np.vstack([R @ wrenches[:3], R @ wrenches[3:]])
    hybrid = np.zeros((carried.problem.joint_count - len(hand.actuated_joint_names), 3))
    motors = np.vstack([hand.actuation.from_joints.T @ own, hybrid])
    with np.errstate(divide="ignore"):
        most = float(np.min(limits.velocity / np.abs(slope), initial=_FASTEST)) ** 2
    polygon = program.polygon(turned, motors, most)
    if polygon is None:
        return None
    rows, sides = [*polygon[0]], [*polygon[1]]
    kinds = [TimingLimit.CONTACTS] * len(rows) + [TimingLimit.VELOCITY]
    rows.append(np.array([0.0, 1.0]))
    sides.append(most)
    # Joints bear what the links need, and the object at the link that carries it.
    J, center = tree.kinematics(hand.positions).J, scene.object.center_of_mass_world
    about_origin = wrenches.copy()
    about_origin[3:] += np.cross(center, wrenches[:3], axis=0)
    joints = tree.coupling.S.T @ (own - (J * tree.moves[carrier]).T @ about_origin)
    of_path = np.column_stack([np.zeros(len(slope)), slope, bend])
    for kind, most_of, parts in (
        (TimingLimit.TORQUE, limits.torque, joints),
        (TimingLimit.ACCELERATION, limits.acceleration, of_path),
    ):
        for joint in np.flatnonzero(np.isfinite(most_of)):
            still, *moving = parts[joint]
            for sign in (1.0, -1.0):
                rows.append(sign * np.array(moving))
                sides.append(most_of[joint] - sign * still)
                kinds.append(kind)
    return _PathPoint(turned, motors, np.array(rows), np.array(sides), tuple(kinds))


def _fastest_speeds(
    along: Sequence[_PathPoint], where: FloatArray, knots: FloatArray, ways: FloatArray
) -> FloatArray | None:
    """Return the (N,) largest speeds along a path, by TOPP-RA; None where there are none.

    Raises:
        GrasplessPinError: If it is not installed.
    """
    try:
        with warnings.catch_warnings():
            # Its docstrings have backslashes that Python warns of where it is first compiled.
            warnings.simplefilter("ignore")
            import toppra
            from toppra.algorithm import TOPPRA
            from toppra.constraint import DiscretizationType, LinearConstraint
            from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate
    except ImportError as error:
        raise GrasplessPinError(
            f"timings need TOPP-RA ({error}); install it with pip install 'graspless-pin[planning]'"
        ) from None
    most = max(len(point.rows) for point in along)
    rows, sides = np.zeros((len(along), most, 2)), np.ones((len(along), most))
    for k, point in enumerate(along):
        sizes = np.maximum(np.linalg.norm(point.rows, axis=1), 1e-300)
        rows[k, : len(point.rows)] = point.rows / sizes[:, None]
        sides[k, : len(point.rows)] = point.sides / sizes

    class Rows(LinearConstraint):
        """The rows of contacts, velocities and torques."""

        def compute_constraint_params(self, *_: Any) -> tuple[Any, ...]:
            unit = np.ones((len(where), 1)) * np.array([[1.0, 0.0]])
            still = np.zeros_like(unit)
            # Rows hold at both ends of an interval, with its one acceleration.
            return canlinear_colloc_to_interpolate(
                unit, unit[:, ::-1].copy(), still, rows, sides, None, None, where
            )

    limits = Rows()
    limits.discretization_type = DiscretizationType.Interpolation
    path = toppra.SplineInterpolator(ways, knots, bc_type="natural")
    search = TOPPRA([limits], path, gridpoints=where, solver_wrapper="seidel")
    search.compute_parameterization(0.0, 0.0)
    speeds = search.problem_data.sd_vec
    if speeds is None or not np.isfinite(speeds).all() or not (speeds[1:-1] > 0.0).all():
        return None
    return np.array(speeds)


def _waypoints(configurations: Configurations, path: Any) -> FloatArray:
    """Return (K, a) positions of different configurations that follow each other."""
    ways = np.array([configurations.array(q) for q in path], dtype=float)
    for k, q in enumerate(ways):
        try:
            configurations.hand_at(q)
        except ArgumentError as error:
            raise ArgumentError(f"path[{k}]", str(error)) from error
    steps = np.linalg.norm(np.diff(ways, axis=0), axis=1) if len(ways) > 1 else np.zeros(0)
    if not len(steps) or not steps.all():
        found = "two that follow each other and are the same" if len(steps) else str(len(ways))
        raise ArgumentError("path", f"needs two configurations or more, found {found}")
    return ways


def _by_joint(argument: str, told: Any, names: tuple[str, ...]) -> FloatArray:
    """Return (a,) positive limits; infinite where none is told."""
    if not isinstance(told, Mapping):
        return np.full(len(names), _positive(argument, told))
    limits = np.full(len(names), np.inf)
    for name, value in told.items():
        if name not in names:
            raise ArgumentError(argument, f"has no joint {name!r}; {names_in_words(name, names)}")
        limits[names.index(name)] = _positive(f"{argument}[{name!r}]", value)
    return limits


def _positive(argument: str, value: Any) -> float:
    number = real_number(argument, value, 0.0)
    if number == 0.0:
        raise ArgumentError(argument, "is 0; it must be more")
    return number
