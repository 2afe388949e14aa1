"""What is found of many states: arrays with an entry for each state."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.robust_solution import Coverage
from graspless_pin.algorithms.search import CLOSED
from graspless_pin.planning.evaluation import STATUSES, Evaluation, StateStatus
from graspless_pin.planning.many_states import Arrays, Progress, StateArrays, gathered
from graspless_pin.planning.state_loops import SolvedStates
from graspless_pin.planning.state_solver import StateSolver
from graspless_pin.planning.warm_starts import WarmState
from graspless_pin.problem.checks import FloatArray, whole_number
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.scene.joints import possible_columns
from graspless_pin.solution.tables import brief_figure

_FOUND = STATUSES.index(StateStatus.FOUND)
_COVERAGES = None, *Coverage


class StateFigures(NamedTuple):
    """What is kept of K states on the way to `EvaluatedStates`, whose attributes these are.

    Attributes:
        codes: (K,) numbers of the statuses among `STATUSES`.
        margins: (K,).
        torques: (K, L).
        contact_counts: (K,).
        bounds: (K,).
        gaps: (K,).
        residuals: (K,).
        coverages: (K,) numbers among `_COVERAGES`.
    """

    codes: NDArray[np.uint8]
    margins: FloatArray
    torques: FloatArray
    contact_counts: NDArray[np.int32]
    bounds: FloatArray
    gaps: FloatArray
    residuals: FloatArray
    coverages: NDArray[np.uint8]

    @classmethod
    def room(cls, count: int, joint_count: int) -> StateFigures:
        """Return room for states, each without a problem."""
        unknown = np.full((3, count), np.nan)
        torques, counts = np.full((count, joint_count), np.nan), np.zeros(count, dtype=np.int32)
        codes, covered = np.zeros((2, count), dtype=np.uint8)
        margins = np.full(count, -np.inf)
        return cls(codes, margins, torques, counts, *unknown, coverages=covered)

    def put(self, number: int, evaluation: Evaluation, torque_names: tuple[str, ...]) -> None:
        """Enter what was found of one state.

        Args:
            number: Of the state.
            evaluation: The answer.
            torque_names: L names of the columns of the torques.
        """
        self.codes[number] = STATUSES.index(evaluation.status)
        if not evaluation.has_contacts:
            return
        certificate, robust = evaluation.solution.certificate, evaluation.robust
        problem, bound = evaluation.solution.problem, certificate.bound
        if robust is not None:
            problem, bound = robust.members[0].problem, robust.bound
            self.coverages[number] = _COVERAGES.index(robust.coverage)
        self.contact_counts[number] = problem.contact_count
        self.bounds[number] = bound
        if evaluation.found:
            columns = _columns(evaluation.joint_names, torque_names)
            self.margins[number] = evaluation.margin
            self.torques[number, columns] = evaluation.torques
            self.gaps[number] = abs(bound - robust.value) if robust else certificate.gap
            self.residuals[number] = robust.residual if robust else certificate.primal_residual

    def put_solved(self, number: int, state: WarmState, torque_names: tuple[str, ...]) -> None:
        """Enter what was found of one state whose optimum was carried over: see `put`."""
        problem, optimum = state.problem, state.optimum
        self.codes[number] = _FOUND
        self.contact_counts[number] = len(problem.positions)
        self.margins[number] = problem.margin_of(optimum.forces)
        torques = problem.jacobian.T @ optimum.forces.ravel() + problem.gravity_torques
        self.torques[number, _columns(problem.joint_names, torque_names)] = torques
        self.bounds[number] = optimum.bound * optimum.unit
        self.gaps[number] = optimum.gap
        self.residuals[number] = optimum.residual

    def put_all(self, solved: SolvedStates, columns: Any) -> None:
        """Enter what was found, with the torques in some columns: see `put`."""
        found, faulty = solved.found, solved.faults != _FOUND
        self.codes[found], self.codes[faulty] = _FOUND, solved.faults[faulty]
        self.contact_counts[found] = solved.contact_counts[found]
        margins, _, bounds, gaps, residuals, _ = solved.figures.T
        for own, values in (
            (self.margins, margins),
            (self.bounds, bounds),
            (self.gaps, gaps),
            (self.residuals, residuals),
        ):
            own[found] = values[found]
        self.torques[np.ix_(found, columns)] = solved.torques[found]


def _columns(names: tuple[str, ...], torque_names: tuple[str, ...]) -> Any:
    """Return where some torques stand among all."""
    return ... if names == torque_names else [torque_names.index(name) for name in names]


@dataclass(frozen=True, eq=False, repr=False)
class EvaluatedStates:
    """What `Evaluator.evaluate_many` found of K states; all arrays are read-only.

    Attributes:
        torque_names: L names of all torques that any state may have.
        torque_units: L units.
        statuses: (K,) the `StateStatus` of each: ``statuses == StateStatus.FOUND`` is a mask.
        margins: (K,) N, -inf where there are no torques.
        torques: (K, L) motor torques, N m (N for linear and hybrid joints and tendons); NaN where
            there are none.
        contact_counts: (K,) number of contacts that carry force; 0 where there is no problem.
        bounds: (K,) proven bound on the optimum over all modes, see `Certificate.bound`; where
            nothing is found it is that of the search, NaN where there is no problem.
        gaps: (K,) distance of what was found from that bound, same unit; NaN where nothing was.
        residuals: (K,) largest violation of a constraint by the forces behind the torques, scaled,
            see `Certificate.primal_residual`; NaN where nothing was found.
        coverages: (K,) the `Coverage` of each: which members of the evaluator's uncertainty the
            answer is proven for; None where it has none, or there is no problem.
        evaluations: The whole answer by number of the state, for those that were asked for.

    Examples:
        >>> import numpy as np
        >>> from graspless_pin import Evaluator, load_scene
        >>> evaluator = Evaluator(load_scene("examples/trihand_pivot_box.yaml"))
        >>> q = evaluator.configuration() + np.linspace(0.0, 0.002, 5)[:, None]  # rad
        >>> states = evaluator.evaluate_many(q)
        >>> states.found.tolist(), states.margins.round(4).tolist()
        ([True, True, True, True, True], [1.131, 1.1305, 1.1301, 1.1296, 1.1292])
    """

    torque_names: tuple[str, ...]
    torque_units: tuple[JointUnit, ...]
    statuses: NDArray[np.object_]
    margins: FloatArray
    torques: FloatArray
    contact_counts: NDArray[np.int32]
    bounds: FloatArray
    gaps: FloatArray
    residuals: FloatArray
    coverages: NDArray[np.object_]
    evaluations: Mapping[int, Evaluation]

    @property
    def found(self) -> NDArray[np.bool_]:
        """(K,) whether there are torques."""
        found: NDArray[np.bool_] = self.statuses == StateStatus.FOUND
        return found

    def __len__(self) -> int:
        """K."""
        return len(self.margins)

    def __repr__(self) -> str:
        """Return one line."""
        return f"<EvaluatedStates: {str(self).partition(chr(10))[0]}>"

    def __str__(self) -> str:
        """Return how many states ended how, and the range of the margins."""
        counts = Counter(self.statuses.tolist()).most_common()
        lines = [f"{len(self)} states"]
        lines += [f"{count:>{len(str(len(self)))}} {status.message}" for status, count in counts]
        if self.found.any():
            ends = float(self.margins[self.found].min()), float(self.margins[self.found].max())
            least, most = (brief_figure(end, max(map(abs, ends))) for end in ends)
            lines.append(f"margins from {least} to {most} N")
        return "\n".join(lines)


def evaluated_states(
    solver: StateSolver,
    states: StateArrays,
    kept: Sequence[int],
    workers: int | None,
    progress: Progress | None,
) -> EvaluatedStates:
    """Return what is found of states: see `Evaluator.evaluate_many`."""
    whole = [whole_number("evaluations", number, 0, states.total - 1) for number in kept]
    columns = possible_columns(solver.configurations.scene.hand)
    names = tuple(columns)
    figures = StateFigures(*gathered(figures_of, solver, states, workers, progress))
    evaluations = {number: solver.evaluate(*states.one(number)) for number in whole}
    for number, evaluation in evaluations.items():
        figures.put(number, evaluation, names)
    statuses = np.array(STATUSES, dtype=object)[figures.codes]
    coverages = np.array(_COVERAGES, dtype=object)[figures.coverages]
    for array in (statuses, coverages, *figures):
        array.setflags(write=False)
    return EvaluatedStates(
        names, tuple(columns.values()), statuses, *figures[1:-1], coverages, evaluations
    )


def figures_of(solver: StateSolver, states: StateArrays) -> StateFigures:
    """Solve states: by loops where they can, else one after the other."""
    hand = solver.configurations.scene.hand
    names = tuple(possible_columns(hand))
    figures = StateFigures.room(states.total, len(names))

    def alone(number: int) -> None:
        answer = solver.solved(*states.one(number))
        if isinstance(answer, Evaluation):
            figures.put(number, answer, names)
        else:
            figures.put_solved(number, answer, names)

    solved = solved_or_alone(solver, states, solver.objective, alone)
    if solved is not None:
        figures.put_all(solved, [names.index(name) for name in solved.joint_names])
    return figures


def solved_or_alone(
    solver: StateSolver,
    states: StateArrays,
    objective: Objective,
    alone: Callable[[int], object],
    enough: float | None = None,
) -> SolvedStates | None:
    """Solve many states by `StateLoops.optima_of_states`; where that is None, each alone."""
    solved = None
    if solver.uncertainty is None:
        solved = solver.loops.optima_of_states(states.configurations, objective, alone, enough)
    if solved is None:
        for number in range(states.total):
            alone(number)
    return solved


def feasible_states(
    solver: StateSolver,
    states: StateArrays,
    margin: float,
    workers: int | None,
    progress: Progress | None,
) -> NDArray[np.bool_]:
    """Return which states are feasible: see `Evaluator.are_feasible`."""
    decide = partial(feasible_ones, margin=margin)
    (feasible,) = gathered(decide, solver, states, workers, progress)
    return feasible


def feasible_ones(solver: StateSolver, states: StateArrays, margin: float) -> Arrays:
    """Decide on states: by loops where they can, else one after the other."""
    feasible = np.zeros(states.total, dtype=bool)

    def alone(number: int) -> None:
        feasible[number] = solver.reaches(*states.one(number), margin)

    if margin < 0.0:  # none is asked for
        for number in range(states.total):
            alone(number)
        return (feasible,)
    solved = solved_or_alone(solver, states, Margin(), alone, margin)
    if solved is not None:
        found = solved.found
        _, value, _, _, _, unit = solved.figures[found].T
        goal = margin / np.abs(unit)
        feasible[found] = value <= CLOSED * np.maximum(1.0, goal) - goal
    return (feasible,)
