from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[np.float64]
Numbers: TypeAlias = NDArray[np.int_]

OTHER: int
BALL: int
REVOLVED: int
PLANE: int
POLYTOPE: int

class ConvexSets:
    def __init__(
        self,
        kinds: ArrayLike,
        bodies: ArrayLike,
        centers: Array,
        half_extents: Array,
        reaches: Array,
        planes: ArrayLike,
        starts: ArrayLike,
        faces: Array,
    ) -> None: ...

class BodyPairs:
    def __init__(self, sets: ConvexSets, ones: ArrayLike, twos: ArrayLike) -> None: ...

MOST_CONTACTS: int
MOST_PAIRS: int

class HandStates:
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
    ) -> tuple[
        NDArray[np.intp], NDArray[np.intp], Array, Array, Array, NDArray[np.bool_], Array
    ]: ...

MARGIN: int
TORQUE: int
SHARE: int

class PaperPrograms:
    contact_count: int
    joint_count: int
    coordinate_count: int
    def __init__(
        self,
        kind: int,
        required: float,
        turns: Sequence[bool],
        axes: ArrayLike,
        sides: Array,
        face_count: int,
        reach: Array,
        has_cone: ArrayLike,
        friction: Array,
        slopes: Array,
        directions: Array,
        least_lever: float,
        rounding: float,
        farthest: float,
        least_limit: float,
        most_strict: float,
    ) -> None: ...

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
        solver: str = "",
    ) -> None: ...

Optimum: TypeAlias = tuple[
    Array, float, Array, float, float, float, Array, Array, Array, list[int], Array, str
]  # fmt: skip

FIGURES: tuple[str, ...]

class WarmOptima(PaperPrograms):
    def __init__(
        self,
        damping: float,
        corrections: int,
        exact: float,
        close: float,
        cutoff: float,
        **shared: Any,
    ) -> None: ...
    def result(self) -> Optimum: ...
    def warm_optimum(
        self, problem: Any, starts: list[Start | None]
    ) -> tuple[int, Optimum] | None: ...
    def optima_of_states(
        self,
        problem: Any,
        starts: list[Start | None],
        may_begin: bool,
        order: NDArray[np.intp],
        states: Sequence[NDArray[Any]],
        moves: Array,
        carriers: Sequence[int],
        center: Array,
        axes: Array,
        figures: Array,
        torques: Array,
    ) -> int: ...

class ColdOptima(WarmOptima):
    def __init__(
        self, guesses: int, judged_by: tuple[float, int, float, float], **shared: Any
    ) -> None: ...

class LoadedStates(ColdOptima):
    def optima(
        self,
        problem: Any,
        loads: Array,
        begin: int,
        starts: list[Start | None],
        cold: bool,
        figures: Array,
        torques: Array,
    ) -> int: ...

class ModeCover:
    def __init__(self, signs: ArrayLike) -> None: ...

class ModePrograms(LoadedStates):
    def decide(self, enough: float, closed: float, covers: list[ModeCover]) -> None: ...

class Dictionary:
    def __init__(self, cost: Array, lb: Array, ub: Array) -> None: ...
    def add_rows(self, rows: Array, low: Array, high: Array) -> None: ...
    def drop_rows(self, first: int, after: int) -> None: ...
    def set_sides(self, rows: NDArray[np.int32], low: Array, high: Array) -> None: ...
    def set_bounds(self, lb: Array, ub: Array) -> None: ...
    def set_cost(self, cost: Array) -> None: ...
    def program(self) -> tuple[Array, Array, Array, Array]: ...

class DenseSimplex(Dictionary):
    def solve(self) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]: ...

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
        aside: Array,
        leaks: Array,
    ) -> None: ...
    def bound(
        self,
        states: Numbers,
        center: Array,
        half_width: Array,
        parts: Array,
        slips: Array,
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
        parts: Array,
        slips: Array,
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
