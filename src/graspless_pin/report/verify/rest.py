"""Checks of the verdict on rest under a document's torques, and under the controller.

The latter needs proofs that no small motion grows. With N the motions without slip,
M_z z'' + D_z z' + (K_geo + N_q^T K N_q) z = 0. Where a matrix P > 0 has A^T P + P A <= 2 r P,
with A of the state (z, z'), P's norm of no motion grows faster than e^(r t): Lyapunov's theorem.
K_geo is taken as given, as J is: it depends on the surfaces at contacts.
"""

from __future__ import annotations

import re
from textwrap import shorten

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import Part
from graspless_pin.report.verify.outcome import Check, agrees, given, holds, within
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.rest_bounds import contact_motion
from graspless_pin.report.verify.rest_load import LARGEST_FORCE, RestLoad, read_load
from graspless_pin.report.verify.rest_tree import (
    certificate_check,
    force_limit,
    kept_tree_check,
    stated_loads,
    tree_check,
)
from graspless_pin.report.verify.values import entry, items

_OF_INSTANT = {
    "holds": ("strong",),
    "needs_feedback": ("strong",),
    "may_fail": ("weak", "strong"),
    "fails": ("none", "strong"),
    "finger_moves": ("none", "strong"),
    "undecided": ("strong", "undecided"),
}
"""Possible statuses of the first instant, by the status under the controller."""
_CONSTANT = "constant torques"
_PER_LEVER = 100.0
"""1/m^2."""
_MOST_ROWS, _MOST_MOTIONS = 10_000, 200
_MOST_GAINS = 3
_QUOTED = r"(?:'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\")"
_NAMES = re.compile(rf" at {_QUOTED}(?:, {_QUOTED})*(?:, \.\.\.)?")
"""Of joints and fingers, which are taken as given."""
_WORDS = {
    "strong": ("holds", "keeps", "needs", "stays", "may "),
    "weak": ("may ",),
    "none": ("fails", "loses"),
    "undecided": ("undecided",),
}
"""How sentences of each status begin; only strong ones claim that the object stays."""
_CLAIMS = "free_motions", "moves"


def rest_checks(document: object, problem: Problem) -> list[Check]:
    """Return the checks of the verdict under ``stability``; none where there is none.

    Args:
        document: The document, with the motors' torques.
        problem: Its problem.

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
        ValueError: If it is missing, or finer than the checker allows.
    """
    resolution = stated["acceleration_resolution"]
    if not resolution >= tolerances.FINEST * (1.0 - tolerances.SAME):
        raise ValueError(
            f"acceleration_resolution of {stated.where} is {resolution:g}; it must be at least "
            f"{tolerances.FINEST:g}"
        )
    return resolution


