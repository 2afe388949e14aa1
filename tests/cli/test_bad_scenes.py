"""Mistakes in a scene file: the message names file, line, key, what was found and what would do."""

import pytest
from cli_tools import LINES, assert_refused, solve_text, spoilt

from graspless_pin.geometry.bodies.shapes import SHAPES

NUMBER = "a finite number"
SIZE = "[0.2, 0.2, 0.2]"
BOX = "{type: box, size: [0.2, 0.2, 0.2]}"
POSE = "{position: [0, 0, 0]}"
Q = "  q: {hinge: 0.0}"
FRICTION = "friction: 0.3"
ONE_HAND = LINES[LINES.index("  robot") : LINES.index("object:")]
*PARTS, LAST = [f"'{name}'" for name, shape in SHAPES.items() if shape.is_bounded]
COMPOUND = "{type: compound, parts: [{shape: {type: box, size: [0.2, 0.2, 0.2]}, pose: %s}]}"

# What is replaced, by what, and the message after the file's name.
CASES = {
    "key of another shape": (
        SIZE,
        SIZE + ", radius: 1",
        ":9: object.shape.radius: unknown key; known: size, type",
    ),
    "missing key of a shape": (
        ", size: [0.2, 0.2, 0.2]",
        "",
        f":9: object.shape.size: is missing; needs a list of 3, each {NUMBER} > 0",
    ),
    "number for a text": ("name: box", "name: 7", ":8: object.name: found 7; needs text"),
    "list for a mapping": (
        "{hinge: 0.0}",
        "[0.0]",
        f":6: hand.q: found [0.0]; needs a mapping of at most 1000 names, each to {NUMBER}",
    ),
    "mapping for a list": (
        "supports:\n  - name",
        "supports:\n    name",
        ":12: supports: found {'name'",
    ),
    "inf": ("-9.8", "-.inf", f":1: gravity[2]: found -inf; needs {NUMBER}"),
    "two numbers for three": (
        "[0, 0, -9.8]",
        "[0, -9.8]",
        f":1: gravity: found [0, -9.8]; needs a list of 3, each {NUMBER}",
    ),
    "one number for three": (
        "[0, 0, -9.8]",
        "9.8",
        f":1: gravity: found 9.8; needs a list of 3, each {NUMBER} within ±1e+12; if z points up, "
        "write [0, 0, -9.8]",
    ),
    "zero quaternion of the hand": (
        "{position: [-0.1, -0.1, 0.0], rpy: [3.141592653589793, 0, 0]}",
        "\n    quaternion: [0, 0, 0, 0]",
        ":6: hand.base_pose.quaternion: a quaternion x, y, z, w must not be zero",
    ),
    "flat box": (SIZE, "[0.2, 0, 0.2]", f":9: object.shape.size[1]: found 0; needs {NUMBER} > 0"),
    "half-space as object": (
        BOX,
        "{type: half_space}",
        ":9: object.shape: found {'type': 'half_space'}; needs a mapping with the type "
        f"{', '.join([*PARTS, LAST])} or 'compound'",
    ),
    "shape of no part": (
        BOX,
        "{type: compound, parts: [{shape: {type: half_space}}]}",
        ":9: object.shape.parts[0].shape: found {'type': 'half_space'}; needs a mapping with the "
        f"type {', '.join(PARTS)} or {LAST}",
    ),
    "zero quaternion of a part": (
        BOX,
        COMPOUND % "{quaternion: [0, 0, 0, 0]}",
        ":9: object.shape.parts[0].pose.quaternion: a quaternion x, y, z, w must not be zero",
    ),
    "flat hull": (
        BOX,
        "{type: hull, points: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]}",
        ":9: object.shape: the hull is almost flat",
    ),
    "unknown robot among several": (
        ONE_HAND,
        "  mounts:\n    - {prefix: a, robot: lever_100mm}\n    - {prefix: b, robot: lvr_100mm}\n",
        ":6: hand.mounts[1].robot: unknown robot 'lvr_100mm'",
    ),
    "prefixes that do not differ": (
        ONE_HAND,
        "  mounts: [{prefix: a, robot: lever_100mm}, {prefix: a, robot: lever_150mm}]\n",
        ":4: hand.mounts: prefixes must differ, got ['a', 'a']",
    ),
    "pose beside mounts": (
        "  robot: lever_100mm",
        "  mounts: [{prefix: a, robot: lever_100mm}]",
        ":3: hand: found mounts and base_pose; with several robots each entry of 'mounts' has its",
    ),
    "two sources of a hand": (
        "  robot: lever_100mm",
        "  robot: lever_100mm\n  urdf: ''",
        ":3: hand: found robot and urdf; needs exactly one of 'robot', 'urdf' and 'mounts'",
    ),
    "no source of a hand": (
        "  robot: lever_100mm\n",
        "",
        ":3: hand: found none of them; needs exactly one of 'robot', 'urdf' and 'mounts'",
    ),
    "joint name that is a number": (
        "hinge: 0.0",
        "1: 0.0",
        ":6: hand.q.1: found 1 as a name; a name is text: put it in quotes",
    ),
    "object called like a link": (
        "name: box",
        "name: tip",
        ":8: object.name: 'tip' is the name of another body, too; names must be distinct",
    ),
    "nameless support": (
        "name: floor",
        "name: ''",
        ":13: supports[0].name: needs a text that is not empty, got ''",
    ),
    "friction not for all": (
        FRICTION,
        "friction: {floor: 0.2}",
        ": friction: has no coefficient for 'tip'; add 'tip', 'hand' or 'default'",
    ),
    "motion of a hand that is not there": (
        LINES[LINES.index("hand:") : LINES.index("object:")],
        "motion: {object_twist: {}, hand: {}}\n",
        ":3: motion.hand: requires a hand, and the scene has none",
    ),
}

