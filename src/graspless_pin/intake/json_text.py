"""JSON with bounds: standard JSON alone, of a few levels, with numbers that a double holds."""

from __future__ import annotations

import json
import math
from typing import Any, NoReturn

from graspless_pin.errors import TextError
from graspless_pin.intake.text import bad_character

DEEPEST_JSON = 50
"""More levels of objects and lists than any document has."""
LONGEST_JSON_NUMBER = 500
"""More digits than any number has."""


def parse_json(text: str) -> Any:
    """Parse a JSON text.

    Raises:
        TextError: It is not standard JSON, is nested more than 50 levels deep, holds a number that
            is no finite double, a repeated key, or a character that cannot be printed.
    """
    try:
        data = json.loads(
            text,
            parse_int=_whole,
            parse_float=_real,
            parse_constant=_no_constant,
            object_pairs_hook=_mapping,
        )
    except RecursionError:
        raise TextError(_TOO_DEEP) from None
    except json.JSONDecodeError as error:
        raise TextError(f"is not JSON: {error}") from None
    _check(data)
    return data


_TOO_DEEP = f"is nested too deeply; at most {DEEPEST_JSON} levels are possible"


def _whole(digits: str) -> int:
    if len(digits) > LONGEST_JSON_NUMBER or not math.isfinite(float(digits)):
        raise TextError(f"has a whole number of {len(digits)} digits, which no double holds")
    return int(digits)


def _real(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise TextError(f"has the number {digits[:50]}, which no double holds")
    return value


def _no_constant(word: str) -> NoReturn:
    raise TextError(f"is not JSON: has the word {word}; write null for what is no number")


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) < len(pairs):
        names = [name for name, _ in pairs]
        repeated = next(name for name in made if names.count(name) > 1)
        raise TextError(f"has the key {repeated[:50]!r} twice in one object; keep one")
    return made


def _check(data: Any) -> None:
    """Check depth and text, level by level: no recursion, however deep."""
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
