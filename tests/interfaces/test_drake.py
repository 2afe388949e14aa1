"""Drake's programs with an evaluator's gaps, optima and torques, and the states of its plants."""

import pickle
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspless_pin import Evaluator, Hand, load_scene
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry import place_fingertips

pytest.importorskip("pydrake", reason="Drake is not installed: pip install 'graspless-pin[drake]'")
from graspless_pin.interfaces.drake import PinnedFunctions, plant_states

drake: Any = import_module("pydrake.all")

ROOT = Path(__file__).resolve().parents[2]
TIPS = tuple(f"finger_{k}_tip" for k in (1, 2, 3))
PINS = [*((tip, "object") for tip in TIPS), ("object", "table")]


def hand_of(scene: Any) -> Hand:
    assert scene.hand is not None
    return scene.hand


def evaluator_of(**options: Any) -> Evaluator:
    return Evaluator(load_scene(ROOT / "examples/trihand_push_box.yaml"), pins=PINS, **options)


def variables_of(evaluator: Evaluator) -> np.ndarray:
    """Joints and the object's pose, a little off, the quaternion longer than 1."""
    off = drake.RigidTransform(drake.RollPitchYaw(0.01, -0.02, 0.03), [0.001, 0.002, 0.003])
    X = drake.RigidTransform(evaluator.scene.object.T_world_object) @ off
    q = evaluator.configuration() + 0.01 * np.random.default_rng(0).normal(size=9)
    return np.concatenate([q, 1.3 * X.rotation().ToQuaternion().wxyz(), X.translation()])


