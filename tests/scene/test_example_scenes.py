"""The example scenes: what touches what, what sticks and slides, and answers that are verified."""

import functools
import json
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scene_tools import EXAMPLES
from tests.geometry.contact_tools import find_contacts

from graspless_pin import load_scene
from graspless_pin.errors import SceneError
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.bodies.meshes import scaled_mesh
from graspless_pin.geometry.bodies.shapes import MeshShape, Sphere
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

GAP = 5e-5  # m


@dataclass(frozen=True)
class Expected:
    """What a scene is meant to be: contacts by body at rest, and those that part or slide.

    Without corners no support touches.
    """

    hand: dict[str, int]
    support: str
    corners: int
    lifted: int = 0
    slides: bool = False
    other_supports: dict[str, int] = field(default_factory=dict)


def tips(*numbers: int, prefix: str = "") -> dict[str, int]:
    return {f"{prefix}link_{number}.0_tip": 1 for number in numbers}


THREE = tips(3, 7, 11)
TRIHAND = {f"finger_{finger}_tip": 1 for finger in (1, 2, 3)}
PADS = {"panda_leftfinger": 4, "panda_rightfinger": 4}
LEVERS = {"right/tip": 1, "left/tip": 1}
BOTH = tips(3, 7, 11, prefix="right/") | tips(3, 7, 11, prefix="left/")

SCENES = {
    "box_between_walls": Expected(LEVERS, "front wall", 4, other_supports={"back wall": 4}),
    "allegro_box_on_slope": Expected(THREE, "slope", 4),
    "allegro_push_up_slope": Expected(THREE, "slope", 4, slides=True),
    "allegro_sphere_on_slope": Expected(tips(3, 11), "slope", 1),
    "allegro_mug_against_wall": Expected(THREE, "wall", 4),
    "allegro_mug_of_unknown_filling": Expected(THREE, "wall", 4),
    "allegro_tumble_box": Expected(THREE, "table", 4, lifted=2),
    "trihand_push_box": Expected(TRIHAND, "table", 4, slides=True),
    "trihand_pivot_box": Expected(TRIHAND, "table", 2),
    "panda_slide_cuboid_up_slope": Expected(PADS, "slope", 4, slides=True),
    "panda_carry_bar": Expected(PADS, "table", 0),
    "panda_arm_drag_board": Expected(PADS, "table", 2, slides=True),
    "panda_stop_with_board": Expected(PADS, "", 0),
    "pivot_against_wall": Expected({"tip": 1}, "floor", 4, other_supports={"wall": 4}),
    "two_hands_slide_crate": Expected(BOTH, "table", 4, slides=True),
    "trihand_slide_and_pivot": Expected(TRIHAND, "slope", 4, slides=True),
}


@functools.cache
def example(name):
    return load_scene(EXAMPLES / f"{name}.yaml")


@functools.cache
def solved(name, algorithm):
    return example(name).solve(algorithm, static_friction="virtual_sliding")


@pytest.fixture(scope="module", params=SCENES)
def case(request):
    """(scene, what it is meant to be)."""
    return example(request.param), SCENES[request.param]


def test_every_example_scene_is_expected_here():
    assert {file.stem for file in EXAMPLES.glob("*.yaml")} == set(SCENES)


def test_what_touches_sticks_slides_and_parts(case):
    scene, expected = case
    arm = scene.path.stem.startswith("panda_")  # which stands on the table
    assert unwanted_overlaps(scene.hand, scene.supports, tolerance=1e-4 if arm else 0.0) == ()
    tree, positions = scene.hand.tree, scene.hand.positions
    assert (positions > tree.lower - 1e-9).all() and (positions < tree.upper + 1e-9).all()
    resting = scene.with_changes(motion=None).contacts
    supports = {expected.support: expected.corners, **expected.other_supports}
    supports = {name: corners for name, corners in supports.items() if corners}
    assert Counter(resting.bodies) == {**expected.hand, **supports}
    kinds = {point.body: point.kind for point in resting.points}
    assert {kinds.pop(support) for support in supports} <= {BodyKind.SUPPORT}
    assert set(kinds.values()) == {BodyKind.HAND}
    assert max(abs(point.distance) for point in resting.points) < GAP < scene.contact_tolerance / 10
    contacts = scene.contacts
    parted = Counter(resting.bodies) - Counter(contacts.bodies)
    assert parted == ({expected.support: expected.lifted} if expected.lifted else {})
    on_support = np.array([body == expected.support for body in contacts.bodies])
    moving = np.linalg.norm(contacts.sliding, axis=1) > 0.0
    assert (moving == (on_support if expected.slides else False)).all()
    if expected.slides:
        along = np.tile(scene.motion.object_twist[:3], (expected.corners, 1))
        assert contacts.sliding[on_support] == pytest.approx(along, abs=1e-7)


