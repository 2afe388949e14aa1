"""A YAML text that is edited holds what it should, and keeps all that need not change."""

from __future__ import annotations

import json

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from graspless_pin.intake.yaml_text import edited_yaml, parse_yaml

TEXT = """\
# A hand.
name: 'one' # kept as it is
hand:
  q: { # all joints
    a.0: 1.50, b: -0, # first
    c: 2, # second
  }
  pose: {position: [0, 0, 0.10], rpy: [0, 1.570796, 0]}
supports: # what it leans on
  - name: table # wood
    shape: {type: half_space}

  # The second one.
  - {name: wall, shape: {type: box, size: [1, 2, 3]}}
motion:
  linear: [1, 0, 0]
  # about y
  angular: [0, 1, 0] # the last line
"""


def edited(change, text=TEXT):
    """Return the text after a change of its data, which must be what the new text holds."""
    data = json.loads(json.dumps(parse_yaml(text).data))  # what aliases share is shared no more
    change(data)
    found = edited_yaml(text, data)
    assert parse_yaml(found).data == data
    return found


def put(*place, value):
    def change(data):
        for key in place[:-1]:
            data = data[key]
        data[place[-1]] = value

    return change


def drop(*place):
    def change(data):
        for key in place[:-1]:
            data = data[key]
        del data[place[-1]]

    return change


def test_what_does_not_change_stays_as_it_is():
    assert edited(lambda data: None) == TEXT
    assert edited(put("hand", "q", "a.0", value=1.5)) == TEXT


@pytest.mark.parametrize(
    ("change", "old", "new"),
    [
        (put("name", value="two"), "'one' #", "two #"),
        (put("name", value="yes"), "'one' #", "'yes' #"),
        (put("hand", "q", "b", value=1e-5), "b: -0,", "b: 1.0e-05,"),
        (put("hand", "q", "d", value=3), "c: 2, # second", "c: 2, d: 3, # second"),
        (drop("hand", "q", "b"), "b: -0, # first", "# first"),
        (drop("hand", "q", "c"), "c: 2, # second", "# second"),
        (put("hand", "pose", "position", 2, value=0.25), "0.10", "0.25"),
        (drop("hand", "pose", "rpy"), ", rpy: [0, 1.570796, 0]", ""),
        (drop("supports", 1, "shape", "type"), "type: box, ", ""),
        (drop("supports", 0, "shape"), "    shape: {type: half_space}\n", ""),
        (drop("supports", 0, "name"), "name: table # wood\n    shape", "shape"),
        (
            drop("supports", 0),
            "  - name: table # wood\n    shape: {type: half_space}\n",
            "",
        ),
        (
            put("supports", 0, "friction", value=0.5),
            "half_space}\n",
            "half_space}\n    friction: 0.5\n",
        ),
        (
            lambda data: data["supports"].append({"name": "new", "shape": {"type": "sphere"}}),
            "[1, 2, 3]}}\n",
            "[1, 2, 3]}}\n  - name: new\n    shape: {type: sphere}\n",
        ),
        (
            put("motion", "hand", value={"linear": [1, 2, 3]}),
            "# the last line\n",
            "# the last line\n  hand:\n    linear: [1, 2, 3]\n",
        ),
        (drop("motion", "angular"), "  angular: [0, 1, 0] # the last line\n", ""),
        (
            put("motion", value=None),
            "motion:\n  linear: [1, 0, 0]\n  # about y\n  angular: [0, 1, 0]",
            "motion: null",
        ),
    ],
)
def test_a_change_changes_its_own_place(change, old, new):
    assert TEXT.count(old) == 1
    assert edited(change) == TEXT.replace(old, new)


def test_anchors_stay_and_what_repeats_them_is_written_out():
    text = "a: &one {x: 1} # first\nb: *one # second\nc: [*one, 2]\n"
    assert edited(put("b", "x", value=2), text) == text.replace("*one # s", "{x: 2} # s")
    changed = edited(put("a", "x", value=2), text)
    assert changed == "a: &one {x: 2} # first\nb: {x: 1} # second\nc: [{x: 1}, 2]\n"
    whole = edited(put("a", value=5), text)
    assert whole == "a: &one 5 # first\nb: {x: 1} # second\nc: [{x: 1}, 2]\n"


def test_what_cannot_be_patched_is_written_anew():
    merged = "base: &b {x: 1, y: 2}\nown:\n  <<: *b # merged\n  y: 3\nlast: 1 # kept\n"
    assert edited(put("own", "x", value=4), merged).endswith("last: 1 # kept\n")
    assert edited(drop("base"), merged) == "own: {x: 1, y: 3}\nlast: 1\n"
    assert edited(put("a", value=1), "# nothing but\n--- {}\n").startswith("# nothing but")


@pytest.mark.parametrize("end", ["", "\n", "\r\n", "\n...\n", "\n# the end"])
def test_ends_of_lines_and_of_the_text(end):
    text = f"a: 1{end}"
    assert edited(put("b", value=[1, {"c": "d"}]), text).startswith("a: 1")
    assert edited(put("a", value=2), text) == f"a: 2{end}"


def test_texts_of_several_lines():
    text = "a: |\n  one\n  two\nb: >-\n  three\n"
    assert edited(put("c", value=1), text) == f"{text}c: 1\n"
    assert edited(put("a", value="four\nfive"), text).endswith("b: >-\n  three\n")
    assert edited(drop("a"), text) == "b: >-\n  three\n"


NAMES = st.sampled_from(["a", "joint_1.0", "yes", "left/x", "1", "x" * 150, "a: b", "# c", "- d"])
LEAVES = (
    st.none()
    | st.booleans()
    | st.integers(-9, 9)
    | st.floats(-1e9, 1e9)
    | st.sampled_from(["", "no", "1:30", "a, b", "{", "~", "1e5", "2020-01-01", "two\nlines", "é"])
)
DATA = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=3),
    max_leaves=8,
)
FILES = st.dictionaries(NAMES, DATA, min_size=1, max_size=4)


@settings(max_examples=20)
@given(FILES, FILES, st.sampled_from([True, False, None]))
def test_any_data_can_take_the_place_of_any_other(before, after, flow):
    text = yaml.safe_dump(before, default_flow_style=flow, sort_keys=False, allow_unicode=True)
    for wanted in (after, before | after):
        assert parse_yaml(edited_yaml(text, wanted)).data == wanted
