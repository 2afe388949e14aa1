from typing import Any

from graspless_pin.compiled.carried_optima import Array
from graspless_pin.compiled.cold_optima import ColdCarrier
from graspless_pin.compiled.optimum_starts import Start

class LoadedStates(ColdCarrier):
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
