"""Objectives of a user's own: the examples of the documentation against the definition by modes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import qpsolvers
from edge_form import Mode, constraints_in_mode, feasible_modes
from scenes import scene
from scipy.optimize import linprog
from scipy.sparse import csc_matrix

from graspless_pin import (
    Objective,
    ProgramBuilder,
    QuasistaticProblem,
    maximize_margin,
    minimize_torque,
    optimize,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.programs.analysis_objectives import AtTorques
from graspless_pin.programs.objectives import Margin, Torque, TorqueShare
from graspless_pin.solution import Status

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "objectives.md"


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    """The names that the page's code defines, run as it stands there."""
    code = re.findall(r"```python[^\n]*\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    text = "\n".join(code).replace("examples/", f"{ROOT}/examples/")
    names: dict[str, Any] = {"__name__": "page"}
    exec(compile(text, str(PAGE), "exec", dont_inherit=True), names)  # noqa: S102 - our own page
    return names


def problems() -> list[QuasistaticProblem]:
    limited = {"torque_limits": ([-3.0, -7.0], [2.0, 11.0]), "gravity_torques": [0.4, -0.2]}
    sphere = scene("sphere").with_changes(**limited)
    return [sphere, sphere.with_changes(friction=[0.25, 0.5, 0.4], cone_edges=8)]


@cache
def modes() -> list[Mode]:
    """The same of both problems, which differ in their cones only."""
    return feasible_modes(problems()[0], "strict", "exempt")


def least_squares(problem: QuasistaticProblem, mode: Mode | None, margin: float) -> float:
    """The least sum of squared shares in one mode, in edge weights; inf if there is none."""
    A, a, E, e, bounds = constraints_in_mode(problem, mode, margin)
    joints, size = problem.joint_count, len(bounds)
    curved = np.zeros(size)
    curved[-1 - joints : -1] = 2.0 / problem.upper_torque**2
    low = np.array([-np.inf if low is None else low for low, _ in bounds])
    high = np.array([np.inf if high is None else high for _, high in bounds])
    P, G, rows = csc_matrix(np.diag(curved)), csc_matrix(A), csc_matrix(E)
    x = qpsolvers.solve_qp(P, np.zeros(size), G, a, rows, e, low, high, solver="highs")
    return np.inf if x is None else float(0.5 * curved @ x**2)


def largest_weighted(problem: QuasistaticProblem, mode: Mode | None, shares: np.ndarray) -> float:
    A, a, E, e, bounds = constraints_in_mode(problem, mode, None, shares=shares)
    found = linprog(np.append(np.zeros(len(bounds) - 1), -1.0), A, a, E, e, bounds)
    return -np.inf if found.status == 2 else -float(found.fun)


def test_the_page_runs(page):
    assert page["even"].status is page["careful"].status is Status.OPTIMAL


@pytest.mark.sampled(1)
@pytest.mark.parametrize("index", range(2))
def test_squared_shares_are_the_least_over_all_modes(page, index):
    problem = problems()[index]
    solution = optimize(problem, page["SquaredShares"](0.1))
    best = min(least_squares(problem, mode, 0.1) for mode in modes())
    assert solution.status is Status.OPTIMAL
    assert solution.value == pytest.approx(best, rel=1e-5)
    shares = solution.torques / problem.upper_torque
    assert solution.value == pytest.approx(float(shares @ shares), rel=1e-6)
    assert solution.margin >= 0.1 - 1e-6
    assert solution.certificate.bound == pytest.approx(solution.value, abs=1e-6)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("index", range(2))
def test_a_weighted_margin_is_the_largest_over_all_modes(page, index):
    problem = problems()[index]
    weights = np.linspace(1.0, 2.0, problem.contact_count)
    solution = optimize(problem, page["WeightedMargin"](tuple(weights)))
    best = max(largest_weighted(problem, mode, weights) for mode in modes())
    assert solution.status is Status.OPTIMAL
    assert solution.value == pytest.approx(best, abs=1e-6)
    assert solution.certificate.bound == pytest.approx(best, abs=1e-6)
    assert f", value = {solution.value:g} N\n" in str(solution)
    even = optimize(problem, page["WeightedMargin"]((1.0,) * problem.contact_count))
    assert even.value == pytest.approx(maximize_margin(problem).margin, abs=1e-7)
    assert solution.value < even.value - 1e-3


@pytest.mark.parametrize("objective", [Margin(), Torque(0.1)])
def test_a_solution_at_given_torques_is_told_as_what_it_is(objective):
    problem = problems()[0]
    free = optimize(problem, objective)
    held = optimize(problem, AtTorques(objective, free.torques))
    assert held.value == pytest.approx(free.value, abs=1e-6)
    told = f"value = {held.value:g}" in str(held)
    assert told is not ("largest margin at given torques" in str(held))
    assert told is (objective == Torque(0.1))


def test_the_required_margin_at_given_torques_is_that_of_the_program():
    problem = problems()[0]
    torques = optimize(problem, Torque(0.1)).torques
    asked_more = AtTorques(Torque(0.1), torques).with_figure("required_margin", 0.5)
    assert asked_more.required_margin == 0.5
    assert not optimize(problem, asked_more).found


def test_multipliers_of_an_own_block_are_derivatives(page):
    """The share rows say what gravity torques cost: by central differences."""
    problem = problems()[1]
    solution = optimize(problem, page["SquaredShares"](0.1), static_friction="coulomb")
    slope = solution.multipliers["shares"] / problem.upper_torque
    for joint in range(problem.joint_count):
        values = []
        for step in (1e-4, -1e-4):
            gravity = problem.gravity_torques.copy()
            gravity[joint] += step
            # The limits bind nothing here: gravity comes in through the shares alone.
            moved = problem.with_changes(gravity_torques=gravity)
            values.append(
                optimize(moved, page["SquaredShares"](0.1), static_friction="coulomb").value
            )
        assert (values[0] - values[1]) / 2e-4 == pytest.approx(slope[joint], abs=1e-5)


def test_optimize_is_what_the_algorithms_are():
    problem = problems()[1]
    assert optimize(problem, Margin()).margin == maximize_margin(problem).margin
    for scale, kind in (("absolute", Torque), ("limits", TorqueShare)):
        same = minimize_torque(problem, 0.05, scale=scale)
        np.testing.assert_array_equal(optimize(problem, kind(0.05)).torques, same.torques)


def test_what_is_no_objective_is_refused(page):
    for wrong in ("margin", page["SquaredShares"], None):
        with pytest.raises(ArgumentError, match="objective"):
            optimize(scene("rest"), wrong)  # type: ignore[arg-type]


class _Balanced(Objective):
    """Any forces that balance."""

    name = "balanced"

    def build(self, program: ProgramBuilder) -> None:
        program.balance()
        program.cones(0.0)
        program.normal_limits(0.0)


@dataclass(frozen=True)
class Weighted(_Balanced):
    """Two with equal figures are equal."""

    weights: Any


@dataclass(frozen=True, eq=False)
class WeightedAlone(_Balanced):
    """Each one is equal to itself alone."""

    weights: Any


@pytest.mark.parametrize("weights", [[1.0, 2.0], np.ones(3), {"left": 1.0}])
def test_figures_without_a_hash_are_refused_with_the_way_out(weights):
    problem = scene("rest")
    with pytest.raises(ArgumentError, match=r"Weighted that cannot be hashed.*eq=False") as caught:
        optimize(problem, Weighted(weights))
    assert "tuples" in str(caught.value)
    assert optimize(problem, WeightedAlone(weights)).found
    assert optimize(problem, Weighted((1.0, 2.0))).found


@dataclass(frozen=True)
class LargestShare(Objective):
    """The least largest torque over its scale, within a box that somebody stated."""

    top: float
    name = "largest share"

    def build(self, program: ProgramBuilder) -> None:
        forces = program.forces
        program.balance()
        program.cones(0.1 / forces.coordinates.force_scale)
        program.normal_limits(0.1 / forces.coordinates.force_scale)
        program.torque_limits()
        largest = program.columns("largest", low=0.0, box=(0.0, self.top), cost=1.0)
        for name, sign in (("upward", 1.0), ("downward", -1.0)):
            program.rows(
                name,
                sign * forces.torque_rows,
                -sign * forces.gravity,
                {largest: -np.ones(len(forces.torque_rows))},
            )


@pytest.mark.parametrize("share", (0.5, 0.99))
def test_a_box_that_hides_an_optimum_is_refused(share):
    """It was taken as given: what is possible was infeasible, with a proof."""
    problem = problems()[1]
    least = optimize(problem, LargestShare(1e3)).value
    assert optimize(problem, LargestShare(1e4)).value == pytest.approx(least, rel=1e-6)
    with pytest.raises(ArgumentError, match=r"^box: .*'largest' is \S+, its box 0 to"):
        optimize(problem, LargestShare(share * least))


def test_a_box_hides_nothing_where_there_is_nothing():
    problem = problems()[1]
    weak = np.full(problem.joint_count, 1e-3)
    problem = problem.with_changes(torque_limits=weak)
    assert optimize(problem, LargestShare(1.0)).status is Status.INFEASIBLE_FORCES
