from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]

class KinematicChains:
    def __init__(
        self, *, parents: ArrayLike, placements: Array, axes: Array, masses: Array, centers: Array
    ) -> None: ...
    def kinematics(self, positions: Array) -> tuple[Array, Array]: ...
    def gravity_torques(self, positions: Array, gravity: Array) -> Array: ...
