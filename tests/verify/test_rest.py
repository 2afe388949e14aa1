"""Verdicts on rest are checked from documents alone, and no tampering with their proofs passes."""

import copy
import json
from itertools import pairwise

import numpy as np
import pytest
from rest_documents import (
    CASES,
    ONE_KILOGRAM,
    G,
    document,
    failures,
    is_refused,
    leaves,
    pressed,
    rest_lines,
    seeded,
    slack_of,
    slope,
    times,
    zeroed,
)
from tests.oracles.compared_outcomes import outcome_case

from graspless_pin import QuasistaticProblem, Stability, maximize_margin, stability
from graspless_pin.report import solution_document
from graspless_pin.report.verify.reading import read_problem
from graspless_pin.report.verify.rest_bounds import (
    Kind,
    KnownStates,
    RestMultipliers,
    commanded_contacts,
    largest_goal,
)
from graspless_pin.report.verify.rest_load import read_load
from graspless_pin.report.verify.rest_tree import RestNode, uncovered_states


@pytest.mark.parametrize(
    ("name", "status"),
    [("slope", "strong"), ("corners", "strong"), ("walls", "weak"), ("pressed", "strong"),
     ("hybrid", "strong"), ("smooth", "strong"), ("kept", "strong"), ("lost", "weak"),
     ("slow", "none")],
)  # fmt: skip
def test_verdicts_are_proven_by_their_documents(name, status):
    made = document(name)
    assert made["stability"]["status"] == status
    assert made["stability"]["motion"] is not None or status == "strong"
    assert all(line.passed is True for line in rest_lines(made))


@pytest.mark.parametrize("unit", [1e-6, 1e6])
@pytest.mark.parametrize("make", [lambda: slope(0.45), pressed])
def test_proofs_reach_as_many_loads_in_any_unit_of_force(make, unit):
    whole = make()
    problem = whole.with_changes(
        external_wrench=unit * whole.external_wrench,
        torque_limits=(unit * whole.lower_torque, unit * whole.upper_torque),
        max_normal_force=unit * whole.max_normal_force,
    )
    solution = maximize_margin(problem, static_friction="coulomb")
    verdict = stability(problem, solution.torques)
    assert verdict.proof is not None and verdict.proof.tree is not None
    made = solution_document(solution, verdict=verdict)
    assert all(line.passed is True for line in rest_lines(made))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("number", [0, 6, 24, 27, 33])
def test_verdicts_on_seeded_scenes_are_proven(number):
    _, problem = outcome_case(3, number)
    solution = maximize_margin(problem)
    assert solution.found
    verdict = stability(problem, solution.torques)
    assert verdict.status in (Stability.STRONG, Stability.WEAK)
    made = solution_document(solution, verdict=verdict)
    assert all(line.passed is True for line in rest_lines(made))


def test_each_way_of_proof_is_among_them():
    proofs = {name: document(name)["stability"]["proof"] for name in CASES}
    assert proofs["slope"]["nodes"] and proofs["smooth"]["forces"]
    assert proofs["pressed"]["loads"]
    assert any(node["forced"] for node in proofs["corners"]["nodes"])


def test_rest_that_is_no_outcome_is_proven():
    made = document("unrest")
    assert made["stability"]["status"] == "none"
    assert all(line.passed is True for line in rest_lines(made))
    forged = copy.deepcopy(made)
    forged["stability"]["no_rest"] = [-z for z in made["stability"]["no_rest"]]
    assert is_refused(forged)
    holding = copy.deepcopy(document("pressed"))
    holding["stability"] |= {"status": "none", "no_rest": made["stability"]["no_rest"]}
    assert is_refused(holding)


TREES = ("slope", "hybrid")


