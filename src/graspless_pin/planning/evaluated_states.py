"""What is found of many states: arrays with an entry for each state."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.search import CLOSED
from graspless_pin.planning.evaluation import STATUSES, Evaluation, StateStatus
from graspless_pin.planning.many_states import Arrays, Progress, StateArrays, gathered
from graspless_pin.planning.state_loops import COVERAGES, StateFigures
from graspless_pin.planning.state_solver import StateSolver
from graspless_pin.problem.checks import FloatArray, whole_number
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.programs.objectives import Margin
from graspless_pin.scene.joints import possible_columns
from graspless_pin.solution.tables import brief_figure


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
    found = StateFigures(*gathered(figures_of, solver, states, workers, progress))
    evaluations = {number: solver.evaluate(*states.one(number)) for number in whole}
    for number, evaluation in evaluations.items():
        found.put(number, evaluation, names)
    margins, _, bounds, gaps, residuals, _ = found.figures.T.copy()
    statuses = np.array(STATUSES, dtype=object)[found.codes]
    coverages = np.array(COVERAGES, dtype=object)[found.coverages]
    torques, counts = found.torques, found.contact_counts
    arrays = statuses, margins, torques, counts, bounds, gaps, residuals, coverages
    for array in arrays:
        array.setflags(write=False)
    return EvaluatedStates(names, tuple(columns.values()), *arrays, evaluations)


def figures_of(solver: StateSolver, states: StateArrays) -> StateFigures:
    """Solve states: by loops where they can, else one after the other."""
    names = tuple(possible_columns(solver.configurations.scene.hand))
    found = StateFigures.room(states.total, len(names))

    def alone(number: int, clear: bool) -> None:
        found.put(number, solver.solved(*states.one(number), clear=clear), names)

    solver.loops.optima_of_states(_looped(solver, states), solver.objective, found, alone)
    return found


def _looped(solver: StateSolver, states: StateArrays) -> FloatArray | None:
    """Return (K, a) the configurations that loops are asked for; None: each state goes alone."""
    return states.configurations if solver.uncertainty is None else None


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

    def alone(number: int, clear: bool) -> None:
        feasible[number] = solver.reaches(*states.one(number), margin, clear=clear)

    found = StateFigures.room(states.total, len(possible_columns(solver.configurations.scene.hand)))
    q = _looped(solver, states) if margin >= 0.0 else None  # below zero none is asked for
    solver.loops.optima_of_states(q, Margin(), found, alone, margin)
    looped = found.contact_counts > 0
    _, value, _, _, _, unit = found.figures[looped].T
    goal = margin / np.abs(unit)
    feasible[looped] = value <= CLOSED * np.maximum(1.0, goal) - goal
    return (feasible,)
