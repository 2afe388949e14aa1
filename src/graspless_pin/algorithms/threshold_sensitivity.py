"""Whether an optimum hangs on what counts as a virtual motion: solved around the threshold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from graspless_pin.algorithms.formulation import Formulation
from graspless_pin.algorithms.search import SearchResult
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.enumeration import requirements_of
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.modes.witness_heuristics import CLEARLY

FACTORS = (0.1, 10.0)
"""The thresholds that an optimum is compared for, over the rule's own."""
_SAME = 1e-6

ModeSearch = Callable[[Formulation], SearchResult]


def threshold_optima(
    result: SearchResult, search: ModeSearch, gap: float = 0.0
) -> tuple[float, float] | None:
    """Return the optimum for a tenth and for ten times the threshold, where it hangs on it.

    Nothing is solved where the motion behind the mode is clearly fast enough and the search refused
    none that a tenth of the threshold would admit: then all three are the same.

    Args:
        result: How the search ended.
        search: Repeats it with another formulation, which has another threshold.
        gap: How near each of two optima is found, over the load or the optimum.

    Returns:
        Two optima, NaN where nothing is feasible or the search was not completed; None where
        neither differs by more than 1e-6 of the load, or of the optimum where that is larger, and
        two gaps.
    """
    state = result.state
    formulation, kinematics = state.formulation, state.formulation.kinematics
    if state.rules.static_friction is StaticFriction.COULOMB:
        return None
    if not (kinematics.undecided_near or _is_slow(result)):
        return None
    values = []
    for factor in FACTORS:
        other = VirtualKinematics(formulation.problem, factor * kinematics.threshold)
        best = search(replace(formulation, kinematics=other)).state.best
        values.append(np.nan if best is None else best.value)
    own = np.nan if state.best is None else state.best.value
    if all(_agree(own, value, _SAME + 2.0 * gap) for value in values):
        return None
    return formulation.unit * values[0], formulation.unit * values[1]


def _is_slow(result: SearchResult) -> bool:
    """Whether the motion behind the best mode is slower than ten times the threshold."""
    state = result.state
    if state.mode is None or state.mode_is_clear:
        return False
    if state.rules.by_direction:
        return True  # the search itself has looked
    kinematics = state.formulation.kinematics
    try:
        slowest = kinematics.slowest(requirements_of(state.mode), state.rules.sign)
    except UndecidedMotionError:
        return True
    return slowest < CLEARLY * kinematics.threshold


def _agree(one: float, other: float, same: float) -> bool:
    if np.isnan(one) or np.isnan(other):
        return bool(np.isnan(one) and np.isnan(other))
    return abs(one - other) <= same * max(1.0, abs(one))
