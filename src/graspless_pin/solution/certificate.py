"""What an answer is worth: its status, how well it is proven, and the verdict asked for."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from graspless_pin.holding.verdict import StabilityVerdict


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
            the same as here.
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
        "the external wrench with the required margin"
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
