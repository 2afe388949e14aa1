"""A seeded slice of the tamperings of ``make tampering``."""

import pytest
from tampering import KINDS, originals, tampered

from graspless_pin.report.verify import verify_document


@pytest.fixture(scope="module")
def outcomes():
    return list(tampered(36))


def test_no_original_is_refused():
    assert all(verify_document(document).proven for document in originals())


def test_every_false_claim_is_refused(outcomes):
    accepted = [one for one in outcomes if one.false and not one.refused]
    assert not accepted


def test_most_tamperings_claim_something_false(outcomes):
    """So that the test above says something of each kind."""
    for kind in KINDS:
        assert any(one.false for one in outcomes if one.kind == kind), kind
    assert sum(one.false for one in outcomes) > len(outcomes) / 2
