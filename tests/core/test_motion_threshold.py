"""One rule for what counts as a virtual motion, and answers that say when they hang on it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scenes import slope_scene
from scenes import scene, slider

from graspless_pin import (
    Status,
    TorqueSolution,
    enumerate_modes,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms.formulation import shared_parts
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.warm_search import solve_from
from graspless_pin.modes import kinematics
from graspless_pin.modes.kinematics import (
    THRESHOLD,
    VirtualKinematics,
    kinematics_of,
    requirements_of,
)
from graspless_pin.modes.rules import Conflict, Requirement, Rules, SignRule, SlidingMode, Witness
from graspless_pin.programs.objectives import Margin

LINED_UP, TURNED = 0.030667, 0.270491
"""Margins with tangents along the only motion, and with tangents that it slides along both of."""


def slowest(turn: float) -> float:
    """The slower component at each contact over all velocities of the motion along x."""
    return abs(np.sin(turn)) / np.sqrt(5.0)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("turn", [0.0, 1e-8, 1e-7, 1e-6, 1.1e-6, 2.3e-6, 3.67e-6, 1e-5, 1e-4, 1e-3])
def test_all_searches_go_by_one_rule(turn):
    problem = slider(turn)
    auto, listed = maximize_margin(problem), maximize_margin(problem, search="enumerate")
    counts = slowest(turn) >= THRESHOLD
    for solution in (auto, listed):
        assert solution.status is Status.OPTIMAL
        assert solution.margin == pytest.approx(TURNED if counts else LINED_UP, rel=1e-2)
    assert auto.certificate.threshold_optima == pytest.approx(
        listed.certificate.threshold_optima, abs=1e-6
    )
    mode = SlidingMode([True] * 5, [[1, -1]] * 5)
    assert any(other == mode for other in enumerate_modes(problem, maximal=True)) == counts
    alone = maximize_margin(problem, mode=mode)
    expected = Status.OPTIMAL_IN_MODE if counts else Status.INFEASIBLE_MODE
    assert alone.status is expected
    objective, rules = Margin(), Rules.parse()
    _, start = solve_from(slider(1e-2), objective, SolveOptions(rules))
    warm, _ = solve_from(problem, objective, SolveOptions(rules), start)
    assert warm.margin == pytest.approx(auto.margin, abs=1e-6)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("turn", [0.0, 1e-8, 3e-7, 1e-6, 3.67e-6, 1e-5, 2e-5, 3e-5, 1e-3])
def test_an_answer_near_the_threshold_says_so(turn):
    """Typing 1.5708 for a right angle is 3.67e-6 rad off, and nine times the margin."""
    solution = maximize_margin(slider(turn))
    share = slowest(turn) / THRESHOLD
    told = solution.certificate.threshold_optima
    assert (told is not None) == (0.1 <= share < 10.0)
    assert ("depends on the threshold of virtual motion" in str(solution)) == (told is not None)
    if told is not None:
        assert told[0] == pytest.approx(TURNED, rel=1e-2)
        assert LINED_UP - 1e-5 <= told[1] < 0.5 * TURNED


def test_a_mode_that_hangs_on_the_threshold_says_so_when_it_is_refused():
    mode = SlidingMode([True] * 5, [[1, -1]] * 5)
    solution = maximize_margin(slider(1e-6), mode=mode)
    assert solution.status is Status.INFEASIBLE_MODE
    looser, stricter = solution.certificate.threshold_optima or (0.0, 0.0)
    assert looser == pytest.approx(TURNED, rel=1e-2)
    assert np.isnan(stricter)
    assert "with ten times the threshold it is infeasible" in str(solution)


@pytest.mark.parametrize("turn", [1e-6, 2.3e-6])
def test_a_search_that_a_limit_ends_tells_no_other_optimum(turn):
    """What it had found by then is none, and nothing found is not infeasible."""
    whole = maximize_margin(slider(turn)).certificate.threshold_optima
    assert whole is not None and whole == pytest.approx((TURNED, LINED_UP), rel=1e-2)
    for nodes in range(1, 8):
        told = maximize_margin(slider(turn), node_limit=nodes).certificate.threshold_optima
        assert told is None or told == pytest.approx(whole, rel=1e-6)


def test_torques_that_hang_on_the_threshold_are_told_in_their_unit(monkeypatch):
    monkeypatch.setattr(TorqueSolution, "explanation", "")  # what else would help takes seconds
    solution = minimize_torque(slider(1e-6), 0.1)
    certificate = replace(solution.certificate, threshold_optima=(0.5, np.nan))
    infeasible = replace(minimize_torque(slider(1e-6), 30.0), certificate=certificate)
    for told in (replace(solution, certificate=certificate), infeasible):
        text = str(told).replace("0.5000", "0.5")
        assert (
            "a tenth of the threshold it is 0.5 N m, with ten times the threshold it is infeasible"
            in text
        )


@pytest.mark.parametrize("name", ["sphere", "rest", "up", "down"])
def test_the_papers_scenes_hang_on_no_threshold(name):
    for solve in (maximize_margin, partial(minimize_torque, margin=0.1)):
        assert solve(scene(name)).certificate.threshold_optima is None


@settings(max_examples=20)
@given(st.floats(-7.5, -4.0), st.integers(-9, 9))
def test_size_changes_no_verdict(decade, power):
    turn = 10.0**decade
    if abs(slowest(turn) / THRESHOLD - 1.0) < 1e-3:
        return
    mode = SlidingMode([True] * 5, [[1, -1]] * 5)
    verdicts = [
        VirtualKinematics(slider(turn, scale=scale)).solve(requirements_of(mode), SignRule.STRICT)
        for scale in (1.0, 10.0**power)
    ]
    assert type(verdicts[0]) is type(verdicts[1])
    assert isinstance(verdicts[0], Witness) == (slowest(turn) >= THRESHOLD)


@pytest.mark.parametrize("turn", [0.0, 1e-7, 2e-6, 3e-6, 1e-3])
def test_witnesses_and_conflicts_prove_themselves(turn):
    """By velocities of all motions, worked out anew from the problem's arrays."""
    problem = slider(turn)
    frames = np.concatenate([problem.normals[:, :, None], problem.tangents], axis=2)
    velocities = np.einsum("lij,lik->ljk", frames, problem.W.T.reshape(5, 3, 6)).reshape(15, 6)
    left, values, _ = np.linalg.svd(velocities, full_matrices=False)
    seen = left[:, values > 1e-8 * values[0]]
    for signs in ([[1, -1]] * 5, [[1, 1]] + [[1, -1]] * 4, [[-1, 1]] * 5):
        mode = SlidingMode([True] * 5, signs)
        verdict = VirtualKinematics(problem).solve(requirements_of(mode), SignRule.STRICT)
        if isinstance(verdict, Witness):
            u = verdict.velocities
            np.testing.assert_allclose(seen @ (seen.T @ u.ravel()), u.ravel(), atol=1e-9)
            assert (np.array(signs) * u[:, 1:]).min() >= 0.4 * THRESHOLD * np.linalg.norm(u)
            assert verdict.slowest >= THRESHOLD
        else:
            assert isinstance(verdict, Conflict)
            v = verdict.combination
            along = np.array(signs) * v[:, 1:]
            assert along.min() >= 0.0
            assert along.sum() == pytest.approx(1.0)
            assert np.linalg.norm(seen.T @ v.ravel()) < THRESHOLD


