"""Inverse kinematics that places fingertips on given points of an object.

Postures of fingers whose tips reach given points, away from the joint limits if possible.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.contact.distances import (
    POINT_RADIUS,
    LinkDistances,
    bounded_set,
    nearest_separation,
    point_body,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import LinkGeometry
from graspless_pin.geometry.posing.finger_joints import (
    AT_LIMIT,
    chosen_fingers,
    driving_columns,
    groups_of_fingers,
    hand_at_positions,
    joints_at_limit,
    least_squares_positions,
    search_ranges,
    tip_shapes,
)
from graspless_pin.problem.checks import FloatArray, read_only, real_number, whole_number


class FingertipGoal:
    """The tip of one finger and its goal.

    Attributes:
        finger: Name of the finger.
        link: The link at its tip.
        point: (3,) point of the object that it is to touch, world, m.
        normal: (3,) unit normal at the point, into the object, world axes.
    """

    def __init__(
        self,
        hand: Hand,
        target: ManipulatedObject,
        finger: str,
        point: FloatArray,
        normal: FloatArray,
    ) -> None:
        """Prepare one finger.

        Raises:
            ArgumentError: If the finger has no collision shape or no joint.
        """
        self._shapes = tip_shapes(hand, finger)
        if not self._shapes:
            raise ArgumentError(
                f"goals[{finger!r}]", "this finger has no collision shape to touch with"
            )
        if not driving_columns(hand, finger):
            raise ArgumentError(f"goals[{finger!r}]", "this finger has no joint to move")
        self.finger = finger
        self.link = self._shapes[0].link
        self.point = point
        self.normal = normal
        self._tree = hand.tree
        links = {*hand.fingers[finger].links, self.link}
        self._distances = LinkDistances(hand, links, target.placed_bodies)

    def touch_point(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the tip's point that is farthest along the normal, and its Jacobian.

        Args:
            positions: (n,) of all joints.

        Returns:
            (3,) the point, world, and (3, a) its velocity per rate of the independent joints.
        """
        tree = self._tree
        kinematics, joint = tree.kinematics(positions), self._shapes[0].joint
        T_world_joint = kinematics.T_world_joint[joint]
        point, fixed = max(
            (_farthest_point(item, T_world_joint, self.normal) for item in self._shapes),
            key=lambda candidate: float(candidate[0] @ self.normal),
        )
        by_joint = tree.point_jacobians(kinematics.J, [joint], fixed[None])[0]
        return point, by_joint @ tree.coupling.S

    def link_overlaps(self, positions: FloatArray) -> dict[str, float]:
        """Return the overlap of each link of the finger with the object, if it has any, m."""
        overlaps: dict[str, float] = {}
        distances = self._distances.at(positions)
        for link, distance in zip(self._distances.links, distances.tolist(), strict=True):
            if distance < 0.0:
                overlaps[link] = max(overlaps.get(link, 0.0), -distance)
        return overlaps


