"""Plain YAML with line numbers: data only, no tags, no duplicate keys."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from graspless_pin.errors import SceneError

Location = tuple[str | int, ...]


class YamlSource:
    """A parsed YAML file that knows on which line each key stands.

    Attributes:
        path: The file.
        data: Its content as plain Python data.
    """

    def __init__(self, path: Path) -> None:
        """Read and parse the file.

        Raises:
            SceneError: If the file is missing, is not UTF-8 text or not plain YAML.
        """
        self.path = path
        try:
            text = path.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise SceneError(f"{path}: there is no such file") from None
        except (OSError, UnicodeDecodeError) as error:
            raise SceneError(f"{path}: cannot be read as UTF-8 text ({error})") from None
        try:
            root = yaml.compose(text, Loader=yaml.SafeLoader)
            self._lines: dict[Location, int] = {}
            if root is not None:
                self._index(root, ())
            self.data: Any = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise SceneError(f"{path}: is not plain YAML: {_yaml_message(error)}") from None

    def line_of(self, location: Location) -> int:
        """Return the line of a key, or of the nearest key above it that stands in the file."""
        for length in range(len(location), -1, -1):
            line = self._lines.get(location[:length])
            if line is not None:
                return line
        return 1

    def where(self, location: Location) -> str:
        """Return ``file:line`` of a key."""
        return f"{self.path}:{self.line_of(location)}"

    def _index(self, node: yaml.Node, location: Location) -> None:
        self._lines.setdefault(location, node.start_mark.line + 1)
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                name = str(key.value)
                inner = (*location, name)
                if inner in self._lines:
                    raise SceneError(
                        f"{self.path}:{key.start_mark.line + 1}: {'.'.join(map(str, inner))}: "
                        f"stands twice, first on line {self._lines[inner]}; keep one"
                    )
                self._lines[inner] = key.start_mark.line + 1
                self._index(value, inner)
        elif isinstance(node, yaml.SequenceNode):
            for index, value in enumerate(node.value):
                self._index(value, (*location, index))


def _yaml_message(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        return f"line {mark.line + 1}, column {mark.column + 1}: {error.problem}"
    return str(error)