@pytest.mark.parametrize("name", [*TREES, "kept"])
def test_no_leaf_can_be_dropped(name):
    nodes = document(name)["stability"]["proof"]["nodes"]
    every = leaves(nodes)
    assert len(every) > 4
    for leaf, parent in every[:: 1 + len(every) // 16]:
        made = copy.deepcopy(document(name))
        left = made["stability"]["proof"]["nodes"]
        left[parent]["children"] -= 1
        del left[leaf]
        assert is_refused(made), leaf


@pytest.mark.parametrize(("name", "step"), [("slope", 5), ("hybrid", 23), ("kept", 6)])
def test_no_node_can_say_other_than_it_proves(name, step):
    made, contacts = document(name), 4 if name == "kept" else 3
    nodes = made["stability"]["proof"]["nodes"]
    some = [side["multipliers"] for node in nodes for side in node["sides"]][:1]
    for index, node in list(enumerate(nodes))[::step]:
        changes = []
        if node["multipliers"] is not None:
            changes += [{"multipliers": None}, {"multipliers": zeroed(node["multipliers"])}]
        for number, side in enumerate(node["sides"]):
            if not node["children"]:  # others may prove more than the leaves below them need
                others = node["sides"][:number] + node["sides"][number + 1 :]
                changes.append({"sides": others})
            if side["goal"] == 0:
                changes.append({"sides": [side | {"goal": 1}]})
        if node["slip"] is not None:
            center, half_width = node["slip"]
            changes += [{"slip": [center, 0.9 * half_width]}, {"slip": [center + 0.1, half_width]}]
        if node["forced"]:
            changes.append({"forced": []})
        if index:
            changes += [{"forced": some}] * len(some)
            changes += [{"contact": (node["contact"] + 1) % contacts},
                        {"children": node["children"] + 1}]  # fmt: skip
            changes.append({"state": "open" if node["state"] != "open" else "sticking"})
        for change in changes:
            forged = copy.deepcopy(made)
            forged["stability"]["proof"]["nodes"][index] |= change
            assert is_refused(forged), (index, change)


def test_a_state_that_is_not_forced_is_refused():
    made = copy.deepcopy(document("corners"))
    forced = [node for node in made["stability"]["proof"]["nodes"] if node["forced"]]
    for node in forced:
        node["forced"] = [zeroed(one) for one in node["forced"]]
    assert forced
    assert is_refused(made)


def replaced(name, *path, by):
    made = copy.deepcopy(document(name))
    *way, last = path
    place = made
    for key in way:
        place = place[key]
    place[last] = by(place[last])
    return made


@pytest.mark.parametrize(
    ("name", "path", "by"),
    [
        ("slope", ("external_wrench",), lambda w: [1.8 * w[0], *w[1:]]),
        ("slope", ("contacts", 0, "friction"), times(0.5)),
        ("slope", ("contacts", 0, "position"), times(-1.0)),
        ("slope", ("stability", "rest_forces"), times(1.01)),
        ("slope", ("stability", "acceleration_limit"), times(10.0)),
        ("slope", ("stability", "acceleration_resolution"), times(0.01)),
        ("slope", ("stability", "proof", "force_limit"), times(1e-3)),
        ("smooth", ("stability", "proof", "forces"), times(1.01)),
        ("smooth", ("external_wrench",), lambda w: [0.1, *w[1:]]),
        ("pressed", ("joints", 0, "torque"), times(0.5)),
        ("pressed", ("joint_inertia",), times(100.0)),
        ("pressed", ("stability", "proof", "loads", 0, "force"), times(1.1)),
        ("pressed", ("stability", "proof", "loads", 0, "contact"), lambda _: 1),
        ("pressed", ("stability", "proof", "loads", 0, "multipliers", "motion"), times(1.1)),
        ("pressed", ("stability", "proof", "loads"), lambda _: []),
        ("hybrid", ("joints", 0, "torque"), times(0.5)),
        ("hybrid", ("joint_inertia",), lambda _: [[0.1]]),
        ("walls", ("stability", "rest_forces"), times(0.0)),
        ("walls", ("stability", "motion", "object_acceleration"), times(1.01)),
        ("walls", ("stability", "motion", "contact_forces"), lambda f: np.add(f, 1.0).tolist()),
        ("walls", ("stability", "motion", "point_acceleration"), times(2.0)),
        ("walls", ("object_inertia",), times(2.0)),
        ("kept", ("external_wrench",), lambda w: [0.1, *w[1:]]),
        ("kept", ("contacts", 0, "friction"), times(0.9)),
        ("kept", ("contacts", 0, "sliding"), times(-1.0)),
        ("kept", ("joints", 0, "torque"), times(1.1)),
        ("kept", ("joint_inertia",), lambda m: [[m[0][0], 0.0], [0.0, 1e3]]),
        ("kept", ("stability", "rest_forces"), times(1.01)),
        ("kept", ("stability", "acceleration_limit"), times(10.0)),
        ("kept", ("stability", "acceleration_resolution"), times(1e-9)),
        ("kept", ("stability", "proof", "force_limit"), times(1e-3)),
        ("kept", ("stability", "proof", "nodes"), lambda nodes: nodes[:1]),
        ("kept", ("object_inertia",), lambda _: None),
        ("lost", ("stability", "motion", "object_acceleration"), times(1.01)),
        ("lost", ("stability", "motion", "contact_forces"), times(1.01)),
        ("lost", ("stability", "motion", "contact_forces"),
         lambda f: [[*row[:1], row[1] + 0.01, *row[2:]] for row in f]),
        ("slow", ("stability", "no_rest"), times(-1.0)),
        ("slow", ("contacts", 0, "sliding"), times(-1.0)),
    ],
)  # fmt: skip
def test_tampering_is_seen(name, path, by):
    assert is_refused(replaced(name, *path, by=by))


def test_a_motion_below_the_limit_proves_no_weak_verdict():
    made = copy.deepcopy(document("walls"))
    factor = 1.01 * made["stability"]["motion"]["point_acceleration"]
    for key in ("acceleration_resolution", "acceleration_limit"):
        made["stability"][key] *= factor / document("walls")["stability"]["acceleration_limit"]
    assert failures(made) == {"its acceleration is above the limit"}


def test_contacts_are_not_counted_from_behind():
    made = copy.deepcopy(document("slope"))
    for node in made["stability"]["proof"]["nodes"]:
        node["contact"] = -1
    with pytest.raises(ValueError, match="must state a contact, and a state other than free"):
        rest_lines(made)
    made = copy.deepcopy(document("slope"))
    made["stability"]["proof"]["nodes"][0]["contact"] = -2  # the root is of contact -1
    with pytest.raises(ValueError, match=r"is -2; it must be a whole number, -1 to"):
        rest_lines(made)


@pytest.mark.parametrize("number", [6, 24, 27])
def test_a_contact_that_may_open_is_not_taken_for_closed(number):
    """A split into slips alone, with all that was proven of them, for one into open and closed.

    Another leaf of the tree may be refused first. Where loads are proven contacts do not open, and
    where nothing below leans on it, the split was not needed.
    """
    solution = maximize_margin(outcome_case(3, number)[1], static_friction="coulomb")
    verdict = stability(solution.problem, solution.torques)
    original = solution_document(solution, verdict=verdict)
    nodes, said = original["stability"]["proof"]["nodes"], []
    assert all(line.passed is True for line in rest_lines(original))
    splits = [
        index for index, (first, second) in enumerate(pairwise(nodes))
        if first["state"] == "open" and not first["children"]
        and second["state"] == "closed" and second["contact"] == first["contact"]
        and second["children"]
    ]  # fmt: skip
    assert splits
    for index in splits:
        made = copy.deepcopy(original)
        left = made["stability"]["proof"]["nodes"]
        (parent,) = {way for leaf, way in leaves(left) if leaf == index}
        left[parent]["children"] = left[index + 1]["children"]
        del left[index : index + 2]
        said.append(rest_lines(made)[-1])
    assert any(
        line.passed is False and "is free, so it cannot be split by its slip" in line.detail
        for line in said
    )


@pytest.mark.parametrize("share", [1.0, 0.01])
def test_least_forces_hold_up_to_the_limit_of_normal_forces(share):
    """Of one kilogram and of ten grams, with multipliers that leave a little of a force."""
    block = pressed()
    solution = maximize_margin(
        block.with_changes(external_wrench=share * block.external_wrench,
                           torque_limits=(0.2 * share, 0.2 * share),
                           object_inertia=share * ONE_KILOGRAM, joint_inertia=[[0.01 * share]]),
        static_friction="coulomb",
    )  # fmt: skip
    verdict = stability(solution.problem, solution.torques)
    made = json.loads(json.dumps(solution_document(solution, verdict=verdict)))
    lever = next(one for one in made["stability"]["proof"]["loads"] if one["contact"] == 3)
    assert lever["force"] == pytest.approx(2.0 * share, rel=1e-5)
    lever["multipliers"]["motion"][-1] -= 1e-8  # 0.04 N of a limit of 9.81e6 N
    for stated, proven in ((1.95, True), (1.97, False)):
        lever["force"] = stated * share
        assert ("least normal force of contact 3" not in failures(made)) == proven


def test_leaves_that_nearly_prove_it_do_not():
    """What all outcomes' power is at most has to be below the limit's."""
    made = copy.deepcopy(document("slope"))
    nodes = made["stability"]["proof"]["nodes"]
    for given in (nodes[leaf]["multipliers"] for leaf, _ in leaves(nodes)):
        given |= {key: times(0.99)(values) for key, values in given.items()}
    assert failures(made) == {"rest is the only outcome"}
    assert "power 0.01, limit" in rest_lines(made)[-1].detail


def test_friction_that_lacks_a_little_of_its_power_is_seen_where_little_moves():
    """Walls that press on both sides change no balance; they rub, and hold the slip back."""
    made = copy.deepcopy(document("gliding"))
    assert made["stability"]["status"] == "weak" and not failures(made)
    for press, failing in (
        (1e-9, set()),
        (1e-4, {"friction opposes its slip, and open contacts have no force"}),
    ):
        forces = np.array(document("gliding")["stability"]["motion"]["contact_forces"])
        forces[3:, 1] += [press * G, -press * G]
        made["stability"]["motion"]["contact_forces"] = forces.tolist()
        assert failures(made) == failing


def test_a_joint_commands_the_one_force_that_it_alone_makes():
    """One with inertia commands nothing, nor one that pushes askew, at two contacts, or not alone.

    All contacts have the normal z; joint 0 alone has an inertia.
    """
    pushes = {
        0: {1: [0, 0, 1.0], 6: [0, 0, 1.0]},
        1: {2: [0, 0, 1.0]},
        2: {5: [1e-3, 0, 1.0]},
        3: {0: [0, 0, 1.0]},
        4: {3: [0, 0, 1.0], 4: [0, 0, 1.0]},
        5: {6: [0, 0, 1.0]},
    }
    jacobian = np.zeros((7, 3, 6))
    for joint, contacts in pushes.items():
        for contact, push in contacts.items():
            jacobian[contact, :, joint] = push
    points = [[0.01 * k, 0.01 * k**2, -0.03] for k in range(-3, 4)]
    problem = QuasistaticProblem(points, [[0, 0, 1]] * 7, [0, 0, -G, 0, 0, 0],
                                 jacobian.reshape(21, 6), friction=0.5)  # fmt: skip
    stated = read_problem(solution_document(maximize_margin(problem)))
    joint_inertia = np.diag([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert commanded_contacts(stated, joint_inertia).tolist() == [-1, 2, -1, 0, -1, -1]


def test_nothing_accelerates_without_a_load():
    made = document("weightless")
    assert made["stability"]["status"] == "strong"
    assert all(line.passed is True for line in rest_lines(made))
    assert rest_lines(made)[-1].detail == "there is no load"


def of_contact(kind, arc=(0.0, np.pi)):
    return RestNode(0, kind, arc, None, [], [])


@pytest.mark.sampled(20)
@pytest.mark.parametrize("seed", range(60))
def test_arcs_of_slip_cover_each_direction(seed):
    """Held against directions one by one; wherever arcs begin, and however often they turn."""
    rng = np.random.default_rng(seed)
    count, center = int(rng.integers(1, 5)), float(rng.uniform(-7.0, 7.0))
    half_width = float(rng.choice([np.pi, rng.uniform(0.1, 3.0)]))
    half = half_width / count * rng.uniform(0.9, 1.3)
    middles = center - half_width + half_width / count * (1.0 + 2.0 * np.arange(count))
    middles = rng.permutation(middles + 2.0 * np.pi * rng.integers(-2, 3, count)).tolist()
    known = KnownStates.all_free(1)
    sticking = []
    if half_width < np.pi:
        known = known.with_state(0, Kind.SLIPPING, (center, half_width))
    else:
        known, sticking = known.with_state(0, Kind.CLOSED), [of_contact(Kind.STICKING)]
    children = [*sticking, *(of_contact(Kind.SLIPPING, (one, half)) for one in middles)]
    directions = center + np.linspace(-half_width, half_width, 5001)
    away = np.abs((directions[:, None] - middles + np.pi) % (2.0 * np.pi) - np.pi)
    covered = bool((away.min(axis=1) <= half + 1e-9).all())
    assert uncovered_states(children, known, np.array([False])) == (
        "" if covered else "the arcs of the children leave out slips"
    )


@pytest.mark.parametrize(
    ("known", "kinds", "why"),
    [
        (Kind.FREE, [Kind.OPEN, Kind.CLOSED], ""),
        (Kind.CLOSED, [Kind.OPEN, Kind.CLOSED], "it is known to be closed already"),
        (Kind.FREE, [Kind.OPEN], "it cannot be split into open"),
        (
            Kind.FREE,
            [Kind.STICKING, Kind.SLIPPING],
            "it is free, so it cannot be split by its slip",
        ),
        (Kind.CLOSED, [Kind.STICKING, Kind.SLIPPING], ""),
        (Kind.CLOSED, [Kind.SLIPPING], "no child is the case in which it sticks"),
        (Kind.CLOSED, [Kind.STICKING], "the arcs of the children leave out slips"),
        (Kind.CLOSED, [Kind.OPEN, Kind.STICKING], "it cannot be split into open, sticking"),
        (Kind.SLIPPING, [Kind.SLIPPING], ""),
        (Kind.STICKING, [Kind.SLIPPING], "it is sticking, so it cannot be split by its slip"),
    ],
)
def test_a_split_leaves_out_no_state(known, kinds, why):
    states = KnownStates.all_free(1).with_state(0, known, (0.0, np.pi))
    children = [of_contact(kind) for kind in kinds]
    assert uncovered_states(children, states, np.array([False])) == why
    # A contact that a finger presses is never open.
    if known == Kind.FREE and Kind.SLIPPING in kinds:
        assert uncovered_states(children, states, np.array([True])) == ""


def test_claims_without_a_proof_are_not_proven():
    made = copy.deepcopy(document("walls"))
    made["stability"]["status"] = "strong"
    assert [line.passed for line in rest_lines(made)].count(None) == 1
    made["stability"]["status"] = "undecided"
    last = rest_lines(made)[-1]
    assert (last.name, last.detail) == (
        "whether the object stays",
        "left undecided: nothing is claimed",
    )
    made = copy.deepcopy(document("slope"))
    made["stability"]["status"] = "weak"
    assert is_refused(made)
    made = copy.deepcopy(document("slope"))
    made["object_inertia"] = None
    assert is_refused(made)


def test_each_condition_of_an_outcome_is_held_up_alone():
    made = copy.deepcopy(document("walls"))
    stated = made["stability"]
    lifted = [[0.0, 0.0, 0.5 * G], [0.0, 0.0, 0.5 * G]]
    stated["rest_forces"] = lifted
    stated["motion"] |= {
        "object_acceleration": [0.0, 0.0, -G, 0.0, 0.0, 0.0],
        "contact_forces": [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
        "point_acceleration": G,
    }
    assert failures(made) == {
        "rest is an outcome",
        "friction opposes its slip, and open contacts have no force",
    }
    stated["motion"]["contact_forces"] = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    assert failures(made) == {"rest is an outcome"}
    made["external_wrench"][0] = 1.0
    stated["motion"]["object_acceleration"][0] = 1.0
    stated["motion"]["point_acceleration"] = float(np.hypot(1.0, G))
    assert "it penetrates nothing" in failures(made)


def states_of(f, u, rng):
    """Return states that an outcome is in, with how far closed contacts part and slip."""
    states = KnownStates.all_free(len(f))
    for contact, (force, slip) in enumerate(zip(f, u, strict=True)):
        kind, speed = rng.choice(list(Kind)), float(np.hypot(*slip[1:]))
        center = float(np.arctan2(slip[2], slip[1])) + rng.uniform(-0.2, 0.2)
        if kind == Kind.OPEN and np.abs(force).max() < 1e-9:
            states = states.with_state(contact, Kind.OPEN)
        elif kind in (Kind.CLOSED, Kind.STICKING, Kind.SLIPPING):
            states = states.with_state(contact, Kind.CLOSED, most=max(float(slip[0]), 0.0))
            if kind == Kind.STICKING:
                states = states.with_state(contact, Kind.STICKING, most=speed)
            elif kind == Kind.SLIPPING and speed > 1e-6:
                states = states.with_state(contact, Kind.SLIPPING, (center, 0.25))
    return states


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [1, 3, 4, 7, 13])
def test_bounds_hold_for_what_happens(number):
    """No multipliers bound an outcome away, whatever is said truly of its contacts."""
    (body, outcome), rng = seeded(number), np.random.default_rng(number)
    dynamics = body.dynamics(body.load)
    y, f = body.coordinates(dynamics, outcome.acceleration, outcome.forces)
    u = dynamics.rows @ y
    for _ in range(300):
        assert slack_of(dynamics, states_of(f, u, rng), y, f, rng) >= -1e-8


def test_a_slip_without_a_load_is_as_long_as_its_own_rows_let_it_be():
    """Nothing pays for it, and no outcome is longer than one: normal rows add nothing."""
    made = document("slope")
    dynamics = read_load(made, read_problem(made)).dynamics
    assert dynamics is not None
    rows, goal = dynamics.rows, np.zeros((3, 3))
    multipliers = RestMultipliers(np.zeros(6), np.zeros(3), np.eye(3, 2))
    for contact in (0, 1):
        own = np.where(np.arange(3)[:, None] == contact, multipliers.tangential, 0.0)
        asked = -np.einsum("li,lin->n", own, rows[:, 1:]), goal
        alone = RestMultipliers(multipliers.motion, multipliers.normal, own)
        bound = largest_goal(dynamics, KnownStates.all_free(3), np.zeros(3), alone, asked, 1e6)
        assert bound == pytest.approx(np.linalg.norm(rows[contact, 1:]), rel=1e-9)
