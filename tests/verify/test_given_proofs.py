"""Documents print the proof that a solution carries: they solve nothing."""

import dataclasses

import numpy as np
import pytest
from verified_documents import SOLUTIONS, documented

from graspless_pin.algorithms import formulation
from graspless_pin.modes.kinematics import VirtualKinematics, requirements_of
from graspless_pin.problem.quasistatic import contact_map
from graspless_pin.report.verify import verify_document


@pytest.fixture
def nothing_solves(monkeypatch):
    """Make every force program and every kinematic program an error, from a call on."""

    def forbid():
        def solve(*_, **__):
            raise AssertionError("something was solved")

        monkeypatch.setattr(formulation, "solve", solve)
        monkeypatch.setattr(VirtualKinematics, "_fastest_sliding", solve)

    return forbid


@pytest.mark.sampled(7)
@pytest.mark.parametrize("name", [
    "margin", "torque", "coulomb", "regularized margin", "one-sided joints", "no motion needed",
    "in a mode", "infeasible in a mode", "infeasible forces", "infeasible margin",
    "infeasible shares", "tree", "exact tree", "nonzero", "infeasible modes",
])  # fmt: skip
def test_the_search_hands_its_proof_over(name, nothing_solves):
    """But for a tree, which is made once, and for why nothing is feasible."""
    solution = SOLUTIONS[name]()
    _ = solution.explanation
    if name.endswith(("tree", "nonzero", "modes")):
        _ = solution.proof
    nothing_solves()
    assert verify_document(documented(solution)).proven
    assert documented(solution)["proof"] == documented(solution)["proof"]


@pytest.mark.parametrize("name", ["margin", "tree", "nonzero", "in a mode"])
def test_the_motion_is_behind_the_mode(name):
    solution = SOLUTIONS[name]()
    assert solution.motion is not None
    twist = np.concatenate([solution.motion[:6], -solution.motion[6:]])
    velocities = contact_map(solution.problem) @ twist
    wanted = requirements_of(solution.mode)
    assert VirtualKinematics(solution.problem).meets_requirements(
        velocities, wanted, solution.rules.sign
    )


def test_a_motion_that_is_not_behind_the_mode_is_replaced():
    """The search's motion is looked at before it is believed."""
    solution = SOLUTIONS["torque"]()
    wrong = dataclasses.replace(solution.evidence, motion=-solution.evidence.motion)
    document = documented(dataclasses.replace(solution, evidence=wrong))
    assert verify_document(document).proven


def test_where_no_motion_is_asked_for_there_is_none():
    assert SOLUTIONS["coulomb"]().motion is None
    assert SOLUTIONS["infeasible forces"]().motion is None
