"""Pictures: arrows start at the contacts, cones open into the object, directions are right."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.scene import Scene, load_scene
from graspless_pin.solution import TorqueSolution
from graspless_pin.visualization import DARK, LIGHT, Mesh, Role, draw_scene
from graspless_pin.visualization.contacts import draw_contacts
from graspless_pin.visualization.drawing import draw_bodies
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST, framing

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCENES = ["allegro_box_on_slope", "panda_slide_cuboid_up_slope", "paper/cuboid_sliding_up"]
FORCES = (
    Role.NORMAL_FORCE,
    Role.FRICTION_FORCE,
    Role.FRICTION_AT_LIMIT,
    Role.TOTAL_FORCE,
)
SCALE = 0.01  # m/N


@pytest.fixture(scope="module", params=SCENES)
def solved(request) -> tuple[Scene, TorqueSolution]:
    scene = load_scene(EXAMPLES / f"{request.param}.yaml")
    return scene, scene.solve()


def points_of(scene: Scene) -> np.ndarray:
    return np.array([point.position for point in scene.contacts.points])


def tip(mesh: Mesh, point: np.ndarray) -> np.ndarray:
    """From a contact to the end of an arrow that starts there."""
    away = mesh.vertices - point
    reach = np.linalg.norm(away, axis=1)
    arrow = away[reach.argmax()]
    assert reach.min() == pytest.approx(0.0, abs=1e-12), mesh.name
    assert (away @ arrow).min() > -1e-9 * (arrow @ arrow), f"{mesh.name} starts before its contact"
    return arrow


def test_arrows_start_at_their_contacts_and_are_the_forces(solved):
    scene, solution = solved
    points, problem = points_of(scene), solution.problem
    picture = draw_scene(scene, solution, force_scale=SCALE)
    normal = np.einsum("ij,ij->i", problem.normals, solution.contact_forces)
    drawn = np.zeros((len(points), 3))
    for mesh in picture.of(*FORCES):
        assert mesh.contact is not None
        arrow = tip(mesh, points[mesh.contact]) / SCALE
        if mesh.role is Role.NORMAL_FORCE:
            expected = normal[mesh.contact] * problem.normals[mesh.contact]
            assert arrow == pytest.approx(expected, abs=1e-9)
        if mesh.role is Role.TOTAL_FORCE:
            assert arrow == pytest.approx(solution.contact_forces[mesh.contact], abs=1e-9)
        else:
            drawn[mesh.contact] += arrow
    assert drawn == pytest.approx(solution.contact_forces, abs=1e-4)
    assert len(picture.of(Role.NORMAL_FORCE)) == len(points)


def test_cones_have_the_problems_edges_about_the_normal(solved):
    scene, solution = solved
    points, problem = points_of(scene), solution.problem
    cones = draw_scene(scene, solution).of(Role.CONE)
    assert [mesh.contact for mesh in cones] == np.flatnonzero(problem.has_cone).tolist()
    for mesh in cones:
        contact = mesh.contact
        assert contact is not None
        away = mesh.vertices - points[contact]
        assert np.linalg.norm(away[0]) < 1e-12
        edges, axis = away[1:-1], away[-1]
        assert axis / np.linalg.norm(axis) == pytest.approx(problem.normals[contact], abs=1e-9)
        columns = problem.C[3 * contact : 3 * contact + 3]
        columns = columns[:, np.abs(columns).sum(axis=0) > 0.0].T
        assert sorted((edges / np.linalg.norm(edges[0])).round(6).tolist()) == sorted(
            columns.round(6).tolist()
        )


def test_cones_open_into_the_object():
    """The middle of each base lies inside the box, and its apex on the box's surface."""
    scene = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    T = scene.object.T_world_object
    half = 0.5 * np.array([0.12, 0.16, 0.10])
    cones = draw_scene(scene).of(Role.CONE)
    assert len(cones) == len(scene.contacts.points)
    for mesh in cones:
        local = (mesh.vertices[[0, -1]] - T[:3, 3]) @ T[:3, :3]
        outside = (np.abs(local) - half).max(axis=1)
        assert abs(outside[0]) < 1e-3  # contact_tolerance
        assert outside[1] < 0.0 or abs(outside[1]) < 1e-3


