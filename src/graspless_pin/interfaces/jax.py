"""The optimum of pinned states as a differentiable operator of JAX.

Needs the extra ``jax``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import optional_import
from graspless_pin.interfaces.differentiable import Operator, Optimum
from graspless_pin.planning.evaluator import Evaluator
from graspless_pin.scene.stated import Motion

with optional_import("this interface requires JAX", "jax", ImportError):
    jax: Any = import_module("jax")  # by name: type checkers take this file for it
    jnp: Any = import_module("jax.numpy")

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
    """Return the optimum, the gaps and the torques of pinned states, for JAX to transform.

    It works under ``jit``, ``vmap``, ``grad``, ``jacfwd`` and ``jacrev``. Leading axes are states,
    and those of all arguments are broadcast. Computation is in double precision, on the host;
    without ``jax_enable_x64`` inputs and results are in single precision. Derivatives are those of
    `Evaluator.pinned`: of the optimum in its mode, and at a kink one of several one-sided ones, see
    `PinnedState.by_optimum`. There are no second derivatives.

    Args:
        evaluator: With pins, and without regularisation.
        q: (..., a) positions of `Evaluator.joint_names` within their limits, rad or m; None: as in
            the scene, likewise for the next arguments.
        T_world_object: (..., 4, 4) poses, m. Their gradient is that of rigid motions only: compute
            poses by functions that keep them rigid, such as ``T @ jax.scipy.linalg.expm(...)``.
        friction: (..., B) coefficients of the pinned bodies, each once in the order of
            `PinnedState.bodies`.
        mass: (...) masses of the object, kg.
        twist: (6,) or (..., 6) twists of the object, not traced by JAX, or a `Motion`: see
            `Evaluator.evaluate`. They are constants.
        with_torques: Whether to return torques, too: their derivatives double the time.

    Raises:
        ArgumentError: If the evaluator has no pins, or a shape is wrong. Any other error of a state
            is raised as an error of JAX.

    Examples:
        >>> import jax
        >>> import numpy as np
        >>> from graspless_pin import Evaluator, load_scene
        >>> from graspless_pin.interfaces.jax import optimum
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> pins = [*((f"finger_{k}_tip", "object") for k in (1, 2, 3)), ("object", "table")]
        >>> evaluator = Evaluator(scene, pins=pins)
        >>> def worth(q, mass):
        ...     margins, gaps, _ = optimum(evaluator, q, mass=mass)
        ...     return margins.min() - 1e3 * (gaps**2).sum()
        >>> q = np.tile(evaluator.configuration(), (5, 1))
        >>> by_q, by_mass = jax.jit(jax.grad(worth, (0, 1)))(q, np.linspace(0.2, 0.6, 5))
        >>> by_q.shape, by_mass.shape
        ((5, 9), (5,))
    """
    given = (q, T_world_object, friction, mass)
    operator = Operator(evaluator, given, twist, with_torques=with_torques)
    inputs = [
        jnp.asarray(default if value is None else value, dtype=jnp.result_type(float))
        for value, default in zip(given, operator.inputs, strict=True)
    ]
    leading = operator.batch_shape(*[value.shape for value in inputs])
    return operator.optimum(
        _host_figures(operator)(
            *[
                jnp.broadcast_to(value, (*leading, *default.shape))
                for value, default in zip(inputs, operator.inputs, strict=True)
            ]
        )
    )


def _host_figures(operator: Operator) -> Any:
    """Return the function from inputs to (..., F) figures, which JAX calls on the host."""
    size = operator.size
    width = sum(own.size for own in operator.inputs)

    def call_on_host(function: Any, inputs: Any, *shapes: tuple[int, ...]) -> Any:
        mass = inputs[-1]
        results = [jax.ShapeDtypeStruct((*mass.shape, *one), mass.dtype) for one in shapes]

        def on_host(*arrays: Any) -> Any:
            results = function(*[np.asarray(array) for array in arrays])
            return [array.astype(mass.dtype) for array in results]

        return jax.pure_callback(on_host, results, *inputs, vmap_method="broadcast_all")

    @jax.custom_jvp
    def figures(*inputs: Any) -> Any:
        return call_on_host(lambda *arrays: [operator.values(*arrays)], inputs, (size,))[0]

    @figures.defjvp
    def _(inputs: Any, changes: Any) -> Any:
        found, jacobian = call_on_host(operator.with_jacobian, inputs, (size,), (size, width))
        leading, owns = inputs[-1].shape, operator.inputs
        rows = [one.reshape(*leading, own.size) for one, own in zip(changes, owns, strict=True)]
        change = jnp.concatenate(rows, axis=-1)
        return found, jnp.einsum("...fn,...n->...f", jacobian, change)

    return figures
