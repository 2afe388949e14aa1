"""Proofs over modes that leave out some are none, whatever their leaves prove."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from tests.core.scenes import scene
from verified_documents import changed, documented, failed

from graspless_pin import QuasistaticProblem, maximize_margin
from graspless_pin.report.verify import verify_document
from graspless_pin.report.verify.reading import read_problem
from graspless_pin.report.verify.tree import ModeSet, TreeWalk, pairs_with

FLOOR = [[0.1, 0.1, -0.1], [-0.1, 0.1, -0.1], [0.0, -0.1, -0.1]]
WALL = [[0.05, 0.1, 0.0], [-0.05, 0.1, 0.0]]
X, Y, Z = np.eye(3)


def tangents(*pairs):
    return [np.column_stack(pair) for pair in pairs]


def pushed_along_a_wall() -> QuasistaticProblem:
    """A block slides along a floor and a wall: it can only go on along both."""
    points, normals = np.array([*FLOOR, *WALL]), np.array([Z] * 3 + [-Y] * 2)
    forces = np.array([[4.0], [4.0], [2.0], [1.0], [1.0]]) * (normals - 0.2 * X)
    wrench = -np.concatenate([forces.sum(axis=0), np.cross(points, forces).sum(axis=0)])
    frames = tangents(*[(X, Y)] * 3, *[(X, Z)] * 2)
    return QuasistaticProblem(
        points, normals, wrench, friction=0.2, tangents=frames, sliding=[0.1 * X] * 5
    )


def pushed_on_a_floor() -> QuasistaticProblem:
    """A finger pushes a block that slides along a floor, which it cannot lift off."""
    return QuasistaticProblem(
        [*FLOOR, [-0.1, 0.0, -0.1]], [Z] * 3 + [X], [0, 0, -10.0, 0, 0, 0], np.vstack([
            np.zeros((9, 1)), 0.1 * X[:, None],
        ]), friction=0.2, tangents=tangents(*[(X, Y)] * 4)[:3] + tangents((Y, Z)),
        sliding=[0.1 * X] * 3 + [0 * X], torque_limits=(-5.0, 5.0),
    )  # fmt: skip


FINGER = 3


@pytest.fixture
def floor():
    """The document of a block that is pushed, and its problem."""
    document = documented(maximize_margin(pushed_on_a_floor(), sliding_rule="constrained"))
    assert document["status"] == "optimal" and verify_document(document).proven
    return document, read_problem(document)


def lifting(sign, at=FINGER):
    """A combination that says: on three points that touch, the finger does not slide up or down."""
    matrix = np.array([[1.0, 1.0, 1.0], *np.array(FLOOR)[:, :2].T])
    shares = np.linalg.solve(matrix, [1.0, -0.1, 0.0])
    floors = [[c, 0, -sign * float(share)] for c, share in enumerate(shares)]
    return [[at, 2, float(sign)], *floors]


def walked(problem, nodes, *, free=False, root=None):
    walk = TreeWalk(problem, float(problem.limit.max()))
    nodes = problem.part({"nodes": nodes}, "proof", "proof")["nodes"]
    return walk.walk(nodes, root or ModeSet.every_mode(problem, free=free))


def some(sign=None, component=1):
    """(3, 3) pairs of signs of contacts that are selected, or that have one of them."""
    pairs = np.ones((3, 3), dtype=bool) if sign is None else pairs_with(component, sign)
    return pairs & ~np.outer([False, True, False], [False, True, False])


def test_a_component_that_no_motion_has_excludes_no_contact(floor):
    """Both signs are excluded where the contact is selected: it need not be."""
    _, problem = floor
    combinations = [lifting(-1), lifting(1)]
    whole = [[FINGER, 1, 0]]
    for items, excluded in (([], False), (whole, True)):
        node = {"kind": "conflict", "items": items, "open": [FINGER, 1]}
        node["combinations"] = combinations
        proof = walked(problem, [node])
        assert proof.failure == (
            "1 sets of modes have no node"
            if excluded
            else "node 0 does not prove that its items conflict"
        )
    # One sign of two is not enough either, nor a combination that is none.
    node = {
        "kind": "conflict",
        "items": whole,
        "open": [FINGER, 1],
        "combinations": combinations[:1],
    }
    assert "does not prove that its items conflict" in walked(problem, [node]).failure
    node["combinations"] = [combinations[0], combinations[0]]
    assert "does not prove that its items conflict" in walked(problem, [node]).failure
    node["combinations"] = combinations[::-1]
    assert "does not prove that its items conflict" in walked(problem, [node]).failure


def test_a_contact_may_stay_unselected(floor):
    """Its four pairs of signs are excluded; without the part that does not select it: no proof."""
    document, problem = floor
    split = {"kind": "contact", "contact": FINGER}
    pairs = [{"kind": "kinematic", "combination": lifting(sign)} for sign in (-1, 1, -1, 1)]
    assert walked(problem, [split, *pairs]).failure
    released = {"kind": "bound", "objective": True,
                "multipliers": copy.deepcopy(document["multipliers"])}  # fmt: skip
    proof = walked(problem, [split, released, *pairs])
    assert not proof.failure
    assert proof.leaves == 5 and proof.programs == 1
    assert -proof.bound == pytest.approx(document["margin"], abs=1e-6)
    # In that order alone, with no leaf twice and none beside.
    for nodes in ([split, *pairs, released], [split, released, *pairs, released],
                  [split, released, *pairs[:3]]):  # fmt: skip
        assert walked(problem, nodes).failure


def test_a_selected_contact_has_no_part_without_it(floor):
    _, problem = floor
    root = ModeSet.every_mode(problem, free=False)
    assert root.selected.tolist() == [True, True, True, False]
    chosen = root.restricted_to(FINGER, some())
    assert chosen is not None and chosen.restricted_to(FINGER, ~some()) is None
    split = {"kind": "contact", "contact": FINGER}
    pairs = [{"kind": "kinematic", "combination": lifting(s)} for s in (-1, 1, -1, 1)]
    assert not walked(problem, [split, *pairs], root=chosen).failure
    released = root.restricted_to(FINGER, ~some())
    assert released is not None
    proof = walked(problem, [split], root=released)
    assert "1 nodes" not in proof.failure  # one part is left: the whole of it
    assert proof.failure == "1 sets of modes have no node"


def test_motions_say_nothing_of_friction_that_needs_none():
    """A block that can only slide along x has no mode with both signs, and yet forces."""
    document = documented(maximize_margin(pushed_along_a_wall(), sliding_rule="constrained"))
    assert document["status"] == "infeasible_modes" and verify_document(document).proven
    nodes = document["proof"]["nodes"]
    assert {node["kind"] for node in nodes} <= {"kinematic", "conflict", "contact"}
    problem = read_problem(document)
    assert walked(problem, nodes).failure == ""
    assert "friction needs none here" in walked(problem, nodes, free=True).failure
    false = changed(document, "status", to="infeasible_forces")
    false["message"] = "infeasible: no contact forces at all"
    assert "infeasible" in failed(false)[0]
    false["rules"]["static_friction"] = "coulomb"
    assert not verify_document(false).passed


def test_the_items_of_a_conflict_are_split_one_after_the_other(floor):
    """Children of a conflict: item by item broken, with all items before it kept."""
    document, problem = floor
    released = {"kind": "bound", "objective": True,
                "multipliers": copy.deepcopy(document["multipliers"])}  # fmt: skip
    up = {"kind": "conflict", "items": [[FINGER, 1, 1]], "open": None, "combinations": [lifting(1)]}
    down = {"kind": "kinematic", "combination": lifting(-1)}
    # Not sliding up: down, or not selected.
    proof = walked(problem, [up, {"kind": "contact", "contact": FINGER}, released, down, down])
    assert not proof.failure and proof.leaves == 3
    assert walked(problem, [up, released]).failure == ""  # its multipliers hold for both at once
    assert (
        walked(problem, [up, down]).failure
        == "node 1 does not rule out all virtual motions of its modes"
    )
    # An item that does not weigh in the combination leaves out more than it proves.
    more = {**up, "items": []}
    assert walked(problem, [more]).failure == "node 0 does not prove that its items conflict"
    other = {**up, "items": [[FINGER, 1, -1]]}
    assert (
        walked(problem, [other, released]).failure
        == "node 0 does not prove that its items conflict"
    )


@pytest.mark.parametrize("v", [[], [[0, 1, 1.0]], [[FINGER, 1, 1.0]], [[FINGER, 2, 1.0]]])
def test_a_combination_weighs_only_what_the_part_knows(floor, v):
    """Contacts that need not be selected, or signs that are open, exclude nothing."""
    _, problem = floor
    assert walked(problem, [{"kind": "kinematic", "combination": v}]).failure
    every = ModeSet.every_mode(problem, free=False)
    chosen = every.restricted_to(FINGER, some(1))
    assert chosen is not None
    assert walked(problem, [{"kind": "kinematic", "combination": v}], root=chosen).failure


def test_leaves_without_objective_prove_that_there_are_no_forces():
    document = documented(maximize_margin(scene("rest").with_changes(max_normal_force=1.0)))
    problem = read_problem(document)
    (leaf,) = document["proof"]["nodes"]
    proof = walked(problem, [leaf], free=True)
    assert proof.bound == np.inf and proof.violation > 0.0
    assert proof.violation == pytest.approx(document["certificate"]["infeasibility"], rel=1e-4)
    weak = copy.deepcopy(leaf)
    weak["multipliers"] = {key: [0.0 * v for v in values] if key != "faces" else []
                           for key, values in weak["multipliers"].items()}  # fmt: skip
    for objective in (True, False):
        weak["objective"] = objective
        proof = walked(problem, [weak], free=True)
        assert proof.bound < np.inf and not proof.failure
        assert proof.violation <= 0.0
        assert objective or proof.bound == -np.inf


def test_a_selected_contact_has_every_pair_of_signs_but_no_sliding(floor):
    problem = floor[1]
    every = ModeSet.every_mode(problem, free=False)
    whole = replace(every, allowed_pairs=np.ones_like(every.allowed_pairs))
    split = {"kind": "contact", "contact": FINGER}
    for root, parts in ((every, 5), (whole, 9)):
        assert walked(problem, [split], root=root).failure == f"{parts} sets of modes have no node"
