"""Values that modules derive from records and keep for the next call: records are data only."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar
from weakref import ref

_Source = TypeVar("_Source")
_Value = TypeVar("_Value")

MOST_SOURCES = 8
"""Sources that a value is kept for."""


class Derived(Generic[_Source, _Value]):
    """Values derived from the last few sources, each made once while its source is among them.

    A source is told apart by identity and held weakly: keeping it keeps no derived value alive for
    long, and a source that is gone takes its value along. So a value must not refer to its source.
    Threads may share the values: the entries are replaced all at once, and what two threads ask for
    at the same time is at worst made twice.
    """

    def __init__(self, make: Callable[[_Source], _Value]) -> None:
        """Keep what ``make`` returns."""
        self._make = make
        self._entries: dict[int, tuple[ref[_Source], _Value]] = {}

    def __len__(self) -> int:
        """Return the number of values kept."""
        return len(self._entries)

    def of(self, source: _Source) -> _Value:
        """Return the value of a source, made now if it is not kept."""
        key = id(source)
        entry = self._entries.get(key)
        if entry is not None and entry[0]() is source:
            return entry[1]
        value = self._make(source)
        entries = {**self._entries, key: (ref(source, self._forget), value)}
        if len(entries) > MOST_SOURCES:
            del entries[next(iter(entries))]
        self._entries = entries
        return value

    def _forget(self, gone: ref[_Source]) -> None:
        self._entries = {key: kept for key, kept in self._entries.items() if kept[0] is not gone}
