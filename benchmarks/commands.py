"""What the command line costs before and beside the answer, in imports of Pinocchio and coal."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
from tabulate import tabulate

_SCENE = Path(__file__).parents[1] / "examples" / "paper" / "cuboid_at_rest.yaml"
_PROGRAM = str(Path(sys.executable).with_name("graspless-pin"))
_ROUNDS = 9
_COMMANDS = {
    "python -c 'import pinocchio, coal'": [sys.executable, "-c", "import pinocchio, coal"],
    "graspless-pin --help": [_PROGRAM, "--help"],
    "graspless-pin solve --help": [_PROGRAM, "solve", "--help"],
    "graspless-pin solve --no-verdict": [_PROGRAM, "solve", "--no-verdict", str(_SCENE)],
    "graspless-pin solve": [_PROGRAM, "solve", str(_SCENE)],
}


def commands() -> str:
    """Whole processes, the interpreter's start included."""
    rounds = [[_processor_time(command) for command in _COMMANDS.values()] for _ in range(_ROUNDS)]
    seconds = np.median(rounds, axis=0)
    rows = [
        [f"`{name}`", f"{time:.2f}", f"{time / seconds[0]:.2f}"]
        for name, time in zip(_COMMANDS, seconds.tolist(), strict=True)
    ]
    table = tabulate(rows, ["process", "s", "ratio"], tablefmt="github", disable_numparse=True)
    note = (
        f"Medians of {_ROUNDS} rounds, in seconds of the processor (user and system) and over the "
        f"first row; the scene is `{_SCENE.stem}`, a box, a half-space and two levers."
    )
    return f"## The command line\n\n{table}\n\n{note}"


def _processor_time(command: list[str]) -> float:
    """Seconds that a process and its children take of the processor."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, capture_output=True, check=True)  # noqa: S603 - fixed programs
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
