"""Check what a scene is changed to, where it is changed."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from graspless_pin.errors import ArgumentError
from graspless_pin.findings import Finding
from graspless_pin.geometry.bodies.materials import Materials
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import real_number
from graspless_pin.scene.messages import checked_key
from graspless_pin.scene.motion_and_contacts import GivenContact, Motion
from graspless_pin.scene.scene_schema import SceneEntry
from graspless_pin.spelling import names_in_words

_Check = Callable[[str, Any], Any]

_OBJECT = "dataclasses.replace(scene.object, mass=2.0), scene.object.with_pose(T)"
_HAND = "scene.hand.with_configuration({...})"
_LEAST = {"object": {"shape": {"type": "sphere", "radius": 1.0}, "mass": 1.0}, "friction": 1.0}
_SUPPORTS = "(*scene.supports, Support(name, shape, T_world_support))"


def checked_changes(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields of a scene by name, each checked, figures as a scene file takes them.

    Raises:
        ArgumentError: If a name is none of the fields, or a value not one of its field.
    """
    checked = {}
    for name, value in changes.items():
        if name not in _CHECKS:
            raise ArgumentError(name, f"is no field of a scene; {names_in_words(name, _CHECKS)}")
        checked[name] = _CHECKS[name](name, value)
    return checked


def _one(kind: type, example: str = "", *, optional: bool = False) -> _Check:
    def check(name: str, value: Any) -> Any:
        if isinstance(value, kind) or (optional and value is None):
            return value
        said = f", e.g. {example}" if example else ""
        none = " or None" if optional else ""
        raise ArgumentError(
            name, f"found {reprlib.repr(value)}; needs a {kind.__name__}{none}{said}"
        )

    return check


def _several(kind: type, example: str = "", *, optional: bool = False) -> _Check:
    one = _one(kind, example)

    def check(name: str, value: Any) -> Any:
        if optional and value is None:
            return None
        if isinstance(value, str | Mapping) or not hasattr(value, "__iter__"):
            value = (value,)
        return tuple([one(name, item) for item in value])

    return check


def _as_in_a_file(name: str, value: Any) -> Any:
    """Check a figure by the schema of scene files."""
    return checked_key(SceneEntry, _LEAST, name, value)


def _friction(name: str, value: Any) -> Mapping[str, float]:
    found = _as_in_a_file(name, dict(value) if isinstance(value, Mapping) else value)
    return found if isinstance(found, Mapping) else {"default": found}


def _array(name: str, value: Any) -> Any:
    return np.array(_as_in_a_file(name, np.asarray(value).tolist()), dtype=np.float64)


def _axes(name: str, value: Any) -> Any:
    axes = [np.asarray(axis).tolist() for axis in value]
    return tuple(np.array(axis) for axis in _as_in_a_file(name, axes))


def _options(_: str, value: Any) -> Any:
    return _as_in_a_file("solve", dict(value)).model_dump()


def _force(name: str, value: Any) -> float | None:
    return None if value is None else real_number(name, value, 0.0)


_CHECKS: dict[str, _Check] = {
    "name": _one(str),
    "object": _one(ManipulatedObject, _OBJECT),
    "friction": _friction,
    "hand": _one(Hand, _HAND, optional=True),
    "supports": _several(Support, _SUPPORTS),
    "path": _one(Path, optional=True),
    "gravity": _array,
    "materials": _one(Materials),
    "hand_material": _one(str, optional=True),
    "given_contacts": _several(GivenContact, optional=True),
    "motion": _one(Motion, "Motion([0.1, 0, 0, 0, 0, 0])", optional=True),
    "max_normal_force": _as_in_a_file,
    "cone_edges": _as_in_a_file,
    "cone": _as_in_a_file,
    "contact_tolerance": _as_in_a_file,
    "points_per_patch": _as_in_a_file,
    "tangent_axes": _axes,
    "count_own_weight": _one(bool),
    "hybrid_force_limit": _force,
    "max_penetration": _as_in_a_file,
    "solve_options": _options,
    "load_findings": _several(Finding),
}
