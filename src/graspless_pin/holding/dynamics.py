"""The dynamics in the first instant, scaled: y = B^T f + h, u = A y; at rest B = A.

Free motions are those of object and joints that no friction resists.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from graspless_pin.holding.controller import GrowthProof, SmallMotions
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.inertias import hybrid_contacts
from graspless_pin.problem.matrices import wrench_map
from graspless_pin.problem.quasistatic import contact_map


@dataclass(frozen=True, eq=False)
class Dynamics:
    """The scaled equations of motion of object and joints in the first instant.

    With the inertia M = C C^T, the generalised load g, H = |C^-1 g| and the largest length alpha
    of a row of G C^-T: y = C^T a / H, A = G C^-T / alpha, h = C^-1 g / H, forces in units of
    H / alpha. Then y = A^T f + h, |h| = 1, and every outcome has
    |y|^2 + sum mu f_n |u_t| = h.y.

    A contact that slides by the declared motion has the force f_n (n - mu v/|v|) whatever the
    acceleration. Then y = B^T f + h, and the power of its friction has no sign.

    Attributes:
        rows: (M, 3, n) A: along n, t1, t2 of each contact; n = P + joints that are no hybrid
            finger's. The normal row of a commanded contact is zero: its force is in the load.
        pushes: (M, 3, n) B: A, but along n - mu v/|v| and zeros where a contact slides.
        load: (n,) h without the part in `free_motion`; zero where there is no load.
        friction: (M,) coefficients; zero where a contact slides: its friction is in B.
        commanded: (M,) normal forces that hybrid fingers command, scaled; NaN elsewhere.
        acceleration: (P + L, n) from y to accelerations of object and joints.
        force_unit: H / alpha, N.
        points: (M + k, 3, n) from y to the accelerations of the contact points and of the
            reference point of the object, m/s^2; see `observed_points`.
        levers: (P,) largest acceleration of these points per unit of each passive acceleration, m
            or 1.
        limit_divisor: If no passive acceleration times its lever exceeds limit / limit_divisor, no
            point accelerates above the limit.
        limit: Accelerations of those points up to this count as rest, m/s^2.
        load_change: (n,) s, loads are h + theta s for any theta from 0 to 1; of these outcomes
            those with |y|^2 + sum mu f_n |u_t| <= h.y are meant; zero: one load.
        commanded_change: (M,) change of commanded forces for theta = 1, scaled.
        free_motion: (n,) motion of joints by themselves, not in y; see `without_free_joints`.
    """

    rows: FloatArray
    pushes: FloatArray
    load: FloatArray
    friction: FloatArray
    commanded: FloatArray
    acceleration: FloatArray
    force_unit: float
    points: FloatArray
    levers: FloatArray
    limit_divisor: float
    limit: float
    load_change: FloatArray
    commanded_change: FloatArray
    free_motion: FloatArray

    @property
    def contact_count(self) -> int:
        """M."""
        return len(self.rows)

    @cached_property
    def is_commanded(self) -> NDArray[np.bool_]:
        """(M,) contacts whose normal force a hybrid finger commands."""
        return np.isfinite(self.commanded)

    @cached_property
    def resolution(self) -> float:
        """Length of y below which it counts as rest."""
        return self.limit / float(np.linalg.norm(self.points, ord=2, axis=(1, 2)).max())

    def point_acceleration(self, y: FloatArray) -> float:
        """Return the largest acceleration of a point, m/s^2."""
        return float(np.linalg.norm(self.points @ y, axis=1).max())

    def contact_motion(self, y: FloatArray) -> FloatArray:
        """Return u, (M, 3): accelerations along n, t1, t2."""
        return self.rows @ y

    def normal_forces(self, forces: FloatArray) -> FloatArray:
        """Return (M,) normal forces, scaled: of contact forces (M, 3), or commanded."""
        return np.where(self.is_commanded, np.nan_to_num(self.commanded), forces[:, 0])

    def scaled_acceleration(self, forces: FloatArray) -> FloatArray:
        """Return y of scaled contact forces (M, 3)."""
        return np.einsum("lin,li->n", self.pushes, forces) + self.load


def observed_points(problem: QuasistaticProblem) -> tuple[FloatArray, FloatArray, float]:
    """Return the map from velocities of passive coordinates to those of the points to be at rest.

    These are the contact points and the reference point of the object. With a given wrench matrix
    they are the relative velocities at contacts, and each coordinate's velocity times its lever:
    the length scale for coordinates with loads in N m, for the others the largest norm of a
    contact's three entries in their row, at least 1.

    Returns:
        (M + k, 3, P) the map; (P,) the levers; the `limit_divisor`; see `Dynamics`.
    """
    count, passive = problem.contact_count, problem.passive_count
    if problem.wrench_matrix is None:
        places = np.vstack([problem.positions, np.zeros(3)])
        farthest = float(np.linalg.norm(places, axis=1).max())
        points = wrench_map(places).T.reshape(-1, 3, passive)
        return points, np.repeat([1.0, farthest], 3), 2.0 * np.sqrt(3.0)
    at = problem.W.T.reshape(count, 3, passive)
    longest = np.maximum(np.linalg.norm(at, axis=1).max(axis=0), 1.0)
    levers = np.where(problem.passive_turns, problem.scales.length, longest)
    own = np.zeros((passive, 3, passive))
    own[:, 0] = np.diag(levers)
    return np.concatenate([at, own]), levers, float(passive)


def generalized_load(problem: QuasistaticProblem, torques: FloatArray) -> FloatArray:
    """Return g = (w_ext, tau - g(q)), (P + L,)."""
    return np.concatenate([problem.external_wrench, torques - problem.gravity_torques])


_ROUNDING = 8.0 * float(np.finfo(float).eps)
"""Relative to the norm of a coordinate's three entries at one contact: smaller ones are zero."""


