"""Loads and accelerations: hand-solved cases, equivalent scenes, files, and what is refused."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import yaml
from scene_tools import EXAMPLES, PAPER, content, hand_of, loaded
from scipy.spatial.transform import Rotation
from tests.studies.study_tools import Here

from graspless_pin import Evaluator, Scene, load_scene
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry import ManipulatedObject
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document
from graspless_pin.scene import Acceleration, Load
from graspless_pin.studies import Study, run_study

CUBOID = PAPER / "cuboid_at_rest.yaml"
BOX = EXAMPLES / "allegro_box_on_slope.yaml"
BOARD = EXAMPLES / "panda_arm_drag_board.yaml"
ARM = {"panda_joint1": 0.4, "panda_joint2": -0.3, "panda_joint4": 0.2}


def turned(scene: Scene, rotvec: list[float]) -> Scene:
    """The scene with its object turned about its centre of mass."""
    made = scene.object
    T = np.array(made.T_world_object)
    T[:3, :3] = Rotation.from_rotvec(rotvec).as_matrix() @ T[:3, :3]
    T[:3, 3] = made.center_of_mass_world - T[:3, :3] @ made.center_of_mass
    return scene.with_changes(object=made.with_pose(T))


def carried() -> Scene:
    """A Panda that holds a board at rest, away from the table."""
    scene = load_scene(BOARD)
    return scene.with_changes(supports=(), motion=None)


def with_payload_in_the_object(scene: Scene, load: Load) -> Scene:
    """The same scene with one heavier object in place of an object and a payload."""
    made = scene.object
    assert load.at is not None
    mass = made.mass + load.mass
    center = (made.mass * made.center_of_mass + load.mass * load.at) / mass
    inertia = np.array(made.own_inertia)
    for own, at in ((made.mass, made.center_of_mass), (load.mass, load.at)):
        d = at - center
        inertia += own * (d @ d * np.eye(3) - np.outer(d, d))
    heavier = ManipulatedObject(
        made.name, made.shape, mass, center, made.T_world_object, made.material, inertia
    )
    return scene.with_changes(object=heavier)


def test_the_wrench_is_the_sum_of_weight_and_loads() -> None:
    scene = load_scene(CUBOID)
    made = scene.object
    R, at = made.T_world_object[:3, :3], np.array([0.02, 0.0, 0.03])
    lever = R @ (at - made.center_of_mass)
    loads = [
        Load("cable", force=[1.0, 2.0, 3.0], at=at),
        Load("tool", force=[0.0, 0.0, -4.0], moment=[0.1, 0.0, 0.2], at=at, axes="object"),
        Load("payload", mass=0.3, at=at),
        Load("wind", field=[0.5, 0.0, 0.0]),
    ]
    wrench = scene.with_changes(loads=loads).problem().external_wrench
    forces = [np.array([1.0, 2.0, 3.0]), R @ [0.0, 0.0, -4.0], 0.3 * scene.gravity,
              0.3 * np.array([0.5, 0.0, 0.0])]  # fmt: skip
    expected = np.r_[made.mass * scene.gravity + made.mass * np.array([0.5, 0, 0]), np.zeros(3)]
    for force in forces:
        expected += np.r_[force, np.cross(lever, force)]
    expected[3:] += R @ [0.1, 0.0, 0.2]
    np.testing.assert_allclose(wrench, expected, atol=1e-12)


def test_only_loads_in_the_objects_axes_turn_with_it() -> None:
    scene = load_scene(CUBOID)
    for axes in ("world", "object"):
        told = scene.with_changes(loads=[Load("push", force=[1.0, 2.0, 0.0], axes=axes)])
        aside = turned(told, [0.0, 0.0, 0.001])
        weight = scene.object.mass * scene.gravity
        before, after = (one.problem().external_wrench[:3] - weight for one in (told, aside))
        R = np.eye(3)
        if axes == "object":
            R = aside.object.T_world_object[:3, :3] @ scene.object.T_world_object[:3, :3].T
        np.testing.assert_allclose(after, R @ before, atol=1e-12)


@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_a_payload_is_a_heavier_object(algorithm: str) -> None:
    scene = load_scene(BOX)
    load = Load("payload", mass=0.04, at=[0.01, -0.005, 0.02])
    loaded_, heavier = scene.with_changes(loads=[load]), with_payload_in_the_object(scene, load)
    own, other = loaded_.solve(algorithm), heavier.solve(algorithm)
    assert own.margin == pytest.approx(other.margin, rel=1e-7)
    assert own.max_torque == pytest.approx(other.max_torque, rel=1e-6)
    # Kinetic energy of one twist, about either centre of mass.
    shift = heavier.object.center_of_mass_world - scene.object.center_of_mass_world
    v, w = np.array([0.1, -0.3, 0.2]), np.array([1.0, 0.5, -2.0])
    there, here = np.r_[v + np.cross(w, shift), w], np.r_[v, w]
    ours, theirs = loaded_.problem().object_inertia, heavier.problem().object_inertia
    assert ours is not None and theirs is not None
    assert here @ ours @ here == pytest.approx(there @ theirs @ there, rel=1e-12)
    # Verdicts and growth rates do not depend on the point that wrenches are about.
    verdicts = [one.stability(own.torques) for one in (loaded_, heavier)]
    assert verdicts[0].status is verdicts[1].status
    assert verdicts[0].growth_rate == pytest.approx(verdicts[1].growth_rate, rel=1e-6)


@pytest.mark.parametrize("file", [CUBOID, BOX])
def test_a_base_that_translates_is_other_gravity(file: Path) -> None:
    scene = load_scene(file)
    a = np.array([0.3, -0.4, 1.5])
    moving = scene.with_changes(acceleration=Acceleration(linear=a))
    heavier = scene.with_changes(gravity=scene.gravity - a)
    for name in ("external_wrench", "gravity_torques"):
        own, other = getattr(moving.problem(), name), getattr(heavier.problem(), name)
        np.testing.assert_allclose(own, other, atol=1e-12)
    own, other = moving.solve("margin"), heavier.solve("margin")
    assert own.margin == pytest.approx(other.margin, rel=1e-9)
    # Torques that carry an idle finger are exact in its own scene alone.
    pairs = zip((moving, heavier), (own.torques, other.torques), strict=True)
    verdicts = [one.stability(torques) for one, torques in pairs]
    assert verdicts[0].holding is verdicts[1].holding
    assert verdicts[0].growth_rate == pytest.approx(verdicts[1].growth_rate, rel=1e-6)


def test_of_the_object_alone_links_feel_nothing() -> None:
    scene = load_scene(BOX)
    moving = scene.with_changes(acceleration=Acceleration(linear=[0, 0, 2.0], of="object"))
    own, rest = moving.problem(), scene.problem()
    np.testing.assert_array_equal(own.gravity_torques, rest.gravity_torques)
    force = scene.object.mass * (scene.gravity - [0.0, 0.0, 2.0])
    np.testing.assert_allclose(own.external_wrench, np.r_[force, np.zeros(3)], atol=1e-12)


def test_turning_takes_centripetal_forces_and_gyroscopic_moments() -> None:
    scene = turned(load_scene(CUBOID), [0.0, 0.0, 0.002])
    made, omega, alpha = scene.object, np.array([0.0, 2.0, 1.0]), np.array([0.5, 0.0, 3.0])
    pivot = made.center_of_mass_world + np.array([0.5, 0.0, 0.0])
    told = Acceleration(angular=alpha, angular_velocity=omega, at=pivot, of="object")
    wrench = scene.with_changes(acceleration=told).problem().external_wrench
    arm = made.center_of_mass_world - pivot
    a = np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    I = made.spatial_inertia()[3:, 3:]  # noqa: E741 - the inertia
    np.testing.assert_allclose(wrench[:3], made.mass * (scene.gravity - a), atol=1e-12)
    np.testing.assert_allclose(wrench[3:], -(I @ alpha + np.cross(omega, I @ omega)), atol=1e-12)


def test_an_object_in_a_gripper_moves_with_the_arm() -> None:
    """The centre of mass as a point of the hand, by second differences of the arm's motion."""
    scene = carried()
    rates = {name: 2.0 * value for name, value in ARM.items()}
    told = scene.with_changes(
        acceleration=Acceleration(joint_velocities=rates, joint_accelerations=ARM)
    )
    hand, center, h = hand_of(scene), scene.object.center_of_mass_world, 1e-4

    def place(t: float) -> np.ndarray:
        q = {name: hand.q[name] + rates[name] * t + 0.5 * ARM[name] * t**2 for name in ARM}
        T = hand.with_configuration(q).pose_of("panda_hand")
        return (T @ np.linalg.inv(hand.pose_of("panda_hand")) @ np.r_[center, 1.0])[:3]

    a = (place(h) - 2.0 * place(0.0) + place(-h)) / h**2
    force = told.problem().external_wrench[:3]
    np.testing.assert_allclose(force, scene.object.mass * (scene.gravity - a), atol=1e-5)


