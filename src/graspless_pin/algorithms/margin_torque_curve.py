"""The smallest largest torque as a function of the required margin: Algorithm 2 for every e0.

Parametric linear programming over all modes. A mode's curve t(e0) is convex, piecewise linear and
rising, and ends at the mode's largest margin. The optimum over all modes is the lower envelope of
these curves; it may have kinks, and jumps up where a mode ends. `CurveSearch` finds it: minimising
t - s e over a piece of slope s finds a point of the same mode below the piece, or by branch and
bound another mode, or proves that there is none.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.branch_and_bound import search_modes
from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.algorithms.options import (
    SolveKeywords,
    SolveOptions,
    TorqueScale,
    torque_objective,
)
from graspless_pin.algorithms.search_state import SearchState
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.modes.kinematics import Requirement, mode_of, requirements_of, sign_pairs
from graspless_pin.modes.rules import SlidingMode, StaticFriction, candidate_contacts
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, choice, finite_array, read_only, units_text
from graspless_pin.programs.analysis_objectives import Tradeoff, weighted_tradeoff
from graspless_pin.programs.program import Program
from graspless_pin.records import Brief
from graspless_pin.solution import Status
from graspless_pin.solution.tables import with_noun
from graspless_pin.solvers import Answer, Outcome, solve
from graspless_pin.tree_search import Limits

SAME_TORQUE = 2e-8
"""Torques closer than this, over the torque scale, are the same."""
SAME_MARGIN = 1e-8
"""Margins closer than this, over the load, are the same."""


class Piece(NamedTuple):
    """A straight piece of a curve, scaled.

    Attributes:
        a: Margin at the begin of the piece.
        b: Margin at its end.
        t_a: Torque at its begin.
        t_b: Torque at its end.
        mode: The mode whose optimum it is.
        closed: Whether a search for other modes below it has ended.
    """

    a: float
    b: float
    t_a: float
    t_b: float
    mode: SlidingMode | None
    closed: bool = False

    @property
    def slope(self) -> float:
        """Torque per margin."""
        return (self.t_b - self.t_a) / (self.b - self.a) if self.b > self.a else 0.0

    def torque_at_margin(self, e: float) -> float:
        """Return the torque at a margin, on the line through the piece."""
        return self.t_a + self.slope * (e - self.a)

    def restricted(self, a: float, b: float) -> Piece:
        """Return the piece of the same line between two margins."""
        return self._replace(a=a, b=b, t_a=self.torque_at_margin(a), t_b=self.torque_at_margin(b))


def lower_envelope(piece: Piece, curve: list[Piece]) -> list[Piece]:
    """Return the lower envelope of a piece and another curve over the piece's margins."""
    if piece.closed:
        return [piece]
    parts: list[Piece] = []
    for other in curve:
        low, high = max(piece.a, other.a), min(piece.b, other.b)
        if high - low > SAME_MARGIN:
            parts += _envelope_of_two(piece.restricted(low, high), other.restricted(low, high))
    covered = parts[-1].b if parts else piece.a
    if piece.b - covered > SAME_MARGIN:
        parts.append(piece.restricted(covered, piece.b))
    merged: list[Piece] = []
    for part in parts:
        if merged and part.mode is piece.mode is merged[-1].mode:
            merged.pop()  # part of the same line
        merged.append(part)
    if all(part.mode is piece.mode for part in merged):
        return [piece]
    # Parts that are too narrow were left out, so each part begins where the previous one ends.
    begins = [piece.a, *(part.b for part in merged[:-1])]
    ends = [*begins[1:], piece.b]
    return [part.restricted(a, b) for part, a, b in zip(merged, begins, ends, strict=True)]


def _envelope_of_two(piece: Piece, other: Piece) -> list[Piece]:
    """Return the lower envelope of two pieces over the same margins; of equal ones the first."""
    slack = SAME_TORQUE * max(1.0, abs(piece.slope), abs(other.slope))
    before, after = other.t_a - piece.t_a, other.t_b - piece.t_b
    if min(before, after) >= -slack:
        return [piece]
    if max(before, after) <= slack:
        return [other]
    # Farther than SAME_MARGIN from both ends: slack is at least two widths of either slope.
    crossing = piece.a + (piece.b - piece.a) * before / (before - after)
    first, second = (piece, other) if before > 0.0 else (other, piece)
    return [first.restricted(piece.a, crossing), second.restricted(crossing, piece.b)]


