"""Contacts, cones, forces and sliding as meshes, with the words for each contact."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.holding.verdict import ContactState, DynamicOutcome
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only
from graspless_pin.scene.load_wrenches import ActingForce
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.active_limits import ContactLimit, contact_rooms, limiting_contacts
from graspless_pin.solution.tables import contact_states, decimals, force_rounding, friction_use
from graspless_pin.visualization.picture import (
    Mark,
    Mesh,
    Picture,
    Role,
    look_across,
    preset_views,
    up_against,
)
from graspless_pin.visualization.primitives import (
    BALL_RINGS,
    Solid,
    arrow_surface,
    ball_surface,
    pyramid_surface,
    with_bearings,
    with_force_scale,
)


def contact_words(
    problem: QuasistaticProblem, solution: TorqueSolution | None, bodies: Sequence[str] | None
) -> list[tuple[str, ...]]:
    """Return lines for each contact: its name, force, share of friction used, nearest limit.

    Args:
        problem: The contacts.
        solution: A solution that was found; None: only names and coefficients.
        bodies: M names of the bodies that touch the object; None: left out.
    """
    names = [
        f"contact {index}" + (f": {bodies[index]}" if bodies is not None else "")
        for index in range(problem.contact_count)
    ]
    if solution is None:
        return [(name, f"μ = {mu:g}") for name, mu in zip(names, problem.friction, strict=True)]
    forces, load = solution.contact_forces, problem.scales.force
    normal = np.einsum("ij,ij->i", problem.normals, forces)
    friction = np.linalg.norm(forces - normal[:, None] * problem.normals, axis=1)
    reserves, use = contact_rooms(problem, forces), friction_use(problem, forces)
    states = contact_states(problem, forces)
    limiting, rounding = limiting_contacts(solution).items(), force_rounding(problem)
    lines = []
    for index, name in enumerate(names):
        use_text = f", {100.0 * use[index]:.0f} % of what μ = {problem.friction[index]:g} allows"
        nearest = int(np.argmin(reserves[index]))
        limits = [limit for limit, contacts in limiting if index in contacts]
        reserve, own_normal, own_friction = (
            decimals(float(one), load, "", rounding[index])
            for one in (reserves[index, nearest], normal[index], friction[index])
        )
        distance = f"{reserve} N from "
        distance += " and ".join(limits) or tuple(ContactLimit)[nearest]
        lines.append(
            (
                name,
                f"normal force {own_normal} N",
                f"friction {own_friction} N"
                + ("" if np.isnan(use[index]) else use_text)
                + f" ({states[index]})",
                distance + (", which limits the margin" if limits else ""),
            )
        )
    return lines


# Lengths as shares of the size of the object.
_LONGEST_FORCE = 0.9
_SLIDING_ARROW = 0.45
_CONE_HEIGHT = 0.3
_MOMENT_ARROW = 0.6
_BALL = 0.035
_SHAFT = 0.02
# The tangential forces of frictionless contacts are rounding.
_NO_FORCE = 1e-6
_CONE_OPACITY = 0.4
_ROUND = 64  # edges of a round cone
_NICE = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
OUTCOME_ROLES = {
    ContactState.STICKING: Role.STICKING_CONTACT,
    ContactState.SLIPPING: Role.SLIPPING_CONTACT,
    ContactState.CLOSED: Role.SLIPPING_CONTACT,  # it slides as declared
    ContactState.OPEN: Role.OPEN_CONTACT,
}
# Radius as a share of the object's, rings and opacity: told apart without colours, too.
_MARKS = {
    Role.STICKING_CONTACT: (_BALL, BALL_RINGS, 1.0),
    Role.SLIPPING_CONTACT: (1.8 * _BALL, 2, 1.0),
    Role.OPEN_CONTACT: (1.8 * _BALL, BALL_RINGS, 0.6),
}


def draw_contacts(
    problem: QuasistaticProblem,
    solution: TorqueSolution | None = None,
    *,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    bodies: Sequence[str] | None = None,
) -> Picture:
    """Draw contacts, and with a solution that was found its forces and virtual sliding.

    Args:
        problem: The contacts.
        solution: A solution of the problem; None, or not found: only the contacts.
        origin: (3,) the problem's reference point in the picture, m.
        bodies: M names of the bodies that touch the object; None: not known.

    Raises:
        ArgumentError: ``origin`` is not three finite numbers.
    """
    center = finite_array("origin", origin, (3,))
    size = float(np.linalg.norm(problem.positions, axis=1).max()) or 1.0
    up, no_points = up_against(_load_force(problem)), np.zeros((0, 4))
    view_from = look_across(np.zeros(3), up)
    views = preset_views(np.zeros(3), up, (), no_points)
    picture = Picture((), center, 1.2 * size, up, view_from, views)
    picture = with_bearings(picture, size, None, no_points)
    return with_contacts(picture, problem, solution, center, size, None, bodies)


def _load_force(problem: QuasistaticProblem) -> FloatArray:
    """Return the (3,) force on one free object, N; zero in other coordinates."""
    return problem.external_wrench[:3] if problem.wrench_matrix is None else np.zeros(3)


def with_contacts(
    picture: Picture,
    problem: QuasistaticProblem,
    solution: TorqueSolution | None,
    origin: FloatArray,
    size: float,
    force_scale: float | None,
    bodies: Sequence[str] | None,
) -> Picture:
    """Return a picture with contacts, their numbers, and what `draw_contacts` draws of a solution.

    Args:
        picture: The picture.
        problem: The contacts.
        solution: See `draw_contacts`.
        origin: (3,) the problem's reference point in the picture, m.
        size: Radius of the object, m.
        force_scale: Metres per newton; None: a round figure with which the largest force is about
            as long as the object's radius.
        bodies: M names of the bodies that touch the object; None: not known.
    """
    points = problem.positions + origin
    meshes = [
        _contact_mesh(Role.CONTACT, index, ball_surface(point, _BALL * size))
        for index, point in enumerate(points)
    ]
    meshes += _cone_meshes(problem, points, _CONE_HEIGHT * size)
    meshes += _velocity_meshes(Role.SLIDING, problem.sliding, points, size)
    found = solution if solution is not None and solution.found else None
    marks = [
        Mark(str(index), Role.CONTACT, read_only(point), index, words)
        for index, (point, words) in enumerate(
            zip(points, contact_words(problem, found, bodies), strict=True)
        )
    ]
    if found is not None:
        forces = found.contact_forces
        states = contact_states(problem, forces)
        at_limit = [state in ("sliding", "at its limit") for state in states]
        chosen = _fitting_force_scale(forces, size) if force_scale is None else force_scale
        meshes += _force_meshes(problem, forces, at_limit, points, chosen, _SHAFT * size)
        meshes += _velocity_meshes(Role.VIRTUAL_SLIDING, virtual_velocities(found), points, size)
        picture = with_force_scale(picture, chosen, size)
        load = _load_force(problem)
        if chosen > 0.0 and (load @ load) > _NO_FORCE**2 * (forces * forces).sum():
            arrow = arrow_surface(origin, chosen * load, _SHAFT * size)
            meshes.append(Mesh(str(Role.EXTERNAL_FORCE), Role.EXTERNAL_FORCE, *arrow))
    return replace(picture, meshes=(*picture.meshes, *meshes), marks=(*picture.marks, *marks))


def with_loads(
    picture: Picture, loads: Sequence[ActingForce], origin: FloatArray, size: float
) -> Picture:
    """Return a picture with the loads on the object besides its weight.

    Forces are arrows from the points that they act on; moments are arrows with two heads along
    their axes, all of one length.

    Args:
        picture: The picture; where it has no scale of forces, one that fits the loads is added.
        loads: The forces and moments on the object.
        origin: (3,) the object's centre of mass in the picture, m.
        size: Radius of the object, m.
    """
    if not loads:
        return picture
    if picture.force_scale is None:
        scale = _fitting_force_scale(np.array([one.force for one in loads]), size)
        picture = with_force_scale(picture, scale, size)
    scale = 0.0 if picture.force_scale is None else picture.force_scale.metres_per_newton
    meshes, texts = [], dict[bytes, list[tuple[FloatArray, str, str]]]()
    for number, one in enumerate(loads):
        point, ends = origin + one.lever, []
        if one.force.any():
            ends.append(scale * one.force)
        if one.moment.any():
            axis = one.moment / np.linalg.norm(one.moment)
            ends += [_MOMENT_ARROW * size * axis, 0.8 * _MOMENT_ARROW * size * axis]
        for part, end in enumerate(ends):
            arrow = arrow_surface(point, end, _SHAFT * size)
            meshes.append(Mesh(f"{Role.LOAD}/{number}/{part}", Role.LOAD, *arrow))
        force, moment = (float(np.linalg.norm(part)) for part in (one.force, one.moment))
        words = [f"force {force:.3g} N"] if force else []
        words += [f"moment {moment:.3g} N m"] if moment else []
        if ends:
            label = point + 1.08 * ends[0], one.name, f"{one.name}: {', '.join(words)}"
            texts.setdefault(one.lever.tobytes(), []).append(label)
    # One text at each point: names of several loads there would cover each other.
    marks = []
    for texts_here in texts.values():
        tips, names, lines = zip(*texts_here, strict=True)
        name = ", ".join(names)
        marks.append(Mark(name, Role.LOAD, read_only(tips[0]), words=(name, *lines)))
    return replace(picture, meshes=(*picture.meshes, *meshes), marks=(*picture.marks, *marks))


def with_outcome(
    picture: Picture,
    problem: QuasistaticProblem,
    motion: DynamicOutcome,
    origin: FloatArray,
    size: float,
) -> Picture:
    """Return a picture with the state of each contact in an outcome, and its force.

    Args:
        picture: The picture.
        problem: The problem of the outcome.
        motion: The outcome.
        origin: (3,) the problem's reference point in the picture, m.
        size: Radius of the object, m.
    """
    points, forces = problem.positions + origin, motion.contact_forces
    meshes = []
    for index, state in enumerate(motion.states):
        role = OUTCOME_ROLES[state]
        radius, rings, opacity = _MARKS[role]
        mark = ball_surface(points[index], radius * size, rings)
        meshes.append(_contact_mesh(role, index, mark, opacity))
    slips = [OUTCOME_ROLES[state] is Role.SLIPPING_CONTACT for state in motion.states]
    scale = _fitting_force_scale(forces, size)
    meshes += _force_meshes(problem, forces, slips, points, scale, _SHAFT * size)
    marks = [
        Mark(str(index), Role.CONTACT, read_only(point), index)
        for index, point in enumerate(points)
    ]
    picture = with_force_scale(picture, scale, size)
    return replace(picture, meshes=(*picture.meshes, *meshes), marks=(*picture.marks, *marks))


def _fitting_force_scale(forces: FloatArray, size: float) -> float:
    """Return metres per newton, a round figure with which the largest force just fits."""
    largest = float(np.linalg.norm(forces, axis=1).max())
    if largest <= 0.0:
        return 0.0
    per_metre = largest / (_LONGEST_FORCE * size)
    power = 10.0 ** np.floor(np.log10(per_metre))
    return 1.0 / (power * min(nice for nice in _NICE if nice * power >= (1.0 - 1e-9) * per_metre))


def virtual_velocities(solution: TorqueSolution) -> FloatArray:
    """(M, 3) velocities of the object relative to the other body in one virtual motion of the mode.

    World axes, in an arbitrary common scale; zero where the mode selects no virtual sliding, and
    everywhere with Coulomb friction, which requires none.
    """
    problem, mode = solution.problem, solution.mode
    velocities = np.zeros((problem.contact_count, 3))
    if solution.rules.static_friction is StaticFriction.COULOMB or not mode.selection.any():
        return velocities
    motion = solution.motion
    if motion is not None:
        passive = problem.passive_count
        moved = problem.W.T @ motion[:passive] - problem.J @ motion[passive:]
        velocities[mode.selection] = moved.reshape(-1, 3)[mode.selection]
    return velocities


def _cone_meshes(problem: QuasistaticProblem, points: FloatArray, height: float) -> Iterator[Mesh]:
    """Return the cones, of one height along the normal, with the problem's own edges if any."""
    model = problem.cone_model
    corners = model.section(_ROUND if model.second_order else problem.cone_edges).corners
    for index in np.flatnonzero(problem.has_cone).tolist():
        frame = np.column_stack([problem.normals[index], problem.tangents[index]])
        local = np.column_stack([np.ones(len(corners)), problem.friction[index] * corners])
        # A steep cone keeps its slant height, or wide cones would hide everything.
        slant = float(np.hypot(1.0, problem.friction[index]))
        edges = height / max(1.0, slant * np.sqrt(0.5)) * local @ frame.T
        if np.linalg.det(frame) < 0.0:  # edges run the other way round
            edges = edges[::-1]
        yield _contact_mesh(Role.CONE, index, pyramid_surface(points[index], edges), _CONE_OPACITY)


