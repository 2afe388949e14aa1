"""The elastic program: the smallest common violation of all rows, and its proof."""

from __future__ import annotations

import numpy as np

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.program import Program


def elastic(program: Program) -> Program:
    """Return the program that finds the smallest common violation of all rows.

    One variable s >= 0 is added: -s <= A x - b <= s, l - s <= G x <= u + s, the first entries of
    cones larger by s, bounds kept, s minimised; rows that are strict have a share of s. It always
    has a solution; a positive proven bound on s proves that the original program has none.
    """
    m, n = program.A.shape
    k = program.flat_count
    G, u, low = program.G[:k], program.u[:k], program.l[:k]
    loose = np.ones(m + len(program.G)) if program.strict is None else 1.0 / program.strict
    one, ones = loose[:m, None], loose[m : m + k, None]
    finite_u, finite_l = np.isfinite(u), np.isfinite(low)
    larger = np.tile([1.0, 0.0, 0.0], program.cone_count)[:, None]
    rows = np.vstack(
        [
            np.hstack([program.A, -one]),
            np.hstack([-program.A, -one]),
            np.hstack([G, -ones])[finite_u],
            np.hstack([-G, -ones])[finite_l],
            np.hstack([program.G[k:], larger]),
        ]
    )
    sides = np.concatenate(
        [program.b, -program.b, u[finite_u], -low[finite_l], program.u[k:]],
    )
    least = np.full(len(rows), -np.inf)
    least[len(rows) - len(larger) :] = program.l[k:]
    first, last = program.reach if program.whole_box is None else program.within(program.whole_box)
    reach = np.maximum(np.abs(first), np.abs(last))
    worst = float((np.abs(rows[:, :n]) @ reach + np.abs(sides)).max(initial=0.0)) + 1.0
    worst /= float(loose.min())
    return Program(
        P=np.zeros(n + 1),
        c=np.append(np.zeros(n), 1.0),
        A=np.zeros((0, n + 1)),
        b=np.zeros(0),
        G=rows,
        l=least,
        u=sides,
        lb=np.append(first, 0.0),
        ub=np.append(last, worst),
        box=np.vstack([np.append(first, 0.0), np.append(last, worst)]),
        cone_count=program.cone_count,
    )


def elastic_multipliers(program: Program, multipliers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return multipliers of a program's own rows, A and G, from those of its elastic program.

    Args:
        program: The program.
        multipliers: Of the rows of `elastic`.
    """
    m, k = len(program.b), program.flat_count
    up, down = np.isfinite(program.u[:k]), np.isfinite(program.l[:k])
    last = len(multipliers) - 3 * program.cone_count
    weights = np.maximum(multipliers[:last], 0.0)
    y = weights[:m] - weights[m : 2 * m]
    z = np.zeros(k)
    z[up] += weights[2 * m : 2 * m + int(up.sum())]
    z[down] -= weights[2 * m + int(up.sum()) :]
    return y, np.concatenate([z, multipliers[last:]])
