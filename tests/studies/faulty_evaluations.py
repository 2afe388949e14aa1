"""Evaluations of samples that fail, for worker processes: they load this module and no more."""

import ctypes
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from graspless_pin.studies import sample_evaluation


def crashes(_):
    """A fault in native code, as a backend may have it."""
    ctypes.string_at(0)


def hangs(_):
    """A native call that lets no other thread of its process run, for a day."""
    ctypes.PyDLL(None).sleep(86400)


def dies_once(plan):
    """The process is killed from outside, as where memory runs out."""
    with suppress(FileExistsError):
        Path(plan.entry.description).touch(exist_ok=False)
        os.kill(os.getpid(), signal.SIGKILL)


def tells_threads_and_hangs(plan):
    """What it writes: threads of linear algebra, and which slow modules were loaded."""
    slow = {"pandas", "scipy.stats", "trimesh"} & {*sys.modules}
    threads = [os.environ[name] for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")]
    part = Path(f"{plan.entry.description}.part")
    part.write_text(" ".join([*threads, str(sorted(slow))]), encoding="utf-8")
    part.rename(plan.entry.description)
    hangs(plan)


def _evaluated(plan, samples, faults):
    for sample in samples:
        if sample[0] in faults:
            faults[sample[0]](plan)
        yield from sample_evaluation.evaluate_each(plan, [sample])


def misbehaves(plan, samples, **_):
    # After the last sample no process has to be started again.
    yield from _evaluated(plan, samples, {3: crashes, 15: dies_once, 23: hangs})


def crashes_at_the_end(plan, samples, **_):
    yield from _evaluated(plan, samples, {23: crashes})


def hangs_at_seven(plan, samples, **_):
    yield from _evaluated(plan, samples, {7: tells_threads_and_hangs})
