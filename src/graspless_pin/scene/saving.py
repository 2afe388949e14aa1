"""Save a scene as YAML that loads to the same problem, with the comments of the file it came from.

That file is loaded as it is now, and changed only where it says something else than the scene is.
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
from graspless_pin.scene.serialization import described, stated_hand, stated_rotation, stated_scene
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
        make: Returns its text; called when nothing else speaks against it.
        overwrite: Whether a file of that name may be replaced.

    Raises:
        SceneError: If the name is not one of a scene file, or the file is there already or cannot
            be written.
        ArgumentError: If ``overwrite`` is neither True nor False.
    """
    truth_values(overwrite=overwrite)
    if target.suffix.lower() not in (".yaml", ".yml"):
        raise SceneError(f"{target}: a scene file ends in .yaml or .yml; choose such a name")
    if os.path.lexists(target) and not overwrite:
        raise SceneError(f"{target}: is there already; choose another name, or give overwrite=True")
    with _write_errors_of(target):
        make_folder_of(target)  # paths in the text are relative to it
    text = make(target)
    with _write_errors_of(target), draft_of(target) as draft:
        draft.write_text(text, encoding="utf-8", newline="")
    return target


@contextmanager
def _write_errors_of(target: Path) -> Iterator[None]:
    """Say which file cannot be written."""
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
        SceneError: If no scene file can say what the scene is, or the one that it came from is no
            scene any more.
    """
    return _written(scene, target)[0]


def scene_as_written(scene: AnyScene) -> AnyScene:
    """Return a scene whose hand and object are to the last bit where a file of it puts them.

    A search that ends at a limit may end otherwise after a difference in the last bit: what is
    said of the one scene then holds for the other.

    Raises:
        SceneError: As of `scene_text`.
    """
    with capture():
        again = _written(scene, scene.path or Path("scene.yaml"))[1]
    return scene.with_changes(hand=again.hand, object=again.object)


def scene_data(scene: SceneFields) -> dict[str, Any]:
    """Return what a file says that a scene could come from, beside the one that it came from.

    Raises:
        SceneError: If the file that it came from is no scene any more.
    """
    target = scene.path or Path(scene.name)
    return _data_for(scene, target, stated_scene(scene, paths_beside(target)))[0]


def _data_for(
    scene: SceneFields, target: Path, wanted: dict[str, Any]
) -> tuple[dict[str, Any], bool]:
    """Return what the file of a scene says, and whether that changes the file it came from.

    Args:
        scene: The scene.
        target: The file: paths in it are relative to its folder.
        wanted: What `stated_scene` returns.
    """
    _check_sayable(scene)
    path_text = paths_beside(target)
    if scene.path is not None and is_file(scene.path):
        source = YamlSource.read(scene.path, SCENE)
        meant = stated_scene(build_scene(SceneFields, source), path_text)
        return _updated(_rebased(source, path_text), meant, wanted, scene), True
    data = _updated({}, {"hand": None}, wanted, scene)
    if scene.name == target.stem:
        del data["name"]
    entry = validated(YamlSource(target, data, SCENE), SceneEntry)
    return entry.model_dump(mode="json", exclude_defaults=True), False


def _check_sayable(scene: SceneFields) -> None:
    """Refuse what has no words in a scene file.

    Raises:
        SceneError: If there is something.
    """
    for key, body in (("object", scene.object), *(("supports", one) for one in scene.supports)):
        shape = body.shape
        solids = shape.parts if isinstance(shape, Compound) else (shape,)
        unsupported = [one.kind for one in solids if type(one) not in SHAPES.values()]
        inside = "" if solids == (shape,) else " in a compound"
        if unsupported:
            raise SceneError(
                f"{label_of(scene)}: {key}: {body.name!r} has a shape of the kind "
                f"{unsupported[0]!r}, which no scene file has{inside}; "
                f"use one of {', '.join(SHAPES)}, or write an MJCF (scene_to_mjcf)"
            )
    for mount in () if scene.hand is None else scene.hand.mounts:
        if find_robot(mount.source).read is not None:
            raise SceneError(
                f"{label_of(scene)}: hand: comes from no file; read the scene from the path of its "
                "MJCF"
            )


def _written(scene: SceneFields, target: Path) -> tuple[str, SceneFields]:
    """Return the text of a scene file, and what it loads to."""
    path_text = paths_beside(target)
    data, has_file = _data_for(scene, target, stated_scene(scene, path_text))
    if has_file and scene.path is not None:
        text = edited_yaml(read_text(scene.path, SCENE), data)
    else:
        text = yaml_of(data)
    return text, _checked(text, target, scene, path_text)


def paths_beside(target: Path) -> PathText:
    """Return how a file names others: relative to its folder."""

    def path_text(path: Path) -> str:
        file = path.parent.resolve() / path.name
        try:
            return Path(os.path.relpath(file, target.parent.resolve())).as_posix()
        except ValueError:  # on another drive
            return str(file)

    return path_text


def _updated(data: Any, meant: Any, wanted: Any, scene: SceneFields) -> dict[str, Any]:
    """Return what a file has to say to mean what is wanted, given what it says and that means."""
    if scene.hand is not None:
        hand = _updated_hand(data.get("hand"), meant["hand"], wanted["hand"], scene.hand)
        data = data | {"hand": hand}
        meant = meant | {"hand": wanted["hand"]}
    return _updated_part(data, meant, wanted)


def _updated_hand(data: Any, meant: Any, wanted: Any, hand: Hand) -> Any:
    if meant is None or _robots(meant) != _robots(wanted):
        with capture():  # of limits that the scene replaces
            alone = stated_hand(Hand.assemble(hand.mounts), str)
        own = {"hybrid_force_limit": None, "material": None, "count_own_weight": True}
        meant = {"mounts": wanted["mounts"], **alone, **own}
        mounts = [_plainly(mount) for mount in wanted["mounts"]]
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


def _robots(stated: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {name: value for name, value in mount.items() if name != "base_pose"}
        for mount in stated["mounts"]
    ]


def _updated_part(data: Any, meant: Any, wanted: Any, key: str = "") -> Any:
    """Return what a part of a file has to say: see `_updated`."""
    if meant == wanted:
        return data
    if key not in _WHOLE and all(isinstance(one, list) for one in (data, meant, wanted)):
        return _updated_items(data, meant, wanted)
    maps = isinstance(meant, dict) and isinstance(wanted, dict) and isinstance(data, dict | None)
    if key in _WHOLE or not maps:
        return _plainly(wanted, key)
    updated = dict(data or {})
    if wanted.keys() == _POSE:
        return _updated_pose(updated, meant, wanted)
    if key == "shape" and meant["type"] != wanted["type"]:
        return _plainly(wanted)
    for name in {**meant, **wanted}:
        value = wanted.get(name)
        if value is None or (not value and name in _MAY_BE_EMPTY):
            updated.pop(name, None)
        elif name not in meant or meant[name] != value:
            updated[name] = _updated_part(updated.get(name), meant.get(name), value, name)
    if key == "q":  # not what follows a joint that has moved
        updated = {name: value for name, value in updated.items() if name in wanted}
    if key == "object":
        reshaped = meant["shape"] != wanted["shape"]
        if reshaped or meant["mass"] != wanted["mass"]:
            updated.pop("density", None)
            updated["mass"] = wanted["mass"]
        if reshaped:  # the centroid has moved
            updated["center_of_mass"] = wanted["center_of_mass"]
    return updated


def _updated_items(data: list[Any], meant: list[Any], wanted: list[Any]) -> list[Any]:
    """Return what a list of a file has to say; supports are told by their names."""
    known = {_name(item, index): index for index, item in enumerate(meant)}
    updated = []
    for index, item in enumerate(wanted):
        old = known.get(_name(item, index))
        updated.append(
            _plainly(item) if old is None else _updated_part(data[old], meant[old], item)
        )
    return updated


def _name(item: Any, index: int) -> Any:
    return item.get("name", index) if isinstance(item, dict) else index


def _updated_pose(updated: dict[str, Any], meant: dict[str, Any], wanted: dict[str, Any]) -> Any:
    if meant["position"] != wanted["position"]:
        updated["position"] = wanted["position"]
    if meant["matrix"] != wanted["matrix"]:
        forms = [name for name, value in updated.items() if name != "position" and value]
        kept = {name: value for name, value in updated.items() if name == "position"}
        updated = kept | stated_rotation(wanted["matrix"], *forms)
    return updated


def _plainly(wanted: Any, key: str = "") -> Any:
    """Return what is wanted as a file says it that says nothing yet."""
    if isinstance(wanted, list):
        return [_plainly(item) for item in wanted]
    if not isinstance(wanted, dict):
        return wanted
    if wanted.keys() == _POSE:
        return {"position": wanted["position"], **stated_rotation(wanted["matrix"])}
    if key == "friction" and wanted.keys() == {"default"}:
        return wanted["default"]
    return {name: _plainly(value, name) for name, value in wanted.items() if value is not None}


def _rebased(source: YamlSource, path_text: PathText) -> Any:
    """Return what a file says with its relative paths as the new file says them."""

    def moved(text: Any) -> Any:
        if isinstance(text, list):
            return [moved(item) for item in text]
        return text if Path(text).is_absolute() else path_text(source.file(text))

    def walked(data: Any) -> Any:
        if isinstance(data, list):
            return [walked(item) for item in data]
        if not isinstance(data, dict):
            return data
        return {
            name: moved(data[name]) if _is_path(name, data) else walked(data[name]) for name in data
        }

    parts = {name: walked(source.data[name]) for name in _WITH_PATHS if name in source.data}
    return {**source.data, **parts}


def _is_path(name: str, data: dict[str, Any]) -> bool:
    robot_file = name == "robot" and data[name].endswith((".yaml", ".yml"))
    return (
        robot_file
        or name in ("urdf", "srdf", "package_dirs")
        or (name == "path" and "type" in data)
    )


def _checked(text: str, target: Path, scene: SceneFields, path_text: PathText) -> SceneFields:
    """Return what a text loads to; refuse one that loads to another scene.

    Raises:
        SceneError: If it does: a scene may hold what was made in Python in a way of its own.
    """
    again = build_scene(SceneFields, YamlSource.parsed(target, text, SCENE))
    place = _first_difference(stated_scene(again, path_text), stated_scene(scene, path_text), ())
    hands = [one.hand for one in (again, scene) if one.hand is not None]
    robots = [[described(mount) for mount in hand.mounts] for hand in hands]
    if place is None and robots and robots[0] != robots[-1]:
        place = ("hand",)
    if place is not None and place != ("name",):
        raise SceneError(
            f"{target}: {key_text(place)}: no scene file leads to what this scene has there; if a "
            "robot was changed in Python, write a robot file that says so, and mount that"
        )
    return again


def _first_difference(one: Any, other: Any, place: Location) -> Location | None:
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        pairs = [((*place, name), one[name], other[name]) for name in one]
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        pairs = [
            ((*place, index), *pair) for index, pair in enumerate(zip(one, other, strict=True))
        ]
    elif isinstance(one, float) and isinstance(other, int | float):
        same = one == other or abs(one - other) <= _SAME_NUMBER * max(1.0, abs(other))
        return None if same else place
    else:
        return None if one == other else place
    found = (_first_difference(first, second, inner) for inner, first, second in pairs)
    return next((inner for inner in found if inner is not None), None)
