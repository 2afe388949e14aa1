"""Which joints and links make a finger, and how each of them is controlled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.tree import KinematicTree, unknown_name
from graspless_pin.geometry.robots.description import FingerSpec
from graspless_pin.problem import ControlMode
from graspless_pin.records import Brief


@dataclass(frozen=True, repr=False)
class ControlPlan(Brief):
    """Control modes after all defaults and overrides.

    Attributes:
        joints: Mode of every independent joint, in model order.
        hybrid_fingers: Fingers under hybrid control.
    """

    joints: Mapping[str, ControlMode]
    hybrid_fingers: tuple[str, ...]


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


def driving_joints(tree: KinematicTree, spec: FingerSpec) -> list[str]:
    """Return the independent joints that move a finger's joints, be they its own or not."""
    columns = tree.coupling.drivers(tree.joint_index[joint] for joint in spec.joints)
    return [tree.joint_names[tree.coupling.leaders[column]] for column in columns]


def plan_control(
    tree: KinematicTree,
    fingers: Mapping[str, FingerSpec],
    control: ControlMode | str | Mapping[str, ControlMode | str] | None,
    *,
    arms: Mapping[str, Sequence[str]] | None = None,
    held: Sequence[str] = (),
) -> ControlPlan:
    """Find every independent joint's control mode.

    Args:
        tree: The kinematic tree.
        fingers: The checked fingers.
        control: One mode for all joints (FORCE or POSITION), or modes by finger, arm or joint
            name: a joint's own mode wins over its finger's or arm's. What is not named is under
            POSITION control if it is in ``held``, else under FORCE. Joints without travel hold
            their position in any case.
        arms: Joints by the name that stands for them in ``control``.
        held: Joints that are position-controlled unless ``control`` says otherwise.

    Returns:
        The plan.

    Raises:
        ArgumentError: If a mode or name is unknown, HYBRID is asked of anything but a finger, a
            joint of a hybrid finger has a mode of its own or moves another finger, a mimic joint
            has a mode, or fingers that one joint moves have different ones.
    """
    leaders = [tree.joint_names[index] for index in tree.coupling.leaders]
    still = dict.fromkeys(sorted(tree.locked), ControlMode.POSITION)
    if isinstance(control, str):
        mode = _mode("control", control)
        if mode is ControlMode.HYBRID:
            raise ArgumentError("control", "hybrid control is per finger: give {finger: 'hybrid'}")
        return ControlPlan(dict.fromkeys(leaders, mode) | still, ())
    modes = {name: _mode(f"control[{name!r}]", mode) for name, mode in (control or {}).items()}
    groups = {name: joints for name, joints in (arms or {}).items() if name not in fingers}
    by_joint = dict.fromkeys(leaders, ControlMode.FORCE)
    by_joint |= {joint: ControlMode.POSITION for joint in held if joint in by_joint}
    for name, joints in groups.items():
        if name in modes and name not in tree.joint_names:
            by_joint |= {joint: modes[name] for joint in joints if joint in by_joint}
    by_joint |= _modes_of_fingers(tree, fingers, modes)
    hybrid = tuple(finger for finger in fingers if modes.get(finger) is ControlMode.HYBRID)
    hybrid_joints = {
        joint: finger for finger in hybrid for joint in driving_joints(tree, fingers[finger])
    }
    for name, mode in modes.items():
        argument = f"control[{name!r}]"
        if name in fingers:
            continue
        is_arm = name in groups and name not in tree.joint_names
        if name in tree.joint_names and name not in by_joint:
            raise ArgumentError(
                argument, "this joint mimics another one; give the mode of the joint it follows"
            )
        if name not in by_joint and not is_arm:
            raise unknown_name("control", "finger or joint", name, (*fingers, *groups, *leaders))
        if mode is ControlMode.HYBRID:
            raise ArgumentError(argument, "hybrid control is per finger, not per joint")
        if is_arm:
            continue
        if name in hybrid_joints:
            raise ArgumentError(
                argument, f"its finger {hybrid_joints[name]!r} is under hybrid control"
            )
        by_joint[name] = mode
    return ControlPlan(by_joint | still, hybrid)


def _modes_of_fingers(
    tree: KinematicTree, fingers: Mapping[str, FingerSpec], modes: Mapping[str, ControlMode]
) -> dict[str, ControlMode]:
    """Return the modes that fingers set for the joints that move them."""
    asked: dict[str, str] = {}
    for finger in fingers:
        if finger not in modes:
            continue
        for joint in driving_joints(tree, fingers[finger]):
            other = asked.setdefault(joint, finger)
            if modes[other] is not modes[finger]:
                raise ArgumentError(
                    f"control[{finger!r}]",
                    f"joint {joint!r} moves this finger and {other!r}; give both the same mode",
                )
    for joint, finger in asked.items():
        shared = [name for name in fingers if joint in driving_joints(tree, fingers[name])]
        if modes[finger] is ControlMode.HYBRID and len(shared) > 1:
            raise ArgumentError(
                f"control[{finger!r}]",
                f"joint {joint!r} moves the fingers {', '.join(shared)}; a hybrid finger needs "
                "joints of its own",
            )
    return {joint: modes[finger] for joint, finger in asked.items()}


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
        if joint not in tree.joint_index:
            raise unknown_name(f"fingers[{finger!r}]", "joint", joint, tree.joint_names)
    columns = [tree.joint_index[joint] for joint in joints]
    return tuple(
        link for link, carrier in tree.link_joints.items() if tree.supports[carrier, columns].any()
    )
