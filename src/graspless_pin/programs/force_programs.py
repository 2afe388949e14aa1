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

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.cones import cone_faces_local
from graspless_pin.programs.program import Program

_FRAME = np.arange(3)
_TANGENTS = np.array([1, 2])


@dataclass(frozen=True, eq=False)
class ForceCoordinates:
    """The map from scaled contact coordinates to forces.

    Attributes:
        basis: (3M, n) with f = F basis x.
        force_scale: F, the largest normal-force limit, N.
        torque_scale: The largest finite torque limit (or, without one, the largest torque that
            the contacts can make), N m.
        length_scale: Size of the contact arrangement, m, for the moment rows.
        normal: (M,) column of each contact's normal coordinate.
        tangent: (M, 2) columns of t1 and t2; -1 where there is no cone.
    """

    basis: FloatArray
    force_scale: float
    torque_scale: float
    length_scale: float
    normal: np.ndarray
    tangent: np.ndarray

    def forces(self, x: FloatArray) -> FloatArray:
        """Return the (M, 3) contact forces of a program's solution, N."""
        count = self.basis.shape[1]
        return (self.force_scale * (self.basis @ x[:count])).reshape(-1, 3)


def force_coordinates(problem: QuasistaticProblem) -> ForceCoordinates:
    """Choose coordinates and scales for a problem."""
    count, has_cone = problem.contact_count, problem.has_cone
    widths = np.where(has_cone, 3, 1)
    normal = np.cumsum(widths) - widths
    tangent = np.where(has_cone[:, None], normal[:, None] + _TANGENTS, -1)
    basis = np.zeros((count, 3, int(widths.sum())))
    cones = np.flatnonzero(has_cone)
    basis[cones[:, None], :, normal[cones, None] + _FRAME] = problem.frames[cones].swapaxes(1, 2)
    if len(cones) < count:
        bare = np.flatnonzero(~has_cone)
        basis[bare, :, normal[bare]] = problem.kinetic_directions[bare]
    basis = basis.reshape(3 * count, -1)
    force = float(problem.max_normal_force.max())
    limits = np.abs(np.concatenate([problem.lower_torque, problem.upper_torque]))
    torque = float(limits.max(initial=0.0, where=np.isfinite(limits)))
    if torque == 0.0:
        reach = force * np.abs(problem.jacobian).sum(axis=0).max(initial=0.0)
        torque = float(reach) or 1.0
    length = math.sqrt(float((problem.positions**2).sum(axis=1).max())) or 1.0
    return ForceCoordinates(basis, force, torque, length, normal, tangent)


@dataclass(frozen=True, eq=False)
class ForceRows:
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
    count, size = problem.contact_count, coordinates.basis.shape[1]
    force, torque = coordinates.force_scale, coordinates.torque_scale
    limit = problem.max_normal_force / force
    cones = np.flatnonzero(problem.has_cone)
    friction = problem.friction[cones]
    faces = np.zeros((len(cones), problem.cone_edges, size))
    columns = coordinates.normal[cones, None] + _FRAME
    blocks = cone_faces_local(friction, problem.cone_edges)
    faces[np.arange(len(cones))[:, None], :, columns] = blocks
    box = np.zeros((2, size))
    box[1, coordinates.normal] = limit
    box[1, columns[:, 1:]] = (friction * limit[cones])[:, None]
    box[0, columns[:, 1:]] = -box[1, columns[:, 1:]]
    normal = np.zeros((count, size))
    normal[np.arange(count), coordinates.normal] = 1.0
    weight = np.repeat([1.0, 1.0 / coordinates.length_scale], 3)
    return ForceRows(
        faces=faces.reshape(-1, size),
        normal=normal,
        limit=limit,
        bare=~problem.has_cone,
        balance=weight[:, None] * (problem.W @ coordinates.basis),
        wrench=-weight * problem.external_wrench / force,
        weight=weight,
        torque=_torque_rows(problem, coordinates) * (force / torque),
        lower=(problem.lower_torque - problem.gravity_torques) / torque,
        upper=(problem.upper_torque - problem.gravity_torques) / torque,
        gravity=problem.gravity_torques / torque,
        box=box,
    )


def _torque_rows(problem: QuasistaticProblem, coordinates: ForceCoordinates) -> FloatArray:
    """(L, n) J^T basis, contact by contact: each column of the basis is one contact's."""
    count, joints = problem.contact_count, problem.joint_count
    own = problem.jacobian.reshape(count, 3, joints).swapaxes(1, 2)
    rows = np.empty((joints, coordinates.basis.shape[1]))
    cones = np.flatnonzero(problem.has_cone)
    along = (own[cones] @ problem.frames[cones]).swapaxes(1, 2)
    rows[:, coordinates.normal[cones, None] + _FRAME] = along.transpose(2, 0, 1)
    if len(cones) < count:
        bare = np.flatnonzero(~problem.has_cone)
        along = own[bare] @ problem.kinetic_directions[bare][:, :, None]
        rows[:, coordinates.normal[bare]] = along[:, :, 0].T
    return rows


