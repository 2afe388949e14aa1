"""What a scene file says of a scene: plain data with every key that the schema has."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import pose_matrix, roll_pitch_yaw
from graspless_pin.geometry.robots.description import RobotDescription
from graspless_pin.geometry.robots.files import find_robot, load_robot, robot_names
from graspless_pin.holding.controller import DAMPING
from graspless_pin.intake.yaml_source import plain
from graspless_pin.problem import ControlMode
from graspless_pin.scene.body_building import stated_turn
from graspless_pin.scene.fields import SceneFields
from graspless_pin.scene.scene_schema import PLAIN_FIGURES, SolveEntry
from graspless_pin.scene.uncertain_figures import stated_uncertainty
from graspless_pin.scene.units import degrees_of, rounded_angle

_SAME_ROTATION = 1e-12
ROBOT = (
    "robot", "urdf", "srdf", "package_dirs", "root_link", "visuals_collide", "fingers", "convex",
    "concavity", "decompose_time_limit", "max_pieces",
)  # fmt: skip
"""Keys of a mount that tell which robot it is of."""


def stated_scene(scene: SceneFields, path_text: Callable[[Path], str]) -> dict[str, Any]:
    """Return what a scene file says of a scene, whether or not it is a default.

    Rotations are matrices, masses are not densities, materials stand once a pair, robots stand
    under ``hand.mounts``, and joints and limits by joint. What is not there is None.

    Args:
        scene: The scene.
        path_text: Returns how the file names another file.
    """
    hand, target, motion, controller = scene.hand, scene.object, scene.motion, scene.controller
    in_a_word = isinstance(controller.stiffness, str) and controller.damping == DAMPING
    of_hand = {
        "hybrid_force_limit": scene.hybrid_force_limit,
        "material": scene.hand_material,
        "count_own_weight": scene.count_own_weight,
    }
    stated = {
        "name": scene.name,
        "gravity": scene.gravity,
        "hand": None if hand is None else stated_hand(hand, path_text) | of_hand,
        "object": {
            "name": target.name,
            "shape": target.shape.stated(path_text),
            "mass": target.mass,
            "center_of_mass": target.center_of_mass,
            "inertia": target.inertia,
            "material": target.material,
            "pose": _pose(target.T_world_object),
        },
        "supports": [
            {
                "name": support.name,
                "shape": support.shape.stated(path_text),
                "pose": _pose(support.T_world_support),
                "friction": support.friction,
                "velocity": _twist(support.velocity),
                "material": support.material,
            }
            for support in scene.supports
        ],
        "friction": dict(scene.friction),
        "materials": _materials(scene),
        "contacts": scene.given_contacts and [vars(one) for one in scene.given_contacts],
        "motion": motion
        and {
            "object_twist": _twist(motion.object_twist),
            "hand": motion.hand
            and {
                "base_twist": _twist(motion.hand.base_twist),
                "joint_velocities": motion.hand.joint_velocities,
            },
        },
        "loads": [vars(load) for load in scene.loads],
        "acceleration": None if scene.acceleration is None else vars(scene.acceleration),
        **{name: getattr(scene, name) for name in PLAIN_FIGURES},
        "tangent_axes": list(scene.tangent_axes),
        "controller": controller.stiffness if in_a_word else vars(controller),
        "uncertainty": scene.uncertainty and stated_uncertainty(scene.uncertainty),
        "solve": SolveEntry().model_dump() | dict(scene.solve_options),
    }
    return plain(stated)


def stated_hand(hand: Hand, path_text: Callable[[Path], str]) -> dict[str, Any]:
    """Return what a scene file says of a hand alone: see `stated_scene`."""
    tree, actuation, control = hand.tree, hand.actuation, hand.control
    modes = {name: mode for name, mode in control.joints.items() if mode is not ControlMode.HYBRID}
    armature = tree.armature
    limits = zip(actuation.names, *hand.effort_limits, strict=True)
    return plain(
        {
            "mounts": [_mount(hand, mount, path_text) for mount in hand.mounts],
            "q": {name: hand.q[name] for name in control.joints},
            "control": modes | dict.fromkeys(control.hybrid_fingers, ControlMode.HYBRID),
            "effort_limits": {
                name: upper if upper == -lower and name not in actuation.tendons else (lower, upper)
                for name, lower, upper in limits
                if name not in actuation.passive
            },
            "armature": {name: armature[tree.joint_index[name]] for name in control.joints},
        }
    )


def stated_rotation(R: ArrayLike, form: str = "rpy") -> dict[str, Any]:
    """Return what a scene file says of a rotation.

    Args:
        R: (3, 3).
        form: One of `ROTATION_FORMS`; where rounding would show, the matrix is taken.
    """
    matrix = np.asarray(R)
    if form == "matrix":
        return {"matrix": plain(matrix)}
    if form == "quaternion":
        numbers = Rotation.from_matrix(matrix).as_quat().tolist()
    else:
        angles = roll_pitch_yaw(matrix)
        in_file = degrees_of if form == "rpy_deg" else rounded_angle
        numbers = [in_file(angle) for angle in angles]
    back = pose_matrix(np.zeros(3), stated_turn({form: numbers})[1])
    if np.abs(back[:3, :3] - matrix).max() > _SAME_ROTATION:
        return {"matrix": plain(matrix)}
    return {form: numbers} if form == "quaternion" or any(numbers) else {}


def robot_key(mount: Mount) -> RobotDescription:
    """Return a mount's robot with its paths in one form, so that two can be compared."""
    robot = find_robot(mount.source)
    return replace(
        robot,
        urdf_path=_one_form(robot.urdf_path),
        package_dirs=tuple(map(_one_form, robot.package_dirs)),
        file=None if robot.file is None else _one_form(robot.file),
        srdf=None if robot.srdf is None else _one_form(robot.srdf),
    )


