"""`make run` installs what it needs and nothing else; the rest comes with what needs it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.metadata import distribution, packages_distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
SMALL = ROOT / "examples" / "paper" / "sphere_on_slope.yaml"
SCENE = ROOT / "examples" / "allegro_box_on_slope.yaml"
CHILD = """
import sys
from importlib.machinery import PathFinder

class WithoutAbsent(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        if name.partition(".")[0] not in absent:
            return super().find_spec(name, path, target)

absent = set(sys.argv[1].split())
sys.meta_path[sys.meta_path.index(PathFinder)] = WithoutAbsent
from graspless_pin.cli import main
small, scene, report = sys.argv[2:]
for words in (["solve", small], ["report", scene, "-o", report, "--ranges-time", "0.5"]):
    sys.argv = ["graspless-pin", *words]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
"""


def planned(target: str, venv: Path) -> str:
    """What make would do."""
    words = ["make", "--dry-run", target, f"VENV={venv}"]
    plain = {name: value for name, value in os.environ.items() if "MAKE" not in name}
    return subprocess.run(  # noqa: S603
        words, cwd=ROOT, env=plain, capture_output=True, text=True, check=True
    ).stdout


def extras(plan: str) -> list[str]:
    """The extras that a plan installs."""
    return re.findall(r"pip install .*'\.\[([\w,]+)\]'", plan)


def test_run_installs_the_extra_report_and_test_adds_the_rest(tmp_path: Path) -> None:
    for target in ("run", "test", "install"):
        assert extras(planned(target, tmp_path)) == [
            "report" if target == "run" else "all,dev,docs"
        ]
    (tmp_path / ".installed-report").touch()
    assert extras(planned("run", tmp_path)) == []
    assert extras(planned("test", tmp_path)) == ["all,dev,docs"]
    (tmp_path / ".installed").touch()
    for target in ("run", "test"):
        assert extras(planned(target, tmp_path)) == []


def needed(extra: str) -> set[str]:
    """Names of the distributions that an extra of the package brings, the package's own first."""
    found: set[tuple[str, str]] = set()
    ahead = [("graspless-pin", extra)]
    while ahead:
        name, extra = ahead.pop()
        if (name, extra) in found:
            continue
        found.add((name, extra))
        for line in distribution(name).requires or []:
            wanted = Requirement(line)
            if wanted.marker is None or wanted.marker.evaluate({"extra": extra}):
                name_of = canonicalize_name(wanted.name)
                ahead += [(name_of, one) for one in wanted.extras or {""}]
    return {name for name, _ in found}


def test_what_run_does_needs_nothing_but_the_extra_report(tmp_path: Path) -> None:
    there = needed("report")
    assert {"graspless-pin", "matplotlib", "jinja2"} <= there
    absent = {
        module
        for module, owners in packages_distributions().items()
        if not there & {canonicalize_name(owner) for owner in owners}
    }
    if not {"viser", "pandas", "mujoco"} <= absent:
        pytest.skip("nothing but the extra report is installed here")
    report = tmp_path / "report.html"
    given = [" ".join(absent), str(SMALL), str(SCENE), str(report)]
    words = [sys.executable, "-c", CHILD, *given]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=300)  # noqa: S603
    assert done.returncode == 0, done.stderr
    assert report.stat().st_size > 100_000
