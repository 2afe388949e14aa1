"""Configurations of a hand as planners give them: by joint name, or as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray, finite_array, read_only

Configuration = Mapping[str, float] | ArrayLike


class Configurations:
    """What a scene's hand can be told to do.

    Attributes:
        joint_names: The a joints that do not follow others, in the hand's order.
        joint_limits: (lower, upper), each (a,), rad or m; infinite where there is no limit.
    """

    def __init__(self, hand: Hand | None) -> None:
        """Take the hand that configurations are of; None: there is nothing to tell."""
        self._hand = hand
        self.joint_names: tuple[str, ...] = ()
        self.joint_limits: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros(0))
        if hand is not None:
            leaders = list(hand.tree.coupling.leaders)
            self.joint_names = tuple(hand.joint_names[leader] for leader in leaders)
            self.joint_limits = (
                read_only(hand.tree.lower[leaders]),
                read_only(hand.tree.upper[leaders]),
            )

    def named(self, q: Configuration) -> dict[str, float]:
        """Return a configuration by joint name.

        Args:
            q: Positions by joint name, or (a,) positions of `joint_names`, rad or m.

        Raises:
            ArgumentError: If a joint is unknown, a number not finite, or the shape wrong.
        """
        if isinstance(q, Mapping):
            known = () if self._hand is None else self._hand.joint_names
            for name in q:
                if name not in known:
                    listed = ", ".join(known) or "none"
                    raise ArgumentError("q", f"unknown joint {name!r}; known: {listed}")
            values = finite_array("q", list(q.values()), (len(q),)).tolist()
            return dict(zip(q, values, strict=True))
        values = finite_array("q", q, (len(self.joint_names),)).tolist()
        return dict(zip(self.joint_names, values, strict=True))

    def array(self, named: Mapping[str, float]) -> FloatArray:
        """Return (a,) positions of `joint_names`; those that are not named as the hand has them."""
        if self._hand is None:
            return np.zeros(0)
        return self._positions(self._hand, named)[list(self._hand.tree.coupling.leaders)]

    def outside(self, named: Mapping[str, float]) -> str:
        """Say which joint a configuration moves out of its limits; empty if none."""
        if self._hand is None:
            return ""
        tree = self._hand.tree
        positions = self._positions(self._hand, named)
        leaders = list(tree.coupling.leaders)
        if len(leaders) < len(positions):
            positions = tree.coupling.S @ positions[leaders] + tree.coupling.offset
        lower, upper = tree.tolerated
        beyond = (positions < lower) | (positions > upper)
        # What the hand's own configuration has outside its limits is not the state's doing.
        beyond &= positions != self._hand.positions
        if not beyond.any():
            return ""
        index = int(np.argmax(beyond))
        return (
            f"joint {tree.joint_names[index]!r} at {positions[index]:g} is outside its limits "
            f"[{tree.lower[index]:g}, {tree.upper[index]:g}]"
        )

    @staticmethod
    def _positions(hand: Hand, named: Mapping[str, float]) -> FloatArray:
        """(n,) of all movable joints as they are named, followers not yet moved."""
        positions = hand.positions.copy()
        positions[[hand.tree.joint_index[name] for name in named]] = list(named.values())
        return positions
