"""Contact forces as program variables: their coordinates, and constraints common to all modes.

The unknown is not the edge weights k of (44) and (45) but the force itself, in contact
coordinates: x_l = (n^T f, t1^T f, t2^T f) / F where there is a friction cone, and n^T f / F alone
where the direction is known (actual sliding, no friction). F is the load, see `problem.scales`.
Then C k with k >= 0 becomes H^T f <= 0, (27) fixes variables at zero and (31) bounds them
(`Formulation.opposing`), so all modes of a problem differ in bounds only.

A planner or a study solves thousands of problems with friction cones at the same contacts. The
layout of their force coordinates among the columns is computed once, and so are the rows that keep
forces a margin away from the surface of their cones: they are shared, read-only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.cone_model import ConeModel, Section
from graspless_pin.problem.quasistatic import contact_map
from graspless_pin.problem.scales import Strictness, passive_levers
from graspless_pin.programs.program import FARTHEST

NARROW = 1e-3
"""Friction below which the tolerance of a cone's faces allows too negative normal forces."""
_RIGHT_ANGLE = 1e-6
"""Largest cosine at which a sliding direction counts as orthogonal to a tangent."""
_FRAME = np.arange(3)
_LAYOUTS_KEPT = 16


@dataclass(frozen=True, eq=False)
class ForceLayout:
    """Columns of the n force coordinates: three for a contact with a cone, one for any other.

    Attributes:
        size: n.
        normal_columns: (M,) column of each contact's normal coordinate.
        tangent_columns: (M, 2) columns of t1 and t2; -1 where there is no cone.
        cones: (c,) indices of the contacts with a cone.
        friction_columns: (c, 2) their columns of t1 and t2.
        without_cone: (M,) bool, contacts without one.
        owner: (n,) contact of each column.
        axes: (n,) index of each column's axis in the (3M,) sequence of the contacts' n, t1, t2.
        places: (n, 3) flat indices of each column's entries in the (3M, n) basis.
        normal_rows: (M, n) with n^T f / F = normal_rows x.
    """

    size: int
    normal_columns: NDArray[np.int_]
    tangent_columns: NDArray[np.int_]
    cones: NDArray[np.int_]
    friction_columns: NDArray[np.int_]
    without_cone: NDArray[np.bool_]
    owner: NDArray[np.int_]
    axes: NDArray[np.int_]
    places: NDArray[np.int_]
    normal_rows: FloatArray


@lru_cache(maxsize=_LAYOUTS_KEPT)
def layout_of(mask: bytes) -> ForceLayout:
    """Return the layout of the force coordinates of a problem.

    Args:
        mask: Bytes of the problem's `has_cone`.
    """
    has_cone = np.frombuffer(mask, dtype=np.bool_)
    widths = np.where(has_cone, 3, 1)
    normal_columns = np.cumsum(widths) - widths
    size = int(widths.sum())
    cones = np.flatnonzero(has_cone)
    owner = np.repeat(np.arange(len(widths)), widths)
    places = (3 * owner[:, None] + _FRAME) * size + np.arange(size)[:, None]
    normal_rows = np.zeros((len(widths), size))
    normal_rows[np.arange(len(widths)), normal_columns] = 1.0
    arrays = {
        "normal_columns": normal_columns,
        "tangent_columns": np.where(has_cone[:, None], normal_columns[:, None] + _FRAME[1:], -1),
        "cones": cones,
        "friction_columns": normal_columns[cones, None] + _FRAME[1:],
        "without_cone": ~has_cone,
        "owner": owner,
        "axes": 3 * owner + np.arange(size) - normal_columns[owner],
        "places": places,
        "normal_rows": normal_rows,
    }
    arrays = {name: read_only(array) for name, array in arrays.items()}
    return ForceLayout(size, **arrays)


@dataclass(frozen=True, eq=False)
class ConeRows:
    """Rows of all friction cones of a problem.

    Attributes:
        name: Name of their block.
        second_order: Whether there are three rows per cone, the first of which must be at least the
            length of the two others (rows x - margin e >= 0 in that order); otherwise each row is
            one side face, rows x + margin e <= 0 (42).
        rows: (k, n) coefficients of the forces.
        margin: (k,) coefficients of the margin e.
        owner: (k,) contact of each row.
        shape: Shape of their multipliers by contact.
        places: (k,) flat index of each row in that shape.
    """

    name: str
    second_order: bool
    rows: FloatArray
    margin: FloatArray
    owner: NDArray[np.int_]
    shape: tuple[int, int]
    places: NDArray[np.int_]


