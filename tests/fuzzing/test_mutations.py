"""A seeded slice of ``make fuzz``: the command line keeps its manners over spoilt files."""

import subprocess
import sys
from pathlib import Path
from random import Random

import pytest
from fuzz import Outcome
from spoiling import spoil

RUN = Path(__file__).parent / "fuzz.py"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits and forks are Linux's")


def test_a_slice_of_the_mutations():
    words = [sys.executable, str(RUN), "--count", "2", "--seed", "60"]
    result = subprocess.run(  # noqa: S603 - our own interpreter and program
        words, capture_output=True, text=True, check=False, timeout=600
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "2 mutations (seed 60): 0 broke a rule" in result.stdout


@pytest.mark.parametrize(
    ("outcome", "fault"),
    [
        (Outcome(-11, b"", b"", 1.0, 1.0), "died of SIGSEGV"),
        (Outcome(3, b"", b"", 1.0, 1.0), "exit code 3"),
        (Outcome(1, b"Traceback (most recent call last)\nE: x", b"", 1.0, 1.0), "traceback: E: x"),
        (Outcome(2, b"free(): invalid pointer", b"", 1.0, 1.0), "no message"),
        (Outcome(0, b"something\n", b"", 1.0, 1.0), "something else on standard error"),
        (Outcome(2, b"error: " + 2000 * b"x", b"", 1.0, 1.0), "2007 bytes on standard error"),
        (Outcome(0, b"", b"", 10.1, 1.0), "10.1 s"),
        (Outcome(0, b"", b"", 1.0, 2.1), "2.10 GiB"),
    ],
)
def test_every_rule_can_be_broken(outcome, fault):
    assert any(fault in found for found in outcome.faults())


def test_what_breaks_no_rule():
    assert Outcome(2, b"error: scene.yaml: no\nwarning: odd\n", b"", 1.0, 1.0).faults() == []
    assert Outcome(0, b"warning: odd\n", b"found", 1.0, 1.0).faults() == []


def test_mutations_are_seeded_and_change_something():
    content = b"a: 1\nb: [2, 3]\nc: {d: text}\n"
    spoilt, again = (
        [spoil("scene.yaml", content, Random(f"7-{i}")) for i in range(12)]  # noqa: S311
        for _ in range(2)
    )
    assert spoilt == again
    assert sum(item != content for item in spoilt) > 8 and len(set(spoilt)) > 8
