"""Easier programs that solvers are asked for in the place of a program, and the way back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.program import FARTHEST, LARGEST_FIGURE, Program

UNREACHED = 1e12
"""Stands for a limit that is out of reach."""


def without_fixed(program: Program) -> tuple[Program, NDArray[np.bool_] | None]:
    """Drop the variables that their bounds fix at zero; also return which are kept.

    Returns:
        The smaller program, and (n,) which variables it has; None: all.
    """
    fixed = (program.lb == 0.0) & (program.ub == 0.0)
    if not fixed.any():
        return program, None
    kept = ~fixed
    smaller = Program(
        P=program.P[kept],
        c=program.c[kept],
        A=np.asfortranarray(program.A[:, kept]),
        b=program.b,
        G=np.asfortranarray(program.G[:, kept]),
        l=program.l,
        u=program.u,
        lb=program.lb[kept],
        ub=program.ub[kept],
        box=program.box[:, kept],
        whole_box=None if program.whole_box is None else program.whole_box[:, kept],
        cone_count=program.cone_count,
    )
    return smaller, kept


def without_far_limits(program: Program) -> Program:
    """Return the program without the limits that are too far away for double precision.

    Solvers are asked for this one, and their answers are held against all limits.
    """
    if not program.is_far:
        return program
    # A row without sides is kept, where other programs of the structure have one, and gets one
    # that nothing reaches; an empty row one that does not slow interior points down. A limit
    # that is far on its wrong side cannot be met: any far figure says so.
    least, high = np.where(program.l < -FARTHEST, -np.inf, program.l), program.u.copy()
    high[high > FARTHEST] = np.inf
    free = np.isinf(least) & np.isinf(high)
    high[free] = np.where(program.G[free].any(axis=1), UNREACHED, 1.0)
    most, upper = program.lb.copy(), program.ub.copy()
    most[most < -FARTHEST], upper[upper > FARTHEST] = -np.inf, np.inf
    return replace(
        program,
        l=np.minimum(least, UNREACHED),
        lb=np.minimum(most, UNREACHED),
        u=np.maximum(high, -UNREACHED),
        ub=np.maximum(upper, -UNREACHED),
    )


def clipped(program: Program) -> Program | None:
    """Return a program without figures that no solver bears; None where it hangs on them.

    Libraries below crash on them or print. Limits so far away are left out, as if there were none.
    """
    if not program.has_rows_in_range:
        return None
    if not program.is_far:
        return program
    if program.has_sides_beyond(LARGEST_FIGURE):
        program = _without_sides_beyond(program, LARGEST_FIGURE)
    return None if program.has_sides_beyond(LARGEST_FIGURE) else program


def _without_sides_beyond(program: Program, size: float) -> Program:
    """Return a program whose limits that are farther away than a size are none."""
    flat = program.flat_count
    low, high = program.l.copy(), program.u.copy()
    low[:flat][low[:flat] < -size], high[:flat][high[:flat] > size] = -np.inf, np.inf
    high[np.isinf(low) & np.isinf(high)] = UNREACHED
    lb = np.where(program.lb < -size, -np.inf, program.lb)
    return replace(
        program, l=low, u=high, lb=lb, ub=np.where(program.ub > size, np.inf, program.ub)
    )


def near_multipliers(program: Program, z: FloatArray) -> FloatArray:
    """Return multipliers of G without those of sides that `without_far_limits` leaves out.

    They are a solver's noise, which a far side would make as large as the objective.
    """
    far = ((z > 0.0) & (program.u > FARTHEST)) | ((z < 0.0) & (program.l < -FARTHEST))
    return np.where(far, 0.0, z)


def rescaled(program: Program, factor: float) -> Program:
    """Return the program in variables that are smaller by a factor; its multipliers stay.

    Args:
        program: The program.
        factor: Positive; the value becomes smaller by it, too.
    """
    return replace(
        program,
        P=program.P * factor,
        b=program.b / factor,
        l=program.l / factor,
        u=program.u / factor,
        lb=program.lb / factor,
        ub=program.ub / factor,
        box=program.box / factor,
        whole_box=None if program.whole_box is None else program.whole_box / factor,
    )
