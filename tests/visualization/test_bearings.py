"""Axes, gravity, the scale of forces, fingers, views and the virtual sliding of pictures."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from graspless_pin import QuasistaticProblem, load_scene, maximize_margin
from graspless_pin.visualization import DARK, LIGHT, Mesh, Picture, Role, draw_scene
from graspless_pin.visualization.contacts import draw_contacts
from graspless_pin.visualization.motion import draw_virtual_sliding
from graspless_pin.visualization.picture import ForceScale

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def solved():
    scene = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    solution = scene.solve()
    return scene, solution, draw_scene(scene, solution)


def along(mesh: Mesh) -> np.ndarray:
    """From the foot of an arrow to its tip."""
    return mesh.vertices[-1] - mesh.vertices[0]


def test_axes_and_gravity_point_where_they_do(solved):
    scene, _, _ = solved
    tilted = scene.with_changes(gravity=np.array([3.0, 0.0, -9.0]))
    picture = draw_scene(tilted)
    for mesh, axis in zip(picture.of(Role.AXES), np.eye(3), strict=True):
        assert along(mesh) / np.linalg.norm(along(mesh)) == pytest.approx(axis)
    (down,) = picture.of(Role.GRAVITY)
    assert np.cross(along(down), tilted.gravity) == pytest.approx(0.0, abs=1e-12)
    assert along(down) @ tilted.gravity > 0.0
    assert [mark.text for mark in picture.marks if mark.contact is None] == ["x", "y", "z", "g"]
    # They stand in front of the slope, and clear of the box.
    normal, offset = picture.floors[0][:3], picture.floors[0][3]
    assert min(float((m.vertices @ normal).min()) for m in picture.of(Role.AXES)) > offset
    weightless = scene.with_changes(gravity=np.zeros(3))
    assert not draw_scene(weightless).of(Role.GRAVITY)


def test_the_scale_is_that_of_the_arrows(solved):
    _, solution, picture = solved
    scale = picture.force_scale
    assert scale is not None and str(scale) == "1 cm = 0.3 N"
    forces = np.linalg.norm(solution.contact_forces, axis=1)
    for mesh in picture.of(Role.TOTAL_FORCE):
        length = np.linalg.norm(along(mesh))
        assert length == pytest.approx(forces[mesh.contact] * scale.metres_per_newton)
    (load,) = picture.of(Role.EXTERNAL_FORCE)
    expected = solution.problem.external_wrench[:3] * scale.metres_per_newton
    assert along(load) == pytest.approx(expected)
    (bar,) = picture.of(Role.FORCE_SCALE)
    (stated,) = (mark.text for mark in picture.marks if mark.role is Role.FORCE_SCALE)
    newtons, unit = stated.split()
    assert unit == "N"
    assert np.linalg.norm(along(bar)) == pytest.approx(float(newtons) * scale.metres_per_newton)


@pytest.mark.parametrize(
    ("scale", "size", "words"),
    [
        (0.01 / 5.0, 0.1, "1 cm = 5 N"),
        (0.001 / 2e-6, 0.005, "1 mm = 2 µN"),
        (1.0 / 3e5, 4.0, "1 m = 300 kN"),
        (1e-6 / 0.25, 1e-5, "1 µm = 0.25 N"),
    ],
)
def test_scales_in_words(scale: float, size: float, words: str):
    assert str(ForceScale.fitting(scale, size)) == words
    assert ForceScale.fitting(scale, size).metres_per_newton == pytest.approx(scale)


def test_the_words_of_a_contact_are_its_figures(solved):
    scene, solution, picture = solved
    numbers = [mark for mark in picture.marks if mark.contact is not None]
    assert [mark.text for mark in numbers] == [str(index) for index in range(7)]
    normal = np.einsum("ij,ij->i", solution.problem.normals, solution.contact_forces)
    for mark, body in zip(numbers, scene.contacts.bodies, strict=True):
        assert mark.words[0] == f"contact {mark.text}: {body}"
        assert mark.words[1] == f"normal force {normal[int(mark.text)]:.4f} N"
        assert mark.words[3].startswith("0.7437 N from slipping")
    limiting = [mark.contact for mark in numbers if mark.words[3].endswith("limits the margin")]
    assert limiting == [3, 6]
    assert draw_scene(scene).marks[-1].words == ("contact 6: slope", "μ = 0.35")


def test_every_link_has_the_colour_of_its_finger(solved):
    scene, _, picture = solved
    assert picture.fingers == tuple(scene.hand.fingers)
    for mesh in picture.of(Role.HAND):
        finger = scene.hand.finger_of(mesh.name.split("/", 2)[2])
        assert (finger is None) == (mesh.finger is None)
        if mesh.finger is not None:
            assert picture.fingers[mesh.finger] == finger
            assert LIGHT.of_mesh(mesh) == tuple(bytes.fromhex(LIGHT.fingers[mesh.finger][1:]))
    assert LIGHT.of_finger(7) == LIGHT.fingers[2]


# Machado, Oliveira & Fernandes 2009, severity 1.
SIGHTS = {
    "normal": np.eye(3),
    "protan": [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]],
    "deutan": [[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]],
    "tritan": [[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]],
}
XYZ = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]


def lab(color: str, sight: np.ndarray) -> np.ndarray:
    """CIE Lab of a colour as somebody sees it."""
    v = np.array(list(bytes.fromhex(color[1:]))) / 255.0
    linear = sight @ np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
    f = np.cbrt(np.array(XYZ) @ np.clip(linear, 0.0, 1.0) / [0.9505, 1.0, 1.089])
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])
@pytest.mark.parametrize("sight", SIGHTS.values(), ids=SIGHTS)
def test_fingers_and_palm_are_told_apart(palette, sight):
    """A distance of 2 is just seen side by side."""
    seen = [lab(color, np.array(sight)) for color in (palette.roles[Role.HAND], *palette.fingers)]
    assert min(np.linalg.norm(a - b) for a, b in combinations(seen, 2)) > 20.0


@pytest.mark.parametrize(
    "name", ["allegro_box_on_slope", "allegro_mug_against_wall", "panda_arm_drag_board"]
)
def test_no_view_is_from_below(name: str):
    picture = draw_scene(load_scene(EXAMPLES / f"{name}.yaml"))
    assert set(picture.views) == {"front", "side", "top"}
    for way in (picture.view_from, *picture.views.values()):
        assert np.linalg.norm(way) == pytest.approx(1.0)
        assert (picture.floors[:, :3] @ way > 0.1).all()
    assert picture.views["top"] @ picture.up > 0.99
    assert abs(picture.views["front"] @ picture.views["side"]) < 0.5


def test_the_virtual_sliding_is_the_motion_behind_the_mode(solved):
    scene, solution, picture = solved
    origin = scene.object.center_of_mass_world
    moving = draw_virtual_sliding(picture, solution, scene.hand, origin)
    assert moving is not None and solution.motion is not None
    end, motion = moving.times[-1], solution.motion
    path = moving.paths[moving.path_of["object/box"]][-1]
    np.testing.assert_allclose(path[:3, :3], Rotation.from_rotvec(end * motion[3:6]).as_matrix())
    np.testing.assert_allclose(path[:3] @ [*origin, 1.0], origin + end * motion[:3], atol=1e-12)
    problem, radius = solution.problem, np.linalg.norm(solution.problem.positions, axis=1).max()
    gone = path[:3, :3] @ problem.positions.T + (path[:3, 3] - origin)[:, None]
    gone += path[:3, :3] @ origin[:, None] - problem.positions.T
    assert 0.1 * radius < np.linalg.norm(gone, axis=0).max() < 0.5 * radius
    moved = {moving.path_of.get(mesh.name) for mesh in picture.of(Role.HAND)}
    assert len(moved) > 2, "links move as well"
    still = picture.of(Role.AXES, Role.GRAVITY, Role.FORCE_SCALE, Role.SUPPORT)
    assert not {mesh.name for mesh in still} & set(moving.path_of)
    coulomb = scene.solve(static_friction="coulomb")
    picture: Picture = draw_scene(scene, coulomb)
    assert draw_virtual_sliding(picture, coulomb, scene.hand, np.zeros(3)) is None


def test_contacts_alone_have_axes_and_a_scale_too():
    corners = [[0.1, 0, -0.1], [-0.1, 0.1, -0.1], [-0.1, -0.1, -0.1]]
    table = QuasistaticProblem(corners, [[0, 0, 1]] * 3, [0, 0, -5, 0, 0, 0], friction=0.5)
    picture = draw_contacts(table, maximize_margin(table), bodies=["a", "b", "c"])
    assert len(picture.of(Role.AXES)) == 3 and picture.force_scale is not None
    assert not picture.of(Role.GRAVITY), "nobody says what of the load is weight"
    assert [mark.words[0] for mark in picture.marks if mark.contact is not None] == [
        "contact 0: a", "contact 1: b", "contact 2: c",
    ]  # fmt: skip