def _force_meshes(
    problem: QuasistaticProblem,
    forces: FloatArray,
    at_limit: Sequence[bool],
    points: FloatArray,
    scale: float,
    radius: float,
) -> Iterator[Mesh]:
    """Return normal force, friction and their sum at each contact, where they are long enough."""
    normal = np.einsum("ij,ij->i", problem.normals, forces)[:, None] * problem.normals
    friction = forces - normal
    shortest = _NO_FORCE * max(1.0, float(np.linalg.norm(forces, axis=1).max()))
    for index, point in enumerate(points):
        parts = {
            Role.NORMAL_FORCE: normal[index],
            Role.FRICTION_AT_LIMIT if at_limit[index] else Role.FRICTION_FORCE: friction[index],
        }
        if np.linalg.norm(friction[index]) > shortest:
            parts[Role.TOTAL_FORCE] = forces[index]
        for role, force in parts.items():
            if scale > 0.0 and np.linalg.norm(force) > shortest:
                shaft = 0.5 * radius if role is Role.TOTAL_FORCE else radius
                yield _contact_mesh(role, index, arrow_surface(point, scale * force, shaft))


def _velocity_meshes(
    role: Role, velocities: FloatArray, points: FloatArray, size: float
) -> Iterator[Mesh]:
    """Return arrows of velocities: the fastest of a fixed length, others of at least half of it."""
    speeds = np.linalg.norm(velocities, axis=1)
    fastest = float(speeds.max(initial=0.0))
    for index in np.flatnonzero(speeds > 1e-9 * fastest).tolist():
        share = max(0.5, speeds[index] / fastest)
        along = share * _SLIDING_ARROW * size * velocities[index] / speeds[index]
        yield _contact_mesh(role, index, arrow_surface(points[index], along, 0.8 * _SHAFT * size))


def _contact_mesh(role: Role, contact: int, surface: Solid, opacity: float = 1.0) -> Mesh:
    vertices, faces = surface
    return Mesh(f"{role}/{contact}", role, vertices, faces, opacity, contact)
