"""Limits that all searches of one call share: nodes of each, seconds of all."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Self, TypedDict

import numpy as np

from graspless_pin.algorithms.options import SolveOptions


class LimitOptions(TypedDict):
    """The limits of one search, by name."""

    node_limit: int | None
    time_limit: float | None


@dataclass(frozen=True)
class Limits:
    """When the searches of one call have to end.

    Attributes:
        node_limit: Nodes of each search; None: any number.
        deadline: Reading of `time.monotonic` at which every search ends.
    """

    node_limit: int | None
    deadline: float

    @classmethod
    def of(cls, options: SolveOptions) -> Self:
        """Return the limits of options; their time begins now."""
        seconds = np.inf if options.time_limit is None else options.time_limit
        return cls(options.node_limit, time.monotonic() + seconds)

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() > self.deadline

    def within(self, options: SolveOptions) -> SolveOptions:
        """Return options with the time that is left."""
        return replace(options, time_limit=self.left["time_limit"])

    @property
    def left(self) -> LimitOptions:
        """What is left for the next search."""
        seconds = None if np.isinf(self.deadline) else max(self.deadline - time.monotonic(), 0.0)
        return {"node_limit": self.node_limit, "time_limit": seconds}
