"""Checks of array arguments: each failure names the argument, the index and the value.

Also the units of generalised forces: N m or N for each column of J and each row of W.
"""

from __future__ import annotations

import operator
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.bounds import LARGEST, LARGEST_REGULARIZATION
from graspless_pin.errors import ArgumentError
from graspless_pin.suggestions import knows_instead, names_in_words, nearest_name, what_to_pass

_LARGEST_OF = {"regularization": LARGEST_REGULARIZATION}

FloatArray = NDArray[np.float64]

SINGULAR = 1e-12
"""An inertia matrix with ones on its diagonal is singular where an eigenvalue is below this."""

_ENTRIES = {"torques": ", one per joint"}
"""Meaning of an argument's entries, by its name, for messages."""
_UNIT_TOLERANCE = 1e-6
_SYMMETRY_TOLERANCE = 1e-9
_Choice = TypeVar("_Choice", bound=StrEnum)
_Array = TypeVar("_Array", bound=NDArray[Any])


def read_only(array: _Array) -> _Array:
    """Return the array itself, marked read-only."""
    array.setflags(write=False)
    return array


def real_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Return a read-only float64 copy of ``value`` with the given shape (None: any length).

    Raises:
        ArgumentError: If the value is not numeric, has another shape, a NaN, an entry that is too
            large, or a mask.
    """
    array = as_floats(value)
    if type(value) is np.ndarray and array is not None:
        if array.shape == shape and all_within((array,)):
            return read_only(array)
    else:
        _refuse_masks(name, value)
    if array is None:
        text = next((one for one in _nested_items(value) if isinstance(one, str)), None)
        if knows_instead(name, value):
            raise ArgumentError(name, what_to_pass(name, value, "array of real numbers"))
        must = "it must be an array of real numbers"
        raise ArgumentError(name, f"is {value!r:.200}; {must}{_text_advice(text)}")
    if not _has_shape(array, shape):
        expected = str(tuple("any" if n is None else n for n in shape)).replace("'", "")
        meant = "; it is transposed" if _has_shape(array.T, shape) else _ENTRIES.get(name, "")
        raise ArgumentError(name, f"has shape {array.shape}; expected {expected}{meant}")
    if np.count_nonzero(np.isnan(array)):
        index = tuple(int(i) for i in np.argwhere(np.isnan(array))[0])
        raise ArgumentError(name, f"is NaN at index {index}; every entry must be a number")
    too_large = np.isfinite(array) & (np.abs(array) > LARGEST)
    if np.count_nonzero(too_large):
        index = tuple(int(i) for i in np.argwhere(too_large)[0])
        raise ArgumentError(
            name, f"is {array[index]} at index {index}; it must be within ±{LARGEST:g}"
        )
    return read_only(array)


def as_floats(value: ArrayLike) -> FloatArray | None:
    """Return a float64 copy of an array of real numbers; None if an entry is anything else."""
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return np.array(value)
    with suppress(TypeError, ValueError):
        # In a list that holds numbers as well, numpy makes numbers of true and false.
        items = () if isinstance(value, np.ndarray) else np.asarray(value, dtype=object).flat
        if np.asarray(value).dtype.kind in "fiu" and {bool, np.bool_}.isdisjoint(map(type, items)):
            return np.array(value, dtype=np.float64)
    return None


def _has_shape(array: FloatArray, shape: tuple[int | None, ...]) -> bool:
    """Return whether an array has the given shape, in which None is any length."""
    return array.shape == shape or (
        array.ndim == len(shape)
        and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    )


def _refuse_masks(name: str, value: object) -> None:
    """Raise an error for masked entries, whose masks a plain array would lose."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        masked = int(np.ma.count_masked(value))
        raise ArgumentError(name, f"has {masked} masked entries; every entry must be a number")


def finite_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> FloatArray:
    """Return what `real_array` does; every entry must be finite."""
    array = real_array(name, value, shape)
    if not np.isfinite(array).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ArgumentError(name, f"is {array[index]} at index {index}; it must be finite")
    return array


