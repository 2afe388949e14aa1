"""Documents of objectives of one's own: what is written is proven, and forgeries are refused."""

import copy
import itertools

import numpy as np
import pytest
from own_objectives import (
    SOLUTIONS,
    WEIGHTS,
    Helped,
    LargestOf,
    LeastSideways,
    SquaredShares,
    WeightedMargin,
)
from tests.core.random_scenes import general_scene
from tests.core.scenes import rescaled, scene
from verified_documents import SCALES, changed, documented, failed, places, refused

from graspless_pin import Objective, ProgramBuilder, maximize_margin, minimize_torque, optimize
from graspless_pin.errors import ArgumentError
from graspless_pin.report.reading import read_solution
from graspless_pin.report.verify import own_objective, verify_document
from graspless_pin.report.verify.bounds import column_box, largest_objective
from graspless_pin.report.verify.reading import read_problem


@pytest.fixture
def own(made):
    """Make a document by the name of its kind; not to be changed in place."""
    return lambda name: made(f"own {name}")


@pytest.mark.parametrize("name", SOLUTIONS)
def test_all_that_a_document_claims_is_proven(own, name):
    verification = verify_document(own(name))
    assert verification.proven, str(verification)
    given = [check.name for check in verification.checks if check.given]
    assert any(one.startswith("costs of ") for one in given)
    assert not any(one.startswith("boxes of ") for one in given)


def test_rows_of_single_force_components_are_proven():
    problem = general_scene(1, 3, joints=(1, 3), cone_edges=5)
    solution = optimize(problem, LeastSideways(), static_friction="coulomb")
    assert solution.value > 0.01
    friction = np.einsum("mi,mi->m", solution.problem.tangents[..., 1], solution.contact_forces)
    assert solution.value == pytest.approx(np.abs(friction).max(), abs=1e-6)
    assert verify_document(documented(solution)).proven


def test_documents_with_round_cones_are_refused_by_name(own):
    problem = scene("rest").with_changes(cone="round")
    with pytest.raises(ArgumentError, match=r"cannot be written as a document: .* round"):
        documented(optimize(problem, SquaredShares(0.1)))
    forged = changed(own("squared shares"), "cone", to="round")
    with pytest.raises(ValueError, match="not supported together with round cones"):
        verify_document(forged)
    with pytest.raises(ArgumentError, match="not supported together with round cones"):
        read_solution(forged)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("force", "length"), SCALES)
def test_proofs_hold_at_every_scale(force, length):
    problem = rescaled(scene("rest"), force, length)
    for objective in (SquaredShares(0.1 * force), WeightedMargin(WEIGHTS), Helped(0.05 * force)):
        assert verify_document(documented(optimize(problem, objective))).proven


