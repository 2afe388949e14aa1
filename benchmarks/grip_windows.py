"""Placed grips: torques that hold without feedback, and the ends of windows of squeeze.

Both are held against MuJoCo with stiff bodies; see `benchmarks.real_grips`, which runs this.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tabulate import tabulate

from benchmarks.grip_runs import MARGIN, NODES, run_of
from graspless_pin import (
    Controller,
    Holding,
    Scene,
    TorqueSolution,
    squeeze_window,
)
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.objectives import Margin, Objective, Torque
from graspless_pin.scene.minimum_stiffness import linearized_motions
from graspless_pin.solvers import Outcome, solve

ABOVE = 1.5
"""Times the feedback that is said to be needed."""
LEAST_GAIN = 0.2
"""N m/rad: of grips that hold without feedback."""
SHARES = 0.5
"""Of the feedback that is needed, with which torques are looked for beside those without any."""
INSIDE, OUTSIDE = 0.02, 0.05
"""Of the width of a window: how far from its ends torques are tried."""
SAMPLES, PRECISION, WINDOW_NODES = 6, 2e-3, 300
RANDOM, CORNERS = 500, 24
"""Torques of the feasible set, and how many of its corners they are between."""


@dataclass(frozen=True)
class StableCase:
    """Torques that are to hold under a controller that the best case needs more than.

    Attributes:
        grip: Hand, object and rank.
        algorithm: Whose torques.
        stiffness: Of the controller, N m/rad (N/m).
        needed: By the best case's torques.
        best: Their value, N or N m (N).
        value: That of the torques found; None: none were.
        at_random: How many torques were tried at random until some held; None: none did.
        seconds: Of the search.
        outcome: What the object does in the simulation; empty: there are no torques.
        stays: Whether object and joints stay.
    """

    grip: str
    algorithm: str
    stiffness: float
    needed: float
    best: float
    value: float | None
    at_random: int | None
    seconds: float
    outcome: str
    stays: bool

    def __str__(self) -> str:
        """Return it in one line."""
        found = "none" if self.value is None else f"{self.value:.4g}"
        at_random = "none" if self.at_random is None else f"{self.at_random} tried"
        return (
            f"{self.grip}, {self.algorithm}, {self.stiffness:.3g} of {self.needed:.3g} N m/rad: "
            f"{found}, best case {self.best:.4g} ({self.seconds:.1f} s); at random: {at_random}; "
            f"{self.outcome}"
        )


@dataclass(frozen=True)
class EndCase:
    """Torques near an end of a window of squeeze.

    Attributes:
        grip: Hand, object and rank.
        stiffness: Of the controller, N m/rad (N/m).
        end: ``lower`` or ``upper``.
        reason: What ends the window there.
        amounts: Of both ends.
        side: ``inside`` or ``outside``.
        holding: What is said of the torques.
        growth: Rate of the small motion that is said to grow, 1/s.
        outcome: What the object does in the simulation.
        stays: Whether object and joints stay.
        measured: Rate of growth in the simulation, 1/s; None: nothing grew far enough.
    """

    grip: str
    stiffness: float
    end: str
    reason: str
    amounts: tuple[float, float]
    side: str
    holding: str = ""
    growth: float = 0.0
    outcome: str = ""
    stays: bool = False
    measured: float | None = None

    @property
    def counts(self) -> bool:
        """Whether anything is claimed of it."""
        return self.side == "inside" or self.reason in ("slips", "grows")

    @property
    def is_as_said(self) -> bool:
        """Whether it stays inside, and outside does not."""
        return self.stays is (self.side == "inside")

    def __str__(self) -> str:
        """Return it in one line."""
        measured = "-" if self.measured is None else f"{self.measured:.3g}"
        return (
            f"{self.grip}, {self.stiffness:.3g} N m/rad, {self.amounts[0]:+.3f} to "
            f"{self.amounts[1]:+.3f}, {self.side} {self.end} ({self.reason}): {self.holding}, "
            f"growth {self.growth:.3g} (measured {measured}); {self.outcome}"
        )


def stable_cases(scene: Scene, grip: str) -> Iterator[StableCase]:
    """Yield what is found for a grip whose best case needs feedback, without any and with less."""
    for algorithm in ("margin", "torque"):
        more: dict[str, Any] = {"margin": MARGIN} if algorithm == "torque" else {}
        best = scene.solve(algorithm, **more)
        if not best.found:
            continue
        said = scene.stability(best.torques, node_limit=NODES)
        needed = said.stiffness_needed
        if said.holding is not Holding.NEEDS_FEEDBACK or not np.isfinite(needed):
            continue
        for stiffness in (0.0, SHARES * needed):
            held = scene.with_changes(controller=Controller(stiffness))
            begin = time.process_time()
            found = held.solve(algorithm, stability="strong", verdict_nodes=NODES, **more)
            seconds = time.process_time() - begin
            outcome, stays = "", False
            if found.found:
                run = run_of(held, found.torques)
                outcome, stays = run.outcome, run.stays
            aim = Margin() if algorithm == "margin" else Torque(MARGIN)
            yield StableCase(
                grip, algorithm, stiffness, needed, best.value, _value(found),
                _tried_at_random(held, aim), seconds, outcome, stays,
            )  # fmt: skip


def _value(found: TorqueSolution) -> float | None:
    return found.value if found.found else None


def _tried_at_random(scene: Scene, aim: Objective) -> int | None:
    """Return how many torques of the feasible set were tried until some hold; None: none of them.

    Torques are drawn between corners of the set of contact forces that the objective allows, in
    random directions. Those under whose own forces a small motion grows are not looked at further.
    """
    rng = np.random.default_rng(1)
    problem = scene.problem()
    formulation = formulate(problem, aim)
    program, coordinates = formulation.program, formulation.coordinates
    low = program.lb.copy()
    for block in program.bounded_blocks:
        if block.name == "margin":
            low[block.at] = np.maximum(low[block.at], 0.0)
    corners = []
    for _ in range(CORNERS):
        c = np.zeros(len(program.c))
        c[: coordinates.layout.size] = rng.normal(size=coordinates.layout.size)
        turned = type(program)(
            P=np.zeros_like(program.P), c=c, A=program.A, b=program.b, G=program.G, l=program.l,
            u=program.u, lb=low, ub=program.ub, box=program.box, whole_box=program.whole_box,
            cone_count=program.cone_count,
        )  # fmt: skip
        answer = solve(turned)
        if answer.outcome is Outcome.SOLVED:
            corners.append(coordinates.forces(answer.x))
    motions = linearized_motions(scene)
    if not corners:
        return None
    for number in range(1, RANDOM + 1):
        shares = rng.dirichlet(np.full(len(corners), 0.2))
        forces = np.einsum("c,cmi->mi", shares, np.array(corners))
        if any(motion.fastest_growth(motion.stiffness(forces))[0] > 0.0 for motion in motions):
            continue
        torques = problem.gravity_torques + problem.jacobian.T @ forces.ravel()
        if scene.stability(torques, node_limit=WINDOW_NODES).holding is Holding.HOLDS:
            return number
    return None


def end_cases(scene: Scene, grip: str) -> Iterator[EndCase]:
    """Yield what becomes of torques near the ends of a grip's window, under gains that hold it."""
    best = scene.solve("torque", margin=MARGIN)
    if not best.found:
        return
    said = scene.stability(best.torques, node_limit=NODES)
    if said.holding not in (Holding.HOLDS, Holding.NEEDS_FEEDBACK):
        return
    stiffness = max(ABOVE * said.stiffness_needed, LEAST_GAIN)
    held = scene.with_changes(controller=Controller(stiffness))
    try:
        window = squeeze_window(
            held, best.torques, samples=SAMPLES, precision=PRECISION, node_limit=WINDOW_NODES
        )
    except ArgumentError:  # nothing squeezes
        return
    lower, upper = window.lower, window.upper
    if lower is None or upper is None:
        return
    amounts = lower.amount, upper.amount
    for name, end in (("lower", lower), ("upper", upper)):
        for side in ("inside", "outside"):
            asked = EndCase(grip, stiffness, name, str(end.reason), amounts, side)
            found = _end_case(held, asked, best.torques)
            if found is not None:
                yield found


