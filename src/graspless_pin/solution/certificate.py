"""The status of an answer, its certificate, its proof and the guarantee of rest.

The proof that no mode gives a better answer is the tree of the branch and bound search. Each node
is a set of modes. A leaf holds the reason why no mode of its set is better than the stated bound:
the dual multipliers of its program, or a combination of constraints that excludes every virtual
motion. An inner node states how its set is split, so that no mode is left out.
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
    """Residuals, bounds and effort of a search, which show how well its answer is proven.

    Values are in scaled units (forces and margin over the load F, torques over that of F on the
    joint's longest lever; see `problem.scales`) unless a unit is given.

    See the example of `Status`.

    Attributes:
        primal_residual: Largest violation of any constraint by the returned forces.
        duality_gap: Objective minus the bound proven by the multipliers of its program.
        bound: Proven bound on the optimum over all modes: an upper bound on the margin in N
            (Algorithm 1), a lower bound on the largest torque (Algorithm 2: N m, or a share of
            the limits). With a regularisation it bounds the regularised objective.
        gap: Distance between the returned objective and that bound, same unit.
        infeasibility: Proven smallest common violation of all constraints if infeasible.
        modes_examined: Number of virtual-sliding modes that were solved or ruled out one by one.
        nodes: Number of nodes of the search.
        force_programs: Number of LPs or QPs in forces that were solved, by a warm start or not.
        kinematic_programs: Number of kinematic feasibility problems that were solved.
        solver: The solver whose answer passed the check, or, if an `Evaluator` warm-started from
            another state, the one whose answer passed there; ``loops``: the compiled loops alone.
        force_reach: The largest normal force up to which the bound is proven, N: the largest limit,
            or 1e8 times the load.
        threshold_optima: The optima with a tenth and with ten times the threshold of what counts
            as a virtual motion, in the bound's unit, NaN if nothing is feasible; None: both are the
            same as here, or not known.
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
    """The outcome of a search; the value is its message.

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
        "the best found; a better answer is not ruled out (a node or time limit, a program that no "
        "solver answered, or a proof that leaves a gap)"
    )
    INFEASIBLE_FORCES = (
        "infeasible: no contact forces inside the friction cones and within the normal-force and "
        "torque limits balance the external wrench (with the required margin, if there is one)"
    )
    INFEASIBLE_MODES = (
        "infeasible: forces that balance exist, but none whose friction opposes a kinematically "
        "feasible virtual sliding"
    )
    INFEASIBLE_IN_MODE = "infeasible in the given virtual-sliding mode"
    INFEASIBLE_MODE = "the given virtual-sliding mode has no virtual motion: it is infeasible"
    NOT_FOUND_IN_LIMIT = "nothing found when a node or time limit ended the search"
    UNVERIFIED = "no solver gave an answer that passes the check"
    LOAD_TOO_LARGE = (
        "the load is too large for the limits: with such a load, double precision cannot resolve "
        "them"
    )
    STRONG = "the best found of the torques that guarantee rest"
    STRONG_NOT_FOUND = "no torques found that guarantee rest; it is not proven that there are none"
    INFEASIBLE_STRONG = "infeasible: no torques guarantee rest"

    @property
    def message(self) -> str:
        """The message in words."""
        return self.value


UNDECIDED = frozenset(
    {Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED, Status.LOAD_TOO_LARGE, Status.STRONG_NOT_FOUND}
)
"""Statuses that leave open whether there is a solution."""
EXPLAINED = (Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES)
"""Statuses whose cause `explain` finds, with changes that would help."""
FOUND = frozenset({Status.OPTIMAL, Status.OPTIMAL_IN_MODE, Status.LIMIT_REACHED, Status.STRONG})


@dataclass(frozen=True, eq=False)
class Guarantee:
    """Result of a search for torques under which rest is the only outcome.

    See the example of `stability`.

    Attributes:
        verdict: Verdict on the solution's torques; if none were found, on those of the best case.
            None in solutions read from documents.
        best_case: The best value of the objective over all statically possible forces, in its own
            unit; guaranteed torques are not better.
        gap: Difference of the solution's value to the best case, same unit; NaN if none was found.
            The gap to the best proven bound is in the solution's `certificate`.
        tried: Number of torque vectors for which verdicts were computed.
    """

    verdict: StabilityVerdict | None
    best_case: float
    gap: float
    tried: int


DualVariables = tuple[FloatArray, FloatArray]
"""Multipliers y, z of the equalities and of the other rows of a scaled program."""


@dataclass(frozen=True, eq=False, repr=False)
class Evidence(Record, Brief):
    """Parts of the proof that a search keeps with its answer.

    Attributes:
        relaxation: Multipliers of the program without modes, or of the given mode if that has no
            forces: they bound every mode, or prove infeasibility. None: not available.
        in_mode: Multipliers of the program in which the solution was found; None: none was.
        added: Values of the columns that the objective adds to the forces', scaled, for the answer
            or, if none was found, for `forces`; None: there is neither.
        forces: (M, 3) forces that balance if friction needs no virtual sliding, N, when no mode
            that admits them was found; None: there are none.
        motion: (P + L,) [V; theta_dot], a candidate for the mode's virtual motion, m/s and rad/s.
    """

    relaxation: DualVariables | None = None
    in_mode: DualVariables | None = None
    added: FloatArray | None = None
    forces: FloatArray | None = None
    motion: FloatArray | None = None


NO_EVIDENCE = Evidence()


@dataclass(frozen=True, eq=False)
class BoundLeaf(Record):
    """Multipliers that prove the bound of a part of all modes.

    Attributes:
        y: (m,) multipliers of the equalities, scaled.
        z: (k,) multipliers of the other rows, scaled.
        objective: Whether they bound the objective; else they prove that there are no forces.
    """

    y: FloatArray
    z: FloatArray
    objective: bool


@dataclass(frozen=True, eq=False)
class KinematicLeaf(Record):
    """A combination of constraints that excludes every virtual motion of a part of all modes.

    Attributes:
        combination: (M, 3) weights along n, t1, t2.
    """

    combination: FloatArray


@dataclass(frozen=True, eq=False)
class ConflictSplit(Record):
    """A split by conflicting items: child k satisfies the items before item k, and violates item k.

    Attributes:
        items: Contact, component and sign; the sign 0: the contact is selected.
        combinations: (M, 3) weights that prove the conflict; with `opened`, one array for each sign
            that is left.
        opened: A component for which the items leave no sign; None: the items conflict themselves.
    """

    items: tuple[tuple[int, int, int], ...]
    combinations: tuple[FloatArray, ...]
    opened: tuple[int, int] | None


@dataclass(frozen=True)
class ContactSplit:
    """A split by a contact: it is not selected, or has one of its remaining pairs of signs.

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
        missing: Why the proof is not complete; empty if it is.
    """

    nodes: tuple[ProofNode, ...]
    missing: str = ""

    @property
    def complete(self) -> bool:
        """Whether the proof is complete."""
        return not self.missing


@dataclass(frozen=True, eq=False, repr=False)
class SolutionProof(Record, Brief):
    """The proof of a solution's statements.

    Attributes:
        tree: Proof of the stated bound, or of infeasibility.
        motion: (P + L,) [V; theta_dot], the mode's virtual motion, m/s and rad/s; None: not needed.
        forces: (M, 3) forces that balance if friction needs no virtual sliding, for a solution that
            is infeasible only by its modes; else None.
        in_mode: Multipliers (y, z) of the mode's own program if the tree is not complete.
    """

    tree: ModeProof
    motion: FloatArray | None = None
    forces: FloatArray | None = None
    in_mode: DualVariables | None = None
