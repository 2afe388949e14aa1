"""The audit of URDFs and the list of robots: known answers."""

import re

import numpy as np
import pytest
import trimesh
from hand_tools import joint, link, write_urdf

from graspless_pin.cli.robots import robot_text
from graspless_pin.errors import MeshError, RobotError
from graspless_pin.findings import FindingCode, capture
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.inspection import audit_urdf, list_robots
from graspless_pin.geometry.robots.files import robot_names

BALL = '<sphere radius="0.01"/>'
MESH = '<mesh filename="{}"/>'
FILES = ("cup", "ell", "open")
TWO = link("a", BALL) + link("b", BALL)


def found(report):
    return [(item.code, item.subject) for item in report.findings]


def audit(tmp_path, body, **options):
    return audit_urdf(write_urdf(tmp_path, body), **options)


def test_limits_efforts_and_mimics(tmp_path):
    body = link("a", BALL) + "".join(link(name, BALL) for name in "bcdefg")
    body += joint("zero", "a", "b", limit='lower="-1" upper="1" effort="0"')
    body += joint("endless", "b", "c", "continuous", limit="")
    body += joint("bent", "c", "d", limit='lower="0.5" upper="1" effort="1"')
    body += joint("lost", "d", "e", extra='<mimic joint="ero"/>')
    far = '<mimic joint="zero" offset="3"/><mimic joint="endless"/>'
    body += joint("far", "e", "f", extra=far)
    body += joint("left_lead", "f", "g", limit='lower="-1" upper="1" effort="1000"')
    report = audit(tmp_path, body.replace('"ero"', '"lead"'))
    assert report.loads
    assert found(report) == [
        (FindingCode.DANGLING_MIMIC, "joint lost"),
        (FindingCode.PLACEHOLDER_EFFORT, "joint zero"),
        (FindingCode.PLACEHOLDER_EFFORT, "joint endless"),
        (FindingCode.PLACEHOLDER_EFFORT, "joint left_lead"),
        (FindingCode.NEUTRAL_OUTSIDE, "joint bent"),
        (FindingCode.NEUTRAL_OUTSIDE, "joint far"),
    ]
    assert "perhaps left_lead" in report.findings[0].advice
    assert "it is at 0.5" in report.findings[4].message
    assert "to 3, outside its limits [-1, 1]" in report.findings[5].message


@pytest.mark.parametrize(("effort", "believed"), [(150, True), (999, True), (1000, False)])
def test_an_arm_without_a_hand_may_be_strong(tmp_path, effort, believed):
    """A UR5 gives 150 N m; nothing says that its joints are fingers."""
    strong = f'lower="-3" upper="3" effort="{effort}"'
    body = TWO + link("c", BALL) + joint("shoulder", "a", "b", limit=strong)
    body += joint("elbow", "b", "c", limit='lower="-3" upper="3" effort="28"')
    report = audit(tmp_path, body)
    assert found(report) == (
        [] if believed else [(FindingCode.PLACEHOLDER_EFFORT, "joint shoulder")]
    )


def test_a_finger_is_not_as_strong_as_an_arm(tmp_path):
    body = "".join(link(name, BALL) for name in "abc")
    strong = 'lower="-1" upper="1" effort="150"'
    body += joint("left", "a", "b", limit=strong) + joint("right", "a", "c", limit=strong)
    assert [code for code, _ in found(audit(tmp_path, body))] == 2 * [
        FindingCode.PLACEHOLDER_EFFORT
    ]


def test_links_without_a_mass_beside_others(tmp_path):
    """A robot without any masses is one for kinematics: nobody forgot one."""
    heavy = '<link name="a"><inertial><mass value="0.2"/></inertial></link>'
    body = link("b", BALL) + joint("i", "a", "b")
    assert found(audit(tmp_path, link("a") + body)) == []
    assert found(audit(tmp_path, heavy + body)) == [(FindingCode.WEIGHTLESS_LINK, "links b")]


