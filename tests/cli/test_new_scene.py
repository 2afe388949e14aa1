"""`graspless-pin new`, `close` and `settle`: scene files made of a robot, or of another scene."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trimesh
from cli_tools import ALLEGRO, LINES, ROOT, assert_refused, run, spoilt
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from graspless_pin import load_scene
from graspless_pin.geometry import unwanted_overlaps
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import Capsule, HalfSpace, MeshShape
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.posing.settling import lying_object
from graspless_pin.intake.yaml_text import parse_yaml

FINGER = """
<joint name="{side}_hinge" type="revolute"><parent link="palm"/><child link="{side}_finger"/>
<origin xyz="{x} 0 0.01"/><axis xyz="0 {y} 0"/>
<limit lower="-0.6" upper="0.8" effort="{effort}" velocity="1"/></joint>
<link name="{side}_finger">
<collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.01"/></geometry></collision></link>"""


def pincher(folder: Path, left: float = 0.0, right: float = 0.0) -> Path:
    """Write a hand of two hinges whose effort limits are as given."""
    file = folder / "pincher.urdf"
    file.write_text(
        '<robot name="pincher"><link name="palm"><collision><geometry><box size="0.14 0.04 0.02"/>'
        "</geometry></collision></link>"
        + FINGER.format(side="left", x=-0.05, y=1, effort=left)
        + FINGER.format(side="right", x=0.05, y=-1, effort=right)
        + "</robot>"
    )
    return file


@pytest.fixture(autouse=True)
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_limits_that_the_file_lacks_are_left_open_and_named() -> None:
    result = run("new", pincher(Path(), right=0.5), "box:0.06,0.04,0.06")
    assert result.exit_code == 0
    assert "fill in hand.effort_limits" in result.stdout and "left_hinge" in result.stdout
    assert "right_hinge" not in result.stdout and result.stderr == ""
    line = next(i for i, text in enumerate(Path("scene.yaml").read_text().splitlines(), 1)
                if "effort_limits:" in text)  # fmt: skip
    assert_refused(
        run("solve", "scene.yaml"),
        f"scene.yaml:{line}: hand.effort_limits: is left empty for left_hinge; fill in",
    )


@pytest.mark.parametrize(("ends", "most"), [("-3 10", 10), ("-10 0", 10), ("-10 10", 10)])
def test_a_tendon_s_limits_are_written_as_the_file_has_them(ends: str, most: int) -> None:
    pytest.importorskip("mujoco")
    joints = "".join(f'<body><joint name="{name}"/><geom size="0.01"/></body>' for name in "ab")
    arms = "".join(f'<joint joint="{name}" coef="0.01"/>' for name in "ab")
    Path("hand.xml").write_text(
        f'<mujoco><worldbody><body name="palm"><geom size="0.01"/>{joints}</body></worldbody>'
        f'<tendon><fixed name="wire">{arms}</fixed></tendon>'
        f'<actuator><motor name="pull" tendon="wire" ctrlrange="{ends}"/></actuator></mujoco>'
    )
    unknown = "effort_limits: {pull: {unknown: nobody has measured it}}\n"
    Path("hand.yaml").write_text(f"name: hand\nurdf: hand.xml\n{unknown}")
    assert run("new", "hand.yaml", "box:0.06,0.04,0.06", "-o", "unknown.yaml").exit_code == 0
    hand = load_scene("unknown.yaml").hand
    assert hand is not None
    assert [limits[0] for limits in hand.effort_limits] == list(map(float, ends.split()))
    told = run("new", "hand.xml", "box:0.06,0.04,0.06", "--effort", "5", "-o", "known.yaml")
    assert f"unchanged: pull ({most});" in told.stderr


