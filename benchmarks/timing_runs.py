"""Fastest timings of an arm's path in MuJoCo: is the object lost with less time, kept with more?

``python -m benchmarks.timing_runs`` moves a Panda's arm as each timing says, at 0.8 and at 1.1
times its duration: the joints follow by computed torques, the gripper presses with a constant
force.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from tabulate import tabulate

from graspless_pin import Controller, Scene, load_scene
from graspless_pin.planning import PathTiming, fastest_timing
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import Load
from graspless_pin.simulation.model import FIXTURE, OBJECT, simulation_model
from graspless_pin.simulation.protocol import load_mujoco

ROOT = Path(__file__).parents[1]
FACTORS = 0.8, 1.1
STIFFNESS, DAMPING = 4e4, 400.0
"""1/s^2 and 1/s: how fast errors of the arm's joints go back."""
LOST = 5e-3
"""m: what goes farther in the hand is lost."""
SQUEEZING, RESTING = 0.3, 0.3  # s before and after the motion


@dataclass(frozen=True)
class TimingCase:
    """A path of an arm that carries something.

    Attributes:
        name: For the table.
        path: Configurations of the arm.
        squeeze: Of the gripper's motor, N.
        loads: On the object.
    """

    name: str
    path: tuple[dict[str, float], ...]
    squeeze: float
    loads: tuple[Load, ...] = ()


CASES = (
    TimingCase("swing", ({}, {"panda_joint1": 0.5}, {"panda_joint1": 1.0}), 60.0),
    TimingCase(
        "swing and lower", ({}, {"panda_joint1": 0.4}, {"panda_joint1": 1.0, "panda_joint2": 0.3}),
        60.0, (Load("hook", mass=0.05, at=[0.0, 0.0, -0.15]),),
    ),
    TimingCase(
        "lift and turn the hand",
        (
            {},
            {"panda_joint2": -0.2, "panda_joint7": 1.0},
            {"panda_joint2": -0.5, "panda_joint7": 1.4},
        ),
        40.0,
    ),
)  # fmt: skip


class DrivenArm:
    """A scene whose arm follows a timing in MuJoCo."""

    def __init__(self, scene: Scene, timing: PathTiming, squeeze: float) -> None:
        """Build the model, with motors at the arm's joints, too."""
        forced = scene.with_changes({"hand.control": "force"})
        idle = np.zeros(forced.problem().joint_count)
        built = simulation_model(forced, idle, controller=Controller("torque"))
        self.mujoco = load_mujoco()
        self.model = self.mujoco.MjModel.from_xml_string(built.xml)
        self.data = self.mujoco.MjData(self.model)
        self.squeeze = squeeze
        self.motors = [*built.motors]
        dofs = [int(self.model.joint(name).dofadr[0]) for name in self.motors]
        finger = self.motors.index("panda_finger_joint1")
        self.finger, self.arm = finger, [k for k in range(len(dofs)) if k != finger]
        self.dofs = np.array([dofs[k] for k in self.arm])
        columns = [timing.joint_names.index(self.motors[k]) for k in self.arm]
        self.start = timing.positions[0, columns]
        self.path = CubicHermiteSpline(
            timing.times, timing.positions[:, columns], timing.velocities[:, columns]
        )
        self.duration = timing.duration

    def lost(self, factor: float) -> float:
        """Return how far the object goes in the hand, m, when the whole takes so much longer."""
        self.data.eq_active[self.model.equality(FIXTURE).id] = True
        count = round(SQUEEZING / self.model.opt.timestep)
        for step in range(count):
            self.step(0.0, factor, min(1.0, 2.0 * step / count), still=True)
        self.data.eq_active[self.model.equality(FIXTURE).id] = False
        before = self.object_in_hand()
        farthest = 0.0
        steps = round((factor * self.duration + RESTING) / self.model.opt.timestep)
        for step in range(steps):
            self.step(step * self.model.opt.timestep / factor, factor)
            if step % 20 == 0:
                farthest = max(farthest, float(np.linalg.norm(self.object_in_hand() - before)))
        return farthest

    def step(self, time: float, factor: float, share: float = 1.0, *, still: bool = False) -> None:
        """Go on by a time step, with the torques that accelerate the arm as told."""
        at = min(time, self.duration)
        moves = 0.0 if still or time >= self.duration else 1.0
        q = self.path(at) - self.start
        rates, changes = moves * self.path(at, 1) / factor, moves * self.path(at, 2) / factor**2
        data = self.data
        errors = q - data.qpos[self.dofs], rates - data.qvel[self.dofs]
        wanted = changes + STIFFNESS * errors[0] + DAMPING * errors[1]
        self.mujoco.mj_step1(self.model, data)
        inertia = np.zeros((self.model.nv, self.model.nv))
        self.mujoco.mj_fullM(self.model, data, inertia)
        torques = inertia[np.ix_(self.dofs, self.dofs)] @ wanted + data.qfrc_bias[self.dofs]
        data.ctrl[self.arm] = torques - data.qfrc_passive[self.dofs]
        data.ctrl[self.finger] = -share * self.squeeze
        self.mujoco.mj_step2(self.model, data)

    def object_in_hand(self) -> FloatArray:
        """(3,) the object's centre of mass in the frame of the gripper's hand, m."""
        hand, body = self.data.body("hand/panda_joint7"), self.data.body(OBJECT)
        return np.array(hand.xmat.reshape(3, 3).T @ (body.xipos - hand.xpos))


def main() -> None:
    """Print the durations, and how far the object goes in the hand."""
    rows = []
    for case in CASES:
        scene = load_scene(ROOT / "examples" / "panda_stop_with_board.yaml").with_changes(
            acceleration=None, loads=case.loads
        )
        timing = fastest_timing(
            scene,
            [*case.path],
            attached_to="panda_hand",
            velocity_limits=50.0,
            torques=[-case.squeeze],
            points=200,
        )
        ways = [DrivenArm(scene, timing, case.squeeze).lost(factor) for factor in FACTORS]
        told = [f"{'lost' if way > LOST else 'kept'}, {1e3 * way:.1f} mm" for way in ways]
        rows.append([case.name, case.squeeze, timing.duration, *told])
    headers = ["path", "squeeze [N]", "duration [s]", *(f"{factor} times" for factor in FACTORS)]
    print(tabulate(rows, headers, "github", floatfmt=".3f"))


if __name__ == "__main__":
    main()
