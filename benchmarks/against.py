"""Compare this version with an older one: ``make bench BASE=COMMIT``.

Each round runs `benchmarks.rows` once in a fresh process of either version, this one first in every
second round. The older version is installed from its commit into a temporary folder.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tabulate import tabulate

from benchmarks.ratios import ALLOWED, LEAST_ROUNDS, Ratio, ratios_of
from benchmarks.study_loops import STUDIES, study_rate

ROOT = Path(__file__).parents[1]
ROUNDS = 9
# The matrices are small: threads would only make the times depend on what else runs.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
PIP = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check")

Round = tuple[Mapping[str, Any], Mapping[str, Any]]
"""What `benchmarks.rows` printed for the new version, and for the base."""


def main() -> int:
    """Print a row for each measurement; return 1 if any got slower or was lost, 2 on bad usage."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.against", description=__doc__)
    parser.add_argument("base", metavar="COMMIT", help="the version to compare with")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"at least {LEAST_ROUNDS}")
    given = parser.parse_args()
    if given.rounds < LEAST_ROUNDS:
        parser.error(f"--rounds {given.rounds}: there must be at least {LEAST_ROUNDS}")
    commit = checked_commit(parser, given.base)
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="bench-base-") as folder:
        print(f"installing {commit[:10]}", file=sys.stderr)
        base = installed(commit, Path(folder))
        new = Path(sys.executable)
        rounds = []
        for number in range(given.rounds):
            print(f"round {number + 1} of {given.rounds}", file=sys.stderr)
            order = (new, base) if number % 2 else (base, new)
            printed = {python: _rows(python) for python in order}
            rounds.append((printed[new], printed[base]))
        beside = _studies(base)
    text, passed = judged(rounds)
    print(f"### This version over {commit[:10]}\n\n{text}\n\n{beside}")
    print(f"\n{given.rounds} rounds in {time.perf_counter() - start:.0f} s.")
    return 0 if passed else 1


def checked_commit(parser: argparse.ArgumentParser, name: str) -> str:
    """Return the whole name of a commit; the parser ends the program where there is none."""
    found = _git("rev-parse", "--verify", "--quiet", f"{name}^{{commit}}")
    if found.returncode:
        parser.error(f"no commit {name!r} in this repository")
    return found.stdout.decode().strip()


def _studies(base: Path) -> str:
    """Studies of 10 000 samples beside a loop of the base over problems that are ready."""
    # Not above: older versions, which are asked for their answers from here, have it elsewhere.
    from graspless_pin.child_process import usable_cores

    cores, rows = usable_cores(), []
    loops = json.loads(run([base, "-m", "benchmarks.study_loops"], ROOT, **ONE_THREAD))
    for name in STUDIES:
        rate = study_rate(name, cores)
        rows.append([name, loops[name], rate, rate / loops[name]])
    again = json.loads(run([base, "-m", "benchmarks.study_loops"], ROOT, **ONE_THREAD))
    for row in rows:
        row[1] = 0.5 * (row[1] + again[row[0]])
        row[3] = row[2] / row[1]
    headers = [
        "10 000 samples of",
        "loop of the base, 1/s",
        f"study, {cores} processes, 1/s",
        "ratio",
    ]
    table = tabulate(rows, headers, "pipe", floatfmt=("", ".0f", ".0f", ".2f"))
    return (
        f"{table}\n\nThe loop is over `maximize_margin`, problems ready, in one process, before "
        f"and after the studies on {cores} processes. Aims: 3 and 8."
    )


def judged(rounds: Sequence[Round]) -> tuple[str, bool]:
    """Return a table with what there is to say about it, and whether no row got slower or lost."""
    ratios = ratios_of([(new["seconds"], base["seconds"]) for new, base in rounds])
    table = [
        [name, 1e3 * one.base, one.ratio, _spread(one), _mark(one)] for name, one in ratios.items()
    ]
    headers = ["", "base [ms]", "new / base", "spread", ""]
    slower = [name for name, one in ratios.items() if one.slower]
    lost = {why: reason for new, _ in rounds for why, reason in new["missing"].items()}
    lines = [
        tabulate(table, headers, "pipe", floatfmt=("", ".3g", ".3f", "", "")),
        "",
        "New / base: ratio of the medians; spread: where the median of the rounds' own ratios lies "
        f"with 95 % confidence. SLOWER: above {ALLOWED} with a spread above 1.",
    ]
    lines += [f"NOT MEASURED HERE: {name}: {reason}" for name, reason in lost.items()]
    older = {why: reason for _, base in rounds for why, reason in base["missing"].items()}
    lines += [f"not in the base: {name}: {reason}" for name, reason in older.items()]
    lines += _differences(*rounds[0])
    lines.append(f"{len(slower)} of {len(ratios)} rows got slower.")
    return "\n".join(lines), bool(ratios) and not slower and not lost


def _spread(one: Ratio) -> str:
    return f"{one.low:.3f} to {one.high:.3f}"


def _mark(one: Ratio) -> str:
    return "SLOWER" if one.slower else ""


def _differences(new: Mapping[str, Any], base: Mapping[str, Any]) -> list[str]:
    """What else differs, as it may be why."""
    lines = []
    if new["loops"] != base["loops"]:
        lines.append(f"compiled loops: {base['loops']} in the base, {new['loops']} here")
    for name in sorted(new["versions"].keys() & base["versions"].keys() - {"graspless-pin"}):
        here, there = new["versions"][name], base["versions"][name]
        if here != there:
            lines.append(f"{name} {there} in the base, {here} here")
    return lines


def installed(commit: str, folder: Path) -> Path:
    """Install a commit's version in its own environment; return that environment's Python."""
    source, environment = folder / "source", folder / "environment"
    archive = _git("archive", "--format=tar", commit)
    archive.check_returncode()
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as tar:
        tar.extractall(source, filter="data")
    run([sys.executable, "-m", "venv", environment], folder)
    python = environment / "bin" / "python"
    constraints = str(source / "constraints.txt")
    names = {"PIP_CONSTRAINT": constraints, "PIP_BUILD_CONSTRAINT": constraints}
    run([python, *PIP, ".[studies]"], source, **names)
    # In the folder that all that follows runs in: it must not find this version there.
    package = run([python, "-c", "import graspless_pin as it; print(it.__file__)"], ROOT).strip()
    if not Path(package).is_relative_to(folder.resolve()):
        raise RuntimeError(f"{package} is imported, which is not {commit}")
    return python


def _rows(python: Path) -> Mapping[str, Any]:
    """Measure all rows once, in a fresh process."""
    printed = run([python, "-m", "benchmarks.rows"], ROOT, **ONE_THREAD)
    return json.loads(printed.splitlines()[-1])


def run(command: Sequence[str | Path], folder: Path, **variables: str) -> str:
    """Return what a program prints; an exit code but 0 is an error."""
    # Each environment imports what is installed in it, whatever the caller's path lists first.
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(  # noqa: S603 - Python, of this environment or of the base's
        command, cwd=folder, env={**kept, **variables}, stdout=subprocess.PIPE, text=True,
        check=True,
    ).stdout  # fmt: skip


def _git(*arguments: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, check=False)  # noqa: S603, S607


if __name__ == "__main__":
    sys.exit(main())
