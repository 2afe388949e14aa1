"""A changed scene takes over what is still valid, and answers like one that was made anew."""

import pickle
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_tools import EXAMPLES, assert_same, hand_of

from graspless_pin import Scene, load_scene
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import Box, HalfSpace
from graspless_pin.problem.cones import default_tangents, projected_tangents
from graspless_pin.scene.stated import GivenContact, HandMotion, Motion

FILES = (
    "allegro_box_on_slope.yaml",
    "panda_slide_cuboid_up_slope.yaml",  # a mimic joint
    "panda_arm_drag_board.yaml",  # an arm that holds its position
    "two_hands_slide_crate.yaml",
)


@pytest.fixture(scope="module", params=FILES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return load_scene(EXAMPLES / request.param)


def anew(scene: Scene) -> Scene:
    """The same scene without anything that it or another one has found before."""
    bodies = {item.name: getattr(scene.object, item.name) for item in fields(scene.object)}
    return replace(
        scene,
        hand=pickle.loads(pickle.dumps(scene.hand)),  # noqa: S301 - our own bytes
        object=type(scene.object)(**bodies),
        supports=tuple(replace(support) for support in scene.supports),
    )


def moved_hand(scene: Scene, seed: int):
    leaders = list(hand_of(scene).tree.coupling.leaders)
    lower, upper = hand_of(scene).tree.lower[leaders], hand_of(scene).tree.upper[leaders]
    noise = np.random.default_rng(seed).uniform(-1e-5, 1e-5, len(leaders))
    return np.clip(hand_of(scene).positions[leaders] + noise, lower, upper)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(3))
def test_a_changed_hand_gives_the_problem_of_a_new_scene(scene: Scene, seed: int) -> None:
    scene.problem()
    changed = scene.with_changes(hand=hand_of(scene).with_configuration(moved_hand(scene, seed)))
    problem = changed.problem()
    assert_same(problem, anew(changed).problem())
    assert not np.array_equal(problem.positions, scene.problem().positions)


def test_a_moved_object_gives_the_problem_of_a_new_scene(scene: Scene) -> None:
    scene.problem()
    T = np.array(scene.object.T_world_object)
    T[:3, 3] += [1e-5, -2e-5, 1e-5]
    changed = scene.with_changes(object=scene.object.with_pose(T))
    assert_same(changed.problem(), anew(changed).problem())
    # And back again: what was kept last is the moved object's.
    back = changed.with_changes(object=scene.object)
    assert_same(back.problem(), anew(scene).problem())


def test_supports_and_tolerance_decide_anew(scene: Scene) -> None:
    scene.problem()
    far = np.eye(4)
    far[2, 3] = -10.0
    for changes in (
        {"supports": (*scene.supports, Support("pit", HalfSpace(), far))},
        {"contact_tolerance": 2e-3},
        {"cone_edges": 8},
        {"friction": {"default": 0.4}},
        {"max_normal_force": 7.0},
    ):
        changed = scene.with_changes(**changes)
        assert_same(changed.problem(), anew(changed).problem())
    alone = scene.with_changes(supports=())
    assert set(alone.contacts.bodies).isdisjoint(support.name for support in scene.supports)


def test_bodies_of_one_name_are_refused() -> None:
    """A support that is called as a link does not say what the link's friction is."""
    scene = load_scene(EXAMPLES / FILES[0])
    first, *others = scene.supports
    (link, *_) = hand_of(scene).link_names
    double = replace(first, friction=0.01)
    for changes, key in (
        ({"supports": (first, *others, double)}, r"supports\[\d\]\.name"),
        ({"supports": (first, *others, replace(double, name=link))}, r"supports\[\d\]\.name"),
        ({"object": replace(scene.object, name=first.name)}, r"supports\[0\]\.name"),
        ({"object": replace(scene.object, name=link)}, r"object\.name"),
    ):
        with pytest.raises(
            ArgumentError, match=rf"{key}: .* name of another body, too; names must be distinct"
        ):
            scene.with_changes(**changes)


def test_a_support_that_starts_to_move_slides() -> None:
    scene = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    assert not scene.problem().is_sliding.any()
    (slope,) = scene.supports
    belt = scene.with_changes(supports=(replace(slope, velocity=[0, 0.1, 0, 0, 0, 0]),))
    assert belt.problem().is_sliding.sum() == belt.contacts.bodies.count("slope") == 4
    assert not belt.with_changes(supports=scene.supports).problem().is_sliding.any()


