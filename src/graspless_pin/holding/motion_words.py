"""What an object does in an outcome, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from graspless_pin.holding.verdict import ContactState, DynamicOutcome
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray

_NEAR = float(np.cos(np.radians(20.0)))
"""Directions that differ by less are called the same."""
_ACROSS = float(np.sin(np.radians(20.0)))
_NOTICED = 0.2
"""Of the largest acceleration: a part of the motion that is smaller is not named."""
_MOVING = {ContactState.OPEN: "open", ContactState.SLIPPING: "slip"}
_STATES = _MOVING | {ContactState.CLOSED: "stay closed", ContactState.STICKING: "stick"}


def motion_words(problem: QuasistaticProblem, motion: DynamicOutcome) -> str:
    """Return what the object does, how fast, and which contacts open or slip.

    Down is where the load's force pulls; other directions are in world axes.

    Args:
        problem: What the motion is an outcome of.
        motion: The motion.

    Returns:
        Words that follow "the object can", such as "slip down, 3.1 m/s^2 (contacts 4, 5 open)".
    """
    linear, angular = motion.object_acceleration[:3], motion.object_acceleration[3:]
    turning = float(np.linalg.norm(np.cross(angular, problem.positions), axis=1).max(initial=0.0))
    least, load = _NOTICED * motion.point_acceleration, problem.external_wrench[:3]
    said = []
    if np.linalg.norm(linear) > least or turning <= least:
        said.append(_moving(_unit(linear), _unit(load), motion.states))
    if turning > least:
        axis = _unit(angular)
        word = "tilt" if abs(float(axis @ _unit(load))) < _NEAR else "turn"
        said.append(f"{word} about {_axis(axis)}")
    states = state_words(motion.states, _MOVING)
    return f"{' and '.join(said)}, {motion.point_acceleration:.3g} m/s^2" + (
        f" ({states})" if states else ""
    )


def _moving(way: FloatArray, load: FloatArray, states: tuple[ContactState, ...]) -> str:
    """Return a verb and where to."""
    down = float(way @ load)
    if down > _NEAR and set(states) == {ContactState.OPEN}:
        return "fall"
    verb = "slip" if ContactState.SLIPPING in states else "move"
    if abs(down) > _NEAR:
        return f"{verb} {'down' if down > 0.0 else 'up'}"
    where = "sideways " if abs(down) < _ACROSS else "down " if down > 0.0 else "up "
    return f"{verb} {where if load.any() else ''}along {_axis(way)}"


def _axis(way: FloatArray) -> str:
    """Return a direction: a world axis, or its components."""
    largest = int(np.argmax(np.abs(way)))
    if abs(way[largest]) > _NEAR:
        return f"{'+' if way[largest] > 0.0 else '-'}{'xyz'[largest]}"
    return f"({', '.join(f'{part + 0.0:.2f}' for part in np.round(way, 2))})"


def state_words(states: Sequence[ContactState], words: Mapping[ContactState, str] = _STATES) -> str:
    """Return which contacts are in which states."""
    said = []
    for state, word in words.items():
        which = [str(index) for index, own in enumerate(states) if own is state]
        if len(which) == len(states):
            said.append(f"all contacts {word}")
        elif which[1:]:
            said.append(f"contacts {', '.join(which)} {word}")
        elif which:
            verb, *after = word.split()
            said.append(" ".join([f"contact {which[0]} {verb}s", *after]))
    return "; ".join(said)


def _unit(vector: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else vector
