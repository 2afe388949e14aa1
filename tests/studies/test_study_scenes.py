"""What a study changes in its scene: keys, several keys at once, bodies moved and turned."""

from collections import Counter
from typing import Any

import numpy as np
import pytest
import yaml
from study_tools import CUBOID, HEIGHT, PAPER, SLOPE, study, study_file

from graspless_pin import load_scene
from graspless_pin.errors import StudyError
from graspless_pin.geometry.bodies.shapes import Box
from graspless_pin.scene import contact_arrays, load
from graspless_pin.studies import Study, load_study
from graspless_pin.studies.study import SampleParts

TIGHT = 1e-9


def at(vary, *sample, **more):
    """The scene of a study with one sample."""
    made = study(vary, **more)
    return made.scene_at(sample or made.samples[0])


def test_a_key_is_set_and_the_rest_stays():
    plain = load_scene(CUBOID)
    scene = at({"object.mass": {"values": [700], "unit": "g"}})
    assert scene.object.mass == pytest.approx(0.7, abs=1e-15)
    assert scene.friction == plain.friction
    np.testing.assert_array_equal(scene.object.T_world_object, plain.object.T_world_object)
    scene = at({"friction.slope": {"values": [0.8]}})
    assert scene.friction == {"default": 0.3, "slope": 0.8}
    by_body = dict(zip(scene.contacts.bodies, scene.problem().friction, strict=True))
    assert by_body["slope"] == 0.8
    assert by_body["finger_1/tip"] == 0.3


def test_items_of_lists_go_by_name_or_index_and_what_is_left_out_can_be_set():
    for key in ("supports.slope.pose.rpy.1", "supports.0.pose.rpy.1"):
        normal = at({key: {"values": [30], "unit": "deg"}}).supports[0].T_world_support[:3, 2]
        np.testing.assert_allclose(normal, [0.5, 0.0, np.sqrt(0.75)], atol=TIGHT)
    scene = at(
        {"object.pose.position.2": {"values": [0.001]}, "max_normal_force": {"values": [20]}}
    )
    np.testing.assert_allclose(scene.object.T_world_object[:3, 3], [0, 0, 0.001])
    rested = load_scene(CUBOID).object.T_world_object
    np.testing.assert_array_equal(scene.object.T_world_object[:3, :3], rested[:3, :3])
    assert scene.max_normal_force == 20


def test_joint_names_may_hold_dots():
    vary = {
        "hand.q.joint_1.0": {"values": [20], "unit": "deg"},
        "hand.effort_limits.joint_1.0": {"values": [0.5]},
    }
    path = str(PAPER.parent / "allegro_box_on_slope.yaml")
    made = Study.from_data({"scene": path, "vary": vary})
    hand = made.scene_at(made.samples[0]).hand
    assert hand is not None
    assert hand.q["joint_1.0"] == pytest.approx(np.deg2rad(20))
    index = hand.actuated_joint_names.index("joint_1.0")
    assert hand.effort_limits[1][index] == 0.5


def test_a_label_stands_for_a_whole_configuration():
    poses = {"straight": {}, "bent": {"finger_1/hinge": 0.001, "finger_6/hinge": -0.001}}
    made = study({"fingers": {"values": poses, "key": "hand.q"}})
    assert [*made.samples] == [("straight",), ("bent",)]
    straight, bent = (made.scene_at(sample).hand for sample in made.samples)
    assert straight is not None and bent is not None
    assert set(straight.q.values()) == {0.0}
    assert bent.q["finger_6/hinge"] == -0.001


def test_several_keys_follow_one_value():
    sets: list[dict[str, Any]] = [{"key": f"object.shape.size.{i}"} for i in range(3)]
    sets.append({"key": "supports.slope.pose.position.2", "factor": -0.5, "offset": 0.01})
    scene = at({"size": {"values": [180], "unit": "mm", "set": sets}})
    assert scene.object.shape == Box((0.18, 0.18, 0.18))
    assert scene.supports[0].T_world_support[2, 3] == pytest.approx(-0.08)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("file", ["cuboid_at_rest", "cuboid_sliding_up", "cuboid_sliding_down"])
@pytest.mark.parametrize("angle", [40.0, 55.0])
def test_turning_everything_is_tilting_gravity_the_other_way(file, angle):
    path, margins = str(PAPER / f"{file}.yaml"), []
    for way in (SLOPE["turn"], {"what": "gravity", "axis": [0, -1, 0], "as_in_scene": 45}):
        vary = {"slope": {"values": [angle], "unit": "deg", "turn": way}}
        scene = Study.from_data({"scene": path, "vary": vary}).scene_at((angle,))
        margins.append(scene.solve("margin").margin)
    assert margins[0] == pytest.approx(margins[1], abs=1e-6)
    assert abs(margins[0] - load_scene(path).solve("margin").margin) > 1e-4