def joined_pieces(pieces: list[Piece]) -> list[Piece]:
    """Return the same curve with collinear adjacent pieces of one mode joined."""
    whole: list[Piece] = []
    for piece in pieces:
        last = whole[-1] if whole else None
        if last is not None and last.mode == piece.mode:
            longer = last._replace(b=piece.b, t_b=piece.t_b)
            steep = max(1.0, abs(longer.slope))
            between = (last.b, last.t_b), (piece.a, piece.t_a)
            if max(abs(longer.torque_at_margin(e) - t) for e, t in between) <= SAME_TORQUE * steep:
                whole[-1] = longer
                continue
        whole.append(piece)
    return whole


CURVE_TOLERANCE = 5e-7
"""No mode lies farther below the curve than this, in scaled units along its steeper axis."""
_STEP_BEHIND_JUMP = 1e-6
"""Step behind a jump, over F, where the search goes on: a mode that ends there hides others."""
_PROVEN = frozenset({Status.OPTIMAL, Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES})


@dataclass(frozen=True, eq=False)
class CurveSearch:
    """The search for the lower envelope of all modes of one problem.

    Attributes:
        formulation: The scaled program with the margin as a variable.
        options: How the modes are searched.
        limits: Limits of the searches over modes.
        unanswered: Programs of single modes that no solver answered.
    """

    formulation: Formulation
    options: SolveOptions
    limits: Limits
    unanswered: list[Program] = field(default_factory=list)

    def run(self) -> tuple[Status, list[Piece]]:
        """Return the status and the pieces from margin zero to the largest."""
        status, state = self._search(weighted_tradeoff(self.formulation.program, 0.0, -1.0), np.inf)
        if state.best is None:
            return status, []
        is_coulomb = self.options.rules.static_friction is StaticFriction.COULOMB
        first = None if is_coulomb else self._maximal(state.mode)
        pieces = self._curve(first, max(self._margin_of(state.best), 0.0))
        if not pieces:
            return Status.UNVERIFIED, []
        limited = status not in _PROVEN
        while not is_coulomb and (
            open_pieces := [one for one in pieces if not one.closed and one.b - one.a > SAME_MARGIN]
        ):
            piece = open_pieces[0]
            parts = [piece]
            for begin in (piece.a, piece.a + _STEP_BEHIND_JUMP):
                curve, proven = self._curve_below(piece, begin)
                limited = limited or not proven
                parts = lower_envelope(piece, curve)
                # A mode that ends where the piece begins hides modes below farther on.
                if not curve or len(parts) > 1 or parts[0] != piece:
                    break
            if parts == [piece]:
                pieces = [old._replace(closed=True) if old is piece else old for old in pieces]
            else:
                pieces = [part for old in pieces for part in lower_envelope(old, curve)]
        limited = limited or bool(self.unanswered)
        return Status.LIMIT_REACHED if limited else Status.OPTIMAL, joined_pieces(pieces)

    def _curve_below(self, piece: Piece, begin: float) -> tuple[list[Piece], bool]:
        """Return the curve of a mode that lies below a piece, and whether the search is proven."""
        if piece.b - begin <= SAME_MARGIN:
            return [], True
        target = self._program_below(piece, begin)
        status, state = self._search(target, self._line_value(target, piece) - CURVE_TOLERANCE)
        found = state.best is not None
        return self._curve(self._maximal(state.mode), None) if found else [], status in _PROVEN

    def _program_below(self, piece: Piece, begin: float) -> Program:
        """Return the program of the point farthest below a piece, from a margin on."""
        aim = np.array([1.0, -piece.slope])
        torque, margin = aim / np.abs(aim).max()
        return weighted_tradeoff(self.formulation.program, torque, margin, begin, piece.b)

    def _search(self, program: Program, cutoff: float) -> tuple[Status, SearchState]:
        """Search all modes for a value below the cutoff."""
        aim = replace(self.formulation, program=program, cutoff=cutoff)
        state = SearchState(aim, self.options, self.limits)
        return search_modes(state), state

    def _curve(self, mode: SlidingMode | None, end: float | None) -> list[Piece]:
        """Return the whole curve of a mode, from margin zero to its largest.

        Args:
            mode: The mode; None: without a constraint on friction.
            end: Its largest margin; None: not known.
        """
        if end is None:
            last = self._solve_in_mode(mode, weighted_tradeoff(self.formulation.program, 0.0, -1.0))
            if last.outcome is not Outcome.SOLVED:
                return []
            end = self._margin_of(last)
        begin, finish = self._mode_point(mode, 0.0), self._mode_point(mode, max(end, 0.0))
        if begin is None or finish is None:
            return []
        done: list[Piece] = []
        remaining = [Piece(begin[0], finish[0], begin[1], finish[1], mode)]
        while remaining:
            piece = remaining.pop()
            e, t = self._lowest_point(piece)
            if piece.a + SAME_MARGIN < e < piece.b - SAME_MARGIN:
                remaining.append(piece._replace(a=e, t_a=t))
                remaining.append(piece._replace(b=e, t_b=t))
            else:
                done.append(piece)
        return joined_pieces(done)

    def _lowest_point(self, piece: Piece) -> tuple[float, float]:
        """Return the point of the piece's mode farthest below it; its begin if there is none."""
        if piece.b - piece.a > 2.0 * SAME_MARGIN:
            target = self._program_below(piece, piece.a)
            answer = self._solve_in_mode(piece.mode, target)
            line = self._line_value(target, piece)
            if answer.outcome is Outcome.SOLVED and answer.value < line - SAME_TORQUE:
                return self._margin_of(answer), self._torque_of(answer)
        return piece.a, piece.t_a

    def _mode_point(self, mode: SlidingMode | None, margin: float) -> tuple[float, float] | None:
        """Return (margin, smallest torque) of a mode; a slightly smaller margin if need be."""
        for e in (margin, margin - 0.1 * SAME_MARGIN, margin - SAME_MARGIN):
            at = max(e, 0.0)
            answer = self._solve_in_mode(
                mode, weighted_tradeoff(self.formulation.program, 1.0, 0.0, at, at)
            )
            if answer.outcome is Outcome.SOLVED:
                return at, self._torque_of(answer)
        return None

    def _torque_of(self, answer: Answer) -> float:
        return float(answer.x[self.formulation.program.column("largest")])

    def _margin_of(self, answer: Answer) -> float:
        return float(answer.x[self.formulation.program.column("margin")])

    def _line_value(self, target: Program, piece: Piece) -> float:
        """Return the value of the target's objective along a piece, where it is constant."""
        t, e = target.column("largest"), target.column("margin")
        return float(target.c[t] * piece.t_a + target.c[e] * piece.a)

    def _solve_in_mode(self, mode: SlidingMode | None, program: Program) -> Answer:
        bounds = replace(self.formulation, program=program).bounds_of(mode)
        answer = solve(program.with_bounds(*bounds), self.options.solver)
        if answer.outcome is Outcome.FAILED:
            self.unanswered.append(program)
        return answer

    def _maximal(self, mode: SlidingMode | None) -> SlidingMode | None:
        """Return a mode extended by further contacts and signs while it stays feasible."""
        if mode is None:
            return None
        problem, kinematics = self.formulation.problem, self.formulation.kinematics
        chosen = {item.contact: item for item in requirements_of(mode)}
        for contact in np.flatnonzero(candidate_contacts(problem, self.options.rules)).tolist():
            signs = chosen[contact].signs if contact in chosen else (0, 0)
            if 0 not in signs:
                continue
            for pair in sign_pairs(self.options.rules.sign, signs):
                if 0 in pair:
                    continue
                trial = chosen | {contact: Requirement(contact, pair)}
                if kinematics.feasible(tuple(trial.values()), self.options.rules.sign):
                    chosen = trial
                    break
        return mode_of(problem, tuple(chosen[contact] for contact in sorted(chosen)))


