"""How far figures may be off: every tolerance of the checker, from the problem alone.

Loads, limits and geometry set them, and what was asked for. Nothing that a document says of its own
answer does: else an answer of large forces would be held to less. What is relative is relative to
what the checker has worked out or proven itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify.problem import Problem

LONGEST_REACH = 1e8
"""Bounds need to be proven for normal forces up to so many loads."""

SHARE = 1e-6
"""Of the load: what counts as met."""
ARITHMETIC = 1e-9
"""Of the load: figures that follow from others by plain arithmetic agree to this."""
SAME = 1e-9
"""Relative: what rounding leaves between two ways of working out one figure."""
FRAMES = 3e-6
"""Entries of frames that are orthonormal."""
UNIT = 1e-9
"""Lengths of directions that are units."""
EXACT = 1e-8
"""Of the load: what is left of it, where no inertia tells what is moved by that."""
ANGLE = 1e-14
"""Arcs that touch may be so far apart, rad: less than rounding leaves of their ends."""
SLOWEST = 1e-6
"""Of all velocities: sliding that counts."""
STILL = 1e-8
"""Of all velocities: those that have to be zero."""
IDLE = 1e-12
"""Of the longest lever: joints on shorter ones bear no contact force."""
LEAST_TORQUE = 1e-6
"""Of the largest torque that load or weight makes: joints' torques are measured in no less."""
RANK = 1e-8
"""Of the largest way in which all velocities may change: smaller ones are none."""
GROWTH = 0.1
"""Motions that grow no faster than this do not count as growing, 1/s."""
GAIN = 1e-3
"""Relative: how near gains are to the ends of those that are stable."""
WITHOUT_SLIP = 1e-5
"""Of the velocities of object and joints: what contacts may have that neither slip nor open."""
BEARING = 5e-5
"""Of the load: contacts that bear less guide no motion."""
MOTION_RANK = 1e-7
"""Of the largest singular value: directions with less are motions without slip."""
FREE_RANK, FREE_ENTRY = 1e-13, 1e-12
"""Of the largest singular value, and of the largest entry: smaller ones count as zero in what
joints do by themselves. What contacts do along it is counted whatever it is."""
LEAST_ASIDE = 1e-7
"""Scaled accelerations of joints by themselves that are worth leaving aside."""
NO_SLIP, NO_SLIP_SHARE = 1e-12, 1e-2
"""Scaled slips of a patch's contacts that count as none, and no more than so much of the power up
to which nothing moves. What it costs is counted."""
LEAST_LOAD = 1e-9
"""Scaled: multipliers are first tried as if the load were no smaller than this."""
PROJECTED = 1e-14
"""Of the length of a combination of velocities: what rounding may hide of its projection."""
COARSEST, FINEST = 0.01, 1e-6
"""Accelerations that count as rest, as shares of load over mass: where rest is said to be certain,
and anywhere."""
BEYOND = 1e-3
"""Of a magnitude of disturbance, or of what makes a load: so far beyond it rest is ruled out."""
_FINEST_LIMIT = 1e-3
"""Of the largest limit: a smaller one is held to no less than this."""
_MOST_LOADS = 1e6
"""More loads than a limit, and the limit cannot be told beside them."""
_MOTION = 1e-3
"""Of the accelerations that count as rest: what a motion may lack."""
_DOUBLE = 8.0 * float(np.finfo(float).eps)
LONG = 8.0 * float(np.finfo(np.longdouble).eps)
PRODUCT = _DOUBLE
"""Of the length of a column: smaller entries of it along normals and tangents are rounding."""
PRODUCTS = 8.0 * _DOUBLE
"""Of the sizes of two matrices of motions, times how many: what rounding may hide of a product."""
STATED = _DOUBLE
"""Taken off a figure before it is stated, so that it passes where there is no longer format."""


def lost(sizes: Any) -> Any:
    """Return what rounding may hide in sums of terms of these sizes, in the longest format.

    It is never in a document's favour: it is added to what must be small, and taken off what must
    be large.
    """
    return LONG * sizes


def force(problem: Problem) -> float:
    """Return by how much forces may miss balance, cones and margins, N."""
    return SHARE * problem.force


def bearing(problem: Problem) -> float:
    """Return the normal force from which on a contact guides small motions, N."""
    return BEARING * problem.force


def moment(problem: Problem) -> float:
    """Return by how much moments may miss their balance, N m."""
    return SHARE * problem.force * problem.length


def normal_limits(problem: Problem) -> np.ndarray:
    """(M,) by how much normal forces may exceed their limits, N."""
    scale = np.maximum(problem.limit, _FINEST_LIMIT * problem.limit.max())
    return SHARE * np.minimum(problem.force, scale)


def torque_limits(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """(L,) by how much torques may be below the lower and above the upper limits, N m (N).

    To a millionth of what the load makes or of the limit, whichever is smaller, but never finer
    than to 1e-9 of the largest limit that joints of the same unit have.
    """
    sizes = np.abs([problem.lower, problem.upper])
    scales = np.maximum(sizes, _FINEST_LIMIT * _largest_limits(problem, sizes))
    lower, upper = SHARE * np.minimum(problem.joint_scale, scales)
    return lower, upper


def resolved(problem: Problem) -> bool:
    """Return whether no joint's limit is lost in what the balance of such a load may miss."""
    limits = np.minimum(*torque_limits(problem)) / SHARE
    return bool((problem.joint_scale <= (1.0 + SAME) * _MOST_LOADS * limits).all())


def force_figure(problem: Problem) -> float:
    """Return how far a stated force may be from what it follows from, N."""
    return ARITHMETIC * problem.force + _DOUBLE * float(_farthest(problem).sum())


def torque_figure(problem: Problem) -> np.ndarray:
    """(L,) how far stated torques may be from what they follow from, N m (N)."""
    made = np.einsum("lij,l->j", np.abs(problem.J), _farthest(problem))
    return ARITHMETIC * (problem.joint_scale + np.abs(problem.gravity)) + _DOUBLE * made


def objective(problem: Problem, *sides: float) -> float:
    """Return how far the objective may be from what is proven of it, in its unit.

    Args:
        problem: The problem.
        sides: What holds the optimum from either side: its size is no more than the smaller of
            theirs. An answer of any size that is far from the optimum is held to this.
    """
    size = min((abs(one) for one in sides), default=0.0)
    return SHARE * max(problem.unit, size if np.isfinite(size) else 0.0)


def motion(resolution: float) -> float:
    """Return by how much a moving outcome may miss its laws, as a share of the load.

    Args:
        resolution: Accelerations that count as rest, as a share of load over mass.
    """
    return min(SHARE, _MOTION * resolution)


def _largest_limits(problem: Problem, sizes: np.ndarray) -> np.ndarray:
    """(L,) the largest finite torque limit of all joints of the same unit; inf where all are 0."""
    units, largest = np.array(problem.units), np.full(len(problem.units), np.inf)
    for unit in set(problem.units):
        own = sizes[:, units == unit]
        largest[units == unit] = float(own[np.isfinite(own)].max(initial=0.0)) or np.inf
    return largest


def _farthest(problem: Problem) -> np.ndarray:
    """(M,) sizes of the largest forces that answers may have, N."""
    return np.minimum(problem.limit, LONGEST_REACH * problem.force) * np.sqrt(1.0 + problem.mu**2)
