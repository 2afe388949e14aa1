import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled.simplex_dictionary import Dictionary

class DenseSimplex(Dictionary):
    def solve(self) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]: ...
