"""The drawing between the panels: meshes and layers in viser, and the motions that it plays."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from graspless_pin.problem.checks import FloatArray
from graspless_pin.viewer.auth import Gate, is_switch, number_between, one_of
from graspless_pin.visualization import DARK, LIGHT, Mesh, Picture, Role
from graspless_pin.visualization.motion import MovingPicture
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST, Mark, framing

_ROOT = "/scene"
_FIELD_OF_VIEW = 0.7  # rad, vertical
_ASPECT = 0.75  # of the area between the panels on a screen of 1280 x 800
_AMBIENT = 1.6
_NARROW = 700  # px: below it panels lie over the lower part of the page
_NARROW_BOX = 0.03, 0.02, 0.97, 0.4
"""Left, top, right and bottom of the area free of panels there, as shares of the page."""
_PANELS = 650  # px
_UNMOVED_CAMERA = 1e-3  # of its distance: smaller moves do not count
_FACING_DOWN = 0.9
NUMBERS = "contact numbers"
"""The layer of the contacts' numbers."""
_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


class Stage:
    """The drawing of a viser server."""

    def __init__(self, server: Any, picture: Picture, *, dark: bool) -> None:
        """Set up layers, light and camera for a first picture, which is not drawn yet."""
        scene = server.scene
        self._scene = scene
        self._first = picture
        self._dark = dark
        self._meshes: dict[str, tuple[Mesh, Any]] = {}
        self._layers: dict[str, Any] = {
            role: scene.add_frame(
                f"{_ROOT}/{role}", show_axes=False, visible=role not in HIDDEN_AT_FIRST
            )
            for role in Role
        }
        self._root = scene.add_frame(_ROOT, show_axes=False)
        self._layers[NUMBERS] = scene.add_frame(f"{_ROOT}/{NUMBERS}", show_axes=False)
        self._labels: dict[str, tuple[Mark, Any]] = {}
        scene.set_up_direction(picture.up)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/ambient light", intensity=_AMBIENT)
        _aim_camera(server.initial_camera, picture)
        self._start = np.array(server.initial_camera.position)
        self._looks: dict[int, tuple[str, tuple[float, float], FloatArray]] = {}

    def draw(self, picture: Picture) -> None:
        """Send meshes that are new or have changed, and remove those that are gone."""
        names = {_mesh_node(mesh): mesh for mesh in picture.meshes}
        for name in [name for name in self._meshes if name not in names]:
            self._meshes.pop(name)[1].remove()
        for _, handle in self._meshes.values():  # a motion may have moved them
            handle.wxyz, handle.position = _NO_TURN, np.zeros(3)
        for name, mesh in names.items():
            before = self._meshes.get(name)
            if before is None or not np.array_equal(before[0].faces, mesh.faces):
                self._meshes[name] = mesh, self._add_mesh(name, mesh)
            elif not np.array_equal(before[0].vertices, mesh.vertices):
                before[1].vertices = mesh.vertices.astype(np.float32)
                self._meshes[name] = mesh, before[1]
        self._update_marks(picture)
        self._keep_upright(picture)

    def keep_fitted(self, camera: Any) -> None:
        """Fit the view to the scene, again when a page is turned, until its reader moves it.

        A page may also reset its camera to the common start after it was set: it is set again then.
        """
        self.look(camera)

        @camera.on_update
        def _(camera: Any) -> None:
            if camera.client.client_id not in self._looks:
                return
            view, size, place = self._looks[camera.client.client_id]
            tolerance = _UNMOVED_CAMERA * float(np.linalg.norm(place - self._first.center))
            at_start, stays = (
                bool(np.linalg.norm(camera.position - there) < tolerance)
                for there in (self._start, place)
            )
            if at_start or (stays and size != (camera.image_width, camera.image_height)):
                self.look(camera, view)

    def look(self, camera: Any, view: str = "fit") -> None:
        """Move the camera of a page to one of the views of the first picture, with all in sight.

        Args:
            camera: viser's, of one page.
            view: ``fit``, ``front``, ``side`` or ``top``.
        """
        picture = self._first
        wide, high = float(camera.image_width), float(camera.image_height)
        if not wide or not high:
            return
        left, top, right, bottom = _NARROW_BOX
        if wide >= _NARROW:
            left, top, right, bottom = 0.5 * _PANELS / wide, 0.02, 1.0 - 0.5 * _PANELS / wide, 0.98
        toward = picture.views.get(view, picture.view_from)
        slope = np.tan(0.5 * _FIELD_OF_VIEW)
        field = 2.0 * np.arctan((bottom - top) * slope)
        aspect = (right - left) * wide / ((bottom - top) * high)
        center, distance = framing(picture, field, aspect, toward)
        across = np.cross(picture.up, toward)
        over = np.cross(toward, across / np.linalg.norm(across))
        # The middle of the page is below that of the area free of panels.
        center = center - (1.0 - top - bottom) * distance * slope * over
        place = center + distance * toward
        self._looks[camera.client.client_id] = view, (wide, high), place
        with camera.client.atomic():
            camera.up_direction = picture.up
            camera.fov = _FIELD_OF_VIEW
            camera.position = place
            camera.look_at = center

    def _update_marks(self, picture: Picture) -> None:
        """Bring the texts up to date."""
        marks = {_mark_node(mark): mark for mark in picture.marks}
        for name in [name for name in self._labels if name not in marks]:
            self._labels.pop(name)[1].remove()
        for name, mark in marks.items():
            if name in self._labels:
                handle = self._labels[name][1]
                handle.position, handle.text = mark.position, mark.text
            else:
                handle = self._scene.add_label(
                    name, mark.text, position=mark.position,
                    anchor="center-center" if mark.contact is None else "top-left",
                )  # fmt: skip
            self._labels[name] = mark, handle

    def move(self, moving: MovingPicture, index: int) -> None:
        """Move the meshes of a moving picture to their poses at one of its times."""
        poses = [path[index] for path in moving.paths]
        turns = Rotation.from_matrix([pose[:3, :3] for pose in poses]).as_quat(scalar_first=True)
        for mesh, handle in self._meshes.values():
            path = moving.path_of.get(mesh.name)
            if path is not None:
                handle.wxyz, handle.position = turns[path], poses[path][:3, 3]
        for mark, handle in self._labels.values():
            if mark.contact is not None:
                handle.position = poses[0][:3] @ [*mark.position, 1.0]

    def show_layer(self, role: str, *, visible: bool) -> None:
        """Show or hide all meshes of a role, or the `NUMBERS`."""
        self._layers[role].visible = visible

    def set_dark(self, *, dark: bool) -> None:
        """Give all meshes the colours of a dark or a light page."""
        self._dark = dark
        for mesh, handle in list(self._meshes.values()):
            handle.color = self._color(mesh)

    def _color(self, mesh: Mesh) -> tuple[int, int, int]:
        return (DARK if self._dark else LIGHT).of_mesh(mesh)

    def _keep_upright(self, picture: Picture) -> None:
        """Turn the whole drawing about its middle so that up stays up on the page."""
        turn = Rotation.align_vectors(self._first.up[None], picture.up[None])[0]
        center = self._first.center
        self._root.wxyz = turn.as_quat(scalar_first=True)
        self._root.position = center - turn.as_matrix() @ center

    def _add_mesh(self, name: str, mesh: Mesh) -> Any:
        floors = self._first.floors[:, :3] if mesh.role is Role.SUPPORT else np.zeros((0, 3))
        return self._scene.add_mesh_simple(
            name,
            mesh.vertices.astype(np.float32),
            _without_undersides(mesh, floors).astype(np.uint32),
            color=self._color(mesh),
            opacity=mesh.opacity if mesh.opacity < 1.0 else None,
            flat_shading=True,
            side="front" if len(floors) else "double",
            cast_shadow=False,
            receive_shadow=False,
        )


