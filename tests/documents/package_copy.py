"""A copy of the package in which a walk-through of CONTRIBUTING was followed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from page_blocks import ROOT, blocks_of

COMMAND = "from graspless_pin.cli.commands import app; app()"


def copied(folder: Path) -> Path:
    """Copy the package to a folder, with the examples and robots beside it."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "src", folder / "src", ignore=ignored)
    for name in ("robots", "examples"):
        (folder / name).symlink_to(ROOT / name)
    return folder


def walkthrough(word: str) -> list[str]:
    """The blocks of CONTRIBUTING with a word in them: the new module, the lines for the list."""
    blocks = blocks_of(ROOT / "CONTRIBUTING.md")
    return [block.text for block in blocks if word in block.text and block.kind]


def inserted(file: Path, line: str, before: str) -> None:
    """Write a line before the first one that begins with some text."""
    text = file.read_text(encoding="utf-8")
    at = text.index(f"\n{before}") + 1
    file.write_text(f"{text[:at]}{line.rstrip()}\n{text[at:]}", encoding="utf-8")


def followed(folder: Path, word: str, module: Path, listed: Path, beside: str) -> Path:
    """Copy the package, add the module of a walk-through, and change the list as it says.

    Args:
        folder: Where to.
        word: What stands in the blocks of the walk-through, and is added to the list.
        module: Where its first block is written.
        listed: The module with the list, of which its second block has an import and the list.
        beside: How the import begins before which the new one goes.
    """
    copied(folder)
    blocks = walkthrough(word)
    (folder / module).write_text(blocks[0], encoding="utf-8")
    line, names = blocks[1].splitlines()
    names = names[names.index("(") :]
    before = re.sub(rf", {word}(\(\))?", "", names)
    text = (folder / listed).read_text(encoding="utf-8")
    assert before != names
    assert text.count(before) == 1
    (folder / listed).write_text(text.replace(before, names), encoding="utf-8")
    inserted(folder / listed, line, beside)
    return folder


def run(package: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python with the copy."""
    return subprocess.run(  # noqa: S603 - our own interpreter and fixed programs
        [sys.executable, *words],
        cwd=package,
        env={**os.environ, "PYTHONPATH": str(package / "src"), "COLUMNS": "160"},
        capture_output=True,
        text=True,
        check=False,
    )


def command(package: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run ``graspless-pin`` of the copy."""
    return run(package, "-c", COMMAND, *words)
