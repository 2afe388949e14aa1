"""Which coefficient of friction a contact of a scene has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.materials import Materials
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.contact.contact_points import ContactArrays
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.suggestions import names_in_words

_GROUPS = ("default", "hand", "supports")


def friction_by_name(
    stated: float | Mapping[str, float], bodies: Sequence[str]
) -> Mapping[str, float]:
    """Return what a scene file states of friction by the names that `FrictionTable` looks up.

    Args:
        stated: One coefficient, or several by body or group.
        bodies: Names of the hand's links and of the supports.

    Raises:
        ArgumentError: If a name is neither a body's nor a group's.
    """
    if not isinstance(stated, Mapping):
        return {"default": stated}
    known = [*_GROUPS, *bodies]
    for name in stated:
        if name not in known:
            words = names_in_words(name, known)
            raise ArgumentError(f"friction['{name}']", f"names no body; {words}")
    return stated


class FrictionTable:
    """Coefficients by body: a support's own, else the materials', else by name or group.

    Each is looked up once.
    """

    def __init__(
        self,
        supports: Sequence[Support],
        friction: Mapping[str, float],
        hand_material: str | None,
        object_material: str | None,
        materials: Materials,
    ) -> None:
        """Take what a scene says of friction, see `Scene`."""
        self._supports = {support.name: support for support in reversed(supports)}
        self._friction = friction
        self._hand_material = hand_material
        self._object_material = object_material
        self._materials = materials
        self._last: tuple[tuple[str, ...], int, FloatArray] = (), 0, np.empty(0)

    def coefficients(self, touching: ContactArrays) -> FloatArray:
        """Return (M,) read-only coefficients of contacts, hand first.

        Raises:
            SceneError: If a body has none.
        """
        count = touching.hand_count
        last_bodies, last_count, last = self._last
        if last_count == count and last_bodies == touching.bodies:
            return last
        bodies = touching.bodies
        values: list[float] = []
        for group, own in (("hand", bodies[:count]), ("supports", bodies[count:])):
            known = {body: self.coefficient(group, body) for body in dict.fromkeys(own)}
            values += map(known.__getitem__, own)
        coefficients = read_only(np.array(values, dtype=np.float64))
        self._last = bodies, count, coefficients
        return coefficients

    def coefficient(self, group: str, body: str) -> float:
        """Return the coefficient of one body.

        Args:
            group: ``hand`` or ``supports``.
            body: The hand link or support.

        Raises:
            SceneError: If it has none.
        """
        support = self._supports.get(body)
        if support is not None and support.friction is not None:
            return support.friction
        material = self._hand_material if support is None else support.material
        if material is not None and self._object_material is not None:
            return self._materials.friction(material, self._object_material)
        for key in (body, group, "default"):
            if key in self._friction:
                return self._friction[key]
        raise SceneError(
            f"friction: has no coefficient for {body!r}; add it, {group!r} or 'default'"
        )
