"""Each document of these tests is made once."""

from functools import cache

import pytest


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
