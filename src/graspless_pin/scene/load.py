"""From a YAML scene to a `Scene`, with errors that name file, line, key and what was found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from graspless_pin.errors import ArgumentError, GrasplessPinError, SceneError
from graspless_pin.geometry.bodies import ManipulatedObject, Support
from graspless_pin.geometry.fingers import FingerSpec
from graspless_pin.geometry.hand import Hand
from graspless_pin.geometry.mounts import Mount
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.shapes import (
    Box,
    Capsule,
    Cone,
    Cylinder,
    HalfSpace,
    MeshShape,
    Shape,
    Sphere,
)
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import schema
from graspless_pin.scene.scene import GivenContact, HandMotion, Motion, Scene
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
    source = YamlSource(Path(path))
    if not isinstance(source.data, dict):
        raise SceneError(
            f"{source.path}: a scene is a mapping with the keys object, friction, hand, "
            f"supports, ...; found {type(source.data).__name__}"
        )
    try:
        entry = schema.SceneEntry.model_validate(source.data)
    except ValidationError as error:
        raise SceneError(_explain(source, error)) from None
    return _Builder(source).scene(entry)


class _Builder:
    """Builds the records of one scene file and locates every error in it."""

    def __init__(self, source: YamlSource) -> None:
        self._source = source
        self._folder = source.path.resolve().parent

    def scene(self, entry: schema.SceneEntry) -> Scene:
        hand = None if entry.hand is None else self._at(("hand",), lambda: self._hand(entry.hand))
        supports = tuple(
            self._at(("supports", index), lambda item=item: self._support(item))
            for index, item in enumerate(entry.supports)
        )
        names = [entry.object.name, *(support.name for support in supports)]
        names += [] if hand is None else hand.link_names
        for index, support in enumerate(supports):
            if names.count(support.name) > 1:
                raise SceneError(
                    f"{self._source.where(('supports', index, 'name'))}: supports[{index}].name: "
                    f"{support.name!r} names another body too; names must differ"
                )
        known_frictions = {"default", "hand", "supports", *names[1:]}
        friction = entry.friction
        if isinstance(friction, dict):
            for key in friction:
                if key not in known_frictions:
                    raise SceneError(
                        f"{self._source.where(('friction', key))}: friction: {key!r} is no hand "
                        "link, support, 'hand', 'supports' or 'default'"
                    )
        weight = entry.hand is None or entry.hand.count_own_weight
        return Scene(
            name=entry.name or self._source.path.stem,
            path=self._source.path,
            gravity=np.array(entry.gravity),
            hand=hand,
            object=self._at(("object",), lambda: self._object(entry.object)),
            supports=supports,
            friction={"default": friction} if not isinstance(friction, dict) else friction,
            given_contacts=self._contacts(entry, names[1:]),
            motion=self._motion(entry.motion),
            max_normal_force=entry.max_normal_force,
            cone_edges=entry.cone_edges,
            contact_tolerance=entry.contact_tolerance,
            tangent_axes=tuple(np.array(axis) for axis in entry.tangent_axes),
            count_own_weight=weight,
            hybrid_force_limit=None if entry.hand is None else entry.hand.hybrid_force_limit,
            solve_options=entry.solve.model_dump(),
        )

    def _at(self, location: Location, make: Callable[[], _Made]) -> _Made:
        """Make something of one part of the file; an error names that part."""
        try:
            return make()
        except SceneError:
            raise
        except GrasplessPinError as error:
            inner = location
            if isinstance(error, ArgumentError):
                inner = (*location, *_keys(error.argument))
            key = ".".join(str(part) for part in location)
            raise SceneError(f"{self._source.where(inner)}: {key}: {error}") from error

    def _path(self, text: str) -> Path:
        path = Path(text)
        return path if path.is_absolute() else self._folder / path

    def _hand(self, entry: schema.HandEntry | None) -> Hand:
        assert entry is not None  # noqa: S101 - narrowed by the caller
        mounts = [
            self._at(self._mount_key(entry, index), lambda p=prefix, m=mount: self._mount(p, m))
            for index, (prefix, mount) in enumerate(entry.mount_entries())
        ]
        return Hand.assemble(
            mounts, q=entry.q, control=entry.control, effort_limits=entry.effort_limits
        )

    def _mount_key(self, entry: schema.HandEntry, index: int) -> Location:
        return ("hand", "mounts", index) if entry.mounts else ("hand",)

    def _mount(self, prefix: str, entry: schema.MountEntry) -> Mount:
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
        folders = [self._path(folder) for folder in entry.package_dirs]
        return Mount(robot, _pose(entry.base_pose), prefix, fingers, folders)

    def _object(self, entry: schema.ObjectEntry) -> ManipulatedObject:
        body = ManipulatedObject(
            name=entry.name,
            shape=self._shape(entry.shape),
            mass=entry.mass,
            center_of_mass=np.array(entry.center_of_mass),
            T_world_object=_pose(entry.pose),
        )
        body.collision_body()
        return body

    def _support(self, entry: schema.SupportEntry) -> Support:
        support = Support(
            entry.name, self._shape(entry.shape), _pose(entry.pose), friction=entry.friction
        )
        support.collision_body()
        return support

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
                return MeshShape(self._path(entry.path), entry.scale)
            case _:
                return HalfSpace()

    def _contacts(
        self, entry: schema.SceneEntry, bodies: list[str]
    ) -> tuple[GivenContact, ...] | None:
        if entry.contacts is None:
            return None
        contacts = []
        for index, item in enumerate(entry.contacts):
            where = self._source.where(("contacts", index, "body"))
            if item.body not in bodies:
                raise SceneError(
                    f"{where}: contacts[{index}].body: {item.body!r} is no hand link or support; "
                    f"known: {', '.join(bodies) or 'none'}"
                )
            normal = np.array(item.normal)
            length = float(np.linalg.norm(normal))
            if length == 0.0:
                where = self._source.where(("contacts", index, "normal"))
                raise SceneError(
                    f"{where}: contacts[{index}].normal: is {list(item.normal)}; it needs a "
                    "direction, into the object"
                )
            contacts.append(GivenContact(item.body, np.array(item.position), normal / length))
        return tuple(contacts)

    def _motion(self, entry: schema.MotionEntry | None) -> Motion | None:
        if entry is None:
            return None
        hand = None
        if entry.hand is not None:
            hand = HandMotion(_twist(entry.hand.base_twist), dict(entry.hand.joint_velocities))
        return Motion(_twist(entry.object_twist), hand)


def _pose(entry: schema.PoseEntry) -> FloatArray:
    return pose_matrix(entry.position, entry.rpy or entry.quaternion or entry.matrix)


def _twist(entry: schema.TwistEntry) -> FloatArray:
    return np.array([*entry.linear, *entry.angular])


def _keys(argument: str) -> tuple[str, ...]:
    """Split an argument's name such as ``q['joint']`` into keys of the file."""
    return tuple(part.strip("'\"]") for part in argument.replace("[", ".").split(".") if part)