def contact_jacobian(problem: QuasistaticProblem) -> FloatArray:
    """Return G = [W^T, -J] in contact frames, (M, 3, P + L).

    With a given wrench matrix, whose coordinates may have other axes than contacts, entries at
    rounding level are set to zero: a contact must not resist a motion that it does not constrain.
    """
    g = contact_map(problem).copy()
    g[:, :, problem.passive_count :] *= -1.0
    if problem.wrench_matrix is not None:
        g[np.abs(g) <= _ROUNDING * np.linalg.norm(g, axis=1, keepdims=True)] = 0.0
    return g


def force_jacobian(problem: QuasistaticProblem) -> FloatArray:
    """Return G for forces, (M, 3, P + L): rows of a sliding contact are n - mu v/|v| and zeros."""
    g = contact_jacobian(problem)
    sliding = problem.is_sliding
    along = np.einsum("lji,lj->li", problem.frames, problem.kinetic_directions)[sliding]
    g[sliding, 0] = np.einsum("li,lik->lk", along, g[sliding])
    g[sliding, 1:] = 0.0
    return g


def world_forces(problem: QuasistaticProblem, forces: FloatArray) -> FloatArray:
    """Return contact forces (M, 3) in world axes; those of sliding contacts by normal forces.

    Args:
        problem: The problem.
        forces: (M, 3) along n, t1, t2.
    """
    world = (problem.frames @ forces[:, :, None])[:, :, 0]
    sliding = problem.is_sliding
    world[sliding] = forces[sliding, :1] * problem.kinetic_directions[sliding]
    return read_only(world)


def slides_with_friction(problem: QuasistaticProblem) -> NDArray[np.bool_]:
    """Return the (M,) contacts that slide with friction."""
    return problem.is_sliding & (problem.friction > 0.0)


def free_friction(problem: QuasistaticProblem) -> FloatArray:
    """Return the (M,) coefficients of friction; zero for contacts that slide as declared."""
    return np.where(problem.is_sliding, 0.0, problem.friction)


