"""The loop of every tree search: over modes, directions of friction, forces and outcomes.

A node is a part of what is searched. Whoever visits it closes it, by a bound or by kinematics, or
splits it into children that together hold all of it (branch and bound: Land and Doig, Econometrica
28(3), 1960). What closes a node, and when the search ends, is the caller's.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from typing import Generic, TypeVar

Node = TypeVar("Node")


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
            bound, depth, _, node = heapq.heappop(self._open)
            self._depth = 1 - depth
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

    def left(self) -> list[Node]:
        """Return the open nodes in the order in which they would be visited."""
        return [node for _, _, _, node in sorted(self._open, key=lambda one: one[:3])]
