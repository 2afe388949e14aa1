"""Read plain values from a document: anything else than what must stand there is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

MOST = 4096
"""Contacts, joints and cone edges that are read."""
MOST_LETTERS = 200
"""Characters of a name."""
LARGEST_READ, _SMALLEST = 1e60, 1e-60


def number(value: object, where: str) -> float:
    """Return a finite number of a size that products of three bear.

    Raises:
        ValueError: If it is none.
    """
    if isinstance(value, float) and _SMALLEST <= abs(value) <= LARGEST_READ:
        return value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _wrong(where, value, "a number")
    try:
        real = float(value)
    except OverflowError:
        real = math.inf
    if abs(real) < _SMALLEST:
        return 0.0  # zero, or the rounding of it
    if not abs(real) <= LARGEST_READ:
        raise _wrong(where, value, f"a number up to {LARGEST_READ:g}")
    return real


def whole(value: object, where: str, low: int, high: int) -> int:
    """Return a whole number between two.

    Raises:
        ValueError: If it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise _wrong(where, value, f"a whole number, {low} to {high}")
    return value


def truth(value: object, where: str) -> bool:
    """Return true or false.

    Raises:
        ValueError: If it is neither.
    """
    if not isinstance(value, bool):
        raise _wrong(where, value, "true or false")
    return value


def word(value: object, where: str, known: tuple[str, ...]) -> str:
    """Return one of some words.

    Raises:
        ValueError: If it is none of them.
    """
    if not isinstance(value, str) or value not in known:
        raise _wrong(where, value, f"one of {', '.join(known)}")
    return value


def text(value: object, where: str) -> str:
    """Return a text.

    Raises:
        ValueError: If it is none.
    """
    if not isinstance(value, str):
        raise _wrong(where, value, "a text")
    return value


def short_text(value: object, where: str) -> str:
    """Return a text that is not too long for a name.

    Raises:
        ValueError: If it is none.
    """
    if len(text(value, where)) > MOST_LETTERS:
        raise _wrong(where, value, f"a text of at most {MOST_LETTERS} characters")
    return text(value, where)


def entry(mapping: object, key: str, where: str) -> Any:
    """Return what stands under a key.

    Raises:
        ValueError: If the mapping is none or lacks it.
    """
    if not isinstance(mapping, dict):
        raise _wrong(where, mapping, "a mapping")
    if key not in mapping:
        raise ValueError(f"{where} lacks the key {key!r}")
    return mapping[key]


def items(value: object, where: str, least: int, most: int) -> list[Any]:
    """Return a list of so many entries.

    Raises:
        ValueError: If it is none.
    """
    if not isinstance(value, list) or not least <= len(value) <= most:
        size = f"of {len(value)} entries" if isinstance(value, list) else _shown(value)
        wanted = str(least) if least == most else f"{least} to {most}"
        raise ValueError(f"{where} is {size}; it must be a list of {wanted}")
    return value


def array(value: object, shape: tuple[int, ...], where: str, *, gaps: bool = False) -> np.ndarray:
    """Return an array of numbers; where there may be gaps, null is read as NaN.

    Raises:
        ValueError: If it has another shape or something that is no number.
    """
    listed: list[Any] = [value]
    for length in shape:
        listed = [one for row in listed for one in items(row, where, length, length)]
    flat = [np.nan if gaps and one is None else number(one, where) for one in listed]
    return np.array(flat, dtype=np.float64).reshape(shape)


def whose(where: str) -> str:
    """Return what something is part of that is called by both."""
    return where.partition(" of ")[2] or where


def sparse(value: object, shape: dict[str, int], where: str) -> np.ndarray:
    """Return an array of which a list has [index, ..., value] entries; the others are zero.

    Args:
        value: The list.
        shape: What each index is called, with how many there are.
        where: What it is called.

    Raises:
        ValueError: If it is none.
    """
    found, width, called = np.zeros(tuple(shape.values())), len(shape) + 1, f"an entry of {where}"
    sizes = [(f"{name} of {whose(where)}", size - 1) for name, size in shape.items()]
    for listed in items(value, where, 0, found.size):
        *indices, one = items(listed, called, width, width)
        pairs = zip(indices, sizes, strict=True)
        place = tuple([whole(index, name, 0, last) for index, (name, last) in pairs])
        found[place] = number(one, called)
    return found


def _wrong(where: str, value: object, wanted: str) -> ValueError:
    return ValueError(f"{where} is {_shown(value)}; it must be {wanted}")


def _shown(value: object) -> str:
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 10**30:
        return "a huge whole number"
    shown = repr(value) if isinstance(value, str | int | float | None) else type(value).__name__
    return shown if len(shown) <= 60 else f"{shown[:57]}..."
