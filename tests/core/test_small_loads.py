"""No margin and no load is too small: nothing crashes, prints from C or claims what is not so."""

from functools import partial
from itertools import chain, product

import numpy as np
import pytest

from graspless_pin import QuasistaticProblem, Status, explain, maximize_margin, minimize_torque
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.arguments import is_too_small
from graspless_pin.programs.answers import call_solver, elastic_program, within_solver_range
from graspless_pin.programs.program import LARGEST_FIGURE, Program
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

MARGINS = (0.0, 1e-300, 1e-20, 1e-3, 0.1, None)
"""Required ones; None: the largest is asked for."""
CASES = ((0.2, 0.0), (0.2, 1e-20), (0.2, 1e-6), (0.0, 0.0), (0.0, 1e-40))
"""The finger's weight, and the load."""
FEASIBLE, INFEASIBLE = "two fingers", "a floor and a wall"


def problem(load: float, weight: float, name: str = FEASIBLE, **changes) -> QuasistaticProblem:
    """Two contacts that squeeze the object, or push it up and aside; a finger of some weight."""
    positions, normals = [[-0.05, 0, 0], [0, 0, -0.05]], [[1, 0, 0], [0, 0, 1]]
    if name == FEASIBLE:
        positions[1], normals[1] = [0.05, 0, 0], [-1, 0, 0]
    arguments = {
        "external_wrench": [0, 0, -load, 0, 0, 0],
        "jacobian": [[0.1], [0], [0], [0], [0], [0]],
        "friction": 0.5,
        "gravity_torques": [weight],
    }
    return QuasistaticProblem(positions, normals, **{**arguments, **changes})


def answers(load: float, weight: float, name: str) -> list[str]:
    """The statuses for the margins, after each answer has been printed and written."""
    statuses = []
    for margin in MARGINS if load in (0.0, 1e-6) else MARGINS[2::2]:
        one = problem(load, weight, name)
        solution = maximize_margin(one) if margin is None else minimize_torque(one, margin)
        assert str(solution)
        document = solution_document(solution)
        if solution.found:
            failed = [check for check in verify_document(document).checks if not check.passed]
            assert not failed, (margin, failed)
        statuses.append(solution.status.name)
    return statuses


def test_no_margin_and_no_load_is_too_small(capfd):
    """A required margin of 1e-20 N without a load ended the process by SIGSEGV in HiGHS."""
    statuses = {
        (name, case): answers(case[1], case[0], name)
        for name, case in product((FEASIBLE, INFEASIBLE), CASES)
    }
    assert capfd.readouterr() == ("", "")
    # What needs forces far beyond the load's reach was said to be infeasible.
    found = {*chain(*(statuses[FEASIBLE, case] for case in CASES))}
    assert not {"INFEASIBLE_FORCES", "INFEASIBLE_MODES"} & found
    for name, wanted in ((FEASIBLE, "OPTIMAL"), (INFEASIBLE, "INFEASIBLE_FORCES")):
        for weight in (0.0, 0.2):
            expected = ["OPTIMAL"] * 3 + [wanted] * 2 + ["OPTIMAL"]
            assert statuses[name, (weight, 0.0)] == expected


def test_a_margin_far_below_the_limits_is_zero():
    """It is no scale of anything: a finger's own weight would be 1e21 times as much."""
    one = problem(0.0, 0.2, max_normal_force=50.0)
    none, tiny, small = (minimize_torque(one, margin) for margin in (0.0, 1e-20, 1e-3))
    for solution, scale in ((none, 50.0), (tiny, 50.0), (small, 1e-3)):
        assert solution.status is Status.OPTIMAL
        assert solution_document(solution)["scales"]["force"] == scale
    assert tiny.max_torque == pytest.approx(none.max_torque, abs=1e-6)


def test_a_load_without_a_size_is_refused():
    """Squares of it are no numbers, so that it has no length and no direction."""
    with pytest.raises(ArgumentError, match=r"external_wrench: is .* must be 0 or at least 1e-40"):
        problem(1e-41, 0.0)
    assert problem(1e-40, 0.0).scales.force == pytest.approx(1e-40)
    wrench = np.array([9.81, 0.0, 1e-300, 0.0, 0.0, 1e-200])
    assert problem(0.0, 0.0, external_wrench=wrench).scales.force == pytest.approx(9.81)
    assert is_too_small(1e-300 * wrench) and not is_too_small(np.zeros(6))


@pytest.mark.parametrize("solve", [maximize_margin, partial(minimize_torque, margin=0.1)])
def test_bounds_are_about_the_forces_that_were_found(solve):
    """A squeeze of 1e11 times the load was optimal by a bound for forces up to 1e8 times it."""
    for load in (1e-20, 1e-12):
        solution = solve(problem(load, 0.0))
        assert solution.status is Status.UNVERIFIED
        assert np.isfinite(solution.certificate.force_reach)


def test_a_margin_of_rounding_is_suggested_as_none():
    solution = minimize_torque(problem(0.0, 0.2, INFEASIBLE), 0.1)
    assert solution.status is Status.INFEASIBLE_FORCES
    first = explain(solution).suggestions[0]
    assert first.text == "the required margin would have to be at most 0 N"
    assert first.margin == 0.0


def fails(_: Program) -> None:
    pytest.fail("a solver was asked")


def program(**changes) -> Program:
    """Minimise x + y over x + y = 2 with x <= 1, of which any figure can be another."""
    figures = {
        "P": np.zeros(2), "c": np.ones(2), "A": np.ones((1, 2)), "b": np.full(1, 2.0),
        "G": np.eye(2)[:1], "l": np.full(1, -np.inf), "u": np.ones(1),
        "lb": np.zeros(2), "ub": np.full(2, np.inf), "box": np.array([[0.0, 0.0], [2.0, 2.0]]),
    }  # fmt: skip
    return Program(**{**figures, **changes})


@pytest.mark.parametrize("figure", [1e16, 1e22, 1e300, np.nan])
@pytest.mark.parametrize(
    ("name", "shape"), [("P", 2), ("c", 2), ("A", (1, 2)), ("b", 1), ("G", (1, 2))]
)
def test_no_solver_is_given_figures_that_it_does_not_bear(name, shape, figure):
    if name == "b" and np.isnan(figure):
        return  # no side of a problem is no number
    assert call_solver(fails, program(**{name: np.full(shape, figure)})) is None


@pytest.mark.parametrize("figure", [1e16, 1e300])
def test_limits_that_cannot_be_met_are_given_to_no_solver(figure):
    for wrong in ({"u": [-figure]}, {"l": [figure]}, {"lb": [figure, 0]}, {"ub": [-figure, 1]}):
        changed = {name: np.array(side, dtype=float) for name, side in wrong.items()}
        assert within_solver_range(program(**changed)) is None


def test_limits_beyond_reach_are_none():
    far = program(u=np.full(1, 1e22), lb=np.full(2, -1e16), ub=np.array([1e300, 1.0]))
    near = within_solver_range(far)
    assert near is not None
    assert near.u.tolist() == [1e12]  # a row without sides has one
    assert near.lb.tolist() == [-np.inf] * 2 and near.ub.tolist() == [np.inf, 1.0]
    assert near.G is far.G and near.A is far.A
    within = program(u=np.full(1, LARGEST_FIGURE))
    assert within_solver_range(within) is within
    assert within_solver_range(elastic_program(program())) is not None
