"""PIQP solvers that are kept for programs of one structure and told only what changes."""

from __future__ import annotations

from threading import Lock
from typing import Any

import numpy as np
import piqp
import scipy.sparse
from numpy.typing import NDArray

from graspless_pin.caching import Bounded
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.answers import Multipliers
from graspless_pin.programs.program import Program

SOLVER_TOLERANCE = 1e-10
"""What all solvers are asked for, in scaled units."""
# Programs are well scaled: interior points may go closer to the boundary than PIQP's default.
_STEP_TO_BOUNDARY = 0.9999
_VARIABLE_UNIT = 10.0
"""What PIQP's variables count in: it starts near one, and forces are some loads."""
_TOLERANCE = SOLVER_TOLERANCE / _VARIABLE_UNIT
_FIRST_ITERATIONS, _COLUMNS_PER_ITERATION = 20, 10
"""Steps after which it is asked whether there is a solution, and columns that take one more."""
_MOST_ITERATIONS = 250
_ENGINES_PER_STRUCTURE = 2
_MOST_STRUCTURES = 32


class _Engine:
    """A PIQP solver that is kept for programs of one structure and told only what changes.

    Sparse, since each row but the balance knows one finger's or one contact's forces, and without
    scaling of its own, since programs are scaled: so no answer depends on what it solved before.
    """

    def __init__(self, program: Program) -> None:
        """Set up for a program and all of its structure."""
        n, count = len(program.c), len(program.b)
        self._A, self._places_A = _columns(program.rows, slice(count))
        self._G, self._places_G = _columns(program.rows, slice(count, None))
        self._P = scipy.sparse.csc_matrix(
            (_VARIABLE_UNIT * program.P, np.arange(n), np.arange(n + 1))
        )
        self._known = program
        self._piqp = piqp.SparseSolver()
        settings = self._settings = self._piqp.settings
        settings.kkt_solver = piqp.KKTSolver.sparse_ldlt_ineq_cond
        settings.preconditioner_iter = 0
        settings.eps_abs = settings.eps_rel = _TOLERANCE
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = _TOLERANCE
        settings.tau = _STEP_TO_BOUNDARY
        self._piqp.setup(
            self._P,
            program.c,
            self._A,
            program.b / _VARIABLE_UNIT,
            self._G,
            program.l / _VARIABLE_UNIT,
            program.u / _VARIABLE_UNIT,
            program.lb / _VARIABLE_UNIT,
            program.ub / _VARIABLE_UNIT,
        )

    def holds(self, program: Program) -> bool:
        """Return whether the matrices of the program are those that were loaded last."""
        return self._known.G is program.G and self._known.A is program.A

    def load(self, program: Program) -> None:
        """Turn to another program of the same structure, or to other bounds of the same one."""
        known = self._known
        changed: dict[str, Any] = {}
        if program.lb is not known.lb or program.ub is not known.ub:
            changed["x_l"], changed["x_u"] = (
                program.lb / _VARIABLE_UNIT,
                program.ub / _VARIABLE_UNIT,
            )
        if program.c is not known.c:
            changed["c"] = program.c
        if program.b is not known.b:
            changed["b"] = program.b / _VARIABLE_UNIT
        if program.l is not known.l:  # both are made at once
            changed["h_l"], changed["h_u"] = program.l / _VARIABLE_UNIT, program.u / _VARIABLE_UNIT
        if program.P is not known.P:
            np.multiply(program.P, _VARIABLE_UNIT, out=self._P.data)
            changed["P"] = self._P
        if not self.holds(program):
            entries = program.rows.T.ravel()
            entries.take(self._places_A, out=self._A.data, mode="clip")
            entries.take(self._places_G, out=self._G.data, mode="clip")
            changed["A"], changed["G"] = self._A, self._G
        if changed:
            self._piqp.update(**changed)
        self._known = program

    def solve(self, program: Program) -> Multipliers:
        """Solve, and stop early where the multipliers already prove that nothing is feasible.

        A feasible program takes some ten iterations; on an infeasible one the multipliers grow
        until the iteration limit, long after they have become a proof.
        """
        self._settings.max_iter = _FIRST_ITERATIONS + len(program.c) // _COLUMNS_PER_ITERATION
        status, result = self._piqp.solve(), self._piqp.result
        if status == piqp.PIQP_MAX_ITER_REACHED and not (
            program.dual_bound(result.y, result.z_u - result.z_l) > program.cutoff
        ):
            self._settings.max_iter = _MOST_ITERATIONS
            self._piqp.solve()
        # Bounds that meet are met to the solver's tolerance: the answer meets them exactly.
        x = np.minimum(np.maximum(_VARIABLE_UNIT * result.x, program.lb), program.ub)
        return x, np.array(result.y), result.z_u - result.z_l


def _columns(rows: FloatArray, part: slice) -> tuple[Any, NDArray[np.int_]]:
    """Return some of the rows in compressed columns, and the places of their entries among all.

    Both go column after column.
    """
    filled = np.zeros(rows.T.shape, dtype=bool)
    filled[:, part] = rows.T[:, part] != 0.0
    starts = np.concatenate([[0], np.cumsum(filled.sum(axis=1))])
    entries = rows.T[filled], np.nonzero(filled[:, part])[1], starts
    size = filled[:, part].shape[1]
    return scipy.sparse.csc_matrix(entries, shape=(size, len(filled))), np.flatnonzero(filled)


_kept: dict[tuple[int, int, int, bytes], list[_Engine]] = Bounded(_MOST_STRUCTURES)
"""Engines that no thread uses, by the structure of their programs."""
_LOCK = Lock()


def by_piqp(program: Program) -> Multipliers:
    """PIQP, with a solver kept from an earlier program of the same structure if there is one."""
    structure = len(program.c), len(program.b), len(program.l), program.pattern
    engine = None
    with _LOCK:
        kept = _kept.get(structure, [])
        matching = [index for index, one in enumerate(kept) if one.holds(program)]
        # Two, so that one stays with a problem that is asked again while others pass.
        if matching or len(kept) >= _ENGINES_PER_STRUCTURE:
            engine = kept.pop(matching[0] if matching else 0)
    if engine is None:
        engine = _Engine(program)
    else:
        engine.load(program)
    answer = engine.solve(program)
    with _LOCK:
        if structure not in _kept:
            _kept[structure] = []
        kept = _kept[structure]
        kept.append(engine)
        del kept[:-_ENGINES_PER_STRUCTURE]
    return answer
