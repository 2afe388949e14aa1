"""Rotor inertias that are given instead of a URDF's."""

from __future__ import annotations

import math
from collections.abc import Mapping

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.fingers import driving_joints
from graspless_pin.geometry.hand.tree import KinematicTree, unknown_name
from graspless_pin.geometry.robots.description import FingerSpec


def joint_armatures(
    tree: KinematicTree,
    fingers: Mapping[str, FingerSpec],
    armature: float | Mapping[str, float],
) -> dict[int, float]:
    """Return given rotor inertias by the index of the joint.

    Args:
        tree: The kinematic tree.
        fingers: The checked fingers.
        armature: Of every independent joint, or by finger or joint; a joint's own one wins over
            its finger's.

    Raises:
        ArgumentError: If a name is unknown or a mimic joint's, or a value negative or not finite.
    """
    leaders = [tree.joint_names[index] for index in tree.coupling.leaders]
    if not isinstance(armature, Mapping):
        return dict.fromkeys(tree.coupling.leaders, _checked("armature", armature))
    given: dict[str, float] = {}
    for name in sorted(armature, key=lambda name: name not in fingers):
        argument = f"armature[{name!r}]"
        value = _checked(argument, armature[name])
        if name in fingers:
            given |= dict.fromkeys(driving_joints(tree, fingers[name]), value)
        elif name in leaders:
            given[name] = value
        elif name in tree.joint_index:
            raise ArgumentError(
                argument, "this joint mimics another one; give the rotor of the joint it follows"
            )
        else:
            raise unknown_name("armature", "finger or joint", name, (*fingers, *leaders))
    return {tree.joint_index[name]: value for name, value in given.items()}


def _checked(argument: str, value: float) -> float:
    ok = isinstance(value, int | float) and not isinstance(value, bool)
    if not (ok and math.isfinite(value) and value >= 0.0):
        raise ArgumentError(argument, f"needs a finite number >= 0 of kg m^2 (kg), got {value!r}")
    return float(value)
