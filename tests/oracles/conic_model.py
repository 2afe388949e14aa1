"""Round cones as an independent model: CVXPY, solved by SCS, straight from the paper's matrices."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from graspless_pin import QuasistaticProblem
from graspless_pin.modes.rules import SlidingMode

_ACCURACY = 1e-10
_ITERATIONS = 500_000


def conic_optimum(
    problem: QuasistaticProblem, margin: float | None, mode: SlidingMode | None = None
) -> float | None:
    """Return the largest margin (N), or the smallest largest torque (N m) at a required margin.

    Args:
        problem: The problem; whatever its `cone` says, the cones are round.
        margin: Required margin, N; None: maximise it.
        mode: Friction opposes this mode; None: Coulomb's law alone.

    Returns:
        None where SCS finds nothing feasible; NaN where it does not come to its accuracy.
    """
    import cvxpy  # every test process loads this module, and few of them solve

    M, F = problem.contact_count, float(np.linalg.norm(problem.external_wrench[:3]))
    # Forces over the load, so that accuracies mean the same everywhere.
    f = cvxpy.Variable(3 * M)
    e: Any = cvxpy.Variable() if margin is None else margin / F
    constraints: list[Any] = [problem.W @ f == -problem.external_wrench / F]
    for contact in range(M):
        own, n = f[3 * contact : 3 * contact + 3], problem.normals[contact]
        mu, normal, along = problem.friction[contact], n @ own, problem.tangents[contact].T @ own
        constraints += [normal >= e, normal <= problem.max_normal_force[contact] / F - e]
        if problem.is_sliding[contact]:
            way = problem.sliding[contact] / np.linalg.norm(problem.sliding[contact])
            constraints.append(own == normal * (n - mu * way))
        elif mu == 0.0:
            constraints.append(along == 0.0)
        else:
            reach = mu * normal - np.sqrt(1.0 + mu**2) * e
            constraints.append(cvxpy.SOC(reach, along))
            if mode is not None:
                constraints += [
                    along[k] * -sign >= 0.0 if sign else along[k] == 0.0
                    for k, sign in enumerate(mode.signs[contact].tolist())
                ]
    torque = problem.J.T @ f + problem.gravity_torques / F
    lower, upper = problem.lower_torque / F, problem.upper_torque / F
    constraints += [torque >= lower, torque <= upper]
    aim = cvxpy.Maximize(e) if margin is None else cvxpy.Minimize(cvxpy.norm_inf(torque))
    model = cvxpy.Problem(aim, constraints)
    with warnings.catch_warnings():
        # What it reaches is compared with what the package proves.
        warnings.filterwarnings("ignore", message="Solution may be inaccurate")
        model.solve(solver="SCS", eps_abs=_ACCURACY, eps_rel=_ACCURACY, max_iters=_ITERATIONS)
    if model.status.endswith("_inaccurate"):
        return np.nan
    value: Any = model.value
    return F * float(value) if model.status == "optimal" else None
