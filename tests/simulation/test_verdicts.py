"""Verdicts beside MuJoCo's outcomes: a slice of ``make holding``."""

from dataclasses import replace
from functools import partial

import pytest
from benchmarks import holding

from graspless_pin import Stability
from graspless_pin.simulation import SimulatedOutcome


@pytest.mark.sampled(1)
@pytest.mark.parametrize("family", ["corner", "groove"])
def test_no_verdict_is_contradicted(family, monkeypatch):
    monkeypatch.setattr(holding, "simulate", partial(holding.simulate, seconds=0.5))
    cases = holding.compared(family, 1)
    assert len(cases) == 3
    assert cases[0].group == Stability.STRONG
    assert not any(case.contradicts() for case in cases)
    (strong, *_) = cases
    assert replace(strong, outcomes=(SimulatedOutcome.MOVED,) * 3).contradicts()
    assert replace(strong, group=str(Stability.NONE)).contradicts()
    assert not replace(strong, group=str(Stability.WEAK)).contradicts()
