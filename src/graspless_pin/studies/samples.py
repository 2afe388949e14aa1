"""Which samples a study has: values made from a sample's number, so that none are kept."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any, overload

import numpy as np

from graspless_pin.bounds import MOST_SAMPLES
from graspless_pin.errors import GrasplessPinError, StudyError
from graspless_pin.problem.checks import FloatArray
from graspless_pin.studies.sample_parts import Sample
from graspless_pin.studies.study_schema import SamplingEntry
from graspless_pin.studies.variables import Variable


class Samples(Sequence[Sample]):
    """The values of all variables, sample by sample; a sample is made when it is asked for."""

    @abstractmethod
    def at(self, number: int) -> Sample:
        """Return a sample by its number, which is one that there is."""

    @overload
    def __getitem__(self, index: int) -> Sample: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Sample, ...]: ...
    def __getitem__(self, index: int | slice) -> Sample | tuple[Sample, ...]:
        """Return a sample, or some."""
        numbers = range(len(self))[index]
        return self.at(numbers) if isinstance(numbers, int) else tuple(map(self.at, numbers))


@dataclass(frozen=True, eq=False)
class GridSamples(Samples):
    """All combinations of values; the last variable varies fastest.

    Attributes:
        points: The values of each variable.
    """

    points: tuple[tuple[Any, ...], ...]

    def __len__(self) -> int:
        """Return the number of combinations."""
        return self._count

    @cached_property
    def _count(self) -> int:
        return prod(map(len, self.points))

    def at(self, number: int) -> Sample:
        """Return a combination."""
        values: list[Any] = []
        for points in reversed(self.points):
            number, place = divmod(number, len(points))
            values.append(points[place])
        return tuple(reversed(values))


@dataclass(frozen=True, eq=False)
class DrawnSamples(Samples):
    """Samples at shares of the variables' ranges.

    Attributes:
        variables: What varies.
        shares: (samples, variables) in [0, 1]: eight bytes a value are all that is kept.
    """

    variables: tuple[Variable, ...]
    shares: FloatArray

    def __len__(self) -> int:
        """Return the number of samples drawn."""
        return len(self.shares)

    def at(self, number: int) -> Sample:
        """Return the values at one row of shares."""
        row = self.shares[number].tolist()
        return tuple([one.at(share) for one, share in zip(self.variables, row, strict=True)])


def grid_size(variable: Variable, fail: Callable[..., GrasplessPinError]) -> int:
    """Return how many values a variable has on a grid.

    Args:
        variable: What varies.
        fail: Makes the error for a part of the study file.

    Raises:
        StudyError: If it does not say so.
    """
    try:
        return variable.grid_size
    except StudyError as error:
        raise fail(("vary", variable.name), str(error)) from None


def samples_of(
    sampling: SamplingEntry,
    variables: tuple[Variable, ...],
    fail: Callable[..., GrasplessPinError],
) -> Samples:
    """Return the samples of a study.

    Args:
        sampling: How they are chosen.
        variables: What varies.
        fail: Makes the error for a part of the study file.

    Raises:
        StudyError: If there are too many, or a variable does not fit the way of sampling.
    """
    count = sampling.samples or 1
    for variable in variables:
        if sampling.method == "grid":
            count *= grid_size(variable, fail)
        elif variable.entry.steps is not None:
            raise fail(("vary", variable.name, "steps"), "goes with a grid; leave it out")
    if count > MOST_SAMPLES:
        raise fail(("sampling",), f"makes {count} samples; at most {MOST_SAMPLES} are possible")
    if sampling.method == "grid":
        return GridSamples(tuple([tuple(variable.points()) for variable in variables]))
    from scipy.stats import qmc  # slow to load, and workers draw no samples

    rng = np.random.default_rng(sampling.seed)
    if sampling.method == "sobol":
        # The sequence is balanced over powers of two; a part of it is still its beginning.
        engine = qmc.Sobol(len(variables), rng=rng)
        shares = engine.random_base2(int(np.ceil(np.log2(count))))[:count].copy()
    else:
        shares = qmc.LatinHypercube(len(variables), rng=rng).random(count)
    shares.flags.writeable = False
    return DrawnSamples(variables, shares)
