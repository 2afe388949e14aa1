"""Records of a verdict: whether the object stays at rest with these torques, and the proof.

Where contacts slide by a declared motion, rest means that this motion is kept.
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
    """Whether rest is an outcome, and the only one (Pang and Trinkle, 2000).

    See the example of `stability`.
    """

    STRONG = "strong"
    """Rest is the only outcome."""
    WEAK = "weak"
    """Rest is an outcome, and so is the motion that the verdict states."""
    NONE = "none"
    """Rest is no outcome: no contact forces balance the load and the torques."""
    UNDECIDED = "undecided"
    """A limit ended the search before an answer was proven."""


class ContactState(StrEnum):
    """The state of a contact in the first instant. See the example of `stability`."""

    FREE = "free"
    """Not decided yet: any of the others."""
    OPEN = "open"
    """It opens or carries no force."""
    CLOSED = "closed"
    """It stays closed; whether it slips is not decided, or it slides on as declared."""
    STICKING = "sticking"
    SLIPPING = "slipping"


class MovingPart(StrEnum):
    """The part that an outcome moves. See the example of `stability`."""

    OBJECT = "object"
    """The object, faster than counts as rest."""
    FINGER = "finger"
    """Joints alone: the object stays in this outcome; others may differ."""


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
    """The first instant is not decided, or the growth of small motions is not known."""


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
    """Multipliers that prove an upper bound over a set of outcomes; see `holding.bounds`.

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
    """A proven lower bound on the normal force of one contact in every outcome.

    Attributes:
        contact: Its index.
        force: The bound, N.
        dual: The multipliers that prove it.
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
        state: The state of that contact here.
        slip: The directions of slip, where the state is slipping.
        children: They cover the node; empty for a leaf.
        dual: A leaf's proof that nothing moves in it; None if its last forced contact shows that
            the sibling with this state holds all its outcomes.
        forced: If it is the only child, the proof that all outcomes of the parent are in this
            state: u_n (u_t1 and u_t2) are at most the closing tolerance.
        loads: Smallest normal forces of all outcomes here and below, each proven with those before.
        sides: Under a declared motion, the goals proven here and below: numbers of goals of
            `holding.declared_motion` with their multipliers; goal 0: the set is empty.
        patch: The slip of the patch, where the parent was split at one.
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
        """Whether it is proven, under a declared motion, that the set is empty."""
        if any(goal == 0 for goal, _ in self.sides):
            return True
        return bool(self.children) and all(child.is_empty for child in self.children)


@dataclass(frozen=True, eq=False, repr=False)
class RestProof(Brief):
    """The proof that rest is the only outcome. See the example of `stability`.

    Attributes:
        loads: Smallest normal forces that the proof uses, each proven with those before it.
        forces: (M, 3) balancing forces with friction up to mu times those normal forces, N, world
            axes: the certificate of one linear program; None where the tree proves it.
        tree: The sets of outcomes that were searched; None where the certificate proves it.
        force_limit: The proof holds for normal forces up to this, N.
    """

    loads: tuple[LoadProof, ...]
    forces: FloatArray | None
    tree: OutcomeSet | None
    force_limit: float


@dataclass(frozen=True, eq=False)
class SpanProof:
    """The proof that rest is the only outcome under all loads between two.

    Attributes:
        multiples: Of a change of load and torques, at the first and at the last of these loads.
        rest_forces: (M, 3) contact forces of rest under each of the two, N, world axes.
        proofs: One for each of the two: both are certificates by normal forces that the outcomes of
            all loads have, or both are trees, in which the load is any from that one to the other.
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
        no_rest: (P + L,) proof that rest is no outcome beyond it, see `StabilityVerdict`; None:
            larger multiples were not searched.
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
        motion: A moving outcome of a weak verdict, or one that was found where rest is no outcome;
            None: there is none.
        proof: The proof of a strong verdict.
        no_rest: (P + L,) proof that rest is no outcome: a motion of object and joints along which
            all contact forces do work of one sign and the load of the other; scaled.
        programs: Linear programs solved.
        nodes: Sets of outcomes searched, without those that multipliers found before prove.
        free_motions: Number of motions that no friction resists, see `free_motions`.
        small_motions: Of a strong verdict: whether rest lasts beyond the first instant.
        leaving: Of a strong verdict: joints that friction alone keeps in place. They may leave
            while the object stays.
        seconds: Processor time of the search through `nodes`.
        next_nodes: Of an undecided verdict: a node limit worth trying; 0: more would not help.
        message: One sentence.
        controller: The controller in addition to the torques, in words; empty: it is not stated,
            and the torques are constant.
        joints_held: Whether the controller keeps joint positions: then torques have no effect, and
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
            "a verdict has no truth value; compare verdict.status with a Stability, such as "
            "Stability.STRONG if the object has to stay"
        )

    @property
    def moves(self) -> MovingPart | None:
        """The part that `motion` moves: the object, or joints alone; None without a motion.

        Where rest is no outcome, the object counts as moving from a smaller acceleration on, that
        of `FINEST_RESOLUTION`: then it slips, and the joints do not move alone.
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
        """Return whether rest is the only outcome; if ``lasting``, also under the controller."""
        return self.holding is Holding.HOLDS if lasting else self.status is Stability.STRONG

    def full_message(self, option: str = "node_limit={}") -> str:
        """Return the message, with the option for a larger node limit where that might decide.

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
"""Range of `acceleration_resolution`, shares of load over mass; the same for documents."""
NODE_LIMIT = 3000
"""Default of the most sets of outcomes that are searched."""
BRIEF_NODE_LIMIT = 1000
"""The same for verdicts that are given in addition to another answer: some seconds at most."""


class StabilityKeywords(TypedDict, total=False):
    """Options of `stability` by name."""

    acceleration_resolution: float
    node_limit: int
    time_limit: float | None
