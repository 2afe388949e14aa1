"""The fields of a scene: a record of hand, object, supports and figures, each checked.

`Scene` adds the methods.
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from graspless_pin.algorithms.uncertainty import Uncertainty
from graspless_pin.caching import Latest
from graspless_pin.errors import ArgumentError
from graspless_pin.findings import Finding
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Materials, Support
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.holding.controller import Controller
from graspless_pin.intake.yaml_source import YamlSource, checked_key, key_text
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Record, changed, frozen
from graspless_pin.scene.body_schema import HandEntry, ObjectEntry
from graspless_pin.scene.scene_schema import SCENE, SceneEntry, SolveEntry
from graspless_pin.scene.stated import Acceleration, GivenContact, Load, Motion
from graspless_pin.suggestions import names_in_words, what_to_pass

_Check = Callable[[str, Any], Any]

_LEAST = {"object": {"shape": {"type": "sphere", "radius": 1.0}, "mass": 1.0}, "friction": 1.0}
_PARTS = {
    "object": ObjectEntry.model_fields,
    "hand": HandEntry.model_fields,
    "solve": SolveEntry.model_fields,
}


def _checked_changes(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes of fields by name, each value checked, figures by the scene file's schema.

    Raises:
        ArgumentError: If a name is no field, or a value is invalid for its field.
    """
    checked = {}
    for name, value in changes.items():
        if name not in _CHECKS:
            keys = [f"{part}.{name}" for part, named in _PARTS.items() if name in named]
            advice = f"with_changes({{{keys[0]!r}: ...}}) sets the key of a file; " if keys else ""
            known = names_in_words(name, _CHECKS)
            raise ArgumentError(name, f"is not a field of a scene; {advice}{known}")
        checked[name] = _CHECKS[name](name, value)
    return checked


_IN_A_FILE = {
    **{name: f"{name!r}: {{...}}" for name in ("object", "hand", "materials", "motion",
                                              "acceleration", "uncertainty")},
    "supports": "'supports': [{...}]",
    "loads": "'loads': [{...}]",
    "given_contacts": "'contacts': [{...}]",
    "hand_material": "'hand.material': 'rubber'",
}  # fmt: skip
"""The form of a field in a scene file, for messages of `Scene.with_changes`."""


def _instance_check(kind: type, example: str = "", *, optional: bool = False) -> _Check:
    def check(name: str, value: Any) -> Any:
        if isinstance(value, kind) or (optional and value is None):
            return value
        hint = f", e.g. {example}" if example else ""
        if isinstance(value, Mapping) and name in _IN_A_FILE:
            hint += f", or, in the form of a file, with_changes({{{_IN_A_FILE[name]}}})"
        none, article = " or None" if optional else "", "an" if kind.__name__[0] in "AEIOU" else "a"
        raise ArgumentError(
            name, f"found {reprlib.repr(value)}; needs {article} {kind.__name__}{none}{hint}"
        )

    return check


def _tuple_check(kind: type, example: str = "", *, optional: bool = False) -> _Check:
    check_item = _instance_check(kind, example)

    def check(name: str, value: Any) -> Any:
        if optional and value is None:
            return None
        if isinstance(value, str | Mapping) or not hasattr(value, "__iter__"):
            value = (value,)
        return tuple([check_item(name, item) for item in value])

    return check


def _check_by_schema(name: str, value: Any) -> Any:
    """Return a figure as the schema of scene files validates it."""
    return checked_key(SCENE, SceneEntry, _LEAST, name, value)


def _checked_friction(name: str, value: Any) -> Mapping[str, float]:
    friction = _check_by_schema(name, value)
    return friction if isinstance(friction, Mapping) else {"default": friction}


def _checked_loads(name: str, value: Any) -> tuple[Load, ...]:
    loads = _tuple_check(Load, "Load('cable', force=[0, 0, 2])")(name, value)
    check_load_names([load.name for load in loads])
    return loads


