"""A copy of the package in which a walk-through of CONTRIBUTING was followed."""

import atexit
import json
import os
import re
import shutil
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

from page_blocks import ROOT, blocks_of


def copied(folder: Path) -> Path:
    """Copy the package to a folder, with the examples and robots beside it."""
    shutil.copytree(ROOT / "src", folder / "src")  # compiled, too: times of files are kept
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


def followed(
    folder: Path, word: str, module: Path, listed: Path, beside: str, text: str | None = None
) -> Path:
    """Copy the package, add the module of a walk-through, and change the list as it says.

    Args:
        folder: Where to.
        word: What stands in the blocks of the walk-through, and is added to the list.
        module: Where its first block is written.
        listed: The module with the list: its next block has an import, and how the list begins.
        beside: How the import begins before which the new one goes.
        text: What is written instead of its first block; then that is the next one.
    """
    copied(folder)
    blocks = walkthrough(word)
    (folder / module).write_text(text or blocks.pop(0), encoding="utf-8")
    line, names = blocks[0].splitlines()
    ((name, first),) = re.findall(r"(\w+) = \.\.\. (\(.*?, )\w", names)
    code = (folder / listed).read_text(encoding="utf-8")
    at = code.index("(", code.index(f"\n{name}:"))
    (folder / listed).write_text(f"{code[:at]}{first}{code[at + 1 :]}", encoding="utf-8")
    inserted(folder / listed, line, beside)
    return folder


SERVER = """
import importlib, json, os, sys, traceback
from graspless_pin.cli.commands import app

for name in ("solve", "verify", "report", "study"):
    importlib.import_module(f"graspless_pin.cli.{name}")
for line in sys.stdin:
    words, *files = json.loads(line)
    child = os.fork()
    if child == 0:
        for number, file in enumerate(files, start=1):
            os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        code = 0
        try:
            if words[0] == "-c":
                sys.argv = ["-c", *words[2:]]
                exec(compile(words[1], "-c", "exec"), {"__name__": "__main__"})
            else:
                sys.argv = ["graspless-pin", *words]
                app()
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            traceback.print_exc()
            code = 1
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
"""Loads a copy once, and forks for each program that it is sent: loading takes longer than most."""


@lru_cache
def _server(package: Path) -> subprocess.Popen[str]:
    """Start a server of the copy; it ends with this process."""
    server = subprocess.Popen(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", SERVER],
        cwd=package,
        env={**os.environ, "PYTHONPATH": str(package / "src"), "COLUMNS": "160"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    atexit.register(server.communicate)
    return server


def run(package: Path, program: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a program with the copy, as ``python -c`` would."""
    return _run(package, "-c", program, *words)


def shown(package: Path, program: str, file: Path) -> dict[str, Any]:
    """What a program prints of a file, as JSON."""
    result = run(package, program, str(file))
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def command(package: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run ``graspless-pin`` of the copy."""
    return _run(package, *words)


def _run(package: Path, *words: str) -> subprocess.CompletedProcess[str]:
    server = _server(package)
    assert server.stdin is not None
    assert server.stdout is not None
    files = package / "stdout.txt", package / "stderr.txt"
    server.stdin.write(json.dumps([words, *map(str, files)]) + "\n")
    server.stdin.flush()
    code = int(server.stdout.readline())
    return subprocess.CompletedProcess(words, code, *[file.read_text() for file in files])
