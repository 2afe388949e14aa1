"""The panels of the page as HTML: margin, torques, explanation, legend. Styled for both modes."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from html import escape
from typing import Any

import numpy as np

from graspless_pin.algorithms.options import OBJECTIVES, why_without_effect
from graspless_pin.holding.verdict import Stability
from graspless_pin.holding.verdict_words import lead_and_words
from graspless_pin.problem.checks import units_text
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.tables import decimals, limit_shares, torque_rounding, torque_size
from graspless_pin.viewer.auth import Gate, is_switch, number_between, one_of
from graspless_pin.viewer.controls import ALONG, HAND_PLACE, OBJECT_PLACE, Control, controls_of
from graspless_pin.viewer.scene_process import Settings, SettingsAnswer
from graspless_pin.visualization import DARK, LIGHT, Picture, Role

_AT_LIMIT = 0.999
# At the right there is room for the panel's scroll bar.
_TEXT = "font-size:13px;line-height:1.4;padding:0 14px 0 6px;overflow-wrap:anywhere"
_MUTED = "opacity:0.75"
_HEADLINE = "63px"  # three lines


def result_html(result: SettingsAnswer, as_loaded: TorqueSolution | None, *, dark: bool) -> str:
    """Return margin and largest torque with their bars, or why there are no torques.

    Args:
        result: The answer to show.
        as_loaded: The solution of the unchanged scene, for comparison; None: there is none.
        dark: Whether the page is dark.
    """
    solution = result.solution
    if solution is None or not solution.found:
        words = escape(result.reason).replace("\n", "<br>")
        color = (DARK if dark else LIGHT).roles[Role.FRICTION_AT_LIMIT]
        return (
            f'<div id="graspless-result" data-found="false" style="{_TEXT}">'
            f'<div style="border-left:4px solid {color};padding-left:8px">'
            f"<b>Why there are no torques</b><br>{words}</div></div>"
        )
    at_margin = f"at margin {solution.required_margin:g} N"
    algorithm = {
        Algorithm.MARGIN: "Algorithm 1: largest margin",
        Algorithm.TORQUE: f"Algorithm 2: smallest torque {at_margin}",
        None: f"{solution.objective.name} {at_margin}",
    }[solution.algorithm]
    before = None, None
    if as_loaded is not None and as_loaded.found:
        before = as_loaded.margin, as_loaded.max_torque
    roles = (DARK if dark else LIGHT).roles
    load = solution.problem.scales.force
    margin = _figure_html(
        "margin e", "N", solution.margin, before[0], load, roles[Role.FRICTION_FORCE]
    )
    torque = _figure_html(
        "max torque",
        solution.max_torque_unit,
        solution.max_torque,
        before[1],
        torque_size(solution.problem, solution.torques),
        roles[Role.NORMAL_FORCE],
    )
    return (
        f'<div id="graspless-result" data-found="true" data-margin="{solution.margin!r}" '
        f'style="{_TEXT}">'
        f"{margin}{torque}<div>{'<br>'.join(map(escape, filter(None, result.limits)))}</div>"
        f'<div style="{_MUTED}">{escape(algorithm)}; {escape(solution.status.message)}</div></div>'
    )


def verdict_html(result: SettingsAnswer, *, dark: bool) -> str:
    """Return the verdict on whether the object stays; empty without torques."""
    solution = result.solution
    if solution is None or not solution.found:
        return ""
    color = _verdict_color(result, dark=dark)
    message = result.verdict or "does it hold?: being computed"
    lead, words = lead_and_words(message.replace("^2", "²"))
    return (
        f'<div id="graspless-verdict" data-status="{result.stability or ""}" style="{_TEXT}">'
        f'<div style="border-left:4px solid {color};padding-left:8px;margin-bottom:8px">'
        f"<b>{escape(lead[:1].upper() + lead[1:])}</b> {escape(words)}</div></div>"
    )


def _verdict_color(result: SettingsAnswer, *, dark: bool) -> str:
    """Return the colour of a verdict: for what holds, what fails, or what is not known."""
    roles, solution = (DARK if dark else LIGHT).roles, result.solution
    if result.holds:
        return roles[Role.FRICTION_FORCE]
    lost = solution is None or not solution.found or result.motion is not None
    if lost or result.stability is Stability.NONE:
        return roles[Role.FRICTION_AT_LIMIT]
    return roles[Role.SUPPORT]


def torque_html(result: SettingsAnswer, *, dark: bool) -> str:
    """Return one bar for each joint between its limits, zero marked; a remark without torques."""
    solution = result.solution
    if solution is None or not solution.found or not solution.problem.joint_count:
        return f'<div id="graspless-torques" style="{_TEXT};{_MUTED}">no torques</div>'
    problem, palette = solution.problem, DARK if dark else LIGHT
    shares = limit_shares(solution.torques, problem.lower_torque, problem.upper_torque)
    size = torque_size(problem, solution.torques)
    widest = solution.max_torque or size
    rows, rounding = [], torque_rounding(problem, solution.contact_torques)
    for index, name in enumerate(problem.joint_names):
        torque = float(solution.torques[index])
        low, high = _bar_ends(problem.lower_torque[index], problem.upper_torque[index], widest)
        full = np.isfinite(shares[index]) and shares[index] >= _AT_LIMIT
        color = palette.roles[Role.FRICTION_AT_LIMIT if full else Role.NORMAL_FORCE]
        rows.append(
            f'<div style="display:grid;grid-template-columns:38% 1fr 22%;gap:6px;'
            f'align-items:center"><span style="white-space:nowrap;overflow:hidden;'
            f'text-overflow:ellipsis" title="{escape(name)}">{escape(name)}</span>'
            f"{_bar_html(torque, low, high, color)}"
            '<span style="text-align:right;font-variant-numeric:tabular-nums">'
            f"{decimals(torque, size, '+', rounding[index])}</span></div>"
        )
    return (
        f'<div id="graspless-torques" style="{_TEXT};line-height:1.4"><b>Torques</b>{"".join(rows)}'
        f'<div style="{_MUTED}">motor torques between their limits, '
        f"{escape(units_text(problem.joint_units))}</div></div>"
    )


def headline_html(result: SettingsAnswer, *, dark: bool) -> str:
    """Return margin and verdict in short, for small pages.

    It always has the height of three lines: what is below does not move when the verdict comes.
    """
    solution, message = result.solution, "no torques"
    color = _verdict_color(result, dark=dark)
    if solution is not None and solution.found:
        lead, _ = lead_and_words(result.verdict or "")
        message = f"margin e <b>{decimals(solution.margin, solution.problem.scales.force)}</b> N"
        message += f" · {escape(lead)}" if lead else ""
    return (
        f'<div id="graspless-headline" style="{_TEXT};font-size:15px;padding-bottom:4px;'
        f'min-height:{_HEADLINE}">'
        f'<div style="border-left:4px solid {color};padding-left:8px">{message}</div></div>'
    )


def note_html(name: str, words: str) -> str:
    """Return a remark with an id; empty where there are no words."""
    if not words:
        return ""
    return (
        f'<div id="{name}" role="status" style="{_TEXT};padding-bottom:6px">{escape(words)}</div>'
    )


def contacts_html(result: SettingsAnswer) -> str:
    """Return the words of each contact, by its number in the picture."""
    marks = [mark for mark in result.picture.marks if mark.contact is not None]
    if not marks:
        return ""
    lines = "".join(
        f'<li value="{escape(mark.text)}" style="margin-bottom:4px">'
        f"{escape(mark.words[0].partition(': ')[2] or mark.words[0])}"
        f'<div style="{_MUTED}">{"<br>".join(map(escape, mark.words[1:]))}</div></li>'
        for mark in marks
    )
    return (
        f'<details id="graspless-contacts" style="{_TEXT}"><summary><b>Contacts</b></summary>'
        f'<ol style="margin:4px 0;padding-left:24px">{lines}</ol></details>'
    )


def legend_html(roles: Iterable[Role], picture: Picture, *, dark: bool) -> str:
    """Return the colours of roles and of a picture's fingers, and the scale of its forces."""
    palette = DARK if dark else LIGHT
    colors = [(palette.roles[role], role.label) for role in roles]
    colors += [(palette.of_finger(k), name) for k, name in enumerate(picture.fingers)]
    scale = f"<div>Forces: {picture.force_scale}</div>" if picture.force_scale else ""
    items = "".join(
        '<span style="white-space:nowrap;margin-right:10px;display:inline-block">'
        f'<span style="display:inline-block;width:10px;height:10px;margin-right:4px;'
        f'background:{color}"></span>{escape(label)}</span>'
        for color, label in colors
    )
    return f'<div id="graspless-legend" style="{_TEXT}">{scale}{items}</div>'


