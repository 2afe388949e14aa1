"""Verdicts under a declared motion are checked from documents alone; no tampering passes."""

import copy
import json
from functools import cache

import numpy as np
import pytest
from rest_documents import is_refused, leaves, rest_lines, times, zeroed
from tests.oracles.kept_cases import kept_problem

from graspless_pin import QuasistaticProblem, maximize_margin, stability
from graspless_pin.report import solution_document
from graspless_pin.report.verify.reading import read_problem
from graspless_pin.report.verify.rest import kept_goal
from graspless_pin.report.verify.rest_bounds import (
    Kind,
    KnownStates,
    RestMultipliers,
    commanded_contacts,
    rest_dynamics,
)

G = 9.81


def pushed(height=0.0, friction=0.5):
    """A block of 1 kg that slides along x on three feet, pushed and carried by two joints."""
    feet = [[0.05, 0.0, -0.02], [-0.05, 0.05, -0.02], [-0.05, -0.05, -0.02], [-0.05, 0.0, height]]
    jacobian = np.zeros((12, 2))
    jacobian[9, 0] = jacobian[11, 1] = 1.0
    return QuasistaticProblem(
        feet, [[0, 0, 1]] * 3 + [[1, 0, 0]], [0, 0, -G, 0, 0, 0], jacobian,
        friction=[friction] * 3 + [0.4], sliding=[[0.1, 0, 0]] * 3 + [[0, 0, 0]], cone="round",
        torque_limits=(-100.0, 100.0), joint_units=["N", "N"],
        object_inertia=np.diag([1.0] * 3 + [1e-3] * 3), joint_inertia=np.diag([0.1, 0.1]),
    )  # fmt: skip


def stiff():
    """The same with a finger that may carry some of the weight."""
    whole = pushed()
    return whole.with_changes(jacobian=whole.jacobian[:, :1], joint_inertia=[[0.1]],
                              joint_units=["N"], joint_names=["push"], gravity_torques=[0.0],
                              torque_limits=(-100.0, 100.0))  # fmt: skip


CASES = {"kept": (pushed, (0.5 * G, 0.0)), "lost": (stiff, (0.5 * G,)), "slow": (stiff, (0.3 * G,))}


@cache
def document(name):
    make, torques = CASES[name]
    problem = make()
    made = solution_document(maximize_margin(problem), verdict=stability(problem, torques))
    for joint, own in zip(made["joints"], torques, strict=True):
        joint["torque"] = float(own)
    return json.loads(json.dumps(made))


@pytest.mark.parametrize(("name", "status"), [("kept", "strong"), ("lost", "weak"),
                                              ("slow", "none")])  # fmt: skip
def test_verdicts_are_proven_by_their_documents(name, status):
    made = document(name)
    assert made["stability"]["status"] == status
    assert made["stability"]["motion"] is not None or status == "strong"
    assert all(line.passed is True for line in rest_lines(made))


def test_no_leaf_can_be_dropped():
    nodes = document("kept")["stability"]["proof"]["nodes"]
    assert len(leaves(nodes)) > 4
    for leaf, parent in leaves(nodes):
        made = copy.deepcopy(document("kept"))
        left = made["stability"]["proof"]["nodes"]
        left[parent]["children"] -= 1
        del left[leaf]
        assert is_refused(made), leaf


def test_no_node_can_say_other_than_it_proves():
    nodes = document("kept")["stability"]["proof"]["nodes"]
    some = next(node["sides"][0]["multipliers"] for node in nodes if node["sides"])
    for index, node in enumerate(nodes):
        changes = []
        for number, side in enumerate(node["sides"]):
            others = node["sides"][:number] + node["sides"][number + 1 :]
            goal, multipliers = side["goal"], side["multipliers"]
            if not node["children"]:  # others may prove more than the leaves below them need
                changes.append({"sides": others})
            if goal == 0:
                changes.append({"sides": [{"goal": 1, "multipliers": multipliers}]})
        if node["slip"] is not None:
            center, half_width = node["slip"]
            changes += [{"slip": [center, 0.9 * half_width]}, {"slip": [center + 0.1, half_width]}]
        if index:
            changes += [{"contact": (node["contact"] + 1) % 4}, {"children": node["children"] + 1}]
            changes.append({"state": "open" if node["state"] != "open" else "sticking"})
            changes.append({"forced": [some]})
        for change in changes:
            made = copy.deepcopy(document("kept"))
            made["stability"]["proof"]["nodes"][index] |= change
            assert is_refused(made), (index, change)


