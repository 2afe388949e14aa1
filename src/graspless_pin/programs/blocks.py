"""Programs built of named blocks: each block of rows knows its meaning, its unit and its signs.

The columns of the contact forces come first, then those that an objective adds. Nothing but a block
itself knows at which rows it stands.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.problem.checks import FloatArray


class Sign(Enum):
    """Which multipliers the rows of a block may have."""

    ANY = "equalities: of any sign"
    UPPER = "upper sides only: not negative"
    CONE = "second-order cones, three rows each: in the cone themselves"
    EITHER = "lower and upper sides: told apart as NAME_lower and NAME_upper"


class Block(NamedTuple):
    """Rows of a program, or bounds of its columns, with one meaning.

    Attributes:
        name: Its name.
        at: Where it stands: among the rows, or among the columns.
        unit: What one of each scaled row is in the problem's units: a number or (k,).
        sign: The signs of its multipliers.
        shape: Shape of its multipliers when they are given by contact or joint.
        places: (k,) flat places there; None: all, in order.
    """

    name: str
    at: slice | NDArray[np.int_]
    unit: float | FloatArray
    sign: Sign
    shape: tuple[int, ...]
    places: NDArray[np.int_] | None = None

    def spread(self, values: FloatArray) -> FloatArray:
        """Return values of its rows by contact or joint, zero where there is no row."""
        if self.places is None:
            return values.reshape(self.shape)
        full = np.zeros(self.shape)
        full.reshape(-1)[self.places] = values
        return full

    def gathered(self, values: FloatArray) -> FloatArray:
        """Return the values of its rows from those by contact or joint."""
        flat = values.reshape(-1)
        return flat if self.places is None else flat[self.places]


class Columns(NamedTuple):
    """Columns that an objective adds to those of the forces.

    Attributes:
        first: Index of the first among all columns.
        size: How many there are.
    """

    first: int
    size: int

    @property
    def at(self) -> slice:
        """Where they stand."""
        return slice(self.first, self.first + self.size)


Terms = Mapping[Columns, ArrayLike]
"""Coefficients of added columns: a number, one a row (for a single column), or a matrix."""
