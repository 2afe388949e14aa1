"""Changes that make rest the only outcome: the smallest of each kind, tried one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.optimization import maximize_margin
from graspless_pin.algorithms.robustness import checked_limits
from graspless_pin.bounds import LARGEST_FRICTION
from graspless_pin.holding.dynamics import with_joints_held
from graspless_pin.holding.stability import stability
from graspless_pin.holding.verdict import NODE_LIMIT, Stability, StabilityVerdict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array
from graspless_pin.tree_search import Limits

_TORQUE_SHARES = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Increases of torques, over the torques or the load, tried one after the other."""
_WITHIN = 1.0 - 1e-12
"""Share of the range of limits that is used, so that rounding puts no torque beyond them."""
_MOST_FRICTION = 4.0
_CHANGE_BISECTIONS = 6

_Changed = tuple[QuasistaticProblem, FloatArray]


@dataclass(frozen=True, eq=False)
class HoldingChange:
    """A change with which rest is the only outcome. See the example of `what_would_hold`.

    Attributes:
        words: The change in words.
        problem: The problem with the change.
        torques: (L,) motors' torques with the change, N m (N).
        verdict: The verdict on these torques: rest is the only outcome.
    """

    words: str
    problem: QuasistaticProblem
    torques: FloatArray
    verdict: StabilityVerdict

    def __str__(self) -> str:
        """Return the change in words."""
        return self.words


@dataclass(frozen=True, eq=False)
class HoldingChanges:
    """Changes with which rest is the only outcome. See the example of `what_would_hold`.

    Attributes:
        changes: The changes found; empty where none that was tried was enough.
        complete: Whether all kinds were tried; False: `time_limit` ended that before, and changes
            may be missing, or larger than they need to be.
    """

    changes: tuple[HoldingChange, ...]
    complete: bool = True

    def __str__(self) -> str:
        """Return a line for each change, and one more where the time was over before."""
        lines = [f"it would hold with {change}" for change in self.changes]
        lines = lines or ["no change that was tried makes it hold"]
        if not self.complete:
            lines.append("the time limit ended the search: other changes may make it hold, too")
        return "\n".join(lines)


def what_would_hold(
    problem: QuasistaticProblem,
    torques: ArrayLike,
    *,
    node_limit: int = 1000,
    time_limit: float | None = None,
) -> HoldingChanges:
    """Find changes with which rest is the only outcome, each tried by a verdict.

    The smallest that was found of each kind: larger torques of the same proportions; a preload, the
    torques of the largest margin without load, on top; other torques (`maximize_margin` with
    ``stability="strong"``); more friction at one contact or at all, up to four times as much; one
    joint, or all joints that move one contact, under position control.

    Args:
        problem: At rest, with `object_inertia` and `joint_inertia`.
        torques: (L,) the motors' torques, of which rest is not the only outcome, N m (N).
        node_limit: Sets of outcomes that each verdict may look at; the default is a third of that
            of a single verdict, since many changes are tried.
        time_limit: Seconds in all; None: any time. What was found by then is returned.

    Returns:
        The changes, and whether the time was enough for all.

    Raises:
        ArgumentError: If an argument is wrong.

    Examples:
        >>> from graspless_pin import load_scene, what_would_hold
        >>> scene = load_scene("examples/box_between_walls.yaml")
        >>> torques = scene.solve().torques  # may fail
        >>> found = what_would_hold(scene.problem(), torques, node_limit=10)
        >>> len(found.changes) > 0
        True
    """
    limits = checked_limits(problem, 0.1, node_limit, time_limit)
    tau = finite_array("torques", torques, (problem.joint_count,))
    return HoldingChanges(
        tuple(filter(None, _tried_changes(problem, tau, limits))), complete=not limits.is_time_over
    )


