"""What is suggested where nothing is feasible is enough, and no more than what is needed."""

import time

import numpy as np
import pytest
from tests.core.random_scenes import general_scene, infeasible_scene
from tests.core.scenes import scene, slider

from graspless_pin import (
    QuasistaticProblem,
    Status,
    TorqueSolution,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms import explanation as explanation_module
from graspless_pin.algorithms.comparison import MinimumFriction
from graspless_pin.algorithms.explanation import Suggestion, explain
from graspless_pin.errors import ArgumentError, UndecidedMotionError
from graspless_pin.modes.rules import SlidingMode

MU = 0.5
LIMIT = 2.0


def pushed(**changes) -> QuasistaticProblem:
    """A block of 10 N slides on the floor, pushed by a finger of at most 2 N and pulled by 1 N.

    The push is as high as the floor's friction, so only forces along x and z matter.
    """
    jacobian = np.zeros((12, 1))
    jacobian[0, 0] = 0.1
    arguments = {
        "positions": [
            [-0.05, 0, -0.05],
            [0.05, 0.05, -0.05],
            [0.05, -0.05, -0.05],
            [-0.05, 0, -0.05],
        ],
        "normals": [[1, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 1]],
        "external_wrench": [-1, 0, -10, 0, 0.05, 0],
        "jacobian": jacobian,
        "friction": [0.0, MU, MU, MU],
        "torque_limits": (-0.1 * LIMIT, 0.1 * LIMIT),
        "sliding": [[0, 0, 0], [0.1, 0, 0], [0.1, 0, 0], [0.1, 0, 0]],
    }
    return QuasistaticProblem(**{**arguments, **changes})


MARGIN, HELP = "the required margin", "an extra external wrench"
FRICTION, NORMAL = "all friction coefficients", "every normal-force limit"
CASES = {
    "margin": (lambda: minimize_torque(scene("rest"), 20.0), [MARGIN, FRICTION]),
    "one joint": (lambda: maximize_margin(pushed()), ["joint_1's torque limit", HELP, FRICTION]),
    "one side of it": (
        lambda: maximize_margin(pushed(torque_limits=(-0.3, 0.2))),
        ["joint_1's upper torque limit", HELP, FRICTION],
    ),
    "normal forces": (
        lambda: maximize_margin(scene("rest").with_changes(max_normal_force=1.0)),
        [NORMAL, HELP, FRICTION],
    ),
    "all joints": (
        lambda: maximize_margin(scene("rest").with_changes(torque_limits=(-0.1, 0.1))),
        ["every torque limit", HELP, FRICTION],
    ),
    "friction": (
        lambda: maximize_margin(scene("rest").with_changes(friction=0.05)),
        [NORMAL, HELP, FRICTION],
    ),
    "no margin either": (
        lambda: minimize_torque(
            scene("rest").with_changes(torque_limits=(-0.01, 0.01), max_normal_force=0.3), 0.1
        ),
        [f"with no required margin, {HELP}"],
    ),
}  # fmt: skip


def partly(solution: TorqueSolution, suggestion: Suggestion, share: float) -> TorqueSolution:
    """What comes of a share of the suggested change."""
    old, new = solution.problem, suggestion.problem

    def between(name: str) -> np.ndarray:
        a, b = getattr(old, name), getattr(new, name)
        return a + share * (b - a)

    problem = old.with_changes(
        external_wrench=between("external_wrench"),
        friction=between("friction"),
        max_normal_force=between("max_normal_force"),
        torque_limits=(between("lower_torque"), between("upper_torque")),
    )
    own = solution.required_margin
    margin = own + share * (suggestion.margin - own)
    return minimize_torque(problem, margin)


@pytest.mark.parametrize("name", CASES)
def test_suggestions_are_enough_and_no_more_than_needed(name):
    make, changes = CASES[name]
    solution = make()
    explanation = explain(solution)
    asked = f" with a margin of {solution.required_margin:g} N." in explanation.cause
    assert asked == (solution.required_margin > 0.0)
    assert len(explanation.suggestions) == len(changes)
    for suggestion, change in zip(explanation.suggestions, changes, strict=True):
        assert suggestion.text.startswith(change)
        assert suggestion.rules == solution.rules
        assert partly(solution, suggestion, 1.0).found, suggestion.text
        assert not partly(solution, suggestion, 0.98).found, suggestion.text


def test_a_limit_that_has_no_side_keeps_none():
    """The finger pushes 1 N against the pull and 5 N against friction, at 0.1 m."""
    suggestion = explain(maximize_margin(pushed())).suggestions[0]
    (upper,) = suggestion.problem.upper_torque
    assert upper == pytest.approx(0.6, rel=2e-5)
    assert suggestion.problem.lower_torque == -upper
    assert suggestion.text == f"joint_1's torque limit would have to be {upper:g} N m"


def test_limits_of_an_explanation_hold():
    """After a search within limits an explanation searched on without any: here for seconds."""
    problem = general_scene(1, 18)
    bound = maximize_margin(problem, node_limit=1).certificate.bound
    solution = minimize_torque(problem, 1.05 * bound)
    assert solution.status is Status.INFEASIBLE_FORCES
    begin = time.process_time()
    at_once = explain(solution, time_limit=0.0)
    assert time.process_time() - begin < 0.5
    assert at_once.suggestions == () and not at_once.complete
    assert str(at_once) == (
        f"{at_once.cause}\n"
        "A limit ended the search for changes: others, or smaller ones, may be enough, too."
    )
    assert "No single change" not in at_once.cause
    begin = time.process_time()
    assert not explain(solution, time_limit=0.2).complete
    assert time.process_time() - begin < 1.5
    few = explain(solution, node_limit=1)
    assert not few.complete
    for suggestion in few.suggestions:
        assert minimize_torque(suggestion.problem, suggestion.margin).found


def test_an_explanation_without_limits_comes_to_its_end():
    make, _ = CASES["one joint"]
    explanation = explain(make())
    assert explanation.complete and "A limit ended" not in str(explanation)
    same = explain(make(), node_limit=1000, time_limit=60.0)
    assert same.complete and str(same) == str(explanation)


def test_what_is_printed_has_limits_of_its_own(monkeypatch):
    monkeypatch.setattr(explanation_module, "_BRIEF_SECONDS", 0.0)
    printed = str(minimize_torque(scene("rest"), 20.0))
    assert "A limit ended the search for changes" in printed
    assert "would have to be" not in printed


@pytest.mark.parametrize(("name", "value"), [("node_limit", 0), ("time_limit", -1.0)])
def test_limits_out_of_range_are_refused(name, value):
    with pytest.raises(ArgumentError, match=name):
        explain(minimize_torque(scene("rest"), 20.0), **{name: value})


INFEASIBLE = [infeasible_scene(seed, contacts) for seed in range(6) for contacts in (3, 5)]


@pytest.mark.sampled(5)
@pytest.mark.parametrize("problem", INFEASIBLE)
def test_every_suggestion_makes_the_scene_feasible(problem):
    solution = maximize_margin(problem)
    assert not solution.found
    explanation = explain(solution)
    assert explanation.suggestions
    for suggestion in explanation.suggestions:
        assert maximize_margin(suggestion.problem, **suggestion.rules.options()).found
    assert explanation.cause in solution.explanation


def test_where_nothing_can_carry_the_weight_help_from_outside_is_all_that_is_suggested():
    problem = QuasistaticProblem(
        [[0.05, 0, 0], [-0.05, 0, 0]],
        [[-1.0, 0, 0], [1.0, 0, 0]],
        [0, 0, -5.0, 0, 0, 0],
        friction=0.0,
    )
    suggestions = explain(maximize_margin(problem)).suggestions
    assert len(suggestions) == 1
    np.testing.assert_allclose(suggestions[0].problem.external_wrench, 0.0, atol=0.06)


def test_all_limits_give_way_at_once_where_none_alone_is_enough():
    """The weight has to be borne from outside, and no contact helps a joint with its own link."""
    problem = QuasistaticProblem(
        [[0.05, 0, 0], [-0.05, 0, 0]],
        [[-1.0, 0, 0], [1.0, 0, 0]],
        [0, 0, -5.0, 0, 0, 0],
        [[-0.1]] + [[0.0]] * 5,
        friction=0.0,
        torque_limits=(-0.1, 0.1),
        gravity_torques=[0.4],
        max_normal_force=20.0,
    )
    solution = maximize_margin(problem)
    (suggestion,) = explain(solution).suggestions
    changed = suggestion.problem
    torque, force = changed.upper_torque[0] - 0.1, changed.max_normal_force[0] - 20.0
    assert torque >= 0.3 and changed.lower_torque[0] == pytest.approx(-0.1 - torque)
    assert suggestion.text.startswith(
        f"every torque limit larger by {torque:g} N m, every normal-force limit by {force:g} N, and"
    )
    assert abs(changed.external_wrench[2]) < 1e-3
    assert partly(solution, suggestion, 1.0).found
    assert not partly(solution, suggestion, 0.98).found


def test_the_sliding_cuboid_names_its_conflict_and_weaker_rules():
    explanation = explain(maximize_margin(scene("up"), sliding_rule="constrained"))
    assert len(explanation.conflicting_contacts) >= 2
    text = str(explanation)
    assert "nonzero" in text and "coulomb" in text


def of_friction(explanation) -> Suggestion:
    (found,) = (item for item in explanation.suggestions if "friction" in item.text)
    return found


def test_half_the_friction_need_not_be_none():
    """The finger's 2 N less the pull leave 1 N for friction: a tenth of the weight, not half."""
    solution = maximize_margin(pushed())
    assert not solution.found
    suggestion = of_friction(explain(solution))
    words, _, last = suggestion.text.partition(" would have to be ")
    factor = float(last.removesuffix(" times as large"))
    assert words == "all friction coefficients"
    assert factor == pytest.approx(0.1 / MU, abs=2e-4) and factor <= 0.1 / MU
    np.testing.assert_allclose(suggestion.problem.friction, factor * pushed().friction)
    assert maximize_margin(suggestion.problem).found
    assert not maximize_margin(pushed(friction=[0, 0.1001, 0.1001, 0.1001])).found


def test_where_nothing_pushes_there_must_be_no_friction():
    """Nothing holds against the least friction, so none may be there, and a person says so."""
    free = pushed(torque_limits=(0.0, 0.0), external_wrench=[0, 0, -10, 0, 0, 0])
    suggestion = of_friction(explain(maximize_margin(free)))
    assert suggestion.text == "all friction coefficients would have to be 0"
    assert (suggestion.problem.friction == 0.0).all()
    assert maximize_margin(suggestion.problem).found
    text = str(explain(maximize_margin(free)))
    assert "- all friction coefficients would have to be 0" in text
    assert "0 times as large" not in text


def test_what_no_solver_decides_on_is_left_out(monkeypatch):
    """The suggestions that need no search of their own stay."""

    def search(*_, **__):
        raise UndecidedMotionError("not decided")

    monkeypatch.setattr(explanation_module, "branch_and_bound", search)
    explanation = explain(maximize_margin(pushed()))
    found = explanation.suggestions
    assert [item.text.split(" would")[0] for item in found] == ["all friction coefficients"]
    assert not explanation.complete


def test_what_is_not_proven_leaves_an_explanation_open(monkeypatch):
    solution = maximize_margin(pushed())
    unknown = MinimumFriction(np.nan, proven=False)
    monkeypatch.setattr(explanation_module, "smallest_factor", lambda *_: unknown)
    assert not explain(solution).complete


def test_a_mode_that_is_refused_is_an_answer():
    mode = SlidingMode([True] * 5, [[1, -1]] * 5)
    told = explain(maximize_margin(slider(1e-6), mode=mode)).cause
    assert told.startswith("Not explained further: the given virtual-sliding mode has no")


def test_a_help_far_beyond_all_that_is_at_hand_is_left_out():
    """Tiny levers turn a margin of next to nothing into a wrench that no one would add."""
    jacobian = [[0.5, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.5], [0.0, 0.0], [0.0, 0.0]]
    problem = QuasistaticProblem(
        [[0.0, -7e-5, 2.7e-4], [0.0, -1e-4, 2.5e-4]], [[-1.0, 0.0, 0.0]] * 2,
        [0.0, 0.0, -2.6, 0.0, 0.0, 0.0], jacobian, friction=0.7,
        torque_limits=([-1e-11, -3e-8], [1e-11, 3e-8]), max_normal_force=[5.0, 1e-5], cone_edges=6,
    )  # fmt: skip
    solution = minimize_torque(problem, 3.4e-8, scale="limits", sign_rule="nonzero")
    found = explain(solution).suggestions
    assert all(one.text.startswith("with no required margin") for one in found)
