"""The rule of directions: cases solved by hand, the rule itself, turned tangents and listing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from tests.core.random_scenes import slope_scene
from tests.core.scenes import random_problem, scene
from tests.oracles.directions import listed, solved, turned

from graspless_pin import (
    QuasistaticProblem,
    SolveOptions,
    compare_rules,
    contact_force_bounds,
    disturbance_margin,
    enumerate_modes,
    explain,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
    minimum_friction,
    optimize,
    optimum_gradients,
)
from graspless_pin.algorithms.warm_search import reaches_margin
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.sectors import (
    Exclusion,
    Sector,
    SectorMotions,
)
from graspless_pin.programs.analysis_objectives import HeldMargin
from graspless_pin.solution import Status, TorqueSolution

FLOOR, WALL, WEIGHT, PUSH = 0.2, 0.5, 10.0, 4.0


def corner(turn: float = 0.0) -> QuasistaticProblem:
    """A weight between a floor, a wall (normal y) and a frictionless finger, pushed along x.

    All forces go through the centre of mass. Tangents are turned about the normals.
    """
    normals = np.array([[0.0, 0, 1], [0, 1, 0], [0, -1, 0]])
    first = np.array([[1.0, 0, 0], [1, 0, 0], [1, 0, 0]])
    second = np.cross(normals, first)
    tangents = np.stack([np.cos(turn) * first + np.sin(turn) * second,
                         np.cos(turn) * second - np.sin(turn) * first], axis=2)  # fmt: skip
    jacobian = np.zeros((3, 3, 1))
    jacobian[2, :, 0] = -0.1 * normals[2]
    return QuasistaticProblem(
        np.zeros((3, 3)),
        normals,
        [PUSH, 0.0, -WEIGHT, 0.0, 0.0, 0.0],
        jacobian.reshape(9, 1),
        friction=[FLOOR, WALL, 0.0],
        tangents=tangents,
        torque_limits=([-5.0], [5.0]),
    )


@pytest.mark.sampled(4)
@pytest.mark.parametrize("turn", [0.0, 0.3, 0.8, 2.0])
@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_a_corner_does_not_wedge_whatever_its_tangents(turn, margin):
    """What touches floor and wall slides along x only, and so does its friction."""
    slack = margin * (np.hypot(1.0, FLOOR) + np.hypot(1.0, WALL))
    press = (PUSH - FLOOR * WEIGHT + slack) / WALL
    solution = minimize_torque(corner(turn), margin, sign_rule="direction", direction_gap=1e-6)
    assert solution.max_torque == pytest.approx(0.1 * press, rel=2e-6)
    assert solution.problem.cone == "round"
    torque = solution.certificate.bound
    assert torque <= solution.max_torque <= torque * (1.0 + 1.1e-6)


def test_signs_let_the_corner_wedge_as_its_tangents_are_turned():
    """The case is one in which the rules differ: round cones, but for the signs."""
    straight, askew = (corner(turn).with_changes(cone="round") for turn in (0.0, 0.8))
    press = (PUSH - FLOOR * WEIGHT) / WALL
    exact = [minimize_torque(one, 0.0, sign_rule="exact").max_torque for one in (straight, askew)]
    assert exact[0] == pytest.approx(0.1 * press, rel=1e-6)
    assert exact[1] < 0.97 * exact[0]


def three_in_a_row(**changes: Any) -> VirtualKinematics:
    """Three contacts with a floor, one metre apart, on an object that slides and turns on it."""
    positions = np.array([[-1.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    arguments: dict[str, Any] = {
        "friction": 0.5,
        "tangents": np.tile(np.eye(3)[:, :2], (3, 1, 1)),
        **changes,
    }
    wrench = [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    normals = np.tile([0.0, 0.0, 1.0], (3, 1))
    problem = QuasistaticProblem(positions, normals, wrench, np.zeros((9, 0)), **arguments)
    return VirtualKinematics(problem)


def test_slopes_of_slidings_in_a_row_are_evenly_spaced():
    """There a motion is (v, w) with slidings (v_x, v_y + w x): the middle slope is the mean."""
    motions = SectorMotions(three_in_a_row())
    even = {0: np.arctan(-0.2), 1: np.arctan(0.3), 2: np.arctan(0.8)}
    found = motions.find({one: Sector(angle, 1e-8) for one, angle in even.items()})
    assert not isinstance(found, Exclusion)
    assert motions.opposes(found, even)
    assert motions.directions(found) == pytest.approx(even, abs=1e-7)
    odd = {**even, 1: even[1] + 1e-4}
    assert not motions.opposes(found, odd)
    against = motions.find({one: Sector(angle, 1e-8) for one, angle in odd.items()})
    assert isinstance(against, Exclusion)
    assert against.directed == {0, 1, 2}


@pytest.mark.parametrize("middle", [0.5, 1.2, 2.5])
def test_how_far_sectors_without_a_motion_reach(middle):
    """About slopes 0 and 0 at the ends, the middle one is in reach at half their distance."""
    motions = SectorMotions(three_in_a_row())

    def moves(half: float) -> bool:
        sectors = {0: Sector(0.0, half), 1: Sector(middle, half), 2: Sector(0.0, half)}
        return not isinstance(motions.find(sectors), Exclusion)

    # The mean of two slopes of at most tan(h) reaches the slope tan(middle - h).
    assert not moves(0.999 * middle / 2.0)
    assert moves(1.001 * middle / 2.0)


CASES = [
    *((slope_scene, seed, contacts) for seed, contacts in ((1, 4), (1, 5), (3, 4), (5, 5))),
    *((random_problem, seed, contacts) for seed, contacts in ((0, 4), (2, 4), (1, 6))),
]


@pytest.mark.sampled(6)
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("margin", [None, 0.05])
def test_friction_opposes_the_motion_of_the_answer(case, margin):
    """The rule itself, from the problem's matrices: touching, opposite, and not too slow."""
    family, seed, contacts = case
    solution = solved(family(seed, contacts), margin)
    if not solution.found:
        assert solution.status is Status.INFEASIBLE_MODES
        return
    assert_by_the_rule(solution)