def _figure_html(
    label: str, unit: str, value: float, before: float | None, size: float, color: str
) -> str:
    """Return a figure with a bar, whose scale is twice that of the unchanged scene, a mark there.

    Args:
        label: Its name.
        unit: Its unit.
        value: The figure.
        before: The figure of the unchanged scene, if any.
        size: The size that its digits are relative to.
        color: Colour of the bar.
    """
    top = max(2.0 * abs(before) if before else 0.0, abs(value)) or size
    compared = ""
    if before is not None:
        compared = f'<span style="{_MUTED}">as loaded {decimals(before, size)}</span>'
    mark = "" if before is None else _mark_html(before / top)
    return (
        '<div style="display:flex;flex-wrap:wrap;justify-content:space-between;'
        'align-items:baseline;column-gap:8px;white-space:nowrap">'
        f'<span>{escape(label)} <b style="font-size:17px;font-variant-numeric:tabular-nums">'
        f"{decimals(value, size)}</b> {escape(unit)}</span>{compared}</div>"
        '<div style="position:relative;height:8px;margin:2px 0 6px;'
        'background:rgba(128,128,128,0.25)"><div style="position:absolute;left:0;top:0;bottom:0;'
        f'width:{100.0 * max(value, 0.0) / top:.2f}%;background:{color}"></div>{mark}</div>'
    )


