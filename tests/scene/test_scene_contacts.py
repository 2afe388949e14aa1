"""Tangents, friction, given contacts and motion of a scene."""

import numpy as np
import pytest
from scene_tools import (
    ALLEGRO,
    BOX,
    EXAMPLES,
    PAPER,
    bodies_at,
    content,
    loaded,
    unit,
    without_hand,
)

from graspless_pin import load_scene
from graspless_pin.errors import ArgumentError, SceneError

ACROSS = {"object_twist": {"linear": [0, 0.1, 0]}}


@pytest.mark.parametrize(
    ("axes", "on_side", "on_floor"),
    [
        (None, (0, 0, -1), (-1, 0, 0)),  # t1 = n x e_y, or n x e_x where n is along y
        ([[0, 3, 0], [1, 1, 1]], (1, 0, 1), (0, 1, 0)),  # the first is along the side's normal
        ([[0, 0, -2]], (0, 0, -1), (-1, 0, 0)),  # the floor's normal: the default rule
    ],
)
def test_tangents_are_axes_projected_in_order_or_the_default(tmp_path, axes, on_side, on_floor):
    data = content(BOX)
    if axes is not None:
        data["tangent_axes"] = axes
    problem = loaded(tmp_path, data).problem()
    side, floor = np.eye(3)[1], np.eye(3)[2]
    for normal, tangents in zip(problem.normals, problem.tangents, strict=True):
        assert min(np.abs(normal - side).max(), np.abs(normal - floor).max()) < 1e-9
        first = unit(*(on_side if normal[1] > 0.5 else on_floor))
        np.testing.assert_allclose(tangents[:, 0], first, atol=1e-9)
        np.testing.assert_allclose(tangents[:, 1], np.cross(normal, first), atol=1e-9)


def with_friction(tmp_path, friction, own=None, name="floor"):
    data = content(BOX)
    data["friction"] = friction
    data["supports"][0]["name"] = name
    if own is not None:
        data["supports"][0]["friction"] = own
    scene = loaded(tmp_path, data)
    values = dict(zip(bodies_at(scene), scene.problem().friction.tolist(), strict=True))
    return values["tip"], values[name]


@pytest.mark.parametrize(
    ("friction", "own", "expected"),
    [
        (0.3, None, (0.3, 0.3)),
        (0, None, (0.0, 0.0)),
        (0.3, 0.7, (0.3, 0.7)),
        ({"default": 0.2}, None, (0.2, 0.2)),
        ({"default": 0.2, "hand": 0.9}, None, (0.9, 0.2)),
        ({"default": 0.2, "supports": 0.4}, None, (0.2, 0.4)),
        ({"hand": 0.9, "supports": 0.4}, None, (0.9, 0.4)),
        ({"hand": 0.9, "tip": 0.8, "supports": 0.4, "floor": 0.5}, None, (0.8, 0.5)),
        ({"tip": 0.8, "floor": 0.5, "lever": 0.1}, None, (0.8, 0.5)),
        ({"hand": 0.9, "supports": 0.4, "floor": 0.5, "default": 0.1}, 0.7, (0.9, 0.7)),
        ({"hand": 0.9}, 0.0, (0.9, 0.0)),
    ],
)
def test_the_most_particular_friction_counts(tmp_path, friction, own, expected):
    assert with_friction(tmp_path, friction, own) == expected


