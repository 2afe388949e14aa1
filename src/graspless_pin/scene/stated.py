"""Loads, accelerations, motions and contacts that a scene states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray, choice, finite_array, real_number
from graspless_pin.records import Brief, PickledByFields


class LoadAxes(StrEnum):
    """Axes of a load's force and moment. See the example of `Load`."""

    WORLD = "world"
    """Fixed in the world as the object turns: a long cable, a field."""
    OBJECT = "object"
    """Turning with the object: the reaction of a tool that it carries."""


_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Load(Brief, PickledByFields):
    """A load on the object: a force and moment, a payload, a field.

    Attributes:
        name: Its name in messages and pictures.
        force: (3,) N, at the point ``at``.
        moment: (3,) N m.
        mass: kg of a payload at the point ``at``, which counts in weight and inertia.
        field: (3,) m/s^2, on the mass of the object and of all payloads, in addition to gravity.
        at: (3,) point of the object, in its frame, m; None: its centre of mass.
        axes: Those of force and moment; a field has the world's.

    Raises:
        ArgumentError: Naming load and field, as in ``loads.cable.force``, if a number is not
            finite, a shape wrong or the mass negative.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.scene import Load
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> pulled = scene.with_changes(loads=[Load("cable", force=(0.0, 0.0, 2.0))])  # N
        >>> print(f"{scene.solve().margin:.3f} N, with the cable {pulled.solve().margin:.3f} N")
        1.650 N, with the cable 1.600 N
    """

    name: str
    force: FloatArray
    moment: FloatArray
    mass: float
    field: FloatArray
    at: FloatArray | None
    axes: LoadAxes

    def __init__(
        self,
        name: str,
        force: ArrayLike = _ZERO,
        moment: ArrayLike = _ZERO,
        mass: float = 0.0,
        field: ArrayLike = _ZERO,
        at: ArrayLike | None = None,
        axes: str = LoadAxes.WORLD,
    ) -> None:
        """Check the numbers and copy them: see the attributes."""
        if not isinstance(name, str) or not name:
            raise ArgumentError("name", f"is {name!r:.100}; it must be a text, such as 'cable'")
        prefix = f"loads.{name}"
        vars(self).update(
            name=name,
            force=finite_array(f"{prefix}.force", force, (3,)),
            moment=finite_array(f"{prefix}.moment", moment, (3,)),
            mass=real_number(f"{prefix}.mass", mass, 0.0),
            field=finite_array(f"{prefix}.field", field, (3,)),
            at=None if at is None else finite_array(f"{prefix}.at", at, (3,)),
            axes=choice(LoadAxes, f"{prefix}.axes", axes),
        )

    def __str__(self) -> str:
        """Return its name and its nonzero parts."""
        of_object = " of the object" if self.axes is LoadAxes.OBJECT else ""
        parts = [
            f"{name} {_vector_text(value)} {unit}{axes}"
            for name, value, unit, axes in (
                ("force", self.force, "N", of_object),
                ("moment", self.moment, "N m", of_object),
                ("field", self.field, "m/s^2", ""),
            )
            if value.any()
        ]
        parts += [f"{self.mass:g} kg"] if self.mass else []
        parts += [] if self.at is None else [f"at {_vector_text(self.at)} m"]
        return f"{self.name}: {', '.join(parts) or 'nothing'}"