def test_virtual_sliding_has_the_signs_of_the_mode(solved):
    scene, solution = solved
    points, problem, mode = points_of(scene), solution.problem, solution.mode
    arrows = draw_scene(scene, solution).of(Role.VIRTUAL_SLIDING)
    assert [mesh.contact for mesh in arrows] == np.flatnonzero(mode.selection).tolist()
    for mesh in arrows:
        along = tip(mesh, points[mesh.contact])
        assert problem.normals[mesh.contact] @ along == pytest.approx(0.0, abs=1e-9)
        signs = np.sign(problem.tangents[mesh.contact].T @ along)
        assert signs.tolist() == mode.signs[mesh.contact].tolist()
        friction = solution.contact_forces[mesh.contact] @ along
        assert friction <= 1e-6, "friction opposes the virtual sliding"


def test_sliding_is_drawn_along_itself_and_its_friction_is_at_the_limit():
    scene = load_scene(EXAMPLES / "paper" / "cuboid_sliding_up.yaml")
    solution = scene.solve()
    picture, points = draw_scene(scene, solution), points_of(scene)
    arrows = picture.of(Role.SLIDING)
    sliding = np.flatnonzero(solution.problem.is_sliding).tolist()
    assert [mesh.contact for mesh in arrows] == sliding
    assert len(sliding) == 4
    for mesh in arrows:
        along = tip(mesh, points[mesh.contact])
        assert along / np.linalg.norm(along) == pytest.approx([-np.sqrt(0.5), 0, np.sqrt(0.5)])
    against = {mesh.contact: mesh for mesh in picture.of(Role.FRICTION_AT_LIMIT)}
    for contact in sliding:
        force = tip(against[contact], points[contact])
        assert force / np.linalg.norm(force) == pytest.approx([np.sqrt(0.5), 0, -np.sqrt(0.5)])


def test_what_is_not_the_hand_is_closed_and_outward(solved):
    scene, solution = solved
    picture = draw_scene(scene, solution)
    for mesh in picture.meshes:
        if mesh.role is Role.HAND:  # a robot's visual meshes are as their authors left them
            continue
        drawn = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert drawn.is_watertight, mesh.name
        assert drawn.volume > 0.0, mesh.name
    names = [mesh.name for mesh in picture.meshes]
    assert len(set(names)) == len(names)


def test_the_picture_is_framed_and_small(solved):
    scene, solution = solved
    picture = draw_scene(scene, solution)
    size = sum(mesh.vertices.size * 4 + mesh.faces.size * 4 for mesh in picture.meshes)
    assert size < 1_000_000  # bytes in single precision
    for mesh in (*picture.of(Role.OBJECT), *picture.of(Role.CONTACT)):
        away = np.linalg.norm(mesh.vertices - picture.center, axis=1).max()
        assert away < 1.1 * picture.radius, mesh.name
    assert picture.up @ scene.gravity < 0.0
    assert np.linalg.norm(picture.view_from) == pytest.approx(1.0)
    assert picture.view_from @ picture.up > 0.2
    picture = draw_scene(scene)  # without a solution there are no forces
    assert picture.of(*FORCES, Role.VIRTUAL_SLIDING) == ()
    assert len(picture.of(Role.CONTACT)) == len(scene.contacts.points)
    assert draw_bodies(scene).of(Role.CONTACT, Role.CONE) == ()


def test_a_wall_is_seen_from_its_front():
    scene = load_scene(EXAMPLES / "allegro_mug_against_wall.yaml")
    wall = scene.supports[0].T_world_support[:3, 2]
    assert draw_bodies(scene).view_from @ wall > 0.0


