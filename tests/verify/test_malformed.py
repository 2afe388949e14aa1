"""What cannot stand at a place of a document is refused by a line of the checker that says why."""

import copy
import traceback
from collections import Counter

import pytest
import test_coordinates_stated
import test_kept_motions
import test_own_objectives
import test_rest
from verified_documents import SOLUTIONS, documented

from graspless_pin.report.verify import verify_document

OWN = test_own_objectives.SOLUTIONS
DOCUMENTS = {
    **{name: (lambda name=name: documented(SOLUTIONS[name]()), ())
       for name in ("tree", "round tree", "infeasible modes")},
    **{name: (lambda name=name: documented(OWN[name]()), ("objective", "multipliers"))
       for name in ("helped", "squared shares")},
    **{name: (lambda name=name: test_rest.document(name), ("stability", "joint_inertia"))
       for name in ("slope", "walls", "pressed", "corners")},
    **{name: (lambda name=name: test_kept_motions.document(name), ("stability",))
       for name in ("kept", "lost")},
    "two boxes": (lambda: test_coordinates_stated.document("pushed"),
                  ("wrench_matrix", "passive_units")),
}  # fmt: skip
INDICES = ("contact", "children", "goal")


def places(value, seen, most, path=()):
    """The ways to values, so many at most that differ in places of lists alone."""
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        way = (*path, key)
        kind = tuple(part for part in way if isinstance(part, str)), len(way), type(item)
        seen[kind] += 1
        if seen[kind] > most:
            continue
        yield way, item
        if isinstance(item, dict | list):
            yield from places(item, seen, most, way)


def others(value):
    """What cannot stand in the place of a value."""
    if isinstance(value, list):
        return [value[:-1], [*value, *value[-1:]], "x", None]
    if isinstance(value, dict):
        return [[], None]
    if isinstance(value, str):
        return ["x", 1, None]
    if isinstance(value, int) and not isinstance(value, bool):
        return [value - 1, -1, 99, 10**6, 0.5, True]
    return ["x", True, -1.0]


def refusal(document):
    """Whether a document is refused; where it is none, by a line that says so."""
    try:
        return not verify_document(document).passed
    except ValueError as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        assert "verify" in last.filename
        assert (last.line or "").startswith("raise "), f"{last.line}: {error}"
        return True


@pytest.mark.parametrize("name", DOCUMENTS)
def test_no_refusal_is_left_to_chance(name):
    """No message of Python or numpy about what is read, and no index from behind."""
    make, parts = DOCUMENTS[name]
    document = make()
    most = 2 if name == "tree" else 1
    for path, value in places(document, Counter(), most):
        if parts and path[0] not in parts:
            continue
        *way, last = path
        for other in others(value):
            false = copy.deepcopy(document)
            place = false
            for key in way:
                place = place[key]
            place[last] = other
            refused = refusal(false)
            if last in INDICES and isinstance(other, int) and not 0 <= other < 99:
                assert refused or value == other, (path, other)