def test_what_is_found_of_motions_serves_under_other_loads():
    """Bit for bit: searches of one problem after the other, and of each where nothing is known."""
    rng, branched, shared = np.random.default_rng(8), 0, 0
    for seed in range(6, 12):
        problem = slope_scene(seed, 8)
        loaded = [
            problem.with_changes(
                external_wrench=problem.external_wrench * rng.uniform(0.5, 2.0),
                friction=problem.friction * rng.uniform(0.4, 1.2),
            )
            for _ in range(4)
        ]

        def answer(one):
            found = maximize_margin(one)
            return found, shared_parts(one).kinematics

        alone = []
        for one in loaded:
            vars(kinematics._OF_THREAD).clear()
            alone.append(answer(one))
        again = [one.with_changes() for one in loaded]
        vars(kinematics._OF_THREAD).clear()
        for (expected, _), (found, motions) in zip(alone, map(answer, again), strict=True):
            assert found.status is expected.status
            ours, theirs = found.certificate, expected.certificate
            for name in ("nodes", "modes_examined", "force_programs", "kinematic_programs"):
                assert getattr(ours, name) == getattr(theirs, name)
            assert ours.threshold_optima == theirs.threshold_optima
            if found.found:
                assert found.margin == expected.margin and found.mode == expected.mode
                np.testing.assert_array_equal(
                    found.contact_forces, expected.contact_forces, strict=True
                )
            branched += ours.nodes > 1
            shared += motions is shared_parts(again[0]).kinematics
    assert branched > 6 and shared > 18


def test_motions_of_other_contacts_or_near_the_threshold_are_not_shared():
    first = kinematics_of(slider(1e-3))
    assert kinematics_of(slider(1e-3)) is first
    assert kinematics_of(slider(1e-3).with_changes(friction=0.1)) is first
    assert kinematics_of(slider(2e-3)) is not first
    near = slider(1e-6)
    assert maximize_margin(near).certificate.threshold_optima is not None
    used = shared_parts(near).kinematics
    assert used.undecided_near
    assert kinematics_of(near.with_changes()) is not used