def check_load_names(names: Sequence[str]) -> None:
    """Refuse two loads with the same name.

    Raises:
        ArgumentError: Naming the load.
    """
    for index, name in enumerate(names):
        if name in names[:index]:
            message = f"{name!r} is the name of another load, too; names must be distinct"
            raise ArgumentError(f"loads[{index}].name", message)


_CHECKS: dict[str, _Check] = {
    "name": _instance_check(str),
    "object": _instance_check(
        ManipulatedObject,
        "dataclasses.replace(scene.object, mass=2.0), scene.object.with_pose(T)",
    ),
    "friction": _checked_friction,
    "hand": _instance_check(Hand, "scene.hand.with_configuration({...})", optional=True),
    "supports": _tuple_check(Support, "(*scene.supports, Support(name, shape, T_world_support))"),
    "path": _instance_check(Path, optional=True),
    "gravity": lambda name, value: np.array(_check_by_schema(name, value), dtype=np.float64),
    "materials": _instance_check(Materials),
    "hand_material": _instance_check(str, optional=True),
    "given_contacts": _tuple_check(GivenContact, optional=True),
    "motion": _instance_check(Motion, "Motion([0.1, 0, 0, 0, 0, 0])", optional=True),
    "loads": _checked_loads,
    "acceleration": _instance_check(Acceleration, "Acceleration(linear=[2, 0, 0])", optional=True),
    "max_normal_force": _check_by_schema,
    "cone_edges": _check_by_schema,
    "cone": _check_by_schema,
    "contact_tolerance": _check_by_schema,
    "points_per_patch": _check_by_schema,
    "tangent_axes": lambda name, value: tuple(map(np.array, _check_by_schema(name, value))),
    "count_own_weight": _instance_check(bool),
    "hybrid_force_limit": partial(checked_key, SCENE, HandEntry, {"robot": "allegro"}),
    "max_penetration": _check_by_schema,
    "controller": Controller.parse,
    "uncertainty": _instance_check(Uncertainty, "Uncertainty(mass=0.2)", optional=True),
    "solve_options": lambda _, value: _check_by_schema("solve", value).model_dump(),
    "load_findings": _tuple_check(Finding),
}


class StatedFields(NamedTuple):
    """The file of a scene, and which fields have changed since it was loaded.

    Attributes:
        file: The file, without its data.
        changed: Names of the fields that differ from the file.
    """

    file: YamlSource
    changed: frozenset[str] = frozenset()

    def with_place(self, finding: Finding) -> Finding:
        """Return a finding with its place in the file, unless its field has changed."""
        key = str(finding.key[0]) if finding.key else ""
        field = FIELDS_OF_KEYS.get(key, (key,))[0]
        return finding if field in self.changed else self.file.with_place(finding)


FIELDS_OF_KEYS = {
    "contacts": ("given_contacts",),
    "hand": ("hand", "hand_material", "count_own_weight", "hybrid_force_limit", "controller"),
    "solve": ("solve_options",),
}
"""Fields of a scene by key of its file, where the names differ."""


