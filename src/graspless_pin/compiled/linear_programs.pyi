from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Numbers: TypeAlias = NDArray[np.int_]

def judged(
    rows: Array,
    low: Array,
    high: Array,
    c: Array,
    lb: Array,
    ub: Array,
    box: Array,
    x: Array,
    y: Array,
    z: Array,
) -> tuple[float, float, float]: ...
def refined(
    rows: Array,
    low: Array,
    high: Array,
    c: Array,
    lb: Array,
    ub: Array,
    active: Numbers,
    at_bounds: Numbers,
    upper: NDArray[np.bool_],
    x: Array,
    weights: Array,
    damping: float,
    corrections: int,
) -> tuple[Array, Array, Array] | None: ...