def face_rows(layout: ForceLayout, friction: FloatArray, section: Section) -> ConeRows:
    """Return the side faces of cones, h_m^T f + e <= 0 (42).

    Args:
        layout: Columns of the force coordinates.
        friction: (c,) coefficients of the contacts with a cone.
        section: Cross-section of all cones.
    """
    cones, edges = layout.cones, len(section.corners)
    faces = np.zeros((len(cones), edges, layout.size))
    columns = layout.normal_columns[cones, None] + _FRAME
    faces[np.arange(len(cones))[:, None], :, columns] = section.faces(friction)
    rows = np.asfortranarray(faces.reshape(-1, layout.size))
    return _stacked_cone_rows("faces", rows, np.ones(len(rows)), layout, edges)


def round_cones(layout: ForceLayout, friction: FloatArray) -> ConeRows:
    """Return Coulomb's cones as second-order cones, |f_t| <= mu f_n - sqrt(1 + mu^2) e.

    Args:
        layout: Columns of the force coordinates.
        friction: (c,) coefficients of the contacts with a cone.
    """
    cones = layout.cones
    rows = np.zeros((len(cones), 3, layout.size))
    columns = layout.normal_columns[cones, None] + _FRAME
    rows[np.arange(len(cones))[:, None], _FRAME, columns] = 1.0
    rows[:, 0] *= friction[:, None]
    margin = np.zeros((len(cones), 3))
    margin[:, 0] = np.sqrt(1.0 + friction**2)
    flat = np.asfortranarray(rows.reshape(-1, layout.size))
    return _stacked_cone_rows("round_cones", flat, margin.ravel(), layout, 3, second_order=True)


def _stacked_cone_rows(
    name: str,
    rows: FloatArray,
    margin: FloatArray,
    layout: ForceLayout,
    rows_per_cone: int,
    *,
    second_order: bool = False,
) -> ConeRows:
    """Return the rows of a cone model with the same number of rows for each cone."""
    places = (layout.cones[:, None] * rows_per_cone + np.arange(rows_per_cone)).ravel()
    owner, shape = (
        np.repeat(layout.cones, rows_per_cone),
        (len(layout.normal_columns), rows_per_cone),
    )
    return ConeRows(name, second_order, read_only(rows), read_only(margin), owner, shape, places)


@lru_cache(maxsize=_LAYOUTS_KEPT)
def cone_rows(model: ConeModel, mask: bytes, friction: bytes, edges: int) -> ConeRows:
    """Return the rows of a problem's friction cones.

    Args:
        model: The problem's `cone_model`.
        mask: Bytes of its `has_cone`.
        friction: Bytes of its `friction`.
        edges: Its `cone_edges`.
    """
    layout = layout_of(mask)
    coefficients = np.frombuffer(friction)[layout.cones]
    if model.second_order:
        return round_cones(layout, coefficients)
    return face_rows(layout, coefficients, model.section(edges))


@lru_cache(maxsize=_LAYOUTS_KEPT)
def unit_force_bounds(mask: bytes, friction: bytes) -> FloatArray:
    """Return (2, n) bounds of forces inside cones, in units of the normal-force limits.

    Args:
        mask: Bytes of the problem's `has_cone`.
        friction: Bytes of its `friction`.
    """
    layout = layout_of(mask)
    coefficients, columns = np.frombuffer(friction)[layout.cones, None], layout.friction_columns
    reach = np.zeros((2, layout.size))
    reach[1, layout.normal_columns] = 1.0
    reach[1, columns], reach[0, columns] = coefficients, -coefficients
    return read_only(reach)


