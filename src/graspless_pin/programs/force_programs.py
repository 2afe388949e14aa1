"""Algorithms 1 and 2 in contact forces: the matrices that every mode of a problem shares.

The unknown is not the edge weights k of (44) and (45) but the force itself, in contact
coordinates: x_l = (n^T f, t1^T f, t2^T f) / F where there is a friction cone, and n^T f / F alone
where the direction is known (actual sliding, no friction). F is the load, see `problem.scales`.
Then C k with k >= 0 becomes H^T f <= 0, (27) fixes variables at zero and (31) bounds them, so all
modes of a problem differ in bounds only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.compiled import contact_frames, linear_programs
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.contact_map import contact_map
from graspless_pin.programs.force_layout import ConeRows, ForceLayout, cone_rows, layout_of
from graspless_pin.programs.program import FARTHEST, Program

_BALANCE = 6
"""Rows of the balance (19), which come first in every program."""


@dataclass(frozen=True, eq=False)
class ForceCoordinates:
    """The map from scaled contact coordinates to forces.

    Attributes:
        directions: (M, 3, 3) rows n, t1, t2 of each contact; the first is the force per newton of
            normal force where there is no cone.
        layout: Where the coordinates stand.
        force_scale: F, the load, N.
        joint_scale: (L,) torques that the load makes on each joint, N m, for the torque rows.
        length_scale: Size of the contact arrangement, m, for the moment rows.
    """

    directions: FloatArray
    layout: ForceLayout
    force_scale: float
    joint_scale: FloatArray
    length_scale: float

    @cached_property
    def torque_scale(self) -> float:
        """The largest joint scale, N m: the unit of Algorithm 2's largest torque."""
        return float(np.maximum.reduce(self.joint_scale, initial=0.0)) or self.force_scale

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


