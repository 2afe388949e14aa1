"""Scenes from MuJoCo models, and back.

An MJCF with an object, a hand and their surroundings becomes a `Scene`: object, supports, hand and
loads.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from graspless_pin.algorithms.uncertainty import Uncertainty
from graspless_pin.errors import RobotError, SceneError
from graspless_pin.findings import capture, emit
from graspless_pin.geometry import Compound, FingerSpec, HalfSpace, ManipulatedObject, Support
from graspless_pin.geometry.bodies.shape import Shape
from graspless_pin.geometry.hand.actuation import EffortLimit
from graspless_pin.geometry.hand.assembly import ControlModes, Mount
from graspless_pin.geometry.hand.mjcf import robot_of_source
from graspless_pin.geometry.hand.mjcf_source import body_shape, mj_pose
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import invert
from graspless_pin.geometry.robots.description import RobotDescription
from graspless_pin.holding.controller import Controller
from graspless_pin.interfaces.mujoco_state import ModelState, PairFriction, read_source
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import Scene
from graspless_pin.scene.stated import Load
from graspless_pin.simulation.scene_document import NO_WORD_FOR, scene_to_mjcf

_PAST_LIMIT = 1e-2
"""Largest violation of a joint limit, which is soft in MuJoCo, rad or m."""
_SAME_FRAME = 1e-12
"""m, and entries of rotations: a shape's frame this near to its body's is the same."""
_LINK_OFF = 1e-4
"""m, and entries of rotations: larger differences of link poses from MuJoCo's are reported."""


def object_of(state: ModelState) -> ManipulatedObject:
    """Return the object, in the frame of its body.

    Raises:
        SceneError: If it has no mass or no geom that can touch anything.
    """
    model, data, bodies = state.model, state.data, np.flatnonzero(state.in_object)
    name, T = state.source.body(state.object), state.pose_of(state.object)
    masses, R = model.body_mass[bodies], T[:3, :3]
    geoms = state.touching_geoms(state.in_object)
    if not (masses.sum() > 0.0 and geoms):
        missing = "mass" if geoms else "geom that can touch anything (contype, conaffinity)"
        raise SceneError(f"{state.source.path}: the object {name!r} has no {missing}; give it one")
    center = masses @ data.xipos[bodies] / masses.sum()
    inertia = np.zeros((3, 3))
    for body, mass in zip(bodies.tolist(), masses.tolist(), strict=True):
        axes, arm = data.ximat[body].reshape(3, 3), data.xipos[body] - center
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    inertia = R.T @ inertia @ R
    placed = []
    for geom in geoms:
        shape, T_body_shape = body_shape(state.source, geom)
        placed.append(
            (shape, invert(T) @ state.pose_of(int(model.geom_bodyid[geom])) @ T_body_shape)
        )
    shape = placed[0][0]
    if len(placed) > 1 or not np.allclose(placed[0][1], np.eye(4), rtol=0.0, atol=_SAME_FRAME):
        shapes, poses = zip(*placed, strict=True)
        shape = Compound(shapes, np.array(poses))
    return ManipulatedObject.from_shape(
        name,
        shape,
        T,
        mass=float(masses.sum()),
        center_of_mass=R.T @ (center - T[:3, 3]),
        inertia=0.5 * (inertia + inertia.T),
    )


