"""Every tolerance of the checker comes from the problem, and none from an answer's own figures."""

import ast
import copy
import inspect
from pathlib import Path

import numpy as np
import pytest
from rest_documents import slope
from tampering import falsehood, originals, refused
from tests.core.scenes import scene
from verified_documents import documented

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque
from graspless_pin.report import solution_document
from graspless_pin.report import verify as checker
from graspless_pin.report.verify import tolerances, verify_document
from graspless_pin.report.verify.reading import read_problem
from graspless_pin.report.verify.rest_bounds import (
    Kind,
    KnownStates,
    RestMultipliers,
    largest_goal,
    rest_dynamics,
)

MODULES = sorted(Path(inspect.getfile(checker)).parent.glob("*.py"))
ELSEWHERE = [file for file in MODULES if file.name != "tolerances.py"]
ZEROS = {"values.py": [1e-60], "problem.py": [1e-12, 1e-12, 1e-20, 1e-12]}
"""What counts as zero in data: no answer is held to it."""
PROBLEM = {"problem", "resolution"}
"""What tolerances may be worked out from: the data, and what was asked for."""


def small(tree):
    """Numbers of the size of a tolerance."""
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, float)
        and 0.0 < abs(node.value) < 0.05
    ]  # fmt: skip


@pytest.mark.parametrize("file", ELSEWHERE, ids=lambda file: file.stem)
def test_no_module_but_one_has_tolerances(file):
    tree = ast.parse(file.read_text())
    assert small(tree) == ZEROS.get(file.name, [])
    names = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert not names & {"finfo", "eps", "allclose", "isclose"}


def test_tolerances_are_given_the_problem_alone():
    """But for what helps no document, and the optimum, of whose two sides the smaller counts."""
    own = {
        name: list(inspect.signature(one).parameters)
        for name, one in inspect.getmembers(tolerances, inspect.isfunction)
        if one.__module__ == tolerances.__name__ and not name.startswith("_")
    }
    others = {name: names for name, names in own.items() if not set(names) <= PROBLEM}
    assert others == {"rounding_error": ["sizes"], "objective": ["problem", "sides"]}
    assert len(own) > 8


# what an answer says of itself

ANSWER = {
    "forces": lambda made: [(c, "force") for c in made["contacts"]],
    "torques": lambda made: [(j, k) for j in made["joints"] for k in ("torque", "torque_contact")],
    "figures": lambda made: [(made, "margin"), (made, "max_torque")],
    "certificate": lambda made: [
        (made["certificate"], key)
        for key in ("bound", "gap", "duality_gap", "primal_residual", "infeasibility")
    ],
    "reach": lambda made: [(made["certificate"], "force_reach")],
    "multipliers": lambda made: [
        (one, key)
        for one in [made.get("multipliers")]
        + [node["multipliers"] for node in made["proof"]["nodes"] if "multipliers" in node]
        if one
        for key in one
        if key != "faces"
    ],
    "motion": lambda made: [
        (made["proof"]["motion"], key) for key in ("object", "joints") if made["proof"]["motion"]
    ],
}
"""Figures that the answer consists of, as places that hold them."""


def grown(value, factor):
    if isinstance(value, list):
        return [grown(one, factor) for one in value]
    return None if value is None else value * factor


@pytest.fixture(scope="module")
def documents():
    return originals()


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", ANSWER)
@pytest.mark.parametrize("index", range(13))
def test_large_figures_of_an_answer_widen_no_tolerance(documents, name, index):
    """All figures of one kind are made large, and one of another kind is off beside them."""
    original = documents[index]
    rng = np.random.default_rng([index, len(name)])
    force, false = original["scales"]["force"], 0
    for factor in (1e3, 1e16):
        made = copy.deepcopy(original)
        for place, key in ANSWER[name](made):
            place[key] = grown(place[key], factor)
        for beside in (None, "figures", "certificate", "forces"):
            off = copy.deepcopy(made)
            places = [] if beside in (None, name) else ANSWER[beside](off)
            if places:
                place, key = places[rng.integers(len(places))]
                value = place[key]
                size = 1e-3 * max(force, 1e-12)
                if isinstance(value, list):
                    place[key] = [one + size for one in value]
                elif value is not None:
                    place[key] = value + size
            why = falsehood(off, original) if repr(off) != repr(original) else ""
            false += bool(why)
            assert not why or refused(off), (factor, beside, why)
    assert false or name in ("reach", "multipliers", "motion") or not original["found"]


