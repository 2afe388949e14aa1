"""Colours by role, for light and dark backgrounds, told apart by colour-blind readers as well.

What carries meaning has the hues of Okabe and Ito's set; hand, object and supports are muted. The
fingers differ in lightness, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from graspless_pin.visualization.picture import Mesh, Role


@dataclass(frozen=True)
class Palette:
    """Colours of one background. See the example of `draw_scene`.

    Attributes:
        background: ``#rrggbb``.
        text: ``#rrggbb``, to be read on the background.
        roles: ``#rrggbb`` by role.
        fingers: ``#rrggbb`` of fingers in turn; more of them begin again.
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
            Role.EXTERNAL_FORCE: "#b0284f",
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
            Role.EXTERNAL_FORCE: "#ff5c74",
            Role.AXES: "#c3c8ce",
            Role.GRAVITY: "#ff8a9a",
            Role.FORCE_SCALE: "#8fc4f2",
        }
    ),
    fingers=("#c79c66", "#8f4238", "#b3e6ac", "#8560a0", "#dccaea"),
)
"""Colours on dark grey."""
