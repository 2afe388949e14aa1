"""The certified optimum of a state by a warm start from a similar one, in compiled loops.

Where the same constraints are active and the same mode and motion admit the friction, a few
compiled loops on plain arrays find the optimum, without making records. Their result is checked
like the answer of a solver; where it does not pass, nothing is returned and a search begins.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from threading import RLock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.batch_programs import (
    ProgramStructure,
    loops_cover,
    loops_of,
    may_begin,
    structure_of,
)
from graspless_pin.algorithms.mode_tree import ModePart, signs_left
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search_state import OPTIMALITY_TOLERANCE
from graspless_pin.caching import Derived
from graspless_pin.compiled import core
from graspless_pin.modes.kinematics import THRESHOLD
from graspless_pin.modes.rules import Rules, SlidingMode
from graspless_pin.modes.virtual_motions import CLEARLY, witness_criteria
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.programs.active_set import ActiveSet
from graspless_pin.programs.objectives import Objective
from graspless_pin.solution import Certificate, Evidence, Status, TorqueSolution


@dataclass(frozen=True, eq=False)
class WarmStart:
    """Result of a search that starts the search of a similar problem with the same contacts.

    Attributes:
        mode: The best mode; None: no mode was found.
        relaxation: Active set at the optimum of the program without modes; None: not known.
        in_mode: Likewise of the mode's own program.
        motion: A virtual motion of the mode, scaled; None: not known.
        structure: The structure that the problem shares with similar ones; None: loops alone
            cannot find the optimum, as cones are no regular pyramids, or the mode's own program
            was needed or leaves signs open.
        cover: See `SearchState`.
    """

    mode: SlidingMode | None = None
    relaxation: ActiveSet | None = None
    in_mode: ActiveSet | None = None
    motion: FloatArray | None = None
    structure: ProgramStructure | None = None
    cover: tuple[ModePart, ...] = ()


class WarmOptimum(NamedTuple):
    """The optimum of a problem over all feasible modes, by a warm start from another, certified.

    Attributes:
        forces: (M, 3) contact forces, N.
        signed_unit: Factor from the program's value to the objective's; negative if that is
            maximised.
        reach: See `Certificate.force_reach`.
        x: (n,) the solution of the scaled program, without friction that the mode forbids.
        value: Value of the scaled program.
        bound: Bound on the value that the multipliers prove.
        residual: Largest violation of a constraint, scaled.
        multipliers: (R,) multipliers of all rows.
        motion: A virtual motion of the mode, scaled.
        scale: Factors from the scaled motion to m/s and rad/s.
        mode: The mode.
        solver: Solver of the optimum that the start was taken from.
    """

    forces: FloatArray
    signed_unit: float
    reach: float
    x: FloatArray
    value: float
    bound: float
    residual: float
    multipliers: FloatArray
    motion: FloatArray
    scale: FloatArray
    mode: SlidingMode
    solver: str

    @property
    def gap(self) -> float:
        """Distance between the optimum and its proven bound, in the objective's unit."""
        return (self.value - self.bound) * abs(self.signed_unit)


def warm_optimum(
    problem: QuasistaticProblem,
    objective: Objective,
    options: SolveOptions,
    starts: Sequence[WarmStart],
) -> tuple[WarmOptimum, int] | None:
    """Return the optimum of a problem whose active set, mode and motion are those of a start.

    Args:
        problem: The problem; only its arrays are read.
        objective: What is optimised.
        options: How the problem is solved.
        starts: Warm starts of similar problems, the most promising first.

    Returns:
        The optimum, proven like any other, and the index of the start that led to it; None
        where no start serves, loops do not cover the options, or nothing was compiled.
    """
    loops = _cold_loops(problem, objective, options) if starts else None
    if loops is None:
        return None
    with LOOPS_LOCK:
        found = loops.warm_optimum(problem, prepared_starts(loops, problem, starts))
    if found is None:
        return None
    place, optimum = found
    return _optimum_record(problem, objective, optimum), place


def _optimum_record(
    problem: QuasistaticProblem, objective: Objective, optimum: tuple[Any, ...]
) -> WarmOptimum:
    forces, unit, *found, contacts, signs, solver = optimum
    x, value, bound, residual, multipliers, motion, scale = found
    selection = np.zeros(len(signs), dtype=bool)
    selection[contacts] = True
    return WarmOptimum(
        forces=forces,
        signed_unit=objective.sign * unit,
        reach=max(problem.max_normal_force.tolist()),
        x=x,
        value=value,
        bound=bound,
        residual=residual,
        multipliers=multipliers,
        motion=motion,
        scale=scale,
        mode=SlidingMode.unchecked(selection, signs.astype(np.int8)),
        solver=solver,
    )


