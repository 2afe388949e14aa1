"""Check the verdict of a document on whether rest is what happens with its torques."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify.figures import Problem
from graspless_pin.report.verify.kept_tree import KeptWalk, kept_goals
from graspless_pin.report.verify.outcome import Check, agrees, given, holds, within
from graspless_pin.report.verify.rest_bounds import (
    KnownStates,
    RestDynamics,
    commanded_contacts,
    contact_motion,
    force_motion,
    largest_goal,
    rest_dynamics,
)
from graspless_pin.report.verify.rest_tree import RestWalk, read_rest_multipliers, read_rest_tree
from graspless_pin.report.verify.values import MOST, array, entry, items, number, whole, word

_FORCE_LIMIT = 1e6
"""Proofs have to hold for normal forces up to so many loads."""
_STATUSES = ("strong", "weak", "none", "undecided")
_BALANCED = 1e-6
"""Of the load: forces that leave less of it unbalanced are forces of rest."""
_EXACT = 1e-8
"""Of the load, where no inertia tells what is moved by what is left of it."""
_MOTION = 1e-6
"""By how much a motion may break a condition, scaled; of friction the power that it lacks, too."""
_ROUNDING = 1e-6
"""Share by which a proven figure may be overstated."""
_SYMMETRIC = 1e-9


def rest_checks(document: dict[str, Any], problem: Problem) -> list[Check]:
    """Return the checks of the verdict under ``stability``; none where there is none.

    Args:
        document: The document, with the motors' torques.
        problem: What it says of contacts and joints.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    stated = document.get("stability")
    if stated is None:
        return []
    return _Verdict(document, stated, problem).run()


