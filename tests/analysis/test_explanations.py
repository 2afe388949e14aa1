"""What is suggested where nothing is feasible is enough, and no more than what is needed."""

import time

import numpy as np
import pytest
from test_suggested_friction import pushed
from tests.core.random_scenes import general_scene
from tests.core.scenes import scene

from graspless_pin import Status, TorqueSolution, maximize_margin, minimize_torque
from graspless_pin.algorithms import explanation as explanation_module
from graspless_pin.algorithms.explanation import Suggestion, explain
from graspless_pin.errors import ArgumentError

MARGIN, HELP = "the required margin", "an extra external wrench"
FRICTION, NORMAL = "all friction coefficients", "every normal-force limit"
CASES = {
    "margin": (lambda: minimize_torque(scene("rest"), 20.0), [MARGIN, FRICTION]),
    "one joint": (lambda: maximize_margin(pushed()), ["joint_1's limit", HELP, FRICTION]),
    "one side of it": (
        lambda: maximize_margin(pushed(torque_limits=(-0.3, 0.2))),
        ["joint_1's upper limit", HELP, FRICTION],
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
    assert suggestion.text == f"joint_1's limit would have to be {upper:g} N m"


def hard() -> TorqueSolution:
    """An infeasible scene whose explanation takes seconds, and searches of more than one node."""
    problem = general_scene(1, 24)
    best = maximize_margin(problem, node_limit=1)
    return minimize_torque(problem, 1.05 * best.certificate.bound)


def test_limits_of_an_explanation_hold():
    """After a search within limits an explanation searched on without any."""
    solution = hard()
    assert solution.status is Status.INFEASIBLE_FORCES
    begin = time.process_time()
    at_once = explain(solution, time_limit=0.0)
    assert time.process_time() - begin < 0.5
    assert at_once.suggestions == () and not at_once.complete
    assert str(at_once) == (
        f"{at_once.cause}\n"
        "Not every search for changes came to its end: others may do, too, or smaller ones."
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
    assert explanation.complete and "came to its end" not in str(explanation)
    same = explain(make(), node_limit=1000, time_limit=60.0)
    assert same.complete and str(same) == str(explanation)


def test_what_is_printed_has_limits_of_its_own(monkeypatch):
    monkeypatch.setattr(explanation_module, "_BRIEF_SECONDS", 0.0)
    printed = str(minimize_torque(scene("rest"), 20.0))
    assert "Not every search for changes came to its end" in printed
    assert "would have to be" not in printed


@pytest.mark.parametrize(("name", "value"), [("node_limit", 0), ("time_limit", -1.0)])
def test_limits_out_of_range_are_refused(name, value):
    with pytest.raises(ArgumentError, match=name):
        explain(minimize_torque(scene("rest"), 20.0), **{name: value})
