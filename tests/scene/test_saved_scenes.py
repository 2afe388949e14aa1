"""A scene that is saved and loaded is the same problem, and its file keeps what it said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_tools import BOX, EXAMPLES, PAPER, hand_of

from graspless_pin import Controller, Hand, Scene, load_scene
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry import (
    Box,
    Cone,
    FingerSpec,
    HalfSpace,
    LinkMeshes,
    ManipulatedObject,
    Materials,
    MeshShape,
    Support,
)
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.robots.files import load_robot
from graspless_pin.report.provenance import problem_sha256, same_problem
from graspless_pin.scene import GivenContact, HandMotion, Motion
from graspless_pin.scene.saving import scene_text

FILES = sorted([*EXAMPLES.glob("*.yaml"), *PAPER.glob("*.yaml")])
REST = PAPER / "cuboid_at_rest.yaml"
TWO_HANDS = EXAMPLES / "two_hands_slide_crate.yaml"
SETTINGS = ("gravity", "max_normal_force", "cone_edges", "cone", "contact_tolerance",
            "points_per_patch", "count_own_weight", "hybrid_force_limit", "hand_material",
            "tangent_axes", "materials", "friction", "solve_options", "controller")  # fmt: skip


def again(scene: Scene, path: Path) -> Scene:
    """Save a scene, and return what it loads to, which must be the same."""
    loaded = load_scene(scene.save(path))
    for name in SETTINGS:
        np.testing.assert_equal(getattr(loaded, name), getattr(scene, name), err_msg=name)
    assert same_problem(loaded.problem(), scene.problem())
    return loaded


def lines_of(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def changed_lines(scene: Scene, path: Path) -> dict[str, str]:
    """Save a scene as another file of its folder; return the lines that differ, old to new."""
    assert scene.path is not None
    old, new = lines_of(scene.path), scene_text(scene, scene.path.with_name("x.yaml")).splitlines()
    again(scene, path)
    assert len(old) == len(new)
    return {a.strip(): b.strip() for a, b in zip(old, new, strict=True) if a != b}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_examples(file: Path, tmp_path: Path) -> None:
    """As they are their text stays; from elsewhere and from nothing they are the same problem."""
    scene = load_scene(file)
    assert scene_text(scene, file.with_name("other.yaml")) == file.read_text(encoding="utf-8")
    elsewhere = load_scene(scene.save(tmp_path / "deeper.yaml"))
    assert problem_sha256(elsewhere.problem()) == problem_sha256(scene.problem())
    assert elsewhere.name == scene.name
    made = again(scene.with_changes(path=None), tmp_path / "made.yaml")
    assert made.name == scene.name


@pytest.fixture(scope="module")
def rest() -> Scene:
    return load_scene(REST)


def test_a_moved_object_changes_its_own_line(rest: Scene, tmp_path: Path) -> None:
    T = np.array(rest.object.T_world_object)
    T[:3, 3] += [0.0, 1e-4, 0.0]
    line = "pose: {position: [0.0, 0.0, 0.1414213562], rpy: [0.0, 0.7853981634, 0.0]}"
    found = changed_lines(rest.with_changes(object=rest.object.with_pose(T)), tmp_path / "x.yaml")
    assert [*found.values()] == [next(iter(found)).replace("[0, 0,", "[0, 0.0001,")] or line


@pytest.mark.parametrize("form", ["rpy", "quaternion", "matrix", "rpy: null, rpy_deg"])
def test_a_rotation_keeps_its_form(form: str, tmp_path: Path) -> None:
    R = {
        "rpy": [0.1, 0.2, 0.3],
        "quaternion": [0.0, 0.0, 0.6, 0.8],
        "matrix": [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        "rpy: null, rpy_deg": [0, 0, 10],
    }[form]
    file = tmp_path / "first.yaml"
    file.write_text(
        f"object: {{shape: {{type: sphere, radius: 1}}, mass: 1, pose: {{{form}: {R}}}}}\n"
        "friction: 1\nsupports: [{name: floor, shape: {type: half_space}, "
        "pose: {position: [0, 0, -1]}}]\n",
        encoding="utf-8",
    )
    scene = load_scene(file)
    turned = scene.object.T_world_object @ pose_matrix(np.zeros(3), [0.5, -0.4, 1.0])
    saved = tmp_path / "second.yaml"
    again(scene.with_changes(object=scene.object.with_pose(turned)), saved)
    text = saved.read_text(encoding="utf-8")
    assert f"{form.split()[-1]}: [" in text and text.count("pose: {") == 2
    upright = scene.object.with_pose(pose_matrix([0, 0, 0], [0.3, -np.pi / 2, 0.2]))
    again(scene.with_changes(object=upright), tmp_path / "upright.yaml")


def test_figures_change_where_they_stand(rest: Scene, tmp_path: Path) -> None:
    changed = rest.with_changes(
        max_normal_force=20.0, friction={"default": 0.25}, solve_options={"algorithm": "torque"}
    )
    file = tmp_path / "x.yaml"
    again(changed.with_changes(solve_options=rest.solve_options), file)
    kept = [line for line in lines_of(REST) if line.lstrip().startswith("#")]
    assert set(kept) <= set(lines_of(file))
    assert {"friction: 0.25"} <= {line.split(" #")[0] for line in lines_of(file)}
    assert load_scene(changed.save(tmp_path / "y.yaml")).solve().algorithm == "torque"


def test_joints_and_mounts_change_one_by_one(tmp_path: Path) -> None:
    scene = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    moved = scene.with_changes(hand=hand_of(scene).with_configuration({"joint_1.0": 0.3001}))
    assert changed_lines(moved, tmp_path / "x.yaml") == {"joint_1.0: 0.3": "joint_1.0: 0.3001"}
    scene = load_scene(TWO_HANDS)
    first, second = hand_of(scene).mounts
    lifted = np.array(second.T_world_base)
    lifted[2, 3] += 1e-4
    hand = Hand.assemble([first, replace(second, T_world_base=lifted)], q=hand_of(scene).q)
    (line,) = changed_lines(scene.with_changes(hand=hand), tmp_path / "y.yaml").values()
    assert "0.1001" in line


def test_supports_come_and_go_with_their_comments(tmp_path: Path) -> None:
    file = tmp_path / "box.yaml"
    wall = (
        "  # To the left.\n  - {name: wall, shape: {type: box, size: [1, 1, 1]}, "
        "pose: {position: [-0.6, 0, 0]}}\n"
    )
    file.write_text(f"{BOX}{wall}", encoding="utf-8")
    scene = load_scene(file)
    floor, left = scene.supports
    right = Support("right", Box((1.0, 1.0, 1.0)), pose_matrix([0.6, 0.0, 0.0]), friction=0.1)
    text = scene_text(scene.with_changes(supports=(left, right)), file)
    assert text.startswith(BOX[: BOX.index("  - name: floor")])
    assert wall in text
    assert "floor" not in text
    again(scene.with_changes(supports=(floor, right)), tmp_path / "two.yaml")
    again(scene.with_changes(supports=(right, left, floor)), tmp_path / "three.yaml")
    assert "supports" not in scene_text(scene.with_changes(supports=()), file)


def odd(tmp_path: Path) -> Scene:
    """Return a scene made in Python that says something at every key."""
    hand = Hand.assemble(
        [Mount("lever_100mm", pose_matrix([-0.1, -0.1, 0.0], [np.pi, 0, 0]), "left/",
               meshes=LinkMeshes(concavity=0.5)),
         Mount(EXAMPLES.parent / "robots" / "lever_150mm.urdf", pose_matrix([0.1, 0.15, 0.0]),
               "right/", fingers={"only": FingerSpec(("hinge",), ("tip",), "tip")})],
        control={"right/only": "hybrid"}, effort_limits={"left/hinge": (-1.0, 2.0)},
        armature={"left/hinge": 0.01},
    )  # fmt: skip
    box = ManipulatedObject.from_shape(
        "box", Box((0.2, 0.2, 0.2)), np.eye(4), mass=1.0, center_of_mass=[0.0, 0.01, 0.0],
        inertia=[0.01, 0.02, 0.025], material="wood",
    )  # fmt: skip
    floor = Support(
        "floor", HalfSpace(), pose_matrix([0, 0, -0.1]), 0.4, np.array([0.1, 0, 0, 0, 0, 0]), "wood"
    )
    contacts = [("left/tip", [0.0, -0.1, 0.0], [0.0, 1.0, 0.0]),
                ("right/tip", [0.0, 0.1, 0.0], [0.0, -1.0, 0.0]),
                ("floor", [0.0, 0.0, -0.1], [0.0, 0.0, 1.0])]  # fmt: skip
    return Scene(
        "odd", box, {"default": 0.3, "left/tip": 0.8}, hand, (floor,),
        gravity=np.array([0.0, 0.1, -9.81]),
        materials=Materials.from_table({"wood": {"wood": 0.3, "rubber": 0.9}}),
        hand_material="rubber",
        given_contacts=tuple(GivenContact(a, np.array(b), np.array(c)) for a, b, c in contacts),
        motion=Motion(
            np.array([0.2, 0, 0, 0, 0, 0]), HandMotion(np.full(6, 0.0), {"left/hinge": 0.0})
        ),
        max_normal_force=30.0, cone_edges=8, contact_tolerance=2e-3, points_per_patch=4,
        tangent_axes=(np.array([1.0, 0.0, 0.0]),), count_own_weight=False, hybrid_force_limit=7.0,
        controller=Controller({"left/hinge": 2.0, "default": 1.0}, damping=0.1),
        solve_options=load_scene(REST).solve_options,
    )  # fmt: skip


def test_a_scene_made_in_python_says_everything(tmp_path: Path) -> None:
    scene = odd(tmp_path)
    loaded = again(scene, tmp_path / "odd.yaml")
    assert hand_of(loaded).control == hand_of(scene).control
    assert hand_of(loaded).fingers == hand_of(scene).fingers
    np.testing.assert_array_equal(hand_of(loaded).effort_limits, hand_of(scene).effort_limits)
    assert loaded.name == "odd"
    assert "name: odd" not in (tmp_path / "odd.yaml").read_text(encoding="utf-8")
    # From that file back to hardly anything, and to another hand.
    bare = loaded.with_changes(
        motion=None, given_contacts=None, hand=None, hand_material=None, friction={"default": 0.5},
        materials=Materials({}), tangent_axes=(), count_own_weight=True, hybrid_force_limit=None,
        controller=Controller(),
        object=replace(loaded.object, material=None, inertia=None, shape=Box((0.2, 0.2, 0.2))),
        supports=(replace(loaded.supports[0], material=None, friction=None),),
    )  # fmt: skip
    text = (again(bare, tmp_path / "bare.yaml").path or tmp_path).read_text(encoding="utf-8")
    assert not any(word in text for word in ("hand", "material", "contacts", "inertia", "motion"))
    other = load_scene(EXAMPLES / "trihand_push_box.yaml")
    again(other.with_changes(path=loaded.path), tmp_path / "trihand.yaml")


@pytest.mark.parametrize("key", ["urdf: hand.urdf", "robot: hand.yaml", "robot: cut.yaml"])
def test_a_root_link_is_what_is_mounted(key: str, tmp_path: Path) -> None:
    links = "".join(f'<link name="{name}"/>' for name in ("torso", "palm", "tip"))
    joints = "".join(
        f'<joint name="{child}_hinge" type="revolute"><parent link="{parent}"/>'
        f'<child link="{child}"/>'
        '<limit lower="-1" upper="1" effort="2" velocity="1"/></joint>'
        for parent, child in (("torso", "palm"), ("palm", "tip"))
    )
    (tmp_path / "hand.urdf").write_text(f'<robot name="r">{links}{joints}</robot>')
    (tmp_path / "hand.yaml").write_text("name: r\nurdf: hand.urdf\n")
    (tmp_path / "cut.yaml").write_text("name: r\nurdf: hand.urdf\nroot_link: palm\n")
    file = tmp_path / "scene.yaml"
    contact = "contacts: [{body: tip, position: [0, 0, 0], normal: [0, 0, 1]}]\n"
    chosen = "" if "cut" in key else "\n  root_link: palm"
    text = contact + BOX.replace("robot: lever_100mm", key + chosen)
    file.write_text(text, encoding="utf-8")
    scene = load_scene(file)
    assert hand_of(scene).joint_names == ("tip_hinge",)
    assert again(scene, tmp_path / "beside.yaml").hand is not None
    bare = again(scene.with_changes(path=None), tmp_path / "bare.yaml")
    assert hand_of(bare).joint_names == ("tip_hinge",)
    assert ("root_link: palm" in (tmp_path / "bare.yaml").read_text()) == bool(chosen)


def test_density_and_centroid_do_not_outlive_their_shape(tmp_path: Path) -> None:
    file = tmp_path / "box.yaml"
    file.write_text(BOX.replace("mass: 1.0", "density: 125 # wood"), encoding="utf-8")
    scene = load_scene(file)
    assert "density: 125 # wood" in scene_text(scene.with_changes(cone_edges=8), file)
    for made in (
        replace(scene.object, mass=2.0),
        replace(scene.object, shape=Cone(0.1, 0.2)),
        replace(scene.object, center_of_mass=np.array([0.0, 0.01, 0.0])),
    ):
        path = tmp_path / f"{made.mass}{made.center_of_mass[1]}{type(made.shape).__name__}.yaml"
        loaded = again(scene.with_changes(object=made), path)
        assert loaded.object.mass == made.mass


def test_paths_name_the_same_files_from_elsewhere(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "er"
    folder.mkdir(parents=True)
    mug = load_scene(EXAMPLES / "allegro_mug_against_wall.yaml")
    assert isinstance(mug.object.shape, MeshShape)
    moved = again(mug, folder / "mug.yaml")
    assert isinstance(moved.object.shape, MeshShape)
    assert moved.object.shape.path.resolve() == mug.object.shape.path.resolve()
    back = again(moved, tmp_path / "mug.yaml")
    assert isinstance(back.object.shape, MeshShape)
    absolute = (tmp_path / "mug.yaml").read_text(encoding="utf-8")
    start = absolute.index("path: ") + len("path: ")
    text = absolute[start:].split(",")[0]
    assert not Path(text).is_absolute()
    here = absolute.replace(text, str(mug.object.shape.path.resolve()))
    (tmp_path / "absolute.yaml").write_text(here, encoding="utf-8")
    kept = load_scene(tmp_path / "absolute.yaml")
    assert scene_text(kept, folder / "new.yaml") == here
    carriage = load_scene(EXAMPLES / "trihand_slide_and_pivot.yaml")
    again(carriage, folder / "carriage.yaml")


def test_a_file_is_not_written_over_unasked(rest: Scene, tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(SceneError, match=r"x\.yaml: exists already; choose another name"):
        rest.save(path)
    with pytest.raises(ArgumentError, match="overwrite: is 'no'; it must be True or False"):
        rest.save(path, overwrite="no")  # pyright: ignore[reportArgumentType]
    assert path.read_text(encoding="utf-8") == "mine"
    rest.save(path, overwrite=True)
    assert load_scene(path).name == rest.name
    loaded = load_scene(path)
    loaded.with_changes(cone_edges=8).save(path, overwrite=True)
    assert load_scene(path).cone_edges == 8
    with pytest.raises(
        SceneError, match=r"x\.txt: the name of a scene file must end in \.yaml or \.yml"
    ):
        rest.save(tmp_path / "x.txt")
    with pytest.raises(SceneError, match="cannot be written"):
        rest.save(path / "x.yaml")
    wrong: Any = 5
    with pytest.raises(ArgumentError, match=r"^path: is an int; it must be a path of a scene file"):
        rest.save(wrong)


def test_what_no_file_can_say_is_refused(rest: Scene, tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    lever = load_robot("lever_100mm")
    for change, place in (
        ({"effort_limits": {"hinge": 9.0}}, r"hand\.effort_limits\.hinge"),
        ({"name": "mine"}, "hand"),
    ):
        hand = Hand.assemble([Mount(replace(lever, **change), np.eye(4))])
        with pytest.raises(SceneError, match=rf"x\.yaml: {place}: a scene file cannot express"):
            rest.with_changes(hand=hand, path=None, motion=None).save(path)
    with pytest.raises(SceneError, match=r"friction: found 1e\+16; needs"):
        replace(rest, friction={"default": 1e16}).save(path)
    assert not path.exists()


def test_the_file_that_it_came_from_may_have_changed_or_gone(tmp_path: Path) -> None:
    file = tmp_path / "box.yaml"
    file.write_text(BOX, encoding="utf-8")
    scene = load_scene(file)
    file.write_text(f"# Later.\n{BOX.replace('mass: 1.0', 'mass: 3.0')}", encoding="utf-8")
    text = scene_text(scene, file)
    assert text == f"# Later.\n{BOX}"
    file.unlink()
    again(scene, file)


NUMBERS = st.floats(-0.3, 0.3)
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)


@settings(max_examples=8)
@given(
    angles=VECTORS,
    place=VECTORS,
    gravity=VECTORS.map(lambda one: np.round(one, 9)),  # a weight of 1e-55 N is refused
    q=NUMBERS,
    mass=st.floats(1e-3, 1e3),
    friction=st.dictionaries(st.sampled_from(["default", "hand", "supports"]), st.floats(0, 2)),
    edges=st.integers(3, 64),
    from_file=st.booleans(),
)
def test_any_change(tmp_path_factory, angles, place, gravity, q, mass, friction, edges, from_file):
    scene = load_scene(REST)
    box = replace(scene.object, mass=mass, T_world_object=pose_matrix(place, angles))
    wall = replace(scene.supports[0], T_world_support=pose_matrix(angles, place))
    joint = hand_of(scene).joint_names[0]
    lower, upper = hand_of(scene).tree.lower[0], hand_of(scene).tree.upper[0]
    changed = scene.with_changes(
        object=box, supports=(wall,), gravity=np.array(gravity), cone_edges=edges,
        friction={**friction, "default": 0.5},
        hand=hand_of(scene).with_configuration({joint: float(np.clip(q, lower, upper))}),
        path=scene.path if from_file else None,
    )  # fmt: skip
    loaded = load_scene(changed.save(tmp_path_factory.mktemp("any") / "x.yaml"))
    assert dict(loaded.friction) == dict(changed.friction)
    assert loaded.object.mass == mass
    assert loaded.cone_edges == edges
    np.testing.assert_array_equal(loaded.gravity, changed.gravity)
    np.testing.assert_array_equal(hand_of(loaded).positions, hand_of(changed).positions)
    for one, other in (
        (loaded.object.T_world_object, box.T_world_object),
        (loaded.supports[0].T_world_support, wall.T_world_support),
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)