@dataclass(frozen=True, eq=False)
class ForceCoordinates:
    """The map from scaled contact coordinates to forces. See the example of `Torque`.

    Attributes:
        directions: (M, 3, 3) rows n, t1, t2 of each contact; the first is the force per newton of
            normal force where there is no cone.
        layout: Columns of the coordinates.
        force_scale: F, the load, N.
        joint_scale: (L,) torques that the load makes on each joint, N m, for the torque rows.
        length_scale: Size of the contact arrangement, m, for the moment rows.
        strictness: Factors by which the tolerances of limits are smaller; None: none is.
    """

    directions: FloatArray
    layout: ForceLayout
    force_scale: float
    joint_scale: FloatArray
    length_scale: float
    strictness: Strictness | None

    @cached_property
    def torque_scale(self) -> float:
        """The largest joint scale, N m: the unit of Algorithm 2's largest torque."""
        return float(np.maximum.reduce(self.joint_scale, initial=0.0)) or self.force_scale

    @cached_property
    def basis(self) -> FloatArray:
        """(3M, n) with f = F basis x."""
        layout = self.layout
        basis = np.zeros((3 * len(layout.normal_columns), layout.size))
        basis.put(layout.places, self.directions.reshape(-1, 3)[layout.axes])
        return read_only(basis)

    @property
    def normal_columns(self) -> NDArray[np.int_]:
        """(M,) column of each contact's normal coordinate."""
        return self.layout.normal_columns

    @property
    def tangent_columns(self) -> NDArray[np.int_]:
        """(M, 2) columns of t1 and t2; -1 where there is no cone."""
        return self.layout.tangent_columns

    def curvature(self, epsilon: float) -> FloatArray:
        """Return the (n,) diagonal of the quadratic term (epsilon / 2) |f / F|^2."""
        return epsilon * (self.basis**2).sum(axis=0)

    def scaled(self, forces: FloatArray) -> FloatArray:
        """Return the (n,) coordinates of (M, 3) contact forces, N."""
        return self.basis.T @ forces.ravel() / ((self.basis**2).sum(axis=0) * self.force_scale)

    def forces(self, x: FloatArray) -> FloatArray:
        """Return the (M, 3) contact forces of a program's solution, N."""
        layout, count = self.layout, len(self.directions)
        local = np.zeros(3 * count)
        local[layout.axes] = x[: layout.size]
        local *= self.force_scale
        return (local.reshape(count, 1, 3) @ self.directions).reshape(count, 3)


def force_coordinates(problem: QuasistaticProblem, margin: float = 0.0) -> ForceCoordinates:
    """Return the force coordinates of a problem, scaled by its load.

    Args:
        problem: The problem.
        margin: Required margin, N: the scale of a problem without a load, if large enough.
    """
    layout, scales = layout_of(problem.has_cone.tobytes()), problem.scales
    strict = problem.strictness
    if margin > 0.0 and not problem.external_wrench.any():
        scales = scales.without_load(margin)
        strict = problem.strictness_in(scales)
    directions = problem.frames.swapaxes(1, 2)
    if len(layout.cones) < problem.contact_count:
        directions = directions.copy()
        np.copyto(directions[:, 0], problem.kinetic_directions, where=layout.without_cone[:, None])
    force, length, joints = scales
    return ForceCoordinates(directions, layout, force, joints, length, strict)


def component_row(
    problem: QuasistaticProblem, coordinates: ForceCoordinates, contact: int, component: int
) -> FloatArray:
    """Return the (n,) row that maps scaled coordinates to f_n, f_t1 or f_t2, over F.

    Without friction, or along a tangent orthogonal to the sliding, the friction is zero, however
    large the normal force is: a cosine within rounding of zero counts as zero.

    Args:
        problem: The problem.
        coordinates: Its force coordinates.
        contact: Index of the contact.
        component: 0, 1 or 2 for f_n, f_t1, f_t2.
    """
    row, column = np.zeros(coordinates.layout.size), coordinates.normal_columns[contact]
    if component == 0 or problem.has_cone[contact]:
        row[column + component] = 1.0
        return row
    kinetic = problem.kinetic_directions[contact] - problem.normals[contact]
    tangential = float(problem.tangents[contact, :, component - 1] @ kinetic)
    if abs(tangential) > _RIGHT_ANGLE * problem.friction[contact]:
        row[column] = tangential
    return row


