from typing import Any

from graspless_pin.compiled.carried_optima import Carrier

class ColdCarrier(Carrier):
    def __init__(
        self, guesses: int, judged_by: tuple[float, int, float, float], **shared: Any
    ) -> None: ...
