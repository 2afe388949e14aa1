"""Checks of array arguments: each failure names the argument, the index and the value."""

from __future__ import annotations

import operator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError

FloatArray = NDArray[np.float64]

_UNIT_TOLERANCE = 1e-6


def read_only(array: FloatArray) -> FloatArray:
    """Return the array itself, marked read-only."""
    array.setflags(write=False)
    return array


def real_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Return a read-only float64 copy of ``value`` with the given shape (None: any length).

    Raises:
        ArgumentError: If the value is not numeric, has another shape or a NaN.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArgumentError(name, f"is not an array of numbers ({error})") from None
    expected = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
    if array.ndim != len(shape) or any(
        n not in (None, m) for n, m in zip(shape, array.shape, strict=True)
    ):
        raise ArgumentError(name, f"has shape {array.shape}; expected {expected}")
    if np.isnan(array).any():
        index = tuple(int(i) for i in np.argwhere(np.isnan(array))[0])
        raise ArgumentError(name, f"is NaN at index {index}; every entry must be a number")
    return read_only(array)


def finite_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Like `real_array`, and every entry must be finite."""
    array = real_array(name, value, shape)
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ArgumentError(name, f"is {array[index]} at index {index}; it must be finite")
    return array


def per_item(name: str, value: ArrayLike, count: int) -> FloatArray:
    """Return a (count,) array from a scalar or a (count,) array."""
    array = np.asarray(value)
    if array.ndim == 0:
        return real_array(name, np.full(count, array), (count,))
    return real_array(name, value, (count,))


def first_bad(name: str, values: FloatArray, bad: NDArray[np.bool_], rule: str) -> None:
    """Raise for the first entry that is marked bad.

    Raises:
        ArgumentError: Naming the index, the value and the rule that it breaks.
    """
    if bad.any():
        index = int(np.argmax(bad))
        raise ArgumentError(name, f"is {values[index]} at index {index}; {rule}")


def unit_rows(name: str, vectors: FloatArray) -> None:
    """Check that every row is a unit vector to 1e-6.

    Raises:
        ArgumentError: Naming the first row that is not.
    """
    lengths = np.linalg.norm(vectors, axis=-1)
    bad = np.abs(lengths - 1.0) > _UNIT_TOLERANCE
    if bad.any():
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        where = index[0] if len(index) == 1 else index
        raise ArgumentError(
            name,
            f"row {where} is {vectors[index].tolist()} with length {lengths[index]:.6g}; "
            "each must be a unit vector",
        )


def whole_number(name: str, value: object, minimum: int) -> int:
    """Return ``value`` as an int not below ``minimum``.

    Raises:
        ArgumentError: If it is not a whole number or too small.
    """
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    if number is None or isinstance(value, bool) or number < minimum:
        raise ArgumentError(name, f"is {value!r}; it must be a whole number >= {minimum}")
    return number
