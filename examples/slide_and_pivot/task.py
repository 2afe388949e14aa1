"""A box slides up a slope and pivots about its front edge: the task that three planners solve.

A hand on a carriage pushes the box, and its fingertips stick to points of the box's rear face. The
box's way is given: 0.15 m up the slope, then 0.45 rad about the front edge. Free is where the palm
stands relative to the box meanwhile. It decides the margin: the fingers' levers change with it.

A state is (progress, lift, pitch). Progress: 0 to 1 while the box slides, 1 to 2 while it pivots.
Lift, m, and pitch, rad: the palm relative to the box. The joints follow by inverse kinematics.

Each planner's `plan(task)` returns (K, 3) states from START to GOAL, joined by straight lines. Its
worth is `task.smallest_margin(task.waypoints(states))`. No path has more than 0.727 N where the box
begins to slide at once: so much has START. The straight line from START to GOAL has 0.398 N.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from graspless_pin import Evaluator, Waypoint, evaluate_path, load_scene

EXAMPLES = Path(__file__).resolve().parents[1]
SCENE = EXAMPLES / "trihand_slide_and_pivot.yaml"
URDF = EXAMPLES / "robots" / "trihand_on_carriage.urdf"

SLIDE, PIVOT = 0.15, 0.45  # m up the slope, then rad about the front edge
LOWER, UPPER = np.array([0.0, -0.025, -0.45]), np.array([2.0, 0.010, 0.45])
START, GOAL = np.array([0.0, -0.022, 0.4]), np.array([2.0, -0.022, -0.3])
UNITS = np.array([1.0, 0.02, 0.3])  # what counts as equally far in each coordinate
TIPS = ("finger_1_tip", "finger_2_tip", "finger_3_tip")
PINS = [*((tip, "object") for tip in TIPS), ("object", "slope")]  # for `Evaluator(scene, pins=...)`
REACH = 0.112  # m from the palm's middle to the middle of the fingertips
CLEARANCE = 0.06  # m from the palm's middle to the slope, at least; its disc has 0.05 m
STEP = 0.08  # units between the states of `waypoints`
UNIT_TIME = 4.0  # s for each unit of the way


class Task:
    """Where box, palm and fingers are in each state, and what a path is worth.

    Attributes:
        scene: The scene in the first state.
        names: Of the joints, in the order of q: three of the carriage, nine of the fingers.
        evaluator: Finds the largest margins of states.
    """

    def __init__(self):
        self.scene: Any = load_scene(SCENE)
        self.model = pin.buildModelFromUrdf(str(URDF))
        self.data = self.model.createData()
        self.names = list(self.model.names)[1:]
        self.frames = [self.model.getFrameId(tip) for tip in TIPS]
        self.home = np.array([self.scene.hand.q[name] for name in self.names])
        self.start = pin.SE3(self.scene.object.T_world_object)
        depth, _, height = self.scene.object.shape.size
        self.edge = _translation(0.5 * depth, 0, -0.5 * height)  # front edge of the bottom
        self.grasp = [self.start.actInv(tip) for tip in self.tips(self.home)]  # stuck to the box
        self.grasp_middle = _translation(*np.mean(self.grasp, axis=0))
        self.evaluator = Evaluator(self.scene, algorithm="margin")

    def box(self, progress):
        """Pose of the box, an SE3; ``.np`` is T_world_object."""
        slid = self.start * _translation(SLIDE * min(progress, 1.0), 0, 0)
        turn = _rotation_y(PIVOT * max(progress - 1.0, 0.0))
        return slid * self.edge * turn * self.edge.inverse()

    def box_rate(self, progress):
        """(6,) [linear; angular] of the box's middle by progress, in world axes."""
        box = self.box(progress)
        if progress < 1.0:
            return np.concatenate([SLIDE * box.rotation[:, 0], np.zeros(3)])
        omega = PIVOT * box.rotation[:, 1]
        return np.concatenate([np.cross(omega, -box.rotation @ self.edge.translation), omega])

    def palm(self, state):
        """Pose of the palm, an SE3."""
        progress, lift, pitch = state
        turned = self.box(progress) * self.grasp_middle * _rotation_y(pitch)
        return turned * _translation(-REACH, 0, lift)

    def tips(self, q):
        """(3, 3) positions of the fingertips, m."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return np.array([self.data.oMf[frame].translation for frame in self.frames])

    def tip_jacobian(self, q):
        """(9, 12) of the fingertips' positions by the joints."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        axes = pin.LOCAL_WORLD_ALIGNED
        each = [pin.getFrameJacobian(self.model, self.data, one, axes)[:3] for one in self.frames]
        return np.vstack(each)

    def tip_goals(self, progress):
        """(3, 3) where the fingertips stick to the box, m."""
        box = self.box(progress)
        return np.array([box.act(point) for point in self.grasp])

    def joints(self, state):
        """(12,) joints by Newton's method from home; None: out of reach or limits."""
        height = self.start.actInv(self.palm(state).translation)[2] - self.edge.translation[2]
        if height < CLEARANCE:
            return None
        q, goals = self.home.copy(), self.tip_goals(state[0])
        q[:3] = self._carriage(state)
        for _ in range(15):
            error = (goals - self.tips(q)).ravel()
            if np.abs(error).max() < 1e-11:
                within = (self.model.lowerPositionLimit <= q) & (q <= self.model.upperPositionLimit)
                return q if within.all() else None
            jacobian = self.tip_jacobian(q)[:, 3:]
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-9 * np.eye(9), error)
            q[3:] += step * min(1.0, 0.5 / np.abs(step).max())
        return None

    def joint_rates(self, state):
        """(12, 3) derivatives of the joints by the state; at progress 1 those of the pivot."""
        steps = 1e-6 * np.eye(3)
        change = [self._carriage(state + step) - self._carriage(state - step) for step in steps]
        carriage = np.column_stack(change) / 2e-6
        if state[0] == 1.0:  # the box's way has a corner here
            carriage[:, 0] = (self._carriage(state + steps[0]) - self._carriage(state)) / 1e-6
        rate, goals = self.box_rate(state[0]), self.tip_goals(state[0])
        arms = goals - self.box(state[0]).translation
        wanted = np.zeros((9, 3))
        wanted[:, 0] = (rate[:3] + np.cross(rate[3:], arms)).ravel()
        jacobian = self.tip_jacobian(self.joints(state))
        fingers = np.linalg.solve(jacobian[:, 3:], wanted - jacobian[:, :3] @ carriage)
        return np.vstack([carriage, fingers])

    def configuration(self, state):
        """(q, T_world_object) as `Evaluator.evaluate` takes them; None: there is no such state."""
        q = self.joints(state)
        return None if q is None else (dict(zip(self.names, q, strict=True)), self.box(state[0]).np)

    def along(self, states):
        """(S, 3) states on the straight lines between (K, 3) states, at most STEP apart.

        One is where the slide ends and the pivot begins.
        """
        found = [np.asarray(states[0], dtype=float)]
        for first, last in pairwise(np.asarray(states, dtype=float)):
            way = last - first
            count = int(np.ceil(np.linalg.norm(way / UNITS) / STEP))
            shares = set(np.linspace(0.0, 1.0, count + 1)[1:])
            if (first[0] - 1.0) * (last[0] - 1.0) < 0.0:
                shares.add((1.0 - first[0]) / way[0])
            found += [first + share * way for share in sorted(shares)]
        return np.array(found)

    def waypoints(self, states):
        """Waypoints `along` (K, 3) states.

        Raises:
            ValueError: If the path leads through a state that is out of reach.
        """
        along, found = self.along(states), []
        for state, time in zip(along, self.times(along), strict=True):
            at = self.configuration(state)
            if at is None:
                raise ValueError(f"the hand does not reach the state {state}")
            found.append(Waypoint(at[0], at[1], time))
        return found

    def times(self, along):
        """(S,) times of the waypoints, s."""
        lengths = np.linalg.norm(np.diff(along, axis=0) / UNITS, axis=1)
        return UNIT_TIME * np.concatenate([[0.0], np.cumsum(lengths)])

    def _carriage(self, state):
        palm = self.palm(state)
        return np.array(
            [palm.translation[0], palm.translation[2], pin.rpy.matrixToRpy(palm.rotation)[1]]
        )

    def profile(self, waypoints):
        """What the way along waypoints is worth: a `PathProfile` of largest margins."""
        return evaluate_path(self.evaluator, waypoints)

    def smallest_margin(self, waypoints):
        """The smallest of the largest margins along the way, N."""
        return self.profile(waypoints).smallest_margin


def _rotation_y(angle):
    return pin.SE3(pin.utils.rotate("y", float(angle)), np.zeros(3))


def _translation(x, y, z):
    return pin.SE3(np.eye(3), np.array([x, y, z], dtype=float))