def verdict_checks(stated: Part, bodies: RestLoad) -> list[Check]:
    """Return the checks of a verdict on bodies under a load.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    return _VerdictChecks(stated, bodies).run()


class _VerdictChecks:
    """The checks of one verdict."""

    def __init__(self, stated: Part, bodies: RestLoad) -> None:
        self.stated, self.bodies, self.status = stated, bodies, stated["status"]
        self.problem, self.dynamics = bodies.problem, bodies.dynamics
        self.is_known, self.resolution = bodies.inertia is not None, resolution_of(stated)
        self.limit = bodies.acceleration_limit(self.resolution)

    def run(self) -> list[Check]:
        checks = [given("inertias", "as they are stated" if self.is_known else "not known")]
        if self.bodies.joints_held:
            checks.append(given("joints", "keep their positions, whatever torques that takes"))
        rest = f"{self.resolution:g} times load over mass"
        if self.is_known:
            claimed, tolerance = self.stated["acceleration_limit"], tolerances.SAME * self.limit
            checks.append(agrees("acceleration limit", claimed, self.limit, tolerance, "m/s^2"))
            rest += f": points that accelerate by up to {self.limit:.3g} m/s^2 count as at rest"
        checks += [given("resolution of accelerations", rest), *self._message_checks()]
        claims = {key: self.stated[key] for key in _CLAIMS if self.stated.get(key) is not None}
        if claims:
            shown = ", ".join(f"{key} {str(value)[:20]}" for key, value in claims.items())
            checks.append(given("free motions, and what moves", shown))
        if self.status == "undecided":
            return [*checks, holds("whether the object stays", passed=True,
                                   detail="left undecided: nothing is claimed")]  # fmt: skip
        if not self.problem.coulombs_law:
            why = "a verdict requires Coulomb's law, but the cones do not represent it"
            return [*checks, holds("whether the object stays", passed=False, detail=why)]
        if self.status == "none":
            # Along some motion contact forces do work of one sign, and the load of the other.
            unbalanced = self.bodies.least_unbalanced_load(self.stated["no_rest"])
            good, detail = unbalanced > tolerances.SHARE, f"{unbalanced:.3g} of the load unbalanced"
            return [*checks, holds("rest is no outcome", good, detail), *self._motion_checks()]
        amiss = self.bodies.rest_violation(self.bodies.local(self.stated["rest_forces"]))
        checks.append(within("rest is an outcome", amiss, tolerances.SHARE, "of the load"))
        if self.status == "strong":
            fine = self.resolution <= tolerances.COARSEST
            detail = f"{self.resolution:g}, at most {tolerances.COARSEST:g} for strong"
            checks.append(holds("the resolution is fine enough", fine, detail))
        if self.status == "weak":
            return [*checks, *self._motion_checks()]
        return [*checks, *self._strong_checks()]

    def _message_checks(self) -> list[Check]:
        """Return the check that the message does not begin like that of another status."""
        message = self.stated["message"] if "message" in self.stated.stated else ""
        own = _WORDS[self.status]
        others = [word for words in _WORDS.values() for word in words if word not in own]
        good = not message.startswith(tuple(others))
        short = shorten(message, 60, placeholder=" ...") or "no sentence"
        return [holds("the sentence and the status agree", good, short)]

    # motion

    def _motion_checks(self) -> list[Check]:
        """Return the checks of the stated motion: each condition of an outcome, over the load."""
        motion, bodies, problem = self.stated.maybe("motion"), self.bodies, self.problem
        if motion is None and self.status == "none":
            return []
        if self.dynamics is None:
            return [
                holds("a motion is an outcome", passed=False, detail="inertias or load are missing")
            ]
        motion = self.stated["motion"]
        acceleration = np.concatenate(
            [motion["object_acceleration"], motion["joint_accelerations"]]
        )
        f = bodies.local(motion["contact_forces"])
        off = bodies.kinetic_friction_error(f)
        hybrid = np.zeros(problem.count, dtype=bool)
        hybrid[bodies.hybrid[bodies.hybrid >= 0]] = True
        commanded = np.abs(f[:, 0] - bodies.commanded)[hybrid].max(initial=0.0)
        residual = bodies.motion_residual(f, acceleration)
        # Hybrid fingers follow; kinetic friction of declared sliding is part of the dynamics.
        u = np.einsum("lik,k->li", contact_motion(problem), acceleration)
        u[hybrid, 0] = 0.0
        friction = np.where(problem.slides, 0.0, problem.mu)
        f[problem.slides, 1:] = 0.0
        outside = np.linalg.norm(f[:, 1:], axis=1) - friction * f[:, 0]
        wrong = max(float(outside.max()), -float(f[:, 0].min()), off, float(commanded))
        # Friction opposes the slip of a contact; a contact that parts bears no force.
        slips, F = np.linalg.norm(u[:, 1:], axis=1), bodies.undisturbed.force
        direction = u[:, 1:] / np.where(slips > 0.0, slips, 1.0)[:, None]
        against = np.linalg.norm(f[:, 1:] + (friction * f[:, 0])[:, None] * direction, axis=1)
        unit = bodies.load_over_mass(bodies.undisturbed)
        gaps = np.minimum(against / F, np.where(problem.slides, 0.0, slips) / unit)
        gaps = np.maximum(gaps, np.minimum(np.abs(f[:, 0]) / F, np.maximum(u[:, 0], 0.0) / unit))
        speed = float(np.linalg.norm(problem.points @ acceleration[: len(problem.w)], axis=1).max())
        claimed, most = motion["point_acceleration"], tolerances.motion(self.resolution)
        checks = [
            given("states of the contacts in a motion", shorten(" ".join(motion["states"]), 60)),
            within("a motion obeys the dynamics", residual, most, "of the load"),
            within("its forces are in the cones, and as commanded", wrong / F, most, "of the load"),
            within("it penetrates nothing", -float(u[:, 0].min()) / unit, most, "of load/mass"),
            within("friction opposes its slip, and open contacts have no force", float(gaps.max()),
                   most, "of the load"),
            agrees("its largest acceleration", claimed, speed, most * unit, "m/s^2"),
        ]  # fmt: skip
        if self.status == "weak":
            detail = f"{speed:.6g} m/s^2, limit {self.limit:.6g}"
            checks.append(holds("its acceleration is above the limit", speed > self.limit, detail))
        return checks

    # proof

    def _strong_checks(self) -> list[Check]:
        name, proof = "rest is the only outcome", self.stated.maybe("proof")
        if proof is None:
            return [Check(name, None, "no proof in the document")]
        limit, reach = force_limit(proof, LARGEST_FORCE * self.problem.force)
        if self.is_known and self.dynamics is None:
            return [holds(name, passed=True, detail="there is no load")]
        if (self.problem.slides & (self.problem.mu > 0.0)).any():
            return [reach, self._declared_motion_check(proof, limit)]
        loads, checks = stated_loads(proof, self.bodies, self.dynamics, limit)
        forces = proof.maybe("forces")
        if forces is not None:
            shown = certificate_check(
                name, self.bodies, self.bodies.local(forces), loads, self.limit
            )
            return [*checks, *([reach] if checks else []), shown]
        if self.dynamics is None:
            return [*checks, holds(name, passed=False, detail="inertias or load are missing")]
        return [*checks, reach, tree_check(name, proof, self.dynamics, loads, (self.limit, limit))]

    def _declared_motion_check(self, proof: Part, limit: float) -> Check:
        """Check that the declared motion is the only outcome."""
        name, dynamics = "the declared motion is the only outcome", self.dynamics
        if dynamics is None or not np.isfinite(self.limit):
            return holds(name, passed=False, detail="inertias or load are missing")
        return kept_tree_check(name, proof, dynamics, self.problem, (self.limit, limit))


def holding_checks(stated: Part | None, instant: str, bodies: RestLoad) -> list[Check]:
    """Return the checks of ``holding``; none where the document has none.

    Args:
        stated: The document's ``holding``.
        instant: The status of its ``stability``.
        bodies: Contacts, joints and inertias.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type.
    """
    if stated is None:
        return []
    status, own = stated["status"], stated["acceleration"]["status"]
    growth, at_best, needed = (
        stated.maybe(key) for key in ("growth_rate", "least_growth_rate", "stiffness_needed")
    )
    agree = own == instant and instant in _OF_INSTANT[status]
    if growth is not None and instant == "strong":
        lost = "fails" if needed is None else "needs_feedback"
        expected = ("may_fail" if at_best == 0.0 else lost) if growth > 0.0 else "holds"
        # ``finger_moves`` claims less than ``holds``.
        agree = agree and (status == expected or (status, expected) == ("finger_moves", "holds"))
    least = "not stated" if needed is None else f"{needed:.3g}"
    detail = f"{stated['controller'][:60]}; stiffness needed: {least}"
    assumed = set(stated["assumed_contacts"])
    if assumed:
        detail += f"; {len(assumed)} contact points are assumed to stay on both bodies"
    checks = [
        holds("holding and stability agree", agree, f"{status}: {instant} at the first instant"),
        given("what small motions do under the controller", detail),
    ]
    if status == "holds" and not bodies.problem.slides.any():
        checks += _growth_proof_checks(stated, bodies)
    return checks


def _growth_proof_checks(holding: Part, bodies: RestLoad) -> list[Check]:
    """Return the checks that no small motion grows, for each model of the surfaces."""
    stated = holding["proofs"]
    if not isinstance(stated, dict) or not stated:
        return [holds("no small motion grows", passed=False, detail="no proof in the document")]
    checks = []
    for name, one in stated.items():
        what = "no small motion grows" if name == "any" else f"no small motion grows ({name[:20]})"
        proof = _GrowthProof(bodies.problem.part(one, "a proof", "growth proof"), bodies)
        gains, unit = _distinct_gains(proof)
        feedback = _feedback_text(gains, unit) or _CONSTANT
        if bodies.joints_held:
            feedback = "joints held in their positions"
        if name != "any":
            matches = _NAMES.sub(" at joints", holding["controller"]) == feedback
            several = len(gains) > 1 or bodies.joints_held
            matches = matches and (several or _is_stable_gain(max(gains, default=0.0), holding))
            about = f"the controller is that of the proof ({name[:20]})"
            checks.append(holds(about, matches, feedback))
        try:
            why = proof.failure()
        except np.linalg.LinAlgError as error:
            why = f"the matrices of the proof are invalid ({error})"
        count = proof.N.shape[1]
        good = (
            f"faster than {proof.rate:g} /s with {feedback}; the geometric stiffness of "
            f"{count} motions is taken as given"
        )
        if not count:
            good = "every motion slips or opens a contact"
        checks.append(holds(what, not why, why or good))
    return checks


def _distinct_gains(proof: _GrowthProof) -> tuple[list[float], str]:
    """Return the distinct gains of a proof as a verdict states them, ascending, and their unit.

    Gains of prismatic joints, N/m, count times (0.1 m)^2, unless all joints are prismatic.
    """
    units = proof.bodies.problem.units
    slides = np.array([units[joint] == "N" for joint in proof.joints], dtype=bool)
    linear = bool(len(slides) and slides.all())
    gains = proof.gains / np.where(slides, _PER_LEVER, 1.0) * (_PER_LEVER if linear else 1.0)
    distinct = {f"{gain:g}": float(gain) for gain in gains.tolist()}  # digits of messages
    return sorted(distinct.values()), "N/m" if linear else "N m/rad"


def _feedback_text(gains: list[float], unit: str) -> str:
    """Return the feedback in the words of a verdict, without joint names; empty: there is none."""
    parts = [f"{gain:g} {unit} at joints" for gain in gains if gain > 0.0]
    parts += ["none at joints"] * (0.0 in gains)
    if len(gains) <= 1:
        return f"joint feedback of {gains[0]:g} {unit}" if any(gains) else ""
    if len(parts) > _MOST_GAINS:
        last = len(parts) - 1 - (0.0 in gains)
        parts = [f"{parts[0]} to {parts[last]}", *parts[last + 1 :]]
    return f"joint feedback of {', '.join(parts)}"


def _is_stable_gain(gain: float, holding: Part) -> bool:
    """Return whether a gain of all joints is in one of the stated stable ranges."""
    return any(
        gain >= least * (1.0 - tolerances.GAIN)
        and (np.isnan(most) or gain <= most * (1.0 + tolerances.GAIN))
        for least, most in holding["stable_stiffness"]
    )


class _GrowthProof:
    """A proof that no small motion grows, as arrays."""

    def __init__(self, stated: Part, bodies: RestLoad) -> None:
        self.bodies, self.passive = bodies, len(bodies.problem.w)
        rows = entry(stated.stated, "velocities", stated.where)
        first = items(rows, "velocities", 0, _MOST_ROWS)[:1]
        self.joints = stated["joints"]
        stated = stated.with_sizes(
            c=len(self.joints),
            d=sum(len(items(row, "velocities", 0, _MOST_MOTIONS)) for row in first),
        )
        self.N, self.K, self.P = (
            stated[key] for key in ("velocities", "geometric_stiffness", "lyapunov")
        )
        self.gains, self.damping, self.rotors = (
            stated[key] for key in ("gains", "damping", "rotors")
        )
        self.forces, self.rate = bodies.local(stated["forces"]), stated["rate"]

    def failure(self) -> str:
        """Return why this proves nothing; empty: it is a proof."""
        if not 0.0 <= self.rate <= tolerances.GROWTH:
            return f"the rate is {self.rate:g} /s; it must be 0 to {tolerances.GROWTH:g}"
        if min(one.min(initial=0.0) for one in (self.gains, self.damping, self.rotors)) < 0.0:
            return "gains, damping and rotors must not be negative"
        return self._motions_failure() or self._growth_failure()

    def _motions_failure(self) -> str:
        """Return why N is not all motions without slip at loaded contacts; empty: it is."""
        problem, hybrid = self.bodies.problem, self.bodies.hybrid
        rows = contact_motion(problem)
        kept = np.ones((problem.count, 3), dtype=bool)
        kept[:, 1:] = problem.has_cone[:, None]
        kept[hybrid[hybrid >= 0], 0] = False
        if self.bodies.rest_violation(self.forces) > tolerances.SHARE:
            return "the forces violate the conditions of rest"
        kept[self.forces[:, 0] <= tolerances.bearing_force(self.bodies.undisturbed)] = False
        columns = np.zeros(rows.shape[2], dtype=bool)
        columns[: self.passive] = True
        columns[self.passive + np.array(self.joints, dtype=int)] = True
        omitted = ~columns
        omitted[self.passive :] &= hybrid < 0
        if rows[:, :, omitted].any() or self.N[~columns].any():
            return "the proof omits a joint that moves a contact"
        flat = rows[kept][:, columns]
        sizes = np.linalg.norm(flat, axis=0)
        sizes[sizes == 0.0] = 1.0
        scaled, motions = flat / sizes, self.N[columns] * sizes[:, None]
        # An orthonormal basis: small columns, or columns that nearly agree, would hide a slip.
        lengths = np.linalg.norm(motions, axis=0)
        basis, _ = np.linalg.qr(motions / np.where(lengths > 0.0, lengths, 1.0))
        if np.abs(scaled @ basis).max(initial=0.0) > tolerances.WITHOUT_SLIP:
            return "some of the motions slip or open a contact"
        values = np.linalg.svd(scaled, compute_uv=False)
        rank = int((values > tolerances.MOTION_RANK * values.max(initial=0.0)).sum())
        count = motions.shape[1]
        if np.linalg.matrix_rank(motions) < count or rank + count < scaled.shape[1]:
            return "motions that neither slip nor open a contact are missing"
        return ""

    def _growth_failure(self) -> str:
        """Return why Lyapunov's inequality does not hold beyond rounding; empty: it does."""
        count = self.N.shape[1]
        if not count:
            return ""
        if self.bodies.inertia is None:
            return "inertias are not known"
        driven = self.N[self.passive + np.array(self.joints, dtype=int)]
        rotors = driven.T @ (self.rotors[:, None] * driven)
        root = np.linalg.cholesky(self.N.T @ self.bodies.inertia @ self.N + rotors)
        stiffness = self.K + driven.T @ (self.gains[:, None] * driven)
        drag = driven.T @ (self.damping[:, None] * driven)
        own, slowed = (
            np.linalg.solve(root, np.linalg.solve(root, matrix.T).T) for matrix in (stiffness, drag)
        )
        w = max(float(np.sqrt(np.abs(own).max())), self.rate)
        if not w > 0.0:
            return "the rate and the stiffness are zero"
        A = np.block([[np.zeros_like(own), np.eye(count)], [-own / w**2, -slowed / w]])
        A = A - self.rate / w * np.eye(2 * count)
        P = 0.5 * (self.P + self.P.T)
        lyapunov = -(A.T @ P + P @ A)
        lost = tolerances.PRODUCTS * count * float(np.linalg.norm(A) * np.linalg.norm(P))
        lost *= float(np.linalg.cond(root))
        for name, matrix in (("P", P), ("2 r P - A^T P - P A", lyapunov)):
            if not np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[0] > lost:
                return f"{name} is not positive definite"
        return ""
