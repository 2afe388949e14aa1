"""The state of a search over modes, and the loop of best-first searches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, NamedTuple

import numpy as np

from graspless_pin.algorithms.formulation import Formulation
from graspless_pin.algorithms.mode_oracle import FoundMode, ModeOracle
from graspless_pin.algorithms.mode_tree import ModePart
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.modes.rules import Rules, SlidingMode, StaticFriction
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solution import Status
from graspless_pin.solvers import PRIMAL_TOLERANCE, Answer, Outcome
from graspless_pin.tree_search import NO_LIMITS, Limits, Node, TreeSearch

OPTIMALITY_TOLERANCE = 2e-8
"""Values closer than this, in scaled units or relative to them, count as equal."""


def optimality_tolerance(value: float) -> float:
    """Return the difference up to which scaled values count as equal to an optimum."""
    return (
        OPTIMALITY_TOLERANCE * max(1.0, abs(value)) if np.isfinite(value) else OPTIMALITY_TOLERANCE
    )


@dataclass
class SearchState:
    """The best answer so far, and the counters.

    Attributes:
        formulation: The shared program.
        options: How the problem is solved.
        limits: When the search has to end.
        oracle: Finds modes for friction forces.
        relaxation: Answer to the program without modes, once it was solved; for a given mode
            without forces, to the program of that mode.
        best: Best answer that a feasible mode admits.
        found: The mode of the best answer; where a given mode has no forces, that mode.
        near: A virtual motion that may also fit the next mode, scaled; None: none is known.
        bound: Proven lower bound on the objective over all modes.
        infeasibility: Proof of infeasibility of the relaxation.
        nodes: Number of nodes or modes visited.
        modes_examined: Number of modes solved or excluded one by one.
        force_programs: Number of programs in forces solved.
        unproven_bound: The lowest bound of programs that were left without a checked answer.
        cover: Parts that contain all feasible modes and whose programs bound them; empty where the
            relaxation does.
    """

    formulation: Formulation
    options: SolveOptions
    limits: Limits = NO_LIMITS
    oracle: ModeOracle = field(init=False)
    relaxation: Answer | None = None
    best: Answer | None = None
    found: FoundMode | None = None
    near: FloatArray | None = None
    bound: float = -np.inf
    infeasibility: float = 0.0
    nodes: int = 0
    modes_examined: int = 0
    force_programs: int = 0
    unproven_bound: float = np.inf
    cover: tuple[ModePart, ...] = ()

    def __post_init__(self) -> None:
        """Make the oracle."""
        self.oracle = ModeOracle(self.formulation, self.rules)

    @property
    def rules(self) -> Rules:
        """The reading of the virtual-sliding constraint."""
        return self.options.rules

    @property
    def unproven(self) -> bool:
        """Whether a program without a checked answer may have a better value than the best."""
        return self.unproven_bound < np.inf and not self.is_closed(self.unproven_bound)

    @property
    def mode(self) -> SlidingMode | None:
        """The mode of the best answer."""
        return None if self.best is None or self.found is None else self.found.mode

    @property
    def best_value(self) -> float:
        """Objective of the best answer; inf without one."""
        return np.inf if self.best is None else self.best.value

    def solve(self, lb: FloatArray, ub: FloatArray) -> Answer:
        """Solve the program under bounds and count it."""
        self.force_programs += 1
        answer = self.formulation.solve(lb, ub, self.options.solver, cutoff=self.best_value)
        if answer.outcome is Outcome.FAILED:
            self.unproven_bound = min(self.unproven_bound, answer.bound)
        return answer

    def relax(self) -> Answer:
        """Solve the relaxation without (27) and (31), once; its bound holds for every mode."""
        if self.relaxation is not None:
            return self.relaxation
        program = self.formulation.program
        return self.store_relaxation(self.solve(program.lb, program.ub))

    def store_relaxation(self, answer: Answer) -> Answer:
        """Store the relaxation's answer, the first node, with its bound and proof; return it."""
        self.relaxation = answer
        self.nodes += 1
        self.bound = answer.bound
        if answer.outcome is Outcome.INFEASIBLE:
            self.infeasibility = answer.proof
        return answer

    def offer(self, answer: Answer, found: FoundMode, admitted: FloatArray | None = None) -> bool:
        """Keep an answer without the friction that a feasible mode forbids, if it is the best.

        That friction is below the threshold of the oracle and is set to zero; where that breaks the
        balance the mode's own program is solved instead.

        Args:
            answer: The answer.
            found: The mode.
            admitted: The answer's x without forbidden friction, if that is known.

        Returns:
            Whether the answer's own value was reached.
        """
        exact = answer
        if self.rules.static_friction is StaticFriction.COULOMB:
            admitted = answer.x  # the mode only describes it
        x = self.formulation.admitted(found.mode, answer.x) if admitted is None else admitted
        if x is not answer.x:
            residual = self.formulation.program.residual(x)
            if residual > PRIMAL_TOLERANCE:
                exact = self.solve(*self.formulation.bounds_of(found.mode))
                if exact.outcome is not Outcome.SOLVED:
                    return False
            else:
                exact = answer.at_point(x, self.formulation.program.value(x), residual)
        if exact.value < self.best_value:
            self.keep(exact, found)
        return exact.value <= answer.value + optimality_tolerance(exact.value)

    def keep(self, answer: Answer, found: FoundMode) -> None:
        """Keep a mode and its answer as the best so far."""
        self.best, self.found = answer, found
        if found.motion is not None:
            self.near = found.motion

    def raise_bound(self, bound: float) -> None:
        """Raise the proven bound over all modes, never above the best value."""
        self.bound = max(self.bound, min(bound, self.best_value))

    def is_closed(self, bound: float) -> bool:
        """Whether nothing at or above this bound can beat the best answer."""
        return self.best_value <= bound + optimality_tolerance(self.best_value)

    def final_status(self, *, interrupted: bool = False) -> Status:
        """Return the status of a search that has ended, by a limit or completed."""
        if not interrupted and not self.unproven:
            return Status.INFEASIBLE_MODES if self.best is None else Status.OPTIMAL
        if self.best is not None:
            return Status.LIMIT_REACHED
        return Status.NOT_FOUND_IN_LIMIT if interrupted else Status.UNVERIFIED

    def undecided_status(self) -> Status:
        """Return the status of a search in which no solver decided on a virtual motion."""
        self.unproven_bound = -np.inf
        return self.final_status()


