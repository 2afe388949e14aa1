"""Handles in the picture, by which object and hand are shifted and turned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.scene import Scene
from graspless_pin.viewer.controls import (
    ALONG,
    HAND_PLACE,
    OBJECT_PLACE,
    place_of,
    placed_values,
    support_frame,
)
from graspless_pin.viewer.gate import Gate

_SIZE = 1.3  # of the object's radius


class Gizmos:
    """The handles of a scene's object and of its hand's base; hidden at first."""

    def __init__(
        self,
        server: Any,
        gate: Gate,
        scene: Scene,
        size: float,
        moved: Callable[[Mapping[str, float]], None],
    ) -> None:
        """Add them to a stage.

        Args:
            server: viser's.
            gate: Whom it lets pass.
            scene: The scene as loaded.
            size: Radius of the object, m.
            moved: Called with the values of `PLACES` when somebody drags one.
        """
        self._frame = np.eye(3)
        self._support = support_frame(scene)
        self._handles: dict[str, Any] = {}
        self._dragged: set[str] = set()
        self._centers = {OBJECT_PLACE: scene.object.center_of_mass_world}
        if scene.hand is not None:
            self._centers[HAND_PLACE] = scene.hand.T_world_base[:3, 3]
        for group in self._centers:
            handle = server.scene.add_transform_controls(
                f"/scene/handles {group.strip('/')}", scale=_SIZE * size, depth_test=False,
                visible=False, position=self._centers[group],
            )  # fmt: skip
            gate.admit_gizmo(handle)
            handle.on_update(lambda event, group=group: self._dragged_to(group, event, moved))
            self._handles[group] = handle

    def show(self, group: str, visible: bool) -> None:
        """Show or hide the handles of `OBJECT_PLACE` or `HAND_PLACE`."""
        self._handles[group].visible = visible

    def place(self, values: Mapping[str, float]) -> None:
        """Bring those that nobody drags to where values have object and hand."""
        along = bool(values.get(ALONG))
        self._frame = self._support if along else np.eye(3)
        self._handles[OBJECT_PLACE].active_axes = (True, True, not along)
        for group, handle in self._handles.items():
            if group not in self._dragged:
                shift, turn = place_of(values, group)
                R = Rotation.from_rotvec(turn).as_matrix() @ self._axes(group)
                handle.position = self._centers[group] + shift
                handle.wxyz = Rotation.from_matrix(R).as_quat(scalar_first=True)

    def _axes(self, group: str) -> Any:
        return self._frame if group == OBJECT_PLACE else np.eye(3)

    def _dragged_to(self, group: str, event: Any, moved: Callable[..., None]) -> None:
        if event.phase == "start":
            self._dragged.add(group)
            return
        if event.phase == "end":
            self._dragged.discard(group)
        handle = self._handles[group]
        R = Rotation.from_quat(np.asarray(handle.wxyz, dtype=float), scalar_first=True)
        turn = R * Rotation.from_matrix(self._axes(group)).inv()
        shift = np.asarray(handle.position, dtype=float) - self._centers[group]
        moved(placed_values(group, shift, turn.as_rotvec()))
