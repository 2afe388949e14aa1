"""The choice of the Pythons that the whole check runs on, and what it is said to support."""

from __future__ import annotations

import importlib.util
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = ROOT / "pyproject.toml"


@pytest.fixture(scope="module")
def interpreters() -> ModuleType:
    file = ROOT / ".ci" / "interpreters.py"
    spec = importlib.util.spec_from_file_location("interpreters", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def program(file: Path, answer: str, *, code: int = 0) -> Path:
    """A program that answers any call with one line and an exit code."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f"#!/bin/sh\necho '{answer}'\nexit {code}\n", encoding="utf-8")
    file.chmod(0o755)
    return file


def test_page_classifiers_and_metadata_name_the_same_versions(interpreters) -> None:
    text = PROJECT.read_text(encoding="utf-8")
    versions = interpreters.supported(text)
    said = set()
    for page in (ROOT / "README.md", ROOT / "docs" / "install.md"):
        words = " ".join(page.read_text(encoding="utf-8").split())
        said |= set(re.findall(r"Python [\d.]+ or newer \(tested on [^)]*\)", words)) or {page}
    assert said == {
        f"Python {versions[0]} or newer (tested on {', '.join(versions[:-1])} and {versions[-1]})"
    }
    assert tomllib.loads(text)["project"]["requires-python"] == f">={versions[0]}"


def test_versions_are_ordered_as_numbers(interpreters) -> None:
    named = [f'"Programming Language :: Python :: {v}",' for v in ("3", "3.10", "3.9", "3.11")]
    assert interpreters.supported("\n".join(named)) == ["3.9", "3.10", "3.11"]


def test_one_on_the_path_that_does_not_start_is_passed_over(interpreters, tmp_path) -> None:
    program(tmp_path / "shims" / "python3.13", "3.13 /shim", code=127)
    program(tmp_path / "other" / "python3.13", "3.12 /another/version")
    (tmp_path / "plain").mkdir()
    (tmp_path / "plain" / "python3.13").write_text("not executable", encoding="utf-8")
    path = [tmp_path / name for name in ("missing", "shims", "other", "plain")]
    assert interpreters.find("3.13", path, tmp_path) is None
    program(tmp_path / "bin" / "python3.13", "3.13 /usr/bin/python3.13")
    assert interpreters.find("3.13", [*path, tmp_path / "bin"], tmp_path) == "/usr/bin/python3.13"


def test_pyenvs_newest_release_comes_after_the_path(interpreters, tmp_path) -> None:
    for name in ("3.13.9", "3.13.10", "3.13.11t", "3.1.3", "3.12.1"):
        program(tmp_path / name / "bin" / "python3", f"{name.rpartition('.')[0]} {name}")
    assert interpreters.find("3.13", [], tmp_path) == "3.13.10"
    path = program(tmp_path / "bin" / "python3.13", "3.13 on the path").parent
    assert interpreters.find("3.13", [path], tmp_path) == "on the path"


def test_this_python_starts_under_its_own_version_only(interpreters) -> None:
    mine = "{}.{}".format(*sys.version_info[:2])
    assert interpreters.start(Path(sys.executable), mine)
    assert interpreters.start(Path(sys.executable), "3.0") is None


def choose(interpreters: ModuleType, patch: pytest.MonkeyPatch, folder: Path, *there: str) -> int:
    """Run the script where only these of the supported versions are there."""
    for version in there:
        program(folder / "bin" / f"python{version}", f"{version} /usr/bin/python{version}")
    patch.setenv("PATH", f"{folder / 'bin'}")
    patch.setenv("PYENV_ROOT", str(folder))
    return interpreters.main()


def test_the_oldest_and_the_newest_are_chosen(interpreters, monkeypatch, tmp_path, capsys) -> None:
    versions = interpreters.supported(PROJECT.read_text(encoding="utf-8"))
    assert choose(interpreters, monkeypatch, tmp_path, *versions) == 0
    ends = (versions[0], versions[-1])
    assert capsys.readouterr().out.splitlines() == [f"{v} /usr/bin/python{v}" for v in ends]


def test_the_newest_must_be_there(interpreters, monkeypatch, tmp_path, capsys) -> None:
    *others, newest = interpreters.supported(PROJECT.read_text(encoding="utf-8"))
    assert choose(interpreters, monkeypatch, tmp_path, *others) == 1
    said = capsys.readouterr()
    assert len(said.out.splitlines()) == 2
    assert f"Python {newest}, the newest supported one, was not found" in said.err
