"""Keys of a scene file by dotted path, such as ``object.mass``: their locations and values.

`scene_with_keys` changes a scene by such keys.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from graspless_pin.errors import ArgumentError
from graspless_pin.findings import capture
from graspless_pin.intake.yaml_source import Location, YamlSource, plain, validated
from graspless_pin.scene.body_building import SceneParts, StageResult
from graspless_pin.scene.fields import FIELDS_OF_KEYS, AnyScene, SceneFields
from graspless_pin.scene.load import build_scene
from graspless_pin.scene.saving import scene_data
from graspless_pin.scene.scene_schema import SCENE, SceneEntry
from graspless_pin.scene.units import IN_DEGREES, in_radians
from graspless_pin.suggestions import names_in_words

Tree = dict[str, Any]
"""A scene file's content as plain data."""
_BY_NAME = (
    "q", "effort_limits", "joint_velocities", "joint_accelerations", "friction", "control",
    "rates", "torque", "torque_offset", "effort", "armature", "stiffness", "damping",
    "contact_position", "convex",
)  # fmt: skip
"""Mappings by name: their keys may contain dots."""
_ZERO = (
    "position", "rpy", "linear", "angular", "angular_velocity", "force", "moment", "field", "at",
)  # fmt: skip
_RADIANS = "in rad, or in a study with unit: deg"


def place_key(tree: Tree, defaults: Tree, key: str) -> Location:
    """Return the location of a dotted key, and add omitted parents of it to the tree.

    List items are named by index, or by their ``name`` or ``prefix``.

    Args:
        tree: The scene, which is changed.
        defaults: The scene with all defaults filled in.
        key: E.g. ``object.mass`` or ``supports.slope.pose.rpy.1``.

    Raises:
        ArgumentError: If there is no such key in a scene.
    """
    parts = key.split(".")
    for name in IN_DEGREES.keys() & parts:
        raise ArgumentError(key, f"use {IN_DEGREES[name]} instead, {_RADIANS}")
    location: Location = ()
    node: Any = tree
    while parts:
        name, count = _next_step(node, location, parts, key)
        location = (*location, name)
        parts = parts[count:]
        if parts:
            node = _enter_part(node, defaults, location, key)
    return location


def _next_step(node: Any, location: Location, parts: list[str], key: str) -> tuple[str | int, int]:
    """Return the next step of a path (key or index), and how many of its parts it consumes."""
    if isinstance(node, list):
        return _item_index(node, parts[0], key), 1
    for count in range(len(parts), 0, -1):
        name = ".".join(parts[:count])
        if name in node:
            return name, count
    if location and location[-1] in _BY_NAME:
        return ".".join(parts), len(parts)
    return parts[0], 1


def _item_index(items: list[Any], name: str, key: str) -> int:
    if re.fullmatch("-?[0-9]+", name):
        if 0 <= int(name) < len(items):
            return int(name)
        raise ArgumentError(key, f"has no item {name}; it has {len(items)} items, counted from 0")
    names = [
        str(item.get("name", item.get("prefix", ""))) if isinstance(item, dict) else ""
        for item in items
    ]
    if names.count(name) == 1:
        return names.index(name)
    known = [*filter(None, names)]
    words = names_in_words(name, known) if known else "its items have no names: give an index"
    words = words if items else "it is empty"
    raise ArgumentError(key, f"has no item named {name!r}; {words}")


def _enter_part(node: Any, defaults: Tree, location: Location, key: str) -> Any:
    """Return the part of the tree at a location, added from the defaults if it is omitted."""
    name: Any = location[-1]
    part = _part_or_none(node, name)
    if part is None or (name == "friction" and not isinstance(part, dict)):
        part = _default_part(defaults, location) if part is None else {"default": part}
        node[name] = part
    if not isinstance(part, dict | list):
        parent_key = ".".join(map(str, location))
        raise ArgumentError(key, f"{parent_key} is {part!r} and has no keys below it")
    return part


def _default_part(defaults: Any, location: Location) -> Any:
    node = defaults
    for part in location:
        node = _part_or_none(node, part)
    if isinstance(node, list | tuple):
        return list(node)
    return [0.0, 0.0, 0.0] if location[-1] in _ZERO else {}


def _part_or_none(node: Any, part: Any) -> Any:
    """Return the part at a key or index, None if there is none."""
    try:
        return node[part]
    except (KeyError, IndexError, TypeError):
        return None


def deep_copy(data: Any) -> Any:
    """Return a deep copy in which parts repeated by YAML anchors are separate, too."""
    if isinstance(data, dict):
        return {key: deep_copy(item) for key, item in data.items()}
    return [deep_copy(item) for item in data] if isinstance(data, list) else data


def with_value_at(tree: Any, location: Location, value: Any) -> Any:
    """Return a copy of a tree with a value at a location; other parts are shared."""
    first, *rest = location
    changed = tree.copy()
    changed[first] = with_value_at(tree[first], tuple(rest), value) if rest else value
    return changed


def _without_alternatives(tree: Any, location: Location, stated: set[Location]) -> Any:
    """Return a tree without the alternatives of a key, unless these are stated, too."""
    *parent, name = location
    node: Any = tree
    for step in parent:
        node = node[step]
    for alternative in (one for names in _EITHER if name in names for one in names if one != name):
        if alternative in node and (*parent, alternative) not in stated:
            tree = with_value_at(tree, (*parent, alternative), None)
    return tree


_EITHER = ("mass", "density"), ("rpy", "quaternion", "matrix")
"""Keys of which only one may be given: a new one replaces the others."""
_NO_FIELD = ("description", "warnings")


def scene_with_keys(scene: AnyScene, values: Mapping[str, Any]) -> AnyScene:
    """Return a scene with other values of keys of its file.

    Args:
        scene: The scene.
        values: By dotted key, as in the file: numbers in SI units, bodies as mappings.

    Raises:
        ArgumentError: If there is no such key.
        SceneError: If the scene file would be invalid.
    """
    tree = in_radians(scene_data(scene))
    path = scene.path or Path(scene.name)
    defaults = validated(YamlSource(path, tree, SCENE), SceneEntry).model_dump()
    changed_keys, stated = set(), set[Location]()
    for key, value in values.items():
        location = place_key(tree, defaults, key)
        top_key = str(location[0])
        if top_key not in SceneEntry.model_fields or top_key in _NO_FIELD:
            known = [name for name in SceneEntry.model_fields if name not in _NO_FIELD]
            raise ArgumentError(key, f"is not a key of a scene; {names_in_words(top_key, known)}")
        tree = with_value_at(tree, location, plain(value))
        changed_keys.add(top_key)
        if value is not None:
            stated.add(location)
    for location in stated:
        tree = _without_alternatives(tree, location, stated)
    source, parts = YamlSource(path, tree, SCENE), SceneParts()
    entry = parts.validated(source)
    if "hand" not in changed_keys and scene.hand is not None:
        # An unchanged hand is not read again.
        parts.latest.put("hand", (entry.hand,), StageResult(scene.hand))
    with capture():
        built = build_scene(SceneFields, source, parts)
    names = [name for key in changed_keys for name in FIELDS_OF_KEYS.get(key, (key,))]
    new_fields = {name: getattr(built, name) for name in names}
    return scene._with_fields(new_fields | {"load_findings": built.load_findings})
