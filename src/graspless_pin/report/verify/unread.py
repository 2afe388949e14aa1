"""Figures that a status makes nothing of: they are named, so that none is taken for checked."""

from __future__ import annotations

from typing import Any

from graspless_pin.report.verify.figures import FOUND_STATES
from graspless_pin.report.verify.outcome import Check, given
from graspless_pin.report.verify.values import entry


def unread_figures(
    document: dict[str, Any], status: str, *, complete: bool, has_modes: bool
) -> list[Check]:
    """Return the line that names the figures which no claim leans on; none where there are none.

    Args:
        document: The document.
        status: Of the answer.
        complete: Whether its proof is.
        has_modes: Whether friction needs a virtual sliding.

    Raises:
        ValueError: If there is no proof.
    """
    proof, found = entry(document, "proof", "the document"), status in FOUND_STATES
    read = {
        "multipliers": found and status != "strong",
        "proof.motion": has_modes and (found or status == "infeasible_in_mode"),
        "proof.nodes": complete,
        "proof.forces": status == "infeasible_modes",
        "proof.columns": status == "infeasible_modes",
        "proof.mode_multipliers": found and not complete,
    }
    stated = {**{f"proof.{key}": one for key, one in proof.items()}, **document}
    unread = [key for key, is_read in read.items() if not is_read and stated.get(key)]
    if not unread:
        return []
    return [given("figures without a claim", f"nothing leans on {', '.join(unread)}")]