def scaled_dynamics(
    problem: QuasistaticProblem,
    torques: FloatArray,
    inertia: FloatArray,
    hybrid: NDArray[np.intp],
    limit: float,
) -> Dynamics | None:
    """Return the scaled dynamics; None without any load, if no contact slides with friction.

    Args:
        problem: Contacts, load and joints.
        torques: (L,) of the motors.
        inertia: (P + L, P + L) of object and joints.
        hybrid: (L,) contact whose normal force a column commands; -1: a joint.
        limit: Accelerations of points up to this count as rest, m/s^2.
    """
    count, passive = problem.contact_count, problem.passive_count
    jacobian, load = contact_jacobian(problem), generalized_load(problem, torques)
    acting = force_jacobian(problem)
    commanded = np.full(count, np.nan)
    for column in np.flatnonzero(hybrid >= 0):
        contact = hybrid[column]
        commanded[contact] = load[passive + column]
        load[:passive] += load[passive + column] * acting[contact, 0, :passive]
        jacobian[contact, 0] = acting[contact, 0] = 0.0
    kept = np.concatenate([np.ones(passive, dtype=bool), hybrid < 0])
    jacobian, acting, load = jacobian[:, :, kept], acting[:, :, kept], load[kept]
    root = np.linalg.cholesky(inertia[np.ix_(kept, kept)])
    back = np.linalg.inv(root).T
    h = back.T @ load
    size = float(np.linalg.norm(h))
    if size == 0.0:
        if not slides_with_friction(problem).any():
            return None
        size = 1.0
    rows, pushes = jacobian @ back, acting @ back
    alpha = float(np.linalg.norm(rows, axis=2).max())
    acceleration = np.zeros((passive + problem.joint_count, len(load)))
    acceleration[kept] = size * back
    points, levers, shares = observed_points(problem)
    return Dynamics(
        rows / alpha,
        pushes / alpha,
        h / size,
        free_friction(problem),
        commanded * alpha / size,
        acceleration,
        size / alpha,
        points @ acceleration[:passive],
        levers,
        shares,
        limit,
        np.zeros_like(h),
        np.zeros(count),
        np.zeros_like(h),
    )


def spread_towards(dynamics: Dynamics, other: Dynamics | None) -> Dynamics:
    """Return dynamics whose load is any load between its own and another one of the same bodies.

    The power of a load between two is at most the larger of theirs. So each outcome of such a load
    is one of the dynamics spread from the one to the other, or from the other to the one.

    Args:
        dynamics: Of one load.
        other: Of the other one; None: without load.
    """
    ratio, last = 0.0, dynamics
    if other is not None:
        ratio, last = other.force_unit / dynamics.force_unit, other
    return replace(
        dynamics,
        load_change=ratio * last.load - dynamics.load,
        commanded_change=np.nan_to_num(ratio * last.commanded - dynamics.commanded),
    )


_DEPENDENT = 1e-13
"""Relative to the largest singular value: rows with smaller ones depend on the others."""
_LEAST_ASIDE = 1e-7
"""Scaled accelerations of joints by themselves up to this are not split off."""
_TINY = 1e-12
"""Relative to the largest entry of `Dynamics.free_motion`: smaller ones are rounding."""
_LEAK = 0.1
"""Share of the power that counts as rest: most power of contacts along `Dynamics.free_motion`."""


def without_free_joints(
    dynamics: Dynamics, opened: NDArray[np.bool_], force_limit: float
) -> Dynamics:
    """Return the dynamics without the motion of joints by themselves while some contacts are open.

    Along motions z in which the object and all contacts but open ones stay, every outcome has
    z.y = z.h. With w the part of h along them, y' = y - w has y' = A^T f + h - w and
    |y'|^2 + sum mu f_n |u_t| = (h - w).y': bounds of y' do not contain the motion of a free finger.

    Args:
        dynamics: The scaled dynamics of one load.
        opened: (M,) contacts that are open.
        force_limit: Normal forces are at most this, scaled.
    """
    whole, passive = dynamics.load + dynamics.free_motion, len(dynamics.levers)
    aside = np.zeros_like(whole)
    if len(whole) > passive and not dynamics.load_change.any():
        rows = np.vstack([dynamics.rows[~opened].reshape(-1, len(whole)),
                          dynamics.acceleration[:passive]])  # fmt: skip
        lengths = np.linalg.norm(rows, axis=1)
        rows = rows[lengths > 0.0] / lengths[lengths > 0.0, None]
        _, sizes, turns = np.linalg.svd(rows)
        free = turns[int((sizes > _DEPENDENT * sizes.max()).sum()) :]
        part = free.T @ (free @ whole)
        part[np.abs(part) < _TINY * np.abs(part).max()] = 0.0
        leak = force_limit * leak_powers(dynamics, part)[~opened].sum()
        if np.linalg.norm(part) > _LEAST_ASIDE and leak < _LEAK * dynamics.resolution**2:
            aside = part
    return replace(dynamics, load=whole - aside, free_motion=aside)


