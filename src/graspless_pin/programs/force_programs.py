"""Algorithms 1 and 2 in contact forces: the matrices that every mode of a problem shares.

The unknown is not the edge weights k of (44) and (45) but the force itself, in contact
coordinates: x_l = (n^T f, t1^T f, t2^T f) / F where there is a friction cone, and n^T f / F alone
where the direction is known (actual sliding, no friction). F is the largest normal-force limit.
Then C k with k >= 0 becomes H^T f <= 0, (27) fixes variables at zero and (31) bounds them, so all
modes of a problem differ in bounds only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.cones import cone_faces_local
from graspless_pin.programs.program import Program


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
    count = problem.contact_count
    normal = np.zeros(count, dtype=int)
    tangent = np.full((count, 2), -1)
    columns: list[FloatArray] = []
    for contact in range(count):
        normal[contact] = len(columns)
        directions = [problem.kinetic_directions[contact]]
        if problem.has_cone[contact]:
            tangent[contact] = len(columns) + 1, len(columns) + 2
            directions = [problem.normals[contact], *problem.tangents[contact].T]
        for direction in directions:
            column = np.zeros(3 * count)
            column[3 * contact : 3 * contact + 3] = direction
            columns.append(column)
    basis = np.array(columns).T
    force = float(problem.max_normal_force.max())
    limits = np.abs(np.concatenate([problem.lower_torque, problem.upper_torque]))
    torque = float(limits[np.isfinite(limits)].max(initial=0.0))
    if torque == 0.0:
        reach = force * np.abs(problem.jacobian).sum(axis=0).max(initial=0.0)
        torque = float(reach) or 1.0
    length = float(np.linalg.norm(problem.positions, axis=1).max()) or 1.0
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
    faces = [np.zeros((0, size))]
    box = np.zeros((2, size))
    box[1, coordinates.normal] = limit
    for contact in np.flatnonzero(problem.has_cone):
        mu = float(problem.friction[contact])
        block = np.zeros((problem.cone_edges, size))
        start = coordinates.normal[contact]
        block[:, start : start + 3] = cone_faces_local(mu, problem.cone_edges).T
        faces.append(block)
        reach = mu * limit[contact]
        box[:, coordinates.tangent[contact]] = [[-reach, -reach], [reach, reach]]
    normal = np.zeros((count, size))
    normal[np.arange(count), coordinates.normal] = 1.0
    weight = np.repeat([1.0, 1.0 / coordinates.length_scale], 3)
    return ForceRows(
        faces=np.vstack(faces),
        normal=normal,
        limit=limit,
        bare=~problem.has_cone,
        balance=weight[:, None] * (problem.W @ coordinates.basis),
        wrench=-weight * problem.external_wrench / force,
        weight=weight,
        torque=problem.jacobian.T @ coordinates.basis * (force / torque),
        lower=(problem.lower_torque - problem.gravity_torques) / torque,
        upper=(problem.upper_torque - problem.gravity_torques) / torque,
        gravity=problem.gravity_torques / torque,
        box=box,
    )


def margin_program(
    problem: QuasistaticProblem, coordinates: ForceCoordinates, regularization: float
) -> Program:
    """Algorithm 1 (44) without (27) and (31): minimise -e/F + (eps/2) |f/F|^2.

    The margin e is the last variable and may become negative: a negative optimum says by how much
    the cones would have to be widened, and its dual proves that no force set exists.
    """
    rows = force_rows(problem, coordinates)
    size, low = rows.size, -rows.normal[rows.bare]
    sides = np.vstack([rows.faces, rows.normal, low])
    G = np.block(
        [[sides, np.ones((len(sides), 1))], [rows.torque, np.zeros((len(rows.torque), 1))]]
    )
    u = np.concatenate([np.zeros(len(rows.faces)), rows.limit, np.zeros(len(low)), rows.upper])
    l = np.concatenate([np.full(len(sides), -np.inf), rows.lower])  # noqa: E741
    # The box speaks of forces inside their cones, that is of e >= 0: what it proves, it proves of
    # those, and a proven bound above zero on -e proves that there are none.
    return _program(
        coordinates, rows, regularization, G, l, u,
        objective=np.append(np.zeros(size), -1.0),
        box=np.hstack([rows.box, [[0.0], [float(rows.limit.min()) / 2.0]]]),
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
    zero = np.zeros((1, 1))
    G = np.vstack(
        [
            np.hstack([rows.faces, np.repeat(zero, len(rows.faces), axis=0)]),
            np.hstack([torque[up], -unit_up[up, None]]),
            np.hstack([-torque[down], -unit_down[down, None]]),
            np.hstack([torque, np.repeat(zero, len(torque), axis=0)]),
        ]
    )
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
        box=np.hstack([rows.box, [[0.0], [highest]]]),
        imposed=(low, high),
    )  # fmt: skip


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
    lengths = (coordinates.basis**2).sum(axis=0)
    return Program(
        P=np.append(regularization * lengths, 0.0),
        c=objective,
        A=np.asfortranarray(np.hstack([rows.balance, np.zeros((6, 1))])),
        b=rows.wrench,
        G=np.asfortranarray(G),
        l=l,
        u=u,
        lb=imposed[0],
        ub=imposed[1],
        box=box,
    )
