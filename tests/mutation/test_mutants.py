"""The mutants of `make mutants`: where they are made, with which tests they are tried, and how."""

import json
import subprocess
import sys
from importlib.util import module_from_spec

import pytest
from mutation.children import Mutated
from mutation.choice import Choice
from mutation.loops import LOOPS, MISTAKES, ROOT
from mutation.sites import all_mutants, sample

from mutation import test_map

MODULE = '''"""A module."""

from __future__ import annotations

_SLACK = 1e-9


def near(one: float, other: float) -> bool:
    return abs(one - other) < _SLACK


def far(one: float) -> float:
    if one is not None:
        return one + 2
    return 0.5
'''


@pytest.fixture
def package(tmp_path):
    """A package of one module."""
    (tmp_path / "module.py").write_text(MODULE, encoding="utf-8")
    return tmp_path


def test_each_mutant_is_one_change_that_compiles(package):
    mutants = all_mutants(package, "module.py")
    sources = [mutant.source(package) for mutant in mutants]
    assert MODULE not in sources
    for mutant, source in zip(mutants, sources, strict=True):
        compile(source, "module.py", "exec")
        changed = [
            a for a, b in zip(MODULE.splitlines(), source.splitlines(), strict=False) if a != b
        ]
        assert changed[:1] == [MODULE.splitlines()[mutant.line - 1]]
    slacks = [float(source.split("_SLACK = ")[1].split()[0]) for source in sources]
    assert sorted({slack for slack in slacks if slack != 1e-9}) == pytest.approx([1e-12, 1e-6])
    # Annotations are not run.
    assert all("-> float" in source for source in sources)


SAME = """
from functools import lru_cache
class Options(TypedDict, total=False):
    name: str
@lru_cache(maxsize=9)
def flat(array):
    return array.reshape(-1)
def other(one, two, sizes):
    return one is not None or one is Color.RED or two is one or sizes.reshape(3, 4)
def looped(one):
    if core is None or one > 5:
        return one - 6
    return one + 7
def sometimes_looped(one):
    if core is None and one > 8:
        return one
    return one + 9
"""


def test_what_is_the_same_either_way_is_left_out_by_its_rule_and_nothing_beside_it(tmp_path):
    (tmp_path / "same.py").write_text(SAME, encoding="utf-8")
    mutants = all_mutants(tmp_path, "same.py")
    sources = [mutant.source(tmp_path) for mutant in mutants]
    for kept in ("total=False", "@lru_cache(maxsize=9)", "reshape(-1)", "one + 7"):
        assert all(kept in source for source in sources)
    for gone in ("one != None", "one == Color.RED"):
        assert not any(gone in source for source in sources)
    for tried in (
        "one is None",
        "one is not Color.RED",
        "two == one",
        "reshape( 4, 4)",
        "one - 7",
        "one + 8",
    ):
        assert any(tried in source for source in sources), tried


def test_the_sample_is_the_same_every_time_and_has_no_place_twice(package):
    first, again = (sample(package, ["module.py"], 6, seed=1) for _ in range(2))
    assert first == again and len(first) == 6
    assert len({(one.line, one.column, one.last) for one in first}) == 6
    assert sample(package, ["module.py"], 6, seed=2) != first


def test_a_change_elsewhere_leaves_a_place_in_the_sample(package):
    """Else every commit would be tried with other mistakes, and no two scores could be compared."""

    def drawn(seed: int) -> set[str]:
        mutants = sample(package, ["module.py"], 6, seed)
        return {one.source(package).splitlines()[one.line - 1] for one in mutants}

    before = [drawn(seed) for seed in range(10)]
    above = "_SLACK = 1e-9\n_MORE, _LEAST = 7, 8"
    (package / "module.py").write_text(MODULE.replace("_SLACK = 1e-9", above), encoding="utf-8")
    # What is new may take the places of two.
    assert all(len(before[seed] - drawn(seed)) <= 2 for seed in range(10))


def ran(node: str, calls: int, *lines: int, seconds: float = 1.0) -> test_map.Test:
    return test_map.Test(node, calls, seconds, {"module.py": sum(1 << line for line in lines)})


def test_mutants_are_tried_with_tests_that_run_their_line(package):
    near = ran("tests/a.py::near", 1_000_000, 8, 9)
    far = ran("tests/a.py::far", 1_000_000, 12, 13, 14)
    slow = ran("tests/b.py::slow", 9_000_000, 8, 9, 12, 13, 14)
    choice = Choice(package, [near, far, slow])
    for mutant in all_mutants(package, "module.py"):
        tests = choice.tests_of(mutant, calls=5e6)
        # The tolerance is used in line 9.
        assert tests == ([near] if mutant.line in (5, 9) else [far] if mutant.line < 15 else [])
        assert slow in choice.tests_of(mutant, calls=1e7) or mutant.line == 15


