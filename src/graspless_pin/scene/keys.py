"""Keys of a scene file by dotted path, such as ``object.mass``: where they stand, and their values.

How a scene changes where some keys of its file say something else.
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
"""Mappings whose keys are names, which may hold dots."""
_ZERO = (
    "position", "rpy", "linear", "angular", "angular_velocity", "force", "moment", "field", "at",
)  # fmt: skip
_RADIANS = "in rad, or in a study with unit: deg"


def place_key(tree: Tree, defaults: Tree, key: str) -> Location:
    """Find where a dotted key stands, and put what is left out above it into the tree.

    Items of lists go by index, or by their ``name`` or ``prefix``.

    Args:
        tree: The scene; changed.
        defaults: The scene with every default written out.
        key: E.g. ``object.mass`` or ``supports.slope.pose.rpy.1``.

    Raises:
        ArgumentError: If the path does not lead through the scene.
    """
    parts = key.split(".")
    for name in IN_DEGREES.keys() & parts:
        raise ArgumentError(key, f"name {IN_DEGREES[name]} instead: {_RADIANS}")
    location: Location = ()
    node: Any = tree
    while parts:
        name, count = _next(node, location, parts, key)
        location = (*location, name)
        parts = parts[count:]
        if parts:
            node = _entered(node, defaults, location, key)
    return location


def _next(node: Any, location: Location, parts: list[str], key: str) -> tuple[str | int, int]:
    """Return the next step of a path, and how many of its parts it takes."""
    if isinstance(node, list):
        return _item(node, parts[0], key), 1
    for count in range(len(parts), 0, -1):
        name = ".".join(parts[:count])
        if name in node:
            return name, count
    if location and location[-1] in _BY_NAME:
        return ".".join(parts), len(parts)
    return parts[0], 1


def _item(items: list[Any], name: str, key: str) -> int:
    if re.fullmatch("-?[0-9]+", name):
        if 0 <= int(name) < len(items):
            return int(name)
        raise ArgumentError(key, f"has no item {name}; it has {len(items)}, counted from 0")
    names = [
        str(item.get("name", item.get("prefix", ""))) if isinstance(item, dict) else ""
        for item in items
    ]
    if names.count(name) == 1:
        return names.index(name)
    known = [*filter(None, names)]
    words = names_in_words(name, known) if known else "known: none, so give an index"
    words = words if items else "it is empty"
    raise ArgumentError(key, f"has no item called {name!r}; {words}")


def _entered(node: Any, defaults: Tree, location: Location, key: str) -> Any:
    """Return the part of the tree at a location; put there from the defaults if it is left out."""
    name: Any = location[-1]
    inner = _inside(node, name)
    if inner is None or (name == "friction" and not isinstance(inner, dict)):
        inner = _default(defaults, location) if inner is None else {"default": inner}
        node[name] = inner
    if not isinstance(inner, dict | list):
        above = ".".join(map(str, location))
        raise ArgumentError(key, f"{above} is {inner!r} and has no keys below it")
    return inner


def _default(defaults: Any, location: Location) -> Any:
    node = defaults
    for part in location:
        node = _inside(node, part)
    if isinstance(node, list | tuple):
        return list(node)
    return [0.0, 0.0, 0.0] if location[-1] in _ZERO else {}


def _inside(node: Any, part: Any) -> Any:
    """Return what stands at a key or index, None if nothing does."""
    try:
        return node[part]
    except (KeyError, IndexError, TypeError):
        return None


def copied(data: Any) -> Any:
    """Return a copy in which nothing is shared, not even what YAML anchors repeat."""
    if isinstance(data, dict):
        return {key: copied(item) for key, item in data.items()}
    return [copied(item) for item in data] if isinstance(data, list) else data


def put(tree: Any, location: Location, value: Any) -> Any:
    """Return a tree with a value at a location; the rest is shared."""
    first, *rest = location
    changed = tree.copy()
    changed[first] = put(tree[first], tuple(rest), value) if rest else value
    return changed


def _without_others(tree: Any, location: Location, kept: set[Location]) -> Any:
    """Return a tree without what may not stand beside a key, but for what is to be kept."""
    *above, name = location
    node: Any = tree
    for part in above:
        node = node[part]
    for other in (one for names in _EITHER if name in names for one in names if one != name):
        if other in node and (*above, other) not in kept:
            tree = put(tree, (*above, other), None)
    return tree


_EITHER = ("mass", "density"), ("rpy", "quaternion", "matrix")
"""Keys of which one may stand: the one that is given says what the others said before."""
_NO_FIELD = ("description", "warnings")


def scene_with_keys(scene: AnyScene, values: Mapping[str, Any]) -> AnyScene:
    """Return a scene whose file would say something else.

    Args:
        scene: The scene.
        values: By dotted key, as the file has them: numbers in SI units, bodies as mappings.

    Raises:
        ArgumentError: If a key leads nowhere.
        SceneError: If the file could not say so.
    """
    tree = in_radians(scene_data(scene))
    path = scene.path or Path(scene.name)
    defaults = validated(YamlSource(path, tree, SCENE), SceneEntry).model_dump()
    changed, stated = set(), set[Location]()
    for key, value in values.items():
        location = place_key(tree, defaults, key)
        first = str(location[0])
        if first not in SceneEntry.model_fields or first in _NO_FIELD:
            known = [name for name in SceneEntry.model_fields if name not in _NO_FIELD]
            raise ArgumentError(key, f"is no key of a scene; {names_in_words(first, known)}")
        tree = put(tree, location, plain(value))
        changed.add(first)
        if value is not None:
            stated.add(location)
    for location in stated:
        tree = _without_others(tree, location, stated)
    source, parts = YamlSource(path, tree, SCENE), SceneParts()
    entry = parts.validated(source)
    if "hand" not in changed and scene.hand is not None:
        # Nothing of it has changed: it is not read again.
        parts.latest.put("hand", (entry.hand,), StageResult(scene.hand))
    with capture():
        new = build_scene(SceneFields, source, parts)
    names = [name for key in changed for name in FIELDS_OF_KEYS.get(key, (key,))]
    found = {name: getattr(new, name) for name in names}
    return scene._changed(found | {"load_findings": new.load_findings})