def assert_derivatives(function: Any, x: np.ndarray) -> None:
    """Of a function of variables that depend on others: values, and gradients by these."""
    mixing = np.random.default_rng(1).normal(size=(len(x), 4))
    step = 1e-6

    def at(shares: Any) -> Any:
        return function(x + mixing @ shares)

    found = at(drake.InitializeAutoDiff(np.zeros(4))[:, 0])
    gradient = drake.ExtractGradient(found[:, None])
    differences = [(at(step * one) - at(-step * one)) / (2.0 * step) for one in np.eye(4)]
    np.testing.assert_allclose(
        drake.ExtractValue(found[:, None])[:, 0], at(np.zeros(4)), atol=1e-12
    )
    np.testing.assert_allclose(gradient, np.transpose(differences), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_gradients_are_those_of_differences(algorithm):
    evaluator = evaluator_of(algorithm=algorithm)
    functions, x = PinnedFunctions(evaluator), variables_of(evaluator)
    for function in (functions.gaps, functions.optimum):
        assert_derivatives(function, x)
    if algorithm == "torque":
        assert_derivatives(functions.torques, x)


@pytest.mark.parametrize("name", ["SnoptSolver", "IpoptSolver"])
def test_a_program_closes_gaps_and_raises_the_margin(name):
    """From fingertips that are off the box, and would do badly where they are nearest to it."""
    scene = load_scene(ROOT / "examples/trihand_push_box.yaml")
    rear = scene.object.T_world_object[0, 3] - 0.06  # m
    places = {"finger_1": (0.008, 0.079), "finger_2": (-0.010, 0.059), "finger_3": (0.051, 0.043)}
    goals = {name: (np.array([rear, *at]), np.array([1, 0, 0])) for name, at in places.items()}
    hand = place_fingertips(hand_of(scene), scene.object, goals).hand
    evaluator = Evaluator(scene.with_changes(hand=hand), algorithm="margin", pins=PINS)
    opened = [0.05 * name.endswith("distal") for name in evaluator.joint_names]  # rad
    start = evaluator.configuration() + opened
    functions, program = PinnedFunctions(evaluator), drake.MathematicalProgram()
    q = program.NewContinuousVariables(9, "q")
    program.AddBoundingBoxConstraint(*evaluator.joint_limits, q)
    program.AddConstraint(lambda x: functions.gaps(x)[:3], np.zeros(3), np.zeros(3), q)
    wanted = 2.0 * Evaluator(evaluator.scene, algorithm="margin").evaluate().margin
    program.AddConstraint(functions.optimum, [wanted], [np.inf], q)
    program.AddQuadraticErrorCost(np.eye(9), start, q)
    found = getattr(drake, name)().Solve(program, start)
    assert found.is_success()
    fresh = Evaluator(evaluator.scene, algorithm="margin")
    assert not fresh.evaluate(start).found
    better = fresh.evaluate(found.GetSolution(q))
    assert better.found
    assert sorted(better.contacts.bodies) == sorted((*TIPS, *4 * ["table"]))
    assert better.margin == pytest.approx(wanted, rel=1e-4)


def test_what_is_no_state_is_nan():
    evaluator = evaluator_of(algorithm="margin")
    outside = evaluator.configuration().copy()
    outside[0] = evaluator.joint_limits[1][0] + 0.01
    nowhere = PinnedFunctions(evaluator, lambda x: None)
    pulled = PinnedFunctions(evaluator, twist=[-0.05, 0.0, 0.0, 0.0, 0.0, 0.0])  # by fingers
    for functions, x, gaps_known in (
        (PinnedFunctions(evaluator), outside, False),
        (nowhere, np.zeros(2), False),
        (pulled, evaluator.configuration(), True),
    ):
        differentiated = drake.InitializeAutoDiff(x)[:, 0]
        for function, known in ((functions.optimum, False), (functions.gaps, gaps_known)):
            gradient = drake.ExtractGradient(function(differentiated)[:, None])
            assert np.isfinite(function(x)).all() == np.isfinite(gradient).all() == known
            assert gradient.shape == (len(function(x)), len(x))
    free = PinnedFunctions(evaluator_of(algorithm="margin", position_limits=False))
    assert free.optimum(outside) == pytest.approx(free.evaluator.pinned(outside).optimum)
    # Optimisers leave a bound by their tolerance.
    outside[0] -= 0.01 - 1e-8
    assert np.isfinite(PinnedFunctions(evaluator).gaps(outside)).all()


def test_functions_are_of_the_motion_that_was_given():
    evaluator, twist = evaluator_of(algorithm="margin"), np.zeros(6)
    functions = PinnedFunctions(evaluator, twist=twist)
    twist[0] = 0.05
    q = evaluator.configuration()
    found = evaluator.pinned(q, None, np.zeros(6)).optimum
    sent = pickle.loads(pickle.dumps(functions))  # noqa: S301 - our own bytes
    for one in (functions, sent):
        assert one.optimum(q) == pytest.approx(found)


def plant_of(T_world_base: np.ndarray, axis: str = "0 -1 0", other: tuple[str, ...] = ()) -> Any:
    """A box and the hand; its fingers bend about an axis, and another model has some bodies."""
    plant = drake.MultibodyPlant(0.0)
    inertia = drake.SpatialInertia.SolidBoxWithMass(1.0, 0.12, 0.16, 0.10)
    plant.AddRigidBody("box", inertia)
    for name in other:
        plant.AddRigidBody(name, plant.AddModelInstance(f"other_{name}"), inertia)
    urdf = (ROOT / "robots/trihand.urdf").read_text(encoding="utf-8").replace("0 -1 0", axis)
    hand = drake.Parser(plant).AddModelsFromString(urdf, "urdf")[0]
    palm = plant.GetFrameByName("palm", hand)
    plant.WeldFrames(plant.world_frame(), palm, drake.RigidTransform(T_world_base))
    plant.Finalize()
    return plant


def test_states_of_a_plant_are_ours():
    evaluator = evaluator_of(algorithm="margin")
    plant = plant_of(hand_of(evaluator.scene).T_world_base)
    states, context = plant_states(evaluator, plant, "box"), plant.CreateDefaultContext()
    rng, (low, high) = np.random.default_rng(0), evaluator.joint_limits
    box = plant.GetBodyByName("box")
    for _ in range(20):
        q = rng.uniform(low, high)
        for name, position in zip(evaluator.joint_names, q, strict=True):
            plant.GetJointByName(name).set_angle(context, position)
        X = drake.RigidTransform(drake.RollPitchYaw(rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))
        plant.SetFreeBodyPose(context, box, X)
        at = states(plant.GetPositions(context))
        assert at is not None
        scene = evaluator.scene_at(*at)
        np.testing.assert_allclose(scene.object.T_world_object, X.GetAsMatrix4(), atol=1e-12)
        for link in hand_of(scene).link_names:
            there = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(link))
            np.testing.assert_allclose(
                hand_of(scene).pose_of(link), there.GetAsMatrix4(), atol=1e-9
            )
    for name, position in hand_of(evaluator.scene).q.items():
        plant.GetJointByName(name).set_angle(context, position)
    plant.SetFreeBodyPose(context, box, drake.RigidTransform(evaluator.scene.object.T_world_object))
    x, functions = plant.GetPositions(context), PinnedFunctions(evaluator, states)
    np.testing.assert_allclose(functions.gaps(x), evaluator.pinned().gaps, atol=1e-12)
    x += 0.005 * rng.normal(size=len(x))  # off the kink
    for function in (functions.gaps, functions.optimum):
        assert_derivatives(function, x)


