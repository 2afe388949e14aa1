"""The lower envelope of all modes' curves of torque over margin, found piece by piece.

The program with the margin as a variable gives both steps. Within a mode, minimising t - s e
over a stretch with the slope s of its chord finds a point below the chord, or proves that the curve
is straight there. Over all modes, the same search with branch and bound finds a mode that lies
below a straight piece of the envelope anywhere, or proves that there is none.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from graspless_pin.algorithms.curve_pieces import STRAIGHT, WIDTH, Piece, first_open, joined, lower
from graspless_pin.algorithms.formulation import Formulation
from graspless_pin.algorithms.limits import Limits
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search import SearchResult, SearchState
from graspless_pin.algorithms.searching import search_modes
from graspless_pin.modes.enumeration import mode_of, requirements_of, sign_pairs
from graspless_pin.modes.kinematics import Requirement
from graspless_pin.modes.rules import SlidingMode, StaticFriction, candidate_contacts
from graspless_pin.programs.analysis_objectives import aimed
from graspless_pin.programs.program import Program
from graspless_pin.solution import Status
from graspless_pin.solvers import Answer, Outcome, solve

TOLERANCE = 5e-7
"""No mode lies farther below the curve than this, in scaled units along its steeper axis."""
_STEP = 1e-6
"""How far behind a jump, over F, the search goes on where the mode that ends there hides others."""
_PROVEN = frozenset({Status.OPTIMAL, Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES})


@dataclass(frozen=True, eq=False)
class CurveSearch:
    """The search for the envelope of one problem.

    Attributes:
        formulation: The scaled program with the margin as a variable.
        options: How the modes are searched.
        limits: Of the searches over modes.
        unanswered: Programs of single modes that no solver answered.
    """

    formulation: Formulation
    options: SolveOptions
    limits: Limits
    unanswered: list[Program] = field(default_factory=list)

    def run(self) -> tuple[Status, list[Piece]]:
        """Return the status and the pieces from margin zero to the largest."""
        largest = self._below(aimed(self.formulation.program, 0.0, -1.0), np.inf)
        best = largest.state.best
        if best is None:
            return largest.status, []
        is_coulomb = self.options.rules.static_friction is StaticFriction.COULOMB
        first = None if is_coulomb else self._extended(largest.state.mode)
        pieces = self._curve(first, max(self._margin(best), 0.0))
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
        limited = limited or bool(self.unanswered)
        return Status.LIMIT_REACHED if limited else Status.OPTIMAL, joined(pieces)

    def _found_below(self, piece: Piece, begin: float) -> tuple[list[Piece], bool]:
        """Return the curve of a mode below a piece, and whether the search was completed."""
        if piece.b - begin <= WIDTH:
            return [], True
        target = self._toward(piece, begin)
        line = self._line(target, piece)
        found = self._below(target, line - TOLERANCE)
        curve: list[Piece] = []
        if found.state.best is not None:
            curve = self._curve(self._extended(found.state.mode), None)
        return curve, found.status in _PROVEN

    def _toward(self, piece: Piece, begin: float) -> Program:
        """Return the program that looks for what lies farthest below a piece."""
        steep = max(1.0, abs(piece.slope))
        program = self.formulation.program
        return aimed(program, 1.0 / steep, -piece.slope / steep, begin, piece.b)

    def _below(self, program: Program, cutoff: float) -> SearchResult:
        """Search all modes for a value below the cutoff."""
        aim = replace(self.formulation, program=program, cutoff=cutoff)
        state = SearchState(aim, self.options.rules, self.options.solver)
        return search_modes(state, self.options, self.limits)

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
            end = self._margin(last)
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
        """Return the point of its mode farthest below a piece; its begin if there is none."""
        if piece.b - piece.a > 2.0 * WIDTH:
            target = self._toward(piece, piece.a)
            answer = self._in_mode(piece.mode, target)
            line = self._line(target, piece)
            if answer.outcome is Outcome.SOLVED and answer.value < line - STRAIGHT:
                return self._margin(answer), self._torque(answer)
        return piece.a, piece.t_a

    def _point(self, mode: SlidingMode | None, margin: float) -> tuple[float, float] | None:
        """(margin, smallest torque) of a mode; a hair less margin where rounding asks for it."""
        for e in (margin, margin - 0.1 * WIDTH, margin - WIDTH):
            at = max(e, 0.0)
            answer = self._in_mode(mode, aimed(self.formulation.program, 1.0, 0.0, at, at))
            if answer.outcome is Outcome.SOLVED:
                return at, self._torque(answer)
        return None

    def _torque(self, answer: Answer) -> float:
        return float(answer.x[self.formulation.program.column("largest")])

    def _margin(self, answer: Answer) -> float:
        return float(answer.x[self.formulation.program.column("margin")])

    def _line(self, target: Program, piece: Piece) -> float:
        """Return the value of the target's objective along a piece."""
        t, e = target.column("largest"), target.column("margin")
        return float(target.c[t] * piece.t_a + target.c[e] * piece.a)

    def _in_mode(self, mode: SlidingMode | None, program: Program) -> Answer:
        lb, ub = program.lb, program.ub
        if mode is not None:
            lb, ub = replace(self.formulation, program=program).bounds_of(mode)
        answer = solve(program.bounded(lb, ub), self.options.solver)
        if answer.outcome is Outcome.FAILED:
            self.unanswered.append(program)
        return answer

    def _extended(self, mode: SlidingMode | None) -> SlidingMode | None:
        """Return a feasible mode that allows what this one allows, and as much more as it may."""
        if mode is None:
            return None
        problem, kinematics = self.formulation.problem, self.formulation.kinematics
        chosen = {item.contact: item for item in requirements_of(mode)}
        for contact in np.flatnonzero(candidate_contacts(problem, self.options.rules)).tolist():
            signs = chosen[contact].signs if contact in chosen else (0, 0)
            if 0 not in signs:
                continue
            for pair in sign_pairs(self.options.rules.sign):
                if 0 in pair or any(s not in (0, p) for s, p in zip(signs, pair, strict=True)):
                    continue
                trial = chosen | {contact: Requirement(contact, pair)}
                if kinematics.feasible(tuple(trial.values()), self.options.rules.sign):
                    chosen = trial
                    break
        return mode_of(problem, tuple(chosen[contact] for contact in sorted(chosen)))