def test_meshes(tmp_path):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.export(tmp_path / "good.stl")
    trimesh.creation.box((100.0, 50.0, 50.0)).export(tmp_path / "millimetres.stl")
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]])
    flat.export(tmp_path / "flat.stl")
    (tmp_path / "broken.stl").write_text("no mesh")
    address = f"file://{tmp_path}/"
    files = {
        "a": f"{address}good.stl",
        "b": "good.stl",
        "c": f"{address}millimetres.stl",
        "d": f"{address}flat.stl",
        "e": f"{address}broken.stl",
        "f": "package://gone/gone.stl",
    }
    body = "".join(link(name, MESH.format(file)) for name, file in files.items())
    for parent, child in zip("abcde", "bcdef", strict=True):
        body += joint(child, parent, child, "fixed", limit="")
    seen = f"<visual><geometry>{MESH.format('gone.dae')}</geometry></visual></link>"
    report = audit(tmp_path, body.replace("</link>", seen, 1))
    assert not report.loads
    assert found(report) == [
        (FindingCode.MESH_SCALE, "link c, collision"),
        (FindingCode.MISSING_MESH, "link f, collision"),
        (FindingCode.UNUSABLE_MESH, "link d, collision"),
        (FindingCode.UNUSABLE_MESH, "link e, collision"),
        (FindingCode.MISSING_VISUAL, "link a, visual"),
        (FindingCode.RELATIVE_MESH, "robot"),
    ]
    assert "is 100 m large" in report.findings[0].message
    assert "package_dirs" in report.findings[1].advice


@pytest.mark.parametrize(
    ("written", "advice"),
    [
        ("package://my_hand/meshes/fingr.stl", "did you mean 'finger.stl'?"),
        ("package://my_hand/mesh/finger.stl", "did you mean 'meshes'?"),
        ("package://my_hnd/meshes/finger.stl", "did you mean 'my_hand'?"),
        ("ros/my_hand/meshes/fingr.stl", "did you mean 'finger.stl'?"),
        ("package://my_hand/meshes/thumb_base.obj", "put the file there or correct the path"),
        ("package://other/finger.stl", "give package_dirs, the folder that holds the package"),
    ],
)
def test_what_to_do_about_a_missing_mesh(tmp_path, written, advice):
    meshes = tmp_path / "ros" / "my_hand" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "finger.stl").touch()
    file = write_urdf(tmp_path, link("a", MESH.format(written)))
    report = audit_urdf(file, package_dirs=[tmp_path / "ros"])
    first = report.findings[0]
    assert (first.code, first.advice) == (FindingCode.MISSING_MESH, advice)
    with pytest.raises(MeshError, match=re.escape(f"; {advice}")):
        Hand.from_urdf(file, package_dirs=[tmp_path / "ros"])


def test_lengths_in_millimetres(tmp_path):
    """Of joints and of shapes; a robot in metres has none of it."""
    apart = 'xyz="0 60 0"'
    body = link("palm") + link("a", '<box size="20 40 8"/>')
    body += joint("turn", "palm", "a", origin=apart)
    first = audit(tmp_path, body).findings[0]
    assert first.code is FindingCode.UNLIKELY_SIZE
    assert str(first).endswith(
        "joint 'turn' is 60 m from the origin of link 'palm', and 3 more such lengths; lengths are "
        "metres: in a file in millimetres this is 0.06 m"
    )
    body = body.replace(apart, 'xyz="0 0.06 0"').replace("20 40 8", "0.02 40 0.008")
    assert "the box of link 'a' is 40 m long or wide; l" in str(audit(tmp_path, body).findings[0])
    good = audit(tmp_path, body.replace(" 40 ", " 0.04 "))
    assert FindingCode.UNLIKELY_SIZE not in dict(found(good))


