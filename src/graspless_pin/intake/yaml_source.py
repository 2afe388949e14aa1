"""A YAML file of the user's: plain data with line numbers, checked by a schema.

Errors name file, line, key, what was found and what would do.
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
    """A parsed YAML file that knows on which line each key stands.

    Attributes:
        path: The file; of content that was made in Python, the name that messages give it.
        data: Its content as plain Python data.
        kind: What it describes.
        lines: Line of each key; none of content that was made in Python.
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
        """Return ``file:line`` of a key, or of the nearest key above it that stands in the file.

        Of what came from no file it is the name alone.
        """
        if not self.lines:
            return str(self.path)
        above = (location[:length] for length in range(len(location), -1, -1))
        return f"{self.path}:{next((self.lines[key] for key in above if key in self.lines), 1)}"

    def placed(self, finding: Finding) -> Finding:
        """Return a finding that says where the file says so, if the finding has a key."""
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
    def at(self, location: Location, also: Location = ()) -> Iterator[None]:
        """Use one part of the file: errors that are raised inside name that part.

        Args:
            location: The part.
            also: Deeper part to name where the error is about no argument but a file or name.
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
            message = f"a file cannot be read ({error}); check it"
            raise self.error((*location, *also), message) from error

    def file(self, text: str) -> Path:
        """Return the path that a text of the file means: relative to the file."""
        return self.path.resolve().parent / text


def key_text(location: Location) -> str:
    """Return a location as people write it, e.g. ``supports[0].name``."""
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
    """Return the content of a file as its schema has it.

    Raises:
        GrasplessPinError: The error of the file's kind, a line a mistake: file:line, key, what was
            found, what would do.
    """
    try:
        return model.model_validate(source.data)
    except ValidationError as error:
        mistakes = list(_mistakes(source.data, error, model, source.kind))
        # A misspelt key comes before what is missing because of it.
        mistakes.sort(key=lambda one: not one[1].startswith(_UNKNOWN_KEY))
        lines = [*dict.fromkeys(source.message(*one) for one in mistakes)]
        more = len(lines) - _MOST_LISTED + max(0, error.error_count() - _MOST_EXAMINED)
        rest = [f"... and {more} mistakes more"] if more > 0 else []
        raise source.kind.error("\n".join([*lines[:_MOST_LISTED], *rest])) from None


def with_known(entry: Any, data: Any, known: Any, known_data: Any) -> Any:
    """Return an entry in which all parts that were said before are the same objects as then.

    Args:
        entry: The entry, or a part of it.
        data: What the file says there.
        known: The entry before.
        known_data: What the file said then.
    """
    if is_alike(data, known_data):
        return known
    kind = type(entry)
    if isinstance(entry, BaseModel) and kind is type(known):
        before = vars(known)
        parts = {
            name: with_known(part, data.get(name), before[name], known_data.get(name))
            for name, part in vars(entry).items()
        }
        return kind.model_construct(entry.model_fields_set, **parts)
    if isinstance(entry, list) and isinstance(known, list) and len(entry) == len(known):
        return [*map(with_known, entry, data, known, known_data)]
    return entry


def checked_key(kind: FileKind, model: type[BaseModel], least: Node, name: str, value: Any) -> Any:
    """Return one key's value as the schema of a file has it.

    Args:
        kind: The kind of file.
        model: The schema.
        least: A content of the file that is sound.
        name: The key.
        value: Its value.

    Raises:
        ArgumentError: If the schema does not take it.
    """
    data = {**least, name: plain(value)}
    try:
        return getattr(model.model_validate(data), name)
    except ValidationError as error:
        location, mistake = next(_mistakes(data, error, model, kind))
        raise ArgumentError(key_text(location), mistake) from None


def plain(value: Any) -> Any:
    """Return plain data: arrays and tuples as lists, numpy's numbers as Python's, enums as text."""
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
    """Return a model's JSON schema, which takes longer to make than to look through."""
    return model.model_json_schema()


def is_whole_number(data: Any, model: type[BaseModel], location: Location) -> bool:
    """Return whether a number at a location of a file has to be a whole one.

    Args:
        data: What the file says above it.
        model: What it is checked against.
        location: Of the number.
    """
    nodes = _nodes_at(_json_schema(model), data, location)
    kinds = {node.get("type") for node in nodes}
    return "integer" in kinds and "number" not in kinds


