"""A scene's contacts in many configurations of its hand at once, as arrays from compiled loops.

They cover the common case: only the hand's configuration changes, nothing moves, and its contacts
are spheres on faces. Other states are left to `Scene.problem`, which gives the same result for
these, and the errors for invalid states.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.caching import Bounded
from graspless_pin.compiled import core
from graspless_pin.errors import GrasplessPinError
from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.contact.contact_points import SPEED_TOLERANCE
from graspless_pin.geometry.contact.distances import solids_of
from graspless_pin.geometry.hand.configuration import joints_of
from graspless_pin.geometry.poses import turning_velocities
from graspless_pin.geometry.posing.overlaps import overlap_pairs
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.contact_arrays import touching_of
from graspless_pin.scene.entry_findings import object_radius_bound
from graspless_pin.scene.scene import Scene

_MOST_KEPT = 256


class BatchContacts(NamedTuple):
    """Contacts of S configurations, found by the compiled loops: see `compiled.core`.

    Attributes:
        counts: (S,) contacts with the hand; -1 where the state is left to `Scene.problem`.
        shapes: (S, m) the collision shape of each.
        rows: (S, m, 6) positions and normals into the object, world, m.
        columns: (S, 6, n) spatial joint columns about the world's origin.
        weights: (S, n) joint torques against the hand's weight.
        doubtful: (S,) whether the hand may overlap itself or a support too deeply.
        poses: (S, n + 1, 4, 4) of the joints, the base first.
    """

    counts: NDArray[np.intp]
    shapes: NDArray[np.intp]
    rows: FloatArray
    columns: FloatArray
    weights: FloatArray
    doubtful: NDArray[np.bool_]
    poses: FloatArray

    def groups(self) -> Iterator[tuple[tuple[int, ...], NDArray[np.intp]]]:
        """Yield each set of touching shapes, and the numbers of the states with these contacts."""
        keys = np.where(np.arange(self.shapes.shape[1]) < self.counts[:, None], self.shapes, -1)
        found = np.flatnonzero(self.counts >= 0)
        groups, group_of = np.unique(keys[found], axis=0, return_inverse=True)
        for number, shapes in enumerate(groups):
            yield tuple(shapes[shapes >= 0].tolist()), found[group_of.ravel() == number]


class SharedContactData(NamedTuple):
    """Data that problems with the same contacts share.

    Attributes:
        bodies: Touching bodies, those of the hand first.
        carriers: For each touching link of the hand the joint that carries it.
        problem: One of these problems.
    """

    bodies: tuple[str, ...]
    carriers: list[int]
    problem: QuasistaticProblem


class BatchContactFinder:
    """Finds the contacts of one scene's hand in other configurations."""

    def __init__(self, scene: Scene, *, collisions: bool = True) -> None:
        """Take the scene.

        Args:
            scene: The scene.
            collisions: Whether to look for too deep overlaps of the hand with itself and supports.
        """
        self._scene = scene
        self._collisions = collisions
        self._known: dict[tuple[str, ...], SharedContactData] = Bounded(_MOST_KEPT)

    def contacts_at(self, q: FloatArray) -> BatchContacts | None:
        """Return the contacts in configurations.

        Args:
            q: (S, a) positions of the hand's independent joints, rad or m.

        Returns:
            The contacts; None if the compiled loops do not handle this scene.
        """
        return None if self._loops is None else BatchContacts(*self._loops.at(q))

    def shared_data(self, shapes: tuple[int, ...]) -> SharedContactData | None:
        """Return the stored data of problems with given touching shapes; None if there are none."""
        names = self._scene.hand.tree.shapes.names if self._scene.hand is not None else ()
        return self._known.get(tuple([names[shape] for shape in shapes]))

    @property
    def moves(self) -> FloatArray:
        """(n + 1, n) one where a joint (column) moves the links of another (row), else zero."""
        return self._scene.hand.tree.moves if self._scene.hand is not None else np.zeros((1, 0))

    @property
    def frame(self) -> tuple[FloatArray, FloatArray]:
        """(3,) the origin of positions (centre of mass), m, and (A, 3) the tangent axes, world."""
        return self._scene.object.center_of_mass_world, self._axes

    def store(self, scene: Scene, problem: QuasistaticProblem) -> None:
        """Store the data that a problem shares with others of the same contacts.

        Args:
            scene: The scene, perhaps in another configuration of its hand.
            problem: Its problem.
        """
        own_scene = self._scene
        if (
            self._loops is None
            or own_scene.hand is None
            or scene.object is not own_scene.object
            or scene.motion is not own_scene.motion
        ):
            return
        arrays = scene.contacts.arrays
        touching = arrays.bodies[: arrays.hand_count]
        self._known[touching] = SharedContactData(
            arrays.bodies, joints_of(own_scene.hand.tree, touching), problem
        )

    @cached_property
    def _axes(self) -> FloatArray:
        return np.array(self._scene.tangent_axes).reshape(-1, 3)

    @cached_property
    def _loops(self) -> Any:
        """The compiled loops with the scene's data; None where they do not apply."""
        scene, hand = self._scene, self._scene.hand
        if (
            core is None
            or hand is None
            or not hand.actuation.is_identity
            or hand.control.hybrid_fingers
            or scene.given_contacts is not None
            or not _has_fixed_sliding(scene)
            or any(support.is_moving for support in scene.supports)
            or scene.acceleration is not None
        ):
            return None
        tree, pieces = hand.tree, scene.object.placed_bodies
        links = solids_of(tree.shapes).compiled_sets
        return loops_of(
            scene,
            (tree.coupling.S, tree.coupling.offset),
            (*tree.shape_placements, links),
            pieces,
            core.BodyPairs(links, *overlap_pairs(tree).T) if self._collisions else None,
        )


