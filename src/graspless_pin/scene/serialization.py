"""A scene as data of a scene file: plain data with every key of the schema."""

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
from graspless_pin.scene.body_building import rotation_form_and_value
from graspless_pin.scene.fields import SceneFields
from graspless_pin.scene.scene_schema import PLAIN_FIGURES, SolveEntry
from graspless_pin.scene.uncertain_figures import uncertainty_entry
from graspless_pin.scene.units import degrees_of, rounded_angle

_SAME_ROTATION = 1e-12
ROBOT = (
    "robot", "urdf", "srdf", "package_dirs", "root_link", "visuals_collide", "fingers", "convex",
    "concavity", "decompose_time_limit", "max_pieces",
)  # fmt: skip
"""Keys of a mount that determine its robot."""


def scene_entry(scene: SceneFields, path_text: Callable[[Path], str]) -> dict[str, Any]:
    """Return a scene as data of a scene file, defaults included.

    Rotations are matrices, the object has a mass rather than a density, each pair of materials is
    given once, robots are under ``hand.mounts``, and positions and limits by joint. Missing parts
    are None.

    Args:
        scene: The scene.
        path_text: Returns a path as it is written in the file.
    """
    hand, target, motion, controller = scene.hand, scene.object, scene.motion, scene.controller
    is_one_value = isinstance(controller.stiffness, str) and controller.damping == DAMPING
    further_keys = {
        "hybrid_force_limit": scene.hybrid_force_limit,
        "material": scene.hand_material,
        "count_own_weight": scene.count_own_weight,
    }
    stated = {
        "name": scene.name,
        "gravity": scene.gravity,
        "hand": None if hand is None else hand_entry(hand, path_text) | further_keys,
        "object": {
            "name": target.name,
            "shape": target.shape.as_entry(path_text),
            "mass": target.mass,
            "center_of_mass": target.center_of_mass,
            "inertia": target.inertia,
            "material": target.material,
            "pose": _pose_data(target.T_world_object),
        },
        "supports": [
            {
                "name": support.name,
                "shape": support.shape.as_entry(path_text),
                "pose": _pose_data(support.T_world_support),
                "friction": support.friction,
                "velocity": _twist_data(support.velocity),
                "material": support.material,
            }
            for support in scene.supports
        ],
        "friction": dict(scene.friction),
        "materials": _materials_table(scene),
        "contacts": scene.given_contacts and [vars(one) for one in scene.given_contacts],
        "motion": motion
        and {
            "object_twist": _twist_data(motion.object_twist),
            "hand": motion.hand
            and {
                "base_twist": _twist_data(motion.hand.base_twist),
                "joint_velocities": motion.hand.joint_velocities,
            },
        },
        "loads": [vars(load) for load in scene.loads],
        "acceleration": None if scene.acceleration is None else vars(scene.acceleration),
        **{name: getattr(scene, name) for name in PLAIN_FIGURES},
        "tangent_axes": list(scene.tangent_axes),
        "controller": controller.stiffness if is_one_value else vars(controller),
        "uncertainty": scene.uncertainty and uncertainty_entry(scene.uncertainty),
        "solve": SolveEntry().model_dump() | dict(scene.solve_options),
    }
    return plain(stated)


def hand_entry(hand: Hand, path_text: Callable[[Path], str]) -> dict[str, Any]:
    """Return a hand as data of a scene file: see `scene_entry`."""
    tree, actuation, control = hand.tree, hand.actuation, hand.control
    modes = {name: mode for name, mode in control.joints.items() if mode is not ControlMode.HYBRID}
    armature = tree.armature
    limits = zip(actuation.names, *hand.effort_limits, strict=True)
    return plain(
        {
            "mounts": [_mount_data(hand, mount, path_text) for mount in hand.mounts],
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


def rotation_entry(R: ArrayLike, form: str = "rpy") -> dict[str, Any]:
    """Return a rotation as data of a scene file.

    Args:
        R: (3, 3) rotation matrix.
        form: One of `ROTATION_FORMS`; the matrix is used where rounding would change the rotation.
    """
    matrix = np.asarray(R)
    if form == "matrix":
        return {"matrix": plain(matrix)}
    if form == "quaternion":
        numbers = Rotation.from_matrix(matrix).as_quat().tolist()
    else:
        angles = roll_pitch_yaw(matrix)
        file_angle = degrees_of if form == "rpy_deg" else rounded_angle
        numbers = [file_angle(angle) for angle in angles]
    pose = pose_matrix(np.zeros(3), rotation_form_and_value({form: numbers})[1])
    if np.abs(pose[:3, :3] - matrix).max() > _SAME_ROTATION:
        return {"matrix": plain(matrix)}
    return {form: numbers} if form == "quaternion" or any(numbers) else {}


def robot_key(mount: Mount) -> RobotDescription:
    """Return a mount's robot with normalised paths, to be compared with others."""
    robot = find_robot(mount.source)
    return replace(
        robot,
        urdf_path=_normalized_path(robot.urdf_path),
        package_dirs=tuple(map(_normalized_path, robot.package_dirs)),
        file=None if robot.file is None else _normalized_path(robot.file),
        srdf=None if robot.srdf is None else _normalized_path(robot.srdf),
    )


def _mount_data(hand: Hand, mount: Mount, path_text: Callable[[Path], str]) -> dict[str, Any]:
    meshes = mount.meshes
    fingers = mount.fingers
    return {
        "prefix": mount.prefix,
        **dict.fromkeys(ROBOT),
        **robot_entry(find_robot(mount.source), path_text),
        "base_pose": _pose_data(hand.base_poses[mount.prefix]),
        "fingers": None if fingers is None else {name: vars(one) for name, one in fingers.items()},
        **({} if meshes is None else vars(meshes)),
    }


def robot_entry(robot: RobotDescription, path_text: Callable[[Path], str]) -> dict[str, Any]:
    """Return the keys of a scene file that determine a robot: see `scene_entry`."""
    options = {"root_link": robot.root_link, "visuals_collide": robot.visuals_collide}
    robot_file = None if robot.file is None else load_robot(robot.file)
    options = {
        key: None if value == getattr(robot_file, key, False) else value
        for key, value in options.items()
    }
    if robot.srdf is not None and (robot_file is None or robot_file.srdf != robot.srdf):
        options["srdf"] = path_text(robot.srdf)
    if robot.file is not None:
        name = robot.file.stem
        is_known = name in robot_names() and load_robot(name).file == robot.file
        return {"robot": name if is_known else path_text(robot.file)} | options
    if robot.model is not None:
        return {"robot": robot.model} | options
    folders = [path_text(folder) for folder in robot.package_dirs]
    return {"urdf": path_text(robot.urdf_path), "package_dirs": folders or None} | options


def _materials_table(scene: SceneFields) -> dict[str, dict[str, float]]:
    table: dict[str, dict[str, float]] = {}
    for pair, value in scene.materials.coefficients.items():
        first, last = min(pair), max(pair)
        table.setdefault(first, {})[last] = value
    return table


def _pose_data(T: ArrayLike) -> dict[str, Any]:
    T = np.asarray(T)
    return {"position": T[:3, 3], "matrix": T[:3, :3]}


def _twist_data(twist: NDArray[np.float64]) -> dict[str, Any]:
    return {"linear": twist[:3], "angular": twist[3:]}


def _normalized_path(path: Path) -> Path:
    return Path(os.path.normpath(path.absolute()))