def test_the_scene_loads_and_says_what_comes_next() -> None:
    made = run("new", pincher(Path()), "box:0.06,0.04,0.06", "--effort", "0.4",
               "--effort", "finger_1=0.7", "--support", "slope:30deg", "--mass", "0.3")  # fmt: skip
    assert made.exit_code == 0 and "next: graspless-pin place scene.yaml" in made.stdout
    solved = run("solve", "scene.yaml", "--no-verdict")
    assert solved.exit_code == 1  # nothing else keeps the box from sliding
    assert "no link of the hand touches object 'box'" in solved.stderr
    assert "graspless-pin place" in solved.stderr
    scene = load_scene("scene.yaml")
    assert scene.hand is not None and [one.code for one in scene.findings] == [
        "hand-touches-nothing"
    ]
    assert scene.hand.effort_limits[1].tolist() == [0.7, 0.4]
    assert scene.hand.fingers["finger_2"].joints == ("right_hinge",)
    assert scene.object.mass == 0.3
    touching = scene.contacts.arrays
    assert touching.bodies == ("slope",) * 4
    np.testing.assert_allclose(touching.distances, 0.0, atol=1e-6)
    downhill = [np.cos(np.pi / 6), 0.0, -0.5]
    np.testing.assert_allclose(scene.tangent_axes[0], downhill, atol=1e-7)
    np.testing.assert_allclose(touching.normals, [[0.5, 0.0, np.cos(np.pi / 6)]] * 4, atol=1e-7)


def test_an_effort_that_does_not_count_is_told() -> None:
    made = run("new", pincher(Path(), right=0.5), "box:0.06,0.04,0.06", "--effort", "0.4")
    assert "unchanged: right_hinge (0.5); --effort NAME=0.4 replaces one" in made.stderr
    scene = load_scene("scene.yaml")
    assert scene.hand is not None and scene.hand.effort_limits[1].tolist() == [0.4, 0.5]
    named = ("--effort", "right_hinge=0.3", "--effort", "0.4", "--overwrite")
    made = run("new", pincher(Path(), right=0.5), "box:0.06,0.04,0.06", *named)
    assert made.stderr == ""
    scene = load_scene("scene.yaml")
    assert scene.hand is not None and scene.hand.effort_limits[1].tolist() == [0.4, 0.3]


STILL = ('lower="-0.6" upper="0.8"', 'lower="0" upper="0"')
FIXED = ('type="revolute"', 'type="fixed"')
BARE = (
    '<collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.01"/></geometry></collision>',
    "",
)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (STILL, "the lower and the upper limit of left_hinge, right_hinge are the same"),
        (FIXED, "has no fingers; name their joints in the robot file or in the scene, or add"),
        (BARE, "has both a joint and a collision shape"),
    ],
)
def test_a_hand_that_place_refuses_is_told_by_new(change: tuple[str, str], reason: str) -> None:
    file = pincher(Path(), 0.5, 0.5)
    file.write_text(file.read_text().replace(*change))
    made = run("new", file, "cylinder:0.03,0.1")
    assert made.exit_code == 0, made.output
    assert reason in made.stdout and "next: graspless-pin place" not in made.stdout
    placed = run("place", "scene.yaml", "-o", "placed.yaml", "--candidates", "5")
    assert placed.exit_code == 2 and reason in placed.stderr


def test_the_file_is_commented_and_fits_the_schema_beside_it() -> None:
    run("new", "allegro_right", ROOT / "examples" / "meshes" / "mug.stl", "-o", "mug.yaml")
    text = Path("mug.yaml").read_text()
    schema = json.loads(Path("scene.schema.json").read_text())
    assert text.startswith("# yaml-language-server: $schema=scene.schema.json\n")
    jsonschema.Draft202012Validator(schema).validate(parse_yaml(text).data)
    # Each figure that was guessed says so, and robot files that know fingers and limits keep them.
    assert text.count("guessed") == 2
    assert not {"fingers", "effort_limits"} & parse_yaml(text).data["hand"].keys()
    assert load_scene("mug.yaml").object.name == "mug"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["lever_100mm", "ball"], "OBJECT: found 'ball'; needs a mesh file or one of box:X,Y,Z"),
        (["lever_100mm", "box:0.1,0.2"], "needs box:X,Y,Z, lengths in metres"),
        (["lever_100mm", "sphere:1cm"], "found '1cm'; needs a number"),
        (["lever_100mm", "sphere:-1"], "radius: needs a positive number"),
        (
            ["lever_100mm", "sphere:0.1", "--scale", "0.001"],
            "--scale and --decompose apply only to",
        ),
        (["lever_100mm", "none.stl"], "mesh file 'none.stl' does not exist"),
        (["lever_100mm", "sphere:0.1", "--support", "slope:30"], "slope:30deg or slope:0.5rad"),
        (["lever_100mm", "sphere:0.1", "--support", "slope:95deg"], "angle of 0 to 80 degrees"),
        (["lever_100mm", "sphere:0.1", "--effort", "0"], "needs a positive number, N m or N"),
        (["lever_100mm", "sphere:0.1", "--effort", "thumb=1"], "unknown finger or joint 'thumb'"),
        (["lever_100mm", "sphere:0.1", "--mass", "1", "--density", "1"], "found both"),
        (["lever_100mm", "sphere:0.1", "-o", "scene.txt"], "must end in .yaml or .yml"),
        (["levr_100mm", "sphere:0.1"], "unknown robot 'levr_100mm'"),
    ],
)
def test_what_does_not_do_is_refused_and_nothing_is_written(
    arguments: list[str], message: str
) -> None:
    assert_refused(run("new", *arguments), message)
    assert not list(Path().iterdir())