def loops_of(
    scene: Scene,
    coupling: tuple[FloatArray, FloatArray],
    moving: tuple[NDArray[np.intp], FloatArray, Any],
    pieces: PlacedBodies,
    pairs: Any,
) -> Any:
    """Return `core.HandStates` of a scene.

    Args:
        scene: The scene, with a hand.
        coupling: Matrix and offset from a configuration to positions of all joints.
        moving: The joint that carries each shape, its pose there, and the shapes for loops.
        pieces: The convex pieces with which contacts are looked for.
        pairs: Pairs of shapes that must not overlap; None: overlaps are not looked for.
    """
    tree: Any = scene.hand and scene.hand.tree
    support_bodies = PlacedBodies.joined([support.placed_bodies for support in scene.supports])
    carriers, shapes, links = moving
    return core.HandStates(
        coupling=coupling[0],
        offset=coupling[1],
        lower=tree.tolerated_limits[0],
        upper=tree.tolerated_limits[1],
        gravity=scene.gravity if scene.count_own_weight else np.zeros(3),
        carriers=carriers,
        shapes=shapes,
        links=links,
        pieces=solids_of(pieces.shapes).compiled_sets,
        poses=pieces.poses,
        pairs=pairs,
        around=solids_of(support_bodies.shapes).compiled_sets,
        around_poses=support_bodies.poses,
        tolerance=scene.contact_tolerance,
        max_penetration=scene.max_penetration,
        **tree.chains,
    )


def _has_fixed_sliding(scene: Scene) -> bool:
    """Return whether the sliding of support contacts does not depend on where the hand touches.

    The hand has to follow the object. The speed that counts as zero is a share of the largest
    contact speed, for which there are only bounds: the hand may touch anywhere on the object.
    """
    motion = scene.motion
    if motion is None:
        return True
    if motion.hand is not None:
        return False
    try:
        touching, center = touching_of(scene), scene.object.center_of_mass_world
    except GrasplessPinError:  # raised for each state by itself
        return False
    on_supports = slice(touching.hand_count, None)
    arms, normals = touching.positions[on_supports] - center, touching.normals[on_supports]
    velocities = motion.object_twist[:3] + turning_velocities(motion.object_twist[3:], arms)
    leaving = (normals * velocities).sum(axis=1)
    sliding_speeds = np.linalg.norm(velocities - leaving[:, None] * normals, axis=1)
    linear, spin = (float(np.linalg.norm(part)) for part in np.split(motion.object_twist, 2))
    farthest = object_radius_bound(scene.object) + scene.contact_tolerance
    nearest = float(np.linalg.norm(arms, axis=1).max(initial=0.0))
    slow, fast = (SPEED_TOLERANCE * max(linear, spin * arm) for arm in (nearest, farthest))
    speeds = np.concatenate((sliding_speeds, np.abs(leaving)))
    return bool(((speeds <= slow) | (speeds > fast)).all())
