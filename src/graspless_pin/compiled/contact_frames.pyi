from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

def contact_map(positions: Array, normals: Array, tangents: Array, jacobian: Array) -> Array: ...
def force_directions(
    normals: Array, tangents: Array, friction: Array, sliding: Array, has_cone: NDArray[np.bool_]
) -> Array: ...
def forces(x: Array, axes: NDArray[np.int_], directions: Array, scale: float) -> Array: ...
def without_forbidden(
    x: Array, columns: NDArray[np.int_], cones: NDArray[np.int_], signs: NDArray[np.int8]
) -> Array: ...
def margin(
    forces: Array,
    normals: Array,
    tangents: Array,
    friction: Array,
    has_cone: NDArray[np.bool_],
    most: Array,
    face_directions: Array,
) -> float: ...
def scales(
    positions: Array,
    wrench: Array,
    jacobian: Array,
    limits: Array,
    least_lever: float,
    rounding: float,
) -> tuple[float, float, Array]: ...
def squared_lengths(vectors: Array) -> Array: ...