def test_evaluators_and_changed_scenes_answer_like_new_ones() -> None:
    scene = load_scene(BOX).with_changes(
        loads=[Load("cable", force=[0.1, 0.0, 0.2], at=[0.0, 0.0, 0.02], axes="object")]
    )
    evaluator = Evaluator(scene, algorithm="margin")
    T = np.array(scene.object.T_world_object)
    T[:3, 3] += 1e-5
    fresh = scene.with_changes(object=scene.object.with_pose(T)).solve("margin").margin
    assert evaluator.evaluate(T_world_object=T).margin == pytest.approx(fresh, rel=1e-9)
    many = evaluator.evaluate_many(np.tile(evaluator.configuration(), (3, 1)))
    np.testing.assert_allclose(many.margins, scene.solve("margin").margin, rtol=1e-9)
    moving = scene.with_changes(acceleration=Acceleration(angular_velocity=[0, 0, 2.0]))
    many = Evaluator(moving, algorithm="margin").evaluate_many(
        np.tile(evaluator.configuration(), (3, 1))
    )
    np.testing.assert_allclose(many.margins, moving.solve("margin").margin, rtol=1e-9)


FILE: dict[str, Any] = {
    "loads": [
        {"name": "cable", "force": [0.0, 0.0, 0.5], "at": [0.0, 0.0, 0.02], "axes": "object"},
        {"name": "water", "mass": 0.05},
    ],
    "acceleration": {"linear": [0.5, 0.0, 0.0], "joint_accelerations": {"joint_1.0": 0.0}},
}


