"""Algorithms 1 and 2 in contact forces: the matrices that every mode of a problem shares.

The unknown is not the edge weights k of (44) and (45) but the force itself, in contact
coordinates: x_l = (n^T f, t1^T f, t2^T f) / F where there is a friction cone, and n^T f / F alone
where the direction is known (actual sliding, no friction). F is the largest normal-force limit.
Then C k with k >= 0 becomes H^T f <= 0, (27) fixes variables at zero and (31) bounds them, so all
modes of a problem differ in bounds only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled import contact_frames, linear_programs
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only, squared_lengths
from graspless_pin.problem.contact_map import contact_map
from graspless_pin.programs.force_layout import ConeRows, ForceLayout, cone_rows, layout_of
from graspless_pin.programs.program import Program

_BALANCE = 6
"""Rows of the balance (19), which come first in every program."""


@dataclass(frozen=True, eq=False)
class ForceCoordinates:
    """The map from scaled contact coordinates to forces.

    Attributes:
        directions: (M, 3, 3) rows n, t1, t2 of each contact; the first is the force per newton of
            normal force where there is no cone.
        layout: Where the coordinates stand.
        force_scale: F, the largest normal-force limit, N.
        torque_scale: The largest finite torque limit (or, without one, the largest torque that
            the contacts can make), N m.
        length_scale: Size of the contact arrangement, m, for the moment rows.
    """

    directions: FloatArray
    layout: ForceLayout
    force_scale: float
    torque_scale: float
    length_scale: float

    @cached_property
    def basis(self) -> FloatArray:
        """(3M, n) with f = F basis x."""
        layout = self.layout
        basis = np.zeros((3 * len(layout.normal), layout.size))
        basis.put(layout.places, self.directions.reshape(-1, 3)[layout.axes])
        return read_only(basis)

    @property
    def normal(self) -> NDArray[np.int_]:
        """(M,) column of each contact's normal coordinate."""
        return self.layout.normal

    @property
    def tangent(self) -> NDArray[np.int_]:
        """(M, 2) columns of t1 and t2; -1 where there is no cone."""
        return self.layout.tangent

    def forces(self, x: FloatArray) -> FloatArray:
        """Return the (M, 3) contact forces of a program's solution, N."""
        layout, count = self.layout, len(self.directions)
        if contact_frames is not None:
            return contact_frames.forces(x, layout.axes, self.directions, self.force_scale)
        local = np.zeros(3 * count)
        local[layout.axes] = x[: layout.size]
        local *= self.force_scale
        return (local.reshape(count, 1, 3) @ self.directions).reshape(count, 3)


def force_coordinates(problem: QuasistaticProblem) -> ForceCoordinates:
    """Choose coordinates and scales for a problem."""
    layout = layout_of(problem)
    force = max(problem.max_normal_force.tolist())
    torque = max(_largest_finite(problem.lower_torque), _largest_finite(problem.upper_torque))
    if torque == 0.0:
        reach = force * np.abs(problem.jacobian).sum(axis=0).max(initial=0.0)
        torque = float(reach) or 1.0
    length = math.sqrt(max(squared_lengths(problem.positions).tolist())) or 1.0
    return ForceCoordinates(_directions(problem, layout), layout, force, torque, length)


def _largest_finite(values: FloatArray) -> float:
    """The largest size of a finite entry, 0 without any."""
    if linear_programs is not None:
        return linear_programs.largest_finite(values)
    return max([abs(value) for value in values.tolist() if math.isfinite(value)], default=0.0)


def _directions(problem: QuasistaticProblem, layout: ForceLayout) -> FloatArray:
    """(M, 3, 3) see `ForceCoordinates`."""
    if contact_frames is not None:
        return contact_frames.force_directions(
            problem.normals, problem.tangents, problem.friction, problem.sliding, problem.has_cone
        )
    directions = problem.frames.swapaxes(1, 2)
    if len(layout.cones) < problem.contact_count:
        directions = directions.copy()
        np.copyto(directions[:, 0], problem.kinetic_directions, where=layout.bare[:, None])
    return directions


