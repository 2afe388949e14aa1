"""Try a seeded sample of mutants, or those named, and say which of them no test noticed."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from mutation.children import (
    OPTIONS,
    PACKAGE,
    Ended,
    Mutated,
    copy_of,
    enter,
    import_shared,
    in_children,
)
from mutation.choice import Choice
from mutation.sites import Mutant, all_mutants, sample
from mutation.test_map import Test, map_of

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "out" / "mutants"
MUTATED = ("problem", "modes", "programs", "solvers", "algorithms", "report/verify*")
TESTS = (
    "tests/core", "tests/analysis", "tests/planning", "tests/report", "tests/oracles",
    "tests/holding", "tests/verify",
    "tests/studies/test_margin_torque_curve.py", "tests/scene/test_uncertain_scenes.py",
    "tests/scene/test_member_verdicts.py", "tests/cli/test_uncertain_command.py",
)  # fmt: skip
OF_LOOPS = ("algorithms/batch_optimum.py", "algorithms/batch_programs.py")
"""Files that do nothing without compiled loops: their mutants are among those of `loops`."""
FIRST, MORE = 6.0, 30.0
"""Millions of calls in the tests that a mutant is tried with; and, if it survives, once more."""


class Trial:
    """Tries mutants of a copy."""

    def __init__(self, copy: Path, tests: Sequence[Test], at_once: int) -> None:
        """Take the copy, its tests and how many mutants are tried at the same time."""
        self._copy, self._at_once = copy, at_once
        self._package = copy / "src" / PACKAGE
        self._choice = Choice(self._package, tests)

    def run(self, mutants: Sequence[Mutant], millions: float) -> dict[Mutant, str]:
        """Return by what each mutant was noticed: empty if no test did, "-" if none runs it."""
        tests = {one: self._choice.tests_of(one, 1e6 * millions) for one in mutants}
        verdicts = {one: "-" for one in mutants if not tests[one]}
        tried = [one for one in mutants if tests[one]]
        start = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            notes = {one: Path(folder) / str(number) for number, one in enumerate(tried)}

            def attempt(mutant: Mutant) -> int:
                return self._attempt(mutant, [test.node for test in tests[mutant]], notes[mutant])

            for one, ended in in_children(
                tried, attempt, lambda one: _allowed(tests[one]), self._at_once
            ):
                verdicts[one] = self._verdict(ended, notes[one])
                print(
                    f"{time.monotonic() - start:6.0f} s {ended.seconds:5.1f} s "
                    f"{verdicts[one] or 'SURVIVED':60.60} {one}",
                    flush=True,
                )
        return verdicts

    @staticmethod
    def _verdict(ended: Ended, note: Path) -> str:
        if ended.code == 0:
            return ""
        if note.exists():
            return note.read_text(encoding="utf-8")
        return "time" if ended.code is None else "the import"

    def _attempt(self, mutant: Mutant, nodes: Sequence[str], note: Path) -> int:
        enter(self._copy)
        text = mutant.source(self._package)
        sys.meta_path.insert(0, Mutated(self._copy, mutant.path, text))
        return int(pytest.main([*OPTIONS, *nodes], plugins=[_Note(note)]))


class _Note:
    """A pytest plugin that writes down the test that failed."""

    def __init__(self, note: Path) -> None:
        self._note = note

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._note.write_text(report.nodeid, encoding="utf-8")


def _allowed(tests: Sequence[Test]) -> float:
    # Generous: a right answer that takes longer on a busy machine is no mistake noticed.
    return 10.0 + 4.0 * sum(test.seconds for test in tests)


def _files(package: Path) -> list[str]:
    found = set[Path]()
    for name in MUTATED:
        for place in package.glob(name):
            found.update([place] if place.is_file() else place.rglob("*.py"))
    return sorted({str(file.relative_to(package)) for file in found} - {*OF_LOOPS})


def _named(package: Path, names: Sequence[str]) -> list[Mutant]:
    """The mutants of files, of lines, or single ones."""
    found = []
    for name in names:
        path = name.split(":", maxsplit=1)[0]
        found += [one for one in all_mutants(package, path) if f"{one}:".startswith(f"{name}:")]
    return found


def main() -> int:
    """Print a line for each mutant and the score; return 1 if it is below what is asked for."""
    parser = argparse.ArgumentParser(prog="python -m mutation", description=__doc__)
    parser.add_argument("--sample", type=int, default=300, help="how many mutants")
    parser.add_argument("--seed", type=int, default=0, help="of the sample")
    parser.add_argument("--part", default="1/1", help="which part of the sample, such as 2/5")
    parser.add_argument(
        "--only", nargs="+", metavar="PATH[:LINE[:...]]", help="instead of a sample"
    )
    parser.add_argument(
        "--tests", nargs="+", default=TESTS, help="files and folders, instead of all that count"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--least", type=float, default=90.0, help="score that passes, %%")
    parser.add_argument("--first", type=float, default=FIRST, help="millions of calls in tests")
    parser.add_argument("--more", type=float, default=MORE, help="those for survivors")
    parser.add_argument("--results", type=Path, help="file that gets the verdicts as JSON")
    given = parser.parse_args()
    start = time.monotonic()
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", CI="true")
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copy = copy_of(ROOT, Path(folder), loops=False)
        package = copy / "src" / PACKAGE
        if given.only:
            mutants = _named(package, given.only)
        else:
            number, parts = map(int, given.part.split("/"))
            mutants = sample(package, _files(package), given.sample, given.seed)
            mutants = mutants[number - 1 :: parts]
        import_shared()
        there = [one for one in given.tests if (copy / one).exists()]
        tests = map_of(copy, there, KEPT, given.jobs)
        trial = Trial(copy, tests, given.jobs)
        print(f"{len(mutants)} mutants, {len(tests)} tests")
        verdicts = trial.run(mutants, given.first)
        left = [one for one in mutants if not verdicts[one]]
        if given.more > given.first and left:
            print(f"{len(left)} mutants are tried with more tests")
            verdicts.update(trial.run(left, given.more))
        lines = {one: (package / one.path).read_text("utf-8").splitlines() for one in mutants}
        survived = [one for one in mutants if verdicts[one] in ("", "-")]
        for one in sorted(survived):
            why = "no test runs it" if verdicts[one] == "-" else "survived"
            print(f"{why}: {one}\n    {lines[one][one.line - 1].strip()}")
    killed = len(mutants) - len(survived)
    score = 100.0 * killed / max(len(mutants), 1)
    print(f"{killed} of {len(mutants)} mutants were noticed: {score:.1f} %")
    print(f"{time.monotonic() - start:.0f} s")
    if given.results:
        written = {str(one): verdict for one, verdict in verdicts.items()}
        given.results.write_text(json.dumps(written, indent=1), encoding="utf-8")
    return 0 if score >= given.least else 1


if __name__ == "__main__":
    sys.exit(main())
