"""From entries of a scene file to poses, shapes, the object and its supports."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.compound import Compound
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import SHAPES, Shape
from graspless_pin.geometry.poses import pose_matrix
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
from graspless_pin.scene.build_cache import SceneParts
from graspless_pin.scene.yaml_source import Location, YamlSource, key_text

_Body = TypeVar("_Body", ManipulatedObject, Support)


def build_object(file: YamlSource, parts: SceneParts, entry: ObjectEntry) -> ManipulatedObject:
    """Return the object of a scene file, or what is the same of the scene before.

    Raises:
        SceneError: Naming the part of the file.
    """
    where = ("object",)
    with parts.stage(key_text(where), entry) as stage:
        if stage.made is not None:
            return stage.made
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
        stage.made = _with_pieces(parts, where, body, pose)
    return stage.made


def build_support(
    file: YamlSource, parts: SceneParts, where: Location, entry: SupportEntry
) -> Support:
    """Return the support at a location of a scene file, or what is the same of the scene before.

    Raises:
        SceneError: Naming the part of the file.
    """
    with parts.stage(key_text(where), entry) as stage:
        if stage.made is not None:
            return stage.made
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
        stage.made = _with_pieces(parts, where, body, pose)
    return stage.made


def build_shape(file: YamlSource, parts: SceneParts, where: Location, entry: Any) -> Shape:
    """Return the shape at a location of a scene file, which can be made of convex pieces.

    Raises:
        SceneError: Naming the part of the file.
    """
    with parts.stage(key_text(where), entry) as stage:
        if stage.made is not None:
            return stage.made
        if isinstance(entry, CompoundEntry):
            places = [(*where, "parts", index) for index in range(len(entry.parts))]
            placed = [*zip(places, entry.parts, strict=True)]
            stage.made = Compound(
                tuple(build_shape(file, parts, (*at, "shape"), one.shape) for at, one in placed),
                np.array([build_pose(file, parts, (*at, "pose"), one.pose) for at, one in placed]),
            )
        else:
            with file.at(where):
                stage.made = SHAPES[entry.type].from_entry(entry, file.file)
            with file.at(where, ("path",) if hasattr(entry, "path") else ()):
                stage.made.pieces()
    return stage.made


def _with_pieces(parts: SceneParts, where: Location, made: _Body, pose: FloatArray) -> _Body:
    """Return a body with the convex pieces that it had, and where they were, if it still does."""
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
        message = str(error).removeprefix(f"{error.argument}: ")
        raise file.error((*where, form), message) from error


def stated_turn(pose: Mapping[str, Any]) -> tuple[str, Any]:
    """Return in which form a pose says how it is turned, and what `pose_matrix` takes of that."""
    form = next((name for name in ROTATION_FORMS if pose.get(name) is not None), "rpy")
    return form, np.radians(pose[form]) if form == "rpy_deg" else pose.get(form)


def twist_of(entry: TwistEntry) -> FloatArray:
    """Return the (6,) twist [v; omega] of an entry, m/s and rad/s."""
    return np.array([*entry.linear, *entry.angular])
