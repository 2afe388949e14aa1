"""The operator of PyTorch: its gradients, batches, and what its transforms make of it."""

# pyright: reportMissingImports=false

from typing import Any

import numpy as np
import pytest
from pinned_steps import Steps, generators, page_example

pytest.importorskip("torch", reason="needs pip install 'graspless-pin[torch]'")
import torch

from graspless_pin.interfaces.torch import optimum


def inputs_of(case: Steps, *steps: float) -> list[Any]:
    """Tensors of positions, screws, coefficients and masses that gradients are asked for."""
    return [torch.tensor(one, requires_grad=True) for one in case.rows(*steps)]


def figures_of(case: Steps, **options: Any) -> Any:
    start = torch.tensor(np.array(case.evaluator.scene.object.T_world_object))
    ways = torch.tensor(generators())

    def figures(q: Any, screw: Any, friction: Any, mass: Any) -> Any:
        T = torch.linalg.matrix_exp(torch.tensordot(screw, ways, 1)) @ start
        found = optimum(case.evaluator, q, T, friction, mass, **options)
        return tuple(one for one in found if one is not None)

    return figures


@pytest.mark.parametrize(
    ("name", "algorithm", "with_torques"),
    [("trihand_push_box", "margin", True), ("paper/cuboid_at_rest", "torque", False)],
)
def test_gradients_pass_the_check_of_torch(name, algorithm, with_torques):
    case = Steps.of(name, 0, algorithm=algorithm)
    figures = figures_of(case, with_torques=with_torques)
    inputs = inputs_of(case, 0.0, 1e-4)
    assert torch.autograd.gradcheck(
        figures, inputs, eps=1e-6, atol=1e-4, fast_mode=True, check_undefined_grad=False
    )


def test_a_batch_is_its_states():
    case = Steps.of("trihand_push_box", 0)
    figures, steps = figures_of(case), (0.0, 1e-3, 2e-3)
    inputs = inputs_of(case, *steps)
    value, gaps = figures(*inputs)
    (value.sum() + gaps.sum()).backward()
    for number, step in enumerate(steps):
        alone = inputs_of(case, step)
        one = figures(*[tensor[0] for tensor in alone])
        assert one[0].shape == () and one[1].shape == gaps.shape[1:]
        torch.testing.assert_close(value[number], one[0], rtol=1e-6, atol=1e-9)
        (one[0] + one[1].sum()).backward()
        for whole, part in zip(inputs, alone, strict=True):
            torch.testing.assert_close(whole.grad[number], part.grad[0], rtol=1e-5, atol=1e-6)


def test_leading_axes_are_broadcast():
    case = Steps.of("trihand_push_box", 0)
    q, _, friction, mass = inputs_of(case, 0.0)
    masses = (mass.detach() * torch.tensor([0.9, 1.0, 1.1])).requires_grad_()
    value, gaps, torques = optimum(case.evaluator, q[0], None, friction[0], masses)
    assert value.shape == (3,) and gaps.shape[0] == 3 and torques is None
    value.sum().backward()

    def value_at(mass: Any) -> Any:
        return optimum(case.evaluator, q[0], None, friction[0], mass).value

    each = [torch.func.grad(value_at)(mass) for mass in masses.detach()]
    torch.testing.assert_close(masses.grad, torch.stack(each), rtol=1e-5, atol=1e-8)


def test_functions_of_torch_transform_it():
    case = Steps.of("trihand_push_box", 0)
    figures, inputs = figures_of(case), [one.detach() for one in inputs_of(case, 0.0, 1e-3)]
    mapped = torch.func.vmap(torch.func.jacrev(figures, (0, 3)))(*inputs)
    for number in range(2):
        one = [each[number].clone().requires_grad_() for each in inputs]
        value, gaps = figures(*one)
        value.backward(retain_graph=True)
        torch.testing.assert_close(mapped[0][0][number], one[0].grad, rtol=1e-5, atol=1e-6)
        torch.testing.assert_close(mapped[0][1][number], one[3].grad, rtol=1e-5, atol=1e-6)
        assert mapped[1][0].shape == (2, *gaps.shape, len(one[0]))
    with torch.no_grad():
        torch.testing.assert_close(figures(*inputs)[0][0], value_of(figures, inputs, 0))
        twice = [torch.stack([one, one, one]) for one in inputs]
        found = torch.func.vmap(torch.func.vmap(figures))(*twice)[0]
        torch.testing.assert_close(found, figures(*twice)[0])


def value_of(figures: Any, inputs: list[Any], number: int) -> Any:
    return figures(*[one[number] for one in inputs])[0]


def test_a_sum_over_states_passes_by_those_without_torques():
    case = Steps.of("trihand_push_box", 0)
    mass = torch.tensor([0.3, 1e3], dtype=torch.float64, requires_grad=True)
    value, gaps, _ = optimum(case.evaluator, None, None, None, mass)
    assert value[1] == -torch.inf and torch.isfinite(gaps).all()
    (by_mass,) = torch.autograd.grad(torch.where(value.isfinite(), value, -1.0).sum(), mass)
    assert by_mass[0] != 0.0 and by_mass[1] == 0.0


def test_single_precision_goes_in_and_comes_out():
    case = Steps.of("trihand_push_box", 0)
    inputs = inputs_of(case, 0.0)
    expected = optimum(case.evaluator, inputs[0], None, inputs[2], inputs[3])
    rough = [one.detach().float().requires_grad_() for one in inputs]
    found = optimum(case.evaluator, rough[0], None, rough[2], rough[3])
    assert found.value.dtype == torch.float32
    torch.testing.assert_close(found.value.double(), expected.value, rtol=1e-4, atol=1e-5)
    found.value.sum().backward()
    assert rough[0].grad.dtype == torch.float32 and rough[0].grad.any()


def test_integers_go_in_and_no_integers_come_out():
    case = Steps.of("trihand_push_box", 0)
    found, expected = [optimum(case.evaluator, mass=torch.tensor(one)) for one in (1, 1.0)]
    torch.testing.assert_close(found.value, expected.value)
    torch.testing.assert_close(found.gaps, expected.gaps)


def test_there_are_no_second_derivatives():
    case = Steps.of("trihand_push_box", 0)
    q, *_ = inputs_of(case, 0.0)
    worth = (optimum(case.evaluator, q).value ** 2).sum()
    (first,) = torch.autograd.grad(worth, q, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        first.sum().backward()


def test_the_example_of_the_page_runs(capsys):
    page_example("graspless_pin.interfaces.torch")
    assert capsys.readouterr().out
