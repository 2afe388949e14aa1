"""Where the code can be mutated, and a seeded sample of the mutants.

The operators are those of Cosmic Ray, and one more that makes a tolerance a thousand times larger
or smaller. A place is drawn first and then one of its mutants, so that an operator with many
alternatives counts no more than others.

Of the kept tools, mutmut leaves out constants of modules, properties and decorated functions, and
Cosmic Ray's own runs start one test command for all mutants, on the files themselves: hence its
operators, on copies, with the tests that run the line.
"""

from __future__ import annotations

import ast
import random
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.provider import OperatorProvider
from parso.python.tree import Number
from parso.tree import NodeOrLeaf

from graspless_pin import compiled

# These take arguments of their own.
_LEFT_OUT = ("VariableReplacer", "VariableInserter")
# Leaves that no operator changes; they are most of a tree.
_UNTOUCHED = ("name", "string", "newline", "endmarker", "error_leaf", "fstring_string")
# The same of None and of the members of an enum.
_OF_IDENTITY = ("ReplaceComparisonOperator_Is_Eq", "ReplaceComparisonOperator_IsNot_NotEq")
_FACTORS = (1e3, 1e-3)
_SMALL, _LARGE = 0.01, 1e4

Span = tuple[tuple[int, int], tuple[int, int]]
"""Line and column of the first character and of the one behind the last."""


class ScaleNumber:
    """Makes a tolerance or a far figure a thousand times larger or smaller.

    It has the methods of Cosmic Ray's operators.
    """

    def mutation_positions(self, node: NodeOrLeaf) -> Iterator[Span]:
        """Return one position for each factor."""
        if _is_tolerance(node):
            for _ in _FACTORS:
                yield node.start_pos, node.end_pos

    def mutate(self, node: Number, index: int) -> Number:
        """Return the number times the factor."""
        value = float(node.value) * _FACTORS[index]
        return Number(f" {value!r}", node.start_pos)


class Mutant(NamedTuple):
    """One mistake in one file.

    Attributes:
        path: The file, relative to the package.
        line: Where.
        last: The last line of what is replaced.
        column: Where in the line.
        operator: The operator's name.
        occurrence: Which of the places in the file that it could change.
    """

    path: str
    line: int
    last: int
    column: int
    operator: str
    occurrence: int

    def __str__(self) -> str:
        """Return what ``--only`` takes."""
        return f"{self.path}:{self.line}:{self.column}:{self.operator}:{self.occurrence}"

    def source(self, package: Path) -> str:
        """Return the text of the file with the mistake in it."""
        text = (package / self.path).read_text(encoding="utf-8")
        changed = mutate_code(text, _OPERATORS[self.operator], self.occurrence)
        if changed is None:
            raise ValueError(f"{self}: there is no such place")
        return changed


