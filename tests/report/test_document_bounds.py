"""Documents are bounded before anything is made of them: contacts, names, numbers."""

import tracemalloc

import numpy as np
import pytest
from report_cases import AT_REST, pinched_block, solved, through_json

from graspless_pin import bounds, maximize_margin
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry import Box, ManipulatedObject, Support
from graspless_pin.report import read_solution
from graspless_pin.report.html import case_of_document
from graspless_pin.report.verify import values, verify_document


@pytest.fixture
def document():
    scene, solution = solved(AT_REST)
    return through_json(solution, scene)


def many(document, count):
    listed = document["contacts"]
    document["contacts"] = [listed[index % len(listed)] for index in range(count)]


def refused(document) -> str:
    """What is said of a document that is refused before it takes memory, or warns."""
    tracemalloc.start()
    try:
        with pytest.raises(ArgumentError) as caught, np.errstate(all="raise"):
            read_solution(document)
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()
    assert len(str(caught.value)) < 400
    return str(caught.value)


def test_more_contacts_or_joints_than_the_checker_reads(document):
    document["joints"] *= 3000
    assert "joints: has 6000 entries" in refused(document)
    document["joints"] = document["joints"][:2]
    many(document, 4097)
    assert "contacts: has 4097 entries; at most 4096 are allowed" in refused(document)
    with pytest.raises(ValueError, match="a list of length 4097"):
        verify_document(document)


@pytest.mark.parametrize(("count", "edges"), [(1500, 6), (1500, 8), (110, 1024)])
def test_more_coefficients_than_any_scene_has(document, count, edges):
    """The program is dense: memory grows with the square of the contacts."""
    many(document, count)
    document["cone_edges"] = edges
    said = refused(document)
    assert f"contacts: {count} contacts" in said
    assert "at most 3e+07" in said


NAMES = {
    "joints[0].name": lambda document, name: document["joints"][0].update(name=name),
    "contacts[2].bodies": lambda document, name: document["contacts"][2].update(bodies=[name, "x"]),
    "scene": lambda document, name: document.update(scene=name),
    "object.name": lambda document, name: document["object"].update(name=name),
    "certificate.solver": lambda document, name: document["certificate"].update(solver=name),
}


@pytest.mark.parametrize("key", NAMES)
def test_names(document, key):
    NAMES[key](document, "n" * 200)
    case_of_document(document)
    for length in (201, 1_000_000):
        NAMES[key](document, "n" * length)
        said = refused(document)
        assert f"{key}: has the name '{'n' * 30}'... of {length} characters" in said
        assert "at most 200" in said


@pytest.mark.parametrize("value", [1.1e60, 1e160, -1e300, 10**400])
def test_numbers_whose_products_no_double_holds(document, value):
    for place in (document["contacts"][1]["force"], document["proof"]["motion"]["object"]):
        before, place[0] = place[0], value
        said = refused(document)
        assert "its magnitude must be at most 1e+60" in said
        place[0] = before
    assert read_solution(document).found


def test_the_checker_has_the_same_bounds(document):
    """It imports nothing else of the package, and reads what this reads."""
    assert values.MOST_LETTERS == bounds.LONGEST_NAME
    assert values.MOST == bounds.MOST_CONTACTS
    assert values.LARGEST_READ == bounds.LARGEST_STATED
    document["joints"][0]["name"] = "n" * 201
    with pytest.raises(ValueError, match="at most 200 characters"):
        verify_document(document)


def test_bodies_and_problems_have_names_that_documents_may_have():
    shape, pose = Box((0.1, 0.1, 0.1)), np.eye(4)
    for make in (
        lambda name: ManipulatedObject.from_shape(name, shape, pose, mass=1.0),
        lambda name: Support(name, shape, pose),
    ):
        with pytest.raises(ArgumentError, match=r"name: .* of 201 characters; .* at most 200"):
            make("n" * 201)
        assert make("n" * 200).name == "n" * 200
    with pytest.raises(ArgumentError, match=r"joint_names: .* of 300 characters; .* at most 200"):
        pinched_block(joint_names=["n" * 300, "b"])
    document = through_json(maximize_margin(pinched_block(joint_names=["n" * 200, "b"])))
    assert verify_document(document).passed
    assert read_solution(document).problem.joint_names[0] == "n" * 200
