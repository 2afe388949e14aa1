"""Documents as they are written are proven, at every scale, and each false figure shows."""

import ast
import copy
import inspect
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.core.scenes import rescaled, scene
from verified_documents import SCALES, SOLUTIONS, changed, documented, failed, slab

import graspless_pin.report.verify
from graspless_pin import QuasistaticProblem, load_scene, maximize_margin, minimize_torque
from graspless_pin.algorithms import solution_proof
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document
from graspless_pin.report.verify.outcome import Check, Verification, given
from graspless_pin.report.verify.reading import read_problem

STATUS = {
    "in a mode": "optimal_in_mode",
    "infeasible forces": "infeasible_forces",
    "round infeasible forces": "infeasible_forces",
    "infeasible margin": "infeasible_forces",
    "infeasible shares": "infeasible_forces",
    "infeasible modes": "infeasible_modes",
    "infeasible modes torque": "infeasible_modes",
    "infeasible in a mode": "infeasible_in_mode",
    "infeasible mode": "infeasible_mode",
}


@pytest.mark.parametrize("name", SOLUTIONS)
def test_all_that_a_document_claims_is_proven(made, name):
    document = made(name)
    verification = verify_document(document)
    assert verification.proven, str(verification)
    if name == "limit":
        assert document["status"] in ("limit_reached", "optimal")
    else:
        assert document["status"] == STATUS.get(name, "optimal")


@pytest.mark.parametrize("name", ["tree", "exact tree", "infeasible modes", "own squared shares"])
def test_proofs_over_modes_have_several_nodes_and_their_leaves_are_counted(made, name):
    nodes = made(name)["proof"]["nodes"]
    leaves = sum(node["kind"] in ("bound", "kinematic") for node in nodes)
    assert len(nodes) > 2
    words = "one leaf" if leaves == 1 else f"{leaves} leaves"
    assert f": {words}" in str(verify_document(made(name)))


def test_what_an_object_weighs_is_told_where_mass_and_gravity_are():
    cuboid = load_scene("examples/paper/cuboid_at_rest.yaml")
    document = solution_document(cuboid.solve(), cuboid)
    mass, gravity = document["object"]["mass"], document["gravity"]
    weight = mass * sum(one**2 for one in gravity) ** 0.5
    said = str(verify_document(document))
    assert f"the object weighs {weight:.6g} N" in said and "one leaf" in said
    for path in (("gravity",), ("object", "mass")):
        assert "weighs" not in str(verify_document(changed(document, *path, to=None)))


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("force", "length"), SCALES)
def test_proofs_hold_at_every_scale(force, length):
    for problem, sign_rule in (
        (scene("rest"), "strict"),
        (scene("up"), "exact"),
        (slab(), "nonzero"),
    ):
        problem = rescaled(problem, force, length)
        for scale in ("absolute", "limits"):
            found = minimize_torque(problem, 0.1 * force, scale=scale, sign_rule=sign_rule)
            assert verify_document(documented(found)).proven
        for epsilon, sliding_rule in ((0.0, "exempt"), (1e-3, "exempt"), (0.0, "constrained")):
            solution = maximize_margin(
                problem, sign_rule=sign_rule, sliding_rule=sliding_rule, regularization=epsilon
            )
            assert verify_document(documented(solution)).proven


@pytest.mark.sampled(2)
@pytest.mark.parametrize("limit", [1e7, 1e8, 1e10, 1e12])
def test_limits_far_above_the_load_change_no_verdict(limit):
    for name in ("rest", "up"):
        for problem in (
            scene(name).with_changes(max_normal_force=limit),
            scene(name).with_changes(max_normal_force=[50.0, 50.0, limit, 50.0, 50.0, 50.0]),
            scene(name).with_changes(torque_limits=(-limit, limit)),
        ):
            for solution in (maximize_margin(problem), minimize_torque(problem, 0.1)):
                document = documented(solution)
                assert verify_document(document).proven
                largest = problem.max_normal_force.max()
                assert document["certificate"]["force_reach"] == min(1e8 * 9.8, largest)


FIGURES = {
    "margin": (["margin"], "margin as stated"),
    "largest torque": (["max_torque"], "largest torque as stated"),
    "torque": (["joints", 0, "torque"], "torques J^T f + g as stated"),
    "torque of the contacts": (["joints", 0, "torque_contact"], "torques J^T f + g as stated"),
    "bound": (["certificate", "bound"], "gap as stated"),
    "force scale": (["scales", "force"], "force scale"),
    "length scale": (["scales", "length"], "length scale"),
    "required margin": (["required_margin"], "required margin"),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("force", "length"), SCALES)
