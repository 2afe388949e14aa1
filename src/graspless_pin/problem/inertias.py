"""Columns of J: joints with an inertia, and normal-force commands of hybrid fingers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import SINGULAR, FloatArray, with_unit_diagonal
from graspless_pin.problem.quasistatic import QuasistaticProblem
from graspless_pin.problem.scales import passive_levers

_NORMAL_TOLERANCE = 1e-9


def hybrid_contacts(problem: QuasistaticProblem) -> NDArray[np.intp]:
    """Return the contact whose normal force each column of J commands.

    A hybrid finger's column has no inertia (its row and column of `joint_inertia` are zero), equals
    the normal of one contact and is the only column that acts there.

    Returns:
        (L,) index of the contact, -1 for joints; without `joint_inertia` all columns are joints.
    """
    contacts = np.full(problem.joint_count, -1, dtype=np.intp)
    inertia = problem.joint_inertia
    if inertia is None:
        return contacts
    blocks = problem.jacobian.reshape(problem.contact_count, 3, problem.joint_count)
    acts = (blocks != 0.0).any(axis=1)
    for column in np.flatnonzero(~inertia.any(axis=0)).tolist():
        (where,) = np.nonzero(acts[:, column])
        if (
            len(where) == 1
            and acts[where[0]].sum() == 1
            and np.abs(blocks[where[0], :, column] - problem.normals[where[0]]).max()
            <= _NORMAL_TOLERANCE
        ):
            contacts[column] = where[0]
    return contacts


def commanded_forces(problem: QuasistaticProblem, torques: FloatArray) -> FloatArray:
    """Return the (M,) normal forces that hybrid fingers command, N; zero elsewhere.

    Args:
        problem: Contacts and joints.
        torques: (L,) motor torques, N m (N).
    """
    forces, contacts = np.zeros(problem.contact_count), hybrid_contacts(problem)
    columns = np.flatnonzero(contacts >= 0)
    forces[contacts[columns]] = (torques - problem.gravity_torques)[columns]
    return forces


def moving_joints(problem: QuasistaticProblem) -> NDArray[np.intp]:
    """Return the (k,) columns of J that are joints with an inertia: all but hybrid fingers'.

    Raises:
        ArgumentError: If their inertia is missing or singular, naming the joint.
    """
    inertia = problem.joint_inertia
    if inertia is None:
        raise ArgumentError("joint_inertia", "is missing; accelerations require it")
    joints = np.flatnonzero(hybrid_contacts(problem) < 0)
    joint_inertia = inertia[np.ix_(joints, joints)]
    massless = joint_inertia.diagonal() <= 0.0
    values, vectors = np.linalg.eigh(with_unit_diagonal(joint_inertia))
    singular = not massless.any() and values.min(initial=1.0) < SINGULAR
    if massless.any() or singular:
        worst = int(np.argmax(np.abs(vectors[:, 0]) if singular else massless))
        raise ArgumentError(
            "joint_inertia",
            f"is singular at joint {problem.joint_names[joints[worst]]!r}: "
            + ("together with others it moves no mass" if singular else "it moves no mass")
            + "; give its links an inertia (<inertial> in the URDF) or its motor one "
            "(hand.armature in the scene)",
        )
    return joints


def largest_mass(problem: QuasistaticProblem) -> float | None:
    """Return the mass of the object, kg; None if its inertia is not known.

    For other passive coordinates it is the largest diagonal entry of the inertia in kg, or, if all
    loads are in N m, the largest entry over the square of the length scale.
    """
    inertia = problem.object_inertia
    if inertia is None:
        return None
    if problem.wrench_matrix is None:
        return float(inertia[0, 0])
    levers = passive_levers(problem.passive_units, problem.scales.length)
    masses = inertia.diagonal() / levers**2
    return float(masses[problem.passive_turns.all() | ~problem.passive_turns].max())


def whole_inertia(problem: QuasistaticProblem) -> FloatArray | None:
    """Return the (P + L, P + L) inertia of object and joints; None if a part of it is not known.

    Raises:
        ArgumentError: If the joints' inertia is singular; see `moving_joints`.
    """
    passive, joints, own = problem.passive_count, problem.joint_count, problem.object_inertia
    if own is None or (problem.joint_inertia is None and joints):
        return None
    inertia = np.zeros((passive + joints, passive + joints))
    inertia[:passive, :passive] = own
    if problem.joint_inertia is not None:
        moving_joints(problem)
        inertia[passive:, passive:] = problem.joint_inertia
    return inertia
