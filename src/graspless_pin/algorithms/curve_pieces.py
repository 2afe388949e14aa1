"""Piecewise linear curves of torque over margin, and their lower envelope; scaled."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from graspless_pin.modes.rules import SlidingMode

STRAIGHT = 2e-8
"""Torques closer than this, over the torque scale, are the same."""
WIDTH = 1e-8
"""Margins closer than this, over the load, are the same."""


class Piece(NamedTuple):
    """A straight piece of a curve, scaled.

    Attributes:
        a: Margin where it begins.
        b: Margin where it ends.
        t_a: Torque at its begin.
        t_b: Torque at its end.
        mode: Whose optimum it is.
        closed: Whether a search has ended that looked for something below it.
    """

    a: float
    b: float
    t_a: float
    t_b: float
    mode: SlidingMode | None
    closed: bool = False

    @property
    def slope(self) -> float:
        """Torque per margin."""
        return (self.t_b - self.t_a) / (self.b - self.a) if self.b > self.a else 0.0

    def at(self, e: float) -> float:
        """Return the torque at a margin, on the line through the piece."""
        return self.t_a + self.slope * (e - self.a)

    def part(self, a: float, b: float) -> Piece:
        """Return the same line between two margins."""
        return self._replace(a=a, b=b, t_a=self.at(a), t_b=self.at(b))


def first_open(pieces: list[Piece]) -> int | None:
    """Return the index of the first piece that counts and is not closed."""
    return next(
        (i for i, piece in enumerate(pieces) if not piece.closed and piece.b - piece.a > WIDTH),
        None,
    )


def lower(piece: Piece, curve: list[Piece]) -> list[Piece]:
    """Return the lower envelope of a piece and another curve over the piece's margins."""
    if piece.closed:
        return [piece]
    parts: list[Piece] = []
    for other in curve:
        low, high = max(piece.a, other.a), min(piece.b, other.b)
        if high - low > WIDTH:
            parts += _lower_of_two(piece.part(low, high), other.part(low, high))
    covered = parts[-1].b if parts else piece.a
    if piece.b - covered > WIDTH:
        parts.append(piece.part(covered, piece.b))
    merged: list[Piece] = []
    for part in parts:
        if merged and part.mode is piece.mode is merged[-1].mode:
            merged.pop()  # part of the same line
        merged.append(part)
    if all(part.mode is piece.mode for part in merged):
        return [piece]
    # What is too narrow to count was left out: parts begin where the one before them ends.
    begins = [piece.a, *(part.b for part in merged[:-1])]
    ends = [*begins[1:], piece.b]
    return [part.part(a, b) for part, a, b in zip(merged, begins, ends, strict=True)]


def _lower_of_two(one: Piece, other: Piece) -> list[Piece]:
    """Return the lower envelope of two pieces over the same margins; of equal ones the first."""
    slack = STRAIGHT * max(1.0, abs(one.slope), abs(other.slope))
    before, after = other.t_a - one.t_a, other.t_b - one.t_b
    if min(before, after) >= -slack:
        return [one]
    if max(before, after) <= slack:
        return [other]
    # Farther than WIDTH from both ends: slack is at least two widths of either slope.
    crossing = one.a + (one.b - one.a) * before / (before - after)
    first, second = (one, other) if before > 0.0 else (other, one)
    return [first.part(one.a, crossing), second.part(crossing, one.b)]


def joined(pieces: list[Piece]) -> list[Piece]:
    """Return the same curve with pieces of one mode joined where they go straight on."""
    joined: list[Piece] = []
    for piece in pieces:
        last = joined[-1] if joined else None
        if last is not None and last.mode == piece.mode:
            whole = last._replace(b=piece.b, t_b=piece.t_b)
            steep = max(1.0, abs(whole.slope))
            if max(abs(whole.at(e) - t) for e, t in _ends(last, piece)) <= STRAIGHT * steep:
                joined[-1] = whole
                continue
        joined.append(piece)
    return joined


def _ends(last: Piece, piece: Piece) -> Iterator[tuple[float, float]]:
    yield last.b, last.t_b
    yield piece.a, piece.t_a
