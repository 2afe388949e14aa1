"""Torques for what is not known exactly, against figures, changed scenes and enumerated modes."""

from typing import Any

import numpy as np
import pytest
from tests.core.random_scenes import slope_scene
from tests.oracles.uncertain_members import (
    BALANCED,
    Balance,
    Members,
    drawn,
    imbalance,
    unbalanced,
    yielding,
)
from tests.oracles.uncertain_modes import RULES, objections

from graspless_pin import (
    Controller,
    Coverage,
    QuasistaticProblem,
    Status,
    Uncertainty,
    load_scene,
    maximize_margin,
    minimize_torque,
    served_share,
)
from graspless_pin.algorithms import joined_optimum, robust_torques, uncertain_members
from graspless_pin.algorithms.joined_optimum import member_margins
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.uncertain_members import members_of
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.problem.members import feedback_torques, join_members, under_commands
from graspless_pin.programs.objectives import Torque
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document
from graspless_pin.tree_search import NO_LIMITS, Limits

CORNERS = Uncertainty(mass=0.2, center_of_mass=0.01)


def contacts_alone(name, edges=16):
    problem = load_scene(f"examples/{name}.yaml").problem()
    idle = np.zeros(problem.joint_count)
    return problem.with_changes(cone_edges=edges, gravity_torques=idle)


@pytest.mark.parametrize(
    ("name", "nominal", "robust"),
    [
        ("paper/cuboid_at_rest", 0.882, 1.0532),
        ("allegro_mug_against_wall", 0.0899, 0.14557),
        ("allegro_box_on_slope", 0.0200, 0.02158),
    ],
)
def test_the_least_torques_of_sixteen_corners(name, nominal, robust):
    """Figures of an independent program over all 16 corners."""
    problem = contacts_alone(name)
    alone = minimize_torque(problem, 0.1, static_friction="coulomb")
    found = minimize_torque(problem, 0.1, static_friction="coulomb", uncertainty=CORNERS)
    assert alone.max_torque == pytest.approx(nominal, rel=5e-3)
    assert found.max_torque == pytest.approx(robust, rel=5e-4)
    assert found.bound == pytest.approx(found.max_torque, rel=1e-6)
    assert found.coverage is Coverage.WHOLE_SET
    assert len(found.members) == 8  # the 16 corners are the corners of a hull of 8
    assert found.margin >= 0.1 - 1e-6


def test_an_object_that_rolls_away_is_served_by_feedback_alone():
    problem = contacts_alone("allegro_sphere_on_slope")
    found = minimize_torque(problem, 0.1, static_friction="coulomb", uncertainty=CORNERS)
    assert not found.found
    assert len(found.conflict) == 2
    assert "no torques are feasible for all of these members:" in str(found)
    assert served_share(problem, Torque(0.1), CORNERS, static_friction="coulomb") == 0.0
    held = minimize_torque(
        problem, 0.1, static_friction="coulomb", uncertainty=CORNERS, feedback=1.0
    )
    assert held.max_torque == pytest.approx(0.159, rel=5e-3)
    # The deflections times the stiffness are what differs from the torques that are commanded.
    np.testing.assert_allclose(held.torques - held.deflections, held.commands, atol=1e-12)
    assert len(held.commands) == len(held.contact_forces) <= len(held.members)
    for member, forces, commands in zip(
        held.members, held.contact_forces, held.commands, strict=False
    ):
        made = member.problem.J.T @ forces.ravel() + member.problem.gravity_torques
        np.testing.assert_allclose(made, commands, atol=1e-7)
    stiff = minimize_torque(
        problem, 0.1, static_friction="coulomb", uncertainty=CORNERS, feedback=Controller(2.0)
    )
    np.testing.assert_allclose(stiff.max_torque, held.max_torque, rtol=1e-5)
    with pytest.raises(NoSolutionError, match="feedback"):
        assert minimize_torque(
            contacts_alone("paper/cuboid_at_rest"), 0.1, uncertainty=Uncertainty(mass=0.1)
        ).deflections.any()


