"""The fastest timing of an arm's path for which contact forces hold the object in its hand.

Time-optimal path parametrisation by reachability analysis (TOPP-RA: H. Pham, Q.-C. Pham, 2018).
With s the length along the path, u = s'' and x = s'^2, inertial forces are linear in (u, x). At
each point of the path the (u, x) for which contact forces exist form a polygon.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError, SceneError, optional_import
from graspless_pin.geometry.hand.joint_columns import STILL, motions_at
from graspless_pin.geometry.hand.work_space import Kinematics
from graspless_pin.planning.attached_states import AttachedConfigurations
from graspless_pin.planning.configurations import Configuration
from graspless_pin.planning.contact_program import MARGIN_SLACK, ContactProgram, motor_limits
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, real_number, whole_number
from graspless_pin.records import Record
from graspless_pin.scene import Scene
from graspless_pin.scene.fields import checked_scene, place_of
from graspless_pin.scene.load_wrenches import object_wrench
from graspless_pin.suggestions import names_in_words

_FASTEST_PATH = 1e3
"""Largest speed along the path where no moving joint has a velocity limit, rad/s."""
_NEAR_LIMIT = 1e-3
"""Relative slack below which a limit counts as reached."""


class TimingLimit(StrEnum):
    """The limit that a timing reaches at a point. See the example of `fastest_timing`."""

    VELOCITY = "joint velocity"
    ACCELERATION = "joint acceleration"
    TORQUE = "joint torque"
    CONTACTS = "contacts"
    NOTHING = "nothing"
    """None here: only speeds before or after are limited."""


@dataclass(frozen=True, eq=False)
class PathTiming(Record):
    """The fastest timing of a path. See the example of `fastest_timing`.

    Without a timing the arrays have the points of the path, and times and rates are NaN.

    Attributes:
        reason: Why there is no timing; empty: there is one.
        joint_names: a joints, those of `Evaluator.joint_names` with the same ``attached_to``.
        times: (N,) s, from rest to rest.
        speeds: (N,) along the path, rad/s (the length of joints' velocities).
        positions: (N, a) rad or m.
        velocities: (N, a) rad/s or m/s.
        accelerations: (N, a) in the interval that begins at the point, rad/s^2 or m/s^2.
        margins: (N,) largest margin of contact forces at these accelerations under plain Coulomb
            friction, N.
        limits: N limits that the timing reaches at the point, or at the end of that interval.
        limiting_contacts: At each point the contacts whose slack is the margin.
        bodies: The body that touches the object at each contact.
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
        """Return the duration, and the shares of points at which each limit is reached."""
        if not self.found:
            return f"no timing: {self.reason}"
        shares = {limit: self.limits.count(limit) / len(self.limits) for limit in TimingLimit}
        parts = [f"{limit} {100.0 * share:.0f} %" for limit, share in shares.items() if share]
        return f"{self.duration:.3f} s, limited by {', '.join(parts)} of {len(self.times)} points"


def fastest_timing(
    scene: Scene,
    path: ArrayLike | Sequence[Configuration],
    *,
    attached_to: str,
    velocity_limits: float | Mapping[str, float] | None = None,
    acceleration_limits: float | Mapping[str, float] | None = None,
    torque_limits: Mapping[str, float] | None = None,
    margin: float = 0.0,
    torques: ArrayLike | Mapping[str, float] | None = None,
    points: int = 100,
) -> PathTiming:
    """Find the fastest timing of an arm's path for which contact forces hold the object.

    The path is a cubic spline through the configurations; it begins and ends at rest. The object
    moves with a link, with the contacts that it has in the scene. Contact forces with the margin
    have to exist under plain Coulomb friction: any force inside the cones is admitted, with or
    without a virtual sliding; for round cones, any inside their pyramids. Loads of the scene are
    included. Collisions are not checked, see `Evaluator.first_invalid`.

    Args:
        scene: A scene at rest in which a hand alone holds the object.
        path: K configurations, at least two: (K, a) positions of all joints but those behind the
            link, rad or m, or a sequence of configurations as `Evaluator.evaluate` takes them.
        attached_to: Name of the link that the object moves with, see `Evaluator`.
        velocity_limits: Largest velocity of all joints, or by independent joint, rad/s or m/s;
            the default are the limits in URDFs.
        acceleration_limits: Likewise, rad/s^2 or m/s^2; by default there is no limit.
        torque_limits: Largest torque by independent joint, N m or N, for arm joints without a
            column in J; None: only the hand's motors are limited.
        margin: Required margin of contact forces, N.
        torques: (L,) the motors' torques, which stay constant, or by name, N m or N; None: any
            within their limits.
        points: Number of points on the path at which all limits are kept.

    Returns:
        The timing, or why there is none.

    Raises:
        ArgumentError: If a joint is unknown or, at a point of the spline, outside its limits, a
            number out of range, a torque beyond its limits or a shape wrong; if the object cannot
            move with the link, as a support touches it or the scene declares a motion.
        SceneError: If the scene states an acceleration.
        StateError: If nothing touches the object.
        GrasplessPinError: If TOPP-RA is not installed.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.planning import fastest_timing
        >>> scene = load_scene("examples/panda_stop_with_board.yaml").with_changes(
        ...     acceleration=None
        ... )
        >>> path = [{}, {"panda_joint1": 0.4}, {"panda_joint1": 1.0, "panda_joint2": 0.3}]
        >>> timing = fastest_timing(
        ...     scene, path, attached_to="panda_hand", velocity_limits=2.0, points=40
        ... )  # rad/s
        >>> timing.found, timing.duration < 2.0
        (True, True)
    """
    checked_scene(scene)
    at = AttachedConfigurations(scene, attached_to)
    if scene.acceleration is not None:
        raise SceneError(
            f"{place_of(scene, 'acceleration')}: is stated, but the path determines all "
            "accelerations; use scene.with_changes(acceleration=None)"
        )
    names, problem = at.joint_names, at.shared_problem(at.scene, at.scene.problem())
    margin = real_number("margin", margin, 0.0)
    program = ContactProgram(problem, motor_limits(problem, torques), margin)
    limits = {
        TimingLimit.VELOCITY: _joint_limits(
            "velocity_limits", velocity_limits, names, at.rate_limits
        ),
        TimingLimit.ACCELERATION: _joint_limits("acceleration_limits", acceleration_limits, names),
        TimingLimit.TORQUE: _joint_limits("torque_limits", torque_limits, names),
    }
    knots = _checked_waypoints(at, path)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    where = np.linspace(0.0, lengths[-1], whole_number("points", points, 3))
    toppra = _toppra()
    spline = toppra.SplineInterpolator(lengths, knots, bc_type="natural")
    positions, slopes, bends = (np.array(spline(where, order)) for order in range(3))
    along = _path_points(at, program, (positions, slopes, bends), limits)
    nothing = np.full(len(where), np.nan)
    most_lost = MARGIN_SLACK * problem.scales.force
    blank = PathTiming(
        "", names, nothing, nothing, positions, np.nan * slopes, np.nan * slopes, nothing,
        (TimingLimit.NOTHING,) * len(where), ((),) * len(where), at.scene.contacts.bodies,
    )  # fmt: skip
    for k, point in enumerate(along):
        if not point.kinds:
            q = ", ".join(f"{value:.4g}" for value in positions[k].tolist())
            lost = f"at point {k}, q = [{q}], whatever the speed"
            return replace(blank, reason=_unheld_reason(problem, torques, margin, point, lost))
    for end, point in (("start", along[0]), ("end", along[-1])):
        if not program.margin(point.wrench, point.torques, 0.0, 0.0)[0] >= margin - most_lost:
            lost = f"at rest at the {end}"
            return replace(blank, reason=_unheld_reason(problem, torques, margin, point, lost))
    speeds = _fastest_speeds(toppra, spline, along, where)
    if speeds is None:
        return replace(blank, reason=_timing_fault(names, limits[TimingLimit.TORQUE], along))
    squared = speeds**2
    changes = np.diff(squared) / (2.0 * np.diff(where))
    changes = np.append(changes, changes[-1])
    pairs = [
        program.margin(point.wrench, point.torques, u, x)
        for point, u, x in zip(along, changes, squared, strict=True)
    ]
    margins, limiting = zip(*pairs, strict=True)
    if not min(margins) >= margin - most_lost:
        lost = int(np.argmin(margins))
        return replace(blank, reason=f"no contact forces were found at point {lost} of the timing")
    last = len(where) - 1
    durations = 2.0 * np.diff(where) / (speeds[:-1] + speeds[1:])
    return replace(
        blank,
        times=np.concatenate([[0.0], np.cumsum(durations)]),
        speeds=speeds,
        velocities=slopes * speeds[:, None],
        accelerations=slopes * changes[:, None] + bends * squared[:, None],
        margins=np.array(margins),
        limits=tuple(
            _reached_limit((along[k], along[min(k + 1, last)]), u, squared[[k, min(k + 1, last)]])
            for k, u in enumerate(changes)
        ),
        limiting_contacts=limiting,
    )


_JointLimits = Mapping[TimingLimit, FloatArray]
"""(a,) limits of independent joints, infinite where there is none: of velocities, rad/s or m/s,
accelerations, rad/s^2 or m/s^2, and torques, N m or N."""


class _PathPoint(NamedTuple):
    """A point of a path: loads as linear functions of (u, x), and the limits of (u, x) there.

    Attributes:
        wrench: (6, 3) coefficients of (1, u, x) in the external and inertial wrench, in the axes of
            the joint that carries the object.
        torques: (L, 3) those in the motors' torques without contact forces, likewise.
        joints: (a, 3) those in the torques of the independent joints, likewise.
        rows: (k, 2) coefficients of (u, x).
        sides: (k,) rows @ (u, x) <= sides.
        kinds: The k limits of the rows; none where no contact forces exist at any speed.
    """

    wrench: FloatArray
    torques: FloatArray
    joints: FloatArray
    rows: FloatArray
    sides: FloatArray
    kinds: tuple[TimingLimit, ...]


def _unheld_reason(
    problem: QuasistaticProblem, torques: Any, margin: float, point: _PathPoint, where: str
) -> str:
    """Return in words which torques do not hold the object at a point, and which would."""
    free = problem.lower_torque, problem.upper_torque
    names = problem.joint_names

    def is_held(limits: tuple[FloatArray, FloatArray]) -> bool:
        program = ContactProgram(problem, limits, margin)
        if point.kinds:
            least = margin - MARGIN_SLACK * problem.scales.force
            return program.margin(point.wrench, point.torques, 0.0, 0.0)[0] >= least
        return program.polygon(point.wrench, point.torques, _FASTEST_PATH**2) is not None

    who = "no torques within the motors' limits"
    if torques is not None:
        given = motor_limits(problem, torques)[0].tolist()
        listed = ", ".join(f"{name} {value:g}" for name, value in zip(names, given, strict=True))
        who = f"the given torques ({listed}) do not"
    margin_words = f" with a margin of {margin:g} N" if margin else ""
    if torques is not None and is_held(free):
        advice = "other torques within the motors' limits do: leave torques out, or give others"
    elif is_held((np.full(len(names), -np.inf), np.full(len(names), np.inf))):
        ranges = zip(names, *free, strict=True)
        listed = ", ".join(f"{name} [{low:g}, {high:g}]" for name, low, high in ranges)
        advice = f"stronger motors would: raise effort_limits ({listed}), or reduce the load"
    else:
        less = ", or ask for less margin" if margin else ""
        advice = f"no motors would with this friction and max_normal_force: change the grip{less}"
    return f"{who} hold the object{margin_words} {where}; {advice}"


def _timing_fault(
    names: tuple[str, ...], torque_limits: FloatArray, along: Sequence[_PathPoint]
) -> str:
    """Return in words why no timing keeps all limits, and which joint needs more torque."""
    needed = np.abs([point.joints[:, 0] for point in along])
    beyond = needed / torque_limits
    k, joint = np.unravel_index(np.argmax(beyond), beyond.shape)
    why = "no timing from rest to rest keeps all limits"
    if beyond[k, joint] <= 1.0:
        return f"{why}; raise the limits of torques and accelerations, or use another path"
    return (
        f"{why}: at point {k}, even at rest, joint {names[joint]!r} needs "
        f"{needed[k, joint]:.4g} N m (N), but torque_limits allows {torque_limits[joint]:g}; raise "
        "it, or reduce the load"
    )


def _reached_limit(ends: Sequence[_PathPoint], u: float, squared: FloatArray) -> TimingLimit:
    """Return a limit that is reached at either end of an interval, that of a joint first."""
    reached = set[TimingLimit]()
    for point, x in zip(ends, squared, strict=True):
        sizes = np.abs(point.rows) @ np.abs([u, x]) + np.abs(point.sides)
        slack = point.sides - point.rows @ [u, x]
        reached |= {point.kinds[k] for k in np.flatnonzero(slack <= _NEAR_LIMIT * sizes)}
    return next((limit for limit in TimingLimit if limit in reached), TimingLimit.NOTHING)


def _path_points(
    at: AttachedConfigurations,
    program: ContactProgram,
    path: tuple[FloatArray, FloatArray, FloatArray],
    limits: _JointLimits,
) -> list[_PathPoint]:
    """Return the points of a path with loads and limits.

    Args:
        at: The states of the scene.
        program: The program of the contact forces.
        path: (N, a) positions and their first and second derivatives along the path.
        limits: The limits of joints.
    """
    scene, hand, joint = at.scene, at.hand, at.joint
    places = _joint_positions(at, path[0], "path", "the spline through it exceeds a limit: ")
    T, J = (np.array(part) for part in zip(*map(hand.tree.kinematics, places), strict=True))
    kinematics = Kinematics(T[:, None], J[:, None])
    T_world_object = T[:, joint] @ at.T_joint_object
    S, _ = at.coupling()
    slopes, bends = (part @ S.T for part in path[1:])
    rates, changes = np.stack([0.0 * slopes, slopes], 1), np.stack([slopes, bends], 1)
    by_ux = motions_at(hand, kinematics, STILL, rates, changes)
    wrenches, own = np.empty((len(T), 3, 6)), np.zeros((len(T), 3, len(S)))
    wrenches[:, 0] = object_wrench(scene, STILL, T_world_object)
    moving = object_wrench(scene, by_ux.motion_of_joint(joint), T_world_object[:, None])
    wrenches[:, 1:] = moving - wrenches[:, :1]
    if scene.count_own_weight:
        own[:, 0] = [hand.tree.gravity_torques(place, scene.gravity) for place in places]
        own[:, 1:] = by_ux.joint_torques(hand)
    own = at.torques_with_load(kinematics, wrenches, own)
    of_path = np.stack([0.0 * path[1], *path[1:]], 1)
    parts = at.wrenches_in_link_axes(kinematics, wrenches), own @ at.motor_map, own @ S, of_path
    turned = (np.swapaxes(part, 1, 2) for part in parts)
    return [_path_point(program, limits, *point) for point in zip(*turned, strict=True)]


def _path_point(
    program: ContactProgram,
    limits: _JointLimits,
    wrench: FloatArray,
    motors: FloatArray,
    joints: FloatArray,
    of_path: FloatArray,
) -> _PathPoint:
    """Return a point of a path: see `_path_points`.

    Args:
        program: The program of the contact forces.
        limits: The limits of joints.
        wrench: See `_PathPoint`.
        motors: Its `torques`, see there.
        joints: See there.
        of_path: (a, 3) coefficients of (1, u, x) in the joints' accelerations.
    """
    with np.errstate(divide="ignore"):
        fastest = limits[TimingLimit.VELOCITY] / np.abs(of_path[:, 1])
    most = float(np.min(fastest, initial=_FASTEST_PATH)) ** 2
    polygon = program.polygon(wrench, motors, most)
    if polygon is None:
        return _PathPoint(wrench, motors, joints, np.empty((0, 2)), np.empty(0), ())
    rows, sides = [polygon[0], np.array([[0.0, 1.0]])], [polygon[1], np.array([most])]
    kinds = [TimingLimit.CONTACTS] * len(polygon[0]) + [TimingLimit.VELOCITY]
    for kind, parts in ((TimingLimit.TORQUE, joints), (TimingLimit.ACCELERATION, of_path)):
        limited = np.isfinite(limits[kind])
        both_signs = np.vstack([parts[limited], -parts[limited]])
        rows.append(both_signs[:, 1:])
        sides.append(np.tile(limits[kind][limited], 2) - both_signs[:, 0])
        kinds += [kind] * len(both_signs)
    return _PathPoint(wrench, motors, joints, np.vstack(rows), np.concatenate(sides), tuple(kinds))


def _toppra() -> Any:
    """Return TOPP-RA.

    Raises:
        GrasplessPinError: If it is not installed.
    """
    with optional_import("timings need TOPP-RA", "planning"), warnings.catch_warnings():
        # Its docstrings have backslashes that Python warns of where it is first compiled.
        warnings.simplefilter("ignore")
        import toppra
        import toppra.algorithm
        import toppra.constraint.linear_constraint
    return toppra


def _fastest_speeds(
    toppra: Any, path: Any, along: Sequence[_PathPoint], where: FloatArray
) -> FloatArray | None:
    """Return the (N,) largest speeds along a path, by TOPP-RA; None: there is no timing."""
    most = max(len(point.rows) for point in along)
    rows, sides = np.zeros((len(along), most, 2)), np.ones((len(along), most))
    for k, point in enumerate(along):
        sizes = np.maximum(np.linalg.norm(point.rows, axis=1), 1e-300)
        rows[k, : len(point.rows)] = point.rows / sizes[:, None]
        sides[k, : len(point.rows)] = point.sides / sizes

    class Rows(toppra.constraint.LinearConstraint):
        """The rows of contacts, velocities and torques."""

        def compute_constraint_params(self, *_: Any) -> tuple[Any, ...]:
            unit = np.ones((len(where), 1)) * np.array([[1.0, 0.0]])
            zeros = np.zeros_like(unit)
            # Rows hold at both ends of an interval, with its one acceleration.
            of_intervals = toppra.constraint.linear_constraint.canlinear_colloc_to_interpolate
            return of_intervals(unit, unit[:, ::-1].copy(), zeros, rows, sides, None, None, where)

    limits = Rows()
    limits.discretization_type = toppra.constraint.DiscretizationType.Interpolation
    search = toppra.algorithm.TOPPRA([limits], path, gridpoints=where, solver_wrapper="seidel")
    search.compute_parameterization(0.0, 0.0)
    speeds = search.problem_data.sd_vec
    if speeds is None or not np.isfinite(speeds).all() or not (speeds[1:-1] > 0.0).all():
        return None
    return np.array(speeds)


def _checked_waypoints(at: AttachedConfigurations, path: Any) -> FloatArray:
    """Return (K, a) positions of a path, checked: two or more, neighbours are different."""
    points = np.array([at.array(q) for q in path], dtype=float)
    _joint_positions(at, points, "path[{}]")
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1) if len(points) > 1 else np.zeros(0)
    if not len(steps) or not steps.all():
        given = "two equal ones in succession" if len(steps) else str(len(points))
        raise ArgumentError("path", f"needs at least two different configurations, found {given}")
    return points


def _joint_positions(
    at: AttachedConfigurations, points: FloatArray, argument: str, what: str = ""
) -> list[FloatArray]:
    """Return positions of all joints at points (K, a); errors name the argument."""
    places = list[FloatArray]()
    for k, q in enumerate(points):
        try:
            places.append(at.hand_at(q).positions)
        except ArgumentError as error:
            raise ArgumentError(argument.format(k), f"{what}{error}") from error
    return places


def _joint_limits(
    argument: str, given: Any, names: tuple[str, ...], others: ArrayLike = np.inf
) -> FloatArray:
    """Return (a,) positive limits; those that are not given are ``others``."""
    if given is not None and not isinstance(given, Mapping):
        return np.full(len(names), _positive_number(argument, given))
    limits = np.broadcast_to(others, len(names)).copy()
    for name, value in (given or {}).items():
        if name not in names:
            raise ArgumentError(argument, f"unknown joint {name!r}; {names_in_words(name, names)}")
        limits[names.index(name)] = _positive_number(f"{argument}[{name!r}]", value)
    return limits


def _positive_number(argument: str, value: Any) -> float:
    number = real_number(argument, value, 0.0)
    if number == 0.0:
        raise ArgumentError(argument, "is 0; it must be positive")
    return number
