from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled.optimum_starts import Start
from graspless_pin.compiled.paper_programs import PaperPrograms

Array: TypeAlias = NDArray[np.float64]

Optimum: TypeAlias = tuple[Array, float, Array, float, float, float, Array, Array, Array]

FIGURES: tuple[str, ...]

class Carrier(PaperPrograms):
    def __init__(
        self,
        damping: float,
        corrections: int,
        exact: float,
        close: float,
        cutoff: float,
        **shared: Any,
    ) -> None: ...
    def carried(self, problem: Any, starts: list[Start | None]) -> tuple[int, Optimum] | None: ...
    def carried_many(
        self,
        problem: Any,
        starts: list[Start | None],
        order: NDArray[np.intp],
        states: Sequence[NDArray[Any]],
        moves: Array,
        carriers: Sequence[int],
        center: Array,
        axes: Array,
        figures: Array,
        torques: Array,
    ) -> int: ...
