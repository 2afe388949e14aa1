"""Text of a first scene with a robot and an object: complete, commented, the hand away from it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.findings import FindingCode, capture, emit
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import HalfSpace, Shape
from graspless_pin.geometry.hand.actuation import is_placeholder
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.fingers import driving_joints
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.posing.finger_joints import arm_above
from graspless_pin.geometry.posing.opposing import carrier_of, fingers_that_close
from graspless_pin.geometry.posing.settling import base_beside, clear_base, lying_object
from graspless_pin.geometry.robots.description import RobotDescription
from graspless_pin.geometry.robots.files import find_robot
from graspless_pin.intake.yaml_source import plain
from graspless_pin.intake.yaml_text import block_of, flow_of
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.entry_findings import unit_findings
from graspless_pin.scene.saving import path_writer
from graspless_pin.scene.serialization import robot_entry, rotation_entry

SCHEMA_FILE = "scene.schema.json"
"""Beside a new scene: the JSON schema, which editors read."""

_GUESSED_DENSITY = 500.0  # kg/m^3
_LEAST_NORMAL_FORCE, _FORCE_OVER_WEIGHT = 50.0, 5.0  # N, 1
_LIMITS = (FindingCode.PLACEHOLDER_EFFORT, FindingCode.UNKNOWN_EFFORT)


class NewSceneText(NamedTuple):
    """The text of a new scene, and notes for its user.

    Attributes:
        text: Text of the file.
        left_open: Actuators whose effort limits are left open.
        kept: Limits (N m, N) by actuator that the robot's files state, so that `effort` has no
            effect; empty where that is None.
        unplaceable: Why the hand cannot be placed; empty if it can.
        out_of_reach: Palms on arms that may not reach the object from the robot's base; empty if
            the base need not be moved.
    """

    text: str
    left_open: tuple[str, ...]
    kept: Mapping[str, float]
    unplaceable: str
    out_of_reach: tuple[str, ...]


def new_scene_text(
    target: Path,
    robot_name: str,
    object_name: str,
    shape: Shape,
    *,
    package_dirs: Sequence[Path] = (),
    mass: float | None = None,
    density: float | None = None,
    slope: float = 0.0,
    efforts: Mapping[str, float] = MappingProxyType({}),
    effort: float | None = None,
    visuals_collide: bool = False,
    root_link: str | None = None,
) -> NewSceneText:
    """Return the text of a new scene.

    The object rests on the support. The hand does not touch it: it is above the support, or on the
    support where an arm reaches the object from there.

    Args:
        target: The file: paths in it are relative to its folder.
        robot_name: A URDF, xacro file, MJCF or robot file, or the name of a robot.
        object_name: Name of the object in results.
        shape: Shape of the object.
        package_dirs: Folders for the ``package://`` addresses of a URDF.
        mass: kg; or
        density: kg/m^3; with neither a density is guessed.
        slope: Angle of the support, rad; it falls towards +x.
        efforts: Effort limit (N m, N) by finger, joint or tendon, which replaces the robot's own.
        effort: Limit of all others that the robot's files do not state; None: left open.
        visuals_collide: Whether links without collision shapes take their visual ones.
        root_link: Link to take with all links below it, such as the palm of a whole robot; None:
            the robot file's, else all.

    Raises:
        GrasplessPinError: If the robot, the mesh or a figure is invalid.
    """
    robot = find_robot(robot_name, package_dirs)
    robot = replace(
        robot,
        visuals_collide=visuals_collide or robot.visuals_collide,
        root_link=root_link or robot.root_link,
    )
    with capture() as findings:
        hand = Hand.assemble([Mount(robot)], effort_limits=efforts)
    emit(*(one for one in findings if one.code not in _LIMITS))
    T_support = pose_matrix(np.zeros(3), (0.0, slope, 0.0))
    support = Support("slope" if slope else "table", HalfSpace(), T_support)
    is_guessed = mass is None and density is None
    target_object = ManipulatedObject.from_shape(
        object_name,
        shape,
        np.eye(4),
        mass=mass,
        density=_GUESSED_DENSITY if is_guessed else density,
    )
    lying = lying_object(target_object, support)
    emit(*unit_findings(lying, beside_hand=True))
    path_text = path_writer(target)
    weight = 9.81 * lying.mass
    limits, left_open, kept = _effort_lines(hand, efforts, effort)
    unplaceable = ""
    try:
        fingers_that_close(hand, None)
    except ArgumentError as error:
        unplaceable = str(error)
    found_arms = (arm_above(hand, carrier_of(hand, name)) for name in hand.fingers)
    arms = {arm.joint: arm for arm in found_arms if arm is not None}
    reaching_base = (
        base_beside(hand, next(iter(arms.values())), lying, support) if len(arms) == 1 else None
    )
    base = clear_base(hand, lying, T_support[:3, 2]) if reaching_base is None else reaching_base
    text = _TEXT.format(
        schema=SCHEMA_FILE,
        name=flow_of(f"{robot.name} and {lying.name}"),
        force=f"{max(_LEAST_NORMAL_FORCE, float(f'{_FORCE_OVER_WEIGHT * weight:.1g}')):g}",
        robot=_yaml_block(robot_entry(robot, path_text), 2),
        base=_pose_lines(base, np.eye(3), 4),
        stands="graspless-pin place finds one that holds the object"
        if reaching_base is None
        else "the arm reaches the object from there",
        fingers=_finger_lines(robot, hand),
        q=_position_lines(hand),
        efforts=limits,
        object=flow_of(lying.name),
        shape=_shape_lines(lying.shape.as_entry(path_text)),
        mass=_mass_line(mass, density),
        pose=_pose_lines(lying.T_world_object[:3, 3], lying.T_world_object[:3, :3], 7),
        support=support.name,
        **_slope_fields(slope),
    )
    out_of_reach = hand.palms if arms and reaching_base is None else ()
    return NewSceneText(text, left_open, kept, unplaceable, out_of_reach)


_TEXT = """\
# yaml-language-server: $schema={schema}
# SI units: m, kg, s, N, N m, rad; degrees where a key ends in _deg.
name: {name}
gravity: [0, 0, -9.81] # m/s^2, world axes
friction: # coefficients at the object, both guessed: measure them or look them up
  hand: 0.8 # rubber on wood
  supports: 0.4 # wood on wood
