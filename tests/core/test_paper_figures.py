"""The paper's printed figures and the rule table, from arrays."""

from itertools import product

import numpy as np
import pytest
from scenes import SOLVERS, assert_holds, scene

from graspless_pin import Status, maximize_margin, minimize_torque

# Algorithm 1: margin and torques; Algorithm 2: torques. The sphere's normals are known to three
# digits only.
FIGURES = {
    "sphere": (1.4507, (-0.7610, -0.7610), (-0.5187, -0.5187), 1e-3),
    "rest": (1.6504, (-4.8348, 4.8348), (-0.9618, 0.9618), 2e-4),
    "up": (2.3001, (-4.7700, 4.7700), (-1.5554, 1.5554), 2e-4),
    "down": (3.9772, (-4.6023, 4.6023), (-0.8482, 0.8482), 2e-4),
}
SEARCHES = ("auto", "enumerate")
ALL_WAYS = [
    (name, solver, search)
    for name, solver, search in product(FIGURES, SOLVERS, SEARCHES)
    if (name, search) != ("rest", "enumerate") or solver == "piqp"  # seconds for each of the others
]


@pytest.mark.sampled(9)
@pytest.mark.parametrize(("name", "solver", "search"), ALL_WAYS)
def test_both_algorithms(name, solver, search):
    margin, torques, least, tolerance = FIGURES[name]
    options = {"solver": solver, "search": search}
    largest = maximize_margin(scene(name), **options)
    smallest = minimize_torque(scene(name), margin=0.1, **options)
    for solution, printed in ((largest, torques), (smallest, least)):
        assert solution.found and solution.status is Status.OPTIMAL
        assert solution.certificate.solver == solver
        np.testing.assert_allclose(solution.torques, printed, rtol=tolerance)
        assert_holds(solution)
    assert largest.margin == pytest.approx(margin, rel=tolerance)
    assert smallest.margin == pytest.approx(0.1, rel=1e-5)
    assert smallest.max_torque == pytest.approx(abs(least[0]), rel=tolerance)


@pytest.mark.parametrize("name", ["rest", "up", "down"])
def test_margin_is_bounded_through_the_finger(name):
    solution = maximize_margin(scene(name))
    limit = 0.1 * (50.0 - solution.margin)
    np.testing.assert_allclose(np.abs(solution.torques), limit, rtol=1e-6)


# Algorithm 1's margin and Algorithm 2's torque; None where no mode admits balancing forces.
NO, SPHERE = (None, None), (1.4507, 0.5187)
RULE_TABLE = [
    # sign rule, sliding rule, at rest, sliding up, sliding down
    ("strict", "exempt", (1.6504, 0.9618), (2.3001, 1.5554), (3.9772, 0.8482)),
    ("strict", "constrained", (1.6504, 0.9618), NO, NO),
    ("exact", "exempt", (1.6504, 0.9278), (2.3001, 1.5554), (3.9772, 0.8482)),
    ("exact", "constrained", (1.6504, 0.9278), (0.0866, None), (1.6458, 0.8482)),
    ("nonzero", "exempt", (1.6504, 0.9278), (2.3001, 1.5554), (3.9772, 0.8482)),
    ("nonzero", "constrained", (1.6504, 0.9278), (2.3001, 1.5554), (3.9772, 0.8482)),
    ("coulomb", "exempt", (1.6504, 0.9278), (2.3001, 1.5554), (3.9772, 0.8482)),
]
CELLS = [
    (sign, sliding, name, *cell)
    for sign, sliding, *row in RULE_TABLE
    for name, cell in zip(FIGURES, (SPHERE, *row), strict=True)
]


@pytest.mark.sampled(14)
@pytest.mark.parametrize("search", SEARCHES)
@pytest.mark.parametrize(("sign", "sliding", "name", "margin", "torque"), CELLS)
def test_rule_table(sign, sliding, name, margin, torque, search):
    problem = scene(name)
    options = {"sign_rule": sign, "sliding_rule": sliding, "search": search}
    if sign == "coulomb":
        options = {"static_friction": sign, "search": search}
    largest = maximize_margin(problem, **options)
    smallest = minimize_torque(problem, 0.1, **options)
    for solution, figure in ((largest, margin), (smallest, torque)):
        assert solution.found == (figure is not None)
        if figure is None:
            assert solution.status is Status.INFEASIBLE_MODES
            assert "virtual sliding" in solution.status.message
        else:
            assert solution.status is Status.OPTIMAL
            assert_holds(solution)
    tolerance = FIGURES[name][-1]
    if margin is not None:
        # Four printed decimals leave 3e-4 of the smallest margin.
        assert largest.margin == pytest.approx(margin, rel=tolerance, abs=5e-5)
    if torque is not None:
        assert smallest.max_torque == pytest.approx(torque, rel=tolerance)


def test_a_margin_beyond_the_largest_has_no_forces():
    problem = scene("rest")
    largest = maximize_margin(problem).margin
    assert minimize_torque(problem, 0.999 * largest).found
    beyond = minimize_torque(problem, 1.001 * largest)
    assert not beyond.found
    assert beyond.status is Status.INFEASIBLE_FORCES
    assert beyond.certificate.infeasibility > 0.0
