"""Robustness of rest as the only outcome: to errors of torques, and to missing contacts.

`load_bracket` brackets the multiple of a change of load or torques at which rest stops to be the
only outcome.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.holding.certificate import LoadLine, Unproven
from graspless_pin.holding.dynamics import with_joints_held
from graspless_pin.holding.stability import stability, undecided_verdict
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
from graspless_pin.problem.inertias import hybrid_contacts
from graspless_pin.records import Brief
from graspless_pin.tree_search import Limits

_COARSEST_PRECISION = 0.5
_MOST_SPANS = 12
_MOST_HALVINGS = 16
_BEYOND = (1e-5, 1e-4, 1e-3)
"""Steps beyond the last balanced multiple at which a verdict is made, over the load."""
_NO_ERROR = 1e-3
"""Over the largest torque: no actuator keeps its torque to a smaller error."""


NOT_REACHED = "not reached before the time limit"


@dataclass(frozen=True, eq=False, repr=False)
class LoadBracket(Brief):
    """Bracket of the multiple of a change of load or torques at which rest fails.

    Attributes:
        failing: The smallest multiple found with a moving outcome, or without rest as an outcome;
            inf: none was found; NaN: it was not looked for.
        failure: The verdict at `failing`.
        spans: Proofs for adjacent spans of multiples from zero on.
        last_rest: The largest multiple of which rest is an outcome, or up to which was looked;
            None: a time limit ended the search before this bracket was reached.
        complete: Whether the search was completed; False: a time limit ended it before, and the
            bracket may be wider than requested, or was not reached.
    """

    failing: float
    failure: StabilityVerdict | None
    spans: tuple[SpanProof, ...]
    last_rest: LastRest | None
    complete: bool = True

    @property
    def reached(self) -> bool:
        """Whether the search began before the time was over; else all figures are NaN."""
        return self.last_rest is not None

    @property
    def guaranteed(self) -> float:
        """Rest is proven to be the only outcome of every multiple from zero up to this."""
        if not self.reached:
            return np.nan
        return self.spans[-1].multiples[1] if self.spans else 0.0

    @property
    def possible(self) -> float:
        """The largest multiple with rest as an outcome, or the largest that was looked at."""
        return np.nan if self.last_rest is None else self.last_rest.multiple

    def words(self, unit: str) -> str:
        """Return the three figures in words."""
        if not self.reached:
            return NOT_REACHED
        message = f"rest is the only outcome up to {self.guaranteed:.4g} {unit}"
        if self.failure is None:
            message += f"; no other outcome was found up to {self.possible:.4g} {unit}"
            return message if self.complete else f"{message}, when the time limit ended the search"
        message += f"; at {self.failing:.4g} {unit} it {self.failure}"
        if self.failure.status is Stability.NONE:
            return message
        return f"{message}; contact forces can balance up to {self.possible:.4g} {unit} at least"


def checked_limits(
    problem: QuasistaticProblem, precision: float, node_limit: int, time_limit: float | None
) -> Limits:
    """Check the arguments of a search for brackets, and return its limits: their time begins now.

    Raises:
        ArgumentError: If it is no problem, one that slides or has no verdict, or an option is out
            of range.
    """
    if checked_problem(problem).is_sliding.any():
        raise ArgumentError(
            "problem", "has sliding contacts; a guarantee is only available for rest"
        )
    if not problem.cone_model.is_coulomb:
        raise ArgumentError(
            "problem",
            f"has the cone '{problem.cone}'; a verdict requires Coulomb's law ('edges' or 'round')",
        )
    if real_number("precision", precision, 1e-3) > _COARSEST_PRECISION:
        raise ArgumentError(
            "precision", f"is {precision}; it must be at most {_COARSEST_PRECISION}"
        )
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

    Motions are looked for first, by bisection over the multiples. Then spans from zero on are
    proven, each as a whole; a span that is not proven is halved.

    Args:
        undisturbed: The verdict without the change: rest is the only outcome.
        direction: (P + L,) change of wrench and torques per unit of the multiple.
        most: Largest multiple that is looked at.
        precision: Relative width of the bracket at which the search ends.
        limits: Sets of outcomes that each of the two trees of a span may look at, and the time.
            Proofs that are complete by then are kept.
    """
    if limits.is_time_over:
        return LoadBracket(np.nan, None, (), None, complete=False)
    line = LoadLine(
        undisturbed.problem, undisturbed.torques, direction, undisturbed.acceleration_limit
    )
    last_rest = line.last_balanced(most)
    possible = last_rest.multiple
    low, high = 0.0, possible
    end = possible if possible >= most else (1.0 - 0.5 * precision) * possible
    while high - low > 0.5 * precision * high and high > 0.5**_MOST_HALVINGS * possible:
        if limits.is_time_over:
            break
        low, high = (low, end) if line.has_motion(end) else (end, high)
        end = 0.5 * (low + high)
    spans, guaranteed = list[SpanProof](), 0.0
    ends = [low] if low > 0.0 else []  # of the spans to prove, the next one last
    step_back = 0.5 * precision  # from a failing multiple, over it
    for _ in range(_MOST_SPANS):
        if not ends or limits.is_time_over:
            break
        end = ends[-1]
        proof = line.prove_span(guaranteed, end, limits.is_over)
        if isinstance(proof, SpanProof):
            spans.append(proof)
            guaranteed = ends.pop()
        elif proof is Unproven.MOVES:
            high, ends, step_back = end, [], 2.0 * step_back
        elif end - guaranteed > 0.5 * precision * end:
            ends.append(0.5 * (guaranteed + end))
        else:
            break
        if not ends and high - guaranteed > precision * high:
            ends = [max(0.5 * (guaranteed + high), (1.0 - step_back) * high)]
    failing, failure = _failing_multiple(line, undisturbed, high, possible, most, limits)
    return LoadBracket(failing, failure, tuple(spans), last_rest, not limits.is_time_over)


