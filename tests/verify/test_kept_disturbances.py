"""What is borne for certain is checked from documents alone, and no tampering passes."""

import copy
import json
from functools import cache

import numpy as np
import pytest
from rest_documents import (
    ONE_KILOGRAM,
    G,
    corners,
    hybrid,
    leaves,
    pressed,
    seeded,
    slack_of,
    slope,
    times,
    zeroed,
)
from tests.oracles.compared_outcomes import outcome_case

from graspless_pin import QuasistaticProblem, guaranteed_disturbance, maximize_margin
from graspless_pin.report import solution_document, verdict_data
from graspless_pin.report.verify import verify_document
from graspless_pin.report.verify.rest_bounds import KnownStates

PUSH, UP, DOWN = [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, -1, 0, 0, 0]


def slot():
    """A block on three feet with friction 0.4 between two walls that touch it."""
    feet = slope(0.0)
    sides, inwards = [[-0.05, 0, 0], [0.05, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
    return QuasistaticProblem(
        [*feet.positions, *sides], [*feet.normals, *inwards], feet.external_wrench,
        friction=[0.4] * 3 + [0.5] * 2, cone="round", object_inertia=ONE_KILOGRAM,
    )  # fmt: skip


def on_wall():
    """A block of 1 kg that a finger presses on a wall, with 40 N where 9.81 N are needed."""
    corners = [[-0.05, y, z] for y in (-0.05, 0.05) for z in (-0.05, 0.05)]
    jacobian = np.zeros((15, 1))
    jacobian[12] = -1.0
    return QuasistaticProblem(
        [*corners, [0.05, 0, 0]], [[1, 0, 0]] * 4 + [[-1, 0, 0]], [0, 0, -G, 0, 0, 0], jacobian,
        friction=0.5, cone="round", joint_units=["N"], torque_limits=(40.0, 40.0),
        object_inertia=ONE_KILOGRAM, joint_inertia=[[1e-3]],
    )  # fmt: skip


def heavy():
    """A block of ten tons."""
    block = slope(0.0)
    return block.with_changes(external_wrench=1e4 * block.external_wrench, max_normal_force=1e6,
                              object_inertia=1e4 * ONE_KILOGRAM)  # fmt: skip


CASES = {
    "flat": (lambda: slope(0.0), [PUSH, UP], 3.0 * G),
    "heavy": (heavy, [UP], 3e4 * G),
    "corners": (corners, [PUSH], 3.0 * G),
    "pressed": (pressed, [[1, 0, 0, 0, 0, 0], DOWN], 3.0 * G),
    "hybrid": (hybrid, [[1, 0, 0, 0, 0, 0]], 3.0 * G),
    "on wall": (on_wall, [DOWN], 3.0),
    "slot": (slot, [PUSH], 3.0 * G),
    "bare": (lambda: slope(0.0).with_changes(object_inertia=None), [DOWN], 3.0 * G),
}


@cache
def found(name):
    make, directions, largest = CASES[name]
    solution = maximize_margin(make(), static_friction="coulomb")
    return solution, guaranteed_disturbance(
        solution.problem, solution.torques, directions, largest=largest,
        precision={"slot": 0.07, "flat": 0.1}.get(name, 0.3),
    )  # fmt: skip


@cache
def document(name):
    """A document as it comes back from a file."""
    solution, disturbances = found(name)
    made = solution_document(solution, disturbances=disturbances)
    return json.loads(json.dumps(made, allow_nan=False))


def lines(made):
    every = verify_document(made).checks
    return [line for line in every if line.name.startswith(("disturbance", "rest without"))]


def refused(made):
    """Whether something of what is borne is said not to be so, or it cannot be read."""
    try:
        return any(line.passed is False for line in lines(made))
    except ValueError:
        return True


def alone(name, direction):
    """The document with one of its directions, and what it says of that."""
    made = copy.deepcopy(document(name))
    claim = made["disturbances"]["directions"][direction]
    made["disturbances"]["directions"] = [claim]
    return made, claim


def replaced(name, *path, by, direction=0):
    made, place = alone(name, direction)
    *way, last = path
    for key in way:
        place = place[key]
    place[last] = by(place[last])
    return made


@pytest.mark.parametrize("name", CASES)
def test_what_is_borne_is_proven_by_its_document(name):
    shown = lines(document(name))
    assert all(line.passed is True for line in shown)
    borne = [line.detail for line in shown if line.name.endswith("is withstood")]
    said = [f"up to {guaranteed:.6g} N" for guaranteed in found(name)[1].guaranteed]
    assert [detail.split(",")[0] for detail in borne] == said
    assert (found(name)[1].guaranteed > 0.0).all()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [9, 24])
def test_documents_of_seeded_fingers_are_proven(number):
    _, problem = outcome_case(3, number)
    solution = maximize_margin(problem)
    disturbances = guaranteed_disturbance(problem, solution.torques, [PUSH, DOWN], precision=0.5)
    assert disturbances.found
    made = solution_document(solution, disturbances=disturbances)
    assert all(line.passed is True for line in lines(json.loads(json.dumps(made))))


def test_each_way_of_proof_is_among_them():
    proofs = {
        name: [
            end["proof"]
            for one in document(name)["disturbances"]["directions"]
            for span in one["spans"]
            for end in span
        ]
        for name in CASES
    }
    assert any(node["forced"] for proof in proofs["corners"] for node in proof["nodes"])
    assert any(proof["nodes"] and proof["loads"] for proof in proofs["pressed"])
    assert any(proof["forces"] and proof["loads"] for proof in proofs["on wall"])
    assert any(proof["forces"] and not proof["loads"] for proof in proofs["bare"])
    failures = [one.brackets[0].failure for _, one in map(found, CASES)]
    statuses = {None if failure is None else str(failure.status) for failure in failures}
    assert statuses == {None, "none", "weak"}


@pytest.mark.parametrize("direction", [0, 1])
@pytest.mark.parametrize(("key", "factor"), [
    ("guaranteed", 1.05), ("guaranteed", -1.0), ("failing", 0.8), ("possible", 1.05),
    ("possible", 0.95), ("possible", 0.0), ("direction", 1.01), ("direction", -1.0),
    ("no_rest", -1.0), ("no_rest", 0.0),
])  # fmt: skip
def test_no_figure_can_be_forged(direction, key, factor):
    assert refused(replaced("flat", key, by=times(factor), direction=direction))


@pytest.mark.parametrize("factor", [0.0, 0.99, 1.01])
def test_no_forces_of_rest_can_be_forged(factor):
    assert refused(replaced("flat", "forces", by=times(factor)))
    for end in (0, 1):
        assert refused(replaced("on wall", "spans", 0, end, "rest_forces", by=times(factor)))


@pytest.mark.parametrize(("end", "magnitude"), [(0, 0.5), (1, 5.0), (1, -5.0), (1, 0.5)])
def test_no_end_of_a_span_can_be_moved(end, magnitude):
    assert refused(replaced("flat", "spans", 0, end, "magnitude", by=lambda _: magnitude))


@pytest.mark.parametrize(("name", "path", "by"), [
    ("on wall", ("forces",), times(1.01)),
    ("on wall", ("force_limit",), times(1e-3)),
    ("on wall", ("loads",), lambda _: []),
    ("on wall", ("loads", 0, "force"), times(1.1)),
    ("on wall", ("loads", 0, "contact"), lambda _: 0),
    ("on wall", ("loads", 0, "multipliers", "motion"), times(1.1)),
    ("pressed", ("loads", 0, "force"), times(1.5)),
    ("pressed", ("nodes",), lambda _: None),
    ("corners", ("nodes",), lambda nodes: nodes[:-1]),
    ("flat", ("force_limit",), times(1e-3)),
])  # fmt: skip
def test_no_proof_of_a_span_can_be_forged(name, path, by):
    for end in (0, 1):
        assert refused(replaced(name, "spans", 0, end, "proof", *path, by=by))


@pytest.mark.parametrize("end", [0, 1])
def test_no_leaf_and_no_multipliers_can_be_dropped(end):
    way = "spans", 0, end, "proof", "nodes"
    nodes = document("flat")["disturbances"]["directions"][0]["spans"][0][end]["proof"]["nodes"]

    def without(leaf, parent):
        def by(given):
            given[parent]["children"] -= 1
            return [*given[:leaf], *given[leaf + 1 :]]

        return by

    for leaf, parent in leaves(nodes)[::17]:
        if parent is not None:
            assert refused(replaced("flat", *way, by=without(leaf, parent))), leaf
        # One that another holds has none.
        for by in (lambda _: None, zeroed) if nodes[leaf]["multipliers"] else ():
            assert refused(replaced("flat", *way, leaf, "multipliers", by=by)), leaf


def test_a_tree_of_one_load_proves_no_span():
    """The load has to be free in it: that of one end alone leaves out what is between."""
    made = copy.deepcopy(document("corners"))
    first, last = made["disturbances"]["directions"][0]["spans"][0]
    assert made["stability"]["proof"]["nodes"]
    whole, first["proof"] = first["proof"], made["stability"]["proof"]
    assert refused(made)
    first["proof"], last["proof"] = last["proof"], whole
    assert refused(made)


def test_spans_have_to_follow_each_other():
    _, disturbances = found("slot")
    assert len(disturbances.brackets[0].spans) > 1
    for by in (lambda spans: spans[1:], lambda spans: spans[::-1], lambda spans: spans[:-1]):
        assert refused(replaced("slot", "spans", by=by))


@pytest.mark.parametrize(("path", "by"), [
    (("status",), lambda _: "strong"),
    (("status",), lambda _: "undecided"),
    (("status",), lambda _: "none"),
    (("motion",), lambda _: None),
    (("motion", "object_acceleration"), times(1.01)),
    (("motion", "contact_forces"), times(1.01)),
    (("acceleration_resolution",), times(0.01)),
    (("acceleration_limit",), times(0.01)),
    (("rest_forces",), times(0.0)),
])  # fmt: skip
def test_what_is_too_much_has_to_be_shown(path, by):
    for change, wrong in ((lambda value: value, False), (by, True)):
        made = replaced("slot", "failure", *path, by=change)
        made["disturbances"]["directions"][0]["spans"] = None  # so that nothing else is checked
        assert refused(made) is wrong


def test_a_motion_that_counts_as_rest_without_disturbance_is_none():
    made = copy.deepcopy(document("slot"))
    speed = made["disturbances"]["directions"][0]["failure"]["motion"]["point_acceleration"]
    factor = 1.01 * speed / made["stability"]["acceleration_limit"]
    for key in ("acceleration_resolution", "acceleration_limit"):
        made["stability"][key] *= factor
    assert any("within the limit without disturbance" in line.detail for line in lines(made))


def test_what_has_no_proof_is_not_proven():
    for key in ("spans", "no_rest", "forces"):
        shown = lines(replaced("flat", key, by=lambda _: None))
        assert [line.passed for line in shown].count(None) == 1
        assert all(line.passed is not False for line in shown)
    assert refused(replaced("flat", "failing", by=lambda _: None))
    made = copy.deepcopy(document("flat"))
    made["stability"]["status"] = "undecided"
    assert refused(made)
    made["disturbances"]["directions"] = []
    assert not refused(made)


def test_too_many_leaves_are_not_written(monkeypatch):
    solution, disturbances = found("flat")
    count = len(
        leaves(document("flat")["disturbances"]["directions"][0]["spans"][0][1]["proof"]["nodes"])
    )
    for most, written in ((count, [False, True]), (count + 1, [True, True])):
        monkeypatch.setattr(verdict_data, "MOST_SPAN_LEAVES", most)
        made = json.loads(json.dumps(solution_document(solution, disturbances=disturbances)))
        spans = [one["spans"] is not None for one in made["disturbances"]["directions"]]
        assert spans == written
        shown = [line.passed for line in lines(made)]
        assert shown.count(None) == written.count(False)
        assert False not in shown


def test_no_tampering_with_a_number_makes_a_figure_pass_that_is_false():
    """On a floor the block slides at 0.5 of its weight, and lifts at all of it."""
    rng, exact, accepted, count = np.random.default_rng(0), (0.5 * G, G), 0, 60
    for _ in range(count):
        at = int(rng.integers(2))
        made, claim = alone("flat", at)
        for key in ("guaranteed", "failing", "possible"):
            if rng.random() < 0.3:
                claim[key] *= float(rng.uniform(0.8, 1.2))
        for _ in range(int(rng.integers(1, 4))):
            tamper(claim, rng)
        if refused(made):
            continue
        accepted += 1
        still = 1e-3 * G
        assert claim["guaranteed"] <= exact[at] + still
        assert claim["failing"] is None or claim["failing"] >= exact[at] - still
        assert abs(claim["possible"] - exact[at]) <= 2e-3 * exact[at]
    assert 0 < accepted < count / 3


def tamper(claim, rng):
    """Change some number that is no claim, however deep it lies, and not what is claimed of."""
    place = claim
    while True:
        keys = range(len(place)) if isinstance(place, list) else [
            key for key in place if key not in ("direction", "guaranteed", "failing", "possible")
        ]  # fmt: skip
        keys = [key for key in keys if isinstance(place[key], float | list | dict) and place[key]]
        if not keys:
            return
        key = keys[int(rng.integers(len(keys)))]
        if isinstance(place[key], float):
            place[key] *= float(rng.choice([-1.0, 0.0, 0.5, 0.99, 1.01, 2.0]))
            return
        place = place[key]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [1, 3, 4, 7, 13])
