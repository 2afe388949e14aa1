"""What operators of PyTorch and JAX share: figures of pinned states and their Jacobian."""

import sys
from importlib import import_module

import numpy as np
import pytest
from pinned_steps import Steps, generators
from scipy.linalg import expm

from graspless_pin import Evaluator
from graspless_pin.errors import ArgumentError
from graspless_pin.interfaces.differentiable import Operator

ALL = (0, 0, 0, 0)
STEP = 1e-6


def column(case: Steps) -> np.ndarray:
    """(N,) how all inputs change along the way."""
    (q, _, friction, mass), poses = case.way, [case.at(step)[1] for step in (STEP, -STEP)]
    return np.hstack([q, ((poses[0] - poses[1]) / (2.0 * STEP)).ravel(), friction, mass])


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    ("name", "algorithm"),
    [
        ("trihand_push_box", "margin"),
        ("trihand_push_box", "torque"),
        ("allegro_box_on_slope", "margin"),
        ("paper/cuboid_at_rest", "torque"),
    ],
)
def test_derivatives_are_slopes_of_solves_of_changed_scenes(name, algorithm, seed):
    case = Steps.of(name, seed, algorithm=algorithm)
    operator = Operator(case.evaluator, ALL, None, with_torques=True)
    figures, jacobian = operator.with_jacobian(*case.at(0.0))
    np.testing.assert_allclose(operator.values(*case.at(0.0)), figures, rtol=1e-6, atol=1e-9)
    q, pose, friction, mass = case.at(0.0)
    state = case.evaluator.pinned(q, pose, friction=friction, mass=float(mass))
    mode = state.evaluation.solution.mode
    each = state.by_optimum, state.by_gaps, state.by_torques
    unique = np.hstack([by.unique.all(axis=-1) for by in each])
    assert unique[: 1 + len(state.gaps)].all()
    middle, high, low = (case.solved(step, mode) for step in (0.0, STEP, -STEP))
    np.testing.assert_allclose(figures[unique], middle[unique], rtol=1e-6, atol=1e-9)
    off = np.abs(jacobian @ column(case) - (high - low) / (2.0 * STEP))
    assert (off <= 1e-3 * np.abs(jacobian).max(axis=1) + 1e-6)[unique].all()


def test_derivatives_by_a_pose_are_those_of_its_motions():
    """Of each of six motions of its own, about the world's origin."""
    case = Steps.of("trihand_push_box", 3)
    q, pose, *others = case.at(0.0)
    operator = Operator(case.evaluator, (0, 0, None, None), None, with_torques=False)
    _, jacobian = operator.with_jacobian(q, pose, *others)
    by_pose = jacobian[:, len(q) : len(q) + 16]
    for one in generators():
        ends = [operator.values(q, expm(s * one) @ pose, *others) for s in (STEP, -STEP)]
        slope = (ends[0] - ends[1]) / (2.0 * STEP)
        found = by_pose @ (one @ pose).ravel()
        np.testing.assert_allclose(found, slope, atol=1e-4 * np.abs(slope).max() + 1e-6)
    # Nothing but motions: a stretch along the axes of the object has no part in it.
    stretch = np.zeros((4, 4))
    stretch[:3, :3] = pose[:3, :3] @ np.diag([1.0, 2.0, 3.0])
    np.testing.assert_allclose(by_pose @ stretch.ravel(), 0.0, atol=1e-9)


