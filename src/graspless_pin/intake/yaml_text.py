"""Parse plain YAML with line numbers and bounds: data only, no tags, no duplicate keys.

Edit a YAML text so that it holds other data: it is patched, not written anew, so that comments,
order, line breaks and the digits of numbers stay.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import yaml

from graspless_pin.errors import TextError
from graspless_pin.intake.text import bad_character

Location = tuple[str | int, ...]

MOST_ENTRIES = 30_000
"""Most keys and items, more than any file has: anchors can multiply a few lines to billions."""
DEEPEST_YAML = 50
"""Most levels of mappings and lists, more than any file has."""
LONGEST_YAML_NUMBER = 500
"""Most characters of a number: Python is slow to convert thousands of digits."""


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
    """PyYAML's safe loader with bounds, which are checked before any recursion or slow search."""

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


# 1:30 is the number 90 in YAML 1.1; here it is text, which is refused where a number is wanted.
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


def all_texts(data: Any) -> Iterator[str]:
    """Yield all texts in a file's data except keys."""
    if isinstance(data, str):
        yield data
    elif isinstance(data, dict | list):
        for item in data.values() if isinstance(data, dict) else data:
            yield from all_texts(item)


def _lines_of(root: yaml.Node) -> dict[Location, int]:
    """Return the line of each key and item, in the order of the text; not recursive."""
    lines: dict[Location, int] = {}
    stack: list[tuple[yaml.Node | None, yaml.Node, Location, frozenset[int]]] = [
        (None, root, (), frozenset())
    ]
    while stack:
        key, node, location, above = stack.pop()
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
                f"has more than {MOST_ENTRIES} entries; use a mesh file for a shape of many "
                "points, and no anchors inside of anchors",
                line,
            )
        if len(location) > DEEPEST_YAML:
            raise TextError(
                f"is nested too deeply; at most {DEEPEST_YAML} levels are possible", line
            )
        above |= {id(node)}
        lines.setdefault(location, line)
        if isinstance(node, yaml.MappingNode):
            stack += [(name, value, location, above) for name, value in reversed(node.value)]
        elif isinstance(node, yaml.SequenceNode):
            items = reversed([*enumerate(node.value)])
            stack += [(None, value, (*location, index), above) for index, value in items]
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
            f"{place}has the character {code}, which cannot be printed; remove it", line
        )


def _advice(error: yaml.MarkedYAMLError) -> str:
    """Return PyYAML's problem with its column, and advice."""
    problem = error.problem or "unreadable"
    advice = "use plain mappings, lists, text and numbers"
    if "tag" in problem:
        advice = "YAML tags are not supported: write the plain value"
    elif "\\t" in problem or "tab" in problem:
        advice = "indent with spaces"
    elif "document" in problem:
        advice = "a file must have a single document"
    elif "<block" in problem:
        problem, advice = "a line of another indentation", "indent keys of one mapping equally"
    elif "mapping values" in problem or "':'" in problem:
        problem = "a key or a value too many"
        advice = "here or one line above, write 'key: value', with a space after the colon"
    column = f"column {error.problem_mark.column + 1}: " if error.problem_mark else ""
    return f"{column}{problem}; {advice}"


_WIDTH = 100
_MOST_ROUNDS = 100
_ANCHOR = re.compile(r"&[^\s,\[\]{}]+")
_COMMA = re.compile(r"[ \t]*,[ \t]*")
_LINE_END = re.compile(r"\r\n|[\r\n\x85\u2028\u2029]")


class _Edit(NamedTuple):
    """Replace the text from start to end."""

    start: int
    end: int
    text: str


