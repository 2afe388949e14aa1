"""An MJCF as MuJoCo has read it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.problem.checks import FloatArray


@dataclass(frozen=True, eq=False)
class MjcfSource:
    """What MuJoCo has read.

    Attributes:
        mujoco: The module.
        path: The file; of a model that comes from none, its name.
        spec: ``mujoco.MjSpec``, which knows the files of meshes; None: there are none.
        model: ``mujoco.MjModel``, which knows all else.
    """

    mujoco: Any
    path: Path
    spec: Any
    model: Any

    def joint(self, index: int) -> str:
        """Return a joint's name."""
        return self.model.joint(index).name or f"joint_{index}"

    def body(self, index: int) -> str:
        """Return a body's name."""
        return self.model.body(index).name or f"body_{index}"


def read_mjcf(path: Path, *, keyframes: bool = False) -> MjcfSource:
    """Let MuJoCo read a file.

    Args:
        path: The file.
        keyframes: Whether its keyframes are read, too.

    Raises:
        RobotError: If MuJoCo is not installed or refuses the file.

    Warns:
        GrasplessPinWarning: What MuJoCo warns of, or angles that look like radians.
    """
    mujoco = _load_mujoco(path)
    # Its own way to warn is a log file in the current folder.
    capture = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        with warnings.catch_warnings(record=True, action="always") as remarks:
            spec = mujoco.MjSpec.from_file(str(path))
            _strip(spec, keyframes=keyframes)
            model = spec.compile()
    except (ValueError, OSError) as error:
        message = " ".join(str(error).split())
        raise RobotError(f"{path}: MuJoCo cannot read this MJCF ({message})") from error
    finally:
        mujoco.set_mju_user_warning(capture)
    for text in dict.fromkeys(str(item.message) for item in remarks):
        emit(
            Finding(
                FindingCode.READER_REMARK,
                path.name,
                f"{path}: MuJoCo says: {text}",
                "look whether it matters for kinematics, shapes or limits",
            )
        )
    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited == 1)
    widest = float(np.rad2deg(np.ptp(model.jnt_range[hinges], axis=1)).max(initial=0.0))
    if spec.compiler.degree and 0.0 < widest <= 2.0 * np.pi:
        emit(
            Finding(
                FindingCode.ANGLE_IN_RADIANS,
                path.name,
                f"{path}: none of its hinges turns by more than {widest:.3g} degrees, which is the "
                "unit of an MJCF that states none; these look like radians",
                'write <compiler angle="radian"/> into it, or give the model that includes it',
            )
        )
    return MjcfSource(mujoco, path, spec, model)


def _load_mujoco(path: Path) -> Any:
    try:
        import mujoco
    except ImportError as error:
        raise RobotError(
            f"{path} is an MJCF, which needs MuJoCo ({error}); install it with pip install "
            "'graspless-pin[simulate]', or give a URDF"
        ) from None
    return mujoco


def source_of_model(model: Any) -> MjcfSource:
    """Return a ``mujoco.MjModel`` that comes from no file as what MuJoCo has read."""
    name = bytes(model.names).partition(b"\0")[0].decode() or "model"
    path = Path(name)
    return MjcfSource(_load_mujoco(path), path, None, model)


def _strip(spec: Any, *, keyframes: bool) -> None:
    """Take away what only looks, and may name files that are not there; keyframes unless asked."""
    for geom in spec.geoms:
        geom.material = ""
    for site in spec.sites:
        site.material = ""
    for tendon in spec.tendons:
        tendon.material = ""
    keys = () if keyframes else spec.keys
    for unseen in (*spec.skins, *spec.materials, *spec.textures, *keys):
        spec.delete(unseen)


def pose(quaternion: FloatArray, position: FloatArray) -> FloatArray:
    """Return the (4, 4) pose of MuJoCo's [w, x, y, z] and [x, y, z]."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    T[:3, 3] = position
    return T