def supports_of(state: ModelState, friction: PairFriction) -> tuple[Support, ...]:
    """Return a support for each other body that can touch the object.

    Geoms of the world, and geoms of one body with different friction, become separate supports.
    """
    model, source = state.model, state.source
    surrounding = ~(state.in_object | state.in_hand)
    groups: dict[tuple[int, float, int], list[tuple[Shape, FloatArray]]] = {}
    for geom in state.touching_geoms(surrounding):
        body, mu = int(model.geom_bodyid[geom]), friction.smallest_coefficient(geom)
        if mu is None:
            continue
        is_plane = model.geom_type[geom] == source.mujoco.mjtGeom.mjGEOM_PLANE
        if is_plane:
            placed = HalfSpace(), mj_pose(model.geom_quat[geom], model.geom_pos[geom])
        else:
            try:
                placed = body_shape(source, geom)
            except RobotError as error:
                message = str(error).removeprefix(f"{source.path}: ")
                advice = "it is left out as a support: approximate it by several geoms"
                state.emit(_geom_name(state, geom), message, advice)
                continue
        groups.setdefault((body, mu, geom if is_plane or body == 0 else -1), []).append(placed)
    taken = {source.body(body) for body in np.flatnonzero(~surrounding).tolist()}
    supports = []
    for (body, mu, geom), parts in groups.items():
        name = source.body(body) if geom < 0 or body else _geom_name(state, geom)
        shape, T = parts[0]
        if len(parts) > 1:
            shapes, poses = zip(*parts, strict=True)
            shape, T = Compound(shapes, np.array(poses)), np.eye(4)
        name = _unique_name(name, taken)
        supports.append(Support(name, shape, state.pose_of(body) @ T, friction=mu))
    for name in dict.fromkeys(source.body(body) for body, *_ in groups if model.body_weldid[body]):
        message = f"body {name!r} can move in MuJoCo, but is a fixed support here"
        state.emit(name, message, "results are only valid as long as it stands still")
    return tuple(supports)


def _geom_name(state: ModelState, geom: int) -> str:
    return state.model.geom(geom).name or f"geom_{geom}"


def hand_of(
    state: ModelState,
    hand_body: str | None,
    control: ControlModes | None,
    effort_limits: Mapping[str, EffortLimit] | None,
) -> Hand | None:
    """Return the hand at its configuration."""
    if state.hand is None:
        return None
    source, stated = state.source, state.custom.get("hand", {})
    read = None if source.spec is not None else robot_of_source(source)
    robot = RobotDescription(state.name, source.path, root_link=hand_body, read=read)
    fingers = {
        finger: FingerSpec(tuple(one["joints"]), tuple(one["links"]), one["tip"])
        for finger, one in stated.get("fingers", {}).items()
    }
    hand = Hand.assemble(
        [Mount(robot, state.pose_of(state.hand), fingers=fingers or None)],
        control=control or stated.get("control"),
        effort_limits={**stated.get("effort_limits", {}), **(effort_limits or {})},
    )
    joints = {source.joint(joint): joint for joint in range(state.model.njnt)}
    addresses = [state.model.jnt_qposadr[joints[name]] for name in hand.control.joints]
    q, (low, high) = state.data.qpos[addresses], hand.tree.ranges
    pressed = (np.maximum(low - q, q - high) <= _PAST_LIMIT) & (low <= high)
    hand = hand.with_configuration(np.where(pressed, np.clip(q, low, high), q))
    _emit_pose_differences(state, hand)
    return hand


def _emit_pose_differences(state: ModelState, hand: Hand) -> None:
    """Emit findings on links at other poses than in MuJoCo, and on a base with a free joint."""
    source = state.source
    differences = {
        name: float(np.abs(hand.pose_of(name) - state.pose_of(body)).max())
        for body in np.flatnonzero(state.in_hand).tolist()
        for name in [source.body(body)]
        if name in hand.link_names
    }
    name = max(differences, key=lambda link: differences[link], default="")
    if name and differences[name] > _LINK_OFF:
        state.emit(name, f"link {name!r} is {1e3 * differences[name]:.2g} mm or mrad away from its "
              "pose in MuJoCo", "its joints exceed their limits, or do not follow the joints "
              "that they are coupled to")  # fmt: skip
    if state.hand and state.is_free(state.hand):
        name = source.body(state.hand)
        state.emit(name, f"body {name!r}, the hand's base, has a free joint",
              "here the base is fixed where it is")  # fmt: skip


