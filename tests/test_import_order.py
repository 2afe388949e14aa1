"""Data flows one way: the contracts of pyproject.toml, checked by import-linter."""

import os
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
    """A package with an upward import and a stray solver import must fail the same contracts."""
    package = tmp_path / "graspless_pin"
    package.mkdir()
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    config = tmp_path / "pyproject.toml"
    config.write_text(text, encoding="utf-8")
    for name in ("__init__", "errors", "problem", "modes", "programs", "solvers", "solution"):
        (package / f"{name}.py").touch()
    (package / "algorithms.py").touch()
    (package / "errors.py").write_text("import graspless_pin.problem\n", encoding="utf-8")
    (package / "modes.py").write_text("import coal\nimport piqp\n", encoding="utf-8")
    result = run_linter(config, tmp_path)
    assert result.returncode != 0
    assert "3 broken" in result.stdout, result.stdout + result.stderr
