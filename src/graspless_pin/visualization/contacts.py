"""Contacts, cones, forces and sliding as meshes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.holding.verdict import ContactState, DynamicOutcome
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array
from graspless_pin.problem.cones import cone_edges_local, default_tangents
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.utilization import contact_state
from graspless_pin.visualization.looking import look_across, up_against
from graspless_pin.visualization.picture import Mesh, Picture, Role

# Lengths as shares of the size of the object.
_LONGEST_FORCE = 0.9
_SLIDING_ARROW = 0.45
_CONE_HEIGHT = 0.3
_BALL = 0.035
_SHAFT = 0.02
# The tangential forces of frictionless contacts are rounding.
_NO_FORCE = 1e-6
_CONE_OPACITY = 0.4
_ROUND = 64  # edges of a round cone
_SECTIONS = 12  # of an arrow's circles
_BALL_RINGS = 6
OUTCOME_ROLES = {
    ContactState.STICKING: Role.STICKING_CONTACT,
    ContactState.SLIPPING: Role.SLIPPING_CONTACT,
    ContactState.CLOSED: Role.SLIPPING_CONTACT,  # it slides as declared
    ContactState.OPEN: Role.OPEN_CONTACT,
}
# Radius as a share of the object's, rings and opacity: told apart without colours, too.
_MARKS = {
    Role.STICKING_CONTACT: (_BALL, _BALL_RINGS, 1.0),
    Role.SLIPPING_CONTACT: (1.8 * _BALL, 2, 1.0),
    Role.OPEN_CONTACT: (1.8 * _BALL, _BALL_RINGS, 0.6),
}
_Surface = tuple[FloatArray, NDArray[np.int64]]
"""(V, 3) vertices and (F, 3) faces."""


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
        _mesh(Role.CONTACT, index, _ball(point, _BALL * size)) for index, point in enumerate(points)
    ]
    meshes += _cones(problem, points, _CONE_HEIGHT * size)
    meshes += _velocities(Role.SLIDING, problem.sliding, points, size)
    if solution is not None and solution.found:
        forces = solution.contact_forces
        scale = default_force_scale(solution, size) if force_scale is None else force_scale
        states = [contact_state(problem, forces, index) for index in range(len(points))]
        at_limit = [state in ("sliding", "at its limit") for state in states]
        meshes += _forces(problem, forces, at_limit, points, scale, _SHAFT * size)
        meshes += _velocities(Role.VIRTUAL_SLIDING, virtual_velocities(solution), points, size)
    return tuple(meshes)


def outcome_meshes(
    problem: QuasistaticProblem, motion: DynamicOutcome, origin: FloatArray, size: float
) -> tuple[Mesh, ...]:
    """Return each contact by what it does in an outcome, and the forces there.

    Args:
        problem: What it is an outcome of.
        motion: The outcome.
        origin: (3,) the problem's reference point in the picture, m.
        size: Radius of the object, m.
    """
    points, forces = problem.positions + origin, motion.contact_forces
    meshes = []
    for index, state in enumerate(motion.states):
        role = OUTCOME_ROLES[state]
        radius, rings, opacity = _MARKS[role]
        mark = _ball(points[index], radius * size, rings)
        meshes.append(_mesh(role, index, mark, opacity))
    slips = [OUTCOME_ROLES[state] is Role.SLIPPING_CONTACT for state in motion.states]
    scale = _fitting_scale(forces, size)
    return (*meshes, *_forces(problem, forces, slips, points, scale, _SHAFT * size))


def default_force_scale(solution: TorqueSolution, size: float) -> float:
    """Metres per newton at which the largest contact force fits an object of this radius (m)."""
    return _fitting_scale(solution.contact_forces, size)


def _fitting_scale(forces: FloatArray, size: float) -> float:
    largest = float(np.linalg.norm(forces, axis=1).max())
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
    """Return the cones, of one height along the normal, with the problem's own edges if any."""
    count = _ROUND if problem.is_round else problem.cone_edges
    for index in np.flatnonzero(problem.has_cone).tolist():
        local = cone_edges_local(float(problem.friction[index]), count)
        frame = np.column_stack([problem.normals[index], problem.tangents[index]])
        # A steep cone keeps its slant height, or wide cones would hide everything.
        stretch = height / max(local[0, 0], np.sqrt(0.5))
        edges = stretch * (frame @ local).T
        if np.linalg.det(frame) < 0.0:  # edges run the other way round
            edges = edges[::-1]
        yield _mesh(Role.CONE, index, _pyramid(points[index], edges), _CONE_OPACITY)