def test_the_value_of_the_scene_leaves_the_scene_as_it_is():
    scene = at({"slope": SLOPE, "height": HEIGHT}, 45.0, 150.0)
    plain = load_scene(CUBOID)
    np.testing.assert_allclose(scene.problem().positions, plain.problem().positions, atol=TIGHT)
    assert scene.solve().margin == pytest.approx(plain.solve().margin, abs=1e-7)


@pytest.mark.parametrize("first", ["slope", "height"])
def test_a_finger_rises_along_the_slope_whatever_comes_first(first):
    vary = {"slope": {**SLOPE}, "height": {**HEIGHT}}
    if first == "height":
        vary = dict(reversed(vary.items()))
    values = {"slope": 30.0, "height": 120.0}
    scene = at(vary, *(values[name] for name in vary))
    normal = np.array([np.sin(np.deg2rad(30)), 0.0, np.cos(np.deg2rad(30))])
    on_slope = scene.supports[0].T_world_support[:3, 3]
    fingers = [point for point in scene.contacts.points if point.body != "slope"]
    assert len(fingers) == 2
    for point in fingers:
        assert (point.position - on_slope) @ normal == pytest.approx(0.12, abs=1e-6)


def test_only_the_named_bodies_move():
    turn = {"what": ["cuboid", "finger_1"], "axis": [0, 0, 2], "point": [1, 0, 0]}
    scene = at({"spin": {"values": [90], "unit": "deg", "turn": turn}})
    plain = load_scene(CUBOID)
    np.testing.assert_allclose(scene.object.T_world_object[:3, 3], [1, -1, 0], atol=TIGHT)
    assert scene.hand is not None and plain.hand is not None
    np.testing.assert_array_equal(
        scene.hand.base_poses["finger_6/"], plain.hand.base_poses["finger_6/"]
    )
    old, new = (hand.base_poses["finger_1/"][:3, 3] for hand in (plain.hand, scene.hand))
    np.testing.assert_allclose(new, [1 - old[1], old[0] - 1, old[2]], atol=TIGHT)
    np.testing.assert_array_equal(
        scene.supports[0].T_world_support, plain.supports[0].T_world_support
    )


def test_anchors_of_the_scene_are_copies(tmp_path):
    content = yaml.safe_load(CUBOID.read_text(encoding="utf-8"))
    pose = {"position": [5.0, 0.0, 0.0]}
    content["supports"] += [
        {"name": name, "shape": {"type": "half_space"}, "pose": pose} for name in ("one", "two")
    ]
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    assert "*id" in file.read_text(encoding="utf-8")
    vary = {"x": {"values": [1.0], "move": {"what": "one", "along": [1, 0, 0]}}}
    tree = Study.from_data({"scene": str(file), "vary": vary}).tree_at((1.0,))
    assert tree["supports"][1]["pose"]["position"][0] == 6.0
    assert tree["supports"][2]["pose"]["position"][0] == 5.0


def test_what_is_computed_goes_into_the_scene():
    made = study({"solve.margin": {"values": [0.1, 1.0]}}, compute={"algorithm": "torque"})
    torques = [made.scene_at(sample).solve().max_torque for sample in made.samples]
    plain = load_scene(CUBOID)
    expected = [plain.solve("torque", margin=margin).max_torque for margin in (0.1, 1.0)]
    assert torques == expected


def test_gains_may_vary():
    made = study({"controller.stiffness": {"values": [0.0, 2.0]}})
    assert [made.scene_at(sample).controller.stiffness for sample in made.samples] == [0.0, 2.0]
    parts = SampleParts()
    one_by_one = [made.scene_at(sample, parts) for sample in made.samples]
    assert [scene.controller.stiffness for scene in one_by_one] == [0.0, 2.0]


ANYTHING = {
    "hand.q.joint_1.0": {"values": [0.3, 0.3001]},
    "hand.base_pose.position.2": {"values": [0.0628, 0.0629]},
    "hand.effort_limits.index": {"values": [0.5, 0.7]},
    "hand.count_own_weight": {"values": [True, False]},
    "slope": {"values": [0.0, 1e-3], "turn": {"what": ["hand", "object"], "axis": [0, 0, 1]}},
    "object.mass": {"from": 0.5, "to": 2.0},
    "object.center_of_mass": {"values": {"low": [0, 0, -0.01], "middle": [0, 0, 0]}},
    "friction.supports": {"values": [0.3, 0.4]},
    "gravity.0": {"values": [0.0, -0.0, 0.1]},
    "max_normal_force": {"values": [20.0, 30.0]},
    "cone_edges": {"values": [8, 16]},
    "contact_tolerance": {"values": [0.001, 0.0011]},
    "solve.sign_rule": {"values": ["strict", "exact"]},
}


