from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.compiled.body_pairs import BodyPairs
from graspless_pin.compiled.contact_search import ConvexSets
from graspless_pin.compiled.kinematic_chains import KinematicChains

Array: TypeAlias = NDArray[np.float64]

MOST_CONTACTS: int
MOST_PAIRS: int

class HandStates(KinematicChains):
    def __init__(
        self,
        *,
        coupling: Array,
        offset: Array,
        lower: Array,
        upper: Array,
        gravity: Array,
        carriers: ArrayLike,
        shapes: Array,
        links: ConvexSets,
        pieces: ConvexSets,
        poses: Array,
        pairs: BodyPairs | None,
        around: ConvexSets,
        around_poses: Array,
        tolerance: float,
        max_penetration: float,
        **joints: ArrayLike,
    ) -> None: ...
    def at(
        self, q: Array
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array, Array, NDArray[np.bool_]]: ...