def test_leading_axes_are_states():
    case = Steps.of("trihand_push_box", 0)
    inputs = [case.at(step) for step in (0.0, 1e-3, 2e-3, 3e-3)]
    together = [np.array(one).reshape(2, 2, *one[0].shape) for one in zip(*inputs, strict=True)]
    operator = Operator(case.evaluator, ALL, None, with_torques=False)
    figures, jacobian = operator.with_jacobian(*together)
    assert figures.shape == (2, 2, operator.size) and jacobian.shape[:-1] == figures.shape
    for number, one in enumerate(inputs):
        place = divmod(number, 2)
        alone = operator.with_jacobian(*one)
        np.testing.assert_allclose(figures[place], alone[0], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(jacobian[place], alone[1], rtol=1e-6, atol=1e-6)


def test_each_state_has_its_twist():
    case = Steps.of("trihand_slide_and_pivot", 0)
    scene = case.evaluator.scene
    push = np.concatenate([0.05 * scene.object.T_world_object[:3, 0], np.zeros(3)])
    twists = np.array([np.zeros(6), push, -push])
    operator = Operator(case.evaluator, (None,) * 4, twists, with_torques=False)
    given = [np.broadcast_to(one, (3, *one.shape)) for one in operator.inputs]
    alone = [case.evaluator.evaluate(None, None, twist).margin for twist in twists]
    assert len({round(one, 6) for one in alone}) == 3
    np.testing.assert_allclose(operator.values(*given)[:, 0], alone, rtol=1e-6)
    shapes = [one.shape for one in operator.inputs]
    assert operator.batch_shape(*shapes) == (3,)
    with pytest.raises(ArgumentError, match=r"leading axes .*twist \(3,\)"):
        operator.batch_shape((2, *shapes[0]), *shapes[1:])
    with pytest.raises(ArgumentError, match="twist"):
        Operator(case.evaluator, (None,) * 4, [0.0, 1.0], with_torques=False)


def test_no_states_are_no_error():
    case = Steps.of("trihand_push_box", 0)
    operator = Operator(case.evaluator, ALL, None, with_torques=False)
    none = [np.zeros((0, *one.shape)) for one in operator.inputs]
    figures, jacobian = operator.with_jacobian(*none)
    assert figures.shape == (0, operator.size) and jacobian.shape[:2] == figures.shape


@pytest.mark.parametrize(("algorithm", "worst"), [("margin", -np.inf), ("torque", np.inf)])
def test_a_state_without_torques_has_gaps_and_no_slope_of_the_optimum(algorithm, worst):
    case = Steps.of("trihand_push_box", 0, algorithm=algorithm)
    operator = Operator(case.evaluator, ALL, None, with_torques=True)
    q, pose, friction, _ = case.at(0.0)
    figures, jacobian = operator.with_jacobian(q, pose, friction, np.array(1e3))
    last = 1 + len(case.evaluator.pinned().gaps)
    assert figures[0] == worst and np.isnan(figures[last:]).all()
    assert not jacobian[0].any() and not jacobian[last:].any()
    assert np.isfinite(figures[1:last]).all() and jacobian[1:last].any(axis=1).all()


def test_poses_in_single_precision_are_rigid_enough():
    case = Steps.of("trihand_push_box", 0)
    q, pose, *others = case.at(0.0)
    operator = Operator(case.evaluator, ALL, None, with_torques=False)
    rough = pose.astype(np.float32)
    rough[:3, :3] *= np.float32(1.0 + 2e-6)
    found = operator.values(q, rough, *others)
    np.testing.assert_allclose(found, operator.values(q, pose, *others), atol=1e-5)
    with pytest.raises(ArgumentError, match="T_world_object"):
        operator.values(q, rough.astype(np.float64), *others)


def test_what_cannot_be_evaluated_is_named():
    case = Steps.of("trihand_push_box", 0)
    operator = Operator(case.evaluator, ALL, None, with_torques=False)
    shapes = [one.shape for one in operator.inputs]
    with pytest.raises(ArgumentError, match=r"q: has the shape \(8,\); it must be \(\.\.\., 9\)"):
        operator.batch_shape((8,), *shapes[1:])
    with pytest.raises(ArgumentError, match=r"leading axes .*q \(2,\), .*mass \(3,\)"):
        operator.batch_shape((2, 9), *shapes[1:3], (3,))
    assert operator.batch_shape((2, 1, 9), *shapes[1:3], (3,)) == (2, 3)
    inputs = [np.array([one, one]) for one in case.at(0.0)]
    inputs[0][1, 2] = 9.0
    with pytest.raises(ArgumentError, match=r"q\[1\]: is not valid"):
        operator.values(*inputs)
    with pytest.raises(ArgumentError, match="pins: this evaluator has none"):
        Operator(Evaluator(case.evaluator.scene), ALL, None, with_torques=False)


@pytest.mark.parametrize(
    ("name", "library"),
    [("torch", "torch"), ("jax", "jax"), ("drake", "pydrake"), ("ompl", "ompl")],
)
def test_what_is_said_without_the_library(name, library, monkeypatch):
    module = f"graspless_pin.interfaces.{name}"
    for one in [library, *(one for one in sys.modules if one.startswith(f"{library}."))]:
        monkeypatch.setitem(sys.modules, one, None)
    monkeypatch.delitem(sys.modules, module, raising=False)
    with pytest.raises(ImportError, match=rf"pip install 'graspless-pin\[{name}\]'"):
        import_module(module)
