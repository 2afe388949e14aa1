"""From mounted robots and what a caller says of them to the fields of a `Hand`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from graspless_pin.geometry.hand.actuation import plan_actuation
from graspless_pin.geometry.hand.configuration import joint_positions
from graspless_pin.geometry.hand.effort_limits import (
    EffortLimit,
    expand_overrides,
    resolve_effort_limits,
)
from graspless_pin.geometry.hand.fingers import plan_control
from graspless_pin.geometry.hand.mounts import Mount, join_mounts
from graspless_pin.problem import ControlMode

ControlModes = ControlMode | str | Mapping[str, ControlMode | str]
"""One mode for all joints, or modes by finger, arm or joint name."""


def hand_fields(
    mounts: Sequence[Mount],
    q: Mapping[str, float],
    control: ControlModes | None,
    effort_limits: Mapping[str, EffortLimit],
) -> dict[str, Any]:
    """Return the fields of the hand that `Hand.assemble` makes; see there."""
    parts = join_mounts(mounts)
    tree = parts.tree
    given = expand_overrides(tree, parts.fingers, effort_limits, parts.tendons)
    plan = plan_control(tree, parts.fingers, control, arms=parts.arms, held=parts.held_joints)
    actuation = plan_actuation(tree, plan, parts.tendons)
    return {
        "tree": tree,
        "base_poses": parts.base_poses,
        "palms": parts.palms,
        "fingers": parts.fingers,
        "arms": parts.arms,
        "control": plan,
        "actuation": actuation,
        "effort_limits": resolve_effort_limits(
            tree,
            actuation,
            parts.effort_limits | given,
            parts.effort_unknown,
            parts.held_joints,
        ),
        "positions": joint_positions(tree, q),
    }
