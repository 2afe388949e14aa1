"""Data flows one way: the contracts of pyproject.toml, checked by import-linter."""

import ast
import os
import shutil
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from graspless_pin.scene import load_scene

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "graspless_pin"
LINT = "from importlinter.cli import lint_imports_command; lint_imports_command()"


PINOCCHIO = {"pinocchio_model", "_work_space"}
"""Attributes that hold Pinocchio's objects."""


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
    shutil.copytree(PACKAGE, package)
    for module, bad in (
        ("errors.py", "graspless_pin.problem"),
        ("problem/cones.py", "coal, piqp"),
        ("geometry/bodies/meshes.py", "graspless_pin.geometry.hand.model"),
    ):
        path = package / module
        path.write_text(f"{path.read_text(encoding='utf-8')}\nimport {bad}\n", encoding="utf-8")
    result = run_linter(ROOT / "pyproject.toml", tmp_path)
    assert result.returncode != 0
    for contract in (
        "Data flows one way",
        "Data flows one way inside the geometry front end",
        "Pinocchio and coal stay in the geometry front end",
        "Solver libraries stay in one package",
    ):
        assert f"{contract} BROKEN" in result.stdout, result.stdout + result.stderr


def imports_by_module(package: Path) -> dict[str, set[str]]:
    """The package's modules with those that each imports: at its top, in functions, for types."""
    paths = {
        ".".join(path.relative_to(package.parent).with_suffix("").parts): path
        for path in package.rglob("*.py")
        if path.name != "__init__.py"
    }
    found: dict[str, set[str]] = {name: set() for name in paths}
    for name, path in paths.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                found[name] |= {f"{node.module}.{one.name}" for one in node.names} | {node.module}
            elif isinstance(node, ast.Import):
                found[name] |= {one.name for one in node.names}
        found[name] &= paths.keys()
    return found


def test_no_modules_import_each_other():
    order = [*TopologicalSorter(imports_by_module(PACKAGE)).static_order()]
    assert len(order) > 200


def test_modules_that_import_each_other_are_found(tmp_path):
    package = tmp_path / "graspless_pin"
    package.mkdir()
    (package / "one.py").write_text("def f():\n    from graspless_pin import other\n")
    (package / "other.py").write_text("import graspless_pin.one\n")
    with pytest.raises(CycleError):
        TopologicalSorter(imports_by_module(package)).prepare()


def pinocchio_readers(package: Path) -> set[str]:
    """Modules that read an attribute which holds one of Pinocchio's objects."""
    return {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr in PINOCCHIO
    }


def test_only_geometry_reads_the_objects_of_pinocchio():
    """They are typed as anything, so that neither the linter nor the type checker would see it."""
    readers = pinocchio_readers(PACKAGE)
    assert any(path.startswith("geometry/hand/") for path in readers)
    assert all(path.startswith("geometry/") for path in readers), readers


def test_a_reader_of_pinocchio_is_found(tmp_path):
    (tmp_path / "weights.py").write_text("m = hand.tree.pinocchio_model.inertias[1].mass\n")
    assert pinocchio_readers(tmp_path) == {"weights.py"}


def test_nothing_else_of_a_hand_is_an_object_of_pinocchio():
    """What a hand and its tree hold under other names is made by this package or by numpy."""
    hand = load_scene(ROOT / "examples" / "allegro_box_on_slope.yaml").hand
    assert hand is not None
    _ = hand.placed_bodies, hand.gravity_torques((0.0, 0.0, -9.81)), hand.joint_inertia()
    held = {**vars(hand.tree), **vars(hand)}
    found = {name for name, value in held.items() if "pinocchio" in type(value).__module__}
    assert found == {"pinocchio_model"}
    assert "_work_space" in held
