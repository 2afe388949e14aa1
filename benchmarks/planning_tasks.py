"""Three tasks planned with OMPL, with and without a margin: ``make planning-tasks``.

A Panda carries a bar, a Kinova with a Robotiq gripper a tray, and two Pandas a crate between them.
RRTConnect plans each twice: so that every state and motion keeps a margin, and by collisions and
joint limits alone. Both paths are cut into states half of the motions' resolution apart, and each
of them is solved as a scene of its own, verified by the checker and measured by MuJoCo.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ompl import base, geometric, util
from scipy.spatial.transform import Rotation
from tabulate import tabulate

from benchmarks.two_arms import TwoArms
from benchmarks.verified_paths import State, between, scene_in, verified_path
from graspless_pin import Evaluator, Scene, load_scene
from graspless_pin.geometry import Box, Support
from graspless_pin.interfaces.ompl import attach_evaluator
from graspless_pin.problem.checks import FloatArray
from graspless_pin.simulation import simulate

ROOT = Path(__file__).parents[1]
RESOLUTION = 0.002, 0.004
"""m, rad: of motions. States are looked at eight times as far apart, 3 cm at an arm's length."""
PADDING = 0.01
"""m: boxes are so much larger on all sides while planning."""
MOST_PENETRATION = 1e-3
"""m: of collisions while planning."""
PIECE = 0.02
"""Of the space's extent: length of a piece of a motion of object poses, a state at each end."""
ITERATIONS = 2000
SHORTCUTS = 30
SEED = 1


@dataclass(frozen=True)
class Task:
    """Something to plan.

    Attributes:
        name: For the table.
        scene: The scene, at the start of the task.
        margin: That is asked for, N.
        link: That carries the object; None: states are poses of the object.
        bounds: (lower, upper) of states.
        start: Where the path begins.
        goal: Where it ends.
        to_state: From a state to that of an evaluator; None: states are its configurations.
    """

    name: str
    scene: Scene
    margin: float
    link: str | None
    bounds: tuple[FloatArray, FloatArray]
    start: FloatArray
    goal: FloatArray
    to_state: Callable[[Any], Any] | None = None


def carried(name: str, scene: Scene, margin: float, link: str, goal: Mapping[str, float]) -> Task:
    """Return the task of an arm whose joints move; those without limits by half a turn."""
    arm = Evaluator(scene, attached_to=link)
    start, (lower, upper) = arm.configuration(), arm.joint_limits
    free = ~np.isfinite(lower)
    bounds = np.where(free, start - np.pi, lower), np.where(free, start + np.pi, upper)
    return Task(name, scene, margin, link, bounds, start, arm.configuration(goal))


def bar() -> Task:
    """A Panda carries a bar past a wall; the gripper is too weak to hold it level."""
    scene, wall = load_scene(ROOT / "examples" / "panda_carry_bar.yaml"), np.eye(4)
    weak = scene.with_changes({"hand.effort_limits": {"left": 14.0}})  # N, for both fingers
    upright = {
        "panda_joint1": -0.7, "panda_joint2": 0.139, "panda_joint3": 0.0, "panda_joint4": -1.855,
        "panda_joint5": 0.0, "panda_joint6": 3.565, "panda_joint7": -2.356,
    }  # fmt: skip
    start = Evaluator(weak, attached_to="panda_hand").scene_at(upright)
    wall[:3, 3] = 0.6, 0.0, 0.45  # m
    supports = *scene.supports, Support("wall", Box((0.6, 0.04, 0.9)), wall)
    scene = start.with_changes(supports=supports)
    return carried("Panda, bar", scene, 0.25, "panda_hand", {"panda_joint1": 0.7})


def tray() -> Task:
    """A Kinova carries a tray past a post: tilted, it slips."""
    scene = load_scene(ROOT / "benchmarks" / "kinova_carry_tray.yaml")
    return carried("Kinova, tray", scene, 1.0, "robotiq_85_base_link", {"joint_1": -1.8})


