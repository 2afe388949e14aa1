"""Friction cone models: the cross-section of the cones, and the kinetic friction.

The cone of a contact is the set of forces whose friction (t1^T f, t2^T f) lies in mu f_n times the
model's cross-section: a convex polygon around the normal, or the unit circle of Coulomb's cone.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray, finite_array, read_only
from graspless_pin.problem.matrices import kinetic_directions

_SECTION_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Section:
    """The cross-section of a friction cone where mu f_n is 1: a convex polygon around the normal.

    Attributes:
        corners: (r, 2) along t1 and t2, counterclockwise: one for each edge of the cone.
        directions: (2, r) unit outward normals of the sides; side m is between the corners m and
            m + 1.
        distances: (r,) distances of the sides from the normal.
    """

    corners: FloatArray
    directions: FloatArray
    distances: FloatArray

    @classmethod
    def with_corners(cls, corners: ArrayLike, name: str = "corners") -> Section:
        """Return the section with given (r, 2) corners; messages call them by ``name``.

        Raises:
            ArgumentError: If they are not a convex polygon around the normal, counterclockwise, or
                one is outside the unit circle: the coefficient is that of the direction with the
                most friction.
        """
        points = finite_array(name, corners, (None, 2))
        sides = np.roll(points, -1, axis=0) - points
        lengths = np.linalg.norm(sides, axis=1)
        if len(points) < 3 or not lengths.all():
            raise ArgumentError(name, "must be at least three distinct points")
        directions = np.stack([sides[:, 1], -sides[:, 0]]) / lengths
        distances = np.einsum("ij,ji->i", points, directions)
        if distances.min() <= 0.0 or (points @ directions - distances).max() > _SECTION_ROUNDING:
            raise ArgumentError(
                name, "must be the corners of a convex polygon around the normal, counterclockwise"
            )
        longest = float(np.linalg.norm(points, axis=1).max())
        if longest > 1.0 + _SECTION_ROUNDING:
            raise ArgumentError(
                name,
                f"are up to {longest:.6g} from the normal; they must be within 1, as the "
                "coefficient of friction is that of the direction with most friction",
            )
        return cls(points, read_only(directions), read_only(distances))

    def edges(self, friction: float) -> FloatArray:
        """Return the (3, r) unit edges of a cone in (n, t1, t2) coordinates, eq. (4)."""
        columns = np.vstack([np.ones(len(self.corners)), friction * self.corners.T])
        return columns / np.linalg.norm(columns, axis=0)

    def faces(self, friction: float | FloatArray) -> FloatArray:
        """Return the unit outward side-face normals in (n, t1, t2) coordinates, eq. (38).

        A force f is inside when h_m^T f <= 0, and -h_m^T f is its distance to face m, in newton.

        Args:
            friction: One coefficient, or (c,) coefficients of c cones.

        Returns:
            (3, r) columns h_m; (c, 3, r) for c cones.
        """
        slopes = np.asarray(friction)[..., None] * self.distances
        columns = np.empty((*slopes.shape[:-1], 3, slopes.shape[-1]))
        columns[..., 0, :] = -slopes
        columns[..., 1:, :] = self.directions
        columns /= np.sqrt(1.0 + slopes[..., None, :] ** 2)
        return columns

    def surface_distances(self, forces: FloatArray, friction: FloatArray) -> FloatArray:
        """Return the distance of forces to the nearest face of their cones, min of -h_m^T f, N.

        Args:
            forces: (c, 3) along n, t1, t2, N.
            friction: (c,) coefficients.

        Returns:
            (c,), negative outside.
        """
        slopes = friction[:, None] * self.distances
        rooms = slopes * forces[:, :1] - forces[:, 1:] @ self.directions
        return np.minimum.reduce(rooms / np.sqrt(1.0 + slopes**2), axis=1)


class ConeModel(ABC):
    """A friction cone model: `problem.cones.CONE_MODELS` lists all by name.

    A model of flat faces needs a name, a description, and the corners of its cross-section. The
    other attributes and `kinetic_friction` are optional; without them an error or an undecided
    verdict says what is missing.
    """

    name: ClassVar[str]
    """Its name in scene files and `QuasistaticProblem`."""
    about: ClassVar[str]
    """Its description in the published schema."""
    is_coulomb: ClassVar[bool] = False
    """Whether it represents Coulomb's law, friction of the same size in all directions."""
    second_order: ClassVar[bool] = False
    """Whether it is the round cone, which its section only approximates, for pictures."""
    regular: ClassVar[bool] = False
    """Whether it is the regular pyramid that compiled loops implement."""

    @abstractmethod
    def corners(self, edges: int) -> ArrayLike:
        """Return (r, 2) corners of the cross-section where mu f_n is 1, see `Section`.

        Along t1 and t2, of the friction on the object. The section need not be symmetric: then the
        sense of t1 (`tangent_axes`) matters.

        Args:
            edges: The problem's `cone_edges`.
        """

    def section(self, edges: int) -> Section:
        """Return the cross-section, computed once for each number of edges."""
        return _cached_section(self, edges)

    def words(self, edges: int) -> str:
        """Return a description of the cones for messages."""
        return f"{self.name} cones of {len(self.section(edges).corners)} edges"

    def signature(self, edges: int) -> str:
        """Return a text that is unique to this model and number of edges."""
        return f"{self.name} {edges}"

    @property
    def no_verdict(self) -> str:
        """Why this model allows no verdict on the actual motion; empty if it does."""
        if self.is_coulomb:
            return ""
        return f"undecided: a verdict requires Coulomb's law, and the cone is '{self.name}'"

    def surface_distances(self, forces: FloatArray, friction: FloatArray, edges: int) -> FloatArray:
        """Return distances of forces to the surfaces of their cones, as of a `Section`."""
        return self.section(edges).surface_distances(forces, friction)

    def friction_sizes(self, friction: FloatArray, edges: int) -> FloatArray:
        """Return (c,) sizes of friction (c, 2) along t1 and t2, N; mu f_n is the largest."""
        if self.is_coulomb:
            return np.linalg.norm(friction, axis=1)
        section = self.section(edges)
        return np.maximum.reduce(friction @ section.directions / section.distances, axis=1)

    def kinetic_friction(self, directions: FloatArray) -> FloatArray:
        """Return the kinetic friction where mu f_n is 1; models of Coulomb's law need none.

        By the principle of maximum dissipation it is the friction inside the cone that takes the
        most power from the sliding.

        Args:
            directions: (c, 2) unit directions along t1, t2 in which the object slides.

        Returns:
            (c, 2) along t1 and t2.

        Raises:
            ArgumentError: If the model does not define it.
        """
        raise ArgumentError(
            "cone",
            f"is '{self.name}', which does not define the kinetic friction of sliding contacts; "
            "use another cone, or leave out the motion",
        )

    def kinetic_directions(
        self,
        normals: FloatArray,
        tangents: FloatArray,
        friction: FloatArray,
        sliding: FloatArray,
        without_cone: NDArray[np.bool_],
    ) -> FloatArray:
        """Return (M, 3) the force per newton of normal force where there is no cone, else zeros.

        Args:
            normals: (M, 3) unit normals.
            tangents: (M, 3, 2) unit tangents.
            friction: (M,) coefficients.
            sliding: (M, 3) sliding velocities; n alone where they are zero.
            without_cone: (M,) contacts without a cone.

        Raises:
            ArgumentError: If the model does not define kinetic friction, or if it drives the
                sliding or is larger than the coefficient allows.
        """
        if self.is_coulomb:
            return kinetic_directions(normals, friction, sliding, without_cone)
        directions = np.where(without_cone[:, None], normals, 0.0)
        sliding_contacts = np.flatnonzero(without_cone & sliding.any(axis=1) & (friction > 0.0))
        if len(sliding_contacts):
            v = np.einsum("mji,mj->mi", tangents[sliding_contacts], sliding[sliding_contacts])
            v /= np.linalg.norm(v, axis=1, keepdims=True)
            kinetic = self.kinetic_friction(v)
            power = np.einsum("mi,mi->m", v, kinetic)
            if power.max() > 0.0 or np.linalg.norm(kinetic, axis=1).max() > 1.0 + _SECTION_ROUNDING:
                raise ArgumentError(
                    "cone",
                    f"is '{self.name}', whose kinetic friction must oppose sliding and be at "
                    f"most 1; it is {kinetic.tolist()!r:.100} for directions {v.tolist()!r:.100}",
                )
            directions[sliding_contacts] += np.einsum(
                "mij,mj->mi", tangents[sliding_contacts], friction[sliding_contacts, None] * kinetic
            )
        return read_only(directions)


@cache
def _cached_section(model: ConeModel, edges: int) -> Section:
    return Section.with_corners(model.corners(edges), f"corners of the cone '{model.name}'")
