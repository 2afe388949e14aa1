"""Documents of answers that there are no forces: proven as they are written, at all limits."""

import numpy as np
import pytest
from tests.core.scenes import scene
from verified_documents import changed, documented, failed

from graspless_pin import maximize_margin, minimize_torque
from graspless_pin.algorithms.solution_proof import ModeProver
from graspless_pin.report.verify import verify_document
from graspless_pin.report.verify.tree import proven_violation

SCENES = ("sphere", "rest", "up", "down")
LIMITS = (50.0, 1e3, 1e7, 1e8, 1e12)
EFFORTS = (0.1, 0.5)


def answers(problem):
    """The answers of both algorithms and both scales, and the name of each."""
    yield "margin", maximize_margin(problem)
    for scale in ("absolute", "limits"):
        yield scale, minimize_torque(problem, 0.1, scale=scale)


@pytest.mark.sampled(7)
@pytest.mark.parametrize("limit", LIMITS)
@pytest.mark.parametrize("name", SCENES)
def test_weak_motors_are_proven_too_weak(name, limit):
    infeasible = 0
    for effort in EFFORTS:
        problem = scene(name).with_changes(torque_limits=(-effort, effort), max_normal_force=limit)
        for kind, solution in answers(problem):
            document = documented(solution)
            assert verify_document(document).proven, (effort, kind, failed(document))
            infeasible += not solution.found
    assert infeasible >= 3


@pytest.mark.sampled(6)
@pytest.mark.parametrize("mass", [0.5, 2.0, 5.0, 20.0])
@pytest.mark.parametrize("name", SCENES)
def test_heavy_objects_are_proven_too_heavy(name, mass):
    problem = scene(name)
    problem = problem.with_changes(
        external_wrench=mass * problem.external_wrench, torque_limits=(-0.5, 0.5)
    )
    for kind, solution in answers(problem):
        document = documented(solution)
        assert verify_document(document).proven, (kind, failed(document))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("limit", [1e3, 7.7e4, 1e7, 1e8, 1e10, 1e12])
def test_a_weak_cuboid_is_proven_so_with_far_limits_at_some_contacts(limit):
    limits = np.full(6, 50.0)
    limits[1:5] = limit
    weak = scene("rest").with_changes(torque_limits=(-0.5, 0.5))
    for most in (limits, limit):
        problem = weak.with_changes(max_normal_force=most)
        for solution in (
            maximize_margin(problem), minimize_torque(problem, 0.1), minimize_torque(problem, 0.0),
        ):  # fmt: skip
            document = documented(solution)
            assert verify_document(document).proven, failed(document)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("limit", [50.0, 1e8])
@pytest.mark.parametrize("name", SCENES)
def test_a_document_states_what_its_search_has_proven(name, limit):
    """And never more: what is written proves as much, but for a millionth."""
    problem = scene(name).with_changes(torque_limits=(-0.1, 0.1), max_normal_force=limit)
    for _, solution in answers(problem):
        stated, found = documented(solution)["certificate"], solution.certificate
        assert stated["infeasibility"] == pytest.approx(found.infeasibility, rel=1e-5)
        assert stated["infeasibility"] <= found.infeasibility


def test_no_hair_more_than_what_is_proven_may_be_stated():
    problem = scene("sphere").with_changes(torque_limits=(-0.5, 0.5))
    document = documented(minimize_torque(problem, 0.1))
    proven = proven_violation(document)
    assert document["certificate"]["infeasibility"] == pytest.approx(proven, rel=1e-5)
    assert not failed(changed(document, "certificate", "infeasibility", to=0.99 * proven))
    more = changed(document, "certificate", "infeasibility", to=(1.0 + 1e-8) * proven)
    assert failed(more) == ["smallest common violation"]


def test_a_proof_that_stays_open_is_not_written(monkeypatch):
    """The document then says that it has none: nothing false, and nothing proven."""
    monkeypatch.setattr(ModeProver, "_refuting_leaf", lambda *_: None)
    document = documented(maximize_margin(scene("up").with_changes(torque_limits=(-0.1, 0.1))))
    assert "do not prove that a tree node is infeasible" in document["proof"]["missing"]
    verification = verify_document(document)
    assert verification.passed and not verification.proven
    assert document["certificate"]["infeasibility"] == 0.0


# figures of answers that were found


def test_an_answer_states_no_common_violation(made):
    document = made("tree")
    false = changed(document, "certificate", "infeasibility", to=1e3)
    assert failed(false) == ["states no infeasibility"]


@pytest.mark.parametrize("key", ["normal_upper", "normal_lower", "torque_upper", "share_lower"])
def test_each_multiplier_of_an_answer_is_worked_out_again_or_has_no_constraint(key, made):
    document = made("tree")
    count = len(document["multipliers"][key])
    false = changed(document, "multipliers", key, to=[1e6] * count)
    assert failed(false)
    if "normal" in key:
        assert failed(false) == ["each multiplier has a constraint"]
        shown = next(one for one in verify_document(false).checks if one.passed is False)
        assert key in shown.detail


def test_multipliers_of_limits_that_are_not_there_or_of_nothing_are_refused():
    free = scene("rest").with_changes(torque_limits=(-np.inf, np.inf))
    document = documented(minimize_torque(free, 0.1))
    assert verify_document(document).proven
    for key, value in (("torque_upper", [1e-3, 0.0]), ("guess", [1.0])):
        false = changed(document, "multipliers", key, to=value)
        assert failed(false) == ["each multiplier has a constraint"]
    faces = document["multipliers"]["faces"]
    twice = changed(document, "multipliers", "faces", to=[[0, 0, 1e3], *faces[1:-1], [0, 0, 0.1]])
    assert failed(twice)


def test_figures_that_a_status_makes_nothing_of_are_named():
    document = documented(minimize_torque(scene("rest"), 40.0))
    names = [check.name for check in verify_document(document).checks]
    assert "figures without a claim" not in names
    more = changed(document, "multipliers", to={"balance": [0.0] * 6})
    line = next(
        one for one in verify_document(more).checks if one.name == "figures without a claim"
    )
    assert line.given and "multipliers" in line.detail
    document = documented(maximize_margin(scene("rest"), static_friction="coulomb"))
    assert "proof.motion" not in str(verify_document(document))
    more = changed(document, "proof", "motion", to=[0.0] * 8)
    assert "no check uses proof.motion" in str(verify_document(more))
    assert "no check uses 'remark'" in str(verify_document({**document, "remark": "heavier"}))


def test_multipliers_that_friction_outweighs_prove_nothing():
    """Of a round cone the first has to be as long as the others, else slippery bodies tell of all.

    That nothing holds slippery ones is proven; of rough ones the same rows would say so, with
    first multipliers that are as much smaller as the friction is larger.
    """
    slippery, share = scene("rest").with_changes(cone="round", friction=1e-3), 1e-3 / 0.5
    forged = documented(minimize_torque(slippery, 0.1, static_friction="coulomb"))
    assert failed(forged) == []
    rough = slippery.with_changes(friction=0.5)
    assert minimize_torque(rough, 0.1, static_friction="coulomb").found
    cones = forged["proof"]["nodes"][0]["multipliers"]["round_cones"]
    for contact, cone in zip(forged["contacts"], cones, strict=True):
        contact["friction"] = 0.5
        cone[0] *= share
    assert failed(forged) == ["infeasible", "smallest common violation"]
