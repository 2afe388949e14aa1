from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.compiled.contact_search import ConvexSets

Array: TypeAlias = NDArray[np.float64]

class BodyPairs:
    def __init__(self, sets: ConvexSets, ones: ArrayLike, twos: ArrayLike) -> None: ...
    def within(self, poses: Array, depth: float) -> list[tuple[int, int]]: ...
    def beside(
        self, poses: Array, others: ConvexSets, others_poses: Array, depth: float
    ) -> list[tuple[int, int]]: ...
