"""Check the verdict of a document on whether rest is what happens with its torques."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.figures import Problem
from graspless_pin.report.verify.kept_tree import KeptWalk, kept_goals
from graspless_pin.report.verify.outcome import Check, agrees, given, holds, within
from graspless_pin.report.verify.rest_bounds import contact_motion
from graspless_pin.report.verify.rest_load import LARGEST_FORCE, RestLoad, read_load
from graspless_pin.report.verify.rest_proof import certificate, force_limit, stated_loads, tree
from graspless_pin.report.verify.rest_tree import read_rest_tree
from graspless_pin.report.verify.values import array, entry, number, text, word

_STATUSES = ("strong", "weak", "none", "undecided")
_WORDS = {"strong": ("holds", "keeps", "stays"), "weak": ("may ",), "none": ("fails", "loses"),
          "undecided": ("undecided",)}  # fmt: skip
"""How sentences begin that only a verdict of one status may say."""
_TOLD = "free_motions", "stiffness_needed", "growth_rate", "moves"


def rest_checks(document: dict[str, Any], problem: Problem) -> list[Check]:
    """Return the checks of the verdict under ``stability``; none where there is none.

    Args:
        document: The document, with the motors' torques.
        problem: What it says of contacts and joints.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    stated = document.get("stability")
    return [] if stated is None else verdict_checks(stated, read_load(document, problem))


def resolution_of(stated: object, where: str) -> float:
    """Return the accelerations that count as rest, as a share of load over mass.

    Raises:
        ValueError: If there is none, or it is none that is asked for.
    """
    resolution = number(entry(stated, "acceleration_resolution", where), "acceleration_resolution")
    if not resolution >= tolerances.FINEST * (1.0 - tolerances.SAME):
        raise ValueError(
            f"acceleration_resolution of {where} is {resolution:g}; it must be at least "
            f"{tolerances.FINEST:g}"
        )
    return resolution


