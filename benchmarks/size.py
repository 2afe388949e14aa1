"""How large the package is: ``make size``.

Statements are nodes of the syntax tree without docstrings; a change of format or of comments does
not count.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

from tabulate import tabulate

PACKAGE = Path(__file__).parents[1] / "src" / "graspless_pin"


def statements(code: str) -> int:
    """Return how many statements a module has, without docstrings."""
    return sum(
        isinstance(node, ast.stmt)
        and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
        for node in ast.walk(ast.parse(code))
    )


def rows(package: Path = PACKAGE) -> Iterator[tuple[str, int, int, int]]:
    """Yield a name, modules, lines and statements: each package, all Python, and Cython."""
    total = [0, 0, 0]
    parts: dict[str, list[int]] = {}
    for path in sorted(package.rglob("*.py")):
        code = path.read_text(encoding="utf-8")
        inside = path.relative_to(package).parts
        part = parts.setdefault(inside[0] if len(inside) > 1 else "(top level)", [0, 0, 0])
        for count in (part, total):
            for place, more in enumerate((1, len(code.splitlines()), statements(code))):
                count[place] += more
    yield from ((name, part[0], part[1], part[2]) for name, part in sorted(parts.items()))
    yield ("Python", total[0], total[1], total[2])
    loops = [path for pattern in ("*.pyx", "*.pxi") for path in package.rglob(pattern)]
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in loops)
    yield ("Cython", len(loops), lines, 0)


def main() -> int:
    """Print the table."""
    print(tabulate(rows(), ["", "modules", "lines", "statements"], "pipe"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
