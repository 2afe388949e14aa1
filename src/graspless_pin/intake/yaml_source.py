"""A YAML file of a user: plain data with line numbers, checked against a schema.

Errors name file, line and key, the value found and the values allowed.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from graspless_pin.caching import is_alike
from graspless_pin.errors import ArgumentError, GrasplessPinError, SceneError
from graspless_pin.findings import Finding
from graspless_pin.intake.files import (
    FileKind,
    errors_of_text,
    kind_of_data,
    read_text,
    refuse_other_kind,
)
from graspless_pin.intake.yaml_text import Location, parse_yaml
from graspless_pin.suggestions import names_in_words, nearest_name, what_to_pass

_NEEDED = {
    "scene": "a scene needs object and friction",
    "study": "a study needs scene and vary",
    "robot file": "a robot file needs name, and urdf or model",
}
FIGURE = re.compile(
    r"\s*(?:±|\+/?-)?\s*"
    r"([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)\s*([A-Za-zµ°%][^\s]*(?: [^\s]+)?)?\s*"
)
"""A number, perhaps with its unit."""


@dataclass(frozen=True, eq=False)
class YamlSource:
    """A parsed YAML file with the line of each key.

    Attributes:
        path: The file; for content that was made in Python, its name in messages.
        data: Its content as plain Python data.
        kind: What it describes.
        lines: Line of each key; empty for content that was made in Python.
    """

    path: Path
    data: Any
    kind: FileKind
    lines: Mapping[Location, int] = field(default_factory=dict)

    @classmethod
    def read(cls, path: str | PathLike[str], kind: FileKind) -> YamlSource:
        """Read and parse a file.

        Args:
            path: The file.
            kind: What the file describes.

        Raises:
            GrasplessPinError: The kind's error, if the file is missing, empty, too large or no
                regular file, is not UTF-8 text or not plain YAML.
            ArgumentError: If it is no path.
        """
        if not isinstance(path, str | PathLike):
            raise ArgumentError("path", what_to_pass("path", path, f"path of a {kind.name} file"))
        return cls.parsed(Path(path), read_text(Path(path), kind), kind)

    @classmethod
    def parsed(cls, path: Path, text: str, kind: FileKind) -> YamlSource:
        """Parse the text of a file; arguments and errors as of `read`."""
        with errors_of_text(path, kind):
            parsed = parse_yaml(text)
        if not parsed.lines:
            raise kind.error(f"{path}: the file is empty; {_NEEDED[kind.name]}")
        refuse_other_kind(path, kind, kind_of_data(parsed.data))
        return cls(path, parsed.data, kind, parsed.lines)

    def where(self, location: Location) -> str:
        """Return ``file:line`` of a key, or of the nearest key above it that the file has.

        Content that came from no file has its name alone.
        """
        if not self.lines:
            return str(self.path)
        above = (location[:length] for length in range(len(location), -1, -1))
        return f"{self.path}:{next((self.lines[key] for key in above if key in self.lines), 1)}"

    def with_place(self, finding: Finding) -> Finding:
        """Return a finding with its place (file, line and key) filled in, if it has a key."""
        if not finding.key or finding.place:
            return finding
        return replace(finding, place=f"{self.where(finding.key)}: {key_text(finding.key)}")

    def message(self, location: Location, message: str) -> str:
        """Return a message that names the file, the line and the key."""
        key = key_text(location) if location else self.kind.name
        return f"{self.where(location)}: {key}: {message}"

    def error(self, location: Location, message: str) -> GrasplessPinError:
        """Return the error for a part of the file."""
        return self.kind.error(self.message(location, message))

    @contextmanager
    def errors_at(self, location: Location, also: Location = ()) -> Iterator[None]:
        """Convert errors in the block to errors that name a part of the file.

        Args:
            location: The part.
            also: Keys below it to name, too, where the error is not about an argument.
        """
        try:
            yield
        except SceneError:
            raise
        except ArgumentError as error:
            first, *rest = _keys_of(error.argument) or ("",)
            named = [(*location, name, *rest) for name in (first, f"{first}_deg")]
            inner = next((key for key in named if key in self.lines), None)
            if inner is not None:
                raise self.error(inner, error.message) from error
            raise self.error(location, str(error)) from error
        except GrasplessPinError as error:
            raise self.error((*location, *also), str(error)) from error
        except OSError as error:
            message = f"its file cannot be read ({error})"
            raise self.error((*location, *also), message) from error

    def file(self, text: str) -> Path:
        """Return the path of a file name in the file, which is relative to the file's folder."""
        return self.path.resolve().parent / text


