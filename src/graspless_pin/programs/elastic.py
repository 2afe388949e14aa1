"""The elastic program: the smallest common violation of all rows, and its proof."""

from __future__ import annotations

import numpy as np

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.program import Program


def elastic(program: Program) -> Program:
    """Return the program that finds the smallest common violation of all rows.

    One variable s >= 0 is added: -s <= A x - b <= s, l - s <= G x <= u + s, bounds kept, s
    minimised. It always has a solution; a positive proven bound on s proves that the original
    program has none.
    """
    m, n = program.A.shape
    k = len(program.G)
    one = np.ones((m, 1))
    finite_u, finite_l = np.isfinite(program.u), np.isfinite(program.l)
    rows = np.vstack(
        [
            np.hstack([program.A, -one]),
            np.hstack([-program.A, -one]),
            np.hstack([program.G, -np.ones((k, 1))])[finite_u],
            np.hstack([-program.G, -np.ones((k, 1))])[finite_l],
        ]
    )
    sides = np.concatenate([program.b, -program.b, program.u[finite_u], -program.l[finite_l]])
    low, high = program.reach if program.whole_box is None else program.within(program.whole_box)
    reach = np.maximum(np.abs(low), np.abs(high))
    worst = float((np.abs(rows[:, :n]) @ reach + np.abs(sides)).max(initial=0.0)) + 1.0
    return Program(
        P=np.zeros(n + 1),
        c=np.append(np.zeros(n), 1.0),
        A=np.zeros((0, n + 1)),
        b=np.zeros(0),
        G=rows,
        l=np.full(len(rows), -np.inf),
        u=sides,
        lb=np.append(low, 0.0),
        ub=np.append(high, worst),
        box=np.vstack([np.append(low, 0.0), np.append(high, worst)]),
    )


def elastic_multipliers(program: Program, multipliers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return multipliers of a program's own rows, A and G, from those of its elastic program.

    Args:
        program: The program.
        multipliers: Of the rows of `elastic`.
    """
    m, up, down = len(program.b), np.isfinite(program.u), np.isfinite(program.l)
    weights = np.maximum(multipliers, 0.0)
    y = weights[:m] - weights[m : 2 * m]
    z = np.zeros(len(program.u))
    z[up] += weights[2 * m : 2 * m + int(up.sum())]
    z[down] -= weights[2 * m + int(up.sum()) :]
    return y, z
