"""URDFs as people have them: small faults that must block nothing else, and be named."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hand_tools import joint, link, write_urdf

from graspless_pin.errors import GrasplessPinWarning, MeshError, RobotError
from graspless_pin.findings import FindingCode, Severity, capture
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.inspection import audit_urdf, list_robots
from graspless_pin.geometry.robots.description import RobotDescription

BALL = '<sphere radius="0.01"/>'
TWO = link("a", BALL) + link("b", BALL)
MESH = '<mesh filename="{}"/>'
HINGE = joint("hinge", "a", "b")


def codes(report):
    return [item.code for item in report.findings]


@pytest.mark.parametrize(
    "foreign",
    [
        '<drake:joint name="x"><drake:damping value="1"/></drake:joint>',
        '<gazebo reference="a" ignition:version="1"/>',
        '<transmission name="t"><joint name="hinge"/><drake:rotor_inertia value="2e-4"/>'
        '<drake:gear_ratio value="10"/></transmission>',
    ],
)
def test_prefixes_need_no_declaration(tmp_path, foreign):
    file = write_urdf(tmp_path, TWO + HINGE + foreign)
    assert audit_urdf(file).loads
    armature = Hand.from_urdf(file).tree.armature
    np.testing.assert_allclose(armature, [2e-2 if "rotor" in foreign else 0.0])


@pytest.mark.parametrize("length", [201, 300_000])
@pytest.mark.parametrize("kind", ["link", "joint"])
def test_a_name_is_not_too_long(tmp_path, kind, length):
    """What prints it would print all of it."""
    old = {"link": '"a"', "joint": '"hinge"'}[kind]
    file = write_urdf(tmp_path, (TWO + HINGE).replace(old, f'"{"n" * length}"'))
    with pytest.raises(
        RobotError, match=rf"<{kind}> has the name 'n+'\.\.\. of {length}"
    ) as caught:
        Hand.from_urdf(file)
    assert len(str(caught.value)) < 400
    (found,) = audit_urdf(file).findings
    assert found.code is FindingCode.UNREADABLE
    assert len(str(found)) < 600


def test_a_prefix_counts(tmp_path):
    file = write_urdf(tmp_path, TWO + HINGE.replace("hinge", "n" * 190))
    robot = RobotDescription("hand", file)
    assert Hand.assemble([Mount(robot, prefix="left_")]).joint_names == ("left_" + "n" * 190,)
    with pytest.raises(RobotError, match="including its hand's prefix"):
        Hand.assemble([Mount(robot, prefix="the_left_hand_")])


@pytest.mark.parametrize("inside", ["meshes/part.stl", "hand_description/meshes/part.stl"])
def test_packages_beside_the_urdf_and_beside_its_package_are_found(tmp_path, inside):
    mesh = tmp_path / "work" / inside
    mesh.parent.mkdir(parents=True)
    trimesh.creation.box((0.1, 0.1, 0.1)).export(mesh)
    folder = tmp_path / "work"
    if "hand" in inside:
        folder = folder / "hand_bringup" / "urdf"
        folder.mkdir(parents=True)
    file = write_urdf(folder, link("a", MESH.format(f"package://{inside}")))
    (body,) = Hand.from_urdf(file).collision_bodies()
    assert body.name == "a"
    report = audit_urdf(file)
    assert report.loads
    assert report.findings == ()


def test_a_missing_mesh_names_few_places(tmp_path):
    file = write_urdf(tmp_path, link("a", MESH.format("package://gone/part.stl")))
    with pytest.raises(MeshError, match=r"gone/part.stl, .*, .* and \d+ more\); give pack"):
        Hand.from_urdf(file)


@pytest.mark.parametrize("key", ["effort", "velocity"])
def test_a_limit_below_zero_is_refused_where_the_joint_moves(tmp_path, key):
    limits = {"effort": 1, "velocity": 1} | {key: -1}
    text = '<limit lower="-1" upper="1" effort="{effort}" velocity="{velocity}"/>'
    body = TWO + joint("hinge", "a", "b", limit="", extra=text.format(**limits))
    file = write_urdf(tmp_path, body)
    with pytest.raises(RobotError, match=f"joint 'hinge' has the limit {key}='-1', .* negative"):
        Hand.from_urdf(file)
    (found,) = audit_urdf(file).findings
    assert found.code is FindingCode.UNREADABLE
    file = write_urdf(tmp_path, body.replace("revolute", "fixed"))
    assert Hand.from_urdf(file).joint_names == ()


FOOT = joint("ankle", "a", "foot", "fixed", limit="")


def test_a_shape_of_size_zero_is_left_out_and_told(tmp_path):
    feet = link("foot", '<sphere radius="0"/>').replace(
        "</link>", f"<collision><geometry>{BALL}</geometry></collision></link>"
    )
    mesh = tmp_path / "box.stl"
    trimesh.creation.box((0.1, 0.1, 0.1)).export(mesh)
    feet = feet.replace(
        "</link>", f"<collision><geometry>{MESH.format('box.stl')}</geometry></collision></link>"
    )
    file = write_urdf(tmp_path, TWO + HINGE + feet + FOOT)
    with capture() as told:
        hand = Hand.from_urdf(file)
    assert [one.code for one in told] == [FindingCode.EMPTY_SHAPE]
    assert "link 'foot' has a sphere of radius 0, which is left out" in told[0].message
    shapes = [type(body.geometry).__name__ for body in hand.collision_bodies()]
    assert sorted(shapes) == ["Convex", "Sphere", "Sphere", "Sphere"]
    report = audit_urdf(file)
    assert report.loads
    assert codes(report) == [FindingCode.EMPTY_SHAPE, FindingCode.RELATIVE_MESH]


FAULTS = {
    "shape": (link("foot", '<sphere radius="-1"/>'), FOOT),
    "mesh": (link("foot", MESH.format("gone.stl")), FOOT),
    "joint": (link("foot", BALL), joint("ankle", "a", "foot", limit='lower="1" upper="-1"')),
    "type": (link("foot", BALL), joint("ankle", "a", "foot", "screw")),
}


def robot_with_a_fault(tmp_path, fault):
    body = link("a", BALL) + "".join(link(name, BALL) for name in ("palm", "b", "c"))
    body += joint("wrist", "a", "palm") + joint("left", "palm", "b") + joint("right", "palm", "c")
    return write_urdf(tmp_path, body + "".join(FAULTS[fault]))


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_outside_the_root_link_block_nothing(tmp_path, fault):
    file = robot_with_a_fault(tmp_path, fault)
    with pytest.raises((RobotError, MeshError)):
        Hand.from_urdf(file)
    hand = Hand.from_urdf(file, root_link="palm")
    assert hand.joint_names == ("left", "right")
    assert Hand.assemble([Mount(file, root_link="palm")]).link_names == hand.link_names
    assert audit_urdf(file, root_link="palm").loads


@pytest.mark.parametrize("fault", ["shape", "mesh"])
def test_an_audit_names_the_link_that_can_be_loaded(tmp_path, fault):
    report = audit_urdf(robot_with_a_fault(tmp_path, fault))
    assert not report.loads
    (serious, *_) = report.findings
    assert serious.severity is Severity.SERIOUS
    assert serious.advice.endswith("or take only the hand, which can be loaded: root_link: palm")


def test_an_audit_names_no_link_where_the_hand_itself_is_at_fault(tmp_path):
    body = link("a", BALL) + link("palm", BALL) + link("b", BALL) + link("c", MESH.format("gone"))
    body += joint("wrist", "a", "palm") + joint("left", "palm", "b") + joint("right", "palm", "c")
    report = audit_urdf(write_urdf(tmp_path, body))
    assert "root_link" not in report.findings[0].advice


def test_reversed_limits_are_called_reversed(tmp_path):
    reversed_ = joint("hinge", "a", "b", limit='lower="1" upper="-1" effort="2"')
    report = audit_urdf(write_urdf(tmp_path, TWO + reversed_))
    assert codes(report) == [FindingCode.UNREADABLE]
    said = report.findings[0].message
    assert "joint 'hinge' has the lower limit 1 above the upper limit -1" in said


def test_a_limit_like_the_largest_number_is_none(tmp_path):
    most = 'lower="-1.797e308" upper="1.797e308" effort="3.4028235e38"'
    file = write_urdf(tmp_path, TWO + joint("hinge", "a", "b", limit=most))
    hand = Hand.from_urdf(file, effort_limits={"hinge": 1.0})
    assert hand.tree.lower == -np.inf and hand.tree.upper == np.inf
    assert codes(audit_urdf(file)) == [FindingCode.PLACEHOLDER_EFFORT]


@pytest.mark.parametrize("fault", ["shape", "joint"])
def test_an_audit_goes_on_after_a_fault(tmp_path, fault):
    weak = joint("right", "palm", "c", limit='lower="-1" upper="1" effort="0"')
    body = robot_with_a_fault(tmp_path, fault).read_text()
    body = body.replace(joint("right", "palm", "c"), weak)
    file = tmp_path / "robot.urdf"
    file.write_text(body.replace(BALL, MESH.format("gone.stl"), 1) if fault == "joint" else body)
    found = codes(audit_urdf(file))
    assert FindingCode.UNREADABLE in found
    assert (FindingCode.PLACEHOLDER_EFFORT in found) == (fault == "shape")


LOCKED = 'lower="{0}" upper="{0}" effort="0"'


@pytest.mark.parametrize("place", [0.0, 0.5])
def test_a_joint_without_travel_needs_no_motor(tmp_path, place):
    body = TWO + link("c", BALL) + joint("still", "a", "b", limit=LOCKED.format(place))
    file = write_urdf(tmp_path, body + joint("hinge", "b", "c"))
    for control in (None, "force", {"still": "force"}):
        hand = Hand.from_urdf(file, control=control)
        assert hand.actuated_joint_names == ("hinge",)
        assert hand.q["still"] == place
    report = audit_urdf(file)
    assert codes(report) == [FindingCode.LOCKED_JOINT]
    assert f"both its limits are {place:g}" in report.findings[0].message
    (record,) = list_robots([str(file)])
    still, hinge = record.joints
    assert (still.is_locked, still.effort) == (True, None)
    assert (hinge.is_locked, hinge.effort is None) == (False, False)


def test_a_follower_without_travel_locks_its_leader_and_a_tendon_pulls_only_what_moves(tmp_path):
    body = TWO + link("c", BALL) + link("d", BALL) + joint("lead", "a", "b")
    body += joint("follow", "b", "c", limit=LOCKED.format(0.2), extra='<mimic joint="lead"/>')
    file = write_urdf(tmp_path, body + joint("hinge", "c", "d"))
    hand = Hand.from_urdf(file, q={"lead": 0.2})
    assert hand.tree.locked == {"lead"}
    robot = RobotDescription("r", file, tendons={"t": {"lead": 0.01, "hinge": 0.02}})
    with pytest.warns(GrasplessPinWarning, match="placeholder"):
        pulled = Hand.assemble([Mount(robot)], q={"lead": 0.2})
    assert pulled.actuated_joint_names == ("t",)
    np.testing.assert_allclose(pulled.actuation.from_joints.T, [[0.0, 0.0, 50.0]])


def test_relative_paths_are_one_finding(tmp_path):
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "box.stl")
    names = [f"l{number}" for number in range(12)]
    body = "".join(link(name, MESH.format("box.stl")) for name in names)
    for parent, child in pairwise(names):
        body += joint(child, parent, child, "fixed", limit="")
    report = audit_urdf(write_urdf(tmp_path, body))
    assert codes(report) == [FindingCode.RELATIVE_MESH]
    assert "12, such as 'box.stl'" in report.findings[0].message


@pytest.mark.parametrize(
    ("mimic", "reachable"),
    [
        ('multiplier="2"', (-0.5, 0.5)),
        ('multiplier="-2" offset="-0.5"', (-0.75, 0.25)),
        ('multiplier="1"', (-1.0, 1.0)),
        ('multiplier="0.9995"', (-1.0, 1.0)),
    ],
)
def test_the_listed_range_of_a_leader_can_be_reached(tmp_path, mimic, reachable):
    limits = 'lower="-1" upper="1.0005" effort="2"'
    body = TWO + link("c", BALL) + joint("lead", "a", "b", limit=limits)
    body += joint("follow", "b", "c", extra=f'<mimic joint="lead" {mimic}/>')
    (record,) = list_robots([str(write_urdf(tmp_path, body))])
    lead = record.joints[0]
    np.testing.assert_allclose((lead.lower, lead.upper), reachable, atol=6e-4)
    for end in (lead.lower, lead.upper):
        Hand.from_urdf(str(record.urdf_path), q={"lead": end})


def test_a_robot_file_names_its_package_folders(tmp_path):
    mesh = tmp_path / "packages" / "hand_meshes" / "part.stl"
    mesh.parent.mkdir(parents=True)
    trimesh.creation.box((0.1, 0.1, 0.1)).export(mesh)
    write_urdf(tmp_path, link("a", MESH.format("package://hand_meshes/part.stl")))
    file = tmp_path / "robot.yaml"
    file.write_text("name: r\nurdf: robot.urdf\npackage_dirs: [packages]\n")
    assert len(Hand.assemble([Mount(file)]).collision_bodies()) == 1