@dataclass(frozen=True, eq=False)
class ForceRows:
    """The constraints on scaled contact coordinates x from which programs are built.

    See the example of `Torque`.

    Attributes:
        problem: The problem.
        coordinates: Its force coordinates.
        cones: Rows of the friction cones.
        reach: (2, n) bounds of forces inside cones, in units of the normal-force limits.
        limit: (M,) normal-force limits f_n,max / F.
        balance_rows: (P, n) W f / F, moment rows over the length scale.
        wrench: (P,) right-hand side of the balance (19).
        weight: (P,) scale of each balance row: 1, or 1 over the length scale.
        torque_rows: (L, n) J^T f / joint scale (18).
        lower: (L,) lower torque limits less gravity, over the joint scale.
        upper: (L,) upper torque limits less gravity, over the joint scale.
        gravity: (L,) g / joint scale.
        boxes: Bounds (2, n) implied by cones and limits, 0 <= n^T f <= limit and
            |t^T f| <= mu limit. With a limit above 1e8 F there are two boxes: one cut at 1e8 F, for
            proofs of bounds, and the uncut one, for proofs of infeasibility.
    """

    problem: QuasistaticProblem
    coordinates: ForceCoordinates
    cones: ConeRows
    reach: FloatArray
    limit: FloatArray
    balance_rows: FloatArray
    wrench: FloatArray
    weight: FloatArray
    torque_rows: FloatArray
    lower: FloatArray
    upper: FloatArray
    gravity: FloatArray
    boxes: tuple[FloatArray, ...]

    @property
    def size(self) -> int:
        """n, the number of force coordinates."""
        return self.coordinates.layout.size

    @property
    def normal_rows(self) -> FloatArray:
        """(M, n) n^T f / F."""
        return self.coordinates.layout.normal_rows

    @property
    def held_above_zero(self) -> NDArray[np.bool_]:
        """(M,) contacts without a cone, or with a narrow one: they need the bound n^T f >= 0.

        A tolerance of a cone's faces h^T f <= 0 is one of n^T f >= 0 divided by the friction.
        """
        return self.without_cone | (self.problem.friction < NARROW)

    @property
    def without_cone(self) -> NDArray[np.bool_]:
        """(M,) contacts without a cone, which would imply n^T f >= e."""
        return self.coordinates.layout.without_cone

    def cone_box(self, reach: float) -> FloatArray:
        """Return (2, n) bounds of forces inside cones with normal components up to ``reach``."""
        return reach * self.reach


def force_rows(problem: QuasistaticProblem, coordinates: ForceCoordinates) -> ForceRows:
    """Return the constraints of a problem in its force coordinates."""
    mask, friction = problem.has_cone.tobytes(), problem.friction.tobytes()
    reach = unit_force_bounds(mask, friction)
    force, joints = coordinates.force_scale, coordinates.joint_scale
    limit = problem.max_normal_force / force
    weight = 1.0 / passive_levers(problem.passive_units, coordinates.length_scale)
    passive = len(weight)
    effects = _unit_force_effects(problem, coordinates)
    uncut = reach * limit[coordinates.layout.owner]
    boxes = (uncut,)
    if limit.max() > FARTHEST:
        boxes = reach * np.minimum(limit, FARTHEST)[coordinates.layout.owner], uncut
    return ForceRows(
        problem=problem,
        coordinates=coordinates,
        cones=cone_rows(problem.cone_model, mask, friction, problem.cone_edges),
        reach=reach,
        limit=limit,
        balance_rows=(effects[:, :passive] * weight).T,
        wrench=-weight * problem.external_wrench / force,
        weight=weight,
        torque_rows=(effects[:, passive:] * (force / joints)).T,
        lower=(problem.lower_torque - problem.gravity_torques) / joints,
        upper=(problem.upper_torque - problem.gravity_torques) / joints,
        gravity=problem.gravity_torques / joints,
        boxes=boxes,
    )


def _unit_force_effects(problem: QuasistaticProblem, coordinates: ForceCoordinates) -> FloatArray:
    """(n, P + L) wrench and joint torques per unit of each coordinate: [W, J]^T basis."""
    layout, contact_maps = coordinates.layout, contact_map(problem)
    effects: FloatArray = contact_maps.reshape(-1, contact_maps.shape[2])[layout.axes]
    if len(layout.cones) < len(contact_maps):
        without_cone = layout.without_cone
        kinetic = problem.kinetic_directions[without_cone, None] @ problem.frames[without_cone]
        effects[layout.normal_columns[without_cone]] = (kinetic @ contact_maps[without_cone])[:, 0]
    return effects


def force_reach(problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
    """Return the largest normal force up to which bounds are proven, N."""
    return min(max(problem.max_normal_force.tolist()), FARTHEST * coordinates.force_scale)
