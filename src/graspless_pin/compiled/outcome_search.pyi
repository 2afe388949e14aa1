from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Numbers: TypeAlias = NDArray[np.int_]

class Bounds:
    def __init__(
        self,
        rows: Array,
        load: Array,
        friction: Array,
        commanded: Array,
        spread: Array,
        commanded_spread: Array,
        loads: Array,
        tolerance: float,
        force_limit: float,
    ) -> None: ...
    def bound(
        self,
        states: Numbers,
        center: Array,
        half_width: Array,
        motion: Array,
        normal: Array,
        tangential: Array,
        p: Array,
        q: Array,
    ) -> float: ...
    def first(
        self,
        states: Numbers,
        center: Array,
        half_width: Array,
        motions: Array,
        normals: Array,
        tangentials: Array,
        p: Array,
        known: int,
        enough: float,
    ) -> int: ...

def swept(
    rows: Array,
    pushes: Array,
    friction: Array,
    commanded: Array,
    points: Array,
    forces: Array,
    motions: Array,
    sweeps: int,
    look: int,
    still: float,
    settled: float,
    diverged: float,
    tiny: float,
) -> None: ...
