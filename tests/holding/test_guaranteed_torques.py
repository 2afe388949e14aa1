"""Torques of which rest is the only outcome: in slots whose best case may drop the box."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from cases import GRAVITY, block_between_walls, pressed_in_slot, pressed_on_wall
from tests.simulation.holding_scenes import holding_scenes

from graspless_pin import (
    Evaluator,
    QuasistaticProblem,
    Scene,
    Stability,
    Status,
    TorqueSolution,
    Waypoint,
    contact_force_bounds,
    disturbance_margin,
    evaluate_path,
    explain,
    load_scene,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
    minimum_friction,
    optimize,
    optimum_gradients,
    stability,
)
from graspless_pin.algorithms import guaranteed_torques
from graspless_pin.algorithms.guaranteed_torques import half_space, weaker_supports
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.holding.small_motions import RestModel
from graspless_pin.holding.stability import undecided_verdict
from graspless_pin.programs.analysis_objectives import InsideHalfSpaces
from graspless_pin.programs.objectives import Margin, Objective, Torque
from graspless_pin.report import read_solution, solution_document

CUBOID = "examples/paper/cuboid_at_rest.yaml"


@pytest.fixture(scope="module")
def slot() -> Scene:
    (scene,) = holding_scenes("slot", 1)
    return scene


@pytest.fixture(scope="module")
def best(slot: Scene) -> TorqueSolution:
    return slot.solve("margin")


@pytest.fixture(scope="module")
def strong(slot: Scene) -> TorqueSolution:
    return slot.solve("margin", stability="strong", verdict_nodes=100)


def is_strong(problem: QuasistaticProblem, solution: TorqueSolution) -> bool:
    return stability(problem, solution.torques).status is Stability.STRONG


def test_the_best_case_in_a_slot_may_fail_and_guaranteed_torques_do_not(
    best: TorqueSolution, strong: TorqueSolution
) -> None:
    problem = best.problem
    assert stability(problem, best.torques).status is Stability.WEAK
    assert strong.status is Status.STRONG
    assert is_strong(problem, strong)
    assert strong.guarantee is not None
    assert strong.guarantee.verdict is not None
    np.testing.assert_array_equal(strong.guarantee.verdict.torques, strong.torques)
    assert strong.guarantee.tried > 1


def test_the_certificate_states_both_gaps(best: TorqueSolution, strong: TorqueSolution) -> None:
    assert strong.guarantee is not None
    assert strong.guarantee.best_case == pytest.approx(best.margin, rel=1e-9)
    assert 0.0 < strong.margin < best.margin
    assert strong.value == pytest.approx(strong.margin, rel=1e-12)
    assert strong.guarantee.gap == pytest.approx(best.margin - strong.margin, rel=1e-9)
    assert strong.certificate.bound == best.certificate.bound
    assert strong.certificate.gap == pytest.approx(best.certificate.bound - strong.margin, rel=1e-9)
    assert f"N from the best case ({best.margin:.5f} N)" in str(strong)


def test_the_forces_are_the_best_of_the_torques(strong: TorqueSolution) -> None:
    """Forces of the problem's own cones, with the largest margin that these torques leave open."""
    problem = strong.problem
    unbalanced = problem.W @ strong.contact_forces.ravel() + problem.external_wrench
    assert np.abs(unbalanced).max() < 1e-9 * problem.scales.force
    ranges = contact_force_bounds(problem, strong.torques, static_friction="coulomb")
    assert strong.margin <= ranges.largest_margin + 1e-6
    assert strong.margin == pytest.approx(ranges.largest_margin, rel=1e-3)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("solve", [
    maximize_margin, partial(minimize_torque, margin=0.1, scale="limits"),
    partial(minimize_torque, margin=0.0, regularization=1e-4),
])  # fmt: skip
@pytest.mark.parametrize("shares", [guaranteed_torques._SHARES, ()], ids=["guesses", "none"])
def test_a_finger_has_to_press_with_the_weight_where_the_far_wall_may_not(
    solve: Callable[..., TorqueSolution], shares: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By hand: finger and near wall bear mu F each, and with less than 9.81 N the box falls.

    With the guesses that rely on less of the supports' friction, and by counterexamples alone.
    """
    monkeypatch.setattr(guaranteed_torques, "_SHARES", shares)
    problem = pressed_in_slot().with_changes(torque_limits=(0.0, 40.0))
    found = solve(problem, stability="strong", verdict_nodes=100)
    assert found.found
    assert found.torques[0] >= GRAVITY
    assert is_strong(problem, found)
    assert found.guarantee is not None
    assert found.guarantee.gap >= 0.0


@pytest.mark.parametrize("objective", [Margin(), Torque(0.1)])
def test_each_guess_is_made_once_and_the_margin_is_among_them(objective: Objective) -> None:
    """With less and less friction at both walls, down to none, and all of the finger's."""
    problem = pressed_in_slot()
    guesses = list(weaker_supports(problem, objective))
    frictions = np.array([weaker.friction for weaker, _ in guesses])
    made = {(aim, *friction) for (_, aim), friction in zip(guesses, frictions, strict=True)}
    assert len(made) == len(guesses)
    assert [aim for aim, *_ in made if aim == Margin()]
    assert (frictions[:, 4] == problem.friction[4]).all()
    walls = np.delete(frictions, 4, axis=1)
    for aim in (objective, Margin()):
        own = np.array([one == aim for _, one in guesses])
        assert walls[own].min() == walls[own][-1].max() == 0.0


def test_less_than_the_weight_needs_luck_and_the_best_case_asks_for_little() -> None:
    problem = pressed_in_slot().with_changes(torque_limits=(0.0, 40.0))
    falls = stability(problem, [0.99 * GRAVITY])
    assert falls.status is Stability.WEAK
    assert minimize_torque(problem, 0.1).torques[0] < 0.1 * GRAVITY


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_counterexamples_lead_to_torques(
    slot: Scene, best: TorqueSolution, monkeypatch: pytest.MonkeyPatch, seed: int | None
) -> None:
    """Without the guesses that rely on less of the supports' friction, too.

    Which motion is met first hangs on rounding: figures that differ by as much change nothing.
    """
    monkeypatch.setattr(guaranteed_torques, "_SHARES", ())
    problem = slot.problem()
    if seed is not None:
        noise = 1.0 + 1e-12 * np.random.default_rng(seed).normal(size=problem.contact_count)
        problem = problem.with_changes(friction=noise * problem.friction)
    found = maximize_margin(problem, stability="strong", verdict_nodes=100)
    assert found.status is Status.STRONG
    assert is_strong(problem, found)
    assert found.guarantee is not None
    assert found.guarantee.tried > 1
    assert found.margin < best.margin


def test_a_counterexample_s_half_space_leaves_its_torques_out_by_the_motion_s_power() -> None:
    problem = pressed_in_slot()
    torques = np.array([12.0])
    motion = stability(problem, torques).motion
    assert motion is not None
    normal, side = half_space(problem, motion, 1.0)
    a, joint = motion.object_acceleration, motion.joint_accelerations
    assert problem.object_inertia is not None
    assert problem.joint_inertia is not None
    power = a @ problem.object_inertia @ a + joint @ problem.joint_inertia @ joint
    assert power > 0.1
    assert normal @ torques - side == pytest.approx(power, rel=1e-6)
    assert half_space(problem, motion, 0.5)[1] < side


@pytest.mark.parametrize(("least", "most", "expected"), [(12.0, 40.0, None), (18.0, 19.0, 19.0)])
def test_torques_are_looked_for_well_inside_half_spaces(
    least: float, most: float, expected: float | None
) -> None:
    """The load makes 9.81 N on the joint: 0.3 of that is deep enough."""
    problem = pressed_in_slot().with_changes(torque_limits=(0.0, most))
    inside = InsideHalfSpaces(np.array([[-2.0]]), np.array([-2.0 * least]), 0.3, 0.0)
    torque = optimize(problem, inside, static_friction="coulomb").torques[0]
    assert torque >= least + (0.3 * GRAVITY if expected is None else 0.0) - 1e-6
    assert expected is None or torque == pytest.approx(expected)


def test_torques_that_hold_are_left_as_they_are() -> None:
    problem = pressed_on_wall().with_changes(torque_limits=(0.0, 40.0))
    best, found = maximize_margin(problem), maximize_margin(problem, stability="strong")
    assert found.status is Status.OPTIMAL
    assert found.guarantee is not None
    assert (found.guarantee.tried, found.guarantee.gap) == (1, 0.0)
    np.testing.assert_array_equal(found.torques, best.torques)
    gradients = optimum_gradients(found).values.friction
    np.testing.assert_array_equal(gradients, optimum_gradients(best).values.friction)


def test_gradients_of_guaranteed_torques_that_are_no_optimum_are_refused(
    strong: TorqueSolution,
) -> None:
    with pytest.raises(ArgumentError, match=r"guaranteed torques, .*: solve with stability='weak'"):
        optimum_gradients(strong)
    with pytest.raises(NoSolutionError, match="multipliers"):
        _ = strong.multipliers


def test_where_none_is_found_it_says_whether_that_is_proven() -> None:
    none = maximize_margin(block_between_walls(0.5), static_friction="coulomb", stability="strong")
    assert none.status is Status.INFEASIBLE_STRONG
    assert none.guarantee is not None
    assert none.guarantee.verdict is not None
    assert none.guarantee.verdict.status is Stability.WEAK
    assert "may fail" in none.explanation
    assert "not proven" not in str(explain(none))
    with pytest.raises(NoSolutionError, match="no torques"):
        _ = none.torques
    short = pressed_in_slot().with_changes(torque_limits=(0.0, 5.0))
    assert maximize_margin(short, stability="strong").status is Status.STRONG_NOT_FOUND
    weak = pressed_on_wall().with_changes(torque_limits=(0.0, 1.0))
    assert maximize_margin(weak, stability="strong").status is Status.INFEASIBLE_FORCES


def test_a_scene_that_verdicts_cannot_decide_on_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "graspless_pin.scene.scene_stability.hand_support_contacts", lambda _: (("tip", "wall"),)
    )
    none = load_scene(CUBOID).solve(stability="strong")
    assert none.status is Status.STRONG_NOT_FOUND
    assert "the hand touches supports (tip on wall)" in none.explanation
    said = Evaluator(load_scene(CUBOID), stability="strong").evaluate()
    assert not said.found
    assert said.status.name == "UNDECIDED"


