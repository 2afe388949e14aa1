"""The manipulated object, its supports, and friction between pairs of materials."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import BodyShapes, CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.shape import Shape
from graspless_pin.geometry.poses import as_pose, transformed
from graspless_pin.intake.text import fault_of_name
from graspless_pin.problem.checks import (
    FloatArray,
    checked_inertia,
    finite_array,
    read_only,
    real_number,
)
from graspless_pin.records import Brief, PickledByFields, Record, changed
from graspless_pin.suggestions import names_in_words, nearest_name


class _PlacedShape(PickledByFields, ABC):
    """Base of object and support: convex pieces under one name at one pose."""

    name: str
    shape: Shape

    def collision_bodies(self) -> tuple[CollisionBody, ...]:
        """Return the convex pieces for contact detection, all with the body's name.

        Raises:
            MeshError: See `Shape.pieces`.
        """
        return tuple(self.placed_bodies)

    @cached_property
    def shapes(self) -> BodyShapes:
        """Names and coal geometries of the convex pieces, independent of the pose.

        Raises:
            MeshError: See `Shape.pieces`.
        """
        pieces = self.shape.pieces()
        return BodyShapes((self.name,) * len(pieces), pieces)

    @cached_property
    @abstractmethod
    def placed_bodies(self) -> PlacedBodies:
        """The pieces of `collision_bodies`, each made on first access.

        Raises:
            MeshError: See `Shape.pieces`.
        """

    def _bodies_at(self, T: FloatArray) -> PlacedBodies:
        """Return the pieces with the shape at a (4, 4) pose."""
        placements = self.shape.placements()
        if placements is None:
            return PlacedBodies(self.shapes, T[None].repeat(len(self.shapes.names), axis=0))
        return PlacedBodies(self.shapes, T @ placements)


@dataclass(frozen=True, eq=False, repr=False)
class ManipulatedObject(Brief, _PlacedShape):
    """A rigid object with its mass. See the example of `settle_object`.

    Attributes:
        name: Name in messages and tables.
        shape: Bounded shape.
        mass: kg.
        center_of_mass: (3,) read-only, in the object's frame, m.
        T_world_object: (4, 4) read-only pose, m.
        material: Name in a table of `Materials`; None if friction is given otherwise.
        inertia: (3, 3) read-only, about the centre of mass, the object's axes, kg m^2; None: that
            of the shape filled with uniform density, about its centroid.
    """

    name: str
    shape: Shape
    mass: float
    center_of_mass: FloatArray
    T_world_object: FloatArray
    material: str | None = None
    inertia: FloatArray | None = None

    @classmethod
    def from_shape(
        cls,
        name: str,
        shape: Shape,
        T_world_object: ArrayLike,
        *,
        mass: float | None = None,
        density: float | None = None,
        center_of_mass: ArrayLike | None = None,
        material: str | None = None,
        inertia: ArrayLike | None = None,
    ) -> ManipulatedObject:
        """Make an object of uniform density.

        Args:
            name: See the attributes.
            shape: See the attributes.
            T_world_object: See the attributes.
            mass: kg; or
            density: kg/m^3.
            center_of_mass: (3,) in the object's frame, m; None: the centroid of the shape.
            material: See the attributes.
            inertia: See the attributes; three numbers are the diagonal.

        Raises:
            ArgumentError: As for the constructor, or not exactly one of mass and density is given.
            MeshError: The mesh file is missing, unreadable or encloses no volume.

        Warns:
            GrasplessPinWarning: A mesh is not watertight and what is asked of it needs its volume.
        """
        if not shape.is_bounded:
            raise ArgumentError("shape", f"object '{name}' cannot be a half-space")
        filling = None
        if mass is None or density is not None or center_of_mass is None:
            mass_or_density = _mass_or_density(mass, density)
            filling = shape.filling()
            mass = mass_or_density if density is None else mass_or_density * filling.volume
            center_of_mass = filling.centroid if center_of_mass is None else center_of_mass
        manipulated = cls(
            name,
            shape,
            mass,
            finite_array("center_of_mass", center_of_mass, (3,)),
            np.asarray(T_world_object, dtype=float),
            material,
            None if inertia is None else np.asarray(inertia),
        )
        if filling is not None and inertia is None:
            vars(manipulated)["own_inertia"] = read_only(manipulated.mass * filling.gyration)
        return manipulated

    def __post_init__(self) -> None:
        """Check all fields and copy the arrays.

        Raises:
            ArgumentError: The name is empty or too long, the shape is a half-space, the mass is not
                positive, the centre of mass is not three finite numbers, the inertia is no rigid
                body's, or the pose is not rigid.
        """
        _check_name(self.name)
        if not self.shape.is_bounded:
            raise ArgumentError("shape", f"object '{self.name}' cannot be a half-space")
        if not _number_or_nan(self.mass) > 0.0:
            raise ArgumentError(
                "mass", f"object '{self.name}' needs a positive mass in kg, got {self.mass!r}"
            )
        object.__setattr__(
            self, "center_of_mass", finite_array("center_of_mass", self.center_of_mass, (3,))
        )
        object.__setattr__(self, "T_world_object", as_pose("T_world_object", self.T_world_object))
        if self.inertia is not None:
            object.__setattr__(self, "inertia", _checked_inertia(self.inertia))

    def with_pose(self, T_world_object: ArrayLike) -> ManipulatedObject:
        """Return this object at another pose with the same geometries: the fast way to move it.

        Raises:
            ArgumentError: If the pose is not rigid.
            MeshError: See `Shape.pieces`.
        """
        pose = as_pose("T_world_object", T_world_object)
        placed = self._bodies_at(pose)
        return changed(self, "center_of_mass_world", T_world_object=pose, placed_bodies=placed)

    def with_mass(self, mass: float) -> ManipulatedObject:
        """Return this object with another mass, kg; a given inertia is kept.

        Raises:
            ArgumentError: If the mass is not positive.
        """
        if not _number_or_nan(mass) > 0.0:
            raise ArgumentError("mass", f"is {mass!r}; it must be positive, in kg")
        return changed(self, "own_inertia", mass=float(mass))

    @cached_property
    def center_of_mass_world(self) -> FloatArray:
        """(3,) read-only centre of mass in the world frame, m."""
        return read_only(transformed(self.T_world_object, self.center_of_mass))

    @cached_property
    def own_inertia(self) -> FloatArray:
        """(3, 3) read-only inertia about the centre of mass, in the object's axes, kg m^2.

        Raises:
            MeshError: The mesh file is missing, unreadable or encloses no volume.

        Warns:
            GrasplessPinWarning: A mesh is not watertight; its convex hull counts instead.
        """
        if self.inertia is not None:
            return self.inertia
        return read_only(self.mass * self.shape.filling().gyration)

    def spatial_inertia(self) -> FloatArray:
        """Return the (6, 6) inertia about the centre of mass for [linear; angular], world axes.

        Its blocks are the mass, kg, and the inertia, kg m^2.

        Raises:
            MeshError: See `own_inertia`.
        """
        R = self.T_world_object[:3, :3]
        world_inertia = R @ self.own_inertia @ R.T
        spatial = np.diag([self.mass, self.mass, self.mass, 0.0, 0.0, 0.0])
        spatial[3:, 3:] = 0.5 * (world_inertia + world_inertia.T)
        return spatial

    @cached_property
    def placed_bodies(self) -> PlacedBodies:
        """The pieces of `collision_bodies`, each made on first access."""
        return self._bodies_at(self.T_world_object)


@dataclass(frozen=True, eq=False, repr=False)
class Support(Brief, _PlacedShape):
    """A fixed body that the object may touch: a table, a slope, a wall.

    Its shape tells the kind of support: a table, slope or wall is a half-space (exact and fastest)
    or a box; a corner is two or three supports that are half-spaces, a step a box on a half-space;
    a second object that is fixed, a rack or a vice is a box, cylinder or mesh, decomposed where the
    object reaches into its hollows. A conveyor is any of them with a velocity.

    See the example of `settle_object`.

    Attributes:
        name: Name in messages and tables.
        shape: Any shape.
        T_world_support: (4, 4) read-only pose, m.
        friction: Coefficient of friction against the object; None: that of the materials or scene.
        velocity: (6,) read-only twist [v; omega] of its surface, v at the origin of the support's
            frame, world axes, m/s and rad/s.
        material: Name in a table of `Materials`; None if friction is given otherwise.
    """

    name: str
    shape: Shape
    T_world_support: FloatArray
    friction: float | None = None
    velocity: FloatArray = field(default_factory=lambda: np.zeros(6))
    material: str | None = None

    def __post_init__(self) -> None:
        """Check all fields and copy the pose.

        Raises:
            ArgumentError: The name is empty or too long, the pose is not rigid, the friction is
                negative, or the velocity is not six finite numbers.
        """
        _check_name(self.name)
        object.__setattr__(
            self, "T_world_support", as_pose("T_world_support", self.T_world_support)
        )
        if self.friction is not None and not _number_or_nan(self.friction) >= 0.0:
            raise ArgumentError(
                "friction",
                f"support '{self.name}' needs a coefficient of zero or more, got {self.friction!r}",
            )
        object.__setattr__(self, "velocity", finite_array("velocity", self.velocity, (6,)))

    @cached_property
    def is_moving(self) -> bool:
        """Whether the velocity is not zero."""
        return bool(self.velocity.any())

    @cached_property
    def placed_bodies(self) -> PlacedBodies:
        """The pieces of `collision_bodies`, each made on first access."""
        return self._bodies_at(self.T_world_support)


def _check_name(name: str) -> None:
    if not isinstance(name, str) or not name.strip():
        raise ArgumentError("name", f"needs a text that is not empty, got {name!r}")
    if fault := fault_of_name(name):
        raise ArgumentError("name", fault)


def _number_or_nan(value: object) -> float:
    """Return a value if it is a finite number that is not negative; NaN for anything else."""
    with suppress(ArgumentError):
        return real_number("", value, 0.0)
    return math.nan


def _mass_or_density(mass: float | None, density: float | None) -> float:
    """Return whichever of mass and density is given.

    Raises:
        ArgumentError: The value is not positive, or not exactly one is given.
    """
    name, value, unit = ("mass", mass, "kg") if density is None else ("density", density, "kg/m^3")
    if value is None or None not in (mass, density):
        found = "neither" if value is None else "both"
        raise ArgumentError("mass", f"needs either a mass in kg or a density, found {found}")
    if not _number_or_nan(value) > 0.0:
        raise ArgumentError(name, f"needs a positive number of {unit}, got {value!r}")
    return value


def _checked_inertia(inertia: ArrayLike) -> FloatArray:
    """Return the (3, 3) inertia of a rigid body about its centre of mass, kg m^2, read-only.

    Args:
        inertia: (3, 3), or (3,) the diagonal.

    Raises:
        ArgumentError: The matrix is not symmetric and positive definite, or one principal moment
            exceeds the sum of the others.
    """
    stated = np.asarray(inertia)
    matrix = checked_inertia(
        "inertia", np.diag(stated) if stated.shape == (3,) else stated, 3, definite=True
    )
    low, middle, high = np.linalg.eigvalsh(matrix).tolist()
    if high > (low + middle) * (1.0 + 1e-9):
        raise ArgumentError(
            "inertia",
            f"has the principal moments {low:g}, {middle:g} and {high:g} kg m^2; none may "
            "be larger than the sum of the other two",
        )
    return matrix


Pair = frozenset[str]
_SIMILAR_NAMES = 0.8
"""Similarity from which on a name counts as a misspelling of another."""


@dataclass(frozen=True)
class Materials(Record):
    """Coefficients of friction by pair of materials; the order of a pair does not matter.

    See the example of `load_scene`.

    Attributes:
        coefficients: Coefficient by set of two names, or of one where a material meets itself.
    """

    coefficients: Mapping[Pair, float]

    @classmethod
    def from_table(cls, table: Mapping[str, Mapping[str, float]]) -> Materials:
        """Make the record from a nested table, such as ``{"rubber": {"steel": 0.6}}``.

        A pair may be written once, or both ways round with the same coefficient.

        Raises:
            ArgumentError: A name is empty, a coefficient is negative or not a number, or a pair has
                two coefficients.
        """
        coefficients: dict[Pair, float] = {}
        for first, row in table.items():
            for second, value in row.items():
                key = f"materials[{first!r}][{second!r}]"
                if not (str(first).strip() and str(second).strip()):
                    raise ArgumentError(key, "needs two names")
                pair, figure = frozenset((first, second)), real_number(key, value, 0.0)
                if coefficients.setdefault(pair, figure) != figure:
                    raise ArgumentError(
                        key,
                        f"is {value:g}, but the reversed pair has {coefficients[pair]:g}; "
                        "give the same figure for both",
                    )
        return cls(coefficients)

    @property
    def names(self) -> tuple[str, ...]:
        """All materials in alphabetical order."""
        return tuple(sorted({name for pair in self.coefficients for name in pair}))

    def check(self, names: Iterable[str], argument: str = "material") -> None:
        """Check that materials are in the table.

        Raises:
            ArgumentError: One is not; the message lists those that are.
        """
        for name in names:
            if name not in self.names:
                suggestion = names_in_words(name, self.names)
                raise ArgumentError(argument, f"{name!r} is in no pair of materials; {suggestion}")

    def misspelt(self, used: Iterable[str]) -> dict[str, str]:
        """Return names in the table that look like misspelt materials of bodies, with the match.

        A name that no body uses is not a mistake by itself: scenes may share a table. Names that
        differ in their digits are different materials.

        Args:
            used: Names of the bodies' materials.
        """
        bodies = sorted(set(used))
        nearest = {
            name: nearest_name(
                name,
                [body for body in bodies if _digit_groups(body) == _digit_groups(name)],
                _SIMILAR_NAMES,
            )
            for name in self.names
            if name not in bodies
        }
        return {name: match for name, match in nearest.items() if match is not None}

    def friction(self, first: str, second: str) -> float:
        """Return the coefficient of friction of two materials.

        Raises:
            ArgumentError: A material is unknown or the pair has no coefficient; the message says
                what to add.
        """
        value = self.coefficients.get(frozenset((first, second)))
        if value is None:
            self.check((first, second))
            raise ArgumentError(
                "materials",
                f"has no coefficient for {first!r} on {second!r}; "
                f"add it, e.g. {first}: {{{second}: 0.5}}",
            )
        return value


def _digit_groups(name: str) -> list[str]:
    return re.findall(r"\d+", name)
