"""The contact frames' view of a problem, which virtual motions and force programs start from."""

from __future__ import annotations

import numpy as np

from graspless_pin.compiled import contact_frames
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.quasistatic import QuasistaticProblem


def contact_map(problem: QuasistaticProblem) -> FloatArray:
    """Return [W^T, J] of eq. (22) in contact frames, made once for a problem.

    Times [V; -theta_dot] it is the velocity of the object relative to the other body along n, t1,
    t2; its rows, transposed, are the wrench and the joint torques of unit forces along them.

    Returns:
        (M, 3, 6 + L) read-only.
    """
    known: FloatArray | None = problem.scratch.get("contact_map")
    if known is None and contact_frames is not None:
        known = problem.scratch["contact_map"] = read_only(
            contact_frames.contact_map(
                problem.positions, problem.normals, problem.tangents, problem.jacobian
            )
        )
    if known is None:
        count, joints = problem.contact_count, problem.joint_count
        world = np.empty((count, 3, 6 + joints))
        world[:, :, :6] = problem.W.T.reshape(count, 3, 6)
        world[:, :, 6:] = problem.jacobian.reshape(count, 3, joints)
        known = problem.scratch["contact_map"] = read_only(
            problem.frames.transpose(0, 2, 1) @ world
        )
    return known