def test_torques_that_few_nodes_left_undecided_are_asked_again_in_their_order() -> None:
    asked = list[tuple[int, float]]()

    def told(problem: QuasistaticProblem, torques: Any, **how: Any) -> Any:
        asked.append((how["node_limit"], float(torques[0])))
        said = undecided_verdict(problem, torques, "too many nodes")
        sure = len(asked) > 1 and how["node_limit"] > 300
        return replace(said, status=Stability.STRONG) if sure else said

    problem = pressed_on_wall().with_changes(torque_limits=(0.0, 40.0))
    options = SolveOptions.parse(stability="strong", verdict_nodes=1000)
    found = solve_problem(problem, Torque(0.1), options, rest=RestModel(verdict=told))
    (_, best), (few, first), *_ = asked
    again = [torque for nodes, torque in asked[1:] if nodes == 1000]
    assert few == 300 and again == [first]
    assert found.status is Status.STRONG
    assert found.torques == pytest.approx([first]) and best != pytest.approx(first)


def test_the_time_limit_is_that_of_the_whole_call(strong: TorqueSolution) -> None:
    none = maximize_margin(strong.problem, stability="strong", time_limit=1e-9)
    assert none.status in (Status.NOT_FOUND_IN_LIMIT, Status.STRONG_NOT_FOUND)


