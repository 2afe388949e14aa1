"""Pictures of a scene with its solution.

The centre of mass, and its tolerated region, are drawn inside the object.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from graspless_pin.algorithms.tolerance_tables import Tolerance, Tolerances
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.errors import ArgumentError, MeshError
from graspless_pin.geometry.bodies.meshes import (
    Triangles,
    file_triangles,
    simplified,
    slab_triangles,
)
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import HalfSpace, shape_of
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.robot_model import LinkMesh, LinkShape
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.scene import Scene
from graspless_pin.scene.load_wrenches import acting_forces
from graspless_pin.solution import TorqueSolution
from graspless_pin.visualization.contacts import with_contacts, with_loads
from graspless_pin.visualization.picture import (
    Mesh,
    Picture,
    Role,
    across_gravity,
    look_across,
    preset_views,
    up_against,
)
from graspless_pin.visualization.primitives import Solid, ball_surface, bar_surface, with_bearings

_BOUNDARY_ANGLES = 72
_OFF_PLANE = 1e-6  # of a change
# Lengths as shares of the size of the object.
_BALL = 0.045
_RIM = 0.012
_FARTHEST_REGION = 1.1
_LEAST_REGION = 1e-3
_REGION_OPACITY = 0.85


def level_boundary(one: Tolerance, level: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the boundary of a tolerance in a plane: (K,) angles, rad, and (K,) largest changes.

    Args:
        one: A tolerance with a boundary.
        level: (2, 3) unit vectors that span the plane, the first at angle 0.
    """
    angles = 2.0 * np.pi * np.arange(_BOUNDARY_ANGLES) / _BOUNDARY_ANGLES
    if one.boundary is not None:  # with each corner that lies in the plane
        along = one.boundary @ level.T
        sizes = np.linalg.norm(one.boundary, axis=1)
        corners = along[
            (sizes > 0.0) & (np.linalg.norm(along, axis=1) > (1.0 - _OFF_PLANE) * sizes)
        ]
        turned = np.arctan2(corners[:, 1], corners[:, 0]) % (2.0 * np.pi)
        angles = np.unique(np.append(angles, turned).round(9))
    return angles, one.along(_rays(angles, level))


def with_tolerances(
    picture: Picture, tolerances: Tolerances, origin: FloatArray, size: float
) -> Picture:
    """Return a picture with the centre of mass and the level region in which it may lie.

    The region ends at 1.1 radii of the object, without a rim there; a mere point is not drawn.

    Args:
        picture: The picture.
        tolerances: Without a tolerance of the centre of mass nothing is added.
        origin: (3,) the object's centre of mass in the picture, m.
        size: Radius of the object, m.
    """
    center_tolerances = [one for one in tolerances.each if one.quantity is Quantity.CENTER]
    if not center_tolerances:
        return picture
    role = Role.CENTER_OF_MASS
    meshes = [Mesh(str(role), role, *ball_surface(origin, _BALL * size))]
    level = across_gravity(tolerances.weight)
    angles, radii = level_boundary(center_tolerances[0], level)
    if float(radii.max()) > _LEAST_REGION * size:
        role, within = Role.CENTER_REGION, radii < _FARTHEST_REGION * size
        ends = origin + np.minimum(radii, _FARTHEST_REGION * size)[:, None] * _rays(angles, level)
        meshes.append(Mesh(f"{role}/inside", role, *_fan_surface(origin, ends), _REGION_OPACITY))
        rim = [
            bar_surface(ends[k - 1], ends[k], _RIM * size)
            for k in np.flatnonzero(within & np.roll(within, 1)).tolist()
        ]
        if rim:
            meshes.append(Mesh(f"{role}/rim", role, *_joined_solid(rim)))
    return replace(picture, meshes=(*picture.meshes, *meshes))


def _rays(angles: FloatArray, level: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(angles), np.sin(angles)]) @ level


def _fan_surface(middle: FloatArray, ends: FloatArray) -> Solid:
    """Return the triangles between a point and neighbouring ends all around it."""
    here = np.arange(1, len(ends) + 1)
    faces = np.column_stack([np.zeros_like(here), here, np.roll(here, -1)])
    return read_only(np.vstack([middle, ends])), faces.astype(np.int64)


def _joined_solid(solids: list[Solid]) -> Solid:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in solids[:-1])])
    faces = [faces + start for (_, faces), start in zip(solids, starts, strict=True)]
    return read_only(np.vstack([vertices for vertices, _ in solids])), np.vstack(faces)


