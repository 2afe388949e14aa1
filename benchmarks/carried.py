"""An object that moves with a link: states a second, beside full evaluation, and how both agree."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from graspless_pin import Evaluator, QuasistaticProblem, Scene, load_scene
from graspless_pin.algorithms.optimization import maximize_margin

_SCENE = Path(__file__).parents[1] / "examples" / "panda_carry_bar.yaml"
_LINK = "panda_hand"
_STATES = 2000
_MARGIN = 0.5
"""N, for Algorithm 2 and what is feasible."""
_FULL = 20
"""Full evaluation does one state in so many."""
_ROUNDS = 3
_STEP = 0.01
"""rad, root mean square over the joints, from one state of a path to the next."""
_LEG = 20
"""States of a path in one direction."""


def carried() -> str:
    """2000 states of a Panda with a bar, along paths and at random."""
    scene = load_scene(_SCENE)
    rows = []
    for algorithm in ("margin", "torque"):
        arm = Evaluator(scene, attached_to=_LINK, algorithm=algorithm, margin=_MARGIN)
        for name, q in (("paths", paths(arm)), ("random", drawn(arm))):
            rows.append([algorithm, name, *_row(scene, arm, q)])
    headers = ["algorithm", "states", "found", "full us", "attached us", "full / attached"]
    headers += ["unchecked us", "are_feasible us", "unchecked us", "is_feasible us"]
    table = tabulate(rows, headers, tablefmt="github", disable_numparse=True)
    note = (
        f"{_STATES} states in one process, of full evaluation with poses and contacts found anew "
        f"one in {_FULL}; processor time, fastest of {_ROUNDS} rounds. Unchecked: without "
        "collisions. The aim is 50 us along paths."
    )
    return f"## Carried objects\n\n{table}\n\n{note}\n\n{_agreement(scene)}"


def _row(scene: Scene, arm: Evaluator, q: np.ndarray) -> list[str]:
    algorithm = "margin" if arm.algorithm == "margin" else "torque"
    asked: Any = {"algorithm": algorithm, "required_margin": _MARGIN}
    free = Evaluator(scene, attached_to=_LINK, collisions=False, **asked)
    full = Evaluator(scene, **asked)
    some = q[::_FULL]
    poses = np.array([arm.scene_at(one).object.T_world_object for one in some])
    last = full.configuration()[len(arm.joint_names) :]
    whole = np.hstack([some, np.tile(last, (len(some), 1))])

    def one_by_one() -> None:
        for state in q[:200]:
            free.is_feasible(state)

    calls: list[tuple[Callable[[], object], int]] = [
        (lambda: full.evaluate_many(whole, poses, workers=1), len(some)),
        (lambda: arm.evaluate_many(q, workers=1), len(q)),
        (lambda: free.evaluate_many(q, workers=1), len(q)),
        (lambda: arm.are_feasible(q, workers=1), len(q)),
        (lambda: free.are_feasible(q, workers=1), len(q)),
        (one_by_one, 200),
    ]
    seconds = np.full(len(calls), np.inf)
    for _ in range(_ROUNDS):
        for k, (call, count) in enumerate(calls):
            start = time.thread_time()
            call()
            seconds[k] = min(seconds[k], (time.thread_time() - start) / count)
    each = [f"{1e6 * value:.1f}" for value in seconds]
    found = f"{100 * arm.evaluate_many(q, workers=1).found.mean():.0f} %"
    return [found, *each[:2], f"{seconds[0] / seconds[1]:.1f}", *each[2:]]


def _agreement(scene: Scene) -> str:
    """How margins of random states differ from those of problems put together for each state."""
    arm = Evaluator(scene, attached_to=_LINK, algorithm="margin", collisions=False)
    q = drawn(arm, seed=1)
    margins = arm.evaluate_many(q, workers=1).margins
    moved, anew, alike = 0.0, 0.0, 0
    for state, margin in zip(q, margins.tolist(), strict=True):
        moved = max(moved, abs(maximize_margin(moved_problem(scene, arm, state)).margin - margin))
        there = arm.scene_at(state)
        if not _leans(there):
            alike += 1
            anew = max(anew, abs(there.solve("margin").margin - margin))
    return (
        f"Of {len(q)} random states margins differ by at most {moved:.1e} N from those of the same "
        f"contacts moved along, and in the {alike} in which nothing else touches the bar by "
        f"{anew:.1e} N from those of contacts found anew."
    )


def _leans(scene: Scene) -> bool:
    try:
        return len(scene.contacts.bodies) != 8
    except ValueError:  # it is in something
        return True


def moved_problem(scene: Scene, arm: Evaluator, q: np.ndarray) -> QuasistaticProblem:
    """The problem of a state: contacts, their frames and the weight, turned with the link."""
    start: Any = scene.hand
    hand = start.with_configuration(dict(zip(arm.joint_names, q.tolist(), strict=True)))
    move = hand.pose_of(_LINK) @ np.linalg.inv(start.pose_of(_LINK))
    R, own, before = move[:3, :3], scene.contacts.arrays, scene.problem()
    points = own.positions @ R.T + move[:3, 3]
    center = R @ scene.object.center_of_mass_world + move[:3, 3]
    return QuasistaticProblem(
        points - center, own.normals @ R.T, [*(scene.object.mass * scene.gravity), 0, 0, 0],
        hand.contact_jacobian(own.bodies, points),
        friction=before.friction, tangents=R @ before.tangents,
        torque_limits=hand.effort_limits, max_normal_force=scene.max_normal_force,
        joint_names=hand.actuated_joint_names, joint_units=hand.effort_units,
        gravity_torques=hand.gravity_torques(scene.gravity),
    )  # fmt: skip


def paths(arm: Evaluator) -> np.ndarray:
    """Configurations along paths from the scene's that turn now and then."""
    rng, states = np.random.default_rng(0), [arm.configuration()]
    step = np.zeros(len(states[0]))
    for k in range(_STATES - 1):
        if k % _LEG == 0:
            step = rng.normal(size=len(step))
            step *= _STEP / np.sqrt(np.mean(step**2))
        states.append(np.clip(states[-1] + step, *arm.joint_limits))
    return np.array(states)


def drawn(arm: Evaluator, seed: int = 0) -> np.ndarray:
    """Configurations that are uniform within the limits."""
    lower, upper = arm.joint_limits
    return np.random.default_rng(seed).uniform(lower, upper, (_STATES, len(lower)))