def _forces(
    problem: QuasistaticProblem,
    forces: FloatArray,
    at_limit: Sequence[bool],
    points: FloatArray,
    scale: float,
    radius: float,
) -> Iterator[Mesh]:
    """Return normal force, friction and their sum at each contact, as far as they can be seen."""
    normal = np.einsum("ij,ij->i", problem.normals, forces)[:, None] * problem.normals
    friction = forces - normal
    seen = _NO_FORCE * max(1.0, float(np.linalg.norm(forces, axis=1).max()))
    for index, point in enumerate(points):
        parts = {
            Role.NORMAL_FORCE: normal[index],
            Role.FRICTION_AT_LIMIT if at_limit[index] else Role.FRICTION_FORCE: friction[index],
        }
        if np.linalg.norm(friction[index]) > seen:
            parts[Role.TOTAL_FORCE] = forces[index]
        for role, force in parts.items():
            if scale > 0.0 and np.linalg.norm(force) > seen:
                slim = 0.5 * radius if role is Role.TOTAL_FORCE else radius
                yield _mesh(role, index, _arrow(point, scale * force, slim))


def _velocities(
    role: Role, velocities: FloatArray, points: FloatArray, size: float
) -> Iterator[Mesh]:
    """Arrows along velocities; the fastest has a fixed length, slower ones at least half of it."""
    speeds = np.linalg.norm(velocities, axis=1)
    fastest = float(speeds.max(initial=0.0))
    for index in np.flatnonzero(speeds > 1e-9 * fastest).tolist():
        share = max(0.5, speeds[index] / fastest)
        along = share * _SLIDING_ARROW * size * velocities[index] / speeds[index]
        yield _mesh(role, index, _arrow(points[index], along, 0.8 * _SHAFT * size))


def _mesh(role: Role, contact: int, surface: _Surface, opacity: float = 1.0) -> Mesh:
    vertices, faces = surface
    return Mesh(f"{role}/{contact}", role, vertices, faces, opacity, contact)


def _arrow(start: ArrayLike, along: ArrayLike, radius: float) -> _Surface:
    """Return an arrow: a shaft and a head whose tip is at the end.

    Args:
        start: (3,) where it starts, m.
        along: (3,) from its start to its tip, m; not zero.
        radius: Radius of the shaft, m; the head is wider, and both are slimmer on a short arrow.
    """
    vector = np.asarray(along, dtype=float)
    length = float(np.linalg.norm(vector))
    shaft = min(radius, 0.12 * length)
    head = min(5.0 * shaft, 0.45 * length)
    profile = [(0.0, 0.0), (shaft, 0.0), (shaft, length - head), (2.2 * shaft, length - head)]
    return _turned([*profile, (0.0, length)], start, vector / length)


def _ball(center: ArrayLike, radius: float, rings: int = _BALL_RINGS) -> _Surface:
    """Return a ball about (3,) ``center``, m; of two rings: a diamond."""
    angles = np.linspace(0.0, np.pi, rings + 1)
    profile = [(radius * np.sin(angle), -radius * np.cos(angle)) for angle in angles]
    profile[0], profile[-1] = (0.0, -radius), (0.0, radius)
    return _turned(profile, center, np.array([0.0, 0.0, 1.0]))


def _pyramid(apex: ArrayLike, edges: FloatArray) -> _Surface:
    """Return the cone between an apex and the ends of its edges.

    Args:
        apex: (3,) m.
        edges: (r, 3) from the apex to the corners of the base, m, in the order that turns
            right-handed about the axis from the apex to the base.
    """
    tip = np.asarray(apex, dtype=float)
    count = len(edges)
    vertices = np.vstack([tip, tip + edges, tip + edges.mean(axis=0)])
    here = np.arange(1, count + 1)
    following = np.roll(here, -1)
    sides = np.column_stack([np.zeros(count, dtype=int), following, here])
    base = np.column_stack([np.full(count, count + 1), here, following])
    return vertices, np.vstack([sides, base]).astype(np.int64)


def _turned(profile: list[tuple[float, float]], start: ArrayLike, axis: FloatArray) -> _Surface:
    """Turn a profile of (radius, height) about an axis; it begins and ends on the axis."""
    t1, t2 = default_tangents(axis[None])[0].T
    origin = np.asarray(start, dtype=float)
    angles = 2.0 * np.pi * np.arange(_SECTIONS) / _SECTIONS
    circle = np.cos(angles)[:, None] * t1 + np.sin(angles)[:, None] * t2
    rings = [radius * circle + height * axis for radius, height in profile[1:-1]]
    ends = [profile[0][1] * axis, profile[-1][1] * axis]
    vertices = origin + np.vstack([ends[0], *rings, ends[1]])
    here = np.arange(_SECTIONS)
    following = np.roll(here, -1)
    last = len(vertices) - 1
    faces = [np.column_stack([np.zeros_like(here), 1 + following, 1 + here])]
    for ring in range(len(rings) - 1):
        low, high = 1 + ring * _SECTIONS, 1 + (ring + 1) * _SECTIONS
        faces.append(np.column_stack([low + here, low + following, high + following]))
        faces.append(np.column_stack([low + here, high + following, high + here]))
    top = last - _SECTIONS
    faces.append(np.column_stack([top + here, top + following, np.full_like(here, last)]))
    return vertices, np.vstack(faces).astype(np.int64)