class _AliasLoader(YamlLoader):
    """Loads an alias as a node of its own, with its place in the text."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        alias = self.peek_event() if self.check_event(yaml.AliasEvent) else None
        node = super().compose_node(parent, index)
        if alias is None:
            return node
        return yaml.ScalarNode("alias", None, alias.start_mark, alias.end_mark)


class _BlockDumper(yaml.SafeDumper):
    """Indents list items, expands aliases, and writes every text on one line."""

    def represent(self, data: Any) -> None:
        """Write the outermost mapping or list in block style unless all is in flow style."""
        node = self.represent_data(data)
        if isinstance(node, yaml.CollectionNode) and not self.default_flow_style:
            node.flow_style = False
        self.serialize(node)

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:  # noqa: ARG002
        super().increase_indent(flow, indentless=False)


def _represent_on_one_line(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    style = None if text.isprintable() else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_BlockDumper.add_representer(str, _represent_on_one_line)


def yaml_of(data: Any) -> str:
    """Return data as YAML: innermost mappings and lists in flow style, others in block style."""
    return yaml.dump(data, Dumper=_BlockDumper, sort_keys=False, allow_unicode=True, width=_WIDTH,
                     default_flow_style=None)  # fmt: skip


def edited_yaml(text: str, data: Any) -> str:
    """Return a YAML text edited to hold some data, with as few changes as possible.

    Where it cannot be patched, as with merged keys, a mapping or the whole text is written anew.

    Args:
        text: What `parse_yaml` takes.
        data: Plain Python data of the result. The order of keys does not count, and equal numbers
            and truth values are the same.

    Raises:
        TextError: See `parse_yaml`.
    """
    current = parse_yaml(text).data
    for _ in range(_MOST_ROUNDS):
        if current == data:
            return text
        root = _AliasLoader(text).get_single_node()
        if root is None:
            break
        # Edits that overlap later ones are left to the next round.
        untouched_end = len(text)
        for edit in sorted(_edits(text, root, current, data), reverse=True):
            if edit.end <= untouched_end:
                text = text[: edit.start] + edit.text + text[edit.end :]
                untouched_end = edit.start
        try:
            current = parse_yaml(text).data
        except TextError:  # an alias has lost its anchor
            break
    return yaml_of(data)


def _edits(text: str, node: yaml.Node, current: Any, wanted: Any) -> Iterator[_Edit]:
    """Yield the edits of the text of one node."""
    if current == wanted:
        return
    edits = None
    if current and wanted and isinstance(node, yaml.MappingNode) and isinstance(wanted, dict):
        edits = _mapping_edits(text, node, current, wanted)
    elif current and wanted and isinstance(node, yaml.SequenceNode) and isinstance(wanted, list):
        edits = _sequence_edits(text, node, current, wanted)
    yield from [_replacement_edit(text, node, wanted)] if edits is None else edits


def _mapping_edits(
    text: str, node: yaml.MappingNode, current: dict[Any, Any], wanted: dict[Any, Any]
) -> list[_Edit] | None:
    """Return the edits of a mapping's keys; None if it has to be replaced as a whole."""
    names = [key.value for key, _ in node.value]
    kept = [name for name in names if name in wanted]
    without_braces = node.flow_style and text[node.start_mark.index] not in "{&"  # [key: value]
    if names != list(current) or not kept or without_braces:
        return None
    edits = []
    for (_, value), name in zip(node.value, names, strict=True):
        if name in wanted:
            edits += _edits(text, value, current[name], wanted[name])
    spans = [(key.start_mark.index, _content_end(value)) for key, value in node.value]
    removed = [index for index, name in enumerate(names) if name not in wanted]
    added = {name: value for name, value in wanted.items() if name not in current}
    return edits + _length_edits(text, node, spans, removed, added)


def _sequence_edits(
    text: str, node: yaml.SequenceNode, current: list[Any], wanted: list[Any]
) -> list[_Edit] | None:
    """Return the edits of a list's items; None if it has to be replaced as a whole."""
    labels, wanted_labels = (
        [_item_label(item) for item in current],
        [_item_label(item) for item in wanted],
    )
    kept = [label for label in labels if label in wanted_labels]
    if (
        kept
        and kept == wanted_labels[: len(kept)]
        and len(kept) < max(len(labels), len(wanted_labels))
    ):
        removed = [index for index, label in enumerate(labels) if label not in wanted_labels]
        spans = [_item_span(text, node, item) for item in node.value]
        return _length_edits(text, node, spans, removed, wanted[len(kept) :])
    if len(current) != len(wanted):
        return None
    pairs = zip(node.value, current, wanted, strict=True)
    return [edit for item, old, new in pairs for edit in _edits(text, item, old, new)]


def _item_label(item: Any) -> str:
    """Return what identifies a list item: its name or prefix, else its whole content."""
    names = (item.get("name"), item.get("prefix")) if isinstance(item, dict) else ()
    return next((name for name in names if isinstance(name, str)), repr(item))


