"""Loading protocols: load the object, held in a fixture or free, and observe whether it stays."""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError, GrasplessPinError, optional_import
from graspless_pin.geometry import ManipulatedObject
from graspless_pin.geometry.poses import pose_matrix, transformed
from graspless_pin.holding.controller import Controller, gain_shares
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import (
    FloatArray,
    choice,
    finite_array,
    motor_torques,
    real_number,
)
from graspless_pin.records import Brief, Record
from graspless_pin.scene import Scene
from graspless_pin.simulation.mjcf import OBJECT
from graspless_pin.simulation.model import (
    FIXTURE,
    HOLDING_GAIN,
    SOFT,
    STIFF,
    TIME_STEP,
    ContactModel,
    SimulationModel,
    simulation_model,
)
from graspless_pin.solution.tables import Table

FIXTURE_TIME = 0.3
"""Time for which the object is held, s; the load grows during the first two thirds."""
RELEASE_TIME = 0.2
"""Time after that in which the damping of the object's motion fades, s."""

_PARTS_OF_STEP = 5
"""Substeps of a time step if contacts close with an impact: overlaps of stiff bodies decay in two
time steps, and with whole steps bodies bounce for ever, and drift in spite of friction."""
_DAMPING_RATES = 1e5, 1e-1  # 1/s, first and last: the object's damping over its inertia
_HOLDING_GAINS = HOLDING_GAIN, 1e-3  # N m/rad, first and last: the joints' until the release ends


def load_mujoco() -> Any:
    """Return the module ``mujoco``.

    Raises:
        GrasplessPinError: If it is not installed.
    """
    with optional_import("simulations need MuJoCo", "simulate"):
        import mujoco
    return mujoco


