"""What a scene says that is not known exactly of it: by the names of bodies, joints and fingers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from graspless_pin.algorithms.uncertainty import Figures, Uncertainty
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.fingers import DEFAULT_GAIN
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.fields import SceneFields
from graspless_pin.scene.joints import fingers_of_motors, possible_columns


def check_names(uncertainty: Uncertainty, hand: Hand | None, bodies: Sequence[str]) -> None:
    """Refuse figures of what a scene does not have.

    Args:
        uncertainty: The figures.
        hand: The scene's hand.
        bodies: Names of its links and of the supports.

    Raises:
        ArgumentError: Naming the key.
    """
    joints = () if hand is None else (*hand.actuation.names, *possible_columns(hand))
    fingers = () if hand is None else (*hand.fingers,)
    uncertainty.check((*dict.fromkeys(joints),), fingers, bodies)


def by_contact_and_joint(
    scene: SceneFields, problem: QuasistaticProblem, uncertainty: Uncertainty
) -> Uncertainty:
    """Return a set with figures for the contacts and joints of a scene's problem, in their order.

    Raises:
        ArgumentError: If it names what is not there.
    """
    links = () if scene.hand is None else scene.hand.link_names
    check_names(uncertainty, scene.hand, [*links, *(one.name for one in scene.supports)])
    touching = contacts_of(scene).arrays
    groups = ["hand"] * touching.hand_count
    groups += ["supports"] * (len(touching.bodies) - len(groups))
    fingers = {} if scene.hand is None else fingers_of_motors(scene.hand)
    own = {"friction": _of_each(uncertainty.friction, zip(touching.bodies, groups, strict=True))}
    for name in ("torque", "torque_offset", "effort"):
        joints = ((joint, fingers.get(joint, "")) for joint in problem.joint_names)
        own[name] = _of_each(getattr(uncertainty, name), joints)
    return Uncertainty(**{**vars(uncertainty), **own})


def _of_each(figures: Figures, names: Iterable[tuple[str, str]]) -> FloatArray:
    """Return the figure of each thing by its own name, else its group's, else the default's."""
    if not isinstance(figures, Mapping):
        return figures
    rest = figures.get(DEFAULT_GAIN, 0.0)
    return np.array([figures.get(own, figures.get(group, rest)) for own, group in names])


def stated_uncertainty(uncertainty: Uncertainty) -> dict[str, Any]:
    """Return what a scene file says of a set; None stands for what is known exactly."""
    stated = {name: _stated(value) for name, value in vars(uncertainty).items()}
    nothing = all(value is None for value in stated.values())
    return stated | {"mass": 0.0} if nothing else stated


def _stated(figures: float | Figures) -> Any:
    if isinstance(figures, Mapping):
        return figures[DEFAULT_GAIN] if figures.keys() == {DEFAULT_GAIN} else dict(figures) or None
    values = np.unique(figures)
    if len(values) == 1:
        return values[0] or None
    return figures
