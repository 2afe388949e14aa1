from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.compiled.paper_programs import PaperPrograms

Array: TypeAlias = NDArray[np.float64]

class Start:
    def __init__(
        self,
        programs: PaperPrograms,
        rows: ArrayLike,
        at_bounds: ArrayLike,
        upper: ArrayLike,
        x: Array,
        weights: Array,
        count: int,
        signs: ArrayLike,
        contacts: Sequence[int],
        own_signs: ArrayLike,
        motion: Array,
        judged_by: tuple[float, int, float, float],
    ) -> None: ...