def _explain(source: YamlSource, error: ValidationError) -> str:
    """Return one line a mistake: file:line, key, what is wrong, what was found."""
    lines = []
    for item in error.errors():
        # Union branches add their own names to the location; only keys of the file are shown.
        location = _in_file(source, item["loc"])
        key = ".".join(str(part) for part in location) or "scene"
        found = item["input"]
        message = item["msg"].removeprefix("Value error, ")
        if item["type"] == "extra_forbidden":
            message = "is not a key that a scene has here"
        shown = (
            "" if isinstance(found, dict) and item["type"] == "missing" else f" (found {found!r})"
        )
        lines.append(f"{source.where(location)}: {key}: {message}{shown}")
    return "\n".join(dict.fromkeys(lines))


def _in_file(source: YamlSource, location: tuple[int | str, ...]) -> Location:
    """Keep the parts of a validation location that are keys of the file, and a missing last key."""
    kept: list[int | str] = []
    data = source.data
    for index, part in enumerate(location):
        in_list = isinstance(data, list) and isinstance(part, int) and part < len(data)
        if in_list or (isinstance(data, dict) and part in data):
            data = data[part]  # pyright: ignore[reportArgumentType, reportCallIssue]
            kept.append(part)
        elif isinstance(data, dict) and index == len(location) - 1:
            kept.append(part)
    return tuple(kept)
