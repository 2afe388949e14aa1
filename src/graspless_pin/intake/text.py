"""Texts within bounds: characters and names, JSON, and XML without entities."""

from __future__ import annotations

import json
import math
import re
import xml.etree.ElementTree as ET
from typing import Any, NoReturn
from xml.parsers import expat

from graspless_pin.bounds import LONGEST_NAME
from graspless_pin.errors import TextError

_BEGINNING = 30  # characters of a name that a message shows
_UNPRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")


def bad_character(text: str) -> str | None:
    """Return the code of the first refused character, such as ``U+D800``; None without any.

    Refused are control characters, which terminals obey, and unpaired surrogates, which no file can
    hold.
    """
    match = _UNPRINTABLE.search(text)
    return f"U+{ord(match[0]):04X}" if match else None


def fault_of_name(name: str) -> str:
    """Return the fault of a name that is too long, with its beginning; empty if it is valid."""
    if len(name) <= LONGEST_NAME:
        return ""
    return (
        f"has the name {name[:_BEGINNING]!r}... of {len(name)} characters; a name may have at most "
        f"{LONGEST_NAME}"
    )


def printable(text: str) -> str:
    """Return the text with each character that `bad_character` refuses replaced by its code."""
    return _UNPRINTABLE.sub(lambda match: f"<U+{ord(match[0]):04X}>", text)


DEEPEST_JSON = 50
"""Most levels of objects and lists, more than any document has."""
LONGEST_JSON_NUMBER = 500
"""Most digits of an integer."""


def parse_json(text: str) -> Any:
    """Parse a JSON text.

    Raises:
        TextError: It is not standard JSON, is nested more than 50 levels deep, holds a number that
            is no finite double, a repeated key, or a character that cannot be printed.
    """
    try:
        data = json.loads(
            text,
            parse_int=_parse_integer,
            parse_float=_parse_float,
            parse_constant=_refuse_constant,
            object_pairs_hook=_without_repeated_keys,
        )
    except RecursionError:
        raise TextError(_TOO_DEEP) from None
    except json.JSONDecodeError as error:
        raise TextError(f"is not JSON: {error}") from None
    _check_depth_and_text(data)
    return data


_TOO_DEEP = f"is nested too deeply; at most {DEEPEST_JSON} levels are possible"


def _parse_integer(digits: str) -> int:
    if len(digits) > LONGEST_JSON_NUMBER or not math.isfinite(float(digits)):
        raise TextError(f"has an integer of {len(digits)} digits; at most 1.8e308 is possible")
    return int(digits)


def _parse_float(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise TextError(f"has the number {digits[:50]}; at most 1.8e308 is possible")
    return value


def _refuse_constant(word: str) -> NoReturn:
    raise TextError(f"is not JSON: has the word {word}; write null instead of it")


def _without_repeated_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        names = [name for name, _ in pairs]
        repeated = next(name for name in mapping if names.count(name) > 1)
        raise TextError(f"has the key {repeated[:50]!r} twice in one object; keep one")
    return mapping


def _check_depth_and_text(data: Any) -> None:
    """Check depth and characters of JSON data, level by level without recursion."""
    level = [data]
    for _ in range(DEEPEST_JSON + 1):
        inner: list[Any] = []
        for item in level:
            if isinstance(item, str):
                code = bad_character(item)
                if code is not None:
                    raise TextError(f"has the character {code}, which cannot be printed")
            elif isinstance(item, dict):
                inner += item
                inner += item.values()
            elif isinstance(item, list):
                inner += item
        level = inner
        if not level:
            return
    raise TextError(_TOO_DEEP)


DEEPEST_XML = 100
"""Most levels, more than any file has; deeper ones would cost stack in readers."""
MOST_ELEMENTS = 200_000
"""Most elements, more than any file has."""


def parse_xml(content: bytes) -> ET.Element:
    """Return the root element of XML; no entity is expanded.

    Prefixes stay part of the names (``drake:rotor_inertia``), declared or not: readers of URDFs do
    not need a declaration, so that many files have none.

    Raises:
        TextError: It is empty, not well-formed, declares a DOCTYPE or entities, is nested more than
            100 levels deep or has more than 200 000 elements.
    """
    if not content.strip():
        raise TextError("is empty; give the file that was meant, or export it again")
    builder = ET.TreeBuilder()
    depth = count = 0

    def refuse_declaration(*_: object) -> None:
        raise TextError(
            "the file declares a DOCTYPE or XML entities; it needs neither, remove the declaration"
        )

    def start_element(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > DEEPEST_XML:
            raise TextError(f"is nested too deeply; at most {DEEPEST_XML} levels are possible")
        if count > MOST_ELEMENTS:
            raise TextError(f"has more than {MOST_ELEMENTS} elements, the most that is possible")
        builder.start(name, attributes)

    def end_element(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    reader = expat.ParserCreate()
    reader.buffer_text = True
    reader.StartDoctypeDeclHandler = refuse_declaration
    reader.EntityDeclHandler = refuse_declaration
    reader.StartElementHandler = start_element
    reader.EndElementHandler = end_element
    reader.CharacterDataHandler = builder.data
    try:
        reader.Parse(content, True)  # noqa: FBT003 - final, a positional-only flag
    except (expat.ExpatError, ValueError, LookupError) as error:
        # An encoding that is unknown or cannot be used for XML raises other errors than ExpatError.
        raise TextError(f"not well-formed XML ({error})") from error
    return builder.close()
