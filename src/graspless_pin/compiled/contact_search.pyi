from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]

OTHER: int
BALL: int
PLANE: int
POLYTOPE: int

class ConvexSets:
    def __init__(
        self,
        kinds: ArrayLike,
        bodies: ArrayLike,
        centers: Array,
        half_extents: Array,
        reaches: Array,
        planes: ArrayLike,
        starts: ArrayLike,
        faces: Array,
    ) -> None: ...

def plain_contacts(
    ones: ConvexSets,
    ones_poses: Array,
    others: ConvexSets,
    others_poses: Array,
    tolerance: float,
    max_penetration: float,
    face_of: Callable[[int, Array], tuple[Array, Array, bool] | None],
) -> tuple[list[int], Array, Array, list[float], list[tuple[int, int]], list[int]]: ...