def test_verdict_nodes_bound_each_verdict() -> None:
    problem = pressed_in_slot().with_changes(torque_limits=(0.0, 19.0))
    assert not maximize_margin(problem, stability="strong", verdict_nodes=0).found


@pytest.mark.parametrize(
    "ask",
    [
        lambda problem, **how: contact_force_bounds(problem, [10.0], **how),
        disturbance_margin,
        minimum_friction,
        margin_torque_curve,
    ],
)
def test_what_takes_torques_or_the_best_case_refuses_it(ask: Callable[..., Any]) -> None:
    with pytest.raises(ArgumentError, match=r"stability: is 'strong', but .*; leave it out"):
        ask(pressed_on_wall(), stability="strong")


def test_bad_arguments_are_named() -> None:
    problem = pressed_on_wall().with_changes(torque_limits=(0.0, 40.0))
    mode = maximize_margin(problem).mode
    with pytest.raises(ArgumentError, match="stability: is 'strong', but the argument mode"):
        maximize_margin(problem, mode=mode, stability="strong")
    with pytest.raises(ArgumentError, match="stability"):
        maximize_margin(problem, stability="certain")
    with pytest.raises(ArgumentError, match="verdict_nodes"):
        maximize_margin(problem, stability="strong", verdict_nodes=-1)


def test_an_evaluator_gives_guaranteed_torques_and_verdicts(slot: Scene, strong: Any) -> None:
    evaluator = Evaluator(slot, stability="strong", verdict_nodes=100)
    said = evaluator.evaluate()
    # Which of them the search finds may hang on rounding.
    assert is_strong(strong.problem, said.solution)
    assert said.margin <= strong.guarantee.best_case + 1e-6
    assert said.stability(node_limit=300).status is Stability.STRONG
    assert Evaluator(slot).evaluate().stability().status is Stability.WEAK


def test_a_state_is_feasible_with_guaranteed_torques_alone() -> None:
    evaluator = Evaluator(load_scene(CUBOID), stability="strong")
    best = evaluator.evaluate().margin
    assert evaluator.is_feasible(margin=0.9 * best)
    assert not evaluator.is_feasible(margin=1.1 * best)


def test_paths_give_a_verdict_for_each_state() -> None:
    scene = load_scene(CUBOID)
    profile = evaluate_path(Evaluator(scene, stability="strong"), [Waypoint(), Waypoint()])
    assert [said.status if said is not None else None for said in profile.verdicts()] == [
        Stability.STRONG
    ] * 2
    assert all(item.solution.guarantee is not None for item in profile.evaluations)


def test_documents_keep_what_is_guaranteed(slot: Scene, strong: TorqueSolution) -> None:
    again = read_solution(json.loads(json.dumps(solution_document(strong, slot))))
    assert again.status is Status.STRONG
    assert again.guarantee is not None
    assert strong.guarantee is not None
    assert again.guarantee.gap == strong.guarantee.gap
    np.testing.assert_allclose(again.torques, strong.torques, atol=1e-12)
    assert str(again) == str(strong)
