"""The README and the docs tell the truth: their code runs, their commands and paths exist."""

import re
import shlex
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from graspless_pin.cli import app
from graspless_pin.scene import scene_json_schema

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PATH = re.compile(r"`((?:examples|docs|robots|src|tests)/[\w./-]*)`")


def blocks(language: str) -> list:
    """Fenced blocks of one language, each with its place for the test's name."""
    found = []
    for document in DOCUMENTS:
        text = document.read_text(encoding="utf-8")
        for match in FENCE.finditer(text):
            if match[1] == language:
                line = text.count("\n", 0, match.start()) + 1
                found.append(pytest.param(match[2], id=f"{document.name}:{line}"))
    return found


def commands() -> list:
    """The command lines of console blocks, without comments."""
    return [
        pytest.param(shlex.split(line[2:], comments=True), id=f"{block.id} {line[2:32]}")
        for block in blocks("console")
        for line in str(block.values[0]).splitlines()
        if line.startswith("$ ")
    ]


@pytest.fixture(autouse=True)
def at_the_root(monkeypatch):
    monkeypatch.chdir(ROOT)


def test_every_fence_is_of_a_known_kind():
    kinds = {m[1] for file in DOCUMENTS for m in FENCE.finditer(file.read_text(encoding="utf-8"))}
    assert {"python", "console"} <= kinds
    assert kinds <= {"", "python", "console", "yaml", "text"}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.name)
def test_python_blocks_run_one_after_the_other(document, capsys):
    """A later block may use what an earlier one of the same page has made, as a reader would."""
    names = {"__name__": "__main__"}
    for block in blocks("python"):
        place = str(block.id)
        if place.startswith(f"{document.name}:"):
            exec(compile(str(block.values[0]), place, "exec"), names)  # noqa: S102 - our own text
            assert capsys.readouterr().out.strip(), f"{place} prints nothing"


@pytest.mark.parametrize("words", commands())
def test_command_works(words):
    """graspless-pin's commands run; make's are targets, which the whole check runs anyway."""
    program, *arguments = words
    if program == "make":
        makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
        assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in arguments)
    else:
        assert program == "graspless-pin"
        result = CliRunner().invoke(app, arguments, catch_exceptions=False)
        assert result.exit_code == 0, result.output


@pytest.mark.parametrize("text", blocks("yaml"))
def test_yaml_block_has_keys_of_the_schema(text):
    assert set(yaml.safe_load(text)) <= set(scene_json_schema()["properties"])


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda file: file.name)
def test_named_paths_and_links_exist(document):
    text = document.read_text(encoding="utf-8")
    for name in PATH.findall(text):
        assert (ROOT / name).exists(), name
    for link in re.findall(r"\]\(([\w./-]+\.md)\)", text):
        assert (document.parent / link).is_file(), link
