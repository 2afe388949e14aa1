"""What is proven of a program: answers that were checked, whoever gave them.

No solver's status is trusted. An answer counts when it meets the constraints and its own
multipliers prove it optimal, by the dual bound over the box of the variables; infeasibility counts
when multipliers prove it: a Farkas certificate.

Where no solver gives one, the elastic program does: the smallest common violation of all rows. If
that is positive, its multipliers are a Farkas certificate.

Solvers are asked for easier programs in the place of a program: without fixed variables or limits
that are too far away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray, all_within
from graspless_pin.programs.active_set_polish import polished
from graspless_pin.programs.program import FARTHEST, LARGEST_FIGURE, Program
from graspless_pin.records import changed

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


def clipped(program: Program) -> Program | None:
    """Return a program without limits above `LARGEST_FIGURE`; None if others are so large.

    Libraries below crash on such figures or print. Limits so far away count as none.
    """
    if not program.has_rows_in_range:
        return None
    if not program.is_far:
        return program
    if program.has_sides_beyond(LARGEST_FIGURE):
        program = _without_huge_sides(program)
    return None if program.has_sides_beyond(LARGEST_FIGURE) else program


def _without_huge_sides(program: Program) -> Program:
    """Return a program whose limits that are farther away than `LARGEST_FIGURE` are none."""
    flat, size = program.flat_count, LARGEST_FIGURE
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
    beyond = ((z > 0.0) & (program.u > FARTHEST)) | ((z < 0.0) & (program.l < -FARTHEST))
    return np.where(beyond, 0.0, z)


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


PRIMAL_TOLERANCE = 1e-7
"""Largest accepted violation of a constraint, in scaled units: of the load."""
GAP_TOLERANCE = 1e-7
"""Largest accepted distance between an objective and its proven bound, in scaled units, or relative
to the objective where that is larger."""
_LARGEST_GAP = 5e-7
"""Half of what the checker of documents lets pass: it works in another order of rounding."""
_BOUND_ROUNDING = 1e-14
"""What rounding leaves of a bound, over the largest variable that it is proven for."""
_LEAST_VIOLATION = 1e-8
_SHRINKING_FACTORS = (1e3, 1e6)
_LARGEST_ANSWER = 1e100
"""Products with larger figures overflow; what is no number is not within it either."""

Multipliers = tuple[FloatArray, FloatArray, FloatArray]
"""A solution x with multipliers of the equalities and of the rows, as a solver left them."""
Backend = Callable[[Program], Multipliers | None]
"""A solver: what it found, or None if that is nothing."""


class Outcome(Enum):
    """What is proven of a program."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    FAILED = "failed"