def test_the_largest_part_of_a_set_that_is_served():
    problem = contacts_alone("paper/sphere_on_slope")
    share = served_share(problem, Torque(0.1), CORNERS, static_friction="coulomb")
    assert share == pytest.approx(0.84, abs=0.01)
    for scale, served in ((share, True), (share + 0.002, False)):
        found = minimize_torque(
            problem, 0.1, static_friction="coulomb", uncertainty=CORNERS.scaled(scale)
        )
        assert found.found is served


def test_corners_are_the_same_however_small_forces_are():
    problem = contacts_alone("allegro_mug_against_wall")
    small = problem.with_changes(external_wrench=1e-10 * problem.external_wrench)
    counts = [len(members_of(one, CORNERS)) for one in (problem, small)]
    assert counts == [8, 8]


def test_members_in_conflict_are_served_without_any_one_of_them():
    problem = contacts_alone("paper/sphere_on_slope")
    found = minimize_torque(problem, 0.1, static_friction="coulomb", uncertainty=CORNERS)
    conflict = [found.members[number] for number in found.conflict]
    assert not minimize_torque(join_members(conflict), 0.1, static_friction="coulomb").found
    for left_out in range(len(conflict)):
        fewer = [one for number, one in enumerate(conflict) if number != left_out]
        assert minimize_torque(join_members(fewer), 0.1, static_friction="coulomb").found


@pytest.mark.parametrize(
    ("name", "given", "feedback"),
    [
        ("paper/cuboid_at_rest", {"mass": 0.1, "center_of_mass": 0.004, "force": 0.1}, None),
        ("paper/cuboid_at_rest", {"tilt": 0.03, "friction": 0.1}, None),
        ("paper/cuboid_sliding_up", {"friction": 0.15, "mass": 0.1}, None),
        ("allegro_box_on_slope", {"force": (0.2, 0.1, 0.1), "moment": 0.003}, None),
        ("allegro_sphere_on_slope", {"mass": 0.2, "tilt": 0.02}, 1.0),
        ("allegro_mug_against_wall", {"center_of_mass_radius": 0.004, "force_radius": 0.1}, None),
        ("allegro_sphere_on_slope", {"force_radius": 0.05, "tilt": 0.02}, 1.0),
    ],
)
def test_changed_scenes_balance_under_the_torques(name, given, feedback):
    """A slice of `make uncertain`."""
    scene = load_scene(f"examples/{name}.yaml")
    found = scene.solve(
        "torque",
        margin=0.02,
        uncertainty=Uncertainty(**given),
        static_friction="coulomb",
        feedback=feedback,
    )
    assert found.coverage is Coverage.WHOLE_SET
    added = None if feedback is None else yielding(scene.problem())
    assert max(unbalanced(scene, given, found, 15, 3, added)) < BALANCED


def test_the_proof_stands_in_a_document():
    scene = load_scene("examples/allegro_sphere_on_slope.yaml")
    unknown = Uncertainty(mass=0.2, center_of_mass=0.005)
    found = scene.solve(
        "torque", margin=0.05, uncertainty=unknown, static_friction="coulomb", feedback=1.0
    )
    document = solution_document(found.solution)
    assert verify_document(document).proven
    document["contacts"][0]["force"][0] += 0.1
    assert not verify_document(document).passed


def test_members_of_arrays_are_in_balance():
    """All of a wrench counts as weight, off the reference point."""
    given = {"mass": 0.2, "center_of_mass": 0.004, "tilt": 0.03}
    problem = slope_scene(5, 5)
    found = minimize_torque(
        problem, 0.02, uncertainty=Uncertainty(**given), static_friction="coulomb"
    )
    assert np.linalg.norm(problem.external_wrench[3:]) > 0.0
    assert unbalanced(problem, given, found, 60, 5).max() < BALANCED


def test_nominal_torques_do_not_serve_the_corners():
    """So the tests above can fail; edges tried for many members say the same as for each."""
    scene = load_scene("examples/paper/cuboid_at_rest.yaml")
    torques = scene.solve("torque", margin=0.02, static_friction="coulomb").torques
    rng = np.random.default_rng(0)
    given = {"mass": 0.2, "center_of_mass": 0.01}
    some, members = [drawn(scene.gravity, 6, given, rng) for _ in range(40)], Members(scene)
    off = np.array([imbalance(one.problem(scene), torques) for one in some])
    wrenches, carried = map(np.array, zip(*map(members.load, some), strict=True))
    problem = scene.problem()
    many = Balance(problem).offs(problem.friction, wrenches, torques - carried)
    assert off.max() > 1e-3 and 5 < (off < BALANCED).sum() < 35
    np.testing.assert_array_equal(many < BALANCED, off < BALANCED)


