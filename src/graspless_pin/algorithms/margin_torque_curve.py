"""How much torque each margin costs: the whole trade-off between Algorithms 1 and 2.

t*(e0), the optimum of Algorithm 2, is for e0 from zero to Algorithm 1's margin the smallest of the
curves of single modes. A mode's curve is the boundary of a polyhedron's shadow: convex, piecewise
linear, rising, and it ends where the mode can keep no larger margin. Their lower envelope is
piecewise linear too, but it is neither convex nor continuous: modes take turns at kinks, and where
a mode ends it may jump up.

The program with the margin as a variable gives both steps. Within a mode, minimising t - s e
over a stretch with the slope s of its chord finds a point below the chord, or proves that the curve
is straight there. Over all modes, the same search with branch and bound finds a mode that lies
below a straight piece of the envelope anywhere, or proves that there is none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.branch_and_bound import branch_and_bound
from graspless_pin.algorithms.curve_pieces import STRAIGHT, WIDTH, Piece, first_open, joined, lower
from graspless_pin.algorithms.formulation import Formulation, shared_parts
from graspless_pin.algorithms.search import SearchResult, SearchState
from graspless_pin.algorithms.torque import TorqueScale
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.modes.enumeration import mode_of, requirements_of, sign_pairs
from graspless_pin.modes.kinematics import Requirement
from graspless_pin.modes.rules import (
    Rules,
    SlidingMode,
    StaticFriction,
    candidate_contacts,
    choice,
)
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only, whole_number
from graspless_pin.programs.program import Program
from graspless_pin.programs.tradeoff_program import aimed, tradeoff_program
from graspless_pin.solution import Status
from graspless_pin.solvers import Answer, Outcome, check_solver, solve

TOLERANCE = 5e-7
"""No mode lies farther below the curve than this, in scaled units along its steeper axis."""
_STEP = 1e-6
"""How far behind a jump, over F, the search goes on where the mode that ends there hides others."""
_PROVEN = frozenset({Status.OPTIMAL, Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES})


@dataclass(frozen=True, eq=False)
class MarginTorqueCurve:
    """The smallest largest torque for each required margin, piece by piece.

    Piece k runs straight from (margins[k, 0], torques[k, 0]) to (margins[k, 1], torques[k, 1]);
    each begins where the one before it ends, at the same torque or, after a jump, at a larger one.
    ``margins.ravel()`` against ``torques.ravel()`` draws the curve with its jumps.

    Attributes:
        status: OPTIMAL where every piece is proven over all modes; LIMIT_REACHED where a limit
            ended a search, and a mode may lie below; or why nothing is feasible.
        margins: (K, 2) begin and end of each piece, N.
        torques: (K, 2) largest |torque| there, N m; a share of the limits if they are the scale.
        modes: K modes whose optimum each piece is; None with Coulomb friction.
        problem: The problem.
    """

    status: Status
    margins: FloatArray
    torques: FloatArray
    modes: tuple[SlidingMode | None, ...]
    problem: QuasistaticProblem

    @property
    def found(self) -> bool:
        """Whether any margin is feasible."""
        return len(self.modes) > 0

    @property
    def slopes(self) -> FloatArray:
        """(K,) N m of torque per N of margin along each piece."""
        width = np.diff(self.margins)[:, 0]
        rise = np.diff(self.torques)[:, 0]
        return np.divide(rise, width, out=np.zeros_like(rise), where=width > 0.0)

    @property
    def largest_margin(self) -> float:
        """Algorithm 1's margin, N: the curve's end."""
        self._check_found()
        return float(self.margins[-1, 1])

    def torque_at(self, margin: ArrayLike) -> FloatArray:
        """Return t*(e0), interpolated; at a jump the smaller value, NaN beyond the largest margin.

        Args:
            margin: Required margins e0 >= 0, N, of any shape.

        Raises:
            NoSolutionError: If no margin is feasible.
            ArgumentError: If a margin is negative or no number.
        """
        self._check_found()
        wanted = finite_array("margin", np.ravel(margin), (None,))
        if (wanted < 0.0).any():
            raise ArgumentError("margin", f"is {wanted.min()}; a required margin is at least 0")
        piece = np.searchsorted(self.margins[:, 1], wanted, side="left")
        inside = np.minimum(piece, len(self.modes) - 1)
        torque = self.torques[inside, 0] + self.slopes[inside] * (wanted - self.margins[inside, 0])
        return np.where(piece < len(self.modes), torque, np.nan).reshape(np.shape(margin))

    def __str__(self) -> str:
        """Return one line."""
        if not self.found:
            return f"not found: {self.status.message}"
        return (
            f"margin 0 to {self.margins[-1, 1]:.4g} N for {self.torques[0, 0]:.4g} to "
            f"{self.torques[-1, 1]:.4g} of torque, {len(self.modes)} pieces: {self.status.message}"
        )

    def _check_found(self) -> None:
        if not self.found:
            raise NoSolutionError(f"There is no curve to read ({self.status.message}).")


def margin_torque_curve(
    problem: QuasistaticProblem,
    *,
    scale: str = "absolute",
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
    static_friction: str = "virtual_sliding",
    solver: str = "piqp",
    node_limit: int | None = None,
) -> MarginTorqueCurve:
    """Find Algorithm 2's optimum for every required margin, up to Algorithm 1's.

    All breakpoints are found, to the tolerance of the solver. Proven is that no mode lies below
    the curve by more than 5e-7 of the largest torque limit (on pieces that rise slower than that
    limit per normal-force limit; on steeper ones, by a shift of 5e-7 of the normal-force limit).
    Behind a jump, other modes are looked for from 1e-6 of the normal-force limit on.

    Args:
        problem: Contacts, wrench, joints and limits.
        scale: See `minimize_torque`.
        sign_rule: See `maximize_margin`, as for the other options.
        sliding_rule: See `maximize_margin`.
        static_friction: See `maximize_margin`.
        solver: See `maximize_margin`.
        node_limit: Limit of each of the searches over modes.

    Raises:
        ArgumentError: If an option is not known.
        SolverUnavailableError: If the solver is not installed.
    """
    if node_limit is not None:
        node_limit = whole_number("node_limit", node_limit, 1)
    rules = Rules.parse(sign_rule, sliding_rule, static_friction)
    by_limits = choice(TorqueScale, "scale", scale) is TorqueScale.LIMITS
    coordinates, kinematics = shared_parts(problem)
    program = tradeoff_program(problem, coordinates, by_limits=by_limits)
    formulation = Formulation(problem, coordinates, program, kinematics)
    search = _Search(formulation, rules, check_solver(solver), node_limit)
    status, pieces = search.run()
    units = coordinates.force_scale, 1.0 if by_limits else coordinates.torque_scale
    return MarginTorqueCurve(
        status,
        read_only(units[0] * np.array([[p.a, p.b] for p in pieces]).reshape(-1, 2)),
        read_only(units[1] * np.array([[p.t_a, p.t_b] for p in pieces]).reshape(-1, 2)),
        tuple(p.mode for p in pieces),
        problem,
    )


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for the envelope of one problem."""

    formulation: Formulation
    rules: Rules
    solver: str
    node_limit: int | None

    def run(self) -> tuple[Status, list[Piece]]:
        """Return the status and the pieces from margin zero to the largest."""
        largest = self._below(aimed(self.formulation.program, 0.0, -1.0), np.inf)
        best = largest.state.best
        if best is None:
            return largest.status, []
        is_coulomb = self.rules.static_friction is StaticFriction.COULOMB
        first = None if is_coulomb else self._extended(largest.state.mode)
        pieces = self._curve(first, max(float(best.x[-1]), 0.0))
        if not pieces:
            return Status.UNVERIFIED, []
        limited = largest.status not in _PROVEN
        while not is_coulomb and (index := first_open(pieces)) is not None:
            piece = pieces[index]
            parts = [piece]
            for begin in (piece.a, piece.a + _STEP):
                curve, proven = self._found_below(piece, begin)
                limited = limited or not proven
                parts = lower(piece, curve)
                # A mode that ends where the piece begins hides what lies below farther on.
                if not curve or len(parts) > 1 or parts[0] != piece:
                    break
            if parts == [piece]:
                pieces[index] = piece._replace(closed=True)
            else:
                pieces = [part for old in pieces for part in lower(old, curve)]
        return Status.LIMIT_REACHED if limited else Status.OPTIMAL, joined(pieces)

    def _found_below(self, piece: Piece, begin: float) -> tuple[list[Piece], bool]:
        """The curve of a mode that lies below a piece, and whether the search was completed."""
        if piece.b - begin <= WIDTH:
            return [], True
        target = self._toward(piece, begin)
        line = float(target.c[-2:] @ (piece.t_a, piece.a))
        found = self._below(target, line - TOLERANCE)
        curve: list[Piece] = []
        if found.state.best is not None:
            curve = self._curve(self._extended(found.state.mode), None)
        return curve, found.status in _PROVEN

    def _toward(self, piece: Piece, begin: float) -> Program:
        """The program that looks for what lies farthest below a piece."""
        steep = max(1.0, abs(piece.slope))
        program = self.formulation.program
        return aimed(program, 1.0 / steep, -piece.slope / steep, begin, piece.b)

    def _below(self, program: Program, cutoff: float) -> SearchResult:
        """Search all modes for a value below the cutoff."""
        aim = replace(self.formulation, program=program, cutoff=cutoff)
        state = SearchState(aim, self.rules, self.solver)
        return branch_and_bound(state, node_limit=self.node_limit)

    def _curve(self, mode: SlidingMode | None, end: float | None) -> list[Piece]:
        """One mode's whole curve, from margin zero to its own largest.

        Args:
            mode: The mode; None: without a constraint on friction.
            end: Its largest margin, if known.
        """
        if end is None:
            last = self._in_mode(mode, aimed(self.formulation.program, 0.0, -1.0))
            if last.outcome is not Outcome.SOLVED:
                return []
            end = float(last.x[-1])
        begin, finish = self._point(mode, 0.0), self._point(mode, max(end, 0.0))
        if begin is None or finish is None:
            return []
        done: list[Piece] = []
        left = [Piece(begin[0], finish[0], begin[1], finish[1], mode)]
        while left:
            piece = left.pop()
            e, t = self._lowest(piece)
            if piece.a + WIDTH < e < piece.b - WIDTH:
                left.append(piece._replace(a=e, t_a=t))
                left.append(piece._replace(b=e, t_b=t))
            else:
                done.append(piece)
        return joined(done)

    def _lowest(self, piece: Piece) -> tuple[float, float]:
        """The point of the piece's mode farthest below the piece; its begin if there is none."""
        if piece.b - piece.a > 2.0 * WIDTH:
            target = self._toward(piece, piece.a)
            answer = self._in_mode(piece.mode, target)
            line = float(target.c[-2:] @ (piece.t_a, piece.a))
            if answer.outcome is Outcome.SOLVED and answer.value < line - STRAIGHT:
                return float(answer.x[-1]), float(answer.x[-2])
        return piece.a, piece.t_a

    def _point(self, mode: SlidingMode | None, margin: float) -> tuple[float, float] | None:
        """(margin, smallest torque) of a mode; a hair less margin where rounding asks for it."""
        for e in (margin, margin - 0.1 * WIDTH, margin - WIDTH):
            at = max(e, 0.0)
            answer = self._in_mode(mode, aimed(self.formulation.program, 1.0, 0.0, at, at))
            if answer.outcome is Outcome.SOLVED:
                return at, float(answer.x[-2])
        return None

    def _in_mode(self, mode: SlidingMode | None, program: Program) -> Answer:
        lb, ub = program.lb, program.ub
        if mode is not None:
            lb, ub = replace(self.formulation, program=program).bounds_of(mode)
        return solve(program.bounded(lb, ub), self.solver)

    def _extended(self, mode: SlidingMode | None) -> SlidingMode | None:
        """A feasible mode that allows all that this one allows, and as much more as it may."""
        if mode is None:
            return None
        problem, kinematics = self.formulation.problem, self.formulation.kinematics
        chosen = {item.contact: item for item in requirements_of(mode)}
        for contact in np.flatnonzero(candidate_contacts(problem, self.rules)).tolist():
            signs = chosen[contact].signs if contact in chosen else (0, 0)
            if 0 not in signs:
                continue
            for pair in sign_pairs(self.rules.sign):
                if 0 in pair or any(s not in (0, p) for s, p in zip(signs, pair, strict=True)):
                    continue
                trial = chosen | {contact: Requirement(contact, pair)}
                if kinematics.feasible(tuple(trial.values()), self.rules.sign):
                    chosen = trial
                    break
        return mode_of(problem, tuple(chosen[contact] for contact in sorted(chosen)))
