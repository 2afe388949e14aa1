"""States of a scene whose object moves with a link of the hand as one body.

In the frame of that link the contacts and the Jacobian of the joints behind it are constant. A
state changes the direction of gravity in that frame, and the torques of the joints that carry it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.batch_optimum import WarmOptimum
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.contact.contact_points import BodyKind, ContactArrays
from graspless_pin.geometry.contact.distances import near_pairs, separation
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.work_space import Kinematics
from graspless_pin.geometry.poses import invert, transformed
from graspless_pin.planning.configurations import (
    Configuration,
    Configurations,
    without_joint_limits,
)
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only, unknown_name
from graspless_pin.problem.own_arrays import problem_of_own_arrays
from graspless_pin.scene import Scene
from graspless_pin.scene.contact_arrays import touching_of, with_touching
from graspless_pin.scene.problem_data import jointed_contacts
from graspless_pin.scene.stated import GivenContact, Motion
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.certificate import DualVariables

_AXES = (np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))
"""Tangent axes where a scene states none. Pyramids with 4 k edges do not change by them; margins of
other cones may differ from those of `Scene.solve`, so such scenes should state axes."""


class AttachedConfigurations(Configurations):
    """The states of a scene whose object moves with a link.

    The joints behind the link hold the object and stay as they are in the scene; a configuration
    has all other joints.

    Attributes:
        link: Name of the link.
        joint: The Pinocchio joint that carries it.
        fixed_joints: Names of the independent joints behind it.
        touching: M contacts in the scene, all of the hand.
    """

    def __init__(self, scene: Scene, link: str) -> None:
        """Prepare the states of a scene.

        Args:
            scene: The scene; its contacts are those of all states.
            link: Name of a link of its hand.

        Raises:
            ArgumentError: If there is no such link, it stands still, or not all that touches the
                object moves with it; if the scene declares a motion; if a joint that holds the
                object follows one that does not.
            StateError: If nothing touches the object.
            SceneError: If the scene cannot be used.
        """
        axes = scene.tangent_axes or _AXES
        super().__init__(scene if scene.tangent_axes else scene.with_changes(tangent_axes=axes))
        self.link = link
        self.joint = joint = self._carrier_joint(link)
        tree = self.hand.tree
        behind = tree.supports[1:, joint - 1].copy()
        behind[joint - 1] = False
        leaders = np.array(tree.coupling.leaders, dtype=np.intp)
        self._free = np.flatnonzero(~behind[leaders])
        self._start = self.hand.positions[leaders]
        self.fixed_joints = tuple([self.joint_names[k] for k in np.flatnonzero(behind[leaders])])
        self._refuse_followers(np.flatnonzero(behind))
        self.joint_names = tuple([self.joint_names[k] for k in self._free])
        self.joint_units = tuple([self.joint_units[k] for k in self._free])
        lower, upper = self.joint_limits
        self.joint_limits = read_only(lower[self._free]), read_only(upper[self._free])
        self._refuse_motion()
        self.touching = self._carried_contacts()

    @cached_property
    def without_limits(self) -> AttachedConfigurations:
        """The same states without joint limits."""
        return AttachedConfigurations(without_joint_limits(self.scene), self.link)

    @property
    def hand(self) -> Hand:
        """The hand as it is in the scene."""
        hand = self.scene.hand
        if hand is None:
            raise ArgumentError("attached_to", "requires a hand, but the scene has none")
        return hand

    def _carrier_joint(self, link: str) -> int:
        tree = self.hand.tree
        if not isinstance(link, str) or link not in tree.link_frames:
            raise unknown_name("attached_to", "link", str(link), self.hand.link_names)
        joint = tree.link_joints[link]
        if joint == 0:
            raise ArgumentError(
                "attached_to",
                f"link {link!r} does not move with any joint; name the link that carries the "
                "fingers",
            )
        return joint

    def _refuse_followers(self, behind: NDArray[np.intp]) -> None:
        """Refuse joints behind the link that follow a joint before it."""
        names, coupling = self.hand.tree.joint_names, self.hand.tree.coupling
        follows = coupling.S[np.ix_(behind, self._free)].any(axis=1)
        for joint in behind[follows].tolist():
            raise ArgumentError(
                "attached_to",
                f"joint {names[joint]!r}, which link {self.link!r} carries, follows a joint before "
                "this link: the grip would change with the state; name another link",
            )

    def _refuse_motion(self) -> None:
        motion = self.scene.motion
        if motion is not None and (motion.object_twist.any() or motion.hand is not None):
            raise ArgumentError(
                "attached_to",
                "the scene declares a motion, but an object that moves with a link is at rest in "
                "the hand; use scene.with_changes(motion=None)",
            )

    def _carried_contacts(self) -> ContactArrays:
        """Return the contacts with the object; refuse bodies that do not move with the link."""
        touching, tree = touching_of(self.scene), self.hand.tree
        _ = self.scene.contacts  # raises the error of a scene without contacts
        for name, kind in zip(touching.bodies, touching.kinds, strict=True):
            if kind is BodyKind.SUPPORT:
                raise ArgumentError(
                    "attached_to",
                    f"support {name!r} touches the object and does not move with link "
                    f"{self.link!r}; start where only the hand touches the object",
                )
            if not tree.supports[tree.link_joints[name], self.joint - 1]:
                raise ArgumentError(
                    "attached_to",
                    f"link {name!r} touches the object and does not move with link {self.link!r}; "
                    "name a link that carries all links that touch the object",
                )
        return touching

    def scene_at(
        self,
        q: Configuration | None,
        T_world_object: ArrayLike | None,
        twist: ArrayLike | Motion | None,
    ) -> Scene:
        """Return the scene in one state: see `Evaluator.scene_at`."""
        for name, given in (("T_world_object", T_world_object), ("twist", twist)):
            if given is not None:
                raise ArgumentError(
                    name,
                    f"is not supported, as the object moves with link {self.link!r} (attached_to) "
                    "and q alone determines its pose and motion; leave it out",
                )
        scene = self.scene
        if q is None:
            return scene
        hand = self.hand_at(q)
        move = self._object_displacement(hand)
        fields: dict[str, Any] = {
            "hand": hand,
            "object": scene.object.with_pose(move @ scene.object.T_world_object),
            "tangent_axes": tuple([read_only(move[:3, :3] @ axis) for axis in scene.tangent_axes]),
        }
        if scene.given_contacts is not None:
            fields["given_contacts"] = tuple(
                [_moved_contact(contact, move) for contact in scene.given_contacts]
            )
        return scene._with_fields(fields)

    def solved_scene_at(self, q: Any, T_world_object: Any, twist: Any) -> Scene:
        """Return the scene in one state with the carried contacts, as it is solved."""
        scene = self.scene_at(q, T_world_object, twist)
        if scene is self.scene or scene.given_contacts is not None or scene.hand is None:
            return scene
        move, own = self._object_displacement(scene.hand), self.touching
        R, t = move[:3, :3], move[:3, 3]
        moved = ContactArrays(
            own.bodies, own.kinds, own.positions @ R.T + t, own.normals @ R.T, own.distances
        )
        return with_touching(scene, moved)

    def _object_displacement(self, hand: Hand) -> FloatArray:
        """Return (4, 4) displacement of the object from its pose in the scene, world axes, m."""
        return self._T_world_joint(hand) @ self._T_joint_world

    def hand_at(self, q: Configuration) -> Hand:
        """Return the hand at a configuration: see `Configurations.hand_at`."""
        if isinstance(q, Mapping):
            return self.hand.with_configuration(self._named_positions(q))
        positions = self._start.copy()
        positions[self._free] = self._position_array(q)
        return self.hand.with_configuration(positions)

    def _named_positions(self, q: Mapping[str, float]) -> dict[str, float]:
        for name in q:
            if name in self.fixed_joints:
                raise ArgumentError(
                    "q",
                    f"joint {name!r} belongs to the grip of the object, which moves with link "
                    f"{self.link!r} (attached_to), and stays as it is in the scene; leave it out",
                )
        return super()._named_positions(q)

    def coupling(self) -> tuple[FloatArray, FloatArray]:
        """Return the matrix (n, a) and offset (n,) that map a configuration to all positions."""
        S, offset = self.hand.tree.coupling.S, self.hand.tree.coupling.offset
        fixed = np.setdiff1d(np.arange(len(self._start)), self._free)
        return S[:, self._free], offset + S[:, fixed] @ self._start[fixed]

    @property
    def rate_limits(self) -> FloatArray:
        """(a,) velocity limits of the joints, rad/s or m/s; infinite where files state none."""
        return self.hand.tree.rate_limits[self._free]

    @cached_property
    def moves_apart(self) -> NDArray[np.bool_]:
        """(G,) mask of the hand's collision shapes that do not move with the link."""
        carriers, _ = self.hand.tree.shape_placements
        return ~self.hand.tree.supports[carriers, self.joint - 1]

    @cached_property
    def motor_map(self) -> FloatArray:
        """(n, L) matrix from the torques of all joints to those of the problem's joints."""
        own = self.hand.actuation.from_joints
        count = len(jointed_contacts(self.scene).joints.names)
        return np.pad(own, ((0, 0), (0, count - own.shape[1])))

    def _T_world_joint(self, hand: Hand) -> FloatArray:
        return hand.tree.kinematics(hand.positions).T_world_joint[self.joint]

    @cached_property
    def _T_joint_world(self) -> FloatArray:
        return invert(self._T_world_joint(self.hand))

    @cached_property
    def T_joint_object(self) -> FloatArray:
        """(4, 4) pose of the object in the frame of the joint, m."""
        return self._T_joint_world @ self.scene.object.T_world_object

    def wrenches_in_link_axes(self, kinematics: Kinematics, wrenches: FloatArray) -> FloatArray:
        """Return (..., 6) wrenches in the axes of the joint that carries the link.

        Args:
            kinematics: Of the states.
            wrenches: (..., 6) on the object about its centre of mass, world axes, N and N m.
        """
        R = kinematics.T_world_joint[..., self.joint, :3, :3]
        turned = wrenches.reshape(*wrenches.shape[:-1], 2, 3) @ R
        return turned.reshape(*turned.shape[:-2], 6)

    def torques_with_load(
        self, kinematics: Kinematics, wrenches: FloatArray, torques: FloatArray
    ) -> FloatArray:
        """Return (..., n) torques of all joints with those by which the object's load is carried.

        Args:
            kinematics: Of the states.
            wrenches: See `wrenches_in_link_axes`; the link carries them, whatever the contact
                forces that balance them.
            torques: (..., n) that the hand's own links need, N m or N.
        """
        T, J = kinematics.T_world_joint[..., self.joint, :, :], kinematics.J
        force, moment = wrenches[..., :3], wrenches[..., 3:]
        own = transformed(self.T_joint_object, self.scene.object.center_of_mass)
        center = T[..., :3, :3] @ own + T[..., :3, 3]
        moment = moment + np.cross(center, force)
        power = force[..., None, :] @ J[..., :3, :] + moment[..., None, :] @ J[..., 3:, :]
        power = power[..., 0, :]
        return torques - self.hand.tree.moves[self.joint] * power

    @cached_property
    def motors_carry(self) -> bool:
        """Whether joints under force control carry the link."""
        carriers = self.hand.tree.supports[self.joint]
        return bool(self.hand.actuation.from_joints[carriers].any())

    def axes_at(self, scene: Scene) -> FloatArray:
        """Return (3, 3) the axes, as columns, of the joint that carries the link in a state."""
        return self._T_world_joint(scene.hand or self.hand)[:3, :3]

    def shared_problem(self, scene: Scene, problem: QuasistaticProblem) -> QuasistaticProblem:
        """Return the problem of a state in the axes of the joint that carries the link.

        Only its wrench and gravity torques differ from state to state. The load on the joints that
        carry the link does not depend on which contact forces balance the wrench: it is added to
        the gravity torques, and the columns of these joints in J are zero.

        Args:
            scene: The scene in this state.
            problem: Its problem.
        """
        R = self.axes_at(scene)
        if not self.motors_carry:
            return rotated_problem(problem, R.T)
        hand, center = scene.hand or self.hand, scene.object.center_of_mass_world
        J, links = problem.jacobian.copy(), (self.link,) * len(problem.positions)
        carried = hand.contact_jacobian(links, problem.positions + center)
        J[:, : carried.shape[1]] -= carried
        kinematics, nothing = hand.tree.kinematics(hand.positions), np.zeros(len(self.motor_map))
        load_torques = self.torques_with_load(kinematics, problem.external_wrench, nothing)
        weights = problem.gravity_torques + load_torques @ self.motor_map
        return rotated_problem(problem, R.T, jacobian=J, gravity_torques=weights)

    def object_overlap(self, scene: Scene) -> str:
        """Return a message on a body that the object overlaps by more than ``max_penetration``.

        It is empty if there is none. Links that hold the object are not compared: their overlap is
        that in the evaluator's scene.
        """
        depth, placed = scene.max_penetration, scene.object.placed_bodies
        hand = scene.hand or self.hand
        around = [
            (own.placed_bodies, np.ones(len(own.placed_bodies), bool)) for own in scene.supports
        ]
        for bodies, counts in [*around, (hand.placed_bodies, self.moves_apart)]:
            for p, k in near_pairs(placed, bodies, -depth):
                deep = -separation(placed[p], bodies[k]).distance if counts[k] else 0.0
                if deep > depth:
                    return (
                        f"object {scene.object.name!r} and {bodies[k].name!r} overlap by "
                        f"{deep * 1e3:.2f} mm"
                    )
        return ""