def test_a_size_that_no_hand_holds_is_no_success() -> None:
    result = run("new", "lever_100mm", "box:60,60,60", "--effort", "1")
    assert result.exit_code == 4 and Path("scene.yaml").exists()
    assert "unlikely-size" in result.stderr and result.stderr.count("warning:") == 1
    assert "correct the size of the object; " in result.stdout
    # Whether an arm reaches it is not known before the size is right.
    result = run("new", "panda", "box:60,60,60", "-o", "arm.yaml")
    assert result.exit_code == 4 and "--move-base" not in result.stdout


def test_no_scene_is_replaced_unless_asked() -> None:
    Path("scene.yaml").write_text("mine")
    Path("scene.schema.json").write_text("mine, too")
    assert_refused(run("new", "lever_100mm", "sphere:0.1"), "exists already")
    assert run("new", "lever_100mm", "sphere:0.1", "--overwrite").exit_code == 0
    assert load_scene("scene.yaml").object.name == "sphere"
    assert Path("scene.schema.json").read_text() == "mine, too"


def test_a_mesh_that_would_tip_lies_on_a_face() -> None:
    """The centre of mass stands over the polygon of the contacts, whatever the hull."""
    rng = np.random.default_rng(3)
    slope = Support("slope", HalfSpace(), pose_matrix([0.1, 0.2, 0.3], [0.2, 0.4, 0.0]))
    normal = slope.T_world_support[:3, 2]
    for index in range(8):
        hull = trimesh.convex.convex_hull(rng.normal(size=(12, 3)) * [0.1, 0.05, 0.03])
        hull.export(f"{index}.stl")
        target = ManipulatedObject.from_shape(
            "o", MeshShape(Path(f"{index}.stl")), np.eye(4), mass=1
        )
        T = lying_object(target, slope).T_world_object
        points = hull.vertices @ T[:3, :3].T + T[:3, 3]
        heights = (points - slope.T_world_support[:3, 3]) @ normal
        lowest = heights.min()
        assert abs(lowest) < 1e-6
        flat = (points @ slope.T_world_support[:3, :3])[heights < lowest + 1e-5, :2]
        center = (hull.center_mass @ T[:3, :3].T + T[:3, 3]) @ slope.T_world_support[:3, :3]
        assert (ConvexHull(flat).equations @ [*center[:2], 1.0] < 0.0).all()


def test_a_mesh_stands_as_in_its_file_if_it_can() -> None:
    turned = trimesh.creation.box((0.1, 0.06, 0.04))
    turned.apply_transform(pose_matrix(np.zeros(3), np.radians([20.0, 0.0, 0.0])))
    turned.export("turned.stl")
    run("new", "lever_100mm", "turned.stl")
    angles = parse_yaml(Path("scene.yaml").read_text()).data["object"]["pose"]["rpy_deg"]
    assert angles == pytest.approx([-20.0, 0.0, 0.0], abs=1e-4)
    assert len(load_scene("scene.yaml").contacts.arrays) == 4


def test_a_capsule_lies() -> None:
    table = Support("table", HalfSpace(), np.eye(4))
    lying = lying_object(
        ManipulatedObject.from_shape("o", Capsule(0.02, 0.1), np.eye(4), mass=1), table
    )
    assert lying.T_world_object[2, 3] == pytest.approx(0.02, abs=1e-6)


