"""What an answer is worth: its status, how well it is proven, and the verdict asked for.

The proof that no mode gives a better answer is the tree of the branch and bound search. Each node
is a set of modes. A leaf holds the reason why no mode of its set beats the stated bound: the dual
multipliers of its program, or a combination of constraints that excludes every virtual motion. An
inner node states how its set is split, so that no mode is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from graspless_pin.holding.verdict import StabilityVerdict
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Brief, Record


@dataclass(frozen=True)
class Certificate:
    """How well the answer is proven.

    Values are in scaled units (forces and margin over the load F, torques over what F makes on a
    joint's longest lever; see `problem.scales`) unless a unit is given.

    See the example of `Status`.

    Attributes:
        primal_residual: Largest violation of any constraint by the returned forces.
        duality_gap: Objective minus the bound that the multipliers of its program prove.
        bound: Proven bound on the optimum over all modes: an upper bound on the margin in N
            (Algorithm 1), a lower bound on the largest torque (Algorithm 2: N m, or a share of
            the limits). With a regularisation it bounds the regularised objective.
        gap: Distance between the returned objective and that bound, same unit.
        infeasibility: Proven smallest common violation of all constraints where infeasible.
        modes_examined: Virtual-sliding modes that were solved or ruled out one by one.
        nodes: Nodes of the search.
        force_programs: LPs or QPs in forces that were solved, or that a warm start answered.
        kinematic_programs: Kinematic feasibility problems that were solved.
        solver: The solver whose answer passed the check, or, where an `Evaluator` warm-started
            from another state, the one that answered there; ``loops``: the compiled loops did
            by themselves.
        force_reach: The largest normal force up to which the bound is proven, N: the largest limit,
            or 1e8 times the load.
        threshold_optima: The optimum with a tenth and with ten times the threshold of what counts
            as a virtual motion, in the bound's unit, NaN where nothing is feasible; None: both are
            the same as here, or not known.
    """

    primal_residual: float
    duality_gap: float
    bound: float
    gap: float
    infeasibility: float
    modes_examined: int
    nodes: int
    force_programs: int
    kinematic_programs: int
    solver: str
    force_reach: float = np.inf
    threshold_optima: tuple[float, float] | None = None


class Status(Enum):
    """What is known of the problem; the value is the message.

    Examples:
        >>> from graspless_pin import Status, explain, load_scene, minimize_torque
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> solution = minimize_torque(problem, margin=30.0)
        >>> solution.status is Status.INFEASIBLE_FORCES
        True
        >>> print(explain(solution).suggestions[0].text)
        the required margin would have to be at most 1.6503 N
    """

    OPTIMAL = "optimal over all feasible virtual-sliding modes"
    OPTIMAL_IN_MODE = "optimal in the given virtual-sliding mode"
    LIMIT_REACHED = (
        "the best found; that nothing is better was not proven (a node or time limit, a program "
        "that no solver answered, or a proof that does not close)"
    )
    INFEASIBLE_FORCES = (
        "infeasible: no contact forces inside the cones, normal-force and torque limits balance "
        "the external wrench (with the required margin, if one is asked for)"
    )
    INFEASIBLE_MODES = (
        "infeasible: forces that balance exist, but none whose friction opposes a kinematically "
        "feasible virtual sliding"
    )
    INFEASIBLE_IN_MODE = "infeasible in the given virtual-sliding mode"
    INFEASIBLE_MODE = "the given virtual-sliding mode has no virtual motion behind it"
    NOT_FOUND_IN_LIMIT = "nothing found when a node or time limit ended the search"
    UNVERIFIED = "no solver gave an answer that passes the check"
    LOAD_TOO_LARGE = (
        "the load is too large for the limits: what they leave to the joints is lost in the "
        "rounding of the balance"
    )
    STRONG = "the best found of the torques that guarantee rest"
    STRONG_NOT_FOUND = "no torques found that guarantee rest; that there are none is not proven"
    INFEASIBLE_STRONG = "infeasible: no torques guarantee rest"

    @property
    def message(self) -> str:
        """The message in words."""
        return self.value


UNDECIDED = frozenset(
    {Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED, Status.LOAD_TOO_LARGE, Status.STRONG_NOT_FOUND}
)
"""What leaves open whether there is a solution."""
EXPLAINED = (Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES)
"""Of these `explain` tells the cause, and looks for changes that help."""
FOUND = frozenset({Status.OPTIMAL, Status.OPTIMAL_IN_MODE, Status.LIMIT_REACHED, Status.STRONG})


@dataclass(frozen=True, eq=False)
class Guarantee:
    """What a search for torques of which rest is the only outcome has found.

    See the example of `stability`.

    Attributes:
        verdict: On the solution's torques; where none were found, on those of the best case. None
            in solutions that were read from documents.
        best_case: The best value of the objective over all forces that statics leave open, in its
            own unit; guaranteed torques are not better.
        gap: By how much the solution's value is worse, same unit; NaN where none was found. The
            gap to the best bound proven stands in the solution's `certificate`.
        tried: Sets of torques that verdicts were asked of.
    """

    verdict: StabilityVerdict | None
    best_case: float
    gap: float
    tried: int


DualVariables = tuple[FloatArray, FloatArray]
"""Multipliers y, z of the equalities and of the other rows of a scaled program."""


@dataclass(frozen=True, eq=False, repr=False)
class Evidence(Record, Brief):
    """What a search leaves of the proof of its answer.

    Attributes:
        relaxation: Multipliers of the program without modes, or of the given mode where that has no
            forces: they bound every mode, or prove that there is nothing. None: not at hand.
        in_mode: Multipliers of the program in which the solution was found; None: none was.
        added: Values of the columns that the objective adds to the forces', scaled, of the answer
            or, where none was found, beside `forces`; None: neither is there.
        forces: (M, 3) forces that balance where friction needs no virtual sliding, N, of a
            solution for which no mode that admits them was found; None: there are none.
        motion: (P + L,) [V; theta_dot] that may be behind the mode, m/s and rad/s.
    """

    relaxation: DualVariables | None = None
    in_mode: DualVariables | None = None
    added: FloatArray | None = None
    forces: FloatArray | None = None
    motion: FloatArray | None = None


NO_EVIDENCE = Evidence()


@dataclass(frozen=True, eq=False)
class BoundLeaf(Record):
    """Multipliers that prove a part's bound.

    Attributes:
        y: (m,) of the equalities, scaled.
        z: (k,) of the other rows, scaled.
        objective: Whether they bound the objective; else they prove that there are no forces.
    """

    y: FloatArray
    z: FloatArray
    objective: bool


@dataclass(frozen=True, eq=False)
class KinematicLeaf(Record):
    """A combination that excludes every motion of a part.

    Attributes:
        combination: (M, 3) along n, t1, t2.
    """

    combination: FloatArray


@dataclass(frozen=True, eq=False)
class ConflictSplit(Record):
    """Items that exclude each other: each child presumes those before its own, and breaks its own.

    Attributes:
        items: Contact, component and sign; the sign 0: the contact is selected.
        combinations: (M, 3) why they exclude each other; with `opened`, one for each sign left.
        opened: A component that the items leave no sign; None: they exclude each other alone.
    """

    items: tuple[tuple[int, int, int], ...]
    combinations: tuple[FloatArray, ...]
    opened: tuple[int, int] | None


@dataclass(frozen=True)
class ContactSplit:
    """A contact that is not selected, or has one of the pairs of signs that are left to it.

    Attributes:
        contact: Its index.
    """

    contact: int


ProofNode = BoundLeaf | KinematicLeaf | ConflictSplit | ContactSplit


@dataclass(frozen=True, eq=False)
class ModeProof:
    """A proof over a part of all modes.

    Attributes:
        nodes: Depth first, children in their order.
        missing: Why it is not complete; empty: it is.
    """

    nodes: tuple[ProofNode, ...]
    missing: str = ""

    @property
    def complete(self) -> bool:
        """Whether it is a proof."""
        return not self.missing


@dataclass(frozen=True, eq=False, repr=False)
class SolutionProof(Record, Brief):
    """What proves the statements of a solution.

    Attributes:
        tree: Why nothing is better than the stated bound, or why there is nothing at all.
        motion: (P + L,) [V; theta_dot] behind the mode, m/s and rad/s; None: none is asked for.
        forces: (M, 3) forces that balance where friction needs no virtual sliding, for a solution
            that is infeasible by its modes alone; None elsewhere.
        in_mode: Multipliers (y, z) of the mode's own program where the tree is not complete.
    """

    tree: ModeProof
    motion: FloatArray | None = None
    forces: FloatArray | None = None
    in_mode: DualVariables | None = None
