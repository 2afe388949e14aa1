from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]

def scaled_map(effects: Array) -> tuple[Array, Array]: ...
def witness(
    rows: Array,
    contacts: Sequence[int] | NDArray[np.int_],
    signs: Array | NDArray[np.int8],
    near: Array | None,
    guesses: int,
    damping: float,
    corrections: int,
    rank_tolerance: float,
    least: float,
) -> tuple[Array, Array] | None: ...