def _mesh_node(mesh: Mesh) -> str:
    """Return a mesh's name on the page: links of prefixed robots have slashes of their own."""
    return f"{_ROOT}/{mesh.role}/{mesh.name.replace('/', ' ')}"


def _mark_node(mark: Mark) -> str:
    """Return a text's name on the page, in the layer of what it belongs to."""
    if mark.contact is not None:
        return f"{_ROOT}/{NUMBERS}/{mark.contact}"
    return f"{_ROOT}/{mark.role}/text {mark.text if mark.role is Role.AXES else ''}"


def _without_undersides(mesh: Mesh, floors: FloatArray) -> NDArray[np.int64]:
    """Return the faces of a support without its underside, which would hide it from below."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    down = normals @ floors.T < -_FACING_DOWN * lengths
    return mesh.faces[~down.any(axis=1)]


def _aim_camera(camera: Any, picture: Picture) -> None:
    """Fit the camera to all that is framed."""
    center, distance = framing(picture, _FIELD_OF_VIEW, _ASPECT)
    camera.fov = _FIELD_OF_VIEW
    camera.position = center + distance * picture.view_from
    camera.look_at = center
    camera.near = 0.01 * distance
    camera.far = 100.0 * distance


_FRAME_TIME = 0.08  # s
_STILL_FRAMES = 10  # at the motion's end
OUTCOME, SLIDING = "what can happen", "virtual sliding"
"""The names of the motions."""


class Player:
    """Controls that show a motion and play it in slow motion, repeatedly, on request.

    Nothing moves before: a server does not know who prefers reduced motion.
    """

    def __init__(self, server: Any, gate: Gate, stage: Stage) -> None:
        """Lay the controls out on the page that is being built."""
        self._server, self._stage = server, stage
        self._motions: Mapping[str, MovingPicture] = {}
        self._picture: Picture | None = None
        self._lock, self._stopped = threading.RLock(), threading.Event()
        gui = server.gui
        self._folder = gui.add_folder("Motion", visible=False)
        with self._folder:
            self._which = gui.add_dropdown("motion", (OUTCOME, SLIDING))
            self._shown = gui.add_checkbox("show", initial_value=False)
            self._play = gui.add_checkbox("play", initial_value=False)
            self._time = gui.add_slider("time", 0.0, 1.0, 0.01, 1.0)
        for control, check in (
            (self._which, one_of((OUTCOME, SLIDING))),
            (self._shown, is_switch),
            (self._play, is_switch),
            (self._time, number_between(0.0, 1.0)),
        ):
            gate.admit(control, check, lambda _: self._draw())
        self._play.on_update(lambda _: self._show_what_plays())
        self._thread = threading.Thread(target=self._run, name="graspless-player", daemon=True)
        self._thread.start()

    def set(self, picture: Picture, motions: Mapping[str, MovingPicture]) -> None:
        """Draw a picture, and offer motions by name that replace it."""
        with self._lock:
            new = tuple(motions) != tuple(self._motions)
            self._picture, self._motions = picture, motions
            self._folder.visible = bool(motions)
            if not motions:
                self._shown.value = self._play.value = False
            elif new:
                self._which.options = tuple(motions)
                self._which.value = next(iter(motions))
            self._draw()

    @property
    def _chosen_motion(self) -> MovingPicture | None:
        """The chosen motion; None: none is shown."""
        return self._motions.get(self._which.value) if self._shown.value else None

    def stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        self._thread.join()

    def _show_what_plays(self) -> None:
        if self._play.value:
            self._shown.value = True

    def _draw(self) -> None:
        """Draw the picture, or the motion at its time."""
        with self._lock, self._server.atomic():
            moving = self._chosen_motion
            if moving is not None:
                self._stage.draw(moving.picture)
                self._stage.move(moving, round(self._time.value * (len(moving.times) - 1)))
            elif self._picture is not None:
                self._stage.draw(self._picture)

    def _run(self) -> None:
        """Play frame by frame until the page is stopped."""
        frame = 0
        while not self._stopped.wait(_FRAME_TIME):
            with self._lock, self._server.atomic():
                moving = self._chosen_motion
                if moving is not None and self._play.value:
                    last = len(moving.times) - 1
                    frame = (frame + 1) % (last + _STILL_FRAMES)
                    self._stage.move(moving, min(frame, last))
