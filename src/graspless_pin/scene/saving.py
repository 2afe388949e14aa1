"""Save a scene as YAML that loads to the same problem, with the comments of its original file.

The original file is read again and edited where it differs: ``data`` is its content, ``meant`` the
scene that it loads to and ``wanted`` the scene to save, both in the form of `scene_entry`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from graspless_pin.atomic_write import draft_of, make_folder_of
from graspless_pin.errors import SceneError
from graspless_pin.findings import capture
from graspless_pin.geometry.bodies.shape import Compound
from graspless_pin.geometry.bodies.shapes import SHAPES
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.robots.files import find_robot
from graspless_pin.intake.files import is_file, read_text
from graspless_pin.intake.yaml_source import Location, YamlSource, key_text, validated
from graspless_pin.intake.yaml_text import edited_yaml, yaml_of
from graspless_pin.problem.checks import truth_values
from graspless_pin.scene.fields import AnyScene, SceneFields, label_of
from graspless_pin.scene.load import build_scene
from graspless_pin.scene.scene_schema import SCENE, SceneEntry
from graspless_pin.scene.serialization import hand_entry, robot_key, rotation_entry, scene_entry
from graspless_pin.scene.units import merged_angles, parted_angles

_SAME_NUMBER = 1e-11
_POSE = {"position", "matrix"}
_WHOLE = ("materials", "inertia", "points")
_MAY_BE_EMPTY = ("materials", "supports", "tangent_axes", "loads")
_WITH_PATHS = ("hand", "object", "supports")
PathText = Callable[[Path], str]


def write_scene_file(target: Path, make: Callable[[Path], str], *, overwrite: bool) -> Path:
    """Write a scene file and return its path.

    Args:
        target: The file.
        make: Returns its text; called after the other checks.
        overwrite: Whether a file of that name may be replaced.

    Raises:
        SceneError: If the name has another suffix than a scene file, or the file exists already or
            cannot be written.
        ArgumentError: If ``overwrite`` is neither True nor False.
    """
    truth_values(overwrite=overwrite)
    if target.suffix.lower() not in (".yaml", ".yml"):
        raise SceneError(f"{target}: the name of a scene file must end in .yaml or .yml")
    if os.path.lexists(target) and not overwrite:
        raise SceneError(f"{target}: exists already; choose another name, or give overwrite=True")
    with _write_errors_for(target):
        make_folder_of(target)  # paths in the text are relative to it
    text = make(target)
    with _write_errors_for(target), draft_of(target) as draft:
        draft.write_text(text, encoding="utf-8", newline="")
    return target


@contextmanager
def _write_errors_for(target: Path) -> Iterator[None]:
    """Convert an `OSError` in the block to an error that names the file."""
    try:
        yield
    except OSError as error:
        raise SceneError(
            f"{target}: cannot be written ({error.strerror}); choose another place"
        ) from error


def scene_text(scene: SceneFields, target: Path) -> str:
    """Return the text of the file that `Scene.save` writes.

    Args:
        scene: The scene.
        target: The file: paths in it are relative to its folder.

    Raises:
        SceneError: If the scene cannot be expressed by a scene file, or its original file is
            invalid by now.
    """
    return _text_and_scene(scene, target)[0]


def scene_as_written(scene: AnyScene) -> AnyScene:
    """Return a scene with hand and object as they are after saving and loading, to the last bit.

    A difference in the last bit may change the result of a search that ends at a limit. With this
    scene, results hold for the saved file, too.

    Raises:
        SceneError: As of `scene_text`.
    """
    with capture():
        reloaded = _text_and_scene(scene, scene.path or Path("scene.yaml"))[1]
    return scene.with_changes(hand=reloaded.hand, object=reloaded.object)


def scene_data(scene: SceneFields) -> dict[str, Any]:
    """Return the content of a file of a scene, in the folder of its original file.

    Raises:
        SceneError: If the original file is invalid by now.
    """
    target = scene.path or Path(scene.name)
    return _file_data(scene, target, scene_entry(scene, path_writer(target)))[0]


def _file_data(
    scene: SceneFields, target: Path, wanted: dict[str, Any]
) -> tuple[dict[str, Any], bool]:
    """Return the content of a scene's file, and whether it is based on the original file.

    Args:
        scene: The scene.
        target: The file: paths in it are relative to its folder.
        wanted: What `scene_entry` returns for the scene.
    """
    _check_expressible(scene)
    path_text = path_writer(target)
    if scene.path is not None and is_file(scene.path):
        source = YamlSource.read(scene.path, SCENE)
        meant = scene_entry(build_scene(SceneFields, source), path_text)
        return _updated_data(_with_moved_paths(source, path_text), meant, wanted, scene), True
    data = _updated_data({}, {"hand": None}, wanted, scene)
    if scene.name == target.stem:
        del data["name"]
    entry = validated(YamlSource(target, data, SCENE), SceneEntry)
    return entry.model_dump(mode="json", exclude_defaults=True), False


def _check_expressible(scene: SceneFields) -> None:
    """Refuse shapes and robots that a scene file cannot express.

    Raises:
        SceneError: Naming the first of them.
    """
    for key, body in (("object", scene.object), *(("supports", one) for one in scene.supports)):
        shape = body.shape
        solids = shape.parts if isinstance(shape, Compound) else (shape,)
        unknown_kinds = [one.kind for one in solids if type(one) not in SHAPES.values()]
        inside = "" if solids == (shape,) else " in a compound"
        if unknown_kinds:
            raise SceneError(
                f"{label_of(scene)}: {key}: {body.name!r} has a shape of the kind "
                f"{unknown_kinds[0]!r}, which scene files do not support{inside}; "
                f"use one of {', '.join(SHAPES)}, or write an MJCF (scene_to_mjcf)"
            )
    for mount in () if scene.hand is None else scene.hand.mounts:
        if find_robot(mount.source).read is not None:
            raise SceneError(
                f"{label_of(scene)}: hand: was not read from a file; read the scene from the path "
                "of its MJCF"
            )


def _text_and_scene(scene: SceneFields, target: Path) -> tuple[str, SceneFields]:
    """Return the text of a scene file, and the scene that it loads to."""
    path_text = path_writer(target)
    data, has_file = _file_data(scene, target, scene_entry(scene, path_text))
    if has_file and scene.path is not None:
        text = edited_yaml(read_text(scene.path, SCENE), data)
    else:
        text = yaml_of(data)
    return text, _reloaded(text, target, scene, path_text)


def path_writer(target: Path) -> PathText:
    """Return a function that writes paths relative to a file's folder."""

    def path_text(path: Path) -> str:
        file = path.parent.resolve() / path.name
        try:
            return Path(os.path.relpath(file, target.parent.resolve())).as_posix()
        except ValueError:  # on another drive
            return str(file)

    return path_text


