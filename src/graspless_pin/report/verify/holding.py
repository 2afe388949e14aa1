"""Whether the object stays under the controller, and the proofs that no small motion grows.

With N the motions without slip, M_z z'' + D_z z' + (K_geo + N_q^T K N_q) z = 0. Where a matrix
P > 0 has A^T P + P A <= 2 r P, with A of the state (z, z'), P's norm of no motion grows faster than
e^(r t): Lyapunov's theorem. K_geo is taken as given, as J is: it hangs on the surfaces at contacts.
"""

from __future__ import annotations

import re

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import Part, entry, items
from graspless_pin.report.verify.outcome import Check, given, holds
from graspless_pin.report.verify.rest_bounds import contact_motion
from graspless_pin.report.verify.rest_load import RestLoad

_OF_INSTANT = {
    "holds": ("strong",),
    "needs_feedback": ("strong",),
    "may_fail": ("weak", "strong"),
    "fails": ("none", "strong"),
    "finger_moves": ("none", "strong"),
    "undecided": ("strong", "undecided"),
}
"""What the first instant may be for what is said of the object under the controller."""
_CONSTANT = "constant torques"
_PER_LEVER = 100.0
"""1/m^2."""
_MOST_ROWS, _MOST_MOTIONS = 10_000, 200
_MOST_GAINS = 3
_QUOTED = r"(?:'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\")"
_NAMES = re.compile(rf" at {_QUOTED}(?:, {_QUOTED})*(?:, \.\.\.)?")
"""Of joints and fingers, which are taken as given."""


