"""Evaluations of samples that fail, for worker processes: they load this module and no more."""

import ctypes
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from graspless_pin.studies import sample_evaluation


def tells_threads(plan, samples, **_):
    told = " ".join(os.environ[name] for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"))
    told += f" {sorted({'pandas', 'scipy.stats', 'trimesh'} & {*sys.modules})}"
    for number, _ in samples:
        yield {"sample": number, "status": "failed", "found": False, "error": told}


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


FAULTS = {3: crashes, 7: hangs, 15: dies_once}


def misbehaves(plan, samples, **_):
    for sample in samples:
        FAULTS.get(sample[0], len)(plan if sample[0] in FAULTS else ())
        yield from sample_evaluation.evaluate_each(plan, [sample])


def hangs_at_seven(plan, samples, **_):
    for sample in samples:
        if sample[0] == 7:
            Path(plan.entry.description).touch()
            hangs(plan)
        yield from sample_evaluation.evaluate_each(plan, [sample])
