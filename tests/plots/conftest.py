"""Plots are drawn without a display, and every figure is closed after its test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import pytest

from graspless_pin import QuasistaticProblem, TorqueSolution, load_scene, maximize_margin

PAPER = Path(__file__).resolve().parents[2] / "examples" / "paper"


@pytest.fixture(autouse=True)
def no_display() -> Iterator[None]:
    mpl.use("Agg")
    from matplotlib import pyplot

    yield
    pyplot.close("all")


@pytest.fixture(scope="session")
def sliding() -> TorqueSolution:
    """The paper's cuboid slides up: two finger contacts with hexagonal cones, four that slide."""
    return load_scene(PAPER / "cuboid_sliding_up.yaml").solve()


@pytest.fixture(scope="session")
def infeasible() -> TorqueSolution:
    """One contact below, a force that pulls up."""
    return maximize_margin(
        QuasistaticProblem([[0, 0, -0.1]], [[0, 0, 1]], [0, 0, 1, 0, 0, 0], friction=0.5)
    )