def test_files_say_loads_and_are_written_again(tmp_path: Path) -> None:
    data = content(BOX)
    scene = loaded(tmp_path, data | FILE)
    assert [str(load) for load in scene.loads] == [
        "cable: force [0, 0, 0.5] N of the object, at [0, 0, 0.02] m", "water: 0.05 kg",
    ]  # fmt: skip
    assert str(scene.acceleration) == "base: [0.5, 0, 0] m/s^2, joints accelerate [joint_1.0 0]"
    assert "load      water: 0.05 kg" in str(scene)
    again = load_scene(scene.save(tmp_path / "again.yaml"))
    np.testing.assert_array_equal(again.problem().external_wrench, scene.problem().external_wrench)
    bare = scene.with_changes(loads=(), acceleration=None)
    text = bare.save(tmp_path / "bare.yaml").read_text()
    assert "loads" not in text and "acceleration" not in text
    copied = pickle.loads(pickle.dumps(scene))  # noqa: S301 - our own bytes
    np.testing.assert_array_equal(copied.problem().external_wrench, scene.problem().external_wrench)


def test_documents_state_loads_and_are_verified(tmp_path: Path) -> None:
    scene = loaded(tmp_path, content(BOX) | FILE)
    solution = scene.solve()
    document = solution_document(solution, scene, verdict=scene.stability(solution.torques))
    assert [one["name"] for one in document["loads"]] == ["cable", "water"]
    assert document["acceleration"]["linear"] == [0.5, 0.0, 0.0]
    assert verify_document(document).passed
    document["loads"][1]["mass"] = 0.06
    with pytest.raises(
        ValueError, match=r"object_inertia has the mass .* kg; object and loads have"
    ):
        verify_document(document)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"loads": [{"name": "a", "mass": 1}, {"name": "a", "mass": 2}]},
            r"loads\[1\].name: 'a' is the name of another load",
        ),
        ({"loads": [{"name": "a", "force": [0, 0]}]}, r"loads\[0\].force"),
        ({"loads": [{"name": "a", "mass": -1}]}, r"loads\[0\].mass"),
        ({"loads": [{"name": "a", "push": 1}]}, r"loads\[0\].push"),
        ({"loads": [{"name": "a", "at": [0, 0, 0]}]}, "found none of 'force', 'moment', 'mass'"),
        ({"acceleration": {"joint_velocities": {"elbow": 1.0}}}, "unknown independent joint"),
        ({"acceleration": {"of": "object", "joint_velocities": {"joint_1.0": 1.0}}}, "object"),
        ({"acceleration": {"of": "arm"}}, r"acceleration.of"),
        ({"acceleration": {"of": "object"}}, "found only 'of' and 'at'; needs at least one of"),
    ],
)
def test_files_that_are_wrong_name_the_key(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError, match=message):
        loaded(tmp_path, content(BOX) | changes)


