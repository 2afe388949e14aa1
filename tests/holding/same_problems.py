"""The same bodies told otherwise: in another frame, in other units, contacts in another order."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin import QuasistaticProblem

Array = NDArray[np.float64]


class Otherwise(NamedTuple):
    """The same bodies, torques and units.

    Attributes:
        problem: The bodies.
        torques: (L,) in other units.
        force: How many of the other units of force one is.
        both: (6, 6) turns twists and wrenches.
    """

    problem: QuasistaticProblem
    torques: Array
    force: float
    both: Array


def told_otherwise(
    problem: QuasistaticProblem, torques: Array, rng: np.random.Generator
) -> Otherwise:
    """Turn the frame and each pair of tangents, put contacts in another order, change the units.

    Mass keeps its unit: forces and lengths of others make other times. What slides does so at
    another speed.
    """
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    both, order = np.kron(np.eye(2), turn), rng.permutation(problem.contact_count)
    force, length, speed = 10.0 ** rng.uniform(-3.0, 3.0, 3)
    scale = np.repeat([1.0, length], 3)
    assert problem.object_inertia is not None
    assert problem.joint_inertia is not None
    # Of a joint that slides, and of a hybrid finger, the torque is a force.
    slides = np.array([unit == "N" for unit in problem.joint_units], dtype=bool)
    lever = np.where(slides | ~problem.joint_inertia.any(axis=0), 1.0, length)
    angle = rng.uniform(0.0, 2.0 * np.pi, problem.contact_count)
    spin = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    tangents = np.einsum("ij,ljk,kml->lim", turn, problem.tangents, spin)
    rows = problem.jacobian.reshape(problem.contact_count, 3, problem.joint_count)
    turned = np.einsum("ij,ljk->lik", turn, rows)[order] * lever
    changed = problem.with_changes(
        positions=length * problem.positions[order] @ turn.T,
        normals=problem.normals[order] @ turn.T,
        tangents=tangents[order],
        sliding=speed * problem.sliding[order] @ turn.T,
        friction=problem.friction[order],
        external_wrench=force * scale * (both @ problem.external_wrench),
        jacobian=turned.reshape(3 * len(order), problem.joint_count),
        object_inertia=scale * (both @ problem.object_inertia @ both.T) * scale[:, None],
        joint_inertia=lever * problem.joint_inertia * lever[:, None],
        gravity_torques=force * lever * problem.gravity_torques,
        max_normal_force=force * problem.max_normal_force[order],
        torque_limits=(-np.inf, np.inf),
    )
    return Otherwise(changed, force * lever * torques, float(force), both)


def off_the_plane(
    problem: QuasistaticProblem, size: float, rng: np.random.Generator
) -> QuasistaticProblem:
    """Move each contact point by at most so much (m) along each axis."""
    moves = size * rng.uniform(-1.0, 1.0, problem.positions.shape)
    return problem.with_changes(positions=problem.positions + moves)
