"""Runs of placed grips in MuJoCo: what stays, and how fast what moves grows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from tabulate import tabulate

from graspless_pin import Scene
from graspless_pin.holding.verdict import BRIEF_NODE_LIMIT
from graspless_pin.problem.checks import FloatArray
from graspless_pin.simulation import SimulatedRun, simulate
from graspless_pin.simulation.model import STIFF, ContactModel

NODES = BRIEF_NODE_LIMIT
MARGIN = 0.1  # N, of Algorithm 2
SECONDS, LONGEST, GROWTHS = 2.0, 20.0, 6.0
"""s of runs; of those in which a motion grows so many times its time constant, s at most."""
START = 1e-4, 1e-3
"""m, rad: how far along a motion that grows a run begins."""
FINGER_MOVED = float(np.radians(2.0))
"""rad: a joint that goes farther does not stay, whatever the object does."""
_OUTCOMES = "held", "shifted", "crept", "moved"
FITTED = 2.0, 10.0
"""Of the start: growth is read off between these. Beyond them motions are not small."""


class GripRun(NamedTuple):
    """What became of a grip.

    Attributes:
        outcome: What the object does.
        fingers: Largest way of a joint, rad.
        measured: Rate of growth, 1/s; None: nothing grew far enough.
        displacement: m.
        rotation: rad.
    """

    outcome: str
    fingers: float
    measured: float | None
    displacement: float
    rotation: float

    @property
    def stays(self) -> bool:
        """Whether object and joints stay."""
        return self.outcome == "held" and self.fingers < FINGER_MOVED


def run_of(
    scene: Scene,
    torques: FloatArray,
    motion: FloatArray | None = None,
    growth: float = 0.0,
    model: ContactModel = STIFF,
) -> GripRun:
    """Return what becomes of torques under the scene's controller.

    Args:
        scene: The scene.
        torques: (L,) N m (N).
        motion: (6 + L,) along which the run begins; None: at rest.
        growth: Rate at which that one grows, 1/s.
        model: How hard bodies are.
    """
    span = min(max(GROWTHS / growth, SECONDS), LONGEST) if growth > 0.0 else SECONDS
    start = None if motion is None else _start(motion)

    def run(seconds: float, start: FloatArray | None) -> SimulatedRun:
        (done,) = simulate(
            scene, torques, seconds=seconds, displacement=start, contact_models=[model]
        ).runs
        return done

    done = run(span, start)
    moves = np.abs(done.joint_moves - done.joint_moves[0])
    measured = None
    if growth > 0.0 and start is not None:
        measured = growth_between(done, run(done.times[-1], -start))
    return GripRun(
        str(done.outcome),
        float(moves.max(initial=0.0)),
        measured,
        done.displacement,
        done.rotation,
    )


def outcome_table(found: Sequence[Any], by: Mapping[str, str], cases: str) -> str:
    """Return how many cases end how.

    Args:
        found: The cases; each has an ``outcome``, and tells whether it ``stays``.
        by: Names of what rows tell apart, and what it is called.
        cases: What cases are called.
    """
    told, rows = attrgetter(*by), []
    for key in sorted(set(map(told, found)), reverse=True):
        own = [one for one in found if told(one) == key]
        counts = Counter(one.outcome for one in own)
        fingers = sum(one.outcome == "held" and not one.stays for one in own)
        outcomes = [counts[kind] for kind in _OUTCOMES]
        rows.append([*key, len(own), *outcomes, fingers])
    return tabulate(rows, [*by.values(), cases, *_OUTCOMES, "held, a finger moved"], "github")


def _start(motion: FloatArray) -> FloatArray:
    """Return a motion (6 + L,) as long as a run's start."""
    sizes = np.concatenate([np.full(3, START[0]), np.full(len(motion) - 3, START[1])])
    return motion / np.abs(motion / sizes).max()


def growth_between(run: SimulatedRun, other: SimulatedRun) -> float | None:
    """Return the rate at which two runs part that begin on either side of the rest, 1/s.

    What both do, such as a shift while the object is let go, is no growth.
    """
    count = min(len(run.times), len(other.times))
    one, two = run.T_world_object[:count], other.T_world_object[:count]
    way = np.linalg.norm(one[:, :3, 3] - two[:, :3, 3], axis=1)
    turn = np.linalg.norm(one[:, :3, :3] - two[:, :3, :3], axis=(1, 2)) / np.sqrt(2)
    moves = np.abs(run.joint_moves[:count] - other.joint_moves[:count])
    joints = moves.max(axis=1, initial=0.0)
    size = 0.5 * np.max([way / START[0], turn / START[1], joints / START[1]], axis=0)
    low, high = FITTED
    past = np.flatnonzero(size > high)
    end = int(past[0]) if len(past) else count
    under = np.flatnonzero(size[:end] < low)
    begin = int(under[-1]) + 1 if len(under) else 0
    if end - begin < 3 or size[end - 1] < 0.5 * high:
        return None
    return float(np.polyfit(run.times[begin:end], np.log(size[begin:end]), 1)[0])
