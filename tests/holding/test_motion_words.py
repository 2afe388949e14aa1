"""Motions in words: where to, about what, which contacts, against motions made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from cases import GRAVITY, block_between_walls, block_on_slope

from graspless_pin import QuasistaticProblem, stability
from graspless_pin.holding.stability import motion_words
from graspless_pin.holding.verdict import ContactState, DynamicOutcome


def words(
    problem: QuasistaticProblem, acceleration: list[float], *states: ContactState, size: float = 1.0
) -> str:
    motion = DynamicOutcome(
        np.array(acceleration),
        np.zeros(problem.joint_count),
        np.zeros((problem.contact_count, 3)),
        states or (ContactState.STICKING,) * problem.contact_count,
        size,
    )
    return motion_words(problem, motion)


def test_a_box_between_two_walls_falls() -> None:
    said = stability(block_between_walls(0.5), [])
    assert str(said) == "may fail: the object can fall, 9.81 m/s^2 (all contacts open)"


def test_a_block_slips_along_its_slope() -> None:
    """The slope's normal is z here, and the load leans by its angle."""
    angle = math.atan(0.5) + 0.2
    size = GRAVITY * (math.sin(angle) - 0.5 * math.cos(angle))
    assert str(stability(block_on_slope(0.5, angle), [])) == (
        "fails: rest is no outcome; the object can slip down along +x, "
        f"{size:.3g} m/s^2 (all contacts slip)"
    )


@pytest.mark.parametrize(
    ("way", "said"),
    [
        ([0, 0, -1], "move down"),
        ([0, 0.3, -1], "move down"),
        ([0, 0, 1], "move up"),
        ([0, -1, 0], "move sideways along -y"),
        ([0.6, -0.8, 0], "move sideways along (0.60, -0.80, 0.00)"),
        ([0.6, 0, -0.8], "move down along (0.60, 0.00, -0.80)"),
        ([0.6, 0, 0.8], "move up along (0.60, 0.00, 0.80)"),
    ],
)
def test_directions(way: list[float], said: str) -> None:
    level = block_on_slope(0.5, 0.0)
    assert words(level, [*way, 0, 0, 0]) == f"{said}, 1 m/s^2"


def test_nothing_is_down_without_a_load() -> None:
    still = block_on_slope(0.5, 0.0).with_changes(external_wrench=np.zeros(6))
    assert words(still, [0, 0, -1, 0, 0, 0]) == "move along -z, 1 m/s^2"


def test_turning_is_named_where_it_counts() -> None:
    """Corners are 0.087 m from the middle: 10 rad/s^2 moves them as fast as 0.5 to 0.87 m/s^2."""
    level = block_on_slope(0.5, 0.0)
    assert words(level, [0, 0, 0, -10, 0, 0]) == "tilt about -x, 1 m/s^2"
    assert words(level, [0, 0, 0, 0, 0, 10]) == "turn about +z, 1 m/s^2"
    assert words(level, [0, 0, -1, 0, 10, 0]) == "move down and tilt about +y, 1 m/s^2"
    assert words(level, [0, 0, -1, 0, 1, 0]) == "move down, 1 m/s^2"
    assert words(level, [0.1, 0, 0, 7, 7, 0]) == "tilt about (0.71, 0.71, 0.00), 1 m/s^2"


def test_contacts_by_number() -> None:
    level = block_on_slope(0.5, 0.0)
    opening, sticking, slipping = ContactState.OPEN, ContactState.STICKING, ContactState.SLIPPING
    assert words(level, [1, 0, 0, 0, 0, 0], opening, sticking, slipping, opening, size=0.25) == (
        "slip sideways along +x, 0.25 m/s^2 (contacts 0, 3 open; contact 2 slips)"
    )
