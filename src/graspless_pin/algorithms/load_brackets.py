"""Up to which multiple of a change of the load rest stays the only outcome, and where it fails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.algorithms.options import Limits
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.load_intervals import LoadLine, Unproven
from graspless_pin.holding.stability import stability
from graspless_pin.holding.verdict import (
    COARSEST_RESOLUTION,
    FINEST_RESOLUTION,
    LastRest,
    SpanProof,
    Stability,
    StabilityVerdict,
)
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, real_number, whole_number
from graspless_pin.records import Brief

_WIDEST = 0.5
_MOST_SPANS = 12
_MOST_HALVINGS = 16
_BEYOND = (1e-5, 1e-4, 1e-3)
"""Of the load: so far beyond the last balanced multiple a verdict is asked for."""


NOT_REACHED = "not reached: the time was over before"


@dataclass(frozen=True, eq=False, repr=False)
class LoadBracket(Brief):
    """Where rest stops to be the only outcome along a change of load or torques.

    Attributes:
        failing: The smallest multiple that was found to have a moving outcome, or none of rest;
            inf: none was found; NaN: it was not looked for.
        failure: The verdict at `failing`.
        spans: Proofs for spans that follow each other from zero on.
        last_rest: The largest multiple of which rest is an outcome, or up to which was looked;
            None: a time limit ended the search before this bracket was reached.
        complete: Whether the search came to its end; False: a time limit ended it before, and the
            bracket may be wider than asked for, or was not reached.
    """

    failing: float
    failure: StabilityVerdict | None
    spans: tuple[SpanProof, ...]
    last_rest: LastRest | None
    complete: bool = True

    @property
    def reached(self) -> bool:
        """Whether anything was looked at before the time was over; else all figures are NaN."""
        return self.last_rest is not None

    @property
    def guaranteed(self) -> float:
        """Rest is proven to be the only outcome of every multiple from zero up to this."""
        if not self.reached:
            return np.nan
        return self.spans[-1].multiples[1] if self.spans else 0.0

    @property
    def possible(self) -> float:
        """The largest multiple of which rest is an outcome, or up to which was looked."""
        return np.nan if self.last_rest is None else self.last_rest.multiple

    def words(self, unit: str) -> str:
        """Return the three figures in words."""
        if not self.reached:
            return NOT_REACHED
        message = f"rest is the only outcome up to {self.guaranteed:.4g} {unit}"
        if self.failure is None:
            message += f"; nothing else was found up to {self.possible:.4g} {unit}"
            return message if self.complete else f"{message}, when the time was over"
        message += f"; at {self.failing:.4g} {unit} it {self.failure}"
        if self.failure.status is Stability.NONE:
            return message
        return f"{message}; forces balance up to {self.possible:.4g} {unit} at least"


def bracket_limits(
    problem: QuasistaticProblem, precision: float, node_limit: int, time_limit: float | None
) -> Limits:
    """Check what every search for brackets is given, and return its limits: their time begins now.

    Raises:
        ArgumentError: If it is no problem, one that slides or has no verdict, or an option is out
            of range.
    """
    if checked_problem(problem).is_sliding.any():
        raise ArgumentError("problem", "slides; what certainly holds is known of rest alone")
    if why := problem.cone_model.no_verdict:
        raise ArgumentError("problem", f"leaves all of this {why}")
    if real_number("precision", precision, 1e-3) > _WIDEST:
        raise ArgumentError("precision", f"is {precision}; it must be at most {_WIDEST}")
    nodes = whole_number("node_limit", node_limit, 0)
    if time_limit is not None:
        time_limit = real_number("time_limit", time_limit, 0.0, finite=False)
    return Limits.from_now(nodes, time_limit)


def load_bracket(
    undisturbed: StabilityVerdict,
    direction: FloatArray,
    most: float,
    precision: float,
    limits: Limits,
) -> LoadBracket:
    """Bracket the largest multiple of a change up to which rest stays the only outcome.

    Motions are looked for first, at ever smaller multiples. Then spans from zero on are proven,
    each as a whole; a span that is not proven is halved.

    Args:
        undisturbed: The verdict without the change: rest is the only outcome.
        direction: (P + L,) what each multiple adds to wrench and torques.
        most: Multiples up to this are looked at.
        precision: Relative width of the bracket with which the search ends.
        limits: Sets of outcomes that each of the two trees of a span may look at, and the time.
            What is proven when it is over stands.
    """
    if limits.passed:
        return LoadBracket(np.nan, None, (), None, complete=False)
    line = LoadLine(
        undisturbed.problem, undisturbed.torques, direction, undisturbed.acceleration_limit
    )
    last_rest = line.last_balanced(most)
    possible = last_rest.multiple
    low, high = 0.0, possible
    end = possible if possible >= most else (1.0 - 0.5 * precision) * possible
    while high - low > 0.5 * precision * high and high > 0.5**_MOST_HALVINGS * possible:
        if limits.passed:
            break
        low, high = (low, end) if line.moves(end) else (end, high)
        end = 0.5 * (low + high)
    spans, ends, below = list[SpanProof](), [low] if low > 0.0 else [], 0.5 * precision
    guaranteed = 0.0
    for _ in range(_MOST_SPANS):
        if not ends or limits.passed:
            break
        end = ends[-1]
        proof = line.proof(guaranteed, end, limits.end)
        if isinstance(proof, SpanProof):
            spans.append(proof)
            guaranteed = ends.pop()
        elif proof is Unproven.MOVES:
            high, ends, below = end, [], 2.0 * below
        elif end - guaranteed > 0.5 * precision * end:
            ends.append(0.5 * (guaranteed + end))
        else:
            break
        if not ends and high - guaranteed > precision * high:
            ends = [max(0.5 * (guaranteed + high), (1.0 - below) * high)]
    failing, failure = _failure(line, undisturbed, high, (possible, most), limits)
    return LoadBracket(failing, failure, tuple(spans), last_rest, not limits.passed)


def _failure(
    line: LoadLine,
    undisturbed: StabilityVerdict,
    high: float,
    ends: tuple[float, float],
    limits: Limits,
) -> tuple[float, StabilityVerdict | None]:
    """Return a multiple that fails, with its verdict, near the one that the search found."""
    possible, most = ends
    if high >= most:
        return np.inf, None
    size = float(np.abs(line.in_loads).max())
    beyond = [share / size for share in _BEYOND] if high >= possible else [0.0]
    for more in beyond:
        problem, torques = line.at(high + more)
        resolution = undisturbed.acceleration_resolution
        # One limit for all loads: that of the undisturbed one.
        resolution *= undisturbed.problem.scales.force / problem.scales.force
        verdict = stability(
            problem, torques, time_limit=limits.left,
            acceleration_resolution=float(
                np.clip(resolution, FINEST_RESOLUTION, COARSEST_RESOLUTION)
            ),
        )  # fmt: skip
        motion = verdict.motion
        if verdict.status is Stability.NONE or (
            verdict.status is Stability.WEAK
            and motion is not None
            and motion.point_acceleration > undisturbed.acceleration_limit
        ):
            return high + more, verdict
    return np.inf, None
