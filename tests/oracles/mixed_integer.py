"""The whole problem as one mixed-integer program (big-M form), solved by HiGHS.

A statement of its own for ordinary scales: the mode (B, S) becomes binary variables beside the
forces, the virtual motion [V; theta_dot] continuous ones. What it finds is a mode and the value
reached in it. It states no bound: motions larger than `LARGEST_MOTION` are left out, so another
mode may be better, and where nothing is found a mode may still exist.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import highspy
import numpy as np
from numpy.typing import NDArray

from graspless_pin import QuasistaticProblem, SlidingMode

LARGEST_MOTION = 1e5
"""Virtual sliding of at least 1 is asked of a motion with entries up to this."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Found:
    """What the program found.

    Attributes:
        value: The margin, N, or the largest |torque|, N m.
        mode: The mode that its binaries say.
    """

    value: float
    mode: SlidingMode


class _Rows:
    """Variables with bounds, and rows low <= a x <= high, added one by one."""

    def __init__(self) -> None:
        self._engine = engine = highspy.Highs()
        engine.setOptionValue("output_flag", False)  # noqa: FBT003
        engine.setOptionValue("threads", 1)
        engine.setOptionValue("presolve", "off")  # it has lost optima by rounding in big-M rows
        engine.setOptionValue("mip_rel_gap", 0.0)
        engine.setOptionValue("mip_abs_gap", 1e-9)
        engine.setOptionValue("mip_feasibility_tolerance", 1e-9)
        engine.setOptionValue("primal_feasibility_tolerance", 1e-9)

    def variables(self, lower: Array, upper: Array, *, binary: bool = False) -> NDArray[np.int_]:
        """Add variables and return their columns."""
        start, count = self._engine.getNumCol(), len(lower)
        self._engine.addVars(count, lower, upper)
        columns = np.arange(start, start + count)
        if binary:
            kinds = np.full(count, highspy.HighsVarType.kInteger)
            self._engine.changeColsIntegrality(count, columns, kinds)
        return columns

    def add(self, low: float, high: float, *terms: tuple[Any, Any]) -> None:
        """Add the row low <= sum of coefficients * columns <= high."""
        columns = np.concatenate([np.atleast_1d(columns) for columns, _ in terms])
        values = np.concatenate(
            [np.broadcast_to(value, np.shape(np.atleast_1d(where))) for where, value in terms]
        )
        added = self._engine.addRow(low, high, len(columns), columns, values.astype(float))
        assert added != highspy.HighsStatus.kError

    def minimize(self, cost: tuple[int, float], time_limit: float | None) -> Array | None:
        """Return the best solution that HiGHS finds."""
        self._engine.changeColCost(*cost)
        if time_limit is not None:
            self._engine.setOptionValue("time_limit", float(time_limit))
        self._engine.run()
        found = self._engine.getInfo().primal_solution_status
        if found != highspy.SolutionStatus.kSolutionStatusFeasible:
            return None
        return np.array(self._engine.getSolution().col_value)


def solve_by_mixed_integer(
    problem: QuasistaticProblem,
    algorithm: str,
    *,
    margin: float = 0.1,
    sign_rule: str = "strict",
    sliding_rule: str = "exempt",
    time_limit: float | None = None,
) -> Found | None:
    """Solve Algorithm 1 ("margin") or 2 ("torque") over all modes.

    Args:
        problem: Contacts, wrench, joints and limits.
        algorithm: Which of them.
        margin: Required margin e_0 of Algorithm 2, N.
        sign_rule: See `graspless_pin.maximize_margin`.
        sliding_rule: Likewise.
        time_limit: Seconds; None: no limit.

    Returns:
        A mode and its value; None proves nothing.
    """
    rows = _Rows()
    scale, tangent, goal = _force_rows(rows, problem, algorithm, margin)
    candidates = problem.has_cone | (problem.is_sliding & (sliding_rule == "constrained"))
    selection, signs = _mode_rows(rows, problem, np.flatnonzero(candidates), sign_rule)
    reach = problem.friction * problem.max_normal_force / scale
    for contact in np.flatnonzero(problem.has_cone):
        for m in range(2):
            column, plus, minus = tangent[contact, m], *signs[contact, m]
            # Friction is opposite to the sliding: positive only against a negative sliding.
            rows.add(-np.inf, 0.0, (column, 1.0), (minus, -reach[contact]))
            rows.add(0.0, np.inf, (column, 1.0), (plus, reach[contact]))
    sense = -1.0 if algorithm == "margin" else 1.0
    x = rows.minimize((goal, sense), time_limit)
    if x is None:
        return None
    chosen = (selection >= 0) & (x[selection] > 0.5)
    taken = ((signs >= 0) & (x[signs] > 0.5)).astype(int)
    mode = SlidingMode(chosen, (taken[:, :, 0] - taken[:, :, 1]) * chosen[:, None])
    return Found(float(x[goal]) * (scale if algorithm == "margin" else 1.0), mode)