def _length_edits(
    text: str,
    node: yaml.CollectionNode,
    spans: list[tuple[int, int]],
    removed: list[int],
    added: Any,
) -> list[_Edit]:
    """Return the edits that remove some children and append new ones after the last."""
    removal = _removal_from_flow if node.flow_style else _removal_from_block
    edits = [removal(text, spans, index) for index in removed]
    end = spans[-1][1]
    if added and node.flow_style:
        edits.append(_Edit(end, end, f", {flow_of(added)[1:-1]}"))
    elif added:
        lines = block_of(added, spans[0][0] - _line_start(text, spans[0][0]))
        if text[:end].endswith("\n"):  # a text block, which ends with its line
            edits.append(_Edit(end, end, f"{lines}\n"))
        else:
            line_end = _line_end(text, end)[0]
            edits.append(_Edit(line_end, line_end, f"\n{lines}"))
    return edits


def _removal_from_flow(text: str, spans: list[tuple[int, int]], index: int) -> _Edit:
    """Return the edit that removes a child from ``{...}`` or ``[...]``, with one comma."""
    start, end = spans[index]
    if comma := _COMMA.match(text, end):
        return _Edit(start, comma.end(), "")
    if index and "#" not in text[spans[index - 1][1] : start]:
        start = spans[index - 1][1]
    return _Edit(start, end, "")


def _removal_from_block(text: str, spans: list[tuple[int, int]], index: int) -> _Edit:
    """Return the edit that removes a child's lines; comments on lines of their own stay."""
    start, end = spans[index]
    if not text[:end].endswith("\n"):
        end = _line_end(text, end)[1]
    line = _line_start(text, start)
    if not text[line:start].strip():
        return _Edit(line, end, "")
    # The first key of a list item, after the dash. More keys follow: else the item is replaced.
    following = spans[index + 1][0] if index + 1 < len(spans) else spans[index][1]
    return _Edit(start, spans[index][1] if text[end:following].strip() else following, "")


def _replacement_edit(text: str, node: yaml.Node, wanted: Any) -> _Edit:
    """Return the edit that replaces a node by data; its anchor stays."""
    start, end = node.start_mark.index, _content_end(node)
    anchor = _ANCHOR.match(text, start)
    start = anchor.end() if anchor else start
    in_block = isinstance(node, yaml.CollectionNode) and not node.flow_style and not anchor
    if in_block and wanted and isinstance(wanted, dict | list):
        return _Edit(start, end, block_of(wanted, node.start_mark.column).lstrip(" "))
    key = text[:start].rstrip()
    if key.endswith(":") and "\n" in text[len(key) : start]:  # the value stood below its key
        start = len(key)
    before = " " if anchor or (key.endswith(":") and start == len(key)) else ""
    after = "\n" if text[start:end].endswith("\n") else ""
    return _Edit(start, end, before + flow_of(wanted) + after)


def _content_end(node: yaml.Node) -> int:
    """Return where the text of a node ends; end marks of blocks are after trailing comments."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style:
        last = node.value[-1]
        return _content_end(last[1] if isinstance(last, tuple) else last)
    return node.end_mark.index


def _item_span(text: str, node: yaml.SequenceNode, item: yaml.Node) -> tuple[int, int]:
    """Return start and end of a list item, in a block with its dash."""
    start = item.start_mark.index
    if not node.flow_style:
        start = text.rindex("-", 0, start)
    return start, _content_end(item)


def _line_end(text: str, index: int) -> tuple[int, int]:
    """Return where the line ends, and where the next one starts."""
    match = _LINE_END.search(text, index)
    return match.span() if match else (len(text), len(text))


def _line_start(text: str, index: int) -> int:
    return max(text.rfind(end, 0, index) for end in "\n\r\x85\u2028\u2029") + 1


def flow_of(data: Any) -> str:
    """Return data as YAML in flow style on one line, valid inside of ``[...]``."""
    line = yaml.dump([data], Dumper=_BlockDumper, sort_keys=False, allow_unicode=True,
                     default_flow_style=True, width=float("inf"))  # fmt: skip
    return line.strip()[1:-1]


def block_of(data: Any, column: int) -> str:
    """Return data as YAML in block style, indented to a column, without the last line end."""
    return "\n".join(" " * column + line for line in yaml_of(data).splitlines())
