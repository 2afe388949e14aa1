"""Forces affine in what is unknown: against a study's figures, corners, drawn members, modes."""

import numpy as np
import pytest
from tests.analysis.test_uncertain_torques import CORNERS, contacts_alone
from tests.oracles.uncertain_members import BALANCED, imbalance

from graspless_pin import (
    QuasistaticProblem,
    Status,
    Torque,
    Uncertainty,
    load_scene,
    maximize_margin,
    minimize_torque,
    optimize,
    uncertainty_gradients,
)
from graspless_pin.algorithms import uncertain_members
from graspless_pin.algorithms.robust_solution import Coverage
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem.members import join_members
from graspless_pin.solvers.conic_backends import SparseConic

STUDIED = [
    # name, affine over a box of wrenches, affine with a push of 5 %, sampled members of that
    ("paper/cuboid_at_rest", 1.0543, 1.1376, 1.1318),
    ("allegro_mug_against_wall", 0.1524, 0.1645, 0.1544),
    ("allegro_box_on_slope", 0.02158, 0.02348, 0.02342),
]


def weight(problem):
    return float(np.linalg.norm(problem.external_wrench[:3]))


def solved(problem, unknown, margin=0.1, **options):
    return minimize_torque(
        problem, margin, static_friction="coulomb", uncertainty=unknown, **options
    )


def in_ball(rng, size=3):
    d = rng.normal(size=size)
    return d / np.linalg.norm(d) * (1.0 if rng.random() < 0.7 else rng.random())


def pushed(problem, rng, unknown):
    """A member of a set of masses, centres of mass, forces and moments."""
    force = problem.external_wrench[:3] * (1.0 + unknown.mass * rng.uniform(-1.0, 1.0))
    off = unknown.center_of_mass * rng.uniform(-1.0, 1.0, 3)
    off = off + unknown.center_of_mass_radius * in_ball(rng)
    push = unknown.force * rng.uniform(-1.0, 1.0, 3) + unknown.force_radius * in_ball(rng)
    turn = unknown.moment * rng.uniform(-1.0, 1.0, 3) + unknown.moment_radius * in_ball(rng)
    moment = problem.external_wrench[3:] + np.cross(off, force) + turn
    return problem.with_changes(external_wrench=np.concatenate([force + push, moment]))


@pytest.mark.parametrize(("name", "affine", "safe", "sampled"), STUDIED)
def test_the_figures_of_the_study(name, affine, safe, sampled, monkeypatch):
    """Its one policy for a box of wrenches; with the corners of mass and centre a tighter one."""
    problem = contacts_alone(name)
    push = Uncertainty(mass=0.2, center_of_mass=0.01, force_radius=0.05 * weight(problem))
    found = solved(problem, push)
    assert found.coverage is Coverage.WHOLE_SET
    assert found.max_torque <= safe * 1.005
    assert found.max_torque >= sampled * 0.995
    # Duals of the policy tell which members bound the torques, and are not unique.
    assert sampled * 0.9 <= found.bound <= found.max_torque * (1.0 + 1e-6)
    # The box around the wrenches of CORNERS; their moments have no part along gravity.
    monkeypatch.setattr(uncertain_members, "MOST_MEMBERS", 1)
    down = problem.external_wrench[:3]
    box = Uncertainty(force=0.2 * np.abs(down), moment=0.012 * (weight(problem) - np.abs(down)))
    assert solved(problem, box).max_torque == pytest.approx(affine, rel=5e-3)
    # With the ball beside it, one policy for all is the study's.
    both = Uncertainty(
        force=0.2 * np.abs(down),
        moment=0.012 * (weight(problem) - np.abs(down)),
        force_radius=0.05 * weight(problem),
    )
    assert solved(problem, both).max_torque == pytest.approx(safe, rel=5e-3)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("paper/cuboid_at_rest", {"force_radius": 0.4, "mass": 0.1}),
        ("paper/cuboid_at_rest", {"center_of_mass_radius": 0.008, "moment_radius": 0.01}),
        ("allegro_mug_against_wall", {"center_of_mass_radius": 0.008, "mass": 0.2}),
        ("allegro_box_on_slope", {"force_radius": 0.3, "moment_radius": 0.003}),
    ],
)
def test_drawn_members_of_balls_balance(name, given):
    problem, unknown = contacts_alone(name), Uncertainty(**given)
    found = solved(problem, unknown, 0.02)
    assert found.found
    assert found.bound <= found.max_torque * (1.0 + 1e-6)
    assert found.bound >= 0.97 * found.max_torque
    rng = np.random.default_rng(2)
    members = [pushed(problem, rng, unknown) for _ in range(15)]
    assert max(imbalance(one, found.torques) for one in members) < BALANCED
    alone = minimize_torque(problem, 0.0, static_friction="coulomb").torques
    assert max(imbalance(one, alone) for one in members) > BALANCED


