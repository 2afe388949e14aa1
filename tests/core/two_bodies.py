"""Problems with other passive coordinates than one free object's, and an oracle for two bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import linprog

from graspless_pin import QuasistaticProblem, body_wrench_matrix

G = 9.8
HALF, HEIGHT = 0.1, 0.05
"""Half the side and the whole height of both flat boxes, m."""
MASSES = (1.0, 0.6)
CORNERS = np.array([[x, y, 0.0] for x in (-HALF, HALF) for y in (-HALF, HALF)])
THREE = np.array([[-HALF, -HALF, 0.0], [-HALF, HALF, 0.0], [HALF, 0.0, 0.0]])


def box_inertia(mass: float) -> np.ndarray:
    """(6, 6) of one of the boxes, in axes that turn with it about y: Ixx and Izz differ."""
    side, height = (2.0 * HALF) ** 2, HEIGHT**2
    flat, upright = mass * (side + height) / 12.0, mass * 2.0 * side / 12.0
    return np.diag([mass, mass, mass, flat, flat, upright])


def stacked(
    angle: float,
    friction: tuple[float, float] = (0.5, 0.5),
    *,
    push: float = 0.0,
    order: tuple[int, int] = (0, 1),
    corners: np.ndarray = CORNERS,
    **changes: Any,
) -> dict[str, Any]:
    """A flat box on a flat box on a slope: arguments of `QuasistaticProblem`.

    Args:
        angle: Of the slope, rad; it falls along the turned x axis.
        friction: Between lower box and slope, and between the boxes.
        push: Largest force of a finger that pushes the upper box up the slope, N; 0: no finger.
        order: The numbers of the lower and of the upper box.
        corners: (c, 3) where the boxes touch the slope and each other.
        changes: Other arguments.
    """
    lower, upper = order
    turn = np.array(
        [[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]]
    )
    centers = np.zeros((2, 3))
    centers[lower], centers[upper] = [0.0, 0.0, 0.5 * HEIGHT], [0.0, 0.0, 1.5 * HEIGHT]
    count = len(corners)
    points = np.vstack([corners, corners + np.array([0.0, 0.0, HEIGHT])])
    bodies = [[lower, -1]] * count + [[upper, lower]] * count
    normals, mu = [[0.0, 0.0, 1.0]] * 2 * count, np.repeat(friction, count).tolist()
    jacobian = np.zeros((6 * count, 0))
    if push > 0.0:
        points = np.vstack([points, [HALF, 0.0, 1.5 * HEIGHT]])
        bodies, normals = [*bodies, [upper, -1]], [*normals, [-1.0, 0.0, 0.0]]
        mu = [*mu, 0.2]
        jacobian = np.zeros((6 * count + 3, 1))
        jacobian[6 * count :, 0] = turn @ normals[-1]
    wrench, inertia = np.zeros(12), np.zeros((12, 12))
    both = np.kron(np.eye(2), turn)
    for body, mass in zip(order, MASSES, strict=True):
        wrench[6 * body + 2] = -mass * G
        own = slice(6 * body, 6 * body + 6)
        inertia[own, own] = both @ box_inertia(mass) @ both.T
    points, centers = points @ turn.T, centers @ turn.T
    return {
        "positions": points,
        "normals": np.array(normals) @ turn.T,
        "external_wrench": wrench,
        "jacobian": jacobian,
        "friction": mu,
        "torque_limits": (0.0, push),
        "joint_units": ["N"] * jacobian.shape[1],
        "object_inertia": inertia,
        "joint_inertia": 0.1 * np.eye(jacobian.shape[1]),
        "wrench_matrix": body_wrench_matrix(points, bodies, centers),
        **changes,
    }


def balances(arguments: dict[str, Any], edges: int = 32) -> bool:
    """Whether contact forces in the pyramids balance both boxes, with hand-written equilibrium.

    All contacts are taken with their friction: where every contact may slide virtually, that is
    what the paper's constraint asks for, too.
    """
    points, normals = np.asarray(arguments["positions"]), np.asarray(arguments["normals"])
    mu = arguments["friction"]
    count, joints, up = len(points), arguments["jacobian"].shape[1], normals[0]
    rows, load = [], []
    for number, mass in enumerate(MASSES):
        center = (0.5 + number) * HEIGHT * up
        acting = np.zeros(count)
        if number == 0:
            acting[:4], acting[4:8] = 1.0, -1.0
        else:
            acting[4:] = 1.0
        force, moment = np.zeros((3, 3 * count)), np.zeros((3, 3 * count))
        for contact in range(count):
            for axis in range(3):
                one = np.eye(3)[axis] * acting[contact]
                force[:, 3 * contact + axis] = one
                moment[:, 3 * contact + axis] = np.cross(points[contact] - center, one)
        rows += [force, moment]
        load += [np.array([0.0, 0.0, mass * G]), np.zeros(3)]
    along = np.cross(normals, [0.0, 1.0, 0.0])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(normals, along)
    cone = np.zeros((3 * count, edges * count))
    for contact in range(count):
        for edge in range(edges):
            turn = 2.0 * np.pi * edge / edges
            way = np.cos(turn) * along[contact] + np.sin(turn) * across[contact]
            own = slice(3 * contact, 3 * contact + 3)
            cone[own, edges * contact + edge] = normals[contact] + mu[contact] * way
    limits = []
    if joints:
        torque = arguments["jacobian"].T @ cone
        limits = [(torque, np.full(joints, arguments["torque_limits"][1])), (-torque, np.zeros(1))]
    found = linprog(
        np.zeros(cone.shape[1]),
        A_eq=np.vstack(rows) @ cone,
        b_eq=np.concatenate(load),
        A_ub=np.vstack([one for one, _ in limits]) if limits else None,
        b_ub=np.concatenate([one for _, one in limits]) if limits else None,
        method="highs",
    )
    return found.status == 0


def on_a_rail(squeeze: float, mass: float = 1.0, mu: float = 0.5) -> QuasistaticProblem:
    """A block that may only move along a rail (z), between two fingers that press it along x.

    They hold it up by friction: two forces of at most mu times ``squeeze`` each. The tangents are
    askew to the rail, so that the block slides along both of them.
    """
    normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    jacobian = np.zeros((6, 2))
    jacobian[:3, 0], jacobian[3:, 1] = normals
    return QuasistaticProblem(
        -0.05 * normals, normals, [-mass * G], jacobian,
        friction=mu, torque_limits=(0.0, squeeze), joint_units=["N", "N"],
        tangents=np.array([[[0.0, 0.0], [1.0, -1.0], [1.0, 1.0]]] * 2) / np.sqrt(2.0),
        object_inertia=[[mass]], joint_inertia=np.zeros((2, 2)),
        wrench_matrix=[[0.0, 0.0, 1.0] * 2], passive_units=["N"],
    )  # fmt: skip
