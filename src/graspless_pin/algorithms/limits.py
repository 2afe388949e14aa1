"""Limits that all searches of one call share: nodes of each, seconds of all."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Self, TypedDict

import numpy as np

from graspless_pin.problem.checks import real_number, whole_number


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
    def parse(cls, node_limit: int | None, time_limit: float | None) -> Self:
        """Return limits that begin now.

        Raises:
            ArgumentError: If there is less than one node, or the time is negative.
        """
        if node_limit is not None:
            node_limit = whole_number("node_limit", node_limit, 1)
        if time_limit is None:
            return cls(node_limit, np.inf)
        seconds = real_number("time_limit", time_limit, 0.0, finite=False)
        return cls(node_limit, time.monotonic() + seconds)

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return time.monotonic() > self.deadline

    @property
    def left(self) -> LimitOptions:
        """What is left for the next search."""
        seconds = None if np.isinf(self.deadline) else max(self.deadline - time.monotonic(), 0.0)
        return {"node_limit": self.node_limit, "time_limit": seconds}


NO_LIMITS = Limits(None, np.inf)