def test_a_declared_motion_after_none_counts() -> None:
    scene = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    scene.problem()
    uphill = scene.object.T_world_object[:3, 0]
    moving = scene.with_changes(motion=Motion(np.concatenate([-0.05 * uphill, np.zeros(3)])))
    problem = moving.problem()
    assert problem.is_sliding.sum() == 4
    np.testing.assert_allclose(problem.sliding[-4:], [-0.05 * uphill] * 4, atol=1e-15)
    assert not moving.with_changes(motion=None).problem().is_sliding.any()


def test_keys_come_as_a_mapping(scene: Scene) -> None:
    with pytest.raises(ArgumentError, match=r"values: found \{5: 1\}; needs keys and values"):
        scene.with_changes({5: 1})  # pyright: ignore[reportArgumentType]
    with pytest.raises(ArgumentError, match=r"values: found \['a'\]; needs keys and values"):
        scene.with_changes(["a"])  # pyright: ignore[reportArgumentType]


def test_an_empty_name_of_an_algorithm_is_no_default(scene: Scene) -> None:
    with pytest.raises(ArgumentError, match="algorithm: is ''; it must be one of 'margin'"):
        scene.solve("")


def test_an_unknown_field_is_refused(scene: Scene) -> None:
    with pytest.raises(ArgumentError, match=r"tolerance: is not a field .*'contact_tolerance'"):
        scene.with_changes(tolerance=1e-3)


def test_positions_by_order_and_by_name_agree(scene: Scene) -> None:
    values = moved_hand(scene, 9)
    ordered = hand_of(scene).with_configuration(values)
    named = hand_of(scene).with_configuration(
        dict(zip(hand_of(scene).control.joints, values.tolist(), strict=True))
    )
    np.testing.assert_array_equal(ordered.positions, named.positions)
    for ours, theirs in zip(ordered.collision_bodies(), named.collision_bodies(), strict=True):
        np.testing.assert_array_equal(ours.T_world_geometry, theirs.T_world_geometry)
    tip = hand_of(scene).link_names[-1]
    np.testing.assert_array_equal(ordered.pose_of(tip), named.pose_of(tip))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda q: q[:-1], r"needs shape \(16,\), one number per independent joint, got \(15,\)"),
        (lambda q: [*q[:-1], "far"], "needs numbers"),
        (lambda q: [np.nan, *q[1:]], r"q\['joint_0.0'\].*finite"),
        (lambda q: [*q[:2], np.inf, *q[3:]], r"q\['joint_2.0'\].*finite"),
        (lambda q: [q[0], 9.0, *q[2:]], r"q\['joint_1.0'\].*is 9, outside the joint's limits"),
    ],
    ids=["short", "text", "nan", "inf", "outside"],
)
def test_impossible_positions_are_refused(spoil, message: str) -> None:
    hand = load_scene(EXAMPLES / FILES[0]).hand
    assert hand is not None
    with pytest.raises(ArgumentError, match=message):
        hand.with_configuration(spoil(list(hand.positions)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"friction": {"default": -0.1}},
            r"friction\.default: found -0\.1; needs",
        ),
        ({"friction": {"default": np.nan}}, r"friction\.default: found nan"),
        ({"friction": -1}, "friction: found -1; needs a finite number >= 0"),
        (
            {"object": {"mass": 2}},
            r"object: found .* needs a ManipulatedObject, e\.g\.",
        ),
        ({"hand": "allegro"}, "hand: found 'allegro'; needs a Hand or None"),
        ({"supports": ["table"]}, "supports: found 'table'; needs a Support"),
        ({"solve_options": {"algoritm": "margin"}}, r"solve\.algoritm: .* mean 'algorithm'"),
        ({"solve_options": {"algorithm": "torqe"}}, r"solve\.algorithm: .* mean 'torque'"),
        ({"max_normal_force": 0.0}, r"max_normal_force: found 0\.0; needs a finite number > 0"),
        ({"max_normal_force": np.nan}, "max_normal_force: found nan"),
        ({"cone_edges": 2}, "cone_edges: found 2; needs a whole number >= 3"),
        ({"cone_edges": 8.5}, r"cone_edges: found 8\.5"),
        (
            {"gravity": np.array([0.0, 0.0, np.nan])},
            r"gravity\[2\]: found nan; needs",
        ),
        ({"gravity": [[1, 2], 3]}, r"gravity\[0\]: found \[1, 2\]; needs"),
        ({"tangent_axes": None}, "tangent_axes: found nothing; needs a list"),
        ({"tangent_axes": 5}, "tangent_axes: found 5; needs a list"),
        ({"solve_options": None}, "solve: found nothing; needs a mapping"),
        ({"solve_options": 5}, "solve: found 5; needs a mapping"),
        ({"hybrid_force_limit": 0.0}, r"hybrid_force_limit: found 0\.0; needs a finite number > 0"),
        (
            {"friction": {"slop": 0.9}},
            r"friction\['slop'\]: is not the name of a body; did you mean 'slope'",
        ),
        (
            {"given_contacts": [GivenContact("slop", np.zeros(3), np.eye(3)[2])]},
            r"given_contacts\[0\]\.body: 'slop' is neither a hand link .*; did you mean 'slope'",
        ),
    ],
)
def test_numbers_that_cannot_be_are_named(changes: dict, message: str) -> None:
    scene = load_scene(EXAMPLES / FILES[0])
    with pytest.raises(ArgumentError, match=message):
        scene.with_changes(**changes)