def test_errors_of_torques_are_borne():
    problem = contacts_alone("paper/cuboid_at_rest")
    unknown = Uncertainty(torque=0.1, torque_offset=0.02)
    found = minimize_torque(problem, 0.05, static_friction="coulomb", uncertainty=unknown)
    rng = np.random.default_rng(1)
    for _ in range(20):
        factors = 1.0 + 0.1 * rng.uniform(-1.0, 1.0, 2)
        offsets = 0.02 * rng.uniform(-1.0, 1.0, 2)
        assert imbalance(problem, factors * found.torques + offsets) < BALANCED
    alone = minimize_torque(problem, 0.05, static_friction="coulomb")
    assert found.max_torque > 1.05 * alone.max_torque


@pytest.mark.parametrize(
    ("seed", "rule"), [(49, 0), (49, 2), (40, 1), (40, 3), (21, 0), (34, 4), (58, 0)]
)
def test_modes_of_all_corners_and_of_each_against_all_of_them(seed, rule):
    """A slice of `make uncertain`."""
    told, wrong = objections(seed, RULES[rule], 400)
    assert not wrong, told


def test_the_best_common_mode_of_the_cuboid_lies_above_what_bounds_all_modes():
    """1.173 was the best of the modes of each corner's own optimum."""
    problem = contacts_alone("paper/cuboid_at_rest")
    found = minimize_torque(problem, 0.1, uncertainty=CORNERS)
    assert found.coverage is Coverage.WHOLE_SET
    assert found.max_torque == pytest.approx(1.14838, rel=1e-4)
    assert found.bound == pytest.approx(1.0815, rel=1e-4)
    either = minimize_torque(problem, 0.1, uncertainty=CORNERS, sign_rule="direction", node_limit=6)
    assert either.coverage is Coverage.CORNERS
    assert either.bound <= either.max_torque


def two_sliding_contacts(friction):
    """Two contacts that slide in opposite ways, on two coordinates that no motor holds.

    With one coefficient for both, forces exist up to 0.2 and from 0.5 on, up to 0.7.
    """
    across = np.array([[0.0, 1.0, 0.0]] * 2)
    return QuasistaticProblem(
        [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]],
        [[0.0, 0.0, 1.0]] * 2,
        [0.0, -1.0],
        friction=friction,
        sliding=across,
        wrench_matrix=[[0.0, 0.0, 1.0, 0.0, -1.0, -0.7], [0.0, 1.0, 0.0, 0.0, 0.0, 0.1]],
        passive_units=["N", "N"],
        max_normal_force=1e3,
    )


def test_both_ends_of_one_coefficient_prove_nothing_between_them():
    for coefficient, balanced in ((0.1, True), (0.19, True), (0.35, False), (0.6, True)):
        assert maximize_margin(two_sliding_contacts(coefficient)).found is balanced
    wide = maximize_margin(two_sliding_contacts(0.35), uncertainty=Uncertainty(friction=0.7))
    assert not wide.found
    narrow = maximize_margin(two_sliding_contacts(0.12), uncertainty=Uncertainty(friction=0.1))
    assert narrow.found
    assert narrow.coverage is Coverage.WHOLE_SET


@pytest.mark.parametrize("at_once", [1, 2])
def test_feedback_of_all_members_stays_within_the_largest_torque(at_once, monkeypatch):
    """Whichever members the search begins with."""
    monkeypatch.setattr(robust_torques, "_AT_ONCE", at_once)
    problem, unknown = contacts_alone("trihand_push_box", 8), Uncertainty(mass=0.1)
    found = minimize_torque(
        problem, 0.03, static_friction="coulomb", uncertainty=unknown, feedback=1.0
    )
    directions = feedback_torques(problem, np.ones(problem.joint_count))
    together = minimize_torque(
        join_members(found.members, directions), 0.03, static_friction="coulomb"
    )
    assert found.max_torque == pytest.approx(together.max_torque, rel=1e-5)