def _updated_data(data: Any, meant: Any, wanted: Any, scene: SceneFields) -> dict[str, Any]:
    """Return the content of a file edited so that it means the wanted scene."""
    if scene.hand is not None:
        hand = _updated_hand(data.get("hand"), meant["hand"], wanted["hand"], scene.hand)
        data = data | {"hand": hand}
        meant = meant | {"hand": wanted["hand"]}
    return _updated_part(data, meant, wanted)


def _updated_hand(data: Any, meant: Any, wanted: Any, hand: Hand) -> Any:
    if meant is None or _mounts_without_poses(meant) != _mounts_without_poses(wanted):
        with capture():  # of limits that the scene replaces
            assembled = hand_entry(Hand.assemble(hand.mounts), str)
        defaults = {"hybrid_force_limit": None, "material": None, "count_own_weight": True}
        meant = {"mounts": wanted["mounts"], **assembled, **defaults}
        mounts = [_as_new_data(mount) for mount in wanted["mounts"]]
        data = mounts[0] if len(mounts) == 1 and not mounts[0]["prefix"] else {"mounts": mounts}
        if data is mounts[0]:
            del data["prefix"]
    meant_own, wanted_own = (
        {name: one[name] for name in one if name != "mounts"} for one in (meant, wanted)
    )
    pairs = [*zip(meant["mounts"], wanted["mounts"], strict=True)]
    if "mounts" in data:
        each = zip(data["mounts"], pairs, strict=True)
        data = data | {"mounts": [_updated_part(updated, *pair) for updated, pair in each]}
    else:
        data = _updated_part(data, *pairs[0])
    degrees = data.get("q_deg")
    if not degrees:
        return _updated_part(data, meant_own, wanted_own)
    merged = data | {"q": merged_angles(data.get("q"), degrees)}
    updated = _updated_part(merged, meant_own, wanted_own)
    q, q_deg = parted_angles(updated["q"], degrees)
    updated |= {"q": q, "q_deg": q_deg}
    return {name: updated[name] for name in updated if name != "q" or q or "q" in data}


def _mounts_without_poses(stated: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {name: value for name, value in mount.items() if name != "base_pose"}
        for mount in stated["mounts"]
    ]


def _updated_part(data: Any, meant: Any, wanted: Any, key: str = "") -> Any:
    """Return a part of the content edited so that it means the wanted part."""
    if meant == wanted:
        return data
    if key not in _WHOLE and all(isinstance(one, list) for one in (data, meant, wanted)):
        return _updated_items(data, meant, wanted)
    maps = isinstance(meant, dict) and isinstance(wanted, dict) and isinstance(data, dict | None)
    if key in _WHOLE or not maps:
        return _as_new_data(wanted, key)
    updated = dict(data or {})
    if wanted.keys() == _POSE:
        return _updated_pose(updated, meant, wanted)
    if key == "shape" and meant["type"] != wanted["type"]:
        return _as_new_data(wanted)
    for name in {**meant, **wanted}:
        value = wanted.get(name)
        if value is None or (not value and name in _MAY_BE_EMPTY):
            updated.pop(name, None)
        elif name not in meant or meant[name] != value:
            updated[name] = _updated_part(updated.get(name), meant.get(name), value, name)
    if key == "q":  # without joints that follow a moved one
        updated = {name: value for name, value in updated.items() if name in wanted}
    if key == "object":
        reshaped = meant["shape"] != wanted["shape"]
        if reshaped or meant["mass"] != wanted["mass"]:
            updated.pop("density", None)
            updated["mass"] = wanted["mass"]
        if reshaped:  # as the centroid changes
            updated["center_of_mass"] = wanted["center_of_mass"]
    return updated


