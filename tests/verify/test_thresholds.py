"""Each check of forces and figures passes at half its tolerance and fails at twice it."""

from dataclasses import replace

import numpy as np
import pytest
from tests.core.scenes import rescaled, scene
from verified_documents import SCALES, changed, documented, failed

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque
from graspless_pin.report.verify import verify_document
from graspless_pin.report.verify.forces import force_checks, residual
from graspless_pin.report.verify.problem import Forces, Problem
from graspless_pin.report.verify.reading import read_problem

ONE = np.eye(6)


def answer(document) -> tuple[Problem, Forces]:
    problem = read_problem(document)
    return problem, Forces(problem, np.array([c["force"] for c in document["contacts"]]))


def pushed(problem: Problem, forces: Forces, size: float) -> Problem:
    return replace(problem, w=problem.w + size * problem.force * ONE[1])


def turned(problem: Problem, forces: Forces, size: float) -> Problem:
    return replace(problem, w=problem.w + size * problem.force * problem.length * ONE[4])


def wider(problem: Problem, forces: Forces, size: float) -> Problem:
    """Friction that is so small that one contact is outside its cone by so much."""
    contact = int(np.argmax(np.linalg.norm(forces.local[:, 1:], axis=1)))
    low, high = 0.0, float(problem.mu[contact])
    for _ in range(80):
        middle = (low + high) / 2.0
        mu = problem.mu.copy()
        mu[contact] = middle
        outside = Forces(replace(problem, mu=mu), forces.f).outside
        low, high = (low, middle) if outside < size * problem.force else (middle, high)
    mu = problem.mu.copy()
    mu[contact] = low
    return replace(problem, mu=mu)


def lower(problem: Problem, forces: Forces, size: float) -> Problem:
    limit, force = problem.limit.copy(), forces.local[2, 0]
    limit[2] = force - size * min(problem.force, max(force, limit.max() / 1000))
    return replace(problem, limit=limit)


def weaker(problem: Problem, forces: Forces, size: float) -> Problem:
    upper, torque = problem.upper.copy(), forces.torques[1]
    upper[1] = torque - size * min(problem.joint_scale[1], abs(torque))
    return replace(problem, upper=upper)


def stronger(problem: Problem, forces: Forces, size: float) -> Problem:
    low, torque = problem.lower.copy(), forces.torques[0]
    low[0] = torque + size * min(problem.joint_scale[0], abs(torque))
    return replace(problem, lower=low)


def asked(problem: Problem, forces: Forces, size: float) -> Problem:
    return replace(problem, e0=forces.margin + size * problem.force)


def slid(problem: Problem, forces: Forces, size: float) -> Problem:
    """Kinetic friction that is smaller by so much at one contact."""
    mu = problem.mu.copy()
    mu[2] -= size * problem.force / forces.local[2, 0]
    return replace(problem, mu=mu)


SPOILT = {
    "balance of forces": ("rest", pushed),
    "balance of moments": ("rest", turned),
    "inside friction cones": ("rest", wider),
    "normal forces between 0 and limit": ("rest", lower),
    "torques within limits": ("rest", weaker),
    "torques within limits, below": ("rest", stronger),
    "required margin": ("rest", asked),
    "kinetic friction opposes sliding": ("up", slid),
}


@pytest.mark.sampled(14)
@pytest.mark.parametrize("name", SPOILT)
@pytest.mark.parametrize(("force", "length"), SCALES)
def test_forces_meet_each_constraint_to_a_millionth_of_load_or_limit(name, force, length):
    which, spoil = SPOILT[name]
    solution = minimize_torque(rescaled(scene(which), force, length), 0.05 * force)
    problem, forces = answer(documented(solution))
    assert all(check.passed for check in force_checks(problem, forces))
    assert residual(problem, forces) < 1e-7
    checked = name.split(",")[0]
    for size, passes in ((0.5e-6, True), (2e-6, False), (1e-2, False)):
        # Where the required margin is spoilt, cones and limits are not, and the other way round.
        spoilt = spoil(replace(problem, e0=0.0), forces, size)
        changed_forces = Forces(spoilt, forces.f)
        found = {check.name: check.passed for check in force_checks(spoilt, changed_forces)}
        assert found[checked] is passes, (size, found)
        # What is outside a cone or a limit leaves no margin either.
        failing = {key for key, good in found.items() if not good}
        assert failing <= {checked, "required margin"}
        axis = 2**-0.5 if checked.startswith("kinetic") else 1.0
        assert residual(spoilt, changed_forces) == pytest.approx(axis * size, rel=0.02)