@pytest.mark.parametrize(
    ("field", "value", "advised"),
    [
        ("given_contacts", [{"body": "slope"}], r"'contacts': \[{\.\.\.}\]"),
        ("supports", {"name": "wall"}, r"'supports': \[{\.\.\.}\]"),
        ("hand_material", {"is": "rubber"}, "'hand.material': 'rubber'"),
        ("motion", {"object_twist": {}}, r"'motion': {\.\.\.}"),
        ("path", {}, None),
    ],
)
def test_what_stands_in_a_file_is_told_by_its_key(field, value, advised) -> None:
    with pytest.raises(ArgumentError) as told:
        load_scene(EXAMPLES / FILES[0]).with_changes(**{field: value})
    if advised is None:
        assert "in the form of a file" not in str(told.value)
    else:
        told.match(rf"in the form of a file, with_changes\({{{advised}}}\)$")


def test_what_is_stated_in_python_is_copied_and_checked() -> None:
    twist = np.zeros(6)
    numbers: Any = [0.0] * 6
    motion = Motion(twist, HandMotion(numbers, {"joint_0.0": 1}))
    twist[0] = 1.0
    assert not motion.object_twist.any() and motion.hand is not None
    assert motion.hand.base_twist.shape == (6,)
    same = pickle.loads(pickle.dumps(motion))  # noqa: S301 - our own bytes
    assert same.hand.joint_velocities == {"joint_0.0": 1.0}


@pytest.mark.parametrize(
    ("make", "given", "message"),
    [
        (Motion, ([0.0] * 5,), r"object_twist: has shape \(5,\)"),
        (HandMotion, ([np.inf] * 6, {}), "base_twist: is inf at index"),
        (HandMotion, (np.zeros(6), {"joint_0.0": "fast"}), r"joint_velocities\.joint_0\.0"),
        (GivenContact, ("slope", [0.0, 0.0], np.eye(3)[2]), "position: has shape"),
        (GivenContact, ("slope", np.zeros(3), "up"), "normal: is 'up'"),
    ],
)
def test_what_is_stated_wrong_in_python_is_named(make, given, message) -> None:
    with pytest.raises(ArgumentError, match=message):
        make(*given)


def test_a_given_contact_needs_a_unit_normal() -> None:
    scene = load_scene(EXAMPLES / FILES[0])
    for normal in ([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]):
        given = GivenContact("slope", np.zeros(3), np.array(normal))
        with pytest.raises(ArgumentError, match=r"normals.*row 0.*each must be a unit vector"):
            scene.with_changes(given_contacts=(given,)).problem()


def test_an_object_that_is_pushed_into_the_slope_is_still_found_too_deep() -> None:
    scene = load_scene(EXAMPLES / FILES[0])
    scene.problem()
    T = np.array(scene.object.T_world_object)
    T[:3, 3] -= 0.02 * T[:3, 2]
    with pytest.raises(SceneError, match="support 'slope' and object 'box' overlap by 2"):
        scene.with_changes(object=scene.object.with_pose(T)).problem()


UNIT = st.floats(-1.0, 1.0)


