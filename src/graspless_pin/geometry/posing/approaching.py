"""Bringing an open hand to an object: back until it is free, aside until it is in the middle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from graspless_pin.geometry.bodies.collision import PlacedBodies
from graspless_pin.geometry.contact.broad_phase import near_pairs
from graspless_pin.geometry.contact.distances import nearest_separation, separation
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray

_LEAST_STEP = 5e-4  # m
_OPPOSITE = -0.3  # cosine between the ways of two fingers to the object


def shortfall(bodies: PlacedBodies, others: PlacedBodies, clearance: float) -> float:
    """Return by how much bodies miss a clearance from others, zero if they keep it, m."""
    if not len(bodies) or not len(others):
        return 0.0
    pairs = near_pairs(bodies, others, clearance)
    gaps = [separation(bodies[i], others[k]).distance for i, k in pairs]
    return max(clearance - min(gaps, default=clearance), 0.0)


def moved_bodies(bodies: PlacedBodies, T: FloatArray) -> PlacedBodies:
    """Return bodies moved by a (4, 4) pose, world axes."""
    return PlacedBodies(bodies.shapes, T @ bodies.poses)


def back_until_free(
    bodies: PlacedBodies,
    obstacles: Sequence[tuple[PlacedBodies, float]],
    direction: FloatArray,
    farthest: float,
) -> tuple[float | None, int]:
    """Return how far bodies go back until they keep clear of all obstacles.

    Each step is as long as the deepest overlap: nowhere nearer are they free.

    Args:
        bodies: What moves.
        obstacles: Bodies, and the clearance from each, m.
        direction: (3,) unit vector of the approach, world axes; bodies go against it.
        farthest: How far they may go, m.

    Returns:
        How far they go, m, or None if that is not enough; and the obstacle that was last in the
        way, -1 without one.
    """
    back, last, T = 0.0, -1, np.eye(4)
    while back <= farthest:
        T[:3, 3] = -back * direction
        there = moved_bodies(bodies, T)
        missing = [shortfall(there, others, clearance) for others, clearance in obstacles]
        worst = int(np.argmax(missing))
        if missing[worst] == 0.0:
            return back, last
        back, last = back + max(missing[worst], _LEAST_STEP), worst
    return None, last


def centering_shift(
    hand: Hand, jaws: Sequence[Sequence[str]], target: PlacedBodies
) -> FloatArray | None:
    """Return how to shift a hand whose jaws close together so that two are equally near.

    These are the nearest jaw and the nearest of those opposite to it. A gripper with one motor
    touches an object that is off its middle on one side only.

    Args:
        hand: The hand.
        jaws: Links of each finger that one motor moves, or of one finger and of a fixed jaw.
        target: The object's pieces.

    Returns:
        (3,) m, world axes; None: no jaw is opposite.
    """
    bodies = hand.placed_bodies
    own = [[one for one in bodies if one.name in links] for links in jaws]
    reached = [nearest_separation(pieces, target) for pieces in own if pieces]
    first = min(reached, key=lambda one: one.distance)
    opposite = [one for one in reached if float(one.normal @ first.normal) < _OPPOSITE]
    if not opposite:
        return None
    second = min(opposite, key=lambda one: one.distance)
    apart = first.normal - second.normal
    return (first.distance - second.distance) * apart / float(apart @ apart)
