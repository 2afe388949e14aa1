"""The operator of JAX: its derivatives, and what its transforms make of it."""

# pyright: reportMissingImports=false

from typing import Any

import numpy as np
import pytest
from pinned_steps import Steps, generators

pytest.importorskip("jax", reason="needs pip install 'graspless-pin[jax]'")
import jax
import jax.numpy as jnp
from jax.test_util import check_grads

from graspless_pin.interfaces.jax import optimum


@pytest.fixture(autouse=True)
def double_precision():
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - JAX's own
    yield
    jax.config.update("jax_enable_x64", False)  # noqa: FBT003 - JAX's own


def inputs_of(case: Steps, *steps: float) -> list[Any]:
    return [jnp.asarray(one) for one in case.rows(*steps)]


def figures_of(case: Steps, **options: Any) -> Any:
    start, ways = jnp.asarray(case.evaluator.scene.object.T_world_object), jnp.asarray(generators())

    def figures(q: Any, screw: Any, friction: Any, mass: Any) -> Any:
        turn, one = jnp.tensordot(screw, ways, 1), jnp.eye(4)
        T = one  # the exponential's series: turns are small
        for number in range(6, 0, -1):
            T = one + turn @ T / number
        found = optimum(case.evaluator, q, T @ start, friction, mass, **options)
        return tuple(one for one in found if one is not None)

    return figures


@pytest.mark.parametrize(
    ("name", "algorithm", "with_torques"),
    [("trihand_push_box", "margin", True), ("paper/cuboid_at_rest", "torque", False)],
)
def test_derivatives_pass_the_check_of_jax(name, algorithm, with_torques):
    case = Steps.of(name, 0, algorithm=algorithm)
    figures = jax.jit(figures_of(case, with_torques=with_torques))
    check_grads(figures, inputs_of(case, 0.0, 1e-4), 1, eps=1e-6, atol=1e-4, rtol=1e-3)


def test_transforms_agree():
    case = Steps.of("trihand_push_box", 0)
    figures, inputs = figures_of(case), inputs_of(case, 0.0, 1e-3)
    value = jax.jit(figures)(*inputs)[0]
    np.testing.assert_allclose(jax.vmap(figures)(*inputs)[0], value, rtol=1e-6, atol=1e-9)
    mapped = jax.jit(jax.vmap(jax.grad(lambda *one: figures(*one)[0], (0, 3))))(*inputs)
    summed = jax.grad(lambda *all_of: figures(*all_of)[0].sum(), (0, 3))(*inputs)
    alone = [one[1] for one in inputs]
    forward = jax.jacfwd(lambda *one: figures(*one)[0], (0, 3))(*alone)
    for each, other, single in zip(mapped, summed, forward, strict=True):
        np.testing.assert_allclose(each, other, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(each[1], single, rtol=1e-5, atol=1e-6)
    # Some inputs mapped over, others shared.
    masses = alone[3] * jnp.array([0.9, 1.0, 1.1])
    shared = jax.vmap(lambda mass: figures(*alone[:3], mass)[0])(masses)
    each = [figures(*alone[:3], mass)[0] for mass in masses]
    np.testing.assert_allclose(shared, jnp.array(each), rtol=1e-6, atol=1e-9)


def test_no_states_have_no_derivatives():
    case = Steps.of("trihand_push_box", 0)
    found = jax.grad(lambda q: optimum(case.evaluator, q).value.sum())(jnp.zeros((0, 9)))
    assert found.shape == (0, 9)


def test_a_sum_over_states_passes_by_those_without_torques():
    case = Steps.of("trihand_push_box", 0)

    def worth(mass: Any) -> Any:
        value = optimum(case.evaluator, None, None, None, mass).value
        return jnp.where(jnp.isfinite(value), value, -1.0).sum()

    by_mass = jax.jit(jax.grad(worth))(jnp.array([0.3, 1e3]))
    assert by_mass[0] != 0.0 and by_mass[1] == 0.0
    assert optimum(case.evaluator, mass=1e3).value == -jnp.inf


def test_single_precision_is_the_default_of_jax():
    case = Steps.of("trihand_push_box", 0)
    q = case.at(0.0)[0]
    expected = optimum(case.evaluator, q).value
    jax.config.update("jax_enable_x64", False)  # noqa: FBT003 - JAX's own
    found = optimum(case.evaluator, q).value
    assert found.dtype == jnp.float32
    assert jax.grad(lambda one: optimum(case.evaluator, one).value)(jnp.asarray(q)).any()
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)


def test_there_are_no_second_derivatives():
    case = Steps.of("trihand_push_box", 0)
    with pytest.raises(ValueError, match="do not support JVP"):
        jax.hessian(lambda mass: optimum(case.evaluator, mass=mass).value)(0.3)