def alike(one, other):
    """Whether two pieces of a document are the same but for rounding."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(alike(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(alike, one, other))
    return one == other or one == pytest.approx(other, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("name", SOLUTIONS)
def test_a_document_is_read_as_it_was_written(own, name):
    """Its objective is the same program: solved again, it has the same value."""
    document = own(name)
    claimed = read_solution(document)
    again = documented(claimed)
    assert alike(again["objective"], document["objective"])
    assert verify_document(again).proven
    if name not in ("coulomb", "in a mode", "infeasible modes", "helped down"):
        solved = optimize(claimed.problem, claimed.objective)
        assert solved.status is claimed.status
        if solved.found:
            assert solved.value == pytest.approx(claimed.value, abs=1e-6)


def figures_of(document):
    """The ways to the figures that follow from others: all of them are worked out again."""
    yield from (("margin",), ("max_torque",), ("objective", "value"))
    for key in ("bound", "gap", "duality_gap", "primal_residual", "force_reach"):
        yield "certificate", key
    for index, group in enumerate(document["objective"]["columns"]):
        for place in range(len(group["values"])):
            yield "objective", "columns", index, "values", place


@pytest.mark.parametrize("name", ["squared shares", "weighted margin", "helped"])
def test_no_stated_figure_is_believed(own, name):
    document = own(name)
    for path in figures_of(document):
        place = document
        for key in path:
            place = place[key]
        wrong = place - 0.01 if path[-1] == "force_reach" else place + 0.01
        assert refused(changed(document, *path, to=wrong)), path


def test_a_worse_answer_is_not_optimal(own):
    """Balanced forces within all limits, with every figure of their own and the true proof."""
    for name, other in (("squared shares", 0.3), ("weighted margin", 0.0)):
        forged = copy.deepcopy(own(name))
        worse = documented(optimize(scene("rest"), SquaredShares(other)))
        for key in ("joints", "contacts", "margin", "max_torque", "max_torque_unit"):
            forged[key] = worse[key]
        forged["proof"]["motion"] = worse["proof"]["motion"]
        (group,) = forged["objective"]["columns"]
        if name == "squared shares":
            group["values"] = [joint["torque"] / 10.0 for joint in forged["joints"]]
            value = float(np.square(group["values"]).sum())
        else:
            value = group["values"][0] = min(worse["margin"], group["values"][0])
        forged["objective"]["value"] = forged["certificate"]["bound"] = value
        forged["certificate"] |= {"gap": 0.0, "duality_gap": 0.0, "primal_residual": 0.0}
        assert "optimal over all modes" in failed(forged)
        assert "value as stated" not in failed(forged)


def test_columns_obey_their_rows_and_bounds(own):
    """Shares that are not those of the torques make no smaller value."""
    forged = copy.deepcopy(own("squared shares"))
    forged["objective"]["columns"][0]["values"] = [0.0, 0.0]
    forged["objective"]["value"] = forged["certificate"]["bound"] = 0.0
    assert "constraints of the objective" in failed(forged)
    helped = copy.deepcopy(own("helped"))
    helped["objective"]["columns"][0]["bounds"][0][0] = 1e3
    assert refused(helped)


def test_boxes_that_rows_imply_are_worked_out(own):
    """What the document says of them is not used; a forged one proves nothing."""
    document = own("weighted margin")
    problem = read_problem(document)
    low, high = column_box(problem, 50.0)
    assert low == 0.0
    assert document["objective"]["value"] < high <= 25.0  # 2 e <= 50 N at contact 0
    for key in ("box", "whole_box"):
        narrow = changed(document, "objective", "columns", 0, key, to=[[0.0], [1e-6]])
        assert verify_document(narrow).proven
        infeasible = copy.deepcopy(own("infeasible modes"))
        infeasible["objective"]["columns"][0][key] = [[1.0], [-1.0]]
        assert verify_document(infeasible).proven


def test_rows_have_a_bounded_number_of_coefficients_of_forces(own, monkeypatch):
    document = own("helped")
    sizes = [int(np.prod(block["shape"])) for block in document["objective"]["rows"]]
    most = 3 * len(document["contacts"]) * max(sizes)
    monkeypatch.setattr(own_objective, "_MOST_COEFFICIENTS", most)
    assert verify_document(document).proven
    monkeypatch.setattr(own_objective, "_MOST_COEFFICIENTS", most - 1)
    with pytest.raises(ValueError, match="too many rows"):
        verify_document(document)


@pytest.mark.parametrize("name", SOLUTIONS)
def test_no_forces_within_reach_cost_more_than_what_refutes(own, name):
    problem = read_problem(own(name))
    assert problem.own is not None
    low, high = column_box(problem, 50.0)
    ends = np.array(list(itertools.product(*zip(low, high, strict=True))))
    costs = ends @ problem.own.cost + 0.5 * ends**2 @ problem.own.curvature
    forces = largest_objective(problem, 50.0) - costs.max()
    # Of forces f the reach leaves |f_n| and friction below 50 N: 0.5 c f^2 each.
    assert -1e-9 <= forces <= 0.5 * problem.curvature.sum() * 50.0**2 + 1e-9


def test_a_box_that_no_row_implies_is_taken_as_given_and_named():
    """Nothing but its cost keeps a largest torque from being larger."""
    document = documented(optimize(scene("rest"), LargestOf()))
    verification = verify_document(document)
    assert verification.proven
    (line,) = (check for check in verification.checks if check.name == "boxes of 'largest of'")
    assert (
        line.given and line.detail.startswith("1 columns") and line.detail.endswith(": 0 to 1e+03")
    )
    value = minimize_torque(scene("rest"), 0.1).max_torque
    assert document["objective"]["value"] == pytest.approx(value, abs=1e-6)
    # Whatever the box is, nothing that exists is refuted by it.
    (group,) = document["objective"]["columns"]
    group["box"] = group["whole_box"] = [[2e3], [-2e3]]
    assert verify_document(document).proven


def test_torque_limits_that_an_objective_leaves_out_are_told(own):
    checks = {c.name: c for c in verify_document(own("helped")).checks}
    assert checks["torques within limits"].given
    with_them = {c.name: c for c in verify_document(own("squared shares")).checks}
    assert not with_them["torques within limits"].given


def test_any_value_may_be_wrong(own):
    """A message, never anything else, from the checker and from the reader."""
    document, rng = own("helped"), np.random.default_rng(1)
    paths = [("objective", *path) for path in places(document["objective"])]
    for index in rng.choice(len(paths), min(len(paths), 15), replace=False):
        *way, last = paths[index]
        for value in (None, "x", [], {}, 1e308, -1, True):
            false = copy.deepcopy(document)
            place = false
            for key in way:
                place = place[key]
            place[last] = value
            refused(false)
            try:
                read_solution(false)
            except ArgumentError as error:
                assert len(str(error)) < 400


class _Loose(Objective):
    name = "loose"

    def build(self, program: ProgramBuilder) -> None:
        program.balance()


class _Twice(Objective):
    name = "twice"

    def build(self, program: ProgramBuilder) -> None:
        program.balance()
        program.cones(0.0)
        program.cones(0.01)
        program.normal_limits(0.0)


@pytest.mark.parametrize(
    ("objective", "why"),
    [(_Loose(), "it lacks the balance"), (_Twice(), "two blocks with the name 'faces'")],
)
def test_what_no_document_holds_is_refused_by_name(objective, why):
    solution = optimize(scene("rest"), objective, static_friction="coulomb")
    with pytest.raises(ArgumentError, match=f"'{objective.name}' cannot be written .*{why}"):
        documented(solution)


def test_the_papers_objectives_are_worked_out_by_the_checker():
    document = documented(maximize_margin(scene("rest")))
    assert "objective" not in document and document["algorithm"] == "margin"
