"""Plain YAML with line numbers and bounds: data only, no tags, no duplicate keys."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from graspless_pin.errors import TextError
from graspless_pin.intake.text import bad_character

Location = tuple[str | int, ...]

MOST_ENTRIES = 30_000
"""More keys and items than any file has; anchors can multiply a few lines into billions."""
DEEPEST_YAML = 50
"""More levels of mappings and lists than any file has."""
LONGEST_YAML_NUMBER = 500
"""More characters than any number has; thousands of digits take Python long."""


@dataclass(frozen=True)
class ParsedYaml:
    """The content of a YAML text.

    Attributes:
        data: Plain Python data; None for an empty text.
        lines: Line of each key and item by its location.
    """

    data: Any
    lines: dict[Location, int]


class YamlLoader(yaml.SafeLoader):
    """PyYAML's plain loader with bounds, which come before any recursion or slow search."""

    def fetch_flow_collection_start(self, TokenClass: Any) -> None:
        """Refuse to go too deep."""
        self._check_depth()
        super().fetch_flow_collection_start(TokenClass)

    def add_indent(self, column: int) -> bool:
        """Refuse to go too deep."""
        self._check_depth()
        return super().add_indent(column)

    def _check_depth(self) -> None:
        if self.flow_level + len(self.indents) > DEEPEST_YAML:
            raise TextError(
                f"is nested too deeply; at most {DEEPEST_YAML} levels are possible", self.line + 1
            )


# 1:30 is the number 90 in YAML 1.1; here it is text, which no number's place takes.
_NUMBERS = {
    "tag:yaml.org,2002:int": re.compile(r"[-+]?(0b[0-1_]+|0[0-7_]*|[1-9][0-9_]*|0x[0-9a-fA-F_]+)"),
    "tag:yaml.org,2002:float": re.compile(
        r"[-+]?(([0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*)([eE][-+][0-9]+)?|\.(inf|Inf|INF))"
        r"|\.(nan|NaN|NAN)"
    ),
}
YamlLoader.yaml_implicit_resolvers = {
    first: [
        (tag, re.compile(rf"(?:{_NUMBERS[tag].pattern})\Z") if tag in _NUMBERS else pattern)
        for tag, pattern in resolvers
    ]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def parse_yaml(text: str) -> ParsedYaml:
    """Parse one YAML document of mappings, lists, text, numbers and truth values.

    Args:
        text: The text.

    Returns:
        Its content and lines.

    Raises:
        TextError: It is no plain YAML, repeats a key, is nested more than 50 levels deep or has
            more than 30 000 entries, anchors written out.
    """
    try:
        loader = YamlLoader(text)
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise TextError(
            f"has the character U+{error.character:04X}, which YAML does not allow; remove it", line
        ) from None
    try:
        root = loader.get_single_node()
        if root is None:
            return ParsedYaml(None, {})
        lines = _lines_of(root)
        return ParsedYaml(loader.construct_document(root), lines)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise TextError(f"is not plain YAML: {_advice(error)}", line) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        # PyYAML lets Python's own errors through for dates and numbers that do not exist.
        problem = " ".join(str(error).split())
        raise TextError(f"is not plain YAML: {problem}; put text in quotes") from error


def texts_of(data: Any) -> Iterator[str]:
    """Yield all texts of a file's data but for keys."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, dict | list):
        for item in data.values() if isinstance(data, dict) else data:
            yield from texts_of(item)


def _lines_of(root: yaml.Node) -> dict[Location, int]:
    """Return the line of each key and item, in the order of the text; without recursion."""
    lines: dict[Location, int] = {}
    waiting: list[tuple[yaml.Node | None, yaml.Node, Location, frozenset[int]]] = [
        (None, root, (), frozenset())
    ]
    while waiting:
        key, node, location, above = waiting.pop()
        if key is not None:
            _check_scalar(key, location)
            location = (*location, str(key.value))
            if location in lines:
                raise TextError(
                    f"{'.'.join(map(str, location))}: duplicate key, first on line "
                    f"{lines[location]}; keep one",
                    key.start_mark.line + 1,
                )
            lines[location] = key.start_mark.line + 1
        line = node.start_mark.line + 1
        if id(node) in above:
            raise TextError("an anchor contains itself; write it out", line)
        if len(lines) > MOST_ENTRIES:
            raise TextError(
                f"has more than {MOST_ENTRIES} entries; shapes of many points are for mesh files, "
                "and anchors that repeat anchors grow without bound",
                line,
            )
        if len(location) > DEEPEST_YAML:
            raise TextError(
                f"is nested too deeply; at most {DEEPEST_YAML} levels are possible", line
            )
        above |= {id(node)}
        lines.setdefault(location, line)
        if isinstance(node, yaml.MappingNode):
            waiting += [(name, value, location, above) for name, value in reversed(node.value)]
        elif isinstance(node, yaml.SequenceNode):
            items = reversed([*enumerate(node.value)])
            waiting += [(None, value, (*location, index), above) for index, value in items]
        else:
            _check_scalar(node, location)
    return lines


def _check_scalar(node: yaml.Node, location: Location) -> None:
    if not isinstance(node, yaml.ScalarNode):
        return
    place = f"{'.'.join(map(str, location))}: " if location else ""
    line = node.start_mark.line + 1
    if node.tag in _NUMBERS and len(node.value) > LONGEST_YAML_NUMBER:
        raise TextError(
            f"{place}found a number of {len(node.value)} characters; a number has at most "
            f"{LONGEST_YAML_NUMBER}",
            line,
        )
    code = bad_character(node.value)
    if code is not None:
        raise TextError(
            f"{place}has the character {code}, which cannot be printed; leave it out", line
        )


def _advice(error: yaml.MarkedYAMLError) -> str:
    """Return what PyYAML found, where on the line, and what would do."""
    problem = error.problem or "unreadable"
    advice = "use plain mappings, lists, text and numbers"
    if "tag" in problem:
        advice = "tags stay inert here: write the plain value"
    elif "\\t" in problem or "tab" in problem:
        advice = "indent with spaces"
    elif "document" in problem:
        advice = "a file holds one document"
    column = f"column {error.problem_mark.column + 1}: " if error.problem_mark else ""
    return f"{column}{problem}; {advice}"