@pytest.mark.parametrize(("path", "check"), FIGURES.values(), ids=FIGURES)
def test_each_figure_is_worked_out_again(path, check, force, length):
    document = documented(minimize_torque(rescaled(scene("rest"), force, length), 0.1 * force))
    value: Any = document
    for key in path:
        value = value[key]
    for factor in (1.001, -1.0, 0.0, 2.0):
        if path == ["required_margin"] and factor < 1.0:
            continue  # less is kept, too
        assert check in failed(changed(document, *path, to=factor * value)), factor


@pytest.mark.parametrize("key", ["gap", "duality_gap", "primal_residual"])
def test_figures_that_ought_to_vanish_are_worked_out_again(made, key):
    for off in (1e-4, -1e-4, 1.0):
        assert failed(changed(made("tree"), "certificate", key, to=off))


@pytest.mark.sampled(10)
@pytest.mark.parametrize("name", SOLUTIONS)
def test_another_status_is_refused(made, name):
    """With its own message and flag: only one status is true of a solution."""
    document = made(name)
    messages = {made(other)["status"]: made(other)["message"] for other in SOLUTIONS}
    for status, message in messages.items():
        if status == document["status"] or (status, name) == ("limit_reached", "tree"):
            continue
        false = copy.deepcopy(document)
        false |= {"status": status, "message": message}
        false["found"] = status in ("optimal", "optimal_in_mode", "limit_reached")
        try:
            verification = verify_document(false)
        except ValueError:
            continue  # it lacks what that status needs
        weaker = status in ("optimal_in_mode", "limit_reached") and document["found"]
        assert weaker or not verification.passed, status


@pytest.mark.parametrize(("name", "unit"), [("margin", "N"), ("torque", "N m"), ("shares", "")])
def test_values_are_told_in_the_unit_of_the_objective(made, name, unit):
    (told,) = [one for one in verify_document(made(name)).checks if one.name == "gap is closed"]
    assert told.detail.split(maxsplit=1)[1:] == ([unit] if unit else [])


def test_a_multiplier_of_no_constraint_is_named_so_far_as_it_fits(made):
    document = copy.deepcopy(made("torque"))
    document["multipliers"]["x" * 60] = [1.0]
    (told,) = [
        one
        for one in verify_document(document).checks
        if one.name == "each multiplier has a constraint"
    ]
    assert told.passed is False
    assert told.detail == "without a constraint: '" + "x" * 39


@pytest.mark.parametrize("gravity", [True, False])
def test_the_objects_weight_is_told_where_mass_and_gravity_are(gravity):
    scene = load_scene("examples/paper/cuboid_at_rest.yaml")
    document = solution_document(scene.solve(), scene)
    if not gravity:
        document["gravity"] = None
    assert ("the object weighs 9.8 N" in str(verify_document(document))) == gravity


def test_the_words_of_a_status_are_held_against_it(made):
    false = changed(made("tree"), "message", to="optimal in the given virtual-sliding mode")
    assert failed(false) == ["message and status agree"]
    assert "found and status agree" in failed(changed(made("tree"), "found", to=False))


@pytest.mark.parametrize("seed", range(3, 6))
def test_a_margin_of_zero_is_proven_whatever_rounding_leaves_of_it(seed):
    """No load: two contacts that cannot press on each other do best with no forces."""
    rng = np.random.default_rng(seed)
    normals = np.array([[0.15, 0.29, 0.945], [0.23, 0.775, -0.59]])
    problem = QuasistaticProblem(
        0.1 * rng.normal(size=(2, 3)), normals / np.linalg.norm(normals, axis=1)[:, None],
        np.zeros(6), 0.1 * rng.normal(size=(6, 1)), friction=[0.57, 0.46], cone="round",
        torque_limits=(-np.inf, np.inf), gravity_torques=[-0.04],
    )  # fmt: skip
    document = documented(maximize_margin(problem))
    verification = verify_document(document)
    assert verification.proven, str(verification)
    document["margin"] = 1e-6
    assert not verify_document(document).proven


def test_a_proof_that_is_withdrawn_is_not_proven(made):
    document = made("tree")
    document = changed(document, "proof", "complete", to=False)
    document = changed(document, "proof", "missing", to="it takes too long")
    verification = verify_document(document)
    assert verification.passed and not verification.proven
    assert "not proven here  optimal over all modes: it takes too long" in str(verification)


