"""A slice of `make outcomes`: no verdict contradicts the enumeration of contact states."""

import pytest
from tests.oracles.compared_outcomes import compared, outcome_case

from graspless_pin import Stability, stability

FEWER_SECTORS = 8
SLICE = [(2 + (number % 4 == 0), number) for number in range(20)]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("contacts", "number"), SLICE)
def test_verdicts_agree_with_the_enumeration(contacts, number):
    line = compared(contacts, number, FEWER_SECTORS if contacts == 3 else None)
    assert line.fault == ""
    assert line.verdict != "undecided"


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("contacts", "number"), [(2, 74), (3, 91), (3, 123)])
def test_commanded_forces_leave_no_relaxation_without_an_answer(contacts, number):
    line = compared(contacts, number, FEWER_SECTORS)
    assert (line.verdict, line.fault) == ("strong", "")


def test_a_sticking_force_on_the_round_cone_is_found():
    line = compared(3, 78, FEWER_SECTORS)
    assert (line.verdict, line.fault) == ("weak", "")


def test_multipliers_of_narrow_sectors_prove_what_they_should():
    """Nearly parallel edges of a sector have large multipliers, whose rounding forces magnify."""
    case, problem = outcome_case(4, 4)
    assert stability(problem, case.torques, node_limit=1000).status is Stability.STRONG
