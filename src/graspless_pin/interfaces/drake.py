"""Gaps, optima and torques for a ``MathematicalProgram`` of Drake, and states of its plants.

Needs the extra ``drake``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.caching import Bounded
from graspless_pin.errors import ArgumentError, optional_import
from graspless_pin.planning.evaluator import Evaluator
from graspless_pin.planning.pinned_contacts import Derivatives, PinnedState
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.stated import Motion

with optional_import("this interface requires Drake", "drake", ImportError):
    # By name, as what their stubs say of arrays is not what numpy's say.
    _autodiff: Any = import_module("pydrake.autodiffutils")
    _eigen: Any = import_module("pydrake.common.eigen_geometry")
    _math: Any = import_module("pydrake.math")

__all__ = ["PinnedFunctions", "plant_states"]

ToState = Callable[[Any], tuple[Any, Any] | None]
"""Function from variables to (a,) joint positions and a pose (4, 4) or ``RigidTransform``; either
may be None: as in the scene. Both consist of floats or ``AutoDiffXd``, as the variables do."""

_MOST_STATES = 256
_BEYOND_BOUND = 1e-6  # rad or m: tolerance of joint limits, as optimisers violate bounds slightly
_LINK_OFF = 1e-6  # tolerance of link poses: m, and of the entries of rotations


class PinnedFunctions:
    """States with pinned contacts as functions that Drake evaluates, with their gradients.

    Each function takes an array of variables, floats or ``AutoDiffXd``, and returns an array, for
    ``AddConstraint`` and, by an entry of it, ``AddCost``. A state is solved once for all functions.
    If there are no torques, optimum and torques are NaN; if there is no such state, the gaps are
    NaN, too. So are their derivatives: SNOPT, IPOPT and NLopt take a shorter step then. See
    `Evaluator.pinned`.

    Attributes:
        evaluator: The evaluator of the states.

    Examples:
        A fingertip is brought down to the box, and the others stay where they are:

        >>> import numpy as np
        >>> from pydrake.solvers import MathematicalProgram, SnoptSolver
        >>> from graspless_pin import Evaluator, load_scene
        >>> from graspless_pin.interfaces.drake import PinnedFunctions
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> pins = [*((f"finger_{k}_tip", "object") for k in (1, 2, 3)), ("object", "table")]
        >>> evaluator = Evaluator(scene, pins=pins)
        >>> functions, program = PinnedFunctions(evaluator), MathematicalProgram()
        >>> q = program.NewContinuousVariables(len(evaluator.joint_names), "q")
        >>> bounds = program.AddBoundingBoxConstraint(*evaluator.joint_limits, q)
        >>> shut = program.AddConstraint(functions.gaps, np.zeros(7), np.zeros(7), q)
        >>> opened = evaluator.configuration({"finger_1_distal": 0.85})  # rad
        >>> near = program.AddQuadraticErrorCost(np.eye(9), opened, q)
        >>> found = SnoptSolver().Solve(program, opened)
        >>> found.is_success(), bool(abs(functions.gaps(found.GetSolution(q))).max() < 1e-6)
        (True, True)
    """

    def __init__(
        self,
        evaluator: Evaluator,
        to_state: ToState | None = None,
        *,
        twist: ArrayLike | Motion | None = None,
    ) -> None:
        """Set up the functions from an evaluator and a map from variables to its states.

        Args:
            evaluator: Has pins, and no regularisation.
            to_state: Function from variables to (q, T_world_object), or to None if there is no such
                state. None: the variables are the positions of `Evaluator.joint_names`, followed
                by, if there are seven more, the object's pose as in Drake's floating bodies: a
                quaternion w, x, y, z of any length, and the position, m.
            twist: See `Evaluator.evaluate`; the motion is the same in all states.

        Raises:
            ArgumentError: As for `Evaluator.pinned` and `PinnedState.by_optimum` of the scene's own
                state.
        """
        first, scene = evaluator.pinned(None, None, twist), evaluator.scene
        if first.evaluation.found:
            _ = first.by_optimum  # raises an error here, not in a program
        self.evaluator = evaluator
        self._to_state, self._twist = to_state or self._joints_and_pose, copy(twist)
        self._center = scene.object.center_of_mass
        self._gap_count = len(first.gaps)
        self._torque_count = 0 if scene.hand is None else len(scene.hand.actuated_joint_names)
        self._states: dict[bytes, PinnedState | None] = Bounded(_MOST_STATES)

    def gaps(self, variables: Any) -> Any:
        """Return the (P,) gaps of the pins, m: see `PinnedState.gaps`."""
        return self._with_gradient(
            variables, self._gap_count, lambda s: s.gaps, lambda s: s.by_gaps
        )

    def optimum(self, variables: Any) -> Any:
        """Return the (1,) optimum: the largest margin, N, or what `PinnedState.optimum` is."""
        return self._with_gradient(
            variables, 1, lambda s: np.array([s.optimum]), lambda s: s.by_optimum, torques=True
        )

    def torques(self, variables: Any) -> Any:
        """Return the (L,) motor torques: see `PinnedState.torques`."""
        return self._with_gradient(
            variables,
            self._torque_count,
            lambda s: s.torques,
            lambda s: s.by_torques,
            torques=True,
        )

    def _with_gradient(
        self,
        variables: Any,
        count: int,
        values_of: Callable[[PinnedState], FloatArray],
        derivatives_of: Callable[[PinnedState], Derivatives],
        *,
        torques: bool = False,
    ) -> Any:
        variables = np.asarray(variables)
        q_and_T = self._to_state(variables)
        q, T = (None, None) if q_and_T is None else q_and_T
        q, T = _uniform_array(q), _uniform_array(T)
        state = None if q_and_T is None else self._pinned_state(_float_values(q), _float_values(T))
        is_defined = state is not None and (state.evaluation.found or not torques)
        values = values_of(state) if state is not None and is_defined else np.full(count, np.nan)
        if variables.dtype != object:
            return np.array(values, dtype=float)
        size = _autodiff.ExtractGradient(variables[:, None]).shape[1]
        gradient = np.full((count, size), np.nan)
        if state is not None and is_defined:
            gradient = self._chain_rule(derivatives_of(state), q, T, size)
        return _autodiff.InitializeAutoDiff(values, gradient)[:, 0]

    def _pinned_state(self, q: FloatArray | None, T: FloatArray | None) -> PinnedState | None:
        """Return the pinned state of a configuration; None if a joint is outside its limits."""
        if q is not None:
            q = self.evaluator.configuration(q)
            clipped = np.clip(q, *self.evaluator.joint_limits)
            q = clipped if np.abs(clipped - q).max(initial=0.0) <= _BEYOND_BOUND else q
        key = b"".join([array.tobytes() for array in (q, T) if array is not None])
        if key not in self._states:
            try:
                self._states[key] = self.evaluator.pinned(q, T, self._twist)
            except ArgumentError as error:
                if error.argument != "q":
                    raise
                self._states[key] = None
        return self._states[key]

    def _chain_rule(self, by: Derivatives, q: Any, T: Any, size: int) -> FloatArray:
        """Return (count, size) derivatives by the variables of which q and T are functions."""
        gradient = np.zeros((len(np.atleast_2d(by.q)), size))
        if q is not None:
            gradient += np.atleast_2d(by.q) @ _gradient(q, size)
        if T is not None:
            R, by_T = _float_values(T)[:3, :3], _gradient(T.ravel(), size).reshape(4, 4, size)
            spin = np.einsum("ikn,jk->ijn", by_T[:3, :3], R)
            shift = np.einsum("ikn,k->in", by_T[:3, :3], self._center)
            twist = np.vstack([by_T[:3, 3] + shift, spin[[2, 0, 1], [1, 2, 0]]])
            gradient += np.atleast_2d(by.pose) @ twist
        return gradient

    def _joints_and_pose(self, variables: Any) -> tuple[Any, Any]:
        count = len(self.evaluator.joint_names)
        if len(variables) not in (count, count + 7):
            raise ArgumentError(
                "variables",
                f"must have {count} joint positions, and 7 more values if the object's pose is "
                f"variable, got {len(variables)}",
            )
        return variables[:count], _pose(variables[count:]) if len(variables) > count else None


def plant_states(evaluator: Evaluator, plant: Any, body: str) -> ToState:
    """Return the function from positions of a ``MultibodyPlant`` to states of an evaluator.

    Joints have the same names in both; a joint of a mount with a prefix, ``left/joint``, is looked
    up in the plant's model instance of that name. The function is a ``to_state`` of
    `PinnedFunctions` for programs with the variables of a plant, such as those of
    ``InverseKinematics``; it also converts a context to a scene:
    ``evaluator.scene_at(*states(plant.GetPositions(context)))``.

    Args:
        evaluator: An evaluator of the scene.
        plant: Finalized; of floats.
        body: Name of the object's body in the plant, whose frame is the object's; where several
            model instances have such a body, after the instance's: ``crate/box``.

    Returns:
        Function from (n,) positions, floats or ``AutoDiffXd``, to ((a,) positions of
        `Evaluator.joint_names`, (4, 4) pose of the object).

    Raises:
        ArgumentError: If the plant lacks a joint or the body, or has a link elsewhere than the
            scene has it, there or with all joints moved.

    Examples:
        >>> import numpy as np
        >>> from pydrake.math import RigidTransform
        >>> from pydrake.multibody.parsing import Parser
        >>> from pydrake.multibody.plant import MultibodyPlant
        >>> from pydrake.multibody.tree import SpatialInertia
        >>> from graspless_pin import Evaluator, load_scene
        >>> from graspless_pin.interfaces.drake import plant_states
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> evaluator, plant = Evaluator(scene), MultibodyPlant(0.0)
        >>> box = plant.AddRigidBody("box", SpatialInertia.SolidBoxWithMass(1.0, 0.12, 0.16, 0.1))
        >>> base = plant.GetFrameByName("palm", Parser(plant).AddModels("robots/trihand.urdf")[0])
        >>> X_base = RigidTransform(scene.hand.T_world_base)
        >>> weld = plant.WeldFrames(plant.world_frame(), base, X_base)
        >>> plant.Finalize()
        >>> states, context = plant_states(evaluator, plant, "box"), plant.CreateDefaultContext()
        >>> plant.SetFreeBodyPose(context, box, RigidTransform(scene.object.T_world_object))
        >>> for name in evaluator.joint_names:
        ...     _ = plant.GetJointByName(name).set_angle(context, scene.hand.q[name])
        >>> state = evaluator.scene_at(*states(plant.GetPositions(context)))
        >>> bool(np.allclose(state.hand.positions, scene.hand.positions))
        True
    """
    joints = {name: _plant_joint(plant, name) for name in evaluator.joint_names}
    places = [joint.position_start() for joint in joints.values()]
    prefix, _, own = body.rpartition("/")
    try:
        index = plant.GetBodyByName(own, *_model_instances(plant, prefix)).index()
    except RuntimeError as error:
        raise ArgumentError("body", f"{body!r} is not a body of the plant: {error}") from None
    _check_links(plant, evaluator, joints)
    plants = {False: (plant, plant.CreateDefaultContext())}

    def to_state(positions: Any) -> tuple[Any, Any]:
        positions = np.asarray(positions)
        differentiated = positions.dtype == object
        if differentiated not in plants:
            autodiff_plant = plant.ToAutoDiffXd()
            plants[True] = autodiff_plant, autodiff_plant.CreateDefaultContext()
        model, context = plants[differentiated]
        model.SetPositions(context, positions)
        T = model.EvalBodyPoseInWorld(context, model.get_body(index)).GetAsMatrix4()
        return positions[places], T

    return to_state


def _plant_joint(plant: Any, name: str) -> Any:
    """Return the plant's joint that corresponds to a joint of the scene."""
    prefix, _, joint_name = name.rpartition("/")
    try:
        joint = plant.GetJointByName(joint_name, *_model_instances(plant, prefix))
    except RuntimeError as error:
        raise ArgumentError(
            "plant", f"has no joint {name!r}, which the scene has: {error}"
        ) from None
    if joint.num_positions() != 1:
        count = joint.num_positions()
        raise ArgumentError(
            "plant", f"has {count} positions of joint {name!r}, but the scene has 1"
        )
    return joint


