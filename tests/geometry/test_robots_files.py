"""Robot files, model names and URDF files: what loads and what the messages say."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
import trimesh
from hand_tools import joint, link, write_urdf

from graspless_pin.errors import MeshError, RobotError
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.robots.files import find_robot, load_robot

MESH = '<mesh filename="{}" scale="1 2 3"/>'


def test_allegro_fingers_cover_all_joints_and_links_but_the_palm():
    hand = Hand.assemble([Mount("allegro_right")])
    joints = [name for spec in hand.fingers.values() for name in spec.joints]
    assert sorted(joints) == sorted(hand.joint_names)
    assert [name for name in hand.link_names if hand.finger_of(name) is None] == ["palm_link"]
    for finger, spec in hand.fingers.items():
        assert spec.tip is not None
        points = np.array([hand.pose_of(spec.tip)[:3, 3]]) + 0.02  # off the spread axis
        moved = np.abs(hand.contact_jacobian([spec.tip], points)).max(axis=0) > 1e-9
        felt = {n for n, m in zip(hand.actuated_joint_names, moved, strict=True) if m}
        assert felt == set(spec.joints), finger


def test_sources_are_told_apart(tmp_path):
    file = write_urdf(tmp_path, link("palm"), name="mine.urdf")
    assert find_robot(file).name == "mine"
    assert find_robot("allegro_right").fingers
    assert find_robot("allegro_right").model == "allegro_right_hand"
    assert not find_robot("allegro_right_hand").fingers


VALID = "name: r\nmodel: allegro_right_hand\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("- 1", "robot.yaml:1: robot file: found .1.; needs a mapping with the keys name, urdf"),
        ("", "robot.yaml: the file is empty; a robot file needs name, and urdf or model"),
        ("name: [", "robot.yaml:1: is not plain YAML"),
        ("name: !!python/object/apply:os.getcwd []", "robot.yaml:1: is not plain YAML"),
        ("name: 2020-13-45", "robot.yaml: is not plain YAML: .*month"),
        (b"name: \xff", "robot.yaml: is not UTF-8 text"),
        ("name: " + 2000 * "[", "robot.yaml:1: is nested too deeply"),
        (VALID + "1: 2", "robot.yaml:3: 1: found 1 as a name; a name is text"),
        (VALID + "convex: soup", "robot.yaml:3: convex.* 'hull' or 'decompose'"),
        (VALID + "concavity: 0", "robot.yaml:3: concavity: .*0.01"),
        (VALID + "concavity: true", "robot.yaml:3: concavity: found True; needs a finite number"),
        (
            VALID + "effort_limits: {f: {limit: true, source: x}}",
            "robot.yaml:3: effort_limits.f.limit: found True; needs a finite number",
        ),
        (
            VALID + "tendons: {t: {moment_arms: {j: true}}}",
            "robot.yaml:3: tendons.t.moment_arms.j: found True; needs a finite number",
        ),
        ("name: r", "robot.yaml:1: robot file: .*either 'urdf'.*or 'model'"),
        (VALID + "urdf: x.urdf", "either 'urdf'.*or 'model'"),
        (VALID + "colour: red", "robot.yaml:3: colour: unknown key; known: .*, model, name, "),
        ("object: {}\nfriction: 1", "robot.yaml: is a scene, not a robot file; solve it"),
        (
            VALID + "fingers: {f: {joints: []}}",
            "robot.yaml:3: fingers.f.joints: found ..; needs a list of at least 1 ",
        ),
        (VALID + "effort_limits: {f: {limit: 1}}", "effort_limits.f: .*'limit' and 'source'"),
        (VALID + "effort_limits: {f: {unknown: x, source: y}}", "or only 'unknown'"),
        (
            VALID + "couplings: {j: {follows: {a: 1}, multiplier: 2}}",
            "couplings.j: .*single leader",
        ),
        (VALID + "couplings: {j: {follows: {}}}", "couplings.j.follows: found {}; needs text"),
        (
            VALID + "tendons: {t: {moment_arms: {}}}",
            "tendons.t.moment_arms: .* of at least 1 and at most",
        ),
        ("name: r\nmodel: alegro_right_hand", "robot.yaml: model: unknown .*allegro_right_hand"),
    ],
)
def test_bad_robot_files(tmp_path, text, message):
    file = tmp_path / "robot.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RobotError, match=message):
        load_robot(file)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fingers: {f: {joints: [nope]}}", r"robot 'r': fingers\['f'\]: unknown joint 'nope'"),
        (
            "palm: nope",
            r"robot\.yaml: robot 'r': palm: unknown link 'nope'; known: palm_link, link",
        ),
        ("palm: [palm_link, nope]", "robot 'r': palm: unknown link 'nope'"),
        ("root_link: nope", "there is no link 'nope' to start from"),
        ("couplings: {nope: {follows: joint_0.0}}", "robot 'r': couplings: unknown joint 'nope'"),
        ("couplings: {joint_0.0: {follows: nope}}", "robot 'r': couplings: unknown joint 'nope'"),
        ("tendons: {t: {moment_arms: {nope: 1}}}", "robot 'r': tendons: unknown joint 'nope'"),
        ("effort_limits: {nope: {unknown: x}}", "robot 'r': .*joint 'nope'"),
        ("effort_limits: {nope: {limit: 1, source: s}}", "robot 'r': .*joint 'nope'"),
        ("effort_limits: {joint_0.0: {limit: -1, source: s}}", "robot 'r': .*must not be negative"),
    ],
)
def test_robot_files_that_do_not_fit_their_urdf(tmp_path, text, message):
    file = tmp_path / "robot.yaml"
    file.write_text(VALID + text)
    with pytest.raises(RobotError, match=message):
        Hand.assemble([Mount(file)])


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (lambda: Hand.from_model_name("alegro_hand"), "'alegro_hand'.*near: .*allegro_right_hand"),
        (lambda: Hand.from_model_name("cassie"), "'cassie'.*not a URDF"),
        (lambda: Hand.from_model_name("qqqq"), "known: a1, alex"),
        (lambda: load_robot("lever_150"), "unknown robot 'lever_150'; near: lever_150mm"),
        (lambda: load_robot("gone.yaml"), "gone.yaml: there is no such file"),
        (
            lambda: Hand.assemble([Mount("allegro")]),
            "unknown robot 'allegro'.*near: .*allegro_right",
        ),
        (lambda: Hand.from_urdf("gone.urdf"), "gone.urdf: there is no such file"),
        (lambda: Hand.assemble([Mount(__file__)]), r"\.py: is a Python program, not a robot file"),
    ],
)
def test_unknown_robots_name_near_ones(load, message):
    with pytest.raises(RobotError, match=message):
        load()


TWO = link("a") + link("b")
LOOP = joint("i", "a", "b") + joint("j", "b", "a")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("", "the robot has no <link>"),
        ("<link/>", "a <link> has no name"),
        (link("a") * 2, "two links are called 'a'"),
        (TWO, "one root link, found a, b"),
        (TWO + LOOP, "one root link, found none"),
        (TWO + joint("i", "a", "a"), "root link 'b', but form a loop of joints: a; correct"),
        (TWO + link("c") + LOOP, "root link 'c', but form a loop of joints: a, b; correct"),
        (TWO + joint("i", "a", "b") * 2, "two joints are called 'i'"),
        (TWO + joint("i", "a", "b") + joint("j", "a", "b"), "'b' is the child of two joints"),
        (TWO + joint("j", "a", "c"), "joint 'j' has the child link 'c', which does not exist"),
        (TWO + '<joint name="j" type="fixed"><child link="b"/></joint>', "parent link None"),
        (
            TWO + link("c") + joint("i", "a", "b") + joint("j", "b", "c", "floating"),
            "joint 'j' is floating but does not carry the whole robot; use revolute",
        ),
        (
            TWO + link("c") + joint("i", "a", "b") + joint("j", "a", "c", "planar"),
            "joint 'j' is planar but does not carry the whole robot",
        ),
        (
            TWO + joint("j", "a", "b", "Revolute"),
            r"type 'Revolute'; did you mean 'revolute'\? known: ",
        ),
        (TWO + joint("j", "a", "b", limit=""), "joint 'j' is revolute but has no <limit"),
        (TWO + joint("j", "a", "b", limit='lower="low"'), "limit lower='low', .*not a number"),
        (TWO + joint("j", "a", "b", limit='effort="nan"'), "limit effort='nan'"),
        (
            TWO + joint("j", "a", "b").replace('xyz="0 0.6 0.8"', 'xyz="0 0 0"'),
            "joint 'j' has the axis '0 0 0'",
        ),
        (
            TWO + joint("j", "a", "b", extra='<mimic joint="j"/>'),
            "circle: j -> j; remove one of them",
        ),
        (link("a", '<box size="1 x 1"/>'), "link 'a' has box size='1 x 1', which is not 3 numbers"),
        (link("a", "<sphere/>"), "sphere radius='', which is not a number"),
        (link("a", '<sphere radius="-1"/>'), "sphere radius='-1', which is negative"),
        (link("a", "<torus/>"), "unknown shape <torus>; known: box, sphere"),
        ('<link name="a"><collision/></link>', "without a shape in its <geometry>"),
        (
            '<link name="a"><collision><geometry/></collision></link>',
            "without a shape in its <geometry>",
        ),
        (link("a", mass=-0.5), "negative mass -0.5 kg"),
        (link("a", mass="much"), "mass='much', which is not a number"),
        (
            TWO + joint("j", "a", "b").replace('xyz="0.1 0.02 0"', 'xyz="0.1 0.02"'),
            "joint 'j' has joint origin xyz='0.1 0.02', which is not 3 numbers",
        ),
    ],
)
def test_bad_urdfs(tmp_path, body, message):
    file = write_urdf(tmp_path, body)
    with pytest.raises(RobotError, match=message):
        Hand.from_urdf(file)


@pytest.fixture
def meshes(tmp_path):
    folder = tmp_path / "hand_description" / "meshes"
    folder.mkdir(parents=True)
    trimesh.creation.box((0.1, 0.1, 0.1)).export(folder / "box.stl")
    (folder / "broken.stl").write_text("not a mesh")
    return folder


@pytest.mark.parametrize(
    ("written", "package_dirs"),
    [
        ("../meshes/box.stl", []),
        ("file://{folder}/box.stl", []),
        ("{folder}/box.stl", []),
        ("package://hand_description/meshes/box.stl", []),
        ("package://hand_description/meshes/box.stl", ["{root}"]),
        ("package://hand_description/meshes/box.stl", ["{root}/hand_description"]),
    ],
)
def test_meshes_are_found_and_become_hulls(tmp_path, meshes, written, package_dirs):
    home = tmp_path / ("elsewhere" if package_dirs else "hand_description") / "urdf"
    home.mkdir(parents=True)
    file = write_urdf(home, link("a", MESH.format(written.format(folder=meshes))))
    dirs = [folder.format(root=tmp_path) for folder in package_dirs]
    (body,) = Hand.from_urdf(file, package_dirs=dirs).collision_bodies()
    assert type(body.geometry) is coal.Convex
    body.geometry.computeLocalAABB()
    box = body.geometry.aabb_local
    np.testing.assert_allclose(box.max_ - box.min_, [0.1, 0.2, 0.3], atol=1e-6)


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("gone.stl", r"link 'a' needs the collision mesh 'gone.stl', which is missing \(looked"),
        ("package://other/gone.stl", "'package://other/gone.stl', .*; give package_dirs"),
        ("", "collision mesh '', which is missing"),
        (
            "hand_description/meshes/broken.stl",
            "broken.stl of link 'a': mesh .* has no faces",
        ),
        ("hand_description/meshes/flat.stl", "flat.stl of link 'a' has no volume"),
    ],
)
def test_unusable_meshes_are_named(tmp_path, meshes, written, message):
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]])
    flat.export(meshes / "flat.stl")
    file = write_urdf(tmp_path, link("a", MESH.format(written)))
    with pytest.raises(MeshError, match=message):
        Hand.from_urdf(file)


def test_a_robot_file_that_changes_is_read_again(tmp_path):
    file = tmp_path / "hand.yaml"
    text = "name: {}\nmodel: allegro_right_hand\n"
    for name in ("first", "second", "first"):
        file.write_text(text.format(name), encoding="utf-8")
        assert load_robot(file).name == name
