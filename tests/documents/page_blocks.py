"""The pages a user reads, and the fenced blocks in them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "evidence").glob("*.md")),
]

_LIBRARIES = {"drake": "pydrake", "jax": "jax", "torch": "torch"}
MISSING = {
    f"graspless_pin.interfaces.{module}"
    for module, library in _LIBRARIES.items()
    if find_spec(library) is None
}
"""Adapters whose library is not installed: `make adapters` tests these, and their examples."""

_FENCE = re.compile(
    r'^```(?P<kind>\w*)(?: title="(?P<title>[^"]+)")?\n(?P<text>.*?)^```$', re.DOTALL | re.MULTILINE
)


@dataclass(frozen=True)
class Block:
    """One fenced block.

    Attributes:
        place: Page and line, for messages.
        kind: The language after the fence.
        title: Name of the file that the reader is told to write; empty without one.
        text: What stands inside.
        output: What the page says that a python block prints: the text block right below it.
    """

    place: str
    kind: str
    title: str
    text: str
    output: str | None = None


def blocks_of(page: Path) -> list[Block]:
    """The blocks of one page in the order of reading."""
    text = page.read_text(encoding="utf-8")
    found: list[Block] = []
    end = 0
    for match in _FENCE.finditer(text):
        line = text.count("\n", 0, match.start()) + 1
        block = Block(f"{page.name}:{line}", match["kind"], match["title"] or "", match["text"])
        follows = found and found[-1].kind == "python" and not text[end : match.start()].strip()
        if block.kind == "text" and follows:
            code = found.pop()
            block = Block(code.place, code.kind, code.title, code.text, block.text)
        found.append(block)
        end = match.end()
    return found


def prose_of(page: Path) -> str:
    """The page without its blocks."""
    return _FENCE.sub("", page.read_text(encoding="utf-8"))