def _model_instances(plant: Any, prefix: str) -> list[Any]:
    return [plant.GetModelInstanceByName(prefix)] if prefix else []


def _check_links(plant: Any, evaluator: Evaluator, joints: Mapping[str, Any]) -> None:
    """Check that links of both have equal poses in the scene's state and with all joints moved."""
    hand, q = evaluator.scene.hand, evaluator.configuration()
    if hand is None:
        return
    lower, upper = evaluator.joint_limits
    instances: dict[str, set[Any]] = {}
    for name, joint in joints.items():
        instances.setdefault(name.rpartition("/")[0], set()).add(joint.model_instance())

    def of_plant(name: str, has: Any, get: Any) -> list[Any]:
        prefix, _, own = name.rpartition("/")
        return [get(own, instance) for instance in instances.get(prefix, ()) if has(own, instance)]

    context = plant.CreateDefaultContext()
    steps = np.linspace(0.1, 0.2, len(q)) * np.where(upper - q > q - lower, 1.0, -1.0)  # rad or m
    for values, hint in (
        (q, "weld the hand's base at scene.hand.T_world_base"),
        (
            np.clip(q + steps, lower, upper),
            "with all joints as in the scene it is there: check the axes of the joints",
        ),
    ):
        hand = hand.with_configuration(dict(zip(joints, values.tolist(), strict=True)))
        positions = plant.GetPositions(context)
        for name, value in hand.q.items():
            for joint in of_plant(name, plant.HasJointNamed, plant.GetJointByName):
                positions[joint.position_start()] = value
        plant.SetPositions(context, positions)
        for link in hand.link_names:
            for body in of_plant(link, plant.HasBodyNamed, plant.GetBodyByName):
                T = plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
                off = np.abs(T - hand.pose_of(link))[:3]
                if off.max() > _LINK_OFF:
                    raise ArgumentError(
                        "plant",
                        f"has link {link!r} {np.linalg.norm(off[:, 3]):.3g} m away from its pose "
                        f"in the scene, or rotated; {hint}",
                    )