def test_an_answer_of_large_forces_is_held_to_the_load():
    """Of a squeeze of 1e5 loads: what it leaves of the balance counts in loads."""
    wide = scene("rest").with_changes(max_normal_force=1e8, torque_limits=(-1e8, 1e8))
    document = documented(minimize_torque(wide, 1e6))
    assert document["max_torque"] > 1e6
    assert verify_document(document).proven
    force = document["scales"]["force"]
    for off, fails in ((5e-7, False), (3e-6, True), (1.0, True)):
        made = copy.deepcopy(document)
        made["contacts"][0]["force"][1] += off * force
        said = {one.name for one in verify_document(made).checks if one.passed is False}
        assert ("balance of forces" in said) is fails


@pytest.mark.parametrize("size", [1.0, 1e8, 1e16, 1e30])
def test_multipliers_of_any_size_prove_no_more_of_rest(size):
    """A body that falls freely has the power 1, whatever multipliers say; rounding is theirs."""
    problem = read_problem(solution_document(maximize_margin(slope())))
    inertia = np.diag([1.0] * 3 + [1e-3] * 3)
    dynamics = rest_dynamics(problem, problem.w, inertia, np.zeros(0, dtype=int))
    assert dynamics is not None
    states = KnownStates.all_free(3)
    for contact in range(3):
        states = states.with_state(contact, Kind.OPEN)
    goal = dynamics.load, np.zeros((3, 3))
    multipliers = RestMultipliers(-size * dynamics.load, np.zeros(3), np.zeros((3, 2)))
    bound = largest_goal(dynamics, states, np.zeros(3), multipliers, goal, 1e6)
    assert bound >= 1.0 - 1e-15


# limits


def limited(lower, upper, units=("N m", "N m", "N"), normal=(1.0, 50.0), load=1.0):
    jacobian = np.zeros((6, 3))
    jacobian[0, 0] = jacobian[1, 1] = jacobian[4, 2] = 1.0
    solution = maximize_margin(
        QuasistaticProblem(
            [[0, -0.05, 0], [0, 0.05, 0]], [[0, 1, 0], [0, -1, 0]], [0, 0, -load, 0, 0, 0],
            jacobian, friction=0.5, joint_units=list(units), torque_limits=(lower, upper),
            max_normal_force=list(normal),
        )
    )  # fmt: skip
    return read_problem(documented(solution))


def test_limits_hold_to_a_millionth_of_themselves_or_of_the_load():
    problem = limited([-0.2, -5.0, -np.inf], [0.0, np.inf, 1e-4])
    lower, upper = tolerances.torque_limits(problem)
    np.testing.assert_allclose(lower, [0.2e-6, 1e-6, 1e-6], rtol=1e-12)
    # A thousandth of the largest limit of the same unit is the least that counts.
    np.testing.assert_allclose(upper, [5e-9, 1e-6, 1e-10], rtol=1e-12)
    np.testing.assert_allclose(tolerances.normal_limits(problem), [1e-6, 1e-6], rtol=1e-12)
    strict = limited([-1.0] * 3, [1.0] * 3, normal=(1e-5, 0.1))
    np.testing.assert_allclose(tolerances.normal_limits(strict), [1e-10, 1e-7], rtol=1e-12)


def test_a_unit_without_limits_but_zero_is_held_to_the_load():
    problem = limited([0.0, 0.0, -1.0], [0.0, 0.0, 1.0])
    lower, upper = tolerances.torque_limits(problem)
    np.testing.assert_allclose([lower, upper], 1e-6, rtol=1e-12)
    assert tolerances.are_limits_resolved(problem)


def test_a_load_of_more_than_a_million_limits_cannot_be_told():
    assert tolerances.are_limits_resolved(limited([-1e-6] * 3, [1e-6] * 3))
    assert not tolerances.are_limits_resolved(limited([-0.9e-6] * 3, [0.9e-6] * 3))
    assert tolerances.are_limits_resolved(limited([-0.9e-6] * 3, [0.9e-6] * 3, load=0.5))
