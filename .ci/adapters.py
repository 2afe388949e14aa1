"""Test adapters, each in a fresh environment with its one extra: ``.ci/adapters.py [NAME ...]``.

Run are its tests, the examples of its docstrings, and its planner in ``examples/``, if it has one.
A line tells of each adapter; what went wrong stands above it.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
FOLDER = PROJECT / "out" / "adapters"
EXTRAS = {"mujoco": "simulate"}
"""Extras that are not named as the adapter is."""

DOCTEST = """\
import doctest, importlib, sys
module = importlib.import_module(sys.argv[1])
sys.exit(doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE).failed)
"""


def adapters() -> dict[str, str]:
    """Return the extra of each adapter that has tests and an extra."""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    modules = (PROJECT / "src" / "graspless_pin" / "interfaces").glob("[a-z]*.py")
    extras = {one.stem: EXTRAS.get(one.stem, one.stem) for one in sorted(modules)}
    return {
        name: extra
        for name, extra in extras.items()
        if extra in project["optional-dependencies"] and tests_of(name).is_file()
    }


def tests_of(name: str) -> Path:
    """Return the file of an adapter's tests."""
    return PROJECT / "tests" / "interfaces" / f"test_{name}.py"


def checked(name: str, extra: str, wheel: Path) -> bool:
    """Tell whether an adapter passes in an environment of its own, which is removed then."""
    environment = FOLDER / name
    shutil.rmtree(environment, ignore_errors=True)
    python = str(environment / "bin" / "python")
    began = time.monotonic()
    install = ["install", "--quiet", "--disable-pip-version-check", "--no-compile"]
    package = f"graspless-pin[{extra}] @ {wheel.as_uri()}"
    steps = {
        "environment": [sys.executable, "-m", "venv", str(environment)],
        "installation": [python, "-m", "pip", *install, package, "pytest", "hypothesis"],
        "tests": [python, "-m", "pytest", "-q", str(tests_of(name))],
        "examples": [python, "-c", DOCTEST, f"graspless_pin.interfaces.{name}"],
    }
    planner = PROJECT / "examples" / "slide_and_pivot" / f"with_{name}.py"
    if planner.is_file():
        steps["planner"] = [python, str(planner)]
    for step, command in steps.items():
        done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)  # noqa: S603
        skipped = step == "tests" and "skipped" in done.stdout
        if done.returncode or skipped:
            print(done.stdout, done.stderr, sep="\n")
            print(f"{name}: {'skipped' if skipped else 'failed'} at: {step}", flush=True)
            return False
    size = sum(file.lstat().st_size for file in environment.rglob("*") if file.is_file())
    seconds = time.monotonic() - began
    passed = ", ".join(list(steps)[2:])
    print(f"{name}: {passed} passed; {seconds:.0f} s, {size / 1e9:.1f} GB", flush=True)
    shutil.rmtree(environment)
    return True


def main() -> int:
    """Test those that are named, or all; return 1 if one fails, 2 if a name is unknown."""
    known = adapters()
    chosen = sys.argv[1:] or list(known)
    if unknown := [name for name in chosen if name not in known]:
        print(f"no adapter {', '.join(unknown)}; there are {', '.join(known)}")
        return 2
    FOLDER.mkdir(parents=True, exist_ok=True)
    for old in FOLDER.glob("*.whl"):
        old.unlink()
    build = ["wheel", "--quiet", "--disable-pip-version-check", "--no-deps", "--wheel-dir", FOLDER]
    subprocess.run([sys.executable, "-m", "pip", *map(str, build), PROJECT], check=True)  # noqa: S603
    (wheel,) = FOLDER.glob("*.whl")
    failed = [name for name in chosen if not checked(name, known[name], wheel)]
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