OF_THE_MASS = {
    "yes": f":10: object.mass: found True; needs {NUMBER} > 0",
    "0": f":10: object.mass: found 0; needs {NUMBER} > 0",
    ".nan": f":10: object.mass: found nan; needs {NUMBER} > 0",
    "1" + 400 * "0": f"; needs {NUMBER} > 0",
}
"""What stands in the place of the mass, and the message."""
OF_THE_POSE = {
    "rpy: [0, 0, 0], quaternion: [0, 0, 0, 1]": (
        ":11: object.pose: found rpy and quaternion; give one form of the rotation"
    ),
    "matrix: [[1, 0, 0], [0, 2, 0], [0, 0, 1]]": (
        ":11: object.pose.matrix: the rotation part is not orthonormal (R^T R is off by 3)"
    ),
    "matrix: [[1, 0, 0], [0, -1, 0], [0, 0, 1]]": (
        ":11: object.pose.matrix: the rotation part is a reflection (determinant -1); flip one axis"
    ),
    "quaternion: [0, 0, 0, 0]": (
        ":11: object.pose.quaternion: a quaternion x, y, z, w must not be zero"
    ),
    "quaternion: [1, 0, 2, 0]": (
        ":11: object.pose.quaternion: found [1.0, 0.0, 2.0, 0.0], of length 2.236; needs x, y, z, w"
    ),
}
"""The same of its pose."""
ADDED = {
    "frction: 0.4": ":3: frction: unknown key; did you mean 'friction'? known: acceleration,",
    "cone_edges: true": ":3: cone_edges: found True; needs a whole number >= 3",
    "contacts:\n  - {body: wall, position: [0, 0, 0], normal: [0, 0, 1]}": (
        ":4: contacts[0].body: 'wall' is neither a hand link nor a support; known: floor, base,"
    ),
    "contacts:\n  - {body: floor, position: [0, 0, 0], normal: [0, 0, 0]}": (
        ":4: contacts[0].normal: found [0.0, 0.0, 0.0]; needs a direction"
    ),
    "contacts: []": (
        ": nothing touches object 'box'; contacts is an empty list: fill it, or leave it out"
    ),
    "tangent_axes: [[1, 0, 0], [0, 0, 0]]": (
        ":3: tangent_axes[1]: found [0.0, 0.0, 0.0]; needs a direction"
    ),
    "cone_edges: 2": ":3: cone_edges: found 2; needs a whole number >= 3",
    "motion: {object_twist: {linear: [0, 0, -0.1]}}": (
        ": motion: the declared motion drives object 'box' into support 'floor' at 0.1 m/s; change"
    ),
    "motion: {object_twist: {linear: [0, 0.1, 0.1]}, hand: {}}": (
        ": the declared motion separates object 'box' from all bodies that touch it; no contact"
    ),
    "motion: {hand: {}}": (
        ":3: motion.object_twist: is missing; needs a mapping with the keys linear, angular"
    ),
    "motion:\n  object_twist: {}\n  hand: {joint_velocities: {hing: 1}}": (
        ":5: motion.hand.joint_velocities: unknown independent joint 'hing'; did you"
    ),
    "solve: {solver: simplex}": (
        ": solve.solver: 'simplex' is unknown or not installed; available: clarabel, highs,"
    ),
    "solve: {margin: -1}": f":3: solve.margin: found -1; needs {NUMBER} >= 0",
    "solve: {algorithm: best}": ":3: solve.algorithm: found 'best'; needs 'margin' or 'torque'",
}
"""A line that is added to the scene, and the message."""
OF_THE_HAND = {
    "count_own_weight: 3": ":6: hand.count_own_weight: found 3; needs true or false",
    "control: {thumb: force}": (
        ":6: hand.control: unknown finger or joint 'thumb'; known: finger, hinge"
    ),
    "control: {finger: soft}": (
        ":6: hand.control.finger: found 'soft'; needs 'force', 'position' or 'hybrid'"
    ),
    "control: hybrid": ":6: hand.control: hybrid control is per finger: give",
    "effort_limits: {finger: [1, -1]}": (
        ":6: hand.effort_limits.finger: the lower limit is above the upper one: (1.0, -1.0)"
    ),
    "effort_limits: {finger: -1}": (
        f":6: hand.effort_limits.finger: found -1; needs {NUMBER} >= 0, at most 1e+30 or a list of "
        "2, each"
    ),
    "effort_limits: {fingr: 1}": (
        ":6: hand.effort_limits: unknown finger or joint 'fingr'; did you mean 'finger'?"
    ),
    "fingers: {f: {joints: [nope]}}": ":6: hand.fingers.f: unknown joint 'nope'; known: hinge",
    "fingers: {f: {joints: []}}": (
        ":6: hand.fingers.f.joints: found []; needs a list of at least 1 and at most 1000, each "
        "item text"
    ),
    "package_dirs: [x]": (
        ":6: hand.package_dirs: is only available with a URDF file, not with 'lever_100mm'"
    ),
}
"""What stands in the place of the joints, and the message."""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        *(pytest.param(*case, id=name) for name, case in CASES.items()),
        *(("mass: 1.0", f"mass: {mass}", message) for mass, message in OF_THE_MASS.items()),
        *((POSE, f"{{{pose}}}", message) for pose, message in OF_THE_POSE.items()),
        *((FRICTION, f"{FRICTION}\n{added}", message) for added, message in ADDED.items()),
        *((Q, f"  {key}", message) for key, message in OF_THE_HAND.items()),
    ],
)
def test_a_mistake_is_named(tmp_path, old, new, message):
    result = solve_text(tmp_path, spoilt(old, new))
    assert_refused(result, message)
    assert str(tmp_path / "scene.yaml") in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1


