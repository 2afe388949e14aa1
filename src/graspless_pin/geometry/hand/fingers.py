"""The joints and links of each finger, and the control modes of the joints.

A robot file may name them; otherwise fingers are the branches below the palm of the kinematic tree.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile

import coal  # pyright: ignore[reportMissingImports]
import numpy as np

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.tree import KinematicTree, LinkGeometry
from graspless_pin.geometry.robots.description import FingerSpec
from graspless_pin.problem import ControlMode
from graspless_pin.problem.checks import FloatArray, check_known, choice, unknown_name
from graspless_pin.records import Brief, Record


@dataclass(frozen=True, repr=False)
class ControlPlan(Record, Brief):
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
        columns = [tree.joint_index[joint] for joint in spec.joints if joint in tree.joint_index]
        moved = (
            link
            for link, carrier in tree.link_joints.items()
            if tree.supports[carrier, columns].any()
        )
        links = spec.links or tuple(moved)
        tips = () if spec.tip is None else (spec.tip,)
        for kind, names, known in (
            ("joint", spec.joints, tree.joint_index),
            ("link", (*links, *tips), tree.link_frames),
        ):
            check_known(f"fingers[{finger!r}]", kind, names, known)
            for name in names:
                if owner.setdefault((kind, name), finger) != finger:
                    raise ArgumentError(
                        f"fingers[{finger!r}]",
                        f"{kind} {name!r} already belongs to finger {owner[kind, name]!r}",
                    )
        checked[finger] = FingerSpec(tuple(spec.joints), tuple(links), spec.tip)
    return checked


def driving_joints(tree: KinematicTree, spec: FingerSpec) -> list[str]:
    """Return the independent joints that move a finger's joints, its own ones or not."""
    columns = tree.coupling.drivers(tree.joint_index[joint] for joint in spec.joints)
    return [tree.leader_names[column] for column in columns]


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
            name: the mode of a joint takes precedence over that of its finger or arm. Unnamed
            joints are under POSITION control if they are in ``held``, else under FORCE. Joints
            without travel are always under POSITION control.
        arms: Joints by the name that denotes them in ``control``.
        held: Joints that are position-controlled by default.

    Returns:
        The plan.

    Raises:
        ArgumentError: If a mode or name is unknown, HYBRID is given for anything but a finger, a
            joint of a hybrid finger has a mode of its own or moves another finger, a mimic joint
            has a mode, or fingers that share a joint have different modes.
    """
    leaders = tree.leader_names
    locked_modes = dict.fromkeys(sorted(tree.locked), ControlMode.POSITION)
    if isinstance(control, str):
        mode = choice(ControlMode, "control", control)
        if mode is ControlMode.HYBRID:
            raise ArgumentError("control", "hybrid control is per finger: give {finger: 'hybrid'}")
        return ControlPlan(dict.fromkeys(leaders, mode) | locked_modes, ())
    modes = {
        name: choice(ControlMode, f"control[{name!r}]", mode)
        for name, mode in (control or {}).items()
    }
    groups = {name: joints for name, joints in (arms or {}).items() if name not in fingers}
    by_joint = dict.fromkeys(leaders, ControlMode.FORCE)
    by_joint |= {joint: ControlMode.POSITION for joint in held if joint in by_joint}
    for name, joints in groups.items():
        if name in modes and name not in tree.joint_names:
            by_joint |= {joint: modes[name] for joint in joints if joint in by_joint}
    by_joint |= _finger_modes(tree, fingers, modes)
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
    return ControlPlan(by_joint | locked_modes, hybrid)


def _finger_modes(
    tree: KinematicTree, fingers: Mapping[str, FingerSpec], modes: Mapping[str, ControlMode]
) -> dict[str, ControlMode]:
    """Return the control modes that fingers set, by joint that moves them."""
    finger_by_joint: dict[str, str] = {}
    for finger in fingers:
        if finger not in modes:
            continue
        for joint in driving_joints(tree, fingers[finger]):
            first = finger_by_joint.setdefault(joint, finger)
            if modes[first] is not modes[finger]:
                raise ArgumentError(
                    f"control[{finger!r}]",
                    f"joint {joint!r} moves this finger and {first!r}; give both the same mode",
                )
    for joint, finger in finger_by_joint.items():
        shared = [name for name in fingers if joint in driving_joints(tree, fingers[name])]
        if modes[finger] is ControlMode.HYBRID and len(shared) > 1:
            raise ArgumentError(
                f"control[{finger!r}]",
                f"joint {joint!r} moves the fingers {', '.join(shared)}; a hybrid finger needs "
                "joints of its own",
            )
    return {joint: modes[finger] for joint, finger in finger_by_joint.items()}


_SHORTEST = 0.05  # least reach of a finger over that of a palm's longest branch
_FAR_END_SHARE = 0.9  # share of a jaw's reach from its joint beyond which is its far end
_SHUT_GAP = 0.25  # largest gap of the far end of a shut jaw, over its reach
_OPEN_GAP = 0.5  # least gap of the far end of an open jaw, over its reach
_POINT_RADIUS = 1e-6  # m, radius of the sphere that represents a point in coal
_NAME_TAIL = re.compile(r"([^a-z0-9]+|joint|link)$", re.IGNORECASE)


@dataclass(frozen=True)
class HandStructure:
    """The palms and fingers found in the tree of one robot.

    Attributes:
        palms: The links that carry fingers; empty if the tree neither branches nor ends in a jaw.
        fingers: The branches below the palms by name, in model order.
        arm_joints: Movable joints that carry a palm.
        outer_joints: Movable joints not below a palm: arms, legs, necks; without a palm, all.
    """

    palms: tuple[str, ...]
    fingers: dict[str, FingerSpec]
    arm_joints: tuple[str, ...]
    outer_joints: tuple[str, ...]


def discover_hands(
    tree: KinematicTree, root: str, palms: Sequence[str] = (), prefix: str = ""
) -> HandStructure:
    """Find the palms of one robot and the fingers below them.

    A palm is a body that carries two or more branches and below which no other body does; a branch
    whose joints are all moved by a single actuator is one mechanism and is not searched for palms.
    Of the body's links, the palm is the lowest one from which all branches descend. So a gripper on
    an arm has one palm and a humanoid with two hands has two.

    A branch without shapes, or with a dot on a motor's axis, is not a finger if there are others.

    Fingers are named by the common beginning of the names of their joints, if that distinguishes
    them, else ``finger_1``, ``finger_2``, ... in model order.

    A robot that does not branch may end in a jaw that closes on a fixed one, as hobby arms do: the
    link below its last joint is a finger if the shapes indicate it, and the link above is a palm.

    Args:
        tree: The kinematic tree.
        root: Root link of the robot in it.
        palms: The links that carry fingers, instead of those found.
        prefix: Prefix for the names of numbered fingers.

    Returns:
        The structure.

    Raises:
        ArgumentError: If a named palm is not a link of the robot.
    """
    walker = _LinkWalker(tree, root)
    check_known("palm", "link", palms, walker.links)
    palm_links = tuple(palms) or tuple(walker.palms_below(root)) or walker.fixed_jaw_palm()
    branches = [branch for palm in palm_links for branch in walker.reaching_branches(palm)]
    branches.sort(key=walker.order.__getitem__)
    branch_links = [walker.subtree(branch) for branch in branches]
    joints = [walker.joints_above(links) for links in branch_links]
    names = _finger_names(tree, joints, prefix)
    fingers = {
        name: FingerSpec(tuple(finger_joints), tuple(links), walker.tip_link(links))
        for name, finger_joints, links in zip(names, joints, branch_links, strict=True)
    }
    own_joints = walker.joints_above(walker.links)
    finger_side_joints = {
        joint for palm in palm_links for joint in walker.joints_above(walker.subtree(palm)[1:])
    }
    masks = [tree.supports[tree.link_joints[palm]] for palm in palm_links]
    return HandStructure(
        palms=palm_links,
        fingers=fingers,
        arm_joints=tuple(
            joint for joint in own_joints if any(mask[tree.joint_index[joint]] for mask in masks)
        ),
        outer_joints=tuple(joint for joint in own_joints if joint not in finger_side_joints),
    )


class _LinkWalker:
    """The link tree of one robot, with the kind of joint above each link."""

    def __init__(self, tree: KinematicTree, root: str) -> None:
        self._tree = tree
        self._children: dict[str, list[str]] = {link: [] for link in tree.link_frames}
        for link, parent in tree.parent_links.items():
            if parent is not None:
                self._children[parent].append(link)
        self.order = {link: index for index, link in enumerate(tree.link_frames)}
        self.links = self.subtree(root)

    def subtree(self, link: str) -> list[str]:
        """Return ``link`` and all links below it, in model order."""
        links = [link]
        for item in links:  # grows while it is walked
            links += self._children[item]
        return [link, *sorted(links[1:], key=self.order.__getitem__)]

    def branches(self, link: str) -> list[str]:
        """Return the first link of every movable branch below ``link``."""
        first: list[str] = []
        for child in self._children[link]:
            first += [child] if self._is_movable(child) else self.branches(child)
        return first

    def reaching_branches(self, palm: str) -> list[str]:
        """Return the branches below a palm whose shapes extend far from their first joints."""
        T_world_joint = self._tree.kinematics(np.zeros(len(self._tree.joint_names))).T_world_joint
        reaches = {}
        for branch in self.branches(palm):
            links, start = set(self.subtree(branch)), T_world_joint[self._tree.link_joints[branch]]
            reaches[branch] = 0.0
            for item in self._tree.geometries:
                if item.link in links:
                    item.shape.computeLocalAABB()
                    T = T_world_joint[item.joint] @ item.T_joint_geometry
                    middle = T[:3, :3] @ item.shape.aabb_center + T[:3, 3] - start[:3, 3]
                    reach = float(np.linalg.norm(middle)) + item.shape.aabb_radius
                    reaches[branch] = max(reaches[branch], reach)
        longest = max(reaches.values(), default=0.0)
        return [branch for branch, reach in reaches.items() if reach >= _SHORTEST * longest]

    def joints_above(self, links: Sequence[str]) -> list[str]:
        """Return the movable joints directly above ``links``, in model order."""
        joints = {self._tree.link_joints[link] for link in links if self._is_movable(link)}
        return [self._tree.joint_names[joint - 1] for joint in sorted(joints)]

    def palms_below(self, body: str) -> Iterator[str]:
        """Yield the palms at or below the body whose topmost link is ``body``."""
        branches = self.branches(body)
        deeper = [
            palm
            for branch in branches
            if not self._is_one_mechanism(branch)
            for palm in self.palms_below(branch)
        ]
        if deeper:
            yield from deeper
        elif len(branches) > 1:
            yield self._common_link(body, branches)

    def tip_link(self, links: Sequence[str]) -> str:
        """Return the link at the end of a finger: the last one with a shape, if there is one."""
        depth = {
            link: int(self._tree.supports[self._tree.link_joints[link]].sum()) for link in links
        }
        last = [link for link in links if depth[link] == max(depth.values())]
        shaped = {item.link for item in self._tree.geometries}
        return next((link for link in reversed(last) if link in shaped), last[-1])

    def fixed_jaw_palm(self) -> tuple[str, ...]:
        """Return the link on which the last link of a chain closes as a jaw, empty if it does not.

        The far end of a jaw is near the fixed link at one end of its range and far from it at the
        other. The contact lies beyond the jaw's joint, seen from the previous joint: a forearm that
        folds onto its upper arm is not a jaw.
        """
        tree = self._tree
        movable = [link for link in self.links if self._is_movable(link)]
        if not movable:
            return ()
        link = max(movable, key=lambda one: int(tree.supports[tree.link_joints[one]].sum()))
        jaw_joint, palm = tree.link_joints[link], tree.parent_links[link]
        carrier = 0 if palm is None else tree.link_joints[palm]
        jaw = [item for item in tree.geometries if item.joint == jaw_joint]
        fixed = [
            item for item in tree.geometries if item.joint == carrier and item.link in self.links
        ]
        lower, upper = tree.lower[jaw_joint - 1], tree.upper[jaw_joint - 1]
        turns = tree.joint_kinds[jaw_joint - 1] == "revolute"
        if palm is None or not jaw or not fixed or not turns or not np.isfinite(upper - lower):
            return ()
        corners = np.vstack([_shape_vertices(item) for item in jaw])
        middle = np.clip(0.0, tree.lower, tree.upper)
        poses = []
        for end in (lower, upper):
            middle[jaw_joint - 1] = end
            T_world_joint = tree.kinematics(middle).T_world_joint
            poses.append((T_world_joint[jaw_joint], T_world_joint[carrier]))
        axis = tree.kinematics(middle).J[3:, jaw_joint - 1] @ poses[1][0][:3, :3]
        reaches = np.linalg.norm(corners - np.outer(corners @ axis, axis), axis=1)
        reach = float(reaches.max())
        far = corners[reaches >= _FAR_END_SHARE * reach]
        nearest = []
        for T_jaw, T_fixed in poses:
            T = np.linalg.inv(T_fixed) @ T_jaw
            points = far @ T[:3, :3].T + T[:3, 3]
            nearest.append(
                min((_nearest_point(fixed, p) for p in points), key=lambda pair: pair[0])
            )
        (shut_gap, shut_point), (open_gap, _) = sorted(nearest, key=lambda pair: pair[0])
        joint_position = (np.linalg.inv(poses[0][1]) @ poses[0][0])[:3, 3]
        beyond = np.linalg.norm(shut_point) > np.linalg.norm(joint_position)
        alongside = np.linalg.norm(shut_point - joint_position) >= _OPEN_GAP * reach
        closes = shut_gap <= _SHUT_GAP * reach and open_gap >= _OPEN_GAP * reach
        return (palm,) if closes and beyond and alongside else ()

    def _is_movable(self, link: str) -> bool:
        """Return whether the joint above ``link`` is movable."""
        parent = self._tree.parent_links[link]
        above = 0 if parent is None else self._tree.link_joints[parent]
        return self._tree.link_joints[link] != above

    def _is_one_mechanism(self, branch: str) -> bool:
        """Return whether a single actuator moves all joints of a branch."""
        joints = self.joints_above(self.subtree(branch))
        rows = [self._tree.joint_index[joint] for joint in joints]
        return len(self._tree.coupling.drivers(rows)) == 1

    def _common_link(self, body: str, branches: Sequence[str]) -> str:
        """Return the lowest link of a body from which all branches descend."""
        common = body
        while True:
            candidates = [
                child
                for child in self._children[common]
                if not self._is_movable(child) and set(branches) <= set(self.subtree(child))
            ]
            if not candidates:
                return common
            common = candidates[0]


def _finger_names(tree: KinematicTree, joints: Sequence[Sequence[str]], prefix: str) -> list[str]:
    """Return names of fingers: the common beginning of their joints' names, else numbers."""
    names = []
    for own in joints:
        common = takewhile(lambda letters: len(set(letters)) == 1, zip(*own, strict=False))
        name = "".join(letters[0] for letters in common)
        while (shorter := _NAME_TAIL.sub("", name)) != name:
            name = shorter
        names.append(name)
    taken = {*tree.joint_names, ""}  # modes and limits go by finger or joint name
    if len(set(names)) < len(names) or not taken.isdisjoint(names):
        return [f"{prefix}finger_{number}" for number in range(1, len(joints) + 1)]
    return names


def _shape_vertices(item: LinkGeometry) -> FloatArray:
    """Return (V, 3) vertices of a shape in the frame of the joint that carries it, m."""
    # Imported here: only a gripper with a fixed jaw needs triangles and trimesh.
    from graspless_pin.geometry.bodies.shapes import shape_of

    return shape_of(item.shape).surface().moved(item.T_joint_geometry).vertices


def _nearest_point(shapes: Sequence[LinkGeometry], point: FloatArray) -> tuple[float, FloatArray]:
    """Return the distance of a point from the nearest shape, and the nearest point, joint frame."""
    point_sphere, distances = coal.Sphere(_POINT_RADIUS), []
    for item in shapes:
        T, result = item.T_joint_geometry, coal.DistanceResult()
        coal.distance(
            item.shape, coal.Transform3s(T[:3, :3], T[:3, 3]),
            point_sphere, coal.Transform3s(np.eye(3), point), coal.DistanceRequest(), result,
        )  # fmt: skip
        distances.append((float(result.min_distance), np.asarray(result.getNearestPoint1())))
    return min(distances, key=lambda candidate: candidate[0])