class Accelerated(StrEnum):
    """What accelerates. See the example of `Acceleration`."""

    BASE = "base"
    """The hand's base: hand, object and supports move as one, except for the hand's joints."""
    OBJECT = "object"
    """The object alone: the hand's links have no inertial forces."""


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Acceleration(Brief, PickledByFields):
    """How object and hand accelerate: the moment at which an arm starts, turns or stops.

    The problem is that of rest in a frame that moves along: inertial forces act on the object and
    its payloads, and where the base or joints accelerate, on the hand's links, too.

    Attributes:
        linear: (3,) of the point ``at``, world axes, m/s^2.
        angular: (3,) world axes, rad/s^2.
        angular_velocity: (3,) world axes, rad/s.
        at: (3,) world, m; None: the object's centre of mass.
        joint_velocities: Of independent joints by name, relative to the base, rad/s or m/s; others
            are zero. The object moves as the links that touch it, which have to move as one.
        joint_accelerations: Likewise, rad/s^2 or m/s^2.
        of: What accelerates.

    Raises:
        ArgumentError: If a number is not finite or a shape wrong, or joints are given with an
            object that accelerates alone.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.scene import Acceleration
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> lifted = scene.with_changes(acceleration=Acceleration(linear=(0.0, 0.0, 2.0)))
        >>> print(f"{scene.solve().margin:.3f} N, lifted {lifted.solve().margin:.3f} N")
        1.650 N, lifted 1.700 N
    """

    linear: FloatArray
    angular: FloatArray
    angular_velocity: FloatArray
    at: FloatArray | None
    joint_velocities: Mapping[str, float]
    joint_accelerations: Mapping[str, float]
    of: Accelerated

    def __init__(
        self,
        linear: ArrayLike = _ZERO,
        angular: ArrayLike = _ZERO,
        angular_velocity: ArrayLike = _ZERO,
        at: ArrayLike | None = None,
        joint_velocities: Mapping[str, float] = MappingProxyType({}),
        joint_accelerations: Mapping[str, float] = MappingProxyType({}),
        of: str = Accelerated.BASE,
    ) -> None:
        """Check the numbers and copy them: see the attributes."""
        vars(self).update(
            linear=finite_array("acceleration.linear", linear, (3,)),
            angular=finite_array("acceleration.angular", angular, (3,)),
            angular_velocity=finite_array("acceleration.angular_velocity", angular_velocity, (3,)),
            at=None if at is None else finite_array("acceleration.at", at, (3,)),
            joint_velocities=_by_joint("acceleration.joint_velocities", joint_velocities),
            joint_accelerations=_by_joint("acceleration.joint_accelerations", joint_accelerations),
            of=choice(Accelerated, "acceleration.of", of),
        )
        if self.of is Accelerated.OBJECT and (joint_velocities or joint_accelerations):
            raise ArgumentError(
                "acceleration.of",
                "is 'object', which is not supported together with joint motions; give 'base'",
            )

    def __str__(self) -> str:
        """Return its nonzero parts."""
        parts = [
            f"{_vector_text(value)} {unit}"
            for value, unit in (
                (self.linear, "m/s^2"),
                (self.angular, "rad/s^2"),
                (self.angular_velocity, "rad/s"),
            )
            if value.any()
        ]
        parts += [
            f"joints {kind} {_by_name_text(value)}"
            for kind, value in (
                ("move", self.joint_velocities),
                ("accelerate", self.joint_accelerations),
            )
            if value
        ]
        return f"{self.of}: {', '.join(parts) or 'nothing'}"

    @property
    def is_translation(self) -> bool:
        """Whether all accelerated points have the same acceleration."""
        turns = self.angular.any() or self.angular_velocity.any()
        joints = any([*self.joint_velocities.values(), *self.joint_accelerations.values()])
        return not (turns or joints)


@dataclass(frozen=True, eq=False)
class HandMotion(PickledByFields):
    """The hand's own motion. See the example of `load_scene`.

    Attributes:
        base_twist: (6,) [v; omega], world axes, m/s and rad/s.
        joint_velocities: rad/s or m/s by joint name.
    """

    base_twist: FloatArray
    joint_velocities: Mapping[str, float]

    def __post_init__(self) -> None:
        """Check the numbers and copy them."""
        vars(self).update(
            base_twist=finite_array("base_twist", self.base_twist, (6,)),
            joint_velocities=_by_joint("joint_velocities", self.joint_velocities),
        )


@dataclass(frozen=True, eq=False)
class Motion(PickledByFields):
    """The declared motion. See the example of `load_scene`.

    Attributes:
        object_twist: (6,) [v; omega] of the object about its centre of mass, world axes.
        hand: The hand's own motion; None: its contacts follow the object and stick.
    """

    object_twist: FloatArray
    hand: HandMotion | None = None

    def __post_init__(self) -> None:
        """Check the numbers and copy them."""
        vars(self).update(object_twist=finite_array("object_twist", self.object_twist, (6,)))


@dataclass(frozen=True, eq=False)
class GivenContact(PickledByFields):
    """A contact stated by the scene, instead of found from the shapes.

    See the example of `load_scene`.

    Attributes:
        body: Hand link or support.
        position: (3,) world frame, m.
        normal: (3,) unit, into the object, world axes.
    """

    body: str
    position: FloatArray
    normal: FloatArray

    def __post_init__(self) -> None:
        """Check the numbers and copy them."""
        vars(self).update(
            position=finite_array("position", self.position, (3,)),
            normal=finite_array("normal", self.normal, (3,)),
        )


def _by_joint(argument: str, given: Mapping[str, float]) -> Mapping[str, float]:
    """Return numbers by joint, checked to be finite."""
    if not isinstance(given, Mapping):
        raise ArgumentError(argument, f"is {given!r:.100}; give numbers by joint: {{'elbow': 0.5}}")
    return MappingProxyType(
        {name: real_number(f"{argument}.{name}", value, -np.inf) for name, value in given.items()}
    )


def _by_name_text(values: Mapping[str, float]) -> str:
    return f"[{', '.join(f'{name} {value:.4g}' for name, value in values.items())}]"


def _vector_text(values: FloatArray) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in values.tolist())}]"
