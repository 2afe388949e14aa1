"""The hands and objects that `make place` takes through the command line, by name."""

from __future__ import annotations

from itertools import product

from tests.oracles.placed_pairs import MORE_PAIRS, PAIRS


def test_ten_pairs_and_each_of_four_hands_with_each_of_three_objects() -> None:
    assert list(PAIRS) == [
        "iCub, duck",
        "iCub, mug on a slope",
        "iCub, box",
        "PR2, duck on a slope",
        "PR2, box",
        "Robotiq 2F-85, mug",
        "Robotiq 2F-85, box on a slope",
        "Shadow, mug",
        "Inspire, box on a slope",
        "Jaco, duck",
    ]
    hands, objects = ("iCub", "PR2", "Robotiq 2F-85", "Allegro"), ("duck", "mug", "box")
    for wanted in map(", ".join, product(hands, objects)):
        assert [name for name in {**PAIRS, **MORE_PAIRS} if name.startswith(wanted)]
