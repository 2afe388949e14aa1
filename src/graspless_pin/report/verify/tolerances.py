"""Every tolerance of the checker, from the problem alone.

Loads, limits, geometry and options set them, and no figure of the answer does: otherwise an answer
of large forces would be checked less strictly. Relative ones are relative to what the checker has
worked out or proven itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify.problem import Problem

LONGEST_REACH = 1e8
"""Of the load: bounds have to be proven for normal forces up to this."""

SHARE = 1e-6
"""Of the load: smaller violations count as none."""
ARITHMETIC = 1e-9
"""Of the load: figures that follow from others by plain arithmetic agree to this."""
SAME = 1e-9
"""Relative: rounding difference between two ways of working out one figure."""
FRAMES = 3e-6
"""Largest error of an entry of orthonormal frames."""
UNIT = 1e-9
"""Largest error of the length of a unit vector."""
EXACT = 1e-8
"""Of the load: what may stay unbalanced where no inertia is known."""
ANGLE = 1e-14
"""Gap between arcs that count as adjoining, rad: less than the rounding of their ends."""
SLOWEST = 1e-6
"""Of the norm of all velocities: slower sliding does not count."""
STILL = 1e-8
"""Of the norm of all velocities: slower ones count as zero."""
IDLE = 1e-12
"""Of the longest lever: joints with shorter ones bear no contact force."""
LEAST_TORQUE = 1e-6
"""Of the largest torque of load or weight: smallest unit of joint torques."""
RANK = 1e-8
"""Of the largest singular value of the motions: smaller ones count as zero."""
GROWTH = 0.1
"""Smaller growth rates of motions do not count as growth, 1/s."""
GAIN = 1e-3
"""Relative: tolerance of gains at the ends of stable ranges."""
WITHOUT_SLIP = 1e-5
"""Of the velocities of object and joints: largest one at contacts that neither slip nor open."""
BEARING = 5e-5
"""Of the load: contacts that bear less guide no motion."""
MOTION_RANK = 1e-7
"""Of the largest singular value: directions with less are motions without slip."""
FREE_RANK, FREE_ENTRY = 1e-13, 1e-12
"""Of the largest singular value, and of the largest entry: smaller ones count as zero in free
motions of joints. The power of contacts along these is counted in any case."""
LEAST_ASIDE = 1e-7
"""Scaled: smaller free accelerations of joints are not separated."""
NO_SLIP, NO_SLIP_SHARE = 1e-12, 1e-2
"""Scaled slips of a patch's contacts that count as none, and their largest share of the power up to
which nothing moves. Their effect is counted."""
LEAST_LOAD = 1e-9
"""Scaled: load that the first trial of a multiplier assumes at least."""
PROJECTED = 1e-14
"""Of the length of a combination of velocities: rounding error of its projection."""
COARSEST, FINEST = 0.01, 1e-6
"""Accelerations that count as rest, as shares of load over mass: the largest for a strong verdict,
and the smallest for any."""
BEYOND = 1e-3
"""Of a magnitude of disturbance, or of the one that makes a load: step beyond it that excludes
rest."""
_FINEST_LIMIT = 1e-3
"""Of the largest limit: smaller limits have the tolerance of this."""
_MOST_LOADS = 1e6
"""Largest ratio of a load to a limit that can be resolved beside it."""
_MOTION = 1e-3
"""Of the accelerations that count as rest: tolerance of a motion."""
_DOUBLE = 8.0 * float(np.finfo(float).eps)
LONG = 8.0 * float(np.finfo(np.longdouble).eps)
PRODUCT = _DOUBLE
"""Of the length of a column: smaller entries of it along normals and tangents are rounding."""
PRODUCTS = 8.0 * _DOUBLE
"""Of the norms of two matrices of motions, times their number: rounding error of the product."""
STATED = _DOUBLE
"""Relative: subtracted from stated figures, which then pass without a longer format, too."""


def rounding_error(sizes: Any) -> Any:
    """Return the rounding error of sums of terms of these sizes, in the longest format.

    It always counts against the document: it is added to what must be small, and subtracted from
    what must be large.
    """
    return LONG * sizes


def force(problem: Problem) -> float:
    """Return the tolerance of forces in balance, cones and margins, N."""
    return SHARE * problem.force


def bearing_force(problem: Problem) -> float:
    """Return the least normal force with which a contact guides small motions, N."""
    return BEARING * problem.force


def moment(problem: Problem) -> float:
    """Return the tolerance of moments in their balance, N m."""
    return SHARE * problem.force * problem.length


def normal_limits(problem: Problem) -> np.ndarray:
    """(M,) tolerances of the limits of normal forces, N."""
    scale = np.maximum(problem.limit, _FINEST_LIMIT * problem.limit.max())
    return SHARE * np.minimum(problem.force, scale)


def torque_limits(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """(L,) tolerances of the lower and of the upper torque limits, N m (N).

    To a millionth of what the load makes or of the limit, whichever is smaller, but never finer
    than to 1e-9 of the largest limit that joints of the same unit have.
    """
    sizes = np.abs([problem.lower, problem.upper])
    scales = np.maximum(sizes, _FINEST_LIMIT * _largest_limits(problem, sizes))
    lower, upper = SHARE * np.minimum(problem.joint_scale, scales)
    return lower, upper


def are_limits_resolved(problem: Problem) -> bool:
    """Return whether every joint's limit exceeds the tolerance of the balance under the load."""
    limits = np.minimum(*torque_limits(problem)) / SHARE
    return bool((problem.joint_scale <= (1.0 + SAME) * _MOST_LOADS * limits).all())


def force_figure(problem: Problem) -> float:
    """Return the tolerance of a stated force that follows from others, N."""
    return ARITHMETIC * problem.force + _DOUBLE * float(_largest_forces(problem).sum())


def torque_figure(problem: Problem) -> np.ndarray:
    """(L,) tolerances of stated torques that follow from others, N m (N)."""
    made = np.einsum("lij,l->j", np.abs(problem.J), _largest_forces(problem))
    return ARITHMETIC * (problem.joint_scale + np.abs(problem.gravity)) + _DOUBLE * made


def objective(problem: Problem, *sides: float) -> float:
    """Return the tolerance of the objective against proven bounds, in its unit.

    Args:
        problem: The problem.
        sides: Bounds on the optimum from either side, of which the smaller size counts: so an
            answer that is far from the optimum widens no tolerance.
    """
    size = min((abs(one) for one in sides), default=0.0)
    return SHARE * max(problem.unit, size if np.isfinite(size) else 0.0)


def motion(resolution: float) -> float:
    """Return the tolerance of the laws of a moving outcome, as a share of the load.

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


def _largest_forces(problem: Problem) -> np.ndarray:
    """(M,) largest forces that answers may have, N."""
    return np.minimum(problem.limit, LONGEST_REACH * problem.force) * np.sqrt(1.0 + problem.mu**2)