max_normal_force: {force} # N, largest admissible normal force
hand:
{robot}
  base_pose: # of the root link in the world; {stands}
{base}
{fingers}{q}{efforts}object:
  name: {object}
{shape}
  {mass}
  pose: # at rest on the support
{pose}
supports:
  - name: {support}
    shape: {{type: half_space}} # solid below z = 0 of its frame
{slope}    # velocity: {{linear: [0.05, 0, 0]}} # m/s: a moving support, such as a conveyor
# motion: {{object_twist: {{linear: [0.02, 0, 0]}}}} # m/s: a slow motion; else at rest
{axes}solve: # algorithm: torque for the smallest torques, with margin: 0.1 (N)
  algorithm: margin # the largest margin
  node_limit: 1000 # of the search over virtual slidings; then: the best answer, and a bound
"""


def _yaml_block(data: Mapping[str, Any], column: int) -> str:
    """Return the entries that are not None as YAML lines, indented to a column."""
    given = {name: value for name, value in data.items() if value is not None}
    return block_of(plain(given), column)


def _pose_lines(position: ArrayLike, R: FloatArray, digits: int) -> str:
    turned = rotation_entry(R, "rpy_deg").get("rpy_deg", [0.0, 0.0, 0.0])
    angles = [_number_text(angle, 6) for angle in turned]
    return f"    position: {_vector_text(position, digits)}\n    rpy_deg: [{', '.join(angles)}]"


def _number_text(number: float, digits: int) -> str:
    return f"{round(float(number), digits) + 0.0:.{digits + 4}g}"


def _vector_text(numbers: ArrayLike, digits: int) -> str:
    return f"[{', '.join(_number_text(one, digits) for one in np.asarray(numbers).tolist())}]"


def _finger_lines(robot: RobotDescription, hand: Hand) -> str:
    if robot.fingers or not hand.fingers:
        return ""
    found = {name: {"joints": spec.joints, "tip": spec.tip} for name, spec in hand.fingers.items()}
    palms = flow_of(", ".join(hand.palms))
    return (
        f"  fingers: # the branches below {palms}: rename them, remove those that are no fingers\n"
        + (_yaml_block(found, 4) + "\n")
    )


def _position_lines(hand: Hand) -> str:
    tree = hand.tree
    lines = ["  q: # rad, m of prismatic joints; in degrees under q_deg\n"]
    for name in hand.control.joints:
        index = tree.joint_index[name]
        limits = f"{tree.lower[index]:.4g} .. {tree.upper[index]:.4g}"
        lines.append(f"    {flow_of(name)}: {_number_text(hand.q[name], 6)} # {limits}\n")
    return "".join(lines) if len(lines) > 1 else ""


def _stated_limit_text(limit: float) -> str:
    return f"the file says {limit:g}" if math.isfinite(limit) else "the file gives no limit"


def _effort_lines(
    hand: Hand, efforts: Mapping[str, float], effort: float | None
) -> tuple[str, tuple[str, ...], dict[str, float]]:
    """Return the lines of effort limits, the actuators left open, and the files' limits kept."""
    lines = [f"    {flow_of(name)}: {limit:g}\n" for name, limit in efforts.items()]
    left_open = []
    limit_pairs = np.transpose(hand.effort_limits).tolist()
    ranges = dict(zip(hand.actuation.names, limit_pairs, strict=True))
    stated = {name: max(-low, high) for name, (low, high) in ranges.items()}
    doubtful = [
        name for one in hand.findings if one.code in _LIMITS for name in one.subject.split(", ")
    ]
    for name in doubtful:
        if effort is not None:
            lines.append(f"    {flow_of(name)}: {effort:g} # {_stated_limit_text(stated[name])}\n")
        elif not is_placeholder(stated[name]):
            low, high = ranges[name]
            limit = f"{high:g}" if high == -low else f"[{low:g}, {high:g}]"
            lines.append(f"    {flow_of(name)}: {limit} # from the file, which gives no source\n")
        else:
            lines.append(f"    {flow_of(name)}: # fill in; {_stated_limit_text(stated[name])}\n")
            left_open.append(name)
    kept: dict[str, float] = {}
    if effort is not None:
        unstated = {*hand.actuation.passive, *doubtful, *efforts}
        for name in hand.fingers.keys() & efforts:
            unstated.update(driving_joints(hand.tree, hand.fingers[name]))
        kept = {name: limit for name, limit in stated.items() if name not in unstated}
    if not lines:
        empty = "  # effort_limits: {} # N m, N: by joint or finger, instead of the robot's\n"
        return empty, (), kept
    head = "  effort_limits: # N m (N for prismatic joints, tendons): largest effort of each motor"
    return f"{head}\n{''.join(lines)}", tuple(left_open), kept


