"""The yardstick of the tables: one bare solve of a scene's relaxed linear program."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import piqp

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


@lru_cache(maxsize=8)
def _hessian(program: Program) -> np.ndarray:
    """diag(P), made in the first round alone: a median does not see it."""
    return np.asfortranarray(np.diag(program.P))