def test_a_missing_coefficient_is_an_error(tmp_path):
    with pytest.raises(SceneError, match=r"no coefficient for 'floor'; add 'floor', 'supports' or"):
        with_friction(tmp_path, {"hand": 0.3})


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "file", [*sorted(PAPER.glob("*.yaml")), *sorted(EXAMPLES.glob("allegro*.yaml"))]
)
def test_given_contacts_give_what_found_ones_do(tmp_path, file):
    """The found contacts, written into the scene in another order, with normals of any length."""
    found = load_scene(file)
    given = content(file)
    given["contacts"] = [
        {
            "body": point.body,
            "position": point.position.tolist(),
            "normal": (3.0 * point.normal).tolist(),
        }
        for point in reversed(found.contacts.points)
    ]
    # The shapes no longer matter: the object is only its mass.
    given["object"]["shape"] = {"type": "sphere", "radius": 0.001}
    scene = loaded(tmp_path, given)
    problem, other = scene.problem(), found.problem()
    hand = sum(point.kind.value == "hand" for point in found.contacts.points)
    order = [*reversed(range(hand)), *reversed(range(hand, len(bodies_at(found))))]
    assert bodies_at(scene) == [bodies_at(found)[index] for index in order]
    for name in ("positions", "normals", "friction", "tangents", "sliding"):
        np.testing.assert_allclose(
            getattr(problem, name), getattr(other, name)[order], atol=1e-12, err_msg=name
        )
    solution, expected = scene.solve(), found.solve()
    assert solution.margin == pytest.approx(expected.margin, abs=1e-6)
    np.testing.assert_allclose(solution.torques, expected.torques, atol=1e-6)


def test_the_hand_follows_a_moved_object_unless_told(tmp_path):
    """Pushing a box over the floor with a frictionless finger: tau = -0.1 mu m g by hand."""
    data = content(BOX)
    data |= {"friction": {"hand": 0, "supports": 0.3}, "motion": ACROSS}
    scene = loaded(tmp_path, data)
    expected = np.array([[0, 0, 0], *[[0, 0.1, 0]] * 4])
    np.testing.assert_allclose(scene.problem().sliding, expected, atol=1e-9)
    for solution in (scene.solve("margin"), scene.solve("torque", margin=0.05)):
        assert solution.found
        np.testing.assert_allclose(solution.torques, [-0.1 * 0.3 * 9.8], atol=1e-7)


def test_a_hand_that_stands_still_lets_the_object_slide_through(tmp_path):
    """Braking the paper's cuboid: all six contacts slide and the squeeze is what balance asks.

    Down the slope: m g q = mu m g q + 2 mu f_n, so |tau| = 0.1 m g q (1 - mu) / (2 mu).
    """
    data = content(PAPER / "cuboid_sliding_down.yaml")
    data["motion"]["hand"] = {}
    scene = loaded(tmp_path, data)
    problem = scene.problem()
    np.testing.assert_allclose(problem.sliding, [[0.1, 0, -0.1]] * 6, atol=1e-9)
    torque = 0.1 * 9.8 * np.sqrt(0.5) * 0.7 / 0.6
    solution = scene.solve("margin")
    np.testing.assert_allclose(solution.torques, [-torque, torque], rtol=1e-6)
    friction = solution.contact_forces - problem.normals * np.einsum(
        "ij,ij->i", problem.normals, solution.contact_forces
    ).reshape(-1, 1)
    np.testing.assert_allclose(friction @ unit(1, 0, -1), -np.linalg.norm(friction, axis=1))


def test_a_turning_base_moves_its_contacts(tmp_path):
    """The base turns about its own origin: v = omega x (p - p_base)."""
    data = content(BOX)
    twist = {"linear": [0, 0, 0.2], "angular": [0, -1.0, 0]}
    data["motion"] = {"object_twist": {}, "hand": {"base_twist": twist}}
    scene = loaded(tmp_path, data)
    tip = np.array([0, 0, 0.2]) + np.cross([0, -1.0, 0], [0.1, 0, 0])
    expected = np.zeros((5, 3))
    expected[0] = -tip  # the object's velocity relative to the tip
    np.testing.assert_allclose(scene.problem().sliding, expected, atol=1e-7)


SLIDER = """\
<robot name="slider">
  <link name="rail"/>
  <joint name="slide" type="prismatic">
    <parent link="rail"/><child link="pad"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="20" velocity="1"/>
  </joint>
  <link name="pad"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
</robot>
"""


