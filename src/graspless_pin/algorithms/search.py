"""What every search over modes keeps and returns, and whether an optimum is at the threshold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from graspless_pin.algorithms.formulation import Formulation
from graspless_pin.algorithms.mode_oracle import FoundMode, ModeOracle
from graspless_pin.algorithms.options import Limits
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.kinematics import VirtualKinematics, requirements_of
from graspless_pin.modes.rules import Conflict, Requirement, Rules, SlidingMode, StaticFriction
from graspless_pin.modes.virtual_motions import CLEARLY
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solution import Status
from graspless_pin.solvers import PRIMAL_TOLERANCE, Answer, Outcome
from graspless_pin.tree_search import Node, TreeSearch

if TYPE_CHECKING:
    from graspless_pin.algorithms.mode_tree import ModePart

CLOSED = 2e-8
"""Values closer than this, in scaled units or relative to them, count as equal."""


def closeness(value: float) -> float:
    """Return how close others must be to a scaled value to count as equal."""
    return CLOSED * max(1.0, abs(value)) if np.isfinite(value) else CLOSED


@dataclass
class SearchState:
    """The best answer so far, and the counters.

    Attributes:
        formulation: The shared program.
        rules: The reading of the constraint.
        solver: The solver to ask first.
        oracle: Finds modes for friction forces.
        relaxation: Answer to the program without modes, once it was solved; of a given mode without
            forces, to its own.
        best: Best answer that a feasible mode admits.
        found: That mode; of a given mode without forces, it itself.
        near: A virtual motion that may be behind the next mode, too, scaled; None: none is known.
        bound: Proven lower bound on the objective over all modes.
        infeasibility: Proof of infeasibility of the relaxation.
        nodes: Nodes or modes looked at.
        modes_examined: Modes solved or ruled out one by one.
        force_programs: Programs in forces solved.
        unproven_bound: The lowest bound of programs that were left without a checked answer.
        cover: Parts that together hold all modes with a motion behind them, whose programs bound
            them; empty where the relaxation does.
    """

    formulation: Formulation
    rules: Rules
    solver: str
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
    def unproven(self) -> bool:
        """Whether a program without a checked answer may hold something better than the best."""
        return self.unproven_bound < np.inf and not self.closed(self.unproven_bound)

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
        answer = self.formulation.solve(lb, ub, self.solver, cutoff=self.best_value)
        if answer.outcome is Outcome.FAILED:
            self.unproven_bound = min(self.unproven_bound, answer.bound)
        return answer

    def relax(self) -> Answer:
        """Solve the relaxation without (27) and (31); its bound holds for every mode."""
        program = self.formulation.program
        return self.relaxed(self.solve(program.lb, program.ub))

    def relaxed(self, answer: Answer) -> Answer:
        """Keep the answer to the relaxation and what it proves."""
        self.relaxation = answer
        self.bound = answer.bound
        if answer.outcome is Outcome.INFEASIBLE:
            self.infeasibility = answer.proof
        return answer

    def accept(self, answer: Answer, found: FoundMode, admitted: FloatArray | None = None) -> bool:
        """Keep an answer that a feasible mode admits, if it is the best so far.

        The friction that the mode forbids is below the threshold of the oracle and is cut off;
        where that breaks the balance the mode's own program is solved instead.

        Args:
            answer: The answer.
            found: The mode.
            admitted: What it admits of the answer's x, if that is known.

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
                exact = answer.moved(x, self.formulation.program.value(x), residual)
        if exact.value < self.best_value:
            self.keep(exact, found)
        return exact.value <= answer.value + closeness(exact.value)

    def keep(self, answer: Answer, found: FoundMode) -> None:
        """Keep a mode and its answer as the best so far."""
        self.best, self.found = answer, found
        if found.motion is not None:
            self.near = found.motion

    def raise_bound(self, bound: float) -> None:
        """Raise the proven bound over all modes, never above the best value."""
        self.bound = max(self.bound, min(bound, self.best_value))

    def closed(self, bound: float) -> bool:
        """Whether nothing at or above this bound can beat the best answer."""
        return self.best_value <= bound + closeness(self.best_value)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """How a search ended.

    Attributes:
        status: What is known.
        state: The best answer, its mode, the bound and the counters.
    """

    status: Status
    state: SearchState


def finished(state: SearchState, *, interrupted: bool = False) -> SearchResult:
    """Return the result of a search that has ended, and close the bound if it was completed."""
    if interrupted or state.unproven:
        found, nothing = Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT
        if not interrupted:
            nothing = Status.UNVERIFIED
        return SearchResult(nothing if state.best is None else found, state)
    if state.best is None:
        return SearchResult(Status.INFEASIBLE_MODES, state)
    return SearchResult(Status.OPTIMAL, state)


def undecided(state: SearchState) -> SearchResult:
    """Return the result of a search in which no solver decided on a virtual motion."""
    state.unproven_bound = -np.inf
    return finished(state)


