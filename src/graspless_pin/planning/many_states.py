"""Evaluation of many states, in this process or in several, with results as arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain, repeat
from time import thread_time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.child_process import kept_processes, shared_work, usable_cores
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.poses import RIGIDITY_TOLERANCE, as_pose
from graspless_pin.planning.configurations import Configuration, Configurations
from graspless_pin.planning.evaluation import STATUSES, Evaluation, StateStatus
from graspless_pin.planning.state_loops import COVERAGES, StateFigures, is_reached
from graspless_pin.planning.state_solver import StateSolver
from graspless_pin.problem.checks import (
    FloatArray,
    JointUnit,
    all_within,
    check_callback,
    finite_array,
    whole_number,
)
from graspless_pin.programs.objectives import Margin
from graspless_pin.records import Record
from graspless_pin.scene.problem_data import possible_columns
from graspless_pin.scene.stated import Motion
from graspless_pin.solution.tables import brief_figure

Progress = Callable[[int, int], object]
"""Called with the number of states that are done, and with that of all."""
Arrays = tuple[NDArray[Any], ...]
"""Arrays with an entry for each state."""

_STATES_AT_ONCE = 1000
"""States in one chunk: tens of milliseconds, long compared to the communication with a process."""
_FIRST_STATES = 100, 400
"""Sizes of the chunks that are computed here before processes are started."""
_WORTH_A_PROCESS = 2.0
"""Processor time of work for each process, s: starting one takes a second of it."""
_POSES_AT_ONCE = 4096
"""Poses that are checked at once: their products stay in the cache."""
_DIMENSIONS = {"q": 2, "T_world_object": 3, "twist": 2}
"""Dimensions of arrays with an entry for each state."""


class StateArrays(NamedTuple):
    """The arguments of `Evaluator.evaluate` for K states.

    Attributes:
        total: K.
        each: Arguments that differ from state to state, by name: (K, a), (K, 4, 4) or (K, 6).
        common: Arguments that all states share, by name.
    """

    total: int
    each: Mapping[str, FloatArray]
    common: Mapping[str, Any]

    @property
    def configurations(self) -> FloatArray | None:
        """(K, a) if only configurations are given, else None."""
        others = [*self.each, *(name for name, value in self.common.items() if value is not None)]
        return self.each["q"] if others == ["q"] else None

    def part(self, numbers: slice) -> StateArrays:
        """Return a part of the states."""
        each = {name: values[numbers] for name, values in self.each.items()}
        return StateArrays(len(range(self.total)[numbers]), each, self.common)

    def arguments_of(self, number: int) -> tuple[Any, Any, Any]:
        """Return the arguments of `Evaluator.evaluate` for one of the states."""
        q, T, twist = (
            self.each[name][number] if name in self.each else self.common[name]
            for name in _DIMENSIONS
        )
        return q, T, twist


def checked_states(at: Configurations, q: Any, T_world_object: Any, twist: Any) -> StateArrays:
    """Check the states that are given to `Evaluator.evaluate_many`.

    Args:
        at: The possible states.
        q: See there.
        T_world_object: See there.
        twist: See there.

    Raises:
        ArgumentError: If nothing has an entry for each state, or not as many as another; if a shape
            is wrong, a number not finite or a pose not rigid.
    """
    joint_count = len(at.joint_names)
    if isinstance(q, Sequence) and len(q) and all(isinstance(one, Mapping) for one in q):
        q = np.array(
            [state_positions(at.array, f"q[{number}]", one) for number, one in enumerate(q)]
        )
    given = {"q": q, "T_world_object": T_world_object, "twist": twist}
    shapes = {"q": (joint_count,), "T_world_object": (4, 4), "twist": (6,)}
    each: dict[str, FloatArray] = {}
    common: dict[str, Any] = {}
    for name, value in given.items():
        if isinstance(value, Motion | Mapping) or _axis_count(value) < _DIMENSIONS[name]:
            common[name] = value
        else:
            each[name] = _state_array(name, value, (None, *shapes[name]))
    if not each:
        raise ArgumentError(
            "q",
            f"no states are given; for K states give q, (K, {joint_count}) in the order of "
            "`joint_names` or K mappings from them, T_world_object (K, 4, 4) or twist (K, 6)",
        )
    first, count = next((name, len(values)) for name, values in each.items())
    for name, values in each.items():
        if len(values) != count:
            raise ArgumentError(
                name, f"has {len(values)} states, but {first} has {count}; give equal numbers"
            )
    _check_rigid(each.get("T_world_object", np.empty((0, 4, 4))))
    return StateArrays(count, each, common)


def _axis_count(value: Any) -> float:
    """Return the number of dimensions of a value as an array; infinity if it is none."""
    try:
        return np.ndim(value)
    except ValueError:  # rows of several lengths: `_state_array` raises the error
        return np.inf


def state_positions(
    array: Callable[[Any], FloatArray], state: str, q: Configuration | None
) -> FloatArray:
    """Return (a,) positions of one of many states; errors name the state.

    Args:
        array: Converts a configuration to an array.
        state: Name of the argument ``q`` in errors.
        q: The configuration.
    """
    try:
        return array(q)
    except ArgumentError as error:
        raise ArgumentError(state + error.argument.removeprefix("q"), error.message) from None


def _state_array(name: str, value: Any, shape: tuple[int | None, ...]) -> FloatArray:
    """Return finite numbers of a shape, without a copy where they are such an array already."""
    if (
        isinstance(value, np.ndarray)
        and value.dtype == np.float64
        and value.shape[1:] == shape[1:]
        and value.flags.c_contiguous
        and all_within((value,))
    ):
        return value
    return finite_array(name, value, shape)


def _check_rigid(poses: FloatArray) -> None:
    for start in range(0, len(poses), _POSES_AT_ONCE):
        block = poses[start : start + _POSES_AT_ONCE]
        R = block[:, :3, :3]
        off = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2))
        doubtful = (off > 0.5 * RIGIDITY_TOLERANCE) | (np.linalg.det(R) < 0.0)
        doubtful |= (block[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1)
        for k in np.flatnonzero(doubtful).tolist():
            as_pose(f"T_world_object[{start + k}]", block[k])


def computed_arrays(
    compute: Callable[[StateSolver, StateArrays], Arrays],
    solver: StateSolver,
    states: StateArrays,
    workers: int | None,
    progress: Progress | None,
) -> Arrays:
    """Return arrays of results of states, computed by one or several processes.

    Args:
        compute: Computes them for some of the states.
        solver: Solves the states.
        states: K states.
        workers: Processes; 1: this one; None: up to the number of cores, if the processor time of
            the first states shows that each saves more than its start takes.
        progress: Called with the numbers of states that are done and of all; None: not called.

    Raises:
        ArgumentError: If ``workers`` is not a whole number from 1 on, or ``progress`` no function.
        CrashError: If a process dies.
    """
    if workers is not None:
        workers = whole_number("workers", workers, 1)
    check_callback("progress", progress)
    whole: Arrays = ()
    for chunk, parts in _computed_chunks(compute, solver, states, workers):
        if not whole:
            whole = tuple([np.empty((states.total, *a.shape[1:]), a.dtype) for a in parts])
        for array, part in zip(whole, parts, strict=True):
            array[chunk] = part
        if progress is not None:
            progress(min(chunk.stop, states.total), states.total)
    return whole


def _computed_chunks(
    compute: Callable[[StateSolver, StateArrays], Arrays],
    solver: StateSolver,
    states: StateArrays,
    workers: int | None,
) -> Iterator[tuple[slice, Arrays]]:
    """Yield chunks of states and their results, in order."""
    done = 0
    if workers is None or workers == 1:
        for size in chain(_FIRST_STATES if workers is None else (), repeat(_STATES_AT_ONCE)):
            chunk, begin = slice(done, min(done + size, states.total)), thread_time()
            arrays = compute(solver, states.part(chunk))
            pace = (thread_time() - begin) / size
            yield chunk, arrays
            learned, done = done > 0, chunk.stop
            remaining = states.total - done
            if not remaining:
                return
            worth = int(min(usable_cores(), remaining * pace / _WORTH_A_PROCESS))
            if workers is None and learned and worth > 1:
                workers = worth
                break
    yield from _found_by_processes(compute, solver, states, done, workers or 1)


def _found_by_processes(
    compute: Callable[[StateSolver, StateArrays], Arrays],
    solver: StateSolver,
    states: StateArrays,
    begin: int,
    workers: int,
) -> Iterator[tuple[slice, Arrays]]:
    """Yield chunks from state ``begin`` on and their results from processes, in order."""
    size = min(_STATES_AT_ONCE, max(1, -(-(states.total - begin) // (4 * workers))))
    ends = [*range(begin, states.total, size), states.total]
    chunks = [slice(*ends[k : k + 2]) for k in range(len(ends) - 1)] or [slice(0, 0)]
    parts = [states.part(chunk) for chunk in chunks]
    arrays = shared_work(compute, solver, parts, workers, kept_processes())
    yield from zip(chunks, arrays, strict=True)


@dataclass(frozen=True, eq=False, repr=False)
class EvaluatedStates(Record):
    """Results of `Evaluator.evaluate_many` for K states; all arrays are read-only.

    Attributes:
        torque_names: L names of all torques that any state may have.
        torque_units: L units.
        statuses: (K,) the `StateStatus` of each: ``statuses == StateStatus.FOUND`` is a mask.
        margins: (K,) N, -inf where there are no torques.
        torques: (K, L) motor torques, N m (N for prismatic and hybrid joints, tendons); NaN where
            there are none.
        contact_counts: (K,) number of contacts that carry force; 0 where there is no problem.
        bounds: (K,) proven bound on the optimum over all modes, see `Certificate.bound`; where
            there are no torques it is that of the search, NaN where there is no problem.
        gaps: (K,) distance of the optimum from that bound, same unit; NaN without torques.
        residuals: (K,) largest violation of a constraint by the contact forces of the torques,
            scaled, see `Certificate.primal_residual`; NaN without torques.
        coverages: (K,) the `Coverage` of each: for which members of the evaluator's uncertainty the
            answer is proven; None where there is no uncertainty or no problem.
        evaluations: The whole answers by number of the state, for the requested states.

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
        """Return the number of states of each status, and the range of the margins."""
        counts = Counter(self.statuses.tolist()).most_common()
        lines = [f"{len(self)} states"]
        lines += [f"{count:>{len(str(len(self)))}}: {status.message}" for status, count in counts]
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
    """Return the results of states: see `Evaluator.evaluate_many`."""
    if not np.iterable(kept):
        raise ArgumentError("evaluations", f"must be a list of indices of states, got {kept!r:.60}")
    whole = [whole_number("evaluations", number, 0, states.total - 1) for number in kept]
    columns = possible_columns(solver.configurations.scene.hand)
    names = tuple(columns)
    results = StateFigures(*computed_arrays(solved_figures, solver, states, workers, progress))
    evaluations = {number: solver.evaluate(*states.arguments_of(number)) for number in whole}
    for number, evaluation in evaluations.items():
        results.enter(number, evaluation, names)
    margins, _, bounds, gaps, residuals, _ = results.figures.T.copy()
    statuses = np.array(STATUSES, dtype=object)[results.codes]
    coverages = np.array(COVERAGES, dtype=object)[results.coverages]
    torques, counts = results.torques, results.contact_counts
    arrays = statuses, margins, torques, counts, bounds, gaps, residuals, coverages
    for array in arrays:
        array.setflags(write=False)
    return EvaluatedStates(names, tuple(columns.values()), *arrays, evaluations)