@pytest.mark.parametrize("most_errors", [0, 8])
def test_the_policy_is_what_it_says(most_errors, monkeypatch):
    monkeypatch.setattr(uncertain_members, "MOST_ERRORS", most_errors)
    problem = contacts_alone("paper/cuboid_at_rest")
    unknown = Uncertainty(mass=0.1, force_radius=0.3, torque=0.03, torque_offset=0.01)
    found = solved(problem, unknown)
    policy = found.policy
    rng = np.random.default_rng(3)
    ball = policy.unknowns.balls
    for _ in range(20):
        corner = int(rng.integers(len(policy.corners)))
        d = policy.unknowns.worst(rng.normal(size=len(ball)))
        member = policy.member(corner, d)
        forces = policy.forces[corner] + policy.slopes[corner] @ d
        off = problem.W @ forces.ravel() + member.problem.external_wrench
        np.testing.assert_allclose(off, 0.0, atol=1e-9)
        own = policy.corners[corner]
        made = own.factors * found.torques + own.offsets + policy.errors @ d
        np.testing.assert_allclose(problem.J.T @ forces.ravel(), made, atol=1e-9)
        assert member.problem.margin_of(forces) >= found.margin - 1e-9
    assert found.margin == pytest.approx(0.1, abs=1e-6)
    assert policy.residual() < 1e-9
    assert "affine" in str(found)
    assert f"{found.bound:.6g}" in str(found)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"force_radius": 0.4, "mass": 0.1}, "mass +10 %, force ["),
        ({"force_radius": 0.4}, "force ["),
    ],
)
def test_the_member_that_needs_the_torques_most_comes_first_and_says_what_it_is(given, words):
    """Here it needs nearly all of them by itself."""
    found = solved(contacts_alone("paper/cuboid_at_rest"), Uncertainty(**given), 0.02)
    first = found.policy.critical(1)[0]
    assert first.words.startswith(words)
    alone = minimize_torque(join_members([first]), 0.02, static_friction="coulomb")
    assert alone.max_torque == pytest.approx(found.max_torque, rel=1e-2)


def few_joints():
    """Three fingertips around a disc that lies on a plane, two joints each along x and y."""
    angles = 2.0 * np.pi * np.arange(3) / 3.0 + 0.3
    ring = np.array([np.cos(angles), np.sin(angles), 0.0 * angles]).T
    tips, floor = 0.05 * ring, 0.04 * ring + np.array([0.0, 0.0, -0.05])
    jacobian = np.zeros((18, 6))
    for tip in range(3):
        jacobian[3 * tip : 3 * tip + 2, 2 * tip : 2 * tip + 2] = 0.1 * np.eye(2)
    return QuasistaticProblem(
        np.vstack([tips, floor]), np.vstack([-ring, np.tile([0.0, 0.0, 1.0], (3, 1))]),
        [0.4, 0.2, -4.0, 0.0, 0.0, 0.0], jacobian, friction=0.7, cone_edges=8,
    )  # fmt: skip


@pytest.mark.parametrize(
    "given", [{"torque": 0.1}, {"torque": 0.05, "torque_offset": [0.004, 0.004, 0, 0, 0, 0]}]
)
def test_affine_forces_are_no_better_than_all_corners(given, monkeypatch):
    problem = few_joints()
    nominal = minimize_torque(problem, 0.1, static_friction="coulomb").max_torque
    exact = solved(problem, Uncertainty(**given))
    assert exact.found
    assert exact.policy is None
    monkeypatch.setattr(uncertain_members, "MOST_MEMBERS", 1)
    affine = solved(problem, Uncertainty(**given))
    assert affine.policy is not None
    assert affine.max_torque >= exact.max_torque * (1.0 - 1e-6)
    assert affine.bound <= exact.max_torque * (1.0 + 1e-6)
    assert exact.max_torque > 1.01 * nominal
    assert affine.max_torque <= 1.05 * exact.max_torque


