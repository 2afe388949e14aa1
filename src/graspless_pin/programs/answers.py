"""Check a solver's answer to a program, and return what it proves.

No solver's status is trusted. An answer is accepted if it meets the constraints and its own
multipliers prove it optimal, by the dual bound over the box of the variables; infeasibility is
accepted if multipliers prove it: a Farkas certificate.

If the solver gives no certificate, the elastic program is solved: it minimises the common violation
of all rows. If its optimum is positive, its multipliers are a Farkas certificate.

Solvers are given an easier program in place of the original: without fixed variables, or without
limits that are too far away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray, all_within
from graspless_pin.programs.active_set_polish import polished_answer
from graspless_pin.programs.program import FARTHEST, LARGEST_FIGURE, Program
from graspless_pin.records import changed

UNREACHED = 1e12
"""Replaces the missing upper side of a row: no variable in its box reaches it."""


def without_fixed(program: Program) -> tuple[Program, NDArray[np.bool_] | None]:
    """Return the program without the variables that their bounds fix at zero.

    Returns:
        The smaller program, and an (n,) mask of the variables that it keeps; None: all.
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

    Solvers are given this program; their answers are checked against all limits.
    """
    if not program.is_far:
        return program
    # A row without sides is kept, so that the structure stays the same, with an upper side that is
    # never reached; an empty row gets a side that does not slow down interior-point solvers. A
    # limit that is far on its wrong side cannot be met, whatever its exact value.
    least, high = np.where(program.l < -FARTHEST, -np.inf, program.l), program.u.copy()
    high[high > FARTHEST] = np.inf
    free = np.isinf(least) & np.isinf(high)
    high[free] = np.where(program.G[free].any(axis=1), UNREACHED, 1.0)
    lower, upper = program.lb.copy(), program.ub.copy()
    lower[lower < -FARTHEST], upper[upper > FARTHEST] = -np.inf, np.inf
    return changed(  # its rows are the same
        program,
        "sides",
        "is_far",
        "reach",
        l=np.minimum(least, UNREACHED),
        lb=np.minimum(lower, UNREACHED),
        u=np.maximum(high, -UNREACHED),
        ub=np.maximum(upper, -UNREACHED),
    )


def within_solver_range(program: Program) -> Program | None:
    """Return a program without limits above `LARGEST_FIGURE`; None if other figures are larger.

    Solver libraries crash on such figures, or print. Limits that large are treated as infinite.
    """
    if not program.has_rows_in_range:
        return None
    if not program.is_far:
        return program
    if program.has_sides_beyond(LARGEST_FIGURE):
        program = _without_huge_limits(program)
    return None if program.has_sides_beyond(LARGEST_FIGURE) else program


def _without_huge_limits(program: Program) -> Program:
    """Return a program in which limits beyond `LARGEST_FIGURE` are infinite."""
    flat, size = program.flat_count, LARGEST_FIGURE
    low, high = program.l.copy(), program.u.copy()
    low[:flat][low[:flat] < -size], high[:flat][high[:flat] > size] = -np.inf, np.inf
    high[np.isinf(low) & np.isinf(high)] = UNREACHED
    lb = np.where(program.lb < -size, -np.inf, program.lb)
    return replace(
        program, l=low, u=high, lb=lb, ub=np.where(program.ub > size, np.inf, program.ub)
    )


def without_far_multipliers(program: Program, z: FloatArray) -> FloatArray:
    """Return multipliers of G, zero for the sides that `without_far_limits` removes.

    Those are a solver's noise; multiplied by a far side it may be as large as the objective.
    """
    is_removed = ((z > 0.0) & (program.u > FARTHEST)) | ((z < 0.0) & (program.l < -FARTHEST))
    return np.where(is_removed, 0.0, z)


def rescaled_program(program: Program, factor: float) -> Program:
    """Return the program in variables divided by a factor; its multipliers are the same.

    Args:
        program: The program.
        factor: Positive; the objective value is divided by it, too.
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


