"""A slice of `make outcomes`: no verdict contradicts the enumeration of contact states."""

import pytest
from tests.oracles.compared_outcomes import compared

FEWER_SECTORS = 8
SLICE = [(2 + (number % 4 == 0), number) for number in range(40)]


@pytest.mark.parametrize(("contacts", "number"), SLICE)
def test_verdicts_agree_with_the_enumeration(contacts, number):
    line = compared(contacts, number, FEWER_SECTORS if contacts == 3 else None)
    assert line.fault == ""
    assert line.verdict != "undecided"