def unknown_key(data: Any, model: type[BaseModel], location: Location) -> str:
    """Return that a location is none of a file, with the keys that there are; empty: it is one.

    Args:
        data: What the file says above it.
        model: What it is checked against.
        location: Of the key.
    """
    known = _known_keys(_json_schema(model), data, location)
    # Where names are free, the schema has no keys.
    return "" if not known or location[-1] in known else _unknown(location, known)


def _known_keys(schema: Node, data: Any, location: Location) -> list[str]:
    """Return the keys that may stand beside a location, sorted."""
    return sorted({key for node in _nodes_at(schema, data, location[:-1]) for key in _keys(node)})


def _unknown(location: Location, known: list[str]) -> str:
    return f"{_UNKNOWN_KEY}; {names_in_words(str(location[-1]), known)}"


def _mistakes(
    data: Any, error: ValidationError, model: type[BaseModel], kind: FileKind
) -> Iterator[tuple[Location, str]]:
    """Yield where a mistake is and what it is called."""
    items = [(_in_file(data, item), item) for item in error.errors()[:_MOST_EXAMINED]]
    schema = _json_schema(model)
    for location, item in items:
        # Every branch of a union complains; the branch that got furthest is the one that is meant.
        if not any(
            len(other) > len(location) and other[: len(location)] == location for other, _ in items
        ):
            yield location, _mistake(schema, data, location, item, kind)


def _mistake(schema: Node, data: Any, location: Location, item: Any, kind: FileKind) -> str:
    fault, parts = item["type"], item["loc"]
    if fault == "value_error":
        return item["msg"].removeprefix("Value error, ")
    if fault == "extra_forbidden":
        return _unknown(location, _known_keys(schema, data, location))
    if fault == "invalid_key" or parts[-1:] == ("[key]",):
        found = reprlib.repr(item["input"])
        if isinstance(item["input"], str):
            return f"found {found} as a name; a name has at most 200 characters"
        return f"found {found} as a name; a name is text: put it in quotes"
    wanted = _wanted_of(schema, _nodes_at(schema, data, location))
    if fault == "missing" and location[-1:] == parts[-1:]:
        return f"is missing; needs {wanted}"
    found = item["input"]
    value = "nothing" if found is None else reprlib.repr(found)
    return f"found {value}; needs {wanted}{_meant(found, wanted, location, kind)}"


def _meant(found: Any, wanted: str, location: Location, kind: FileKind) -> str:
    """Return which figure, or which of the words that would do, was probably meant."""
    word = found.get("type") if isinstance(found, dict) else found
    share = _plain_figure(word) if "below 1" in wanted else None
    if share is not None and 1.0 <= share < 100.0:
        return f"; {share:g} % is {share / 100.0:g}"
    is_one = isinstance(word, str | int | float) and "number" in wanted
    if is_one and (advice := kind.advice(str(word), location)):
        return advice
    nearest = nearest_name(word, re.findall("'(.*?)'", wanted)) if isinstance(word, str) else None
    return "" if nearest is None else f"; did you mean {nearest!r}?"


def _plain_figure(found: Any) -> float | None:
    """Return what is a number, or a text that is one without a unit; None for all else."""
    figure = None if isinstance(found, bool) else FIGURE.fullmatch(str(found))
    return None if figure is None or figure[2] else float(figure[1].replace(",", "."))


def _in_file(data: Any, item: Any) -> Location:
    """Keep the parts of a validation location that are keys of the file, and a missing last key.

    Branches of unions add their own names to the location.
    """
    kept: list[int | str] = []
    for part in item["loc"]:
        if _holds(data, part):
            # Lines are by keys as they are written, be they numbers or not.
            kept.append(part if isinstance(data, list) else str(part))
            data = data[part]
    if item["type"] == "missing" and isinstance(data, dict):
        kept.append(item["loc"][-1])
    return tuple(kept)


def _holds(data: Any, part: Any) -> bool:
    if isinstance(data, list):
        return isinstance(part, int) and part < len(data)
    return isinstance(data, dict) and part in data