ON_A_GRID = {
    "friction": {"values": {"even": 0.3, "slope": {"default": 0.3, "slope": 0.5}}},
    "cone_edges": {"values": [8, 16]},
    "solve.algorithm": {"values": ["margin", "torque"]},
    "max_normal_force": {"values": [10.0, 20.0]},
    "tangent_axes.0.0": {"values": [1.0, 0.5]},
    "object.mass": {"values": [1.0, 2.0]},
    "slope": {"values": [45.0, 40.0], "unit": "deg", "turn": SLOPE["turn"]},
}


@pytest.mark.parametrize("grid", [False, True])
def test_parts_that_are_kept_change_nothing(grid):
    """Every array of every sample is bit for bit that of the scene built anew, in any order."""
    if grid:
        made = study(ON_A_GRID)
        mixed = np.random.default_rng(2).permutation(len(made.samples))[:20]
        samples = [*made.samples[:12], *(made.samples[int(number)] for number in mixed)]
    else:
        path = str(PAPER.parent / "allegro_box_on_slope.yaml")
        sampling = {"method": "sobol", "samples": 24, "seed": 2}
        made = Study.from_data({"scene": path, "vary": ANYTHING, "sampling": sampling})
        samples = made.samples
    parts, known = SampleParts(), 0
    for sample in samples:
        before = parts.last
        kept, fresh = (made.scene_at(sample, use) for use in (parts, None))
        known += parts.last is before
        assert kept.friction == fresh.friction and kept.solve_options == fresh.solve_options
        assert kept.objective_and_options() == fresh.objective_and_options()
        kept, fresh = kept.problem(), fresh.problem()
        for name, value in vars(fresh).items():
            if isinstance(value, np.ndarray):
                assert getattr(kept, name).tobytes() == value.tobytes(), name
        assert kept.cone_edges == fresh.cone_edges
        np.testing.assert_array_equal(kept.object_inertia, fresh.object_inertia)
    assert known if grid else len(parts.hands) == 1


@pytest.mark.parametrize(
    ("keys", "geometry", "hands"),
    [
        (["friction.supports", "object.mass", "max_normal_force", "gravity.0"], 2, 1),
        (["hand.effort_limits.index", "solve.sign_rule", "cone_edges"], 2, 1),
        (["hand.base_pose.position.2"], 3, 1),
        (["hand.q.joint_1.0"], 3, 1),
        (["slope"], 4, 1),
    ],
)
def test_only_what_a_variable_touches_is_made_again(monkeypatch, keys, geometry, hands):
    """Contacts on the hand and on supports are looked for once, or once for each pose."""
    calls: Counter[str] = Counter()
    for module, name in ((contact_arrays, "contact_arrays"), (load, "assembled_mounts")):
        function = getattr(module, name)

        def counted(*args, name=name, function=function, **options):
            calls[name] += 1
            return function(*args, **options)

        monkeypatch.setattr(module, name, counted)
    path = str(PAPER.parent / "allegro_box_on_slope.yaml")
    vary = {key: ANYTHING[key] for key in keys if "values" in ANYTHING[key]}
    made = Study.from_data({"scene": path, "vary": vary})
    calls.clear()  # the scene was built once to find the files that its robots' files name
    parts = SampleParts()
    for sample in made.samples:
        made.scene_at(sample, parts).problem()
    assert calls == {"contact_arrays": geometry, "assembled_mounts": hands}


MATERIALS = """\
object: {shape: {type: box, size: [0.2, 0.2, 0.2]}, mass: 1.0, material: cardboard}
supports:
  - {name: floor, shape: {type: half_space}, pose: {position: [0, 0, -0.1]}, material: rubber}
friction: 0.5
materials: {rubber: {cardboard: 0.9, steel: 0.7}}
"""


def of_materials(folder, vary: dict[str, Any]) -> Study:
    (folder / "scene.yaml").write_text(MATERIALS, encoding="utf-8")
    return load_study(study_file(folder, {"scene": "scene.yaml", "vary": vary}))


STEEL = {"object.material": {"values": ["cardboard", "steel"]}}


@pytest.mark.parametrize(
    ("vary", "expected"),
    [
        ({"materials.rubber.cardboard": {"values": [0.2, 0.4]}}, [0.2, 0.4]),
        (STEEL | {"materials.rubber.steel": {"values": [0.3]}}, [0.9, 0.3]),
    ],
)
def test_the_coefficient_of_a_pair_varies(tmp_path, vary, expected):
    made = of_materials(tmp_path, vary)
    found = [made.scene_at(sample).problem().friction[0] for sample in made.samples]
    assert found == expected


@pytest.mark.parametrize("pair", ["ruber.cardboard", "rubber.steel", "rubber.rubber"])
def test_a_pair_that_counts_nowhere_is_refused(tmp_path, pair):
    """Also where both materials are known: the table would vary and no contact would."""
    with pytest.raises(StudyError) as error:
        of_materials(tmp_path, {f"materials.{pair}": {"values": [0.2, 0.4]}})
    assert f"sets materials.{pair}, which has no effect: the object" in str(error.value)
    assert "the object is of 'cardboard', hand and supports are of 'rubber'" in str(error.value)