INERTIA = '<inertia ixx="6e-6" ixy="0" ixz="0" iyy="6e-6" iyz="0" izz="2e-6"/>'
FINGER = """<link name="{name}"><inertial><origin xyz="0 0 0.02"/><mass value="0.03"/>{inertia}
</inertial><collision><origin xyz="0 0 0.02" rpy="0 0 3.1416"/><geometry>
<box size="0.02 0.02 0.04"/></geometry></collision></link>"""
SOUND = (
    link("palm", '<box size="0.08 0.08 0.02"/>', 0.2)
    + FINGER.format(name="a", inertia=INERTIA)
    + FINGER.format(name="b", inertia=INERTIA)
    + joint("i", "palm", "a", limit='lower="-0.6" upper="0.8" effort="2"', axis="0 1 0")
    + joint("k", "a", "b", extra='<mimic joint="i" multiplier="-1.5"/>', axis="0 1 0",
            limit='lower="-1.2" upper="0.9" effort="2"', origin='xyz="0 0 0.04"')
)  # fmt: skip
FAR = 'origin xyz="0 0 0.02"/>'
UNITS = {
    # what is replaced, by what, the code, what is said, what to do
    "mass in grams": ('value="0.03"', 'value="30"', "unlikely-density",
                      "link 'a' has 30 kg in a box of 20 x 20 x 40 mm, which is",
                      "in a file in grams this is 0.03 kg"),
    "centre of mass in mm": (FAR, 'origin xyz="0 0 20"/>', "unlikely-size",
                             "the centre of mass of link 'a' is 20 m from its origin",
                             "in a file in millimetres this is 0.02 m"),
    "centre of mass a little in mm": (FAR, 'origin xyz="0 0 2"/>', "unlikely-size",
                                      "the centre of mass of link 'a' is 2 m", "this is 0.002 m"),
    "shape in mm": ('xyz="0 0 0.02" rpy', 'xyz="0 0 20" rpy', "unlikely-size",
                    "a shape of link 'a' is 20 m from its origin", "this is 0.02 m"),
    "limits in degrees": ('lower="-0.6" upper="0.8"', 'lower="-34" upper="46"', "angle-in-degrees",
                          "the limits [-34, 46] rad of joint 'i' are more than 2 turns",
                          "[-34, 46] degrees are [-0.5934, 0.8029] rad"),
    "joint turned in degrees": ('"0 0 0.04"', '"0 0 0.04" rpy="0 0 180"', "angle-in-degrees",
                                "the angles [0, 0, 180] rad of joint 'k' are more than a turn",
                                "[0, 0, 180] degrees are [0, 0, 3.1416] rad"),
    "shape turned in degrees": ("0 0 3.1416", "0 0 180", "angle-in-degrees",
                                "the angles [0, 0, 180] rad of link 'a'", "3.1416] rad"),
    "inertia in g mm^2": ('ixx="6e-6"', 'ixx="6000"', "unlikely-inertia",
                          "link 'a' of 0.03 kg has the moments of inertia 2e-06, 6e-06, 6e+03",
                          "1 g mm^2 is 1e-9 kg m^2"),
    "negative inertia": ('izz="2e-6"', 'izz="-2e-6"', "unlikely-inertia",
                         "none may be negative", "about the centre of mass"),
    "inertia of no body": ('izz="2e-6"', 'izz="2e-5"', "unlikely-inertia",
                           "the largest exceeds the sum of the others", "about the centre of mass"),
    "no inertia": (INERTIA, "", "unlikely-inertia",
                   "link 'a' has a mass but no <inertia>, which other links have", "add it"),
    "degrees for radians": ('"-1.5"', '"57.3"', "angle-in-degrees",
                            "joint 'k' follows joint 'i' times 57.3, which is 180/pi",
                            "radians per radian"),
    "radians for degrees": ('"-1.5"', '"-0.01745"', "angle-in-degrees",
                            "times -0.01745, which is pi/180", "radians per radian"),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "code", "said", "advice"), UNITS.values(), ids=UNITS)
def test_another_unit_in_a_robot(tmp_path, old, new, code, said, advice):
    """`inspect` tells it, and so does whatever loads the robot."""
    assert found(audit(tmp_path, SOUND)) == []
    file = write_urdf(tmp_path, SOUND.replace(old, new, 1))
    one = {item.code: item for item in audit_urdf(file).findings}[FindingCode(code)]
    assert said in one.message and advice in one.advice
    with capture() as told:
        Hand.from_urdf(file)
    assert one in told


