"""A planner that keeps a margin: OMPL plans, Pink follows, every state is verified.

A hand on a carriage pushes a box up a slope and then pivots it about its front edge. The box's way
is given; OMPL plans where the palm stands relative to the box meanwhile, so that every state has
torques within the limits and a margin of at least `REQUIRED`. See docs/tutorial_planning.md.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pink
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from matplotlib.figure import Figure
from ompl import base, geometric
from ompl import util as ompl_util

from graspless_pin import Evaluator, Waypoint, evaluate_path, load_scene
from graspless_pin.planning import PathProfile, joint_trajectory, write_path_csv
from graspless_pin.plots import path_torques
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

HERE = Path(__file__).resolve().parent
SCENE = HERE / "trihand_slide_and_pivot.yaml"
URDF = HERE / "robots" / "trihand_on_carriage.urdf"
OUTPUT = Path("out/slide_and_pivot")

REQUIRED = 0.6  # N, margin of every state
RESERVE = 0.02  # N, kept while planning for what lies between the states that are looked at
SLIDE, PIVOT = 0.15, 0.45  # m up the slope, then rad about the front edge
STAGE_TIME = 4.0  # s for each of the two
REACH = 0.112  # m from the palm's middle to the middle of the fingertips
CLEARANCE = 0.06  # m from the palm's middle to the slope, at least; its disc has 0.05 m

# A state is (progress, lift, pitch). Progress: 0 to 1 while the box slides, 1 to 2 while it
# pivots. Lift (m) and pitch (rad): where the palm stands relative to the box.
UNITS = np.array([1.0, 0.02, 0.3])  # what counts as equally far in each coordinate
LOWER, UPPER = np.array([0.0, -0.025, -0.45]), np.array([2.0, 0.010, 0.45])
START, GOAL = np.array([0.0, -0.022, 0.4]), np.array([2.0, -0.022, -0.3])
STEEPEST = 4.0  # units of lift and pitch per unit of progress
RESOLUTION = 0.08  # units between the states that are looked at on an edge
MOST_CHECKS = 5000  # states to look at before giving up


def rotation_y(angle):
    return pin.SE3(pin.utils.rotate("y", float(angle)), np.zeros(3))


def translation(x, y, z):
    return pin.SE3(np.eye(3), np.array([x, y, z], dtype=float))


class Manoeuvre:
    """Where box, palm and fingers are in each state, and what the state is worth."""

    def __init__(self, scene):
        self.evaluator = Evaluator(scene, required_margin=REQUIRED)
        self.model = pin.buildModelFromUrdf(str(URDF))
        self.data = self.model.createData()
        self.names = list(self.model.names)[1:]
        self.tips = [f"finger_{k}_tip" for k in (1, 2, 3)]
        self.home = np.array([scene.hand.q[name] for name in self.names])
        self.start = pin.SE3(scene.object.T_world_object)
        depth, _, height = scene.object.shape.size
        self.edge = translation(0.5 * depth, 0, -0.5 * height)  # front edge of the bottom
        pin.framesForwardKinematics(self.model, self.data, self.home)
        to_box = self.start.inverse()
        # The fingertips stick to these points of the box.
        self.grasp = [to_box.act(self.frame_position(name)) for name in self.tips]
        self.grasp_middle = translation(*np.mean(self.grasp, axis=0))

    def frame_position(self, name):
        return self.data.oMf[self.model.getFrameId(name)].translation

    def box(self, progress):
        slid = self.start * translation(SLIDE * min(progress, 1.0), 0, 0)
        turn = rotation_y(PIVOT * max(progress - 1.0, 0.0))
        return slid * self.edge * turn * self.edge.inverse()

    def twist(self, progress):
        """Of the box, about its centre of mass: the slope slides, or the edge sticks."""
        box = self.box(progress)
        if progress < 1.0:
            return np.concatenate([SLIDE / STAGE_TIME * box.rotation[:, 0], np.zeros(3)])
        omega = PIVOT / STAGE_TIME * box.rotation[:, 1]
        return np.concatenate([np.cross(omega, -box.rotation @ self.edge.translation), omega])

    def palm(self, state):
        progress, lift, pitch = state
        turned = self.box(progress) * self.grasp_middle * rotation_y(pitch)
        return turned * translation(-REACH, 0, lift)

    def joints(self, state):
        """Inverse kinematics by Newton steps from home; None: out of reach or limits."""
        palm, box = self.palm(state), self.box(state[0])
        if self.start.actInv(palm.translation)[2] - self.edge.translation[2] < CLEARANCE:
            return None
        q = self.home.copy()
        q[:3] = palm.translation[0], palm.translation[2], pin.rpy.matrixToRpy(palm.rotation)[1]
        goals = [box.act(point) for point in self.grasp]
        for _ in range(12):
            pin.computeJointJacobians(self.model, self.data, q)
            pin.updateFramePlacements(self.model, self.data)
            error = np.concatenate(
                [
                    goal - self.frame_position(name)
                    for goal, name in zip(goals, self.tips, strict=True)
                ]
            )
            if np.abs(error).max() < 1e-8:
                within = (self.model.lowerPositionLimit <= q) & (q <= self.model.upperPositionLimit)
                return q if within.all() else None
            rows = [
                pin.getFrameJacobian(
                    self.model, self.data, self.model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED
                )[:3, 3:]
                for name in self.tips
            ]
            jacobian = np.vstack(rows)
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-9 * np.eye(9), error)
            q[3:] += step * min(1.0, 0.5 / np.abs(step).max())
        return None

    def query(self, state, q):
        """A state as the evaluator takes it."""
        return dict(zip(self.names, q, strict=True)), self.box(state[0]).np, self.twist(state[0])

    def is_reachable(self, state):
        return self.joints(state) is not None

    def is_robust(self, state):
        """Whether the hand gets there and torques within the limits keep the margin there."""
        q = self.joints(state)
        if q is None:
            return False
        return self.evaluator.is_feasible(*self.query(state, q), margin=REQUIRED + RESERVE)

    def margin(self, state):
        q = self.joints(state)
        return -np.inf if q is None else self.evaluator.evaluate(*self.query(state, q)).margin


class ForwardMotions(base.MotionValidator):
    """An edge is valid if the box always moves on and every state looked at is valid."""

    def __init__(self, information, is_valid):
        super().__init__(information)
        self.is_valid = is_valid

    def checkMotion(self, start, end):  # called by OMPL
        first, last = from_ompl(start), from_ompl(end)
        along = (last - first) / UNITS
        if along[0] <= np.linalg.norm(along[1:]) / STEEPEST:
            return False
        count = int(np.ceil(np.linalg.norm(along) / RESOLUTION))
        shares = [k / count for k in range(count, 0, -1)]
        if first[0] < 1.0 < last[0]:  # the slide's last state, too
            shares.append((1.0 - 1e-9 - first[0]) / along[0])
        return all(self.is_valid(first + share * (last - first)) for share in shares)


def from_ompl(state):
    return np.array([state[k] for k in range(3)]) * UNITS


def to_ompl(state, values):
    for k, value in enumerate(values / UNITS):
        state[k] = value
    return state


def plan(is_valid, seed):
    """(K, 3) corners of a short path from START to GOAL; None if none is found.

    It runs through states for which ``is_valid`` holds; the search gives up after MOST_CHECKS.
    """
    looked_at = 0

    def counted(state):
        nonlocal looked_at
        looked_at += 1
        return is_valid(state)

    ompl_util.noOutputHandler()
    ompl_util.RNG.setSeed(seed)
    space = base.RealVectorStateSpace(3)
    bounds = base.RealVectorBounds(3)
    for k, (low, high) in enumerate(zip(LOWER / UNITS, UPPER / UNITS, strict=True)):
        bounds.setLow(k, low)
        bounds.setHigh(k, high)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    setup.setStateValidityChecker(lambda state: counted(from_ompl(state)))
    information.setMotionValidator(ForwardMotions(information, counted))
    start, goal = to_ompl(space.allocState(), START), to_ompl(space.allocState(), GOAL)
    setup.setStartAndGoalStates(start, goal)
    planner = geometric.RRTConnect(information)
    planner.setRange(0.5)
    setup.setPlanner(planner)
    # A count ends the search, not a clock, so that the same seed gives the same path.
    setup.solve(base.PlannerTerminationCondition(lambda: looked_at > MOST_CHECKS))
    if not setup.haveExactSolutionPath():
        return None
    path = setup.getSolutionPath()
    simplifier = geometric.PathSimplifier(information)
    for _ in range(4):
        simplifier.partialShortcutPath(path, 15, 15)
        simplifier.reduceVertices(path, 10, 10)
    return np.array([from_ompl(state) for state in path.getStates()])


def dense(corners, count=40):
    """(2 count + 1, 3) states at equal steps of progress; one is where the pivot begins."""
    progress = np.linspace(0.0, 2.0, 2 * count + 1)
    columns = [np.interp(progress, corners[:, 0], column) for column in corners.T]
    return np.column_stack(columns)


def follow(manoeuvre, states):
    """(K, a) joint positions: Pink moves the hand along the states, a step for each."""
    configuration = pink.Configuration(manoeuvre.model, manoeuvre.data, manoeuvre.joints(states[0]))
    carriage = pink.tasks.FrameTask("carriage", position_cost=1.0, orientation_cost=1.0)
    fingertips = [
        pink.tasks.FrameTask(name, position_cost=10.0, orientation_cost=0.0)
        for name in manoeuvre.tips
    ]
    posture = pink.tasks.PostureTask(cost=1e-2)  # keeps the spread still where it moves no tip
    duration = 2.0 * STAGE_TIME / (len(states) - 1)
    followed = [configuration.q.copy()]
    for state in states[1:]:
        posture.set_target(manoeuvre.joints(state))
        carriage.set_target(manoeuvre.palm(state))
        box = manoeuvre.box(state[0])
        for task, point in zip(fingertips, manoeuvre.grasp, strict=True):
            task.set_target(pin.SE3(np.eye(3), box.act(point)))
        tasks = [carriage, *fingertips, posture]
        velocity = pink.solve_ik(configuration, tasks, duration, solver="piqp")
        configuration.integrate_inplace(velocity, duration)
        followed.append(configuration.q.copy())
    return np.array(followed)


@dataclass(frozen=True, eq=False)
class Result:
    """The planned path, what it is worth, and the path planned without asking for a margin."""

    corners: np.ndarray  # (K, 3)
    states: np.ndarray  # (S, 3)
    careless: np.ndarray  # (S, 3), the shortest path of reachable states
    careless_margins: np.ndarray  # (S,), N
    tip_error: float  # m, largest distance of a fingertip from its point while Pink follows
    best: PathProfile  # Algorithm 1: the largest margin of each state that Pink reached
    least: PathProfile  # Algorithm 2: the smallest torques with the margin REQUIRED


def evaluate(manoeuvre, states, configurations, algorithm):
    times = states[:, 0] * STAGE_TIME
    waypoints = [
        Waypoint(dict(zip(manoeuvre.names, q, strict=True)), manoeuvre.box(state[0]).np, time)
        for state, q, time in zip(states, configurations, times, strict=True)
    ]
    scene = manoeuvre.evaluator.scene
    evaluator = Evaluator(scene, algorithm=algorithm, required_margin=REQUIRED)
    return evaluate_path(evaluator, waypoints)


def verified(profile):
    """How many states an independent checker, which has numpy alone, finds right."""
    return sum(
        verify_document(solution_document(state.solution, state.scene)).passed
        for state in profile.evaluations
        if state.found
    )


def tip_error(manoeuvre, states, configurations):
    worst = 0.0
    for state, q in zip(states, configurations, strict=True):
        pin.framesForwardKinematics(manoeuvre.model, manoeuvre.data, q)
        box = manoeuvre.box(state[0])
        for name, point in zip(manoeuvre.tips, manoeuvre.grasp, strict=True):
            off = np.linalg.norm(manoeuvre.frame_position(name) - box.act(point))
            worst = max(worst, float(off))
    return worst


def run(seed=1):
    """Plan, follow and evaluate."""
    manoeuvre = Manoeuvre(load_scene(SCENE))
    corners = plan(manoeuvre.is_robust, seed)
    shortest = plan(manoeuvre.is_reachable, seed)  # for comparison: any margin will do
    if corners is None or shortest is None:
        raise SystemExit(f"no path found in {MOST_CHECKS} states; try another seed")
    states = dense(corners)
    configurations = follow(manoeuvre, states)
    careless = dense(shortest)
    return Result(
        corners,
        states,
        careless,
        np.array([manoeuvre.margin(state) for state in careless]),
        tip_error(manoeuvre, states, configurations),
        evaluate(manoeuvre, states, configurations, "margin"),
        evaluate(manoeuvre, states, configurations, "torque"),
    )


def draw_side_view(axes, result, manoeuvre):
    count = len(result.states)
    moments = ((0, "tab:blue"), (count // 2, "tab:orange"), (count - 1, "tab:green"))
    x, _, z = manoeuvre.edge.translation
    corners = [np.array([a, 0, b]) for a, b in ((-x, z), (x, z), (x, -z), (-x, -z))]
    for k, color in moments:
        box = manoeuvre.box(result.states[k, 0])
        outline = np.array([box.act(corner) for corner in corners])
        axes.fill(outline[:, 0], outline[:, 2], facecolor=color, edgecolor=color, alpha=0.35)
        pin.framesForwardKinematics(manoeuvre.model, manoeuvre.data, result.best.positions[k])
        palm = manoeuvre.data.oMf[manoeuvre.model.getFrameId("palm")]
        disc = np.array([palm.act(np.array([side, 0.0, 0.0])) for side in (-0.05, 0.05)])
        label = f"at {result.best.times[k]:g} s"
        axes.plot(disc[:, 0], disc[:, 2], color=color, linewidth=5, label=label)
        for finger in ("finger_1", "finger_2"):
            parts = [f"{finger}_{part}" for part in ("base", "lower", "upper", "tip")]
            chain = np.array([manoeuvre.frame_position(part) for part in parts])
            axes.plot(chain[:, 0], chain[:, 2], "o-", color=color, markersize=3)
    slope = np.outer([-0.25, 0.3], manoeuvre.start.rotation[:, 0])
    axes.plot(slope[:, 0], slope[:, 2], color="black")
    axes.set(xlabel="x [m]", ylabel="z [m]", title="Slides, then pivots")
    axes.set_aspect("equal")
    axes.legend(loc="upper left", fontsize="small")


def draw_placements(axes, result, manoeuvre):
    lifts = np.linspace(LOWER[1], UPPER[1], 13)
    pitches = np.linspace(LOWER[2], UPPER[2], 19)
    margins = [[manoeuvre.margin(np.array([0.5, a, b])) for b in pitches] for a in lifts]
    found = np.where(np.isfinite(margins), margins, np.nan)
    filled = axes.contourf(pitches, 1e3 * lifts, found, 12, cmap="cividis")
    axes.figure.colorbar(filled, label="largest margin while sliding [N]")
    axes.contour(pitches, 1e3 * lifts, found, [REQUIRED], colors="white", linestyles="--")
    slides = result.states[:, 0] <= 1.0
    paths = (("planned", result.states, "red"), ("careless", result.careless, "black"))
    for name, states, color in paths:
        for part, style, verb in ((slides, "-", "slides"), (~slides, ":", "pivots")):
            _, lift, pitch = states[part].T
            label = f"{name}, {verb}"
            axes.plot(pitch, 1e3 * lift, style, color=color, linewidth=2.5, label=label)
    axes.set(xlabel="pitch of the palm [rad]", ylabel="lift of the palm [mm]")
    axes.set_title(f"Palm relative to the box; dashed: {REQUIRED:g} N")
    axes.legend(loc="upper left", fontsize="small")


def draw_margins(axes, result):
    times = result.best.times
    axes.plot(times, result.careless_margins, color="black", label="careless")
    axes.plot(times, result.best.margins, color="red", label="planned")
    axes.axhline(REQUIRED, color="gray", linestyle="--", label="required")
    axes.axvline(STAGE_TIME, color="gray", linewidth=0.8)
    axes.set(xlabel="time [s]", ylabel="margin e [N]", title="Largest margin within the limits")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.25)
    axes.legend()


def draw(result, file):
    manoeuvre = Manoeuvre(load_scene(SCENE))
    figure = Figure(figsize=(13, 9), layout="constrained")
    (upper,), (lower,) = figure.subfigures(2, 1, squeeze=False)
    side, placements = upper.subplots(1, 2)
    margins, torques = lower.subplots(1, 2)
    draw_side_view(side, result, manoeuvre)
    draw_placements(placements, result, manoeuvre)
    draw_margins(margins, result)
    path_torques(result.least, ax=torques)
    torques.set_ylabel("motor torque [N m]")
    torques.set_title(f"Smallest torques with a margin of {REQUIRED:g} N, limit 0.6 N m")
    figure.savefig(file, dpi=110)


def main(output=OUTPUT):
    result = run()
    output.mkdir(parents=True, exist_ok=True)
    write_path_csv(result.least, output / "path.csv")
    text = json.dumps(joint_trajectory(result.least), indent=1)
    (output / "trajectory.json").write_text(text, encoding="utf-8")
    draw(result, output / "path.png")
    print(f"planned {len(result.corners)} corners, {len(result.states)} states; fingertips within")
    print(f"  {1e3 * result.tip_error:.3f} mm of their points while Pink follows")
    print(f"smallest margin: {result.best.smallest_margin:.3f} N, asked for {REQUIRED:g} N;")
    print(f"  {result.careless_margins.min():.3f} N if the planner does not ask for a margin")
    print(f"largest torque: {np.abs(result.least.torques).max():.3f} N m, limit 0.6 N m")
    print(f"verified: {verified(result.best)} and {verified(result.least)} of {len(result.states)}")
    print(f"written to {output}/: path.csv, trajectory.json, path.png")
    return result


if __name__ == "__main__":
    main()
