"""Whole scenes from MuJoCo, and back.

From an MJCF with an object, a hand and what stands around them to a `Scene`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from graspless_pin.algorithms.uncertainty import Uncertainty
from graspless_pin.findings import capture, emit
from graspless_pin.geometry.hand.actuation import EffortLimit
from graspless_pin.geometry.hand.assembly import ControlModes
from graspless_pin.holding.controller import Controller
from graspless_pin.interfaces.mujoco_bodies import (
    friction_of_links,
    hand_of,
    loads_of,
    object_of,
    supports_of,
    tell_equalities,
    weight_counts,
)
from graspless_pin.interfaces.mujoco_state import ModelState, PairFriction, source_of
from graspless_pin.scene import Scene
from graspless_pin.simulation.scene_document import NO_WORD_FOR, scene_to_mjcf

__all__ = ["scene_from_mjcf", "scene_to_mjcf"]


def scene_from_mjcf(
    source: Any,
    data: Any = None,
    *,
    object_body: str | None = None,
    hand_body: str | None = None,
    keyframe: str | int | None = None,
    control: ControlModes | None = None,
    effort_limits: Mapping[str, EffortLimit] | None = None,
) -> Scene:
    """Return the scene of a whole MJCF.

    The body with a free joint becomes the object, with all that is fixed to it, its inertia as
    MuJoCo has it and the frame of its body. The trees of bodies with motors become the hand, as
    MJCFs of hands are read everywhere. Every other geom that can touch the object becomes a support
    of its name; what could move there stands still, and a warning names it. Friction is MuJoCo's
    sliding friction of each pair: the larger one, or that of the higher priority, or the pair's
    own. Torsional and rolling friction, softness, margins and gaps of contacts and velocities are
    left out, and so is what no rigid bodies at rest have a word for: a warning names the element.

    Args:
        source: Path of the MJCF, ``mujoco.MjSpec`` or ``mujoco.MjModel``. `Scene.save` needs a
            path.
        data: ``mujoco.MjData`` with the positions of joints and object, and the forces in
            ``xfrc_applied`` as loads on the object; None: a keyframe.
        object_body: Name of the object's body; None: the only one with a free joint.
        hand_body: Name of the body with which the hand begins; None: all trees with motors.
        keyframe: Name or number of a keyframe; None: the only one, or, where there is none, the
            model's initial positions.
        control: See `Hand.assemble`.
        effort_limits: See `Hand.assemble`; they replace what the motors' ranges and gears say.

    Returns:
        The scene; its other fields are set by `Scene.with_changes`.

    Raises:
        ArgumentError: If a body or keyframe is unknown, or it has to be said which one.
        RobotError: If MuJoCo is not installed or refuses the file, or it has a hand or shape that
            cannot be read.
        SceneError: If joints are inside the object, or a motor moves it.

    Warns:
        GrasplessPinWarning: Something is left out, or stands still that MuJoCo moves.

    Examples:
        >>> import mujoco
        >>> from graspless_pin.interfaces.mujoco import scene_from_mjcf
        >>> model = mujoco.MjModel.from_xml_string('''
        ... <mujoco>
        ...   <option gravity="1.7 0 -9.6"/>
        ...   <worldbody>
        ...     <geom name="table" type="plane" size="1 1 0.1" friction="0.5"/>
        ...     <body name="box" pos="0 0 0.02">
        ...       <freejoint/>
        ...       <geom type="box" size="0.04 0.03 0.02" mass="0.2" friction="0.3"/>
        ...     </body>
        ...   </worldbody>
        ... </mujoco>''')
        >>> scene = scene_from_mjcf(model)
        >>> scene.supports[0].friction, scene.solve().found
        (0.5, True)
    """
    with capture() as found:
        at = ModelState(source_of(source), data, keyframe, object_body, hand_body)
        scene = _scene(at, hand_body, control, effort_limits)
    emit(*found)
    of_hand = () if scene.hand is None else scene.hand.findings
    return scene.with_changes(load_findings=[one for one in found if one not in of_hand])


def _scene(
    at: ModelState,
    hand_body: str | None,
    control: ControlModes | None,
    effort_limits: Mapping[str, EffortLimit] | None,
) -> Scene:
    friction = PairFriction(at)
    supports = supports_of(at, friction)
    by_link = friction_of_links(at, friction)
    friction.tell()
    tell_equalities(at)
    gravity = np.array(at.model.opt.gravity)
    if at.model.opt.disableflags & at.source.mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        gravity = np.zeros(3)
    scene = Scene(
        name=at.name,
        object=object_of(at),
        hand=hand_of(at, hand_body, control, effort_limits),
        supports=supports,
        friction=by_link or {"default": 0.0},  # supports have their own
        gravity=gravity,
        loads=loads_of(at),
        count_own_weight=weight_counts(at),
    )
    stated = {name: at.beyond[name] for name in NO_WORD_FOR if name in at.beyond}
    if "controller" in at.beyond:
        stated["controller"] = Controller(**at.beyond["controller"])
    if "uncertainty" in at.beyond:
        stated["uncertainty"] = Uncertainty(**at.beyond["uncertainty"])
    return scene.with_changes(**stated) if stated else scene