def rotated_problem(
    problem: QuasistaticProblem,
    R: FloatArray,
    *,
    jacobian: FloatArray | None = None,
    gravity_torques: FloatArray | None = None,
) -> QuasistaticProblem:
    """Return a problem of one free object in other axes, without inertias.

    Args:
        problem: The problem; its contacts have the same limit of normal forces.
        R: (3, 3) rotates vectors into those axes.
        jacobian: (3M, L) in the problem's axes; None: its own.
        gravity_torques: (L,) None: its own.
    """
    J = problem.jacobian if jacobian is None else jacobian
    blocks = J.reshape(len(problem.positions), 3, -1)
    return problem_of_own_arrays(
        problem.positions @ R.T,
        problem.normals @ R.T,
        _rotated(problem.external_wrench, R),
        (R @ blocks).reshape(J.shape),
        friction=problem.friction,
        tangents=R @ problem.tangents,
        sliding=problem.sliding @ R.T,
        torque_limits=(problem.lower_torque, problem.upper_torque),
        max_normal_force=float(problem.max_normal_force[0]),
        cone_edges=problem.cone_edges,
        cone=problem.cone,
        joint_names=problem.joint_names,
        joint_units=problem.joint_units,
        gravity_torques=problem.gravity_torques if gravity_torques is None else gravity_torques,
    )


