"""Effort limits of the actuators: from the URDF, overridden by what is known better."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.actuation import Actuation
from graspless_pin.geometry.hand.fingers import driving_joints
from graspless_pin.geometry.hand.tree import KinematicTree, unknown_name
from graspless_pin.geometry.robots.description import FingerSpec

PLACEHOLDER_EFFORT = 100.0
"""An effort (N m or N) from which on no finger's motor is believed."""

PLACEHOLDER_ARM_EFFORT = 1000.0
"""The same for joints that are not below a palm: arms, legs, lifts."""

EffortLimit = float | tuple[float, float]
"""A symmetric limit, or (lower, upper); N m for a revolute and N for a prismatic joint."""


def is_placeholder(effort: float, *, on_arm: bool = False) -> bool:
    """Return whether a URDF's effort limit is no motor's: 0, infinite or too large for one.

    Args:
        effort: N m or N.
        on_arm: Whether the joint is not below a palm.
    """
    return effort == 0.0 or effort >= (PLACEHOLDER_ARM_EFFORT if on_arm else PLACEHOLDER_EFFORT)


def expand_overrides(
    tree: KinematicTree,
    fingers: Mapping[str, FingerSpec],
    overrides: Mapping[str, EffortLimit],
    tendons: Mapping[str, Mapping[str, float]] | None = None,
) -> dict[str, tuple[float, float]]:
    """Spread overrides by finger, joint or tendon name over joints and tendons.

    Args:
        tree: The kinematic tree.
        fingers: The checked fingers.
        overrides: Limit by finger, joint or tendon; a joint's own one wins over its finger's. A
            tendon only pulls, so that one number F means (0, F) there.
        tendons: The joints that each tendon pulls.

    Returns:
        (lower, upper) by independent joint or tendon.

    Raises:
        ArgumentError: If a name is unknown or that of a joint without a motor, or a limit is not a
            finite number or pair with lower <= upper.
    """
    pairs = {name: _pair(name, limit) for name, limit in overrides.items()}
    expanded = {
        target: pairs[name]
        for target, name in spread_names(tree, fingers, overrides, tendons).items()
    }
    for name in tendons or ():
        if name in expanded and np.ndim(overrides[name]) == 0:
            expanded[name] = (0.0, expanded[name][1])
    return expanded


def spread_names(
    tree: KinematicTree,
    fingers: Mapping[str, FingerSpec],
    names: Collection[str],
    tendons: Mapping[str, Mapping[str, float]] | None = None,
) -> dict[str, str]:
    """Return which of ``names`` speaks for each joint with a motor and each tendon.

    Raises:
        ArgumentError: If a name is unknown or that of a joint without a motor.
    """
    tendons = tendons or {}
    leaders = [tree.joint_names[index] for index in tree.coupling.leaders]
    pulled = {
        joint: tendon
        for tendon, arms in tendons.items()
        for joint in driving_joints(tree, FingerSpec(tuple(arms)))
    }
    spread: dict[str, str] = {}
    for name in names:
        if name in fingers:
            own = [joint for joint in driving_joints(tree, fingers[name]) if joint not in pulled]
            if not own:
                raise ArgumentError(
                    f"effort_limits[{name!r}]", "no motor moves this finger; limit its tendons"
                )
            spread |= dict.fromkeys(own, name)
    for name in names:
        argument = f"effort_limits[{name!r}]"
        if name in fingers:
            continue
        if name in pulled:
            raise ArgumentError(argument, f"tendon {pulled[name]!r} pulls this joint; limit that")
        if name not in leaders and name not in tendons:
            if name in tree.joint_index:
                raise ArgumentError(
                    argument, "this joint mimics another one; limit the joint it follows"
                )
            known = (*fingers, *leaders, *tendons)
            raise unknown_name("effort_limits", "finger or joint", name, known)
        spread[name] = name
    return spread


def resolve_effort_limits(
    tree: KinematicTree,
    actuation: Actuation,
    overrides: Mapping[str, tuple[float, float]],
    unknown: Mapping[str, str] | None = None,
    arm_joints: Collection[str] = (),
    tensions: Mapping[str, tuple[float, float]] = MappingProxyType({}),
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the (lower, upper) effort limits of the actuators.

    Args:
        tree: The kinematic tree, which holds the URDF's limits.
        actuation: The L actuators.
        overrides: (lower, upper) by joint or tendon, instead of the URDF's.
        unknown: What is known, by joint or tendon whose real limit is declared unknown.
        arm_joints: Joints that are not below a palm.
        tensions: (lower, upper) of tendons, N; others only pull, without a limit.

    Returns:
        Two read-only (L,) arrays in N m (N for prismatic joints and tendons).

    Warns:
        GrasplessPinWarning: If the limit of an actuator without override is declared unknown
            or is the URDF's and 0, infinite or at least 100 (1000 on an arm).
    """
    lower, upper = np.zeros(len(actuation.names)), np.zeros(len(actuation.names))
    urdf_lower, urdf_upper = urdf_efforts(tree)
    unknown = unknown or {}
    doubtful: dict[str, str] = {}
    noted: dict[str, list[str]] = {}
    for row, name in enumerate(actuation.names):
        if name in actuation.passive:
            continue
        if name in overrides:
            lower[row], upper[row] = overrides[name]
            continue
        if name in actuation.tendons:
            lower[row], upper[row] = tensions.get(name, (0.0, np.inf))
        else:
            index = tree.joint_index[name]
            lower[row], upper[row] = urdf_lower[index], urdf_upper[index]
        if name in unknown:
            noted.setdefault(unknown[name], []).append(f"{name!r} ({upper[row]:g})")
        elif is_placeholder(upper[row], on_arm=name in arm_joints):
            doubtful[name] = f"{name!r} ({upper[row]:g})"
    unsure = "; ".join(f"{', '.join(names)}: {note}" for note, names in noted.items())
    declared = [name for name in actuation.names if name in unknown and name not in overrides]
    for code, names, what, listed in (
        (
            FindingCode.PLACEHOLDER_EFFORT,
            doubtful,
            "look like placeholders",
            ", ".join(doubtful.values()),
        ),
        (FindingCode.UNKNOWN_EFFORT, declared, "the robot file declares unknown", unsure),
    ):
        if listed:
            emit(
                Finding(
                    code,
                    ", ".join(names),
                    f"effort limits that {what}: {listed}",
                    "give the motors' real limits in effort_limits (N m, or N for a prismatic "
                    "joint)",
                    ("hand", "effort_limits"),
                )
            )
    lower.setflags(write=False)
    upper.setflags(write=False)
    return lower, upper


def urdf_efforts(tree: KinematicTree) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the URDF's (lower, upper) efforts of the n movable joints, infinite if unbounded."""
    model = tree.pinocchio_model
    return np.array(model.lowerEffortLimit), np.array(model.upperEffortLimit)


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
