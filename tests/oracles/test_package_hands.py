"""A hand of a package that installs by name; `make hands` holds sixteen of them to the same."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from tests.oracles.package_hands import HANDS, agrees, check_hand


@pytest.fixture(scope="module")
def seen():
    folder = Path(sys.prefix)
    return check_hand(folder / HANDS["iCub mk3"], [folder, folder / "share"])


def test_it_agrees_with_triangles_differences_and_rnea(seen):
    touches, *_ = seen.contacts
    assert agrees(seen)
    assert (seen.links, seen.joints, touches) == (12, 11, 48)


@pytest.mark.parametrize(
    "off",
    [
        {"poses": 2e-10},
        {"jacobian": 2e-8},
        {"torques": 2e-10},
        {"contacts": (60, 6e-6, 0.0, 0.0, 0.0)},
        {"contacts": (60, 0.0, 2e-4, 0.0, 0.0)},
        {"contacts": (60, 0.0, 0.0, 6e-6, 0.0)},
        {"contacts": (60, 0.0, 0.0, 0.0, 6e-6)},
    ],
)
def test_what_is_off_is_told(seen, off):
    assert not agrees(seen._replace(**off))
