"""The force ranges of a report, within a time limit."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path

from graspless_pin.algorithms.force_bounds import ContactForceBounds, contact_force_bounds
from graspless_pin.errors import NoSolutionError
from graspless_pin.solution import TorqueSolution

# A search cannot be told to stop half way, but the process that it runs in can be ended. The
# answer goes to a file, so that nothing else that is printed can mix with it.
_PROGRAM = """
import pickle, sys
from pathlib import Path
from graspless_pin.algorithms.force_bounds import contact_force_bounds
from graspless_pin.errors import NoSolutionError
asked, answer = map(Path, sys.argv[1:])
problem, torques, rules = pickle.loads(asked.read_bytes())
try:
    found = contact_force_bounds(problem, torques, **rules)
except NoSolutionError as error:
    found = error
answer.write_bytes(pickle.dumps(found))
"""


def bounds_within(solution: TorqueSolution, seconds: float | None) -> ContactForceBounds:
    """Return the force ranges of a solution's torques.

    Args:
        solution: A solution that was found.
        seconds: They are worked out in a process of its own, which is ended after this time;
            None: here, however long it takes.

    Raises:
        NoSolutionError: If there are no ranges, or none in this time.
    """
    asked = (solution.problem, solution.torques, solution.rules.options())
    if seconds is None:
        return contact_force_bounds(asked[0], asked[1], **asked[2])
    with tempfile.TemporaryDirectory() as folder:
        question, answer = Path(folder, "question"), Path(folder, "answer")
        question.write_bytes(pickle.dumps(asked))
        try:
            subprocess.run(  # noqa: S603 - our own interpreter and program
                [sys.executable, "-c", _PROGRAM, str(question), str(answer)],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                timeout=seconds,
                check=True,
            )
        except subprocess.TimeoutExpired:
            raise NoSolutionError(
                f"working them out was ended after {seconds:g} s; a larger --ranges-time gives it "
                "more."
            ) from None
        except subprocess.CalledProcessError as error:
            raise NoSolutionError(f"the process that works them out failed: {error}.") from None
        found = pickle.loads(answer.read_bytes())  # noqa: S301 - written by our own program
    if isinstance(found, NoSolutionError):
        raise found
    return found
