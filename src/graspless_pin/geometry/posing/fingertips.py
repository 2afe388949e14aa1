"""Inverse kinematics that puts fingertips on given points of an object.

Postures of fingers whose tips reach given points, away from the joints' limits if possible.
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
    hand_at,
    joints_at_limit,
    least_misses,
    searched_ranges,
    tip_shapes,
)
from graspless_pin.problem.checks import FloatArray, read_only, real_number, whole_number


class Tip:
    """The tip of one finger and where it should be.

    Attributes:
        finger: The finger's name.
        link: The link at its tip.
        point: (3,) where it should touch the object, world, m.
        normal: (3,) unit normal there into the object, world axes.
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

    def touch(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the tip's point farthest along the normal and its Jacobian.

        Args:
            positions: (n,) of all joints.

        Returns:
            (3,) the point, world, and (3, a) its velocity per rate of the independent joints.
        """
        tree = self._tree
        kinematics, joint = tree.kinematics(positions), self._shapes[0].joint
        T_world_joint = kinematics.T_world_joint[joint]
        touch, fixed = max(
            (_farthest(item, T_world_joint, self.normal) for item in self._shapes),
            key=lambda found: float(found[0] @ self.normal),
        )
        by_joint = tree.point_jacobians(kinematics.J, [joint], fixed[None])[0]
        return touch, by_joint @ tree.coupling.S

    def overlaps(self, positions: FloatArray) -> dict[str, float]:
        """Return how deep each link of the finger is in the object, without those outside."""
        deepest: dict[str, float] = {}
        distances = self._distances.at(positions)
        for link, distance in zip(self._distances.links, distances.tolist(), strict=True):
            if distance < 0.0:
                deepest[link] = max(deepest.get(link, 0.0), -distance)
        return deepest


def _farthest(
    item: LinkGeometry, T_world_joint: FloatArray, normal: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a shape's point farthest along a normal, and the body-fixed point it moves with.

    A sphere's farthest point slides over it as it turns and so moves like its centre.
    """
    solid = bounded_set(item)
    T = T_world_joint @ item.T_joint_geometry
    touch = T[:3, :3] @ solid.feature(T[:3, :3].T @ normal).mean(axis=0) + T[:3, 3]
    return touch, touch - solid.swept_radius * normal


_UNLIMITED = np.pi  # rad or m to each side of where it stands that a joint without limits is tried
_MOST_EVALUATIONS = 100
_EASY = 0.8  # middle share of a joint's range in which nothing pulls it
_PULL = 1e-3  # m of miss that weigh as much as half a joint's range outside of that share


def reach(
    hand: Hand, tips: Sequence[Tip], independent: FloatArray, *, tolerance: float, starts: int
) -> FloatArray:
    """Find the best posture of fingers that share joints.

    The points come first; among postures that reach them, those whose links are not in the object,
    and among these, those with no joint at a limit. What freedom the points leave takes joints out
    of the outermost tenths of their ranges.

    Args:
        hand: The hand.
        tips: The fingers' tips.
        independent: (a,) positions of all independent joints to start from.
        tolerance: Miss and overlap that pass, m.
        starts: How many postures to start from.

    Returns:
        (a,) positions of the independent joints; those of other fingers as they were.
    """
    search = _Search(hand, tips, independent)
    random = np.random.default_rng(0)
    lower, upper = search.lower, search.upper
    best, least_fault = search.now, (np.inf, np.inf, np.inf)
    for attempt in range(starts if len(best) else 0):
        start = random.uniform(lower, upper)
        if attempt == 0:
            start = search.now
        elif attempt == 1:
            start = 0.5 * (lower + upper)
        found = search.nearest(start)
        fault = search.fault(found, tolerance)
        if fault[0] == 0.0 and search.crowding(found) > _EASY:
            eased = search.eased(found)
            fault_then = search.fault(eased, tolerance)
            if fault_then <= fault and search.crowding(eased) < search.crowding(found):
                found, fault = eased, fault_then
        if fault < least_fault:
            best, least_fault = found, fault
        if not any(fault):
            break
    return search.completed(best)


class _Search:
    """The joints of one group of fingers as a least-squares problem; vectors are theirs only."""

    def __init__(self, hand: Hand, tips: Sequence[Tip], independent: FloatArray) -> None:
        lower, upper = searched_ranges(hand.tree, independent, _UNLIMITED)
        driving = {column for tip in tips for column in driving_columns(hand, tip.finger)}
        self._columns = [column for column in sorted(driving) if lower[column] < upper[column]]
        self._tips = tips
        self._coupling = hand.tree.coupling
        self._independent = independent
        self.now = independent[self._columns]
        self.lower, self.upper = lower[self._columns], upper[self._columns]
        self._middle = 0.5 * (self.lower + self.upper)
        self._half = 0.5 * (self.upper - self.lower)

    def completed(self, values: FloatArray) -> FloatArray:
        """Return the positions (a,) of all independent joints."""
        full = self._independent.copy()
        full[self._columns] = values
        return full

    def nearest(self, start: FloatArray) -> FloatArray:
        """Return the posture with the least misses that is found from a start."""
        bounds = self.lower, self.upper
        return least_misses(self._misses, self._jacobian, start, bounds, _MOST_EVALUATIONS)

    def eased(self, values: FloatArray) -> FloatArray:
        """Return a posture with about the same misses and joints farther from their limits."""

        def residuals(values: FloatArray) -> FloatArray:
            share = self._share(values)
            outside = share - np.clip(share, -_EASY, _EASY)
            return np.concatenate([self._misses(values), _PULL * outside])

        def jacobian(values: FloatArray) -> FloatArray:
            outside = np.abs(self._share(values)) > _EASY
            return np.vstack([self._jacobian(values), np.diag(_PULL * outside / self._half)])

        inward = self._middle + np.clip(self._share(values), -_EASY, _EASY) * self._half
        bounds = self.lower, self.upper
        return self.nearest(least_misses(residuals, jacobian, inward, bounds, _MOST_EVALUATIONS))

    def crowding(self, values: FloatArray) -> float:
        """Return how near to its limits any joint is: 0 half way between them, 1 at one of them."""
        return float(np.abs(self._share(values)).max())

    def fault(self, values: FloatArray, tolerance: float) -> tuple[float, float, float]:
        """Return largest miss, deepest overlap and crowding, each zero where it passes."""
        positions = self._positions(values)
        misses = self._misses(values).reshape(-1, 3)
        miss = float(np.linalg.norm(misses, axis=1).max())
        depths = [depth for tip in self._tips for depth in tip.overlaps(positions).values()]
        overlap, crowding = max(depths, default=0.0), self.crowding(values)
        return (
            miss if miss > tolerance else 0.0,
            overlap if overlap > tolerance else 0.0,
            crowding if crowding > 1.0 - 2.0 * AT_LIMIT else 0.0,
        )

    def _share(self, values: FloatArray) -> FloatArray:
        """Positions as shares of the way from the middle of the range to its ends, -1 to 1."""
        return (values - self._middle) / self._half

    def _misses(self, values: FloatArray) -> FloatArray:
        positions = self._positions(values)
        return np.concatenate([tip.touch(positions)[0] - tip.point for tip in self._tips])

    def _jacobian(self, values: FloatArray) -> FloatArray:
        positions = self._positions(values)
        return np.vstack([tip.touch(positions)[1][:, self._columns] for tip in self._tips])

    def _positions(self, values: FloatArray) -> FloatArray:
        return self._coupling.all_positions(self.completed(values))


SURFACE_TOLERANCE = 1e-3
"""How far off the object's surface a given point may lie, m."""

_OUTSIDE = 2.0 * SURFACE_TOLERANCE  # how far a point is moved to see whether it gets out


@dataclass(frozen=True, eq=False)
class PlacedFingertip:
    """How well a fingertip got to its point.

    Attributes:
        finger: Its name.
        link: The link at its tip.
        position: (3,) read-only point of the tip that lies farthest along the normal, world, m:
            what should be at the given point.
        residual: Distance from the given point, m.
        overlapping: Links of the finger that are in the object by more than the tolerance, in
            model order.
        overlap: How deep the deepest of its links is in the object, zero without any, m.
        at_limit: Joints that move the finger and stand at a limit of theirs.
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
    """A hand whose fingertips have been put on points of an object.

    See the example of `place_fingertips`.

    Attributes:
        hand: The hand at its new configuration.
        fingertips: One per finger, in the order they were given.
        tolerance: Residual or overlap up to which a fingertip counts as placed, m.
    """

    hand: Hand
    fingertips: tuple[PlacedFingertip, ...]
    tolerance: float

    @property
    def reached(self) -> bool:
        """Whether every fingertip is at its point and no finger is in the object."""
        return all(max(tip.residual, tip.overlap) <= self.tolerance for tip in self.fingertips)

    def __str__(self) -> str:
        """One line a finger."""
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

    Of each finger the tip's point that lies farthest along the normal goes to the given point, so
    that a rounded tip touches there from outside. All independent joints of the named fingers may
    move, within their limits, whatever their control mode; the other fingers and the base stay.
    Where a finger has joints to spare, the solution near the hand's configuration is taken, but no
    joint stays in the outermost tenth of its range without need. Each finger is solved by bounded
    nonlinear least squares from that configuration and, as long as it misses its point, is in the
    object or has a joint at a limit, from mid-range and from repeatable random ones; these three
    count in this order.

    Args:
        hand: The hand.
        target: The object.
        goals: By finger, the (3,) point on the object's surface and the (3,) normal there into the
            object, world, m; the normal of any length.
        tolerance: Residual and overlap that pass, m.
        starts: How many configurations to start from, at least 1.

    Returns:
        The hand with the fingers at their best, by how much each missed and which joints ended at
        a limit: an unreachable point is not an error.

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
        name: Tip(hand, target, name, *_checked_goal(target, name, goals[name])) for name in names
    }
    independent = hand.tree.coupling.independent(hand.positions)
    for group in groups_of_fingers(hand, names):
        members = [tips[name] for name in group]
        independent = reach(hand, members, independent, tolerance=tolerance, starts=starts)
    moved = hand_at(hand, independent)
    placed = tuple(_report(tips[name], moved, tolerance) for name in names)
    return FingertipPlacement(moved, placed, tolerance)


def _report(tip: Tip, hand: Hand, tolerance: float) -> PlacedFingertip:
    """Measure how well a tip got there."""
    position, _ = tip.touch(hand.positions)
    overlaps = tip.overlaps(hand.positions)
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
    """Check where a fingertip is to go.

    Args:
        target: The object.
        finger: Whose goal it is, for the message.
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
    for what, vector in (("point", point), ("normal", normal)):
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise ArgumentError(
                argument, f"the {what} needs three finite numbers, got {vector.tolist()}"
            )
    if not np.any(normal):
        raise ArgumentError(argument, "the normal must not be zero")
    normal /= np.linalg.norm(normal)
    off, outward = _off_surface(target, point)
    if abs(off) > SURFACE_TOLERANCE:
        side = "outside" if off > 0.0 else "inside"
        nearest = point - off * outward
        message = f"the point {point.tolist()} is {abs(off) * 1e3:.1f} mm {side} the surface of "
        message += f"object '{target.name}'"
        if not _is_within(target, nearest, outward):
            message += f"; the nearest point of it is {nearest.round(6).tolist()}"
        raise ArgumentError(argument, message)
    ahead, _ = _off_surface(target, point + SURFACE_TOLERANCE * normal)
    if ahead > off + 0.5 * SURFACE_TOLERANCE:
        raise ArgumentError(
            argument,
            f"the normal {normal.round(6).tolist()} points out of object '{target.name}'; normals "
            "point into it",
        )
    if _is_within(target, point, -normal):
        raise ArgumentError(
            argument,
            f"the point {point.tolist()} lies inside object '{target.name}' where two of its "
            "convex pieces meet: no finger gets there along the normal",
        )
    return point, normal


def _is_within(target: ManipulatedObject, point: FloatArray, outward: FloatArray) -> bool:
    """Return whether the object goes on outwards of a point on the surface of one of its pieces."""
    _, aside, across = np.linalg.svd(outward[None])[2]
    rays = [outward, *(outward + turn for turn in (aside, -aside, across, -across))]
    reached = [point + _OUTSIDE * ray / np.linalg.norm(ray) for ray in rays]
    return max(_off_surface(target, there)[0] for there in reached) < 0.25 * _OUTSIDE


def _off_surface(target: ManipulatedObject, point: FloatArray) -> tuple[float, FloatArray]:
    """Return a point's signed distance from the object's surface and the direction outwards.

    Inside an object of several convex pieces it is the distance from the surface of the piece in
    which the point lies deepest.
    """
    apart = nearest_separation(target.collision_bodies(), [point_body(point)])
    return apart.distance + POINT_RADIUS, apart.normal
