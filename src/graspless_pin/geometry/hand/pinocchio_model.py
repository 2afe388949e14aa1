"""Pinocchio's model of robots, joint by joint.

Links, joints and frames come in the order of Pinocchio's own reader of URDFs: depth first, the
joints of one link by name; then frames by the joint that carries them, as `appendModel` sorts them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from graspless_pin.geometry.hand.robot_model import RobotJoint, RobotLink, RobotModel
from graspless_pin.problem.checks import FloatArray

_ALIGNED = {
    "revolute": (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ),
    "continuous": (pin.JointModelRUBX, pin.JointModelRUBY, pin.JointModelRUBZ),
    "prismatic": (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ),
}
_UNALIGNED = {
    "revolute": pin.JointModelRevoluteUnaligned,
    "prismatic": pin.JointModelPrismaticUnaligned,
}
_BEYOND_COSINES = 1.01
"""Pinocchio's limits of a cosine and a sine, which are none."""


class _Frame(NamedTuple):
    """A frame to be added.

    Attributes:
        joint: Pinocchio index of the joint that carries it.
        key: Its type and name.
        placement: In the joint's frame.
        above: Key of the frame that it hangs on; None: the universe.
    """

    joint: int
    key: tuple[Any, str]
    placement: Any
    above: tuple[Any, str] | None


def pinocchio_model(
    robots: Sequence[tuple[RobotModel, FloatArray]],
) -> tuple[Any, tuple[tuple[frozenset[str], Any], ...]]:
    """Return one ``pinocchio.Model`` of robots that are fixed to the world.

    Frames of joints are called ``joint NAME``: a joint may be called like a link.

    Args:
        robots: Each with its (4, 4) ``T_world_base``; their names must differ.

    Returns:
        The model, with rotor inertias as armature; and of each robot the names of its joints and
        frames, and the inertia of what does not move, in world axes.
    """
    model = pin.Model()
    bases = tuple(
        _Builder(model, robot, pin.SE3(np.array(T_world_base))).add()
        for robot, T_world_base in robots
    )
    rotors = {one.name: one.rotor_inertia for robot, _ in robots for one in robot.joints}
    model.armature = np.array([rotors[name] for name in tuple(model.names)[1:]])
    return model, bases


class _Builder:
    """Adds one robot to a model."""

    def __init__(self, model: Any, robot: RobotModel, T_world_base: Any) -> None:
        self._model, self._base = model, T_world_base
        self._links = {link.name: link for link in robot.links}
        self._below: dict[str, list[RobotJoint]] = {}
        for joint in sorted(robot.joints, key=lambda one: one.name):
            self._below.setdefault(joint.parent, []).append(joint)
        self._root = self._links[robot.root]
        self._joints: list[str] = []
        self._frames: list[_Frame] = []
        self._fixed = pin.Inertia.Zero()

    def add(self) -> tuple[frozenset[str], Any]:
        """Add it; return its names and the inertia of what does not move."""
        self._visit(self._root, 0, pin.SE3.Identity(), None)
        at: dict[tuple[Any, str], int] = {}
        for frame in sorted(self._frames, key=lambda one: one.joint):
            above = 0 if frame.above is None else at[frame.above]
            placement = frame.placement if frame.joint else self._base * frame.placement
            kind, name = frame.key
            at[frame.key] = self._model.addFrame(
                pin.Frame(name, frame.joint, above, placement, kind)
            )
        fixed = self._base.act(self._fixed)
        self._model.inertias[0] = self._model.inertias[0] + fixed
        return frozenset([*self._joints, *(name for _, name in at)]), fixed

    def _visit(
        self, link: RobotLink, joint: int, placement: Any, above: tuple[Any, str] | None
    ) -> None:
        """Add a link at a placement in the frame of a joint, and all below it."""
        body = (pin.FrameType.BODY, link.name)
        self._frames.append(_Frame(joint, body, placement, above))
        if link.mass or link.inertia.any():
            # Set one by one: its constructor refuses inertias that no rigid body has.
            own = pin.Inertia.Zero()
            own.mass, own.lever = link.mass, np.array(link.center_of_mass)
            own.inertia = np.array(link.inertia)
            if joint:
                self._model.appendBodyToJoint(joint, own, placement)
            else:
                self._fixed = self._fixed + placement.act(own)
        for item in self._below.get(link.name, ()):
            T, child = placement * pin.SE3(np.array(item.T_parent_joint)), self._links[item.child]
            kind = pin.FrameType.JOINT if item.is_movable else pin.FrameType.FIXED_JOINT
            frame = (kind, f"joint {item.name}")
            if item.is_movable:
                carrier = self._add_joint(item, joint, T if joint else self._base * T)
                T = pin.SE3.Identity()
            else:
                carrier = joint
            self._frames.append(_Frame(carrier, frame, T, body))
            self._visit(child, carrier, T, frame)

    def _add_joint(self, item: RobotJoint, parent: int, placement: Any) -> int:
        self._joints.append(item.name)
        ends = np.array([item.lower]), np.array([item.upper])
        if item.kind == "continuous":
            ends = -_BEYOND_COSINES * np.ones(2), _BEYOND_COSINES * np.ones(2)
        return self._model.addJoint(
            parent, _joint_model(item), placement, item.name,
            np.array([item.effort]), np.array([np.inf]), *ends,
        )  # fmt: skip


def _joint_model(item: RobotJoint) -> Any:
    for axis, kind in zip(np.eye(3), _ALIGNED[item.kind], strict=True):
        if (item.axis == axis).all():
            return kind()
    axis = item.axis / np.abs(item.axis).max()  # whose squares are numbers
    axis = axis / np.linalg.norm(axis)
    return _unbounded(axis) if item.kind == "continuous" else _UNALIGNED[item.kind](axis)


def _unbounded(axis: FloatArray) -> Any:
    """Return a joint without limits about a unit vector (3,).

    The bindings cannot tell it its axis; Pinocchio's reader of URDFs does.
    """
    words = " ".join(repr(float(one)) for one in axis)
    return pin.buildModelFromXML(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        f'<parent link="a"/><child link="b"/><axis xyz="{words}"/></joint></robot>'
    ).joints[1]
