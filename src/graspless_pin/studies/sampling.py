"""Samples of a study: a grid, random or quasi-random samples, or adaptive ones.

The values of a sample are computed from its number and not stored. A round of adaptive samples
depends only on the points so far and their outcomes, so that a killed study can be resumed.
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
    """A sequence of samples, each computed when it is asked for."""

    @abstractmethod
    def at(self, number: int) -> Sample:
        """Return a sample by its number, which has to be valid."""

    @overload
    def __getitem__(self, index: int) -> Sample: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Sample, ...]: ...
    def __getitem__(self, index: int | slice) -> Sample | tuple[Sample, ...]:
        """Return a sample, or those of a slice."""
        numbers = range(len(self))[index]
        return self.at(numbers) if isinstance(numbers, int) else tuple(map(self.at, numbers))


@dataclass(frozen=True, eq=False)
class MadeSamples(Samples):
    """A fixed number of samples, each computed by a function of its number."""

    size: int
    made: Callable[[int], Sample]

    def __len__(self) -> int:
        """Return the number of samples."""
        return self.size

    def at(self, number: int) -> Sample:
        """Return the sample that the function computes."""
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
    """Return the number of values of a variable on a grid.

    Args:
        variable: The variable.
        fail: Makes the error for a part of the study file.

    Raises:
        StudyError: If it is a range without steps.
    """
    if variable.entry.steps is None and not variable.is_choice and len(variable.extremes()) > 1:
        raise fail(
            ("vary", variable.name),
            "a range on a grid needs 'steps', the number of values, ends included",
        )
    return variable.grid_size


def samples_of(
    sampling: SamplingEntry,
    variables: tuple[Variable, ...],
    fail: Callable[..., GrasplessPinError],
) -> Samples:
    """Return the samples of a study that is not adaptive.

    Args:
        sampling: The sampling section of the study file.
        variables: The variables.
        fail: Makes the error for a part of the study file.

    Raises:
        StudyError: If there are too many, or a variable does not fit the method.
    """
    count = sampling.samples or 1
    for variable in variables:
        if sampling.method == "grid":
            count *= grid_size(variable, fail)
        elif variable.entry.steps is not None:
            raise fail(
                ("vary", variable.name, "steps"), "has an effect only on a grid; leave it out"
            )
    if count > MOST_SAMPLES:
        raise fail(("sampling",), f"gives {count} samples; at most {MOST_SAMPLES} are possible")
    if sampling.method == "grid":
        return grid_samples([variable.grid_values() for variable in variables])
    from scipy.stats import qmc  # slow to load, and workers draw no samples

    rng = np.random.default_rng(sampling.seed)
    if sampling.method == "sobol":
        # The sequence is balanced over powers of two; take the beginning of such a part.
        engine = qmc.Sobol(len(variables), rng=rng)
        shares = engine.random_base2(int(np.ceil(np.log2(count))))[:count].copy()
    else:
        shares = qmc.LatinHypercube(len(variables), rng=rng).random(count)
    # Only the shares of the variables' ranges are stored: eight bytes a value.
    return MadeSamples(
        count,
        lambda number: tuple([
            v.value_at(share) for v, share in zip(variables, shares[number].tolist(), strict=True)
        ]),
    )  # fmt: skip


Places = NDArray[np.int64]
"""Indices on the finest grid: along each variable, or flat."""
_MOST_RANGES = 4
_MOST_HALVINGS = 12
"""Depth at most, where only the number of samples is stated."""
_MOST_PLACES = 2**62


@dataclass(frozen=True, eq=False)
class AdaptiveSamples(Samples):
    """Points of an adaptively refined grid: those of all rounds so far.

    Attributes:
        variables: The variables. Ranges are halved, listed values are not.
        depth: How often each interval of the grid may be halved.
        limit: Most samples.
        points: (samples,) flat indices on the finest grid; the last variable varies fastest.
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
        places = map(int, np.unravel_index(self.points[number], self._grid_shape))
        coordinates = zip(self.variables, self._grid_shape, places, strict=True)
        return tuple([
            v.grid_values()[place] if v.is_choice else v.value_at(place / max(size - 1, 1))
            for v, size, place in coordinates
        ])  # fmt: skip

    @cached_property
    def _grid_shape(self) -> tuple[int, ...]:
        return _finest_grid_shape(self.variables, self.depth)

    def refined(self, outcomes: Places) -> AdaptiveSamples:
        """Return these samples followed by those of the next round, if there is one.

        A cell of any size with points of different outcomes, its border included, is halved: the
        corners of its halves are added.

        Args:
            outcomes: (samples,) number of the outcome of each sample.
        """
        shape = np.array(self._grid_shape)
        halved = np.array([_is_halved(variable) for variable in self.variables])
        coordinates = np.stack(np.unravel_index(self.points, self._grid_shape), axis=1)
        so_far = self.points
        for level in range(self.depth):
            sides = np.where(halved, 2 ** (self.depth - level), 1)
            cells = _mixed_cells(coordinates, outcomes, sides, shape, halved)
            extents = zip(sides.tolist(), halved.tolist(), strict=True)
            steps = product(*[(0, side // 2, side) if half else (0,) for side, half in extents])
            corners = [cells * sides + np.array(step) for step in steps]
            corner_points = np.ravel_multi_index(tuple(np.concatenate(corners).T), self._grid_shape)
            so_far = np.concatenate([so_far, np.setdiff1d(corner_points, so_far)])
        points = so_far[: self.limit]
        points.flags.writeable = False
        return replace(self, points=points)


def adaptive_samples(
    sampling: SamplingEntry,
    variables: tuple[Variable, ...],
    fail: Callable[..., GrasplessPinError],
) -> AdaptiveSamples:
    """Return the initial grid of adaptive samples.

    Args:
        sampling: The sampling section of the study file.
        variables: The variables.
        fail: Makes the error for a part of the study file.

    Raises:
        StudyError: If there are too many samples or ranges, or no range to halve.
    """
    for variable in variables:
        grid_size(variable, fail)
        if variable.is_whole and _is_halved(variable):
            raise fail(("vary", variable.name), "adaptive cannot halve whole numbers; list values")
    ranges = sum(map(_is_halved, variables))
    if not 1 <= ranges <= _MOST_RANGES:
        raise fail(
            ("sampling", "method"),
            f"adaptive needs 1 to {_MOST_RANGES} ranges, found {ranges}; use another method",
        )
    limit = sampling.samples or MOST_SAMPLES
    depth = sampling.depth or _MOST_HALVINGS
    while sampling.depth is None and prod(_finest_grid_shape(variables, depth)) > _MOST_PLACES:
        depth -= 1
    shape = _finest_grid_shape(variables, depth)
    if prod(shape) > _MOST_PLACES:
        raise fail(("sampling", "depth"), "makes a grid of too many points; lower it")
    steps = [2**depth if _is_halved(variable) else 1 for variable in variables]
    first_places = [np.arange(0, size, step) for size, step in zip(shape, steps, strict=True)]
    if prod(map(len, first_places)) > limit:
        raise fail(
            ("sampling", "samples"),
            f"is {limit}, but the initial grid has {prod(map(len, first_places))} samples; "
            "allow more samples, or use fewer steps",
        )
    points = np.ravel_multi_index(np.meshgrid(*first_places, indexing="ij"), shape).ravel()
    points.flags.writeable = False
    return AdaptiveSamples(variables, depth, limit, points)


def _is_halved(variable: Variable) -> bool:
    return not variable.is_choice and variable.grid_size > 1


def _finest_grid_shape(variables: tuple[Variable, ...], depth: int) -> tuple[int, ...]:
    """Return the number of points of each variable on the finest grid."""
    sizes = [(variable.grid_size, _is_halved(variable)) for variable in variables]
    return tuple([(size - 1) * 2**depth + 1 if is_halved else size for size, is_halved in sizes])


def _mixed_cells(
    coordinates: Places,
    outcomes: Places,
    sides: Places,
    shape: Places,
    halved: NDArray[np.bool_],
) -> Places:
    """Return (cells, variables) cells of one size with several outcomes, borders included.

    Args:
        coordinates: (samples, variables) indices of the points on the finest grid.
        outcomes: (samples,) number of the outcome of each sample.
        sides: (variables,) side lengths of the cells.
        shape: (variables,) number of points on the finest grid.
        halved: (variables,) whether cells have an extent along the variable.
    """
    counts = np.where(halved, (shape - 1) // sides, shape)
    cell_numbers, cell_outcomes = [], []
    # A point on a border belongs to the cells on both sides of it.
    for offset in product(*[(0, 1) if is_halved else (0,) for is_halved in halved.tolist()]):
        cells = (coordinates - np.array(offset)) // sides
        inside = ((cells >= 0) & (cells < counts)).all(axis=1)
        cell_numbers.append(np.ravel_multi_index(tuple(cells[inside].T), tuple(counts)))
        cell_outcomes.append(outcomes[inside])
    keys, values = np.concatenate(cell_numbers), np.concatenate(cell_outcomes)
    order = np.argsort(keys, kind="stable")
    keys, values = keys[order], values[order]
    begins = np.flatnonzero(np.diff(keys, prepend=-1))
    differ = np.minimum.reduceat(values, begins) != np.maximum.reduceat(values, begins)
    return np.stack(np.unravel_index(keys[begins][differ], tuple(counts)), axis=1)