def crate() -> Task:
    """Two Pandas carry a crate through a window; states are x, y, z, m, and the pitch, rad."""
    scene = load_scene(ROOT / "benchmarks" / "two_pandas_carry_crate.yaml")
    arms, T = TwoArms(scene), scene.object.T_world_object
    pitch = float(np.arctan2(T[0, 2], T[0, 0]))

    def to_state(state: Any) -> Any:
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("y", state[3]).as_matrix()
        pose[:3, 3] = [state[k] for k in range(3)]
        q = arms.configuration(pose)
        return None if q is None else (q, pose)

    bounds = np.array([0.3, -0.1, 0.2, -1.2]), np.array([0.8, 0.1, 0.8, 1.2])
    start, goal = np.array([*T[:3, 3], pitch]), np.array([0.74, 0.0, 0.32, pitch])
    return Task("two Pandas, crate", scene, 0.2, None, bounds, start, goal, to_state)


TASKS = {"bar": bar, "tray": tray, "crate": crate}


@dataclass(frozen=True)
class Plan:
    """A plan, and what planning it took.

    Attributes:
        corners: OMPL's states on the path; none where the planner found no path.
        states: Of the path, half of the motions' resolution apart.
        seconds: Of one processor.
        looked_at: States that the planner had looked at.
    """

    corners: list[FloatArray]
    states: list[State]
    seconds: float
    looked_at: int


def plan(
    task: Task,
    margin: float,
    resolution: tuple[float, float] = RESOLUTION,
    iterations: int = ITERATIONS,
) -> Plan:
    """Plan a task.

    Args:
        task: The task.
        margin: That every state and motion keeps, N; -inf: none.
        resolution: Of motions, m and rad; the states of the plan are half as far apart.
        iterations: Of RRTConnect before it gives up.
    """
    util.noOutputHandler()
    scene = task.scene.with_changes(
        supports=[padded(one) for one in task.scene.supports], max_penetration=MOST_PENETRATION
    )
    evaluator = Evaluator(scene, attached_to=task.link, algorithm="margin")
    counted = Counted(evaluator)
    lower, upper = task.bounds
    space, limits = base.RealVectorStateSpace(len(lower)), base.RealVectorBounds(len(lower))
    for k, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
        limits.setLow(k, low)
        limits.setHigh(k, high)
    space.setBounds(limits)
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(PIECE)
    longest = PIECE * information.getMaximumExtent()
    attach_evaluator(setup, evaluator, task.to_state, margin=margin, resolution=resolution)
    ends: list[Any] = [space.allocState(), space.allocState()]
    for state, values in zip(ends, (task.start, task.goal), strict=True):
        for k, value in enumerate(values.tolist()):
            state[k] = value
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(geometric.RRTConnect(information))
    calls = itertools.count()
    begin = time.process_time()
    setup.solve(base.PlannerTerminationCondition(lambda: next(calls) > iterations))
    if not setup.haveExactSolutionPath():
        return Plan([], [], time.process_time() - begin, counted.states)
    path: Any = setup.getSolutionPath()
    geometric.PathSimplifier(information).partialShortcutPath(path, SHORTCUTS)
    seconds, looked_at = time.process_time() - begin, counted.states
    corners = [np.array([s[k] for k in range(len(lower))]) for s in path.getStates()]
    return Plan(corners, dense_states(task, corners, longest, resolution), seconds, looked_at)


def padded(support: Support) -> Support:
    """Return a box that is larger by `PADDING` on all sides; the floor stays where arms stand."""
    if not isinstance(support.shape, Box):
        return support
    x, y, z = (length + 2.0 * PADDING for length in support.shape.size)
    return Support(support.name, Box((x, y, z)), support.T_world_support)


class Counted:
    """Counts the states that an evaluator looks at for `is_feasible` and along motions."""

    def __init__(self, evaluator: Evaluator) -> None:
        """Take the evaluator."""
        self.states = 0
        solver: Any = evaluator._solver
        posed, reaches = solver.posed_scene, solver.loops.reaches_margin

        def count(*args: Any, **keywords: Any) -> Any:
            self.states += 1
            return posed(*args, **keywords)

        def count_in_loops(*args: Any, **keywords: Any) -> Any:
            reached = reaches(*args, **keywords)
            self.states += reached is not None
            return reached

        solver.posed_scene, solver.loops.reaches_margin = count, count_in_loops


