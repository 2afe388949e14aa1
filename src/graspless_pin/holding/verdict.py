"""Records of a verdict: does the object stay at rest with these torques, and what proves it?

Where contacts slide by a declared motion, rest stands for keeping that motion.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import ceil, floor, inf, isinf, log10, nan
from typing import Never, TypedDict

import numpy as np

from graspless_pin.holding.controller import SmallMotions
from graspless_pin.holding.patches import PatchSlip
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Brief


class Stability(StrEnum):
    """Whether rest is what happens (Pang and Trinkle, 2000). See the example of `stability`."""

    STRONG = "strong"
    """Rest is the only outcome."""
    WEAK = "weak"
    """Rest is an outcome, and so is the motion that the verdict states."""
    NONE = "none"
    """Rest is no outcome: no contact forces balance the load and the torques."""
    UNDECIDED = "undecided"
    """A limit ended the search before an answer was proven."""


class ContactState(StrEnum):
    """What a contact does in the instant after. See the example of `stability`."""

    FREE = "free"
    """Not decided yet: any of the others."""
    OPEN = "open"
    """It opens or carries no force."""
    CLOSED = "closed"
    """It stays closed; whether it slips is not decided, or it slides on as declared."""
    STICKING = "sticking"
    SLIPPING = "slipping"


class MovingPart(StrEnum):
    """What an outcome moves. See the example of `stability`."""

    OBJECT = "object"
    """The object, faster than counts as rest."""
    FINGER = "finger"
    """Joints alone: the object stays in this outcome, which tells nothing of others."""


class Holding(StrEnum):
    """Whether the object stays with these torques under the controller that runs.

    See the example of `Controller`.
    """

    HOLDS = "holds"
    """Rest is the only outcome, and no small motion grows."""
    NEEDS_FEEDBACK = "needs_feedback"
    """Rest is the only outcome of the first instant; joints need more feedback to keep it."""
    MAY_FAIL = "may_fail"
    """Rest is an outcome, and so is a motion of the object; or small motions grow under some of the
    contact forces that the torques leave open."""
    FAILS = "fails"
    """Rest is no outcome, or no joint feedback keeps it."""
    FINGER_MOVES = "finger_moves"
    """The object stays in an outcome in which joints move by themselves."""
    UNDECIDED = "undecided"
    """The first instant is not decided, or what small motions do is not known."""


@dataclass(frozen=True, eq=False, repr=False)
class DynamicOutcome(Brief):
    """Accelerations and forces that the laws of rigid bodies and of Coulomb allow together.

    See the example of `stability`.

    Attributes:
        object_acceleration: (P,) of the passive coordinates: of one free object [of the reference
            point; angular], m/s^2 and rad/s^2, world axes.
        joint_accelerations: (L,) rad/s^2 (m/s^2); zero for a hybrid finger's column.
        contact_forces: (M, 3) on the object, N, world axes.
        states: M contact states.
        point_acceleration: The largest acceleration of the centre of mass and of the contact
            points on the object, m/s^2; beside a given wrench matrix at contacts, relative to each
            other, and of each passive coordinate times its lever.
    """

    object_acceleration: FloatArray
    joint_accelerations: FloatArray
    contact_forces: FloatArray
    states: tuple[ContactState, ...]
    point_acceleration: float


@dataclass(frozen=True, eq=False)
class DualBound:
    """Multipliers that prove an upper bound in some set of outcomes; see `holding.bounds`.

    Attributes:
        motion: (n,) lambda of the dynamics, scaled.
        normal: (M,) nu of the normal accelerations.
        tangential: (M, 2) kappa of the tangential ones.
    """

    motion: FloatArray
    normal: FloatArray
    tangential: FloatArray


@dataclass(frozen=True, eq=False)
class LoadProof:
    """A smallest normal force of one contact in every outcome.

    Attributes:
        contact: Its index.
        force: N.
        dual: What proves it.
    """

    contact: int
    force: float
    dual: DualBound


@dataclass(frozen=True, eq=False)
class SlipRange:
    """The directions in which a contact slips.

    Attributes:
        center: Angle from t1 to t2 of the middle, rad.
        half_width: rad; pi: all directions.
    """

    center: float
    half_width: float


@dataclass(frozen=True, eq=False)
class OutcomeSet:
    """One set of outcomes: a leaf with its proof, or split into its children.

    Attributes:
        contact: The contact that its parent was split at, or the first of a patch; -1 at the root.
        state: What is known of that contact here.
        slip: The directions of slip, where the state is slipping.
        children: They cover the node; empty for a leaf.
        dual: A leaf's proof that nothing moves in it; None where its last forced contact says that
            the sibling of this state holds all its outcomes.
        forced: What proves that all outcomes of the parent are in this state, where it is the only
            child: that u_n (u_t1 and u_t2) are at most the closing tolerance.
        loads: Smallest normal forces of all outcomes here and below, each proven with those before.
        sides: Under a declared motion, what is proven here and below: numbers of goals of
            `holding.declared_motion` with their multipliers; goal 0: no outcome is here.
        patch: What its contacts do, where the parent was split at a patch.
    """

    contact: int
    state: ContactState
    slip: SlipRange | None
    children: tuple[OutcomeSet, ...] = ()
    dual: DualBound | None = None
    forced: tuple[DualBound, ...] = ()
    loads: tuple[LoadProof, ...] = ()
    sides: tuple[tuple[int, DualBound], ...] = ()
    patch: PatchSlip | None = None

    @property
    def is_empty(self) -> bool:
        """Whether it is proven, under a declared motion, that it holds no outcome."""
        if any(goal == 0 for goal, _ in self.sides):
            return True
        return bool(self.children) and all(child.is_empty for child in self.children)


@dataclass(frozen=True, eq=False, repr=False)
class RestProof(Brief):
    """What proves that rest is the only outcome. See the example of `stability`.

    Attributes:
        loads: Smallest normal forces that the rest of it uses, each proven with those before it.
        forces: (M, 3) balancing forces whose friction those loads bear, N, world axes: the
            certificate of one linear program; None where the tree proves it.
        tree: The sets of outcomes that were looked at; None where the certificate proves it.
        force_limit: The proof holds for normal forces up to this, N.
    """

    loads: tuple[LoadProof, ...]
    forces: FloatArray | None
    tree: OutcomeSet | None
    force_limit: float


@dataclass(frozen=True, eq=False)
class SpanProof:
    """What proves that rest is the only outcome of all loads between two.

    Attributes:
        multiples: Of a change of load and torques, at the first and at the last of these loads.
        rest_forces: (M, 3) contact forces of an outcome of rest of each of the two, N, world axes.
        proofs: For each of the two: both are certificates with loads that all outcomes have, or
            both are trees, in which the load is any from that one to the other.
    """

    multiples: tuple[float, float]
    rest_forces: tuple[FloatArray, FloatArray]
    proofs: tuple[RestProof, RestProof]


@dataclass(frozen=True, eq=False)
class LastRest:
    """The largest multiple of a change of load and torques with which rest is an outcome.

    Attributes:
        multiple: Of the change.
        forces: (M, 3) contact forces of that rest, N, world axes; None: only the rest without
            the change is known.
        no_rest: (P + L,) what proves that rest is no outcome beyond it, as of a verdict; None: it
            was not looked further.
    """

    multiple: float
    forces: FloatArray | None
    no_rest: FloatArray | None


@dataclass(frozen=True, eq=False, repr=False)
class StabilityVerdict:
    """Whether an object stays at rest with given motor torques.

    It has no truth value: ask its ``status``. See the example of `stability`.

    Attributes:
        status: The answer.
        problem: The problem.
        torques: (L,) the motors' torques, N m (N).
        acceleration_resolution: Share of load over mass.
        acceleration_limit: That share, m/s^2: points of the object that accelerate less count as
            at rest; NaN where the problem has no inertia.
        rest_forces: (M, 3) contact forces of an outcome of rest, N; None where there is none.
        motion: The moving outcome of a weak verdict, or what happens where rest is no outcome, if
            one was found.
        proof: What proves a strong verdict.
        no_rest: (P + L,) what proves that rest is no outcome: a motion of object and joints along
            which all contact forces do work of one sign and the load the other; scaled.
        programs: Linear programs solved.
        nodes: Sets of outcomes looked at, without those that earlier proofs close.
        free_motions: How many motions no friction resists, see `free_motions`.
        small_motions: Of a strong verdict: whether rest lasts beyond the first instant.
        seconds: Processor time that looking at `nodes` took.
        next_nodes: Of an undecided verdict: a limit worth asking for; 0: more would not help.
        message: One sentence.
        controller: What runs on the joints beside the torques, in words; empty: it is not stated,
            and the torques are constant.
        joints_held: Whether joints keep their positions under it: then torques do not count, and
            the joints of the problem have no part in its contacts.
    """

    status: Stability
    problem: QuasistaticProblem
    torques: FloatArray
    acceleration_resolution: float
    acceleration_limit: float
    rest_forces: FloatArray | None
    motion: DynamicOutcome | None
    proof: RestProof | None
    no_rest: FloatArray | None
    programs: int
    nodes: int
    free_motions: int
    small_motions: SmallMotions | None
    seconds: float
    next_nodes: int
    message: str
    controller: str = ""
    joints_held: bool = False

    def __bool__(self) -> Never:
        """Refuse, since there are four answers.

        Raises:
            TypeError: Always.
        """
        raise TypeError(
            "a verdict is neither true nor false: compare verdict.status, with Stability.STRONG "
            "where the object has to stay"
        )

    @property
    def moves(self) -> MovingPart | None:
        """What `motion` moves: the object, or joints alone; None without a motion."""
        if self.motion is None:
            return None
        moved = self.motion.point_acceleration > self.acceleration_limit
        alone = not moved and self.motion.joint_accelerations.any()
        return MovingPart.FINGER if alone else MovingPart.OBJECT

    @property
    def stiffness_needed(self) -> float:
        """Joint feedback that rest needs, N m/rad (N/m); inf: none is enough; NaN: not known."""
        return nan if self.small_motions is None else self.small_motions.stiffness

    @property
    def growth_rate(self) -> float:
        """Rate at which rest is lost under the controller, 1/s; 0: it is not; NaN: not known."""
        return nan if self.small_motions is None else self.small_motions.growth

    @property
    def holding(self) -> Holding:
        """Whether the object stays under the controller that runs on the joints.

        A declared motion is kept where no motion is free.
        """
        if self.status is Stability.NONE:
            return Holding.FINGER_MOVES if self.moves is MovingPart.FINGER else Holding.FAILS
        if self.status is not Stability.STRONG:
            return Holding.MAY_FAIL if self.status is Stability.WEAK else Holding.UNDECIDED
        if self.problem.is_sliding.any():
            return Holding.NEEDS_FEEDBACK if self.free_motions else Holding.HOLDS
        small = self.small_motions
        if small is None or small.unknown:
            return Holding.UNDECIDED
        if not small.moving:
            return Holding.HOLDS
        if small.depends_on_forces:
            return Holding.MAY_FAIL
        return Holding.FAILS if isinf(small.stiffness) else Holding.NEEDS_FEEDBACK

    def keeps_rest(self, *, lasting: bool) -> bool:
        """Return whether rest is the only outcome, and if asked for, lasts under the controller."""
        return self.holding is Holding.HOLDS if lasting else self.status is Stability.STRONG

    def full_message(self, option: str = "node_limit={}") -> str:
        """Return the message, and where more nodes might decide, how to ask for them.

        Args:
            option: How a limit is given, with braces for the number.
        """
        if not self.next_nodes:
            return self.message
        message = f"{self.message}; try {option.format(self.next_nodes)}"
        if not self.nodes:
            return message
        seconds = self.seconds / self.nodes * self.next_nodes
        amount, unit = (seconds, "s") if seconds < 60.0 else (seconds / 60.0, "min")
        return f"{message} (about {max(float(f'{amount:.1g}'), 1.0):g} {unit})"

    def __str__(self) -> str:
        """Return the message, and how to ask for more."""
        return self.full_message()

    def __repr__(self) -> str:
        """Return the status and the message, not the arrays."""
        return f"StabilityVerdict({self.status}: {self.message})"


_NOTICED = 0.2
"""Of the torque that is left over most: joints with less are not named."""
_MOST_NAMED = 3
_ALIKE = 2.0
"""Growth on both models of a mesh that differs by less than this factor is told as one."""


def parted(message: str) -> tuple[str, str]:
    """Return what a verdict leads with, such as "holds", and what it goes on with."""
    lead, *rest = re.split("[:;] ", message, maxsplit=1)
    return lead, "".join(rest)


def strong_words(verdict: StabilityVerdict) -> str:
    """Return what a strong verdict says: its proof is of the first instant, rest has to last."""
    count, free, small = verdict.programs, verdict.free_motions, verdict.small_motions
    proof = f"{count} LP{'s' if count != 1 else ''}"
    feedback = f"; needs position feedback: {free} free motion{'s' if free != 1 else ''}"
    if verdict.problem.is_sliding.any():
        message = f"keeps its motion: nothing else is an outcome (proof: {proof})"
        return message + (feedback if free else "")
    if small is None or small.unknown:
        why = "not looked at" if small is None else small.unknown
        message = f"stays at the first instant; small motions not known: {why} (proof: {proof})"
        return message + (feedback if free else "")
    return _lasting_words(verdict, small, proof) + _assumed_words(small)


def _lasting_words(verdict: StabilityVerdict, small: SmallMotions, proof: str) -> str:
    """Return what becomes of rest after the first instant, which is proven."""
    if not small.moving:
        under = f" with {verdict.controller}" if verdict.controller else ""
        neutral = f"; neutral: {', '.join(small.neutral)}" if small.neutral else ""
        return (
            f"holds{under}: the object provably stays at rest ({proof}); no small motion grows"
            f"{neutral}"
        )
    grows = f"{small.moving}, growing at {_rounded(small.growth):g} /s{_surface_words(small)}"
    needed = f"joint feedback of {_stable_words(small)}"
    stops = "no joint feedback stops it" if isinf(small.stiffness) else f"{needed} stops it"
    if small.depends_on_forces:
        under = f"with {verdict.controller} " if verdict.controller else ""
        return (
            f"may fail: {under}torques leave contact forces open, and under some of them {grows}; "
            f"{stops} (first instant: {proof})"
        )
    if isinf(small.stiffness):
        return f"stays at the first instant; then {grows}: {stops} (proof: {proof})"
    without = f"with {verdict.controller}" if verdict.controller else "without it"
    return f"needs {needed}; {without} {grows} (first instant: {proof})"


def _assumed_words(small: SmallMotions) -> str:
    """Return at which contacts it is not known how the bodies roll; empty: it is."""
    if not small.assumed:
        return ""
    listed = ", ".join(map(str, small.assumed[:_MOST_NAMED]))
    several = f"s {listed}{', ...' if len(small.assumed) > _MOST_NAMED else ''} have"
    whose = several if len(small.assumed) > 1 else f" {listed} has"
    return f"; assumed: contact{whose} a point that stays on both bodies, as no shapes touch there"


def _stable_words(small: SmallMotions) -> str:
    """Return which feedback stops what grows, such as "at least 2 N m/rad"."""
    parts = []
    for low, high in small.stable or ((small.stiffness, inf),):
        least, most = f"{_rounded(low, up=True):g}", f"{_rounded(high):g}"
        if isinf(high):
            parts.append(f"at least {least}")
        else:
            parts.append(f"{least} to {most}" if low > 0.0 else f"at most {most}")
    return f"{' or '.join(parts)} {small.unit}"


def _surface_words(small: SmallMotions) -> str:
    """Return how growth hangs on what a mesh stands for, where that makes much of it."""
    rates = small.growth_by_surface
    if not rates or min(rates.values()) * _ALIKE >= max(rates.values()):
        return ""
    facets, fitted = (_rounded(rates[name]) for name in ("facets", "fitted"))
    return f" (on a mesh's facets {facets:g} /s, on a smooth surface fitted to them {fitted:g} /s)"


def finger_words(verdict: StabilityVerdict, fingers: Mapping[str, str]) -> str:
    """Return what a verdict says whose motion is one of joints alone.

    Args:
        verdict: The verdict; `moves` is ``finger``.
        fingers: The finger of a joint by the joint's name, where it is known.
    """
    problem, motion = verdict.problem, verdict.motion
    left = np.zeros(problem.joint_count)
    if motion is not None and problem.joint_inertia is not None:
        left = np.abs(problem.joint_inertia @ motion.joint_accelerations)
    moving = np.flatnonzero(left >= _NOTICED * left.max(initial=0.0))
    most = int(np.argmax(left))
    names = [problem.joint_names[joint] for joint in moving]
    of = sorted({fingers[name] for name in names if name in fingers})
    kind, who = ("finger", of) if of else ("joint", names)
    listed = ", ".join(map(repr, who[:_MOST_NAMED])) + (", ..." if len(who) > _MOST_NAMED else "")
    moves = f"{kind} {listed} moves by itself"
    if len(who) > 1:
        moves = f"{kind}s {listed} move by themselves"
    loads = "weight and contact forces" if problem.jacobian[:, moving].any() else "weight"
    rest = f"{_rounded(float(left[most])):g} {problem.joint_units[most]}"
    return (
        f"fails: {moves}: torques do not balance {loads}, {rest} are left over at joint "
        f"{problem.joint_names[most]!r}; the object stays in this outcome, which is not proven to "
        "be the only one"
    )


def _rounded(value: float, *, up: bool = False) -> float:
    """Return two digits of a figure."""
    if value <= 0.0 or isinf(value):
        return value
    unit = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{(ceil if up else round)(value / unit * (1.0 - 1e-9)) * unit:.2g}")


COARSEST_RESOLUTION, FINEST_RESOLUTION = 0.01, 1e-6
"""Accelerations that may count as rest, as shares of load over mass; documents hold to the same."""
NODE_LIMIT = 3000
"""Sets of outcomes that are looked at unless told otherwise; earlier proofs close others."""
BRIEF_NODE_LIMIT = 1000
"""The same of verdicts that stand beside an answer unasked: some seconds at most."""


class StabilityKeywords(TypedDict, total=False):
    """Options of `stability` by name."""

    acceleration_resolution: float
    node_limit: int
    time_limit: float | None
