"""How well an answer is proven."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
        force_programs: LPs or QPs in forces that were solved, or carried over and proven.
        kinematic_programs: Kinematic feasibility problems that were solved.
        solver: The solver whose answer passed the check, or, where an `Evaluator` carried the
            optimum of another state over, the one that answered there; ``loops``: the
            compiled loops did by themselves.
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
