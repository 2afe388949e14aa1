"""The records of a picture: meshes with a role, and where to look."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from graspless_pin.geometry.pickling import Record
from graspless_pin.problem.checks import FloatArray


class Role(StrEnum):
    """What a mesh stands for; layers and colours go by it."""

    HAND = "hand"
    OBJECT = "object"
    SUPPORT = "support"
    CONTACT = "contact"
    CONE = "friction_cone"
    NORMAL_FORCE = "normal_force"
    FRICTION_FORCE = "friction_force"
    FRICTION_AT_LIMIT = "friction_at_limit"
    TOTAL_FORCE = "total_force"
    VIRTUAL_SLIDING = "virtual_sliding"
    SLIDING = "sliding"
    STICKING_CONTACT = "sticking_contact"
    SLIPPING_CONTACT = "slipping_contact"
    OPEN_CONTACT = "open_contact"

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
    Role.VIRTUAL_SLIDING: "virtual sliding",
    Role.SLIDING: "actual sliding",
    Role.STICKING_CONTACT: "sticking contact",
    Role.SLIPPING_CONTACT: "slipping contact",
    Role.OPEN_CONTACT: "open contact",
}


@dataclass(frozen=True, eq=False)
class Mesh(Record):
    """Triangles of one thing, counterclockwise when seen from outside.

    Attributes:
        name: Unique in its picture; slashes make groups.
        role: What it stands for.
        vertices: (V, 3) read-only, world frame, m.
        faces: (F, 3) read-only indices of vertices.
        opacity: 0 to 1.
        contact: Index of the contact that it belongs to; None: of none.
    """

    name: str
    role: Role
    vertices: FloatArray
    faces: NDArray[np.int64]
    opacity: float = 1.0
    contact: int | None = None


@dataclass(frozen=True, eq=False)
class Picture:
    """What there is to see, and what to look at.

    Attributes:
        meshes: All meshes.
        center: (3,) middle of what matters: the object and the hand around it, m.
        radius: Radius of a sphere around that, m.
        up: (3,) unit vector against gravity, world axes.
        view_from: (3,) unit vector from the center towards a good place to look from.
    """

    meshes: tuple[Mesh, ...]
    center: FloatArray
    radius: float
    up: FloatArray
    view_from: FloatArray

    def of(self, *roles: Role) -> tuple[Mesh, ...]:
        """Return the meshes of some roles."""
        return tuple(mesh for mesh in self.meshes if mesh.role in roles)
