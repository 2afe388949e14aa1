"""OMPL plans, Pink follows, and every state that the hand reaches is evaluated and verified.

Needs the extra ``planning``. Writes the path as CSV and as a trajectory of ROS, and draws it. See
``docs/tutorial_planning.md``.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pink
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from matplotlib.figure import Figure
from task import GOAL, LOWER, START, TIPS, UPPER, Task
from with_ompl import plan

from graspless_pin import Evaluator, Waypoint, evaluate_path
from graspless_pin.planning import PathProfile, joint_trajectory, write_path_csv
from graspless_pin.plots import path_torques
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

OUTPUT = Path("out/slide_and_pivot")
KEPT = 0.7  # N, a little less than the planner keeps: for what Pink leaves of its goals


def follow(task, states):
    """(S, a) joint positions: Pink moves the hand along (S, 3) states, a step for each."""
    configuration = pink.Configuration(task.model, task.data, task.joints(states[0]))
    carriage = pink.tasks.FrameTask("carriage", position_cost=1.0, orientation_cost=1.0)
    fingertips = [
        pink.tasks.FrameTask(name, position_cost=10.0, orientation_cost=0.0) for name in TIPS
    ]
    posture = pink.tasks.PostureTask(cost=1e-2)  # keeps the spread still where it moves no tip
    followed = [configuration.q.copy()]
    for state, duration in zip(states[1:], np.diff(task.times(states)), strict=True):
        posture.set_target(task.joints(state))
        carriage.set_target(task.palm(state))
        for one, goal in zip(fingertips, task.tip_goals(state[0]), strict=True):
            one.set_target(pin.SE3(np.eye(3), goal))
        tasks = [carriage, *fingertips, posture]
        velocity = pink.solve_ik(configuration, tasks, duration, solver="piqp")
        configuration.integrate_inplace(velocity, duration)
        followed.append(configuration.q.copy())
    return np.array(followed)


@dataclass(frozen=True, eq=False)
class Result:
    """What the followed path is worth, and the straight line from START to GOAL beside it."""

    states: np.ndarray  # (S, 3)
    straight: PathProfile
    tip_error: float  # m, largest distance of a fingertip from its point while Pink follows
    best: PathProfile  # Algorithm 1: the largest margin of each state that Pink reached
    least: PathProfile  # Algorithm 2: the smallest torques with the margin KEPT


def run():
    """Plan, follow and evaluate."""
    task = Task()
    corners = plan(task)
    if corners is None:
        raise SystemExit("no path found; try another seed")
    states = task.along(corners)
    followed = follow(task, states)
    waypoints = [
        Waypoint(dict(zip(task.names, q, strict=True)), task.box(state[0]).np, time)
        for state, q, time in zip(states, followed, task.times(states), strict=True)
    ]
    tips = np.array([task.tips(q) for q in followed])
    off = tips - [task.tip_goals(state[0]) for state in states]
    torque = Evaluator(task.scene, algorithm="torque", margin=KEPT)
    return Result(
        states,
        task.profile(task.waypoints([START, GOAL])),
        float(np.linalg.norm(off, axis=2).max()),
        task.profile(waypoints),
        evaluate_path(torque, waypoints),
    )


def verified(profile):
    """How many states an independent checker, which has numpy alone, finds right."""
    return sum(
        verify_document(solution_document(state.solution, state.scene)).passed
        for state in profile.evaluations
        if state.found
    )


def draw_placements(axes, result, task):
    lifts, pitches = np.linspace(LOWER[1], UPPER[1], 13), np.linspace(LOWER[2], UPPER[2], 19)
    margins = np.full((len(lifts), len(pitches)), np.nan)
    for row, lift in enumerate(lifts):
        for column, pitch in enumerate(pitches):
            state = task.configuration(np.array([0.5, lift, pitch]))
            if state is not None:
                margins[row, column] = task.evaluator.evaluate(*state, task.box_rate(0.5)).margin
    margins[np.isinf(margins)] = np.nan
    filled = axes.contourf(pitches, 1e3 * lifts, margins, 12, cmap="cividis")
    axes.figure.colorbar(filled, label="largest margin while sliding [N]")
    axes.contour(pitches, 1e3 * lifts, margins, [KEPT], colors="white", linestyles="--")
    straight = task.along([START, GOAL])
    for name, states, color in (("planned", result.states, "red"), ("straight", straight, "black")):
        slides = states[:, 0] <= 1.0
        for part, style, verb in ((slides, "-", "slides"), (~slides, ":", "pivots")):
            _, lift, pitch = states[part].T
            axes.plot(pitch, 1e3 * lift, style, color=color, lw=2.5, label=f"{name}, {verb}")
    axes.set(xlabel="pitch of the palm [rad]", ylabel="lift of the palm [mm]")
    axes.set_title(f"Palm relative to the box; dashed: {KEPT:g} N")
    axes.legend(loc="upper left", fontsize="small")


def draw_margins(axes, result, task):
    straight = task.along([START, GOAL])
    axes.plot(straight[:, 0], result.straight.margins, color="black", label="straight")
    axes.plot(result.states[:, 0], result.best.margins, color="red", label="planned")
    axes.axhline(KEPT, color="gray", linestyle="--", label="asked for")
    axes.set(xlabel="progress", ylabel="margin e [N]", title="Largest margin within the limits")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.25)
    axes.legend()


def draw(result, file):
    task = Task()
    figure = Figure(figsize=(17, 5), layout="constrained")
    placements, margins, torques = figure.subplots(1, 3)
    draw_placements(placements, result, task)
    draw_margins(margins, result, task)
    path_torques(result.least, ax=torques)
    torques.set_ylabel("motor torque [N m]")
    torques.set_title(f"Smallest torques with a margin of {KEPT:g} N, limit 0.6 N m")
    figure.savefig(file, dpi=110)


def main(output=OUTPUT):
    result = run()
    output.mkdir(parents=True, exist_ok=True)
    write_path_csv(result.least, output / "path.csv")
    text = json.dumps(joint_trajectory(result.least), indent=1)
    (output / "trajectory.json").write_text(text, encoding="utf-8")
    draw(result, output / "path.png")
    count = len(result.states)
    print(f"{count} states; fingertips within {1e3 * result.tip_error:.3f} mm of their points")
    print(f"smallest margin: {result.best.smallest_margin:.3f} N, asked for {KEPT:g} N;")
    print(f"  {result.straight.smallest_margin:.3f} N on the straight line")
    print(f"largest torque: {np.abs(result.least.torques).max():.3f} N m, limit 0.6 N m")
    print(f"verified: {verified(result.best)} and {verified(result.least)} of {count}")
    print(f"written to {output}/: path.csv, trajectory.json, path.png")
    return result


if __name__ == "__main__":
    main()