def _bar_ends(lower: float, upper: float, widest: float) -> tuple[float, float]:
    """Return the ends of a bar: the limits, or finite ones around zero."""
    low = lower if np.isfinite(lower) else -widest
    high = upper if np.isfinite(upper) else widest
    low, high = min(low, 0.0), max(high, 0.0)
    return (low, high) if high > low else (-widest, widest)


def _bar_html(value: float, low: float, high: float, color: str) -> str:
    """Return a bar from zero to the value between two ends."""
    zero = -low / (high - low)
    end = float(np.clip((value - low) / (high - low), 0.0, 1.0))
    left, width = min(zero, end), abs(end - zero)
    return (
        '<span style="position:relative;height:10px;display:block;'
        'background:rgba(128,128,128,0.25)"><span style="position:absolute;top:0;bottom:0;'
        f'left:{100.0 * left:.2f}%;width:{100.0 * width:.2f}%;background:{color}"></span>'
        f"{_mark_html(zero)}</span>"
    )


def _mark_html(place: float) -> str:
    """Return a thin line across a bar at a share of its length."""
    return (
        '<span style="position:absolute;top:-2px;bottom:-2px;width:1px;background:currentColor;'
        f'left:{100.0 * min(max(place, 0.0), 0.997):.2f}%"></span>'
    )


_ALGORITHMS = {
    "1: largest margin": Algorithm.MARGIN,
    "2: smallest torque": Algorithm.TORQUE,
} | {name: name for name in OBJECTIVES if name not in tuple(Algorithm)}
_STEPS = ("Undo", "Redo", "As loaded")
_OPEN_GROUPS = ("Load",)
_MOVED = {"Object": OBJECT_PLACE, "Hand's base": HAND_PLACE}
"""Prefix of the keys of what can be dragged, by the group of its controls."""


