"""Readers of plain values from a document, which refuse values of another type or size."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

MOST = 4096
"""Largest number of contacts, joints or cone edges that is read."""
MOST_LETTERS = 200
"""Largest number of characters of a name."""
LARGEST_READ, _SMALLEST = 1e60, 1e-60


def number(value: object, where: str) -> float:
    """Return a finite number, small enough that products of three do not overflow.

    Raises:
        ValueError: If it is no such number.
    """
    if isinstance(value, float) and _SMALLEST <= abs(value) <= LARGEST_READ:
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _refusal(where, value, "a number")
    try:
        real = float(value)
    except OverflowError:
        real = math.inf
    if abs(real) < _SMALLEST:
        return 0.0  # zero, or the rounding of it
    if not abs(real) <= LARGEST_READ:
        raise _refusal(where, value, f"a number of magnitude {LARGEST_READ:g} or less")
    return real


def whole(value: object, where: str, low: int, high: int) -> int:
    """Return a whole number from low to high.

    Raises:
        ValueError: If it is no such number.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise _refusal(where, value, f"a whole number, {low} to {high}")
    return value


def truth(value: object, where: str) -> bool:
    """Return a boolean.

    Raises:
        ValueError: If it is none.
    """
    if not isinstance(value, bool):
        raise _refusal(where, value, "true or false")
    return value


def word(value: object, where: str, known: tuple[str, ...]) -> str:
    """Return a text that is one of the known words.

    Raises:
        ValueError: If it is none of them.
    """
    if not isinstance(value, str) or value not in known:
        raise _refusal(where, value, f"one of {', '.join(known)}")
    return value


def text(value: object, where: str) -> str:
    """Return a text.

    Raises:
        ValueError: If it is none.
    """
    if not isinstance(value, str):
        raise _refusal(where, value, "a text")
    return value


def short_text(value: object, where: str) -> str:
    """Return a text that is short enough for a name.

    Raises:
        ValueError: If it is no such text.
    """
    if len(text(value, where)) > MOST_LETTERS:
        raise _refusal(where, value, f"a text of at most {MOST_LETTERS} characters")
    return text(value, where)


def entry(mapping: object, key: str, where: str) -> Any:
    """Return the value under a key.

    Raises:
        ValueError: If it is no mapping, or lacks the key.
    """
    if not isinstance(mapping, dict):
        raise _refusal(where, mapping, "a mapping")
    if key not in mapping:
        raise ValueError(f"{where} lacks the key {key!r}")
    return mapping[key]


def items(value: object, where: str, least: int, most: int) -> list[Any]:
    """Return a list with a length from least to most.

    Raises:
        ValueError: If it is no such list.
    """
    if not isinstance(value, list) or not least <= len(value) <= most:
        size = f"a list of length {len(value)}" if isinstance(value, list) else _value_text(value)
        wanted = str(least) if least == most else f"{least} to {most}"
        raise ValueError(f"{where} is {size}; it must be a list of length {wanted}")
    return value


def array(value: object, shape: tuple[int, ...], where: str, *, gaps: bool = False) -> np.ndarray:
    """Return an array of numbers; where there may be gaps, null is read as NaN.

    Raises:
        ValueError: If it has another shape, or an entry that is no number.
    """
    listed: list[Any] = [value]
    for length in shape:
        listed = [one for row in listed for one in items(row, where, length, length)]
    flat = [np.nan if gaps and one is None else number(one, where) for one in listed]
    return np.array(flat, dtype=np.float64).reshape(shape)


def enclosing_name(where: str) -> str:
    """Return the name of the part around a value from the value's name, such as ``key of part``."""
    return where.partition(" of ")[2] or where


def sparse(value: object, shape: dict[str, int], where: str) -> np.ndarray:
    """Return an array from a list of [index, ..., value] entries; the others are zero.

    Args:
        value: The list.
        shape: Name and size of each dimension.
        where: Name of the list in messages.

    Raises:
        ValueError: If it is no such list.
    """
    dense, width, called = np.zeros(tuple(shape.values())), len(shape) + 1, f"an entry of {where}"
    sizes = [(f"{name} of {enclosing_name(where)}", size - 1) for name, size in shape.items()]
    for listed in items(value, where, 0, dense.size):
        *indices, one = items(listed, called, width, width)
        pairs = zip(indices, sizes, strict=True)
        place = tuple([whole(index, name, 0, last) for index, (name, last) in pairs])
        dense[place] = number(one, called)
    return dense


def _refusal(where: str, value: object, wanted: str) -> ValueError:
    return ValueError(f"{where} is {_value_text(value)}; it must be {wanted}")


def _value_text(value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 10**30:
        return "a huge whole number"
    shown = repr(value) if isinstance(value, str | int | float | None) else type(value).__name__
    return shown if len(shown) <= 60 else f"{shown[:57]}..."
