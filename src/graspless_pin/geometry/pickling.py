"""Pickling of records: made again from their fields."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from types import MappingProxyType
from typing import Any


def remake(record: Any) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """Return how to make a dataclass record again from its fields, for pickling.

    Arrays come out of a pickle writeable, read-only views of mappings do not go into one, and
    cached values would travel with it; making the record anew does without all that and runs
    ``__post_init__``.
    """
    values = (getattr(record, item.name) for item in fields(record))
    return type(record), tuple(dict(v) if isinstance(v, MappingProxyType) else v for v in values)