@pytest.mark.parametrize("pull", [1e-3, 2e-6])
def test_a_contact_does_not_pull(pull):
    problem, forces = answer(documented(minimize_torque(scene("up"), 0.1)))
    pulling = forces.f.copy()
    pulling[3] = -pull * problem.force * problem.kinetic_directions[3]
    found = {c.name: c.passed for c in force_checks(problem, Forces(problem, pulling))}
    assert not found["normal forces between 0 and limit"]
    assert found["kinetic friction opposes sliding"]


def test_each_stated_figure_is_right_to_a_billionth(made):
    document = made("tree")
    problem, forces = answer(document)
    sizes = {
        ("margin",): max(problem.force, np.abs(forces.f).max()),
        ("max_torque",): problem.joint_scale.max(),
        ("joints", 1, "torque"): problem.joint_scale[1],
        ("joints", 1, "torque_contact"): problem.joint_scale[1],
    }
    for path, size in sizes.items():
        value = document
        for key in path:
            value = value[key]
        for off, passes in ((0.5e-9, True), (1e-8, False)):
            for sign in (1.0, -1.0):
                false = changed(document, *path, to=value + sign * off * size)
                assert verify_document(false).passed is passes, (path, off)


@pytest.mark.parametrize("key", ["force", "length"])
def test_scales_are_right_to_a_billionth(key, made):
    document = made("tree")
    for off, failing in ((0.5e-9, []), (-0.5e-9, []), (2e-9, [f"{key} scale"])):
        stated = document["scales"][key] * (1.0 + off)
        assert failed(changed(document, "scales", key, to=stated)) == failing


def test_the_reach_is_1e8_loads_or_the_largest_limit():
    problem = scene("rest").with_changes(max_normal_force=[1e10] + [50.0] * 5)
    document = documented(maximize_margin(problem))
    reach = 1e8 * document["scales"]["force"]
    assert document["certificate"]["force_reach"] == pytest.approx(reach, rel=1e-12)
    for stated, failing in (
        (reach * (1.0 - 1e-10), []),
        (reach * (1.0 - 1e-8), ["reach of the proof"]),
        (reach / 10.0, ["reach of the proof"]),
    ):
        false = changed(document, "certificate", "force_reach", to=stated)
        assert failed(false)[:1] == failing


def test_a_bound_that_is_off_by_a_few_millionths_is_refused():
    """Of an answer that is not proven optimal the bound is the whole claim."""
    solution = minimize_torque(scene("rest"), 0.1, node_limit=2)
    document = documented(solution)
    assert document["status"] == "limit_reached"
    problem = read_problem(document)
    bound, gap = document["certificate"]["bound"], document["certificate"]["gap"]
    size = max(problem.unit, abs(document["max_torque"]))
    for off, failing in ((5e-7, []), (3e-6, ["bound over all modes"]), (-3e-6, [])):
        false = changed(document, "certificate", "bound", to=bound + off * size)
        false["certificate"]["gap"] = gap - off * size
        assert failed(false) == failing


def test_a_bound_beyond_the_value_closes_no_gap():
    """Even where the document holds no proof of it, bound and value of an optimum agree."""
    for solution, sign in (
        (minimize_torque(scene("rest"), 0.1), 1.0),
        (maximize_margin(scene("up")), -1.0),
    ):
        document = documented(solution)
        document["proof"] |= {"complete": False, "missing": "too long", "mode_multipliers": None}
        assert failed(document) == []
        problem = read_problem(document)
        for off, failing in ((5e-7, []), (3e-6, ["gap is closed"]), (0.1, ["gap is closed"])):
            for way in (1.0, -1.0):
                false = changed(
                    document, "certificate", "bound", to=document["certificate"]["bound"]
                )
                false["certificate"]["bound"] += sign * way * off * problem.unit
                false["certificate"]["gap"] -= way * off * problem.unit
                assert failed(false) == failing