def test_what_an_answer_says():
    problem = contacts_alone("paper/sphere_on_slope")
    refused = minimize_torque(problem, 0.1, static_friction="coulomb", uncertainty=CORNERS)
    assert "feedback=" in str(refused)
    weak = Uncertainty(effort=0.99)
    alone = minimize_torque(problem, 0.1, static_friction="coulomb", uncertainty=weak)
    assert "this member alone is infeasible:\n  effort limits -99 %" in str(alone)
    cuboid = contacts_alone("paper/cuboid_at_rest")
    found = minimize_torque(cuboid, 0.1, static_friction="coulomb", uncertainty=CORNERS)
    assert list(found.torques_by_joint.values()) == found.torques.tolist()
    assert "proven for the whole set" in str(found)
    assert all(name in str(found) for name in cuboid.joint_names)
    wrong = Uncertainty(torque=[0.0, 0.99], torque_offset=[0.0, 20.0])
    said = str(minimize_torque(cuboid, 0.1, static_friction="coulomb", uncertainty=wrong))
    assert f"torques of {cuboid.joint_names[1]} " in said
    assert f"torques of {cuboid.joint_names[0]} " not in said


def test_time_that_is_over_finds_nothing():
    problem = contacts_alone("allegro_mug_against_wall", 8)
    unknown = Uncertainty(mass=0.1, center_of_mass=0.004, force=0.2, moment=0.01)
    found = minimize_torque(
        problem, 0.05, static_friction="coulomb", uncertainty=unknown, time_limit=0.0
    )
    assert found.status is Status.NOT_FOUND_IN_LIMIT
    assert np.isnan(found.max_torque)


def test_a_set_without_width_is_the_nominal_problem():
    problem = contacts_alone("allegro_mug_against_wall", 8)
    alone = maximize_margin(problem, static_friction="coulomb")
    found = maximize_margin(problem, static_friction="coulomb", uncertainty=Uncertainty())
    assert len(found.members) == 1
    assert found.margin == pytest.approx(alone.margin, rel=1e-6)


@pytest.mark.parametrize("cone", ["edges", "round"])
def test_more_members_than_are_solved_at_once_are_all_served(cone):
    problem = contacts_alone("paper/cuboid_at_rest", 8).with_changes(cone=cone)
    unknown = Uncertainty(mass=0.1, center_of_mass=0.004, force=0.2, moment=0.01)
    found = minimize_torque(problem, 0.05, static_friction="coulomb", uncertainty=unknown)
    assert len(found.members) > len(found.contact_forces)
    together = minimize_torque(join_members(found.members), 0.05, static_friction="coulomb")
    assert found.max_torque == pytest.approx(together.max_torque, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "size", "feedback"),
    [("paper/cuboid_at_rest", 0.4, False), ("allegro_sphere_on_slope", 0.03, True)],
)
def test_margins_of_members_are_those_of_a_solve_of_each(name, size, feedback):
    """With errors of torques, which change a member's matrices, and torques that serve not all."""
    problem = contacts_alone(name, 8)
    last = np.eye(problem.joint_count)[-1]
    unknown = Uncertainty(mass=0.4, center_of_mass=size, torque_offset=0.01 * last)
    members = [*members_of(problem, unknown), *members_of(problem, Uncertainty(torque=0.05 * last))]
    directions = feedback_torques(problem, np.ones(len(last))) if feedback else None
    options = SolveOptions.parse(static_friction="coulomb")
    torques = minimize_torque(problem, 0.1, static_friction="coulomb").torques
    found = member_margins(members, torques, options, NO_LIMITS, directions=directions)
    alone = [
        maximize_margin(under_commands(one, torques, directions), static_friction="coulomb").margin
        for one in members
    ]
    served = np.isfinite(alone)
    assert served.any()
    assert not served.all()
    np.testing.assert_allclose(found[served], np.array(alone)[served], atol=1e-6)
    assert (found[~served] < 0.0).all()


