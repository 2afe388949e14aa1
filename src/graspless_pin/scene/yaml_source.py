"""A YAML file of the user's: plain data with line numbers, read within bounds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from graspless_pin.errors import SceneError, TextError
from graspless_pin.intake.files import FileKind, read_text
from graspless_pin.intake.yaml_text import Location, parse_yaml

__all__ = ["Location", "YamlSource"]

_MEBIBYTES = 4
_NEEDED = {
    "scene": "a scene needs object and friction",
    "study": "a study needs scene and vary",
}


class YamlSource:
    """A parsed YAML file that knows on which line each key stands.

    Attributes:
        path: The file.
        data: Its content as plain Python data.
    """

    def __init__(self, path: Path, kind: str = "scene") -> None:
        """Read and parse the file.

        Args:
            path: The file.
            kind: What the file describes, for messages.

        Raises:
            SceneError: If the file is missing, empty, too large or no regular file, is not UTF-8
                text or not plain YAML.
        """
        self.path = path
        text = read_text(path, FileKind(kind, _MEBIBYTES, SceneError))
        try:
            parsed = parse_yaml(text)
        except TextError as error:
            line = f":{error.line}" if error.line else ""
            raise SceneError(f"{path}{line}: {error}") from None
        self.data: Any = parsed.data
        self._lines = parsed.lines
        if not parsed.lines:
            raise SceneError(f"{path}: the file is empty; {_NEEDED[kind]}")

    @classmethod
    def of_data(cls, data: Any, path: Path) -> YamlSource:
        """Return content that was made in Python, under the name that messages give it."""
        source = object.__new__(cls)
        source.path, source.data, source._lines = path, data, {}
        return source

    def with_data(self, data: Any) -> YamlSource:
        """Return the same file with changed content; lines stay those of the file."""
        source = self.of_data(data, self.path)
        source._lines = self._lines
        return source

    def line_of(self, location: Location) -> int:
        """Return the line of a key, or of the nearest key above it that stands in the file."""
        for length in range(len(location), -1, -1):
            line = self._lines.get(location[:length])
            if line is not None:
                return line
        return 1

    def has(self, location: Location) -> bool:
        """Return whether exactly this key stands in the file."""
        return location in self._lines

    def where(self, location: Location) -> str:
        """Return ``file:line`` of a key; the name alone of what came from no file."""
        if not self._lines:
            return str(self.path)
        return f"{self.path}:{self.line_of(location)}"
