"""The judge of answers: false answers are wrong, and a lost worker is one line."""

from dataclasses import replace

import numpy as np
import pytest
from tests.oracles.exact_optimum import Question
from tests.oracles.judging import RESOLVED, Outcome, ask, compare, exact_scene
from tests.oracles.lost_worker import ends_or_sleeps
from tests.oracles.scale_scenes import FAMILIES, scale_case
from tests.oracles.scales import Judged, passes, run, summary
from tests.oracles.test_exact_optimum import four_points

from graspless_pin import QuasistaticProblem, SlidingMode, Status, TorqueSolution

PUSHED = QuasistaticProblem(
    [[-1, -1, -1], [1, -1, -1], [0, 1, -1], [0, 0, 1]],
    [[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, -1]],
    [1, 0, -8, 0, 0, 0],
    np.concatenate([np.zeros(9), [0.25, 0.0, 0.5]])[:, None],
    friction=0.5,
    tangents=[[[0.6, -0.8], [0.8, 0.6], [0, 0]]] * 3 + [[[0.6, 0.8], [0.8, -0.6], [0, 0]]],
    cone_edges=4,
)  # fmt: skip
QUESTION = Question("torque", 0.125)


@pytest.fixture(scope="module")
def right() -> TorqueSolution:
    solution = ask(PUSHED, QUESTION)
    assert compare(PUSHED, QUESTION, solution).outcome == Outcome.AGREE
    assert solution.max_torque > 0.1
    return solution


def forged(solution: TorqueSolution, what: str) -> TorqueSolution:
    certificate, mode = solution.certificate, solution.mode
    assert solution._forces is not None and mode is not None
    if what == "bound":
        return replace(solution, certificate=replace(certificate, bound=certificate.bound * 0.999))
    if what == "infeasible":
        return replace(solution, status=Status.INFEASIBLE_FORCES, _forces=None, _mode=None)
    if what == "no selection":
        none = type(mode)(np.zeros(4, dtype=bool), np.zeros((4, 2)))
        return replace(solution, _mode=none)
    if what == "other signs":
        return replace(solution, _mode=type(mode)(mode.selection, -mode.signs))
    if what == "no motion":
        signs = np.array([[1, 1], [-1, -1], [1, -1], [-1, 1]])
        return replace(solution, _mode=type(mode)(np.ones(4, dtype=bool), signs))
    forces = solution._forces.copy()
    if what == "unbalanced":
        forces[3, 2] -= 1e-4
    else:
        # Still balanced, but pressed harder than it has to be.
        forces[:3, 2] += 1e-3
        forces[3, 2] -= 3e-3
    return replace(solution, _forces=forces)


@pytest.mark.parametrize(
    "what",
    ["bound", "infeasible", "no selection", "other signs", "no motion", "unbalanced", "harder"],
)
def test_a_false_answer_is_wrong(right, what):
    verdict = compare(PUSHED, QUESTION, forged(right, what))
    assert verdict.outcome == Outcome.WRONG, verdict


def test_a_found_answer_to_an_impossible_question_is_wrong(right):
    impossible = PUSHED.with_changes(max_normal_force=1.0)
    assert compare(impossible, QUESTION, right).outcome == Outcome.WRONG


@pytest.mark.parametrize(
    ("turn", "outcome"),
    [(1e-4, Outcome.AGREE), (1e-6, Outcome.THRESHOLD), (6e-8, Outcome.WRONG)],
)
def test_an_answer_that_hangs_on_the_threshold_is_told(turn, outcome):
    """Where the sliding is a third of the turn: clear, near the threshold, or nothing."""
    problem, question = four_points(turn), Question("margin")
    best = exact_scene(problem, question).optimum()
    assert best is not None and best.mode is not None
    clear = ask(four_points(1e-4), question)
    mode = SlidingMode(
        [pair is not None for pair in best.mode], [pair or (0, 0) for pair in best.mode]
    )
    answer = replace(
        clear,
        problem=problem,
        certificate=replace(clear.certificate, bound=float(best.value)),
        _forces=np.array(best.forces, dtype=float),
        _mode=mode,
    )
    assert compare(problem, question, answer).outcome == outcome


@pytest.mark.parametrize(
    ("turn", "outcome"),
    [(6e-8, Outcome.AGREE), (6e-6, Outcome.THRESHOLD), (1e-4, Outcome.AGREE)],
)
def test_the_package_says_where_it_hangs_on_the_threshold(turn, outcome):
    problem, question = four_points(turn), Question("margin")
    solution = ask(problem, question)
    assert solution.found is (turn > 3e-6)
    assert compare(problem, question, solution).outcome == outcome
    told = solution.certificate.threshold_optima
    forgeries: list[tuple[float, float] | None] = [(0.5, 0.5)]
    bound = solution.certificate.bound
    forgeries.append((bound, bound) if told is None else None)
    for forgery in forgeries:
        certificate = replace(solution.certificate, threshold_optima=forgery)
        forged_one = replace(solution, certificate=certificate)
        assert compare(problem, question, forged_one).outcome == Outcome.WRONG


