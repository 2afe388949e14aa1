from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.compiled.contact_search import ConvexSets

Array: TypeAlias = NDArray[np.float64]

MOST_CONTACTS: int
MOST_PAIRS: int

class HandStates:
    def __init__(
        self,
        parents: ArrayLike,
        placements: Array,
        axes: Array,
        coupling: Array,
        offset: Array,
        lower: Array,
        upper: Array,
        masses: Array,
        centers: Array,
        gravity: Array,
        carriers: ArrayLike,
        shapes: Array,
        links: ConvexSets,
        pieces: ConvexSets,
        poses: Array,
        tolerance: float,
        max_penetration: float,
    ) -> None: ...
    def at(self, q: Array) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array, Array]: ...
