"""Claims that are false, with whatever figures and proofs a forger would write beside them."""

import copy
import json

import numpy as np
import pytest
from forgeries import set_optimum
from tests.core.scenes import scene
from verified_documents import changed, documented, failed, refused

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque
from graspless_pin.report.verify import verify_document


def test_a_worse_answer_is_not_optimal_whatever_its_certificate_says():
    """Forces of another optimum, all figures of their own, and the proof of the true one."""
    truth = documented(minimize_torque(scene("rest"), 0.1))
    worse = documented(minimize_torque(scene("rest"), 0.5, sign_rule="strict"))
    for proof in (truth["proof"], worse["proof"]):
        forged = copy.deepcopy(worse)
        forged["required_margin"] = 0.1
        forged["proof"] = copy.deepcopy(proof)
        forged["proof"]["motion"] = worse["proof"]["motion"]
        set_optimum(forged, forged["max_torque"])
        assert refused(forged)


@pytest.mark.parametrize("factor", [1.001, 2.0, 1e3, 1e9, 1e18])
def test_larger_multipliers_prove_no_larger_bound(made, factor):
    for name in ("torque", "margin", "tree", "coulomb", "shares"):
        forged = copy.deepcopy(made(name))
        value = forged["margin"] if forged["algorithm"] == "margin" else forged["max_torque"]
        forged["certificate"]["bound"] = value * (0.9 if forged["algorithm"] == "margin" else 1.1)
        forged["certificate"]["gap"] = -0.1 * value
        for node in forged["proof"]["nodes"]:
            multipliers = node.get("multipliers", {})
            for key, values in multipliers.items():
                flat = np.array(values, dtype=float)
                if key == "faces":
                    flat[:, 2] *= factor
                    multipliers[key] = [[int(c), int(k), v] for c, k, v in flat.tolist()]
                else:
                    multipliers[key] = (factor * flat).tolist()
        assert refused(forged)


def test_multipliers_below_zero_are_refused(made):
    for key in ("normal_upper", "torque_upper", "share_lower"):
        values = [-1e-3 for _ in made("tree")["multipliers"][key]]
        with pytest.raises(ValueError, match="negative multiplier"):
            verify_document(changed(made("tree"), "multipliers", key, to=values))


def test_multipliers_of_limits_that_are_not_there_prove_nothing():
    free = documented(
        minimize_torque(scene("rest").with_changes(torque_limits=(-np.inf, np.inf)), 0.1)
    )
    node = next(node for node in free["proof"]["nodes"] if node["kind"] == "bound")
    node["multipliers"]["torque_upper"] = [1e3, 1e3]
    assert verify_document(free).proven


def test_a_forged_motion_is_none():
    """The relaxation's optimum at rest, 0.9278, with a motion that hardly moves as it should."""
    problem = scene("rest")
    false = documented(minimize_torque(problem, 0.1, static_friction="coulomb"))
    assert false["max_torque"] == pytest.approx(0.9278, abs=1e-4)
    false["rules"]["static_friction"] = "virtual_sliding"
    random = np.random.default_rng(0)
    for size in (1.0, 1e-9, 1e9):
        for _ in range(20):
            false["proof"]["motion"] = {
                "object": (size * random.normal(size=6)).tolist(),
                "joints": (size * random.normal(size=2)).tolist(),
            }
            for contact in false["contacts"]:
                contact["selected"] = bool(np.any(contact["signs"]))
                contact["signs"] = [sign or 1 for sign in contact["signs"]]
            assert refused(false)


def test_sliding_is_held_against_all_velocities(made):
    """A motion that lifts the object off and slides 1e-12 as fast beside it is none."""
    document = made("tree")
    motion = np.array(document["proof"]["motion"]["object"])
    assert verify_document(document).proven
    lifting = motion.copy()
    lifting[2] += 1e7 * np.linalg.norm(motion)
    assert refused(changed(document, "proof", "motion", "object", to=lifting.tolist()))
    assert refused(changed(document, "proof", "motion", to=None))


def test_one_large_limit_hides_no_unbalanced_load():
    """All forces zero, and the whole weight of 9.8 N unbalanced."""
    limits = [1e7, 50.0, 50.0, 50.0, 50.0, 50.0]
    document = documented(maximize_margin(scene("rest").with_changes(max_normal_force=limits)))
    for contact in document["contacts"]:
        contact["force"] = [0.0, 0.0, 0.0]
    for joint in document["joints"]:
        joint["torque_contact"] = joint["torque"] = 0.0
    document["margin"] = document["max_torque"] = 0.0
    set_optimum(document, 0.0)
    assert "balance of forces" in failed(document)