_OBJECT_OPACITY = 0.45
# Of a wall between the object and the camera.
_WALL_OPACITY = 0.3
_FACING = 0.1
# Planes whose normals have a larger upward part are floors: views stay above them.
_UPWARD = 0.2
# In radii of the object: hands without a finger that is nearer are context, as arms are.
_CLOSE = 3.5
# A half-space is drawn this wide on each side of the object, and this deep, in its radii.
_SLAB_WIDTH = 1.3
_SLAB_THICKNESS = 0.08


def draw_scene(
    scene: Scene,
    solution: TorqueSolution | None = None,
    *,
    tolerances: Tolerances | None = None,
    force_scale: float | None = None,
    max_faces: int = 1500,
) -> Picture:
    """Draw hand, object, supports and contacts, and with a solution forces and virtual sliding.

    Args:
        scene: The scene.
        solution: A solution of ``scene.problem()``; None, or not found: without forces.
        tolerances: Of ``scene.tolerances``: the centre of mass is drawn, and the level region in
            which it may lie, cut off near the object; None: neither.
        force_scale: Metres per newton; None: a round figure, fitted to the object.
        max_faces: Most triangles of one link, object or support; finer meshes are simplified.

    Raises:
        ArgumentError: The solution is of a problem with other contacts.
        SceneError: The contacts cannot be found, see `Scene.contacts`.
        MeshError: A mesh file is missing or unreadable.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.visualization import Role, draw_scene
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> picture = draw_scene(scene, scene.solve())
        >>> len(picture.of(Role.NORMAL_FORCE))
        6
    """
    problem = scene.problem() if solution is None else solution.problem
    points = np.array([point.position for point in scene.contacts.points])
    origin = scene.object.center_of_mass_world
    if len(points) != problem.contact_count or not np.allclose(points, problem.positions + origin):
        raise ArgumentError(
            "solution", "belongs to a problem whose contacts are not those of the scene"
        )
    bodies = draw_bodies(scene, max_faces=max_faces)
    names = scene.contacts.bodies
    size = object_radius(bodies)
    picture = with_contacts(bodies, problem, solution, origin, size, force_scale, names)
    picture = with_loads(picture, acting_forces(scene), origin, size)
    return picture if tolerances is None else with_tolerances(picture, tolerances, origin, size)


def draw_bodies(scene: Scene, *, max_faces: int = 1500) -> Picture:
    """Draw hand, object and supports without contacts, wherever they are.

    Args:
        scene: The scene.
        max_faces: Most triangles of one link, object or support; finer meshes are simplified.

    Raises:
        MeshError: A mesh file is missing or unreadable.
    """
    body = scene.object.shape.surface(max_faces)
    body = body.moved(scene.object.T_world_object)
    middle, size = _enclosing_sphere(body.vertices)
    hand = [] if scene.hand is None else _hand_meshes(scene.hand, max_faces)
    close = [] if scene.hand is None else _close_vertices(scene.hand, hand, middle, size)
    shown = np.vstack([body.vertices, *close])
    center, radius = _enclosing_sphere(shown)
    up = up_against(scene.gravity)
    away = shown[len(body.vertices) :].mean(axis=0) - middle if any(map(len, close)) else 0.0 * up
    walls = [
        support.T_world_support[:3, 2]
        for support in scene.supports
        if isinstance(support.shape, HalfSpace)
    ]
    view_from = look_across(away, up, walls)
    supports = [_support_mesh(one, middle, size, max_faces, view_from) for one in scene.supports]
    planes = _bounding_planes(scene.supports, supports, body, up)
    floors = planes[planes[:, :3] @ up > _UPWARD]
    fingers = () if scene.hand is None else tuple(scene.hand.fingers)
    meshes = (
        *hand,
        _body_mesh(f"object/{scene.object.name}", Role.OBJECT, body, _OBJECT_OPACITY),
        *supports,
    )
    upright = [wall for wall in walls if wall @ up <= _UPWARD]
    views = preset_views(away, up, upright, floors)
    picture = Picture(
        meshes, read_only(center), radius, up, view_from, views, read_only(floors), fingers
    )
    return with_bearings(picture, size, scene.gravity, planes)


def _bounding_planes(
    supports: Sequence[Support], meshes: Sequence[Mesh], body: Triangles, up: FloatArray
) -> FloatArray:
    """(K, 4) planes with the object in front: of half-spaces, and below it of what carries it.

    Args:
        supports: The supports.
        meshes: Their meshes.
        body: The object's triangles.
        up: (3,) unit.
    """
    lowest, planes = float((body.vertices @ up).min()), []
    for support, mesh in zip(supports, meshes, strict=True):
        if isinstance(support.shape, HalfSpace):
            T = support.T_world_support
            planes.append([*T[:3, 2], T[:3, 2] @ T[:3, 3]])
        elif np.median(mesh.vertices @ up) < lowest:
            planes.append([*up, lowest])
    return np.array(planes).reshape(-1, 4)