STRICT, EXACT, NONZERO = SignRule.STRICT, SignRule.EXACT, SignRule.NONZERO
SLOW, FAST = 0.9e-6, 1.1e-6
"""Below and above the threshold, over the length of all velocities."""
STILL, MOVING = 0.9e-8, 1.1e-8
"""Below and above what counts as rounding of zero."""

# Signs that are asked for; normal, first and second velocity of that contact; by rule: whether it
# counts. All other contacts make up for the length of 1.
ONE_CONTACT = [
    ((1, 1), (0.0, 0.5, 0.5), {STRICT: True, EXACT: True, NONZERO: True}),
    ((1, -1), (0.0, 0.5, -0.5), {STRICT: True, EXACT: True, NONZERO: True}),
    ((1, 1), (0.0, 0.5, -0.5), {STRICT: False, EXACT: False, NONZERO: False}),
    ((-1, 1), (0.0, 0.5, 0.5), {STRICT: False, EXACT: False, NONZERO: False}),
    ((1, 1), (0.0, 0.5, FAST), {STRICT: True, EXACT: True, NONZERO: True}),
    ((1, 1), (0.0, 0.5, SLOW), {STRICT: False, EXACT: False, NONZERO: True}),
    ((1, 1), (0.0, SLOW, 0.5), {STRICT: False, EXACT: False, NONZERO: True}),
    ((1, 1), (0.0, 0.5, 0.0), {STRICT: False, EXACT: False, NONZERO: True}),
    ((1, 1), (0.0, 0.5, -STILL), {STRICT: False, EXACT: False, NONZERO: True}),
    ((1, 1), (0.0, 0.5, -MOVING), {STRICT: False, EXACT: False, NONZERO: False}),
    ((1, 1), (0.0, SLOW / 2, SLOW / 2), {STRICT: False, EXACT: False, NONZERO: False}),
    ((1, 1), (0.0, FAST / 2, FAST / 2), {STRICT: False, EXACT: False, NONZERO: True}),
    ((1, 0), (0.0, 0.5, STILL), {EXACT: True}),
    ((1, 0), (0.0, 0.5, -STILL), {EXACT: True}),
    ((1, 0), (0.0, 0.5, MOVING), {EXACT: False}),
    ((0, -1), (0.0, -MOVING, -0.5), {EXACT: False}),
    ((0, -1), (0.0, 0.0, -0.5), {EXACT: True}),
    ((0, -1), (0.0, 0.0, -SLOW), {EXACT: False}),
    ((1, 1), (STILL, 0.5, 0.5), {STRICT: True, EXACT: True, NONZERO: True}),
    ((1, 1), (MOVING, 0.5, 0.5), {STRICT: False, EXACT: False, NONZERO: False}),
    ((1, 1), (-MOVING, 0.5, 0.5), {STRICT: False, EXACT: False, NONZERO: False}),
    # What is not asked for may be anything: a sign that is open under two of the rules.
    ((1, 0), (0.0, 0.5, -0.5), {STRICT: True, EXACT: False}),
]


@pytest.mark.parametrize("size", [1.0, 1e-9, 1e9])
@pytest.mark.parametrize(("signs", "velocity", "verdicts"), ONE_CONTACT)
def test_one_contact(signs, velocity, verdicts, size):
    kinematics = VirtualKinematics(scene("rest"))
    velocities = np.zeros((6, 3))
    velocities[2] = velocity
    velocities[4, 0] = np.sqrt(1.0 - np.sum(np.square(velocity)))
    for rule, counts in verdicts.items():
        assert (
            kinematics.meets_requirements(size * velocities, [Requirement(2, signs)], rule)
            is counts
        ), rule


@pytest.mark.parametrize("rule", list(SignRule))
def test_all_selected_contacts_have_to_slide(rule):
    kinematics = VirtualKinematics(scene("rest"))
    velocities = np.zeros((6, 3))
    velocities[[1, 3], 1:] = 0.5
    asked = [Requirement(1, (1, 1)), Requirement(3, (1, 1))]
    assert kinematics.meets_requirements(velocities, asked, rule)
    for other in ([Requirement(1, (1, 1)), Requirement(3, (1, -1))], [Requirement(0, (1, 1))],
                  [*asked, Requirement(5, (1, 1))]):  # fmt: skip
        assert not kinematics.meets_requirements(velocities, other, rule)
    # Nothing is asked of contacts that are not selected.
    velocities[0] = [0.3, -0.2, 0.1]
    assert kinematics.meets_requirements(velocities, asked, rule)
    assert kinematics.meets_requirements(velocities, [], rule)
    # No motion counts for nothing only.
    assert kinematics.meets_requirements(np.zeros((6, 3)), [], rule)
    assert not kinematics.meets_requirements(np.zeros((6, 3)), [Requirement(2, (1, 1))], rule)
