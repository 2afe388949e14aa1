"""A tree search visits every open node once: best bound first, or depth first."""

from __future__ import annotations

from collections.abc import Iterator

from hypothesis import given
from hypothesis import strategies as st

from graspless_pin.tree_search import TreeSearch

TREES = st.recursive(st.just([]), lambda trees: st.lists(trees, max_size=4), max_leaves=30)
"""A node is the list of its children."""
Place = tuple[tuple[int, ...], list]


def preorder(tree: list, path: tuple[int, ...] = ()) -> Iterator[tuple[int, ...]]:
    yield path
    for number, child in enumerate(tree):
        yield from preorder(child, (*path, number))


@given(tree=TREES, ends_after=st.integers(0, 40))
def test_without_bounds_it_is_depth_first(tree, ends_after):
    search, visited = TreeSearch[Place]([((), tree)]), []
    for _, (path, node) in search:
        if len(visited) == ends_after:
            left = [path, *(one for one, _ in search.left())]
            break
        visited.append(path)
        search.add(reversed([((*path, k), child) for k, child in enumerate(node)]))
    else:
        left = []
        assert not len(search)
    every = list(preorder(tree))
    assert visited == every[:ends_after]
    # Of what is left, the parents come in their turn.
    assert left == [one for one in every[ends_after:] if one[:-1] in visited or not one]


@given(tree=TREES, bounds=st.lists(st.integers(0, 3), min_size=40, max_size=40))
def test_the_best_bound_comes_first_and_every_node_once(tree, bounds):
    search, visited, last = TreeSearch[Place]([((), tree)], 0.0), [], 0.0
    rising = iter(bounds)
    for bound, (path, node) in search:
        assert bound >= last  # children prove at least what their parent does
        assert all(bound <= other for other, _, _, _ in search._open)
        last = bound
        visited.append(path)
        children = [((*path, k), child) for k, child in enumerate(node)]
        search.add(children, bound + next(rising, 0))
    assert sorted(visited) == sorted(preorder(tree))