def test_tangents_are_orthonormal_and_sliding_is_tangential():
    document = documented(maximize_margin(scene("up")))
    name = "orthonormal frames, tangential sliding"
    for off, fails in ((1e-6, False), (1e-5, True)):
        tangents = np.array(document["contacts"][0]["tangents"])
        normal = (np.array(document["contacts"][0]["normal"]) + off * tangents[0]).tolist()
        assert (name in failed(changed(document, "contacts", 0, "normal", to=normal))) is fails
        longer = changed(document, "contacts", 0, "tangents", to=((1.0 + off) * tangents).tolist())
        assert (name in failed(longer)) is fails
        sliding = np.array(document["contacts"][2]["sliding"])
        normal = np.array(document["contacts"][2]["normal"])
        lifted = sliding + off * np.linalg.norm(sliding) * normal
        false = changed(document, "contacts", 2, "sliding", to=lifted.tolist())
        assert (name in failed(false)) is fails


def test_figures_of_zero_size_are_read_as_zero(made):
    """A subnormal friction or limit is no number to compute with."""
    document = made("tree")
    assert read_problem(changed(document, "contacts", 0, "friction", to=1e-70)).mu[0] == 0.0
    assert read_problem(changed(document, "contacts", 0, "friction", to=1e-59)).mu[0] == 1e-59


@pytest.mark.parametrize(("lever", "unit"), [(0.5, "N"), (2.0, "N m")])
def test_the_unit_is_that_of_the_largest_torque(lever, unit):
    """Two joints press with the same force; the larger figure is of one kind or of the other."""
    jacobian = np.zeros((6, 2))
    jacobian[1, 0], jacobian[4, 1] = -lever, 1.0
    problem = QuasistaticProblem(
        [[0, -0.05, 0], [0, 0.05, 0]], [[0, 1, 0], [0, -1, 0]], [0, 0, -1.0, 0, 0, 0], jacobian,
        friction=0.5, joint_units=["N m", "N"],
    )  # fmt: skip
    document = documented(minimize_torque(problem, 0.1))
    assert document["max_torque_unit"] == unit
    assert verify_document(document).proven
    other = {"N": "N m", "N m": "N"}[unit]
    assert failed(changed(document, "max_torque_unit", to=other)) == [
        "unit of the largest torque as stated"
    ]


@pytest.mark.parametrize(
    ("make", "unit"),
    [
        (lambda: maximize_margin(scene("up")), "N"),
        (lambda: minimize_torque(scene("rest"), 0.1), "N m"),
        (lambda: minimize_torque(scene("rest"), 0.1, scale="limits"), ""),
    ],
)
def test_the_gap_has_its_unit(make, unit):
    (check,) = [
        one for one in verify_document(documented(make())).checks if one.name == "gap as stated"
    ]
    words = check.detail.split("found ")[1].split(maxsplit=1)[1:]
    assert " ".join(words) == unit


def test_an_open_answer_states_no_infeasibility():
    document = documented(minimize_torque(scene("rest"), 0.1, time_limit=0.0))
    assert failed(document) == []
    false = changed(document, "certificate", "infeasibility", to=1e-3)
    assert failed(false) == ["states no infeasibility"]
    nothing = changed(document, "certificate", "infeasibility", to=-1e-3)
    assert failed(nothing) == []


def test_shares_of_wide_limits_are_held_to_their_own_size():
    """A millionth of the share that the load makes, not of the limits."""
    problem = scene("rest").with_changes(torque_limits=(-1e6, 1e6))
    document = documented(minimize_torque(problem, 0.1, scale="limits"))
    assert verify_document(document).proven
    value = max(abs(joint["torque"]) for joint in document["joints"]) / 1e6
    assert document["certificate"]["bound"] == pytest.approx(value, rel=1e-5)
    for off in (1e-3, -1e-3):
        false = changed(document, "certificate", "bound", to=value * (1.0 + off))
        false["certificate"]["gap"] = -value * off
        assert failed(false)


def test_contacts_at_one_point_have_the_length_of_the_load_or_a_metre():
    """A moment alone has no length; with a force it has one."""
    at_once = {"positions": [[0, 0, 0]] * 2, "normals": [[0, 0, 1], [1, 0, 0]], "friction": 0.5}
    for wrench, length in (
        ([0, 0, 0, 0, 3.0, 0], 1.0), ([0, 0, -2.0, 0, 3.0, 0], 1.5), ([0, 0, -2.0, 0, 0, 0], 1.0),
    ):  # fmt: skip
        document = documented(
            maximize_margin(QuasistaticProblem(external_wrench=wrench, **at_once))
        )
        assert document["found"] == (wrench[4] == 0.0)
        assert document["scales"]["length"] == length
        assert verify_document(document).proven
        false = changed(document, "scales", "length", to=2.0 * length)
        assert "length scale" in failed(false)