@dataclass(frozen=True, eq=False, repr=False)
class SceneFields(Record):
    """The fields of a scene: see `Scene`."""

    name: str
    object: ManipulatedObject
    friction: Mapping[str, float]
    hand: Hand | None = None
    supports: tuple[Support, ...] = ()
    path: Path | None = None
    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    materials: Materials = field(default_factory=lambda: Materials({}))
    hand_material: str | None = None
    given_contacts: tuple[GivenContact, ...] | None = None
    motion: Motion | None = None
    loads: tuple[Load, ...] = ()
    acceleration: Acceleration | None = None
    max_normal_force: float = 50.0
    cone_edges: int = 32
    cone: str = "edges"
    contact_tolerance: float = 1e-3
    points_per_patch: int = 8
    tangent_axes: tuple[FloatArray, ...] = ()
    count_own_weight: bool = True
    hybrid_force_limit: float | None = None
    max_penetration: float = 5e-3
    controller: Controller = field(default_factory=Controller)
    uncertainty: Uncertainty | None = None
    solve_options: Mapping[str, Any] = field(default_factory=dict)
    load_findings: tuple[Finding, ...] = ()

    _DERIVED: ClassVar[tuple[str, ...]] = ()
    """Cached properties that depend on the fields."""

    def with_changes(self, **changes: Any) -> Self:
        """Return the scene with some fields replaced; data that do not depend on them stay cached.

        Raises:
            ArgumentError: If a name is no field, or a value is invalid for its field.
        """
        scene = self._with_fields(_checked_changes(changes))
        links = () if scene.hand is None else scene.hand.link_names
        supports = [support.name for support in scene.supports]
        if changes.keys() & {"object", "hand", "supports"}:
            check_body_names(scene.object.name, supports, links)
        if "friction" in changes or "given_contacts" in changes:
            bodies = (*supports, *links)
            if "friction" in changes:
                friction_by_name(scene.friction, bodies)
            contacts = scene.given_contacts if "given_contacts" in changes else None
            for index, contact in enumerate(contacts or ()):
                check_contact_body(f"given_contacts[{index}].body", contact.body, bodies)
        return scene

    def _with_fields(self, fields: Mapping[str, Any]) -> Self:
        """Return the scene with some fields replaced, without checks."""
        stated = self._source
        if stated is not None and not stated.changed.issuperset(fields):
            stated = stated._replace(changed=stated.changed.union(fields))
        own = {name: frozen(value) for name, value in fields.items()}
        return changed(self, *self._DERIVED, _cache=self._cache, _source=stated, **own)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the fields, and `_source`."""
        return (*super().__reduce__(), {"_source": self._source})

    @cached_property
    def _source(self) -> StatedFields | None:
        """The scene's file and the fields that differ from it; None: it came from no file."""
        return None

    @cached_property
    def _cache(self) -> Latest:
        """Cache of latest results, shared with scenes changed from it or of the same parts."""
        return Latest()


AnyScene = TypeVar("AnyScene", bound=SceneFields)
"""A class of scenes."""


def check_body_names(object_name: str, supports: Sequence[str], links: Sequence[str]) -> None:
    """Refuse bodies with the same name, as names identify contacts.

    Raises:
        ArgumentError: Naming the object or the support.
    """
    taken = set(links)
    for number, name in enumerate((object_name, *supports)):
        if name in taken:
            argument = f"supports[{number - 1}].name" if number else "object.name"
            raise ArgumentError(
                argument, f"{name!r} is the name of another body, too; names must be distinct"
            )
        taken.add(name)


_GROUPS = ("default", "hand", "supports")


def friction_by_name(
    stated: float | Mapping[str, float], bodies: Sequence[str]
) -> Mapping[str, float]:
    """Return the friction of a scene file as coefficients by the names that `friction_at` reads.

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
            raise ArgumentError(f"friction['{name}']", f"is not the name of a body; {words}")
    return stated


def check_contact_body(argument: str, body: str, bodies: Sequence[str]) -> None:
    """Refuse a stated contact with an unknown body.

    Args:
        argument: Its name in messages.
        body: The body that the contact names.
        bodies: Names of the hand's links and of the supports.

    Raises:
        ArgumentError: If there is no such body.
    """
    if body not in bodies:
        words = names_in_words(body, bodies)
        raise ArgumentError(argument, f"{body!r} is neither a hand link nor a support; {words}")


def checked_scene(scene: object) -> SceneFields:
    """Return the argument if it is a scene.

    Raises:
        ArgumentError: If it is not.
    """
    if not isinstance(scene, SceneFields):
        raise ArgumentError("scene", what_to_pass("scene", scene, "Scene"))
    return scene


def label_of(scene: SceneFields) -> str:
    """Return the name of a scene in messages: its file, or its name without one."""
    return scene.name if scene.path is None else str(scene.path)


def place_of(scene: SceneFields, *key: str) -> str:
    """Return the name of a scene's part in messages: file, line and key if it has not changed."""
    stated = scene._source
    if stated is None or key[0] in stated.changed:
        return label_of(scene)
    return f"{stated.file.where(key)}: {key_text(key)}"