def assert_by_the_rule(solution: TorqueSolution) -> None:
    problem, motion = solution.problem, solution.motion
    assert motion is not None
    velocities = (problem.W.T @ motion[:6] - problem.J @ motion[6:]).reshape(-1, 3)
    size = np.linalg.norm(velocities)
    load = problem.scales.force
    for contact in range(problem.contact_count):
        n, t = problem.normals[contact], problem.tangents[contact]
        friction = t.T @ solution.contact_forces[contact]
        if problem.is_sliding[contact] or np.linalg.norm(friction) < 1e-7 * load:
            continue
        assert solution.mode.selection[contact]
        way = -friction / np.linalg.norm(friction)
        sliding = t.T @ velocities[contact]
        assert abs(n @ velocities[contact]) <= 1e-7 * size
        assert sliding @ way >= 0.99e-6 * size
        assert abs(sliding[0] * way[1] - sliding[1] * way[0]) <= 3e-8 * size
    residual = problem.W @ solution.contact_forces.ravel() + problem.external_wrench
    assert np.abs(residual).max() <= 1e-6 * load
    assert problem.margin_of(solution.contact_forces) >= solution.required_margin - 1e-6 * load


@pytest.mark.sampled(0)
def test_some_cases_are_split_and_some_hang_on_it():
    """So that the cases above look at more than relaxations."""
    nodes, lower = [], 0
    for family, seed, contacts in CASES:
        solution = solved(family(seed, contacts), None)
        free = maximize_margin(solution.problem, static_friction="coulomb")
        nodes.append(solution.certificate.nodes)
        lower += solution.found and solution.margin < 0.99 * free.margin
    assert min(nodes) >= 1
    assert sum(one > 5 for one in nodes) >= 4
    assert lower >= 3


