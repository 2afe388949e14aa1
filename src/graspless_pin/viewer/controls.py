"""The figures of a scene that a viewer may change, and the scene after a change."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import HalfSpace
from graspless_pin.geometry.hand.model import Hand, displaced_hand
from graspless_pin.geometry.poses import turned_about
from graspless_pin.problem.checks import FloatArray, unknown_name
from graspless_pin.scene import Scene
from graspless_pin.scene.problem_data import friction_at
from graspless_pin.visualization.picture import up_against

_FRICTION = "friction/"
OBJECT_PLACE, HAND_PLACE = "object/", "hand/"
"""Prefixes of the keys of rigid displacements; `PLACES` are their endings."""
PLACES = ("x", "y", "z", "turn_x", "turn_y", "turn_z")
"""Shift (mm) and rotation vector (degrees) along and about the world's axes."""
ALONG = "object/along"
"""Whether the object stays in the plane of the first half-space: 1 or 0."""
_JOINT = "joint/"
_MOST_SHIFT = 100.0  # mm
_MOST_TURN = 180.0  # degrees
_MOST_TILT = 45.0  # degrees
_LEVEL_SINE = 1e-6


@dataclass(frozen=True)
class Control:
    """A figure of a scene that can be changed. See the example of `controls_of`.

    Attributes:
        key: ``friction/hand``, ``friction/supports``, ``mass``, ``slope``, ``object/x`` to
            ``object/turn_z``, ``object/along``, the same of ``hand/``, or ``joint/NAME``.
        label: What the page calls it, with its unit.
        group: The folder that it is in.
        low: Smallest value.
        high: Largest value.
        step: Distance between values.
        initial: The scene's own value.
    """

    key: str
    label: str
    group: str
    low: float
    high: float
    step: float
    initial: float


def controls_of(scene: Scene) -> tuple[Control, ...]:
    """Return the controls of a scene.

    Object and joints can be moved where contacts are found from the shapes, not where they are
    given.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.viewer import controls_of
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> [control.label for control in controls_of(scene)][:2]
        ['friction, hand', 'friction, supports']
    """
    controls = [*_friction_controls(scene)]
    mass = scene.object.mass
    step = 10.0 ** (math.floor(math.log10(mass)) - 2)
    controls.append(Control("mass", "mass [kg]", "Load", 5.0 * step, 4.0 * mass, step, mass))
    name, angle = _slope_name_and_angle(scene)
    angle = round(angle, 2)
    low, high = max(angle - _MOST_TILT, 0.0 if angle > 0.0 else -_MOST_TILT), angle + _MOST_TILT
    label = "tilt [°]" if name is None else f"angle of {name} [°]"
    controls.append(Control("slope", label, "Load", low, high, 0.1, angle))
    if scene.given_contacts is None:
        controls += _place_controls(OBJECT_PLACE, "Object")
        if _first_half_space(scene) is not None:
            label = f"stay on {_slope_name_and_angle(scene)[0]}"
            controls.append(Control(ALONG, label, "Object", 0.0, 1.0, 1.0, 0.0))
        if scene.hand is not None:
            controls += _place_controls(HAND_PLACE, "Hand's base")
            controls += _joint_controls(scene.hand)
    return tuple(controls)


