from typing import Any

from graspless_pin.compiled.carried_optima import Array, Carrier, Optimum

class ColdCarrier(Carrier):
    def __init__(
        self, guesses: int, judged_by: tuple[float, int, float, float], **shared: Any
    ) -> None: ...
    def found(
        self, problem: Any
    ) -> tuple[tuple[Array, Optimum] | None, tuple[Array, Array] | None]: ...
