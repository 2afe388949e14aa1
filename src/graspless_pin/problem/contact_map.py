"""The contact frames' view of a problem, which virtual motions and force programs start from."""

from __future__ import annotations

import numpy as np

from graspless_pin.caching import Derived
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.quasistatic import QuasistaticProblem


def contact_map(problem: QuasistaticProblem) -> FloatArray:
    """Return [W^T, J] of eq. (22) in contact frames, made once for a problem in use.

    Times [V; -theta_dot] it is the velocity of the object relative to the other body along n, t1,
    t2; its rows, transposed, are the wrench and the joint torques of unit forces along them.

    Returns:
        (M, 3, P + L) read-only.
    """
    return _MAPS.of(problem)


def _assembled(problem: QuasistaticProblem) -> FloatArray:
    count, passive, joints = problem.contact_count, problem.passive_count, problem.joint_count
    world = np.empty((count, 3, passive + joints))
    world[:, :, :passive] = problem.W.T.reshape(count, 3, passive)
    world[:, :, passive:] = problem.jacobian.reshape(count, 3, joints)
    return read_only(problem.frames.transpose(0, 2, 1) @ world)


_MAPS = Derived(_assembled)
