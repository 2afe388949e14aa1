"""What counts as a virtual motion decides here by a factor of nine; the checker has the rule."""

import copy

import numpy as np
import pytest
from tests.core.scenes import slider
from verified_documents import Document, changed, documented, failed

from graspless_pin import maximize_margin
from graspless_pin.report.verify import verify_document

COUNTS, DOES_NOT = 5e-6, 2e-7


def document(turned: float, sign_rule: str = "strict") -> Document:
    return documented(maximize_margin(slider(turned), sign_rule=sign_rule))


@pytest.mark.sampled(7)
@pytest.mark.parametrize("turned", [0.0, 1e-8, DOES_NOT, COUNTS, 1e-4, 1e-2])
@pytest.mark.parametrize("sign_rule", ["strict", "exact", "nonzero"])
def test_documents_near_the_threshold_are_proven(turned, sign_rule):
    assert verify_document(document(turned, sign_rule=sign_rule)).proven


def test_a_motion_that_is_too_slow_is_refused():
    """The optimum of tangents that are turned enough, for tangents that are not."""
    true = document(COUNTS)
    less = document(DOES_NOT)
    assert true["margin"] > 2.0 * less["margin"]
    forged = copy.deepcopy(true)
    for contact, other in zip(forged["contacts"], less["contacts"], strict=True):
        contact["tangents"] = other["tangents"]
    assert "the mode has a virtual motion (22)" in failed(forged)


def test_a_motion_that_is_fast_enough_cannot_be_excluded():
    """The optimum and proof of tangents that are not turned enough, for tangents that are."""
    less = document(DOES_NOT)
    assert len(less["proof"]["nodes"]) > 1
    forged = copy.deepcopy(less)
    for contact, other in zip(forged["contacts"], document(COUNTS)["contacts"], strict=True):
        contact["tangents"] = other["tangents"]
    assert not verify_document(forged).passed


def test_selected_contacts_must_not_part():
    """A motion that lifts a millionth of its velocities off is none."""
    true = document(1e-2)
    assert verify_document(true).proven
    motion = np.array(true["proof"]["motion"]["object"])
    size = np.linalg.norm(motion)
    for lift, passes in ((1e-10, True), (1e-6, False), (-1e-6, False)):
        lifted = (motion + lift * size * np.eye(6)[2]).tolist()
        moved = changed(true, "proof", "motion", "object", to=lifted)
        assert verify_document(moved).passed == passes


def test_zero_sliding_is_none():
    """Under `exact` a component without friction must stand still."""
    true = document(0.0, sign_rule="exact")
    signs = [contact["signs"] for contact in true["contacts"] if contact["selected"]]
    assert any(0 in pair for pair in signs)
    motion = np.array(true["proof"]["motion"]["object"])
    size = np.linalg.norm(motion)
    for turn in range(6):
        moved = (motion + 1e-6 * size * np.eye(6)[turn]).tolist()
        passed = verify_document(changed(true, "proof", "motion", "object", to=moved)).passed
        assert passed == (turn == 0), turn  # along x it slides anyway
