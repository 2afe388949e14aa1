"""Less friction as a way out: where the hand cannot push against kinetic friction."""

import numpy as np
import pytest

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque
from graspless_pin.algorithms import explanation
from graspless_pin.algorithms.explanation import Suggestion, explain
from graspless_pin.errors import UndecidedMotionError

FRICTION = 0.5
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
        "friction": [0.0, FRICTION, FRICTION, FRICTION],
        "torque_limits": (-0.1 * LIMIT, 0.1 * LIMIT),
        "sliding": [[0, 0, 0], [0.1, 0, 0], [0.1, 0, 0], [0.1, 0, 0]],
    }
    return QuasistaticProblem(**{**arguments, **changes})


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
    assert factor == pytest.approx(0.1 / FRICTION, abs=2e-4) and factor <= 0.1 / FRICTION
    np.testing.assert_allclose(suggestion.problem.friction, factor * pushed().friction)
    assert maximize_margin(suggestion.problem).found
    assert not maximize_margin(pushed(friction=[0, 0.1001, 0.1001, 0.1001])).found


def test_the_same_with_a_margin_to_keep():
    """With 0.5 N of margin the finger may push 2 N all the same; the torque is what limits it."""
    solution = minimize_torque(pushed(), margin=0.5)
    assert not solution.found
    suggestion = of_friction(explain(solution))
    assert minimize_torque(suggestion.problem, margin=0.5).found
    factor = suggestion.problem.friction[1] / FRICTION
    assert factor == pytest.approx(0.1 / FRICTION, abs=2e-4)


def test_where_nothing_pushes_there_must_be_no_friction():
    """Nothing holds against the least friction, so none may be there, and a person says so."""
    free = pushed(torque_limits=(0.0, 0.0), external_wrench=[0, 0, -10, 0, 0, 0])
    suggestion = of_friction(explain(maximize_margin(free)))
    assert suggestion.text == "the contacts would have to be without friction"
    assert (suggestion.problem.friction == 0.0).all()
    assert maximize_margin(suggestion.problem).found
    text = str(explain(maximize_margin(free)))
    assert "- the contacts would have to be without friction" in text
    assert "0 times as large" not in text


def test_what_no_solver_decides_on_is_left_out(monkeypatch):
    """The suggestions that need no search of their own stay."""

    def search(*_, **__):
        raise UndecidedMotionError("not decided")

    monkeypatch.setattr(explanation, "branch_and_bound", search)
    found = explain(maximize_margin(pushed())).suggestions
    assert [item.text.split(" would")[0] for item in found] == ["all friction coefficients"]