def _failing_multiple(
    line: LoadLine,
    undisturbed: StabilityVerdict,
    high: float,
    possible: float,
    most: float,
    limits: Limits,
) -> tuple[float, StabilityVerdict | None]:
    """Return a failing multiple near the one that the search found, and its verdict."""
    if high >= most:
        return np.inf, None
    size = float(np.abs(line.scaled_direction).max())
    beyond = [share / size for share in _BEYOND] if high >= possible else [0.0]
    for more in beyond:
        problem, torques = line.at_load(high + more)
        resolution = undisturbed.acceleration_resolution
        # The acceleration limit of the undisturbed load holds for all loads.
        resolution *= undisturbed.problem.scales.force / problem.scales.force
        verdict = stability(
            problem, torques, time_limit=limits.seconds_left,
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


@dataclass(frozen=True, eq=False, repr=False)
class Robustness(Brief):
    """Errors that torques tolerate with rest as the only outcome. See the example of `robustness`.

    Attributes:
        verdict: Verdict on the given torques. Unless it is ``strong``, all else is empty.
        less: L brackets: by how much each joint's torque may be smaller, N m (N).
        more: L brackets: by how much it may be larger.
        all_less: By which share all torques together may be smaller.
        all_more: By which share they may be larger.
        without: M verdicts without each contact; None where it is the only one.
        complete: Whether the search was completed; False: `time_limit` ended it before, and larger
            errors may be tolerated, and fewer contacts needed. Brackets have it, too.
    """

    verdict: StabilityVerdict
    less: tuple[LoadBracket, ...] = ()
    more: tuple[LoadBracket, ...] = ()
    all_less: LoadBracket | None = None
    all_more: LoadBracket | None = None
    without: tuple[StabilityVerdict | None, ...] = ()
    complete: bool = True

    @property
    def relies_on(self) -> tuple[int, ...]:
        """The contacts without which rest is not proven to be the only outcome."""
        return tuple(
            contact
            for contact, verdict in enumerate(self.without)
            if verdict is None or verdict.status is not Stability.STRONG
        )

    def __str__(self) -> str:
        """Return the figures, one line each."""
        lines = [self.verdict.message]
        problem, torques = self.verdict.problem, np.abs(self.verdict.torques)
        free: dict[str, list[str]] = {}
        units = np.array([str(unit) for unit in problem.joint_units])
        for name, unit, less, more in (
            zip(problem.joint_names, units, self.less, self.more, strict=True) if self.less else ()
        ):
            most = _NO_ERROR * torques[units == unit].max()
            if less.failing <= most and more.failing <= most:
                free.setdefault(f"{most:.2g} {unit}", []).append(name)
            else:
                lines.append(f"{name}: {_error_range_text(less, more, 1.0, unit)}")
        share = f"{100.0 * _NO_ERROR:g} %"
        for most, names in free.items():
            lines.append(
                f"{', '.join(names)}: rely on joint feedback: under constant torques an error of "
                f"{most}, {share} of the largest torque, already fails"
            )
        if self.all_less is not None and self.all_more is not None and self.less:
            range_text = _error_range_text(self.all_less, self.all_more, 100.0, "%")
            if self.all_less.failing <= _NO_ERROR and self.all_more.failing <= _NO_ERROR:
                range_text = f"rely on joint feedback: an error of {share} already fails"
            lines.append(f"all torques together: {range_text}")
        if self.without:
            listed = ", ".join(str(contact) for contact in self.relies_on) or "none"
            lines.append(f"contacts without which rest is not proven: {listed}")
        if not self.complete:
            lines.append("the time limit ended the search: a larger one may give more results")
        return "\n".join(lines)


def _error_range_text(less: LoadBracket, more: LoadBracket, scale: float, unit: str) -> str:
    """Return the range of a torque error that is tolerated, and where it fails, in words."""
    if not (less.reached or more.reached):
        return NOT_REACHED
    fails = [
        f"{sign}{scale * one.failing:.3g}"
        for sign, one in (("-", less), ("+", more))
        if one.failure is not None
    ]
    ends = [
        f"{sign}{scale * one.guaranteed:.3g}" if one.reached else f"{sign}(not reached)"
        for sign, one in (("-", less), ("+", more))
    ]
    text = f"tolerates {' to '.join(ends)} {unit}"
    return (
        f"{text}, fails at {' and '.join(fails)} {unit}" if fails else f"{text} (no failure found)"
    )


def robustness(
    problem: QuasistaticProblem,
    torques: ArrayLike,
    *,
    precision: float = 0.1,
    node_limit: int = 300,
    time_limit: float | None = None,
) -> Robustness:
    """Return the errors that torques tolerate with rest as the only outcome.

    Errors of one joint's torque, and of all by one share, are bracketed like disturbances: up to
    one figure rest is proven to stay the only outcome, at another a verdict fails. Then each
    contact is removed in turn, which shows the contacts that rest relies on.

    Args:
        problem: At rest, with `object_inertia` and `joint_inertia`.
        torques: (L,) the motors' torques, N m (N).
        precision: Relative width of the brackets at which the search ends.
        node_limit: Sets of outcomes that each tree of a bracket and each verdict without a contact
            may look at; the default is a tenth of that of the other verdicts, on the given torques
            and at the ends of brackets, since there are two brackets for each joint.
        time_limit: Seconds in all; None: any time. What is proven by then is returned, and
            `complete` tells whether the search was completed.

    Raises:
        ArgumentError: If an argument is wrong.

    Examples:
        >>> import numpy as np
        >>> from graspless_pin import QuasistaticProblem, robustness
        >>> feet = [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]]  # m
        >>> normals, weight = [[0.0, 0.0, 1.0]] * 3, [0.0, 0.0, -4.9, 0.0, 0.0, 0.0]
        >>> inertia = np.diag([0.5, 0.5, 0.5, 1e-3, 1e-3, 1e-3])
        >>> stool = QuasistaticProblem(feet, normals, weight, friction=0.5, object_inertia=inertia)
        >>> robustness(stool, []).relies_on
        (0, 1, 2)
    """
    limits = checked_limits(problem, precision, node_limit, time_limit)
    verdict = stability(problem, torques, time_limit=limits.seconds_left)
    if verdict.status is not Stability.STRONG:
        return Robustness(verdict, complete=not limits.is_time_over)
    count = problem.joint_count

    def bracket(change: FloatArray, most: float) -> LoadBracket:
        direction = np.concatenate([np.zeros(problem.passive_count), change])
        return load_bracket(verdict, direction, most, precision, limits)

    largest = np.maximum(np.abs(verdict.torques), problem.scales.joints)
    less, more = (
        tuple(
            bracket(sign * axis, float(most))
            for axis, most in zip(np.eye(count), largest, strict=True)
        )
        for sign in (-1.0, 1.0)
    )
    together: list[LoadBracket | None] = [None, None]
    if verdict.torques.any():
        together = [bracket(sign * verdict.torques, 1.0) for sign in (-1.0, 1.0)]
    without = tuple(
        _verdict_without(verdict, contact, node_limit, limits)
        for contact in range(len(problem.normals))
    )
    return Robustness(
        verdict, less, more, together[0], together[1], without, complete=not limits.is_time_over
    )


def _verdict_without(
    verdict: StabilityVerdict, contact: int, node_limit: int, limits: Limits
) -> StabilityVerdict | None:
    """Return the verdict without a contact; None: no other is left."""
    problem = verdict.problem
    kept: NDArray[np.intp] = np.delete(np.arange(problem.contact_count), contact)
    if not len(kept):
        return None
    blocks = problem.jacobian.reshape(problem.contact_count, 3, problem.joint_count)
    given = problem.wrench_matrix
    if given is not None:
        given = given.reshape(problem.passive_count, problem.contact_count, 3)
    fewer = problem.with_changes(
        positions=problem.positions[kept],
        normals=problem.normals[kept],
        jacobian=blocks[kept].reshape(3 * len(kept), problem.joint_count),
        friction=problem.friction[kept],
        tangents=problem.tangents[kept],
        sliding=problem.sliding[kept],
        max_normal_force=problem.max_normal_force[kept],
        wrench_matrix=None if given is None else given[:, kept].reshape(len(given), 3 * len(kept)),
    )
    # A hybrid finger that touches nothing commands nothing.
    idle = np.flatnonzero(hybrid_contacts(problem) == contact)
    changed, tau = with_joints_held(fewer, verdict.torques, idle), verdict.torques
    if limits.is_time_over:
        return undecided_verdict(
            changed, tau, "undecided: the time limit ended the search before this contact"
        )
    return stability(changed, tau, node_limit=node_limit, time_limit=limits.seconds_left)
