"""Wrenches: this package has forces first, some others have moments first; loads in words."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.problem.checks import FloatArray, real_array
from graspless_pin.problem.joint_units import JointUnit


def moment_first(wrench: ArrayLike) -> FloatArray:
    """Reorder [force; moment], as everywhere in this package, to [moment; force].

    The reference point and the axes stay as they are. A twist is reordered in the same way, from
    [linear; angular] to [angular; linear].

    Args:
        wrench: (6,), or (N, 6) for several, N and N m.

    Returns:
        A copy of the same shape with moments first, as in Drake.

    Raises:
        ArgumentError: If the shape is another one or an entry is not a number.

    Examples:
        >>> from graspless_pin import moment_first
        >>> moment_first([4.0, 5.0, 6.0, 0.1, 0.2, 0.3])
        array([0.1, 0.2, 0.3, 4. , 5. , 6. ])
    """
    return _halves_swapped(wrench)


def force_first(wrench: ArrayLike) -> FloatArray:
    """Reorder [moment; force] to [force; moment], as everywhere in this package.

    The reference point and the axes stay as they are: an external wrench also has to be about the
    object's centre of mass and in world axes.

    Args:
        wrench: (6,), or (N, 6) for several, N m and N.

    Returns:
        A copy of the same shape with forces first.

    Raises:
        ArgumentError: If the shape is another one or an entry is not a number.

    Examples:
        >>> from graspless_pin import force_first
        >>> force_first([0.1, 0.2, 0.3, 4.0, 5.0, 6.0])
        array([4. , 5. , 6. , 0.1, 0.2, 0.3])
    """
    return _halves_swapped(wrench)


def load_words(load: FloatArray, units: tuple[JointUnit, ...], *, joined: str) -> str:
    """Return a load on passive coordinates: what is in N, and what is in N m.

    Args:
        load: (P,) N and N m.
        units: P units.
        joined: What stands between the two.
    """
    turns = np.array([unit is JointUnit.TORQUE for unit in units])
    force, moment = np.round(load[~turns], 4) + 0.0, np.round(load[turns], 5) + 0.0
    words = [f"force {force.tolist()} N"] if force.size else []
    words += [f"moment {moment.tolist()} N m"] if moment.size else []
    return joined.join(words)


def _halves_swapped(wrench: ArrayLike) -> FloatArray:
    try:
        rows = np.ndim(wrench) == 2
    except ValueError:  # rows of several lengths: the check below says so
        rows = False
    array = real_array("wrench", wrench, (None, 6) if rows else (6,))
    return np.roll(array, 3, axis=-1)