@dataclass(frozen=True, eq=False)
class Answer:
    """A checked answer to a program.

    Attributes:
        outcome: What is proven.
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

    def moved(self, x: FloatArray, value: float, residual: float) -> Answer:
        """Return the answer with another point and what holds there; multipliers and bound stay."""
        return Answer(
            self.outcome, x, self.y, self.z, value, self.bound, residual, self.proof, self.solver
        )


def checked_answer(program: Program, backend: Backend, name: str, cutoff: float) -> Answer:
    """Ask a solver and say what its answer proves.

    Args:
        program: The program.
        backend: The solver.
        name: Its name.
        cutoff: A value above which solutions are of no interest: a proven bound above it counts
            as infeasible.

    Returns:
        A solved or infeasible answer, or a failed one with the bound that is proven all the same.
    """
    reduced = without_far_limits(program)
    factors = [1.0, *(factor for factor in _SHRINKING_FACTORS if reduced.has_sides_beyond(factor))]
    if reduced.has_sides_beyond(FARTHEST):
        # Interior points are led there, and end after all their steps: rescaled, the program has
        # nothing so far away.
        factors.sort(key=lambda factor: factor != _SHRINKING_FACTORS[0])
    best = -np.inf
    for factor in factors:
        answer = _tried(program, reduced, factor, backend, name, cutoff)
        if answer.outcome is not Outcome.FAILED:
            return answer
        best = max(best, answer.bound)
    return failed(best)


def _tried(
    program: Program, reduced: Program, factor: float, backend: Backend, name: str, cutoff: float
) -> Answer:
    """Ask a solver for a program rescaled by a factor, and hold its answer against the program."""
    raw = call_solver(backend, reduced if factor == 1.0 else rescaled(reduced, factor))
    if raw is None:
        return failed(-np.inf)
    x, y, z = raw
    found = factor * x, y, z if reduced is program else near_multipliers(program, z)
    answer = proven(program, found, name, cutoff)
    if answer.outcome is not Outcome.FAILED:
        return answer
    nearer = polished(program, found)
    if nearer is not None:
        again = proven(program, nearer, name, cutoff)
        if again.outcome is not Outcome.FAILED:
            return again
    if program.residual(found[0]) <= _LEAST_VIOLATION:
        return failed(answer.bound)  # no proof says more than a point violates
    return (
        _proven_infeasible(program, found[1:], name)
        or _proven_infeasible(program, _elastic_multipliers(program, backend), name)
        or failed(answer.bound)
    )


def _proven_infeasible(
    program: Program, multipliers: tuple[FloatArray, FloatArray] | None, name: str
) -> Answer | None:
    """Return the infeasible answer that multipliers prove; None: they prove none."""
    if multipliers is None:
        return None
    proof = program.infeasibility_bound(*multipliers)
    if proof > _LEAST_VIOLATION or _breaks_limits(program, multipliers, proof):
        return _infeasible(np.inf, proof, *multipliers, name)
    return None


def _breaks_limits(
    program: Program, multipliers: tuple[FloatArray, FloatArray], proof: float
) -> bool:
    """Return whether all points break what is strict, though others may be met nearly."""
    if program.strict is None or proof <= _BOUND_ROUNDING * max(1.0, program.farthest):
        return False
    return program.infeasibility_bound(*multipliers, strictly=True) > _LEAST_VIOLATION


def call_solver(backend: Backend, program: Program) -> Multipliers | None:
    """Return what a solver finds of a program, None if that is nothing or not to be reckoned with.

    No solver of a `Program` is asked but here, and none is given figures that it does not bear.

    Args:
        backend: The solver.
        program: The program.
    """
    within_range = clipped(program)
    raw = None if within_range is None else backend(within_range)
    return None if raw is None or not all_within(raw, _LARGEST_ANSWER) else raw


def proven(program: Program, found: Multipliers, name: str, cutoff: float) -> Answer:
    """Say what a solution and its multipliers prove by themselves.

    Args:
        program: The program.
        found: What is said to be optimal.
        name: Who says so.
        cutoff: As in `checked_answer`.

    Returns:
        A solved answer, or an infeasible one where the bound is above the cutoff, or a failed one.

    Raises:
        ArgumentError: If the solution is an optimum that boxes which were stated hide.
    """
    x, y, z = found
    if program.strict is not None:
        x = np.clip(x, program.lb, program.ub)  # limits that are bounds hold exactly
    bound, value, residual = program.assess(x, y, z)
    if program.boxes_are_stated and residual <= PRIMAL_TOLERANCE:
        _check_boxes(program, x, y, z)
    if _is_above(program, bound, cutoff, y, z):
        return _infeasible(bound, max(program.infeasibility_bound(y, z), 0.0), y, z, name)
    gap = abs(value - bound) / max(1.0, abs(value))
    # What rounding may leave of large figures counts as none, too.
    is_tight = gap <= max(GAP_TOLERANCE, min(_BOUND_ROUNDING * program.farthest, _LARGEST_GAP))
    is_met = residual <= PRIMAL_TOLERANCE and program.is_resolved
    if is_met and is_tight and _is_within_reach(program, x):
        return Answer(Outcome.SOLVED, x, y, z, value, bound, residual, 0.0, name)
    return failed(bound)


def _check_boxes(program: Program, x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    """Refuse boxes that hide an optimum of the program.

    A bound is proven over the boxes, so an optimum outside them would be called infeasible. The
    multipliers of x tell whether it is one: they prove a bound as high as its value over boxes that
    are made as large as x. A column without a cost may be anything; the boxes hide an optimum where
    its value or its bound are not what they are within them.
    """
    low, high = program.box if program.whole_box is None else program.whole_box
    outside = _is_outside(x, low, high)
    if not outside.any():
        return
    larger = replace(program, box=np.stack((np.minimum(low, x), np.maximum(high, x))))
    value, bound = program.value(x), larger.dual_bound(y, z)
    gap = GAP_TOLERANCE * max(1.0, abs(value)) + _rounding(larger.farthest, y, z)
    hidden = value > program.highest + gap or program.dual_bound(y, z, whole=True) > bound + gap
    if not hidden or value > bound + gap:
        return
    messages = [
        f"the column {block.name!r} has {x[at]:.6g} there, its box {low[at]:.6g} to {high[at]:.6g}"
        for block in program.bounded_blocks
        for at in np.arange(len(x))[block.at][outside[block.at]]
    ]
    if messages:
        raise ArgumentError(
            "box", f"an optimum is outside: {messages[0]}; state boxes that hold of every solution"
        )


def _is_above(program: Program, bound: float, cutoff: float, y: FloatArray, z: FloatArray) -> bool:
    """Return whether multipliers prove that no solution is below a cutoff."""
    least = cutoff + _LEAST_VIOLATION * max(1.0, abs(cutoff) if np.isfinite(cutoff) else 1.0)
    if bound <= least:
        return False
    farthest = program.farthest
    if program.whole_box is not None and cutoff >= program.highest:
        # It is about whether there is any solution, however far away.
        bound = program.dual_bound(y, z, whole=True)
        farthest = float(np.abs(program.whole_box).max(initial=0.0))
    # Multipliers may be so large that their rounding is above the cutoff.
    return bool(bound > least and bound - cutoff > _rounding(farthest, y, z))


def _rounding(farthest: float, y: FloatArray, z: FloatArray) -> float:
    """Return what rounding of multipliers may add to a bound over a box that reaches so far."""
    return _BOUND_ROUNDING * farthest * float(np.abs(y).sum() + np.abs(z).sum())


def _is_within_reach(program: Program, x: FloatArray) -> bool:
    """Return whether a bound is about a solution: not where this is farther than proofs look."""
    if program.whole_box is None:
        return True
    return not _is_outside(x, *program.box).any()


def _is_outside(x: FloatArray, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
    """(n,) whether each is outside its box by more than a tolerance of the box's own size."""
    below = x < low - PRIMAL_TOLERANCE * np.maximum(1.0, np.abs(low))
    return below | (x > high + PRIMAL_TOLERANCE * np.maximum(1.0, np.abs(high)))


def failed(bound: float) -> Answer:
    """Return the answer that no solver gave, with a bound that is proven all the same."""
    empty = np.zeros(0)
    return Answer(Outcome.FAILED, empty, empty, empty, np.inf, bound, np.inf, 0.0, "")


def _infeasible(bound: float, proof: float, y: FloatArray, z: FloatArray, name: str) -> Answer:
    return Answer(Outcome.INFEASIBLE, np.zeros(0), y, z, np.inf, bound, np.inf, proof, name)


def _elastic_multipliers(
    program: Program, backend: Backend
) -> tuple[FloatArray, FloatArray] | None:
    """Multipliers that prove the smallest common violation of all rows, by the elastic program."""
    relaxed = elastic(program)
    raw = call_solver(backend, relaxed)
    if raw is None:
        return None
    found = raw, polished(relaxed, raw) or raw
    best = max(found, key=lambda one: relaxed.dual_bound(one[1], one[2]))
    return elastic_multipliers(program, best[2])