def relaxation(state: SearchState) -> Answer | SearchResult:
    """Return the answer to the relaxation, the first node; without one, how the search ended."""
    answer = state.relax()
    state.nodes += 1
    if answer.outcome is Outcome.SOLVED:
        return answer
    failed = answer.outcome is Outcome.FAILED
    return SearchResult(Status.UNVERIFIED if failed else Status.INFEASIBLE_FORCES, state)


def best_first(
    state: SearchState,
    limits: Limits,
    root: tuple[float, list[Node] | None],
    expand: Callable[[Node, float], tuple[float, list[Node] | None]],
    closed: Callable[[float], bool],
) -> tuple[SearchResult, tuple[Node, ...]]:
    """Search from the relaxation on, the node with the lowest bound first.

    Args:
        state: The search to run.
        limits: When to stop.
        root: What `expand` would return of the relaxation.
        expand: Looks at a node with a proven bound: what is proven then, and its children; None
            where it is left without being split.
        closed: Whether nothing at or above a bound is of interest.

    Returns:
        How it ended, and nodes that hold all there is and whose bounds were enough; none where a
        limit ended it.
    """
    bound, children = root
    search = TreeSearch(children or (), bound)
    # The lowest bound of the nodes that were left without being split: no optimum lies below it.
    left = bound if children is None else np.inf
    cover: list[Node] = []
    for before, node in search:
        state.raise_bound(min(before, left))
        if closed(before):
            return finished(state), (*cover, node, *search.left())
        if limits.end(state.nodes):
            return finished(state, interrupted=True), ()
        bound, children = expand(node, before)
        if children is None:
            left = min(left, bound)
            cover.append(node)
        search.add(children or (), bound)
    state.raise_bound(left)
    return finished(state), tuple(cover)


def in_mode(state: SearchState, mode: SlidingMode, requirements: list[Requirement]) -> SearchResult:
    """Solve one given mode only."""
    state.nodes = state.modes_examined = 1
    state.oracle.kinematic_programs += 1
    kinematics = state.formulation.kinematics
    try:
        verdict = kinematics.solve(requirements, state.rules.sign)
    except UndecidedMotionError:
        return undecided(state)
    if isinstance(verdict, Conflict):
        return SearchResult(Status.INFEASIBLE_MODE, state)
    state.found = FoundMode(mode, kinematics.scaled_motion(verdict.coordinates))
    answer = state.solve(*state.formulation.bounds_of(mode))
    state.bound = answer.bound
    if answer.outcome is Outcome.SOLVED:
        state.best = answer
        return SearchResult(Status.OPTIMAL_IN_MODE, state)
    failed = answer.outcome is Outcome.FAILED
    state.relaxation, state.infeasibility = answer, answer.proof
    return SearchResult(Status.UNVERIFIED if failed else Status.INFEASIBLE_IN_MODE, state)


FACTORS = (0.1, 10.0)
"""The thresholds that an optimum is compared for, over the rule's own."""
_SAME = 1e-6

ModeSearch = Callable[[SearchState], SearchResult]


def threshold_optima(
    result: SearchResult, search: ModeSearch, gap: float = 0.0
) -> tuple[float, float] | None:
    """Return the optimum for a tenth and for ten times the threshold, where it hangs on it.

    Nothing is solved where the motion behind the mode is clearly fast enough and the search refused
    none that a tenth of the threshold would admit: then all three are the same.

    Args:
        result: How the search ended.
        search: Repeats it from a state whose formulation has another threshold.
        gap: How near each of two optima is found, over the load or the optimum.

    Returns:
        Two optima, NaN where nothing is feasible or the search was not completed; None where
        neither differs by more than 1e-6 of the load, or of the optimum where that is larger, and
        two gaps.
    """
    state = result.state
    formulation, kinematics = state.formulation, state.formulation.kinematics
    if state.rules.static_friction is StaticFriction.COULOMB:
        return None
    if not (kinematics.undecided_near or _is_slow(result)):
        return None
    values = []
    for factor in FACTORS:
        other = VirtualKinematics(formulation.problem, factor * kinematics.threshold)
        again = SearchState(replace(formulation, kinematics=other), state.rules, state.solver)
        best = search(again).state.best
        values.append(np.nan if best is None else best.value)
    own = np.nan if state.best is None else state.best.value
    if all(_agree(own, value, _SAME + 2.0 * gap) for value in values):
        return None
    return formulation.unit * values[0], formulation.unit * values[1]


def _is_slow(result: SearchResult) -> bool:
    """Whether the motion behind the best mode is slower than ten times the threshold."""
    state = result.state
    if state.mode is None or state.found is None or state.found.is_clear:
        return False
    if state.rules.by_direction:
        return True  # the search itself has looked
    kinematics = state.formulation.kinematics
    try:
        slowest = kinematics.slowest(requirements_of(state.mode), state.rules.sign)
    except UndecidedMotionError:
        return True
    return slowest < CLEARLY * kinematics.threshold


def _agree(one: float, other: float, same: float) -> bool:
    if np.isnan(one) or np.isnan(other):
        return bool(np.isnan(one) and np.isnan(other))
    return abs(one - other) <= same * max(1.0, abs(one))