def test_a_decorator_is_tried_with_tests_that_run_its_function(tmp_path):
    text = "class One:\n    @property\n    def value(self):\n        return 1\n\n\nprint(One)\n"
    (tmp_path / "module.py").write_text(text, encoding="utf-8")
    runs, loads = ran("tests/a.py::runs", 9, 4), ran("tests/a.py::loads", 9, 7)
    mutants = [one for one in all_mutants(tmp_path, "module.py") if one.line == 2]
    assert mutants
    for mutant in mutants:
        assert Choice(tmp_path, [loads, runs]).tests_of(mutant, 100.0) == [runs]


def test_neither_the_choice_nor_the_work_of_a_test_depends_on_how_long_it_takes(package):
    quiet, busy = (
        [ran(f"tests/{n}.py::test", n * 1_000_000, 8, 9, seconds=n**power) for n in range(1, 9)]
        for power in (1, -2)
    )
    for mutant in all_mutants(package, "module.py"):
        first, again = (Choice(package, tests).tests_of(mutant, 9e6) for tests in (quiet, busy))
        assert [one.node for one in first] == [one.node for one in again]
        assert len(first) == (3 if mutant.line in (5, 9) else 0)


TIMED = """
import pytest
from graspless_pin.sums import one_more

@pytest.mark.parametrize("calls, added", [(1, 1), (1000, 10_000_000), (3000, 1)])
def test_work(calls, added):
    total = 0
    for _ in range(calls):
        total = one_more(total)
    assert sum(range(added)) >= 0
"""
MAPS = """
import json, sys
from pathlib import Path
from mutation.test_map import map_of

copy = Path(sys.argv[1])
for test in map_of(copy, ["tests"], copy / "kept", at_once=1):
    print(json.dumps([test.calls, test.lines]))
"""


def test_the_work_of_a_test_is_its_calls(tmp_path):
    for name, text in (
        ("src/graspless_pin/__init__.py", ""),
        ("src/graspless_pin/sums.py", "def one_more(total):\n    return total + 1\n"),
        ("tests/test_work.py", TIMED),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    told = subprocess.run(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", MAPS, tmp_path],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert told.returncode == 0, told.stderr
    lines = told.stdout.splitlines()[1:]  # behind the line that says what is mapped
    (_, first), (calls, _), (more_calls, _) = map(json.loads, lines)
    assert first == {"sums.py": 1 << 2}
    assert 1900 <= more_calls - calls <= 2100  # though the one before adds ten million numbers


def test_a_module_is_imported_from_its_mutated_text(tmp_path):
    finder = Mutated(tmp_path, "problem/checks.py", "VALUE = 7\n")
    spec = finder.find_spec("graspless_pin.problem.checks")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.VALUE == 7
    assert finder.find_spec("graspless_pin.problem.scales") is None
    folder = Mutated(tmp_path, "problem/__init__.py", "VALUE = 8\n")
    assert folder.find_spec("graspless_pin.problem") is not None


CHILDREN = """
import os, signal, time
from mutation.children import in_children

def run(job):
    if job == "crash":
        os.kill(os.getpid(), signal.SIGKILL)
    while job == "endless":
        time.process_time()
    if job == "error":
        raise RuntimeError(job)
    return 3 if job == "three" else 0

jobs = ["fine", "three", "crash", "endless", "error"]
for job, ended in in_children(jobs, run, lambda _: 1.0, at_once=2):
    print(job, ended.code, ended.seconds > 0.5)
"""


def test_children_end_with_their_code_their_time_or_a_crash():
    # In a process of its own: this one may have threads, which a fork does not bear.
    told = subprocess.run(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", CHILDREN], cwd=ROOT, capture_output=True, text=True, timeout=600
    )
    assert sorted(told.stdout.splitlines()) == [
        "crash None False", "endless None True", "error 70 False", "fine 0 False", "three 3 False",
    ], told.stderr  # fmt: skip


def test_every_mistake_in_the_loops_has_its_place():
    """What was renamed since has to be renamed there, too."""
    assert len(MISTAKES) >= 30
    assert len(set(MISTAKES)) == len(MISTAKES)
    files = {file.stem for file in (ROOT / LOOPS).glob("*.pxi")}
    assert files <= {mistake.loops for mistake in MISTAKES}
    for mistake in MISTAKES:
        right = (ROOT / LOOPS / mistake.file).read_text(encoding="utf-8")
        assert mistake.source(ROOT / LOOPS) != right
