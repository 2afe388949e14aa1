"""The optimum of pinned states as a differentiable operator of PyTorch.

Needs the extra ``torch``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from numpy.typing import ArrayLike

from graspless_pin.errors import optional_import
from graspless_pin.interfaces.differentiable import Operator, Optimum
from graspless_pin.planning.evaluator import Evaluator
from graspless_pin.scene.stated import Motion

with optional_import("this interface requires PyTorch", "torch", ImportError):
    torch: Any = import_module("torch")  # by name: type checkers take this file for it

__all__ = ["optimum"]


def optimum(
    evaluator: Evaluator,
    q: Any = None,
    T_world_object: Any = None,
    friction: Any = None,
    mass: Any = None,
    *,
    twist: ArrayLike | Motion | None = None,
    with_torques: bool = False,
) -> Optimum:
    """Return the optimum, the gaps and the torques of pinned states, for `torch.autograd`.

    Leading axes are states, and those of all arguments are broadcast. The results are tensors of
    the dtype and device of the first tensor among the arguments; if it has integers, or no argument
    is a tensor, of PyTorch's default dtype. Computation is in double precision, on the CPU.
    Derivatives are those of `Evaluator.pinned`: of the optimum in its mode, and at a kink one of
    several one-sided ones, see `PinnedState.by_optimum`. There are no second derivatives.

    Args:
        evaluator: With pins, and without regularisation.
        q: (..., a) positions of `Evaluator.joint_names` within their limits, rad or m; None: as in
            the scene, likewise for the next arguments.
        T_world_object: (..., 4, 4) poses, m. Their gradient is that of rigid motions only: compute
            poses by functions that keep them rigid, such as ``T @ torch.linalg.matrix_exp(...)``.
        friction: (..., B) coefficients of the pinned bodies, each once in the order of
            `PinnedState.bodies`.
        mass: (...) masses of the object, kg.
        twist: (6,) or (..., 6) twists of the object, or a `Motion`: see `Evaluator.evaluate`. They
            are constants.
        with_torques: Whether to return torques, too: their derivatives double the time.

    Raises:
        ArgumentError: As for `Evaluator.pinned`; if a shape is wrong; or, if derivatives are
            needed, as for `PinnedState.by_optimum`.

    Examples:
        >>> import torch
        >>> from graspless_pin import Evaluator, load_scene
        >>> from graspless_pin.interfaces.torch import optimum
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> pins = [*((f"finger_{k}_tip", "object") for k in (1, 2, 3)), ("object", "table")]
        >>> evaluator = Evaluator(scene, pins=pins)
        >>> q = torch.tensor(evaluator.configuration()).expand(5, -1).clone().requires_grad_()
        >>> mass = torch.linspace(0.2, 0.6, 5, dtype=q.dtype, requires_grad=True)  # kg
        >>> margins, gaps, _ = optimum(evaluator, q, mass=mass)
        >>> (margins.min() - 1e3 * (gaps**2).sum()).backward()
        >>> margins.shape, gaps.shape, q.grad.shape, mass.grad.shape
        (torch.Size([5]), torch.Size([5, 7]), torch.Size([5, 9]), torch.Size([5]))
    """
    given = (q, T_world_object, friction, mass)
    operator = Operator(evaluator, given, twist, with_torques=with_torques)
    like = next((one for one in given if isinstance(one, torch.Tensor)), torch.zeros(0))
    dtype = like.dtype if like.is_floating_point() else torch.get_default_dtype()
    inputs = [
        torch.as_tensor(own.copy() if one is None else one, dtype=dtype, device=like.device)
        for one, own in zip(given, operator.inputs, strict=True)
    ]
    leading = operator.batch_shape(*[tuple(one.shape) for one in inputs])
    inputs = [
        one.expand((*leading, *own.shape)) for one, own in zip(inputs, operator.inputs, strict=True)
    ]
    needed = torch.is_grad_enabled() and any(one.requires_grad for one in inputs)
    figures, _ = _Figures.apply(operator, needed, *inputs)
    return operator.optimum(figures)


class _Figures(torch.autograd.Function):
    """An operator's figures and its Jacobian, which is saved for the backward pass."""

    @staticmethod
    def forward(operator: Operator, needed: bool, *inputs: Any) -> Any:
        """Return (..., F) figures and, if needed, (..., F, N) their derivatives."""
        arrays = [array.detach().cpu().numpy() for array in inputs]
        results = operator.with_jacobian(*arrays) if needed else (operator.values(*arrays), ())
        return tuple(inputs[0].new_tensor(array) for array in results)

    @staticmethod
    def setup_context(ctx: Any, inputs: Any, output: Any) -> None:
        """Save the Jacobian."""
        ctx.operator = inputs[0]
        ctx.save_for_backward(output[1])
        ctx.mark_non_differentiable(output[1])

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, by_figures: Any, _: Any) -> Any:
        """Return the gradients by the inputs."""
        (jacobian,) = ctx.saved_tensors
        row = torch.einsum("...f,...fn->...n", by_figures, jacobian)
        inputs = ctx.operator.inputs
        parts = row.split([own.size for own in inputs], dim=-1)
        each = zip(parts, inputs, strict=True)
        return None, None, *(part.reshape((*row.shape[:-1], *own.shape)) for part, own in each)

    @staticmethod
    def vmap(info: Any, in_dims: Any, operator: Operator, needed: bool, *inputs: Any) -> Any:
        """Return the figures with one more leading axis."""
        mapped = [
            one.expand((info.batch_size, *one.shape)) if axis is None else one.movedim(axis, 0)
            for one, axis in zip(inputs, in_dims[2:], strict=True)
        ]
        return _Figures.apply(operator, needed, *mapped), (0, 0 if needed else None)
