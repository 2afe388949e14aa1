"""Margin against torque: Algorithms 1 and 2 as one program with the margin as a variable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.programs.force_programs import ForceCoordinates, torque_program
from graspless_pin.programs.program import Program


def tradeoff_program(
    problem: QuasistaticProblem, coordinates: ForceCoordinates, *, by_limits: bool
) -> Program:
    """Algorithm 2 (45) without (27) and (31) with the margin e / F >= 0 as one more variable.

    Variables are the force coordinates, t and e / F, in this order; the objective is t.
    """
    base = torque_program(problem, coordinates, 0.0, 0.0, by_limits=by_limits)
    count, bare = problem.contact_count, ~problem.has_cone
    size = len(base.c) - 1
    cones = int(problem.has_cone.sum()) * problem.cone_edges
    limit = problem.max_normal_force / coordinates.force_scale
    # Faces take -e on their right-hand side; so do both ends of the normal force, (36) and (42).
    faces = np.zeros((len(base.G), 1))
    faces[:cones] = 1.0
    normal = np.zeros((count, size + 2))
    normal[np.arange(count), coordinates.normal] = 1.0
    low = -normal[bare]
    normal[:, -1] = 1.0
    low[:, -1] = 1.0
    least, most = base.lb.copy(), base.ub.copy()
    least[coordinates.normal] = -np.inf
    most[coordinates.normal] = np.inf
    G = np.vstack([np.hstack([base.G, faces]), normal, low])
    return Program(
        P=np.zeros(size + 2),
        c=np.append(base.c, 0.0),
        A=np.asfortranarray(np.hstack([base.A, np.zeros((len(base.A), 1))])),
        b=base.b,
        G=np.asfortranarray(G),
        l=np.concatenate([base.l, np.full(count + len(low), -np.inf)]),
        u=np.concatenate([base.u, limit, np.zeros(len(low))]),
        lb=np.append(least, 0.0),
        ub=np.append(most, np.inf),
        box=np.hstack([base.box, [[0.0], [float(limit.min()) / 2.0]]]),
    )


def aimed(
    program: Program, torque: float, margin: float, low: float = 0.0, high: float = np.inf
) -> Program:
    """Return the trade-off with the objective torque * t + margin * e / F, low <= e / F <= high."""
    c = program.c.copy()
    c[-2:] = torque, margin
    lb, ub = program.lb.copy(), program.ub.copy()
    lb[-1], ub[-1] = low, high
    return replace(program, c=c, lb=lb, ub=ub)
