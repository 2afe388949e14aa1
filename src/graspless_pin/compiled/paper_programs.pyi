from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]

MARGIN: int
TORQUE: int
SHARE: int

class PaperPrograms:
    M: int
    L: int
    n: int
    def __init__(
        self,
        kind: int,
        required: float,
        turns: Sequence[bool],
        axes: ArrayLike,
        sides: Array,
        face_count: int,
        reach: Array,
        has_cone: ArrayLike,
        friction: Array,
        slopes: Array,
        directions: Array,
        least_lever: float,
        rounding: float,
        farthest: float,
        least_limit: float,
        most_strict: float,
    ) -> None: ...
