"""Hands whose actuators were moved by a little."""

from __future__ import annotations

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray


def bent_hand(hand: Hand, change: FloatArray) -> Hand:
    """Return the hand with its actuators moved by (L,) rad or m; entries after them are left out.

    Raises:
        SceneError: If a joint would leave its limits.
    """
    columns = hand.actuation.from_independent
    moved = hand.positions[list(hand.tree.coupling.leaders)] + columns @ change[: columns.shape[1]]
    try:
        return hand.with_configuration(moved)
    except ArgumentError as error:
        raise SceneError(f"a joint stands at its limit: {error}") from error
