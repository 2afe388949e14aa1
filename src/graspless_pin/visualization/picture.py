"""The records of a picture: meshes and texts with roles, their colours, and the camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import Record


class Role(StrEnum):
    """The meaning of a mesh; layers and colours depend on it. See the example of `draw_scene`."""

    HAND = "hand"
    OBJECT = "object"
    SUPPORT = "support"
    CONTACT = "contact"
    CONE = "friction_cone"
    NORMAL_FORCE = "normal_force"
    FRICTION_FORCE = "friction_force"
    FRICTION_AT_LIMIT = "friction_at_limit"
    TOTAL_FORCE = "total_force"
    EXTERNAL_FORCE = "external_force"
    LOAD = "load"
    VIRTUAL_SLIDING = "virtual_sliding"
    SLIDING = "sliding"
    STICKING_CONTACT = "sticking_contact"
    SLIPPING_CONTACT = "slipping_contact"
    OPEN_CONTACT = "open_contact"
    CENTER_OF_MASS = "center_of_mass"
    CENTER_REGION = "center_of_mass_region"
    AXES = "world_axes"
    GRAVITY = "gravity"
    FORCE_SCALE = "force_scale"

    @property
    def label(self) -> str:
        """The role in words, for legends."""
        return _LABELS[self]


_LABELS = {
    Role.HAND: "hand",
    Role.OBJECT: "object",
    Role.SUPPORT: "supports",
    Role.CONTACT: "contact points",
    Role.CONE: "friction cones",
    Role.NORMAL_FORCE: "normal force",
    Role.FRICTION_FORCE: "friction",
    Role.FRICTION_AT_LIMIT: "friction at its limit",
    Role.TOTAL_FORCE: "total force",
    Role.EXTERNAL_FORCE: "weight and all loads",
    Role.LOAD: "loads",
    Role.VIRTUAL_SLIDING: "virtual sliding",
    Role.SLIDING: "actual sliding",
    Role.STICKING_CONTACT: "sticking contact",
    Role.SLIPPING_CONTACT: "slipping contact",
    Role.OPEN_CONTACT: "open contact",
    Role.CENTER_OF_MASS: "centre of mass",
    Role.CENTER_REGION: "where the centre of mass may be",
    Role.AXES: "world axes",
    Role.GRAVITY: "gravity",
    Role.FORCE_SCALE: "scale of forces",
}
_UNITS = {1.0: "1 m", 1e-2: "1 cm", 1e-3: "1 mm", 1e-6: "1 µm"}
_PREFIXES = {1e6: "MN", 1e3: "kN", 1.0: "N", 1e-3: "mN", 1e-6: "µN", 1e-9: "nN"}
_LEAST_PLAIN, _MOST_PLAIN = 0.01, 1e4  # N, without a prefix
_UNITS_IN_SIZE = 2.0
HIDDEN_AT_FIRST = frozenset({Role.TOTAL_FORCE, Role.EXTERNAL_FORCE})
"""Layers that are shown on request: the sums of other arrows."""


class ForceScale(NamedTuple):
    """The scale of drawn forces, as on maps: a force for a length.

    Attributes:
        length: The length, m: a metre, centimetre, millimetre or micrometre.
        force: The force that is drawn with this length, N.
    """

    length: float
    force: float

    @classmethod
    def fitting(cls, metres_per_newton: float, size: float) -> ForceScale:
        """Return a scale whose length fits into the size of the object (m)."""
        fits = [unit for unit in _UNITS if _UNITS_IN_SIZE * unit <= size]
        unit = max(fits, default=min(_UNITS))
        return cls(unit, unit / metres_per_newton)

    @property
    def metres_per_newton(self) -> float:
        """Drawn length of one newton, m."""
        return self.length / self.force

    def __str__(self) -> str:
        """Return the scale in words, such as "1 cm = 5 N"."""
        prefixes = [prefix for prefix in _PREFIXES if prefix <= self.force]
        prefix = max(prefixes, default=min(_PREFIXES))
        prefix = 1.0 if _LEAST_PLAIN <= self.force < _MOST_PLAIN else prefix
        return f"{_UNITS[self.length]} = {self.force / prefix:.3g} {_PREFIXES[prefix]}"


@dataclass(frozen=True, eq=False)
class Mark(Record):
    """A short text at a point.

    Attributes:
        text: The text: a contact's number, the letter of an axis.
        role: Role of what it labels; it is visible where that is.
        position: (3,) read-only, world frame, m.
        contact: Index of the contact that it numbers; None: of none.
        words: Description, a line each; the first names it.
    """

    text: str
    role: Role
    position: FloatArray
    contact: int | None = None
    words: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Mesh(Record):
    """Triangles of one body or arrow, counterclockwise when seen from outside.

    See the example of `draw_scene`.

    Attributes:
        name: Unique in its picture; slashes make groups.
        role: Its meaning.
        vertices: (V, 3) read-only, world frame, m.
        faces: (F, 3) read-only indices of vertices.
        opacity: 0 to 1.
        contact: Index of the contact that it belongs to; None: of none.
        finger: Index of the finger, of its picture's, that it belongs to; None: of none.
    """

    name: str
    role: Role
    vertices: FloatArray
    faces: NDArray[np.int64]
    opacity: float = 1.0
    contact: int | None = None
    finger: int | None = None


@dataclass(frozen=True, eq=False)
class Picture(Record):
    """Meshes and texts, with views of them. See the example of `draw_scene`.

    Attributes:
        meshes: All meshes.
        center: (3,) middle of object and near hand, m.
        radius: Radius of a sphere around them, m.
        up: (3,) unit vector against gravity, world axes.
        view_from: (3,) unit vector from the center towards the default camera.
        views: Other such vectors by name: ``front``, ``side`` and ``top``.
        floors: (K, 4) planes (n, d) with n^T x >= d in front of them, supports of the object that
            views stay above.
        fingers: Names of the fingers; meshes have their index.
        marks: Texts in the picture.
        force_scale: The scale of forces; None: there are none.
    """

    meshes: tuple[Mesh, ...]
    center: FloatArray
    radius: float
    up: FloatArray
    view_from: FloatArray
    views: Mapping[str, FloatArray] = field(default_factory=dict)
    floors: FloatArray = field(default_factory=lambda: np.zeros((0, 4)))
    fingers: tuple[str, ...] = ()
    marks: tuple[Mark, ...] = ()
    force_scale: ForceScale | None = None

    def of(self, *roles: Role) -> tuple[Mesh, ...]:
        """Return the meshes of some roles."""
        return tuple(mesh for mesh in self.meshes if mesh.role in roles)


_FORWARD, _HEIGHT = 0.35, 0.5
_TOO_SHORT = 1e-9
_LOWEST_VIEW, _VIEW_STEP = np.radians(10.0), np.radians(1.0)
# In radii from the middle: the framed part of hands, whose arms are context, and of all else; the
# slab of a half-space, 1.3 of the object's radii to each side, lies within.
_HAND_FRAMED, _FRAMED = 1.05, 2.3
_FRAME_MARGIN = 1.08


def up_against(force: FloatArray) -> FloatArray:
    """(3,) unit vector against gravity or weight; z where that is zero."""
    length = float(np.linalg.norm(force))
    if length <= _TOO_SHORT:
        return read_only(np.array([0.0, 0.0, 1.0]))
    return read_only(0.0 - force / length)  # without negative zeros


def across_gravity(force: FloatArray) -> FloatArray:
    """(2, 3) unit vectors that span the level plane; their cross product is up.

    The first is the projection of the world axis that is most level.

    Args:
        force: (3,) gravity or weight; zero: up is z.
    """
    up = up_against(force)
    axis: FloatArray = np.eye(3)[int(np.abs(up).round(9).argmin())]
    first = axis - (axis @ up) * up
    first /= np.linalg.norm(first)
    return read_only(np.stack([first, np.cross(up, first)]))


def look_across(away: FloatArray, up: FloatArray, walls: Sequence[FloatArray] = ()) -> FloatArray:
    """(3,) unit vector towards a camera that sees object and hand side by side, from above.

    Args:
        away: (3,) from the object to the hand, m; without a horizontal part there is no hand.
        up: (3,) unit.
        walls: (3,) outward normals of planes, to be seen from outside rather than from behind.
    """
    level = _horizontal_unit(away, up)
    side = np.cross(level, up)
    choices = [
        across * side + forward * level + _HEIGHT * up
        for forward in (_FORWARD, -_FORWARD)
        for across in (1.0, -1.0)
    ]
    best = max(choices, key=lambda view: min((0.0, *(float(view @ wall) for wall in walls))))
    return read_only(best / np.linalg.norm(best))


def _horizontal_unit(away: FloatArray, up: FloatArray) -> FloatArray:
    """Return the unit horizontal part of a vector, or of an axis where it has none."""
    level = away - (away @ up) * up
    if np.linalg.norm(level) <= _TOO_SHORT + 0.1 * np.linalg.norm(away):
        level = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
        level -= (level @ up) * up
    return level / np.linalg.norm(level)


def preset_views(
    away: FloatArray, up: FloatArray, walls: Sequence[FloatArray], floors: FloatArray
) -> Mapping[str, FloatArray]:
    """Return unit vectors towards cameras in front of, beside and above object and hand.

    The front shows the object before the hand, or the hand before it if a wall stands there. No
    view is from below a floor.

    Args:
        away: (3,) from the object to the hand, m, see `look_across`.
        up: (3,) unit.
        walls: (3,) outward normals of planes, to be seen from outside rather than from behind.
        floors: (K, 4) of `Picture.floors`.
    """
    level = _horizontal_unit(away, up)
    side = np.cross(level, up)
    views = {}
    for name, way in (("front", -level), ("side", side)):
        best = max((way, -way), key=lambda one: min((0.0, *(float(one @ wall) for wall in walls))))
        views[name] = read_only(_view_above_floors(best, up, floors))
    # Not quite from above, so that up stays up.
    views["top"] = read_only(_view_above_floors(views["side"], up, floors, np.radians(88.0)))
    return views


def _view_above_floors(
    level: FloatArray, up: FloatArray, floors: FloatArray, tilt: float = _LOWEST_VIEW
) -> FloatArray:
    """Return a view vector at an angle above the level, raised until in front of all floors."""
    level = level - (level @ up) * up
    level /= np.linalg.norm(level)
    while True:
        view = np.cos(tilt) * level + np.sin(tilt) * up
        if tilt >= 0.5 * np.pi or (floors[:, :3] @ view >= np.sin(_LOWEST_VIEW)).all():
            return view
        tilt += _VIEW_STEP


def framing(
    picture: Picture, field_of_view: float, aspect: float, toward: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Return the point that a camera looks at, and its distance, to show all that is framed.

    Args:
        picture: The picture.
        field_of_view: Vertical, rad.
        aspect: Width over height of the drawing.
        toward: (3,) unit vector to the camera; None: ``view_from``.

    Returns:
        (3,) point to look at and the camera's distance from it, m.
    """
    toward, up = picture.view_from if toward is None else toward, picture.up
    right = np.cross(up, toward)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(toward, right), toward])
    framed = []
    for mesh in picture.meshes:
        if mesh.role not in HIDDEN_AT_FIRST:
            reach = _HAND_FRAMED if mesh.role is Role.HAND else _FRAMED
            vertices = mesh.vertices - picture.center
            framed.append(vertices[np.linalg.norm(vertices, axis=1) < reach * picture.radius])
    seen = np.vstack(framed) @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0)) * [1.0, 1.0, 0.0]
    x, y, z = (seen - middle).T
    slope = np.tan(0.5 * field_of_view)
    distance = float(np.max(np.maximum(np.abs(x) / aspect, np.abs(y)) * _FRAME_MARGIN / slope + z))
    return picture.center + middle @ axes, distance


