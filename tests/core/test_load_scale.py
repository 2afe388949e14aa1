"""No limit, unit, size, frame or order changes an answer but as it must; the load is the scale."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import (
    assert_holds,
    cuboid_arguments,
    random_arguments,
    rescaled,
    scene,
    sphere_arguments,
    structured_arguments,
)
from scipy.spatial.transform import Rotation

from graspless_pin import QuasistaticProblem, Status, maximize_margin, minimize_torque
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

PLACEHOLDERS = (1e7, 1e8, 1e12, np.inf)
DECADES = st.integers(-9, 9).map(lambda power: 10.0**power)
RULES = [
    {"sign_rule": sign, "sliding_rule": sliding}
    for sign in ("strict", "exact", "nonzero")
    for sliding in ("exempt", "constrained")
] + [{"static_friction": "coulomb"}]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("limit", PLACEHOLDERS)
@pytest.mark.parametrize(("name", "torque"), [("up", 1.5554), ("rest", 0.9618)])
def test_placeholders_of_torque_limits_change_nothing(name, torque, limit):
    """They made 4.99 and 4.54 N m of these, said to be optimal."""
    problem = scene(name).with_changes(torque_limits=(-limit, limit))
    solution = minimize_torque(problem, 0.1)
    assert solution.status is Status.OPTIMAL
    assert solution.max_torque == pytest.approx(torque, abs=1e-4)
    assert_holds(solution, 1e-6)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("limit", [7.7e4, 1e7, 1e8, 1e10, 1e12])
@pytest.mark.parametrize("name", ["up", "rest"])
def test_placeholders_of_normal_force_limits_change_nothing(name, limit):
    plain = scene(name).with_changes(max_normal_force=1e4)
    problem = plain.with_changes(max_normal_force=limit)
    for solve in (maximize_margin, partial(minimize_torque, margin=0.1)):
        expected, solution = solve(plain), solve(problem)
        assert solution.status is Status.OPTIMAL
        assert solution.margin == pytest.approx(expected.margin, rel=1e-6)
        assert solution.max_torque == pytest.approx(expected.max_torque, rel=1e-6)
        assert_holds(solution, 1e-6)
        reach = solution.certificate.force_reach
        assert reach == min(limit, 1e8 * problem.scales.force)
        told = "the bound is proven for normal forces up to" in str(solution)
        assert told == (reach < limit)


@pytest.mark.parametrize("seed", [2, 6])
def test_round_cones_are_proven_under_placeholders_of_normal_force_limits(seed):
    """Rounding over so far a box left more of the bound than is a gap elsewhere."""
    plain = QuasistaticProblem(**structured_arguments(seed, "slab", 4), cone="round")
    problem = plain.with_changes(max_normal_force=1e12)
    smallest = minimize_torque(problem, 0.1, static_friction="coulomb")
    assert smallest.status is Status.OPTIMAL
    assert verify_document(solution_document(smallest)).passed


def test_a_large_limit_makes_nothing_feasible():
    """A margin of -1.5 N with 1.3 N of weight unbalanced was said to be optimal."""
    problem = scene("rest")
    weak = problem.with_changes(torque_limits=(-0.5, 0.5))
    assert minimize_torque(weak, 0.1).status is Status.INFEASIBLE_FORCES
    for limit in (1e8, 1e12):
        limits = problem.max_normal_force.copy()
        limits[-4:] = limit
        large = weak.with_changes(max_normal_force=limits)
        solution = minimize_torque(large, 0.1)
        assert solution.status is Status.INFEASIBLE_FORCES
        assert solution.certificate.infeasibility > 1e-8


def test_a_load_of_micronewtons_is_no_rounding():
    """An infeasible scene of 5e-6 N with limits of 50 N was optimal with a negative margin."""
    problem = QuasistaticProblem(
        [[0.1, 0.0, -0.1], [-0.1, 0.0, -0.1]], [[0.0, 0.0, 1.0]] * 2,
        [0.0, 0.0, 5e-6, 0.0, 0.0, 0.0], friction=0.5,
    )  # fmt: skip
    solution = maximize_margin(problem, static_friction="coulomb")
    assert solution.status is Status.INFEASIBLE_FORCES
    held = problem.with_changes(external_wrench=[0.0, 0.0, -5e-6, 0.0, 0.0, 0.0])
    assert maximize_margin(held, static_friction="coulomb").margin > 1e-7


def test_forces_that_no_double_resolves_are_not_said_to_be_optimal():
    """A squeeze of 1e12 times the load: the balance is lost in rounding."""
    problem = QuasistaticProblem(
        [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]], [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]],
        [0.0, -0.1, 0.0, 0.0, 0.0, 0.0], friction=0.5, max_normal_force=1e11 / 3.0,
    )  # fmt: skip
    solution = maximize_margin(problem)
    assert solution.status is Status.UNVERIFIED
    assert "no solver gave an answer that passes the check" in str(solution)
    resolved = maximize_margin(problem.with_changes(max_normal_force=1e5))
    assert resolved.status is Status.OPTIMAL


def test_a_limit_that_stands_for_none_does_not_hide_a_margin():
    """Without a load the margin is the scale, though the limits are 1e14 times as large."""
    problem = scene("rest").with_changes(external_wrench=np.zeros(6), max_normal_force=2e12)
    solution = minimize_torque(problem, 0.02)
    document = solution_document(solution)
    assert solution.found
    assert document["scales"]["force"] == pytest.approx(0.02)
    assert solution.margin >= 0.02 * (1.0 - 1e-6)
    assert verify_document(document).proven


@st.composite
def questions(draw):
    """Arguments of a random problem, an algorithm with its options, and its own forces' scale."""
    seed, kind = (
        draw(st.integers(0, 3000)),
        draw(st.sampled_from(["free", "slab", "pinch", "paper"])),
    )
    if kind == "paper":
        arguments = sphere_arguments() if seed % 2 else cuboid_arguments(seed % 3 - 1.0)
    elif kind == "free":
        arguments = random_arguments(seed, 3, slides=seed % 2)
    else:
        arguments = structured_arguments(seed, kind, 4, slides=seed % 2)
    options = dict(draw(st.sampled_from(RULES)))
    options["regularization"] = draw(st.sampled_from([0.0, 0.0, 0.05]))
    which = draw(st.sampled_from(["margin", "absolute", "limits"]))
    return arguments, which, options