def elastic_program(program: Program) -> Program:
    """Return the elastic program, whose optimum is the smallest common violation of all rows.

    One variable s >= 0 is added: -s <= A x - b <= s, l - s <= G x <= u + s, the first entries of
    cones larger by s, bounds kept, s minimised; strict rows are relaxed by s over their strictness.
    It always has a solution; a positive proven bound on s proves that the original program has
    none.
    """
    m, n = program.A.shape
    k = program.flat_count
    G, u, low = program.G[:k], program.u[:k], program.l[:k]
    relaxation = np.ones(m + len(program.G)) if program.strict is None else 1.0 / program.strict
    equality_column, row_column = relaxation[:m, None], relaxation[m : m + k, None]
    finite_u, finite_l = np.isfinite(u), np.isfinite(low)
    cone_column = np.tile([1.0, 0.0, 0.0], program.cone_count)[:, None]
    rows = np.vstack(
        [
            np.hstack([program.A, -equality_column]),
            np.hstack([-program.A, -equality_column]),
            np.hstack([G, -row_column])[finite_u],
            np.hstack([-G, -row_column])[finite_l],
            np.hstack([program.G[k:], cone_column]),
        ]
    )
    sides = np.concatenate(
        [program.b, -program.b, u[finite_u], -low[finite_l], program.u[k:]],
    )
    least = np.full(len(rows), -np.inf)
    least[len(rows) - len(cone_column) :] = program.l[k:]
    first, last = (
        program.reach if program.whole_box is None else program.box_within_bounds(program.whole_box)
    )
    reach = np.maximum(np.abs(first), np.abs(last))
    largest_violation = float((np.abs(rows[:, :n]) @ reach + np.abs(sides)).max(initial=0.0)) + 1.0
    largest_violation /= float(relaxation.min())
    return Program(
        P=np.zeros(n + 1),
        c=np.append(np.zeros(n), 1.0),
        A=np.zeros((0, n + 1)),
        b=np.zeros(0),
        G=rows,
        l=least,
        u=sides,
        lb=np.append(first, 0.0),
        ub=np.append(last, largest_violation),
        box=np.vstack([np.append(first, 0.0), np.append(last, largest_violation)]),
        cone_count=program.cone_count,
    )