def test_a_solution_of_another_scene_is_refused():
    first = load_scene(EXAMPLES / "paper" / "sphere_on_slope.yaml")
    second = load_scene(EXAMPLES / "paper" / "cuboid_at_rest.yaml")
    with pytest.raises(ArgumentError, match="contacts are not those of the scene"):
        draw_scene(first, second.solve())


def test_contacts_alone_can_be_drawn_about_any_origin():
    problem = QuasistaticProblem(
        positions=[[0, -0.05, 0], [0, 0.05, 0]],
        normals=[[0, 1, 0], [0, -1, 0]],
        external_wrench=[0, 0, -2, 0, 0, 0],
        friction=0.5,
        tangents=[[[1, 0], [0, 0], [0, 1]], [[1, 0], [0, 0], [0, 1]]],
    )
    picture = draw_contacts(problem, origin=[1, 2, 3])
    assert picture.center.tolist() == [1, 2, 3]
    assert picture.up.tolist() == [0, 0, 1]
    for mesh in picture.meshes:  # of which one contact frame is left-handed
        drawn = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        assert drawn.is_watertight
        assert drawn.volume > 0.0
    assert [mesh.contact for mesh in picture.of(Role.CONE)] == [0, 1]
    with pytest.raises(ArgumentError, match="origin"):
        draw_contacts(problem, origin=[1, 2])


def luminance(color: str) -> float:
    """Relative luminance as the web's accessibility rules define it."""
    parts = [value / 255.0 for value in bytes.fromhex(color.removeprefix("#"))]
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def contrast(first: str, second: str) -> float:
    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])
def test_colours_are_complete_and_differ(palette):
    assert set(palette.roles) == set(Role)
    assert len(set(palette.roles.values())) == len(Role)
    assert contrast(palette.text, palette.background) > 7.0
    for role in (Role.NORMAL_FORCE, Role.FRICTION_FORCE, Role.FRICTION_AT_LIMIT):
        assert contrast(palette.roles[role], palette.background) > 3.0, role


EVERY_SCENE = sorted([*EXAMPLES.glob("*.yaml"), *EXAMPLES.glob("paper/*.yaml")])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("file", EVERY_SCENE, ids=lambda file: file.stem)
def test_nothing_is_cut_off_at_first_sight(file: Path):
    """Each corner of what is shown at first, but for arms, is inside; some are near the rim."""
    scene = load_scene(file)
    picture = draw_scene(scene, scene.solve())
    first = [
        mesh.vertices
        for mesh in picture.meshes
        if mesh.role not in HIDDEN_AT_FIRST and "/panda_link" not in mesh.name  # but for arms
    ]
    corners = np.vstack(first)
    for aspect in (0.75, 1.6):
        center, distance = framing(picture, 0.7, aspect)
        right = np.cross(picture.up, picture.view_from)
        right /= np.linalg.norm(right)
        away = corners - (center + distance * picture.view_from)
        depth = -away @ picture.view_from
        assert depth.min() > 0.0
        across = np.abs(away @ right) / (depth * aspect)
        along = np.abs(away @ np.cross(picture.view_from, right)) / depth
        reach = np.maximum(across, along).max() / np.tan(0.35)
        assert 0.88 < reach < 1.0


def test_loads_are_drawn_where_they_act():
    scene = load_scene(EXAMPLES / "panda_stop_with_board.yaml")
    picture = draw_scene(scene, scene.solve())
    by_name = {mark.text: mark for mark in picture.marks if mark.role is Role.LOAD}
    assert list(by_name) == ["hook, inertia of hook", "inertia"]
    hook = scene.object.T_world_object @ [0.0, 0.0, -0.15, 1.0]
    starts = [mesh.vertices[0] for mesh in picture.of(Role.LOAD)]
    # The weight of the hook, its inertia, and force and moment (two heads) of the board's.
    assert len(starts) == 5
    assert sum(bool(np.allclose(one, hook[:3])) for one in starts) == 2
    assert by_name["hook, inertia of hook"].words[1] == "hook: force 0.491 N"
    assert not draw_scene(scene.with_changes(loads=(), acceleration=None)).of(Role.LOAD)