def test_an_interval_alone_is_served_as_by_its_ends(monkeypatch):
    """Forces of one interval's members are means of two: affine ones lose nothing."""
    problem = contacts_alone("paper/cuboid_at_rest")
    for unknown in (Uncertainty(force=(0.4, 0.0, 0.0)), Uncertainty(torque=[0.08, 0.0])):
        exact = solved(problem, unknown)
        with monkeypatch.context() as patched:
            patched.setattr(uncertain_members, "MOST_MEMBERS", 1)
            affine = solved(problem, unknown)
        assert affine.policy is not None
        assert affine.max_torque == pytest.approx(exact.max_torque, rel=1e-6)


def test_errors_of_many_joints_with_feedback(monkeypatch):
    monkeypatch.setattr(uncertain_members, "MOST_MEMBERS", 1000)
    problem = contacts_alone("allegro_box_on_slope")
    unknown = Uncertainty(torque=0.05)
    assert not solved(problem, unknown, 0.05).found
    found = solved(problem, unknown, 0.05, feedback=1.0)
    assert found.found
    assert len(found.policy.unknowns.balls) == 12
    assert found.bound >= 0.95 * found.max_torque
    rng = np.random.default_rng(4)
    directions = found.policy.directions
    for _ in range(10):
        # Commands N z are free: what a joint makes of them is off by the same share.
        factors = 1.0 + 0.05 * rng.choice([-1.0, 1.0], problem.joint_count)
        off = imbalance(problem, factors * found.torques, factors[:, None] * directions)
        assert off < BALANCED


def test_a_motion_that_no_contact_resists_bears_no_ball():
    problem = contacts_alone("allegro_sphere_on_slope")
    found = solved(problem, Uncertainty(force_radius=0.05))
    assert found.status is Status.INFEASIBLE_FORCES
    assert len(found.conflict) == 2
    held = solved(problem, Uncertainty(force_radius=0.05), feedback=1.0)
    assert held.found
    assert held.max_torque >= held.bound * (1.0 - 1e-6)


def test_least_torques_of_nothing_reach_their_bound():
    """A box on a floor bears small pushes by itself: zero to rounding is not left open."""
    corners = [[x, y, -0.03] for x in (-0.03, 0.03) for y in (-0.03, 0.03)]  # m
    problem = QuasistaticProblem(
        positions=[*corners, [0.0, 0.0, 0.03]],
        normals=[[0.0, 0.0, 1.0]] * 4 + [[0.0, 0.0, -1.0]],
        friction=0.5,
        external_wrench=[0.0, 0.0, -3.0, 0.0, 0.0, 0.0],
        jacobian=np.eye(15, 1, -14),
        torque_limits=([-5.0], [5.0]),
    )
    found = solved(problem, Uncertainty(force_radius=0.2), margin=0.0)
    assert found.max_torque == pytest.approx(0.0, abs=1e-6)
    assert found.status is Status.OPTIMAL


def test_the_largest_margin_of_a_ball():
    problem = contacts_alone("paper/cuboid_at_rest")
    unknown = Uncertainty(force_radius=0.4)
    found = maximize_margin(problem, static_friction="coulomb", uncertainty=unknown)
    alone = maximize_margin(problem, static_friction="coulomb").margin
    assert found.margin < alone
    assert found.margin <= found.bound * (1.0 + 1e-6)
    assert found.margin >= 0.95 * found.bound
    refused = maximize_margin(
        problem, static_friction="coulomb", uncertainty=Uncertainty(force_radius=40.0)
    )
    assert not refused.found


def test_other_rules_need_one_mode():
    problem = contacts_alone("paper/cuboid_at_rest", 8)
    unknown = Uncertainty(mass=0.05, force_radius=0.05)
    found = minimize_torque(problem, 0.02, uncertainty=unknown)
    assert found.found
    # In each contact with a cone, friction opposes one virtual sliding for all d.
    policy, rng = found.policy, np.random.default_rng(6)
    assert policy is not None
    signs = []
    for _ in range(20):
        d = policy.unknowns.worst(rng.normal(size=len(policy.unknowns.balls)))
        forces = policy.forces[0] + policy.slopes[0] @ d
        friction = np.einsum("lij,li->lj", problem.tangents, forces)
        signs.append(np.sign(np.where(np.abs(friction) < 1e-6, 0.0, friction)))
    assert (np.max(signs, axis=0) - np.min(signs, axis=0)).max() < 2.0
    coulomb = solved(problem, unknown, 0.02)
    assert found.max_torque >= coulomb.max_torque * (1.0 - 1e-6)


