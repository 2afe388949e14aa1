"""From entries of a scene file to poses, shapes, the object and its supports."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import SHAPES, Compound, Shape
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

    def made() -> ManipulatedObject:
        shape = _shape_at(file, parts, (*where, "shape"), entry.shape)
        pose = _pose_at(file, parts, (*where, "pose"), entry.pose)
        body = file.at(
            where,
            lambda: ManipulatedObject.from_shape(
                entry.name,
                shape,
                pose,
                mass=entry.mass,
                density=entry.density,
                center_of_mass=entry.center_of_mass,
                material=entry.material,
                inertia=entry.inertia,
            ),
        )
        return _with_pieces(parts, where, body, pose)

    return parts.stage(key_text(where), (entry,), made)


def build_support(
    file: YamlSource, parts: SceneParts, where: Location, entry: SupportEntry
) -> Support:
    """Return the support at a location of a scene file, or what is the same of the scene before.

    Raises:
        SceneError: Naming the part of the file.
    """

    def made() -> Support:
        pose = _pose_at(file, parts, (*where, "pose"), entry.pose)
        shape = _shape_at(file, parts, (*where, "shape"), entry.shape)
        body = file.at(
            where,
            lambda: Support(
                entry.name,
                shape,
                pose,
                friction=entry.friction,
                velocity=twist_of(entry.velocity),
                material=entry.material,
            ),
        )
        return _with_pieces(parts, where, body, pose)

    return parts.stage(key_text(where), (entry,), made)


def _pose_at(file: YamlSource, parts: SceneParts, where: Location, entry: PoseEntry) -> FloatArray:
    return parts.stage(key_text(where), (entry,), lambda: build_pose(file, where, entry))


def _shape_at(file: YamlSource, parts: SceneParts, where: Location, entry: Any) -> Shape:
    """Return the shape at a location of a scene file, which can be made of convex pieces."""

    def made() -> Shape:
        if not isinstance(entry, CompoundEntry):
            return _solid_at(file, where, entry)
        places = [(*where, "parts", index) for index in range(len(entry.parts))]
        placed = [*zip(places, entry.parts, strict=True)]
        return Compound(
            tuple(_solid_at(file, (*place, "shape"), part.shape) for place, part in placed),
            np.array([build_pose(file, (*place, "pose"), part.pose) for place, part in placed]),
        )

    return parts.stage(key_text(where), (entry,), made)


def _solid_at(file: YamlSource, where: Location, entry: Any) -> Shape:
    shape = file.at(where, lambda: SHAPES[entry.type].from_entry(entry, file.file))
    file.at(where, lambda: shape.pieces(), ("path",) if hasattr(entry, "path") else ())
    return shape


def _with_pieces(parts: SceneParts, where: Location, made: _Body, pose: FloatArray) -> _Body:
    """Return a body with the convex pieces that it had, and where they were, if it still does."""
    name, kept = key_text(where), parts.latest
    pieces = kept.of(f"{name}: pieces", (made.shape, made.name), lambda: made.shapes)
    body = changed(made, shapes=pieces, geometries=pieces.geometries)
    placed = kept.of(f"{name}: placed pieces", (pieces, pose), lambda: body.placed_bodies)
    return changed(body, placed_bodies=placed)


def build_pose(file: YamlSource, where: Location, entry: PoseEntry) -> FloatArray:
    """Return the (4, 4) pose at a location of a scene file.

    Raises:
        SceneError: Naming the part of the file.
    """
    form, rotation = stated_turn(vars(entry))
    try:
        return pose_matrix(entry.position, rotation)
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
