"""What viser draws between the panels: meshes, layers, light and the first look at the scene."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.visualization import DARK, LIGHT, Mesh, Picture, Role
from graspless_pin.visualization.looking import framing
from graspless_pin.visualization.motion import MovingPicture
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST

_ROOT = "/scene"
_FIELD_OF_VIEW = 0.7  # rad, vertical
_ASPECT = 0.75  # of what lies between the panels on a screen of 1280 x 800
_AMBIENT = 1.6
_NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])


class Stage:
    """The drawing of a viser server."""

    def __init__(self, server: Any, picture: Picture, *, dark: bool) -> None:
        """Set up layers, light and camera for a first picture, which still has to be drawn."""
        scene = server.scene
        self._scene = scene
        self._first = picture
        self._dark = dark
        self._meshes: dict[str, tuple[Mesh, Any]] = {}
        self._layers = {
            role: scene.add_frame(
                f"{_ROOT}/{role}", show_axes=False, visible=role not in HIDDEN_AT_FIRST
            )
            for role in Role
        }
        self._root = scene.add_frame(_ROOT, show_axes=False)
        scene.set_up_direction(picture.up)
        scene.configure_environment_map(None)
        scene.add_light_ambient("/ambient light", intensity=_AMBIENT)
        _aim(server.initial_camera, picture)

    def draw(self, picture: Picture) -> None:
        """Send the meshes that are new or have changed and remove those that are gone."""
        names = {_node(mesh): mesh for mesh in picture.meshes}
        for name in [name for name in self._meshes if name not in names]:
            self._meshes.pop(name)[1].remove()
        for _, handle in self._meshes.values():  # where a motion has left them
            handle.wxyz, handle.position = _NO_TURN, np.zeros(3)
        for name, mesh in names.items():
            if name not in self._meshes or not _same_faces(self._meshes[name][0], mesh):
                self._meshes[name] = (mesh, self._add_mesh(name, mesh))
                continue
            before, handle = self._meshes[name]
            if not np.array_equal(before.vertices, mesh.vertices):
                handle.vertices = mesh.vertices.astype(np.float32)
                self._meshes[name] = (mesh, handle)
        self._tilt(picture)

    def move(self, moving: MovingPicture, index: int) -> None:
        """Bring the meshes of a moving picture to where they are at one of its times."""
        poses = [path[index] for path in moving.paths]
        turns = Rotation.from_matrix([pose[:3, :3] for pose in poses]).as_quat(scalar_first=True)
        for mesh, handle in self._meshes.values():
            path = moving.path_of.get(mesh.name)
            if path is not None:
                handle.wxyz, handle.position = turns[path], poses[path][:3, 3]

    def show_layer(self, role: Role, *, visible: bool) -> None:
        """Show or hide all meshes of a role."""
        self._layers[role].visible = visible

    def set_dark(self, *, dark: bool) -> None:
        """Give all meshes the colours of a dark or a light page."""
        self._dark = dark
        for mesh, handle in list(self._meshes.values()):
            handle.color = self._color(mesh)

    def _color(self, mesh: Mesh) -> tuple[int, int, int]:
        return (DARK if self._dark else LIGHT).of_mesh(mesh)

    def _tilt(self, picture: Picture) -> None:
        """Turn all that is drawn about its middle so that up stays up on the page."""
        turn = Rotation.align_vectors(self._first.up[None], picture.up[None])[0]
        center = self._first.center
        self._root.wxyz = turn.as_quat(scalar_first=True)
        self._root.position = center - turn.as_matrix() @ center

    def _add_mesh(self, name: str, mesh: Mesh) -> Any:
        return self._scene.add_mesh_simple(
            name,
            mesh.vertices.astype(np.float32),
            mesh.faces.astype(np.uint32),
            color=self._color(mesh),
            opacity=mesh.opacity if mesh.opacity < 1.0 else None,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )


def _node(mesh: Mesh) -> str:
    """Name of a mesh on the page: links of prefixed robots have slashes of their own."""
    return f"{_ROOT}/{mesh.role}/{mesh.name.replace('/', ' ')}"


def _same_faces(first: Mesh, second: Mesh) -> bool:
    return first.faces is second.faces or np.array_equal(first.faces, second.faces)


def _aim(camera: Any, picture: Picture) -> None:
    """Look at what matters, all of it."""
    center, distance = framing(picture, _FIELD_OF_VIEW, _ASPECT)
    camera.fov = _FIELD_OF_VIEW
    camera.position = center + distance * picture.view_from
    camera.look_at = center
    camera.near = 0.01 * distance
    camera.far = 100.0 * distance