def unsolved_status(answer: Answer, infeasible: Status) -> Status:
    """Return the status of a search whose first program has no solution, or no proven answer."""
    return Status.UNVERIFIED if answer.outcome is Outcome.FAILED else infeasible


class Fathomed(NamedTuple):
    """A node without children: its bound is no better than the best value, or it cannot be split.

    Attributes:
        bound: Proven lower bound of the node.
    """

    bound: float


class Split(NamedTuple, Generic[Node]):
    """The children of a node.

    Attributes:
        bound: Proven lower bound of all children.
        children: Nodes whose union is the node; empty: nothing feasible is in it.
    """

    bound: float
    children: list[Node]


def best_first(
    state: SearchState,
    root: Fathomed | Split[Node],
    expand: Callable[[Node, float], Fathomed | Split[Node]],
    closed: Callable[[float], bool],
) -> tuple[Status, tuple[Node, ...]]:
    """Search from the relaxation on, the node with the lowest bound first.

    Args:
        state: The search to run.
        root: The result of `expand` for the relaxation.
        expand: Fathoms or splits a node, given its proven bound.
        closed: Whether nothing at or above a bound is of interest.

    Returns:
        The status, and nodes that cover the search space with sufficient bounds; none where a limit
        ended the search.
    """
    search = TreeSearch[Node](() if isinstance(root, Fathomed) else root.children, root.bound)
    # The lowest bound of fathomed nodes: no optimum in them lies below it.
    fathomed_bound = root.bound if isinstance(root, Fathomed) else np.inf
    cover: list[Node] = []
    for before, node in search:
        state.raise_bound(min(before, fathomed_bound))
        if closed(before):
            return state.final_status(), (*cover, node, *search.open_nodes())
        if state.limits.is_over(state.nodes):
            return state.final_status(interrupted=True), ()
        outcome = expand(node, before)
        if isinstance(outcome, Fathomed):
            fathomed_bound = min(fathomed_bound, outcome.bound)
            cover.append(node)
        else:
            search.add(outcome.children, outcome.bound)
    state.raise_bound(fathomed_bound)
    return state.final_status(), tuple(cover)