class World:
    """A model and its state in MuJoCo."""

    def __init__(self, model: SimulationModel) -> None:
        """Load the model.

        Raises:
            GrasplessPinError: If MuJoCo is not installed or refuses the model.
        """
        self._mujoco = load_mujoco()
        # MuJoCo's default is to write warnings to a log file in the current folder.
        self._mujoco.set_mju_user_warning(lambda _: None)
        try:
            self.model = self._mujoco.MjModel.from_xml_string(model.xml)
        except ValueError as error:
            raise GrasplessPinError(f"MuJoCo refuses the model: {error}") from error
        self.model.opt.disableflags |= self._mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.data = self._mujoco.MjData(self.model)
        self._idle, self._commands = model.idle, model.commands
        self._object, self._parts = self.model.body(OBJECT).id, 1
        names = [self.model.geom(index).name for index in range(self.model.ngeom)]
        self._others = [model.links.get(name) for name in names]
        self._joints = np.array([self.model.joint(name).id for name in model.joints], dtype=int)
        self._rates = model.joint_rates
        self._held = held = self._joints[self._rates.any(axis=1)]
        slides = self.model.jnt_type[held] == self._mujoco.mjtJoint.mjJNT_SLIDE
        self._gains, self._gain_shares = self.model.jnt_stiffness[held], gain_shares(slides)
        self.data.qpos[self._joints] = self.model.qpos_spring[self._joints] = model.closing
        self._loads, self._R0 = model.loads, model.object.T_world_object[:3, :3]
        self._push, self._share = np.zeros(3), 0.0
        for body, wrench in model.link_wrenches.items():
            self.data.xfrc_applied[self.model.body(body).id] = wrench

    def load_and_release(self, push: FloatArray) -> None:
        """Hold the object while torques and a push (3,) (N, world axes) grow; then release it.

        The torques grow from those that carry the hand's own weight. Feedback holds the joints in
        place until contacts bear the torques.
        """
        steps = round(FIXTURE_TIME / TIME_STEP)
        self._set_holding_gain(_HOLDING_GAINS[0])
        for step in range(1, steps + 1):
            share = min(1.0, 1.5 * step / steps)
            self.data.ctrl = self._idle + share * (self._commands - self._idle)
            self._push, self._share = push, share
            self.step(1)
        self.data.eq_active[self.model.equality(FIXTURE).id] = False
        self._release()

    def load_at_once(self, push: FloatArray) -> None:
        """Apply the whole load from the first step on, to a free object."""
        self.data.eq_active[self.model.equality(FIXTURE).id] = False
        self._parts = _PARTS_OF_STEP
        self.model.opt.timestep = TIME_STEP / _PARTS_OF_STEP
        self.data.ctrl = self._commands
        self._push, self._share = push, 1.0

    def _release(self) -> None:
        """Release the object without impact: contacts close while damping keeps motions slow."""
        body = self.model.body(OBJECT)
        inertia = np.concatenate([np.repeat(body.mass, 3), body.inertia])
        steps = round(RELEASE_TIME / TIME_STEP)
        for rate, gain in zip(
            np.geomspace(*_DAMPING_RATES, steps), np.geomspace(*_HOLDING_GAINS, steps), strict=True
        ):
            self.model.dof_damping[-6:] = rate * inertia
            self._set_holding_gain(gain)
            self.step(1)
        self.model.dof_damping[-6:] = 0.0
        self._set_holding_gain(0.0)

    def _set_holding_gain(self, gain: float) -> None:
        """Add position feedback, N m/rad, to the controller's; not at hybrid fingers."""
        self.model.jnt_stiffness[self._held] = self._gains + gain * self._gain_shares

    def displace(self, motion: FloatArray) -> None:
        """Move object and joints by a small motion (6 + L,) in the problem's coordinates."""
        self.data.qpos[self._joints] += self._rates @ motion[6:]
        linear, angular = motion[:3], motion[3:6]
        origin, R = self.data.qpos[-7:-4], self.data.xmat[self._object].reshape(3, 3)
        origin += linear + np.cross(angular, origin - self.data.xipos[self._object])
        self._mujoco.mju_quatIntegrate(self.data.qpos[-4:], R.T @ angular, 1.0)

    def step(self, count: int) -> None:
        """Simulate a number of time steps.

        Raises:
            GrasplessPinError: If the state is no longer finite.
        """
        # Levers of loads rotate with the object: with loads, each step has its own wrench.
        at_once = 1 if self._loads else count * self._parts
        for _ in range(count * self._parts // at_once):
            self.data.xfrc_applied[self._object] = self._share * self._object_wrench()
            self._mujoco.mj_step(self.model, self.data, at_once)
        if not np.isfinite(self.data.qpos).all():
            raise GrasplessPinError(
                f"the simulation in MuJoCo diverges: no finite state at {self.data.time:.3f} s"
            )

    def _object_wrench(self) -> FloatArray:
        """(6,) wrench of push and loads on the object about its centre of mass, as it is turned."""
        wrench = np.concatenate([self._push, np.zeros(3)])
        if self._loads:
            R = self.data.xmat[self._object].reshape(3, 3) @ self._R0.T
            for load in self._loads:
                turn = R if load.turns else np.eye(3)
                rotated = load._replace(
                    force=turn @ load.force, moment=turn @ load.moment, lever=R @ load.lever
                )
                wrench = wrench + rotated.wrench
        return wrench

    def joint_moves(self) -> FloatArray:
        """(k,) displacement of each joint, rad or m."""
        return self.data.qpos[:-7].copy()

    def object_pose(self) -> FloatArray:
        """(4, 4) pose of the object, m."""
        position, quaternion = self.data.qpos[-7:-4], self.data.qpos[[-3, -2, -1, -4]]
        return np.array(pose_matrix(position, quaternion))

    def normal_forces(self) -> dict[str, float]:
        """Return the normal force on the object by hand link and support, N."""
        forces: dict[str, float] = defaultdict(float)
        force = np.zeros(6)
        for index, pair in enumerate(self.data.contact.geom.tolist()):
            bodies = [body for geom in pair if (body := self._others[geom])]
            if len(bodies) == 1:  # two where the hand touches a support
                self._mujoco.mj_contactForce(self.model, self.data, index, force)
                forces[bodies[0]] += float(force[0])
        return forces


HELD = 1e-3, float(np.radians(0.5))
"""m, rad: a held object moves less than both."""
MOVED = 5e-3, float(np.radians(2.0))
"""m, rad: a moved object has moved more than one of them."""

_STOP_FACTOR = 10.0  # a run ends at this multiple of `MOVED`
_RESTING_SHARE = 0.1
"""Relative to `HELD`: an object that moves less in the last quarter of the time is at rest."""
_STEPS_PER_LOOK = 20  # time steps between two observations of the object
LOOK_TIME = _STEPS_PER_LOOK * TIME_STEP
"""Time between two observations, s."""
_LOOKS_OF_FORCES = 20
_LONGEST_RUN = 600.0  # s


class LoadingProtocol(StrEnum):
    """How the load is applied to a simulated object. See the example of `simulate`."""

    FIXTURE = "fixture"
    """A fixture holds the object while the load grows, and releases it without an impact."""
    STEP = "step"
    """Torques, weight and push act at once on a free object."""


class SimulatedOutcome(StrEnum):
    """The behaviour of a simulated object under the load. See the example of `simulate`."""

    HELD = "held"
    """It stays within 1 mm and 0.5 degrees."""
    SHIFTED = "shifted"
    """It moves farther than held ones, then rests, touched by all that touched it at first."""
    CREPT = "crept"
    """It moves farther than held ones and does not rest, but less than moved ones."""
    MOVED = "moved"
    """It moves by more than 5 mm or 2 degrees, and does not rest."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedRun(Brief, Record):
    """One simulated run with one contact model. See the example of `simulate`.

    Attributes:
        contact_model: Stiffness of contacts.
        outcome: Behaviour of the object.
        displacement: Largest distance of the centre of mass from its pose with closed gaps, m.
        rotation: Largest angle from that pose, rad.
        moved_after: Time after the release at which it counts as moved, s; None: never.
        normal_forces: Mean normal force on the object over the last 0.2 s, N, by the hand link or
            support that exerts it.
        times: (K,) s after the release.
        T_world_object: (K, 4, 4) poses of the object at these times, m.
        joint_moves: (K, k) displacements of the joints that move at these times, rad or m.
    """

    contact_model: ContactModel
    outcome: SimulatedOutcome
    displacement: float
    rotation: float
    moved_after: float | None
    normal_forces: Mapping[str, float]
    times: FloatArray
    T_world_object: FloatArray
    joint_moves: FloatArray

    def __str__(self) -> str:
        """Return the outcome, displacement and rotation as a table."""
        return str(Table([self.row], _COLUMNS))

    @property
    def row(self) -> list[object]:
        """Its row in a table of runs."""
        return [
            self.contact_model.name,
            str(self.outcome),
            f"{self.displacement * 1e3:.3f}",
            f"{np.degrees(self.rotation):.3f}",
            "" if self.moved_after is None else f"{self.moved_after:.2f}",
        ]


_COLUMNS = ["bodies", "outcome", "displacement [mm]", "rotation [deg]", "moved after [s]"]
_WORDS = {
    SimulatedOutcome.HELD: "held: the object stays",
    SimulatedOutcome.SHIFTED: "shifted: the object moves, and then stays where it is",
    SimulatedOutcome.CREPT: "crept: the object neither stays nor moves away",
    SimulatedOutcome.MOVED: "moved: the object does not stay",
}


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Brief):
    """MuJoCo's simulations of a scene's rest under constant torques.

    See the example of `simulate`.

    Attributes:
        runs: Runs with stiff and with soft bodies.
        model: The model of the first run.
        problem: The scene's problem with the push and the changed friction.
        torques: (L,) the motors' torques.
    """

    runs: tuple[SimulatedRun, ...]
    model: SimulationModel
    problem: QuasistaticProblem
    torques: FloatArray

    @property
    def outcome(self) -> SimulatedOutcome:
        """Moved if the object moves in any run; else the outcome of the first run."""
        outcomes = [run.outcome for run in self.runs]
        return SimulatedOutcome.MOVED if SimulatedOutcome.MOVED in outcomes else outcomes[0]

    def __str__(self) -> str:
        """Return the outcome, the runs with a different outcome, and a table of all runs."""
        others = [
            f"{run.contact_model.name} bodies: {run.outcome}"
            for run in self.runs
            if run.outcome is not self.outcome
        ]
        headline = _WORDS[self.outcome] + (f" ({', '.join(others)})" if others else "")
        return f"{headline}\n\n{Table([run.row for run in self.runs], _COLUMNS)}"


def simulate(
    scene: Scene,
    torques: ArrayLike | Mapping[str, float],
    *,
    controller: Controller | float | None = None,
    push: ArrayLike = (0.0, 0.0, 0.0),
    friction_factor: float = 1.0,
    seconds: float = 2.0,
    protocol: LoadingProtocol | str = LoadingProtocol.FIXTURE,
    displacement: ArrayLike | None = None,
    contact_models: Sequence[ContactModel] = (STIFF, SOFT),
) -> Simulation:
    """Simulate a scene's rest with MuJoCo, with stiff bodies and with soft ones.

    Gaps at contacts are closed first, by joints if they can, else by moving the object; its motion
    is measured from there. It is held in a fixture for 0.3 s while torques and push grow to their
    full values, and feedback holds the joints. Then both are released, with a damping that fades
    within 0.2 s: contacts that just touch would close with an impact otherwise. The torques stay
    constant. A run ends early if the object has moved far. With ``protocol="step"`` everything acts
    at once on the free object, impact included.

    Args:
        scene: The scene, without a declared motion.
        torques: (L,) the motors' torques, as solutions of the scene's problem give them, or by
            joint (`torques_by_joint`), N m (N).
        controller: Controller of the joints that move in addition to the torques, or the stiffness
            of its position feedback, N m/rad; None: the scene's.
        push: (3,) force on the object's centre of mass, world axes, N.
        friction_factor: Factor of all coefficients of friction.
        seconds: Duration after the release.
        protocol: How the load is applied to the object.
        displacement: (6 + L,) displacement of object [of the centre of mass; rotation] and joints
            at the release, m and rad, world axes, such as 1e-3 times a growing motion of a
            verdict's ``small_motions``; None: zero.
        contact_models: Stiffness of contacts, one run for each; by default stiff and soft.

    Raises:
        ArgumentError: If an argument is out of range or has the wrong shape.
        SceneError: See `simulation_model`.
        GrasplessPinError: If MuJoCo is not installed, refuses the model or cannot go on.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.simulation import simulate
        >>> scene = load_scene("examples/paper/sphere_on_slope.yaml")
        >>> run = simulate(scene, scene.solve().torques, seconds=0.05)
        >>> len(run.runs)
        2
    """
    factor, span = checked_figures(friction_factor, seconds)
    force = finite_array("push", push, (3,))
    loading = choice(LoadingProtocol, "protocol", protocol)
    problem = scene.problem()
    problem = problem.with_changes(
        friction=factor * problem.friction,
        external_wrench=problem.external_wrench + np.concatenate([force, np.zeros(3)]),
    )
    tau = motor_torques(problem.joint_names, torques)
    start = np.zeros(6 + problem.joint_count)
    if displacement is not None:
        start = finite_array("displacement", displacement, start.shape)
    hardness = tuple(contact_models)
    if not hardness:
        raise ArgumentError(
            "contact_models", "is empty; give STIFF, SOFT or a contact model of your own"
        )
    models = [
        simulation_model(
            scene, tau, controller=controller, friction_factor=factor, contact_model=contact_model
        )
        for contact_model in hardness
    ]
    runs = [
        _simulated_run(model, contact_model, force, span, loading, start)
        for model, contact_model in zip(models, hardness, strict=True)
    ]
    return Simulation(tuple(runs), models[0], problem, tau)


def checked_figures(friction_factor: float, seconds: float) -> tuple[float, float]:
    """Return the checked friction factor and duration of `simulate`; check that MuJoCo is there.

    Raises:
        ArgumentError: If one is out of range.
        GrasplessPinError: If MuJoCo is not installed.
    """
    factor = real_number("friction_factor", friction_factor, 0.0)
    span = real_number("seconds", seconds, LOOK_TIME)
    if span > _LONGEST_RUN:
        raise ArgumentError("seconds", f"is {span:g}; it must be at most {_LONGEST_RUN:g}")
    load_mujoco()
    return factor, span


def _simulated_run(
    model: SimulationModel,
    contact_model: ContactModel,
    push: FloatArray,
    seconds: float,
    protocol: LoadingProtocol,
    displacement: FloatArray,
) -> SimulatedRun:
    world, manipulated = World(model), model.object
    if protocol is LoadingProtocol.STEP:
        world.load_at_once(push)
    else:
        world.load_and_release(push)
    world.displace(displacement)
    times, poses, moves = [0.0], [world.object_pose()], [world.joint_moves()]
    changes = [change_of_pose(manipulated, poses[0])]
    forces: deque[Mapping[str, float]] = deque([world.normal_forces()], _LOOKS_OF_FORCES)
    touched_first = forces[0].keys()
    moved_after = None
    for look in range(1, round(seconds / LOOK_TIME) + 1):
        world.step(_STEPS_PER_LOOK)
        times.append(look * LOOK_TIME)
        poses.append(world.object_pose())
        moves.append(world.joint_moves())
        changes.append(change_of_pose(manipulated, poses[-1]))
        forces.append(world.normal_forces())
        size = max(np.divide(changes[-1], MOVED).tolist())
        if size > 1.0 and moved_after is None:
            moved_after = times[-1]
        if size > _STOP_FACTOR:
            break
    distance, rotation = np.max(changes, axis=0).tolist()
    touched = sorted({body for look in forces for body in look})
    rests = _comes_to_rest(manipulated, poses) and touched_first <= {*touched}
    return SimulatedRun(
        contact_model,
        _classified_outcome(distance, rotation, rests=rests),
        distance,
        rotation,
        moved_after,
        {body: fmean(look.get(body, 0.0) for look in forces) for body in touched},
        np.array(times),
        np.array(poses),
        np.array(moves),
    )


def change_of_pose(
    manipulated: ManipulatedObject, T: FloatArray, T0: FloatArray | None = None
) -> tuple[float, float]:
    """Return the distance, m, and angle, rad, between poses (4, 4); ``T0`` None: the object's."""
    T0 = manipulated.T_world_object if T0 is None else T0
    shift = transformed(T, manipulated.center_of_mass) - transformed(T0, manipulated.center_of_mass)
    R = (T[:3, :3] @ T0[:3, :3].T).tolist()
    sine = math.hypot(R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1])
    angle = math.atan2(sine, R[0][0] + R[1][1] + R[2][2] - 1.0)
    return math.hypot(*shift.tolist()), angle


def _comes_to_rest(manipulated: ManipulatedObject, poses: Sequence[FloatArray]) -> bool:
    """Return whether the object is at rest in the last quarter of the time."""
    *_, last = poses
    quarter = poses[-max(len(poses) // 4, 2) :]
    moves = [np.divide(change_of_pose(manipulated, T, last), HELD).max() for T in quarter]
    return max(moves) < _RESTING_SHARE


def _classified_outcome(displacement: float, rotation: float, *, rests: bool) -> SimulatedOutcome:
    if displacement < HELD[0] and rotation < HELD[1]:
        return SimulatedOutcome.HELD
    if rests:
        return SimulatedOutcome.SHIFTED
    if displacement > MOVED[0] or rotation > MOVED[1]:
        return SimulatedOutcome.MOVED
    return SimulatedOutcome.CREPT
