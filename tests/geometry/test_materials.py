"""Friction between materials: lookup in either order, and tables that cannot be used."""

import pytest

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.object_and_supports import Materials

TABLE = {
    "rubber": {"cardboard": 0.9, "steel": 0.6, "rubber": 1.1},
    "steel": {"cardboard": 0.3, "rubber": 0.6},
}


def test_a_pair_is_found_in_either_order_and_with_itself() -> None:
    materials = Materials.from_table(TABLE)
    assert materials.names == ("cardboard", "rubber", "steel")
    for first, second, value in (
        ("rubber", "cardboard", 0.9),
        ("steel", "cardboard", 0.3),
        ("steel", "rubber", 0.6),
        ("rubber", "rubber", 1.1),
    ):
        assert materials.friction(first, second) == value
        assert materials.friction(second, first) == value


def test_a_missing_pair_says_what_to_add() -> None:
    materials = Materials.from_table(TABLE)
    with pytest.raises(
        ArgumentError, match=r"materials: has no coefficient for 'steel' on 'steel'; add"
    ):
        materials.friction("steel", "steel")
    with pytest.raises(
        ArgumentError, match=r"'wood' is in no pair of materials; known: cardboard, rubber, steel"
    ):
        materials.friction("steel", "wood")
    with pytest.raises(ArgumentError, match=r"object.material: 'wood' is in no pair"):
        materials.check(["rubber", "wood"], "object.material")
    materials.check(["rubber", "steel"])


@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf"), True])
def test_a_coefficient_is_zero_or_more(value: float) -> None:
    with pytest.raises(ArgumentError, match=r"materials\['a'\]\['b'\]: is .*; it must be a finite"):
        Materials.from_table({"a": {"b": value}})


def test_a_pair_cannot_have_two_coefficients() -> None:
    with pytest.raises(
        ArgumentError, match=r"\['b'\]\['a'\]: is 0.4, but the reversed pair has 0.3"
    ):
        Materials.from_table({"a": {"b": 0.3}, "b": {"a": 0.4}})


def test_a_name_cannot_be_empty() -> None:
    with pytest.raises(ArgumentError, match="needs two names"):
        Materials.from_table({"a": {" ": 0.3}})


def test_the_record_cannot_be_changed() -> None:
    table = {"a": {"b": 0.3}}
    materials = Materials.from_table(table)
    table["a"]["b"] = 5.0
    assert materials.friction("a", "b") == 0.3
    pairs = dict(materials.coefficients)
    again = Materials(pairs)
    pairs.clear()
    assert again.friction("a", "b") == 0.3
    with pytest.raises(TypeError):
        materials.coefficients[frozenset(("a", "b"))] = 1.0  # pyright: ignore[reportIndexIssue]