def test_bounds_of_a_span_hold_for_what_happens_between(number):
    """No multipliers bound away an outcome of a load between two."""
    (body, outcome), rng, tight = seeded(number), np.random.default_rng(number), np.inf
    for _ in range(30):
        step = np.zeros(len(body.load))
        size = rng.choice([1e-2, 1.0]) * np.linalg.norm(body.load[:6])
        step[:6] = size * rng.normal(size=6)
        before, after = rng.uniform(0.0, 1.0, 2)
        ends = [body.load - before * step, body.load + after * step]
        ends.sort(key=lambda end: -float(end @ outcome.acceleration))
        here, there = map(body.dynamics, ends)
        dynamics = here.towards(there)
        y, f = body.coordinates(dynamics, outcome.acceleration, outcome.forces)
        for _ in range(30):
            states, tangential = KnownStates.all_free(len(f)), float(rng.integers(0, 2))
            slack = slack_of(dynamics, states, y, f, rng, tangential=tangential)
            assert slack >= -1e-8
            tight = min(tight, slack)
    assert tight < 0.05


def end_of(made):
    return next(line for line in lines(made) if line.name.endswith("can be balanced"))


@pytest.mark.parametrize(("end", "passed"), [(0.0, False), (-1.0, None)])
def test_an_end_that_is_understated_does_not_pass_without_forces(end, passed):
    """At no disturbance at all no forces are needed: that more cannot be balanced is then wrong."""
    made = copy.deepcopy(document("corners"))
    claim = made["disturbances"]["directions"][0]
    assert end_of(made).passed
    claim["possible"], claim["forces"] = end, None
    assert end_of(made).passed is passed


@pytest.mark.parametrize(("share", "right"), [(1e-10, True), (1e-6, False)])
def test_forces_of_a_body_without_inertia_must_balance_it_closely(share, right):
    """They may be rounded, but not wrong: nothing tells how fast what is left would move it."""
    made = replaced("bare", "spans", 0, 0, "proof", "forces", by=times(1.0 + share))
    assert refused(made) is not right
