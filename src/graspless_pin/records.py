"""Base classes and copies of frozen records: own arrays, pickles, a short ``repr``.

Only this module, and constructors, write into frozen records.
"""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import fields
from enum import Enum
from pathlib import PurePath
from types import MappingProxyType
from typing import Any, TypeVar, cast

import numpy as np

_FEW_ITEMS = 4
_LONGEST_VALUE = 80  # characters of a value


_Record = TypeVar("_Record")


def unchecked(kind: type[_Record], /, **values: Any) -> _Record:
    """Return a record of values that are valid by construction, without the constructor's checks.

    Args:
        kind: The class of the record.
        values: By name: all fields, and cached properties that are known.
    """
    record = object.__new__(kind)
    record.__dict__.update(values)
    return record


def changed(record: _Record, /, *forgotten: str, **values: Any) -> _Record:
    """Return a copy of a record with changed values, which are valid by construction.

    Args:
        record: The record; its cached properties are copied.
        forgotten: Names of cached properties that depend on the changes.
        values: By name, see `unchecked`.
    """
    copied = object.__new__(type(record))
    copied.__dict__.update(record.__dict__)
    for name in forgotten:
        copied.__dict__.pop(name, None)
    copied.__dict__.update(values)
    return copied


class Brief:
    """A base of dataclasses with ``repr=False``: a ``repr`` of a line or two."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Return the fields, without the items of arrays and long collections."""
        shown = [
            f"{item.name}={_brief(getattr(self, item.name))}"
            for item in fields(self)  # pyright: ignore[reportArgumentType]
            if item.repr and not item.name.startswith("_")
        ]
        return f"{type(self).__name__}({', '.join(shown)})"


def _brief(value: Any) -> str:
    match value:
        case Enum():
            return value.name
        case bool() | int() | None:
            return repr(value)
        case float():
            return f"{value:.6g}"
        case str() | PurePath():
            text = repr(str(value))
            return text if len(text) <= _LONGEST_VALUE else f"{text[: _LONGEST_VALUE - 4]}...'"
        case np.ndarray():
            return str(value.tolist()) if value.size < _FEW_ITEMS else f"<array {value.shape}>"
        case Mapping():
            if 0 < len(value) <= _FEW_ITEMS:
                inside = ", ".join(f"{_brief(key)}: {_brief(one)}" for key, one in value.items())
                return _text_or_count(f"{{{inside}}}", value)
            return f"<{len(value)} entries>" if value else "{}"
        case tuple() | list() | AbstractSet():
            if 0 < len(value) <= _FEW_ITEMS:
                return _text_or_count(f"({', '.join(map(_brief, value))})", value)
            return f"<{len(value)} items>" if value else "()"
        case _:
            # Records that hold arrays have no equality, and their long repr is not made.
            parameters = getattr(type(value), "__dataclass_params__", None)
            text = repr(value) if parameters and (parameters.eq or not parameters.repr) else ""
            return text if 0 < len(text) <= 2 * _LONGEST_VALUE else f"<{type(value).__name__}>"


def _text_or_count(text: str, values: Any) -> str:
    """Return a text if it is short, else the number of its values."""
    return text if len(text) <= _LONGEST_VALUE else f"<{len(values)} items>"


class PickledByFields:
    """A dataclass that is unpickled by its constructor from its fields.

    By default unpickled arrays are writeable, read-only views of mappings cannot be pickled, and
    cached values are pickled, too; the constructor avoids that and runs ``__post_init__``.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the fields."""
        values = (getattr(self, item.name) for item in fields(cast("Any", self)))
        return type(self), tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)


class Record(PickledByFields):
    """A frozen dataclass that owns its arrays and dictionaries."""

    def __post_init__(self) -> None:
        """Make its arrays and dictionaries read-only."""
        for name, value in list(vars(self).items()):
            if (own := frozen(value)) is not value:
                object.__setattr__(self, name, own)


def frozen(value: Any) -> Any:
    """Return a value whose arrays are made read-only; of a dictionary a read-only copy."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple | Mapping):
        for item in value.values() if isinstance(value, Mapping) else value:
            frozen(item)
    return MappingProxyType(dict(value)) if isinstance(value, dict) else value
