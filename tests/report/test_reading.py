"""A solution read back from its document is the same solution."""

import copy
from dataclasses import fields

import numpy as np
import pytest
from report_cases import ALLEGRO, AT_REST, SLIDING, pinched_block, solved, through_json

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque, optimum_gradients
from graspless_pin.algorithms.gradients import Gradients
from graspless_pin.errors import ArgumentError
from graspless_pin.report.document import solution_document
from graspless_pin.report.provenance import problem_sha256, same_problem
from graspless_pin.report.reading import document_bodies, read_solution

CASES = {
    "allegro": lambda: solved(ALLEGRO),
    "sliding": lambda: solved(SLIDING),
    "least torque": lambda: solved(AT_REST, "torque"),
    "by limits": lambda: solved(AT_REST, "torque", scale="limits"),
    "coulomb": lambda: solved(AT_REST, static_friction="coulomb"),
    "infeasible": lambda: solved(SLIDING, sliding_rule="constrained"),
    "arrays": lambda: (None, minimize_torque(pinched_block(), margin=0.2)),
    "no joint": lambda: (None, maximize_margin(stool())),
}


def stool():
    """Three feet on the ground, without a hand: the joints' inertia has no row."""
    feet = [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]]
    return QuasistaticProblem(
        feet, [[0.0, 0.0, 1.0]] * 3, [0.0, 0.0, -4.9, 0.0, 0.0, 0.0], friction=0.5,
        object_inertia=np.eye(6), joint_inertia=np.zeros((0, 0)),
    )  # fmt: skip


@pytest.mark.parametrize("make", CASES.values(), ids=CASES)
def test_it_is_the_same_solution(make):
    scene, solution = make()
    document = through_json(solution, scene)
    read = read_solution(document)
    assert str(read) == str(solution)
    assert read.status is solution.status and read.rules == solution.rules
    assert read.certificate == solution.certificate or not solution.found
    assert same_problem(read.problem, solution.problem)
    if solution.found:
        np.testing.assert_array_equal(read.contact_forces, solution.contact_forces)
        np.testing.assert_allclose(read.torques, solution.torques, rtol=1e-12)
        assert read.mode == solution.mode
    assert document_bodies(document) == (None if scene is None else scene.contacts.bodies)


GRADIENTS = {
    "margin": lambda: maximize_margin(pinched_block()),
    "torque": lambda: minimize_torque(pinched_block(), margin=0.2),
    "by limits": lambda: solved(AT_REST, "torque", scale="limits")[1],
    "sliding": lambda: solved(SLIDING)[1],
    "strict at rest": lambda: solved(AT_REST, "torque")[1],
}


@pytest.mark.parametrize("make", GRADIENTS.values(), ids=GRADIENTS)
def test_a_read_solution_knows_its_multipliers(make):
    solution = make()
    expected = optimum_gradients(solution)
    found = optimum_gradients(read_solution(through_json(solution)))
    for item in fields(Gradients):
        own, other = (getattr(one.values, item.name) for one in (expected, found))
        np.testing.assert_allclose(other, own, rtol=1e-6, atol=1e-8 * np.abs(own).max(initial=1.0))
        np.testing.assert_array_equal(found.unique[item.name], expected.unique[item.name])


def test_a_read_solution_knows_whether_it_was_regularized():
    solution = maximize_margin(pinched_block(), regularization=1e-3)
    read = read_solution(through_json(solution))
    assert read.regularization == 1e-3
    with pytest.raises(ArgumentError, match="has a regularisation"):
        optimum_gradients(read)


def test_a_read_solution_has_the_same_proof():
    for solution in (solved(AT_REST, "torque")[1], maximize_margin(pinched_block())):
        document = through_json(solution)
        again = through_json(read_solution(document))
        assert again["proof"]["complete"] is True
        assert len(again["proof"]["nodes"]) == len(document["proof"]["nodes"])


@pytest.mark.parametrize("found", [1, 3, None])
def test_other_formats_are_refused(found):
    document = through_json(maximize_margin(pinched_block())) | {"format": found}
    with pytest.raises(ArgumentError, match=f"has the format {found}; it must be 2: solve again"):
        read_solution(document)
    with pytest.raises(ArgumentError, match="is not a JSON object"):
        read_solution([1, 2])  # pyright: ignore[reportArgumentType]


def test_the_document_says_what_it_was_made_of():
    scene, solution = solved(SLIDING)
    made_of = solution_document(solution, scene)["provenance"]
    assert made_of["scene_file"] == str(SLIDING)
    assert made_of["problem_sha256"] == problem_sha256(solution.problem)
    assert {"python", "numpy", "graspless-pin", "pin"} <= set(made_of["versions"])
    alone = solution_document(maximize_margin(pinched_block()))["provenance"]
    assert alone["scene_file"] is None and alone["scene_sha256"] is None


def broken(document, path, value):
    """The document with one value replaced, or taken away."""
    changed = copy.deepcopy(document)
    place = changed
    for key in path[:-1]:
        place = place[key]
    if value is KeyError:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return changed


BROKEN = {
    "no status": (["status"], KeyError, "lacks the key 'status'"),
    "another status": (["status"], "perfect", "status is 'perfect'; it must be one of"),
    "no contact": (["contacts"], [], "states an invalid problem|has an invalid value"),
    "a normal that is none": (["contacts", 0, "normal"], [0, 2, 0], "states an invalid problem"),
    "a force of two": (["contacts", 0, "force"], [0, 2], "has an invalid value"),
    "a text for a number": (["required_margin"], "much", "has an invalid value"),
    "true for a number": (["required_margin"], True, "is True; it must be"),
    "true for a regularisation": (["regularization"], True, "regularization is True"),
    "an endless regularisation": (["regularization"], np.inf, "regularization is inf"),
    "a negative regularisation": (["regularization"], -1.0, "regularization must not be negative"),
    "true for a coordinate": (["contacts", 0, "position"], [True, 0.0, 0.0], "is True; it must be"),
    "true for a friction": (["contacts", 0, "friction"], True, "is True; it must be"),
    "true for a limit": (["joints", 0, "upper"], True, "is True; it must be"),
    "true for a bound": (["certificate", "bound"], True, "is True; it must be"),
    "true for a multiplier": (["multipliers", "normal_upper", 0], True, "is True; it must be"),
    "NaN for a force": (["contacts", 0, "force"], [0.0, 0.0, np.nan], "force of contact 0 is nan"),
    "no joint": (["joints"], [], "states an invalid problem|has an invalid value"),
    "a list of contacts": (["contacts", 0], "finger", "has an invalid value"),
    "another rule": (["rules", "sign_rule"], "loose", "sign_rule of rules is 'loose'"),
}


@pytest.mark.parametrize(("path", "value", "message"), BROKEN.values(), ids=BROKEN)
def test_a_broken_document_is_refused(path, value, message):
    document = through_json(maximize_margin(pinched_block()))
    with pytest.raises(ArgumentError, match=message):
        read_solution(broken(document, path, value))