def test_the_scene_itself_is_right(tmp_path):
    result = solve_text(tmp_path, LINES)
    assert result.exit_code == 0 and result.stderr == ""


def test_several_mistakes_are_all_named(tmp_path):
    text = spoilt("mass: 1.0", "mass: -1", spoilt(FRICTION, "frction: 0.3"))
    result = solve_text(tmp_path, text)
    assert_refused(result, ":2: frction: unknown key")
    for message in (":10: object.mass: found -1", ":1: friction: is missing"):
        assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 3


def test_a_hybrid_finger_with_two_contacts(tmp_path):
    contacts = "".join(
        f"\n  - {{body: tip, position: [{x}, -0.1, 0], normal: [0, 1, 0]}}" for x in (0, 0.01)
    )
    text = spoilt(FRICTION, f"friction: 0.3\ncontacts:{contacts}")
    result = solve_text(tmp_path, spoilt(Q, "  control: {finger: hybrid}", text))
    assert_refused(result, "scene.yaml: hybrid finger 'finger' touches the object at several")


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        (BOX, "{type: box, size: [80, 60, 40]}", "looks like millimetres"),
        (POSE, "{position: [0, 0, 0], rpy: [0, 30, 0]}", "are more than a turn"),
    ],
)
def test_what_explains_an_error_stands_above_it(tmp_path, old, new, cause):
    told = solve_text(tmp_path, spoilt(old, new)).stderr
    assert "overlap by" in told.partition("error: ")[2]
    assert cause in told.partition("error: ")[0]


def test_a_misspelt_key_comes_before_what_is_missing_because_of_it(tmp_path):
    told = solve_text(tmp_path, spoilt(FRICTION, "frction: 0.3")).stderr.splitlines()
    assert "frction: unknown key; did you mean 'friction'?" in told[0]
    assert "friction: is missing" in told[1]


def test_an_mjcf_is_named_as_a_urdf_is(tmp_path):
    result = solve_text(tmp_path, spoilt(ONE_HAND, "  mjcf: hand.xml\n"))
    assert_refused(result, "hand: found mjcf; use the key 'urdf' for an MJCF, too")
