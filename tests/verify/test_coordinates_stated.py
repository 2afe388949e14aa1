"""Documents of other passive coordinates than one free object's: two boxes, a block on a rail."""

import copy
import json
from functools import cache

import numpy as np
import pytest
from own_objectives import Helped
from tests.core.two_bodies import HEIGHT, THREE, G, on_a_rail, stacked
from verified_documents import refused

from graspless_pin import (
    QuasistaticProblem,
    guaranteed_disturbance,
    maximize_margin,
    minimize_torque,
    optimize,
    stability,
)
from graspless_pin.report import read_solution, solution_document
from graspless_pin.report.verify import verify_document


def gliding():
    """The stack on a belt that runs under it, kept where it is by a smooth finger."""
    arguments = stacked(0.0, (0.1, 0.5), push=3.0, corners=THREE)
    arguments["friction"][-1] = 0.0
    sliding = np.zeros((7, 3))
    sliding[:3] = [-0.1, 0.0, 0.0]
    return QuasistaticProblem(**arguments, sliding=sliding)


def hinged():
    """A flap on a hinge, pulled down by 1 N m and held up by a support 0.2 m away."""
    return QuasistaticProblem(
        [[0.2, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [-1.0], friction=0.5, object_inertia=[[0.01]],
        wrench_matrix=[[0.0, 0.0, 0.2]], passive_units=["N m"],
    )  # fmt: skip


def hybrid():
    """The stack on a slope under a hybrid finger of 2 N."""
    arguments = stacked(0.2, push=2.0, corners=THREE)
    arguments["jacobian"][-3:, 0] = arguments["normals"][-1]
    return QuasistaticProblem(**arguments | {"torque_limits": (2.0, 2.0), "joint_inertia": [[0.0]]})


PROBLEMS = {
    "flat": lambda: QuasistaticProblem(**stacked(0.0)),
    "slope": lambda: QuasistaticProblem(**stacked(0.2)),
    "too steep": lambda: QuasistaticProblem(**stacked(0.5)),
    "pushed": lambda: QuasistaticProblem(**stacked(0.2, push=3.0)),
    "round": lambda: QuasistaticProblem(**stacked(0.2, push=3.0), cone="round"),
    "three": lambda: QuasistaticProblem(**stacked(0.2, corners=THREE)),
    "rail": lambda: on_a_rail(20.0),
    "weak rail": lambda: on_a_rail(9.0),
    "belt": gliding,
    "hinge": hinged,
    "hybrid": hybrid,
}
SOLVES = {"margin": maximize_margin, "torque": lambda problem: minimize_torque(problem, 0.01)}
OTHERS = {
    "limits": lambda: minimize_torque(PROBLEMS["pushed"](), 0.1, scale="limits"),
    "regularised": lambda: maximize_margin(PROBLEMS["pushed"](), regularization=1e-2),
    "nonzero": lambda: maximize_margin(PROBLEMS["pushed"](), sign_rule="nonzero"),
    "exact": lambda: maximize_margin(PROBLEMS["pushed"](), sign_rule="exact"),
    "coulomb": lambda: maximize_margin(PROBLEMS["pushed"](), static_friction="coulomb"),
    "in a mode": lambda: maximize_margin(
        PROBLEMS["pushed"](), mode=maximize_margin(PROBLEMS["pushed"]()).mode
    ),
    "strong": lambda: maximize_margin(on_a_rail(20.0), stability="strong"),
    "own objective": lambda: optimize(PROBLEMS["pushed"](), Helped()),
    "infeasible modes": lambda: maximize_margin(
        on_a_rail(20.0).with_changes(tangents=[[[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]]] * 2)
    ),
}
"""Of every kind of document, one with other coordinates."""


def plain(solution, **parts):
    """A document as it comes back from a file."""
    return json.loads(json.dumps(solution_document(solution, **parts)))


@cache
def document(name, solve="margin", *, node_limit=None):
    """The document of a problem, with the verdict on its torques where nodes are given."""
    problem = PROBLEMS[name]()
    solution = SOLVES[solve](problem)
    verdict = None
    if node_limit is not None:
        verdict = stability(problem, solution.torques, node_limit=node_limit)
    return plain(solution, verdict=verdict)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("solve", SOLVES)
def test_answers_are_proven_by_their_documents(name, solve):
    made = document(name, solve)
    assert made["found"] == (name not in ("too steep", "weak rail"))
    verification = verify_document(made)
    assert verification.proven, str(verification)
    assert "passive coordinates" in str(verification)
    again = read_solution(made)
    problem = PROBLEMS[name]()
    np.testing.assert_array_equal(again.problem.W, problem.W)
    assert again.problem.passive_units == problem.passive_units
    if again.found:
        np.testing.assert_allclose(again.contact_forces, [c["force"] for c in made["contacts"]])


def test_a_contact_that_no_coordinate_moves_is_no_error():
    """Turned out of the hinge's way, and no longer across its tangents."""
    made = copy.deepcopy(document("hinge", node_limit=500))
    made["contacts"][0]["normal"] = [1.0, 0.0, 0.0]
    assert refused(made)


@pytest.mark.parametrize("name", OTHERS)
def test_documents_of_every_kind_are_proven(name):
    solution = OTHERS[name]()
    assert solution.found == (name != "infeasible modes")
    made = plain(solution)
    verification = verify_document(made)
    assert verification.proven, str(verification)
    again = read_solution(made)
    assert again.status is solution.status
    if solution.found:
        assert again.value == pytest.approx(solution.value, abs=1e-9)
        made["wrench_matrix"][0][0] += 0.1
        assert refused(made)


def forged(name, change, **parts):
    made = copy.deepcopy(document(name, **parts))
    change(made)
    return made


@pytest.mark.parametrize("row", range(12))
def test_another_entry_of_the_matrix_is_refused(row):
    forces = np.array([one["force"] for one in document("pushed")["contacts"]])
    largest = int(np.argmax(np.abs(forces)))

    def change(made):
        made["wrench_matrix"][row][largest] += 0.01

    assert refused(forged("pushed", change))


def without_reaction(made):
    """Contacts between the boxes, as many as on the floor, act on the upper one alone."""
    own = 3 * (len(made["contacts"]) // 2)
    for row in made["wrench_matrix"][:6]:
        row[own : 2 * own] = [0.0] * own


@pytest.mark.parametrize("name", ["flat", "slope", "pushed"])
def test_a_reaction_that_is_left_out_is_refused(name):
    assert refused(forged(name, without_reaction))


def test_an_infeasible_answer_is_held_to_its_load():
    def lighter(made):
        made["external_wrench"] = [0.0, 0.0, -9.8, *[0.0] * 3, 0.0, 0.0, -5.88, *[0.0] * 3]
        for row in made["wrench_matrix"]:
            row[:] = [0.0] * 24

    def level(made):
        down = np.array([0.0, 0.0, -1.0])
        normal = np.array(made["contacts"][0]["normal"])
        for number, mass in enumerate((1.0, 0.6)):
            made["external_wrench"][6 * number : 6 * number + 3] = (-9.8 * mass * normal).tolist()
        assert normal @ down > -1.0

    assert not refused(document("too steep"))
    assert refused(forged("too steep", level))
    # Without any effect of the contacts nothing balances, but the multipliers are of another load.
    assert refused(forged("too steep", lighter))


@pytest.mark.parametrize(
    "change",
    [
        lambda made: made.pop("wrench_matrix"),
        lambda made: made.pop("passive_units"),
        lambda made: made["passive_units"].pop(),
        lambda made: made["passive_units"].__setitem__(0, "kg"),
        lambda made: made["passive_units"].__setitem__(0, "N m"),
        lambda made: made["wrench_matrix"].pop(),
        lambda made: made["wrench_matrix"][3].pop(),
        lambda made: made["wrench_matrix"].append([0.0] * 27),
        lambda made: made["external_wrench"].pop(),
        lambda made: made["wrench_matrix"].clear(),
        lambda made: made["proof"]["motion"]["object"].pop(),
        lambda made: made["multipliers"]["balance"].pop(),
    ],
)
def test_a_document_whose_coordinates_do_not_fit_is_refused(change):
    assert refused(forged("pushed", change))


@pytest.mark.parametrize(
    ("name", "nodes"),
    [("flat", 100), ("rail", 100), ("hinge", 100), ("hybrid", 3000)],
)
def test_rest_is_proven(name, nodes):
    made = document(name, node_limit=nodes)
    assert made["stability"]["status"] == "strong"
    verification = verify_document(made)
    assert verification.proven, str(verification)


def test_forgeries_of_rest_on_a_slope_are_refused():
    """On three corners each, where the proof is short."""
    made = document("three", node_limit=2000)
    assert made["stability"]["status"] == "strong" and verify_document(made).proven

    def light(one):
        one["object_inertia"] = (0.5 * np.array(one["object_inertia"])).tolist()

    def upper_heavy(one):
        for index in range(6, 9):
            one["object_inertia"][index][index] = 5.0

    def unproven(one):
        one["stability"]["proof"]["loads"][-1]["multipliers"]["motion"] = [0.0] * 12

    for change in (without_reaction, light, upper_heavy, unproven):
        assert refused(forged("three", change, node_limit=2000)), change.__name__


def test_a_stack_on_a_belt_keeps_its_motion():
    made = document("belt", "torque", node_limit=2000)
    assert made["joints"][0]["torque"] == pytest.approx(0.1 * 1.6 * G, abs=1e-6)
    assert made["stability"]["status"] == "strong"
    verification = verify_document(made)
    assert verification.proven, str(verification)

    def one_goal_less(one):
        last = max((node for node in one["stability"]["proof"]["nodes"] if node["sides"]),
                   key=lambda node: len(node["sides"]))  # fmt: skip
        last["sides"].pop()

    for change in (without_reaction, one_goal_less):
        assert refused(forged("belt", change, solve="torque", node_limit=2000)), change.__name__


def test_a_motion_of_two_boxes_is_checked():
    problem = QuasistaticProblem(**stacked(0.55, push=3.0, corners=THREE))
    solution = minimize_torque(problem, 0.01)
    verdict = stability(problem, solution.torques)
    assert verdict.status.name == "WEAK"
    assert verdict.motion is not None
    assert verdict.motion.object_acceleration.shape == (12,)
    made = plain(solution, verdict=verdict)
    verification = verify_document(made)
    assert verification.proven, str(verification)
    for entry in (0, 6, 7, 10):
        other = copy.deepcopy(made)
        other["stability"]["motion"]["object_acceleration"][entry] += 0.05
        assert refused(other), entry


def test_disturbances_of_a_block_on_a_rail_are_proven():
    """Two fingers of 20 N bear 20 N of friction in all, of which the weight takes 9.8."""
    problem = on_a_rail(20.0)
    solution = maximize_margin(problem)
    found = guaranteed_disturbance(problem, solution.torques, precision=0.05)
    assert found.directions.tolist() == [[1.0], [-1.0]]
    assert found.guaranteed == pytest.approx([29.8, 10.2], rel=0.06)
    assert (found.guaranteed <= [29.8, 10.2]).all()
    made = plain(solution, disturbances=found)
    verification = verify_document(made)
    assert verification.proven, str(verification)
    more = copy.deepcopy(made)
    more["disturbances"]["directions"][1]["guaranteed"] = 10.5
    assert refused(more)


@pytest.mark.parametrize("load", [1.0, -1.0])
@pytest.mark.parametrize("aside", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
def test_a_contact_across_a_rail_does_not_block_it_by_rounding(aside, load):
    """Of normals across an oblique rail one has -2.8e-17 along it: 3.6e16 N would hold 1 N."""
    rail = np.array([0.2, 0.7, 0.1]) / np.linalg.norm([0.2, 0.7, 0.1])
    normal = np.cross(rail, aside)
    problem = QuasistaticProblem(
        [[0.0, 0.0, 0.0]], [normal / np.linalg.norm(normal)], [load], friction=0.5,
        wrench_matrix=[rail], passive_units=["N"], object_inertia=[[1.0]],
    )  # fmt: skip
    solution = maximize_margin(problem, static_friction="coulomb")
    verdict = stability(solution.problem, solution.torques)
    assert verdict.status == "weak" and verdict.motion is not None
    assert verdict.motion.object_acceleration == pytest.approx([load])
    made = plain(solution, verdict=verdict)
    verification = verify_document(made)
    assert verification.proven, str(verification)
    smooth = problem.with_changes(friction=0.0)
    assert stability(smooth, []).status == "none"


def test_scales_are_those_of_the_definition():
    """Of loads by unit, and of the longest lever in rows of N m."""
    hinge = PROBLEMS["hinge"]().scales
    assert (hinge.force, hinge.length) == pytest.approx((5.0, 0.2))
    problem = PROBLEMS["pushed"]()
    scales, levers = problem.scales, problem.W.reshape(12, 9, 3)
    turning = levers[[3, 4, 5, 9, 10, 11]]
    assert scales.length == pytest.approx(np.linalg.norm(turning, axis=2).max())
    assert scales.length >= 0.5 * HEIGHT
    assert scales.force == pytest.approx(9.8 * np.hypot(1.0, 0.6))
    moment = problem.with_changes(external_wrench=[*[0.0] * 3, 3.0, 0.0, 4.0, *[0.0] * 6])
    assert moment.scales.force == pytest.approx(5.0 / scales.length)
