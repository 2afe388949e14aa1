"""From entries of a scene file to poses, shapes, the object and its supports.

What scenes of one folder share: hands, and whatever was built of the same content. A scene
is built in stages. Each depends on parts of the file and on what earlier stages made; where these
are as they were in the scene before, so is what it makes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, NamedTuple, TypeVar

import numpy as np

from graspless_pin.caching import Bounded, Latest
from graspless_pin.errors import ArgumentError
from graspless_pin.findings import Finding, capture, emit
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shape import Compound
from graspless_pin.geometry.bodies.shapes import SHAPES, Shape
from graspless_pin.geometry.hand.assembly import AssembledMounts
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.intake.yaml_source import Location, YamlSource, key_text, validated, with_known
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import changed
from graspless_pin.scene.body_schema import (
    ROTATION_FORMS,
    CompoundEntry,
    ObjectEntry,
    PoseEntry,
    SupportEntry,
    TwistEntry,
)
from graspless_pin.scene.scene_schema import SceneEntry

_MOST_HANDS = 16
_Entry = TypeVar("_Entry")
_Made = TypeVar("_Made")


class Last(NamedTuple):
    """The scene that was built last.

    Attributes:
        entry: What its file holds.
        bodies: What was built of its bodies.
        scene: The scene.
    """

    entry: SceneEntry
    bodies: Any
    scene: Any


class Stage(NamedTuple):
    """A step from a file to a scene.

    Attributes:
        made: What it made.
        findings: What looks wrong with it.
    """

    made: Any
    findings: tuple[Finding, ...] = ()


@dataclass(eq=False)
class SceneParts:
    """What the scenes of one folder leave for the next; it never changes what a scene becomes.

    Of hands up to sixteen are kept; of other stages, what was made last.

    Attributes:
        hands: Hand by all of its entry that its description, fingers and control depend on.
        latest: What each stage made last.
        last: The scene that was built last; None: there is none.
    """

    hands: Bounded[str, AssembledMounts] = field(default_factory=lambda: Bounded(_MOST_HANDS))
    latest: Latest = field(default_factory=Latest)
    last: Last | None = None
    _before: tuple[SceneEntry, Any] | None = None

    def validated(self, source: YamlSource) -> SceneEntry:
        """Return the content of a scene file; parts as in the scene before are the same objects.

        Raises:
            SceneError: See `validated`.
        """
        entry = validated(source, SceneEntry)
        if self._before is not None:
            entry = with_known(entry, source.data, *self._before)
        self._before = entry, source.data
        return entry

    def made(self, name: str, sources: tuple[Any, ...], make: Callable[[], _Made]) -> _Made:
        """Return what a stage makes, or made last of the same sources; tell what looks wrong of it.

        Args:
            name: Of the stage.
            sources: All that it depends on.
            make: Runs it.
        """
        stage = self.latest.get(name, sources)
        if stage is None:
            with capture() as found:
                made = make()
            stage = self.latest.put(name, sources, Stage(made, (*found,)))
        emit(*stage.findings)
        return stage.made


def kept(
    build: Callable[[YamlSource, SceneParts, Location, _Entry], _Made],
) -> Callable[[YamlSource, SceneParts, Location, _Entry], _Made]:
    """Have what is built at a location of a scene file kept while the entry there is the same."""

    @wraps(build)
    def built(file: YamlSource, parts: SceneParts, where: Location, entry: _Entry) -> _Made:
        name = key_text(where)
        return parts.made(name, (entry,), lambda: build(file, parts, where, entry))

    return built


@kept
def build_object(
    file: YamlSource, parts: SceneParts, where: Location, entry: ObjectEntry
) -> ManipulatedObject:
    """Return the object of a scene file, or what is the same of the scene before.

    Raises:
        SceneError: Naming the part of the file.
    """
    shape = build_shape(file, parts, (*where, "shape"), entry.shape)
    pose = build_pose(file, parts, (*where, "pose"), entry.pose)
    with file.at(where):
        body = ManipulatedObject.from_shape(
            entry.name,
            shape,
            pose,
            mass=entry.mass,
            density=entry.density,
            center_of_mass=entry.center_of_mass,
            material=entry.material,
            inertia=entry.inertia,
        )
    return _with_pieces(parts, where, body, pose)


@kept
def build_support(
    file: YamlSource, parts: SceneParts, where: Location, entry: SupportEntry
) -> Support:
    """Return the support at a location of a scene file, or what is the same of the scene before.

    Raises:
        SceneError: Naming the part of the file.
    """
    pose = build_pose(file, parts, (*where, "pose"), entry.pose)
    shape = build_shape(file, parts, (*where, "shape"), entry.shape)
    with file.at(where):
        body = Support(
            entry.name,
            shape,
            pose,
            friction=entry.friction,
            velocity=twist_of(entry.velocity),
            material=entry.material,
        )
    return _with_pieces(parts, where, body, pose)


@kept
def build_shape(file: YamlSource, parts: SceneParts, where: Location, entry: Any) -> Shape:
    """Return the shape at a location of a scene file, which can be made of convex pieces.

    Raises:
        SceneError: Naming the part of the file.
    """
    if isinstance(entry, CompoundEntry):
        placed = [((*where, "parts", index), part) for index, part in enumerate(entry.parts)]
        return Compound(
            tuple(build_shape(file, parts, (*at, "shape"), one.shape) for at, one in placed),
            np.array([build_pose(file, parts, (*at, "pose"), one.pose) for at, one in placed]),
        )
    with file.at(where):
        shape = SHAPES[entry.type].from_entry(entry, file.file)
    with file.at(where, ("path",) if hasattr(entry, "path") else ()):
        shape.pieces()
    return shape


_Body = TypeVar("_Body", ManipulatedObject, Support)


def _with_pieces(parts: SceneParts, where: Location, made: _Body, pose: FloatArray) -> _Body:
    """Return a body with the pieces and placements that the last one of its shape and pose had."""
    name, kept = key_text(where), parts.latest
    sources = made.shape, made.name
    pieces = kept.made(f"{name}: pieces", sources, lambda: made.shapes)
    body = changed(made, shapes=pieces)
    placed = kept.made(f"{name}: placed pieces", (pieces, pose), lambda: body.placed_bodies)
    return changed(body, placed_bodies=placed)


def build_pose(
    file: YamlSource, parts: SceneParts, where: Location, entry: PoseEntry
) -> FloatArray:
    """Return the (4, 4) pose at a location of a scene file, the same array while it says the same.

    Raises:
        SceneError: Naming the part of the file.
    """
    form, rotation = stated_turn(vars(entry))
    try:
        return parts.latest.made(
            key_text(where), (entry,), lambda: pose_matrix(entry.position, rotation)
        )
    except ArgumentError as error:
        raise file.error((*where, form), error.message) from error


def stated_turn(pose: Mapping[str, Any]) -> tuple[str, Any]:
    """Return in which form a pose says how it is turned, and what `pose_matrix` takes of that."""
    form = next((name for name in ROTATION_FORMS if pose.get(name) is not None), "rpy")
    return form, np.radians(pose[form]) if form == "rpy_deg" else pose.get(form)


def twist_of(entry: TwistEntry) -> FloatArray:
    """Return the (6,) twist [v; omega] of an entry, m/s and rad/s."""
    return np.array([*entry.linear, *entry.angular])
