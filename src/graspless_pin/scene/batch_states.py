"""A scene's contacts in many configurations of its hand, as arrays, without records on the way.

For what is asked most often: the hand elsewhere, nothing moves, and its contacts are spheres on
faces. All other states are left to `Scene.problem`, which finds the same of these and says what is
wrong with those that are.
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
from graspless_pin.geometry.posing.overlaps import pairs_of
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.contact_arrays import touching_of
from graspless_pin.scene.entry_findings import reach_of
from graspless_pin.scene.scene import Scene

_MOST_KEPT = 256


class BatchContacts(NamedTuple):
    """Contacts of S configurations, found by the compiled loops: see `compiled.core`.

    Attributes:
        counts: (S,) contacts with the hand; -1 where `Scene.problem` has to be asked.
        shapes: (S, m) the collision shape of each.
        rows: (S, m, 6) positions and normals into the object, world, m.
        columns: (S, 6, n) spatial joint columns about the world's origin.
        weights: (S, n) torques that carry the hand's weight.
        doubtful: (S,) whether the hand may be too deep in itself or in a support.
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
        """Yield the shapes that touch, and the numbers of the states in which they do."""
        keys = np.where(np.arange(self.shapes.shape[1]) < self.counts[:, None], self.shapes, -1)
        some = np.flatnonzero(self.counts >= 0)
        kinds, kind_of = np.unique(keys[some], axis=0, return_inverse=True)
        for number, kind in enumerate(kinds):
            yield tuple(kind[kind >= 0].tolist()), some[kind_of.ravel() == number]


class SharedContactData(NamedTuple):
    """What problems with the same contacts share.

    Attributes:
        bodies: That touch, those of the hand first.
        carriers: The joint that carries each of the hand's.
        problem: One of these problems.
    """

    bodies: tuple[str, ...]
    carriers: list[int]
    problem: QuasistaticProblem


class BatchContactFinder:
    """Contacts of one scene's hand in other configurations."""

    def __init__(self, scene: Scene, *, collisions: bool = True) -> None:
        """Take the scene.

        Args:
            scene: The scene.
            collisions: Whether states are looked for in which the hand may be too deep in itself or
                in a support.
        """
        self._scene = scene
        self._collisions = collisions
        self._known: dict[tuple[str, ...], SharedContactData] = Bounded(_MOST_KEPT)

    def at(self, q: FloatArray) -> BatchContacts | None:
        """Return the contacts in configurations.

        Args:
            q: (S, a) positions of the hand's independent joints, rad or m.

        Returns:
            None: the compiled loops do not handle this scene.
        """
        return None if self._loops is None else BatchContacts(*self._loops.at(q))

    def shared_data(self, shapes: tuple[int, ...]) -> SharedContactData | None:
        """Return what problems share in which some shapes touch, if it is known."""
        names = self._scene.hand.tree.shapes.names if self._scene.hand is not None else ()
        return self._known.get(tuple([names[shape] for shape in shapes]))

    @property
    def moves(self) -> FloatArray:
        """(n + 1, n) one where a joint moves what is attached to another, else zero."""
        return self._scene.hand.tree.moves if self._scene.hand is not None else np.zeros((1, 0))

    @property
    def frame(self) -> tuple[FloatArray, FloatArray]:
        """(3,) what positions are about, and (A, 3) the directions that tangents lie along."""
        return self._scene.object.center_of_mass_world, self._axes

    def store(self, scene: Scene, problem: QuasistaticProblem) -> None:
        """Keep what a problem shares with those of the same contacts.

        Args:
            scene: The scene, but for its hand's configuration.
            problem: Its problem.
        """
        own = self._scene
        if (
            self._loops is None
            or own.hand is None
            or scene.object is not own.object
            or scene.motion is not own.motion
        ):
            return
        arrays = scene.contacts.arrays
        touching = arrays.bodies[: arrays.hand_count]
        self._known[touching] = SharedContactData(
            arrays.bodies, joints_of(own.hand.tree, touching), problem
        )

    @cached_property
    def _axes(self) -> FloatArray:
        return np.array(self._scene.tangent_axes).reshape(-1, 3)

    @cached_property
    def _loops(self) -> Any:
        """The loops, with all that they read of the scene; None where they do not apply."""
        scene, hand = self._scene, self._scene.hand
        if (
            core is None
            or hand is None
            or not hand.actuation.every_joint_alone
            or hand.control.hybrid_fingers
            or scene.given_contacts is not None
            or not _slides_alike(scene)
            or any(support.is_moving for support in scene.supports)
            or scene.acceleration is not None
        ):
            return None
        tree, pieces = hand.tree, scene.object.placed_bodies
        links = solids_of(tree.shapes).for_loops
        return loops_of(
            scene,
            (tree.coupling.S, tree.coupling.offset),
            (*tree.shape_placements, links),
            pieces,
            core.BodyPairs(links, *pairs_of(tree).T) if self._collisions else None,
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
        scene: The scene; it has a hand.
        coupling: Matrix and offset from a configuration to positions of all joints.
        moving: The joint that carries each shape, its pose there, and the shapes for loops.
        pieces: What contacts are looked for with.
        pairs: Of the shapes, which may not be in each other; None: no overlaps are looked for.
    """
    tree: Any = scene.hand and scene.hand.tree
    around = PlacedBodies.joined([support.placed_bodies for support in scene.supports])
    carriers, shapes, links = moving
    return core.HandStates(
        coupling=coupling[0],
        offset=coupling[1],
        lower=tree.tolerated[0],
        upper=tree.tolerated[1],
        gravity=scene.gravity if scene.count_own_weight else np.zeros(3),
        carriers=carriers,
        shapes=shapes,
        links=links,
        pieces=solids_of(pieces.shapes).for_loops,
        poses=pieces.poses,
        pairs=pairs,
        around=solids_of(around.shapes).for_loops,
        around_poses=around.poses,
        tolerance=scene.contact_tolerance,
        max_penetration=scene.max_penetration,
        **tree.chains,
    )


def _slides_alike(scene: Scene) -> bool:
    """Whether contacts with supports slide, part or stay as they do wherever the hand touches.

    The hand has to follow the object. What counts as no speed is a share of the fastest of all
    contacts, which is known up to where on the object the hand touches.
    """
    motion = scene.motion
    if motion is None:
        return True
    if motion.hand is not None:
        return False
    try:
        touching, center = touching_of(scene), scene.object.center_of_mass_world
    except GrasplessPinError:  # said of each state by itself
        return False
    own = slice(touching.hand_count, None)
    arms, normals = touching.positions[own] - center, touching.normals[own]
    velocities = motion.object_twist[:3] + turning_velocities(motion.object_twist[3:], arms)
    leaving = (normals * velocities).sum(axis=1)
    along = np.linalg.norm(velocities - leaving[:, None] * normals, axis=1)
    linear, spin = (float(np.linalg.norm(part)) for part in np.split(motion.object_twist, 2))
    farthest = reach_of(scene.object) + scene.contact_tolerance
    nearest = float(np.linalg.norm(arms, axis=1).max(initial=0.0))
    least, most = (SPEED_TOLERANCE * max(linear, spin * arm) for arm in (nearest, farthest))
    speeds = np.concatenate((along, np.abs(leaving)))
    return bool(((speeds <= least) | (speeds > most)).all())
