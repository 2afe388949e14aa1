"""What cannot stand at a place of a document is refused by a line of the checker that says why."""

import copy
import traceback
from collections import Counter
from itertools import count

import pytest
import rest_documents
import test_coordinates_stated
from verified_documents import changed

from graspless_pin.report.verify import verify_document

REST = {"slope": ("stability", "joint_inertia"), "walls": ("stability", "joint_inertia"),
        "pressed": ("stability", "joint_inertia"), "corners": ("stability", "joint_inertia"),
        "kept": ("stability",), "lost": ("stability",)}  # fmt: skip
PARTS = {
    "tree": (), "round tree": (), "infeasible modes": (),
    "own helped": ("objective", "multipliers"), "own squared shares": ("objective", "multipliers"),
    **REST, "two boxes": ("wrench_matrix", "passive_units"),
}  # fmt: skip
"""Documents, and the parts of them that are looked at; (): all."""
INDICES = ("contact", "children", "goal")
GONE = object()


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
        return [value[:-1], [*value, *value[-1:]], "x", {}, None]
    if isinstance(value, dict):
        return [[], None]
    if isinstance(value, str):
        return ["x", 1, None]
    if isinstance(value, int) and not isinstance(value, bool):
        return [value - 1, -1, 99, 10**6, 0.5, True]
    return ["x", True, -1.0, 1e308]


def refusal(document):
    """Whether a document is refused; where it is none, by a line that says so."""
    try:
        return not verify_document(document).passed
    except ValueError as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        assert "verify" in last.filename
        assert (last.line or "").startswith("raise "), f"{last.line}: {error}"
        return True


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (("external_wrench",), "external_wrench is 'x'; it must be a list of length 6"),
        (("certificate", "bound"), "bound of certificate is 'x'; it must be a number"),
        (
            ("contacts", 0, "position"),
            "position of contact 0 is 'x'; it must be a list of length 3",
        ),
    ],
)
def test_a_refusal_names_the_place(path, words, made):
    with pytest.raises(ValueError, match=rf"^{words}$"):
        verify_document(changed(made("tree"), *path, to="x"))


@pytest.mark.sampled(4)
@pytest.mark.parametrize("share", range(4))
@pytest.mark.parametrize("name", PARTS)
def test_no_refusal_is_left_to_chance(name, share, made):
    """No message of Python or numpy about what is read, and no index from behind."""
    if name == "two boxes":
        document = test_coordinates_stated.document("pushed")
    else:
        document = rest_documents.document(name) if name in REST else made(name)
    parts, numbers = PARTS[name], count()
    for path, value in places(document, Counter(), 2 if name == "tree" else 1):
        *way, last = path
        for other in [*others(value), *([GONE] if isinstance(last, str) else [])]:
            if (parts and path[0] not in parts) or next(numbers) % 4 != share:
                continue
            false = copy.deepcopy(document)
            place = false
            for key in way:
                place = place[key]
            if other is GONE:
                del place[last]
            else:
                place[last] = other
            refused = refusal(false)
            if last in INDICES and isinstance(other, int) and not 0 <= other < 99:
                assert refused or value == other, (path, other)


