"""The page: viser draws what `answer_settings` works out for the settings of its controls."""

from __future__ import annotations

import contextlib
import io
import logging
import math
import socket
import threading
import webbrowser
from dataclasses import replace
from typing import Any

from graspless_pin.errors import ArgumentError, CrashError, GrasplessPinError
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.scene import Scene
from graspless_pin.viewer.controls import Control, controls_of
from graspless_pin.viewer.gate import Gate, gated, is_switch, number_between, one_of
from graspless_pin.viewer.panels import legend_html, result_html, torque_html, verdict_html
from graspless_pin.viewer.player import Player
from graspless_pin.viewer.scene_process import (
    SceneProcess,
    Settings,
    SettingsAnswer,
    initial_settings,
)
from graspless_pin.viewer.stage import Stage
from graspless_pin.visualization import Role
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST

DEFAULT_PORT = 8080

_LAST_PORT = 65_000  # viser looks upward for a free one

_ALGORITHMS = {
    "1: largest margin": Algorithm.MARGIN,
    "2: smallest torque": Algorithm.TORQUE,
}
_OPEN_GROUPS = ("Load",)
_RESULT_WIDTH = 330  # px
_LISTEN_EVERY = 0.5  # s
_PAUSE = 0.5  # s without a change before the verdict is asked for
_BODIES = (Role.HAND, Role.OBJECT, Role.SUPPORT)
_log = logging.getLogger(__name__)


def view(
    scene: Scene,
    *,
    host: str = "127.0.0.1",
    port: int = DEFAULT_PORT,
    open_browser: bool = False,
    dark: bool = False,
) -> Viewer:
    """Show a scene on an interactive page and return at once; the page lives in threads.

    Args:
        scene: The scene.
        host: The address to listen at; the default can only be reached from this machine. Only
            pages with the token of `Viewer.url` are answered.
        port: The port; the next free one above it if it is taken.
        open_browser: Whether to open the page.
        dark: Whether the page begins dark.

    Raises:
        GrasplessPinError: viser is not installed.
        ArgumentError: Nothing can listen at this host, or there is no such port.
        MeshError: A mesh file is missing or unreadable.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.viewer import view
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> viewer = view(scene, port=0)  # any free port
        >>> viewer.url.startswith("http://127.0.0.1:")
        True
        >>> viewer.stop()
    """
    try:
        import viser
    except ImportError as error:
        raise GrasplessPinError(
            "the viewer needs viser: pip install 'graspless-pin[viewer]'"
        ) from error
    _check_address(host, port)
    gate = Gate(host)
    server = None
    try:
        with contextlib.redirect_stdout(io.StringIO()), gated(gate):  # viser announces itself
            server = viser.ViserServer(host=host, port=port, label="graspless_pin", verbose=False)
        viewer = Viewer(scene, server, gate, host, dark=dark)
    except BaseException:
        if server is not None:
            _stop(server)
        raise
    if open_browser:
        webbrowser.open(viewer.url)
    return viewer


def _stop(server: Any) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def _check_address(host: str, port: int) -> None:
    """Refuse what viser would try in vain for ever.

    Raises:
        ArgumentError: See `view`.
    """
    if not 0 <= port <= _LAST_PORT:
        raise ArgumentError("port", f"is {port}; it must be 0 (any free one) to {_LAST_PORT}")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
    except OSError as error:
        raise ArgumentError(
            "host", f"nothing can listen at {host!r} ({error}); use an address of this machine"
        ) from error