def force_coordinates(problem: QuasistaticProblem, margin: float = 0.0) -> ForceCoordinates:
    """Choose coordinates for a problem, scaled by its load.

    Args:
        problem: The problem.
        margin: Required margin, N: the scale of a problem without a load.
    """
    layout, scales = layout_of(problem), problem.scales
    if margin > 0.0 and not problem.external_wrench.any():
        scales = scales.without_load(margin)
    force, length, joints = scales
    return ForceCoordinates(_directions(problem, layout), layout, force, joints, length)


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
        torque: (L, n) J^T f / joint scale (18).
        lower: (L,) lower torque limits less gravity, over the joint scale.
        upper: (L,) upper torque limits less gravity, over the joint scale.
        gravity: (L,) g / joint scale.
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
    force, joints = coordinates.force_scale, coordinates.joint_scale
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
        torque=(effects[:, 6:] * (force / joints)).T,
        lower=(problem.lower_torque - problem.gravity_torques) / joints,
        upper=(problem.upper_torque - problem.gravity_torques) / joints,
        gravity=problem.gravity_torques / joints,
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
    whole = None
    if problem.max_normal_force.max() > FARTHEST * coordinates.force_scale:
        limit = problem.max_normal_force / coordinates.force_scale
        near, whole = (
            _widened(one, 0.5 * min(float(limit.min()), most))
            for one, most in zip(
                _boxes(shared, coordinates, limit), (FARTHEST, np.inf), strict=True
            )
        )
        box = near
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
        whole_box=whole,
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
            coordinates.joint_scale,
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
    of any joint's own limit in units of `torque_unit` when ``by_limits``. The motors' torques
    J^T f + g obey their limits.
    """
    rows, shared = force_rows(problem, coordinates), cone_rows(problem)
    size, torque, gravity = rows.size, rows.torque, rows.gravity
    e = margin / coordinates.force_scale
    up, down = share_rows(problem, coordinates, by_limits=by_limits)
    above, below = (
        up.torque[:, None] * torque[up.counts],
        down.torque[:, None] * torque[down.counts],
    )
    first, middle = len(rows.faces), len(rows.faces) + len(above)
    last = middle + len(below)
    stack = _stack(rows, _BALANCE + last + len(torque))
    G = stack[_BALANCE:]
    np.concatenate((rows.faces, above, -below, torque), out=G[:, :size])
    G[:, size] = 0.0
    G[first:middle, size] = -up.level
    G[middle:last, size] = -down.level
    own = -up.torque * gravity[up.counts], down.torque * gravity[down.counts]
    low, high = shared.free.copy()
    high[coordinates.normal] = rows.limit - e
    low[coordinates.normal[rows.bare]] = e
    low[-1] = 0.0
    boxes = _boxes(shared, coordinates, rows.limit)
    highest = []
    for box in boxes:
        most = np.abs(torque) @ box[1] + np.abs(gravity)
        levels = [one.torque * most[one.counts] / one.level for one in (up, down)]
        highest.append(float(np.concatenate(levels).max(initial=0.0)) + 1.0)
    return Program.of_rows(
        stack,
        _BALANCE,
        np.concatenate((rows.wrench, np.full(last, -np.inf), rows.lower)),
        np.concatenate((rows.wrench, np.full(first, -e), *own, rows.upper)),
        linear=regularization == 0.0,
        P=_quadratic(coordinates, shared, regularization),
        c=shared.last[1],
        lb=low,
        ub=high,
        box=_widened(boxes[0], highest[0]),
        whole_box=_widened(boxes[-1], highest[-1]) if len(boxes) > 1 else None,
    )


def torque_unit(
    problem: QuasistaticProblem, coordinates: ForceCoordinates, *, by_limits: bool
) -> float:
    """Return the unit of t in Algorithm 2.

    The torque scale, N m; ``by_limits`` the largest share of any joint's own limit that the load's
    torque is, at most 1, so that limits far above the load cost no digits.
    """
    if not by_limits:
        return coordinates.torque_scale
    limits = np.concatenate([problem.upper_torque, -problem.lower_torque])
    counts = np.isfinite(limits) & (limits > 0.0)
    shares = np.tile(coordinates.joint_scale, 2)[counts] / limits[counts]
    return min(float(shares.max(initial=0.0)), 1.0) or 1.0


class ShareRows(NamedTuple):
    """The rows of one side that say which torque t is the largest of: torque x - t' level <= ...

    Attributes:
        counts: (L,) bool, joints that have such a row: a limit of zero, or one on the wrong side of
            zero, stays a hard row and has no share.
        torque: Factor of each joint's row of torques, in joint scales.
        level: What t in `torque_unit` is multiplied by.
        weight: Multiplier of J^T f + g <= t, or t times the limit, in SI units for one of the row.
    """

    counts: NDArray[np.bool_]
    torque: FloatArray
    level: FloatArray
    weight: FloatArray


def share_rows(
    problem: QuasistaticProblem, coordinates: ForceCoordinates, *, by_limits: bool
) -> tuple[ShareRows, ShareRows]:
    """Return the rows of the torques upwards and downwards, no entry of which is above 1."""
    joints = coordinates.joint_scale
    unit = torque_unit(problem, coordinates, by_limits=by_limits)
    if not by_limits:
        all_ = np.ones(len(joints), dtype=bool)
        one = np.ones(len(joints))
        both = ShareRows(all_, joints / unit, one, one)
        return both, both
    sides = []
    for limit in (problem.upper_torque, -problem.lower_torque):
        counts = np.isfinite(limit) & (limit > 0.0)
        share = joints[counts] / limit[counts] / unit
        size = np.maximum(share, 1.0)
        sides.append(ShareRows(counts, share / size, 1.0 / size, 1.0 / (size * limit[counts])))
    return sides[0], sides[1]


def force_reach(problem: QuasistaticProblem, coordinates: ForceCoordinates) -> float:
    """Return the largest normal force up to which bounds are proven, N."""
    return min(max(problem.max_normal_force.tolist()), FARTHEST * coordinates.force_scale)


def _boxes(
    shared: ConeRows, coordinates: ForceCoordinates, limit: FloatArray
) -> tuple[FloatArray, ...]:
    """Bounds of the forces that proofs look at, and where those are fewer, of all forces."""
    owner = coordinates.layout.owner
    whole = shared.reach * limit[owner]
    if limit.max() <= FARTHEST:
        return (whole,)
    return shared.reach * np.minimum(limit, FARTHEST)[owner], whole


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