def key_text(location: Location) -> str:
    """Return a location as a dotted key, e.g. ``supports[0].name``."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        elif "." in part:
            text += f"[{part!r}]"
        else:
            text += f".{part}" if text else part
    return text or "scene"


def _keys_of(argument: str) -> Location:
    """Split an argument's name such as ``supports[0].q['joint_1.0']`` into keys of the file."""
    return tuple(
        quoted or plain or int(index)
        for quoted, index, plain in re.findall(r"\['(.*?)'\]|\[(\d+)\]|([^.\[\]]+)", argument)
    )


_MOST_EXAMINED = 60
_MOST_LISTED = 5
_UNKNOWN_KEY = "unknown key"
_Entry = TypeVar("_Entry", bound=BaseModel)
Node = dict[str, Any]
"""A part of the JSON schema."""


def validated(source: YamlSource, model: type[_Entry]) -> _Entry:
    """Return the content of a file, validated by its schema.

    Raises:
        GrasplessPinError: The error of the file's kind, with a line for each mistake: file:line,
            key, the value found, the values allowed.
    """
    try:
        return model.model_validate(source.data)
    except ValidationError as error:
        mistakes = list(_mistakes(source.data, error, model, source.kind))
        # Misspelt keys come before keys that are missing because of them.
        mistakes.sort(key=lambda mistake: not mistake[1].startswith(_UNKNOWN_KEY))
        lines = [*dict.fromkeys(source.message(*mistake) for mistake in mistakes)]
        unlisted = len(lines) - _MOST_LISTED + max(0, error.error_count() - _MOST_EXAMINED)
        remainder = [f"... and {unlisted} more mistakes"] if unlisted > 0 else []
        raise source.kind.error("\n".join([*lines[:_MOST_LISTED], *remainder])) from None


def reused_entry(entry: Any, data: Any, earlier: Any, earlier_data: Any) -> Any:
    """Return an entry with unchanged parts replaced by the same objects of an earlier entry.

    Args:
        entry: The entry, or a part of it.
        data: The file's data for it.
        earlier: The earlier entry.
        earlier_data: The file's data for the earlier entry.
    """
    if is_alike(data, earlier_data):
        return earlier
    kind = type(entry)
    if isinstance(entry, BaseModel) and kind is type(earlier):
        before = vars(earlier)
        parts = {
            name: reused_entry(part, data.get(name), before[name], earlier_data.get(name))
            for name, part in vars(entry).items()
        }
        return kind.model_construct(entry.model_fields_set, **parts)
    if isinstance(entry, list) and isinstance(earlier, list) and len(entry) == len(earlier):
        return [*map(reused_entry, entry, data, earlier, earlier_data)]
    return entry


def checked_key(
    kind: FileKind, model: type[BaseModel], minimal_data: Node, name: str, value: Any
) -> Any:
    """Return the value of one key, validated by the schema of a file.

    Args:
        kind: The kind of file.
        model: The schema.
        minimal_data: Valid content of such a file.
        name: The key.
        value: Its value.

    Raises:
        ArgumentError: If the schema does not take it.
    """
    data = {**minimal_data, name: plain(value)}
    try:
        return getattr(model.model_validate(data), name)
    except ValidationError as error:
        location, mistake = next(_mistakes(data, error, model, kind))
        raise ArgumentError(key_text(location), mistake) from None


def plain(value: Any) -> Any:
    """Return plain data: arrays and tuples as lists, numpy scalars as numbers, enums as values."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Enum):
        return value.value
    return value + 0.0 if isinstance(value, float) else value  # no -0


@cache
def _json_schema(model: type[BaseModel]) -> Node:
    """Return a model's JSON schema, cached as it is slow to make."""
    return model.model_json_schema()


def is_whole_number(data: Any, model: type[BaseModel], location: Location) -> bool:
    """Return whether the number at a location of a file has to be a whole number.

    Args:
        data: The file's data.
        model: Its schema.
        location: Location of the number.
    """
    nodes = _nodes_at(_json_schema(model), data, location)
    kinds = {node.get("type") for node in nodes}
    return "integer" in kinds and "number" not in kinds


