"""Figures of pinned states as one function of arrays with its Jacobian, for other libraries.

A pose is a (4, 4) matrix with six degrees of freedom. The derivative by its entries is the pullback
of the gradient by the object's twist: its product with every change of a rigid pose is the change
of the figure. So the chain rule holds through any function that returns rigid poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.caching import Derived
from graspless_pin.errors import ArgumentError
from graspless_pin.planning.evaluator import Evaluator
from graspless_pin.planning.pinned_contacts import Derivatives, PinnedState
from graspless_pin.problem.checks import FloatArray, finite_array
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.scene.stated import Motion

__all__ = ["Optimum"]


class Optimum(NamedTuple):
    """Result of a differentiable operator, as arrays of its library with leading axes.

    Examples:
        >>> import numpy as np
        >>> from graspless_pin.interfaces.differentiable import Optimum
        >>> found = Optimum(np.array([0.7, -np.inf]), np.zeros((2, 7)), None)
        >>> margins, gaps, torques = found
        >>> float(margins.max())
        0.7

    Attributes:
        value: (...) the largest margin, N, or the smallest torque, N m, or share. If no torques are
            found it is -inf, or inf for a torque, and its derivatives are zero.
        gaps: (..., P) gaps of the pins, negative where bodies overlap, m.
        torques: (..., L) motor torques; NaN if none are found, with derivatives of zero. None: not
            requested.
    """

    value: Any
    gaps: Any
    torques: Any


class _Sizes(NamedTuple):
    """Sizes and defaults common to all states of an evaluator.

    Attributes:
        inputs: Defaults of the inputs: (a,) positions, (4, 4) pose, (B,) friction and mass.
        gap_count: P.
        torque_names: L names.
        worst: The optimum if there are no torques.
        center: (3,) centre of mass, in the object's frame, m.
    """

    inputs: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
    gap_count: int
    torque_names: tuple[str, ...]
    worst: float
    center: FloatArray


@Derived
def _sizes_of(evaluator: Evaluator) -> _Sizes:
    state = evaluator.pinned(twist=np.zeros(6))  # raises an error for an unsuitable evaluator
    scene = evaluator.scene_at(twist=np.zeros(6))
    problem, obj = scene.problem(), scene.object
    first = [state.bodies.index(body) for body in dict.fromkeys(state.bodies)]
    inputs = (
        evaluator.configuration(), obj.T_world_object, problem.friction[first], np.array(obj.mass)
    )  # fmt: skip
    worst = np.inf if evaluator.algorithm is Algorithm.TORQUE else -np.inf
    return _Sizes(inputs, len(state.gaps), problem.joint_names, worst, obj.center_of_mass)


class Operator:
    """An evaluator's figures of pinned states as one function of arrays.

    Its F figures are the optimum, the P gaps and, if requested, the L torques. Its N inputs are
    (a,) positions, (4, 4) poses, (B,) coefficients of friction and the mass, each with the same
    leading axes. Threads may share it.

    Attributes:
        inputs: Defaults of the inputs.
        size: F.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        given: Sequence[Any],
        twist: ArrayLike | Motion | None,
        *,
        with_torques: bool,
    ) -> None:
        """Set up the operator from the arguments of the libraries' operators.

        Args:
            evaluator: The evaluator.
            given: The inputs; those that are None keep their defaults.
            twist: See `Evaluator.evaluate`.
            with_torques: Whether torques are figures, too.

        Raises:
            ArgumentError: If the evaluator has no pins.
        """
        self._twist: Any = twist
        if not (twist is None or isinstance(twist, Motion)):
            self._twist = finite_array("twist", twist, (*np.shape(twist)[:-1], 6))
        self._evaluator, self._with_torques = evaluator, with_torques
        self._is_given = [value is not None for value in given]
        self._sizes = sizes = _sizes_of(evaluator)
        self.inputs = sizes.inputs
        self.size = 1 + sizes.gap_count + with_torques * len(sizes.torque_names)

    def batch_shape(self, *shapes: tuple[int, ...]) -> tuple[int, ...]:
        """Return the broadcast leading axes of inputs with the given shapes.

        Raises:
            ArgumentError: If an input has a wrong shape, or leading axes do not broadcast.
        """
        names = ("q", "T_world_object", "friction", "mass")
        leading = []
        for name, shape, default in zip(names, shapes, self.inputs, strict=True):
            cut = len(shape) - default.ndim
            if cut < 0 or shape[cut:] != default.shape:
                wanted = ", ".join(["...", *map(str, default.shape)])
                raise ArgumentError(name, f"has the shape {tuple(shape)}; it must be ({wanted})")
            leading.append(shape[:cut])
        if isinstance(self._twist, np.ndarray):
            names, leading = (*names, "twist"), [*leading, self._twist.shape[:-1]]
        try:
            return np.broadcast_shapes(*leading)
        except ValueError:
            each = ", ".join(f"{name} {one}" for name, one in zip(names, leading, strict=True))
            raise ArgumentError(
                "q", f"its leading axes do not fit those of the others: {each}"
            ) from None

    def optimum(self, figures: Any) -> Optimum:
        """Return (..., F) figures as an `Optimum`."""
        last = 1 + self._sizes.gap_count
        torques = figures[..., last:] if self._with_torques else None
        return Optimum(figures[..., 0], figures[..., 1:last], torques)

    def values(self, *inputs: Any) -> FloatArray:
        """Return the (..., F) figures."""
        return self._figures_and_jacobian(inputs, derivatives=False)[0]

    def with_jacobian(self, *inputs: Any) -> tuple[FloatArray, FloatArray]:
        """Return the (..., F) figures and their (..., F, N) derivatives by all inputs in one axis.

        Raises:
            ArgumentError: See `PinnedState.by_optimum`.
        """
        return self._figures_and_jacobian(inputs, derivatives=True)

    def _figures_and_jacobian(
        self, inputs: tuple[Any, ...], *, derivatives: bool
    ) -> tuple[FloatArray, FloatArray]:
        q, T, friction, mass = (np.asarray(value) for value in inputs)
        leading, count = mass.shape, mass.size
        q, friction = (
            value.reshape(count, default.size).astype(np.float64)
            for value, default in ((q, self.inputs[0]), (friction, self.inputs[2]))
        )
        poses = T.reshape(count, 4, 4).astype(np.float64)
        if T.dtype != np.float64:  # orthonormal only to the precision of its own dtype
            R = poses[:, :3, :3]
            poses[:, :3, :3] = 1.5 * R - 0.5 * R @ R.swapaxes(1, 2) @ R
        twists = self._twist
        if isinstance(twists, np.ndarray):
            twists = np.broadcast_to(twists, (*leading, 6)).reshape(count, 6)
        with_q, with_pose, with_friction, with_mass = self._is_given
        width = sum(default.size for default in self.inputs) if derivatives else 0
        figures, jacobian = np.empty((count, self.size)), np.zeros((count, self.size, width))
        for k in range(count):
            try:
                state = self._evaluator.pinned(
                    q[k] if with_q else None,
                    poses[k] if with_pose else None,
                    twists[k] if isinstance(twists, np.ndarray) else twists,
                    friction=friction[k] if with_friction else None,
                    mass=float(mass.flat[k]) if with_mass else None,
                )
            except ArgumentError as error:
                name = f"{error.argument}[{k}]" if leading else error.argument
                raise ArgumentError(name, str(error.args[1])) from error
            figures[k] = self._state_figures(state)
            if derivatives:
                self._write_jacobian(jacobian[k], state, poses[k, :3, :3])
        return figures.reshape(*leading, self.size), jacobian.reshape(*leading, self.size, width)

    def _state_figures(self, state: PinnedState) -> FloatArray:
        is_found, sizes = state.evaluation.found, self._sizes
        parts = [[state.optimum if is_found else sizes.worst], state.gaps]
        if self._with_torques:
            torques = state.evaluation.torques_by_joint if is_found else {}
            parts.append(
                [torques.get(name, 0.0 if is_found else np.nan) for name in sizes.torque_names]
            )
        return np.concatenate(parts)

    def _write_jacobian(self, jacobian: FloatArray, state: PinnedState, R: FloatArray) -> None:
        """Write the (F, N) derivatives of a state; they stay zero for torques not found."""
        last, sizes = 1 + self._sizes.gap_count, self._sizes
        jacobian[1:last] = self._input_derivatives(state.by_gaps, R)
        if not state.evaluation.found:
            return
        jacobian[0] = self._input_derivatives(state.by_optimum, R)
        if self._with_torques:
            places = [sizes.torque_names.index(name) for name in state.evaluation.joint_names]
            jacobian[last:][places] = self._input_derivatives(state.by_torques, R)

    def _input_derivatives(self, by: Derivatives, R: FloatArray) -> FloatArray:
        """(..., N) derivatives by the inputs, with the pose as a matrix of 16 entries."""
        linear, angular = by.pose[..., :3], by.pose[..., 3:]
        # By a rotation about the origin of the object's frame, which moves the centre of mass, too.
        turn = angular + np.cross(R @ self._sizes.center, linear)
        pose = np.zeros((*linear.shape[:-1], 4, 4))
        pose[..., :3, :3] = 0.5 * np.cross(turn[..., None, :], np.eye(3)).swapaxes(-1, -2) @ R
        pose[..., :3, 3] = linear
        return np.concatenate(
            [by.q, pose.reshape(*linear.shape[:-1], 16), by.friction, by.mass], axis=-1
        )
