"""The page: viser draws what `answer_settings` returns for the settings of its controls.

With handles in the picture, by which object and hand are shifted and turned.
"""

from __future__ import annotations

import contextlib
import io
import logging
import threading
import webbrowser
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.errors import CrashError, GrasplessPinError, optional_import
from graspless_pin.scene import Scene
from graspless_pin.viewer.auth import SCHEMES, Gate, check_address, guarded_by, is_switch, one_of
from graspless_pin.viewer.controls import (
    ALONG,
    HAND_PLACE,
    OBJECT_PLACE,
    displacement_values,
    stated_displacement,
    support_frame,
)
from graspless_pin.viewer.panels import (
    ControlPanel,
    contacts_html,
    headline_html,
    legend_html,
    note_html,
    result_html,
    torque_html,
    verdict_html,
)
from graspless_pin.viewer.scene_process import (
    SceneProcess,
    Settings,
    SettingsAnswer,
    contact_changes_text,
    error_text,
    free_name,
    initial_settings,
)
from graspless_pin.viewer.scene_view import NUMBERS, OUTCOME, SLIDING, Player, Stage
from graspless_pin.visualization import Role
from graspless_pin.visualization.drawing import object_radius
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST

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
            gate: The gate that admits them.
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
            handle.on_update(self._drag_callback(group, moved))
            self._handles[group] = handle

    def show(self, group: str, visible: bool) -> None:
        """Show or hide the handles of `OBJECT_PLACE` or `HAND_PLACE`."""
        self._handles[group].visible = visible

    def place(self, values: Mapping[str, float]) -> None:
        """Move handles that are not being dragged to the displacement that values state."""
        along = bool(values.get(ALONG))
        self._frame = self._support if along else np.eye(3)
        self._handles[OBJECT_PLACE].active_axes = (True, True, not along)
        for group, handle in self._handles.items():
            if group not in self._dragged:
                shift, turn = stated_displacement(values, group)
                R = Rotation.from_rotvec(turn).as_matrix() @ self._axes_of(group)
                handle.position = self._centers[group] + shift
                handle.wxyz = Rotation.from_matrix(R).as_quat(scalar_first=True)

    def _axes_of(self, group: str) -> Any:
        return self._frame if group == OBJECT_PLACE else np.eye(3)

    def _drag_callback(self, group: str, moved: Callable[..., None]) -> Callable[[Any], Any]:
        """Return the callback of a handle that is dragged."""

        # viser awaits coroutines one after the other, in the order of the messages; functions it
        # runs in threads, where the end of a drag can come before its last step.
        async def follow(event: Any) -> None:
            if event.phase == "start":
                self._dragged.add(group)
                return
            handle = self._handles[group]
            R = Rotation.from_quat(np.asarray(handle.wxyz, dtype=float), scalar_first=True)
            turn = R * Rotation.from_matrix(self._axes_of(group)).inv()
            shift = np.asarray(handle.position, dtype=float) - self._centers[group]
            if event.phase == "end":  # not before the pose is read: `place` would take it back
                self._dragged.discard(group)
            moved(displacement_values(group, shift, turn.as_rotvec()))

        return follow


DEFAULT_PORT = 8080

_SCHEMES = ("as the system", *SCHEMES)
_VIEWS = {"Fit": "fit", "Front": "front", "Side": "side", "Top": "top"}
_BUTTON = (11, 83, 148)
_RESULT_WIDTH = 330  # px
_LISTEN_EVERY = 0.5  # s
_PAUSE = 0.5  # s without a change before the verdict is computed
_BODIES = (Role.HAND, Role.OBJECT, Role.SUPPORT)
_log = logging.getLogger(__name__)