def test_an_answer_to_the_program_of_another_mode_is_refused(monkeypatch):
    """Forces that balance inside all cones, with friction along the sliding instead of against."""
    problem = contacts_alone("paper/cuboid_at_rest")
    unknown = Uncertainty(mass=0.05, force_radius=0.05)
    mode = minimize_torque(problem, 0.02).mode
    honest, answers = SparseConic.solve, []

    def solve(program, time_limit=None):
        answers.append(honest(program, time_limit))
        return answers[0]

    monkeypatch.setattr(SparseConic, "solve", solve)
    assert minimize_torque(problem, 0.02, mode=mode, uncertainty=unknown).policy is not None
    turned = SlidingMode(mode.selection, -mode.signs)
    found = minimize_torque(problem, 0.02, mode=turned, uncertainty=unknown)
    assert len(answers) > 1  # it was asked again, and told the first answer
    assert found.policy is None
    assert not found.found


def test_cones_shares_and_modes_of_balls():
    problem = contacts_alone("paper/cuboid_at_rest")
    unknown = Uncertainty(mass=0.05, force_radius=0.05)
    edges = solved(problem, unknown)
    # Round cones are served by the pyramids inside of them, and may bear less.
    found = solved(problem.with_changes(cone="round"), unknown)
    assert found.max_torque == pytest.approx(edges.max_torque, rel=1e-6)
    assert found.bound < edges.bound
    share = solved(problem, unknown, scale="limits")
    limits = np.minimum(problem.upper_torque, -problem.lower_torque)
    assert share.policy.value(share.solution.objective) == pytest.approx(
        np.abs(share.torques / limits).max(), rel=1e-6
    )
    assert share.bound == pytest.approx(np.abs(share.torques / limits).max(), rel=1e-3)
    mode = minimize_torque(problem, 0.02).mode
    given = minimize_torque(problem, 0.02, mode=mode, uncertainty=unknown)
    assert given.found
    free = minimize_torque(problem, 0.02, uncertainty=unknown)
    assert free.bound <= given.max_torque * (1.0 + 1e-6)


def test_the_time_ends_a_search_among_many_corners():
    """384 corners and ten balls: with time enough forces are not found, and UNVERIFIED says so."""
    scene = load_scene("examples/paper/cuboid_at_rest.yaml")
    small = {"force": 0.002, "moment": 0.002, "torque_offset": 0.002, "tilt": 0.002}
    unknown = Uncertainty(mass=0.1, torque=0.1, center_of_mass=0.002, **small)
    options = {"margin": 0.1, "static_friction": "coulomb", "uncertainty": unknown}
    found = scene.solve("torque", time_limit=0.2, **options)
    assert found.status is Status.NOT_FOUND_IN_LIMIT
    assert not found.found
    assert found.conflict == ()
    assert "no torques for the whole set" in str(found)


def test_what_balls_do_not_go_with():
    problem = contacts_alone("paper/cuboid_at_rest")
    unknown = Uncertainty(force_radius=0.1)
    with pytest.raises(ArgumentError, match="regularization"):
        optimize(problem, Torque(0.1, 1e-3), uncertainty=unknown)
    with pytest.raises(ArgumentError, match="force_radius"):
        Uncertainty(force_radius=-1.0)
    with pytest.raises(ArgumentError, match="center_of_mass_radius"):
        Uncertainty(center_of_mass_radius=np.nan)
    with pytest.raises(ArgumentError, match="boxes instead of balls"):
        uncertainty_gradients(solved(problem, unknown))


def test_a_scene_turns_the_centre_of_mass_with_the_object():
    """A ball is the same in all axes, and holds the box that is inside of it."""
    scene = load_scene("examples/paper/cuboid_at_rest.yaml")
    options = {"margin": 0.05, "static_friction": "coulomb"}
    ball = scene.solve("torque", uncertainty=Uncertainty(center_of_mass_radius=0.004), **options)
    inside = Uncertainty(center_of_mass=0.004 / np.sqrt(3.0))
    box = scene.solve("torque", uncertainty=inside, **options)
    around = scene.solve("torque", uncertainty=Uncertainty(center_of_mass=0.004), **options)
    assert box.max_torque <= ball.max_torque * (1.0 + 1e-6)
    assert ball.bound <= around.max_torque * (1.0 + 1e-6)
    assert CORNERS.scaled(0.5).mass == pytest.approx(0.1)