def unknown_key(data: Any, model: type[BaseModel], location: Location) -> str:
    """Return a message that a file has no such key, with the known keys; empty if it has it.

    Args:
        data: The file's data.
        model: Its schema.
        location: Location of the key.
    """
    known = _known_keys(_json_schema(model), data, location)
    # Mappings by free names have no keys in the schema.
    return "" if not known or location[-1] in known else _unknown_key_text(location, known)


def _known_keys(schema: Node, data: Any, location: Location) -> list[str]:
    """Return the keys that the schema allows at the level of a location, sorted."""
    return sorted(
        {key for node in _nodes_at(schema, data, location[:-1]) for key in _properties(node)}
    )


def _unknown_key_text(location: Location, known: list[str]) -> str:
    return f"{_UNKNOWN_KEY}; {names_in_words(str(location[-1]), known)}"


def _mistakes(
    data: Any, error: ValidationError, model: type[BaseModel], kind: FileKind
) -> Iterator[tuple[Location, str]]:
    """Yield location and message of each mistake."""
    items = [(_file_location(data, item), item) for item in error.errors()[:_MOST_EXAMINED]]
    schema = _json_schema(model)
    for location, item in items:
        # Every branch of a union reports errors: take those with the deepest location.
        if not any(
            len(longer) > len(location) and longer[: len(location)] == location
            for longer, _ in items
        ):
            yield location, _mistake_text(schema, data, location, item, kind)


def _mistake_text(schema: Node, data: Any, location: Location, item: Any, kind: FileKind) -> str:
    fault, parts = item["type"], item["loc"]
    if fault == "value_error":
        return item["msg"].removeprefix("Value error, ")
    if fault == "extra_forbidden":
        return _unknown_key_text(location, _known_keys(schema, data, location))
    if fault == "invalid_key" or parts[-1:] == ("[key]",):
        found = reprlib.repr(item["input"])
        if isinstance(item["input"], str):
            return f"found {found} as a name; a name has at most 200 characters"
        return f"found {found} as a name; a name is text: put it in quotes"
    wanted = _wanted_of_any(schema, _nodes_at(schema, data, location))
    if fault == "missing" and location[-1:] == parts[-1:]:
        return f"is missing; needs {wanted}"
    found = item["input"]
    value = "nothing" if found is None else reprlib.repr(found)
    return f"found {value}; needs {wanted}{_meant_value_text(found, wanted, location, kind)}"


def _meant_value_text(found: Any, wanted: str, location: Location, kind: FileKind) -> str:
    """Return, for messages, the figure or the allowed word that was probably meant; else empty."""
    word = found.get("type") if isinstance(found, dict) else found
    share = _unitless_figure(word) if "below 1" in wanted else None
    if share is not None and 1.0 <= share < 100.0:
        return f"; {share:g} % is {share / 100.0:g}"
    is_one = isinstance(word, str | int | float) and "number" in wanted
    if is_one and (advice := kind.advice(str(word), location)):
        return advice
    nearest = nearest_name(word, re.findall("'(.*?)'", wanted)) if isinstance(word, str) else None
    return "" if nearest is None else f"; did you mean {nearest!r}?"


def _unitless_figure(value: Any) -> float | None:
    """Return a number, or a text that is a number without a unit; None for anything else."""
    figure = None if isinstance(value, bool) else FIGURE.fullmatch(str(value))
    return None if figure is None or figure[2] else float(figure[1].replace(",", "."))


def _file_location(data: Any, item: Any) -> Location:
    """Return the location in the file of a validation error, a missing last key included.

    Names of union branches, which pydantic inserts, are left out.
    """
    location: list[int | str] = []
    for part in item["loc"]:
        if _has_part(data, part):
            # Locations have mapping keys as texts, also keys that are numbers.
            location.append(part if isinstance(data, list) else str(part))
            data = data[part]
    if item["type"] == "missing" and isinstance(data, dict):
        location.append(item["loc"][-1])
    return tuple(location)


def _has_part(data: Any, part: Any) -> bool:
    if isinstance(data, list):
        return isinstance(part, int) and part < len(data)
    return isinstance(data, dict) and part in data


