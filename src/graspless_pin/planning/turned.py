"""Problems and their solutions in other axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graspless_pin.algorithms.batch_optimum import WarmOptimum
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.own_arrays import problem_of_own_arrays
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.proof import DualVariables


def turned_problem(
    problem: QuasistaticProblem,
    R: FloatArray,
    *,
    jacobian: FloatArray | None = None,
    gravity_torques: FloatArray | None = None,
) -> QuasistaticProblem:
    """Return a problem of one free object, without inertias, in other axes.

    Args:
        problem: The problem; all its contacts bear the same normal force.
        R: (3, 3) turns vectors into those axes.
        jacobian: (3M, L) in the problem's axes; None: its own.
        gravity_torques: (L,) None: its own.
    """
    J = problem.jacobian if jacobian is None else jacobian
    blocks = J.reshape(len(problem.positions), 3, -1)
    return problem_of_own_arrays(
        problem.positions @ R.T,
        problem.normals @ R.T,
        _turned(problem.external_wrench, R),
        (R @ blocks).reshape(J.shape),
        friction=problem.friction,
        tangents=R @ problem.tangents,
        sliding=problem.sliding @ R.T,
        torque_limits=(problem.lower_torque, problem.upper_torque),
        max_normal_force=float(problem.max_normal_force[0]),
        cone_edges=problem.cone_edges,
        cone=problem.cone,
        joint_names=problem.joint_names,
        joint_units=problem.joint_units,
        gravity_torques=problem.gravity_torques if gravity_torques is None else gravity_torques,
    )


def turned_solution(
    solution: TorqueSolution, problem: QuasistaticProblem, R: FloatArray
) -> TorqueSolution:
    """Return the solution of a problem from that of the same problem in other axes.

    Args:
        solution: That.
        problem: The problem.
        R: (3, 3) turns vectors into the axes of the problem.
    """
    found, forces = solution.evidence, solution._forces
    evidence = replace(
        found,
        relaxation=_turned_multipliers(found.relaxation, R),
        in_mode=_turned_multipliers(found.in_mode, R),
        forces=None if found.forces is None else read_only(found.forces @ R.T),
        motion=None if found.motion is None else read_only(_turned(found.motion, R)),
    )
    forces = None if forces is None else read_only(forces @ R.T)
    return replace(solution, problem=problem, evidence=evidence, _forces=forces)


def turned_optimum(optimum: WarmOptimum, R: FloatArray) -> WarmOptimum:
    """Return an optimum in other axes.

    Args:
        optimum: The optimum.
        R: (3, 3) turns vectors into those axes.
    """
    motion = _turned(optimum.scale * optimum.motion, R)
    return optimum._replace(
        forces=optimum.forces @ R.T,
        multipliers=_turned(optimum.multipliers, R),
        motion=motion,
        scale=np.ones(len(motion)),
    )


def _turned_multipliers(multipliers: DualVariables | None, R: FloatArray) -> DualVariables | None:
    if multipliers is None:
        return None
    y, z = multipliers
    return read_only(_turned(y, R)), z


def _turned(vector: FloatArray, R: FloatArray) -> FloatArray:
    """Turn the first two vectors of three of (6 + k,) numbers; the others stay."""
    return np.concatenate([R @ vector[:3], R @ vector[3:6], vector[6:]])