def sample(package: Path, files: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Return mutants drawn at random, at most one of each place.

    Each place has a lot of its own, made of its file, its line's text and the seed: a change of
    the code elsewhere leaves it in the sample, so that scores of two commits can be compared.

    Args:
        package: Folder of the package.
        files: Files in it.
        count: How many.
        seed: Of the lots.
    """
    drawn = sorted(
        (random.Random(f"{seed} {name}").random(), place)  # noqa: S311 - no secret
        for path in files
        for name, place in _named_places(package, path)
    )
    return [place[int(lot * 1e9) % len(place)] for lot, place in drawn[:count]]


def _named_places(package: Path, path: str) -> Iterator[tuple[str, list[Mutant]]]:
    """Each place with a name that stays the same while its line does."""
    lines = (package / path).read_text(encoding="utf-8").splitlines()
    times = Counter[str]()
    for place in _places(package, path):
        line, column = lines[place[0].line - 1], place[0].column
        text = line.strip()
        name = f"{path} {text} {column - line.index(text)}"
        times[name] += 1
        yield f"{name} {times[name]}", place


def all_mutants(package: Path, path: str) -> list[Mutant]:
    """Return every mutant of a file."""
    return [mutant for place in _places(package, path) for mutant in place]


def _operators() -> dict[str, Any]:
    provider: Any = OperatorProvider()
    known = {name: provider[name]() for name in provider if name not in _LEFT_OUT}
    return {**known, "ScaleNumber": ScaleNumber()}


_OPERATORS = _operators()


def _places(package: Path, path: str) -> list[list[Mutant]]:
    """The mutants of a file, place by place."""
    text = (package / path).read_text(encoding="utf-8")
    tree = ast.parse(text)
    ignored, identities = list(_ignored(tree)), list(_identities(tree))
    counts = dict.fromkeys(_OPERATORS, -1)
    places: dict[tuple[object, ...], list[Mutant]] = {}
    for node in ast_nodes(get_ast(text)):
        if node.type in _UNTOUCHED:
            continue
        coarse = _is_tolerance(node)
        for name, operator in _OPERATORS.items():
            for start, end in operator.mutation_positions(node):
                counts[name] += 1
                inside = any(low <= start and end <= high for low, high in ignored)
                # One more or less is no likely mistake in a tolerance.
                if inside or (coarse and name == "NumberReplacer"):
                    continue
                if name in _OF_IDENTITY and any(a <= start and end <= b for a, b in identities):
                    continue
                mutant = Mutant(path, start[0], end[0], start[1], name, counts[name])
                places.setdefault((start, end), []).append(mutant)
    return list(places.values())


def _is_tolerance(node: NodeOrLeaf) -> bool:
    if not isinstance(node, Number):
        return False
    try:
        value = abs(float(node.value))
    except ValueError:
        return False
    return 0.0 < value < _SMALL or value > _LARGE


def _ignored(tree: ast.Module) -> Iterator[Span]:
    """Places where a mutant changes no result, or which do not run without the compiled loops."""
    for node in ast.walk(tree):
        for decorator in getattr(node, "decorator_list", ()):
            if _name_of(decorator) in ("cache", "lru_cache"):  # time and memory
                yield (decorator.lineno, 0), (decorator.end_lineno + 1, 0)
        if isinstance(node, ast.arg | ast.AnnAssign) and node.annotation is not None:
            yield _span(node.annotation)
        elif isinstance(node, ast.keyword) and node.arg in ("strict", "total"):
            # Of zip, which then looks for a mistake that is not there; of a typed dictionary.
            yield _span(node)
        elif isinstance(node, ast.Call) and _name_of(node) == "reshape":
            for size in node.args:
                if isinstance(size, ast.UnaryOp):  # numpy takes any negative number for an open one
                    yield _span(size)
        elif isinstance(node, ast.FunctionDef):
            if node.returns is not None:
                yield _span(node.returns)
            yield from _behind_loops(node.body)
        elif isinstance(node, ast.If) and _asks_for_loops(node.test):
            yield _span(node.test)
            if any(isinstance(part, ast.IsNot) for part in ast.walk(node.test)):
                yield _span(node.body[0])[0], _span(node.body[-1])[1]
        elif isinstance(node, ast.stmt) and not hasattr(node, "body") and _asks_for_loops(node):
            yield _span(node)


def _behind_loops(body: list[ast.stmt]) -> Iterator[Span]:
    """What a function comes to only where it has not returned since there are no loops."""
    for node, behind in pairwise(body):
        if isinstance(node, ast.If) and isinstance(node.body[-1], ast.Return):
            test = node.test
            if isinstance(test, ast.BoolOp) and isinstance(test.op, ast.Or):
                test = test.values[0]
            absent = isinstance(test, ast.Compare) and isinstance(test.ops[0], ast.Is)
            if absent and _asks_for_loops(test):
                yield _span(behind)[0], _span(body[-1])[1]


def _identities(tree: ast.Module) -> Iterator[Span]:
    """Comparisons by ``is`` and ``is not`` with None, or with a member of an enum by its name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            other = node.comparators[0]
            member = isinstance(other, ast.Attribute) and other.attr.isupper()
            if member or (isinstance(other, ast.Constant) and other.value is None):
                yield _span(node)


def _name_of(node: ast.expr) -> str:
    """Return the last part of what is called, or named."""
    called = node.func if isinstance(node, ast.Call) else node
    return getattr(called, "attr", getattr(called, "id", ""))


def _asks_for_loops(node: ast.AST) -> bool:
    names = (part.id for part in ast.walk(node) if isinstance(part, ast.Name))
    return any(name in compiled.__all__ for name in names)


def _span(node: ast.expr | ast.stmt | ast.keyword) -> Span:
    end = node.end_lineno or node.lineno, node.end_col_offset or node.col_offset
    return (node.lineno, node.col_offset), end
