"""Each typical mistake is answered by its cause and its cure."""

import pytest
from mistakes import MISTAKES, Mistake, said_of


def plain(text: str) -> str:
    """The text without the frames that the command line draws around its own errors."""
    return " ".join(text.replace("│", " ").split())


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda one: one.what)
def test_a_mistake_is_answered_by_cause_and_cure(mistake: Mistake):
    code, said = said_of(mistake)
    assert mistake.cause in plain(said)
    assert mistake.cure in plain(said)
    assert code == mistake.code
    assert "Traceback" not in said


def test_there_are_forty():
    assert len({one.what for one in MISTAKES}) == len(MISTAKES) >= 40
