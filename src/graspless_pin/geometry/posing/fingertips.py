"""Inverse kinematics that puts fingertips on given points of an object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.records import ManipulatedObject
from graspless_pin.geometry.contact.convex_sets import Revolved
from graspless_pin.geometry.contact.distances import LinkDistances, bounded_set
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import LinkGeometry
from graspless_pin.geometry.posing.finger_joints import (
    chosen_fingers,
    driving_columns,
    groups_of_fingers,
    joint_ranges,
)
from graspless_pin.geometry.posing.surface_points import checked_goal

Array = NDArray[np.float64]

_UNLIMITED = np.pi  # rad or m to each side of where it stands that a joint without limits is tried
_INSIDE = 1e-6  # share of a joint's range that the solver keeps off its ends at the start


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
    """

    finger: str
    link: str
    position: Array
    residual: float
    overlapping: tuple[str, ...]
    overlap: float


@dataclass(frozen=True, eq=False)
class FingertipPlacement:
    """A hand whose fingertips have been put on points of an object.

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
    Where a finger has joints to spare, the solution near the hand's configuration is taken. Each
    finger is solved by bounded nonlinear least squares from that configuration and, as long as it
    misses its point or is in the object, from mid-range and from repeatable random ones; the point
    counts first.

    Args:
        hand: The hand.
        target: The object.
        goals: By finger, the (3,) point on the object's surface and the (3,) normal there into the
            object, world, m; the normal of any length.
        tolerance: Residual and overlap that pass, m.
        starts: How many configurations to start from, at least 1.

    Returns:
        The hand with the fingers at their best, and by how much each missed: an unreachable point
        is not an error.

    Raises:
        ArgumentError: If a finger is unknown or has no collision shape or joint, a point is more
            than `surface_points.SURFACE_TOLERANCE` off the surface, a normal points out of the
            object, or a number is out of range.
    """
    if not goals:
        raise ArgumentError("goals", "needs at least one finger: {finger: (point, normal)}")
    names = chosen_fingers(hand, tuple(goals))
    if not (np.isfinite(tolerance) and tolerance > 0.0):
        raise ArgumentError("tolerance", f"needs a positive length in metres, got {tolerance!r}")
    if starts < 1:
        raise ArgumentError("starts", f"needs at least 1, got {starts!r}")
    tips = {
        name: _Tip(hand, target, name, *checked_goal(target, name, goals[name])) for name in names
    }
    independent = hand.positions[list(hand.tree.coupling.leaders)].copy()
    for group in groups_of_fingers(hand, names):
        members = [tips[name] for name in group]
        independent = _solve(hand, members, independent, tolerance=tolerance, starts=starts)
    leaders = hand.tree.coupling.leaders
    moved = hand.with_configuration(
        {
            hand.joint_names[leader]: float(value)
            for leader, value in zip(leaders, independent, strict=True)
            if value != hand.positions[leader]
        }
    )
    placed = tuple(tips[name].report(moved.positions, tolerance) for name in names)
    return FingertipPlacement(moved, placed, tolerance)