@settings(max_examples=30)
@given(x=UNIT, y=UNIT, z=UNIT, axis=st.tuples(UNIT, UNIT, UNIT))
def test_tangents_are_projections_by_the_textbook(x, y, z, axis) -> None:
    normal = np.array([x, y, z])
    if np.linalg.norm(normal) < 1e-2:
        normal = np.array([0.0, 0.0, 1.0])
    normal = normal / np.linalg.norm(normal)
    along = np.array(axis)
    (pair,) = projected_tangents(normal[None], [along])
    if abs(along @ normal) <= 0.99 * np.linalg.norm(along) and np.linalg.norm(along) > 1e-6:
        first = along - (along @ normal) * normal
        first /= np.linalg.norm(first)
        np.testing.assert_allclose(pair, np.column_stack([first, np.cross(normal, first)]),
                                   atol=1e-9)  # fmt: skip
    default = default_tangents(normal[None])[0]
    axis_of = [1.0, 0.0, 0.0] if abs(normal[1]) > 0.99 else [0.0, 1.0, 0.0]
    first = np.cross(normal, axis_of)
    first /= np.linalg.norm(first)
    np.testing.assert_allclose(default, np.column_stack([first, np.cross(normal, first)]),
                               atol=1e-12)  # fmt: skip


def test_a_scene_that_never_answered_shares_what_its_copies_find() -> None:
    scene = load_scene(EXAMPLES / FILES[0])
    hand = hand_of(scene)
    first = scene.with_changes(hand=hand.with_configuration(hand.positions)).contacts
    second = scene.with_changes(hand=hand.with_configuration(hand.positions)).contacts
    np.testing.assert_array_equal(first.arrays.positions, second.arrays.positions)
    box = Support("crate", Box((0.1, 0.1, 0.1)), np.eye(4))
    apart = np.array(box.T_world_support)
    apart[:3, 3] = [0.0, 0.0, 5.0]
    with_box = scene.with_changes(supports=(*scene.supports, replace(box, T_world_support=apart)))
    assert with_box.contacts.bodies == first.bodies


def test_friction_is_looked_up_anew_where_what_it_says_changed(scene: Scene) -> None:
    first = scene.problem().friction
    count = scene.contacts.arrays.hand_count
    for changes, expected in (
        ({"friction": {"hand": 0.11, "supports": 0.22}}, (0.11, 0.22)),
        ({"friction": {"default": 0.33, "hand": 0.44}}, (0.44, 0.33)),
    ):
        supports = tuple(replace(support, friction=None) for support in scene.supports)
        changed = scene.with_changes(**changes, supports=supports, hand_material=None)
        found = changed.problem().friction
        np.testing.assert_array_equal(found[:count], expected[0])
        np.testing.assert_array_equal(found[count:], expected[1])
    np.testing.assert_array_equal(scene.problem().friction, first)
    with pytest.raises(
        SceneError, match=r"friction: has no coefficient for .*; add '.*', 'hand' or"
    ):
        scene.with_changes(friction={"supports": 0.3}).problem()


@pytest.mark.parametrize(
    ("key", "value", "read"),
    [
        ("object.mass", 2.5, lambda scene: scene.object.mass),
        ("friction.hand", 0.31, lambda scene: scene.friction["hand"]),
        ("hand.q.joint_1.0", 0.3001, lambda scene: scene.hand.q["joint_1.0"]),
        ("hand.effort_limits.index", 0.2, lambda scene: scene.hand.effort_limits[1][0]),
        ("supports.slope.friction", 0.21, lambda scene: scene.supports[0].friction),
        ("solve.margin", 0.7, lambda scene: scene.solve_options["margin"]),
        ("max_normal_force", 9.0, lambda scene: scene.max_normal_force),
    ],
)
def test_a_key_of_the_file_changes_what_the_file_would(tmp_path, key, value, read) -> None:
    """The oracle is the file itself, with the key edited and loaded."""
    scene = load_scene(EXAMPLES / FILES[0])
    changed = scene.with_changes({key: value})
    assert read(changed) == value
    assert read(scene) != value
    text = yaml.safe_load((EXAMPLES / FILES[0]).read_text())
    node, names = text, key.split(".", 2 if key.startswith("hand") else -1)
    for name in names[:-1]:
        if isinstance(node, list):
            node = next(one for one in node if one["name"] == name)
        else:
            if not isinstance(node.get(name, {}), dict | list):
                node[name] = {"default": node[name]}
            node = node.setdefault(name, {})
    node[names[-1]] = value
    (tmp_path / "edited.yaml").write_text(yaml.safe_dump(text))
    assert_same(changed.problem(), load_scene(tmp_path / "edited.yaml").problem())


