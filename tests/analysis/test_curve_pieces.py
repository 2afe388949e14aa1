"""The lower envelope of piecewise linear curves, point by point, and curves that go straight on."""

from itertools import pairwise

import numpy as np
import pytest

from graspless_pin import SlidingMode
from graspless_pin.algorithms.margin_torque_curve import WIDTH, Piece, first_open, joined, lower

ONE = SlidingMode([True], [[1, 1]])
OTHERS = [SlidingMode([True], [[1, -1]]), SlidingMode([True], [[-1, 1]])]


def chain(rng, begin, end, mode, count, torque):
    """A curve of so many pieces of one mode."""
    margins = np.sort(np.concatenate([[begin, end], rng.uniform(begin, end, count - 1)]))
    torques = torque + rng.uniform(-1.0, 1.0, count + 1)
    points = list(zip(margins.tolist(), torques.tolist(), strict=True))
    return [Piece(a, b, t_a, t_b, mode) for (a, t_a), (b, t_b) in pairwise(points)]


def on(curve, e):
    """The torque of a curve at a margin; inf where it is not."""
    return min((piece.at(e) for piece in curve if piece.a <= e <= piece.b), default=np.inf)


@pytest.mark.parametrize("seed", range(40))
def test_the_envelope_is_the_lower_of_both_everywhere(seed):
    rng = np.random.default_rng(seed)
    t_a, t_b = rng.uniform(-0.5, 0.5, 2).tolist()
    piece = Piece(0.0, 1.0, t_a, t_b, ONE)
    # A mode that keeps some margin keeps less, too: its curve begins where the envelope does.
    begin, end = [(-0.2, 1.2), (0.0, 1.2), (-0.2, 0.6), (0.0, 0.6)][seed % 4]
    curve = chain(rng, begin, end, OTHERS[0], 1 + seed % 5, 0.0)
    parts = lower(piece, curve)
    assert parts[0].a == piece.a and parts[-1].b == piece.b
    assert all(first.b == second.a for first, second in pairwise(parts))
    assert all(part.b - part.a > WIDTH for part in parts)
    # Its own line is cut only where the other curve lies below it.
    assert not any(first.mode is second.mode is ONE for first, second in pairwise(parts))
    ends = [one for part in parts for one in (part.a, part.b)]
    for e in [*np.linspace(0.001, 0.999, 200), *(end - 1e-6 for end in ends[1:])]:
        own, other = piece.at(e), on(curve, e)
        (part,) = (one for one in parts if one.a <= e < one.b)
        assert part.at(e) == pytest.approx(min(own, other), abs=1e-7)
        if abs(own - other) > 1e-5:
            assert part.mode is (ONE if own < other else OTHERS[0])


def test_what_lies_nowhere_below_changes_nothing():
    piece = Piece(0.0, 1.0, 1.0, 2.0, ONE)
    for curve in ([], [Piece(0.0, 1.0, 1.0, 2.0, OTHERS[0])], [Piece(0.2, 0.3, 5, 6, OTHERS[0])],
                  [Piece(2.0, 3.0, 0.0, 0.0, OTHERS[0])]):  # fmt: skip
        assert lower(piece, curve) == [piece]
    below = [Piece(0.0, 1.0, 0.0, 0.0, OTHERS[0])]
    assert lower(piece, below) == below
    assert lower(piece._replace(closed=True), below) == [piece._replace(closed=True)]


@pytest.mark.parametrize("slope", [0.1, 1.0, 1e4])
@pytest.mark.parametrize("near", [1e-9, 1e-7])
def test_no_piece_of_a_crossing_is_narrower_than_margins_are_told_apart(slope, near):
    piece = Piece(0.0, 1.0, 0.0, slope, ONE)
    for off in (near * slope, (1.0 - near) * slope):
        parts = lower(piece, [Piece(0.0, 1.0, off, off, OTHERS[0])])
        assert all(part.b - part.a > WIDTH for part in parts)
        for e in (0.25, 0.75):
            at = min(slope * e, off)
            assert on(parts, e) == pytest.approx(at, abs=3e-8 * max(1.0, slope))


@pytest.mark.parametrize("bend", [0.0, 1e-9, 1e-6, 0.1])
def test_pieces_of_one_mode_are_joined_where_they_go_straight_on(bend):
    pieces = [
        Piece(0.0, 0.3, 0.0, 0.3 + bend, ONE), Piece(0.3, 0.7, 0.3 + bend, 0.7, ONE),
        Piece(0.7, 1.0, 0.7, 1.0, OTHERS[0]), Piece(1.0, 2.0, 1.0, 2.0, OTHERS[1]),
        Piece(2.0, 3.0, 2.0, 3.0, OTHERS[1]),
    ]  # fmt: skip
    whole = joined(pieces)
    straight = bend < 1e-8
    assert len(whole) == (3 if straight else 4)
    assert (whole[0].a, whole[0].b) == (0.0, 0.7 if straight else 0.3)
    assert whole[-1] == Piece(1.0, 3.0, 1.0, 3.0, OTHERS[1])
    for e in np.linspace(0.0, 3.0, 100):
        assert on(whole, e) == pytest.approx(on(pieces, e), abs=1e-7)


def test_pieces_that_are_too_narrow_or_closed_are_not_looked_at():
    wide, narrow = Piece(0.0, 1.0, 0.0, 1.0, ONE), Piece(1.0, 1.0 + 0.5 * WIDTH, 1.0, 1.0, ONE)
    assert first_open([narrow, wide._replace(closed=True), wide, wide]) == 2
    assert first_open([narrow, wide._replace(closed=True)]) is None
    assert narrow._replace(b=1.0).slope == 0.0 and wide.slope == 1.0