@pytest.mark.parametrize("goals", [range(1, 13), [0]])
def test_sides_are_worked_out_again(goals):
    made = copy.deepcopy(document("kept"))
    root = made["stability"]["proof"]["nodes"][0]
    some = next(
        side["multipliers"]
        for node in made["stability"]["proof"]["nodes"]
        for side in node["sides"]
    )
    claimed = [{"goal": goal, "multipliers": zeroed(some)} for goal in goals]
    made["stability"]["proof"]["nodes"] = [root | {"sides": claimed, "children": 0}]
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


def test_friction_has_to_be_against_the_sliding():
    made = copy.deepcopy(document("lost"))
    made["joints"][0]["torque"] = 0.0
    # The weight on three feet that do not rub: balanced, and in the cones.
    lift = [[0.0, 0.0, share * G] for share in (0.5, 0.25, 0.25, 0.0)]
    made["stability"]["rest_forces"] = lift
    assert "rest is an outcome" in {line.name for line in rest_lines(made) if line.passed is False}
    made["contacts"] = [contact | {"friction": 0.0} for contact in made["contacts"]]
    assert "rest is an outcome" in {line.name for line in rest_lines(made) if line.passed}


def test_a_strong_verdict_without_its_sides_is_refused():
    made = copy.deepcopy(document("kept"))
    del made["stability"]["proof"]["nodes"][0]["sides"]
    assert is_refused(made)
    made = copy.deepcopy(document("lost"))
    made["stability"]["status"] = "strong"
    assert [line.passed for line in rest_lines(made)].count(None) == 1


def states_of(f, u, rng):
    """Return states that an outcome is in, as much or as little told as chance has it."""
    states = KnownStates.unknown(len(f))
    for contact, (force, slip) in enumerate(zip(f, u, strict=True)):
        speed, kind = float(np.hypot(*slip[1:])), rng.choice(list(Kind))
        if kind == Kind.OPEN and force[0] <= 0.0:
            states = states.changed(contact, Kind.OPEN)
        elif kind in (Kind.CLOSED, Kind.STICKING, Kind.SLIPPING) and abs(slip[0]) < 1e-9:
            states = states.changed(contact, Kind.CLOSED)
            if kind == Kind.STICKING and speed < 1e-9:
                states = states.changed(contact, Kind.STICKING)
            elif kind == Kind.SLIPPING and speed > 1e-6:
                center = float(np.arctan2(slip[2], slip[1])) + rng.uniform(-0.2, 0.2)
                states = states.changed(contact, Kind.SLIPPING, (center, 0.25))
    return states


@pytest.mark.parametrize("number", [5, 11, 13, 17, 40])
def test_bounds_hold_for_what_happens(number):
    """No multipliers bound an outcome away, whatever is said truly of its contacts."""
    case, _, problem = kept_problem(2, number)
    verdict = stability(problem, case.torques)
    assert verdict.motion is not None
    document = solution_document(maximize_margin(problem, static_friction="coulomb"))
    stated = read_problem(json.loads(json.dumps(document)))
    inertia = np.zeros((6 + len(case.torques),) * 2)
    inertia[:6, :6], inertia[6:, 6:] = case.object_inertia, case.joint_inertia
    load = np.concatenate([case.external_wrench, case.torques])
    dynamics = rest_dynamics(stated, load, inertia, commanded_contacts(stated, case.joint_inertia))
    assert dynamics is not None
    motion = verdict.motion
    acceleration = np.concatenate([motion.object_acceleration, motion.joint_accelerations])
    y = np.linalg.lstsq(dynamics.accelerations, acceleration, rcond=None)[0]
    f = np.einsum("lij,lj->li", stated.frames, motion.contact_forces) / dynamics.force_unit
    f[stated.slides, 1:] = 0.0
    u, rng, tight = dynamics.rows @ y, np.random.default_rng(number), np.inf
    for _ in range(1000):
        states = states_of(f, u, rng)
        size = 10.0 ** rng.uniform(-3.0, 1.0)
        multipliers = RestMultipliers(
            np.zeros(len(y)), size * rng.normal(size=len(f)), size * rng.normal(size=(len(f), 2))
        )
        goal = rng.normal(size=y.shape)
        bound = kept_goal(dynamics, states, multipliers, goal, 1.01 * float(f[:, 0].max()))
        assert bound >= goal @ y - 1e-7 * (1.0 + size)
        tight = min(tight, bound - goal @ y)
    assert tight < 5.0