def _farthest_point(
    item: LinkGeometry, T_world_joint: FloatArray, normal: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a shape's point farthest along a normal, and the body-fixed point that it moves with.

    The farthest point of a sphere moves over its surface as it rotates, and so moves like its
    centre.
    """
    solid = bounded_set(item)
    T = T_world_joint @ item.T_joint_geometry
    point = T[:3, :3] @ solid.feature(T[:3, :3].T @ normal).mean(axis=0) + T[:3, 3]
    return point, point - solid.swept_radius * normal


_UNLIMITED = np.pi  # rad or m to each side: search range of a joint without limits
_MOST_EVALUATIONS = 100
_FREE_SHARE = 0.8  # middle share of a joint's range that is not penalised
_LIMIT_WEIGHT = 1e-3  # m: tip error that weighs as much as half a joint's range outside that share


def best_posture(
    hand: Hand,
    tips: Sequence[FingertipGoal],
    independent: FloatArray,
    *,
    tolerance: float,
    starts: int,
) -> FloatArray:
    """Find the best posture of fingers that share joints.

    The error of the tips is minimised first; among postures that reach the points, those without
    overlap with the object are preferred, and among these, those with no joint at a limit. The
    remaining freedom moves joints out of the outermost tenths of their ranges.

    Args:
        hand: The hand.
        tips: The fingers' tips.
        independent: (a,) positions of all independent joints to start from.
        tolerance: Largest tip error and overlap that are accepted, m.
        starts: Number of starting postures.

    Returns:
        (a,) positions of the independent joints; those of other fingers are unchanged.
    """
    search = _PostureSearch(hand, tips, independent)
    random = np.random.default_rng(0)
    lower, upper = search.lower, search.upper
    best, least_faults = search.start, (np.inf, np.inf, np.inf)
    for attempt in range(starts if len(best) else 0):
        start = random.uniform(lower, upper)
        if attempt == 0:
            start = search.start
        elif attempt == 1:
            start = 0.5 * (lower + upper)
        posture = search.nearest_posture(start)
        faults = search.faults(posture, tolerance)
        if faults[0] == 0.0 and search.limit_proximity(posture) > _FREE_SHARE:
            relaxed = search.relaxed_posture(posture)
            relaxed_faults = search.faults(relaxed, tolerance)
            if relaxed_faults <= faults and search.limit_proximity(
                relaxed
            ) < search.limit_proximity(posture):
                posture, faults = relaxed, relaxed_faults
        if faults < least_faults:
            best, least_faults = posture, faults
        if not any(faults):
            break
    return search.independent_positions(best)


class _PostureSearch:
    """The least-squares problem of one group of fingers; vectors are of their joints only."""

    def __init__(self, hand: Hand, tips: Sequence[FingertipGoal], independent: FloatArray) -> None:
        lower, upper = search_ranges(hand.tree, independent, _UNLIMITED)
        driving = {column for tip in tips for column in driving_columns(hand, tip.finger)}
        self._columns = [column for column in sorted(driving) if lower[column] < upper[column]]
        self._tips = tips
        self._coupling = hand.tree.coupling
        self._independent = independent
        self.start = independent[self._columns]
        self.lower, self.upper = lower[self._columns], upper[self._columns]
        self._mid_range = 0.5 * (self.lower + self.upper)
        self._half = 0.5 * (self.upper - self.lower)

    def independent_positions(self, values: FloatArray) -> FloatArray:
        """Return the (a,) positions of all independent joints."""
        full = self._independent.copy()
        full[self._columns] = values
        return full

    def nearest_posture(self, start: FloatArray) -> FloatArray:
        """Return the posture with the least tip errors found from a start."""
        bounds = self.lower, self.upper
        return least_squares_positions(
            self._tip_errors, self._jacobian, start, bounds, _MOST_EVALUATIONS
        )

    def relaxed_posture(self, values: FloatArray) -> FloatArray:
        """Return a posture with about the same tip errors and joints farther from their limits."""

        def residuals(values: FloatArray) -> FloatArray:
            share = self._range_shares(values)
            outside = share - np.clip(share, -_FREE_SHARE, _FREE_SHARE)
            return np.concatenate([self._tip_errors(values), _LIMIT_WEIGHT * outside])

        def jacobian(values: FloatArray) -> FloatArray:
            outside = np.abs(self._range_shares(values)) > _FREE_SHARE
            return np.vstack(
                [self._jacobian(values), np.diag(_LIMIT_WEIGHT * outside / self._half)]
            )

        inward = (
            self._mid_range
            + np.clip(self._range_shares(values), -_FREE_SHARE, _FREE_SHARE) * self._half
        )
        bounds = self.lower, self.upper
        return self.nearest_posture(
            least_squares_positions(residuals, jacobian, inward, bounds, _MOST_EVALUATIONS)
        )

    def limit_proximity(self, values: FloatArray) -> float:
        """Return the largest distance of a joint from mid-range over its half-range, 0 to 1."""
        return float(np.abs(self._range_shares(values)).max())

    def faults(self, values: FloatArray, tolerance: float) -> tuple[float, float, float]:
        """Return largest tip error, overlap and limit proximity, each zero if acceptable."""
        positions = self._joint_positions(values)
        errors = self._tip_errors(values).reshape(-1, 3)
        miss = float(np.linalg.norm(errors, axis=1).max())
        depths = [depth for tip in self._tips for depth in tip.link_overlaps(positions).values()]
        overlap, proximity = max(depths, default=0.0), self.limit_proximity(values)
        return (
            miss if miss > tolerance else 0.0,
            overlap if overlap > tolerance else 0.0,
            proximity if proximity > 1.0 - 2.0 * AT_LIMIT else 0.0,
        )

    def _range_shares(self, values: FloatArray) -> FloatArray:
        """Return the positions relative to mid-range over the half-range, -1 to 1."""
        return (values - self._mid_range) / self._half

    def _tip_errors(self, values: FloatArray) -> FloatArray:
        positions = self._joint_positions(values)
        return np.concatenate([tip.touch_point(positions)[0] - tip.point for tip in self._tips])

    def _jacobian(self, values: FloatArray) -> FloatArray:
        positions = self._joint_positions(values)
        return np.vstack([tip.touch_point(positions)[1][:, self._columns] for tip in self._tips])

    def _joint_positions(self, values: FloatArray) -> FloatArray:
        return self._coupling.all_positions(self.independent_positions(values))


SURFACE_TOLERANCE = 1e-3
"""Largest distance of a given point from the object's surface, m."""

_RAY_LENGTH = 2.0 * SURFACE_TOLERANCE  # m: shift of a point that tests if it leaves


@dataclass(frozen=True, eq=False)
class PlacedFingertip:
    """The placement of one fingertip.

    Attributes:
        finger: Name of the finger.
        link: The link at its tip.
        position: (3,) read-only point of the tip farthest along the normal, world, m: it should
            coincide with the given point.
        residual: Distance from the given point, m.
        overlapping: Links of the finger that overlap the object by more than the tolerance, in
            model order.
        overlap: Largest overlap of its links with the object, zero without any, m.
        at_limit: Joints that move the finger and are at one of their limits.
    """

    finger: str
    link: str
    position: FloatArray
    residual: float
    overlapping: tuple[str, ...]
    overlap: float
    at_limit: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class FingertipPlacement:
    """A hand whose fingertips have been placed on points of an object.

    See the example of `place_fingertips`.

    Attributes:
        hand: The hand at its new configuration.
        fingertips: The placements, one per finger, in the order they were given.
        tolerance: Largest residual or overlap of a fingertip that counts as placed, m.
    """

    hand: Hand
    fingertips: tuple[PlacedFingertip, ...]
    tolerance: float

    @property
    def reached(self) -> bool:
        """Whether every fingertip is at its point and no finger overlaps the object."""
        return all(max(tip.residual, tip.overlap) <= self.tolerance for tip in self.fingertips)

    def __str__(self) -> str:
        """Return one line for each finger."""
        lines = []
        for tip in self.fingertips:
            line = f"{tip.finger}: {tip.link} {tip.residual * 1e3:.3f} mm from its point"
            if tip.overlapping:
                line += f"; {', '.join(tip.overlapping)} up to {tip.overlap * 1e3:.2f} mm inside"
            if tip.at_limit:
                line += f"; at their limit: {', '.join(tip.at_limit)}"
            lines.append(line)
        return "\n".join(lines)


def place_fingertips(
    hand: Hand,
    target: ManipulatedObject,
    goals: Mapping[str, tuple[ArrayLike, ArrayLike]],
    *,
    tolerance: float = 1e-5,
    starts: int = 8,
) -> FingertipPlacement:
    """Move fingers so that their tips touch an object at given points.

    The point of each fingertip that is farthest along the normal moves to the given point, so that
    a rounded tip touches there from outside. All independent joints of the named fingers may move,
    within their limits, whatever their control mode; the other fingers and the base do not move.
    Where a finger is redundant, the solution near the hand's configuration is taken, but no joint
    stays in the outermost tenth of its range without need. Each finger is solved by bounded
    nonlinear least squares from that configuration and, as long as it misses its point, overlaps
    the object or has a joint at a limit, from mid-range and from repeatable random configurations;
    these three faults count in this order.

    Args:
        hand: The hand.
        target: The object.
        goals: By finger, the (3,) point on the object's surface and the (3,) normal there into the
            object, world, m; the normal of any length.
        tolerance: Largest residual and overlap that are accepted, m.
        starts: Number of configurations to start from, at least 1.

    Returns:
        The hand with the best posture of the fingers, each residual, and the joints at a limit: an
        unreachable point is not an error.

    Raises:
        ArgumentError: If a finger is unknown or has no collision shape or joint, a point is more
            than `SURFACE_TOLERANCE` off the surface, a normal points out of the
            object, or a number is out of range.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.geometry import place_fingertips
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> point = scene.contacts.points[0]
        >>> goals = {"finger_1": (point.position, point.normal)}
        >>> sorted(place_fingertips(scene.hand, scene.object, goals).hand.fingers)
        ['finger_1', 'finger_2', 'finger_3']
    """
    if not goals:
        raise ArgumentError("goals", "needs at least one finger: {finger: (point, normal)}")
    names = chosen_fingers(hand, tuple(goals))
    if not real_number("tolerance", tolerance, 0.0):
        raise ArgumentError("tolerance", f"needs a positive length in metres, got {tolerance!r}")
    starts = whole_number("starts", starts, 1)
    tips = {
        name: FingertipGoal(hand, target, name, *_checked_goal(target, name, goals[name]))
        for name in names
    }
    independent = hand.tree.coupling.independent(hand.positions)
    for group in groups_of_fingers(hand, names):
        members = [tips[name] for name in group]
        independent = best_posture(hand, members, independent, tolerance=tolerance, starts=starts)
    placed_hand = hand_at_positions(hand, independent)
    placed = tuple(_placed_fingertip(tips[name], placed_hand, tolerance) for name in names)
    return FingertipPlacement(placed_hand, placed, tolerance)


def _placed_fingertip(tip: FingertipGoal, hand: Hand, tolerance: float) -> PlacedFingertip:
    """Return the placement of one fingertip."""
    position, _ = tip.touch_point(hand.positions)
    overlaps = tip.link_overlaps(hand.positions)
    return PlacedFingertip(
        finger=tip.finger,
        link=tip.link,
        position=read_only(position),
        residual=float(np.linalg.norm(position - tip.point)),
        overlapping=tuple(link for link, depth in overlaps.items() if depth > tolerance),
        overlap=max(overlaps.values(), default=0.0),
        at_limit=joints_at_limit(hand, tip.finger),
    )


def _checked_goal(
    target: ManipulatedObject, finger: str, goal: tuple[ArrayLike, ArrayLike]
) -> tuple[FloatArray, FloatArray]:
    """Check the goal of a fingertip.

    Args:
        target: The object.
        finger: Name of the finger, for the message.
        goal: (3,) point on the object's surface and (3,) normal there into the object, world.

    Returns:
        The point and the unit normal.

    Raises:
        ArgumentError: If one is not three finite numbers, the point is more than
            `SURFACE_TOLERANCE` off the surface, or the normal is zero or points out of the object.
    """
    argument = f"goals[{finger!r}]"
    try:
        point, normal = (np.array(part, dtype=np.float64) for part in goal)
    except (TypeError, ValueError) as error:
        raise ArgumentError(argument, f"needs (point, normal), got {goal!r}") from error
    for part_name, vector in (("point", point), ("normal", normal)):
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise ArgumentError(
                argument, f"the {part_name} needs three finite numbers, got {vector.tolist()}"
            )
    if not np.any(normal):
        raise ArgumentError(argument, "the normal must not be zero")
    normal /= np.linalg.norm(normal)
    height, outward = _surface_distance(target, point)
    if abs(height) > SURFACE_TOLERANCE:
        side = "outside" if height > 0.0 else "inside"
        nearest = point - height * outward
        message = f"the point {point.tolist()} is {abs(height) * 1e3:.1f} mm {side} the surface of "
        message += f"object '{target.name}'"
        if not _continues_outwards(target, nearest, outward):
            message += f"; the nearest point of it is {nearest.round(6).tolist()}"
        raise ArgumentError(argument, message)
    height_ahead, _ = _surface_distance(target, point + SURFACE_TOLERANCE * normal)
    if height_ahead > height + 0.5 * SURFACE_TOLERANCE:
        raise ArgumentError(
            argument,
            f"the normal {normal.round(6).tolist()} points out of object '{target.name}'; normals "
            "point into it",
        )
    if _continues_outwards(target, point, -normal):
        raise ArgumentError(
            argument,
            f"the point {point.tolist()} lies inside object '{target.name}' where two of its "
            "convex pieces meet: no finger gets there along the normal",
        )
    return point, normal


def _continues_outwards(target: ManipulatedObject, point: FloatArray, outward: FloatArray) -> bool:
    """Return whether the object continues outwards of a surface point of one of its pieces."""
    _, aside, across = np.linalg.svd(outward[None])[2]
    rays = [outward, *(outward + turn for turn in (aside, -aside, across, -across))]
    ray_ends = [point + _RAY_LENGTH * ray / np.linalg.norm(ray) for ray in rays]
    return max(_surface_distance(target, ray_end)[0] for ray_end in ray_ends) < 0.25 * _RAY_LENGTH


def _surface_distance(target: ManipulatedObject, point: FloatArray) -> tuple[float, FloatArray]:
    """Return a point's signed distance from the object's surface and the outward direction.

    Inside an object of several convex pieces it is the distance from the surface of the piece in
    which the point is deepest.
    """
    nearest = nearest_separation(target.collision_bodies(), [point_body(point)])
    return nearest.distance + POINT_RADIUS, nearest.normal
