"""States of a scene as planners give them: configurations by joint name or as plain arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.geometry.hand.model import Hand
from graspless_pin.planning.pins import Pin, PinEntry, pinned_points, pins_of
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, unknown_name
from graspless_pin.records import changed
from graspless_pin.scene import Scene
from graspless_pin.scene.motion_and_contacts import Motion

Configuration = Mapping[str, float] | ArrayLike


class Configurations:
    """The states that a scene can be put into.

    Attributes:
        scene: The scene; what a state does not say is as it is there.
        joint_names: The a joints that do not follow others, in the hand's order.
        joint_units: ``rad`` or ``m`` of each.
        pins: Contacts whatever the gap, those of the hand first; None: contacts are found.
        joint_limits: (lower, upper), each (a,), rad or m; infinite where there is no limit, and
            narrowed by the limits of the joints that follow.
    """

    def __init__(self, scene: Scene, pins: Sequence[PinEntry] | None = None) -> None:
        """Take the scene, and what is pinned in it: see `Evaluator`."""
        self.pins = None if pins is None else pins_of(scene, pins)
        self.scene = scene if self.pins is None else _pinned(scene, self.pins)
        self._hand = hand = scene.hand
        self.joint_names: tuple[str, ...] = ()
        self.joint_units: tuple[str, ...] = ()
        self.joint_limits: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros(0))
        if hand is not None:
            leaders = list(hand.tree.coupling.leaders)
            self.joint_names = tuple(hand.joint_names[leader] for leader in leaders)
            kinds = [hand.tree.joint_kinds[leader] for leader in leaders]
            self.joint_units = tuple("m" if kind == "prismatic" else "rad" for kind in kinds)
            self.joint_limits = hand.tree.ranges

    def hand_at(self, q: Configuration) -> Hand | None:
        """Return the hand at a configuration; None if there is no hand.

        Args:
            q: Positions by joint name, or (a,) positions of `joint_names`, rad or m.

        Raises:
            ArgumentError: If a joint is unknown, a number not finite, the shape wrong, or a joint
                outside its limits.
        """
        if isinstance(q, Mapping):
            named = self._named(q)
            return None if self._hand is None else self._hand.with_configuration(named)
        values = self._values(q)
        return None if self._hand is None else self._hand.with_configuration(values)

    def array(self, q: Configuration) -> FloatArray:
        """Return (a,) positions of `joint_names`; those that are not named as the hand has them.

        Args:
            q: See `hand_at`.

        Raises:
            ArgumentError: As for `hand_at`, but joints may be outside their limits.
        """
        if not isinstance(q, Mapping):
            return self._values(q).copy()
        now: Mapping[str, float] = {} if self._hand is None else self._hand.q
        positions = {**now, **self._named(q)}
        return np.array([positions[name] for name in self.joint_names])

    def row(self, q: Configuration | None) -> FloatArray | None:
        """Return (a,) positions of `joint_names`; None where a joint is named that follows others.

        Args:
            q: See `Evaluator.evaluate`.

        Raises:
            ArgumentError: As for `array`.
        """
        named = q if isinstance(q, Mapping) else {}
        if self._hand is None or not named.keys() <= set(self.joint_names):
            return None
        return self.array({} if q is None else q)

    def with_scene(self, scene: Scene) -> Configurations:
        """Return the same states of a scene that differs in mass and friction alone."""
        other = copy(self)
        vars(other).pop("without_limits", None)
        other.scene = scene
        return other

    @cached_property
    def without_limits(self) -> Configurations:
        """The same states, and those in which joints are outside their limits."""
        free = Configurations(unlimited(self.scene))
        free.pins = self.pins
        return free

    motors_carry = False
    """Whether joints under force control carry the object whatever the contact forces are."""

    def axes_at(self, scene: Scene) -> FloatArray | None:  # noqa: ARG002
        """Return (3, 3) axes in which states are solved, as columns; None: the world's."""
        return None

    def shared_problem(self, scene: Scene, problem: QuasistaticProblem) -> QuasistaticProblem:  # noqa: ARG002
        """Return the problem of a state as states with the same contacts share it."""
        return problem

    def overlap(self, scene: Scene) -> str:  # noqa: ARG002
        """Return what the object is in that a scene's contacts do not tell; empty: in nothing."""
        return ""

    def answered_at(
        self,
        q: Configuration | None,
        T_world_object: ArrayLike | None,
        twist: ArrayLike | Motion | None,
    ) -> Scene:
        """Return the scene in one state as it is solved."""
        return self.scene_at(q, T_world_object, twist)

    def scene_at(
        self,
        q: Configuration | None,
        T_world_object: ArrayLike | None,
        twist: ArrayLike | Motion | None,
    ) -> Scene:
        """Return the scene in one state: see `Evaluator.scene_at`."""
        changes: dict[str, Any] = {}
        if q is not None:
            changes["hand"] = self.hand_at(q)
        if T_world_object is not None:
            changes["object"] = self.scene.object.with_pose(T_world_object)
        if twist is not None:
            changes["motion"] = (
                twist if isinstance(twist, Motion) else Motion(finite_array("twist", twist, (6,)))
            )
        scene = self.scene.with_changes(**changes)
        return scene if self.pins is None else _pinned(scene, self.pins)

    def _named(self, q: Mapping[str, float]) -> dict[str, float]:
        known = () if self._hand is None else self._hand.joint_names
        for name in q:
            if name not in known:
                raise unknown_name("q", "joint", name, known)
        values = finite_array("q", list(q.values()), (len(q),)).tolist()
        return dict(zip(q, values, strict=True))

    def _values(self, q: ArrayLike) -> FloatArray:
        shape = (len(self.joint_names),)
        if (
            isinstance(q, np.ndarray)
            and q.dtype == np.float64
            and q.shape == shape
            and math.isfinite(np.add.reduce(q))  # a finite sum has finite terms
        ):
            return q
        return finite_array("q", q, shape)


def _pinned(scene: Scene, pins: Sequence[Pin]) -> Scene:
    """Return a scene with its contacts where the pins are."""
    points = pinned_points(scene, pins)
    return scene.with_changes(given_contacts=[one.contact for one in points])


def unlimited(scene: Scene) -> Scene:
    """Return a scene whose joints may go anywhere."""
    hand = scene.hand
    if hand is None:
        return scene
    most = np.full(len(hand.joint_names), np.finfo(float).max)
    tree = changed(hand.tree, tolerated=(-most, most))
    return scene.with_changes(hand=changed(hand, tree=tree))
