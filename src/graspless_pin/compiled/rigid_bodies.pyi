from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]

STICKS: int
ROLLS: int
SLIDES: int
PARTS: int
PENETRATES: int

def placed(T_world_joint: Array, joints: NDArray[np.intp], T_joint_shape: Array) -> Array: ...
def point_jacobians(
    J_world: Array, moved: Array, joints: Sequence[int], points: Array
) -> Array: ...
def twist_velocities(twist: Array, center: Array, points: ArrayLike) -> Array: ...
def motion_states(
    positions: Array,
    normals: Array,
    twist: Array,
    center: Array,
    others: Array,
    turning: Array | None,
    tolerance: float,
) -> tuple[list[int], Array, Array]: ...
def is_rigid(pose: Array) -> bool: ...