def unit_vector(name: str, value: ArrayLike) -> FloatArray:
    """Return a (3,) direction scaled to length 1.

    Raises:
        ArgumentError: If it is zero, or not three finite numbers.
    """
    vector = finite_array(name, value, (3,))
    if not vector.any():
        raise ArgumentError(name, "needs a direction, got zeros")
    vector = vector / np.abs(vector).max()  # squares of small numbers are zero
    return vector / np.linalg.norm(vector)


def motor_torques(names: Sequence[str], given: ArrayLike | Mapping[str, float]) -> FloatArray:
    """Return (L,) joint torques from an array in the order of the joints, or a mapping by name.

    Args:
        names: L names of the joints.
        given: L torques, N m (N), as an array or by joint name.

    Raises:
        ArgumentError: If a name is unknown or missing, or they are not L finite numbers.
    """
    if isinstance(given, Mapping):
        check_known("torques", "joint", given, names)
        if missing := [name for name in names if name not in given]:
            raise ArgumentError(
                "torques", f"has no entry for {', '.join(map(repr, missing))}; give all joints"
            )
        given = [given[name] for name in names]
    return finite_array("torques", given, (len(names),))


def all_true(flags: NDArray[np.bool_]) -> bool:
    """Return whether every flag is set: as ``all``, in a third of its time for a few flags."""
    return np.count_nonzero(flags) == flags.size


def all_finite(arrays: Sequence[FloatArray]) -> bool:
    """Return whether every entry of every array is finite."""
    return all(all_true(np.isfinite(array)) for array in arrays)


def all_within(arrays: Sequence[FloatArray], most: float = LARGEST) -> bool:
    """Return whether no entry of any array is NaN or above this magnitude."""
    return all(all_true(np.abs(array) <= most) for array in arrays)


def squared_lengths(vectors: FloatArray) -> FloatArray:
    """Return the (M,) squared lengths of (M, 3) rows."""
    return np.einsum("ij,ij->i", vectors, vectors)


def array_of_items(name: str, value: ArrayLike, count: int) -> FloatArray:
    """Return a (count,) array from a scalar, which is repeated, or a (count,) array."""
    if np.isscalar(value) or (isinstance(value, np.ndarray) and value.ndim == 0):
        return np.broadcast_to(real_array(name, np.reshape(value, 1), (1,)), (count,))
    return real_array(name, value, (count,))


def refuse_first_bad(name: str, values: FloatArray, bad: NDArray[np.bool_], rule: str) -> None:
    """Raise an error for the first entry that is marked bad.

    Raises:
        ArgumentError: Naming the index, the value and the rule that it breaks.
    """
    if bad.any():
        index = int(np.argmax(bad))
        raise ArgumentError(name, f"is {values[index]} at index {index}; {rule}")


def check_unit_rows(name: str, vectors: FloatArray) -> None:
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


def _short_repr(value: object) -> str:
    """Return the ``repr`` of a value, shortened for messages; Python refuses very long integers."""
    try:
        return f"{value!r:.100}"
    except ValueError:
        return "too large a number"


def _text_advice(value: object) -> str:
    """Return advice for a number given as text; empty if the value is not text."""
    if not isinstance(value, str):
        return ""
    with suppress(ValueError):
        return f", not text; write {float(value):g}"
    return ", not text"


def _nested_items(value: Any) -> Iterator[Any]:
    """Yield the items of nested lists and tuples."""
    if isinstance(value, list | tuple):
        for item in value:
            yield from _nested_items(item)
    else:
        yield value


def real_number(name: str, value: object, minimum: float, *, finite: bool = True) -> float:
    """Return ``value`` as a float not below ``minimum``.

    Raises:
        ArgumentError: If it is not a real number, is NaN, too small or too large, or infinite where
            finite.
    """
    ok = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    number = np.nan
    with suppress(OverflowError):  # a whole number may be larger than any float
        number = float(value) if ok else np.nan  # type: ignore[arg-type]
    if not number >= minimum or (finite and np.isinf(number)):
        kind = "finite number" if finite else "number"
        must = f"it must be a {kind}" + (f" >= {minimum:g}" if np.isfinite(minimum) else "")
        raise ArgumentError(name, f"is {_short_repr(value)}; {must}{_text_advice(value)}")
    most = _LARGEST_OF.get(name, LARGEST)
    if finite and number > most:
        raise ArgumentError(name, f"is {number:g}; it must be from {minimum:g} to {most:g}")
    return number