class ControlPanel:
    """The controls of a scene, with the steps of their settings for undo.

    Attributes:
        settings: The present settings.
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
            gate: The gate that admits them.
            scene: The scene.
            settings: The first settings.
            changed: Called with all new settings.
            handles: Called to show or hide the handles of `OBJECT_PLACE` or `HAND_PLACE`.
        """
        self.settings = settings
        self._gui, self._gate = server.gui, gate
        self._changed, self._handles = changed, handles
        self._steps, self._at, self._quiet = [settings], 0, False
        self._lock = threading.RLock()  # controls, handles and steps are moved from several threads
        self._controls = {control.key: control for control in controls_of(scene)}
        steps = self._gui.add_button_group("steps", _STEPS)
        gate.admit(steps, one_of(_STEPS), lambda event: self._go_to_step(event.target.value))
        self._algorithm = gate.admit(
            self._gui.add_dropdown("algorithm", tuple(_ALGORITHMS)),
            one_of(tuple(_ALGORITHMS)),
            lambda event: self._change_settings(algorithm=_ALGORITHMS[event.target.value]),
        )
        self._margin = gate.admit(
            self._gui.add_number("e0 [N]", 0.0, min=0.0, step=0.01, hint="required margin"),
            number_between(0.0, math.inf),
            lambda event: self._change_settings(required_margin=float(event.target.value)),
        )
        self._inputs: dict[str, Any] = {}
        folders: dict[str, Any] = {}
        for control in self._controls.values():
            if control.group not in folders:
                folders[control.group] = self._add_folder(control.group)
            with folders[control.group]:
                self._inputs[control.key] = self._add_input(control)
        self._show_settings(settings)

    def change(self, values: Mapping[str, float]) -> None:
        """Set some controls, with the same effect as at the page."""
        with self._lock:
            self.apply(replace(self.settings, values={**self.settings.values, **values}))

    def apply(self, settings: Settings) -> None:
        """Set all controls and report the settings."""
        with self._lock:
            self._show_settings(settings)
            self._change_settings(**vars(settings))

    def remember(self) -> None:
        """Make the present settings a step that can be undone."""
        with self._lock:
            if self.settings != self._steps[self._at]:
                self._steps[self._at + 1 :] = [self.settings]
                self._at += 1

    def _go_to_step(self, step: str) -> None:
        with self._lock:
            if step == "As loaded":
                self.apply(self._steps[0])
                return
            self.remember()
            self._at += 1 if step == "Redo" else -1
            self._at = min(max(self._at, 0), len(self._steps) - 1)
            self.apply(self._steps[self._at])

    def _change_settings(self, **changes: Any) -> None:
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
            self._margin.disabled = bool(why_without_effect("margin", settings.algorithm))
            self._changed(self.settings)

    def _show_settings(self, settings: Settings) -> None:
        """Set the controls without a report of the settings."""
        names = {algorithm: name for name, algorithm in _ALGORITHMS.items()}
        self._quiet = True
        try:
            self._algorithm.value = names[settings.algorithm]
            self._margin.value = settings.required_margin
            self._margin.disabled = bool(why_without_effect("margin", settings.algorithm))
            for key, control in self._controls.items():
                value = settings.values.get(key, control.initial)
                self._inputs[key].value = bool(value) if key == ALONG else value
        finally:
            self._quiet = False

    def _add_folder(self, group: str) -> Any:
        folder = self._gui.add_folder(group, expand_by_default=group in _OPEN_GROUPS)
        if group in _MOVED:
            with folder:
                box = self._gui.add_checkbox("drag in the picture", initial_value=False)
            show = partial(self._handles, _MOVED[group])
            self._gate.admit(box, is_switch, lambda event: show(event.target.value))
        return folder

    def _add_input(self, control: Control) -> Any:
        then = partial(self._set_control_value, control.key)
        if control.key == ALONG:
            box = self._gui.add_checkbox(control.label, initial_value=False)
            return self._gate.admit(box, is_switch, then)
        low, high = control.low, control.high
        slider = self._gui.add_slider(control.label, low, high, control.step, control.initial)
        return self._gate.admit(slider, number_between(low, high), then)

    def _set_control_value(self, key: str, event: Any) -> None:
        with self._lock:
            self._change_settings(values={**self.settings.values, key: float(event.target.value)})
