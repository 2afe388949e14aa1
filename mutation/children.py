"""Run tests of a copy of the project in forked processes that share what is slow to import."""

from __future__ import annotations

import compileall
import contextlib
import importlib
import importlib.abc
import importlib.util
import os
import resource
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import NamedTuple, TypeVar

PACKAGE = "graspless_pin"
COPIED = ("src", "tests", "examples", "robots", "benchmarks", "docs", "pyproject.toml")
# Kept from one trial to the next: these take most of the time that an import takes.
_SHARED = (
    "numpy", "scipy.optimize", "scipy.sparse", "scipy.spatial", "scipy.stats", "qpsolvers", "piqp",
    "proxsuite", "highspy", "clarabel", "pytest", "hypothesis", "pinocchio", "coal", "pydantic",
    "yaml", "trimesh", "rich", "typer", "tabulate", "coverage",
)  # fmt: skip
OPTIONS = (
    "-q", "-x", "--tb=no", "--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist",
    "-W", "ignore::pytest.PytestAssertRewriteWarning",  # of what is imported before
)  # fmt: skip
"""What pytest is called with."""
_WAIT = 0.01
_ASLEEP = 30.0
"""How many times longer than its processor time a child may last, on a busy machine."""

Job = TypeVar("Job")


class Ended(NamedTuple):
    """How a child ended.

    Attributes:
        code: Its exit code; None: it was killed, for its time or by a crash.
        seconds: Processor time that it took.
    """

    code: int | None
    seconds: float


def copy_of(root: Path, folder: Path, *, loops: bool) -> Path:
    """Copy what the tests need, with the compiled loops or without."""
    left_out = ("__pycache__",) if loops else ("__pycache__", "*.so", "*.pyd")
    for name in COPIED:
        source = root / name
        if source.is_dir():
            ignored = shutil.ignore_patterns(*left_out)
            shutil.copytree(source, folder / name, ignore=ignored)
        elif source.exists():
            shutil.copy(source, folder / name)
    for name in ("src", "tests"):  # once, not in each child
        compileall.compile_dir(folder / name, quiet=1)
    return folder


def import_shared() -> None:
    """Import what all children need, once."""
    for name in _SHARED:
        importlib.import_module(name)


def enter(copy: Path) -> None:
    """Make this process, a child, use the copy."""
    for name in [*sys.modules]:
        if name.split(".")[0] in (PACKAGE, "mutation"):
            del sys.modules[name]
    sys.path[:] = [str(copy / "src"), *(p for p in sys.path if not p.endswith("src"))]
    sys.dont_write_bytecode = True
    os.chdir(copy)
    from hypothesis import HealthCheck, Phase, settings  # after the fork: it reads the time

    # A failure is all that is asked for: not the smallest one.
    phases = (Phase.explicit, Phase.generate)
    settings.register_profile(
        "mutants",
        derandomize=True,
        database=None,
        deadline=None,
        phases=phases,
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.load_profile("mutants")


class Mutated(importlib.abc.MetaPathFinder):
    """Imports one module from a given text."""

    def __init__(self, copy: Path, path: str, text: str) -> None:
        """Take the module's path within the package and its text."""
        parts = [PACKAGE, *Path(path).with_suffix("").parts]
        self._name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        self._file = str(copy / "src" / PACKAGE / path)
        self._text = text

    def find_spec(self, fullname: str, *_: object) -> ModuleSpec | None:
        """Return how the module is loaded, None for other modules."""
        if fullname != self._name:
            return None
        text = self._text

        class Loader(SourceFileLoader):
            def get_code(self, fullname: str) -> CodeType:
                return compile(text, self.get_filename(fullname), "exec")

        loader = Loader(self._name, self._file)
        return importlib.util.spec_from_file_location(self._name, self._file, loader=loader)


def in_children(
    jobs: Iterable[Job],
    run: Callable[[Job], int],
    allowed: Callable[[Job], float],
    at_once: int,
) -> Iterator[tuple[Job, Ended]]:
    """Run each job in a child of its own and yield how it ended, as they end.

    Args:
        jobs: What is to be done.
        run: Does it and returns the exit code.
        allowed: Processor time that a job may take, s.
        at_once: How many run at the same time.
    """
    waiting, running = iter(jobs), dict[int, tuple[Job, float]]()
    more = True
    while more or running:
        while more and len(running) < at_once:
            try:
                job = next(waiting)
            except StopIteration:
                more = False
                break
            most = allowed(job)
            child = os.fork()
            if child == 0:
                _child(job, run, most)
            running[child] = job, time.monotonic() + _ASLEEP * most + 10.0
        for child, (job, deadline) in list(running.items()):
            ended, status, usage = os.wait4(child, os.WNOHANG)
            if not ended:
                if time.monotonic() > deadline:
                    _kill_group(child)
                continue
            _kill_group(child)
            del running[child]
            code = os.waitstatus_to_exitcode(status)
            seconds = usage.ru_utime + usage.ru_stime
            yield job, Ended(None if code < 0 else code, seconds)
        time.sleep(_WAIT)


def _child(job: Job, run: Callable[[Job], int], most: float) -> None:
    code = 70
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (int(most) + 1, int(most) + 2))
        silent = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(silent, stream)
        code = run(job)
    finally:
        os._exit(code)


def _kill_group(child: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
