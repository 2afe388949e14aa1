"""Which contact velocities count as a virtual motion, written out case by case (docs/rules.md)."""

import numpy as np
import pytest
from scenes import scene

from graspless_pin.modes.feasibility import Requirement
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.rules import SignRule

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
        assert kinematics.counts(size * velocities, [Requirement(2, signs)], rule) is counts, rule


@pytest.mark.parametrize("rule", list(SignRule))
def test_all_selected_contacts_have_to_slide(rule):
    kinematics = VirtualKinematics(scene("rest"))
    velocities = np.zeros((6, 3))
    velocities[[1, 3], 1:] = 0.5
    asked = [Requirement(1, (1, 1)), Requirement(3, (1, 1))]
    assert kinematics.counts(velocities, asked, rule)
    for other in ([Requirement(1, (1, 1)), Requirement(3, (1, -1))], [Requirement(0, (1, 1))],
                  [*asked, Requirement(5, (1, 1))]):  # fmt: skip
        assert not kinematics.counts(velocities, other, rule)
    # Nothing is asked of contacts that are not selected.
    velocities[0] = [0.3, -0.2, 0.1]
    assert kinematics.counts(velocities, asked, rule)
    assert kinematics.counts(velocities, [], rule)


@pytest.mark.parametrize("rule", list(SignRule))
def test_no_motion_counts_for_nothing_only(rule):
    kinematics = VirtualKinematics(scene("rest"))
    assert kinematics.counts(np.zeros((6, 3)), [], rule)
    assert not kinematics.counts(np.zeros((6, 3)), [Requirement(2, (1, 1))], rule)