@dataclass(frozen=True)
class Palette:
    """Colours of one background. See the example of `draw_scene`.

    Attributes:
        background: ``#rrggbb``.
        text: ``#rrggbb`` of text on the background.
        roles: ``#rrggbb`` by role.
        fingers: ``#rrggbb`` of fingers in turn; further ones repeat them.
    """

    background: str
    text: str
    roles: Mapping[Role, str]
    fingers: tuple[str, ...]

    def of_finger(self, finger: int) -> str:
        """Return the colour of a finger by its index, ``#rrggbb``."""
        return self.fingers[finger % len(self.fingers)]

    def of_mesh(self, mesh: Mesh) -> tuple[int, int, int]:
        """Return a mesh's colour as three numbers from 0 to 255: its finger's, or its role's."""
        own = self.roles[mesh.role] if mesh.finger is None else self.of_finger(mesh.finger)
        red, green, blue = bytes.fromhex(own.removeprefix("#"))
        return red, green, blue


LIGHT = Palette(
    background="#ffffff",
    text="#1b1f24",
    roles=MappingProxyType(
        {
            Role.HAND: "#8d949c",
            Role.OBJECT: "#9cc3e0",
            Role.SUPPORT: "#cdbf9f",
            Role.CONTACT: "#1b1f24",
            Role.CONE: "#e6c700",
            Role.NORMAL_FORCE: "#0072b2",
            Role.FRICTION_FORCE: "#009e73",
            Role.FRICTION_AT_LIMIT: "#d55e00",
            Role.TOTAL_FORCE: "#4b4f55",
            Role.VIRTUAL_SLIDING: "#b8508e",
            Role.SLIDING: "#e69f00",
            Role.STICKING_CONTACT: "#2c3138",
            Role.SLIPPING_CONTACT: "#f08c00",
            Role.OPEN_CONTACT: "#d6336c",
            Role.CENTER_OF_MASS: "#123a12",
            Role.CENTER_REGION: "#5c9e1f",
            Role.EXTERNAL_FORCE: "#b0284f",
            Role.LOAD: "#6b3fa0",
            Role.AXES: "#5a6068",
            Role.GRAVITY: "#8a1538",
            Role.FORCE_SCALE: "#0b5394",
        }
    ),
    fingers=("#2b505d", "#d9b4f2", "#9a7348", "#8fcea4", "#5e3a17"),
)
"""Colours on white."""

