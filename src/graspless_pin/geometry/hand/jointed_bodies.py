"""A hand as rigid bodies on joints, in numpy alone: what another program needs to move it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.work_space import joint_motions
from graspless_pin.geometry.poses import invert
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import Record


@dataclass(frozen=True, eq=False)
class JointedBody(Record):
    """A movable joint and all that is fixed to its far side, up to the next joints.

    Attributes:
        joint: Name of the joint.
        parent: Index of the body that the joint hangs on among the hand's n; None: the world.
        linear: Whether the joint slides.
        axis: (3,) unit vector of the joint, world axes; it passes through the body's origin.
        T_world_body: (4, 4) pose of the body's frame, m.
        mass: kg.
        center_of_mass: (3,) in the body's frame, m.
        inertia: (3, 3) about the centre of mass, axes of the body's frame, kg m^2.
        rotor_inertia: What the motor adds behind its gear, kg m^2, or kg of a joint that slides.
    """

    joint: str
    parent: int | None
    linear: bool
    axis: FloatArray
    T_world_body: FloatArray
    mass: float
    center_of_mass: FloatArray
    inertia: FloatArray
    rotor_inertia: float


def jointed_bodies(hand: Hand) -> tuple[JointedBody, ...]:
    """Return the bodies of a hand at its configuration, one for each of its n movable joints."""
    tree = hand.tree
    model, placed = tree.pinocchio_model, tree.kinematics(hand.positions)
    bodies = []
    for index, (name, kind) in enumerate(zip(tree.joint_names, tree.joint_kinds, strict=True)):
        carried = model.inertias[index + 1]
        parent = int(model.parents[index + 1]) - 1
        linear = kind == "prismatic"
        bodies.append(
            JointedBody(
                name,
                parent if parent >= 0 else None,
                linear,
                placed.J[:3, index] if linear else placed.J[3:, index],
                placed.T_world_joint[index + 1],
                float(carried.mass),
                read_only(np.array(carried.lever)),
                read_only(np.array(carried.inertia)),
                float(model.armature[index]),
            )
        )
    return tuple(bodies)


class PlacedLink(NamedTuple):
    """A link where it is while all joints of a hand stand at zero.

    Attributes:
        name: Of the link.
        parent: The link that it hangs on; None: the world.
        joint: Index of the movable joint between the two among the hand's n; None: it is fixed.
        T_parent_link: (4, 4) pose in the parent's frame, m.
        T_joint_link: (4, 4) pose in the frame of the joint that moves it, m.
    """

    name: str
    parent: str | None
    joint: int | None
    T_parent_link: FloatArray
    T_joint_link: FloatArray


def placed_links(hand: Hand) -> tuple[PlacedLink, ...]:
    """Return the links of a hand, parents before children; a joint's frame is its link's."""
    tree = hand.tree
    parents, steps, _ = joint_motions(tree)
    poses = [np.eye(4)]
    for joint in range(1, len(parents)):
        poses.append(poses[parents[joint]] @ steps[joint])
    frames = tree.pinocchio_model.frames
    placements = {link: frames[k].placement.homogeneous for link, k in tree.link_frames.items()}
    at_zero = {link: poses[tree.link_joints[link]] @ T for link, T in placements.items()}
    links = []
    for link, parent in tree.parent_links.items():
        own, above = tree.link_joints[link], 0 if parent is None else tree.link_joints[parent]
        T = at_zero[link] if parent is None else invert(at_zero[parent]) @ at_zero[link]
        joint = own - 1 if own != above else None
        links.append(PlacedLink(link, parent, joint, T, placements[link]))
    return tuple(links)