@pytest.mark.sampled(9)
@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_answers(case, algorithm):
    """Both algorithms answer under the default rules, within honest limits."""
    scene, expected = case
    solution = solved(scene.path.stem, algorithm)
    assert solution.found
    asked = scene.solve_options.get("margin", 0.1)
    assert solution.margin > (min(asked, 0.1) if algorithm == "torque" else 0.1) - 1e-6
    rules = solution.rules
    assert (str(rules.sign), str(rules.sliding)) == ("strict", "exempt")
    assert str(rules.static_friction) == "virtual_sliding"
    lower, upper = scene.hand.effort_limits
    assert np.isfinite([lower, upper]).all()
    assert (solution.torques > lower - 1e-6).all()
    assert (solution.torques < upper + 1e-6).all()
    document = json.loads(json.dumps(solution_document(solution, scene)))
    verification = verify_document(document)
    assert verification.passed, str(verification)
    for contact in document["contacts"]:
        slides = expected.slides and expected.support in contact["bodies"]
        assert any(contact["sliding"]) == slides


@pytest.mark.parametrize("name", ["allegro_tumble_box", "trihand_pivot_box"])
def test_the_twist_turns_about_the_edge(name):
    """The edge is the two corners that stay: the twist moves none of their points."""
    scene = example(name)
    edge = [point for point in scene.contacts.points if point.kind is BodyKind.SUPPORT]
    assert scene.motion is not None
    twist = scene.motion.object_twist
    for point in edge:
        lever = point.position - scene.object.center_of_mass_world
        assert twist[:3] + np.cross(twist[3:], lever) == pytest.approx(np.zeros(3), abs=1e-6)
    along = edge[1].position - edge[0].position
    assert np.cross(along, twist[3:]) == pytest.approx(np.zeros(3), abs=1e-9)


def test_pivoted_box_is_past_its_balance():
    scene = example("trihand_pivot_box")
    edge = [point for point in scene.contacts.points if point.kind is BodyKind.SUPPORT]
    assert scene.object.center_of_mass_world[0] > edge[0].position[0] + 0.01
    assert not scene.with_changes(hand=None, motion=None).solve("margin").found


def test_tumbling_has_less_margin_on_a_smoother_table():
    scene = example("allegro_tumble_box")
    smoother = scene.with_changes(friction={**scene.friction, "supports": 0.35})
    assert solved("allegro_tumble_box", "margin").margin == pytest.approx(0.671, abs=1e-3)
    assert smoother.solve("margin").margin == pytest.approx(0.128, abs=1e-3)


def test_sphere_has_one_largest_margin_and_many_grips_with_it():
    """The slope's normal force, without friction there, decides; the torques are left open."""
    scene = example("allegro_sphere_on_slope")
    best = solved("allegro_sphere_on_slope", "margin")
    normal = scene.contacts.points[2].normal
    pressing = best.contact_forces[2] @ normal
    mu = scene.friction["supports"]
    assert best.margin == pytest.approx(pressing * mu / np.hypot(1.0, mu), rel=1e-2)
    least = scene.solve("torque", margin=best.margin - 1e-6)
    assert least.max_torque == pytest.approx(0.1533, abs=1e-3)
    assert best.max_torque > least.max_torque - 1e-4


def test_mug_hangs_on_friction_alone():
    scene = example("allegro_mug_against_wall")
    slippery = scene.with_changes(friction={"default": 0.0})
    assert not slippery.solve("margin").found


def test_the_mugs_figures_are_the_meshs():
    scene = example("allegro_mug_against_wall")
    assert isinstance(scene.object.shape, MeshShape)
    mug = scaled_mesh(scene.object.shape.path, 1.0)
    assert mug.is_watertight
    assert scene.object.mass == pytest.approx(mug.volume * 2300, rel=1e-2)  # kg/m^3, stoneware
    assert scene.object.center_of_mass == pytest.approx(mug.center_mass, abs=1e-4)
    assert scene.object.shape.path.stat().st_size < 200_000


def test_the_mugs_hollow_and_handle_are_open():
    """Nothing touches a fingertip there, although both are within the mug's convex hull."""
    mug = example("allegro_mug_against_wall").object
    assert isinstance(mug.shape, MeshShape)
    for position in ((0.0, 0.0, 0.05), (0.0, 0.05, 0.0475)):
        T = mug.T_world_object @ pose_matrix(position)
        tip = [CollisionBody("tip", Sphere(0.008).pieces()[0], T)]
        assert find_contacts(mug.collision_bodies(), tip, []) == ()
        hull = replace(mug, shape=replace(mug.shape, convex="hull"))
        with pytest.raises(SceneError, match="'tip' and object 'mug' overlap"):
            find_contacts(hull.collision_bodies(), tip, [])


def test_the_grippers_motor_feels_both_fingers():
    scene = example("panda_slide_cuboid_up_slope")
    solution = solved("panda_slide_cuboid_up_slope", "torque")
    normals = np.array([point.normal for point in scene.contacts.points])
    pressing = np.einsum("ij,ij->i", solution.contact_forces, normals)[:8].sum()
    assert solution.torques == pytest.approx([-pressing], abs=1e-6)


@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_two_hands_mirror_each_other(algorithm):
    """Joint by joint in size; the mirror turns the sign of the spread joints."""
    solution = solved("two_hands_slide_crate", algorithm)
    names = solution.problem.joint_names
    torques = dict(zip(names, solution.torques, strict=True))
    for name in [name for name in names if name.startswith("right/")]:
        other = torques[name.replace("right/", "left/")]
        assert abs(other) == pytest.approx(abs(torques[name]), abs=1e-4)