def test_a_plant_that_is_another():
    evaluator = evaluator_of()
    moved = hand_of(evaluator.scene).T_world_base.copy()
    moved[2, 3] += 0.01
    with pytest.raises(ArgumentError, match=r"'palm' 0.01 m from.*weld the hand's base"):
        plant_states(evaluator, plant_of(moved), "box")
    plant = plant_of(hand_of(evaluator.scene).T_world_base)
    with pytest.raises(ArgumentError, match="crate"):
        plant_states(evaluator, plant, "crate")
    own = hand_of(evaluator.scene)
    straight = evaluator.scene.with_changes(hand=own.with_configuration(np.zeros(9)))
    plant_states(Evaluator(straight), plant, "box")
    with pytest.raises(ArgumentError, match=r"'finger_1_.*all joints as in the scene"):
        plant_states(Evaluator(straight), plant_of(own.T_world_base, axis="0 1 0"), "box")
    other = Evaluator(load_scene(ROOT / "examples/allegro_tumble_box.yaml"))
    with pytest.raises(ArgumentError, match=r"joint_0\.0"):
        plant_states(other, plant, "box")


def test_bodies_that_several_models_have():
    evaluator = evaluator_of()
    plant = plant_of(hand_of(evaluator.scene).T_world_base, other=("palm", "box"))
    with pytest.raises(ArgumentError, match=r"body: 'box'.*multiple model instances"):
        plant_states(evaluator, plant, "box")
    context, X = plant.CreateDefaultContext(), drake.RigidTransform([1.0, 2.0, 3.0])
    box = plant.GetBodyByName("box", plant.GetModelInstanceByName("other_box"))
    plant.SetFreeBodyPose(context, box, X)
    found = plant_states(evaluator, plant, "other_box/box")(plant.GetPositions(context))
    assert found is not None
    np.testing.assert_allclose(found[1], X.GetAsMatrix4())


def test_wrong_variables_and_evaluators():
    evaluator = evaluator_of()
    with pytest.raises(ArgumentError, match=r"9 joint positions.*got 4"):
        PinnedFunctions(evaluator).gaps(np.zeros(4))
    with pytest.raises(ArgumentError, match=r"shape \(1,\)"):
        PinnedFunctions(evaluator, lambda x: (x, None)).gaps(np.array([0.3]))
    with pytest.raises(ArgumentError, match="quaternion"):
        PinnedFunctions(evaluator).gaps(np.zeros(16))
    with pytest.raises(ArgumentError, match="pins"):
        PinnedFunctions(Evaluator(evaluator.scene))
    with pytest.raises(ArgumentError, match="regulari"):
        PinnedFunctions(evaluator_of(regularization=1e-3))
