"""The loop of every tree search: over modes, directions of friction, forces and outcomes.

And when such a search ends: `Limits`.

A node is a part of what is searched. Whoever visits it closes it, by a bound or by kinematics, or
splits it into children that together hold all of it (branch and bound: Land and Doig, Econometrica
28(3), 1960). What closes a node is the caller's.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Generic, Self, TypeVar

Node = TypeVar("Node")
_Options = TypeVar("_Options", bound=Any)


class TreeSearch(Generic[Node]):
    """Open nodes, to be visited best bound first; without bounds, depth first.

    Among equal bounds the deepest node comes first, then the youngest: the search dives to an
    answer.

    Examples:
        >>> from graspless_pin.tree_search import TreeSearch
        >>> search = TreeSearch([(0, 8)])
        >>> visited = []
        >>> for _, (low, high) in search:
        ...     visited.append((low, high))
        ...     if high - low > 4:
        ...         middle = (low + high) // 2
        ...         search.add([(middle, high), (low, middle)])  # the last one is visited first
        >>> visited
        [(0, 8), (0, 4), (4, 8)]
    """

    def __init__(self, roots: Iterable[Node] = (), bound: float = 0.0) -> None:
        """Begin with some nodes.

        Args:
            roots: The nodes; what they hold together is searched.
            bound: What is proven of all of them.
        """
        self._open: list[tuple[float, int, int, Node]] = []
        self._depth, self._born = 0, 0
        self.add(roots, bound)

    def __len__(self) -> int:
        """Return how many nodes are open."""
        return len(self._open)

    def __iter__(self) -> Iterator[tuple[float, Node]]:
        """Yield each open node with the bound that it was added with, until none is open."""
        while self._open:
            bound, minus_depth, _, node = heapq.heappop(self._open)
            self._depth = 1 - minus_depth
            yield bound, node

    def add(self, children: Iterable[Node], bound: float = 0.0) -> None:
        """Add the children of the node that is being visited.

        Args:
            children: Nodes; the last one is visited first.
            bound: What is proven of all of them: nothing in them is lower.
        """
        for child in children:
            self._born += 1
            heapq.heappush(self._open, (bound, -self._depth, -self._born, child))

    def open_nodes(self) -> list[Node]:
        """Return the open nodes in the order in which they would be visited."""
        return [node for _, _, _, node in sorted(self._open, key=lambda one: one[:3])]


@dataclass(frozen=True)
class Limits:
    """When the searches of one call have to end.

    Attributes:
        node_limit: Nodes of each search; None: any number.
        deadline: Reading of `time.monotonic` at which every search ends.
    """

    node_limit: int | None = None
    deadline: float = inf

    @classmethod
    def of(cls, options: Any) -> Self:
        """Return the limits of `SolveOptions`; their time begins now."""
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
        return self.deadline < inf and time.monotonic() > self.deadline

    def end(self, nodes: int) -> bool:
        """Return whether a search ends that has looked at so many nodes."""
        return (self.node_limit is not None and nodes >= self.node_limit) or self.passed

    @property
    def seconds_left(self) -> float | None:
        """Seconds that are left, at least zero; None: any."""
        return None if self.deadline == inf else max(self.deadline - time.monotonic(), 0.0)

    def within(self, options: _Options) -> _Options:
        """Return `SolveOptions` with the time that is left."""
        remaining = self.seconds_left
        return options if remaining is None else replace(options, time_limit=remaining)


NO_LIMITS = Limits()