def whole_number(
    name: str, value: object, minimum: int | None = None, maximum: int | None = None
) -> int:
    """Return ``value`` as an int from ``minimum`` to ``maximum``; None: no such limit.

    Raises:
        ArgumentError: If it is not a whole number, too small or too large.
    """
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    too_small = number is not None and minimum is not None and number < minimum
    if number is None or isinstance(value, bool) or too_small:
        least = "" if minimum is None else f" >= {minimum}"
        raise ArgumentError(name, f"is {_short_repr(value)}; it must be a whole number{least}")
    if maximum is not None and number > maximum:
        raise ArgumentError(
            name, f"is {_short_repr(number)}; it must be from {minimum} to {maximum}"
        )
    return number


def truth_values(**values: object) -> None:
    """Check that options are True or False: a text such as ``"no"`` would count as True.

    Raises:
        ArgumentError: Naming the first that is neither.
    """
    for name, value in values.items():
        if not isinstance(value, bool | np.bool_):
            raise ArgumentError(name, f"is {_short_repr(value)}; it must be True or False")


def check_callback(name: str, value: object) -> None:
    """Check that a callback is a function or None.

    Raises:
        ArgumentError: If it is neither.
    """
    if value is not None and not callable(value):
        raise ArgumentError(name, f"is {_short_repr(value)}; it must be a function or None")


def choice(options: type[_Choice], name: str, value: str) -> _Choice:
    """Return the member of an enum with a given value.

    Raises:
        ArgumentError: Naming the argument and the values it can have.
    """
    return options(one_of(tuple(options), name, value))


def unknown_name(argument: str, kind: str, name: str, known: Sequence[str]) -> ArgumentError:
    """Return the error for a name that is not among the known ones, which it lists."""
    return ArgumentError(argument, f"unknown {kind} {name!r}; {names_in_words(name, known)}")


def check_known(argument: str, kind: str, names: Iterable[str], known: Collection[str]) -> None:
    """Raise an error for names that are not among the known ones.

    Raises:
        ArgumentError: Listing the known names.
    """
    for name in names:
        if name not in known:
            raise unknown_name(argument, kind, name, tuple(known))


def one_of(known: Collection[str], name: str, value: str) -> str:
    """Return a text if it is one of the known ones.

    Raises:
        ArgumentError: Naming the argument and the values it can have.
    """
    if isinstance(value, str) and value in known:
        return value
    listed = ", ".join(repr(str(option)) for option in known)
    closest = nearest_name(value, known)
    meant = "" if closest is None else f"; did you mean {closest!r}?"
    raise ArgumentError(name, f"is {value!r:.100}; it must be one of {listed}{meant}")


def checked_inertia(
    name: str, inertia: ArrayLike, count: int, *, definite: bool = False
) -> FloatArray:
    """Return a symmetric, positive semidefinite (count, count) matrix, read-only.

    Tolerances are relative to the diagonal, so that units do not matter.

    Args:
        name: Name of the argument, for messages.
        inertia: The matrix.
        count: Number of its rows.
        definite: Whether it must be positive definite.

    Raises:
        ArgumentError: Naming the argument, the index and the value that is wrong.
    """
    matrix = finite_array(name, inertia, (count, count))
    diagonal = matrix.diagonal()
    kind = "positive" if definite else ">= 0"
    bad = (diagonal <= 0.0) if definite else (diagonal < 0.0)
    if bad.any():
        index = int(np.argmax(bad))
        raise ArgumentError(
            name, f"is {diagonal[index]} at index {(index, index)}; the diagonal must be {kind}"
        )
    roots = np.sqrt(diagonal)
    scale = np.outer(roots, roots)
    for wrong, rule in (
        (np.abs(matrix - matrix.T) > _SYMMETRY_TOLERANCE * scale, "the matrix must be symmetric"),
        (np.abs(matrix) > (1.0 + _SYMMETRY_TOLERANCE) * scale, "it must be positive semidefinite"),
    ):
        if wrong.any():
            row, column = (int(i) for i in np.argwhere(wrong)[0])
            raise ArgumentError(
                name,
                f"is {matrix[row, column]} at index {(row, column)} and {matrix[column, row]} at "
                f"{(column, row)}, beside {diagonal[row]} and {diagonal[column]} on the diagonal; "
                f"{rule}",
            )
    least = float(np.linalg.eigvalsh(with_unit_diagonal(matrix)).min(initial=1.0))
    if least < (SINGULAR if definite else -_SYMMETRY_TOLERANCE):
        rule = "definite" if definite else "semidefinite"
        raise ArgumentError(
            name,
            f"has the eigenvalue {least:.3g} when its diagonal is scaled to ones; it must be "
            f"positive {rule}",
        )
    return read_only(0.5 * (matrix + matrix.T))


