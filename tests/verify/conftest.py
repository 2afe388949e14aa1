"""Let these tests import the shared builders of ``tests/core``; each document is made once."""

import sys
from functools import cache
from pathlib import Path

import pytest

_CORE = str(Path(__file__).resolve().parents[1] / "core")
if _CORE not in sys.path:
    sys.path.insert(0, _CORE)


@cache
def _made(name):
    import own_objectives
    from verified_documents import SOLUTIONS, documented

    kind = name.removeprefix("own ")
    return documented((SOLUTIONS if kind == name else own_objectives.SOLUTIONS)[kind]())


@pytest.fixture
def made():
    """Make a document by the name of its kind, or "own" and that; not to be changed in place."""
    return _made
