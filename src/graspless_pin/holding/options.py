"""Options of a verdict by name, apart from the search: who states them does not load it."""

from __future__ import annotations

from typing import TypedDict

COARSEST_RESOLUTION, FINEST_RESOLUTION = 0.01, 1e-6
"""Accelerations that may count as rest, as shares of load over mass; documents hold to the same."""
NODE_LIMIT = 3000
"""Sets of outcomes that are looked at unless told otherwise; earlier proofs close others."""
BRIEF_NODE_LIMIT = 300
"""The same of verdicts that stand beside an answer unasked: about a second."""


class StabilityKeywords(TypedDict, total=False):
    """Options of `stability` by name."""

    acceleration_resolution: float
    node_limit: int
    time_limit: float | None
