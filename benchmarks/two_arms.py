"""Two Panda arms that hold a crate between them: where both are when the crate is at a pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from graspless_pin import Scene
from graspless_pin.geometry.poses import invert
from graspless_pin.geometry.robots.files import find_robot
from graspless_pin.problem.checks import FloatArray

ARM = tuple(f"panda_joint{k}" for k in range(1, 8))
_STEPS = 10
_DAMPING = 1e-8
_REACHED = 1e-7
"""m and rad: a hand that is farther from where it shall be is out of reach."""


class _Arm(NamedTuple):
    prefix: str
    start: FloatArray
    T_base_world: FloatArray
    T_object_hand: FloatArray


class TwoArms:
    """The arms of a scene, whose hands stay where they are on the object."""

    def __init__(self, scene: Scene, prefixes: tuple[str, str] = ("right/", "left/")) -> None:
        """Take the scene."""
        hand = scene.hand
        if hand is None:
            raise ValueError("the scene has no arms")
        model = pin.buildModelFromUrdf(str(find_robot("panda").urdf_path))
        fingers = [model.getJointId(name) for name in model.names[1:] if name not in ARM]
        self._model = pin.buildReducedModel(model, fingers, pin.neutral(model))
        self._data, self._frame = self._model.createData(), self._model.getFrameId("panda_hand")
        T_object_world = invert(scene.object.T_world_object)
        self._arms = [
            _Arm(
                prefix,
                np.array([hand.q[prefix + name] for name in ARM]),
                invert(hand.pose_of(f"{prefix}panda_link0")),
                T_object_world @ hand.pose_of(f"{prefix}panda_hand"),
            )
            for prefix in prefixes
        ]

    def configuration(self, T_world_object: FloatArray) -> dict[str, float] | None:
        """Return the joints' positions at a pose of the object, rad; None: out of reach.

        As many steps of Newton's method from the scene's configuration at every pose: joints change
        smoothly with the pose.
        """
        found: dict[str, float] = {}
        for arm in self._arms:
            q, wanted = arm.start, pin.SE3(arm.T_base_world @ T_world_object @ arm.T_object_hand)
            for _ in range(_STEPS):
                error = self._error(q, wanted)
                J = pin.computeFrameJacobian(self._model, self._data, q, self._frame, pin.LOCAL)
                q = q + J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), error)
            if np.abs(self._error(q, wanted)).max() > _REACHED:
                return None
            found |= {arm.prefix + name: value for name, value in zip(ARM, q.tolist(), strict=True)}
        return found

    def _error(self, q: FloatArray, wanted: pin.SE3) -> FloatArray:
        pin.framesForwardKinematics(self._model, self._data, q)
        return pin.log6(self._data.oMf[self._frame].actInv(wanted)).vector
