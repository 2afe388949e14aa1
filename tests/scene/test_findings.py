"""What is wrong with a scene is found, with what to do; and only where it is wrong."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scene_tools import EXAMPLES, hand_of
from tests.cli.cli_tools import LINES, spoilt

from graspless_pin import Scene, Uncertainty, load_scene
from graspless_pin.errors import ArgumentError, GrasplessPinWarning, SceneError
from graspless_pin.findings import Finding, FindingCode, Severity, capture, causes_first, emit
from graspless_pin.geometry import Box, Sphere, Support, unwanted_overlaps
from graspless_pin.records import changed
from graspless_pin.report import scene_solution_text, solution_document
from graspless_pin.report.reading import read_solution


def loaded(tmp_path: Path, *changes: tuple[str, str]) -> Scene:
    text = LINES
    for old, new in changes:
        text = spoilt(old, new, text)
    file = tmp_path / "scene.yaml"
    file.write_text(text, encoding="utf-8")
    with capture():
        return load_scene(file)


def found(scene: Scene) -> dict[FindingCode, Finding]:
    return {one.code: one for one in scene.findings}


def test_nothing_is_wrong_with_the_papers_scenes_and_the_one_above(tmp_path):
    assert loaded(tmp_path).findings == ()
    for file in sorted(EXAMPLES.glob("paper/*.yaml")):
        assert load_scene(file).findings == ()


FLOOR = "pose: {position: [0, 0, -0.1]}"
HAND = "position: [-0.1, -0.1, 0.0]"
CASES = {
    # what is replaced, by what, the code, the subject, what is said
    "hand far away": (HAND, "position: [-0.1, -0.6, 0.0]", "hand-touches-nothing", "box",
                      "'tip', is 500 mm away"),
    "table 10 um too far": (FLOOR, "pose: {position: [0, 0, -0.10101]}", "support-missed", "floor",
                            "is 1.01 mm from object 'box', so it is not a contact"),
    "table 10 mm too far": (FLOOR, "pose: {position: [0, 0, -0.11]}", "no-support-touches", "box",
                            "no support touches object 'box': the nearest, 'floor', is 10 mm away"),
    "quaternion of another order": (
        "pose: {position: [0, 0, 0]}", "pose: {position: [0, 0, 0], quaternion: [-1, 0, 0, 0]}",
        "quaternion-order", "box", "the quaternion of 'box' is half a turn about x"),
    "finger too far": (HAND, "position: [-0.1, -0.1049, 0.0]", "finger-missed", "finger",
                       "'tip' is 4.9 mm from object"),
    "hand through a support": (
        FLOOR, FLOOR + "\n  - name: wall\n    shape: {type: box, size: [0.04, 0.04, 0.04]}\n"
        "    pose: {position: [0, -0.1349, 0]}", "hand-through-support", "tip",
        "hand link 'tip' and support 'wall' overlap by 5.10 mm"),
    "hand a little in a support": (
        FLOOR, FLOOR + "\n  - name: wall\n    shape: {type: box, size: [0.04, 0.04, 0.04]}\n"
        "    pose: {position: [0, -0.1351, 0]}", "deep-overlap", "tip",
        "hand link 'tip' and support 'wall' overlap by 4.90 mm"),
    "overlap": (FLOOR, "pose: {position: [0, 0, -0.0951]}", "deep-overlap", "floor",
                "'floor' and object 'box' overlap by 4.9 mm"),
    "degrees": ("rpy: [3.141592653589793, 0, 0]", "rpy: [180, 0, 0]", "angle-in-degrees", "hand",
                "angles [180, 0, 0] rad of 'hand' are more than a turn"),
    "radians": ("rpy: [3.141592653589793, 0, 0]", "rpy_deg: [3.1416, 0, 0]", "angle-in-radians",
                "hand", "angles [3.1416, 0, 0] degrees of 'hand' look like radians"),
    "grams": ("mass: 1.0", "mass: 1000", "unlikely-density", "box", "more than any metal"),
    "millimetres beside a hand": ("size: [0.2, 0.2, 0.2]", "size: [60, 50, 80]", "unlikely-size",
                                  "box", "'box' is 60 x 50 x 80 m large"),
    "millimetres": ("size: [0.2, 0.2, 0.2]", "size: [200, 200, 200]", "unlikely-density", "box",
                    "less than air"),
    "centre of mass": ("mass: 1.0", "mass: 1.0\n  center_of_mass: [0, 0, 0.101]",
                       "center-of-mass-outside", "box", "outside the box around its shape"),
    "gravity": ("-9.8", "-9810", "unlikely-gravity", "gravity", "9810 m/s^2"),
    "gravity upward": ("-9.8", "9.8", "unlikely-gravity", "gravity", "points up: [0.0, 0.0, 9.8]"),
    "a payload in grams": ("friction: 0.3", "friction: 0.3\nloads: [{name: bag, mass: 51}]",
                           "unlikely-load", "bag",
                           "the mass of load 'bag', 51 kg, is 51 times the mass of object 'box'"),
    "a strong push": ("friction: 0.3", "friction: 0.3\nloads: [{name: push, force: [500, 0, 0]}]",
                      "unlikely-load", "push", "500 N, is 51 times the weight of object 'box'"),
    "a push in millimetres": (
        "friction: 0.3", "friction: 0.3\nloads: [{name: push, force: [1, 0, 0], at: [0, 50, 0]}]",
        "unlikely-load", "push", "load 'push' acts 49.9 m outside the box around object 'box'"),
    "friction": ("friction: 0.3", "friction: 80", "steep-friction", "default", "80 (default)"),
    "friction of a support": (FLOOR, FLOOR + "\n    friction: 4", "steep-friction", "floor",
                              "4 (floor) is above 3"),
    "stated limit": ("  q: {hinge: 0.0}", "  q: {hinge: 0.0}\n  effort_limits: {finger: 1e+6}",
                     "placeholder-effort", "hinge", "'hinge' (1e+06)"),
    "normal force": ("friction: 0.3", "friction: 0.3\nmax_normal_force: 1e+8",
                     "placeholder-force", "box", "1e+08 N, looks like a placeholder"),
    "held joints": ("  q: {hinge: 0.0}", "  control: position", "no-torque-counts", "box",
                    "no force-controlled joint moves"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("ways", "expected"),
    [
        ({"right/": 0.003}, ["finger-missed"]),
        ({"right/": 0.006}, ["mount-touches-nothing"]),
        ({"right/": 0.4}, ["mount-touches-nothing"]),
        ({"right/": 0.4, "left/": -0.4}, ["hand-touches-nothing"]),
    ],
)
def test_a_robot_that_touches_nothing_beside_one_that_does(ways, expected):
    scene = load_scene(EXAMPLES / "box_between_walls.yaml")
    hand = hand_of(scene)
    poses = {prefix: hand.base_poses[prefix].copy() for prefix in ways}
    for prefix, way in ways.items():
        poses[prefix][0, 3] += way
    moved = found(scene.with_changes(hand=hand.with_base_at(poses)))
    assert [*moved] == expected
    if expected == ["mount-touches-nothing"]:
        told = moved[FindingCode.IDLE_MOUNT]
        away = f"it is {1e3 * ways['right/']:.0f} mm from object 'box'"
        assert f"robot 'right/' touches nothing: {away}" in str(told)
        assert told.key == ("hand", "mounts", 0, "base_pose")


@pytest.mark.parametrize(("old", "new", "code", "subject", "said"), CASES.values(), ids=CASES)
def test_a_fault_is_found(tmp_path, old, new, code, subject, said):
    one = found(loaded(tmp_path, (old, new)))[FindingCode(code)]
    assert one.subject == subject
    assert said in one.message
    assert one.advice


@pytest.mark.parametrize(
    ("old", "new", "code", "advice"),
    [
        ("mass: 1.0", "mass: 300", "unlikely-density", "the mass looks like grams, 0.3 kg?"),
        ("mass: 1.0", "density: 0.5", "unlikely-density", "like g/cm^3, 500 kg/m^3?"),
        ("mass: 1.0", "mass: 1e+9", "unlikely-density", "lengths in metres"),
        ("size: [0.2, 0.2, 0.2]", "size: [200, 200, 100]", "unlikely-density",
         "the size looks like millimetres, 0.2 x 0.2 x 0.1 m?"),
        ("size: [0.2, 0.2, 0.2]", "size: [60, 50, 80]", "unlikely-size",
         "it looks like millimetres, 0.06 x 0.05 x 0.08 m, or centimetres, 0.6 x 0.5 x 0.8 m?"),
        ("mass: 1.0", "mass: 1.0\n  center_of_mass: [0, 1.5, 50]", "center-of-mass-outside",
         "in metres: millimetres are [0, 0.0015, 0.05] m"),
        ("mass: 1.0", "mass: 1.0\n  center_of_mass: [0, 0, 5]", "center-of-mass-outside",
         "in metres: centimetres are [0, 0, 0.05] m, millimetres are [0, 0, 0.005] m"),
    ],
)  # fmt: skip
def test_what_looks_like_another_unit_is_said_in_the_right_one(tmp_path, old, new, code, advice):
    scene = loaded(tmp_path, (old, new))
    if "density" in new:
        # A cube of 0.2 m.
        assert scene.object.mass == pytest.approx(0.004)
    if new == "mass: 300":
        # 37 500 kg/m^3.
        assert found(scene)[FindingCode(code)].message.endswith("more than any metal")
    assert found(scene)[FindingCode(code)].advice.endswith(advice)
    if code == FindingCode.UNLIKELY_SIZE:  # of what a hand is to hold
        assert FindingCode.UNLIKELY_SIZE not in found(scene.with_changes(hand=None))


def test_a_centre_of_mass_is_off_by_no_more_than_the_object_is_large(tmp_path):
    scene = loaded(tmp_path)
    words = "by 10 m along z, but object 'box' is 0.2 m large there; give metres: centimetres are"
    with pytest.raises(ArgumentError, match=words):
        scene.solve("margin", uncertainty=Uncertainty(center_of_mass=[0.0, 0.0, 10.0]))
    assert scene.solve("margin", uncertainty=Uncertainty(center_of_mass=[0.0, 0.0, 0.2])).status


@pytest.mark.parametrize("change", [("mass: 1.0", "density: 29000"), ("mass: 1.0", "density: 1.1"),
                                    ("[0.2, 0.2, 0.2]", "[4.9, 0.2, 0.2]")])  # fmt: skip
def test_heavy_light_and_large_objects_that_exist_are_no_finding(tmp_path, change):
    odd = {FindingCode.UNLIKELY_DENSITY, FindingCode.UNLIKELY_SIZE}
    scene = loaded(tmp_path, change)
    assert not odd.intersection(found(scene))


def test_tolerances_and_inertias_that_fit_the_object_are_no_finding(tmp_path):
    """Nor is what a file leaves out, beside whatever object."""
    odd = {FindingCode.UNLIKELY_INERTIA, FindingCode.UNLIKELY_SIZE}
    stated = ("friction: 0.3", "friction: 0.3\ncontact_tolerance: 0.0199\nmax_penetration: 0.0199")
    own = ("mass: 1.0", "mass: 1.0\n  inertia: [0.0299, 0.0299, 0.0299]")
    assert not odd.intersection(found(loaded(tmp_path, stated, own)))
    thin = ("[0.2, 0.2, 0.2]", "[0.2, 0.2, 0.002]")
    assert not odd.intersection(found(loaded(tmp_path, thin)))


def test_a_palm_that_misses_is_not_to_be_closed():
    allegro = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    palm = next(one for one in hand_of(allegro).placed_bodies if one.name == "palm_link")
    back = palm.T_world_geometry @ [-0.0204 - 0.01 - 0.003, 0, 0, 1]  # a box of 40.8 mm
    T = np.eye(4)
    T[:3, 3] = back[:3]
    ball = replace(allegro.object, shape=Sphere(0.01)).with_pose(T)
    one = found(allegro.with_changes(object=ball, supports=()))[FindingCode.FINGER_MISSED]
    assert "'palm_link' is 3 mm from object" in one.message
    assert "move the hand closer" in one.advice and "finger" not in one.advice
    assert one.key == ("hand", "base_pose")


@pytest.mark.parametrize("gap", [0.00099, 0.00502])
def test_what_touches_or_is_far_away_is_not_missed(tmp_path, gap):
    scene = loaded(tmp_path, (FLOOR, f"pose: {{position: [0, 0, {-0.1 - gap}]}}"))
    assert FindingCode.SUPPORT_MISSED not in found(scene)


@pytest.mark.parametrize(
    ("change", "key", "advice"),
    [
        ((FLOOR, "pose: {position: [0, 0, -0.0951]}"), ("supports", 0, "pose"), "settle"),
        ((HAND, "position: [-0.1, -0.097, 0.0]"), ("hand", "q"), "open the finger"),
    ],
)
def test_an_overlap_stands_where_it_is_mended(tmp_path, change, key, advice):
    one = found(loaded(tmp_path, change))[FindingCode.DEEP_OVERLAP]
    assert one.key == key and advice in one.advice


def test_a_palm_in_the_object_is_moved_away():
    allegro = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    palm = next(one for one in hand_of(allegro).placed_bodies if one.name == "palm_link")
    T = np.eye(4)
    T[:3, 3] = (palm.T_world_geometry @ [-0.0204 - 0.01 + 0.002, 0, 0, 1])[:3]
    ball = replace(allegro.object, shape=Sphere(0.01)).with_pose(T)
    one = found(allegro.with_changes(object=ball, supports=()))[FindingCode.DEEP_OVERLAP]
    assert "'palm_link' and object" in one.message
    assert one.key == ("hand", "base_pose") and "move the hand away" in one.advice


def test_a_hand_in_itself_is_one_finding():
    """The deepest pair is told, and how many others there are."""
    allegro = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    bent = {"joint_0.0": -0.47, "joint_4.0": 0.0, "joint_8.0": 0.47} | {
        f"joint_{n}.0": 1.6 for n in (1, 2, 3, 5, 6, 7, 9, 10, 11)
    }
    hand = hand_of(allegro).with_configuration({**hand_of(allegro).q, **bent})
    deep = unwanted_overlaps(hand, tolerance=0.005)
    assert len(deep) > 2
    told = [
        one
        for one in allegro.with_changes(hand=hand).findings
        if one.code is FindingCode.HAND_THROUGH_ITSELF
    ]
    worst = max(deep, key=lambda one: one.depth)
    assert [one.message for one in told] == [f"{worst}, and {len(deep) - 1} more pairs less deep"]


def test_deeper_overlaps_may_be_allowed(tmp_path):
    deep = FLOOR, "pose: {position: [0, 0, -0.093]}"
    with pytest.raises(
        SceneError,
        match=r":\d+: object\.pose: support .* 7.00 mm, more than max_penetration \(5.00 mm\)",
    ):
        loaded(tmp_path, deep).problem()
    scene = loaded(tmp_path, deep, ("friction: 0.3", "friction: 0.3\nmax_penetration: 0.008"))
    assert scene.problem().contact_count == 5
    assert FindingCode.DEEP_OVERLAP in found(scene)


def on_a_knife(across: float, shape=None) -> Scene:
    """A box tilted by 45 degrees, its lower edge across the upper edge of a tilted support."""
    half = 0.1 * np.sqrt(2.0)
    base = load_scene(EXAMPLES / "paper" / "cuboid_at_rest.yaml")
    R = np.array([[half, 0, half], [0, 0.1, 0], [-half, 0, half]])
    R[[0, 2]] /= 0.2
    R[1, 1] = 1.0
    T = np.eye(4)
    T[:3, :3], T[2, 3] = R, half
    below = np.eye(4)
    turn = np.array([[np.cos(across), -np.sin(across), 0], [np.sin(across), np.cos(across), 0],
                     [0, 0, 1]])  # fmt: skip
    below[:3, :3], below[2, 3] = turn @ R, -half
    support = Support("knife", shape or Box((0.2, 0.2, 0.2)), below, friction=0.5)
    made = base.object.with_pose(T)
    return base.with_changes(hand=None, object=made, supports=(support,), friction=0.5)


def test_an_edge_on_an_edge_is_marked():
    one = found(on_a_knife(1.0))[FindingCode.AMBIGUOUS_NORMAL]
    assert one.subject == "knife" and "by 45 degrees" in one.message
    assert one.severity is Severity.NOTE


def test_a_face_in_a_face_and_an_edge_on_a_ball_are_not(tmp_path):
    deep = loaded(tmp_path, (FLOOR, "pose: {position: [0, 0, -0.0951]}"))
    assert FindingCode.AMBIGUOUS_NORMAL not in found(deep)
    scene = on_a_knife(1.0, Sphere(0.1 * np.sqrt(2.0)))
    assert scene.contacts.points
    assert FindingCode.AMBIGUOUS_NORMAL not in found(scene)


def over_a_step(height: float, apart: float) -> Scene:
    """A box on two plates, the second one lower, with so much between their edges."""
    base = load_scene(EXAMPLES / "paper" / "cuboid_at_rest.yaml")
    T = np.eye(4)
    T[2, 3] = 0.1
    plates = []
    for name, x, top in (("high", 0.5, 0.0), ("low", -0.5, -height)):
        T_plate = np.eye(4)
        T_plate[[0, 2], 3] = x * (1.0 + apart), top - 0.5
        plates.append(Support(name, Box((1.0, 1.0, 1.0)), T_plate, friction=0.5))
    made = replace(base.object, shape=Box((0.2, 0.2, 0.2))).with_pose(T)
    return base.with_changes(hand=None, object=made, supports=(*plates,), friction=0.5)


def test_a_contact_that_hangs_behind_another_of_the_same_rigid_body_is_marked():
    """Over 0.1 m faces count as parallel up to 0.5 mm: what is more takes a turn."""
    one = found(over_a_step(0.8e-3, 0.1))[FindingCode.UNEVEN_GAPS]
    assert one.subject == "low" and one.key == ("contact_tolerance",)
    assert "'low' is 0.8 mm from object" in one.message
    assert "where 'high', which is rigidly connected to it, is 0 mm from it" in one.message
    assert f"turn by {np.degrees(np.arctan(0.8 / 100.0)):.2g} degrees" in one.message
    assert one.advice.endswith("contact_tolerance below 0.8 mm")
    assert FindingCode.UNEVEN_GAPS not in found(over_a_step(0.5e-3, 0.1))
    left_out = over_a_step(0.8e-3, 0.1).with_changes(contact_tolerance=0.7e-3)
    assert FindingCode.UNEVEN_GAPS not in found(left_out)


@pytest.mark.parametrize(("between", "marked"), [("fixed", True), ("revolute", False)])
def test_links_that_no_joint_parts_cannot_close_two_gaps(tmp_path, between, marked):
    ball = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'
    limit = '<limit lower="-1" upper="1" effort="20" velocity="1"/>'
    (tmp_path / "finger.urdf").write_text(
        f'<robot name="finger"><link name="rail"/><link name="pad">{ball}</link>'
        f'<link name="tip">{ball}</link><joint name="slide" type="prismatic"><parent link="rail"/>'
        f'<child link="pad"/><axis xyz="0 1 0"/>{limit}</joint><joint name="bend" type="{between}">'
        '<parent link="pad"/><child link="tip"/><origin xyz="0 -0.0008 0.04"/>'
        f'<axis xyz="1 0 0"/>{limit}</joint></robot>'
    )
    mount = "robot: lever_100mm", "urdf: finger.urdf"
    pose = HAND + ", rpy: [3.141592653589793, 0, 0]", "position: [0, -0.11, 0]"
    scene = loaded(tmp_path, mount, pose, ("  q: {hinge: 0.0}\n", ""))
    marks = [one for one in scene.findings if one.code is FindingCode.UNEVEN_GAPS]
    assert [one.subject for one in marks] == ["tip"] * marked
    assert all("'pad', which is rigidly connected to it" in one.message for one in marks)


def test_a_gap_that_sliding_closes_is_none(tmp_path):
    """The box slides to the wall; in a slot it cannot touch both walls."""
    walls = [
        f"\n  - name: {name}\n    shape: {{type: box, size: [1.0, 1.0, 0.1]}}\n"
        f"    pose: {{position: [{x}, 0, 0]}}"
        for name, x in (("right", 0.6009), ("left", -0.6009))
    ]
    one, both = (loaded(tmp_path, (FLOOR, FLOOR + "".join(walls[:n]))) for n in (1, 2))
    assert "right" in one.contacts.bodies and "left" in both.contacts.bodies
    assert FindingCode.UNEVEN_GAPS not in found(one)
    assert found(both)[FindingCode.UNEVEN_GAPS].subject in ("left", "right")


def test_joints_in_degrees_are_found_where_no_limit_refuses_them():
    scene = load_scene(EXAMPLES / "trihand_push_box.yaml")
    turned = np.array(hand_of(scene).positions)
    turned[0] = 90.0
    hand = changed(hand_of(scene), positions=turned)
    one = found(scene.with_changes(hand=hand))[FindingCode.ANGLE_IN_DEGREES]
    assert "90 degrees are 1.571 rad" in one.advice


def test_an_angle_that_may_be_radians_is_not_converted(tmp_path):
    mixed = "rpy: [3.1415927, 90, 0]"
    one = found(loaded(tmp_path, ("rpy: [3.141592653589793, 0, 0]", mixed)))
    advice = one[FindingCode.ANGLE_IN_DEGREES].advice
    assert advice.endswith("if 90 alone is in degrees, it is [3.1415927, 1.5708, 0] rad")


def test_a_finding_of_the_file_says_where_until_the_scene_is_changed(tmp_path):
    floor = "pose: {position: [0, 0, -0.1]}"
    scene = loaded(
        tmp_path,
        ("friction: 0.3", "friction:\n  hand: 80"),
        (floor, f"{floor}\n    friction: 4"),
    )
    places = {one.subject: one.place for one in scene.findings}
    file = tmp_path / "scene.yaml"
    assert places["hand"] == f"{file}:3: friction.hand"
    assert places["floor"] == f"{file}:17: supports[0].friction"
    assert pickle.loads(pickle.dumps(scene)).findings == scene.findings  # noqa: S301
    changed = scene.with_changes(friction={"hand": 90}).findings
    assert {one.subject: one.place for one in changed} == {"hand": "", "floor": places["floor"]}


def test_an_option_of_another_algorithm_is_told(tmp_path):
    asks = "friction: 0.3\nsolve: {algorithm: margin, margin: 0.2, scale: limits}"
    scene = loaded(tmp_path, ("friction: 0.3", asks))
    told = [one for one in scene.solve().findings if one.code is FindingCode.UNUSED_OPTION]
    assert [one.severity for one in told] == [Severity.NOTE] * 2
    place = f"{tmp_path / 'scene.yaml'}:3: solve"
    assert [one.place for one in told] == [f"{place}.margin", f"{place}.scale"]
    assert "margin is 0.2, which has no effect with the scene's algorithm, 'margin'" in str(told[0])
    assert "algorithm: torque" in told[0].advice
    # Where it is asked for, and where the usual value is written out, nothing is ignored.
    assert scene.solve("torque").findings == scene.solve("margin").findings == ()
    usual = loaded(tmp_path, ("friction: 0.3", asks.replace("0.2, scale: limits", "0.1")))
    assert usual.solve().findings == ()


def test_warnings_are_errors_if_the_scene_says_so(tmp_path):
    strict = "friction: 80\nwarnings: error"
    with pytest.raises(SceneError) as caught:
        loaded(tmp_path, ("friction: 0.3", strict), ("mass: 1.0", "mass: 1000"))
    lines = str(caught.value).splitlines()
    assert len(lines) == 2
    assert "scene.yaml:11: object.mass: object 'box' has 1.25e+05 kg/m^3" in lines[0]
    assert "scene.yaml:2: friction.default: the coefficient of friction 80" in lines[1]
    assert all("because of 'warnings: error'" in line for line in lines)
    assert loaded(tmp_path, ("friction: 0.3", "friction: 0.3\nwarnings: error")).findings == ()


def test_a_solution_has_the_findings_of_its_scene_and_its_own(tmp_path):
    scene = loaded(
        tmp_path, (HAND, "position: [-0.1, -0.6, 0.0]"), ("friction: 0.3", "friction: 4")
    )
    solution = scene.solve()
    codes = [one.code for one in solution.findings]
    assert codes[0] is FindingCode.HAND_TOUCHES_NOTHING and FindingCode.STEEP_FRICTION in codes
    assert pickle.loads(pickle.dumps(solution)).findings == solution.findings  # noqa: S301
    document = solution_document(solution, scene)
    assert [one["code"] for one in document["findings"]] == codes
    assert read_solution(document).findings == solution.findings
    # Commands have said what is wrong where the answer stands.
    first, *rest = scene_solution_text(scene, solution).splitlines()
    assert first.startswith("serious: hand-touches-nothing: ")
    assert not any("serious" in line for line in rest)


def test_a_margin_of_zero_and_a_search_cut_short_are_found(tmp_path):
    weak = loaded(tmp_path, ("  q: {hinge: 0.0}", "  effort_limits: {finger: 0}"))
    assert FindingCode.NO_RESERVE in [one.code for one in weak.solve().findings]
    short = load_scene(EXAMPLES / "paper" / "cuboid_at_rest.yaml").solve("torque", node_limit=3)
    assert [one.code for one in short.findings] == [FindingCode.NOT_OPTIMAL]


def test_python_hears_of_what_loading_finds(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_text(LINES.replace("rpy: [3.14", "rpy: [0, 90, 3.14"), encoding="utf-8")
    file.write_text(file.read_text().replace("793, 0, 0]", "793]"), encoding="utf-8")
    with pytest.warns(GrasplessPinWarning, match=r"scene.yaml:5: hand.base_pose.rpy: ") as caught:
        load_scene(file)
    (one,) = (item.message for item in caught)
    assert isinstance(one, GrasplessPinWarning)
    assert isinstance(one.finding, Finding)
    assert one.finding.code is FindingCode.ANGLE_IN_DEGREES


def test_what_is_heard_warns_nobody():
    told = Finding(FindingCode.NO_VIDEO, "video", "there is none", "save a page")
    with capture() as outer:
        with capture() as inner:
            emit(told)
        assert inner == [told]
        assert outer == []
    with pytest.warns(GrasplessPinWarning, match="there is none; save a page"):
        emit(told)


def test_findings_are_sorted_and_said_once():
    all_codes = [Finding(code, "x", "y", "z") for code in FindingCode]
    shuffled = causes_first([*reversed(all_codes), *all_codes])
    units = {FindingCode(code) for code in (
        "angle-in-degrees", "angle-in-radians", "unlikely-size", "unlikely-density",
        "unlikely-inertia", "unlikely-gravity", "mesh-scale",
    )}  # fmt: skip
    assert {one.code for one in shuffled[: len(units)]} == units
    weights = [list(Severity).index(one.severity) for one in shuffled[len(units) :]]
    assert weights == sorted(weights)
    assert len(shuffled) == len(all_codes)