def state_optimum(
    problem: QuasistaticProblem,
    objective: Objective,
    options: SolveOptions,
    learned: WarmStart | None,
    pool: list[Any],
    *state: Any,
) -> WarmOptimum | None:
    """Return the optimum of one state; None: loops do not find it. See `optima_of_states`."""
    loops = _cold_loops(problem, objective, options)
    if loops is None:
        return None
    order = np.zeros(1, dtype=np.intp)
    with LOOPS_LOCK:
        if not _optima_found(loops, problem, options, learned, pool, order, state):
            return None
        # From the same object: the cache may have dropped it, or another thread replaced it.
        optimum = loops.result()
    return _optimum_record(problem, objective, optimum)


def optima_of_states(
    problem: QuasistaticProblem,
    objective: Objective,
    options: SolveOptions,
    learned: WarmStart | None,
    pool: list[Any],
    order: NDArray[np.intp],
    *states: Any,
) -> int:
    """Find the optima of states with the same contacts, one after the other.

    Args:
        problem: The problem of one of the states; the structure is the same for all.
        objective: What is optimised.
        options: How problems are solved.
        learned: The warm start that a search has left since the last call; None: none.
        pool: Compiled starts for these contacts, the most promising first: it is changed.
        order: Numbers of the states.
        states: The further arguments of `core.WarmOptima.optima_of_states`.

    Returns:
        Number of optima found, in that order, before the first state without one.
    """
    loops = _cold_loops(problem, objective, options)
    if loops is None:
        return 0
    with LOOPS_LOCK:
        return _optima_found(loops, problem, options, learned, pool, order, states)


def _optima_found(
    loops: Any,
    problem: QuasistaticProblem,
    options: SolveOptions,
    learned: WarmStart | None,
    pool: list[Any],
    order: NDArray[np.intp],
    states: tuple[Any, ...],
) -> int:
    """Return the result of `optima_of_states`; the caller holds the lock of the loops."""
    if learned is not None:
        pool[:0] = [
            start for start in prepared_starts(loops, problem, [learned]) if start is not None
        ]
    return loops.optima_of_states(problem, pool, may_begin(problem, options), order, *states)


def _cold_loops(problem: QuasistaticProblem, objective: Objective, options: SolveOptions) -> Any:
    """Return the loops for the structure of a problem; None: they do not cover it."""
    # They assume one free object.
    if problem.wrench_matrix is not None or not loops_cover(problem.cone_model, objective, options):
        return None
    return loops_of("ColdOptima", structure_of(problem), objective, problem.joint_units)


def prepared_starts(
    loops: Any, problem: QuasistaticProblem, starts: Sequence[WarmStart]
) -> list[Any]:
    """Return starts in compiled form; None in the place of a start that does not fit."""
    structure, prepared = structure_of(problem), []
    for start in starts:
        last = _last_prepared(start)
        own, active = last[0]
        if own is not loops:
            fits = start.structure is not None and start.structure.has_rows_of(structure)
            active = _compiled_start(loops, start) if fits else None
            last[0] = loops, active
        prepared.append(active)
    return prepared


LOOPS_LOCK = RLock()
"""One workspace serves all threads."""
_last_prepared: Derived[WarmStart, list[Any]] = Derived(lambda _: [(None, None)], most=math.inf)
"""The loops that a start was prepared for last, and its compiled form."""


def _compiled_start(loops: Any, start: WarmStart) -> Any:
    active, mode, motion = start.relaxation, start.mode, start.motion
    if active is None or mode is None or motion is None:
        return None
    if len(active.x) != loops.coordinate_count + 1 or len(motion) != 6 + loops.joint_count:
        return None
    return core.Start(
        loops, active.rows, active.at_bounds, active.upper, active.x, active.weights,
        sum(active.sizes),
        mode.signs, mode.contacts, mode.own_signs.ravel(), motion,
        witness_criteria(CLEARLY * THRESHOLD),
        active.solver,
    )  # fmt: skip