def solved(problem, which, options, factor=1.0):
    if which == "margin":
        return maximize_margin(problem, **options)
    return minimize_torque(problem, 0.05 * factor, scale=which, **options)


def assert_alike(one, two, which, force, length):
    assert two.status is one.status
    if one.found:
        load = one.problem.scales.force
        if which == "margin":
            assert two.margin / force == pytest.approx(one.margin, rel=1e-5, abs=2e-6 * load)
        else:
            torque = one.problem.scales.joints.max(initial=0.0)
            expected = pytest.approx(one.max_torque, rel=1e-5, abs=2e-6 * torque)
            if which == "absolute":
                assert two.max_torque / (force * length) == expected
        bound = two.certificate.bound
        unit = force if which == "margin" else force * length if which == "absolute" else 1.0
        assert bound / unit == pytest.approx(one.certificate.bound, rel=1e-5, abs=2e-6 * load)


@settings(max_examples=25)
@given(questions(), DECADES, DECADES)
def test_other_units_change_nothing(question, force, length):
    arguments, which, options = question
    problem = QuasistaticProblem(**arguments)
    one = solved(problem, which, options)
    two = solved(rescaled(problem, force, length), which, options, factor=force)
    assert_alike(one, two, which, force, length)


@settings(max_examples=15)
@given(questions(), st.floats(0.0, 9.0), st.data())
def test_limits_that_do_not_bind_change_nothing_when_raised(question, decades, data):
    """Raised are those of contacts that stay well below theirs, in all optima that count."""
    arguments, which, options = question
    wide = 1e3 * QuasistaticProblem(**arguments).scales.force
    problem = QuasistaticProblem(**{**arguments, "max_normal_force": wide})
    one = solved(problem, which, options)
    if not one.found:
        return
    normal = np.einsum("ij,ij->i", problem.normals, one.contact_forces)
    loose = np.flatnonzero(normal + one.margin < 0.5 * wide)
    if not len(loose):
        return
    raised = problem.max_normal_force.copy()
    chosen = data.draw(st.sets(st.sampled_from(loose.tolist()), min_size=1))
    raised[list(chosen)] *= 10.0**decades
    other = problem.with_changes(max_normal_force=raised)
    assert_alike(one, solved(other, which, options), which, 1.0, 1.0)