def _mount(hand: Hand, mount: Mount, path_text: Callable[[Path], str]) -> dict[str, Any]:
    meshes = mount.meshes
    fingers = mount.fingers
    return {
        "prefix": mount.prefix,
        **dict.fromkeys(ROBOT),
        **stated_robot(find_robot(mount.source), path_text),
        "base_pose": _pose(hand.base_poses[mount.prefix]),
        "fingers": None if fingers is None else {name: vars(one) for name, one in fingers.items()},
        **({} if meshes is None else vars(meshes)),
    }


def stated_robot(robot: RobotDescription, path_text: Callable[[Path], str]) -> dict[str, Any]:
    """Return what a scene file says of which robot it is: see `stated_scene`."""
    own = {"root_link": robot.root_link, "visuals_collide": robot.visuals_collide}
    loaded = None if robot.file is None else load_robot(robot.file)
    own = {
        key: None if value == getattr(loaded, key, False) else value for key, value in own.items()
    }
    if robot.srdf is not None and (loaded is None or loaded.srdf != robot.srdf):
        own["srdf"] = path_text(robot.srdf)
    if robot.file is not None:
        name = robot.file.stem
        is_known = name in robot_names() and load_robot(name).file == robot.file
        return {"robot": name if is_known else path_text(robot.file)} | own
    if robot.model is not None:
        return {"robot": robot.model} | own
    folders = [path_text(folder) for folder in robot.package_dirs]
    return {"urdf": path_text(robot.urdf_path), "package_dirs": folders or None} | own


def _materials(scene: SceneFields) -> dict[str, dict[str, float]]:
    table: dict[str, dict[str, float]] = {}
    for pair, value in scene.materials.coefficients.items():
        first, last = min(pair), max(pair)
        table.setdefault(first, {})[last] = value
    return table


def _pose(T: ArrayLike) -> dict[str, Any]:
    T = np.asarray(T)
    return {"position": T[:3, 3], "matrix": T[:3, :3]}


def _twist(twist: NDArray[np.float64]) -> dict[str, Any]:
    return {"linear": twist[:3], "angular": twist[3:]}


def _one_form(path: Path) -> Path:
    return Path(os.path.normpath(path.absolute()))
