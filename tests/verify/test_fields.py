"""The table of fields: the page that lists it, and documents that hold nothing beside it."""

import re
from pathlib import Path

import pytest
from forgeries import base

from graspless_pin.report.verify.fields import FIELDS, Part
from graspless_pin.report.verify.reading import read_problem

PAGE = Path(__file__).parents[2] / "docs" / "document_format.md"


def listed(part):
    """The lines of the page for a part of a document: a heading, and a table of its fields."""
    yield from (f"### {part}", "", "| field | holds |", "|---|---|")
    for key, field in FIELDS[part].items():
        what = re.sub(
            r"see ([a-z ]+)", lambda see: f"[{see[1]}](#{see[1].replace(' ', '-')})", field.what
        )
        yield f"| `{key}` | {what} |"


@pytest.mark.parametrize("part", FIELDS)
def test_the_page_lists_every_field(part):
    assert "\n".join(listed(part)) + "\n\n" in PAGE.read_text(encoding="utf-8") + "\n"


def parts(value):
    """A part of a document, and all parts within it."""
    if isinstance(value, list):
        for one in value:
            yield from parts(one)
    elif isinstance(value, Part):
        yield value
        for key, field in FIELDS[value.kind].items():
            if "see " in field.what:
                yield from parts(value.get(key))


@pytest.mark.parametrize("name", ["slope", "kept", "guaranteed", "borne flat", "walls of a scene"])
def test_no_document_has_other_fields(name):
    document = base(name)
    found = list(parts(read_problem(document).part(document)))
    assert {"document", "contact", "node", "rest node"} <= {
        part.kind for part in found
    } or name != "slope"
    for part in found:
        assert part.stated.keys() <= FIELDS[part.kind].keys(), part.where


@pytest.mark.parametrize("name", ["own helped", "round tree", "infeasible modes", "exact tree"])
def test_no_document_of_an_answer_has_other_fields(made, name):
    document = made(name)
    own = {f"{row['name']}{end}" for row in document.get("objective", {}).get("rows", ())
           for end in ("", "_upper", "_lower")}  # fmt: skip
    for part in parts(read_problem(document).part(document)):
        known = FIELDS[part.kind].keys() | (own if part.kind == "multipliers" else set())
        assert part.stated.keys() <= known, part.where
