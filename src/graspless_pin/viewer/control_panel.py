"""The page's controls: what they are set to, what they were set to before, and setting them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from graspless_pin.algorithms.named_objectives import OBJECTIVES, useless
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.scene import Scene
from graspless_pin.viewer.auth import Gate, is_switch, number_between, one_of
from graspless_pin.viewer.controls import ALONG, HAND_PLACE, OBJECT_PLACE, Control, controls_of
from graspless_pin.viewer.scene_process import Settings

_ALGORITHMS = {
    "1: largest margin": Algorithm.MARGIN,
    "2: smallest torque": Algorithm.TORQUE,
} | {name: name for name in OBJECTIVES if name not in tuple(Algorithm)}
_STEPS = ("Undo", "Redo", "As loaded")
_OPEN_GROUPS = ("Load",)
_MOVED = {OBJECT_PLACE: "Object", HAND_PLACE: "Hand's base"}


class Desk:
    """Controls of a scene, with the steps that they have gone.

    Attributes:
        settings: What they are set to.
    """

    def __init__(
        self,
        server: Any,
        gate: Gate,
        scene: Scene,
        settings: Settings,
        changed: Callable[[Settings], None],
        handles: Callable[[str, bool], None],
    ) -> None:
        """Lay the controls out where the page is being built.

        Args:
            server: viser's.
            gate: Whom it lets pass.
            scene: The scene.
            settings: What they begin with.
            changed: Called with every new setting.
            handles: Called to show or hide the handles of `OBJECT_PLACE` or `HAND_PLACE`.
        """
        self.settings = settings
        self._gui, self._gate = server.gui, gate
        self._changed, self._handles = changed, handles
        self._steps, self._at, self._quiet = [settings], 0, False
        self._lock = threading.RLock()  # controls, handles and steps are moved from several threads
        self._controls = {control.key: control for control in controls_of(scene)}
        steps = self._gui.add_button_group("steps", _STEPS)
        gate.admit(steps, one_of(_STEPS))
        steps.on_click(lambda _: self._go(str(steps.value)))
        self._algorithm = self._gui.add_dropdown("algorithm", tuple(_ALGORITHMS))
        self._margin = self._gui.add_number(
            "e0 [N]", 0.0, min=0.0, step=0.01, hint="required margin"
        )
        gate.admit(self._algorithm, one_of(tuple(_ALGORITHMS)))
        gate.admit(self._margin, number_between(0.0, math.inf))
        self._algorithm.on_update(lambda _: self._set(algorithm=_ALGORITHMS[self._algorithm.value]))
        self._margin.on_update(lambda _: self._set(required_margin=float(self._margin.value)))
        self._inputs: dict[str, Any] = {}
        folders: dict[str, Any] = {}
        for control in self._controls.values():
            if control.group not in folders:
                folders[control.group] = self._add_folder(control.group)
            with folders[control.group]:
                self._inputs[control.key] = self._add_input(control)
        self._show(settings)

    def change(self, values: Mapping[str, float]) -> None:
        """Set some controls, as somebody at the page would."""
        with self._lock:
            self.apply(replace(self.settings, values={**self.settings.values, **values}))

    def apply(self, settings: Settings) -> None:
        """Set all controls, and say so."""
        with self._lock:
            self._show(settings)
            self._set(**vars(settings))

    def remember(self) -> None:
        """Make what is set now a step that can be undone."""
        with self._lock:
            if self.settings != self._steps[self._at]:
                self._steps[self._at + 1 :] = [self.settings]
                self._at += 1

    def _go(self, step: str) -> None:
        with self._lock:
            if step == "As loaded":
                self.apply(self._steps[0])
                return
            self.remember()
            self._at += 1 if step == "Redo" else -1
            self._at = min(max(self._at, 0), len(self._steps) - 1)
            self.apply(self._steps[self._at])

    def _set(self, **changes: Any) -> None:
        with self._lock:
            if self._quiet:
                return
            settings = replace(self.settings, **changes)
            moved = {
                key: value
                for key, value in settings.values.items()
                if value != self._controls[key].initial
            }
            self.settings = replace(settings, values=moved)
            self._margin.disabled = bool(useless("margin", settings.algorithm))
            self._changed(self.settings)

    def _show(self, settings: Settings) -> None:
        """Set the controls without saying so."""
        names = {algorithm: name for name, algorithm in _ALGORITHMS.items()}
        self._quiet = True
        try:
            self._algorithm.value = names[settings.algorithm]
            self._margin.value = settings.required_margin
            self._margin.disabled = bool(useless("margin", settings.algorithm))
            for key, control in self._controls.items():
                value = settings.values.get(key, control.initial)
                self._inputs[key].value = bool(value) if key == ALONG else value
        finally:
            self._quiet = False

    def _add_folder(self, group: str) -> Any:
        folder = self._gui.add_folder(group, expand_by_default=group in _OPEN_GROUPS)
        for moved, name in _MOVED.items():
            if name == group:
                with folder:
                    self._add_handles(moved)
        return folder

    def _add_handles(self, moved: str) -> None:
        box = self._gui.add_checkbox("drag in the picture", initial_value=False)
        self._gate.admit(box, is_switch)
        box.on_update(lambda _: self._handles(moved, box.value))

    def _add_input(self, control: Control) -> Any:
        if control.key == ALONG:
            made = self._gui.add_checkbox(control.label, initial_value=False)
            self._gate.admit(made, is_switch)
        else:
            made = self._gui.add_slider(
                control.label, control.low, control.high, control.step, control.initial
            )
            self._gate.admit(made, number_between(control.low, control.high))
        made.on_update(lambda _: self._set_value(control.key, float(made.value)))
        return made

    def _set_value(self, key: str, value: float) -> None:
        with self._lock:
            self._set(values={**self.settings.values, key: value})