def leak_powers(dynamics: Dynamics, aside: FloatArray) -> FloatArray:
    """Return (M,) the most power of each contact along `aside` (n,), for a unit normal force."""
    return np.sqrt(1.0 + dynamics.friction**2) * np.linalg.norm(dynamics.rows @ aside, axis=1)


LEAST_LOAD = 1e-4
"""In loads: contacts that bear less in all admissible forces are no constraints on motions."""
NEGLIGIBLE = 1e-6
"""Relative: smaller speeds and levers count as zero."""
_IN_ONE_PLACE = 1e-3
"""Of the distance from the reference point: contacts nearer to each other are in one place."""


def free_motions(problem: QuasistaticProblem) -> FloatArray:
    """Return a basis of the motions that move the object while every contact just rolls.

    Object and joints move so that all contacts keep touching and none slips, except those that
    slide as declared or have no friction. To first order nothing resists such a motion: whether
    constant torques hold the object then depends on curvatures and weights, and mostly they do not;
    position feedback does. A declared sliding motion is itself among them.

    Motions of the joints alone are left out: each motion moves the joints as little as it can. At
    a hybrid finger's contact the finger follows along the normal, and its entry is zero.

    Args:
        problem: Contacts and joints. `joint_inertia` tells which columns are hybrid fingers';
            without it such a column is a joint that follows.

    Returns:
        (k, P + L) velocities, read-only: of the object [linear of the reference point; angular],
        world axes, m/s and rad/s, or of other passive coordinates, then of the joints. k = 0: none.
        The rows are orthonormal when linear velocities count in `problem.scales.length` per second,
        angular ones in rad/s, and a joint's rate in that length over its longest lever. Of contacts
        in one place the length is their distance from the reference point. Those that
        move the object most come first.

    Raises:
        ArgumentError: If it is no problem.

    Examples:
        >>> from graspless_pin import load_scene, free_motions
        >>> scene = load_scene("examples/allegro_sphere_on_slope.yaml")
        >>> len(free_motions(scene.problem()))
        3
    """
    checked_problem(problem)
    basis, moving, units = no_slip_basis(problem)
    _, shares, turns = np.linalg.svd(basis[: problem.passive_count], full_matrices=True)
    count = int((shares > NEGLIGIBLE).sum())
    motions = np.zeros((count, len(moving)))
    motions[:, moving] = turns[:count] @ basis.T * units
    return read_only(motions)


def with_joints_held(
    problem: QuasistaticProblem, torques: FloatArray, joints: NDArray[np.intp]
) -> QuasistaticProblem:
    """Return the problem with some joints held still, whatever torques that takes.

    Their columns of J are zero, and each joint balances its own torque.

    Args:
        problem: The problem.
        torques: (L,) of the motors, N m (N).
        joints: Indices of the joints that are held.
    """
    jacobian, gravity = problem.jacobian.copy(), problem.gravity_torques.copy()
    jacobian[:, joints] = 0.0
    gravity[joints] = torques[joints]
    inertia = problem.joint_inertia
    if inertia is not None:
        own = inertia.diagonal()[joints].copy()
        inertia = inertia.copy()
        inertia[joints] = inertia[:, joints] = 0.0
        inertia[joints, joints] = np.where(own > 0.0, own, 1.0)  # nothing moves it
    return problem.with_changes(jacobian=jacobian, gravity_torques=gravity, joint_inertia=inertia)


