"""Check the verdict of a document on whether rest is what happens with its torques.

Go through a proof that nothing but a declared motion is an outcome.

Where friction rubs its power has no sign, and accelerations are bounded by linear duality alone:
for all multipliers, with lambda = p + sum (nu A_n + kappa.A_t), y = B^T f + h and u = A y,

    p.y = lambda.h + sum (B lambda).f - sum (nu u_n + kappa.u_t).

Each node states what is proven there and below. A leaf needs both signs of the accelerations of all
passive coordinates, small enough together that no point of the object accelerates above the limit,
or goal 0, p = 0, below zero: then there is no outcome in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from textwrap import shorten

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import Part
from graspless_pin.report.verify.holding import holding_checks
from graspless_pin.report.verify.outcome import Check, agrees, given, holds, within
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.rest_bounds import (
    Kind,
    KnownStates,
    RestDynamics,
    RestMultipliers,
    allowed_normals,
    contact_motion,
    least_product,
    most_of_forces,
)
from graspless_pin.report.verify.rest_load import LARGEST_FORCE, RestLoad, read_load
from graspless_pin.report.verify.rest_tree import (
    NoProofError,
    RestNode,
    certificate,
    force_limit,
    read_rest_tree,
    stated_loads,
    tree,
    uncovered,
)

_LONG = np.longdouble
_EMPTY = -0.1
"""Multipliers of any size prove the same of no outcome: by how much is no tolerance."""


def kept_goals(dynamics: RestDynamics, problem: Problem, limit: float) -> np.ndarray:
    """(2 P + 1, n) zero, and both signs of accelerations; one object's in limit / (2 sqrt(3)).

    Args:
        dynamics: The scaled dynamics.
        problem: What they are of: its levers count.
        limit: Accelerations of points up to this are none, m/s^2.
    """
    scale = problem.levers[:, None] * (problem.goal_weight / limit)
    ways = scale * dynamics.accelerations[: dynamics.passive]
    return np.concatenate([np.zeros((1, ways.shape[1])), ways, -ways])


def kept_goal(
    dynamics: RestDynamics,
    states: KnownStates,
    multipliers: RestMultipliers,
    goal: np.ndarray,
    force_limit: float,
) -> float:
    """Return what p.y is at most in all outcomes in these states.

    Args:
        dynamics: The scaled dynamics.
        states: Of the contacts.
        multipliers: nu and kappa; lambda follows from them.
        goal: p (n,).
        force_limit: Normal forces are at most this, scaled.
    """
    rows, pushes = dynamics.rows.astype(_LONG), dynamics.pushes.astype(_LONG)
    nu, mu = allowed_normals(dynamics, states, multipliers.normal), dynamics.friction
    sticks, slips = states.are(Kind.STICKING), states.are(Kind.SLIPPING)
    kappa = multipliers.tangential.astype(_LONG)
    half_width = np.where(slips, states.half_width, np.pi)
    motion = goal + nu @ rows[:, 0] + np.einsum("li,lin->n", kappa, rows[:, 1:])
    rough = np.abs(goal) + np.abs(nu) @ np.abs(rows[:, 0])
    rough = rough + np.einsum("li,lin->n", np.abs(kappa), np.abs(rows[:, 1:]))
    slope, none = (pushes @ motion, np.abs(pushes) @ rough), np.zeros(len(rows))
    pushed = most_of_forces(dynamics, states, half_width, slope, none, none, force_limit)
    # What rounding leaves of -kappa.u_t, with the longest slip that such forces make.
    wrong = np.maximum(-least_product(kappa, states.center, half_width), 0.0)
    wrong = wrong + tolerances.lost(np.linalg.norm(kappa, axis=1))
    wrong = np.where(sticks, 0.0, wrong) @ np.linalg.norm(rows[:, 1:], axis=(1, 2))
    held, opened = np.isfinite(dynamics.commanded), states.are(Kind.OPEN)
    most = np.where(opened, 0.0, np.where(held, dynamics.commanded, force_limit))
    longest = np.linalg.norm(pushes, axis=2)
    fastest = most @ (longest[:, 0] + mu * longest[:, 1:].sum(axis=1))
    bound = motion @ dynamics.load + pushed.sum()
    bound += wrong * (np.linalg.norm(dynamics.load) + fastest)
    size = rough @ np.abs(dynamics.load) + np.abs(pushed).sum()
    return float(bound + tolerances.lost(size))


@dataclass(eq=False)
class KeptWalk:
    """A walk through one proof.

    Attributes:
        dynamics: The scaled dynamics.
        goals: (2 P + 1, n) of `kept_goals`.
        force_limit: Normal forces that the proof has to reach, scaled.
        leaves: How many there were.
    """

    dynamics: RestDynamics
    goals: np.ndarray
    force_limit: float
    leaves: int = 0

    def walk(self, root: RestNode) -> None:
        """Go through all nodes.

        Raises:
            NoProofError: If they leave out outcomes.
        """
        self._visit(root, KnownStates.unknown(len(self.dynamics.rows)), frozenset())

    def _visit(self, node: RestNode, states: KnownStates, proven: frozenset[int]) -> None:
        for goal, multipliers in node.sides:
            most = _EMPTY if goal == 0 else 1.0 + tolerances.SHARE
            bound = kept_goal(
                self.dynamics, states, multipliers, self.goals[goal], self.force_limit
            )
            if not bound <= most:
                raise NoProofError(f"goal {goal} reaches {bound:.3g} where {most:.3g} is claimed")
            proven |= {goal}
        if not node.children:
            self.leaves += 1
            wanted = len(self.goals) - 1
            if 0 not in proven and len(proven) < wanted:
                raise NoProofError(f"a leaf bounds {len(proven)} of {wanted} accelerations")
            return
        contact = node.children[0].contact
        if any(child.forced or child.contact != contact for child in node.children):
            raise NoProofError(
                f"children of one node are of contact {contact} and others, or forced"
            )
        why = uncovered(node.children, states, np.isfinite(self.dynamics.commanded))
        if why:
            raise NoProofError(f"contact {contact}: {why}")
        for child in node.children:
            self._visit(child, states.changed(contact, child.kind, child.arc), proven)


_WORDS = {
    "strong": ("holds", "keeps", "needs", "stays", "may "),
    "weak": ("may ",),
    "none": ("fails", "loses"),
    "undecided": ("undecided",),
}
"""How sentences of each status begin; only strong ones claim that the object stays."""
_TOLD = "free_motions", "moves"


def rest_checks(document: object, problem: Problem) -> list[Check]:
    """Return the checks of the verdict under ``stability``; none where there is none.

    Args:
        document: The document, with the motors' torques.
        problem: What it says of contacts and joints.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    whole = problem.part(document)
    stated = whole.get("stability")
    if stated is None:
        return []
    instant, bodies = stated["status"], read_load(document, problem)
    if stated.stated.get("joints_held", False) is not False:
        bodies = bodies.with_joints_held()
    under_controller = holding_checks(whole.get("holding"), instant, bodies)
    return [*under_controller, *verdict_checks(stated, bodies)]


