"""Postures in which fingertips meet."""

from pathlib import Path

import numpy as np
import pytest

from graspless_pin import load_scene
from graspless_pin.geometry.posing.opposing import _FingertipCenters

SCENE = Path(__file__).resolve().parents[2] / "examples" / "allegro_box_on_slope.yaml"


@pytest.mark.parametrize("thicker", [1.0, 100.0], ids=["apart", "overlapping"])
def test_rates_of_what_is_left_to_meet_are_its_differences(thicker):
    hand = load_scene(SCENE).hand
    assert hand is not None
    tips = _FingertipCenters(hand, tuple(hand.fingers))
    tips._least_gaps *= thicker
    there = hand.tree.coupling.independent(hand.positions) + 0.1
    steps = 1e-6 * np.eye(len(there))
    differences = [
        tips.meeting_residuals(there + step) - tips.meeting_residuals(there - step)
        for step in steps
    ]
    rates = tips.meeting_rates(there)
    assert np.abs(rates).max() > 0.05
    np.testing.assert_allclose(rates, np.transpose(differences) / 2e-6, atol=1e-8)
