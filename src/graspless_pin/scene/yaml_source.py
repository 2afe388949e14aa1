"""A YAML file of the user's: plain data with line numbers, and errors that name file and key."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

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

__all__ = ["SCENE", "Location", "YamlSource", "key_text"]

SCENE = FileKind("scene", 4, SceneError)
_NEEDED = {
    "scene": "a scene needs object and friction",
    "study": "a study needs scene and vary",
}


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
    kind: FileKind = SCENE
    lines: Mapping[Location, int] = field(default_factory=dict)

    @classmethod
    def read(cls, path: Path, kind: FileKind = SCENE) -> YamlSource:
        """Read and parse a file.

        Args:
            path: The file.
            kind: What the file describes.

        Raises:
            GrasplessPinError: The kind's error, if the file is missing, empty, too large or no
                regular file, is not UTF-8 text or not plain YAML.
        """
        text = read_text(path, kind)
        with errors_of_text(path, kind):
            parsed = parse_yaml(text)
        if not parsed.lines:
            raise kind.error(f"{path}: the file is empty; {_NEEDED[kind.name]}")
        refuse_other_kind(path, kind, kind_of_data(parsed.data))
        return cls(path, parsed.data, kind, parsed.lines)

    def has(self, location: Location) -> bool:
        """Return whether exactly this key stands in the file."""
        return location in self.lines

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
        return f"{self.where(location)}: {key_text(location)}: {message}"

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
            first, *rest = _keys(error.argument) or ("",)
            named = [(*location, name, *rest) for name in (first, f"{first}_deg")]
            inner = next(filter(self.has, named), None)
            if inner is not None:
                message = str(error).removeprefix(f"{error.argument}: ")
                raise self.error(inner, message) from error
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


def _keys(argument: str) -> tuple[str, ...]:
    """Split an argument's name such as ``q['joint_1.0']`` into keys of the file."""
    return tuple(
        quoted or plain for quoted, plain in re.findall(r"\['(.*?)'\]|([^.\[\]]+)", argument)
    )
