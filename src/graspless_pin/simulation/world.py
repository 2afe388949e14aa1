"""A model while MuJoCo simulates it; the only module that imports MuJoCo."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np

from graspless_pin.errors import GrasplessPinError
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.problem.checks import FloatArray
from graspless_pin.simulation.model import FIXTURE, OBJECT, TIME_STEP, SimulationModel

FIXTURE_TIME = 0.3
"""s in which the object is held; the load grows during the first two thirds."""
RELEASE_TIME = 0.2
"""s in which the damping of the object's motion fades after that."""

_PARTS_OF_STEP = 5
"""Of a time step, where contacts close with an impact. Stiff bodies go back in two time steps: in
whole steps they bounce for ever, and the object drifts on although friction would stop it."""
_DAMPING_RATES = 1e5, 1e-1  # 1/s, first and last: the object's damping over its inertia


def load_mujoco() -> Any:
    """Return the module ``mujoco``.

    Raises:
        GrasplessPinError: If it is not installed.
    """
    try:
        import mujoco
    except ImportError as error:
        raise GrasplessPinError(
            f"simulations need MuJoCo ({error}); install it with pip install "
            "'graspless-pin[simulate]'"
        ) from None
    return mujoco


class World:
    """A model and its state in MuJoCo."""

    def __init__(self, model: SimulationModel) -> None:
        """Load the model.

        Raises:
            GrasplessPinError: If MuJoCo is not installed or refuses the model.
        """
        self._mujoco = load_mujoco()
        # Its own way to warn is a log file in the current folder.
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

    def load_and_release(self, push: FloatArray) -> None:
        """Hold the object while torques and a push (3,) (N, world axes) grow; then let it go.

        The torques grow from what carries the hand's own weight.
        """
        steps = round(FIXTURE_TIME / TIME_STEP)
        for step in range(1, steps + 1):
            share = min(1.0, 1.5 * step / steps)
            self.data.ctrl = self._idle + share * (self._commands - self._idle)
            self.data.xfrc_applied[self._object, :3] = share * push
            self.step(1)
        self.data.eq_active[self.model.equality(FIXTURE).id] = False
        self._release()

    def load_at_once(self, push: FloatArray) -> None:
        """Let the whole load act from the first step on, with nothing that holds the object."""
        self.data.eq_active[self.model.equality(FIXTURE).id] = False
        self._parts = _PARTS_OF_STEP
        self.model.opt.timestep = TIME_STEP / _PARTS_OF_STEP
        self.data.ctrl = self._commands
        self.data.xfrc_applied[self._object, :3] = push

    def _release(self) -> None:
        """Let go without an impact: contacts that just touch close while all motion is slow."""
        body = self.model.body(OBJECT)
        inertia = np.concatenate([np.repeat(body.mass, 3), body.inertia])
        for rate in np.geomspace(*_DAMPING_RATES, round(RELEASE_TIME / TIME_STEP)):
            self.model.dof_damping[-6:] = rate * inertia
            self.step(1)
        self.model.dof_damping[-6:] = 0.0

    def step(self, count: int) -> None:
        """Go on by some time steps.

        Raises:
            GrasplessPinError: If the state is no longer finite.
        """
        self._mujoco.mj_step(self.model, self.data, count * self._parts)
        if not np.isfinite(self.data.qpos).all():
            raise GrasplessPinError(
                f"MuJoCo's simulation has no finite state any more at {self.data.time:.3f} s"
            )

    def joint_moves(self) -> FloatArray:
        """(k,) how far each joint has gone, rad or m."""
        return self.data.qpos[:-7].copy()

    def object_pose(self) -> FloatArray:
        """(4, 4) pose of the object, m."""
        position, quaternion = self.data.qpos[-7:-4], self.data.qpos[-4:]
        return np.array(pose_matrix(position, np.roll(quaternion, -1)))

    def normal_forces(self) -> dict[str, float]:
        """Return the normal force on the object by hand link and support, N."""
        forces: dict[str, float] = defaultdict(float)
        force = np.zeros(6)
        for index, contact in enumerate(self.data.contact):
            others = [other for geom in contact.geom.tolist() if (other := self._others[geom])]
            if len(others) == 1:  # two where the hand touches a support
                self._mujoco.mj_contactForce(self.model, self.data, index, force)
                forces[others[0]] += float(force[0])
        return forces