def margin_program(
    problem: QuasistaticProblem, coordinates: ForceCoordinates, regularization: float
) -> Program:
    """Algorithm 1 (44) without (27) and (31): minimise -e/F + (eps/2) |f/F|^2.

    The margin e is the last variable and may become negative: a negative optimum says by how much
    the cones would have to be widened, and its dual proves that no force set exists.
    """
    rows = force_rows(problem, coordinates)
    size, low = rows.size, -rows.normal[rows.bare]
    sides = len(rows.faces) + len(rows.normal) + len(low)
    G = np.zeros((sides + len(rows.torque), size + 1), order="F")
    np.concatenate([rows.faces, rows.normal, low, rows.torque], out=G[:, :size])
    G[:sides, size] = 1.0
    u = np.concatenate([np.zeros(len(rows.faces)), rows.limit, np.zeros(len(low)), rows.upper])
    l = np.concatenate([np.full(sides, -np.inf), rows.lower])  # noqa: E741
    # The box speaks of forces inside their cones, that is of e >= 0: what it proves, it proves of
    # those, and a proven bound above zero on -e proves that there are none.
    return _program(
        coordinates, rows, regularization, G, l, u,
        objective=np.append(np.zeros(size), -1.0),
        box=_widened(rows.box, float(rows.limit.min()) / 2.0),
        imposed=(np.full(size + 1, -np.inf), np.full(size + 1, np.inf)),
    )  # fmt: skip


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
    rows = force_rows(problem, coordinates)
    size, torque, gravity = rows.size, rows.torque, rows.gravity
    e = margin / coordinates.force_scale
    unit_up, unit_down = np.ones(len(torque)), np.ones(len(torque))
    if by_limits:
        # The share of a limit is counted on the side where the torque is; a limit of zero, or
        # one on the wrong side of zero, stays a hard row and has no share.
        scale = coordinates.torque_scale
        unit_up = np.maximum(problem.upper_torque / scale, 0.0)
        unit_down = np.maximum(-problem.lower_torque / scale, 0.0)
    up, down = np.isfinite(unit_up) & (unit_up > 0.0), np.isfinite(unit_down) & (unit_down > 0.0)
    blocks = [rows.faces, torque[up], -torque[down], torque]
    first, middle, last, end = np.cumsum([len(block) for block in blocks])
    G = np.zeros((end, size + 1), order="F")
    np.concatenate(blocks, out=G[:, :size])
    G[first:middle, size] = -unit_up[up]
    G[middle:last, size] = -unit_down[down]
    u = np.concatenate([np.full(len(rows.faces), -e), -gravity[up], gravity[down], rows.upper])
    l = np.concatenate([np.full(len(u) - len(rows.upper), -np.inf), rows.lower])  # noqa: E741
    low, high = np.full(size + 1, -np.inf), np.full(size + 1, np.inf)
    high[coordinates.normal] = rows.limit - e
    low[coordinates.normal[rows.bare]] = e
    low[-1] = 0.0
    reach = np.abs(torque) @ np.abs(rows.box).max(axis=0) + np.abs(gravity)
    shares = [reach[up] / unit_up[up], reach[down] / unit_down[down]]
    highest = float(np.concatenate([*shares, [0.0]]).max()) + 1.0
    return _program(
        coordinates, rows, regularization, G, l, u,
        objective=np.append(np.zeros(size), 1.0),
        box=_widened(rows.box, highest),
        imposed=(low, high),
    )  # fmt: skip


def _widened(box: FloatArray, highest: float) -> FloatArray:
    """The box of the forces with one more variable between 0 and a bound."""
    wide = np.zeros((2, box.shape[1] + 1))
    wide[:, :-1] = box
    wide[1, -1] = highest
    return wide


def _program(
    coordinates: ForceCoordinates,
    rows: ForceRows,
    regularization: float,
    G: FloatArray,
    l: FloatArray,  # noqa: E741
    u: FloatArray,
    *,
    objective: FloatArray,
    box: FloatArray,
    imposed: tuple[FloatArray, FloatArray],
) -> Program:
    P = np.zeros(rows.size + 1)
    if regularization > 0.0:
        P[:-1] = regularization * (coordinates.basis**2).sum(axis=0)
    A = np.zeros((6, rows.size + 1), order="F")
    A[:, :-1] = rows.balance
    return Program(
        P=P,
        c=objective,
        A=A,
        b=rows.wrench,
        G=G,
        l=l,
        u=u,
        lb=imposed[0],
        ub=imposed[1],
        box=box,
    )
