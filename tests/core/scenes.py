"""Problems that the tests of the numerical core share: the paper's four scenes and random ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin import QuasistaticProblem, TorqueSolution

SIGN_RULES = ("strict", "exact", "nonzero")
SLIDING_RULES = ("exempt", "constrained")
SOLVERS = ("piqp", "proxqp", "highs", "clarabel")

_Q = np.sqrt(2.0) / 2.0
_WEIGHT = [0.0, 0.0, -9.8, 0.0, 0.0, 0.0]


def sphere_arguments() -> dict[str, Any]:
    """The paper's sphere on a slope: arguments of `QuasistaticProblem`."""
    normals = np.array([[-0.612, 0.707, 0.354], [_Q, 0.0, _Q], [-0.612, -0.707, 0.354]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    jacobian = np.zeros((9, 2))
    jacobian[:3, 0] = -0.15 * normals[0]
    jacobian[6:, 1] = -0.15 * normals[2]
    return {
        "positions": -0.1 * normals,
        "normals": normals,
        "external_wrench": _WEIGHT,
        "jacobian": jacobian,
        "friction": 0.3,
        "cone_edges": 32,
    }


def cuboid_arguments(motion: float = 0.0) -> dict[str, Any]:
    """The paper's pinched cuboid: at rest (0), sliding up (1) or down (-1) the slope."""
    h, a = 0.05 * _Q, 0.2 * _Q
    jacobian = np.zeros((18, 2))
    jacobian[1, 0] = jacobian[16, 1] = -0.1
    up = [-_Q, 0.0, _Q]
    pairs = [[up, [-_Q, 0.0, -_Q]], *[[up, [0.0, -1.0, 0.0]]] * 4, [up, [_Q, 0.0, _Q]]]
    sliding = np.zeros((6, 3))
    sliding[1:5] = motion * np.array(up)
    return {
        "positions": [
            [h, -0.1, h], [0, -0.1, -a], [0, 0.1, -a], [-a, 0.1, 0], [-a, -0.1, 0], [h, 0.1, h]
        ],
        "normals": [[0, 1, 0], *[[_Q, 0, _Q]] * 4, [0, -1, 0]],
        "external_wrench": _WEIGHT,
        "jacobian": jacobian,
        "friction": 0.3,
        "cone_edges": 6,
        "tangents": np.array(pairs).transpose(0, 2, 1),
        "sliding": sliding,
    }  # fmt: skip


def scene(name: str) -> QuasistaticProblem:
    """One of the paper's scenes: sphere, rest, up or down."""
    if name == "sphere":
        return QuasistaticProblem(**sphere_arguments())
    return QuasistaticProblem(**cuboid_arguments({"rest": 0.0, "up": 1.0, "down": -1.0}[name]))


def slider(turn: float, *, scale: float = 1.0) -> QuasistaticProblem:
    """A slider on three floor and two wall points, its tangents turned by an angle, rad."""
    points = [[0.1, 0.1, -0.1], [-0.1, 0.1, -0.1], [0, -0.05, -0.1], [0.1, -0.1, -0.1],
              [-0.1, -0.1, -0.1]]  # fmt: skip
    normals, along = [[0.0, 0.0, 1.0]] * 3 + [[0.0, 1.0, 0.0]] * 2, np.array([1.0, 0.0, 0.0])
    c, s = np.cos(turn), np.sin(turn)
    tangents = [
        np.column_stack([c * along + s * across, c * across - s * along])
        for across in np.cross(normals, along)
    ]
    wrench = np.array([6.0, -5.0, -10.0, -0.5 * scale, -0.6 * scale, 0.0])
    return QuasistaticProblem(
        scale * np.array(points), normals, wrench, friction=0.5, tangents=tangents, cone_edges=8
    )


def random_arguments(
    seed: int, contacts: int = 3, *, slides: int = 0, joints: int | None = None
) -> dict[str, Any]:
    """Arguments of a random problem that has forces inside its cones (with Coulomb friction).

    Contact 0 belongs to a force-controlled finger; contact 1, for odd seeds, to a hybrid one; the
    last `slides` contacts actually slide. The wrench is that of random forces inside the cones.

    Args:
        seed: Of the random numbers.
        contacts: M.
        slides: How many contacts slide.
        joints: Joints of the force-controlled finger; None: one or two, by the seed.
    """
    rng = np.random.default_rng(seed)
    edges = int(rng.integers(3, 7))
    normals = rng.normal(size=(contacts, 3))
    if seed % 3 == 0:
        # Nearly opposite contacts pinch the object and make the kinematics bite.
        normals[1] = -normals[0] + 0.2 * rng.normal(size=3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    positions = -0.1 * normals + 0.03 * rng.normal(size=(contacts, 3))
    friction = rng.uniform(0.2, 0.8, contacts)
    raw = rng.normal(size=(contacts, 3))
    first = np.cross(normals, raw)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    tangents = np.stack([first, np.cross(normals, first)], axis=2)
    press = rng.uniform(2.0, 8.0, contacts)
    inside = 0.9 * np.cos(np.pi / edges) * rng.uniform(0.0, 1.0, contacts)
    turn = rng.uniform(0.0, 2.0 * np.pi, contacts)
    sliding = np.zeros((contacts, 3))
    direction = np.einsum(
        "lij,lj->li", tangents, np.stack([np.cos(turn), np.sin(turn)], axis=1)
    )  # fmt: skip
    for contact in range(contacts - slides, contacts):
        sliding[contact] = -rng.uniform(0.01, 0.2) * direction[contact]
        inside[contact] = 1.0
    forces = press[:, None] * (normals + (friction * inside)[:, None] * direction)
    count = joints if joints is not None else 1 + seed % 2
    hybrid = seed % 2 == 1
    jacobian = np.zeros((3 * contacts, count + hybrid))
    jacobian[:3, :count] = 0.1 * rng.normal(size=(3, count))
    lower, upper = np.full(count + hybrid, -5.0), np.full(count + hybrid, 5.0)
    if hybrid:
        jacobian[3:6, -1] = normals[1]
        lower[-1], upper[-1] = 0.0, 30.0
    gravity = np.where(np.arange(count + hybrid) < count, rng.uniform(-0.2, 0.2), 0.0)
    return {
        "positions": positions,
        "normals": normals,
        "external_wrench": -np.concatenate(
            [forces.sum(axis=0), np.cross(positions, forces).sum(axis=0)]
        ),
        "jacobian": jacobian,
        "friction": friction,
        "tangents": tangents,
        "sliding": sliding,
        "torque_limits": (lower, upper),
        "max_normal_force": rng.uniform(15.0, 40.0, contacts),
        "cone_edges": edges,
        "gravity_torques": gravity,
    }


def random_problem(
    seed: int, contacts: int = 3, *, slides: int = 0, joints: int | None = None
) -> QuasistaticProblem:
    """The problem of `random_arguments`."""
    return QuasistaticProblem(**random_arguments(seed, contacts, slides=slides, joints=joints))


def structured_arguments(seed: int, kind: str, contacts: int, *, slides: int = 0) -> dict[str, Any]:
    """Arguments of a random problem whose kinematics often forbid what Coulomb friction allows.

    Fingers are levers along their contact's normal with random limits; the last `slides` contacts
    slide. All is turned by a random rotation.

    Args:
        seed: Of the random numbers.
        kind: ``slab``: a finger presses onto supports in one plane; ``pinch``: two fingers pinch
            from the sides above such supports; ``planar``: all contacts in one plane, one finger.
        contacts: M.
        slides: How many contacts slide; all in one direction but for ``planar``.
    """
    rng = np.random.default_rng(seed)
    friction = rng.uniform(0.2, 0.8, contacts)
    edges = int(rng.integers(3, 6))
    fingers = 2 if kind == "pinch" else 1
    if kind == "planar":
        at, angle = rng.uniform(0.0, 2.0 * np.pi, (2, contacts))
        angle = at + 0.4 * np.cos(angle)
        normals = np.column_stack([np.cos(angle), np.zeros(contacts), np.sin(angle)])
        positions = -0.1 * np.column_stack([np.cos(at), np.zeros(contacts), np.sin(at)])
        first = np.cross(normals, [0.0, 1.0, 0.0])
    else:
        normals = np.tile([0.0, 0.0, 1.0], (contacts, 1))
        positions = np.column_stack(
            [rng.uniform(-0.1, 0.1, (contacts, 2)), -0.1 * np.ones(contacts)]
        )
        tips = [[0, 1, 0], [0, -1, 0]] if kind == "pinch" else [[0, 0, -1]]
        normals[:fingers] = tips
        positions[:fingers] = rng.uniform(-0.03, 0.03, (fingers, 3)) - 0.1 * normals[:fingers]
        first = np.cross(normals, [0.3, 0.5, 0.81])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    tangents = np.stack([first, np.cross(normals, first)], axis=2)
    turn = rng.uniform(0.0, 2.0 * np.pi, contacts)
    direction = np.einsum("lij,lj->li", tangents, np.column_stack([np.cos(turn), np.sin(turn)]))
    inside = rng.uniform(0.5, 0.95, contacts) * np.cos(np.pi / edges)
    sliding = np.zeros((contacts, 3))
    if slides:
        inside[-slides:] = 1.0
        if kind != "planar":
            direction[-slides:] = direction[-1]
        sliding[-slides:] = -0.1 * direction[-slides:]
    press = rng.uniform(2.0, 8.0, contacts)
    forces = press[:, None] * (normals + (friction * inside)[:, None] * direction)
    levers = np.zeros((contacts, 3, fingers))
    for finger in range(fingers):
        levers[finger, :, finger] = -0.1 * normals[finger]
    wrench = -np.array([forces.sum(axis=0), np.cross(positions, forces).sum(axis=0)])
    rotation = Rotation.random(rng=rng).as_matrix()
    return {
        "positions": positions @ rotation.T,
        "normals": normals @ rotation.T,
        "external_wrench": (wrench @ rotation.T).ravel(),
        "jacobian": (rotation @ levers).reshape(3 * contacts, fingers),
        "friction": friction,
        "tangents": rotation @ tangents,
        "sliding": sliding @ rotation.T,
        "torque_limits": (-rng.uniform(1.0, 2.5, fingers), rng.uniform(0.0, 1.0, fingers)),
        "max_normal_force": 30.0,
        "cone_edges": edges,
        "gravity_torques": rng.uniform(-0.1, 0.1, fingers),
    }


def rescaled(problem: QuasistaticProblem, force: float, length: float = 1.0) -> QuasistaticProblem:
    """The problem in other units of force and length; none of its joints is linear."""
    torque = force * length
    return problem.with_changes(
        positions=length * problem.positions, jacobian=length * problem.jacobian,
        external_wrench=force * problem.external_wrench * np.repeat([1.0, length], 3),
        torque_limits=(torque * problem.lower_torque, torque * problem.upper_torque),
        max_normal_force=force * problem.max_normal_force,
        gravity_torques=torque * problem.gravity_torques,
    )  # fmt: skip


def assert_holds(solution: TorqueSolution, tolerance: float = 1e-5) -> None:
    """Check forces, torques and mode against the problem's letters, without the package's checks.

    Args:
        solution: A found solution.
        tolerance: Largest violation, N or N m.
    """
    problem, f = solution.problem, solution.contact_forces.ravel()
    np.testing.assert_allclose(problem.W @ f, -problem.external_wrench, atol=tolerance)
    torques = problem.J.T @ f + problem.gravity_torques
    np.testing.assert_allclose(solution.torques, torques, atol=1e-12)
    assert (torques >= problem.lower_torque - tolerance).all()
    assert (torques <= problem.upper_torque + tolerance).all()
    e = solution.margin
    normal = problem.N.T @ f
    assert (normal >= e - tolerance).all()
    assert (normal <= problem.max_normal_force - e + tolerance).all()
    edges = np.where(problem.has_cone, problem.cone_edges, 1)
    owner = np.repeat(np.arange(problem.contact_count), edges)
    faces = (problem.H.T @ f)[problem.has_cone[owner]]
    assert (faces <= -e + tolerance).all()
    assert e >= solution.required_margin - tolerance
    friction = (problem.T.T @ f).reshape(-1, 2)
    for contact in range(problem.contact_count):
        if problem.is_sliding[contact]:
            speed = np.linalg.norm(problem.sliding[contact])
            kinetic = problem.friction[contact] * normal[contact]
            opposing = -kinetic * problem.sliding[contact] / speed
            tangential = (
                f[3 * contact : 3 * contact + 3] - normal[contact] * problem.normals[contact]
            )
            np.testing.assert_allclose(tangential, opposing, atol=tolerance)
        elif solution.rules.static_friction == "virtual_sliding":
            signs = solution.mode.signs[contact]
            assert (signs * friction[contact] <= tolerance).all()
            if solution.rules.sign == "exact" or not solution.mode.selection[contact]:
                assert (np.abs(friction[contact][signs == 0]) <= tolerance).all()
