"""Mixed-integer programs, by HiGHS."""

from __future__ import annotations

from typing import Any

import highspy
import numpy as np
import scipy.sparse

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.mode_program import ModeProgram


def solve_mixed_integer(
    program: ModeProgram, time_limit: float | None = None
) -> tuple[FloatArray | None, float, bool]:
    """Solve a mixed-integer program with HiGHS.

    Args:
        program: The program.
        time_limit: Seconds; None: no limit.

    Returns:
        The best solution (None if there is none), the proven bound on the objective, and whether
        the search was completed.
    """
    columns: Any = scipy.sparse.csc_matrix(program.G)
    model = highspy.HighsLp()
    model.num_col_, model.num_row_ = len(program.c), len(program.G)
    model.col_cost_, model.col_lower_, model.col_upper_ = program.c, program.lb, program.ub
    model.row_lower_, model.row_upper_ = program.l, program.u
    model.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    model.a_matrix_.start_ = columns.indptr
    model.a_matrix_.index_ = columns.indices
    model.a_matrix_.value_ = columns.data
    kinds = highspy.HighsVarType.kContinuous, highspy.HighsVarType.kInteger
    model.integrality_ = [kinds[int(binary)] for binary in program.binary]
    engine = highspy.Highs()
    engine.setOptionValue("output_flag", False)  # noqa: FBT003
    engine.setOptionValue("threads", 1)
    engine.setOptionValue("presolve", "off")  # it has lost optima by rounding in big-M rows
    engine.setOptionValue("mip_rel_gap", 0.0)
    engine.setOptionValue("mip_abs_gap", 1e-9)
    engine.setOptionValue("mip_feasibility_tolerance", 1e-9)
    engine.setOptionValue("primal_feasibility_tolerance", 1e-9)
    if time_limit is not None:
        engine.setOptionValue("time_limit", float(time_limit))
    engine.passModel(model)
    engine.run()
    status, info = engine.getModelStatus(), engine.getInfo()
    completed = status in (
        highspy.HighsModelStatus.kOptimal,
        highspy.HighsModelStatus.kInfeasible,
    )
    has_solution = info.primal_solution_status == highspy.SolutionStatus.kSolutionStatusFeasible
    x = np.array(engine.getSolution().col_value) if has_solution else None
    return x, float(info.mip_dual_bound), completed
