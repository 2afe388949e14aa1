"""What a scene says that is not known exactly of it: by the names of bodies, joints and fingers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from graspless_pin.algorithms.uncertainty import PairFigures, Uncertainty
from graspless_pin.findings import Finding, FindingCode
from graspless_pin.geometry.bodies.object_and_supports import Pair
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.fingers import DEFAULT_GAIN
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.fields import SceneFields
from graspless_pin.scene.problem_data import fingers_of_motors, possible_columns


def check_uncertain_names(
    uncertainty: Uncertainty,
    hand: Hand | None,
    supports: Sequence[str],
    materials: Sequence[str],
    object_name: str,
) -> None:
    """Refuse figures of what a scene does not have.

    Args:
        uncertainty: The figures.
        hand: The scene's hand.
        supports: Names of the supports.
        materials: Names in the scene's table of materials.
        object_name: Name of its object.

    Raises:
        ArgumentError: Naming the key.
    """
    joints = () if hand is None else (*hand.actuation.names, *possible_columns(hand))
    fingers, links = ((), ()) if hand is None else ((*hand.fingers,), hand.link_names)
    bodies = [*links, *supports]
    uncertainty.check((*dict.fromkeys(joints),), fingers, bodies, materials, object_name)


def check_names_in(scene: SceneFields, uncertainty: Uncertainty) -> None:
    """Refuse figures of what a scene does not have: see `check_uncertain_names`."""
    supports, materials = [one.name for one in scene.supports], scene.materials.names
    check_uncertain_names(uncertainty, scene.hand, supports, materials, scene.object.name)


def by_contact_and_joint(
    scene: SceneFields, problem: QuasistaticProblem, uncertainty: Uncertainty
) -> Uncertainty:
    """Return a set with figures for the contacts and joints of a scene's problem, in their order.

    Raises:
        ArgumentError: If it names what is not there.
    """
    check_names_in(scene, uncertainty)
    fingers = {} if scene.hand is None else fingers_of_motors(scene.hand)
    surfaces = _surfaces(scene)
    own = {
        name: _of_each(getattr(uncertainty, name), surfaces)
        for name in ("friction", "contact_position")
    }
    for name in ("torque", "torque_offset", "effort"):
        joints = ((joint, fingers.get(joint, "")) for joint in problem.joint_names)
        own[name] = _of_each(getattr(uncertainty, name), joints)
    return Uncertainty(**{**vars(uncertainty), **own})


def unused_surfaces(scene: SceneFields) -> Iterator[Finding]:
    """Find figures of friction or place for bodies or materials of no contact."""
    surfaces = _surfaces(scene)
    touching = {name for own in surfaces for name in own} | {DEFAULT_GAIN}
    for key in ("friction", "contact_position"):
        figures = getattr(scene.uncertainty, key, None)
        unused = [name for name in _by_name(figures) if name not in touching]
        if unused:
            bodies = ", ".join(dict.fromkeys(f"'{own[0]}'" for own in surfaces))
            names = [
                " on ".join(sorted(one)) if isinstance(one, frozenset) else one for one in unused
            ]
            yield Finding(
                FindingCode.UNUSED_OPTION,
                key,
                f"{key} has figures for {names}, of which there is no contact",
                f"name bodies that touch the object ({bodies}) or their materials, or leave it out",
                ("uncertainty", key),
            )


def _surfaces(scene: SceneFields) -> list[tuple[Pair | str, ...]]:
    """Return the names that figures of each contact may go by, the closest first."""
    touching = contacts_of(scene).arrays
    groups = ["hand"] * touching.hand_count
    groups += ["supports"] * (len(touching.bodies) - len(groups))
    return [
        (body, *_materials_of(scene, body), group)
        for body, group in zip(touching.bodies, groups, strict=True)
    ]


def _materials_of(scene: SceneFields, body: str) -> tuple[Pair | str, ...]:
    """Return the pair of materials that a contact's coefficient is of, and both materials."""
    support = next((one for one in scene.supports if one.name == body), None)
    own, of_object = scene.hand_material, scene.object.material
    if support is not None:
        own = support.material if support.friction is None else None
    return () if own is None or of_object is None else (Pair((own, of_object)), own, of_object)


def _of_each(figures: PairFigures, names: Iterable[Sequence[Pair | str]]) -> FloatArray:
    """Return the figure of each thing by the first of its names that has one, or the default's."""
    if not isinstance(figures, Mapping):
        return figures
    known = _by_name(figures)
    rest = known.get(DEFAULT_GAIN, 0.0)
    return np.array([next((known[one] for one in own if one in known), rest) for own in names])


def _by_name(figures: PairFigures | None) -> dict[Pair | str, float]:
    """Return figures by the name of a thing, or by the pair of materials."""
    known: dict[Pair | str, float] = {}
    for name, figure in figures.items() if isinstance(figures, Mapping) else ():
        if isinstance(figure, Mapping):
            known |= {Pair((name, other)): one for other, one in figure.items()}
        else:
            known[name] = figure
    return known


def stated_uncertainty(uncertainty: Uncertainty) -> dict[str, Any]:
    """Return what a scene file says of a set; None stands for what is known exactly."""
    stated = {name: _stated(value) for name, value in vars(uncertainty).items()}
    nothing = all(value is None for value in stated.values())
    return stated | {"mass": 0.0} if nothing else stated


def _stated(figures: float | PairFigures) -> Any:
    if isinstance(figures, Mapping):
        return figures[DEFAULT_GAIN] if figures.keys() == {DEFAULT_GAIN} else dict(figures) or None
    values = np.unique(figures)
    if len(values) == 1:
        return values[0] or None
    return figures
