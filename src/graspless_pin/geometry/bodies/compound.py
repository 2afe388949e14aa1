"""Several shapes as those of one rigid body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.meshes import MOST_FACES, Triangles
from graspless_pin.geometry.bodies.shape import Filling, Shape
from graspless_pin.geometry.bodies.shapes import HalfSpace
from graspless_pin.geometry.poses import as_pose, transformed
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.records import PickledByFields


@dataclass(frozen=True, eq=False)
class Compound(PickledByFields, Shape):
    """Shapes at poses in one frame, as the geoms of a body in MuJoCo are.

    Attributes:
        parts: S bounded shapes.
        poses: (S, 4, 4) of each in the frame of the compound, m.

    Examples:
        >>> import numpy as np
        >>> from graspless_pin.geometry import Box, Compound, Cylinder
        >>> head, handle = Box((0.08, 0.03, 0.03)), Cylinder(0.01, 0.2)  # m
        >>> T_head = np.eye(4)
        >>> T_head[2, 3] = 0.115  # m
        >>> hammer = Compound((head, handle), [T_head, np.eye(4)])
        >>> print(f"{1e6 * hammer.filling().volume:.0f} cm^3")
        135 cm^3
    """

    kind = "compound"
    parts: tuple[Shape, ...]
    poses: FloatArray

    def __post_init__(self) -> None:
        """Check the parts and copy the poses.

        Raises:
            ArgumentError: There is no part, one has no end, or a pose is not rigid.
        """
        object.__setattr__(self, "parts", tuple(self.parts))
        if not self.parts or any(isinstance(part, HalfSpace) for part in self.parts):
            raise ArgumentError("parts", "needs at least one shape, none of them a half-space")
        if len(self.poses) != len(self.parts):
            raise ArgumentError("poses", f"needs one for each of {len(self.parts)} parts")
        poses = [as_pose(f"poses[{k}]", T) for k, T in enumerate(self.poses)]
        object.__setattr__(self, "poses", read_only(np.array(poses)))

    @cached_property
    def _pieces(self) -> tuple[tuple[Any, ...], ...]:
        return tuple(part.pieces() for part in self.parts)

    def pieces(self) -> tuple[Any, ...]:
        """Make the coal geometries of all parts, each in the part's own frame."""
        return tuple(piece for own in self._pieces for piece in own)

    def placements(self) -> FloatArray:
        """Return the (K, 4, 4) poses of the pieces."""
        return np.repeat(self.poses, [len(own) for own in self._pieces], axis=0)

    def filling(self) -> Filling:
        """Return volume, centroid and inertia per mass; where parts overlap, both count."""
        fillings = [part.filling() for part in self.parts]
        volumes = np.array([one.volume for one in fillings])
        shares = volumes / volumes.sum()
        turns = self.poses[:, :3, :3]
        centers = np.array(
            [transformed(T, one.centroid) for T, one in zip(self.poses, fillings, strict=True)]
        )
        centroid = shares @ centers
        gyration = np.zeros((3, 3))
        for share, R, one, arm in zip(shares, turns, fillings, centers - centroid, strict=True):
            steiner = arm @ arm * np.eye(3) - np.outer(arm, arm)
            gyration += share * (R @ one.gyration @ R.T + steiner)
        return Filling(float(volumes.sum()), read_only(centroid), read_only(gyration))

    def surface(self, max_faces: int = MOST_FACES) -> Triangles:
        """Return the surfaces of all parts."""
        most = max(max_faces // len(self.parts), 1)
        each = [part.surface(most).moved(T) for part, T in zip(self.parts, self.poses, strict=True)]
        starts = np.cumsum([0, *(len(one.vertices) for one in each)])
        faces = [one.faces + start for one, start in zip(each, starts, strict=False)]
        return Triangles(np.vstack([one.vertices for one in each]), np.vstack(faces))

    def stated(self, path_text: Callable[[Path], str]) -> dict[str, Any]:
        """Return what a scene file says of it: see `Shape.stated`."""
        placed = zip(self.parts, self.poses, strict=True)
        return {
            "type": self.kind,
            "parts": [
                {
                    "shape": part.stated(path_text),
                    "pose": {"position": T[:3, 3], "matrix": T[:3, :3]},
                }
                for part, T in placed
            ],
        }
