"""Contacts, cones, forces and sliding as meshes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array
from graspless_pin.problem.cones import cone_edges_local
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.utilization import contact_state
from graspless_pin.visualization.looking import look_across, up_against
from graspless_pin.visualization.picture import Mesh, Picture, Role
from graspless_pin.visualization.solids import Surface, arrow, ball, pyramid

# Lengths as shares of the size of the object.
_LONGEST_FORCE = 0.9
_SLIDING_ARROW = 0.45
_CONE_HEIGHT = 0.3
_BALL = 0.035
_SHAFT = 0.02
# The tangential forces of frictionless contacts are rounding.
_NO_FORCE = 1e-6
_CONE_OPACITY = 0.4


def draw_contacts(
    problem: QuasistaticProblem,
    solution: TorqueSolution | None = None,
    *,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    size: float | None = None,
    force_scale: float | None = None,
) -> Picture:
    """Draw contacts, and with a solution that was found forces and virtual sliding.

    Args:
        problem: The contacts.
        solution: A solution of the problem; None, or not found: only the contacts.
        origin: (3,) the problem's reference point in the picture, m.
        size: Radius of the object, to which sizes are fitted, m; None: of the contacts.
        force_scale: Metres per newton; None: the largest force is about as long as the object's
            radius.

    Raises:
        ArgumentError: ``origin`` is not three finite numbers.
    """
    center = finite_array("origin", origin, (3,))
    if size is None:
        size = float(np.linalg.norm(problem.positions, axis=1).max()) or 1.0
    meshes = contact_meshes(problem, solution, center, size, force_scale)
    up = up_against(problem.external_wrench[:3])
    return Picture(meshes, center, 1.2 * size, up, look_across(np.zeros(3), up))


def contact_meshes(
    problem: QuasistaticProblem,
    solution: TorqueSolution | None,
    origin: FloatArray,
    size: float,
    force_scale: float | None,
) -> tuple[Mesh, ...]:
    """Return the meshes of `draw_contacts`."""
    points = problem.positions + origin
    meshes = [
        _mesh(Role.CONTACT, index, ball(point, _BALL * size)) for index, point in enumerate(points)
    ]
    meshes += _cones(problem, points, _CONE_HEIGHT * size)
    meshes += _velocities(Role.SLIDING, problem.sliding, points, size)
    if solution is not None and solution.found:
        scale = default_force_scale(solution, size) if force_scale is None else force_scale
        meshes += _forces(solution, points, scale, _SHAFT * size)
        meshes += _velocities(Role.VIRTUAL_SLIDING, virtual_velocities(solution), points, size)
    return tuple(meshes)


def default_force_scale(solution: TorqueSolution, size: float) -> float:
    """Metres per newton at which the largest contact force fits an object of this radius (m)."""
    largest = float(np.linalg.norm(solution.contact_forces, axis=1).max())
    return _LONGEST_FORCE * size / largest if largest > 0.0 else 0.0


def virtual_velocities(solution: TorqueSolution) -> FloatArray:
    """(M, 3) velocities of the object relative to the other body in one virtual motion of the mode.

    World axes, to scale among each other; zero where the mode selects no virtual sliding, and
    everywhere with Coulomb friction, which asks for none.
    """
    problem, mode = solution.problem, solution.mode
    velocities = np.zeros((problem.contact_count, 3))
    if solution.rules.static_friction is StaticFriction.COULOMB or not mode.selection.any():
        return velocities
    motion = solution.motion
    if motion is not None:
        moved = problem.W.T @ motion[:6] - problem.J @ motion[6:]
        velocities[mode.selection] = moved.reshape(-1, 3)[mode.selection]
    return velocities


def _cones(problem: QuasistaticProblem, points: FloatArray, height: float) -> Iterator[Mesh]:
    """Return the cones, of one height along the normal, with the problem's own edges."""
    for index in np.flatnonzero(problem.has_cone).tolist():
        local = cone_edges_local(float(problem.friction[index]), problem.cone_edges)
        frame = np.column_stack([problem.normals[index], problem.tangents[index]])
        # A steep cone keeps its slant height, or wide cones would hide everything.
        stretch = height / max(local[0, 0], np.sqrt(0.5))
        edges = stretch * (frame @ local).T
        if np.linalg.det(frame) < 0.0:  # edges run the other way round
            edges = edges[::-1]
        yield _mesh(Role.CONE, index, pyramid(points[index], edges), _CONE_OPACITY)


def _forces(
    solution: TorqueSolution, points: FloatArray, scale: float, radius: float
) -> Iterator[Mesh]:
    """Return normal force, friction and their sum at each contact, as far as they can be seen."""
    problem, forces = solution.problem, solution.contact_forces
    normal = np.einsum("ij,ij->i", problem.normals, forces)[:, None] * problem.normals
    friction = forces - normal
    seen = _NO_FORCE * max(1.0, float(np.linalg.norm(forces, axis=1).max()))
    for index, point in enumerate(points):
        at_limit = contact_state(problem, forces, index) in ("sliding", "at its limit")
        parts = {
            Role.NORMAL_FORCE: normal[index],
            Role.FRICTION_AT_LIMIT if at_limit else Role.FRICTION_FORCE: friction[index],
        }
        if np.linalg.norm(friction[index]) > seen:
            parts[Role.TOTAL_FORCE] = forces[index]
        for role, force in parts.items():
            if scale > 0.0 and np.linalg.norm(force) > seen:
                slim = 0.5 * radius if role is Role.TOTAL_FORCE else radius
                yield _mesh(role, index, arrow(point, scale * force, slim))


def _velocities(
    role: Role, velocities: FloatArray, points: FloatArray, size: float
) -> Iterator[Mesh]:
    """Arrows along velocities; the fastest has a fixed length, slower ones at least half of it."""
    speeds = np.linalg.norm(velocities, axis=1)
    fastest = float(speeds.max(initial=0.0))
    for index in np.flatnonzero(speeds > 1e-9 * fastest).tolist():
        share = max(0.5, speeds[index] / fastest)
        along = share * _SLIDING_ARROW * size * velocities[index] / speeds[index]
        yield _mesh(role, index, arrow(points[index], along, 0.8 * _SHAFT * size))


def _mesh(role: Role, contact: int, surface: Surface, opacity: float = 1.0) -> Mesh:
    vertices, faces = surface
    return Mesh(f"{role}/{contact}", role, vertices, faces, opacity, contact)