def _pose(variables: Any) -> Any:
    """Return the (4, 4) pose of a quaternion w, x, y, z of any length and a position."""
    number = _autodiff.AutoDiffXd if variables.dtype == object else float
    length = np.sqrt(variables[:4] @ variables[:4])
    if not length > 0.0:
        raise ArgumentError(
            "variables", "have a zero quaternion; give an initial guess of the pose"
        )
    wxyz = variables[:4] / length
    turn = _eigen.Quaternion_[number](wxyz)
    return _math.RigidTransform_[number](turn, variables[4:]).GetAsMatrix4()


def _uniform_array(values: Any) -> Any:
    """Return an array of floats only or of ``AutoDiffXd`` only; None stays None."""
    if values is None:
        return None
    if hasattr(values, "GetAsMatrix4"):
        values = values.GetAsMatrix4()
    array = np.asarray(values)
    if array.dtype != object:
        return array.astype(float)
    number = _autodiff.AutoDiffXd
    numbers = [value if isinstance(value, number) else number(value) for value in array.flat]
    return np.array(numbers, dtype=object).reshape(array.shape)


def _float_values(entries: Any) -> Any:
    if entries is None or entries.dtype != object:
        return entries
    return _autodiff.ExtractValue(entries.reshape(-1, 1)).reshape(entries.shape)


def _gradient(entries: Any, size: int) -> FloatArray:
    """Return the (N, size) derivatives of N entries."""
    if entries.dtype != object:
        return np.zeros((len(entries), size))
    gradient = _autodiff.ExtractGradient(entries[:, None])
    return gradient if gradient.size else np.zeros((len(entries), size))