def with_unit_diagonal(inertia: FloatArray) -> FloatArray:
    """Return the matrix scaled so that its positive diagonal entries are one."""
    diagonal = inertia.diagonal()
    roots = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return inertia / np.outer(roots, roots)


class JointUnit(StrEnum):
    """Unit of the generalised force of a joint or of a passive coordinate.

    See the example of `assemble_joint_space`.
    """

    TORQUE = "N m"
    """Of a revolute joint."""
    FORCE = "N"
    """Of a prismatic joint, a tendon, or a hybrid finger's normal force."""


FREE_BODY = (JointUnit.FORCE,) * 3 + (JointUnit.TORQUE,) * 3
"""Units of the wrench on one free body."""


def torque_mask(units: Sequence[JointUnit]) -> NDArray[np.bool_]:
    """Return the mask of the coordinates whose generalised forces are in N m."""
    return np.array([unit is JointUnit.TORQUE for unit in units], dtype=bool)


def checked_units(units: Sequence[str] | None, count: int) -> tuple[JointUnit, ...]:
    """Return the units of ``count`` joints; None: all are revolute.

    Raises:
        ArgumentError: Naming the index and the value that is wrong.
    """
    if units is None:
        return (JointUnit.TORQUE,) * count
    return _checked_unit_names("joint_units", units, count, "the jacobian has {} columns")


def checked_passive_units(units: Sequence[str] | None, count: int) -> tuple[JointUnit, ...]:
    """Return the units of ``count`` passive coordinates; None: those of free bodies.

    Raises:
        ArgumentError: Naming the index and the value that is wrong.
    """
    if units is not None:
        return _checked_unit_names("passive_units", units, count, "the wrench_matrix has {} rows")
    bodies, remainder = divmod(count, len(FREE_BODY))
    if remainder:
        raise ArgumentError(
            "passive_units",
            f"is missing for a wrench_matrix of {count} rows; it may be left out only for free "
            f"bodies, each of {len(FREE_BODY)} rows: three 'N' and three 'N m'",
        )
    return FREE_BODY * bodies


def _checked_unit_names(
    name: str, units: Sequence[str], count: int, rule: str
) -> tuple[JointUnit, ...]:
    if isinstance(units, str) or not isinstance(units, Sequence):
        raise ArgumentError(name, f"is {units!r}; it must be a sequence of units")
    if len(units) != count:
        raise ArgumentError(name, f"has {len(units)} units; {rule.format(count)}")
    allowed = ", ".join(repr(str(unit)) for unit in JointUnit)
    for index, unit in enumerate(units):
        if unit not in list(JointUnit):
            raise ArgumentError(name, f"is {unit!r} at index {index}; it must be one of {allowed}")
    return tuple(JointUnit(unit) for unit in units)


def units_text(units: Sequence[JointUnit]) -> str:
    """Return the unit of all joints as text, or, if they differ, which joints have which."""
    if JointUnit.FORCE not in units:
        return JointUnit.TORQUE.value
    if JointUnit.TORQUE not in units:
        return JointUnit.FORCE.value
    return "N m; N for prismatic and hybrid joints"