def test_a_strict_answer_is_not_optimal_for_coulomb_friction(made):
    """There the relaxation is the problem: 0.9278, not 0.9618."""
    strict = made("tree")
    assert strict["max_torque"] == pytest.approx(0.9618, abs=1e-4)
    assert refused(changed(strict, "rules", "static_friction", to="coulomb"))
    # Where the relaxation has the same optimum, the relabelled document is true.
    same = made("torque")
    relabelled = changed(same, "rules", "static_friction", to="coulomb")
    assert verify_document(relabelled).proven


def test_an_infeasible_scene_with_a_large_limit_is_not_optimal():
    """A placeholder in one limit makes no negative margin an optimum."""
    problem = scene("rest").with_changes(friction=0.01)
    assert not maximize_margin(problem).found
    limits = np.array(problem.max_normal_force)
    limits[1] = 1e8
    document = documented(maximize_margin(problem.with_changes(max_normal_force=limits)))
    assert document["found"] is False
    assert verify_document(document).proven


@pytest.mark.parametrize("name", ["tree", "exact tree", "infeasible modes", "own squared shares",
                                  "own infeasible modes"])  # fmt: skip
def test_no_leaf_of_a_proof_can_be_left_out(made, name):
    nodes = made(name)["proof"]["nodes"]
    leaves = [i for i, node in enumerate(nodes) if node["kind"] in ("bound", "kinematic")]
    for index in leaves[:: 1 + len(leaves) // 12]:
        assert refused(changed(made(name), "proof", "nodes", to=nodes[:index] + nodes[index + 1 :]))
    assert refused(changed(made(name), "proof", "nodes", to=nodes + nodes[-1:]))


def test_splits_that_leave_out_modes_are_refused(made):
    """A conflict without one of its items, or with a combination that was made up."""
    name = "tree"
    nodes = made(name)["proof"]["nodes"]
    first = nodes[0]
    assert first["kind"] == "conflict"
    for item, (contact, component, sign) in enumerate(first["items"]):
        axis = component + 1 if sign else 0
        weighs = any([contact, axis] == entry[:2] for v in first["combinations"] for entry in v)
        fewer = copy.deepcopy(nodes)
        del fewer[0]["items"][item]
        assert weighs <= refused(changed(made(name), "proof", "nodes", to=fewer))
    other = copy.deepcopy(nodes)
    other[0]["combinations"] = [
        [[c, axis, 1.0 + value] for c, axis, value in v] for v in first["combinations"]
    ]
    assert refused(changed(made(name), "proof", "nodes", to=other))


def test_a_motion_that_there_is_cannot_be_excluded(made):
    """A tree of one leaf that says that no contact can slide, for the optimum's own mode."""
    document = made("tree")
    rng = np.random.default_rng(2)
    leaf = {"kind": "kinematic", "combination": []}
    assert refused(changed(document, "proof", "nodes", to=[leaf]))
    for _ in range(50):
        leaf["combination"] = [[c, k, rng.normal()] for c in range(6) for k in range(3)]
        assert refused(changed(document, "proof", "nodes", to=[leaf]))


def test_a_proof_of_forces_proves_nothing_of_motions(made):
    forged = changed(made("infeasible in a mode"), "status", to="infeasible_mode")
    forged["message"] = made("infeasible mode")["message"]
    assert refused(forged)


def test_documents_without_a_format_are_refused(made):
    old = {key: value for key, value in made("tree").items() if key != "format"}
    with pytest.raises(ValueError, match="does not state its format version: solve again"):
        verify_document(old)


def test_a_load_of_nothing_has_a_size():
    """Two fingers pinch a weightless block: the required margin or the smallest limit does."""
    problem = QuasistaticProblem(
        [[0, -0.05, 0], [0, 0.05, 0]], [[0, 1, 0], [0, -1, 0]], np.zeros(6), friction=0.5
    )
    for solution, scale in ((maximize_margin(problem), 50.0), (minimize_torque(problem, 0.1), 0.1)):
        document = json.loads(json.dumps(documented(solution)))
        assert document["scales"]["force"] == scale
        assert verify_document(document).proven