def verdict_checks(stated: Any, bodies: RestLoad) -> list[Check]:
    """Return the checks of a verdict on what bodies do under a load.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    return _Verdict(stated, bodies).run()


class _Verdict:
    """One verdict, and what it is about."""

    def __init__(self, stated: Any, bodies: RestLoad) -> None:
        self.stated, self.bodies = stated, bodies
        self.problem, self.dynamics = bodies.problem, bodies.dynamics
        where = "stability"
        self.status = word(entry(stated, "status", where), "status of stability", _STATUSES)
        self.is_known = bodies.inertia is not None
        self.resolution = resolution_of(stated, where)
        self.limit = bodies.limit(self.resolution)

    def run(self) -> list[Check]:
        checks = [given("inertias", "as they are stated" if self.is_known else "not known")]
        rest = f"{self.resolution:g} of load over mass"
        if self.is_known:
            stated = number(entry(self.stated, "acceleration_limit", "stability"), "a limit")
            tolerance = tolerances.SAME * self.limit
            checks.append(agrees("acceleration limit", stated, self.limit, tolerance, "m/s^2"))
            rest += f": points that accelerate by up to {self.limit:.3g} m/s^2 are at rest"
        checks += [given("resolution of accelerations", rest), *self._words()]
        told = {key: self.stated[key] for key in _TOLD if self.stated.get(key) is not None}
        if told:
            shown = ", ".join(f"{key} {str(value)[:20]}" for key, value in told.items())
            checks.append(given("what small motions do, and what moves", shown))
        if self.status == "undecided":
            return [*checks, holds("whether the object stays", passed=True,
                                   detail="left undecided: nothing is claimed")]  # fmt: skip
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
        said = text(self.stated.get("message", ""), "message of stability")
        others = [word for status, words in _WORDS.items() if status != self.status
                  for word in words]  # fmt: skip
        good = not said.startswith(tuple(others))
        return [holds("the sentence and the status agree", good, said[:60] or "no sentence")]

    def _rest(self) -> Check:
        local = self.bodies.forces("rest_forces", self.stated, "stability")
        return within("rest is an outcome", self.bodies.amiss(local), tolerances.SHARE, "loads")

    def _no_rest(self) -> Check:
        """Along some motion all contact forces do work of one sign, and the load of the other."""
        shape = self.bodies.load.shape
        z = array(entry(self.stated, "no_rest", "stability"), shape, "no_rest")
        left = self.bodies.left_by_all(z)
        return holds(
            "rest is no outcome", left > tolerances.SHARE, f"{left:.3g} loads are unbalanced"
        )

    # motion

    def _motion(self) -> list[Check]:
        """Return the checks of the stated motion: each condition of an outcome, by the load."""
        motion = entry(self.stated, "motion", "stability")
        if motion is None and self.status == "none":
            return []
        if self.dynamics is None:
            return [holds("a motion is an outcome", passed=False, detail="no inertia is known")]
        bodies, problem, where = self.bodies, self.problem, "the motion"
        acceleration = np.concatenate(
            [
                array(entry(motion, "object_acceleration", where), (6,), where),
                array(entry(motion, "joint_accelerations", where), (len(bodies.hybrid),), where),
            ]
        )
        f = bodies.forces("contact_forces", motion, where)
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
        speed = self._fastest(acceleration[:6])
        told = number(entry(motion, "point_acceleration", where), "point_acceleration")
        most = tolerances.motion(self.resolution)
        checks = [
            within("a motion obeys the dynamics", left, most, "loads"),
            within("its forces are in the cones, and as commanded", wrong / F, most, "loads"),
            within("it penetrates nothing", -float(u[:, 0].min()) / unit, most, "loads over mass"),
            within("friction opposes its slip, and what parts bears nothing", float(gaps.max()),
                   most, "loads"),
            agrees("its largest acceleration", told, speed, most * unit, "m/s^2"),
        ]  # fmt: skip
        if self.status == "weak":
            detail = f"{speed:.6g} m/s^2, limit {self.limit:.6g}"
            checks.append(holds("it is above the limit", speed > self.limit, detail))
        return checks

    def _fastest(self, acceleration: np.ndarray) -> float:
        """Return the largest acceleration of a contact point or of the centre, m/s^2."""
        at = acceleration[:3] + np.cross(acceleration[3:], self.problem.p)
        return float(np.linalg.norm(np.vstack([at, acceleration[:3]]), axis=1).max())

    # proof

    def _strong(self) -> list[Check]:
        name, proof = "rest is the only outcome", entry(self.stated, "proof", "stability")
        if proof is None:
            return [Check(name, None, "no proof in the document")]
        limit, reach = force_limit(proof, LARGEST_FORCE * self.problem.force)
        if self.is_known and self.dynamics is None:
            return [holds(name, passed=True, detail="there is no load")]
        if (self.problem.slides & (self.problem.mu > 0.0)).any():
            return [reach, self._kept(proof, limit)]
        loads, checks = stated_loads(proof, self.bodies, self.dynamics, limit)
        if entry(proof, "forces", "proof of rest") is not None:
            forces = self.bodies.forces("forces", proof, "proof")
            shown = certificate(name, self.bodies, forces, loads, self.limit)
            return [*checks, *([reach] if checks else []), shown]
        if self.dynamics is None:
            return [*checks, holds(name, passed=False, detail="no inertia is known")]
        return [*checks, reach, tree(name, proof, self.dynamics, loads, (self.limit, limit))]

    def _kept(self, proof: Any, limit: float) -> Check:
        """Check that nothing but the declared motion is an outcome."""
        name, dynamics = "the declared motion is the only outcome", self.dynamics
        if dynamics is None or not np.isfinite(self.limit):
            return holds(name, passed=False, detail="no inertia is known")
        lever = float(np.linalg.norm(self.problem.p, axis=1).max())
        goals = kept_goals(dynamics, lever, self.limit)
        walk = KeptWalk(dynamics, goals, limit / dynamics.force_unit)
        walk.walk(read_rest_tree(entry(proof, "nodes", "proof of the motion"), dynamics))
        return holds(name, not walk.failure, walk.failure or f"{walk.leaves} leaves")
