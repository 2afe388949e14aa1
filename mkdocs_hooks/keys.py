"""The page of all keys of scene, study and robot files, made of the schemas that check them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from graspless_pin.geometry.robots.files import RobotFile
from graspless_pin.scene.scene_schema import SceneEntry
from graspless_pin.studies.study_schema import StudyEntry

FILES: dict[str, tuple[type[BaseModel], str]] = {
    "Scene files": (
        SceneEntry,
        "A scene says what there is and what is asked. [Your own hand](own_hand.md) writes one.",
    ),
    "Robot files": (
        RobotFile,
        "A robot file says which joints of a URDF make which finger, and what its motors bear.",
    ),
    "Study files": (StudyEntry, "A study varies keys of a scene: see [studies](studies.md)."),
}
_PLAIN = {
    "integer": "whole number",
    "number": "number",
    "string": "text",
    "boolean": "true or false",
}
_UNIT = re.compile(r"^\[([^]]*)\] ")
_HEAD = """# All keys

Made of the schemas that check the files whenever this site is built. `graspless-pin schema` prints
the scene's as JSON schema. Units are SI; `1` is a plain number. A key without a default is
needed.
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the page to the site."""
    files.append(File.generated(config, "keys.md", content=keys_page()))
    return files


def keys_page() -> str:
    """Return the page as Markdown: a section a file, a table for each part of it."""
    parts = [_HEAD]
    told: set[str] = set()
    for title, (model, words) in FILES.items():
        _, document = models_json_schema([(model, "validation")])
        entries = document["$defs"]
        parts.append(f"## {title}\n\n{words}\n")
        for name in _order(model.__name__, entries):
            if name in told:
                continue
            told.add(name)
            parts.append(_section(name, entries[name]))
    return "\n".join(parts)


def rows_of(entry: Mapping[str, Any]) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield key, type, unit, default and meaning of each key of a part."""
    required = entry.get("required", [])
    for key, schema in entry["properties"].items():
        inner = [one.get("description", "") for one in schema.get("anyOf", [])]
        words = schema.get("description") or "".join(inner)
        unit = _UNIT.match(words)
        default = "" if key in required else _default(schema.get("default"))
        yield key, _type(schema), unit[1] if unit else "", default, _UNIT.sub("", words)


def _section(name: str, entry: Mapping[str, Any]) -> str:
    rows = [
        f"| `{key}` | {_prose(words)} | {kind} | {unit} | {default} |"
        for key, kind, unit, default, words in rows_of(entry)
    ]
    head = ["| key | what it means | type | unit | default |", "|---|---|---|---|---|"]
    heading = f"### {_title(name)} {{#{_anchor(name)}}}"
    return "\n".join([heading, "", _prose(entry["description"]), "", *head, *rows, ""])


def _order(first: str, entries: Mapping[str, Any]) -> list[str]:
    """Return the parts of a file, each after the one that first names it."""
    found = [first]
    for name in found:
        named = re.findall(r'"\$ref": "#/\$defs/(\w+)"', json.dumps(entries[name]))
        found += [one for one in dict.fromkeys(named) if one not in found]
    return [name for name in found if "properties" in entries[name]]


def _type(schema: Mapping[str, Any]) -> str:
    """Return the type of a value in words, with links to other tables."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{_title(name)}](#{_anchor(name)})"
    for several in ("anyOf", "oneOf"):
        if several in schema:
            kinds = [_type(one) for one in schema[several] if one.get("type") != "null"]
            return " or ".join(dict.fromkeys(kinds))
    if "enum" in schema or "const" in schema:
        return ", ".join(f"`{value}`" for value in schema.get("enum", [schema.get("const")]))
    if schema.get("type") == "array":
        if "prefixItems" in schema:
            return f"{len(schema['prefixItems'])} × {_type(schema['prefixItems'][0])}"
        return f"list of {_type(schema['items'])}"
    if schema.get("type") == "object":
        inner = schema.get("additionalProperties")
        return f"by name: {_type(inner)}" if isinstance(inner, Mapping) else "by name"
    return _PLAIN.get(schema.get("type", ""), "any")


def _default(value: Any) -> str:
    if value in (None, "", [], {}):
        return "none"
    return "all of its defaults" if isinstance(value, dict) else f"`{json.dumps(value)}`"


def _prose(words: str) -> str:
    """Return text whose braces, bars and lines do not end a table's cell."""
    return " ".join(words.replace("``", "`").replace("|", "\\|").split())


def _title(name: str) -> str:
    words = re.findall(r"[A-Z][a-z]+", name.removesuffix("Entry").removesuffix("File"))
    return " ".join(words).lower()


def _anchor(name: str) -> str:
    return _title(name).replace(" ", "-")