def _end_case(scene: Scene, asked: EndCase, torques: FloatArray) -> EndCase | None:
    """Return what becomes of torques on one side of an end; None where no limit leaves such ones.

    Args:
        scene: The grip with its gains.
        asked: Which end, and which side.
        torques: (L,) of the grip, around which the window is, N m (N).
    """
    low, high = asked.amounts
    end, sign = (high, 1.0) if asked.end == "upper" else (low, -1.0)
    way = sign * (-INSIDE if asked.side == "inside" else OUTSIDE) * (high - low)
    try:
        near = squeeze_window(scene, torques, samples=[end + way], precision=1.0, node_limit=0)
    except ArgumentError:
        return None
    (tried,) = near.torques[near.amounts != 0.0]
    said = scene.stability(tried, node_limit=NODES)
    small = said.small_motions
    run = run_of(scene, tried, None if small is None else small.motion, said.growth_rate)
    return replace(
        asked, holding=str(said.holding), growth=said.growth_rate, outcome=run.outcome,
        stays=run.stays, measured=run.measured,
    )  # fmt: skip


def window_summary(stable: Sequence[StableCase], ends: Sequence[EndCase]) -> str:
    """Return the tables, and each case that is not as it is said to be."""
    either = [one for one in stable if one.value is not None or one.at_random is not None]
    found = [one for one in stable if one.value is not None]
    free = [one for one in found if one.stiffness == 0.0]
    lines = [
        f"- torques that hold under less feedback than the best case needs: {len(found)} of "
        f"{len(either)} that the search or {RANDOM} torques at random find (wanted 80%)",
        f"- of those for constant torques, held: {sum(one.stays for one in free)} of {len(free)} "
        "(wanted 98%)",
        f"- of those for half the feedback, held: "
        f"{sum(one.stays for one in found if one.stiffness)} of {len(found) - len(free)}",
        "",
    ]
    keys = Counter((one.end, one.reason, one.side) for one in ends)
    rows = []
    for key, count in sorted(keys.items()):
        own = [one for one in ends if (one.end, one.reason, one.side) == key]
        good = sum(one.is_as_said for one in own)
        rows.append([*key, count, f"{good}" if own[0].counts else "-"])
    lines.append(tabulate(rows, ["end", "reason", "side", "cases", "as said"], "github"))
    grips = len({one.grip for one in ends})
    sides = [[one for one in ends if one.counts and one.side == side]
             for side in ("inside", "outside")]  # fmt: skip
    shares = [f"{sum(one.is_as_said for one in own)} of {len(own)} {own[0].side}"
              for own in sides if own]  # fmt: skip
    lines += ["", f"Ends of windows of {grips} grips as said: {', '.join(shares)}.", "", "Not so:"]
    lines += [f"- {one}" for one in ends if one.counts and not one.is_as_said]
    lines += [f"- {one}" for one in found if not one.stays]
    lines += [f"- {one}" for one in either if one.value is None]
    return "\n".join(lines)
