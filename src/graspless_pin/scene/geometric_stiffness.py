"""The geometric stiffness of a scene's rest: how contact forces' work changes along motions.

In closed form from the surfaces at the contacts. At rest Q + G^T f = 0 for the generalised load Q
(weight, torques less the links' weight), and G N = 0 along the motions without slip. So along them
the change of N^T Q is N^T (dQ + dG^T f) with the contact forces f fixed in the world: contact
points and levers move as bodies and surfaces do.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.convex_sets import FLAT
from graspless_pin.geometry.contact.curvature import (
    Rolling,
    has_mesh,
    is_surface_of,
    radii_of_curvature,
)
from graspless_pin.geometry.hand.joint_columns import JointColumns
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.holding.dynamics import motion_length
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.inertias import hybrid_contacts
from graspless_pin.problem.quasistatic import QuasistaticProblem
from graspless_pin.scene.contact_arrays import contacts_of, pieces_by_body
from graspless_pin.scene.fields import SceneFields, label_of
from graspless_pin.scene.load_wrenches import hand_motion, load_rates


def rolling_by_model(scene: SceneFields, problem: QuasistaticProblem) -> Mapping[str, Rolling]:
    """Return the radii of curvature at the contacts, by model of the surfaces.

    ``facets`` takes hulls of meshes as they are; ``fitted``, if there are meshes, fits smooth
    surfaces to them. Radii are zero at `assumed_contacts`.
    """
    contacts = contacts_of(scene).arrays
    object_pieces, touching = _touching_pieces(scene)
    half = 0.5 * np.array(contacts.distances)[:, None] * contacts.normals
    assumed = {*assumed_contacts(scene)}
    models = ["facets", "fitted"] if any(map(has_mesh, [object_pieces, *touching])) else ["facets"]
    surfaces = {}
    for name in models:
        radii = np.zeros((2, len(contacts), 2, 2))
        for contact in range(len(contacts)):
            if contact in assumed:
                continue
            normal, tangents = contacts.normals[contact], problem.tangents[contact]
            for side, sign, pieces in ((0, 1.0, object_pieces), (1, -1.0, touching[contact])):
                point = contacts.positions[contact] + sign * half[contact]
                radii[side, contact] = radii_of_curvature(
                    pieces, point, -sign * normal, tangents, fitted=name == "fitted"
                )
        surfaces[name] = Rolling(*radii)
    return surfaces


def assumed_contacts(scene: SceneFields) -> tuple[int, ...]:
    """Return the indices of stated contacts at which the shapes of object and body do not touch.

    Their curvature is unknown, so both surfaces are taken as points that do not roll. Round ones
    would make rest under the normal forces more stable.
    """
    if scene.given_contacts is None:
        return ()
    contacts, tolerance = contacts_of(scene).arrays, scene.contact_tolerance
    object_pieces, touching = _touching_pieces(scene)
    return tuple(
        contact
        for contact, (pieces, point, normal) in enumerate(
            zip(touching, contacts.positions, contacts.normals, strict=True)
        )
        if not is_surface_of(object_pieces, point, -normal, tolerance)
        or not is_surface_of(pieces, point, normal, tolerance)
    )


def _touching_pieces(scene: SceneFields) -> tuple[PlacedBodies, list[list[CollisionBody]]]:
    """Return the convex pieces of the object, and of the body at each contact."""
    pieces = pieces_by_body(scene)
    return scene.object.placed_bodies, [pieces[name] for name in contacts_of(scene).bodies]


class MovingBodies(NamedTuple):
    """Velocities of the touching bodies in d motions.

    Attributes:
        columns: The columns of the hand's joints; None without a hand.
        links: Pinocchio joint of the link at each of the hand's contacts, which come first.
        rates: (n, d) joint rates.
        turns: (M, 3, d) angular velocities.
        points: (M, 3, d) velocities of the material points at the contacts.
        follows: (M,) true at contacts of hybrid fingers, which follow the object along the normal.
    """

    columns: JointColumns | None
    links: list[int]
    rates: FloatArray
    turns: FloatArray
    points: FloatArray
    follows: NDArray[np.bool_]


def moving_bodies(
    scene: SceneFields, problem: QuasistaticProblem, velocities: FloatArray
) -> MovingBodies:
    """Return the velocities of the touching bodies in motions N (6 + L, d) of object and joints."""
    hand, contacts = scene.hand, contacts_of(scene).arrays
    turns = np.zeros((len(contacts), 3, velocities.shape[1]))
    points = np.zeros_like(turns)
    hybrid = hybrid_contacts(problem)
    follows = np.isin(np.arange(len(contacts)), hybrid[hybrid >= 0])
    if hand is None:
        return MovingBodies(None, [], np.zeros((0, velocities.shape[1])), turns, points, follows)
    rates = hand.actuation.from_joints @ velocities[6 : 6 + len(hand.actuation.names)]
    columns = JointColumns(hand)
    links = [hand.tree.link_joints[name] for name in contacts.bodies[: contacts.hand_count]]
    for contact, link in enumerate(links):
        turns[contact] = columns.rotation(link) @ rates
        points[contact] = columns.velocity(link, contacts.positions[contact]) @ rates
    for contact in np.flatnonzero(follows).tolist():
        normal, lever = problem.normals[contact], problem.positions[contact]
        point_velocities = velocities[:3] + np.cross(velocities[3:6], lever, axis=0)
        turns[contact], points[contact] = 0.0, np.outer(normal, normal @ point_velocities)
    return MovingBodies(columns, links, rates, turns, points, follows)


def refuse_flat_on_flat(
    scene: SceneFields,
    problem: QuasistaticProblem,
    rolling: Rolling,
    velocities: FloatArray,
    bodies: MovingBodies,
    bears: NDArray[np.bool_] | None = None,
) -> None:
    """Refuse motions about a tangent where both surfaces are flat: the contact point would jump.

    With ``bears``, (M,), only contacts that bear load are checked.

    Raises:
        SceneError: Naming the body.
    """
    across = np.cross(velocities[3:6] - bodies.turns, problem.normals[:, :, None], axis=1)
    moves = rolling.rolling_matrix @ np.einsum("mit,mid->mtd", problem.tangents, across)
    distance = np.linalg.norm(moves, axis=1).max(axis=1, initial=0.0)
    if bears is not None:
        distance[~bears] = 0.0
    if distance.max(initial=0.0) > np.sqrt(FLAT) * motion_length(problem):
        body = contacts_of(scene).bodies[int(np.argmax(distance))]
        raise SceneError(
            f"{label_of(scene)}: one contact represents a line or a face on {body!r}, about which "
            "the object tips; use shapes with contacts at its ends, or round shapes"
        )


def geometric_stiffness(
    scene: SceneFields,
    problem: QuasistaticProblem,
    rolling: Rolling,
    velocities: FloatArray,
    bodies: MovingBodies,
) -> tuple[FloatArray, FloatArray]:
    """Return the stiffness (M, 3, d, d) of unit contact forces, (d, d) of loads and links' weight.

    Rows are motions that do work, columns motions along which forces change.
    """
    linear, angular = velocities[:3], velocities[3:6]
    count, size = problem.contact_count, velocities.shape[1]
    force_stiffness, constant = np.zeros((count, 3, size, size)), np.zeros((size, size))
    contacts, columns = contacts_of(scene).arrays, bodies.columns
    shares, moves = rolling.inverse_radii_sum, rolling.rolling_matrix
    for contact in range(count):
        normal, tangents = problem.normals[contact], problem.tangents[contact]
        object_velocity = linear + np.cross(angular, problem.positions[contact], axis=0)
        across = tangents.T @ np.cross(angular - bodies.turns[contact], normal, axis=0)
        point = object_velocity + tangents @ (moves[contact] @ across)
        stiffness = force_stiffness[contact]
        if not problem.has_cone[contact]:
            # Without friction the contact slips, and its force turns with the normal.
            relative_velocity = object_velocity - bodies.points[contact]
            slip = tangents.T @ relative_velocity
            point = point - tangents @ (rolling.object_radii[contact] @ shares[contact] @ slip)
            swing = shares[contact] @ (rolling.body_radii[contact] @ across - slip)
            turned = np.cross(angular, normal, axis=0) - tangents @ swing
            stiffness -= np.einsum("i,ja,jb->iab", normal, relative_velocity, turned)
        # The moment of a force that is fixed in the world changes with its point of attack.
        stiffness -= np.cross(angular.T[:, None], (point - linear).T[None]).transpose(2, 0, 1)
        moves_by_joints = contact < len(bodies.links) and not bodies.follows[contact]
        if columns is not None and moves_by_joints:
            stiffness += columns.change_of_velocities(
                bodies.links[contact], contacts.positions[contact], point, bodies.rates
            )
    constant -= velocities[:6].T @ load_rates(scene, angular)
    if scene.hand is not None and columns is not None and scene.count_own_weight:
        constant -= _weight_stiffness(scene, scene.hand, columns, bodies.rates)
    return force_stiffness, constant


def _weight_stiffness(
    scene: SceneFields, hand: Hand, columns: JointColumns, rates: FloatArray
) -> FloatArray:
    """Return the (d, d) stiffness of the links' weight: change of its work along motions.

    Inertial forces of accelerating links are taken as constant.
    """
    masses, centers = hand.tree.masses
    motions = hand_motion(scene)
    inertial = None if motions is None else motions.inertial_wrenches(hand)
    total = np.zeros((rates.shape[1],) * 2)
    is_moved = (hand.tree.supports[:, rates.any(axis=1)]).any(axis=1)
    for link in np.flatnonzero(is_moved & (masses > 0.0)).tolist():
        T = columns.T_world_joint[link]
        center = T[:3, :3] @ centers[link] + T[:3, 3]
        velocity = columns.velocity(link, center) @ rates
        changes = columns.change_of_velocities(link, center, velocity, rates)
        force = masses[link] * scene.gravity
        if inertial is not None:
            force = force + inertial[link, :3]
            turning = columns.change_of_rotations(link, rates)
            total += np.einsum("i,iab->ab", inertial[link, 3:], turning)
        total += np.einsum("i,iab->ab", force, changes)
    return total