def view(
    scene: Scene,
    *,
    host: str = "127.0.0.1",
    port: int = DEFAULT_PORT,
    open_browser: bool = False,
    dark: bool | None = None,
) -> Viewer:
    """Show a scene on an interactive page and return at once; the page lives in threads.

    Args:
        scene: The scene.
        host: The address to listen at; the default can only be reached from this machine. Only
            pages with the token of `Viewer.url` are answered.
        port: The port; the next free one above it if it is taken.
        open_browser: Whether to open the page.
        dark: Whether the page is dark; None: as its reader prefers pages.

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
    with optional_import("the viewer needs viser", "viewer"):
        import viser
    check_address(host, port)
    gate = Gate(host)
    server = None
    try:
        with contextlib.redirect_stdout(io.StringIO()), guarded_by(gate):  # viser announces itself
            server = viser.ViserServer(host=host, port=port, label="graspless_pin", verbose=False)
        viewer = Viewer(scene, server, gate, host, dark=dark)
    except BaseException:
        if server is not None:
            _stop_server(server)
        raise
    if open_browser:
        webbrowser.open(viewer.url)
    return viewer


def _stop_server(server: Any) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


class Viewer:
    """A running page. Make one with `view`; ends with `stop` or its process.

    See the example of `view`.

    Attributes:
        scene: The scene as loaded.
        url: The address of the page, with its token.
    """

    def __init__(
        self, scene: Scene, server: Any, gate: Gate, host: str, *, dark: bool | None
    ) -> None:
        """Build the page on a viser server behind a gate and start the thread that evaluates it."""
        self.scene = scene
        shown = "localhost" if host in ("0.0.0.0", "::", "") else host  # noqa: S104 - not binding
        name = f"[{shown}]" if ":" in shown else shown
        self.url = f"http://{name}:{server.get_port()}/{gate.token}/"
        self._server = server
        self._gate = gate
        self._scheme = _SCHEMES[0] if dark is None else SCHEMES[dark]
        self._dark = self._reader_dark = bool(dark)
        self._settings = initial_settings(scene)
        self._solving = SceneProcess(scene)
        self._initial = self._solving.evaluate_first(self._settings)
        self._shown = self._initial
        self._saved: tuple[Settings, Path] | None = None
        self._stage = Stage(server, self._initial.picture, dark=self._dark)
        size = object_radius(self._initial.picture)
        self._gizmos = Gizmos(server, gate, scene, size, lambda values: self._desk.change(values))
        self._changed = threading.Condition()
        self._waiting = False
        self._stopped = threading.Event()
        self._build_panels()
        self._show_answer(self._initial)
        gate.scheme_told = self._note_scheme
        server.on_client_connect(lambda client: self._stage.keep_fitted(client.camera))
        self._worker = threading.Thread(target=self._run, name="graspless-viewer", daemon=True)
        self._worker.start()

    @property
    def evaluation(self) -> SettingsAnswer:
        """The answer that the page shows now."""
        return self._shown

    def wait(self) -> None:
        """Wait until the page is stopped, from another thread or by the keyboard."""
        # With a timeout: Ctrl-C is handled by this thread, and nothing else wakes it where the
        # kernel delivers the signal to another one.
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
        _stop_server(self._server)

    def _build_panels(self) -> None:
        """Lay out panels and controls."""
        gui, admit = self._server.gui, self._gate.admit
        results = gui.add_panel()
        with results.add_tab("Result"):
            self._verdict = gui.add_html("")
            self._result = gui.add_html("")
            self._player = Player(self._server, self._gate, self._stage)
            self._torques = gui.add_html("")
            self._contacts = gui.add_html("")
        with results.add_tab("Layers"):
            self._legend = gui.add_html("")
            box = gui.add_dropdown("colours", _SCHEMES, initial_value=self._scheme)
            self._scheme_box = admit(box, one_of(_SCHEMES), lambda _: self._apply_scheme())
            for layer, label in ((NUMBERS, NUMBERS), *((role, role.label) for role in Role)):
                box = gui.add_checkbox(label, layer not in HIDDEN_AT_FIRST)
                admit(box, is_switch, partial(self._show_layer, layer))
        results.dock_left()
        results.set_width(_RESULT_WIDTH)
        gui.main_panel.dock_right()
        self._headline = gui.add_html("")
        admit(
            gui.add_button_group("view", tuple(_VIEWS)),
            one_of(tuple(_VIEWS)),
            lambda event: self._stage.look(event.client.camera, _VIEWS[event.target.value]),
        )
        self._desk = ControlPanel(
            self._server, self._gate, self.scene, self._settings, self._request, self._gizmos.show
        )
        save = gui.add_button("Save as scene file", color=_BUTTON)
        admit(save, is_switch, lambda _: self._save_at_page())
        self._saying = gui.add_html("")
        self._configure_theme()

    def _show_layer(self, layer: str, event: Any) -> None:
        self._stage.show_layer(layer, visible=event.target.value)

    def save(self, path: str | Path | None = None) -> Path:
        """Write the scene as it is shown to a file, see `Scene.save`; return its path.

        Args:
            path: The file; None: beside the scene's own, or here, under a name that is free.

        Raises:
            SceneError: The file exists already or cannot be written.
        """
        shown = self._shown
        if path is not None:
            return shown.scene.save(path)
        if self._saved is not None and self._saved[0] == shown.settings:
            return self._saved[1]
        self._saved = shown.settings, shown.scene.save(free_name(self.scene))
        return self._saved[1]

    def _save_at_page(self) -> None:
        try:
            message = f"saved as {self.save()}"
        except GrasplessPinError as error:
            message = f"not saved: {error}"
        self._saying.content = note_html("graspless-saved", message)

    def _request(self, settings: Settings) -> None:
        """Request other settings; the newest ones replace those that are not evaluated yet."""
        with self._changed:
            self._settings = settings
            self._waiting = True
            self._changed.notify()

    def _run(self) -> None:
        """Evaluate and show settings, then their verdict where no others follow, until the end."""
        judged = False
        while True:
            with self._changed:
                pause = None if judged else _PAUSE
                has_settings = self._changed.wait_for(
                    lambda: self._waiting or self._stopped.is_set(), pause
                )
                if self._stopped.is_set():
                    return
                settings, self._waiting = self._settings, False
            judged, shown = not has_settings, self._shown
            try:
                if judged:
                    self._show_verdict()
                else:
                    self._show_answer(self._solving.evaluate(settings))
                continue
            except CrashError as error:
                why = f"a solver crashed: {error}"
            except Exception as error:  # the page goes on, and shows the error
                subject = "the verdict" if judged else f"the settings {settings}"
                _log.exception("%s cannot be shown", subject)
                why = error_text(error)
            if self._stopped.is_set():
                return
            if judged:
                self._show_answer(replace(shown, verdict=f"no verdict: {why}"))
            else:  # the bodies that were shown before stay
                bodies = replace(shown.picture, meshes=shown.picture.of(*_BODIES))
                self._show_answer(SettingsAnswer(settings, shown.scene, None, bodies, why))

    def _show_verdict(self) -> None:
        """Show the verdict on the torques that are shown, and make the settings a step for undo."""
        self._desk.remember()
        solution = self._shown.solution
        if solution is not None and solution.found:
            self._show_answer(self._solving.judge())

    def _show_answer(self, result: SettingsAnswer) -> None:
        """Bring meshes and panels up to date."""
        self._shown = result
        motions = {OUTCOME: result.motion, SLIDING: result.sliding}
        with self._server.atomic():
            self._player.set(
                result.picture, {name: one for name, one in motions.items() if one is not None}
            )
            self._gizmos.place(result.settings.values)
            self._write_panels()
        self._server.flush()

    def _write_panels(self) -> None:
        """Write the panels."""
        shown = self._shown
        same = shown.settings.algorithm == self._initial.settings.algorithm
        before = self._initial.solution if same else None
        changes = ""
        if shown.bodies is not None and self._initial.bodies is not None:
            changes = contact_changes_text(self._initial.bodies, shown.bodies)
        self._headline.content = headline_html(shown, dark=self._dark)
        self._verdict.content = note_html(
            "graspless-changes", changes and f"since loading: {changes}"
        ) + verdict_html(shown, dark=self._dark)
        self._result.content = result_html(shown, before, dark=self._dark)
        self._torques.content = torque_html(shown, dark=self._dark)
        self._contacts.content = contacts_html(shown)
        self._legend.content = legend_html(Role, shown.picture, dark=self._dark)

    def _note_scheme(self, dark: bool) -> None:
        """Note a reader's colour scheme; called by viser's own thread, which must not wait."""
        self._reader_dark = dark
        threading.Thread(target=self._apply_scheme, daemon=True).start()

    def _apply_scheme(self) -> None:
        """Apply the colour scheme that is chosen in the box."""
        scheme = self._scheme_box.value
        dark = self._reader_dark if scheme == _SCHEMES[0] else scheme == "dark"
        if dark == self._dark:
            return
        self._dark = dark
        with self._server.atomic():
            self._configure_theme()
            self._stage.set_dark(dark=dark)
            self._write_panels()

    def _configure_theme(self) -> None:
        self._server.gui.configure_theme(
            dark_mode=self._dark, show_logo=False, show_share_button=False, control_width="medium"
        )
