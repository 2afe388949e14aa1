"""Problems whose verdicts are known by hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin import QuasistaticProblem
from graspless_pin.holding.dynamics import Dynamics, scaled_dynamics
from graspless_pin.problem.inertias import hybrid_contacts, whole_inertia

GRAVITY = 9.81
HALF = 0.05


def box_inertia(mass: float = 1.0, side: float = 2.0 * HALF) -> NDArray[np.float64]:
    """(6, 6) inertia of a cube about its centre."""
    return np.diag(np.repeat([mass, mass * side**2 / 6.0], 3))


def block_on_slope(friction: float, angle: float) -> QuasistaticProblem:
    """A cube on four corners; the plane's normal is z, and it would slide along x."""
    corners = [(x, y, -HALF) for x in (-HALF, HALF) for y in (-HALF, HALF)]
    weight = GRAVITY * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    return QuasistaticProblem(
        corners, [(0.0, 0.0, 1.0)] * 4, [*weight, 0.0, 0.0, 0.0], friction=friction,
        object_inertia=box_inertia(), joint_inertia=np.zeros((0, 0)),
    )  # fmt: skip


def block_between_walls(friction: float) -> QuasistaticProblem:
    """A cube between two parallel walls that nothing presses: what holds it is history."""
    corners = [(x, y, z) for x in (-HALF, HALF) for y in (-HALF, HALF) for z in (-HALF, HALF)]
    normals = [(-np.sign(x), 0.0, 0.0) for x, _, _ in corners]
    return QuasistaticProblem(
        corners, normals, [0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.0], friction=friction,
        object_inertia=box_inertia(), joint_inertia=np.zeros((0, 0)),
    )  # fmt: skip


def pressed_on_wall(friction: float = 0.5, inertia: float = 0.01) -> QuasistaticProblem:
    """A cube that a linear finger presses on a wall: it holds from 9.81 N on at friction 0.5."""
    corners = [(-HALF, y, z) for y in (-HALF, HALF) for z in (-HALF, HALF)]
    jacobian = np.zeros((15, 1))
    jacobian[12] = -1.0
    return QuasistaticProblem(
        [*corners, (HALF, 0.0, 0.0)], [(1.0, 0.0, 0.0)] * 4 + [(-1.0, 0.0, 0.0)],
        [0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.0], jacobian, friction=friction, joint_units=["N"],
        object_inertia=box_inertia(), joint_inertia=[[inertia]],
    )  # fmt: skip


def pressed_in_slot(friction: float = 0.5) -> QuasistaticProblem:
    """The same with a second wall, which may press or not: 9.81 N hold whatever it does."""
    one = pressed_on_wall(friction)
    corners = one.positions[:4] * [-1.0, 1.0, 1.0]
    return QuasistaticProblem(
        np.vstack([one.positions, corners]), np.vstack([one.normals, [(-1.0, 0.0, 0.0)] * 4]),
        one.external_wrench, np.vstack([one.jacobian, np.zeros((12, 1))]), friction=friction,
        joint_units=["N"], object_inertia=box_inertia(), joint_inertia=[[0.01]],
    )  # fmt: skip


def hybrid_on_wall(friction: float = 0.5) -> QuasistaticProblem:
    """The same with a hybrid finger: its one column commands the normal force."""
    problem = pressed_on_wall(friction)
    return problem.with_changes(joint_inertia=[[0.0]])


def dynamics_of(problem: QuasistaticProblem, torques: ArrayLike = ()) -> Dynamics:
    """The dynamics under torques; accelerations up to 0.001 of load over mass are rest."""
    inertia = whole_inertia(problem)
    assert inertia is not None
    given = np.array(torques, dtype=np.float64)
    made = scaled_dynamics(problem, given, inertia, hybrid_contacts(problem), 1e-3)
    assert made is not None
    return made
