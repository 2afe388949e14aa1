"""Values that modules derive from records and keep for the next call: records are data only."""

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
"""Sources that a value is kept for."""


class Derived(Generic[_Source, _Value]):
    """A function of one source whose value is made once while the source is among the last few.

    A source is told apart by identity and held weakly: keeping it keeps no derived value alive for
    long, and a source that is gone takes its value along. So a value must not refer to its source.
    Threads may share the values: what two of them ask for at the same time is at worst made twice.
    """

    def __init__(self, make: Callable[[_Source], _Value], most: float = MOST_SOURCES) -> None:
        """Keep what ``make`` returns, for some sources at the most."""
        update_wrapper(self, make)
        self._make = make
        self._most = most
        self._entries: dict[int, tuple[ref[_Source], _Value]] = {}

    def __len__(self) -> int:
        """Return the number of values kept."""
        return len(self._entries)

    def __call__(self, source: _Source) -> _Value:
        """Return the value of a source, made now if it is not kept."""
        key, entries = id(source), self._entries
        entry = entries.get(key)
        if entry is not None and entry[0]() is source:
            return entry[1]
        value = self._make(source)
        # A source that is gone tells before another one can have its identity.
        entries[key] = ref(source, lambda _: entries.pop(key, None)), value
        while len(entries) > self._most:
            try:
                entries.pop(next(iter(entries), 0), None)
            except RuntimeError:  # another thread was faster
                continue
        return value


class Bounded(dict[_Key, _Value]):
    """A dictionary that forgets all it holds before it would hold too much."""

    def __init__(self, most: int) -> None:
        """Begin empty; hold ``most`` entries at most."""
        super().__init__()
        self._most = most

    def __setitem__(self, key: _Key, value: _Value) -> None:
        """Keep a value."""
        if len(self) >= self._most:
            self.clear()
        super().__setitem__(key, value)


class Latest:
    """Values by name, each good while what it was made from is the same."""

    def __init__(self) -> None:
        """Begin with none."""
        self._kept: dict[Any, tuple[tuple[Any, ...], Any]] = {}

    def get(self, name: Any, sources: tuple[Any, ...]) -> Any:
        """Return the value that a name was given last; None if it was made from something else.

        Args:
            name: What the value is called.
            sources: All that it depends on: the same objects, or equal numbers and texts.
        """
        kept = self._kept.get(name)
        if kept is None or len(kept[0]) != len(sources):
            return None
        return kept[1] if all(map(_is_same, kept[0], sources)) else None

    def made(self, name: Any, sources: tuple[Any, ...], make: Callable[[], _Value]) -> _Value:
        """Return the value that a name was given last; made now if it was made from others.

        Args:
            name: What the value is called.
            sources: All that it depends on: the same objects, or equal numbers and texts.
            make: Makes the value; it is not None.
        """
        value = self.get(name, sources)
        return self.put(name, sources, make()) if value is None else value

    def put(self, name: Any, sources: tuple[Any, ...], value: _Value) -> _Value:
        """Keep the value of a name instead of the last one, and return it; see `get`."""
        self._kept[name] = sources, value
        return value


def is_alike(one: Any, other: Any) -> bool:
    """Return whether two contents are the same, types, signs of zero and order included.

    Args:
        one: A number, a text, None, or mappings and lists of these.
        other: Another.
    """
    kind = type(one)
    if one is other or kind is not type(other):
        return one is other
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


def _is_same(one: Any, other: Any) -> bool:
    """Return whether two sources are the same object, or equal numbers or texts."""
    return one is other or (type(one) in _PLAIN and is_alike(one, other))
