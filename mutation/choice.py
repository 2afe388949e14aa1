"""Which tests a mutant is tried with: those that run its line, the nearest first.

How many is counted in calls of functions, not in time: the choice is the same on a busy machine.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import chain, zip_longest
from pathlib import Path

from mutation.sites import Mutant
from mutation.test_map import Test

# Each file takes time to be imported, and each test some beside its calls.
_CALLS_PER_FILE, _CALLS_BESIDE = 1e6, 5e4
_OF_DEFINITIONS = ("tests/core/test_records.py",)
"""Tests that look at definitions themselves, which run when a module is loaded."""


class Choice:
    """Chooses tests for mutants."""

    def __init__(self, package: Path, tests: Sequence[Test]) -> None:
        """Take the package's folder and the tests that there are."""
        self._package = package
        self._tests = tests

    def tests_of(self, mutant: Mutant, calls: float) -> list[Test]:
        """Return tests that run what is changed and are about so much work together.

        Args:
            mutant: The mutant.
            calls: Of functions, that the tests may make.
        """
        wanted = self._lines(mutant)
        able = [
            test
            for test in self._tests
            if any(test.lines.get(path, 0) & bits for path, bits in wanted.items())
        ]
        groups: dict[str, list[Test]] = defaultdict(list)
        for test in able:
            groups[test.function].append(test)

        def order(group: list[Test]) -> float:
            near = max(test.nearness(mutant.path) for test in group)
            return -near / (_CALLS_BESIDE + min(test.calls for test in group)) ** 0.5

        ordered = sorted(groups.values(), key=order)
        chosen, files, left = self._of_definitions(mutant), set[str](), calls
        for test in chain.from_iterable(zip_longest(*ordered)):
            if test is None or test.calls > left:
                continue
            if test.file in files or _CALLS_PER_FILE * len(files) < calls:
                chosen.append(test)
                files.add(test.file)
                left -= test.calls
        return chosen

    def _of_definitions(self, mutant: Mutant) -> list[Test]:
        if _inside(self._package / mutant.path, mutant.line)[0]:
            return []
        return [test for test in self._tests if test.file in _OF_DEFINITIONS]

    def _lines(self, mutant: Mutant) -> dict[str, int]:
        """Lines that run what is changed: its own, or, outside functions, those that use it.

        A decorator runs when a module is loaded: what it does shows where its function runs.
        """
        own = _bits(range(mutant.line, mutant.last + 1))
        body, names = _inside(self._package / mutant.path, mutant.line)
        if body:
            return {mutant.path: own}
        decorated = _bits(_decorated(self._package / mutant.path, mutant.line))
        if decorated:
            return {mutant.path: decorated}
        used: dict[str, int] = {}
        if names:
            for file in self._package.rglob("*.py"):
                bits = _bits(_uses(file, names))
                if bits:
                    used[str(file.relative_to(self._package))] = bits
        return used or {mutant.path: -1}


def _bits(lines: Iterable[int]) -> int:
    total = 0
    for line in lines:
        total |= 1 << line
    return total


@cache
def _tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def _inside(file: Path, line: int) -> tuple[bool, frozenset[str]]:
    """Whether a line is in a function's body, and otherwise the names that it gives."""
    names: set[str] = set()
    for node in ast.walk(_tree(file)):
        if isinstance(node, ast.FunctionDef) and node.body[0].lineno <= line <= (
            node.end_lineno or 0
        ):
            return True, frozenset()
        if isinstance(node, ast.Assign | ast.AnnAssign | ast.FunctionDef | ast.ClassDef) and _first(
            node
        ) <= line <= (node.end_lineno or 0):
            targets = node.targets if isinstance(node, ast.Assign) else [node]
            for target in targets:
                one = getattr(target, "target", target)
                names.add(getattr(one, "id", getattr(one, "name", "")))
    return False, frozenset(names - {""})


def _decorated(file: Path, line: int) -> range:
    """Lines of the body of the function that a line decorates."""
    for node in ast.walk(_tree(file)):
        if isinstance(node, ast.FunctionDef) and _first(node) <= line < node.lineno:
            return range(node.body[0].lineno, (node.end_lineno or 0) + 1)
    return range(0)


def _first(node: ast.stmt) -> int:
    return min([node.lineno, *(one.lineno for one in getattr(node, "decorator_list", []))])


@cache
def _uses(file: Path, names: frozenset[str]) -> list[int]:
    found = []
    for node in ast.walk(_tree(file)):
        name = getattr(node, "id", getattr(node, "attr", ""))
        if name in names and isinstance(node, ast.Name | ast.Attribute):
            found.append(node.lineno)
    return found