def _nodes_at(schema: Node, data: Any, location: Location) -> list[Node]:
    """Return the JSON schemas of what may stand at a location of this file."""
    nodes = [schema]
    for part in location:
        fitting = [node for node in nodes if _is_named(node, data)] or nodes
        children = [_child(node, part) for node in fitting]
        nodes = [option for child in children if child for option in _options(schema, child)]
        data = data[part] if _holds(data, part) else None
    return [node for node in nodes if _is_named(node, data)] or nodes


def _is_named(node: Node, data: Any) -> bool:
    """Return whether ``data`` is the mapping whose ``type`` this branch of a union describes."""
    named = node.get("properties", {}).get("type", {}).get("const")
    return named is not None and isinstance(data, dict) and data.get("type") == named


def _options(schema: Node, node: Node) -> list[Node]:
    """Return the branches of a union, each with its reference followed, without null."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rpartition("/")[2]]
    branches = node.get("anyOf") or node.get("oneOf")
    if branches is None:
        return [] if node.get("type") == "null" else [node]
    return [option for branch in branches for option in _options(schema, branch)]


def _child(node: Node, part: int | str) -> Node | None:
    if isinstance(part, int):
        places = node.get("prefixItems", [])
        return places[part] if part < len(places) else node.get("items")
    further = node.get("additionalProperties")
    return _keys(node).get(part) or (further if isinstance(further, dict) else None)


def _keys(node: Node) -> Node:
    return node.get("properties", {})


def _wanted_of(schema: Node, nodes: list[Node]) -> str:
    """Say in words what any branch of a union allows."""
    names = [_keys(node)["type"]["const"] for node in nodes if "type" in _keys(node)]
    if len(names) > 1:
        return f"a mapping with the type {_join([repr(name) for name in names])}"
    return _join([_wanted(schema, node) for node in nodes])


def _wanted(schema: Node, node: Node) -> str:
    """Say in words what a part of the schema allows."""
    if "enum" in node or "const" in node:
        return _join([repr(value) for value in node.get("enum", [node.get("const")])])
    match node.get("type"):
        case "number" | "integer":
            return f"{'a finite' if node['type'] == 'number' else 'a whole'} number{_bounds(node)}"
        case "array":
            inner = node.get("prefixItems", [node.get("items", {})])
            each = _wanted_of(schema, _options(schema, inner[0]))
            if "prefixItems" in node:
                return f"a list of {len(inner)}, each {each}"
            return f"a list{_sizes(node, 'Items')}, each item {each}"
        case "object" if "properties" in node:
            return f"a mapping with the keys {', '.join(_keys(node))}"
        case "object" if not isinstance(node.get("additionalProperties"), dict):
            return "a mapping"
        case "object":
            each = _wanted_of(schema, _options(schema, node["additionalProperties"]))
            return f"a mapping{_sizes(node, 'Properties') or ' of'} names, each to {each}"
        case "boolean":
            return "true or false"
        case _:
            sizes = _sizes(node, "Length")
            return f"text{sizes} characters" if sizes else "text"


def _sizes(node: Node, of: str) -> str:
    """Return how many there may be, such as `` of at most 3``; empty: any number."""
    words = {"at least": node.get(f"min{of}"), "at most": node.get(f"max{of}")}
    bounds = [f"{word} {size}" for word, size in words.items() if size is not None]
    return f" of {' and '.join(bounds)}" if bounds else ""


def _bounds(node: Node) -> str:
    least, most = node.get("minimum"), node.get("maximum")
    if "exclusiveMaximum" in node:
        return f" >= {least:g}, below {node['exclusiveMaximum']:g}"
    if most is None:
        return "" if least is None else f" >= {least:g}"
    if least is None:
        return f" > {node['exclusiveMinimum']:g}, at most {most:g}"
    if "exclusiveMinimum" in node:
        return f" > 0, from {least:g} to {most:g}"
    if least == -most:
        return f" within ±{most:g}"
    return f" >= {least:g}, at most {most:g}"


def _join(words: list[str]) -> str:
    words = list(dict.fromkeys(words))
    return " or ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else "".join(words)
