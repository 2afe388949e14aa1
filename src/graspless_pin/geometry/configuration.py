"""Joint positions by name, checked against the limits, couplings applied."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.tree import KinematicTree, unknown_name

LIMIT_TOLERANCE = 1e-6
"""How far outside its limits a named joint may stand (rounded input), radians or metres."""

FOLLOWER_TOLERANCE = 1e-3
"""The same for mimic joints, whose limits rarely match multiplier times limit to all digits."""


def joint_positions(
    tree: KinematicTree, q: Mapping[str, float], start: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the positions of all joints of a tree.

    Args:
        tree: The kinematic tree with n movable joints.
        q: Position by joint name in radians or metres. A mimic joint may be named if its value
            agrees with the joint it follows.
        start: (n,) positions of the joints that ``q`` does not name; None is zero, clamped into
            the limits.

    Returns:
        (n,) read-only positions in model order.

    Raises:
        ArgumentError: If a joint is unknown, or a value is not a finite number, outside the
            joint's limits or against the coupling.
    """
    names, coupling = tree.joint_names, tree.coupling
    rest = np.clip(0.0, tree.lower, tree.upper) if start is None else start
    given: dict[int, float] = {}
    for name, value in q.items():
        if name not in names:
            raise unknown_name("q", "joint", name, names)
        given[names.index(name)] = _finite(name, value)
    independent = rest[list(coupling.leaders)].copy()
    for column, index in enumerate(coupling.leaders):
        independent[column] = given.get(index, independent[column])
    positions = coupling.S @ independent + coupling.offset
    for index, name in enumerate(names):
        leader = coupling.leaders[int(np.flatnonzero(coupling.S[index])[0])]
        leads = leader == index
        if index in given and abs(given[index] - positions[index]) > FOLLOWER_TOLERANCE:
            raise ArgumentError(
                f"q[{name!r}]",
                f"is {given[index]:g}, but this joint mimics {names[leader]!r} and stands at "
                f"{positions[index]:g}; name only {names[leader]!r}",
            )
        tolerance = LIMIT_TOLERANCE if leads else FOLLOWER_TOLERANCE
        if leader in given and not (
            tree.lower[index] - tolerance <= positions[index] <= tree.upper[index] + tolerance
        ):
            because = "" if leads else f" because it mimics {names[leader]!r}"
            raise ArgumentError(
                f"q[{name!r}]",
                f"is {positions[index]:g}{because}, outside the joint's limits "
                f"[{tree.lower[index]:g}, {tree.upper[index]:g}]",
            )
    positions.setflags(write=False)
    return positions


def _finite(name: str, value: float) -> float:
    """Return ``value`` as a finite float."""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise ArgumentError(f"q[{name!r}]", f"needs a number, got {value!r}") from error
    if not np.isfinite(number):
        raise ArgumentError(f"q[{name!r}]", f"needs a finite number, got {value!r}")
    return number
