"""Which test runs which line, and how much work it is."""

from __future__ import annotations

import cProfile
import hashlib
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import coverage
import pytest

from mutation.children import OPTIONS, PACKAGE, enter, in_children

_MOST_PER_FILE = 1800.0


class Test(NamedTuple):
    """A test as it was seen.

    Attributes:
        node: Its pytest node id.
        calls: Of functions, Python's and C's: its work, whatever else the machine does.
        seconds: Processor time, while lines were traced and calls counted.
        lines: Lines that it ran of each file of the package: bit i is line i.
    """

    node: str
    calls: int
    seconds: float
    lines: dict[str, int]

    @property
    def file(self) -> str:
        """The file of the test."""
        return self.node.split("::")[0]

    @property
    def function(self) -> str:
        """The test without its parameters."""
        return self.node.split("[")[0]

    def nearness(self, path: str) -> float:
        """Return the share of its lines that are in one file."""
        total = sum(bits.bit_count() for bits in self.lines.values())
        return self.lines.get(path, 0).bit_count() / total if total else 0.0


class _Watch:
    """A pytest plugin that keeps the lines of each test apart, and counts its calls."""

    def __init__(self, traced: coverage.Coverage) -> None:
        self.traced = traced
        self.work: dict[str, tuple[int, float]] = {}
        self.failed: set[str] = set()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item):
        self.traced.switch_context(item.nodeid)
        start, profile = time.process_time(), cProfile.Profile(subcalls=False)
        profile.enable()
        try:
            return (yield)
        finally:
            profile.disable()
            calls = sum(entry.callcount for entry in profile.getstats())
            self.work[item.nodeid] = calls, time.process_time() - start
            self.traced.switch_context("")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if not report.passed:
            self.failed.add(report.nodeid)


def map_of(copy: Path, tests: Sequence[str], kept: Path, at_once: int) -> list[Test]:
    """Return the tests of a copy that pass there, mapped anew unless the files are the same.

    Args:
        copy: The copy of the project.
        tests: Folders and files of tests.
        kept: Folder that maps are kept in, one for each test file.
        at_once: How many files of tests run at the same time.
    """
    files = sorted(
        {str(file.relative_to(copy)) for one in tests for file in _test_files(copy / one)}
    )
    shared = _digest([*sorted((copy / "src").rglob("*.py")), *_helpers(copy), Path(__file__)])
    kept.mkdir(parents=True, exist_ok=True)
    names = {file: kept / f"{_digest([copy / file], shared)}.json" for file in files}
    missing = [file for file in files if not names[file].exists()]
    for file, ended in in_children(
        missing, lambda file: _map_file(copy, file, names[file]), lambda _: _MOST_PER_FILE, at_once
    ):
        print(f"mapped {file} in {ended.seconds:.0f} s", flush=True)
    found = []
    for file in files:
        if names[file].exists():
            found += [_test(one) for one in json.loads(names[file].read_text(encoding="utf-8"))]
        else:
            print(f"not used, since its map was not made: {file}")
    return found


def _test_files(place: Path) -> list[Path]:
    return [place] if place.is_file() else sorted(place.rglob("test_*.py"))


def _helpers(copy: Path) -> list[Path]:
    return [one for one in sorted((copy / "tests").rglob("*.py")) if "test_" not in one.name[:5]]


def _digest(files: Sequence[Path], start: str = "") -> str:
    total = hashlib.sha256(start.encode())
    for file in files:
        total.update(file.read_bytes())
    return total.hexdigest()[:20]


def _test(raw: dict[str, Any]) -> Test:
    lines = {path: int(bits, 16) for path, bits in raw["lines"].items()}
    return Test(raw["node"], raw["calls"], raw["seconds"], lines)


def _map_file(copy: Path, file: str, result: Path) -> int:
    """Run a file of tests and write what each of them ran."""
    enter(copy)
    package = copy / "src" / PACKAGE
    traced = coverage.Coverage(data_file=None, config_file=False, source=[str(package)])
    watch = _Watch(traced)
    traced.start()
    code = pytest.main([*OPTIONS, "--maxfail=1000", file], plugins=[watch])
    traced.stop()
    data = traced.get_data()
    lines: dict[str, dict[str, int]] = {node: {} for node in watch.work}
    for name in data.measured_files():
        path = str(Path(name).relative_to(package))
        for line, contexts in data.contexts_by_lineno(name).items():
            for node in contexts:
                if node in lines:
                    lines[node][path] = lines[node].get(path, 0) | 1 << line
    tests = [
        {
            "node": node,
            "calls": calls,
            "seconds": seconds,
            "lines": {path: hex(bits) for path, bits in lines[node].items()},
        }
        for node, (calls, seconds) in watch.work.items()
        if node not in watch.failed
    ]
    draft = result.with_suffix(f".{code}.part")
    draft.write_text(json.dumps(tests), encoding="utf-8")
    draft.rename(result)
    return 0
