"""Whether one of two versions is slower: the ratio of medians, its spread, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

LEAST_ROUNDS = 7
ALLOWED = 1.05
"""The largest ratio that passes wherever its spread lies."""
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Ratio:
    """How a row's seconds compare, new over base.

    Attributes:
        base: Median seconds of the base.
        ratio: Of the medians over the rounds.
        low: Lower end of the spread: with 95 % confidence the median of the rounds' own ratios lies
            between the two ends, however they are distributed.
        high: Upper end.
    """

    base: float
    ratio: float
    low: float
    high: float

    @property
    def slower(self) -> bool:
        """Whether the ratio is above what is allowed, and not within the spread of equal times."""
        return self.ratio > ALLOWED and self.low > 1.0


def ratio_of(new: Sequence[float], base: Sequence[float]) -> Ratio:
    """Compare the seconds of one row, round by round.

    Args:
        new: (rounds,) seconds of the newer version.
        base: (rounds,) seconds of the base, each measured beside the one of the same round.

    Raises:
        ValueError: There are fewer than seven rounds, or not as many of both.
    """
    pairs = np.sort(np.divide(new, base))
    if len(pairs) < LEAST_ROUNDS:
        raise ValueError(f"{len(pairs)} rounds are too few; there must be {LEAST_ROUNDS}")
    left = _left_out(len(pairs))
    middle = float(np.median(base))
    low, high = pairs[left], pairs[-1 - left]
    return Ratio(middle, float(np.median(new) / middle), float(low), float(high))


def ratios_of(
    rounds: Sequence[tuple[Mapping[str, float], Mapping[str, float]]],
) -> dict[str, Ratio]:
    """Compare the rows that both versions have in every round.

    Args:
        rounds: Seconds by row of the new version and of the base, one pair a round.
    """
    names = [name for name in rounds[0][0] if all(name in one for pair in rounds for one in pair)]
    return {
        name: ratio_of([new[name] for new, _ in rounds], [base[name] for _, base in rounds])
        for name in names
    }


def _left_out(rounds: int) -> int:
    """How many ratios may be left out at either end: the sign test's interval of the median.

    As each ratio is as likely to lie below the median as above it, the number below it is binomial.
    """
    at_most = np.cumsum([comb(rounds, below) for below in range(rounds)]) / 2.0**rounds
    return int(np.count_nonzero(2.0 * at_most <= 1.0 - CONFIDENCE)) - 1
