"""Names of materials that no body has: misspelt ones and useless tables are warned of."""

import pytest
from scene_tools import loaded

from graspless_pin.errors import GrasplessPinWarning
from graspless_pin.geometry.bodies.object_and_supports import Materials

TEXT = """\
object: {shape: {type: box, size: [0.2, 0.2, 0.2]}, mass: 1.0, material: cardboard}
supports:
  - {name: floor, shape: {type: half_space}, pose: {position: [0, 0, -0.1]}, material: rubber}
friction: 0.5
materials:
  rubber:
    cardboard: 0.9
    steel: 0.7
"""


def without(name: str) -> str:
    return TEXT.replace(f", material: {name}", "")


def test_a_shared_table_is_fine(tmp_path):
    """Steel is of no body, and like no other name. Warnings are errors here."""
    assert loaded(tmp_path, TEXT).problem().friction.tolist() == [0.9] * 4


def test_a_table_of_a_scene_without_materials_is_fine(tmp_path):
    bare = without("cardboard").replace(", material: rubber", "")
    assert loaded(tmp_path, bare).problem().friction.tolist() == [0.5] * 4


@pytest.mark.parametrize(
    ("line", "key", "said"),
    [
        ("  ruber: {steel: 0.3}\n", "materials.ruber.steel", "'ruber'; did you mean 'rubber'"),
        ("  Rubber: {glass: 0.3}\n", "materials.Rubber.glass", "'Rubber'; did you mean 'rubber'"),
        ("  glass: {cardbord: 1}\n", "materials.glass.cardbord", "did you mean 'cardboard'"),
    ],
)
def test_a_misspelt_name_is_named_with_its_line(tmp_path, line, key, said):
    with pytest.warns(GrasplessPinWarning) as caught:
        loaded(tmp_path, TEXT + line)
    (message,) = (str(item.message) for item in caught)
    assert f"scene.yaml:9: {key}: no body has the material " in message and said in message


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (without("rubber"), "the object is of 'cardboard', hand and supports are of no material"),
        (without("cardboard"), "the object is of no material, hand and supports are of 'rubber'"),
        (
            TEXT.replace("cardboard: 0.9", "glass: 0.9") + "  steel: {cardboard: 0.2}\n",
            "the object is of 'cardboard', hand and supports are of 'rubber'",
        ),
    ],
)
def test_a_table_that_counts_nowhere(tmp_path, text, said):
    with pytest.warns(GrasplessPinWarning) as caught:
        loaded(tmp_path, text)
    (message,) = (str(item.message) for item in caught)
    assert "scene.yaml:5: materials: no pair of materials has an effect, as " in message
    assert (
        said in message
        and "add the pair of these materials, or the missing key 'material'" in message
    )


def test_names_that_differ_in_digits_are_different_materials():
    table = Materials.from_table({"nylon_6": {"nylon_12": 0.2}, "nylon6": {"steel": 0.2}})
    assert table.misspelt(["nylon_12", "steel"]) == {}
    assert table.misspelt(["nylon_6", "steel"]) == {"nylon6": "nylon_6"}
    assert table.misspelt([]) == {}