def test_scenes_are_of_every_scale_and_limit():
    cases = [scale_case(seed) for seed in range(250)]
    again = scale_case(7)
    np.testing.assert_array_equal(again.problem.jacobian, cases[7].problem.jacobian)
    assert {case.family for case in cases} == set(FAMILIES)
    problems = [case.problem for case in cases]
    lengths = [np.abs(problem.positions).max() for problem in problems]
    loads = [np.abs(problem.external_wrench[:3]).max() for problem in problems]
    assert min(lengths) < 1e-8 and max(lengths) > 1e8
    assert min(load for load in loads if load) < 1e-7 and max(loads) > 1e9
    assert sum(not problem.external_wrench.any() for problem in problems) > 12
    assert {problem.contact_count for problem in problems} == {2, 3, 4}
    assert {problem.joint_count for problem in problems} == {0, 1, 2, 3, 4}
    assert sum(bool((problem.friction == 0.0).any()) for problem in problems) > 37
    assert sum(bool(problem.is_sliding.any()) for problem in problems) > 18
    widths = np.concatenate([problem.upper_torque - problem.lower_torque for problem in problems])
    assert (widths == 0.0).sum() > 30 and np.isinf(widths).sum() > 60
    shares = [
        problem.max_normal_force / load
        for problem, load in zip(problems, loads, strict=True)
        if load
    ]
    assert np.concatenate(shares).max() > 1e11 and np.concatenate(shares).min() < 1e-5
    questions = [case.question for case in cases]
    for name, values in {
        "algorithm": {"margin", "torque"},
        "sign_rule": {"strict", "exact", "nonzero"},
        "sliding_rule": {"exempt", "constrained"},
        "static_friction": {"virtual_sliding", "coulomb"},
        "by_limits": {True, False},
    }.items():
        assert {getattr(question, name) for question in questions} == values


# At these seeds limits and forces beyond the load's 1e8 times are left unverified.
@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", [82, 154, 585, 694, 772, 947, 1462, 1557, 1845, 1847, 1877])
def test_all_is_answered_where_limits_are_1e8_times_the_load(seed):
    case = scale_case(seed)
    force, _, joints = case.problem.scales
    most = case.problem.max_normal_force, case.problem.upper_torque, case.problem.lower_torque
    normal = np.minimum(most[0], RESOLVED * force)
    upper = np.where(np.isfinite(most[1]), np.minimum(most[1], RESOLVED * joints), np.inf)
    lower = np.where(np.isfinite(most[2]), np.maximum(most[2], -RESOLVED * joints), -np.inf)
    problem = case.problem.with_changes(max_normal_force=normal, torque_limits=(lower, upper))
    assert normal.max() > 0.99e8 * force or upper.max(initial=0.0) > 0.99e8 * joints.max()
    verdict = compare(problem, case.question, ask(problem, case.question))
    assert verdict.outcome == Outcome.AGREE, verdict


def test_an_answer_that_is_missing_near_the_load_is_wrong():
    problem = scale_case(3).problem
    for factor, outcome in ((0.9e8, Outcome.WRONG), (1.1e8, Outcome.UNVERIFIED)):
        limits = np.full(problem.contact_count, factor * problem.scales.force)
        free = (np.full(problem.joint_count, -np.inf), np.full(problem.joint_count, np.inf))
        changed = problem.with_changes(max_normal_force=limits, torque_limits=free)
        solution = replace(ask(changed, scale_case(3).question), status=Status.UNVERIFIED)
        assert compare(changed, scale_case(3).question, solution).outcome == outcome


def test_a_process_that_is_lost_or_never_ends_is_one_wrong_scene():
    lines = sorted(run(range(6), 2, ends_or_sleeps, limit=2.0))
    assert [line.seed for line in lines] == list(range(6))
    assert [line.seed for line in lines if line.outcome == Outcome.WRONG] == [2, 5]
    assert "ended with 7" in lines[2].detail
    assert "no answer in 2 s" in lines[5].detail and "ends_or_sleeps" in lines[5].detail
    assert not passes(lines)
    fine = [line for line in lines if line.outcome == Outcome.AGREE]
    assert passes(fine) and "1.0e-09" in summary(fine)
    refused = Judged(3, Outcome.REFUSED, "", 0.0, found=True)
    assert not passes([*fine, refused]) and passes([*fine * 13, refused])