def assert_described(question, change, forces=np.copy, torques=np.copy):
    """Compare with the problem described otherwise; what becomes of forces and torques is told."""
    arguments, which, options = question
    problem = QuasistaticProblem(**arguments)
    one = solved(problem, which, options)
    two = solved(problem.with_changes(**change(problem)), which, options)
    assert_alike(one, two, which, 1.0, 1.0)
    if one.found:
        assert_holds(one)
        assert_holds(two)
        if which == "margin" and options["regularization"] > 0.0:
            # Then the optimum is unique in its forces.
            np.testing.assert_allclose(two.contact_forces, forces(one.contact_forces), atol=5e-3)
            np.testing.assert_allclose(two.torques, torques(one.torques), atol=5e-3)


few = settings(max_examples=12)
VECTORS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
ROTATIONS = st.integers(0, 10_000).map(
    lambda seed: Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
)


@few
@given(questions(), ROTATIONS, VECTORS)
def test_a_rigid_change_of_frame(question, rotation, shift):
    """All is turned, and moments are taken about the old origin seen from a new one."""

    def change(problem):
        force, moment = (rotation @ part for part in problem.external_wrench.reshape(2, 3))
        rows = problem.jacobian.reshape(problem.contact_count, 3, -1)
        return {
            "positions": problem.positions @ rotation.T + shift,
            "normals": problem.normals @ rotation.T,
            "external_wrench": np.concatenate([force, moment + np.cross(shift, force)]),
            "jacobian": (rotation @ rows).reshape(problem.jacobian.shape),
            "tangents": rotation @ problem.tangents,
            "sliding": problem.sliding @ rotation.T,
        }

    assert_described(question, change, forces=lambda f: f @ rotation.T)


@few
@given(questions(), st.randoms(use_true_random=False))
def test_relabelled_contacts_and_joints(question, random):
    problem = QuasistaticProblem(**question[0])
    contacts, joints = list(range(problem.contact_count)), list(range(problem.joint_count))
    random.shuffle(contacts)
    random.shuffle(joints)

    def change(one):
        names = "positions", "normals", "friction", "tangents", "sliding", "max_normal_force"
        rows = one.jacobian.reshape(one.contact_count, 3, -1)[contacts][:, :, joints]
        return {name: getattr(one, name)[contacts] for name in names} | {
            "jacobian": rows.reshape(one.jacobian.shape),
            "torque_limits": (one.lower_torque[joints], one.upper_torque[joints]),
            "gravity_torques": one.gravity_torques[joints],
        }

    assert_described(question, change, lambda f: f[contacts], lambda tau: tau[joints])


@few
@given(questions())
def test_the_speed_of_sliding_does_not_matter(question):
    assert_described(question, lambda problem: {"sliding": 50.0 * problem.sliding})


POINTS = st.tuples(*[st.floats(-0.1, 0.1)] * 3).map(np.array)


@settings(max_examples=10)
@given(POINTS, POINTS, st.floats(-1.0, 1.0), st.integers(1, 3))
def test_rounding_of_the_moment_is_no_length(point, side, rounding, count):
    """It gave a length of 1e-18 m, and said that a contact below the load cannot bear it."""
    force = np.array([side[0], side[1], -9.7])
    moment = np.cross(point, force)
    moment += 1e-14 * rounding * np.abs(point).max()
    problem = QuasistaticProblem(
        [point] * count, [[0.0, 0.0, 1.0]] * count, np.concatenate([force, moment]), friction=0.5
    )
    assert problem.scales.length == 1.0
    solution = maximize_margin(problem, static_friction="coulomb")
    assert solution.status is Status.OPTIMAL
    assert_holds(solution, 1e-6)
    assert all(check.passed for check in verify_document(solution_document(solution)).checks)


def test_a_moment_on_contacts_at_one_point_is_a_length():
    wrench = [0.0, 0.0, -2.0, -0.4, 0.2, 1e-6]
    problem = QuasistaticProblem([[0.1, 0.2, 0.3]], [[0, 0, 1]], wrench, friction=0.5)
    assert problem.scales.length == pytest.approx(5e-7, rel=1e-9)