def test_members_that_differ_in_their_loads_alone_need_no_solve_of_their_own(monkeypatch):
    """A few pivots lead from one to the next."""
    problem = contacts_alone("paper/cuboid_at_rest", 8)
    torques = minimize_torque(problem, 0.1, static_friction="coulomb").torques
    options = SolveOptions.parse(static_friction="coulomb")
    monkeypatch.setattr(joined_optimum, "solve_problem", None)
    members = members_of(problem, Uncertainty(mass=0.01))
    assert len(members) > 1
    assert (member_margins(members, torques, options, NO_LIMITS) > 0.0).all()


def test_no_program_is_made_of_members_for_which_there_is_no_time(monkeypatch):
    """Errors of torques leave thousands of members with a program of their own."""
    monkeypatch.setattr(joined_optimum, "formulate", None)
    problem = contacts_alone("paper/cuboid_at_rest", 8)
    members = members_of(problem, Uncertainty(torque=0.05))
    torques, options = np.zeros(problem.joint_count), SolveOptions.parse(static_friction="coulomb")
    found = member_margins(members, torques, options, Limits.from_now(None, 0.0))
    assert np.isnan(found).all()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"mass": -0.1}, "mass"),
        ({"mass": 1.0}, "below 1"),
        ({"effort": 1.0}, "effort.*below 1"),
        ({"center_of_mass": [0.1, 0.2]}, "center_of_mass"),
        ({"tilt": 1.0}, "45 degrees"),
        ({"friction": [0.1]}, "6 contacts"),
        ({"torque": [0.1, 0.1, 0.1]}, "2 joints"),
        ({"force": np.nan}, "force"),
    ],
)
def test_what_is_no_uncertainty(given, words):
    problem = contacts_alone("paper/cuboid_at_rest")
    with pytest.raises(ArgumentError, match=words):
        maximize_margin(problem, uncertainty=Uncertainty(**given))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_motors_that_lack_effort_have_so_much_less(way):
    """Of limits below one newton metre, on either side."""
    problem = contacts_alone("paper/sphere_on_slope")
    problem = problem.with_changes(jacobian=way * problem.jacobian, torque_limits=(-0.75, 0.75))
    weaker = problem.with_changes(torque_limits=(-0.6, 0.6))
    lacking = Uncertainty(effort=0.2)
    found = maximize_margin(problem, static_friction="coulomb", uncertainty=lacking)
    wanted = maximize_margin(weaker, static_friction="coulomb")
    assert found.margin == pytest.approx(wanted.margin, rel=1e-6)
    assert found.margin < 0.99 * maximize_margin(problem, static_friction="coulomb").margin
    one_way = problem.with_changes(torque_limits=(way * np.array([0.65, 0.75])[:: int(way)]))
    with pytest.raises(ArgumentError, match=r"effort.*no torque.*N m"):
        maximize_margin(one_way, uncertainty=lacking)


def test_what_does_not_go_with_uncertainty(monkeypatch):
    problem = contacts_alone("paper/cuboid_at_rest")
    alone: Any = {"feedback": 1.0}
    share: Any = 0.2
    with pytest.raises(ArgumentError, match="uncertainty"):
        maximize_margin(problem, **alone)
    with pytest.raises(ArgumentError, match="uncertainty"):
        load_scene("examples/paper/cuboid_at_rest.yaml").solve(feedback=1.0)
    with pytest.raises(ArgumentError, match="Uncertainty"):
        maximize_margin(problem, uncertainty=share)
    with pytest.raises(ArgumentError, match="stability"):
        maximize_margin(problem, uncertainty=CORNERS, stability="strong")
    with pytest.raises(ArgumentError, match="stiffness"):
        maximize_margin(problem, uncertainty=CORNERS, feedback=Controller())
    monkeypatch.setattr(uncertain_members, "MOST_MEMBERS", 100)
    with pytest.raises(ArgumentError, match="384 corners"):
        unknown = Uncertainty(mass=0.1, center_of_mass=0.01, tilt=0.1)
        load_scene("examples/allegro_box_on_slope.yaml").solve(uncertainty=unknown, feedback=1.0)
    with pytest.raises(ArgumentError, match="links' weight"):
        heavy = problem.with_changes(gravity_torques=[0.1, 0.0])
        maximize_margin(heavy, uncertainty=Uncertainty(tilt=0.1))
