"""Effort limits of the motors: from the URDF, overridden by what the user knows better."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError, PlaceholderEffortWarning
from graspless_pin.geometry.fingers import FingerSpec
from graspless_pin.geometry.tree import KinematicTree, unknown_name
from graspless_pin.geometry.urdf import UNBOUNDED

PLACEHOLDER_EFFORT = 100.0
"""An effort (N m or N) from which on no finger's motor is believed."""

EffortLimit = float | tuple[float, float]
"""A symmetric limit, or (lower, upper); N m for a revolute and N for a prismatic joint."""


def expand_overrides(
    tree: KinematicTree,
    fingers: Mapping[str, FingerSpec],
    overrides: Mapping[str, EffortLimit],
) -> dict[str, tuple[float, float]]:
    """Spread overrides by finger or joint name over the independent joints.

    Args:
        tree: The kinematic tree.
        fingers: The checked fingers.
        overrides: Limit by finger or joint; a joint's own one wins over its finger's.

    Returns:
        (lower, upper) by joint.

    Raises:
        ArgumentError: If a name is unknown or a mimic joint's, or a limit is not a finite number
            or pair with lower <= upper.
    """
    leaders = [tree.joint_names[index] for index in tree.coupling.leaders]
    expanded: dict[str, tuple[float, float]] = {}
    for name, limit in overrides.items():
        if name in fingers:
            pair = _pair(name, limit)
            expanded |= {joint: pair for joint in fingers[name].joints if joint in leaders}
    for name, limit in overrides.items():
        if name in fingers:
            continue
        if name not in leaders:
            if name in tree.joint_names:
                raise ArgumentError(
                    f"effort_limits[{name!r}]",
                    "this joint mimics another one; limit the joint it follows",
                )
            raise unknown_name("effort_limits", "finger or joint", name, (*fingers, *leaders))
        expanded[name] = _pair(name, limit)
    return expanded


def resolve_effort_limits(
    tree: KinematicTree, joints: Sequence[str], overrides: Mapping[str, tuple[float, float]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (lower, upper) effort limits of the force-controlled joints.

    Args:
        tree: The kinematic tree, which holds the URDF's limits.
        joints: The L force-controlled joints.
        overrides: (lower, upper) by joint, instead of the URDF's.

    Returns:
        Two read-only (L,) arrays in N m (N for prismatic joints).

    Warns:
        PlaceholderEffortWarning: If the URDF's limit of a joint without override is 0, infinite or
            at least 100.
    """
    indices = [tree.joint_names.index(joint) for joint in joints]
    lower = np.array(tree.model.lowerEffortLimit)[indices]
    upper = np.array(tree.model.upperEffortLimit)[indices]
    lower[lower <= -UNBOUNDED] = -np.inf
    upper[upper >= UNBOUNDED] = np.inf
    doubtful: list[str] = []
    for row, joint in enumerate(joints):
        if joint in overrides:
            lower[row], upper[row] = overrides[joint]
        elif upper[row] == 0.0 or upper[row] >= PLACEHOLDER_EFFORT:
            doubtful.append(f"{joint!r} ({upper[row]:g})")
    if doubtful:
        warnings.warn(
            f"effort limits that look like placeholders: {', '.join(doubtful)}; give the motors' "
            "real limits in effort_limits (N m, or N for a prismatic joint)",
            PlaceholderEffortWarning,
            stacklevel=2,
        )
    lower.setflags(write=False)
    upper.setflags(write=False)
    return lower, upper


def _pair(name: str, limit: EffortLimit) -> tuple[float, float]:
    """Return a limit as (lower, upper)."""
    argument = f"effort_limits[{name!r}]"
    try:
        values = np.array(limit, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArgumentError(argument, f"needs a number or a pair, got {limit!r}") from error
    if values.shape not in ((), (2,)) or not np.isfinite(values).all():
        raise ArgumentError(argument, f"needs a finite number or a pair, got {limit!r}")
    if values.shape == ():
        if values < 0.0:
            raise ArgumentError(argument, f"a symmetric limit is not negative, got {limit!r}")
        return -float(values), float(values)
    if values[0] > values[1]:
        raise ArgumentError(argument, f"the lower limit is above the upper one: {limit!r}")
    return float(values[0]), float(values[1])