def object_radius(picture: Picture) -> float:
    """Return the radius of the sphere that holds the picture's object, m."""
    return _enclosing_sphere(picture.of(Role.OBJECT)[0].vertices)[1]


def _hand_meshes(hand: Hand, max_faces: int) -> list[Mesh]:
    names = list(hand.fingers)
    meshes = []
    for index, (link, triangles) in enumerate(hand_triangles(hand, max_faces=max_faces)):
        mesh, finger = (
            _body_mesh(f"hand/{index}/{link}", Role.HAND, triangles, 1.0),
            hand.finger_of(link),
        )
        meshes.append(mesh if finger is None else replace(mesh, finger=names.index(finger)))
    return meshes


def _close_vertices(
    hand: Hand, meshes: Sequence[Mesh], middle: FloatArray, size: float
) -> list[FloatArray]:
    """Return the (V, 3) vertices of the fingers and palms that are close to the object.

    A close finger brings all that its palm carries. Of a hand without fingers, the close vertices.

    Args:
        hand: The hand.
        meshes: Meshes of its links.
        middle: (3,) middle of the object, m.
        size: Radius of the object, m.
    """
    close = {
        mesh.name: np.linalg.norm(mesh.vertices - middle, axis=1) < _CLOSE * size for mesh in meshes
    }
    palms: dict[str, str | None] = {}
    for link in hand.link_names:
        above, finger = link, hand.finger_of(link)
        while finger is not None and above is not None and hand.finger_of(above) == finger:
            above = hand.tree.parent_links[above]
        if finger is not None:
            palms[link] = above
    links = {mesh.name: mesh.name.split("/", 2)[2] for mesh in meshes}
    at_object = {palms[link] for name, link in links.items() if link in palms and close[name].any()}
    shown = [
        mesh.vertices
        for mesh in meshes
        if links[mesh.name] in at_object or palms.get(links[mesh.name], "") in at_object
    ]
    return shown or [mesh.vertices[close[mesh.name]] for mesh in meshes]


def _support_mesh(
    support: Support, middle: FloatArray, size: float, max_faces: int, view_from: FloatArray
) -> Mesh:
    """Return a support's mesh; a half-space as a slab below the object, translucent from behind."""
    T, opacity = support.T_world_support, 1.0
    if isinstance(support.shape, HalfSpace):
        local = T[:3, :3].T @ (middle - T[:3, 3])
        surface = slab_triangles(local[:2], _SLAB_WIDTH * size, _SLAB_THICKNESS * size)
        opacity = 1.0 if T[:3, 2] @ view_from > -_FACING else _WALL_OPACITY
    else:
        surface = support.shape.surface(max_faces)
    return _body_mesh(f"support/{support.name}", Role.SUPPORT, surface.moved(T), opacity)


def _enclosing_sphere(points: FloatArray) -> tuple[FloatArray, float]:
    """Return the middle of the box around points, and the radius of the sphere about it."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return middle, float(np.linalg.norm(points - middle, axis=1).max())


def _body_mesh(name: str, role: Role, surface: Triangles, opacity: float) -> Mesh:
    return Mesh(name, role, surface.vertices, surface.faces, opacity)


def hand_triangles(hand: Hand, *, max_faces: int = 1500) -> Iterator[tuple[str, Triangles]]:
    """Yield the link and the triangles of each of a hand's shapes, world frame, m.

    A link is drawn by the URDF's visual shapes; one that has none, or none that can be read, by its
    collision shapes.

    Args:
        hand: The hand at its configuration.
        max_faces: Most triangles of one shape; finer meshes are simplified.
    """
    drawn: set[str] = set()
    for link, items in hand.tree.visuals.items():
        try:
            surfaces = [_visual_triangles(item, max_faces) for item in items]
        except MeshError:
            continue  # the collision shapes are drawn instead
        drawn.add(link)
        T = hand.pose_of(link)
        yield from ((link, surface.moved(T)) for surface in surfaces)
    for body in hand.collision_bodies():
        if body.name not in drawn:
            triangles = simplified(shape_of(body.geometry).surface(), max_faces)
            yield body.name, triangles.moved(body.T_world_geometry)


def _visual_triangles(visual: LinkShape, max_faces: int) -> Triangles:
    """Return the triangles of one visual shape in its link's frame.

    Raises:
        MeshError: Its mesh is missing or cannot be read.
    """
    shape = visual.shape
    if not isinstance(shape, LinkMesh):
        surface = shape.surface()
    elif shape.file is None:
        raise MeshError(f"the mesh {shape.stated_name!r} is missing")
    else:
        surface = file_triangles(shape.file, shape.scale, max_faces, upright=False)
    return surface.moved(visual.T_link_shape)