class _Tip:
    """The tip of one finger and where it should be."""

    def __init__(
        self, hand: Hand, target: ManipulatedObject, finger: str, point: Array, normal: Array
    ) -> None:
        spec = hand.fingers[finger]
        shaped = {item.link for item in hand.tree.geometries}
        ends = (*spec.links, *(() if spec.tip is None else (spec.tip,)))
        ends = [link for link in ends if link in shaped]
        if not ends:
            raise ArgumentError(
                f"goals[{finger!r}]", "this finger has no collision shape to touch with"
            )
        if not driving_columns(hand, finger):
            raise ArgumentError(f"goals[{finger!r}]", "this finger has no joint to move")
        self.finger = finger
        self.link = ends[-1]
        self.point = point
        self.normal = normal
        self._tree = hand.tree
        self._data: Any = hand.tree.model.createData()
        self._shapes = [item for item in hand.tree.geometries if item.link == self.link]
        self._distances = LinkDistances(hand, {*spec.links, self.link}, target.collision_body())

    def touch(self, positions: Array) -> tuple[Array, Array]:
        """Return the tip's point farthest along the normal and its Jacobian.

        Args:
            positions: (n,) of all joints.

        Returns:
            (3,) the point, world, and (3, a) its velocity per rate of the independent joints.
        """
        tree = self._tree
        J = pin.computeJointJacobians(tree.model, self._data, tree.configuration(positions))
        joint = self._shapes[0].joint
        T_world_joint = np.array(self._data.oMi[joint].homogeneous)
        touch, fixed = max(
            (_farthest(item, T_world_joint, self.normal) for item in self._shapes),
            key=lambda found: float(found[0] @ self.normal),
        )
        by_joint = tree.point_jacobians(J, [joint], fixed[None])[0]
        return touch, by_joint @ tree.coupling.S

    def overlaps(self, positions: Array) -> dict[str, float]:
        """Return how deep each link of the finger is in the object, without those outside."""
        deepest: dict[str, float] = {}
        distances = self._distances.at(positions)
        for link, distance in zip(self._distances.links, distances.tolist(), strict=True):
            if distance < 0.0:
                deepest[link] = max(deepest.get(link, 0.0), -distance)
        return deepest

    def report(self, positions: Array, tolerance: float) -> PlacedFingertip:
        """Return how well the tip got there."""
        position, _ = self.touch(positions)
        position.setflags(write=False)
        overlaps = self.overlaps(positions)
        return PlacedFingertip(
            finger=self.finger,
            link=self.link,
            position=position,
            residual=float(np.linalg.norm(position - self.point)),
            overlapping=tuple(link for link, depth in overlaps.items() if depth > tolerance),
            overlap=max(overlaps.values(), default=0.0),
        )


def _solve(
    hand: Hand, tips: Sequence[_Tip], independent: Array, *, tolerance: float, starts: int
) -> Array:
    """Return the best positions (a,) of the independent joints for fingers that share joints."""
    coupling = hand.tree.coupling
    lower, upper = joint_ranges(hand.tree)
    driving = {column for tip in tips for column in driving_columns(hand, tip.finger)}
    columns = [column for column in sorted(driving) if lower[column] < upper[column]]
    if not columns:
        return independent
    now = independent[columns]
    lower = np.where(np.isinf(lower[columns]), now - _UNLIMITED, lower[columns])
    upper = np.where(np.isinf(upper[columns]), now + _UNLIMITED, upper[columns])

    def completed(values: Array) -> Array:
        full = independent.copy()
        full[columns] = values
        return full

    def positions(values: Array) -> Array:
        return coupling.S @ completed(values) + coupling.offset

    def misses(values: Array) -> Array:
        return np.concatenate([tip.touch(positions(values))[0] - tip.point for tip in tips])

    def jacobian(values: Array) -> Array:
        return np.vstack([tip.touch(positions(values))[1][:, columns] for tip in tips])

    random = np.random.default_rng(0)
    inside = _INSIDE * (upper - lower)
    best, least_fault = now, (np.inf, np.inf)
    for attempt in range(starts):
        start = random.uniform(lower, upper)
        if attempt == 0:
            start = now
        elif attempt == 1:
            start = 0.5 * (lower + upper)
        found = least_squares(
            misses,
            np.clip(start, lower + inside, upper - inside),
            jac=jacobian,  # pyright: ignore[reportArgumentType] - a function will do
            bounds=(lower, upper),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
            max_nfev=100,
        ).x
        overlaps = [depth for tip in tips for depth in tip.overlaps(positions(found)).values()]
        # The point comes first; among those that reach it, the one least in the object.
        miss = float(np.linalg.norm(misses(found).reshape(-1, 3), axis=1).max())
        overlap = max(overlaps, default=0.0)
        fault = tuple(0.0 if length <= tolerance else length for length in (miss, overlap))
        if fault < least_fault:
            best, least_fault = found, fault
        if not any(fault):
            break
    return completed(best)


def _farthest(item: LinkGeometry, T_world_joint: Array, normal: Array) -> tuple[Array, Array]:
    """Return a shape's point farthest along a normal, and the body-fixed point it moves with.

    A sphere's farthest point slides over it as it turns and so moves like its centre.
    """
    solid = bounded_set(item)
    T = T_world_joint @ item.T_joint_geometry
    touch = T[:3, :3] @ solid.feature(T[:3, :3].T @ normal).mean(axis=0) + T[:3, 3]
    swept = solid.swept_radius if isinstance(solid, Revolved) else 0.0
    return touch, touch - swept * normal