def friction_of_links(state: ModelState, friction: PairFriction) -> dict[str, float]:
    """Return coefficients by link, or one for the hand if all are equal."""
    of_body: dict[int, list[int]] = {}
    for geom in state.touching_geoms(state.in_hand):
        of_body.setdefault(int(state.model.geom_bodyid[geom]), []).append(geom)
    by_link = {}
    for body, geoms in of_body.items():
        name = state.source.body(body)
        each = [friction.smallest_coefficient(geom) for geom in geoms]
        known = [mu for mu in each if mu is not None]
        if len(known) < len(each):
            state.emit(name, f"in MuJoCo no geom of the object can touch {len(each) - len(known)}"
                  f" of the geoms of {name!r}", "here all of them can touch it")  # fmt: skip
        if len(set(known)) > 1:
            state.emit(name, f"the geoms of {name!r} have the coefficients of friction "
                  f"{', '.join(f'{mu:g}' for mu in sorted(set(known)))} against the object",
                  "the smallest is used")  # fmt: skip
        by_link[name] = min(known, default=0.0)
    values = set(by_link.values())
    return {"hand": values.pop()} if len(values) == 1 else by_link


def own_weight_counts(state: ModelState) -> bool:
    """Return whether the hand's own weight counts; emit findings on partial compensation."""
    model, source = state.model, state.source
    share = model.body_gravcomp
    for body in np.flatnonzero(state.in_object & (share != 0.0)).tolist():
        name = source.body(body)
        state.emit(name, f"the object's body {name!r} has gravcomp {share[body]:g}",
              "its whole weight counts here: change its mass or gravity")  # fmt: skip
    heavy = state.in_hand & (model.body_mass > 0.0) & (model.body_weldid != 0)
    compensated = share[heavy] == 1.0
    if len(compensated) and not compensated.all() and (share[heavy] != 0.0).any():
        name = source.body(int(np.flatnonzero(heavy & (share != 0.0))[0]))
        state.emit(name, f"body {name!r} has gravcomp, but not all of the hand's weight has",
              "the weight of all links counts here")  # fmt: skip
    return not (len(compensated) and compensated.all())


def loads_of(state: ModelState) -> tuple[Load, ...]:
    """Return the forces applied to the object; emit findings on all other applied forces."""
    data, source = state.data, state.source
    applied = np.array(data.xfrc_applied)
    for body in np.flatnonzero(applied.any(axis=1) & ~state.in_object).tolist():
        name = source.body(body)
        state.emit(name, f"xfrc_applied pushes body {name!r}",
              "it is ignored: only loads on the object count")  # fmt: skip
    if data.qfrc_applied.any():
        state.emit("qfrc_applied", "qfrc_applied has forces",
              "they are ignored: state them as loads")  # fmt: skip
    bodies = np.flatnonzero(state.in_object)
    if not applied[bodies].any():
        return ()
    masses = state.model.body_mass[bodies]
    center = masses @ data.xipos[bodies] / masses.sum()
    forces, moments = applied[bodies, :3], applied[bodies, 3:]
    moments = moments + np.cross(data.xipos[bodies] - center, forces)
    return (Load("xfrc_applied", force=forces.sum(axis=0), moment=moments.sum(axis=0)),)


def emit_equalities(state: ModelState) -> None:
    """Emit findings on equality constraints that hold the object."""
    model, kinds = state.model, state.source.mujoco.mjtEq
    for index in np.flatnonzero(model.eq_active0).tolist():
        if kinds(int(model.eq_type[index])) not in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
            continue
        ends = model.eq_obj1id[index], model.eq_obj2id[index]
        if model.eq_objtype[index] == state.source.mujoco.mjtObj.mjOBJ_SITE:
            ends = model.site_bodyid[ends[0]], model.site_bodyid[ends[1]]
        if state.in_object[list(ends)].any():
            name = model.equality(index).name or f"no. {index + 1}"
            state.emit(name, f"the equality {name!r} holds the object",
                  "it is ignored: only contacts and loads act on it here")  # fmt: skip