class ForceRows(NamedTuple):
    """The constraints on scaled contact coordinates x that every program is made of.

    Attributes:
        faces: (k, n) side faces of the cones: faces x <= -e (42).
        normal: (M, n) picks n^T f / F.
        limit: (M,) f_n,max / F.
        bare: (M,) bool, contacts without a cone: there the side faces do not imply n^T f >= e.
        balance: (6, n) W f / F, moment rows over the length scale.
        wrench: (6,) right-hand side of the balance (19).
        weight: (6,) scale of each balance row: 1, or 1 over the length scale.
        torque: (L, n) J^T f / torque scale (18).
        lower: (L,) lower torque limits less gravity, scaled.
        upper: (L,) upper torque limits less gravity, scaled.
        gravity: (L,) g / torque scale.
        box: (2, n) bounds of forces inside cones: 0 <= n^T f <= limit, |t^T f| <= mu limit.
    """

    faces: FloatArray
    normal: FloatArray
    limit: FloatArray
    bare: NDArray[np.bool_]
    balance: FloatArray
    wrench: FloatArray
    weight: FloatArray
    torque: FloatArray
    lower: FloatArray
    upper: FloatArray
    gravity: FloatArray
    box: FloatArray

    @property
    def size(self) -> int:
        """n, the number of force coordinates."""
        return self.balance.shape[1]


def force_rows(problem: QuasistaticProblem, coordinates: ForceCoordinates) -> ForceRows:
    """Assemble the constraints of a problem in its force coordinates."""
    layout, shared = coordinates.layout, cone_rows(problem)
    force, torque = coordinates.force_scale, coordinates.torque_scale
    limit = problem.max_normal_force / force
    weight = np.ones(6)
    weight[3:] = 1.0 / coordinates.length_scale
    effects = _effects(problem, coordinates)
    return ForceRows(
        faces=shared.faces,
        normal=shared.normal,
        limit=limit,
        bare=layout.bare,
        balance=(effects[:, :6] * weight).T,
        wrench=-weight * problem.external_wrench / force,
        weight=weight,
        torque=(effects[:, 6:] * (force / torque)).T,
        lower=(problem.lower_torque - problem.gravity_torques) / torque,
        upper=(problem.upper_torque - problem.gravity_torques) / torque,
        gravity=problem.gravity_torques / torque,
        box=shared.reach * limit[layout.owner],
    )


def _effects(problem: QuasistaticProblem, coordinates: ForceCoordinates) -> FloatArray:
    """(n, 6 + L) wrench and joint torques of a unit of each coordinate: [W, J]^T basis."""
    layout, local = coordinates.layout, contact_map(problem)
    effects: FloatArray = local.reshape(-1, local.shape[2])[layout.axes]
    if len(layout.cones) < len(local):
        bare = layout.bare
        kinetic = problem.kinetic_directions[bare, None] @ problem.frames[bare]
        effects[layout.normal[bare]] = (kinetic @ local[bare])[:, 0]
    return effects


def margin_program(
    problem: QuasistaticProblem, coordinates: ForceCoordinates, regularization: float
) -> Program:
    """Algorithm 1 (44) without (27) and (31): minimise -e/F + (eps/2) |f/F|^2.

    The margin e is the last variable and may become negative: a negative optimum says by how much
    the cones would have to be widened, and its dual proves that no force set exists.
    """
    shared = cone_rows(problem)
    rows, low, high, box = _margin_rows(problem, coordinates, shared)
    return Program.of_rows(
        rows,
        _BALANCE,
        low,
        high,
        linear=regularization == 0.0,
        P=_quadratic(coordinates, shared, regularization),
        c=shared.last[0],
        lb=shared.free[0],
        ub=shared.free[1],
        # The box speaks of forces inside their cones, that is of e >= 0: what it proves, it
        # proves of those, and a proven bound above zero on -e proves that there are none.
        box=box,
    )