@dataclass(frozen=True, eq=False, repr=False)
class MarginTorqueCurve(Brief):
    """The smallest largest torque for each required margin, piece by piece.

    Piece k runs straight from (margins[k, 0], torques[k, 0]) to (margins[k, 1], torques[k, 1]);
    each begins where the one before it ends, at the same torque or, after a jump, at a larger one.
    ``margins.ravel()`` against ``torques.ravel()`` draws the curve with its jumps.

    See the example of `margin_torque_curve`.

    Attributes:
        status: OPTIMAL where every piece is proven over all modes; LIMIT_REACHED where a limit
            ended a search, and a mode may lie below; or why nothing is feasible.
        margins: (K, 2) begin and end of each piece, N.
        torques: (K, 2) largest |torque| there, in `torque_unit`.
        modes: K modes whose optimum each piece is; None with Coulomb friction.
        problem: The problem.
        scale: Measure of the torques: their size, or their share of the limits.
    """

    status: Status
    margins: FloatArray
    torques: FloatArray
    modes: tuple[SlidingMode | None, ...]
    problem: QuasistaticProblem
    scale: TorqueScale

    @property
    def found(self) -> bool:
        """Whether any margin is feasible."""
        return len(self.modes) > 0

    @property
    def torque_unit(self) -> str:
        """Unit of the torques in words; the joint of the largest may change along the curve."""
        if self.scale is TorqueScale.LIMITS:
            return "share of the limit"
        return units_text(self.problem.joint_units)

    @property
    def slopes(self) -> FloatArray:
        """(K,) torque, in `torque_unit`, per N of margin along each piece."""
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

        Up to 1e-8 of the load beyond that margin, the tolerance of its optimum, it is that of the
        end.

        Args:
            margin: Required margins e0 >= 0, N, of any shape.

        Raises:
            NoSolutionError: If no margin is feasible.
            ArgumentError: If a margin is negative or no number.
        """
        wanted = finite_array("margin", np.ravel(margin), (None,))
        end = self.largest_margin
        attainable = wanted <= end + SAME_MARGIN * self.problem.scales.force
        wanted = np.where(attainable, np.minimum(wanted, end), wanted)
        if (wanted < 0.0).any():
            raise ArgumentError("margin", f"is {wanted.min()}; it must not be negative")
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
            f"{self.torques[-1, 1]:.4g} of torque [{self.torque_unit}], "
            f"{with_noun(len(self.modes), 'piece')}: {self.status.message}"
        )

    def _check_found(self) -> None:
        if not self.found:
            raise NoSolutionError(f"There is no margin-torque curve ({self.status.message}).")


def margin_torque_curve(
    problem: QuasistaticProblem,
    *,
    scale: str = "absolute",
    **options: Unpack[SolveKeywords],
) -> MarginTorqueCurve:
    """Find Algorithm 2's optimum for every required margin, up to Algorithm 1's.

    All breakpoints are found, to the tolerance of the solver. It is proven that no mode lies below
    the curve by more than 5e-7 of the torque that the load makes on the longest lever (on pieces
    that rise slower than that torque per load; on steeper ones, by a shift of 5e-7 of the load).
    Behind a jump, other modes are searched from 1e-6 of the load on.

    Args:
        problem: Contacts, wrench, joints and limits.
        scale: See `minimize_torque`.
        options: See `SolveOptions.parse`.

    Raises:
        ArgumentError: If an option is not known, for ``direction`` or ``strong``.
        SolverUnavailableError: If the solver is not installed.

    Examples:
        >>> from graspless_pin import load_scene, margin_torque_curve
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> curve = margin_torque_curve(problem)
        >>> print(f"{float(curve.torque_at(0.1)):.4f} N m for 0.1 N")
        0.9618 N m for 0.1 N
    """
    checked_problem(problem)
    how = SolveOptions.parse(**options).need_weak(
        "margin_torque_curve considers only the best admissible contact forces",
        "leave it out, or call `minimize_torque` for each margin",
    )
    how.rules.need_signs("margin_torque_curve")
    torque_scale = choice(TorqueScale, "scale", scale)
    formulation = formulate(problem, Tradeoff(torque_objective(0.0, torque_scale)))
    status, pieces = CurveSearch(formulation, how, Limits.from_options(how)).run()
    units = formulation.coordinates.force_scale, formulation.signed_unit
    return MarginTorqueCurve(
        status,
        read_only(units[0] * np.array([[p.a, p.b] for p in pieces]).reshape(-1, 2)),
        read_only(units[1] * np.array([[p.t_a, p.t_b] for p in pieces]).reshape(-1, 2)),
        tuple(p.mode for p in pieces),
        problem,
        torque_scale,
    )