WRONG = (
    # What the message has to say.
    ("friction must not be negative", ["contacts", 1, "friction"], -1e-3),
    ("max_normal_force must be positive", ["contacts", 1, "max_normal_force"], 0.0),
    ("lower must not be above upper", ["joints", 1, "lower"], 11.0),
    ("required_margin must not be negative", ["required_margin"], -1e-3),
    ("regularization must not be negative", ["regularization"], -1e-3),
    ("torque_gravity must be a number", ["joints", 1, "torque_gravity"], None),
    ("cone_edges is 2; it must be a whole number, 3 to 4096", ["cone_edges"], 2),
    ("a sign of contact 1 is -2; it must be a whole number, -1 to 1",
     ["contacts", 1, "signs"], [-2, 1]),
    ("format version is 1; it must be 2", ["format"], 1),
    ("friction of contact 1 is 1e+61; it must be a number of magnitude 1e+60 or less",
     ["contacts", 1, "friction"], 1e61),
    ("required_margin is list; it must be a number", ["required_margin"], [0.1]),
    ("max_torque_unit is 'lbf'; it must be one of N m, N", ["max_torque_unit"], "lbf"),
    ("contacts is a list of length 0; it must be a list of length 1 to 4096", ["contacts"], []),
    ("upper of joint 0 is a huge whole number", ["joints", 0, "upper"], 10**80),
    *((message, ["proof", "nodes"], [{"kind": "kinematic", "combination": entries}])
      for message, entries in (
          ("0 to 2", [[0, 3, 1.0]]),
          ("0 to 5", [[6, 0, 1.0]]),
          ("a list of length 2; it must be a list of length 3", [[0, 1]]),
          ("a list of length 4; it must be a list of length 3", [[0, 1, 1.0, 1.0]]),
          ("a list of length 19; it must be a list of length 0 to 18", [[0, 1, 1.0]] * 19),
      )),
    *((message, ["multipliers", "faces"], [entry])
      for message, entry in (
          ("must be a list of length 3", [0, 0]),
          ("must be a list of length 3", [0, 0, 1.0, 1.0]),
          ("a contact of multipliers is", [6, 0, 1.0]),
          ("a face of multipliers is", [0, 6, 1.0]),
      )),
    ("", ["margin"], 10**400),
    ("", ["margin"], float("nan")),
    ("", ["contacts", 0, "force"], [float("inf"), 0.0, 0.0]),
    ("", ["contacts", 0, "friction"], "0.3"),
    ("", ["contacts", 0, "position"], None),
    ("", ["contacts", 0, "normal"], [0.0, 1.0]),
    ("", ["external_wrench"], [0.0] * 7),
    ("", ["contacts", 0, "signs"], [[1, 1]]),
    ("", ["required_margin"], True),
    ("", ["joints"], {}),
    ("", ["contacts", 0], "finger"),
    ("", ["certificate", "bound"], 1e300),
    ("", ["cone_edges"], 10**9),
    ("", ["cone_edges"], 6.5),
    ("", ["rules", "sign_rule"], "loose"),
    ("", ["algorithm"], "both"),
    ("", ["status"], "perfect"),
    ("", ["certificate"], None),
    ("", ["proof"], None),
    ("", ["proof", "nodes"], [None]),
    ("", ["proof", "nodes"], []),
    ("", ["proof", "nodes"], [{"kind": "contact", "contact": 0}] * 20_000),
    ("", ["proof", "nodes"], [{"kind": "contact", "contact": 99}]),
    ("", ["proof", "nodes"], [{"kind": "contact", "contact": 6}]),
    ("", ["joints", 0, "unit"], "lbf"),
    ("", ["format"], True),
)  # fmt: skip
WRONG_OBJECTIVES = (
    (["objective"], None),
    (["algorithm"], "own"),
    (["objective", "keeps"], ["balance", "torque"]),
    (["objective", "unit"], 0.0),
    (["objective", "columns", 0, "curvature"], [-1.0, 2.0]),
    (["objective", "force_curvature", 0, 0], -1.0),
    (["objective", "columns", 0, "values"], [0.0]),
    (["objective", "rows", 0, "forces"], [[7, 0, 0, 1.0]]),
    (["objective", "rows", 0, "forces"], [[0, 6, 0, 1.0]]),
    (["objective", "rows", 0, "forces"], [[0, 0, 3, 1.0]]),
    (["objective", "rows", 0, "forces"], [[0, 0, -1, 1.0]]),
    (["objective", "rows", 0, "forces"], [[0, -1, 0, 1.0]]),
    (["objective", "terms", "balance"], [[0, 9, 1.0]]),
    (["objective", "rows", 0, "shape"], [4096, 4096]),
    (["objective", "rows", 0, "high"], [1.0, 1.0]),
    (["objective", "rows", 0, "sign"], "both"),
    (["objective", "face_margins", 0], "0.1"),
)


@pytest.mark.parametrize(
    ("name", "message", "path", "value"),
    [*(("tree", *one) for one in WRONG),
     *(("own squared shares", "", *one) for one in WRONG_OBJECTIVES)],
    ids=lambda one: repr(one)[:40],
)  # fmt: skip
def test_what_is_no_document_gets_one_message(made, name, message, path, value):
    with pytest.raises(ValueError, match=r".") as caught:
        verify_document(changed(made(name), *path, to=value))
    assert type(caught.value) is ValueError
    assert message in str(caught.value)
    assert len(str(caught.value)) < 300
    assert "unpack" not in str(caught.value)