def holding_checks(stated: Part | None, instant: str, bodies: RestLoad) -> list[Check]:
    """Return the checks of what is said of the object under the controller; none: nothing is.

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
        # That a finger may move away claims less than that nothing does.
        agree = agree and (status == expected or (status, expected) == ("finger_moves", "holds"))
    least = "none that is known" if needed is None else f"{needed:.3g}"
    told = f"{stated['controller'][:60]}; stiffness needed: {least}"
    assumed = set(stated["assumed_contacts"])
    if assumed:
        told += f"; points that stay on both bodies are assumed at {len(assumed)}"
    checks = [
        holds("holding and stability agree", agree, f"{status}: {instant} at the first instant"),
        given("what small motions do under the controller", told),
    ]
    if status == "holds" and not bodies.problem.slides.any():
        checks += _proof_checks(stated, bodies)
    return checks


def _proof_checks(holding: Part, bodies: RestLoad) -> list[Check]:
    """Return the checks of the proofs that no small motion grows, of each model of the surfaces."""
    stated = holding["proofs"]
    if not isinstance(stated, dict) or not stated:
        return [holds("no small motion grows", passed=False, detail="no proof in the document")]
    checks = []
    for name, one in stated.items():
        what = "no small motion grows" if name == "any" else f"no small motion grows ({name[:20]})"
        proof = _Proof(bodies.problem.part(one, "a proof", "growth proof"), bodies)
        gains, unit = _gains(proof)
        said = _gain_words(gains, unit) or _CONSTANT
        if bodies.joints_held:
            said = "joints held in their positions"
        if name != "any":
            agrees = _NAMES.sub(" at joints", holding["controller"]) == said
            several = len(gains) > 1 or bodies.joints_held
            agrees = agrees and (several or _is_stable(max(gains, default=0.0), holding))
            about = f"the controller is that of the proof ({name[:20]})"
            checks.append(holds(about, agrees, said))
        try:
            why = proof.failure()
        except np.linalg.LinAlgError as error:
            why = f"the matrices are of no motion ({error})"
        count = proof.N.shape[1]
        good = (
            f"faster than {proof.rate:g} /s with {said}; geometric stiffness of "
            f"{count} motions as stated"
        )
        if not count:
            good = "every motion slips or opens a contact"
        checks.append(holds(what, not why, why or good))
    return checks


def _gains(proof: _Proof) -> tuple[list[float], str]:
    """Return the gains of a proof as a verdict tells them, ascending, and their unit.

    Gains of joints that slide count over (0.1 m)^2, unless all do.
    """
    units = proof.bodies.problem.units
    slides = np.array([units[joint] == "N" for joint in proof.joints], dtype=bool)
    linear = bool(len(slides) and slides.all())
    gains = proof.gains / np.where(slides, _PER_LEVER, 1.0) * (_PER_LEVER if linear else 1.0)
    told = {f"{gain:g}": float(gain) for gain in gains.tolist()}  # digits of a sentence
    return sorted(told.values()), "N/m" if linear else "N m/rad"


def _gain_words(gains: list[float], unit: str) -> str:
    """Return gains in the words of a verdict, with no names of joints; empty: there are none."""
    parts = [f"{gain:g} {unit} at joints" for gain in gains if gain > 0.0]
    parts += ["none at joints"] * (0.0 in gains)
    if len(gains) <= 1:
        return f"joint feedback of {gains[0]:g} {unit}" if any(gains) else ""
    if len(parts) > _MOST_GAINS:
        last = len(parts) - 1 - (0.0 in gains)
        parts = [f"{parts[0]} to {parts[last]}", *parts[last + 1 :]]
    return f"joint feedback of {', '.join(parts)}"


def _is_stable(gain: float, holding: Part) -> bool:
    """Return whether a gain of all joints is among those that are said to be stable."""
    return any(
        gain >= least * (1.0 - tolerances.GAIN)
        and (np.isnan(most) or gain <= most * (1.0 + tolerances.GAIN))
        for least, most in holding["stable_stiffness"]
    )


class _Proof:
    """One proof as arrays."""

    def __init__(self, stated: Part, bodies: RestLoad) -> None:
        self.bodies, self.passive = bodies, len(bodies.problem.w)
        rows = entry(stated.stated, "velocities", stated.where)
        first = items(rows, "velocities", 0, _MOST_ROWS)[:1]
        self.joints = stated["joints"]
        stated = stated.sized(
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
            return f"the rate is {self.rate:g} /s; it must be at most {tolerances.GROWTH:g}"
        if min(one.min(initial=0.0) for one in (self.gains, self.damping, self.rotors)) < 0.0:
            return "gains, damping and rotors must not be negative"
        return self._of_motions() or self._of_growth()

    def _of_motions(self) -> str:
        """Return whether the motions are all without slip at contacts that bear load."""
        problem, hybrid = self.bodies.problem, self.bodies.hybrid
        rows = contact_motion(problem)
        still = np.ones((problem.count, 3), dtype=bool)
        still[:, 1:] = problem.cone[:, None]
        still[hybrid[hybrid >= 0], 0] = False
        if self.bodies.amiss(self.forces) > tolerances.SHARE:
            return "the forces are none of rest"
        still[self.forces[:, 0] <= tolerances.bearing(self.bodies.undisturbed)] = False
        columns = np.zeros(rows.shape[2], dtype=bool)
        columns[: self.passive] = True
        columns[self.passive + np.array(self.joints, dtype=int)] = True
        left_out = ~columns
        left_out[self.passive :] &= hybrid < 0
        if rows[:, :, left_out].any() or self.N[~columns].any():
            return "a joint that moves a contact is left out"
        flat = rows[still][:, columns]
        sizes = np.linalg.norm(flat, axis=0)
        sizes[sizes == 0.0] = 1.0
        scaled, motions = flat / sizes, self.N[columns] * sizes[:, None]
        # Of an orthonormal basis: small columns, or columns that nearly agree, hide no slip.
        lengths = np.linalg.norm(motions, axis=0)
        basis, _ = np.linalg.qr(motions / np.where(lengths > 0.0, lengths, 1.0))
        if np.abs(scaled @ basis).max(initial=0.0) > tolerances.WITHOUT_SLIP:
            return "the motions let contacts slip or open"
        values = np.linalg.svd(scaled, compute_uv=False)
        rank = int((values > tolerances.MOTION_RANK * values.max(initial=0.0)).sum())
        count = motions.shape[1]
        if np.linalg.matrix_rank(motions) < count or rank + count < scaled.shape[1]:
            return "the motions are not all that neither slip nor open contacts"
        return ""

    def _of_growth(self) -> str:
        """Return whether Lyapunov's inequality holds, with room for rounding."""
        count = self.N.shape[1]
        if not count:
            return ""
        if self.bodies.inertia is None:
            return "inertias are not known"
        driven = self.N[self.passive + np.array(self.joints, dtype=int)]
        rotors = driven.T @ (self.rotors[:, None] * driven)
        root = np.linalg.cholesky(self.N.T @ self.bodies.inertia @ self.N + rotors)
        held = self.K + driven.T @ (self.gains[:, None] * driven)
        drag = driven.T @ (self.damping[:, None] * driven)
        own, slowed = (
            np.linalg.solve(root, np.linalg.solve(root, matrix.T).T) for matrix in (held, drag)
        )
        w = max(float(np.sqrt(np.abs(own).max())), self.rate)
        if not w > 0.0:
            return "the rate is zero"
        A = np.block([[np.zeros_like(own), np.eye(count)], [-own / w**2, -slowed / w]])
        A = A - self.rate / w * np.eye(2 * count)
        P = 0.5 * (self.P + self.P.T)
        left = -(A.T @ P + P @ A)
        lost = tolerances.PRODUCTS * count * float(np.linalg.norm(A) * np.linalg.norm(P))
        lost *= float(np.linalg.cond(root))
        for name, matrix in (("P", P), ("2 r P - A^T P - P A", left)):
            if not np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[0] > lost:
                return f"{name} is not positive definite"
        return ""
