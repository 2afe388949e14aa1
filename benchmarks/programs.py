"""The yardstick of the tables: one bare solve of a scene's relaxed linear program."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import clarabel
import numpy as np
import piqp
from scipy.sparse import csc_array

from graspless_pin import QuasistaticProblem
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.programs.objectives import Margin
from graspless_pin.programs.program import Program


def relaxed_program(problem: QuasistaticProblem) -> Program:
    """The relaxed LP of Algorithm 1 in forces, as the package states it."""
    objective = Margin()
    return formulate(problem, objective).program


def bare_solve(program: Program) -> None:
    """One dense PIQP solve, set-up included, with its default settings: the unit of the tables.

    The package itself solves with the sparse one and keeps it, so a whole search can take less.
    """
    engine = piqp.DenseSolver()
    engine.setup(
        _hessian(program),
        program.c,
        program.A,
        program.b,
        program.G,
        program.l,
        program.u,
    )  # the margin program imposes no bound on a single variable
    engine.solve()


def bare_round_solve(program: Program) -> None:
    """One Clarabel solve of a program with round cones, set-up included, with default settings."""
    solver: Any = clarabel
    solver.DefaultSolver(*_conic_form(program), _quiet()).solve()


@lru_cache(maxsize=8)
def _conic_form(program: Program) -> tuple[Any, ...]:
    """What Clarabel is given, made in the first round alone."""
    library: Any = clarabel
    m, n, flat = len(program.b), len(program.c), program.flat_count
    up, down = np.isfinite(program.u[:flat]), np.isfinite(program.l[:flat])
    G, cones = program.G[:flat], program.G[flat:]
    one, high, low = np.eye(n), np.isfinite(program.ub), np.isfinite(program.lb)
    rows = np.vstack([program.A, G[up], -G[down], one[high], -one[low], -cones])
    sides = np.concatenate([program.b, program.u[:flat][up], -program.l[:flat][down],
                            program.ub[high], -program.lb[low], -program.l[flat:]])  # fmt: skip
    kinds = [library.ZeroConeT(m), library.NonnegativeConeT(len(rows) - m - len(cones))]
    kinds += [library.SecondOrderConeT(3)] * program.cone_count
    return csc_array((n, n)), program.c, csc_array(rows), sides, kinds


@lru_cache(maxsize=1)
def _quiet() -> Any:
    library: Any = clarabel
    settings = library.DefaultSettings()
    settings.verbose = False
    return settings


@lru_cache(maxsize=8)
def _hessian(program: Program) -> np.ndarray:
    """diag(P), made in the first round alone: a median does not see it."""
    return np.asfortranarray(np.diag(program.P))
