"""From a YAML scene to a `Scene`, with errors that name file, line, key and what was found."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from graspless_pin.errors import ArgumentError, GrasplessPinError, SceneError
from graspless_pin.geometry.bodies.materials import Materials
from graspless_pin.geometry.bodies.records import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import (
    Box,
    Capsule,
    Cone,
    Cylinder,
    HalfSpace,
    MeshShape,
    Shape,
    Sphere,
    coal_geometries,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.mounts import Mount
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.robots.description import FingerSpec
from graspless_pin.geometry.robots.files import describe_urdf, find_robot
from graspless_pin.magnitudes import LARGEST_LOAD_OVER_LIMIT
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import schema
from graspless_pin.scene.material_pairs import warn_of_unused_materials
from graspless_pin.scene.messages import explain, key_text
from graspless_pin.scene.parts import SceneParts
from graspless_pin.scene.records import GivenContact, HandMotion, Motion
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.yaml_source import Location, YamlSource

_Made = TypeVar("_Made")


def load_scene(path: str | Path) -> Scene:
    """Load a YAML scene.

    Paths in the file are relative to the file. The file is data: YAML tags are refused, and so are
    XML entities in the URDFs that it names.

    Args:
        path: The scene file.

    Returns:
        The scene, with hand and shapes loaded.

    Raises:
        SceneError: Naming file, line and key, what was found and what would do.
    """
    return build_scene(YamlSource(Path(path)))


def build_scene(source: YamlSource, parts: SceneParts | None = None) -> Scene:
    """Build the scene of a parsed file.

    Args:
        source: The file, perhaps with changed content.
        parts: What earlier scenes of the same folder left; None: nothing is shared.

    Raises:
        SceneError: See `load_scene`.
    """
    if not isinstance(source.data, dict):
        raise SceneError(
            f"{source.where(())}: found {reprlib.repr(source.data)}; a scene is a mapping with the "
            "keys object, friction, hand, supports, ..."
        )
    try:
        entry = schema.SceneEntry.model_validate(source.data)
    except ValidationError as error:
        raise SceneError(explain(source, error)) from None
    return _Builder(source, parts or SceneParts()).scene(entry)


class _Builder:
    """Builds the records of one scene file and locates every error in it."""

    def __init__(self, source: YamlSource, parts: SceneParts) -> None:
        self._source = source
        self._parts = parts
        self._folder = source.path.resolve().parent

    def scene(self, entry: schema.SceneEntry) -> Scene:
        hand = None if entry.hand is None else self._hand(entry.hand)
        supports = tuple(
            self._support(("supports", index), item) for index, item in enumerate(entry.supports)
        )
        links = () if hand is None else hand.link_names
        bodies = [*(support.name for support in supports), *links]
        self._check_names(entry, links)
        friction = entry.friction
        if isinstance(friction, dict):
            known = ["default", "hand", "supports", *bodies]
            for key in friction:
                if key not in known:
                    raise self._error(
                        ("friction", key), f"names no body; known: {', '.join(known)}"
                    )
        made = self._object(entry.object)
        self._check_weight(entry, made)
        weight = entry.hand is None or entry.hand.count_own_weight
        return Scene(
            name=entry.name or self._source.path.stem,
            path=self._source.path,
            gravity=np.array(entry.gravity),
            hand=hand,
            object=made,
            supports=supports,
            friction={"default": friction} if not isinstance(friction, dict) else friction,
            materials=self._materials(entry),
            hand_material=None if entry.hand is None else entry.hand.material,
            given_contacts=self._contacts(entry, bodies),
            motion=self._motion(entry.motion, hand),
            max_normal_force=entry.max_normal_force,
            cone_edges=entry.cone_edges,
            contact_tolerance=entry.contact_tolerance,
            points_per_patch=entry.points_per_patch,
            tangent_axes=tuple(np.array(axis) for axis in entry.tangent_axes),
            count_own_weight=weight,
            hybrid_force_limit=None if entry.hand is None else entry.hand.hybrid_force_limit,
            solve_options=entry.solve.model_dump(),
        )

    def _check_weight(self, entry: schema.SceneEntry, made: ManipulatedObject) -> None:
        """Refuse an object whose weight no double holds beside the force that must bear it."""
        weight = made.mass * float(np.linalg.norm(entry.gravity))
        most = LARGEST_LOAD_OVER_LIMIT * entry.max_normal_force
        if weight > most:
            raise self._error(
                ("max_normal_force",),
                f"is {entry.max_normal_force:g} N, and the object weighs {weight:g} N; it may "
                f"weigh at most {LARGEST_LOAD_OVER_LIMIT:g} times as much, {most:g} N",
            )

    def _materials(self, entry: schema.SceneEntry) -> Materials:
        table = self._at((), lambda: Materials.from_table(entry.materials))
        named: list[tuple[Location, str | None]] = [(("object", "material"), entry.object.material)]
        if entry.hand is not None:
            named.append((("hand", "material"), entry.hand.material))
        named += [
            (("supports", i, "material"), item.material) for i, item in enumerate(entry.supports)
        ]
        for location, name in named:
            if name is not None:
                self._at(location, lambda name=name: table.check([name]))
        warn_of_unused_materials(self._source, entry, table)
        return table

    def _error(self, location: Location, message: str) -> SceneError:
        return SceneError(f"{self._source.where(location)}: {key_text(location)}: {message}")

    def _at(self, location: Location, make: Callable[[], _Made], also: Location = ()) -> _Made:
        """Make something of one part of the file; an error names that part.

        Args:
            location: The part.
            make: Makes it.
            also: Deeper part to name where the error is about no argument but a file or name.
        """
        try:
            return make()
        except SceneError:
            raise
        except ArgumentError as error:
            inner = (*location, *_keys(error.argument))
            if self._source.has(inner):
                message = str(error).removeprefix(f"{error.argument}: ")
                raise self._error(inner, message) from error
            raise self._error(location, str(error)) from error
        except GrasplessPinError as error:
            raise self._error((*location, *also), str(error)) from error
        except OSError as error:
            message = f"a file cannot be read ({error}); check it"
            raise self._error((*location, *also), message) from error

    def _check_names(self, entry: schema.SceneEntry, links: Sequence[str]) -> None:
        """Refuse a body that is called like another one: contacts are told by these names."""
        taken = set(links)
        bodies: list[tuple[Location, str]] = [(("object", "name"), entry.object.name)]
        bodies += [(("supports", i, "name"), item.name) for i, item in enumerate(entry.supports)]
        for location, name in bodies:
            if name in taken:
                raise self._error(location, f"{name!r} names another body too; names must differ")
            taken.add(name)

    def _path(self, text: str) -> Path:
        path = Path(text)
        return path if path.is_absolute() else self._folder / path

    def _hand(self, entry: schema.HandEntry) -> Hand:
        return self._at(("hand",), lambda: self._parts.hand(entry, lambda: self._assembled(entry)))

    def _assembled(self, entry: schema.HandEntry) -> Hand:
        mounts = []
        for index, (prefix, item) in enumerate(entry.mount_entries()):
            where: Location = ("hand", "mounts", index) if entry.mounts else ("hand",)
            mounts.append(self._mount(where, prefix, item))
        source: Location = ("mounts",)
        if not entry.mounts:
            source = ("robot",) if entry.urdf is None else ("urdf",)
        return self._at(
            ("hand",),
            lambda: Hand.assemble(
                mounts, q=entry.q, control=entry.control, effort_limits=entry.effort_limits
            ),
            source,
        )

    def _mount(self, where: Location, prefix: str, entry: schema.MountEntry) -> Mount:
        robot = entry.robot
        if entry.urdf is not None:
            robot = self._path(entry.urdf)
        elif robot is not None and robot.endswith((".yaml", ".yml")):
            robot = self._path(robot)
        fingers = None
        if entry.fingers is not None:
            fingers = {
                name: FingerSpec(tuple(item.joints), tuple(item.links), item.tip)
                for name, item in entry.fingers.items()
            }
        assert robot is not None  # noqa: S101 - the schema asks for one of the two
        source = robot
        folders = [self._path(folder) for folder in entry.package_dirs]
        found = self._at(
            where,
            lambda: self._parts.robot(
                ("urdf" if entry.urdf else "robot", str(source), *map(str, folders)),
                lambda: (
                    describe_urdf(source, folders) if entry.urdf else find_robot(source, folders)
                ),
            ),
            ("robot",),
        )
        pose = self._pose((*where, "base_pose"), entry.base_pose)
        given = {
            "convex": entry.convex,
            "concavity": entry.concavity,
            "decompose_time_limit": entry.decompose_time_limit,
        }
        own = {name: value for name, value in given.items() if value is not None}
        meshes = replace(found.meshes, **own) if own else None
        return Mount(found, pose, prefix, fingers, meshes=meshes)

    def _object(self, entry: schema.ObjectEntry) -> ManipulatedObject:
        shape = self._at(("object", "shape"), lambda: self._shape(entry.shape))
        self._at(("object", "shape"), lambda: coal_geometries(shape), ("path",))
        return self._at(
            ("object",),
            lambda: ManipulatedObject.from_shape(
                entry.name,
                shape,
                self._pose(("object", "pose"), entry.pose),
                mass=entry.mass,
                density=entry.density,
                center_of_mass=entry.center_of_mass,
                material=entry.material,
            ),
        )

    def _support(self, where: Location, entry: schema.SupportEntry) -> Support:
        pose = self._pose((*where, "pose"), entry.pose)
        support = self._at(
            where,
            lambda: Support(
                entry.name,
                self._shape(entry.shape),
                pose,
                friction=entry.friction,
                velocity=_twist(entry.velocity),
                material=entry.material,
            ),
        )
        self._at((*where, "shape"), support.collision_bodies, ("path",))
        return support

    def _pose(self, where: Location, entry: schema.PoseEntry) -> FloatArray:
        rotations = {"rpy": entry.rpy, "quaternion": entry.quaternion, "matrix": entry.matrix}
        form = next((name for name, value in rotations.items() if value is not None), None)
        if form is None:
            return pose_matrix(entry.position)
        try:
            return pose_matrix(entry.position, rotations[form])
        except ArgumentError as error:
            message = str(error).removeprefix(f"{error.argument}: ")
            raise self._error((*where, form), message) from error

    def _shape(self, entry: Any) -> Shape:
        match entry:
            case schema.BoxEntry():
                return Box(entry.size)
            case schema.SphereEntry():
                return Sphere(entry.radius)
            case schema.CylinderEntry():
                return Cylinder(entry.radius, entry.length)
            case schema.CapsuleEntry():
                return Capsule(entry.radius, entry.length)
            case schema.ConeEntry():
                return Cone(entry.radius, entry.length)
            case schema.MeshEntry():
                return MeshShape(
                    self._path(entry.path),
                    entry.scale,
                    convex=entry.convex,
                    concavity=entry.concavity,
                    decompose_time_limit=entry.decompose_time_limit,
                )
            case _:
                return HalfSpace()

    def _contacts(
        self, entry: schema.SceneEntry, bodies: list[str]
    ) -> tuple[GivenContact, ...] | None:
        if entry.contacts is None:
            return None
        contacts: list[GivenContact] = []
        for index, item in enumerate(entry.contacts):
            if item.body not in bodies:
                raise self._error(
                    ("contacts", index, "body"),
                    f"{item.body!r} is no hand link or support; known: "
                    f"{', '.join(bodies) or 'none'}",
                )
            normal = np.array(item.normal) / np.linalg.norm(item.normal)
            contacts.append(GivenContact(item.body, np.array(item.position), normal))
        return tuple(contacts)

    def _motion(self, entry: schema.MotionEntry | None, hand: Hand | None) -> Motion | None:
        if entry is None:
            return None
        own = None
        if entry.hand is not None:
            if hand is None:
                raise self._error(("motion", "hand"), "the scene has no hand that could move")
            own = HandMotion(_twist(entry.hand.base_twist), dict(entry.hand.joint_velocities))
            self._at(
                ("motion", "hand"),
                lambda: hand.point_velocities(
                    (), np.zeros((0, 3)), own.joint_velocities, own.base_twist
                ),
            )
        return Motion(_twist(entry.object_twist), own)


def _twist(entry: schema.TwistEntry) -> FloatArray:
    return np.array([*entry.linear, *entry.angular])


def _keys(argument: str) -> tuple[str, ...]:
    """Split an argument's name such as ``q['joint_1.0']`` into keys of the file."""
    return tuple(
        quoted or plain for quoted, plain in re.findall(r"\['(.*?)'\]|([^.\[\]]+)", argument)
    )