def _shape_lines(stated: dict[str, Any]) -> str:
    if stated["type"] != "mesh":
        return f"  shape: {flow_of(plain(stated))} # m"
    return f"""  shape:
    type: mesh
    path: {flow_of(stated["path"])}
    scale: {flow_of(plain(stated["scale"]))} # m per unit of the file
    convex: {stated["convex"]} # hull, or decompose: convex pieces, if concave parts matter"""


def _mass_line(mass: float | None, density: float | None) -> str:
    if mass is not None:
        return f"mass: {mass:g} # kg"
    if density is not None:
        return f"density: {density:g} # kg/m^3; or give its mass (kg)"
    return f"density: {_GUESSED_DENSITY:g} # kg/m^3, guessed: give the measured mass (kg) instead"


def _slope_fields(angle: float) -> dict[str, str]:
    """Return the lines of the support's pose and of tangent axes, both empty on level ground."""
    if not angle:
        return {"slope": "", "axes": ""}
    turn, downhill = math.degrees(angle), _vector_text([math.cos(angle), 0.0, -math.sin(angle)], 7)
    return {
        "slope": f"    pose: {{rpy_deg: [0, {_number_text(turn, 6)}, 0]}} # descends towards +x\n",
        "axes": f"tangent_axes: [{downhill}] # t1 points downhill, t2 across\n",
    }