@pytest.mark.sampled(2)
@pytest.mark.parametrize("number", [3, 7, 13, 20, 26])
def test_turned_tangents_change_nothing_beyond_the_gap(number):
    pair = turned(number)
    assert pair.agrees, pair
    assert pair.closed


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [0, 2, 6, 9, 14])
def test_listing_of_sectors_agrees(number):
    one = listed(number)
    assert one.agrees, one


@pytest.mark.sampled(2)
@pytest.mark.parametrize("case", CASES)
def test_directions_allow_no_more_than_exact_signs(case):
    """Opposite vectors have opposite components, and vanish along the same tangents."""
    family, seed, contacts = case
    problem = family(seed, contacts).with_changes(cone="round")
    exact = maximize_margin(problem, sign_rule="exact")
    strictest = solved(problem, None)
    if strictest.found:
        assert strictest.margin <= exact.margin * (1.0 + 1e-6)


@pytest.mark.parametrize("name", ["up", "down"])
def test_sliding_contacts_that_have_to_slide_virtually(name):
    """On the paper's slope, nothing but the push down it is left of what wedging allows."""
    problem = scene(name)
    options: dict[str, Any] = {"sliding_rule": "constrained"}
    solution = maximize_margin(problem, sign_rule="direction", **options)
    exact = maximize_margin(problem.with_changes(cone="round"), sign_rule="exact", **options)
    assert solution.margin == pytest.approx(exact.margin, rel=1e-4)
    assert solution.mode.selection[problem.is_sliding].all()
    assert_by_the_rule(solution)


def test_the_gap_is_what_was_asked_for():
    problem = random_problem(2, 3)
    coarse, fine = (
        maximize_margin(problem, sign_rule="direction", direction_gap=gap) for gap in (1e-1, 1e-3)
    )
    assert coarse.status is fine.status is Status.OPTIMAL
    assert coarse.certificate.nodes < fine.certificate.nodes
    for one, gap in ((coarse, 1e-1), (fine, 1e-3)):
        assert one.certificate.gap == pytest.approx(one.certificate.bound - one.margin)
        assert 0.0 <= one.certificate.gap <= gap * one.margin
    assert fine.margin <= coarse.certificate.bound


def test_a_limit_is_said_with_both_values():
    solution = maximize_margin(random_problem(2, 3), sign_rule="direction", node_limit=20)
    assert solution.status is Status.LIMIT_REACHED
    assert solution.certificate.gap > 1e-4 * solution.margin
    assert f"outer {solution.certificate.bound:.6g} N" in str(solution)
    assert f"inner value {solution.margin:.6g}, " in str(solution)
    assert "round cones" in str(solution)


def test_a_margin_inside_the_gap_is_neither_reached_nor_out_of_reach():
    problem = random_problem(2, 3)
    options = SolveOptions.parse(sign_rule="direction", direction_gap=1e-2)
    best = maximize_margin(problem, sign_rule="direction", direction_gap=1e-2)
    margin, bound = best.margin, best.certificate.bound
    for wanted, reached in ((0.99 * margin, True), (0.5 * (margin + bound), None),
                            (1.01 * bound, False)):  # fmt: skip
        assert reaches_margin(problem, wanted, options)[0] is reached
    early = replace(options, node_limit=0)
    assert reaches_margin(problem, 0.99 * margin, early)[0] is not False


def test_shares_of_the_limits_go_by_directions():
    """Equal limits: the largest share is the largest torque over them."""
    options: dict[str, Any] = {"sign_rule": "direction", "direction_gap": 1e-6}
    share = minimize_torque(corner(0.8), 0.1, scale="limits", **options)
    assert share.value == pytest.approx(minimize_torque(corner(), 0.1, **options).value / 5.0)


