"""Check the verdict of a document on whether rest is what happens with its torques."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify.figures import Problem
from graspless_pin.report.verify.kept_tree import KeptWalk, kept_goals
from graspless_pin.report.verify.outcome import Check, agrees, given, holds, within
from graspless_pin.report.verify.rest_load import BALANCED, LARGEST_FORCE, RestLoad, read_load
from graspless_pin.report.verify.rest_proof import certificate, force_limit, stated_loads, tree
from graspless_pin.report.verify.rest_tree import read_rest_tree
from graspless_pin.report.verify.values import array, entry, number, word

_STATUSES = ("strong", "weak", "none", "undecided")
_MOTION = 1e-6
"""By how much a motion may break a condition, scaled; of friction the power that it lacks, too."""


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
        self.limit = bodies.limit(
            number(entry(stated, "acceleration_resolution", where), "acceleration_resolution")
        )

    def run(self) -> list[Check]:
        checks = [given("inertias", "as they are stated" if self.is_known else "not known")]
        if self.is_known:
            stated = number(entry(self.stated, "acceleration_limit", "stability"), "a limit")
            tolerance = 1e-9 * abs(self.limit)
            checks.append(agrees("acceleration limit", stated, self.limit, tolerance, "m/s^2"))
        if self.status == "undecided":
            return [*checks, holds("whether rest is what happens", passed=True,
                                   detail="undecided: nothing is claimed")]  # fmt: skip
        if self.status == "none":
            return [*checks, self._no_rest(), *self._motion()]
        checks.append(self._rest())
        if self.status == "weak":
            return [*checks, *self._motion()]
        return [*checks, *self._strong()]

    def _rest(self) -> Check:
        local = self.bodies.forces("rest_forces", self.stated, "stability")
        return within("rest is an outcome", self.bodies.amiss(local), BALANCED, "loads")

    def _no_rest(self) -> Check:
        """Along some motion all contact forces do work of one sign, and the load of the other."""
        shape = self.bodies.load.shape
        z = array(entry(self.stated, "no_rest", "stability"), shape, "no_rest")
        left = self.bodies.left_by_all(z)
        return holds("rest is no outcome", left > BALANCED, f"{left:.3g} loads are unbalanced")

    # motion

    def _motion(self) -> list[Check]:
        """Return the checks of the stated motion: each condition of an outcome, scaled."""
        motion = entry(self.stated, "motion", "stability")
        if motion is None and self.status == "none":
            return []
        if self.dynamics is None:
            return [holds("a motion is an outcome", passed=False, detail="no inertia is known")]
        dynamics, where = self.dynamics, "the motion"
        kept = np.concatenate([np.ones(6, dtype=bool), self.bodies.hybrid < 0])
        acceleration = np.concatenate(
            [
                array(entry(motion, "object_acceleration", where), (6,), where),
                array(
                    entry(motion, "joint_accelerations", where), (len(self.bodies.hybrid),), where
                ),
            ]
        )
        y = np.linalg.solve(dynamics.accelerations[kept], acceleration[kept])
        f = self.bodies.forces("contact_forces", motion, where) / dynamics.force_unit
        off = self.bodies.misdirected(f)
        f[self.problem.slides, 1:] = 0.0  # it is in the pushes
        u = dynamics.rows @ y
        held = np.isfinite(dynamics.commanded)
        most = dynamics.friction * f[:, 0]
        slips = np.linalg.norm(u[:, 1:], axis=1)
        power = float(y @ y + most @ slips)
        scale = np.sqrt(max(power, 0.0))
        commanded = np.abs(f[:, 0] - dynamics.commanded)[held].max(initial=0.0)
        left = y - np.einsum("lin,li->n", dynamics.pushes, f) - dynamics.load
        rubbing = np.linalg.norm(f[:, 1:], axis=1)
        gaps = np.abs((f * u).sum(axis=1) + most * slips)
        outside = max(float((rubbing - most).max()), -f[:, 0].min(), off)
        speed = float(np.linalg.norm(dynamics.points @ y, axis=1).max())
        told = number(entry(motion, "point_acceleration", where), "point_acceleration")
        largest_force = max(1.0, float(np.abs(f).max()))
        checks = [
            within("a motion obeys the dynamics", float(np.abs(left).max()),
                   _MOTION * scale, "(scaled)"),
            within("its forces are in the cones, and as commanded", max(outside, commanded),
                   _MOTION * largest_force, "(scaled)"),
            within("it penetrates nothing", -u[:, 0].min(), _MOTION * scale, "(scaled)"),
            within("friction opposes its slip, and what parts bears nothing", gaps.sum(),
                   _MOTION * power, "(scaled)"),
            agrees("its largest acceleration", told, speed, 1e-6 * max(speed, self.limit), "m/s^2"),
        ]  # fmt: skip
        if self.status == "weak":
            detail = f"{speed:.6g} m/s^2, limit {self.limit:.6g}"
            checks.append(holds("it is above the limit", speed > self.limit, detail))
        return checks

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
