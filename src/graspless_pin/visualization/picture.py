"""The records of a picture: meshes and short texts with a role, and where to look."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.geometry.pickling import Record
from graspless_pin.problem.checks import FloatArray


class Role(StrEnum):
    """What a mesh stands for; layers and colours go by it. See the example of `draw_scene`."""

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
    VIRTUAL_SLIDING = "virtual_sliding"
    SLIDING = "sliding"
    STICKING_CONTACT = "sticking_contact"
    SLIPPING_CONTACT = "slipping_contact"
    OPEN_CONTACT = "open_contact"
    AXES = "world_axes"
    GRAVITY = "gravity"
    FORCE_SCALE = "force_scale"

    @property
    def label(self) -> str:
        """In words, for legends."""
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
    Role.EXTERNAL_FORCE: "weight and other loads",
    Role.VIRTUAL_SLIDING: "virtual sliding",
    Role.SLIDING: "actual sliding",
    Role.STICKING_CONTACT: "sticking contact",
    Role.SLIPPING_CONTACT: "slipping contact",
    Role.OPEN_CONTACT: "open contact",
    Role.AXES: "world axes",
    Role.GRAVITY: "gravity",
    Role.FORCE_SCALE: "scale of forces",
}
_UNITS = {1.0: "1 m", 1e-2: "1 cm", 1e-3: "1 mm", 1e-6: "1 µm"}
_PREFIXES = {1e6: "MN", 1e3: "kN", 1.0: "N", 1e-3: "mN", 1e-6: "µN", 1e-9: "nN"}
_LEAST, _MOST = 0.01, 1e4  # N, said without a prefix
_UNITS_IN_SIZE = 2.0
HIDDEN_AT_FIRST = frozenset({Role.TOTAL_FORCE, Role.EXTERNAL_FORCE})
"""Layers that are shown when they are asked for: what other arrows sum up to."""


class ForceScale(NamedTuple):
    """How long forces are drawn, as maps state it: so many newtons to a length.

    Attributes:
        length: The length, m: a metre, centimetre, millimetre or micrometre.
        force: The force that is so long, N.
    """

    length: float
    force: float

    @classmethod
    def of(cls, metres_per_newton: float, size: float) -> ForceScale:
        """Return a scale, with a length that goes into the size of the object (m)."""
        fits = [unit for unit in _UNITS if _UNITS_IN_SIZE * unit <= size]
        unit = max(fits, default=min(_UNITS))
        return cls(unit, unit / metres_per_newton)

    @property
    def metres_per_newton(self) -> float:
        """How long one newton is, m."""
        return self.length / self.force

    def __str__(self) -> str:
        """Return it in words, such as "1 cm = 5 N"."""
        prefixes = [prefix for prefix in _PREFIXES if prefix <= self.force]
        prefix = max(prefixes, default=min(_PREFIXES))
        prefix = 1.0 if _LEAST <= self.force < _MOST else prefix
        return f"{_UNITS[self.length]} = {self.force / prefix:.3g} {_PREFIXES[prefix]}"


@dataclass(frozen=True, eq=False)
class Mark(Record):
    """A short text at a point.

    Attributes:
        text: The text: a contact's number, the letter of an axis.
        role: What it stands beside; it is seen where that is.
        position: (3,) read-only, world frame, m.
        contact: Index of the contact that it numbers; None: of none.
        words: What there is to say of it, a line each; the first names it.
    """

    text: str
    role: Role
    position: FloatArray
    contact: int | None = None
    words: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Mesh(Record):
    """Triangles of one thing, counterclockwise when seen from outside.

    See the example of `draw_scene`.

    Attributes:
        name: Unique in its picture; slashes make groups.
        role: What it stands for.
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
    """What there is to see, and what to look at. See the example of `draw_scene`.

    Attributes:
        meshes: All meshes.
        center: (3,) middle of what matters: the object and the hand around it, m.
        radius: Radius of a sphere around that, m.
        up: (3,) unit vector against gravity, world axes.
        view_from: (3,) unit vector from the center towards a good place to look from.
        views: Other such vectors by name: ``front``, ``side`` and ``top``.
        floors: (K, 4) planes (n, d) with n^T x >= d in front of them, from below which nobody
            looks: supports that the object may stand on.
        fingers: Names of the fingers, that of each mesh by its index.
        marks: Texts in the picture.
        force_scale: How long forces are; None: there are none.
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