def test_what_cannot_be_is_refused() -> None:
    scene = load_scene(BOX)
    with pytest.raises(ArgumentError, match=r"loads.a.force: .*3"):
        Load("a", force=[1.0, 2.0])
    with pytest.raises(ArgumentError, match=r"loads.a.axes: is 'hand'"):
        Load("a", axes="hand")
    with pytest.raises(ArgumentError, match=r"loads.a.mass: is '3'; .*, not text; write 3$"):
        Load("a", mass=cast("Any", "3"))
    with pytest.raises(ArgumentError, match=r"name: is 3; it must be a text"):
        Load(cast("Any", 3))
    with pytest.raises(ArgumentError, match=r"acceleration.joint_velocities.b: is 'fast'"):
        Acceleration(joint_velocities={"b": cast("Any", "fast")})
    with pytest.raises(
        ArgumentError, match=r"acceleration: found .* in the form of a file, with_changes"
    ):
        scene.with_changes(acceleration={"linear": [1, 2]})
    wrong = scene.with_changes(acceleration=Acceleration(joint_velocities={"elbow": 1.0}))
    with pytest.raises(SceneError, match=r"yaml: acceleration.joint_velocities: unknown independ"):
        wrong.problem()
    with pytest.raises(ArgumentError, match="must be distinct"):
        scene.with_changes(loads=[Load("a"), Load("a")])
    with pytest.raises(
        ArgumentError, match="is 'object', which is not supported together with joint motions"
    ):
        Acceleration(of="object", joint_velocities={"joint_1.0": 1.0})
    one = scene.with_changes(acceleration=Acceleration(joint_accelerations={"joint_1.0": 5.0}))
    with pytest.raises(SceneError, match="do not move as one body"):
        one.problem()
    board = load_scene(BOARD).with_changes(
        motion=None, acceleration=Acceleration(joint_velocities=ARM)
    )
    with pytest.raises(SceneError, match="declare how it slides"):
        board.problem()


def computed(scene: Path, vary: dict[str, Any], folder: Path) -> list[float]:
    study = Study.from_data({"scene": str(scene), "vary": vary})
    file = folder / f"{next(iter(vary))}.csv"
    return run_study(study, file, executor=Here(), progress=False)["margin_N"].tolist()


def test_studies_vary_and_turn_loads(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(yaml.safe_dump(content(CUBOID) | {"loads": FILE["loads"]}), encoding="utf-8")
    vary = {
        "loads.water.mass": {"values": [50.0], "unit": "g"},
        "acceleration.linear.2": {"values": [0.0, 2.0], "unit": "m/s^2"},
    }
    table = computed(scene, vary, tmp_path)
    expected = [
        load_scene(scene).with_changes(acceleration=Acceleration(linear=[0.0, 0.0, a])).solve()
        for a in (0.0, 2.0)
    ]
    np.testing.assert_allclose(table, [one.margin for one in expected])
    turn_all = {"tilt": {"values": [0.3], "turn": {
        "what": ["all", "gravity", "loads"], "axis": [1, 0, 0]}}}  # fmt: skip
    np.testing.assert_allclose(computed(scene, turn_all, tmp_path), expected[0].margin, rtol=1e-6)
