"""Records that are pickled by their fields, and whose arrays are read-only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, cast

import numpy as np


class PickledByFields:
    """A dataclass that pickles make again from its fields.

    Arrays come out of a pickle writeable, read-only views of mappings do not go into one, and
    cached values would travel with it; making the record anew does without all that and runs
    ``__post_init__``.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the fields."""
        values = (getattr(self, item.name) for item in fields(cast("Any", self)))
        return type(self), tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)


class Record(PickledByFields):
    """A frozen dataclass that owns its arrays and dictionaries."""

    def __post_init__(self) -> None:
        """Make them read-only."""
        for name, value in list(vars(self).items()):
            _make_read_only(value)
            if isinstance(value, dict):
                object.__setattr__(self, name, MappingProxyType(dict(value)))


def _make_read_only(value: Any) -> None:
    """Make all arrays in a value read-only."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple | Mapping):
        for item in value.values() if isinstance(value, Mapping) else value:
            _make_read_only(item)