def small_motions_without_scene(
    problem: QuasistaticProblem, bearing: Callable[[], FloatArray]
) -> SmallMotions:
    """Return a record of small motions about a rest, decided by contacts without their surfaces.

    If every motion of object and joints makes loaded contacts slip or open, there is none.
    Otherwise stability depends on how the surfaces roll, which a problem does not know.

    Args:
        problem: Contacts and joints at rest.
        bearing: Returns (M, 3) forces of a rest, N, world axes, in which every contact bears load
            that does in some rest; the others are no constraints.
    """
    if problem.is_sliding.any():
        return SmallMotions.not_known("contacts slide by the declared motion")
    rolls = "how contacts roll is only known for scenes with shapes"
    basis, moving, _ = no_slip_basis(problem)
    if basis.shape[1]:
        return SmallMotions.not_known(rolls)
    forces = bearing()
    loaded = np.einsum("li,li->l", forces, problem.normals) > LEAST_LOAD * problem.scales.force
    basis, moving, _ = no_slip_basis(problem, bears=loaded)
    if not basis.shape[1]:
        joints = np.flatnonzero(moving[problem.passive_count :])
        still, nothing, none = np.zeros((len(moving), 0)), np.zeros((0, 0)), np.zeros(len(joints))
        proof = GrowthProof(
            still, forces, nothing, (*joints.tolist(),), none, none, none, 0.0, nothing
        )
        return SmallMotions(0.0, 0.0, least_growth=0.0, proofs={"any": proof})
    return SmallMotions.not_known(f"some contacts carry no load, and {rolls}")


def no_slip_basis(
    problem: QuasistaticProblem,
    moving: NDArray[np.bool_] | None = None,
    *,
    bears: NDArray[np.bool_] | None = None,
) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
    """Return an orthonormal basis of the motions in which no contact slips or opens.

    Args:
        problem: Contacts and joints.
        moving: (P + L,) coordinates that move; None: all but hybrid fingers, which follow.
        bears: (M,) contacts that do not slip or open; None: all.

    Returns:
        The basis as columns, scaled by the units; the mask ``moving``; and the units of its
        coordinates, see `motion_units`.
    """
    hybrid = hybrid_contacts(problem)
    if moving is None:
        moving = np.concatenate([np.ones(problem.passive_count, dtype=bool), hybrid < 0])
    units = motion_units(problem)[moving]
    velocities = contact_jacobian(problem)[:, :, moving] * (units / motion_length(problem))
    still = np.ones((problem.contact_count, 3), dtype=bool)
    still[:, 1:] = problem.has_cone[:, None]
    still[hybrid[hybrid >= 0], 0] = False
    if bears is not None:
        still[~bears] = False
    return null_space(velocities[still], rcond=NEGLIGIBLE), moving, units


def motion_length(problem: QuasistaticProblem) -> float:
    """Return the unit of length of linear velocities, m: `problem.scales.length`.

    For contacts in one place, where that may be next to zero, it is their distance from the
    reference point.
    """
    length = problem.scales.length
    if problem.wrench_matrix is not None:
        return length
    farthest = float(np.linalg.norm(problem.positions, axis=1).max())
    return farthest if length < _IN_ONE_PLACE * farthest else length


def motion_units(problem: QuasistaticProblem) -> FloatArray:
    """Return the (P + L,) units of the velocities of object and joints in `free_motions`."""
    length = motion_length(problem)
    blocks = problem.jacobian.reshape(problem.contact_count, 3, problem.joint_count)
    levers = np.linalg.norm(blocks, axis=1).max(axis=0)
    levers = np.maximum(levers, NEGLIGIBLE * levers.max(initial=0.0))
    joints = np.divide(length, levers, out=np.ones_like(levers), where=levers > 0.0)
    return np.concatenate([np.where(problem.passive_turns, 1.0, length), joints])