def _margin_rows(
    problem: QuasistaticProblem, coordinates: ForceCoordinates, shared: ConeRows
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The rows of Algorithm 1, their lower and upper sides, and the box."""
    if linear_programs is not None:
        columns, low, high, box = linear_programs.margin_program(
            problem.positions,
            coordinates.directions,
            problem.jacobian,
            coordinates.layout.axes,
            shared.sides.T,
            len(shared.faces),
            shared.reach,
            problem.max_normal_force,
            problem.external_wrench,
            problem.lower_torque,
            problem.upper_torque,
            problem.gravity_torques,
            coordinates.force_scale,
            coordinates.torque_scale,
            coordinates.length_scale,
        )
        return columns.T, low, high, box
    rows = force_rows(problem, coordinates)
    size, sides = rows.size, _BALANCE + len(shared.sides)
    stack = _stack(rows, sides + len(rows.torque))
    stack[_BALANCE:sides] = shared.sides
    stack[sides:, :size] = rows.torque
    stack[sides:, size] = 0.0
    faces = np.zeros(len(rows.faces))
    low = np.concatenate([rows.wrench, shared.below, rows.lower])
    high = np.concatenate([rows.wrench, faces, rows.limit, shared.low, rows.upper])
    return stack, low, high, _widened(rows.box, float(rows.limit.min()) / 2.0)


def torque_program(
    problem: QuasistaticProblem,
    coordinates: ForceCoordinates,
    margin: float,
    regularization: float,
    *,
    by_limits: bool,
) -> Program:
    """Algorithm 2 (45) without (27) and (31): minimise t + (eps/2) |f/F|^2 at a required margin.

    The last variable t is the largest |torque| in units of the torque scale, or the largest share
    of any joint's own limit when ``by_limits``. The motors' torques J^T f + g obey their limits.
    """
    rows, shared = force_rows(problem, coordinates), cone_rows(problem)
    size, torque, gravity = rows.size, rows.torque, rows.gravity
    e = margin / coordinates.force_scale
    up = down = np.ones(len(torque), dtype=bool)
    unit_up = unit_down = np.ones(len(torque))
    if by_limits:
        # The share of a limit is counted on the side where the torque is; a limit of zero, or
        # one on the wrong side of zero, stays a hard row and has no share.
        scale = coordinates.torque_scale
        unit_up, unit_down = problem.upper_torque / scale, -problem.lower_torque / scale
        up = np.isfinite(unit_up) & (unit_up > 0.0)
        down = np.isfinite(unit_down) & (unit_down > 0.0)
        unit_up, unit_down = unit_up[up], unit_down[down]
    blocks = rows.faces, torque[up], -torque[down], torque
    first, middle = len(rows.faces), len(rows.faces) + len(unit_up)
    last = middle + len(unit_down)
    stack = _stack(rows, _BALANCE + last + len(torque))
    G = stack[_BALANCE:]
    np.concatenate(blocks, out=G[:, :size])
    G[:, size] = 0.0
    G[first:middle, size] = -unit_up
    G[middle:last, size] = -unit_down
    u = rows.wrench, np.full(first, -e), -gravity[up], gravity[down], rows.upper
    low, high = shared.free.copy()
    high[coordinates.normal] = rows.limit - e
    low[coordinates.normal[rows.bare]] = e
    low[-1] = 0.0
    reach = np.abs(torque) @ rows.box[1] + np.abs(gravity)
    shares = reach[up] / unit_up, reach[down] / unit_down
    highest = float(np.concatenate(shares).max(initial=0.0)) + 1.0
    return Program.of_rows(
        stack,
        _BALANCE,
        np.concatenate((rows.wrench, np.full(last, -np.inf), rows.lower)),
        np.concatenate(u),
        linear=regularization == 0.0,
        P=_quadratic(coordinates, shared, regularization),
        c=shared.last[1],
        lb=low,
        ub=high,
        box=_widened(rows.box, highest),
    )


def _stack(rows: ForceRows, count: int) -> FloatArray:
    """(count, n + 1) rows, of which the first are the balance and the others yet to be filled."""
    stack = np.empty((count, rows.size + 1), order="F")
    stack[:_BALANCE, :-1] = rows.balance
    stack[:_BALANCE, -1] = 0.0
    return stack


def _widened(box: FloatArray, highest: float) -> FloatArray:
    """The box of the forces with one more variable between 0 and a bound."""
    wide = np.zeros((2, box.shape[1] + 1))
    wide[:, :-1] = box
    wide[1, -1] = highest
    return wide


def _quadratic(
    coordinates: ForceCoordinates, shared: ConeRows, regularization: float
) -> FloatArray:
    """(n + 1,) diagonal of the quadratic term eps |f/F|^2."""
    P = shared.flat
    if regularization > 0.0:
        P = P.copy()
        P[:-1] = regularization * (coordinates.basis**2).sum(axis=0)
    return P