def _tried_changes(
    problem: QuasistaticProblem, tau: FloatArray, limits: Limits
) -> Iterator[HoldingChange | None]:
    if problem.joint_count:
        yield _larger_torques(
            problem, tau, tau - problem.gravity_torques,
            lambda share: f"contact torques {100.0 * share:.0f} % larger",
            limits,
        )  # fmt: skip
        yield _preload(problem, tau, limits)
        yield _other_torques(problem, limits)
    everywhere = np.ones(problem.contact_count, dtype=bool)
    each = np.eye(problem.contact_count, dtype=bool)
    for where, place in [
        *((row, f"contact {contact}") for contact, row in enumerate(each)),
        (everywhere, "all contacts"),
    ]:
        yield _smallest_change(
            lambda more, where=where: (
                problem.with_changes(
                    friction=np.minimum((1.0 + more * where) * problem.friction, LARGEST_FRICTION)
                ), tau
            ),
            (_MOST_FRICTION - 1.0,),
            lambda more, place=place: f"{1.0 + more:.2f} times the friction at {place}",
            limits,
        )  # fmt: skip
    for joint, name in enumerate(problem.joint_names):
        held = with_joints_held(problem, tau, np.array([joint], dtype=np.intp))
        yield _verified_change((held, tau), f"joint {name} under position control", limits)
    blocks = problem.jacobian.reshape(problem.contact_count, 3, problem.joint_count)
    acts = (blocks != 0.0).any(axis=1)
    for contact in np.flatnonzero(acts.sum(axis=1) > 1).tolist():
        held = with_joints_held(problem, tau, np.flatnonzero(acts[contact]))
        words = f"all joints that act on contact {contact} under position control"
        yield _verified_change((held, tau), words, limits)


def _other_torques(problem: QuasistaticProblem, limits: Limits) -> HoldingChange | None:
    """Try the torques of the largest margin of which rest is the only outcome."""
    if limits.is_time_over:
        return None
    nodes = NODE_LIMIT if limits.node_limit is None else limits.node_limit
    solution = maximize_margin(
        problem, stability="strong", verdict_nodes=nodes, time_limit=limits.seconds_left
    )
    if not solution.found or solution.guarantee is None or solution.guarantee.verdict is None:
        return None
    words = "torques of maximize_margin with stability='strong'"
    return HoldingChange(words, problem, solution.torques, solution.guarantee.verdict)


def _preload(problem: QuasistaticProblem, tau: FloatArray, limits: Limits) -> HoldingChange | None:
    """Try torques on top that squeeze the object without load."""
    if limits.is_time_over:
        return None
    unloaded = problem.with_changes(
        external_wrench=np.zeros(problem.passive_count),
        gravity_torques=np.zeros(problem.joint_count),
    )
    squeeze = maximize_margin(unloaded, static_friction="coulomb", time_limit=limits.seconds_left)
    if not squeeze.found or squeeze.margin <= 1e-6 * problem.scales.force:
        return None
    largest = float(np.linalg.norm(squeeze.contact_forces, axis=1).max())
    per_newton, load = squeeze.torques / largest, problem.scales.force
    return _larger_torques(
        problem, tau, load * per_newton,
        lambda share: f"a preload of up to {share * load:.3g} N at the contacts, by the torques",
        limits,
    )  # fmt: skip


def _larger_torques(
    problem: QuasistaticProblem,
    tau: FloatArray,
    direction: FloatArray,
    words: Callable[[float], str],
    limits: Limits,
) -> HoldingChange | None:
    """Try shares of torques (L,) on top, as far as the joints' limits allow."""
    moved = direction != 0.0
    ends = np.where(direction > 0.0, problem.upper_torque, problem.lower_torque)
    most = _WITHIN * float(((ends - tau)[moved] / direction[moved]).min(initial=np.inf))
    sizes = np.unique(np.minimum(_TORQUE_SHARES, most))
    sizes = (*sizes[sizes > 0.0].tolist(),)
    return _smallest_change(lambda share: (problem, tau + share * direction), sizes, words, limits)


def _verified_change(changed: _Changed, words: str, limits: Limits) -> HoldingChange | None:
    """Return a change if a verdict proves rest with it; None: not proven, or beyond limits."""
    problem, torques = changed
    beyond = (torques < problem.lower_torque) | (torques > problem.upper_torque)
    if limits.is_time_over or beyond.any():
        return None
    nodes = NODE_LIMIT if limits.node_limit is None else limits.node_limit
    verdict = stability(problem, torques, node_limit=nodes, time_limit=limits.seconds_left)
    is_strong = verdict.status is Stability.STRONG
    return HoldingChange(words, problem, torques, verdict) if is_strong else None


def _smallest_change(
    change: Callable[[float], _Changed],
    sizes: tuple[float, ...],
    words: Callable[[float], str],
    limits: Limits,
) -> HoldingChange | None:
    """Return the smallest change: the first size that holds, bisected towards the one before."""
    too_small = 0.0
    for size in sizes:
        found = _verified_change(change(size), words(size), limits)
        if found is None:
            too_small = size
            continue
        for _ in range(_CHANGE_BISECTIONS):
            middle = 0.5 * (too_small + size)
            less = _verified_change(change(middle), words(middle), limits)
            too_small, size = (middle, size) if less is None else (too_small, middle)
            found = less or found
        return found
    return None
