"""A scene: hand, object and supports at one moment, and the way to a `QuasistaticProblem`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from graspless_pin.algorithms.torque import maximize_margin, minimize_torque
from graspless_pin.errors import ArgumentError, SceneError, SolverUnavailableError
from graspless_pin.geometry.bodies.materials import Materials
from graspless_pin.geometry.bodies.records import ManipulatedObject, Support
from graspless_pin.geometry.contact.finding import BodyKind, ContactPoint, find_contacts
from graspless_pin.geometry.contact.motion import apply_motion, support_velocities, twist_velocities
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.modes.rules import choice
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.cones import default_tangents
from graspless_pin.solution import Algorithm, TorqueSolution

_ALONG = 0.99


@dataclass(frozen=True, eq=False)
class GivenContact:
    """A contact that the scene states instead of having it found.

    Attributes:
        body: Hand link or support.
        position: (3,) world frame, m.
        normal: (3,) unit, into the object, world axes.
    """

    body: str
    position: FloatArray
    normal: FloatArray


@dataclass(frozen=True, eq=False)
class HandMotion:
    """The hand's own motion.

    Attributes:
        base_twist: (6,) [v; omega], world axes, m/s and rad/s.
        joint_velocities: rad/s or m/s by joint name.
    """

    base_twist: FloatArray
    joint_velocities: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class Motion:
    """The declared motion.

    Attributes:
        object_twist: (6,) [v; omega] of the object about its centre of mass, world axes.
        hand: The hand's own motion; None: its contacts follow the object and stick.
    """

    object_twist: FloatArray
    hand: HandMotion | None = None


@dataclass(frozen=True, eq=False)
class SceneContacts:
    """The contacts of a scene that carry force.

    Attributes:
        points: M contacts, hand first.
        sliding: (M, 3) velocity of the object relative to the other body, zero where it sticks.
    """

    points: tuple[ContactPoint, ...]
    sliding: FloatArray

    @property
    def bodies(self) -> tuple[str, ...]:
        """M names of the hand links and supports that touch the object."""
        return tuple(point.body for point in self.points)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that `QuasistaticProblem` is made of.

    Attributes:
        name: For titles.
        path: The file that it came from, for messages; None if made in Python.
        hand: The hand at its configuration; None: the object only leans on supports.
        object: The manipulated object.
        supports: What is fixed around it.
        gravity: (3,) m/s^2, world axes.
        friction: Coefficient by hand link or support, else by ``hand`` or ``supports``, else
            ``default``; a support's own coefficient comes first.
        materials: Coefficient per pair of materials; it comes before `friction` where both bodies
            have a material.
        hand_material: Material of all hand links; None: `friction` tells.
        given_contacts: Contacts to be used as they are; None: found from the shapes.
        motion: The declared motion; None: at rest.
        max_normal_force: f_n,max of every contact, N.
        cone_edges: Edges of each friction cone.
        contact_tolerance: Largest gap that counts as touching, m.
        tangent_axes: t1 of a contact is the projection of the first of these axes that is not
            along its normal; without any, the rule of `QuasistaticProblem`.
        count_own_weight: Whether the links' weight g(q) counts against the limits.
        hybrid_force_limit: Largest commanded force of a hybrid finger, N; None: max_normal_force.
        solve_options: Options of `solve` by name.
    """

    name: str
    object: ManipulatedObject
    friction: Mapping[str, float]
    hand: Hand | None = None
    supports: tuple[Support, ...] = ()
    path: Path | None = None
    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    materials: Materials = field(default_factory=lambda: Materials({}))
    hand_material: str | None = None
    given_contacts: tuple[GivenContact, ...] | None = None
    motion: Motion | None = None
    max_normal_force: float = 50.0
    cone_edges: int = 32
    contact_tolerance: float = 1e-3
    tangent_axes: tuple[FloatArray, ...] = ()
    count_own_weight: bool = True
    hybrid_force_limit: float | None = None
    solve_options: Mapping[str, Any] = field(default_factory=dict)

    def with_changes(self, **changes: Any) -> Scene:
        """Return the same scene with some fields replaced."""
        return replace(self, **changes)

    @cached_property
    def contacts(self) -> SceneContacts:
        """The contacts that carry force, found or given, after the declared motion.

        Raises:
            SceneError: If nothing touches the object, bodies overlap too deeply, or the declared
                motion drives the object into something.
        """
        points = self._points()
        if not points:
            raise SceneError(
                f"{self._label()}: nothing touches object {self.object.name!r}"
                + (
                    f" within {self.contact_tolerance:g} m; move the hand or the object, or raise "
                    "contact_tolerance"
                    if self.given_contacts is None
                    else "; contacts is an empty list: fill it, or leave it out to have them found"
                )
            )
        sliding = np.zeros((len(points), 3))
        motion = self.motion
        if motion is None and any(support.velocity.any() for support in self.supports):
            motion = Motion(np.zeros(6))
        if motion is not None:
            try:
                points, sliding = apply_motion(
                    points,
                    motion.object_twist,
                    self.object.center_of_mass_world,
                    self._body_velocities(points, motion),
                    object_name=self.object.name,
                )
            except SceneError as error:
                raise SceneError(f"{self._label()}: motion: {error}") from error
            if not points:
                raise SceneError(
                    f"{self._label()}: the declared motion parts object {self.object.name!r} from "
                    "everything that touches it; no contact is left"
                )
        return SceneContacts(points, sliding)

    def problem(self) -> QuasistaticProblem:
        """Return the problem: contacts, contact Jacobian, weight and limits as arrays.

        Positions and moments are about the object's centre of mass, in world axes.

        Raises:
            SceneError: See `contacts`.
        """
        contacts = self.contacts
        normals = np.array([point.normal for point in contacts.points])
        positions = np.array([point.position for point in contacts.points])
        jacobian, lower, upper, gravity, names = self._joints(contacts)
        weight = self.object.mass * self.gravity
        return QuasistaticProblem(
            positions - self.object.center_of_mass_world,
            normals,
            np.concatenate([weight, np.zeros(3)]),
            jacobian,
            friction=[self._friction_at(point) for point in contacts.points],
            tangents=self._tangents(normals),
            sliding=contacts.sliding,
            torque_limits=(lower, upper),
            max_normal_force=self.max_normal_force,
            cone_edges=self.cone_edges,
            joint_names=names,
            gravity_torques=gravity,
        )

    def solve(self, algorithm: str | None = None, **options: Any) -> TorqueSolution:
        """Solve the scene's problem with its own options, or with others.

        Args:
            algorithm: ``margin`` (Algorithm 1) or ``torque`` (Algorithm 2); None: the scene's.
            options: Options of `maximize_margin` or `minimize_torque`.

        Raises:
            ArgumentError: If an option is not known or not one of this algorithm.
            SceneError: See `contacts`; or if the scene's own solver is not installed.
        """
        merged = {**self.solve_options, **options}
        own = merged.pop("algorithm", "margin")
        chosen = choice(Algorithm, "algorithm", algorithm or own)
        if chosen is Algorithm.MARGIN:
            for name in ("margin", "scale"):
                if name in options:
                    raise ArgumentError(
                        name,
                        "is an option of Algorithm 2 and would change nothing here; ask for the "
                        "algorithm 'torque' or leave it out",
                    )
                merged.pop(name, None)
        run = maximize_margin if chosen is Algorithm.MARGIN else minimize_torque
        try:
            return run(self.problem(), **merged)
        except SolverUnavailableError as error:
            if "solver" in options:
                raise
            raise SceneError(f"{self._label()}: solve.{error}") from error

    def _label(self) -> str:
        return self.name if self.path is None else str(self.path)

    def _points(self) -> tuple[ContactPoint, ...]:
        if self.given_contacts is not None:
            links = () if self.hand is None else self.hand.link_names
            kinds = [
                BodyKind.HAND if given.body in links else BodyKind.SUPPORT
                for given in self.given_contacts
            ]
            points = [
                ContactPoint(given.body, kind, given.position, given.normal, 0.0)
                for given, kind in zip(self.given_contacts, kinds, strict=True)
            ]
            return tuple(sorted(points, key=lambda point: point.kind is BodyKind.SUPPORT))
        try:
            return find_contacts(
                self.object.collision_bodies(),
                () if self.hand is None else self.hand.collision_bodies(),
                [body for support in self.supports for body in support.collision_bodies()],
                tolerance=self.contact_tolerance,
            )
        except SceneError as error:
            raise SceneError(f"{self._label()}: {error}") from error

    def _body_velocities(self, points: tuple[ContactPoint, ...], motion: Motion) -> FloatArray:
        """(M, 3) velocities of what the object touches; hand contacts follow it by default."""
        positions = np.array([point.position for point in points])
        of_hand = np.array([point.kind is BodyKind.HAND for point in points])
        velocities, _ = support_velocities(points, self.supports)
        if motion.hand is None:
            velocities[of_hand] = twist_velocities(
                motion.object_twist, self.object.center_of_mass_world, positions[of_hand]
            )
        elif self.hand is not None:
            links = [point.body for point in points if point.kind is BodyKind.HAND]
            velocities[of_hand] = self.hand.point_velocities(
                links, positions[of_hand], motion.hand.joint_velocities, motion.hand.base_twist
            )
        return velocities

    def _friction_at(self, point: ContactPoint) -> float:
        support = next((item for item in self.supports if item.name == point.body), None)
        if support is not None and support.friction is not None:
            return support.friction
        material = self.hand_material if support is None else support.material
        if material is not None and self.object.material is not None:
            return self.materials.friction(material, self.object.material)
        group = "hand" if point.kind is BodyKind.HAND else "supports"
        for key in (point.body, group, "default"):
            if key in self.friction:
                return self.friction[key]
        raise SceneError(
            f"{self._label()}: friction: has no coefficient for {point.body!r}; add it, "
            f"{group!r} or 'default'"
        )

    def _tangents(self, normals: FloatArray) -> FloatArray:
        tangents = default_tangents(normals)
        for axis in reversed(self.tangent_axes):
            along = normals @ axis
            usable = np.abs(along) <= _ALONG * np.linalg.norm(axis)
            first = axis - along[usable, None] * normals[usable]
            first /= np.linalg.norm(first, axis=1, keepdims=True)
            tangents[usable] = np.stack([first, np.cross(normals[usable], first)], axis=2)
        return tangents

    def _joints(
        self, contacts: SceneContacts
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, list[str]]:
        """J (12), limits, g(q) and names: force-controlled joints, then hybrid fingers."""
        rows = 3 * len(contacts.points)
        if self.hand is None:
            return np.zeros((rows, 0)), np.zeros(0), np.zeros(0), np.zeros(0), []
        on_hand = [
            index for index, point in enumerate(contacts.points) if point.kind is BodyKind.HAND
        ]
        touching = [contacts.points[index] for index in on_hand]
        links = [point.body for point in touching]
        names = list(self.hand.actuated_joint_names)
        jacobian = np.zeros((rows, len(names)))
        block = self.hand.contact_jacobian(
            links, np.array([point.position for point in touching]).reshape(-1, 3)
        )
        for row, index in enumerate(on_hand):
            jacobian[3 * index : 3 * index + 3] = block[3 * row : 3 * row + 3]
        lower, upper = self.hand.effort_limits
        gravity = np.zeros(len(names))
        if self.count_own_weight and names:
            gravity = self.hand.gravity_torques(self.gravity)
        hybrid = [index for index in on_hand if self.hand.is_hybrid(contacts.points[index].body)]
        columns = np.zeros((rows, len(hybrid)))
        for column, index in enumerate(hybrid):
            columns[3 * index : 3 * index + 3, column] = contacts.points[index].normal
            names.append(self._hybrid_name(contacts.points[index].body, names))
        limit = self.hybrid_force_limit or self.max_normal_force
        return (
            np.hstack([jacobian, columns]),
            np.concatenate([lower, np.zeros(len(hybrid))]),
            np.concatenate([upper, np.full(len(hybrid), limit)]),
            np.concatenate([gravity, np.zeros(len(hybrid))]),
            names,
        )

    def _hybrid_name(self, link: str, taken: list[str]) -> str:
        """Name the commanded force of a hybrid finger: one contact a finger (Sec. II-A)."""
        finger = None if self.hand is None else self.hand.finger_of(link)
        name = f"{finger}.normal_force"
        if name in taken:
            raise SceneError(
                f"{self._label()}: hybrid finger {finger!r} touches the object at several points; "
                "a hybrid finger has exactly one contact: give the contacts, or control it by "
                "force"
            )
        return name
