"""Limits that all searches of one call share: nodes of each, seconds of all."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from graspless_pin.algorithms.options import SolveOptions


@dataclass(frozen=True)
class Limits:
    """When the searches of one call have to end.

    Attributes:
        node_limit: Nodes of each search; None: any number.
        deadline: Reading of `time.monotonic` at which every search ends.
    """

    node_limit: int | None = None
    deadline: float = np.inf

    @classmethod
    def of(cls, options: SolveOptions) -> Self:
        """Return the limits of options; their time begins now."""
        return cls.from_now(options.node_limit, options.time_limit)

    @classmethod
    def from_now(cls, node_limit: int | None, time_limit: float | None) -> Self:
        """Return the limits of so many nodes and seconds; None: no limit."""
        if time_limit is None:
            return cls(node_limit)
        return cls(node_limit, time.monotonic() + time_limit)

    @property
    def passed(self) -> bool:
        """Whether the time is over."""
        return self.deadline < np.inf and time.monotonic() > self.deadline

    def end(self, nodes: int) -> bool:
        """Return whether a search ends that has looked at so many nodes."""
        return (self.node_limit is not None and nodes >= self.node_limit) or self.passed

    @property
    def left(self) -> float | None:
        """Seconds that are left, at least zero; None: any."""
        return None if self.deadline == np.inf else max(self.deadline - time.monotonic(), 0.0)

    def within(self, options: SolveOptions) -> SolveOptions:
        """Return options with the time that is left."""
        left = self.left
        return options if left is None else replace(options, time_limit=left)


NO_LIMITS = Limits()
