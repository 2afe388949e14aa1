"""From robots to all that a hand is, but for where its joints stand and what its motors give.

Rotor inertias that are given instead of a URDF's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.findings import Finding, capture, emit
from graspless_pin.geometry.hand.actuation import (
    Actuation,
    EffortLimit,
    expand_overrides,
    plan_actuation,
    resolve_effort_limits,
    spread_names,
)
from graspless_pin.geometry.hand.configuration import joint_positions
from graspless_pin.geometry.hand.fingers import ControlPlan, plan_control
from graspless_pin.geometry.hand.mounts import JoinedMounts, Mount, join_mounts
from graspless_pin.geometry.hand.srdf import refuse_lacking
from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.geometry.poses import as_pose, invert
from graspless_pin.geometry.robots.description import FingerSpec
from graspless_pin.problem import ControlMode
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import changed


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
    if not isinstance(armature, Mapping):
        return dict.fromkeys(tree.coupling.leaders, _checked("armature", armature))
    values = {name: _checked(f"armature[{name!r}]", one) for name, one in armature.items()}
    spread = spread_names(
        tree, fingers, values, argument="armature", instead="give the rotor of the joint it follows"
    )
    return {tree.joint_index[joint]: values[name] for joint, name in spread.items()}


def _checked(argument: str, value: float) -> float:
    ok = isinstance(value, int | float) and not isinstance(value, bool)
    if not (ok and math.isfinite(value) and value >= 0.0):
        raise ArgumentError(argument, f"needs a finite number >= 0 of kg m^2 (kg), got {value!r}")
    return float(value)


ControlModes = ControlMode | str | Mapping[str, ControlMode | str]
"""One mode for all joints, or modes by finger, arm or joint name."""


@dataclass(frozen=True, eq=False)
class AssembledMounts:
    """What a hand is before it is told where its joints stand and what its motors give.

    Attributes:
        joined: The mounted robots as one tree.
        mounts: The robots, each found.
        plan: Control modes of the independent joints, and the hybrid fingers.
        actuation: The L actuators.
        findings: What looked wrong.
    """

    joined: JoinedMounts
    mounts: tuple[Mount, ...]
    plan: ControlPlan
    actuation: Actuation
    findings: tuple[Finding, ...]

    def effort_limits(
        self, given: Mapping[str, EffortLimit]
    ) -> tuple[tuple[NDArray[np.float64], NDArray[np.float64]], tuple[Finding, ...]]:
        """Return the (lower, upper) limits of the L actuators, and what of them looks wrong.

        Args:
            given: Limits by finger, joint or tendon that replace those of robot files and URDFs.
        """
        joined = self.joined
        own = expand_overrides(joined.tree, joined.fingers, given, joined.tendons)
        with capture() as found:
            limits = resolve_effort_limits(
                joined.tree,
                self.actuation,
                joined.effort_limits | own,
                joined.effort_unknown,
                joined.outer_joints,
                joined.tensions,
            )
        emit(*found)
        return limits, tuple(found)

    def at_bases(self, poses: Sequence[ArrayLike]) -> AssembledMounts:
        """Return the same with the mounts' root links at other (4, 4) poses, world axes.

        Raises:
            ArgumentError: If a pose is not rigid.
        """
        before = self.joined.base_poses
        now = {name: as_pose("T_world_base", T) for name, T in zip(before, poses, strict=True)}
        ways = [T @ invert(before[name]) for name, T in now.items()]
        tree = displaced_tree(self.joined.tree, ways)
        mounts = tuple(replace(one, T_world_base=now[one.prefix]) for one in self.mounts)
        return replace(self, joined=replace(self.joined, tree=tree, base_poses=now), mounts=mounts)


def assembled_mounts(
    mounts: Sequence[Mount],
    control: ControlModes | None = None,
    armature: float | Mapping[str, float] | None = None,
) -> AssembledMounts:
    """Assemble robots as `Hand.assemble` does; what looked wrong is told.

    Args:
        mounts: The robots.
        control: See `Hand.assemble`.
        armature: See `Hand.assemble`.
    """
    with capture() as found:
        joined = join_mounts(mounts)
        tree = joined.tree
        mounted = tuple(
            replace(
                mount,
                source=mount.robot(),
                T_world_base=joined.base_poses[mount.prefix],
                package_dirs=(),
                root_link=None,
                srdf=None,
            )
            for mount in mounts
        )
        # A group of an SRDF stands for its joints as an arm does.
        arms, held = {**tree.groups, **joined.arms}, joined.held_joints
        if isinstance(control, Mapping):
            asked = [name for name in control if name not in (*joined.fingers, *joined.arms)]
            refuse_lacking("control", asked, tree.lacking)
        plan = plan_control(tree, joined.fingers, control, arms=arms, held=held)
        actuation = plan_actuation(tree, plan, joined.tendons)
        for joint, value in joint_armatures(tree, joined.fingers, armature or {}).items():
            tree.pinocchio_model.armature[joint] = value
    emit(*found)
    return AssembledMounts(joined, mounted, plan, actuation, tuple(found))


def hand_fields(
    parts: AssembledMounts,
    q: Mapping[str, float] | None,
    effort_limits: Mapping[str, EffortLimit] | None,
) -> dict[str, Any]:
    """Return the fields of the hand that `Hand.assemble` makes; what looks wrong is told."""
    limits, found = parts.effort_limits(effort_limits or {})
    return fields_of(parts, limits, joint_positions(parts.joined.tree, q or {}), found)


def fields_of(
    parts: AssembledMounts,
    limits: tuple[NDArray[np.float64], NDArray[np.float64]],
    positions: NDArray[np.float64],
    found: tuple[Finding, ...],
) -> dict[str, Any]:
    """Return the fields of a hand with its (L,) limits and (n,) positions, and what they told."""
    joined = parts.joined
    return {
        "tree": joined.tree,
        "mounts": parts.mounts,
        "base_poses": joined.base_poses,
        "palms": joined.palms,
        "fingers": joined.fingers,
        "arms": joined.arms,
        "control": parts.plan,
        "actuation": parts.actuation,
        "effort_limits": limits,
        "positions": positions,
        "findings": (*parts.findings, *found),
    }


_ANYWHERE = (
    "joint_index",
    "joint_kinds",
    "tolerated",
    "ranges",
    "locked",
    "link_joints",
    "parent_links",
    "supports",
    "shapes",
    "_starts",
    "moves",
)
"""What is the same wherever the robots are mounted."""


def displaced_tree(tree: KinematicTree, ways: Sequence[FloatArray]) -> KinematicTree:
    """Return a tree with what is fixed to the world moved.

    Args:
        tree: The tree.
        ways: (4, 4) by mounted robot, world axes.
    """
    model, steps = tree.pinocchio_model.copy(), [pin.SE3(np.array(T)) for T in ways]
    way_of = {name: k for k, (names, _) in enumerate(tree.bases) for name in names}
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            way = steps[way_of[model.names[joint]]]
            model.jointPlacements[joint] = way * model.jointPlacements[joint]
    for index in range(1, model.nframes):
        frame = model.frames[index]
        if frame.parentJoint == 0:
            frame.placement = steps[way_of[frame.name]] * frame.placement
    bases = tuple(
        (names, way.act(inertia)) for way, (names, inertia) in zip(steps, tree.bases, strict=True)
    )
    model.inertias[0] = sum((inertia for _, inertia in bases), pin.Inertia.Zero())
    geometries = tuple(
        item
        if item.joint
        else replace(item, T_joint_geometry=ways[way_of[item.link]] @ item.T_joint_geometry)
        for item in tree.geometries
    )
    moved = replace(tree, pinocchio_model=model, geometries=geometries, bases=bases)
    # Asked of the tree that is moved, or each place that it is moved to would work it out.
    return changed(moved, **{name: getattr(tree, name) for name in _ANYWHERE})
