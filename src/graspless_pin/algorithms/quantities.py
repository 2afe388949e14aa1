"""What may be off of a problem, and the units that people think in."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

MOST_TILT = 0.6  # rad
"""How far gravity may be turned: larger tilts are not looked at."""


class Quantity(StrEnum):
    """What may be off. See the example of `tolerances`."""

    MASS_MORE = "more mass"
    MASS_LESS = "less mass"
    CENTER = "centre of mass"
    TILT = "gravity's direction"
    FRICTION = "friction"
    """Of each contact by itself: less at those that stick, either at those that slide."""
    PUSH = "push"
    MOMENT = "moment"
    TORQUE_MORE = "all torques larger"
    TORQUE_LESS = "all torques smaller"
    JOINT = "one joint's torque"

    @property
    def unit(self) -> str:
        """The unit that people think in; that of `Tolerance` is SI, or a share."""
        return _UNITS[self][1]

    @property
    def scale(self) -> float:
        """How many of that unit one of `Tolerance` is."""
        return _UNITS[self][0]


_UNITS = {
    Quantity.MASS_MORE: (100.0, "%"), Quantity.MASS_LESS: (100.0, "%"),
    Quantity.CENTER: (100.0, "cm"), Quantity.TILT: (180.0 / np.pi, "deg"),
    Quantity.FRICTION: (100.0, "%"), Quantity.PUSH: (1.0, "N"), Quantity.MOMENT: (1.0, "N m"),
    Quantity.TORQUE_MORE: (100.0, "%"), Quantity.TORQUE_LESS: (100.0, "%"),
    Quantity.JOINT: (1.0, "N m"),
}  # fmt: skip
"""What a figure is multiplied by where it is shown, and the unit then."""
