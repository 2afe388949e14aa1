"""Pairs of materials that a scene names and no contact can have."""

from __future__ import annotations

import warnings
from collections.abc import Iterable

from graspless_pin.errors import UnusedMaterialWarning
from graspless_pin.geometry.bodies.materials import Materials
from graspless_pin.scene.messages import key_text
from graspless_pin.scene.scene_schema import SceneEntry
from graspless_pin.scene.yaml_source import Location, YamlSource


def warn_of_unused_materials(source: YamlSource, entry: SceneEntry, table: Materials) -> None:
    """Warn of names in the table that look misspelt, and of a table of which no pair counts.

    Other pairs that no body has are fine: scenes may share a table. So is a table in a scene that
    gives no body a material.

    Args:
        source: The scene file, for naming the line.
        entry: Its content.
        table: Its table of materials.
    """
    own, others = entry.object.material, other_materials(entry)
    used = {name for name in (own, *others) if name is not None}
    for name, meant in table.misspelt(used).items():
        pair = next((a, b) for a, row in entry.materials.items() for b in row if name in (a, b))
        location: Location = ("materials", *pair)
        _warn(source, location, f"no body is of {name!r}; did you mean {meant!r}?")
    if used and not any(frozenset((own, other)) in table.coefficients for other in others):
        _warn(
            source,
            ("materials",),
            f"none of them counts, for {materials_in_words(own, others)}; add their pair, or the "
            "'material' that is left out",
        )


def other_materials(entry: SceneEntry) -> tuple[str | None, ...]:
    """Return the materials of what may touch the object; None: not given."""
    hand = () if entry.hand is None else (entry.hand.material,)
    return (*hand, *(support.material for support in entry.supports))


def materials_in_words(own: str | None, others: Iterable[str | None]) -> str:
    """Return what the bodies are of, for messages."""
    named = sorted({repr(name) for name in others if name is not None})
    return (
        f"the object is of {'no material' if own is None else repr(own)}, hand and supports are of "
        f"{', '.join(named) or 'no material'}"
    )


def _warn(source: YamlSource, location: Location, message: str) -> None:
    warnings.warn(
        f"{source.where(location)}: {key_text(location)}: {message}",
        UnusedMaterialWarning,
        stacklevel=3,
    )