def dense_states(
    task: Task, corners: list[FloatArray], piece: float, resolution: tuple[float, float]
) -> list[State]:
    """Return the states of a path, half of the motions' resolution apart.

    Args:
        task: The task.
        corners: OMPL's states.
        piece: OMPL's longest piece of a motion: where the object's poses are planned, there is a
            state at the end of each.
        resolution: Of motions, m and rad.
    """
    whole, hand, moved = Evaluator(task.scene), task.scene.hand, task.scene.object
    if hand is None:
        raise ValueError("the scene has no hand")
    names, q_start = whole.joint_names, whole.configuration()

    def at(values: FloatArray) -> State:
        if task.to_state is not None:
            q, T = task.to_state(values)
            return whole.configuration(q), T
        q = np.array([*values, *q_start[len(values) :]])
        T_link = hand.pose_of(str(task.link), dict(zip(names, q.tolist(), strict=True)))
        return q, T_link @ np.linalg.inv(hand.pose_of(str(task.link))) @ moved.T_world_object

    metres, radians = 0.5 * resolution[0], 0.5 * resolution[1]
    states = [at(corners[0])]
    for one, other in itertools.pairwise(corners):
        longest = piece if task.to_state else radians
        way = np.linalg.norm(other - one) if task.to_state else np.abs(other - one).max()
        for share in np.linspace(0.0, 1.0, 1 + max(1, int(np.ceil(way / longest))))[1:].tolist():
            end = at(one + share * (other - one))
            if task.to_state:
                states += between(states[-1], end, moved.center_of_mass, (metres, radians))
            else:
                states.append(end)
    return states


def told(name: str, *, with_margin: bool, every: int) -> tuple[bool, dict[str, str]]:
    """Plan a task and verify the path: in a process of its own, where OMPL's seed counts.

    Args:
        name: Of the task.
        with_margin: Whether states and motions shall keep its margin.
        every: One state in so many is solved and verified.

    Returns:
        Whether the path is what was asked for, and its row of the table.
    """
    util.RNG.setSeed(SEED)
    task = TASKS[name]()
    found = plan(task, task.margin if with_margin else -np.inf)
    row = {
        "task": task.name,
        "margin asked for, N": f"{task.margin:g}" if with_margin else "none",
        "planned in, s of CPU": f"{found.seconds:.1f}",
        "states looked at": f"{found.looked_at}",
        "a second": f"{found.looked_at / found.seconds:.0f}",
    }
    if not found.states:
        return False, {**row, "path": "none found"}
    along = task.link is not None
    seen = verified_path(task.scene, found.states, carried=along, every=every)
    for objection in seen.objections[:5]:
        print(f"{task.name}: {objection}", file=sys.stderr)
    worst = found.states[every * int(np.argmin(seen.margins))]
    sound = not seen.objections and not seen.outside and seen.clearance > 0.0
    return sound and not (with_margin and seen.below(task.margin)), {
        **row,
        "path": f"{len(found.corners) - 1} edges, {seen.states} states",
        "solved and verified": f"{len(seen.margins)}",
        "objections": f"{len(seen.objections)}",
        "outside limits": f"{seen.outside}",
        "least distance, mm": seen.distance,
        "smallest margin, N": f"{seen.margins.min():.3f}",
        "below what the task asks for": f"{seen.below(task.margin)}",
        "nothing holds": f"{seen.lost}",
        "the worst in MuJoCo": in_mujoco(task, worst) if along else "",
    }


def in_mujoco(task: Task, state: State) -> str:
    """Return what the object does in a state when the gripper's motor does all that it can."""
    torques = task.scene.solve("margin").torques
    runs = simulate(scene_in(task.scene, state, carried=True), torques).runs
    return ", ".join(f"{run.contact_model.name}: {run.outcome.value}" for run in runs)


def main() -> int:
    """Print a column for each plan; 1 where one is not what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tasks", nargs="*", help="bar, tray, crate; none: all")
    parser.add_argument(
        "--every", type=int, default=1, help="solve and verify one state in so many"
    )
    given = parser.parse_args()
    names = given.tasks or [*TASKS]
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=spawn, max_tasks_per_child=1) as processes:
        asked = [
            processes.submit(told, name, with_margin=kept, every=given.every)
            for name in names
            for kept in (True, False)
        ]
        answers = list[tuple[bool, dict[str, str]]]()
        for one in asked:
            answers.append(one.result())
            print(answers[-1][1], file=sys.stderr, flush=True)
    labels = dict.fromkeys(label for _, row in answers for label in row)
    lines = [[label, *(row.get(label, "") for _, row in answers)] for label in labels]
    print(tabulate(lines, tablefmt="github", headers="firstrow", disable_numparse=True))
    return int(not all(sound for sound, _ in answers))


if __name__ == "__main__":
    sys.exit(main())
