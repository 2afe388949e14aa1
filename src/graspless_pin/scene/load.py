"""From a YAML scene to a `Scene`, with errors that name file, line, key and what was found."""

from __future__ import annotations

import reprlib
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from graspless_pin.errors import SceneError, UnusedMaterialWarning
from graspless_pin.geometry.bodies.materials import Materials
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.magnitudes import LARGEST_LOAD_OVER_LIMIT
from graspless_pin.scene.body_building import build_object, build_support, twist_of
from graspless_pin.scene.friction import friction_by_name
from graspless_pin.scene.hand_building import SceneParts, build_hand
from graspless_pin.scene.messages import validated
from graspless_pin.scene.motion_and_contacts import GivenContact, HandMotion, Motion
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.scene_schema import MotionEntry, SceneEntry
from graspless_pin.scene.yaml_source import Location, YamlSource


def load_scene(path: str | Path) -> Scene:
    """Load a YAML scene.

    Paths in the file are relative to the file. The file is data: YAML tags are refused, and so are
    XML entities in the URDFs that it names.

    Args:
        path: The scene file.

    Returns:
        The scene, with hand and shapes loaded.

    Raises:
        SceneError: Naming file, line and key, what was found and what would do.

    Examples:
        >>> from graspless_pin import load_scene
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> scene.name
        'Cuboid pinched on a slope, at rest'
        >>> print(f"{scene.solve().margin:.4f} N")
        1.6504 N
    """
    return build_scene(YamlSource.read(Path(path)))


def build_scene(source: YamlSource, parts: SceneParts | None = None) -> Scene:
    """Build the scene of a parsed file.

    Args:
        source: The file, perhaps with changed content.
        parts: What earlier scenes of the same folder left; None: nothing is shared.

    Raises:
        SceneError: See `load_scene`.
    """
    if not isinstance(source.data, dict):
        raise SceneError(
            f"{source.where(())}: found {reprlib.repr(source.data)}; a scene is a mapping with the "
            "keys object, friction, hand, supports, ..."
        )
    return _scene(source, parts or SceneParts(), validated(source, SceneEntry))


def _scene(file: YamlSource, parts: SceneParts, entry: SceneEntry) -> Scene:
    hand = None
    if entry.hand is not None:
        hand = build_hand(file, parts, entry.hand)
    supports = tuple(
        build_support(file, ("supports", index), item) for index, item in enumerate(entry.supports)
    )
    links = () if hand is None else hand.link_names
    bodies = [*(support.name for support in supports), *links]
    _check_names(file, entry, links)
    made = build_object(file, entry.object)
    _check_weight(file, entry, made)
    weight = entry.hand is None or entry.hand.count_own_weight
    return Scene(
        name=entry.name or file.path.stem,
        path=file.path,
        gravity=np.array(entry.gravity),
        hand=hand,
        object=made,
        supports=supports,
        friction=file.at((), lambda: friction_by_name(entry.friction, bodies)),
        materials=_materials(file, entry),
        hand_material=None if entry.hand is None else entry.hand.material,
        given_contacts=_contacts(file, entry, bodies),
        motion=_motion(file, entry.motion, hand),
        max_normal_force=entry.max_normal_force,
        cone_edges=entry.cone_edges,
        cone=entry.cone,
        contact_tolerance=entry.contact_tolerance,
        points_per_patch=entry.points_per_patch,
        tangent_axes=tuple(np.array(axis) for axis in entry.tangent_axes),
        count_own_weight=weight,
        hybrid_force_limit=None if entry.hand is None else entry.hand.hybrid_force_limit,
        solve_options=entry.solve.model_dump(),
    )


def _check_weight(file: YamlSource, entry: SceneEntry, made: ManipulatedObject) -> None:
    """Refuse an object whose weight no double holds beside the force that must bear it."""
    weight = made.mass * float(np.linalg.norm(entry.gravity))
    most = LARGEST_LOAD_OVER_LIMIT * entry.max_normal_force
    if weight > most:
        raise file.error(
            ("max_normal_force",),
            f"is {entry.max_normal_force:g} N, and the object weighs {weight:g} N; it may "
            f"weigh at most {LARGEST_LOAD_OVER_LIMIT:g} times as much, {most:g} N",
        )


def _materials(file: YamlSource, entry: SceneEntry) -> Materials:
    table = file.at((), lambda: Materials.from_table(entry.materials))
    named: list[tuple[Location, str | None]] = [(("object", "material"), entry.object.material)]
    if entry.hand is not None:
        named.append((("hand", "material"), entry.hand.material))
    named += [(("supports", i, "material"), item.material) for i, item in enumerate(entry.supports)]
    for location, name in named:
        if name is not None:
            file.at(location, lambda name=name: table.check([name]))
    _warn_of_unused_materials(file, entry, table)
    return table


def _warn_of_unused_materials(file: YamlSource, entry: SceneEntry, table: Materials) -> None:
    """Warn of names in the table that look misspelt, and of a table of which no pair counts.

    Other pairs that no body has are fine: scenes may share a table. So is a table in a scene that
    gives no body a material.
    """
    own, others = entry.object.material, other_materials(entry)
    used = {name for name in (own, *others) if name is not None}
    for name, meant in table.misspelt(used).items():
        pair = next((a, b) for a, row in entry.materials.items() for b in row if name in (a, b))
        _warn(file, ("materials", *pair), f"no body is of {name!r}; did you mean {meant!r}?")
    if used and not any(frozenset((own, other)) in table.coefficients for other in others):
        _warn(
            file,
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


def _warn(file: YamlSource, location: Location, message: str) -> None:
    warnings.warn(file.message(location, message), UnusedMaterialWarning, stacklevel=3)


def _check_names(file: YamlSource, entry: SceneEntry, links: Sequence[str]) -> None:
    """Refuse a body that is called like another one: contacts are told by these names."""
    taken = set(links)
    bodies: list[tuple[Location, str]] = [(("object", "name"), entry.object.name)]
    bodies += [(("supports", i, "name"), item.name) for i, item in enumerate(entry.supports)]
    for location, name in bodies:
        if name in taken:
            raise file.error(location, f"{name!r} names another body too; names must differ")
        taken.add(name)


def _contacts(
    file: YamlSource, entry: SceneEntry, bodies: list[str]
) -> tuple[GivenContact, ...] | None:
    if entry.contacts is None:
        return None
    contacts: list[GivenContact] = []
    for index, item in enumerate(entry.contacts):
        if item.body not in bodies:
            raise file.error(
                ("contacts", index, "body"),
                f"{item.body!r} is no hand link or support; known: {', '.join(bodies) or 'none'}",
            )
        normal = np.array(item.normal) / np.linalg.norm(item.normal)
        contacts.append(GivenContact(item.body, np.array(item.position), normal))
    return tuple(contacts)


def _motion(file: YamlSource, entry: MotionEntry | None, hand: Hand | None) -> Motion | None:
    if entry is None:
        return None
    own = None
    if entry.hand is not None:
        if hand is None:
            raise file.error(("motion", "hand"), "the scene has no hand that could move")
        own = HandMotion(twist_of(entry.hand.base_twist), dict(entry.hand.joint_velocities))
        file.at(
            ("motion", "hand"),
            lambda: hand.point_velocities(
                (), np.zeros((0, 3)), own.joint_velocities, own.base_twist
            ),
        )
    return Motion(twist_of(entry.object_twist), own)