def elastic_multipliers(program: Program, multipliers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return multipliers (y, z) of a program's rows A and G from those of its elastic program.

    Args:
        program: The program.
        multipliers: Multipliers of the rows of `elastic_program`.
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


PRIMAL_TOLERANCE = 1e-7
"""Largest accepted violation of a constraint, in scaled units: of the load."""
GAP_TOLERANCE = 1e-7
"""Largest accepted distance between an objective and its proven bound, in scaled units, or relative
to the objective where that is larger."""
_LARGEST_GAP = 5e-7
"""Half of the checker's tolerance for documents, as it rounds in another order."""
_BOUND_ROUNDING = 1e-14
"""Rounding error of a bound, relative to the largest variable that it is proven for."""
_LEAST_VIOLATION = 1e-8
_SHRINKING_FACTORS = (1e3, 1e6)
_LARGEST_ANSWER = 1e100
"""Larger figures overflow in products; NaN fails this limit, too."""

Multipliers = tuple[FloatArray, FloatArray, FloatArray]
"""A solution x and the multipliers of the equalities and of the rows, as a solver returned them."""
Backend = Callable[[Program], Multipliers | None]
"""A solver: returns its answer, or None if it has none."""


class Outcome(Enum):
    """What an answer proves about its program."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass(frozen=True, eq=False)
class Answer:
    """A checked answer to a program.

    Attributes:
        outcome: What it proves.
        x: (n,) solution; empty unless solved.
        y: (m,) multipliers of the equalities: of the bound, or of the proof where infeasible.
        z: (k,) multipliers of the inequality rows, positive on the upper side.
        value: Objective at x; inf unless solved.
        bound: Proven lower bound on the objective.
        residual: Largest violation of a constraint at x, scaled units.
        proof: Proven lower bound on the smallest common violation of all rows; > 0 if infeasible.
        solver: Name of the solver whose answer passed.
    """

    outcome: Outcome
    x: FloatArray
    y: FloatArray
    z: FloatArray
    value: float
    bound: float
    residual: float
    proof: float
    solver: str

    @property
    def gap(self) -> float:
        """Objective minus proven bound."""
        return self.value - self.bound

    def at_point(self, x: FloatArray, value: float, residual: float) -> Answer:
        """Return the answer at another point x with its value and residual; the bound stays."""
        return Answer(
            self.outcome, x, self.y, self.z, value, self.bound, residual, self.proof, self.solver
        )


def checked_answer(program: Program, backend: Backend, name: str, cutoff: float) -> Answer:
    """Return the checked answer of a solver to a program.

    Args:
        program: The program.
        backend: The solver.
        name: Its name.
        cutoff: A value above which solutions are of no interest: a proven bound above it counts
            as infeasible.

    Returns:
        A solved or infeasible answer, or a failed one with the best bound that is proven.
    """
    reduced = without_far_limits(program)
    factors = [1.0, *(factor for factor in _SHRINKING_FACTORS if reduced.has_sides_beyond(factor))]
    if reduced.has_sides_beyond(FARTHEST):
        # Interior-point solvers move towards far limits and reach their iteration limit; rescaled,
        # the program has no limit so far away.
        factors.sort(key=lambda factor: factor != _SHRINKING_FACTORS[0])
    best = -np.inf
    for factor in factors:
        answer = _rescaled_answer(program, reduced, factor, backend, name, cutoff)
        if answer.outcome is not Outcome.FAILED:
            return answer
        best = max(best, answer.bound)
    return failed_answer(best)


def _rescaled_answer(
    program: Program, reduced: Program, factor: float, backend: Backend, name: str, cutoff: float
) -> Answer:
    """Return a solver's answer to a program rescaled by a factor, checked in the program itself."""
    raw = call_solver(backend, reduced if factor == 1.0 else rescaled_program(reduced, factor))
    if raw is None:
        return failed_answer(-np.inf)
    x, y, z = raw
    multipliers = factor * x, y, z if reduced is program else without_far_multipliers(program, z)
    answer = proven_answer(program, multipliers, name, cutoff)
    if answer.outcome is not Outcome.FAILED:
        return answer
    refined = polished_answer(program, multipliers)
    if refined is not None:
        refined_answer = proven_answer(program, refined, name, cutoff)
        if refined_answer.outcome is not Outcome.FAILED:
            return refined_answer
    if program.residual(multipliers[0]) <= _LEAST_VIOLATION:
        return failed_answer(answer.bound)  # no proof exceeds the violation at a point
    return (
        _proven_infeasible(program, multipliers[1:], name)
        or _proven_infeasible(program, _elastic_proof(program, backend), name)
        or failed_answer(answer.bound)
    )


def _proven_infeasible(
    program: Program, multipliers: tuple[FloatArray, FloatArray] | None, name: str
) -> Answer | None:
    """Return an infeasible answer if the multipliers prove infeasibility, else None."""
    if multipliers is None:
        return None
    proof = program.infeasibility_bound(*multipliers)
    if proof > _LEAST_VIOLATION or _violates_strict_rows(program, multipliers, proof):
        return _infeasible_answer(np.inf, proof, *multipliers, name)
    return None


def _violates_strict_rows(
    program: Program, multipliers: tuple[FloatArray, FloatArray], proof: float
) -> bool:
    """Return whether the proven violation is significant where strict rows count more."""
    if program.strict is None or proof <= _BOUND_ROUNDING * max(1.0, program.farthest):
        return False
    return program.infeasibility_bound(*multipliers, strictly=True) > _LEAST_VIOLATION


def call_solver(backend: Backend, program: Program) -> Multipliers | None:
    """Return a solver's raw answer to a program; None if it has none, or one too large to use.

    All solvers of a `Program` are called here, and none gets figures above its range.

    Args:
        backend: The solver.
        program: The program.
    """
    within_range = within_solver_range(program)
    raw = None if within_range is None else backend(within_range)
    return None if raw is None or not all_within(raw, _LARGEST_ANSWER) else raw


def proven_answer(program: Program, found: Multipliers, name: str, cutoff: float) -> Answer:
    """Return the checked answer that a solution and its own multipliers prove.

    Args:
        program: The program.
        found: x, y and z as a solver returned them.
        name: Name of the solver.
        cutoff: As in `checked_answer`.

    Returns:
        A solved answer, an infeasible one if the bound is above the cutoff, or a failed one.

    Raises:
        ArgumentError: If the solution is an optimum outside the stated boxes.
    """
    x, y, z = found
    if program.strict is not None:
        x = np.clip(x, program.lb, program.ub)  # limits that are bounds hold exactly
    bound, value, residual = program.assess(x, y, z)
    if program.boxes_are_stated and residual <= PRIMAL_TOLERANCE:
        _refuse_hiding_boxes(program, x, y, z)
    if _is_bound_above(program, bound, cutoff, y, z):
        return _infeasible_answer(bound, max(program.infeasibility_bound(y, z), 0.0), y, z, name)
    gap = abs(value - bound) / max(1.0, abs(value))
    # A gap within the rounding of large figures counts as closed, too.
    is_tight = gap <= max(GAP_TOLERANCE, min(_BOUND_ROUNDING * program.farthest, _LARGEST_GAP))
    is_met = residual <= PRIMAL_TOLERANCE and program.is_resolved
    if is_met and is_tight and _is_within_proof_box(program, x):
        return Answer(Outcome.SOLVED, x, y, z, value, bound, residual, 0.0, name)
    return failed_answer(bound)


def _refuse_hiding_boxes(program: Program, x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    """Raise an error if the stated boxes exclude an optimum of the program.

    A bound is proven over the boxes, so an optimum outside them would be called infeasible. The
    multipliers of x show whether it is one: they prove a bound as high as its value over boxes that
    are enlarged to contain x. A column without a cost may have any value; the boxes hide an optimum
    only if its value, or its bound, differs from that within them.
    """
    low, high = program.box if program.whole_box is None else program.whole_box
    outside = _is_outside(x, low, high)
    if not outside.any():
        return
    larger = replace(program, box=np.stack((np.minimum(low, x), np.maximum(high, x))))
    value, bound = program.value(x), larger.dual_bound(y, z)
    gap = GAP_TOLERANCE * max(1.0, abs(value)) + _multiplier_rounding(larger.farthest, y, z)
    hidden = value > program.highest + gap or program.dual_bound(y, z, whole=True) > bound + gap
    if not hidden or value > bound + gap:
        return
    messages = [
        f"the column {block.name!r} is {x[k]:.6g}, its box {low[k]:.6g} to {high[k]:.6g}"
        for block in program.bounded_blocks
        for k in np.arange(len(x))[block.at][outside[block.at]]
    ]
    if messages:
        raise ArgumentError(
            "box", f"an optimum is outside: {messages[0]}; state boxes that contain all solutions"
        )


def _is_bound_above(
    program: Program, bound: float, cutoff: float, y: FloatArray, z: FloatArray
) -> bool:
    """Return whether the multipliers prove that no solution has a value below the cutoff."""
    least = cutoff + _LEAST_VIOLATION * max(1.0, abs(cutoff) if np.isfinite(cutoff) else 1.0)
    if bound <= least:
        return False
    farthest = program.farthest
    if program.whole_box is not None and cutoff >= program.highest:
        # The question is whether any solution exists, however far away.
        bound = program.dual_bound(y, z, whole=True)
        farthest = float(np.abs(program.whole_box).max(initial=0.0))
    # Multipliers may be so large that their rounding is above the cutoff.
    return bool(bound > least and bound - cutoff > _multiplier_rounding(farthest, y, z))


def _multiplier_rounding(box_size: float, y: FloatArray, z: FloatArray) -> float:
    """Return how far rounding of the multipliers may raise a bound over a box of this size."""
    return _BOUND_ROUNDING * box_size * float(np.abs(y).sum() + np.abs(z).sum())


def _is_within_proof_box(program: Program, x: FloatArray) -> bool:
    """Return whether a solution is inside the box over which bounds are proven."""
    if program.whole_box is None:
        return True
    return not _is_outside(x, *program.box).any()


def _is_outside(x: FloatArray, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
    """(n,) whether each variable is outside its box by more than a relative tolerance."""
    below = x < low - PRIMAL_TOLERANCE * np.maximum(1.0, np.abs(low))
    return below | (x > high + PRIMAL_TOLERANCE * np.maximum(1.0, np.abs(high)))


def failed_answer(bound: float) -> Answer:
    """Return a failed answer: no solution, only a proven bound."""
    empty = np.zeros(0)
    return Answer(Outcome.FAILED, empty, empty, empty, np.inf, bound, np.inf, 0.0, "")


def _infeasible_answer(
    bound: float, proof: float, y: FloatArray, z: FloatArray, name: str
) -> Answer:
    return Answer(Outcome.INFEASIBLE, np.zeros(0), y, z, np.inf, bound, np.inf, proof, name)


def _elastic_proof(program: Program, backend: Backend) -> tuple[FloatArray, FloatArray] | None:
    """Multipliers (y, z) from the elastic program that prove a common violation of all rows."""
    relaxed = elastic_program(program)
    raw = call_solver(backend, relaxed)
    if raw is None:
        return None
    candidates = raw, polished_answer(relaxed, raw) or raw
    best = max(candidates, key=lambda candidate: relaxed.dual_bound(candidate[1], candidate[2]))
    return elastic_multipliers(program, best[2])