def test_units_of_a_whole_file(tmp_path):
    """Of each kind one figure is told, with the number of others."""
    one = audit(tmp_path, SOUND.replace('value="0.03"', 'value="30"')).findings[0]
    assert one.message.endswith("more than any metal, and 1 more such links")
    one = audit(tmp_path, SOUND.replace(INERTIA, "")).findings[0]
    assert one.message.endswith("but no <inertia>, which other links have, and 1 more such links")


def test_a_mesh_that_its_hull_fills_out_by_far(tmp_path):
    walls = trimesh.creation.box((0.1, 0.1, 0.1))
    inside = trimesh.creation.box((0.08, 0.08, 0.1))
    inside.apply_translation((0.0, 0.0, 0.01))
    cup = trimesh.boolean.difference([walls, inside])  # 1000 - 576 = 424 cm^3 in a hull of 1000
    cup.export(tmp_path / "cup.stl")
    flat = trimesh.creation.box(bounds=[[0, 0, 0], [0.1, 0.02, 0.02]])
    tall = trimesh.creation.box(bounds=[[0, 0, 0], [0.02, 0.02, 0.05]])
    trimesh.boolean.union([flat, tall]).export(tmp_path / "ell.stl")  # fills 72 % of its hull
    cup.update_faces(np.arange(len(cup.faces)) > 0)
    cup.export(tmp_path / "open.stl")
    body = "".join(link(name, MESH.format(f"file://{tmp_path}/{name}.stl")) for name in FILES)
    body += joint("i", "cup", "ell", "fixed", limit="") + joint("j", "ell", "open", "fixed", "")
    report = audit(tmp_path, body)
    assert found(report) == [(FindingCode.HOLLOW_MESH, "link cup, collision")]
    assert "has 2.4 times its volume" in report.findings[0].message
    assert "'convex: {cup: decompose}'" in report.findings[0].advice
    for convex in ("decompose", "{cup: decompose}"):
        file = tmp_path / "robot.yaml"
        file.write_text(f"name: r\nurdf: robot.urdf\nconvex: {convex}\nconcavity: 1\n")
        opened = [FindingCode.OPEN_MESH] if convex == "decompose" else []
        assert [one.code for one in audit_urdf(file).findings] == opened
    file.write_text("name: r\nurdf: robot.urdf\nconvex: {ell: decompose}\n")
    assert found(audit_urdf(file)) == [(FindingCode.HOLLOW_MESH, "link cup, collision")]


def test_a_misspelt_leader_is_told_from_a_near_name(tmp_path):
    body = TWO + link("c", BALL) + joint("index_1", "a", "b")
    report = audit(tmp_path, body + joint("index_2", "b", "c", extra='<mimic joint="indx_1"/>'))
    assert found(report) == [(FindingCode.DANGLING_MIMIC, "joint index_2")]
    assert "perhaps index_1" in report.findings[0].advice


def test_links_that_nothing_can_touch(tmp_path):
    drawn = f'<link name="a"><visual><geometry>{BALL}</geometry></visual></link>'
    assert found(audit(tmp_path, drawn)) == [(FindingCode.NO_SHAPES, "robot")]
    body = drawn + link("b", BALL) + link("c") + joint("i", "a", "b") + joint("j", "b", "c")
    assert found(audit(tmp_path, body)) == [(FindingCode.NO_COLLISION, "links a")]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (TWO, "one root link"),
        (TWO + joint("j", "a", "b", limit=""), "has no <limit"),
        (link("a", "<torus/>"), "unknown shape <torus>"),
    ],
)
def test_what_cannot_be_read_is_a_finding(tmp_path, body, message):
    report = audit(tmp_path, body)
    assert [item.code for item in report.findings] == [FindingCode.UNREADABLE]
    assert message in report.findings[0].message
    assert not report.loads


def test_the_ending_of_a_file_may_be_in_capitals(tmp_path):
    written = write_urdf(tmp_path, link("a", BALL))
    report = audit_urdf(written.rename(tmp_path / "HAND.URDF"))
    assert report.loads


