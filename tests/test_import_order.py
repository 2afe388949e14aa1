"""Data flows one way: the contracts of pyproject.toml, checked by import-linter."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LINT = "from importlinter.cli import lint_imports_command; lint_imports_command()"


def run_linter(config: Path, *extra_paths: Path) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(str(p) for p in [*extra_paths, ROOT / "src"])
    return subprocess.run(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", LINT, "--config", str(config), "--no-cache"],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


def test_imports_keep_the_contracts():
    result = run_linter(ROOT / "pyproject.toml")
    assert result.returncode == 0, result.stdout + result.stderr
    assert "0 broken" in result.stdout


def test_the_linter_reports_a_broken_contract(tmp_path):
    """A copy of the package with an upward import and a stray library must break its contracts."""
    package = tmp_path / "graspless_pin"
    shutil.copytree(ROOT / "src" / "graspless_pin", package)
    for module, bad in (("errors.py", "graspless_pin.problem"), ("problem/cones.py", "coal, piqp")):
        path = package / module
        path.write_text(f"{path.read_text(encoding='utf-8')}\nimport {bad}\n", encoding="utf-8")
    result = run_linter(ROOT / "pyproject.toml", tmp_path)
    assert result.returncode != 0
    for contract in (
        "Data flows one way",
        "Pinocchio and coal stay in the geometry front end",
        "Solver libraries stay in one package",
    ):
        assert f"{contract} BROKEN" in result.stdout, result.stdout + result.stderr