@pytest.mark.parametrize(
    ("passed", "words"),
    [
        (
            (True, True, True),
            "Verified: all figures and proofs of the document, in 3 checks, for the problem that "
            "is taken as given.",
        ),
        (
            (True, None, True),
            "None of 3 checks failed, but not every claim is proven here: 'b'.",
        ),
        ((None, None, None), "not every claim is proven here: 'a' and 2 more."),
        ((None, False, False), "Refused: 2 of 3 checks failed, the first 'b'."),
    ],
)
def test_the_conclusion_counts_checks_but_not_what_is_given(passed, words):
    lines = [Check(name, one, "") for name, one in zip("abc", passed, strict=True)]
    told = Verification((given("contacts", "4 of them"), *lines))
    assert words in told.conclusion and str(told).endswith(told.conclusion)
    assert told.proven == (passed == (True, True, True))


def test_too_many_leaves_are_said_and_not_proven(monkeypatch):
    page = Path(__file__).parents[2] / "docs" / "document_format.md"
    assert (
        f"A proof of more than {solution_proof.MOST_LEAVES} leaves is not written"
        in page.read_text()
    )
    monkeypatch.setattr("graspless_pin.algorithms.solution_proof.MOST_LEAVES", 2)
    document = documented(minimize_torque(scene("rest"), 0.1))
    assert document["proof"]["missing"] == "the proof needs more than 2 leaves"
    verification = verify_document(document)
    assert verification.passed and not verification.proven
    shown = {check.name: check.passed for check in verification.checks}
    assert shown["optimal over all modes"] is None
    assert shown["optimal within its mode"] is True


def undecided(*_):
    raise UndecidedMotionError("No solver decided.")


def test_a_proof_for_which_no_solver_decides_is_missing(monkeypatch):
    """What is known besides, the motion behind the mode too, stays in the document."""
    solution = minimize_torque(scene("rest"), 0.1)
    monkeypatch.setattr(solution_proof.ModeProver, "_proof_node", undecided)
    monkeypatch.setattr(solution_proof.ModeProver, "_leaf", lambda *_, **__: None)
    document = documented(solution)
    assert document["proof"]["missing"] == "No solver decided."
    verification = verify_document(document)
    assert verification.passed and not verification.proven


def test_a_motion_for_which_no_solver_decides_is_not_in_the_document(monkeypatch):
    solution = minimize_torque(scene("rest"), 0.1)
    monkeypatch.setattr("graspless_pin.algorithms.solution_proof.motion_of", undecided)
    document = documented(solution)
    assert document["proof"]["missing"] == "No solver decided."
    assert document["proof"]["motion"] is None


@pytest.mark.parametrize("lever", [1e-14, 1e-17])
def test_a_single_contact_has_the_length_of_the_load_or_one_metre(lever):
    """Of a load that acts so far beside it, unless that is rounding of its place."""
    problem = QuasistaticProblem([[0, 0, 1e-3]], [[0, 0, 1]], [0, 0, -1, lever, 0, 0], friction=0.5)
    document = documented(maximize_margin(problem, static_friction="coulomb"))
    length = read_problem(document).length
    assert length == problem.scales.length == pytest.approx(lever if lever > 1e-15 else 1.0)


def test_what_a_search_did_not_decide_is_not_proven():
    document = documented(minimize_torque(scene("rest"), 0.1, time_limit=0.0))
    verification = verify_document(document)
    assert document["status"] == "not_found_in_limit"
    assert verification.passed and not verification.proven


@pytest.mark.parametrize("nodes", [1, 2, 4, 6, 8])
def test_the_bound_of_a_search_that_ended_early_is_proven(nodes):
    solution = minimize_torque(scene("rest"), 0.1, node_limit=nodes)
    document = documented(solution)
    assert verify_document(document).proven == solution.found
    if document["status"] == "limit_reached":
        bound = document["certificate"]["bound"]
        above = changed(document, "certificate", "bound", to=bound + 1e-3)
        above["certificate"]["gap"] -= 1e-3
        assert failed(above) == ["bound over all modes"]


def test_the_checker_imports_numpy_alone():
    package = Path(inspect.getfile(graspless_pin.report.verify)).parent
    allowed = {"numpy", "graspless_pin.report.verify", *sys.stdlib_module_names}
    for file in package.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            for name in names:
                own = name.startswith("graspless_pin.report.verify.")
                assert own or name in allowed or name.split(".")[0] in allowed, (file.name, name)