def emit_options(state: ModelState) -> None:
    """Emit findings on options of the model that disable or override contacts or motors."""
    option, mujoco = state.model.opt, state.source.mujoco
    disabled, enabled = mujoco.mjtDisableBit, mujoco.mjtEnableBit
    settings = {
        "contact": (option.disableflags & disabled.mjDSBL_CONTACT, "contacts are disabled"),
        "actuation": (option.disableflags & disabled.mjDSBL_ACTUATION, "motors are disabled"),
        "actuatorgroupdisable": (option.disableactuator, "groups of motors are disabled"),
        "override": (option.enableflags & enabled.mjENBL_OVERRIDE, "o_friction overrides contacts"),
    }
    for name, (is_set, message) in settings.items():
        if is_set:
            state.emit(name, f"{message} ({name})",
                    "this is ignored: contacts and motors count as they are given")  # fmt: skip


def _unique_name(name: str, taken: set[str]) -> str:
    """Return a name that is not taken, and add it to the taken ones."""
    number, unique = 2, name
    while unique in taken:
        unique, number = f"{name}_{number}", number + 1
    taken.add(unique)
    return unique


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

    The body with a free joint becomes the object, with all that is fixed to it, MuJoCo's inertia
    and the frame of its body. The trees of bodies with motors become the hand, as in other MJCFs of
    hands. Every other geom that can touch the object becomes a support of its name; bodies that
    could move there are fixed, and a warning names them. Friction is MuJoCo's sliding friction of
    each pair: the larger one, or that of the higher priority, or the pair's own. Torsional and
    rolling friction, softness, margins and gaps of contacts and velocities are left out, and so are
    elements without a meaning for rigid bodies at rest: a warning names them.

    Args:
        source: Path of the MJCF, ``mujoco.MjSpec`` or ``mujoco.MjModel``. `Scene.save` needs a
            path.
        data: ``mujoco.MjData`` with the positions of joints and object, and the forces in
            ``xfrc_applied`` as loads on the object; None: a keyframe.
        object_body: Name of the object's body; None: the only one with a free joint.
        hand_body: Name of the hand's first body; None: all trees with motors.
        keyframe: Name or number of a keyframe; None: the only one, or, if there is none, the
            model's initial positions.
        control: See `Hand.assemble`.
        effort_limits: See `Hand.assemble`; they replace the limits by the motors' ranges and gears.

    Returns:
        The scene; its other fields are set by `Scene.with_changes`.

    Raises:
        ArgumentError: If a body or keyframe is unknown, or has to be specified.
        RobotError: If MuJoCo is not installed or refuses the file, or it has a hand or shape that
            cannot be read.
        SceneError: If joints are inside the object, or a motor moves it.

    Warns:
        GrasplessPinWarning: Something is left out, or a body that MuJoCo moves is fixed here.

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
    with capture() as findings:
        state = ModelState(read_source(source), data, keyframe, object_body, hand_body)
        scene = _scene_of_state(state, hand_body, control, effort_limits)
    emit(*findings)
    of_hand = () if scene.hand is None else scene.hand.findings
    return scene.with_changes(load_findings=[one for one in findings if one not in of_hand])


def _scene_of_state(
    state: ModelState,
    hand_body: str | None,
    control: ControlModes | None,
    effort_limits: Mapping[str, EffortLimit] | None,
) -> Scene:
    friction = PairFriction(state)
    supports = supports_of(state, friction)
    by_link = friction_of_links(state, friction)
    friction.emit()
    emit_equalities(state)
    emit_options(state)
    gravity = np.array(state.model.opt.gravity)
    if state.model.opt.disableflags & state.source.mujoco.mjtDisableBit.mjDSBL_GRAVITY:
        gravity = np.zeros(3)
    scene = Scene(
        name=state.name,
        object=object_of(state),
        hand=hand_of(state, hand_body, control, effort_limits),
        supports=supports,
        friction=by_link or {"default": 0.0},  # supports have their own
        gravity=gravity,
        loads=loads_of(state),
        count_own_weight=own_weight_counts(state),
    )
    stated = {name: state.custom[name] for name in NO_WORD_FOR if name in state.custom}
    if "controller" in state.custom:
        stated["controller"] = Controller(**state.custom["controller"])
    if "uncertainty" in state.custom:
        stated["uncertainty"] = Uncertainty(**state.custom["uncertainty"])
    return scene.with_changes(**stated) if stated else scene