def _nodes_at(schema: Node, data: Any, location: Location) -> list[Node]:
    """Return the JSON schemas that apply at a location of a file."""
    nodes = [schema]
    for part in location:
        fitting = [node for node in nodes if _is_branch_of_type(node, data)] or nodes
        children = [_child_schema(node, part) for node in fitting]
        nodes = [option for child in children if child for option in _union_branches(schema, child)]
        data = data[part] if _has_part(data, part) else None
    return [node for node in nodes if _is_branch_of_type(node, data)] or nodes


def _is_branch_of_type(node: Node, data: Any) -> bool:
    """Return whether ``data`` is a mapping with the ``type`` of this branch of a union."""
    named = node.get("properties", {}).get("type", {}).get("const")
    return named is not None and isinstance(data, dict) and data.get("type") == named


def _union_branches(schema: Node, node: Node) -> list[Node]:
    """Return the branches of a union, references resolved, without null."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rpartition("/")[2]]
    branches = node.get("anyOf") or node.get("oneOf")
    if branches is None:
        return [] if node.get("type") == "null" else [node]
    return [option for branch in branches for option in _union_branches(schema, branch)]


def _child_schema(node: Node, part: int | str) -> Node | None:
    if isinstance(part, int):
        item_schemas = node.get("prefixItems", [])
        return item_schemas[part] if part < len(item_schemas) else node.get("items")
    additional = node.get("additionalProperties")
    return _properties(node).get(part) or (additional if isinstance(additional, dict) else None)


def _properties(node: Node) -> Node:
    return node.get("properties", {})


def _wanted_of_any(schema: Node, nodes: list[Node]) -> str:
    """Return in words what the branches of a union allow."""
    names = [_properties(node)["type"]["const"] for node in nodes if "type" in _properties(node)]
    if len(names) > 1:
        return f"a mapping with the type {_joined_by_or([repr(name) for name in names])}"
    return _joined_by_or([_wanted(schema, node) for node in nodes])


def _wanted(schema: Node, node: Node) -> str:
    """Return in words what a part of the schema allows."""
    if "enum" in node or "const" in node:
        return _joined_by_or([repr(value) for value in node.get("enum", [node.get("const")])])
    match node.get("type"):
        case "number" | "integer":
            return f"{'a finite' if node['type'] == 'number' else 'a whole'} number{_bounds(node)}"
        case "array":
            items = node.get("prefixItems", [node.get("items", {})])
            item = _wanted_of_any(schema, _union_branches(schema, items[0]))
            if "prefixItems" in node:
                return f"a list of {len(items)}, each {item}"
            return f"a list{_size_text(node, 'Items')}, each item {item}"
        case "object" if "properties" in node:
            return f"a mapping with the keys {', '.join(_properties(node))}"
        case "object" if not isinstance(node.get("additionalProperties"), dict):
            return "a mapping"
        case "object":
            item = _wanted_of_any(schema, _union_branches(schema, node["additionalProperties"]))
            return f"a mapping{_size_text(node, 'Properties') or ' of'} names, each to {item}"
        case "boolean":
            return "true or false"
        case _:
            sizes = _size_text(node, "Length")
            return f"text{sizes} characters" if sizes else "text"


def _size_text(node: Node, suffix: str) -> str:
    """Return the bounds on a number of items, such as `` of at most 3``; empty without any."""
    limits = {"at least": node.get(f"min{suffix}"), "at most": node.get(f"max{suffix}")}
    bounds = [f"{word} {size}" for word, size in limits.items() if size is not None]
    return f" of {' and '.join(bounds)}" if bounds else ""


def _bounds(node: Node) -> str:
    low, high = node.get("minimum"), node.get("maximum")
    if "exclusiveMaximum" in node:
        return f" >= {low:g}, below {node['exclusiveMaximum']:g}"
    if high is None:
        return "" if low is None else f" >= {low:g}"
    if low is None:
        return f" > {node['exclusiveMinimum']:g}, at most {high:g}"
    if "exclusiveMinimum" in node:
        return f" > 0, from {low:g} to {high:g}"
    if low == -high:
        return f" within ±{high:g}"
    return f" >= {low:g}, at most {high:g}"


def _joined_by_or(words: list[str]) -> str:
    words = list(dict.fromkeys(words))
    return " or ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)