def solved_figures(solver: StateSolver, states: StateArrays) -> StateFigures:
    """Solve states, in compiled loops where possible, else one after the other."""
    names = tuple(possible_columns(solver.configurations.scene.hand))
    results = StateFigures.empty(states.total, len(names))

    def alone(number: int, clear: bool) -> None:
        results.enter(number, solver.solve(*states.arguments_of(number), clear=clear), names)

    solver.loops.optima_of_states(_loop_states(solver, states), solver.objective, results, alone)
    return results


def _loop_states(solver: StateSolver, states: StateArrays) -> FloatArray | None:
    """Return the configurations (K, a) for compiled loops; None: states are solved one by one."""
    return states.configurations if solver.uncertainty is None else None


def feasible_states(
    solver: StateSolver,
    states: StateArrays,
    margin: float,
    workers: int | None,
    progress: Progress | None,
) -> NDArray[np.bool_]:
    """Return which states are feasible: see `Evaluator.are_feasible`."""
    decide = partial(decided_states, margin=margin)
    (feasible,) = computed_arrays(decide, solver, states, workers, progress)
    return feasible


def decided_states(solver: StateSolver, states: StateArrays, margin: float) -> Arrays:
    """Decide which states are feasible, in loops where possible, else one after the other."""
    feasible = np.zeros(states.total, dtype=bool)

    def alone(number: int, clear: bool) -> None:
        feasible[number] = solver.is_feasible(*states.arguments_of(number), margin, clear=clear)

    results = StateFigures.empty(
        states.total, len(possible_columns(solver.configurations.scene.hand))
    )
    q = _loop_states(solver, states) if margin >= 0.0 else None  # below zero: none is required
    solver.loops.optima_of_states(q, Margin(), results, alone, margin)
    looped = results.contact_counts > 0
    _, value, _, _, _, unit = results.figures[looped].T
    reached = [is_reached(*row, margin) for row in zip(value.tolist(), unit.tolist(), strict=True)]
    feasible[looped] = reached
    return (feasible,)
