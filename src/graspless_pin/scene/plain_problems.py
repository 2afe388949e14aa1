"""Arrays of a scene's problem in one configuration after another, without records on the way.

For what is asked most often: the hand elsewhere, nothing moves, and its contacts are known in
closed form. All other states are left to `Scene.problem`, which finds the same of these and says
what is wrong with those that are.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled import contact_search, rigid_bodies
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.contact.broad_phase import solids_of
from graspless_pin.geometry.contact.closed_form_contacts import (
    ContactLimits,
    joined_rows,
    near_and_closed_form,
)
from graspless_pin.geometry.contact.finding import MERGE_DISTANCE
from graspless_pin.geometry.hand.configuration import independent_positions
from graspless_pin.geometry.hand.posed_links import joints_of
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.cones import projected_tangents
from graspless_pin.scene.scene import Scene

_MOST_KEPT = 256


class PlainProblem(NamedTuple):
    """What loops read of a `QuasistaticProblem`, whose attributes these are."""

    positions: FloatArray
    normals: FloatArray
    tangents: FloatArray
    jacobian: FloatArray
    gravity_torques: FloatArray
    friction: FloatArray
    sliding: FloatArray
    has_cone: NDArray[np.bool_]
    is_sliding: NDArray[np.bool_]
    external_wrench: FloatArray
    lower_torque: FloatArray
    upper_torque: FloatArray
    max_normal_force: FloatArray
    cone_edges: int
    is_round: bool
    joint_names: tuple[str, ...]
    joint_count: int
    contact_count: int

    @property
    def as_problem(self) -> QuasistaticProblem:
        """Itself, for loops that read no more than these attributes of a problem."""
        return cast("QuasistaticProblem", self)

    def margin_of(self, forces: FloatArray) -> float:
        """Return what `QuasistaticProblem.margin_of` does."""
        return QuasistaticProblem.margin_of(self.as_problem, forces)


_ALIKE = PlainProblem._fields[5:]
"""What problems with the same contacts share."""


class PlainProblems:
    """Problems of one scene's hand in other configurations."""

    def __init__(self, scene: Scene) -> None:
        """Take the scene."""
        self._scene, hand = scene, scene.hand
        self._hand = None
        if (
            contact_search is not None
            and hand is not None
            and hand.actuation.every_joint_alone
            and not hand.control.hybrid_fingers
            and scene.given_contacts is None
            and scene.motion is None
            and not any(support.velocity.any() for support in scene.supports)
        ):
            self._hand = hand
        self._known: dict[tuple[str, ...], tuple[Any, ...]] = {}
        self._limits = ContactLimits(
            scene.contact_tolerance, scene.max_penetration, MERGE_DISTANCE, scene.points_per_patch
        )

    def at(self, q: FloatArray) -> tuple[tuple[str, ...], PlainProblem] | None:
        """Return the bodies that touch, and the problem, with the hand at a configuration.

        Args:
            q: (a,) positions of its independent joints, rad or m.

        Returns:
            None where `Scene.problem` has to be asked.
        """
        hand = self._hand
        if hand is None:
            return None
        tree = hand.tree
        try:
            positions = independent_positions(tree, q)
        except ArgumentError:
            return None
        kinematics = tree.kinematics(positions)
        poses = rigid_bodies.placed(kinematics.T_world_joint, *tree.shape_placements)
        pieces, links = self._scene.object.placed_bodies, PlacedBodies(tree.shapes, poses)
        solids = solids_of(pieces.shapes), solids_of(tree.shapes)
        pairs, found, left = near_and_closed_form(pieces, solids[0], links, solids[1], self._limits)
        if left:
            return None
        rows, names = joined_rows(found), tree.shapes.names
        touching = tuple([names[pairs[place][1]] for place in rows.places])
        known = self._known.get(touching)
        if known is None:
            return None
        bodies, carriers, support_points, support_normals, alike = known
        center = self._scene.object.center_of_mass_world
        normals = np.concatenate((rows.normals, support_normals))
        jacobian = np.zeros((3 * len(normals), len(positions)))
        jacobians = tree.point_jacobians(kinematics.J, carriers, rows.positions)
        jacobian[: 3 * len(touching)] = jacobians.reshape(-1, len(positions))
        weights = np.zeros(len(positions))
        if self._scene.count_own_weight:
            weights = tree.gravity_torques(positions, self._scene.gravity)
        problem = PlainProblem(
            np.concatenate((rows.positions - center, support_points)),
            normals,
            projected_tangents(normals, self._scene.tangent_axes),
            jacobian,
            weights,
            *alike,
        )
        return bodies, problem

    def learn(self, scene: Scene, problem: QuasistaticProblem) -> None:
        """Keep what a problem shares with those of the same contacts.

        Args:
            scene: The scene, but for its hand's configuration.
            problem: Its problem.
        """
        arrays = scene.contacts.arrays
        touching = arrays.bodies[: arrays.hand_count]
        own = self._scene
        if self._hand is None or scene.object is not own.object or scene.motion is not own.motion:
            return
        if len(self._known) >= _MOST_KEPT:
            self._known = {}
        self._known[touching] = (
            arrays.bodies,
            joints_of(self._hand.tree, touching),
            problem.positions[len(touching) :],
            problem.normals[len(touching) :],
            tuple([getattr(problem, name) for name in _ALIKE]),
        )
