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


@pytest.mark.parametrize(("contacts", "number"), [(2, 74), (3, 91), (3, 123)])
def test_commanded_forces_leave_no_relaxation_without_an_answer(contacts, number):
    line = compared(contacts, number, FEWER_SECTORS)
    assert (line.verdict, line.fault) == ("strong", "")


def test_a_sticking_force_on_the_round_cone_is_found():
    line = compared(3, 78, FEWER_SECTORS)
    assert (line.verdict, line.fault) == ("weak", "")