def solution_of_optimum(
    problem: QuasistaticProblem,
    objective: Objective,
    rules: Rules,
    found: WarmOptimum,
) -> TorqueSolution:
    """Return the solution of an optimum that loops found.

    Args:
        problem: The problem.
        objective: What was optimised.
        rules: The reading of the virtual-sliding constraint.
        found: The optimum.
    """
    size = structure_of(problem).layout.size
    proof = found.multipliers[:6], found.multipliers[6:]
    certificate = Certificate(
        primal_residual=found.residual,
        duality_gap=found.value - found.bound,
        bound=found.bound * found.signed_unit,
        gap=found.gap,
        infeasibility=0.0,
        force_reach=found.reach,
        modes_examined=1,
        nodes=1,
        force_programs=1,
        kinematic_programs=1,
        solver=found.solver,
    )
    added = found.x[size:].copy()
    evidence = Evidence(proof, proof, added, None, found.scale * found.motion)
    return TorqueSolution(
        status=Status.OPTIMAL,
        objective=objective,
        rules=rules,
        certificate=certificate,
        problem=problem,
        evidence=evidence,
        _forces=read_only(found.forces),
        _mode=found.mode,
    )


MOST_STARTS = 8
"""Warm starts kept for one set of contacts: trying one costs a tenth of a solver's answer."""
_MOST_COLD_COORDINATES = 24
"""Force coordinates; with more, a kept solver with sparse factors is faster than the loops."""


class LoadSweep:
    """Optima of states with the same contacts under other loads, friction and limits, in order.

    The start that led to one optimum is tried first for the next.
    """

    def __init__(
        self,
        problem: QuasistaticProblem,
        objective: Objective,
        options: SolveOptions,
        *,
        only_load_changes: bool = False,
    ) -> None:
        """Begin without warm starts.

        Args:
            problem: The problem of one of the states; its cones are pyramids.
            objective: What is optimised; `loops_cover` tells whether loops cover it.
            options: How problems are solved.
            only_load_changes: Whether states differ in their load alone. The optimal bases of
                earlier states then stay dual feasible, and the simplex method goes on from them.
        """
        structure = structure_of(problem, problem.has_cone.astype(np.float64))
        kind = "ModePrograms" if only_load_changes else "LoadedStates"
        self._loops = loops_of(kind, structure, objective, problem.joint_units)
        self._may_begin = (
            may_begin(problem, options) and self._loops.coordinate_count <= _MOST_COLD_COORDINATES
        )
        self._last: WarmStart | None = None
        self._pool: list[Any] = []
        self._only_load_changes, self._covers = only_load_changes, list[Any]()

    def learn(self, problem: QuasistaticProblem, start: WarmStart) -> None:
        """Add the warm start of a state that was solved by itself.

        Args:
            problem: The problem of the state.
            start: The start that led to its optimum, or that its search left.
        """
        if start is not self._last:
            self._last = start
            if self._only_load_changes:
                # These loops have the mode's own program, and the parts that bound all other modes.
                signs = start.mode is not None and start.mode.own_signs.all()
                own = [_compiled_start(self._loops, start)] if signs else []
                if start.cover:
                    cover = core.ModeCover([signs_left(part) for part in start.cover])
                    self._covers = [cover, *self._covers][:MOST_STARTS]
            else:
                own = prepared_starts(self._loops, problem, [start])
            own = [one for one in own if one is not None]
            self._pool = [*own, *self._pool][:MOST_STARTS]

    def advance(
        self,
        problem: QuasistaticProblem,
        loads: FloatArray,
        begin: int,
        figures: FloatArray,
        torques: FloatArray,
        *,
        enough: float | None = None,
    ) -> int:
        """Find optima until one is not found, and return the number of that state, or K.

        Args:
            problem: The problem whose contacts and Jacobian are used.
            loads: See `core.LoadedStates.optima`.
            begin: The first state.
            figures: (K, 6), see there.
            torques: (K, L), see there.
            enough: Margin, N, of which only is decided whether it is reached, where the load
                alone changes; None: optima are looked for.
        """
        arguments = loads, begin, self._pool, self._may_begin, figures, torques
        with LOOPS_LOCK:
            if isinstance(self._loops, core.ModePrograms):
                self._loops.decide(
                    -1.0 if enough is None else enough, OPTIMALITY_TOLERANCE, self._covers
                )
            return self._loops.optima(problem, *arguments)
