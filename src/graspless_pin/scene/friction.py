"""Which coefficient of friction a contact of a scene has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from graspless_pin.errors import SceneError
from graspless_pin.geometry.bodies.materials import Materials
from graspless_pin.geometry.bodies.records import Support
from graspless_pin.geometry.contact.records import BodyKind, ContactArrays
from graspless_pin.problem.checks import FloatArray


def friction_coefficients(
    touching: ContactArrays,
    supports: Sequence[Support],
    friction: Mapping[str, float],
    hand_material: str | None,
    object_material: str | None,
    materials: Materials,
) -> FloatArray:
    """Return (M,) coefficients: a support's own, else the materials', else by name or group.

    Raises:
        SceneError: If a body has none.
    """

    def coefficient(kind: BodyKind, body: str) -> float:
        support = next((item for item in supports if item.name == body), None)
        if support is not None and support.friction is not None:
            return support.friction
        material = hand_material if support is None else support.material
        if material is not None and object_material is not None:
            return materials.friction(material, object_material)
        group = "hand" if kind is BodyKind.HAND else "supports"
        for key in (body, group, "default"):
            if key in friction:
                return friction[key]
        raise SceneError(
            f"friction: has no coefficient for {body!r}; add it, {group!r} or 'default'"
        )

    known: dict[tuple[BodyKind, str], float] = {}
    coefficients = []
    for key in zip(touching.kinds, touching.bodies, strict=True):
        if key not in known:
            known[key] = coefficient(*key)
        coefficients.append(known[key])
    return np.array(coefficients, dtype=np.float64)
