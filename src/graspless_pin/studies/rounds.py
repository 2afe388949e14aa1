"""The rounds of a study: one, or as many as its samples are refined in."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from graspless_pin.studies.refinement import AdaptiveSamples
from graspless_pin.studies.rows import Row
from graspless_pin.studies.study import Study


def rounds_of(
    study: Study, rows: Callable[[Iterable[int]], Iterator[Row]]
) -> Iterator[tuple[Study, range]]:
    """Yield the study with its samples so far, and the numbers of those that are new in a round.

    Args:
        study: The study with the samples of its first round.
        rows: Reads the rows of samples. They have them when the next round is asked for.

    Yields:
        The study and its new numbers.
    """
    border = study.entry.sampling.border or "found"
    outcomes: dict[str, int] = {}
    told = array("q")
    while len(told) < len(study.samples):
        numbers = range(len(told), len(study.samples))
        yield study, numbers
        if not isinstance(study.samples, AdaptiveSamples):
            return
        for row in rows(numbers):
            told.append(outcomes.setdefault(str(row.get(border)), len(outcomes)))
        samples = study.samples.refined(np.array(told))
        study = replace(study, samples=samples)
