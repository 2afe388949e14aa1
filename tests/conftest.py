"""Tests that ask for `form` run twice: with the compiled loops, and with numpy in their place.

Of the cases of a test that is marked ``sampled(n)``, n are run; all of them with ``--all-cases``,
or where a test is named.
"""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import zlib
from collections import defaultdict
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

# Before anything loads numpy: several test processes share the cores, and matrices are small.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import portalocker
import pytest
from hypothesis import settings

from graspless_pin import compiled
from graspless_pin.errors import GrasplessPinError

# Tests import what they share as `tests.core.scenes`, wherever pytest is started.
if (_ROOT := str(Path(__file__).resolve().parents[1])) not in sys.path:
    sys.path.insert(0, _ROOT)

# Whoever runs the tests in the background, or with nohup, ignores these, and so would every process
# that a test starts and interrupts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


# A slow machine is no defect. The rest is hypothesis' own choice: in CI the same examples always.
settings.register_profile("without deadlines", settings(), deadline=None)
settings.load_profile("without deadlines")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option."""
    parser.addoption("--all-cases", action="store_true", help="run all cases of sampled tests, too")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out cases beyond those that are run: always the same ones."""
    if config.getoption("--all-cases") or any("::" in one for one in config.args):
        return
    cases: defaultdict[tuple[str, int], list[pytest.Item]] = defaultdict(list)
    for item in items:
        marker = item.get_closest_marker("sampled")
        if marker is not None:
            cases[item.nodeid.partition("[")[0], marker.args[0]].append(item)
    left_out: set[pytest.Item] = set()
    for (_, count), those in cases.items():
        # In an order that has nothing to do with that of the parameters.
        left_out.update(sorted(those, key=lambda one: zlib.crc32(one.nodeid.encode()))[count:])
    config.hook.pytest_deselected(items=[one for one in items if one in left_out])
    items[:] = [one for one in items if one not in left_out]


def pytest_collection() -> None:
    """Keep the collector of garbage from going through all modules and tests again and again."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Leave all that was collected out of it, too."""
    gc.enable()
    gc.collect()
    gc.freeze()


def pytest_unconfigure() -> None:
    """Let all of it go at the end: libraries look for what is left over."""
    gc.unfreeze()


def leave_out_loops(patch: pytest.MonkeyPatch) -> None:
    """Make all modules loaded so far go without the compiled loops."""
    for module in _users_of_loops(len(sys.modules)):
        patch.setattr(module, "core", None)


@lru_cache(maxsize=1)
def _users_of_loops(_: int) -> list[ModuleType]:
    """The modules that use them, looked for again when more modules are loaded."""
    return [
        module
        for name, module in list(sys.modules.items())
        if name.startswith("graspless_pin.") and module is not compiled and "core" in vars(module)
    ]


def _outcome(call: Callable[[], Any]) -> Any:
    try:
        return call()
    except GrasplessPinError as error:
        return type(error), str(error)


def _by_numpy(call: Callable[[], Any]) -> Any:
    with pytest.MonkeyPatch.context() as patch:
        leave_out_loops(patch)
        return _outcome(call)


@pytest.fixture(scope="session")
def outcome() -> Callable[[Callable[[], Any]], Any]:
    """What a call returns, or the kind and message of the error that it raises."""
    return _outcome


@pytest.fixture(scope="session")
def by_numpy() -> Callable[[Callable[[], Any]], Any]:
    """The same without the compiled loops."""
    return _by_numpy


@pytest.fixture
def without_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    """The test runs as on a machine without a C compiler."""
    leave_out_loops(monkeypatch)


@pytest.fixture
def without_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report's text alone: what is plotted takes most of its time."""
    monkeypatch.setattr("graspless_pin.report.html.sections._inline_svg", lambda *_, **__: "")


@pytest.fixture(params=["compiled", "numpy"])
def form(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """How the loops run."""
    if request.param == "numpy":
        leave_out_loops(monkeypatch)
    elif compiled.core is None:
        pytest.skip("the loops are not compiled")
    return request.param


SOURCES_OF_SITE = ("docs", "mkdocs_hooks", "mkdocs.yml", "src", "examples", "robots", "README.md")


def _made_since(folder: Path, root: Path) -> bool:
    """Whether a site was built after its sources changed."""
    last = folder / "search" / "search_index.json"
    if not last.is_file():
        return False
    built = last.stat().st_mtime
    files = [file for name in SOURCES_OF_SITE for file in [root / name, *(root / name).rglob("*")]]
    return all(
        file.stat().st_mtime < built for file in files if file.is_file() and file.suffix != ".pyc"
    )


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The documentation site: that of `make docs`, else built once, without a warning."""
    root, own = Path(__file__).parents[1], tmp_path_factory.getbasetemp()
    if _made_since(root / "site", root):
        return root / "site"
    common = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    folder, part = common / "site", own / "site.part"
    with portalocker.Lock(common / "site.lock", timeout=300.0):
        if not folder.exists():
            command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
            built = subprocess.run(  # noqa: S603 - our own command
                [*command, "--site-dir", str(part)],
                cwd=root,
                env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
                capture_output=True,
                text=True,
                check=False,
            )
            assert (built.returncode, built.stdout, built.stderr) == (0, "", "")
            part.rename(folder)
    return folder
