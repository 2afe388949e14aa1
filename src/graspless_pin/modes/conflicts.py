"""From a combination of contact velocities that all but vanishes to the conflict it proves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from graspless_pin.modes.fastest_sliding import TAKES_PART, length, signed_rows
from graspless_pin.modes.feasibility import Conflict
from graspless_pin.modes.rules import SignRule
from graspless_pin.problem.checks import FloatArray, all_finite, read_only


def conflict_of(
    seen: FloatArray,
    contacts: tuple[int, ...],
    signs: NDArray[np.int_],
    rule: SignRule,
    still: FloatArray,
    weights: FloatArray,
    threshold: float,
) -> Conflict:
    """Name the requirements whose combination all but vanishes.

    Args:
        seen: (M, 3, r) contact velocities of all motions along n, t1, t2.
        contacts: s selected contacts.
        signs: (s, 2) their required signs.
        rule: How a zero sign is read.
        still: (k, r) rows that vanish on the selected contacts.
        weights: Of the required rows, see `signed_rows`.
        threshold: The slowest sliding that counts.
    """
    moving, strict = signed_rows(seen[list(contacts), 1:], signs, rule)
    # Rows that must be positive stay whatever the others weigh.
    most = np.where(strict > 0.0, (weights * strict).max(), weights.max())
    weights = np.where(weights > TAKES_PART * most, weights, 0.0)
    weights /= float(weights @ strict)
    # Each weighted row stands for one component, or for both of a contact (their sum).
    pairs, values = signs.tolist(), weights.tolist()
    given = [(k, m) for k, pair in enumerate(pairs) for m in (0, 1) if pair[m]]
    share = [[0.0, 0.0] for _ in contacts]
    for (k, m), weight in zip(given, values, strict=False):
        share[k][m] += weight
    both = [k for k, pair in enumerate(pairs) if all(pair)]
    for k, weight in zip(both, values[len(given) :], strict=False):
        share[k] = [own + weight for own in share[k]]
    items = tuple([(contacts[k], m, pairs[k][m]) for k, m in given if share[k][m] > 0.0])
    # The rest of the combination is carried by rows that vanish: a basic solution names few.
    carried = reactions(still, -(weights @ moving), threshold).tolist()
    owners, places = list(contacts), [0] * len(contacts)
    if rule is SignRule.EXACT:
        zeros = np.flatnonzero(signs.ravel() == 0)
        owners += [contacts[index // 2] for index in zeros]
        places += [int(1 + index % 2) for index in zeros]
    largest = max((1.0, *map(abs, carried)))
    combination, carrying = np.zeros(seen.shape[:2]), set[int]()
    combination[list(contacts), 1:] = signs * np.array(share)
    for owner, place, reaction in zip(owners, places, carried, strict=True):
        if abs(reaction) > TAKES_PART * largest:
            carrying.add(owner)
            combination[owner, place] = reaction
    others = tuple(sorted(carrying - {contact for contact, _, _ in items}))
    return Conflict(items, others, read_only(combination))


def reactions(still: FloatArray, rest: FloatArray, threshold: float) -> FloatArray:
    """Weights of rows that vanish which make up for the rest of a combination, few if possible."""
    from scipy.optimize import nnls

    try:
        halves, _ = nnls(np.concatenate((still.T, -still.T), axis=1), rest)
        if all_finite((halves,)):
            found: FloatArray = halves[: len(still)] - halves[len(still) :]
            if length(found @ still - rest) < threshold:
                return found
    except RuntimeError:
        pass
    return np.linalg.lstsq(still.T, rest)[0].astype(np.float64)