def _force_rows(
    rows: _Rows, problem: QuasistaticProblem, algorithm: str, margin: float
) -> tuple[float, NDArray[np.int_], int]:
    """Add forces in contact coordinates over the largest normal-force limit, and their rows.

    Returns:
        The scale of forces, N; the (M, 2) columns of t1^T f and t2^T f, -1 without a cone; the
        column of the objective: e over the scale, or the largest |torque|.
    """
    scale = float(problem.max_normal_force.max())
    limit = problem.max_normal_force / scale
    count = problem.contact_count
    normal = rows.variables(np.zeros(count), limit)
    tangent = np.full((count, 2), -1)
    blocks = np.zeros((3 * count, count))
    for contact in range(count):
        own = slice(3 * contact, 3 * contact + 3)
        if not problem.has_cone[contact]:
            blocks[own, contact] = problem.kinetic_directions[contact]
            continue
        blocks[own, contact] = problem.normals[contact]
        reach = np.full(2, problem.friction[contact] * limit[contact])
        tangent[contact] = rows.variables(-reach, reach)
        wide = np.zeros((3 * count, 2))
        wide[own] = problem.tangents[contact]
        blocks = np.hstack([blocks, wide])
    forces = np.arange(blocks.shape[1])
    goal = int(rows.variables(np.zeros(1), np.array([np.inf]))[0])
    if algorithm == "margin":
        margins: tuple[tuple[int, float], ...] = ((goal, 1.0),)
        least = 0.0
    else:
        margins, least = (), margin / scale
    length = float(np.linalg.norm(problem.positions, axis=1).max()) or 1.0
    weight = np.repeat([1.0, 1.0 / length], 3)
    balance = weight[:, None] * (problem.W @ blocks)
    for row, side in zip(balance, -weight * problem.external_wrench / scale, strict=True):
        rows.add(side, side, (forces, row))
    owner = np.repeat(np.arange(count), np.where(problem.has_cone, problem.cone_edges, 1))
    for contact, face in zip(owner, problem.H.T @ blocks, strict=True):
        if problem.has_cone[contact]:
            rows.add(-np.inf, -least, (forces, face), *margins)
    for contact in range(count):
        rows.add(-np.inf, limit[contact] - least, (normal[contact], 1.0), *margins)
        rows.add(-np.inf, -least, (normal[contact], -1.0), *margins)
    own_limits = problem.lower_torque, problem.upper_torque
    torques = scale * (problem.J.T @ blocks)
    for row, gravity, low, high in zip(torques, problem.gravity_torques, *own_limits, strict=True):
        rows.add(low - gravity, high - gravity, (forces, row))
        if algorithm != "margin":
            rows.add(-np.inf, -gravity, (forces, row), (goal, -1.0))
            rows.add(-gravity, np.inf, (forces, row), (goal, 1.0))
    return scale, tangent, goal


def _mode_rows(
    rows: _Rows, problem: QuasistaticProblem, candidates: NDArray[np.int_], sign_rule: str
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Add the virtual motion, the binaries of the mode and what ties them, (22), (29), (30).

    Returns:
        (M,) columns of b_l, -1 where a contact cannot be selected, and (M, 2, 2) columns of
        "virtually slides along +t_m" and "along -t_m", -1 likewise.
    """
    count = problem.contact_count
    world = np.hstack([problem.W.T, problem.J]).reshape(count, 3, -1)
    velocity = problem.frames.swapaxes(1, 2) @ world
    sizes = np.sqrt((velocity**2).sum(axis=(0, 1)))
    velocity = velocity / np.where(sizes > 0.0, sizes, 1.0)
    large_motion = np.full(velocity.shape[2], LARGEST_MOTION)
    motion = rows.variables(-large_motion, large_motion)
    selection, signs = np.full(count, -1), np.full((count, 2, 2), -1)
    for contact in candidates:
        # A contact that slides is selected in every mode.
        chosen = np.array([float(problem.is_sliding[contact])])
        b = selection[contact] = rows.variables(chosen, np.ones(1), binary=True)[0]
        signs[contact] = rows.variables(np.zeros(4), np.ones(4), binary=True).reshape(2, 2)
        normal, *tangents = velocity[contact]
        large = 1.0 + LARGEST_MOTION * float(np.abs(velocity[contact]).sum(axis=1).max())
        rows.add(-np.inf, large, (motion, normal), (b, large))
        rows.add(-large, np.inf, (motion, normal), (b, -large))
        least = 0.0 if sign_rule == "nonzero" else 1.0
        for m, k in np.ndindex(2, 2):
            signed = (1.0 - 2.0 * k) * tangents[m]
            rows.add(least - large, np.inf, (motion, signed), (signs[contact, m, k], -large))
        for m in range(2):
            both = (signs[contact, m], -1.0)
            if sign_rule != "exact":
                rows.add(0.0, 0.0, (b, 1.0), both)
                continue
            rows.add(0.0, np.inf, (b, 1.0), both)
            still = (signs[contact, m], large), (b, -large)
            rows.add(-large, np.inf, (motion, tangents[m]), *still)
            rows.add(-large, np.inf, (motion, -tangents[m]), *still)
        if sign_rule == "exact":
            rows.add(-np.inf, 0.0, (b, 1.0), (signs[contact].ravel(), -1.0))
        if sign_rule == "nonzero":
            for i, j in np.ndindex(2, 2):
                total = (1.0 - 2.0 * i) * tangents[0] + (1.0 - 2.0 * j) * tangents[1]
                pair = np.array([signs[contact, 0, i], signs[contact, 1, j]])
                rows.add(1.0 - 4.0 * large, np.inf, (motion, total), (pair, -2.0 * large))
    return selection, signs
