"""Caches of values derived from records: records hold data only."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from itertools import chain
from math import copysign, isnan
from typing import Any, Generic, TypeVar
from weakref import ref

_Source = TypeVar("_Source")
_Value = TypeVar("_Value")
_Key = TypeVar("_Key")

MOST_SOURCES = 8
"""Number of sources whose values are kept."""


class Derived(Generic[_Source, _Value]):
    """A function of one source, whose values are cached for the last few sources.

    Sources are identified by identity and referenced weakly: the cache keeps no source alive, and
    the value of a deleted source is deleted, too. So a value must not refer to its source. Threads
    may share the cache: values that two of them need at the same time are at worst computed twice.
    """

    def __init__(self, make: Callable[[_Source], _Value], most: float = MOST_SOURCES) -> None:
        """Cache the results of ``make``, for at most ``most`` sources."""
        update_wrapper(self, make)
        self._make = make
        self._most = most
        self._entries: dict[int, tuple[ref[_Source], _Value]] = {}

    def __len__(self) -> int:
        """Return the number of values kept."""
        return len(self._entries)

    def __call__(self, source: _Source) -> _Value:
        """Return the value of a source, computed now if it is not cached."""
        key, entries = id(source), self._entries
        entry = entries.get(key)
        if entry is not None and entry[0]() is source:
            return entry[1]
        value = self._make(source)
        # The callback of a deleted source runs before another one can have its identity.
        entries[key] = ref(source, lambda _: entries.pop(key, None)), value
        while len(entries) > self._most:
            try:
                entries.pop(next(iter(entries), 0), None)
            except RuntimeError:  # another thread was faster
                continue
        return value


class Bounded(dict[_Key, _Value]):
    """A dictionary that is cleared before it would exceed a number of entries."""

    def __init__(self, most: int) -> None:
        """Start empty; hold at most ``most`` entries."""
        super().__init__()
        self._most = most

    def __setitem__(self, key: _Key, value: _Value) -> None:
        """Keep a value."""
        if key not in self and len(self) >= self._most:
            self.clear()
        super().__setitem__(key, value)

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave what it holds behind."""
        return type(self), (self._most,)


class Latest:
    """The latest value of each name, valid while the sources that it depends on are the same."""

    def __init__(self) -> None:
        """Start without values."""
        self._kept: dict[Any, tuple[tuple[Any, ...], Any]] = {}

    def get(self, name: Any, sources: tuple[Any, ...]) -> Any:
        """Return the latest value of a name; None if it depends on other sources.

        Args:
            name: Name of the value.
            sources: All that it depends on: the same objects, or equal numbers and texts.
        """
        entry = self._kept.get(name)
        if entry is None or len(entry[0]) != len(sources):
            return None
        return entry[1] if all(map(_is_same_source, entry[0], sources)) else None

    def value(self, name: Any, sources: tuple[Any, ...], make: Callable[[], _Value]) -> _Value:
        """Return the latest value of a name; computed now if it depends on other sources.

        Args:
            name: Name of the value.
            sources: All that it depends on: the same objects, or equal numbers and texts.
            make: Computes the value, which is not None.
        """
        value = self.get(name, sources)
        return self.put(name, sources, make()) if value is None else value

    def put(self, name: Any, sources: tuple[Any, ...], value: _Value) -> _Value:
        """Replace the value of a name, and return it; see `get`."""
        self._kept[name] = sources, value
        return value


def is_alike(one: Any, other: Any) -> bool:
    """Return whether two values are equal, including types, signs of zero and order.

    Args:
        one: A number, a text, None, or mappings and lists of these.
        other: The value to compare with.
    """
    kind = type(one)
    if one is other:
        return True
    if kind is not type(other):
        return False
    if isinstance(one, float):
        same = one == other or (isnan(one) and isnan(other))
        return same and copysign(1.0, one) == copysign(1.0, other)
    if kind is dict:
        return len(one) == len(other) and all(
            map(is_alike, chain(one, one.values()), chain(other, other.values()))
        )
    if kind is list:
        return len(one) == len(other) and all(map(is_alike, one, other))
    return bool(one == other)


_PLAIN = frozenset({float, int, str, bool, bytes})


def _is_same_source(one: Any, other: Any) -> bool:
    """Return whether two sources are the same object, or equal numbers or texts."""
    return one is other or (type(one) in _PLAIN and is_alike(one, other))
