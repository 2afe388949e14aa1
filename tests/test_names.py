"""No two files of the tests share a name."""

from collections import Counter
from pathlib import Path


def test_no_two_files_of_the_tests_share_a_name():
    """They are imported by their name alone: with two of one name none of either would run."""
    files = Counter(path.name for path in Path(__file__).parent.rglob("*.py"))
    assert {name for name, count in files.items() if count > 1} <= {"conftest.py", "__init__.py"}