class _Verdict:
    """One verdict, and what was worked out of the problem for it."""

    def __init__(self, document: dict[str, Any], stated: Any, problem: Problem) -> None:
        self.stated, self.problem = stated, problem
        where = "stability"
        self.status = word(entry(stated, "status", where), "status of stability", _STATUSES)
        torques = [entry(joint, "torque", "a joint") for joint in document["joints"]]
        motors = array(torques, (len(problem.units),), "the joints' torques")
        self.load = np.concatenate([problem.w, motors - problem.gravity])
        self.local_motion, self.acting = contact_motion(problem), force_motion(problem)
        force, length = problem.force, problem.length
        self.unit = np.concatenate([np.repeat([force, force * length], 3), problem.joint_scale])
        self.resolution = number(
            entry(stated, "acceleration_resolution", where), "acceleration_resolution"
        )
        joints = len(problem.units)
        own, of_joints = document.get("object_inertia"), document.get("joint_inertia")
        inertia = np.zeros((6 + joints, 6 + joints))
        self.hybrid = np.full(joints, -1)
        if of_joints is not None:
            inertia[6:, 6:] = array(of_joints, (joints, joints), "joint_inertia")
            self.hybrid = commanded_contacts(problem, inertia[6:, 6:])
        self.is_known = own is not None and (of_joints is not None or not joints)
        self.dynamics: RestDynamics | None = None
        self.limit = np.nan
        if self.is_known:
            inertia[:6, :6] = array(own, (6, 6), "object_inertia")
            size = np.sqrt(np.abs(np.outer(inertia.diagonal(), inertia.diagonal())))
            if (np.abs(inertia - inertia.T) > _SYMMETRIC * size).any():
                raise ValueError("object_inertia and joint_inertia must be symmetric")
            self.limit = self.resolution * force / float(inertia[0, 0])
            self.dynamics = rest_dynamics(problem, self.load, inertia, self.hybrid)

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

    # rest

    def _unbalanced(self, forces: np.ndarray) -> float:
        """Return the largest entry of G^T f + g, in loads; forces (M, 3) in contact frames."""
        left = np.einsum("lik,li->k", self.local_motion, forces) + self.load
        return float(np.abs(left / self.unit).max())

    def _forces(self, key: str, mapping: object, where: str) -> np.ndarray:
        """(M, 3) forces in contact frames, N."""
        rows = array(entry(mapping, key, where), (self.problem.count, 3), f"{key} of {where}")
        return np.einsum("lij,lj->li", self.problem.frames, rows)

    def _rest(self) -> Check:
        local = self._forces("rest_forces", self.stated, "stability")
        size = self.problem.force
        slip = np.linalg.norm(local[:, 1:], axis=1) - self.problem.mu * local[:, 0]
        worst = max(
            self._unbalanced(local), float(-local[:, 0].min()) / size, float(slip.max()) / size,
            self._misdirected(local) / size,
        )  # fmt: skip
        return within("rest is an outcome", worst, _BALANCED, "loads")

    def _misdirected(self, local: np.ndarray) -> float:
        """Return the most by which friction is not against the sliding that is declared, N."""
        along = np.einsum("lij,lj->li", self.problem.frames, self.problem.directions)
        off = np.linalg.norm(local - local[:, :1] * along, axis=1)
        return float(off[self.problem.slides].max(initial=0.0))

    def _no_rest(self) -> Check:
        """Along some motion all contact forces do work of one sign, and the load of the other."""
        z = array(entry(self.stated, "no_rest", "stability"), self.load.shape, "no_rest")
        z = z / max(1.0, float(np.abs(z).sum()))
        c = self.acting @ (z * self.problem.force / self.unit)
        gain = self.problem.mu * np.linalg.norm(c[:, 1:], axis=1) - c[:, 0]
        left = float(z @ (self.load / self.unit))
        left -= _FORCE_LIMIT * float(np.maximum(gain, 0.0).sum())
        return holds("rest is no outcome", left > _BALANCED, f"{left:.3g} loads are unbalanced")

    # motion

    def _motion(self) -> list[Check]:
        """Return the checks of the stated motion: each condition of an outcome, scaled."""
        motion = entry(self.stated, "motion", "stability")
        if motion is None and self.status == "none":
            return []
        if self.dynamics is None:
            return [holds("a motion is an outcome", passed=False, detail="no inertia is known")]
        dynamics, where = self.dynamics, "the motion"
        kept = np.concatenate([np.ones(6, dtype=bool), self.hybrid < 0])
        acceleration = np.concatenate(
            [
                array(entry(motion, "object_acceleration", where), (6,), where),
                array(entry(motion, "joint_accelerations", where), (len(self.hybrid),), where),
            ]
        )
        y = np.linalg.solve(dynamics.accelerations[kept], acceleration[kept])
        f = self._forces("contact_forces", motion, where) / dynamics.force_unit
        off = self._misdirected(f)
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
            agrees("its largest acceleration", told, speed, 1e-6 * speed, "m/s^2"),
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
        limit = entry(proof, "force_limit", "proof of rest")
        limit = np.inf if limit is None else number(limit, "force_limit")
        wanted = _FORCE_LIMIT * self.problem.force
        reach = holds("force limit of the proof", limit >= (1.0 - 1e-9) * wanted,
                      f"{limit:.6g} N, wanted {wanted:.6g} N")  # fmt: skip
        if self.is_known and self.dynamics is None:
            return [holds(name, passed=True, detail="there is no load")]
        limit = limit if np.isfinite(limit) else wanted
        if (self.problem.slides & (self.problem.mu > 0.0)).any():
            return [reach, self._kept(proof, limit)]
        loads, checks = self._loads(proof, limit)
        if entry(proof, "forces", "proof of rest") is not None:
            certificate = self._certificate(name, self._forces("forces", proof, "proof"), loads)
            return [*checks, *([reach] if checks else []), certificate]
        if self.dynamics is None:
            return [*checks, holds(name, passed=False, detail="no inertia is known")]
        unit = self.dynamics.force_unit
        walk = RestWalk(self.dynamics, loads / unit, limit / unit)
        walk.walk(read_rest_tree(entry(proof, "nodes", "proof of rest"), self.dynamics))
        most = (self.limit / self.dynamics.reach) ** 2
        proven = not walk.failure and walk.bound <= (1.0 + _ROUNDING) * most
        shown = f"{walk.leaves} leaves, power {walk.bound:.3g} of {most:.3g} (scaled)"
        return [*checks, reach, holds(name, proven, walk.failure or shown)]

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

    def _loads(self, proof: Any, limit: float) -> tuple[np.ndarray, list[Check]]:
        """Return the normal forces that every outcome has, N, and the checks of their proofs."""
        loads = np.zeros(self.problem.count)
        columns = np.flatnonzero(self.hybrid >= 0)
        loads[self.hybrid[columns]] = self.load[6 + columns]
        checks = []
        for index, one in enumerate(items(entry(proof, "loads", "proof"), "loads", 0, MOST)):
            where = f"load {index} of the proof"
            if self.dynamics is None:
                raise ValueError(f"{where} needs inertias")
            contact = whole(entry(one, "contact", where), where, 0, self.problem.count - 1)
            force = number(entry(one, "force", where), where)
            dynamics, unit = self.dynamics, self.dynamics.force_unit
            q = np.zeros((self.problem.count, 3))
            q[contact, 0] = -1.0
            multipliers = read_rest_multipliers(entry(one, "multipliers", where), dynamics, where)
            states = KnownStates.unknown(self.problem.count)
            goal = np.zeros(len(dynamics.load)), q
            found = -unit * largest_goal(
                dynamics, states, loads / unit, multipliers, goal, limit / unit
            )
            good = force <= found + 1e-9 * self.problem.force
            detail = f"stated {force:.9g}, proven {found:.9g} N"
            checks.append(holds(f"least normal force of contact {contact}", good, detail))
            if good:
                loads[contact] = max(loads[contact], min(force, found))
        return loads, checks

    def _certificate(self, name: str, forces: np.ndarray, loads: np.ndarray) -> Check:
        """Check that forces balance with no more friction than those loads bear."""
        unborne = np.linalg.norm(forces[:, 1:], axis=1) - self.problem.mu * loads
        unborne, pulling = np.maximum(unborne, 0.0), np.maximum(-forces[:, 0], 0.0)
        dynamics, size = self.dynamics, self.problem.force
        if dynamics is None:
            worst = max(self._unbalanced(forces), unborne.max() / size, pulling.max() / size)
            return within(name, worst, _EXACT, "loads")
        rows, unit = dynamics.rows, dynamics.force_unit
        left = np.einsum("lin,li->n", rows, forces / unit) + dynamics.load
        y = float(np.linalg.norm(left))
        y += float(unborne @ np.linalg.norm(rows[:, 1:], ord=2, axis=(1, 2))) / unit
        y += float(pulling @ np.linalg.norm(rows[:, 0], axis=1)) / unit
        return within(name, y * dynamics.reach, self.limit, "m/s^2 at most")