def test_settle_writes_the_object_on_its_support_and_keeps_degrees() -> None:
    above = spoilt(
        "pose: {position: [0, 0, 0]}",
        "pose: {position: [0, 0, 0.1], rpy_deg: [0, 0, 90]} # high",
        LINES,
    )
    Path("above.yaml").write_text(above)
    result = run("settle", "above.yaml", "-o", "settled.yaml")
    assert result.exit_code == 0
    assert "object 'box' moves down by 100.000 mm" in result.stdout
    assert "wrote settled.yaml" in result.stdout
    text = Path("settled.yaml").read_text()
    assert "rpy_deg: [0, 0, 90]} # high" in text
    T = load_scene("settled.yaml").object.T_world_object
    np.testing.assert_allclose(T[:3, 3], 0.0, atol=1e-6)
    np.testing.assert_allclose(
        T[:3, :3], Rotation.from_euler("z", 0.5 * np.pi).as_matrix(), atol=1e-12
    )


def test_close_writes_the_closed_hand_and_tells_which_finger_misses() -> None:
    opened = ALLEGRO.read_text().replace("joint_1.0: 0.3", "joint_1.0: 0.1")
    Path("opened.yaml").write_text(opened)
    result = run("close", "opened.yaml", "-o", "closed.yaml", "--finger", "index")
    assert result.exit_code == 0
    assert "index: touches with link_3.0_tip" in result.stdout
    assert "link_3.0_tip" in load_scene("closed.yaml").contacts.arrays.bodies
    assert_refused(run("close", "opened.yaml", "-o", "closed.yaml"), "exists already")
    assert_refused(run("close", "opened.yaml", "-o", "o.yaml", "--finger", "pinky"), "pinky")
    Path("far.yaml").write_text(opened.replace("[0.1989, 0, 0.0628]", "[0.5, 0, 0.3]"))
    missed = run("close", "far.yaml", "-o", "missed.yaml", "--finger", "index")
    assert missed.exit_code == 1 and "index: touches nothing" in missed.stdout
    # What no command takes is not written: here the object is in the slope.
    sunk = load_scene("opened.yaml")
    T_world_object = sunk.object.T_world_object.copy()
    T_world_object[2, 3] -= 0.008
    sunk.with_changes(object=sunk.object.with_pose(T_world_object)).save("sunk.yaml")
    refused = run("close", "sunk.yaml", "-o", "deep.yaml", "--finger", "index")
    assert_refused(refused, "support 'slope' and object 'box' overlap by 6.93 mm")
    assert not Path("deep.yaml").exists()


def test_an_arm_stands_where_it_reaches_the_object() -> None:
    arm = run("new", "panda", "box:0.04,0.04,0.06", "--effort", "20")
    assert arm.stdout.endswith("graspless-pin place scene.yaml -o placed.yaml\n")
    scene = load_scene("scene.yaml")
    assert scene.hand is not None
    x, _, z = scene.hand.T_world_base[:3, 3]
    assert x < -0.3
    assert z == pytest.approx(0.0, abs=1e-3)
    assert not unwanted_overlaps(scene.hand, scene.supports)
    few = "--candidates", "8", "--approach", "0,0,-1", "--verdict-nodes", "0"
    assert run("place", "scene.yaml", "-o", "placed.yaml", *few).exit_code == 0
    assert load_scene("placed.yaml").solve().found


def test_the_base_of_an_arm_is_to_be_moved_where_it_is_out_of_reach() -> None:
    arm = run("new", "panda", "box:0.04,0.04,2.5", "--effort", "20")
    place, alone = arm.stdout.splitlines()[-1].split("; ")
    assert place.endswith("graspless-pin place scene.yaml -o placed.yaml --move-base")
    assert alone.endswith("use new with the hand alone: --root-link panda_hand")
    alone = run("new", "panda", "box:0.04,0.04,0.06", "--root-link", "panda_hand", "--overwrite")
    assert alone.stdout.endswith("graspless-pin place scene.yaml -o placed.yaml\n")
    hand = run("new", pincher(Path()), "box:0.06,0.04,0.06", "--effort", "1", "--overwrite")
    assert hand.stdout.endswith("graspless-pin place scene.yaml -o placed.yaml\n")
