"""The hands and objects that `make place` takes through the command line, by name."""

from __future__ import annotations

from itertools import product

import numpy as np
from tests.oracles.placed_pairs import HANDS, MORE_PAIRS, OTHERS, PAIRS, Outcome, broken_promises


def test_each_of_four_hands_with_each_of_three_objects() -> None:
    assert len(PAIRS) == 10
    hands, objects = ("iCub", "PR2", "Robotiq 2F-85", "Allegro"), ("duck", "mug", "box")
    for wanted in map(", ".join, product(hands, objects)):
        assert [name for name in {**PAIRS, **MORE_PAIRS} if name.startswith(wanted)]


def test_ten_more_hands_each_with_box_cylinder_and_mug() -> None:
    assert len(HANDS) == 10 and len(OTHERS) == 30
    for wanted in map(", ".join, product(HANDS, ("box", "cylinder", "mug"))):
        assert wanted in OTHERS


def test_crashes_and_places_without_a_grip_break_the_promise() -> None:
    grip = Outcome(1.0, 2, 0.01, 30.0, 30.0, 20.0)
    refused = Outcome(np.nan, 0, np.nan, 3.0, 3.0, np.nan, said="new: no", refused=True)
    good = {f"grip {k}": grip for k in range(8)}
    assert not broken_promises({**good, "a": refused, "b": refused})
    assert broken_promises({**good, "a": refused, "b": refused, "c": refused})
    crashed = refused._replace(refused=False)
    pressed, touching = grip._replace(squeezes=False), grip._replace(clearance=0.0)
    for wrong in (crashed, pressed, touching, grip._replace(links=1)):
        assert broken_promises({**good, "a": wrong})
    assert broken_promises({f"slow {k}": grip._replace(cpu_seconds=200.0) for k in range(10)})
