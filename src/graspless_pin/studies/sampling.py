"""Which samples a study has: listed, drawn, or adaptive.

Values are made from a sample's number, so that none are kept. A round of adaptive samples depends
on the points so far and their outcomes alone: that is how a study that was killed finds its
samples again.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from math import prod
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from graspless_pin.bounds import MOST_SAMPLES
from graspless_pin.errors import GrasplessPinError
from graspless_pin.studies.keys import Sample, Variable
from graspless_pin.studies.study_schema import SamplingEntry


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
class MadeSamples(Samples):
    """So many samples, each made by a function of its number."""

    size: int
    made: Callable[[int], Sample]

    def __len__(self) -> int:
        """Return the number of samples."""
        return self.size

    def at(self, number: int) -> Sample:
        """Return what the function makes."""
        return self.made(number)


def grid_samples(points: Sequence[Sequence[Any]]) -> Samples:
    """Return all combinations of values; the last variable varies fastest.

    Args:
        points: The values of each variable.
    """
    shape = tuple(map(len, points))

    def combination(number: int) -> Sample:
        places = map(int, np.unravel_index(number, shape))
        return tuple([values[place] for values, place in zip(points, places, strict=True)])

    return MadeSamples(prod(shape), combination)


def grid_size(variable: Variable, fail: Callable[..., GrasplessPinError]) -> int:
    """Return how many values a variable has on a grid.

    Args:
        variable: What varies.
        fail: Makes the error for a part of the study file.

    Raises:
        StudyError: If it does not say so.
    """
    if variable.entry.steps is None and not variable.is_choice and len(variable.extremes()) > 1:
        raise fail(
            ("vary", variable.name),
            "a range on a grid needs 'steps', how many values, ends included",
        )
    return variable.grid_size


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
        return grid_samples([variable.points() for variable in variables])
    from scipy.stats import qmc  # slow to load, and workers draw no samples

    rng = np.random.default_rng(sampling.seed)
    if sampling.method == "sobol":
        # The sequence is balanced over powers of two; a part of it is still its beginning.
        engine = qmc.Sobol(len(variables), rng=rng)
        shares = engine.random_base2(int(np.ceil(np.log2(count))))[:count].copy()
    else:
        shares = qmc.LatinHypercube(len(variables), rng=rng).random(count)
    # Shares of the variables' ranges: eight bytes a value are all that is kept.
    return MadeSamples(
        count,
        lambda number: tuple([
            one.at(share) for one, share in zip(variables, shares[number].tolist(), strict=True)
        ]),
    )  # fmt: skip


Places = NDArray[np.int64]
"""Whole numbers: places on the finest grid, counted along each variable or all through."""
_MOST_RANGES = 4
_MOST_HALVINGS = 12
"""Where only the number of samples is stated."""
_MOST_PLACES = 2**62


@dataclass(frozen=True, eq=False)
class AdaptiveSamples(Samples):
    """Points of a grid that is halved again and again: those so far, round by round.

    Attributes:
        variables: What varies. Ranges are halved, listed values are not.
        depth: How often each interval of the grid may be halved.
        limit: Most samples.
        points: (samples,) places on the finest grid, where the last variable varies fastest.
    """

    variables: tuple[Variable, ...]
    depth: int
    limit: int
    points: Places

    def __len__(self) -> int:
        """Return the number of samples so far."""
        return len(self.points)

    def at(self, number: int) -> Sample:
        """Return the values at a point."""
        places = map(int, np.unravel_index(self.points[number], self._shape))
        each = zip(self.variables, self._shape, places, strict=True)
        return tuple([
            one.points()[place] if one.is_choice else one.at(place / max(size - 1, 1))
            for one, size, place in each
        ])  # fmt: skip

    @cached_property
    def _shape(self) -> tuple[int, ...]:
        return _finest(self.variables, self.depth)

    def refined(self, outcomes: Places) -> AdaptiveSamples:
        """Return these samples and after them those of the next round, if there is one.

        A cell of any size in or at which two points differ gets the corners of its halves.

        Args:
            outcomes: (samples,) a number for each outcome.
        """
        shape = np.array(self._shape)
        halved = np.array([_is_halved(variable) for variable in self.variables])
        coordinates = np.stack(np.unravel_index(self.points, self._shape), axis=1)
        known = self.points
        for level in range(self.depth):
            sides = np.where(halved, 2 ** (self.depth - level), 1)
            cells = _mixed(coordinates, outcomes, sides, shape, halved)
            each = zip(sides.tolist(), halved.tolist(), strict=True)
            steps = product(*[(0, side // 2, side) if half else (0,) for side, half in each])
            corners = [cells * sides + np.array(step) for step in steps]
            wanted = np.ravel_multi_index(tuple(np.concatenate(corners).T), self._shape)
            known = np.concatenate([known, np.setdiff1d(wanted, known)])
        points = known[: self.limit]
        points.flags.writeable = False
        return replace(self, points=points)


def adaptive_samples(
    sampling: SamplingEntry,
    variables: tuple[Variable, ...],
    fail: Callable[..., GrasplessPinError],
) -> AdaptiveSamples:
    """Return the grid that adaptive samples begin with.

    Args:
        sampling: How far it is refined.
        variables: What varies.
        fail: Makes the error for a part of the study file.

    Raises:
        StudyError: If there are too many samples or ranges, or none that could be halved.
    """
    for variable in variables:
        grid_size(variable, fail)
        if variable.is_whole and _is_halved(variable):
            raise fail(("vary", variable.name), "whole numbers are not halved; list their values")
    ranges = sum(map(_is_halved, variables))
    if not 1 <= ranges <= _MOST_RANGES:
        raise fail(
            ("sampling", "method"),
            f"adaptive refines 1 to {_MOST_RANGES} ranges, and {ranges} vary; use another method",
        )
    limit = sampling.samples or MOST_SAMPLES
    depth = sampling.depth or _MOST_HALVINGS
    while sampling.depth is None and prod(_finest(variables, depth)) > _MOST_PLACES:
        depth -= 1
    shape = _finest(variables, depth)
    if prod(shape) > _MOST_PLACES:
        raise fail(("sampling", "depth"), "makes a grid that is too fine to count; lower it")
    every = [2**depth if _is_halved(variable) else 1 for variable in variables]
    first = [np.arange(0, size, step) for size, step in zip(shape, every, strict=True)]
    if prod(map(len, first)) > limit:
        raise fail(
            ("sampling", "samples"),
            f"is {limit}, and the grid to begin with has {prod(map(len, first))}; "
            "take more samples, or fewer steps",
        )
    points = np.ravel_multi_index(np.meshgrid(*first, indexing="ij"), shape).ravel()
    points.flags.writeable = False
    return AdaptiveSamples(variables, depth, limit, points)


def _is_halved(variable: Variable) -> bool:
    return not variable.is_choice and variable.grid_size > 1


def _finest(variables: tuple[Variable, ...], depth: int) -> tuple[int, ...]:
    """Return how many places each variable has on the finest grid."""
    sizes = [(variable.grid_size, _is_halved(variable)) for variable in variables]
    return tuple([(size - 1) * 2**depth + 1 if half else size for size, half in sizes])


def _mixed(
    coordinates: Places,
    outcomes: Places,
    sides: Places,
    shape: Places,
    halved: NDArray[np.bool_],
) -> Places:
    """(cells, variables) the cells of one size that have points of two outcomes, borders included.

    Args:
        coordinates: (samples, variables) the points.
        outcomes: (samples,) a number for each outcome.
        sides: (variables,) of the cells.
        shape: (variables,) places on the finest grid.
        halved: (variables,) which ones cells have an extent along.
    """
    counts = np.where(halved, (shape - 1) // sides, shape)
    found, outcomes_found = [], []
    # A point on a border belongs to the cells on both sides of it.
    for before in product(*[(0, 1) if half else (0,) for half in halved.tolist()]):
        cells = (coordinates - np.array(before)) // sides
        inside = ((cells >= 0) & (cells < counts)).all(axis=1)
        found.append(np.ravel_multi_index(tuple(cells[inside].T), tuple(counts)))
        outcomes_found.append(outcomes[inside])
    keys, values = np.concatenate(found), np.concatenate(outcomes_found)
    order = np.argsort(keys, kind="stable")
    keys, values = keys[order], values[order]
    begins = np.flatnonzero(np.diff(keys, prepend=-1))
    differ = np.minimum.reduceat(values, begins) != np.maximum.reduceat(values, begins)
    return np.stack(np.unravel_index(keys[begins][differ], tuple(counts)), axis=1)