def test_what_is_no_urdf_is_a_finding_and_no_file_an_error(tmp_path):
    file = tmp_path / "robot.urdf"
    file.write_text("<sdf/>")
    assert [item.code for item in audit_urdf(file).findings] == [FindingCode.UNREADABLE]
    with pytest.raises(RobotError, match="there is no such file"):
        audit_urdf(tmp_path / "gone.urdf")
    with pytest.raises(RobotError, match="unknown robot 'nope'"):
        audit_urdf("nope")


def test_a_robot_file_mends_what_the_audit_of_its_model_finds():
    alone = audit_urdf("psyonic_right")
    codes = [item.code for item in alone.findings]
    assert codes == [FindingCode.UNKNOWN_EFFORT] * 6 + [FindingCode.HOLLOW_MESH]
    assert alone.fingers["thumb"] == ("Right_thumb_q1", "Right_thumb_q2")
    panda = audit_urdf("panda")
    assert found(panda) == [(FindingCode.NEUTRAL_OUTSIDE, "joint panda_joint4")]


def effort(item):
    assert item.effort is not None
    return item.effort


def test_the_list_of_robots_says_where_limits_come_from():
    records = {record.name: record for record in list_robots()}
    assert tuple(records) == robot_names()
    assert all(record.problem is None for record in records.values())
    hand = records["psyonic_left"]
    joints = {item.name: item for item in hand.joints}
    follower = joints["Left_index_q2"]
    assert follower.follows == {"Left_index_q1": 1.05851325}
    assert (follower.offset, follower.effort) == (0.72349796, None)
    thumb = effort(joints["Left_thumb_q1"])
    assert (thumb.known, thumb.lower, thumb.upper) == (False, -1.2, 1.2)
    assert "AbilityBaseLink on" in hand.origin
    panda = {item.name: item for item in records["panda"].joints}
    grip = panda["panda_finger_joint1"]
    assert (grip.kind, effort(grip).upper, effort(grip).known) == ("prismatic", 140.0, True)
    assert effort(grip).source.startswith("70 N continuous grasping force")
    assert panda["panda_joint1"].is_held
    assert not grip.is_held
    bravo = {item.name: item for item in records["bravo7_gripper"].joints}
    assert (bravo["joint1"].kind, bravo["joint1"].upper) == ("continuous", np.inf)
    assert "placeholder" in effort(bravo["joint1"]).source
    trihand = records["trihand"]
    assert trihand.palms == ("palm",)
    assert trihand.fingers["finger_2"].tip == "finger_2_tip"


def test_the_list_covers_tendons_models_and_failures(tmp_path):
    write_urdf(tmp_path, TWO + joint("hinge", "a", "b"))
    file = tmp_path / "robot.yaml"
    tendons = "tendons: {t: {moment_arms: {hinge: 0.01}}}\n"
    file.write_text(
        f"name: r\nurdf: robot.urdf\n{tendons}effort_limits: {{t: {{limit: 9, source: me}}}}"
    )
    broken = tmp_path / "broken.yaml"
    broken.write_text("name: b\nurdf: gone.urdf\n")
    model, tendon, missing, unknown = list_robots(
        ["allegro_left_hand", str(file), str(broken), "nope"]
    )
    assert list(model.fingers) == [f"finger_{number}" for number in (1, 2, 3, 4)]
    assert effort(model.joints[0]).source == "the URDF or MJCF"
    assert (tendon.tendons["t"].upper, tendon.tendons["t"].source) == (9.0, "me")
    assert tendon.joints[0].effort is None
    shown = robot_text(tendon)
    assert re.search(r"hinge +revolute .* - +pulled by tendons", shown)
    assert re.search(r"t +tendon +- +0 \.\. 9 +driven", shown)
    assert shown.endswith("  me")
    file.write_text(
        "name: r\nurdf: robot.urdf\ncouplings: {far: {follows: hinge, multiplier: 0}}\n"
    )
    write_urdf(tmp_path, TWO + link("c") + joint("hinge", "a", "b") + joint("far", "b", "c"))
    (still,) = list_robots([str(file)])
    assert re.search(r"far +revolute .* - +locked", robot_text(still))
    assert "no such file" in str(missing.problem)
    assert "unknown robot 'nope'" in str(unknown.problem)