class Viewer:
    """A running page. Make one with `view`; ends with `stop` or its process.

    See the example of `view`.

    Attributes:
        scene: The scene as loaded.
        url: Where the page is, with the token that it is answered for.
    """

    def __init__(self, scene: Scene, server: Any, gate: Gate, host: str, *, dark: bool) -> None:
        """Build the page on a viser server behind a gate and begin to answer its controls."""
        self.scene = scene
        shown = "localhost" if host in ("0.0.0.0", "::", "") else host  # noqa: S104 - not binding
        name = f"[{shown}]" if ":" in shown else shown
        self.url = f"http://{name}:{server.get_port()}/{gate.token}/"
        self._server = server
        self._gate = gate
        self._dark = dark
        self._settings = initial_settings(scene)
        self._solving = SceneProcess(scene)
        self._initial = self._solving.evaluate_first(self._settings)
        self._shown = self._initial
        self._stage = Stage(server, self._initial.picture, dark=dark)
        self._changed = threading.Condition()
        self._waiting = False
        self._stopped = threading.Event()
        self._build()
        self._show(self._initial)
        self._worker = threading.Thread(target=self._work, name="graspless-viewer", daemon=True)
        self._worker.start()

    @property
    def evaluation(self) -> SettingsAnswer:
        """What the page shows now."""
        return self._shown

    def wait(self) -> None:
        """Wait until the page is stopped, from another thread or by the keyboard."""
        # Not without end: Ctrl-C is answered by this thread, and nothing else wakes it where the
        # kernel gave the signal to another one.
        while not self._stopped.wait(_LISTEN_EVERY):
            pass

    def stop(self) -> None:
        """Close the page. Doing so again does nothing."""
        with self._changed:
            if self._stopped.is_set():
                return
            self._stopped.set()
            self._changed.notify()
        self._solving.kill()
        self._worker.join()
        self._player.stop()
        self._solving.close()
        _stop(self._server)

    def _build(self) -> None:
        """Lay out panels and controls."""
        gui = self._server.gui
        results = gui.add_panel()
        with results.add_tab("Result"):
            self._verdict = gui.add_html("")
            self._player = Player(self._server, self._gate, self._stage)
            self._result = gui.add_html("")
            self._torques = gui.add_html("")
        with results.add_tab("Layers"):
            self._legend = gui.add_html("")
            self._dark_box = gui.add_checkbox("dark page", self._dark)
            self._gate.admit(self._dark_box, is_switch)
            self._dark_box.on_update(lambda _: self._switch_mode())
            for role in Role:
                self._add_layer_box(role)
        results.dock_left()
        results.set_width(_RESULT_WIDTH)
        gui.main_panel.dock_right()
        self._add_controls()
        self._set_mode()

    def _add_layer_box(self, role: Role) -> None:
        box = self._server.gui.add_checkbox(role.label, role not in HIDDEN_AT_FIRST)
        self._gate.admit(box, is_switch)

        @box.on_update
        def _(_event: Any) -> None:
            self._stage.show_layer(role, visible=box.value)

    def _add_controls(self) -> None:
        gui, settings = self._server.gui, self._settings
        names = {algorithm: name for name, algorithm in _ALGORITHMS.items()}
        algorithm = gui.add_dropdown(
            "algorithm", tuple(_ALGORITHMS), initial_value=names[settings.algorithm]
        )
        margin = gui.add_number(
            "e0 [N]",
            settings.required_margin,
            min=0.0,
            step=0.01,
            hint="required margin of Algorithm 2",
            disabled=settings.algorithm is Algorithm.MARGIN,
        )
        self._gate.admit(algorithm, one_of(tuple(_ALGORITHMS)))
        self._gate.admit(margin, number_between(0.0, math.inf))

        @algorithm.on_update
        def _(_event: Any) -> None:
            chosen = _ALGORITHMS[algorithm.value]
            margin.disabled = chosen is Algorithm.MARGIN
            self._set(algorithm=chosen)

        @margin.on_update
        def _(_event: Any) -> None:
            self._set(required_margin=float(margin.value))

        reset = gui.add_button("As loaded")
        self._gate.admit(reset, is_switch)
        sliders: list[tuple[Control, Any]] = []
        folders: dict[str, Any] = {}
        for control in controls_of(self.scene):
            if control.group not in folders:
                folders[control.group] = gui.add_folder(
                    control.group, expand_by_default=control.group in _OPEN_GROUPS
                )
            with folders[control.group]:
                sliders.append((control, self._add_slider(control)))

        @reset.on_click
        def _(_event: Any) -> None:
            first = self._initial.settings
            algorithm.value, margin.value = names[first.algorithm], first.required_margin
            for control, slider in sliders:
                slider.value = control.initial
            self._set(**vars(first))

    def _add_slider(self, control: Control) -> Any:
        slider = self._server.gui.add_slider(
            control.label, control.low, control.high, control.step, control.initial
        )
        self._gate.admit(slider, number_between(control.low, control.high))

        @slider.on_update
        def _(_event: Any) -> None:
            self._set(values={**self._settings.values, control.key: float(slider.value)})

        return slider

    def _set(self, **changes: Any) -> None:
        """Ask for other settings; the newest ones win over those not yet worked out."""
        with self._changed:
            self._settings = replace(self._settings, **changes)
            self._waiting = True
            self._changed.notify()

    def _work(self) -> None:
        """Work settings out and show them, and their verdict once no others come, until the end."""
        judged = False
        while True:
            with self._changed:
                pause = None if judged else _PAUSE
                asked = self._changed.wait_for(self._has_work, pause)
                if self._stopped.is_set():
                    return
                settings, self._waiting = self._settings, False
            judged = not asked
            if judged:
                self._judge()
                continue
            try:
                self._show(self._solving.evaluate(settings))
            except CrashError as error:
                if not self._stopped.is_set():
                    self._say(settings, f"a solver failed and took its process along: {error}")
            except Exception as error:  # a page that goes on and says so is better than a dead one
                _log.exception("the settings %s cannot be shown", settings)
                self._say(settings, str(error))

    def _has_work(self) -> bool:
        return self._waiting or self._stopped.is_set()

    def _judge(self) -> None:
        """Show the verdict on the torques that are shown."""
        shown = self._shown
        if shown.solution is None or not shown.solution.found:
            return
        try:
            self._show(self._solving.judge())
        except CrashError as error:
            if not self._stopped.is_set():
                said = f"no verdict: a solver failed and took its process along: {error}"
                self._show(replace(shown, verdict=said))

    def _say(self, settings: Settings, reason: str) -> None:
        """Say why settings are not shown; of what was shown before, the bodies stay."""
        before = self._shown
        bodies = replace(before.picture, meshes=before.picture.of(*_BODIES))
        self._show(SettingsAnswer(settings, before.scene, None, bodies, reason))

    def _show(self, result: SettingsAnswer) -> None:
        """Bring meshes and readings up to date."""
        self._shown = result
        with self._server.atomic():
            self._player.set(result.picture, result.motion)
            self._write()
        self._server.flush()

    def _write(self) -> None:
        """Write the readings."""
        shown = self._shown
        same = shown.settings.algorithm is self._initial.settings.algorithm
        before = self._initial.solution if same else None
        self._verdict.content = verdict_html(shown, dark=self._dark)
        self._result.content = result_html(shown, before, dark=self._dark)
        self._torques.content = torque_html(shown, dark=self._dark)
        self._legend.content = legend_html(Role, dark=self._dark)

    def _switch_mode(self) -> None:
        """Follow the box of the dark page."""
        self._dark = self._dark_box.value
        self._set_mode()
        self._stage.set_dark(dark=self._dark)
        self._write()

    def _set_mode(self) -> None:
        self._server.gui.configure_theme(
            dark_mode=self._dark, show_logo=False, show_share_button=False, control_width="medium"
        )
