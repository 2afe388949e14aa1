"""What a document may hold at most: looked at before anything is made of it.

The program of a document is dense: its size grows with the square of the contacts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from graspless_pin.errors import ArgumentError
from graspless_pin.intake.text import fault_of_name
from graspless_pin.magnitudes import (
    LARGEST_STATED,
    MOST_COEFFICIENTS,
    MOST_CONE_EDGES,
    MOST_CONTACTS,
)

_ROUND_ROWS = 3
"""Rows of a round cone."""
_OWN_ROWS = 3
"""Rows of a contact beside those of its cone."""


def check_bounds(document: dict[str, Any]) -> None:
    """Refuse a document with too many contacts or joints, too long a name or too large a number.

    Values of wrong types pass: whoever reads them refuses them.

    Raises:
        ArgumentError: Naming the key, what was found and what would do.
    """
    contacts, joints = (_listed(document, key) for key in ("contacts", "joints"))
    for key, entries in (("contacts", contacts), ("joints", joints)):
        if len(entries) > MOST_CONTACTS:
            raise ArgumentError(
                "document", f"{key}: has {len(entries)} entries; at most {MOST_CONTACTS} are read"
            )
    size = _coefficients(document, len(contacts), len(joints))
    if size > MOST_COEFFICIENTS:
        raise ArgumentError(
            "document",
            f"contacts: {len(contacts)} of them, with their cones, make a program of {size:.2g} "
            f"coefficients; at most {MOST_COEFFICIENTS:.2g} are read: solve with fewer cone edges "
            "or points_per_patch",
        )
    for key, name in _names(document):
        if fault := fault_of_name(name):
            raise ArgumentError("document", f"{key}: {fault}")
    for key, value in document.items():
        _check_magnitudes(key, value)


def _coefficients(document: dict[str, Any], contacts: int, joints: int) -> int:
    """Return the rows times the columns of a document's program, or a little more."""
    edges, faces = document.get("cone_edges"), _ROUND_ROWS
    if isinstance(edges, int) and document.get("cone") != "round":
        faces = min(edges, MOST_CONE_EDGES)
    rows, columns = contacts * (faces + _OWN_ROWS) + 2 * joints + 6, 3 * contacts + 1
    own = document.get("objective")
    if isinstance(own, dict):
        rows += sum(len(_listed(one, "unit")) for one in _listed(own, "rows"))
        columns += sum(len(_listed(one, "unit")) for one in _listed(own, "columns"))
    return rows * columns


def _names(document: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the names of a document with their keys."""
    for index, joint in enumerate(_listed(document, "joints")):
        yield f"joints[{index}].name", _text(joint, "name")
    for index, contact in enumerate(_listed(document, "contacts")):
        for body in _listed(contact, "bodies"):
            if isinstance(body, str):
                yield f"contacts[{index}].bodies", body
    yield "scene", _text(document, "scene")
    yield "object.name", _text(document.get("object"), "name")
    yield "certificate.solver", _text(document.get("certificate"), "solver")
    own = document.get("objective")
    yield "objective.name", _text(own, "name")
    for key in ("columns", "rows"):
        for index, one in enumerate(_listed(own, key)):
            yield f"objective.{key}[{index}].name", _text(one, "name")


def _check_magnitudes(key: str, value: Any) -> None:
    """Refuse numbers whose products no double holds, below one key."""
    waiting = [(key, value)]
    while waiting:
        where, item = waiting.pop()
        if isinstance(item, dict):
            waiting += [(f"{where}.{name}", one) for name, one in item.items()]
        elif isinstance(item, list):
            waiting += [(where, one) for one in item]
        elif isinstance(item, int | float) and LARGEST_STATED < abs(item) < math.inf:
            raise ArgumentError(
                "document",
                f"{where[:100]}: has the number {item!r:.30}; numbers up to {LARGEST_STATED:g} "
                "are read",
            )


def _listed(holder: Any, key: str) -> list[Any]:
    """Return what a mapping lists under a key; nothing where there is no such list."""
    found = holder.get(key) if isinstance(holder, dict) else None
    return found if isinstance(found, list) else []


def _text(holder: Any, key: str) -> str:
    """Return a text under a key; empty where there is none."""
    found = holder.get(key) if isinstance(holder, dict) else None
    return found if isinstance(found, str) else ""