def _updated_items(data: list[Any], meant: list[Any], wanted: list[Any]) -> list[Any]:
    """Return a list of the content edited; items are matched by name, else by index."""
    index_of = {_item_name(item, index): index for index, item in enumerate(meant)}
    updated = []
    for index, item in enumerate(wanted):
        old = index_of.get(_item_name(item, index))
        updated.append(
            _as_new_data(item) if old is None else _updated_part(data[old], meant[old], item)
        )
    return updated


def _item_name(item: Any, index: int) -> Any:
    return item.get("name", index) if isinstance(item, dict) else index


def _updated_pose(updated: dict[str, Any], meant: dict[str, Any], wanted: dict[str, Any]) -> Any:
    if meant["position"] != wanted["position"]:
        updated["position"] = wanted["position"]
    if meant["matrix"] != wanted["matrix"]:
        forms = [name for name, value in updated.items() if name != "position" and value]
        position = {name: value for name, value in updated.items() if name == "position"}
        updated = position | rotation_entry(wanted["matrix"], *forms)
    return updated


def _as_new_data(wanted: Any, key: str = "") -> Any:
    """Return wanted data in the form for a new file: without None, rotations in short form."""
    if isinstance(wanted, list):
        return [_as_new_data(item) for item in wanted]
    if not isinstance(wanted, dict):
        return wanted
    if wanted.keys() == _POSE:
        return {"position": wanted["position"], **rotation_entry(wanted["matrix"])}
    if key == "friction" and wanted.keys() == {"default"}:
        return wanted["default"]
    return {name: _as_new_data(value, name) for name, value in wanted.items() if value is not None}


def _with_moved_paths(source: YamlSource, path_text: PathText) -> Any:
    """Return the content of a file with its relative paths rewritten for the new file."""

    def moved_path(text: Any) -> Any:
        if isinstance(text, list):
            return [moved_path(item) for item in text]
        return text if Path(text).is_absolute() else path_text(source.file(text))

    def moved_part(data: Any) -> Any:
        if isinstance(data, list):
            return [moved_part(item) for item in data]
        if not isinstance(data, dict):
            return data
        return {
            name: moved_path(data[name]) if _is_path_key(name, data) else moved_part(data[name])
            for name in data
        }

    parts = {name: moved_part(source.data[name]) for name in _WITH_PATHS if name in source.data}
    return {**source.data, **parts}


def _is_path_key(name: str, data: dict[str, Any]) -> bool:
    robot_file = name == "robot" and data[name].endswith((".yaml", ".yml"))
    return (
        robot_file
        or name in ("urdf", "srdf", "package_dirs")
        or (name == "path" and "type" in data)
    )


def _reloaded(text: str, target: Path, scene: SceneFields, path_text: PathText) -> SceneFields:
    """Return the scene that a text loads to; refuse a text that loads to another scene.

    Raises:
        SceneError: If it does: parts made in Python may not be expressible in a scene file.
    """
    loaded = build_scene(SceneFields, YamlSource.parsed(target, text, SCENE))
    place = _first_difference(scene_entry(loaded, path_text), scene_entry(scene, path_text), ())
    hands = [one.hand for one in (loaded, scene) if one.hand is not None]
    robots = [[robot_key(mount) for mount in hand.mounts] for hand in hands]
    if place is None and robots and robots[0] != robots[-1]:
        place = ("hand",)
    if place is not None and place != ("name",):
        raise SceneError(
            f"{target}: {key_text(place)}: a scene file cannot express the value of this scene; if "
            "a robot was changed in Python, write a robot file with the change, and mount that"
        )
    return loaded


def _first_difference(data: Any, other: Any, location: Location) -> Location | None:
    if isinstance(data, dict) and isinstance(other, dict) and data.keys() == other.keys():
        pairs = [((*location, name), data[name], other[name]) for name in data]
    elif isinstance(data, list) and isinstance(other, list) and len(data) == len(other):
        pairs = [
            ((*location, index), *pair) for index, pair in enumerate(zip(data, other, strict=True))
        ]
    elif isinstance(data, float) and isinstance(other, int | float):
        is_same = data == other or abs(data - other) <= _SAME_NUMBER * max(1.0, abs(other))
        return None if is_same else location
    else:
        return None if data == other else location
    differences = (_first_difference(first, second, below) for below, first, second in pairs)
    return next((below for below in differences if below is not None), None)