def changed_scene(scene: Scene, values: Mapping[str, float]) -> Scene:
    """Return the scene with other values of its controls; those that are not named stay.

    Friction of a group scales in proportion, with its largest coefficient becoming the value. The
    slope turns gravity, which is the same as tilting hand, object and supports together. The object
    turns about its centre of mass, the hand about its base. Where the object stays on a half-space,
    shifts along its normal and turns about other axes are left out.

    Args:
        scene: The scene.
        values: Value by the key of its control.

    Raises:
        ArgumentError: A key is no control of this scene or a value is impossible.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.viewer import changed_scene
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> smoother = changed_scene(scene, {"friction/supports": 0.2})
        >>> print(f"{smoother.solve().margin:.4f} N")
        1.1622 N
    """
    controls = {control.key: control for control in controls_of(scene)}
    for key, value in values.items():
        if key not in controls:
            raise unknown_name("values", "control", key, [*controls])
        if not math.isfinite(value):
            raise ArgumentError("values", f"{key} is {value!r}; it must be a finite number")
    moved = {key: value for key, value in values.items() if value != controls[key].initial}
    changed = scene
    for key, value in moved.items():
        if key.startswith(_FRICTION):
            first = controls[key].initial
            changed = _with_group_friction(
                changed,
                key.removeprefix(_FRICTION),
                lambda mu, first=first, value=value: mu * value / first if first > 0.0 else value,
            )
    if "mass" in moved:
        changed = changed.with_changes(object=replace(changed.object, mass=moved["mass"]))
    if "slope" in moved:
        angle = math.radians(_slope_name_and_angle(scene)[1] - moved["slope"])
        turn = Rotation.from_rotvec(angle * _tilt_axis(scene))
        gravity = scene.gravity.copy()  # scipy takes no read-only array
        changed = changed.with_changes(gravity=turn.apply(gravity))
    shift, turn = stated_displacement(moved, OBJECT_PLACE)
    if moved.get(ALONG):
        normal = support_frame(scene)[:, 2]
        shift, turn = shift - (shift @ normal) * normal, (turn @ normal) * normal
    if shift.any() or turn.any():
        body = changed.object
        T = displacement_about(body.center_of_mass_world, shift, turn) @ body.T_world_object
        changed = changed.with_changes(object=replace(body, T_world_object=T))
    shift, turn = stated_displacement(moved, HAND_PLACE)
    if changed.hand is not None and (shift.any() or turn.any()):
        displacement = displacement_about(changed.hand.T_world_base[:3, 3], shift, turn)
        changed = changed.with_changes(hand=displaced_hand(changed.hand, displacement))
    joints = {
        key.removeprefix(_JOINT): value for key, value in moved.items() if key.startswith(_JOINT)
    }
    if joints and changed.hand is not None:
        changed = changed.with_changes(hand=changed.hand.with_configuration(joints))
    return changed


def stated_displacement(values: Mapping[str, float], group: str) -> tuple[FloatArray, FloatArray]:
    """Return the (3,) shift, m, and rotation vector, rad, that values of `PLACES` state.

    Args:
        values: Value by key; those that are not named are zero.
        group: `OBJECT_PLACE` or `HAND_PLACE`.
    """
    place = np.array([values.get(group + name, 0.0) for name in PLACES])
    return place[:3] / 1000.0, np.radians(place[3:])


def displacement_values(group: str, shift: FloatArray, turn: FloatArray) -> dict[str, float]:
    """Return the values that state a shift (m) and a rotation vector (rad), within their ranges."""
    place = [
        *np.clip(1000.0 * shift, -_MOST_SHIFT, _MOST_SHIFT),
        *np.clip(np.degrees(turn), -_MOST_TURN, _MOST_TURN),
    ]
    return {group + name: round(float(x), 2) for name, x in zip(PLACES, place, strict=True)}


def displacement_about(center: FloatArray, shift: FloatArray, turn: FloatArray) -> FloatArray:
    """(4, 4) rotation about a point by a vector (rad), then a shift (m), world axes."""
    return turned_about(center, Rotation.from_rotvec(turn).as_matrix(), shift)


def support_frame(scene: Scene) -> FloatArray:
    """(3, 3) axes of the first half-space, its outward normal last; the world's without one."""
    support = _first_half_space(scene)
    return np.eye(3) if support is None else support.T_world_support[:3, :3]


def _place_controls(group: str, folder: str) -> list[Control]:
    labels = [f"shift along {axis} [mm]" for axis in "xyz"]
    labels += [f"turn about {axis} [°]" for axis in "xyz"]
    reaches = [_MOST_SHIFT] * 3 + [_MOST_TURN] * 3
    return [
        Control(group + name, label, folder, -reach, reach, 0.1, 0.0)
        for name, label, reach in zip(PLACES, labels, reaches, strict=True)
    ]


