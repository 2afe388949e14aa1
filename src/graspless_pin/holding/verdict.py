"""Records of a verdict: does the object stay at rest with these torques, and what proves it?

Where contacts slide by a declared motion, rest stands for keeping that motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import isinf, nan
from typing import Never, TypedDict

from graspless_pin.holding.controller import SmallMotions
from graspless_pin.holding.patches import PatchSlip
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Brief, Record


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
    """The object stays, and there is an outcome in which joints move by themselves."""
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
class DualBound(Record):
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
        leaving: Of a strong verdict: joints that friction alone keeps. They may leave, and the
            object stays all the same.
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
    leaving: tuple[str, ...] = ()

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
        """What `motion` moves: the object, or joints alone; None without a motion.

        Where rest is no outcome, an object that accelerates less than counts as motion elsewhere
        goes with the joints all the same: it slips, and they do not move alone.
        """
        if self.motion is None:
            return None
        limit = self.acceleration_limit
        if self.status is Stability.NONE:
            limit *= FINEST_RESOLUTION / self.acceleration_resolution
        moved = self.motion.point_acceleration > limit
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
            return Holding.FINGER_MOVES if self.leaving else Holding.HOLDS
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