def test_coulomb_has_no_rule_and_keeps_the_cones():
    problem = scene("rest")
    options: dict[str, Any] = {"static_friction": "coulomb"}
    one = maximize_margin(problem, sign_rule="direction", **options)
    assert one.problem.cone != "round"
    assert one.margin == pytest.approx(maximize_margin(problem, **options).margin)


def test_the_comparison_has_the_rule_and_says_round():
    text = str(compare_rules(scene("rest"), "torque", margin=0.1))
    lines = [line for line in text.splitlines() if line.startswith("direction")]
    assert [line.split()[2] for line in lines] == ["exempt", "constrained"]
    assert all(line.endswith("round cones") for line in lines)
    enumerated = compare_rules(scene("rest"), search="enumerate")  # has no directions
    assert len(enumerated.solutions) == 7
    both = compare_rules(scene("rest").with_changes(cone="round"))
    assert "round cones" not in str(both)


def test_infeasible_by_directions_is_explained():
    """Weaker rules and smaller margins are tried; other changes are not."""
    solution = minimize_torque(slope_scene(1, 5), 0.05, sign_rule="direction")
    assert solution.status is Status.INFEASIBLE_MODES
    explained = str(explain(solution))  # without the time limit of what is printed
    assert "solving with sign_rule='nonzero'" in explained
    assert "required margin would have to be at most" in explained


def test_contacts_that_leave_no_motion_have_none_along_friction():
    """A wedge on a vertical rail moves only if it leaves its contact: nothing lets friction act."""
    wedge = QuasistaticProblem(
        [[0.0, 0.0, 0.0]], [[0.6, 0.0, 0.8]], [-1.0], friction=0.9, max_normal_force=1.1,
        wrench_matrix=[[0.0, 0.0, 1.0]], passive_units=["N"],
    )  # fmt: skip
    for rule in ("direction", "exact"):
        assert maximize_margin(wedge, sign_rule=rule).status is Status.INFEASIBLE_MODES
    assert maximize_margin(wedge, static_friction="coulomb").found


def test_minimum_friction_goes_by_directions():
    """In the corner without a finger's help, the push needs the floor alone."""
    problem = corner().with_changes(torque_limits=([0.0], [0.0]))
    least = minimum_friction(problem, sign_rule="direction")
    assert least.factor == pytest.approx(PUSH / (FLOOR * WEIGHT), rel=1e-5)


PROBLEM = random_problem(0, 3)


@cache
def found():
    return maximize_margin(PROBLEM, sign_rule="direction", direction_gap=1e-2)


REFUSED = {
    "contact_force_bounds": lambda: contact_force_bounds(
        PROBLEM, found().torques, sign_rule="direction"
    ),
    "disturbance_margin": lambda: disturbance_margin(PROBLEM, sign_rule="direction"),
    "margin_torque_curve": lambda: margin_torque_curve(PROBLEM, sign_rule="direction"),
    "enumerate_modes": lambda: enumerate_modes(PROBLEM, sign_rule="direction"),
    "a gradient": lambda: optimum_gradients(found()),
    "the proof": lambda: found().proof,
    "search='enumerate'": lambda: maximize_margin(
        PROBLEM, sign_rule="direction", search="enumerate"
    ),
    "the argument mode": lambda: maximize_margin(PROBLEM, sign_rule="direction", mode=found().mode),
    "the objective": lambda: optimize(PROBLEM, HeldMargin(found().torques), sign_rule="direction"),
    "a regularisation": lambda: maximize_margin(
        PROBLEM, sign_rule="direction", regularization=1e-3
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_needs_signs_refuses_the_rule_by_name(what):
    with pytest.raises(ArgumentError, match=r"^sign_rule: is 'direction'") as caught:
        REFUSED[what]()
    assert what in str(caught.value)
    assert "'strict', 'exact' or 'nonzero'" in str(caught.value)
