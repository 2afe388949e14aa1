"""Plain YAML with line numbers: data only, no tags, no duplicate keys."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from graspless_pin.errors import SceneError

Location = tuple[str | int, ...]

_NEEDED = {
    "scene": "a scene needs object and friction",
    "study": "a study needs scene and vary",
}

MOST_ENTRIES = 100_000
"""More keys and items than any scene has; anchors can multiply a few lines into billions."""


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
            SceneError: If the file is missing or empty, is not UTF-8 text or not plain YAML.
        """
        self.path = path
        try:
            text = path.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise SceneError(f"{path}: there is no such file; check the path") from None
        except OSError as error:
            raise SceneError(f"{path}: cannot be read ({error.strerror})") from None
        except UnicodeDecodeError as error:
            raise SceneError(
                f"{path}: is not UTF-8 text ({error}); a {kind} is a YAML text file"
            ) from None
        self._lines: dict[Location, int] = {}
        try:
            root = yaml.compose(text, Loader=yaml.SafeLoader)
            if root is not None:
                self._index(root, (), frozenset())
            self.data: Any = yaml.safe_load(text)
        except yaml.MarkedYAMLError as error:
            line = f":{error.problem_mark.line + 1}" if error.problem_mark else ""
            raise SceneError(f"{path}{line}: is not plain YAML: {_advice(error)}") from None
        except SceneError:
            raise
        except (yaml.YAMLError, ValueError) as error:
            # PyYAML lets Python's own ValueError through for dates and numbers that do not exist.
            problem = " ".join(str(error).split())
            raise SceneError(f"{path}: is not plain YAML: {problem}; put text in quotes") from error
        except RecursionError:
            raise SceneError(f"{path}: is nested too deeply; a {kind} has few levels") from None
        if root is None:
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

    def _index(self, node: yaml.Node, location: Location, above: frozenset[int]) -> None:
        line = node.start_mark.line + 1
        if id(node) in above:
            raise SceneError(f"{self.path}:{line}: an anchor contains itself; write it out")
        if len(self._lines) > MOST_ENTRIES:
            raise SceneError(
                f"{self.path}:{line}: has more than {MOST_ENTRIES} entries; anchors that repeat "
                "anchors grow without bound"
            )
        above |= {id(node)}
        self._lines.setdefault(location, line)
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
                self._index(value, inner, above)
        elif isinstance(node, yaml.SequenceNode):
            for index, value in enumerate(node.value):
                self._index(value, (*location, index), above)


def _advice(error: yaml.MarkedYAMLError) -> str:
    """Return what PyYAML found, where on the line, and what would do."""
    problem = error.problem or "unreadable"
    advice = "use plain mappings, lists, text and numbers"
    if "tag" in problem:
        advice = "tags stay inert here: write the plain value"
    elif "\\t" in problem or "tab" in problem:
        advice = "indent with spaces"
    elif "document" in problem:
        advice = "a file holds one scene"
    column = f"column {error.problem_mark.column + 1}: " if error.problem_mark else ""
    return f"{column}{problem}; {advice}"