def rotated_solution(
    solution: TorqueSolution, problem: QuasistaticProblem, R: FloatArray
) -> TorqueSolution:
    """Return the solution of a problem from that of the same problem in other axes.

    Args:
        solution: That of the problem in the other axes.
        problem: The problem.
        R: (3, 3) rotates vectors into the axes of the problem.
    """
    own, forces = solution.evidence, solution._forces
    evidence = replace(
        own,
        relaxation=_rotated_multipliers(own.relaxation, R),
        in_mode=_rotated_multipliers(own.in_mode, R),
        forces=None if own.forces is None else read_only(own.forces @ R.T),
        motion=None if own.motion is None else read_only(_rotated(own.motion, R)),
    )
    forces = None if forces is None else read_only(forces @ R.T)
    return replace(solution, problem=problem, evidence=evidence, _forces=forces)


def rotated_optimum(optimum: WarmOptimum, R: FloatArray) -> WarmOptimum:
    """Return an optimum in other axes.

    Args:
        optimum: The optimum.
        R: (3, 3) rotates vectors into those axes.
    """
    motion = _rotated(optimum.scale * optimum.motion, R)
    return optimum._replace(
        forces=optimum.forces @ R.T,
        multipliers=_rotated(optimum.multipliers, R),
        motion=motion,
        scale=np.ones(len(motion)),
    )


def _rotated_multipliers(multipliers: DualVariables | None, R: FloatArray) -> DualVariables | None:
    if multipliers is None:
        return None
    y, z = multipliers
    return read_only(_rotated(y, R)), z


def _rotated(vector: FloatArray, R: FloatArray) -> FloatArray:
    """Rotate the first two triples of a vector (6 + k,); the other entries stay."""
    return np.concatenate([R @ vector[:3], R @ vector[3:6], vector[6:]])


def _moved_contact(contact: GivenContact, move: FloatArray) -> GivenContact:
    R, t = move[:3, :3], move[:3, 3]
    return GivenContact(contact.body, R @ contact.position + t, R @ contact.normal)
