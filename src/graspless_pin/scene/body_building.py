"""Build poses, shapes, the object and its supports from the entries of a scene file.

A scene is built in stages. Each depends on parts of the file and on results of earlier stages. If
these are the same as for the scene before, its result is reused. Hands are cached, too.
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
from graspless_pin.intake.yaml_source import Location, YamlSource, key_text, reused_entry, validated
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


class LastScene(NamedTuple):
    """The scene that was built last.

    Attributes:
        entry: Content of its file.
        bodies: Its bodies.
        scene: The scene.
    """

    entry: SceneEntry
    bodies: Any
    scene: Any


class StageResult(NamedTuple):
    """Result of a stage of building.

    Attributes:
        made: The object that was built.
        findings: Findings emitted meanwhile.
    """

    made: Any
    findings: tuple[Finding, ...] = ()


@dataclass(eq=False)
class SceneParts:
    """Cache of parts of scenes in one folder, for the next scene; it never changes a result.

    It holds up to sixteen hands, and the last result of each other stage.

    Attributes:
        hands: Hands by the part of the entry that description, fingers and control depend on.
        latest: Last result of each stage.
        last: The scene that was built last; None: there is none.
    """

    hands: Bounded[str, AssembledMounts] = field(default_factory=lambda: Bounded(_MOST_HANDS))
    latest: Latest = field(default_factory=Latest)
    last: LastScene | None = None
    _before: tuple[SceneEntry, Any] | None = None

    def validated(self, source: YamlSource) -> SceneEntry:
        """Return the validated content of a scene file; unchanged parts are the same objects.

        Raises:
            SceneError: See `validated`.
        """
        entry = validated(source, SceneEntry)
        if self._before is not None:
            entry = reused_entry(entry, source.data, *self._before)
        self._before = entry, source.data
        return entry

    def run_stage(self, name: str, sources: tuple[Any, ...], make: Callable[[], _Made]) -> _Made:
        """Return the result of a stage, cached for the same sources, and emit its findings.

        Args:
            name: Name of the stage.
            sources: All that the stage depends on.
            make: Runs the stage.
        """
        result = self.latest.get(name, sources)
        if result is None:
            with capture() as findings:
                made = make()
            result = self.latest.put(name, sources, StageResult(made, (*findings,)))
        emit(*result.findings)
        return result.made


def cached_by_entry(
    build: Callable[[YamlSource, SceneParts, Location, _Entry], _Made],
) -> Callable[[YamlSource, SceneParts, Location, _Entry], _Made]:
    """Decorate a builder: its result is cached by location while the entry there is the same."""

    @wraps(build)
    def cached_build(file: YamlSource, parts: SceneParts, where: Location, entry: _Entry) -> _Made:
        name = key_text(where)
        return parts.run_stage(name, (entry,), lambda: build(file, parts, where, entry))

    return cached_build


@cached_by_entry
def build_object(
    file: YamlSource, parts: SceneParts, where: Location, entry: ObjectEntry
) -> ManipulatedObject:
    """Build the object of a scene file.

    Raises:
        SceneError: Naming the part of the file.
    """
    shape = build_shape(file, parts, (*where, "shape"), entry.shape)
    pose = build_pose(file, parts, (*where, "pose"), entry.pose)
    with file.errors_at(where):
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


@cached_by_entry
def build_support(
    file: YamlSource, parts: SceneParts, where: Location, entry: SupportEntry
) -> Support:
    """Build the support at a location of a scene file.

    Raises:
        SceneError: Naming the part of the file.
    """
    pose = build_pose(file, parts, (*where, "pose"), entry.pose)
    shape = build_shape(file, parts, (*where, "shape"), entry.shape)
    with file.errors_at(where):
        body = Support(
            entry.name,
            shape,
            pose,
            friction=entry.friction,
            velocity=twist_of(entry.velocity),
            material=entry.material,
        )
    return _with_pieces(parts, where, body, pose)


@cached_by_entry
def build_shape(file: YamlSource, parts: SceneParts, where: Location, entry: Any) -> Shape:
    """Build the shape at a location of a scene file, and check its convex pieces.

    Raises:
        SceneError: Naming the part of the file.
    """
    if isinstance(entry, CompoundEntry):
        placed = [((*where, "parts", index), part) for index, part in enumerate(entry.parts)]
        return Compound(
            tuple(build_shape(file, parts, (*at, "shape"), one.shape) for at, one in placed),
            np.array([build_pose(file, parts, (*at, "pose"), one.pose) for at, one in placed]),
        )
    with file.errors_at(where):
        shape = SHAPES[entry.type].from_entry(entry, file.file)
    with file.errors_at(where, ("path",) if hasattr(entry, "path") else ()):
        shape.pieces()
    return shape


_Body = TypeVar("_Body", ManipulatedObject, Support)


def _with_pieces(parts: SceneParts, where: Location, body: _Body, pose: FloatArray) -> _Body:
    """Return a body with cached convex pieces, and their poses if it has the same pose."""
    name, cache = key_text(where), parts.latest
    sources = body.shape, body.name
    pieces = cache.value(f"{name}: pieces", sources, lambda: body.shapes)
    with_shapes = changed(body, shapes=pieces)
    placed = cache.value(
        f"{name}: placed pieces", (pieces, pose), lambda: with_shapes.placed_bodies
    )
    return changed(with_shapes, placed_bodies=placed)


def build_pose(
    file: YamlSource, parts: SceneParts, where: Location, entry: PoseEntry
) -> FloatArray:
    """Build the (4, 4) pose at a location of a scene file; the array is cached by its entry.

    Raises:
        SceneError: Naming the part of the file.
    """
    form, rotation = rotation_form_and_value(vars(entry))
    try:
        return parts.latest.value(
            key_text(where), (entry,), lambda: pose_matrix(entry.position, rotation)
        )
    except ArgumentError as error:
        raise file.error((*where, form), error.message) from error


def rotation_form_and_value(pose: Mapping[str, Any]) -> tuple[str, Any]:
    """Return the form of a pose entry's rotation, and the rotation as `pose_matrix` takes it."""
    form = next((name for name in ROTATION_FORMS if pose.get(name) is not None), "rpy")
    return form, np.radians(pose[form]) if form == "rpy_deg" else pose.get(form)


def twist_of(entry: TwistEntry) -> FloatArray:
    """Return the (6,) twist [v; omega] of an entry, m/s and rad/s."""
    return np.array([*entry.linear, *entry.angular])
