"""Spoil files and give them to the command line: no traceback, no signal, no flood, no long wait.

    python tests/fuzzing/fuzz.py --count 2000 --seed 1

The libraries are loaded once; every command runs in a process forked from there, with the working
folder, output and limits of its own. Prints what broke the rules, with the number of the case:
``--only NUMBER --keep FOLDER`` runs it again and leaves its files.
"""

from __future__ import annotations

import argparse
import importlib
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from random import Random

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import spoiling
import spoilt_seeds as seeds

from graspless_pin.cli.commands import app

SECONDS = 10.0
"""Processor time of a command and its own children."""
PATIENCE = 120.0
"""Wall-clock time after which a command is ended: other work may slow it down."""
GIB = 2.0
BYTES = 2000


@dataclass(frozen=True)
class Case:
    """One spoilt file and the command that reads it."""

    number: int
    seed: seeds.Seed
    command: tuple[str, ...]
    content: bytes

    def write(self, folder: Path) -> None:
        """Write all files, the spoilt one among them."""
        for name, content in self.seed.files.items():
            (folder / name).write_bytes(content)
        (folder / self.seed.name).write_bytes(self.content)


@dataclass(frozen=True)
class Outcome:
    """What became of a command."""

    code: int
    stderr: bytes
    stdout: bytes
    seconds: float
    gib: float

    def faults(self) -> list[str]:
        """Return which rules it broke."""
        text = self.stderr.decode("utf-8", "replace")
        found = []
        if self.code < 0:
            found.append(f"died of {signal.Signals(-self.code).name}")
        elif self.code not in (0, 1, 2, 4):
            found.append(f"exit code {self.code}")
        if "Traceback" in text or b"Traceback" in self.stdout:
            found.append(f"traceback: {text.strip().splitlines()[-1][:200]}")
        # Below the findings that explain it.
        elif self.code == 2 and not re.search("^(error|Usage): ", text, re.MULTILINE):
            found.append(f"no message: {text[:200]!r}")
        elif self.code in (0, 1, 4) and not all(
            # A report of a document that is refused is written, and says so.
            line.startswith(("serious: ", "warning: ", "note: ", " ", "..."))
            or (self.code == 4 and line.startswith("error: "))
            for line in text.splitlines()
        ):
            found.append(f"something else on standard error: {text[:200]!r}")
        if len(self.stderr) >= BYTES:
            found.append(f"{len(self.stderr)} bytes on standard error")
        if self.seconds >= SECONDS:
            found.append(f"{self.seconds:.1f} s")
        if self.gib >= GIB:
            found.append(f"{self.gib:.2f} GiB")
        return found


def case(number: int, seed: int, known: list[seeds.Seed]) -> Case:
    """Return a case by its number: the same for the same seed, whatever ran before."""
    random = Random(f"{seed}-{number}")  # noqa: S311 - reproducible, not secret
    chosen = random.choice(known)
    command = random.choice(chosen.commands)
    content = spoiling.spoil(chosen.name, chosen.files[chosen.name], random)
    return Case(number, chosen, command, content)


def start(item: Case, folder: Path) -> int:
    """Run a command in a process of its own; return the process."""
    folder.mkdir(parents=True)
    item.write(folder)
    child = os.fork()
    if child:
        return child
    os.setsid()
    os.chdir(folder)
    for name, number in (("stdout", 1), ("stderr", 2)):
        os.dup2(os.open(f".{name}", os.O_WRONLY | os.O_CREAT), number)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CPU, (int(2 * SECONDS), int(2 * SECONDS)))
    room = int(2 * GIB * 2**30)
    resource.setrlimit(resource.RLIMIT_AS, (room, room))
    code = 3
    try:
        sys.argv = ["graspless-pin", *item.command]
        app(list(item.command), prog_name="graspless-pin")
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException as error:  # what Python itself would print
        sys.excepthook(type(error), error, error.__traceback__)
        code = 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def end(status: int, usage: resource.struct_rusage, folder: Path) -> Outcome:
    """Return what became of a process that has ended."""
    return Outcome(
        os.waitstatus_to_exitcode(status),
        (folder / ".stderr").read_bytes(),
        (folder / ".stdout").read_bytes(),
        usage.ru_utime + usage.ru_stime,
        usage.ru_maxrss / 2**20,
    )


def run(cases: list[Case], folder: Path, jobs: int) -> dict[int, Outcome]:
    """Run all cases, some at a time."""
    for words, module in (("report", "matplotlib.pyplot"), ("study", "pandas")):
        if any(item.command[0] == words for item in cases):
            importlib.import_module(module)  # once, and not in each process
    waiting = list(reversed(cases))
    running: dict[int, tuple[Case, Path, float]] = {}
    outcomes: dict[int, Outcome] = {}
    while waiting or running:
        while waiting and len(running) < jobs:
            item = waiting.pop()
            place = folder / str(item.number)
            running[start(item, place)] = item, place, time.monotonic()
        for process, (item, place, begin) in list(running.items()):
            ended, status, usage = os.wait4(process, os.WNOHANG)
            if ended:
                outcomes[item.number] = end(status, usage, place)
                del running[process]
                shutil.rmtree(place, ignore_errors=True)
            elif time.monotonic() - begin > PATIENCE:
                os.killpg(process, signal.SIGKILL)
        time.sleep(0.002)
    return outcomes


def main() -> int:
    """Run the cases and tell what broke the rules."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", type=int, nargs="*")
    parser.add_argument("--keep", type=Path, help="write the files of --only here and run nothing")
    options = parser.parse_args()
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "seeds").mkdir()
        known = seeds.seeds(folder / "seeds")
        numbers = options.only or range(options.count)
        cases = [case(number, options.seed, known) for number in numbers]
        if options.keep:
            for item in cases:
                place = options.keep / str(item.number)
                place.mkdir(parents=True)
                item.write(place)
                print(f"cd {place}; graspless-pin {' '.join(item.command)}")
            return 0
        outcomes = run(cases, folder, options.jobs)
    broken = 0
    for item in cases:
        faults = outcomes[item.number].faults()
        broken += bool(faults)
        for fault in faults:
            print(f"{item.number}: {item.seed.name}, {' '.join(item.command)}: {fault}")
    codes = Counter(outcome.code for outcome in outcomes.values())
    slowest = max(outcome.seconds for outcome in outcomes.values())
    largest = max(outcome.gib for outcome in outcomes.values())
    longest = max(len(outcome.stderr) for outcome in outcomes.values())
    print(
        f"{len(cases)} mutations (seed {options.seed}): {broken} broke a rule; exit codes "
        f"{dict(sorted(codes.items()))}; at most {slowest:.1f} s, {largest:.2f} GiB, {longest} "
        f"bytes on standard error; {time.monotonic() - begin:.0f} s in all"
    )
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
