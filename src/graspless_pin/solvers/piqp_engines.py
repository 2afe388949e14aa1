"""PIQP solvers that are kept for programs of one structure and updated with what changes."""

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
"""Tolerance that all solvers get, in scaled units."""
# Programs are well scaled: iterates may go closer to the boundary than PIQP's default.
_STEP_TO_BOUNDARY = 0.9999
_VARIABLE_UNIT = 10.0
"""Unit of PIQP's variables: its starting point is near one, and forces are several loads."""
_TOLERANCE = SOLVER_TOLERANCE / _VARIABLE_UNIT
_FIRST_ITERATIONS, _COLUMNS_PER_ITERATION = 20, 10
"""Iterations before the first check for infeasibility, and columns per further iteration."""
_MOST_ITERATIONS = 250
_ENGINES_PER_STRUCTURE = 2
_MOST_STRUCTURES = 32


class _Engine:
    """A PIQP solver that is kept for programs of one structure and updated with what changes.

    It is sparse, since each row except the balance involves one finger's or one contact's forces,
    and has no scaling of its own, since programs are scaled: so no answer depends on earlier ones.
    """

    def __init__(self, program: Program) -> None:
        """Set up the solver for a program and all others of its structure."""
        n, count = len(program.c), len(program.b)
        self._A, self._places_A = _compressed_columns(program.rows, slice(count))
        self._G, self._places_G = _compressed_columns(program.rows, slice(count, None))
        self._P = scipy.sparse.csc_matrix(
            (_VARIABLE_UNIT * program.P, np.arange(n), np.arange(n + 1))
        )
        self._loaded = program
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
        """Return whether the program has the matrices that were loaded last."""
        return self._loaded.G is program.G and self._loaded.A is program.A

    def load(self, program: Program) -> None:
        """Load another program of the same structure, or other bounds of the same program."""
        loaded = self._loaded
        updates: dict[str, Any] = {}
        if program.lb is not loaded.lb or program.ub is not loaded.ub:
            updates["x_l"], updates["x_u"] = (
                program.lb / _VARIABLE_UNIT,
                program.ub / _VARIABLE_UNIT,
            )
        if program.c is not loaded.c:
            updates["c"] = program.c
        if program.b is not loaded.b:
            updates["b"] = program.b / _VARIABLE_UNIT
        if program.l is not loaded.l:  # both are made at once
            updates["h_l"], updates["h_u"] = program.l / _VARIABLE_UNIT, program.u / _VARIABLE_UNIT
        if program.P is not loaded.P:
            np.multiply(program.P, _VARIABLE_UNIT, out=self._P.data)
            updates["P"] = self._P
        if not self.holds(program):
            entries = program.rows.T.ravel()
            entries.take(self._places_A, out=self._A.data, mode="clip")
            entries.take(self._places_G, out=self._G.data, mode="clip")
            updates["A"], updates["G"] = self._A, self._G
        if updates:
            self._piqp.update(**updates)
        self._loaded = program

    def solve(self, program: Program) -> Multipliers:
        """Solve the program, and stop early if the multipliers already prove infeasibility.

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
        # The solver meets equal bounds to its tolerance only: the answer meets them exactly.
        x = np.minimum(np.maximum(_VARIABLE_UNIT * result.x, program.lb), program.ub)
        return x, np.array(result.y), result.z_u - result.z_l


def _compressed_columns(rows: FloatArray, part: slice) -> tuple[Any, NDArray[np.int_]]:
    """Return some rows as a sparse matrix, and its entries' flat indices in the transposed rows.

    Both are in column order.
    """
    is_nonzero = np.zeros(rows.T.shape, dtype=bool)
    is_nonzero[:, part] = rows.T[:, part] != 0.0
    starts = np.concatenate([[0], np.cumsum(is_nonzero.sum(axis=1))])
    entries = rows.T[is_nonzero], np.nonzero(is_nonzero[:, part])[1], starts
    size = is_nonzero[:, part].shape[1]
    return scipy.sparse.csc_matrix(entries, shape=(size, len(is_nonzero))), np.flatnonzero(
        is_nonzero
    )


_kept: dict[tuple[int, int, int, bytes], list[_Engine]] = Bounded(_MOST_STRUCTURES)
"""Idle engines, by the structure of their programs."""
_LOCK = Lock()


def by_piqp(program: Program) -> Multipliers:
    """Return PIQP's answer, by an engine kept from a program of the same structure if possible."""
    structure = len(program.c), len(program.b), len(program.l), program.pattern
    engine = None
    with _LOCK:
        engines = _kept.get(structure, [])
        matching = [index for index, candidate in enumerate(engines) if candidate.holds(program)]
        # Two, so that one keeps a problem that is solved repeatedly while others pass.
        if matching or len(engines) >= _ENGINES_PER_STRUCTURE:
            engine = engines.pop(matching[0] if matching else 0)
    if engine is None:
        engine = _Engine(program)
    else:
        engine.load(program)
    answer = engine.solve(program)
    with _LOCK:
        if structure not in _kept:
            _kept[structure] = []
        engines = _kept[structure]
        engines.append(engine)
        del engines[:-_ENGINES_PER_STRUCTURE]
    return answer
