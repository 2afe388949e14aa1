"""README and docs tell the truth: page by page, what they say to do is done and compared."""

import contextlib
import io
import os
import re
import shlex
import tomllib
from pathlib import Path

import pytest
import typer.core
import yaml
from page_blocks import MISSING, PAGES, ROOT, Block, blocks_of, prose_of
from shown_output import difference
from typer.testing import CliRunner

from graspless_pin.cli.commands import app
from graspless_pin.geometry.robots.files import RobotFile
from graspless_pin.scene import scene_json_schema
from graspless_pin.studies.study_schema import StudyEntry

KINDS = {"", "python", "console", "yaml", "xml", "text", "bibtex"}
PATH = re.compile(r"`((?:examples|docs|robots|src|tests|benchmarks)/[\w./-]*)`")
REPOSITORY = ("examples", "docs", "robots", "src", "tests", "benchmarks", "Makefile")
UNTIL_INTERRUPTED = {"view"}
COMMENT_GOES_ON = re.compile(r"\A(?: +# .*\n)+")


@pytest.fixture(autouse=True)
def a_fresh_clone(tmp_path, monkeypatch):
    """A working folder that looks like a clone, in which pages may write files; and one core."""
    for name in REPOSITORY:
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setenv("COLUMNS", "120")
    # Seconds that other work on the machine must not use up.
    monkeypatch.setattr("graspless_pin.cli.solve._RANGES_TIME", float("inf"))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0}, raising=False)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_page_does_as_it_says(page):
    """Blocks run in the order of reading; a later one may use what an earlier one has made."""
    names = {"__name__": "__main__"}
    for block in blocks_of(page):
        assert block.kind in KINDS, f"{block.place}: what is a block of {block.kind!r}?"
        if block.title:
            assert Path(block.title).name == block.title
            Path(block.title).write_text(block.text, encoding="utf-8")
        if block.kind == "python":
            run_python(block, names)
        elif block.kind == "console":
            run_console(block)
        elif block.kind == "yaml":
            check_keys(block)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_named_paths_exist(page):
    for name in PATH.findall(prose_of(page)):
        assert (ROOT / name).exists(), name


def run_python(block: Block, names: dict) -> None:
    if any(f"from {module} import" in block.text for module in MISSING):
        return
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(block.text, block.place, "exec"), names)  # noqa: S102 - our own text
    if block.output is None:
        assert printed.getvalue().strip() or block.title, f"{block.place} prints nothing"
    else:
        assert not (wrong := difference(block.output, printed.getvalue())), (
            f"{block.place}: {wrong}"
        )


def run_console(block: Block) -> None:
    """Each command works, and prints what is shown below it, where something is shown."""
    exit_code, answered, printed = 0, True, ""
    for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
        line, _, shown = part.partition("\n")
        words = shlex.split(line, comments=True)
        if " # " in line:
            shown = COMMENT_GOES_ON.sub("", shown)
        if words == ["echo", "$?"]:
            assert int(shown) == exit_code, f"{block.place}: exit code {exit_code}"
            answered = True
            continue
        assert answered, f"{block.place}: exit code {exit_code}, which the page does not say"
        exit_code, printed = result_of(words)
        answered = exit_code == 0
        if shown.strip():
            assert not (wrong := difference(shown, printed)), f"{block.place} {line}: {wrong}"
    assert answered, f"{block.place}: exit code {exit_code}, which the page does not say\n{printed}"


def result_of(words: list[str]) -> tuple[int, str]:
    """Exit code and output of a command; of commands that others test, only that they exist."""
    program, *arguments = words
    if program == "graspless-pin" and arguments[0] not in UNTIL_INTERRUPTED:
        result = CliRunner().invoke(app, arguments, catch_exceptions=False)
        return result.exit_code, result.output
    if program == "graspless-pin":
        group = typer.main.get_command(app)
        assert isinstance(group, typer.core.TyperGroup)
        _, command, rest = group.resolve_command(typer.Context(group), arguments)
        assert command is not None
        context = command.make_context(arguments[0], rest)
        assert all(item.exists() for item in context.params.values() if isinstance(item, Path))
    elif program == "make":
        makefile = Path("Makefile").read_text(encoding="utf-8")
        targets = [argument for argument in arguments if "=" not in argument]
        assert targets
        assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets)
    elif program in ("python", ".venv/bin/python"):
        assert ROOT.joinpath(arguments[0]).is_relative_to(ROOT / "examples")
        assert Path(arguments[0]).is_file()
    else:
        assert words[:2] == ["pip", "install"], words
        check_requirement(words[2])
    return 0, ""


def check_requirement(text: str) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    match = re.fullmatch(r"(\.|[\w-]+)(?:\[([\w,]+)\])?", text)
    assert match, text
    assert match[1] in (".", project["name"])
    assert set((match[2] or "dev").split(",")) <= set(project["optional-dependencies"])


def check_keys(block: Block) -> None:
    """A part of a scene, study or robot file names keys that exist; a titled file is used later."""
    known = [scene_json_schema(), StudyEntry.model_json_schema(), RobotFile.model_json_schema()]
    keys = set(yaml.safe_load(block.text))
    assert any(keys <= set(schema["properties"]) for schema in known), f"{block.place}: {keys}"