def test_joint_velocities_slide_a_finger_along_a_resting_object(tmp_path):
    (tmp_path / "slider.urdf").write_text(SLIDER)
    data = content(BOX)
    data["hand"] = {"urdf": "slider.urdf", "base_pose": {"position": [0, -0.11, 0]}}
    data["motion"] = {"object_twist": {}, "hand": {"joint_velocities": {"slide": 0.3}}}
    problem = loaded(tmp_path, data).problem()
    np.testing.assert_allclose(problem.sliding[0], [0, 0, -0.3], atol=1e-9)
    np.testing.assert_array_equal(problem.sliding[1:], np.zeros((4, 3)))
    np.testing.assert_allclose(problem.jacobian[:3, 0], [0, 0, 1], atol=1e-12)


def lever_motion(tmp_path, rate):
    data = content(BOX)
    data["motion"] = {"object_twist": {}, "hand": {"joint_velocities": {"hinge": rate}}}
    return loaded(tmp_path, data)


def test_a_finger_that_moves_off_is_no_contact(tmp_path):
    assert bodies_at(lever_motion(tmp_path, 0.5)) == ["floor"] * 4


def test_a_finger_that_moves_into_the_object_is_an_error(tmp_path):
    scene = lever_motion(tmp_path, -0.5)
    with pytest.raises(
        SceneError, match=r"scene.yaml: motion: .* into hand link 'tip' at 0.05 m/s"
    ):
        _ = scene.contacts


def test_lifting_leaves_the_finger_alone(tmp_path):
    data = content(BOX)
    data["motion"] = {"object_twist": {"linear": [0, 0, 0.1]}}
    scene = loaded(tmp_path, data)
    assert bodies_at(scene) == ["tip"]
    np.testing.assert_array_equal(scene.problem().sliding, np.zeros((1, 3)))


def test_a_scene_without_a_hand_has_no_joints(tmp_path):
    scene = without_hand(tmp_path)
    assert scene.problem().jacobian.shape == (12, 0)
    inertia = scene.problem().joint_inertia
    assert inertia is not None and inertia.shape == (0, 0)
    solution = scene.solve("margin")
    assert solution.found and solution.max_torque == 0.0
    # 2.45 N on each corner, all along the normals: the cone's faces are nearest.
    slope = 0.3 * np.cos(np.pi / 32)
    assert solution.margin == pytest.approx(2.45 * slope / np.hypot(1, slope), rel=1e-6)


def test_options_of_the_wrong_algorithm_are_refused():
    scene = load_scene(ALLEGRO)
    with pytest.raises(ArgumentError, match="margin: has no effect with algorithm 'margin'"):
        scene.solve("margin", margin=0.2)
    with pytest.raises(ArgumentError, match="scale: has no effect with algorithm 'margin'"):
        scene.solve(scale="limits")
    with pytest.raises(ArgumentError, match="algorithm: is 'best'; it must be one of 'margin'"):
        scene.solve("best")
    assert scene.solve("torque", scale="limits").found


def test_moments_are_about_the_centre_of_mass(tmp_path):
    """The corners carry a weight off the middle by the lever rule."""
    data = content(BOX)
    del data["hand"]
    data["friction"] = 0
    data["object"] |= {
        "center_of_mass": [0.05, 0, 0.02],
        "pose": {"position": [1.0, -2.0, 0.0], "rpy": [0, 0, np.pi / 2]},
    }
    scene = loaded(tmp_path, data)
    center = np.array([1.0, -1.95, 0.02])
    np.testing.assert_allclose(scene.object.center_of_mass_world, center, atol=1e-12)
    points = np.array([point.position for point in scene.contacts.points])
    np.testing.assert_allclose(scene.problem().positions, points - center, atol=1e-12)
    forces = scene.solve("margin").contact_forces
    np.testing.assert_allclose(forces[:, :2], 0.0, atol=1e-7)
    # 0.05 of 0.1 m off the middle: three quarters of the weight on that side.
    near = points[:, 1] > -2.0
    assert forces[near, 2].sum() == pytest.approx(0.75 * 9.8, rel=1e-6)
