"""Which joints and links make a finger, and how each of them is controlled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.tree import KinematicTree, unknown_name


class ControlMode(StrEnum):
    """What a joint's controller holds.

    FORCE holds a torque: the joint is a column of the contact Jacobian. POSITION holds an angle:
    the joint is part of the environment. HYBRID is a whole finger that holds a commanded normal
    force at each of its contacts and a position across it.
    """

    FORCE = "force"
    POSITION = "position"
    HYBRID = "hybrid"


@dataclass(frozen=True)
class FingerSpec:
    """A finger.

    Attributes:
        joints: Its movable joints.
        links: The links whose contacts count as the finger's; empty means every link that its
            joints move.
        tip: The link at its end, if one is named.
    """

    joints: tuple[str, ...]
    links: tuple[str, ...] = ()
    tip: str | None = None


@dataclass(frozen=True)
class ControlPlan:
    """Control modes after all defaults and overrides.

    Attributes:
        joints: Mode of every independent joint, in model order.
        hybrid_fingers: Fingers under hybrid control.
    """

    joints: Mapping[str, ControlMode]
    hybrid_fingers: tuple[str, ...]

    @property
    def force_controlled(self) -> tuple[str, ...]:
        """The joints under force control, in model order."""
        return tuple(name for name, mode in self.joints.items() if mode is ControlMode.FORCE)


def check_fingers(tree: KinematicTree, fingers: Mapping[str, FingerSpec]) -> dict[str, FingerSpec]:
    """Check fingers against a tree and fill in the links of those that name none.

    Raises:
        ArgumentError: If a joint or link does not exist or belongs to two fingers.
    """
    checked: dict[str, FingerSpec] = {}
    owner: dict[tuple[str, str], str] = {}
    for finger, spec in fingers.items():
        links = spec.links or _moved_links(tree, finger, spec.joints)
        tips = () if spec.tip is None else (spec.tip,)
        for kind, names, known in (
            ("joint", spec.joints, tree.joint_names),
            ("link", (*links, *tips), tuple(tree.link_frames)),
        ):
            for name in names:
                if name not in known:
                    raise unknown_name(f"fingers[{finger!r}]", kind, name, known)
                if owner.setdefault((kind, name), finger) != finger:
                    raise ArgumentError(
                        f"fingers[{finger!r}]",
                        f"{kind} {name!r} already belongs to finger {owner[kind, name]!r}",
                    )
        checked[finger] = FingerSpec(tuple(spec.joints), tuple(links), spec.tip)
    return checked


def plan_control(
    tree: KinematicTree,
    fingers: Mapping[str, FingerSpec],
    control: ControlMode | str | Mapping[str, ControlMode | str] | None,
) -> ControlPlan:
    """Find every independent joint's control mode.

    Args:
        tree: The kinematic tree.
        fingers: The checked fingers.
        control: One mode for all joints (FORCE or POSITION; None is FORCE), or modes by finger
            or joint name: a joint's own mode wins over its finger's, and what is not named is
            FORCE.

    Returns:
        The plan.

    Raises:
        ArgumentError: If a mode or name is unknown, HYBRID is asked of anything but a finger, a
            joint of a hybrid finger has a mode of its own, or a mimic joint has one.
    """
    leaders = [tree.joint_names[index] for index in tree.coupling.leaders]
    if control is None or isinstance(control, str):
        mode = _mode("control", control or ControlMode.FORCE)
        if mode is ControlMode.HYBRID:
            raise ArgumentError("control", "hybrid control is per finger: give {finger: 'hybrid'}")
        return ControlPlan(dict.fromkeys(leaders, mode), ())
    modes = {name: _mode(f"control[{name!r}]", mode) for name, mode in control.items()}
    by_joint = dict.fromkeys(leaders, ControlMode.FORCE)
    for name, mode in modes.items():
        if name in fingers:
            for joint in fingers[name].joints:
                if joint in by_joint:
                    by_joint[joint] = mode
    hybrid = tuple(finger for finger in fingers if modes.get(finger) is ControlMode.HYBRID)
    held = {joint: finger for finger in hybrid for joint in fingers[finger].joints}
    for name, mode in modes.items():
        if name in fingers:
            continue
        argument = f"control[{name!r}]"
        if name not in by_joint:
            if name in tree.joint_names:
                raise ArgumentError(
                    argument, "this joint mimics another one; give the mode of the joint it follows"
                )
            raise unknown_name("control", "finger or joint", name, (*fingers, *leaders))
        if mode is ControlMode.HYBRID:
            raise ArgumentError(argument, "hybrid control is per finger, not per joint")
        if name in held:
            raise ArgumentError(argument, f"its finger {held[name]!r} is under hybrid control")
        by_joint[name] = mode
    return ControlPlan(by_joint, hybrid)


def _mode(argument: str, value: ControlMode | str) -> ControlMode:
    """Return the control mode that ``value`` names."""
    try:
        return ControlMode(value)
    except ValueError as error:
        known = ", ".join(mode.value for mode in ControlMode)
        raise ArgumentError(argument, f"unknown control mode {value!r}; known: {known}") from error


def _moved_links(tree: KinematicTree, finger: str, joints: Sequence[str]) -> tuple[str, ...]:
    """Return the links that any of ``joints`` moves, in model order."""
    for joint in joints:
        if joint not in tree.joint_names:
            raise unknown_name(f"fingers[{finger!r}]", "joint", joint, tree.joint_names)
    columns = [tree.joint_names.index(joint) for joint in joints]
    return tuple(
        link
        for link, frame in tree.link_frames.items()
        if tree.supports[tree.model.frames[frame].parentJoint, columns].any()
    )