def test_keys_are_changed_beside_fields_and_after_earlier_changes() -> None:
    scene = load_scene(EXAMPLES / FILES[0])
    moved = scene.with_changes(hand=hand_of(scene).with_configuration({"joint_1.0": 0.3001}))
    changed = moved.with_changes({"object.mass": 2.0}, cone_edges=8, solve={"algorithm": "torque"})
    assert (changed.object.mass, changed.cone_edges) == (2.0, 8)
    assert changed.solve_options["algorithm"] == "torque"
    assert changed.hand is moved.hand
    np.testing.assert_array_equal(changed.object.T_world_object, scene.object.T_world_object)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("object.masss", 1.0, r"object\.masss: unknown key; did you mean 'mass'"),
        ("objct.mass", 1.0, r"objct\.mass: is not a key of a scene; did you mean 'object'"),
        ("object.mass", -1.0, r"object\.mass: found -1\.0; needs a finite number > 0"),
        ("supports.slop.friction", 0.1, "has no item named 'slop'; did you mean 'slope'"),
        ("supports.².friction", 0.1, "has no item named '²'"),
        ("supports.--1.friction", 0.1, "has no item named '--1'"),
        ("supports.-1.friction", 0.1, "has no item -1; it has 1"),
        ("warnings", "error", "warnings: is not a key of a scene"),
        ("gravity.0.1", 1.0, r"gravity\.0\.1: gravity\.0 is 0 and has no keys below it"),
        ("object.pose.rpy_deg.1", 1.0, "use rpy instead, in rad"),
    ],
)
def test_a_key_that_leads_nowhere_is_named(key: str, value: object, message: str) -> None:
    with pytest.raises((ArgumentError, SceneError), match=message):
        load_scene(EXAMPLES / FILES[0]).with_changes({key: value})


@pytest.mark.parametrize(
    ("key", "above"),
    [
        ("hand.armature", {}),
        ("controller.stiffness", {"controller": {"stiffness": {"joint_0.0": 1.0}}}),
        ("controller.damping", {"controller": {"stiffness": 1.0, "damping": {"joint_0.0": 1.0}}}),
        ("uncertainty.contact_position", {"uncertainty": {"mass": 0.1}}),
    ],
)
def test_names_may_hold_dots(key: str, above: dict) -> None:
    scene = load_scene(EXAMPLES / FILES[0])
    name = "link_3.0_tip" if key.startswith("uncertainty") else "joint_1.0"
    changed = (scene.with_changes(above) if above else scene).with_changes({f"{key}.{name}": 1e-3})
    part, figure = key.split(".")
    if part == "hand":
        tree = hand_of(changed).tree
        assert tree.pinocchio_model.armature[tree.joint_index[name]] == 1e-3
    else:
        assert getattr(getattr(changed, part), figure)[name] == 1e-3


def test_a_key_replaces_the_one_that_may_not_stand_beside_it(scene: Scene) -> None:
    """Also what an earlier change has left in its place."""
    for _ in range(2):
        scene = scene.with_changes({"object.density": 500.0})
        dense = scene.object.mass
        scene = scene.with_changes({"object.pose.quaternion": [0.0, 0.0, 0.6, 0.8]})
        np.testing.assert_allclose(scene.object.T_world_object[0, :3], [0.28, -0.96, 0.0])
        scene = scene.with_changes({"object.mass": 2.0, "object.pose.rpy": [0.0, 0.0, np.pi]})
        assert scene.object.mass == 2.0 != dense
        np.testing.assert_allclose(scene.object.T_world_object[:2, :2], -np.eye(2), atol=1e-12)
    with pytest.raises(SceneError, match="found both of 'mass'"):
        scene.with_changes({"object.mass": 2.0, "object.density": 500.0})


def test_a_part_of_a_body_is_no_field_but_a_key(scene: Scene) -> None:
    with pytest.raises(ArgumentError, match=r"mass: .*with_changes\(\{'object\.mass': \.\.\.\}\)"):
        scene.with_changes(mass=2.0)