DARK = Palette(
    background="#14181d",
    text="#e8eaed",
    roles=MappingProxyType(
        {
            Role.HAND: "#8a919a",
            Role.OBJECT: "#4a7fa5",
            Role.SUPPORT: "#6f6650",
            Role.CONTACT: "#ffffff",
            Role.CONE: "#f0e442",
            Role.NORMAL_FORCE: "#56b4e9",
            Role.FRICTION_FORCE: "#2fd0a0",
            Role.FRICTION_AT_LIMIT: "#ff7f3f",
            Role.TOTAL_FORCE: "#d5d9de",
            Role.VIRTUAL_SLIDING: "#e58fc2",
            Role.SLIDING: "#ffb733",
            Role.STICKING_CONTACT: "#eef0f2",
            Role.SLIPPING_CONTACT: "#ffa94d",
            Role.OPEN_CONTACT: "#ff7aa8",
            Role.CENTER_OF_MASS: "#e9ffd0",
            Role.CENTER_REGION: "#a6e04e",
            Role.EXTERNAL_FORCE: "#ff5c74",
            Role.LOAD: "#c8a2ff",
            Role.AXES: "#c3c8ce",
            Role.GRAVITY: "#ff8a9a",
            Role.FORCE_SCALE: "#8fc4f2",
        }
    ),
    fingers=("#c79c66", "#8f4238", "#b3e6ac", "#8560a0", "#dccaea"),
)
"""Colours on dark grey."""