def _friction_controls(scene: Scene) -> list[Control]:
    """Return a control for the hand's contacts and one for the supports', where there are any."""
    try:
        coefficients = scene.problem().friction
        bodies = scene.contacts.bodies
    except SceneError:
        return []
    supports = {support.name for support in scene.supports}
    controls = []
    for group in ("hand", "supports"):
        mask = np.array([(body in supports) == (group == "supports") for body in bodies])
        if mask.any():
            largest = float(coefficients[mask].max())
            differ = bool(np.ptp(coefficients[mask]) > 0.0)
            label = f"friction, {group}" + (" (largest)" if differ else "")
            high = max(1.5, 2.0 * largest)
            controls.append(Control(_FRICTION + group, label, "Load", 0.0, high, 0.01, largest))
    return controls


def _joint_controls(hand: Hand) -> list[Control]:
    controls = []
    for index, low, high in zip(hand.tree.coupling.leaders, *hand.tree.ranges, strict=True):
        name = hand.joint_names[index]
        value = float(hand.positions[index])
        prismatic = hand.tree.joint_kinds[index] == "prismatic"
        reach = 0.1 if prismatic else math.pi
        low = min(float(low), value) if math.isfinite(low) else value - reach
        high = max(float(high), value) if math.isfinite(high) else value + reach
        finger = next(
            (finger for finger, spec in hand.fingers.items() if name in spec.joints), "other joints"
        )
        label, step = f"{name} [{'m' if prismatic else 'rad'}]", 1e-4 if prismatic else 1e-3
        controls.append(Control(_JOINT + name, label, f"Joints: {finger}", low, high, step, value))
    return controls


def _with_group_friction(scene: Scene, group: str, change: Callable[[float], float]) -> Scene:
    """Change the coefficients of one group; those of materials become the bodies' own."""
    if group == "supports":
        return scene.with_changes(
            supports=tuple(
                replace(support, friction=change(own), material=None)
                if (own := _support_friction(scene, support.name)) is not None
                else support
                for support in scene.supports
            )
        )
    links = () if scene.hand is None else scene.hand.link_names
    friction = dict(scene.friction)
    if scene.hand_material is not None and scene.object.material is not None:
        of_pair = scene.materials.friction(scene.hand_material, scene.object.material)
        friction = {key: value for key, value in friction.items() if key not in links}
        friction["hand"] = change(of_pair)
        return scene.with_changes(friction=friction, hand_material=None)
    for key in ("hand", *links):
        if key in friction:
            friction[key] = change(friction[key])
    if "hand" not in friction and "default" in friction:
        friction["hand"] = change(friction["default"])
    return scene.with_changes(friction=friction)


def _support_friction(scene: Scene, name: str) -> float | None:
    """Return the coefficient between object and a support, None where the scene has none."""
    try:
        return friction_at(scene, "supports", name)
    except SceneError:
        return None


def _first_half_space(scene: Scene) -> Support | None:
    """Return the first half-space among the supports."""
    return next((one for one in scene.supports if isinstance(one.shape, HalfSpace)), None)


def _slope_name_and_angle(scene: Scene) -> tuple[str | None, float]:
    """Return the name of the first half-space and its angle against level ground, degrees."""
    support = _first_half_space(scene)
    if support is None:
        return None, 0.0
    cosine = float(np.clip(support.T_world_support[:3, 2] @ up_against(scene.gravity), -1.0, 1.0))
    return support.name, math.degrees(math.acos(cosine))


def _tilt_axis(scene: Scene) -> FloatArray:
    """Return the axis about which up turns towards the slope's normal; y on level ground."""
    support, axis = _first_half_space(scene), np.zeros(3)
    if support is not None:
        axis = np.cross(up_against(scene.gravity), support.T_world_support[:3, 2])
    length = float(np.linalg.norm(axis))
    return axis / length if length > _LEVEL_SINE else np.array([0.0, 1.0, 0.0])
