"""How much rest bears: errors of the torques, and contacts that are not there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.load_brackets import (
    NOT_REACHED,
    LoadBracket,
    bracket_limits,
    load_bracket,
)
from graspless_pin.algorithms.options import Limits
from graspless_pin.holding.dynamics import with_joints_held
from graspless_pin.holding.stability import stability, undecided_verdict
from graspless_pin.holding.verdict import Stability, StabilityVerdict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.inertias import hybrid_contacts
from graspless_pin.records import Brief


@dataclass(frozen=True, eq=False, repr=False)
class Robustness(Brief):
    """What torques bear of which rest is the only outcome. See the example of `robustness`.

    Attributes:
        verdict: On the torques as they are. The rest is empty unless it is ``strong``.
        less: L brackets: how much smaller each joint's torque may be, N m (N).
        more: L brackets: how much larger.
        all_less: By which share of themselves all torques together may be smaller.
        all_more: By which share they may be larger.
        without: M verdicts without each contact; None where it is the only one.
        complete: Whether all was looked at; False: `time_limit` ended the search before, and more
            may be borne, and less be relied on, than is known. Brackets have it, too.
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
        problem = self.verdict.problem
        for name, unit, less, more in (
            zip(problem.joint_names, problem.joint_units, self.less, self.more, strict=True)
            if self.less
            else ()
        ):
            lines.append(f"{name}: {_error(less, more, 1.0, str(unit))}")
        if self.all_less is not None and self.all_more is not None and self.less:
            lines.append(
                f"all torques together: {_error(self.all_less, self.all_more, 100.0, '%')}"
            )
        if self.without:
            listed = ", ".join(str(contact) for contact in self.relies_on) or "none"
            lines.append(f"contacts without which rest is not proven: {listed}")
        if not self.complete:
            lines.append("the time limit ended the search: more time may tell more")
        return "\n".join(lines)


def _error(less: LoadBracket, more: LoadBracket, scale: float, unit: str) -> str:
    """Return what two brackets bear, and where they fail."""
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
    return f"{text}, fails at {' and '.join(fails)} {unit}" if fails else f"{text} (end of search)"


def robustness(
    problem: QuasistaticProblem,
    torques: ArrayLike,
    *,
    precision: float = 0.1,
    node_limit: int = 300,
    time_limit: float | None = None,
) -> Robustness:
    """Tell how much torques of which rest is the only outcome bear.

    Errors of one joint's torque, and of all by one share, are bracketed like disturbances: up to
    one figure rest is proven to stay the only outcome, at another a verdict fails. Then each
    contact is taken away: contacts that the rest relies on have to touch.

    Args:
        problem: At rest, with `object_inertia` and `joint_inertia`.
        torques: (L,) the motors' torques, N m (N).
        precision: Relative width of the brackets with which the search ends.
        node_limit: Sets of outcomes that each tree and each verdict may look at; a tenth of what
            one verdict alone may, since there are two brackets for each joint and a verdict for
            each contact.
        time_limit: Seconds in all; None: any time. What is proven by then is returned, and
            `complete` tells whether it is all.

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
    limits = bracket_limits(problem, precision, node_limit, time_limit)
    verdict = stability(problem, torques, time_limit=limits.left)
    if verdict.status is not Stability.STRONG:
        return Robustness(verdict, complete=not limits.passed)
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
        _without(verdict, contact, node_limit, limits) for contact in range(len(problem.normals))
    )
    return Robustness(
        verdict, less, more, together[0], together[1], without, complete=not limits.passed
    )


def _without(
    verdict: StabilityVerdict, contact: int, node_limit: int, limits: Limits
) -> StabilityVerdict | None:
    """Return the verdict without a contact, None where no other is left."""
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
    if limits.passed:
        why = "undecided: the time was over before it was looked at"
        return undecided_verdict(changed, tau, why)
    return stability(changed, tau, node_limit=node_limit, time_limit=limits.left)