def resolution_of(stated: Part) -> float:
    """Return the accelerations that count as rest, as a share of load over mass.

    Raises:
        ValueError: If there is none, or it is none that is asked for.
    """
    resolution = stated["acceleration_resolution"]
    if not resolution >= tolerances.FINEST * (1.0 - tolerances.SAME):
        raise ValueError(
            f"acceleration_resolution of {stated.where} is {resolution:g}; it must be at least "
            f"{tolerances.FINEST:g}"
        )
    return resolution


def verdict_checks(stated: Part, bodies: RestLoad) -> list[Check]:
    """Return the checks of a verdict on what bodies do under a load.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    return _Verdict(stated, bodies).run()


class _Verdict:
    """One verdict, and what it is about."""

    def __init__(self, stated: Part, bodies: RestLoad) -> None:
        self.stated, self.bodies, self.status = stated, bodies, stated["status"]
        self.problem, self.dynamics = bodies.problem, bodies.dynamics
        self.is_known, self.resolution = bodies.inertia is not None, resolution_of(stated)
        self.limit = bodies.limit(self.resolution)

    def run(self) -> list[Check]:
        checks = [given("inertias", "as they are stated" if self.is_known else "not known")]
        if self.bodies.joints_held:
            checks.append(given("joints", "keep their positions, whatever torques that takes"))
        rest = f"{self.resolution:g} of load over mass"
        if self.is_known:
            told, tolerance = self.stated["acceleration_limit"], tolerances.SAME * self.limit
            checks.append(agrees("acceleration limit", told, self.limit, tolerance, "m/s^2"))
            rest += f": points that accelerate by up to {self.limit:.3g} m/s^2 are at rest"
        checks += [given("resolution of accelerations", rest), *self._words()]
        claims = {key: self.stated[key] for key in _TOLD if self.stated.get(key) is not None}
        if claims:
            shown = ", ".join(f"{key} {str(value)[:20]}" for key, value in claims.items())
            checks.append(given("what small motions do, and what moves", shown))
        if self.status == "undecided":
            return [*checks, holds("whether the object stays", passed=True,
                                   detail="left undecided: nothing is claimed")]  # fmt: skip
        if not self.problem.coulombs_law:
            why = "a verdict is about Coulomb's law, and the cones are others"
            return [*checks, holds("whether the object stays", passed=False, detail=why)]
        if self.status == "none":
            return [*checks, self._no_rest(), *self._motion()]
        checks.append(self._rest())
        if self.status == "strong":
            fine = self.resolution <= tolerances.COARSEST
            detail = f"{self.resolution:g}, at most {tolerances.COARSEST:g} for strong"
            checks.append(holds("the resolution is fine enough", fine, detail))
        if self.status == "weak":
            return [*checks, *self._motion()]
        return [*checks, *self._strong()]

    def _words(self) -> list[Check]:
        """Return the check that the sentence does not say what another status would."""
        message = self.stated["message"] if "message" in self.stated.stated else ""
        own = _WORDS[self.status]
        others = [word for words in _WORDS.values() for word in words if word not in own]
        good = not message.startswith(tuple(others))
        short = shorten(message, 60, placeholder=" ...") or "no sentence"
        return [holds("the sentence and the status agree", good, short)]

    def _rest(self) -> Check:
        local = self.bodies.local(self.stated["rest_forces"])
        return within("rest is an outcome", self.bodies.amiss(local), tolerances.SHARE, "loads")

    def _no_rest(self) -> Check:
        """Along some motion all contact forces do work of one sign, and the load of the other."""
        left = self.bodies.left_by_all(self.stated["no_rest"])
        return holds(
            "rest is no outcome", left > tolerances.SHARE, f"{left:.3g} loads are unbalanced"
        )

    # motion

    def _motion(self) -> list[Check]:
        """Return the checks of the stated motion: each condition of an outcome, by the load."""
        motion, bodies, problem = self.stated.maybe("motion"), self.bodies, self.problem
        if motion is None and self.status == "none":
            return []
        if self.dynamics is None:
            return [holds("a motion is an outcome", passed=False, detail="no inertia is known")]
        motion = self.stated["motion"]
        acceleration = np.concatenate(
            [motion["object_acceleration"], motion["joint_accelerations"]]
        )
        f = bodies.local(motion["contact_forces"])
        off = bodies.misdirected(f)
        held = np.zeros(problem.count, dtype=bool)
        held[bodies.hybrid[bodies.hybrid >= 0]] = True
        commanded = np.abs(f[:, 0] - bodies.commanded)[held].max(initial=0.0)
        left = bodies.left_by_motion(f, acceleration)
        # Hybrid fingers follow; friction of what slides by the declared motion is in the dynamics.
        u = np.einsum("lik,k->li", contact_motion(problem), acceleration)
        u[held, 0] = 0.0
        friction = np.where(problem.slides, 0.0, problem.mu)
        f[problem.slides, 1:] = 0.0
        outside = np.linalg.norm(f[:, 1:], axis=1) - friction * f[:, 0]
        wrong = max(float(outside.max()), -float(f[:, 0].min()), off, float(commanded))
        # Where a contact slips its friction is against that; where it parts it bears nothing.
        slips, F = np.linalg.norm(u[:, 1:], axis=1), bodies.undisturbed.force
        way = u[:, 1:] / np.where(slips > 0.0, slips, 1.0)[:, None]
        against = np.linalg.norm(f[:, 1:] + (friction * f[:, 0])[:, None] * way, axis=1)
        unit = bodies.acceleration(bodies.undisturbed)
        gaps = np.minimum(against / F, np.where(problem.slides, 0.0, slips) / unit)
        gaps = np.maximum(gaps, np.minimum(np.abs(f[:, 0]) / F, np.maximum(u[:, 0], 0.0) / unit))
        speed = float(np.linalg.norm(problem.points @ acceleration[: len(problem.w)], axis=1).max())
        claimed, most = motion["point_acceleration"], tolerances.motion(self.resolution)
        checks = [
            within("a motion obeys the dynamics", left, most, "loads"),
            within("its forces are in the cones, and as commanded", wrong / F, most, "loads"),
            within("it penetrates nothing", -float(u[:, 0].min()) / unit, most, "loads over mass"),
            within("friction opposes its slip, and what parts bears nothing", float(gaps.max()),
                   most, "loads"),
            agrees("its largest acceleration", claimed, speed, most * unit, "m/s^2"),
        ]  # fmt: skip
        if self.status == "weak":
            detail = f"{speed:.6g} m/s^2, limit {self.limit:.6g}"
            checks.append(holds("it is above the limit", speed > self.limit, detail))
        return checks

    # proof

    def _strong(self) -> list[Check]:
        name, proof = "rest is the only outcome", self.stated.maybe("proof")
        if proof is None:
            return [Check(name, None, "no proof in the document")]
        limit, reach = force_limit(proof, LARGEST_FORCE * self.problem.force)
        if self.is_known and self.dynamics is None:
            return [holds(name, passed=True, detail="there is no load")]
        if (self.problem.slides & (self.problem.mu > 0.0)).any():
            return [reach, self._kept(proof, limit)]
        loads, checks = stated_loads(proof, self.bodies, self.dynamics, limit)
        forces = proof.maybe("forces")
        if forces is not None:
            shown = certificate(name, self.bodies, self.bodies.local(forces), loads, self.limit)
            return [*checks, *([reach] if checks else []), shown]
        if self.dynamics is None:
            return [*checks, holds(name, passed=False, detail="no inertia is known")]
        return [*checks, reach, tree(name, proof, self.dynamics, loads, (self.limit, limit))]

    def _kept(self, proof: Part, limit: float) -> Check:
        """Check that nothing but the declared motion is an outcome."""
        name, dynamics = "the declared motion is the only outcome", self.dynamics
        if dynamics is None or not np.isfinite(self.limit):
            return holds(name, passed=False, detail="no inertia is known")
        goals = kept_goals(dynamics, self.problem, self.limit)
        walk = KeptWalk(dynamics, goals, limit / dynamics.force_unit)
        try:
            walk.walk(read_rest_tree(proof, dynamics))
        except NoProofError as error:
            return holds(name, passed=False, detail=str(error))
        return holds(name, passed=True, detail=f"{walk.leaves} leaves")
