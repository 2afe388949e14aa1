"""Where contacts appear, vanish, begin or cease to slide along a path."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from graspless_pin.planning.evaluation import Evaluation


@dataclass(frozen=True)
class ContactChange:
    """How the contacts of a waypoint differ from those of the one before.

    Torques may jump here, and only here. See the example of `evaluate_path`.

    Attributes:
        waypoint: Index of the waypoint with the new contacts.
        gained: Hand links and supports, a name for each contact that was not there.
        lost: The same for contacts that are gone.
        starts_sliding: The same for contacts that slide now and did not.
        stops_sliding: The same for contacts that slid and do not now.
    """

    waypoint: int
    gained: tuple[str, ...]
    lost: tuple[str, ...]
    starts_sliding: tuple[str, ...]
    stops_sliding: tuple[str, ...]


def contact_changes(evaluations: Sequence[Evaluation]) -> tuple[ContactChange, ...]:
    """Return where the contacts differ from those of the waypoint before."""
    changes = []
    before = _touching(evaluations[0])
    for k, evaluation in enumerate(evaluations[1:], start=1):
        now = _touching(evaluation)
        change = ContactChange(
            k,
            gained=_more(now[0], before[0]),
            lost=_more(before[0], now[0]),
            starts_sliding=_more(now[1], before[1]),
            stops_sliding=_more(before[1], now[1]),
        )
        if now != before:
            changes.append(change)
        before = now
    return tuple(changes)


def _touching(evaluation: Evaluation) -> tuple[Counter[str], Counter[str]]:
    """Contacts by body, and those of them that slide."""
    if not evaluation.has_contacts:
        return Counter(), Counter()
    contacts = evaluation.contacts
    sliding = [
        name
        for name, velocity in zip(contacts.bodies, contacts.sliding, strict=True)
        if velocity.any()
    ]
    return Counter(contacts.bodies), Counter(sliding)


def _more(some: Counter[str], others: Counter[str]) -> tuple[str, ...]:
    return tuple((some - others).elements())
