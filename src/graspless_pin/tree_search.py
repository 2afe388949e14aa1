"""The loop of every tree search: over modes, directions of friction, forces and outcomes.

`Limits` states when such a search ends.

A node is a subset of the search space. The caller visits it and either closes it, by a bound or by
kinematics, or splits it into children whose union is the node (branch and bound: Land and Doig,
Econometrica 28(3), 1960). The criterion that closes a node is the caller's.
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
    """Queue of open nodes, visited in the order of their bounds; without bounds, depth first.

    Among equal bounds the deepest node comes first, then the one added last, so that the search
    reaches a leaf early.

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
        """Begin with the root nodes.

        Args:
            roots: The nodes; their union is searched.
            bound: Proven lower bound of all of them.
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
            bound: Proven lower bound of all of them.
        """
        for child in children:
            self._born += 1
            heapq.heappush(self._open, (bound, -self._depth, -self._born, child))

    def open_nodes(self) -> list[Node]:
        """Return the open nodes in the order in which they would be visited."""
        return [node for _, _, _, node in sorted(self._open, key=lambda one: one[:3])]


@dataclass(frozen=True)
class Limits:
    """Limits of nodes and time for the searches of one call.

    Attributes:
        node_limit: Largest number of nodes of each search; None: any number.
        deadline: Reading of `time.monotonic` at which every search ends.
    """

    node_limit: int | None = None
    deadline: float = inf

    @classmethod
    def from_options(cls, options: Any) -> Self:
        """Return the limits that `SolveOptions` state; their time begins now."""
        return cls.from_now(options.node_limit, options.time_limit)

    @classmethod
    def from_now(cls, node_limit: int | None, time_limit: float | None) -> Self:
        """Return limits of a number of nodes and of seconds from now; None: no limit."""
        if time_limit is None:
            return cls(node_limit)
        return cls(node_limit, time.monotonic() + time_limit)

    @property
    def is_time_over(self) -> bool:
        """Whether the deadline has passed."""
        return self.deadline < inf and time.monotonic() > self.deadline

    def is_over(self, nodes: int) -> bool:
        """Return whether a search has to end after a number of nodes."""
        return (self.node_limit is not None and nodes >= self.node_limit) or self.is_time_over

    @property
    def seconds_left(self) -> float | None:
        """Seconds until the deadline, at least zero; None: no deadline."""
        return None if self.deadline == inf else max(self.deadline - time.monotonic(), 0.0)

    def with_time_left(self, options: _Options) -> _Options:
        """Return `SolveOptions` whose time limit is the time that is left."""
        remaining = self.seconds_left
        return options if remaining is None else replace(options, time_limit=remaining)


NO_LIMITS = Limits()
