"""Figures of a scene's uncertainty by the names of bodies, materials, joints and fingers."""

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
    """Refuse figures for names that a scene does not have.

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
    """Refuse figures for names that a scene does not have: see `check_uncertain_names`."""
    supports, materials = [one.name for one in scene.supports], scene.materials.names
    check_uncertain_names(uncertainty, scene.hand, supports, materials, scene.object.name)


def by_contact_and_joint(
    scene: SceneFields, problem: QuasistaticProblem, uncertainty: Uncertainty
) -> Uncertainty:
    """Return an uncertainty with a figure for each contact and joint of a scene's problem.

    Raises:
        ArgumentError: If it has figures for unknown names.
    """
    check_names_in(scene, uncertainty)
    fingers = {} if scene.hand is None else fingers_of_motors(scene.hand)
    surfaces = _contact_names(scene)
    figures = {
        name: _figure_of_each(getattr(uncertainty, name), surfaces)
        for name in ("friction", "contact_position")
    }
    for name in ("torque", "torque_offset", "effort"):
        joints = ((joint, fingers.get(joint, "")) for joint in problem.joint_names)
        figures[name] = _figure_of_each(getattr(uncertainty, name), joints)
    return Uncertainty(**{**vars(uncertainty), **figures})


def unused_surfaces(scene: SceneFields) -> Iterator[Finding]:
    """Find figures of friction or contact position for bodies or materials without contact."""
    surfaces = _contact_names(scene)
    touching = {name for own in surfaces for name in own} | {DEFAULT_GAIN}
    for key in ("friction", "contact_position"):
        figures = getattr(scene.uncertainty, key, None)
        unused = [name for name in _figures_by_name(figures) if name not in touching]
        if unused:
            bodies = ", ".join(dict.fromkeys(f"'{own[0]}'" for own in surfaces))
            names = [
                " on ".join(sorted(pair)) if isinstance(pair, frozenset) else pair
                for pair in unused
            ]
            yield Finding(
                FindingCode.UNUSED_OPTION,
                key,
                f"{key} has values for {names}, which have no contact",
                f"give names of bodies that touch the object ({bodies}) or of their materials",
                ("uncertainty", key),
            )


def _contact_names(scene: SceneFields) -> list[tuple[Pair | str, ...]]:
    """Return the names under which figures of each contact are looked up, the closest first."""
    touching = contacts_of(scene).arrays
    groups = ["hand"] * touching.hand_count
    groups += ["supports"] * (len(touching.bodies) - len(groups))
    return [
        (body, *_contact_materials(scene, body), group)
        for body, group in zip(touching.bodies, groups, strict=True)
    ]


def _contact_materials(scene: SceneFields, body: str) -> tuple[Pair | str, ...]:
    """Return the pair of materials at a contact and both of them; empty if they are not used."""
    support = next((one for one in scene.supports if one.name == body), None)
    own, of_object = scene.hand_material, scene.object.material
    if support is not None:
        own = support.material if support.friction is None else None
    return () if own is None or of_object is None else (Pair((own, of_object)), own, of_object)


def _figure_of_each(figures: PairFigures, names: Iterable[Sequence[Pair | str]]) -> FloatArray:
    """Return the figure of each item by the first of its names that has one, else the default."""
    if not isinstance(figures, Mapping):
        return figures
    by_name = _figures_by_name(figures)
    default = by_name.get(DEFAULT_GAIN, 0.0)
    return np.array(
        [next((by_name[one] for one in own if one in by_name), default) for own in names]
    )


def _figures_by_name(figures: PairFigures | None) -> dict[Pair | str, float]:
    """Return figures by name, or by pair of materials."""
    by_name: dict[Pair | str, float] = {}
    for name, figure in figures.items() if isinstance(figures, Mapping) else ():
        if isinstance(figure, Mapping):
            by_name |= {Pair((name, other)): pair_figure for other, pair_figure in figure.items()}
        else:
            by_name[name] = figure
    return by_name


def uncertainty_entry(uncertainty: Uncertainty) -> dict[str, Any]:
    """Return an uncertainty as data of a scene file; None stands for zero figures."""
    stated = {name: _stated_figures(value) for name, value in vars(uncertainty).items()}
    is_empty = all(value is None for value in stated.values())
    return stated | {"mass": 0.0} if is_empty else stated


def _stated_figures(figures: float | PairFigures) -> Any:
    if isinstance(figures, Mapping):
        return figures[DEFAULT_GAIN] if figures.keys() == {DEFAULT_GAIN} else dict(figures) or None
    values = np.unique(figures)
    if len(values) == 1:
        return values[0] or None
    return figures
