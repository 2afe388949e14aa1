"""Checks of the disturbances that a document claims to be guaranteed, or too large.

A span is the set of all loads between two. Forces that balance both ends, and certificates of both
that rely on normal forces of all outcomes in between, hold for each load of it. Otherwise two trees
prove a span, one from each end, in which the load is any up to the other end: an outcome in between
has at most the power that one of the two end loads has in its motion.
"""

from __future__ import annotations

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import Part
from graspless_pin.report.verify.outcome import Check, holds, within
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.rest import resolution_of, verdict_checks
from graspless_pin.report.verify.rest_load import LARGEST_FORCE, RestLoad, read_load
from graspless_pin.report.verify.rest_tree import (
    certificate_check,
    force_limit,
    stated_loads,
    tree_check,
)


def disturbance_checks(document: object, problem: Problem) -> list[Check]:
    """Return the checks of ``disturbances``; none where the document has none.

    Args:
        document: The document, with the motors' torques and the verdict without disturbance.
        problem: Its problem.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    whole = problem.part(document)
    stated = whole.get("disturbances")
    if stated is None:
        return []
    undisturbed, length, largest = (
        whole["stability"], stated["characteristic_length"], stated["largest"]
    )  # fmt: skip
    claims, sure = stated["directions"], undisturbed["status"] == "strong"
    checks = [
        holds(
            "rest without disturbance is guaranteed",
            sure or not claims,
            f"{len(claims)} directions",
        )
    ]
    bodies = read_load(document, problem)
    limit = bodies.acceleration_limit(resolution_of(undisturbed))
    for claim in claims:
        unit = claim["direction"]
        if abs(float(np.linalg.norm(unit)) - 1.0) > tolerances.UNIT or length <= 0.0:
            raise ValueError(
                f"direction of {claim.where} must have the length 1, and "
                "characteristic_length must be positive"
            )
        step = unit * np.where(problem.is_moment, length, 1.0)
        checks += _DirectionChecks(claim, bodies, step, limit).run(largest)
    return checks


_CLAIMS = ("guaranteed", "failing", "possible", "spans", "failure", "forces", "no_rest")


class _DirectionChecks:
    """The checks of the claims on disturbances along one direction."""

    def __init__(self, claim: Part, bodies: RestLoad, step: np.ndarray, limit: float) -> None:
        self.name, self.claim, self.bodies = claim.where, claim, bodies
        self.step, self.limit = step, limit

    def run(self, largest: float) -> list[Check]:
        if self.bodies.problem.slides.any():
            raise ValueError(f"{self.name} is not supported together with contacts that slide")
        stated = [self.claim.maybe(key) for key in _CLAIMS]
        if all(one is None or (isinstance(one, list) and not one) for one in stated):
            return [holds(f"{self.name} was not examined", passed=True, detail="it claims nothing")]
        return [self._guaranteed_check(), self._possible_check(largest), *self._failing_checks()]

    def _load_at(self, magnitude: float) -> RestLoad:
        return self.bodies.changed(magnitude * self.step)

    # the guaranteed magnitude

    def _guaranteed_check(self) -> Check:
        """Check that adjoining spans from zero reach the claimed magnitude."""
        name, wanted, reached = f"{self.name} is withstood", self.claim["guaranteed"], 0.0
        spans, shown = self.claim.maybe("spans"), f"up to {wanted:.6g} N"
        if spans is None:
            return Check(name, None, f"{shown}: no proof in the document")
        for ends in spans:
            where, (first, last) = ends[0].where, (end["magnitude"] for end in ends)
            if not first <= reached <= last:
                return holds(name, passed=False, detail=f"{where} does not adjoin the one before")
            for check in self._span_checks(ends, where):
                if not check.passed:
                    return holds(name, passed=False, detail=f"{check.name}: {check.detail}")
            reached = last
        count = f"{len(spans)} span{'s' if len(spans) != 1 else ''}"
        good = 0.0 <= wanted <= reached
        return holds(name, good, f"{shown}, proven up to {reached:.6g} N in {count}")

    def _span_checks(self, ends: list[Part], where: str) -> list[Check]:
        """Return the checks of a span: of all loads between two magnitudes."""
        bodies, proofs = (
            [self._load_at(end["magnitude"]) for end in ends],
            [end["proof"] for end in ends],
        )
        checks, loads, parts = list[Check](), list[np.ndarray](), []
        for end, proof, own, other in zip(ends, proofs, bodies, reversed(bodies), strict=True):
            checks.append(_rest_check(end["rest_forces"], own, where))
            limit, reach = force_limit(proof, LARGEST_FORCE * self.bodies.problem.force)
            dynamics = None if own.dynamics is None else own.dynamics.towards(other.dynamics)
            least, shown = stated_loads(proof, own, dynamics, limit)
            checks += [reach, *shown]
            loads.append(least)
            parts.append((own, dynamics, limit))
        forces = [proof.maybe("forces") for proof in proofs]
        if all(one is not None for one in forces):
            common = np.minimum(*loads)
            for own, one in zip(bodies, forces, strict=True):
                carried = np.maximum(own.commanded, common)
                checks.append(certificate_check(where, own, own.local(one), carried, self.limit))
            return checks
        for proof, least, (own, dynamics, limit) in zip(proofs, loads, parts, strict=True):
            if dynamics is not None:
                checks.append(tree_check(where, proof, dynamics, least, (self.limit, limit)))
            elif own.inertia is None:
                checks.append(holds(where, passed=False, detail="not all inertias are stated"))
        return checks

    # the largest and the failing magnitude

    def _possible_check(self, largest: float) -> Check:
        """Check that forces of rest exist up to the claimed magnitude, and none beyond it."""
        name, possible = f"{self.name} can be balanced", self.claim["possible"]
        shown, forces = f"up to {possible:.6g} N", self.claim.maybe("forces")
        if forces is not None:
            rest = _rest_check(forces, self._load_at(possible), f"{shown} of {self.name}")
            if not rest.passed:
                return holds(name, passed=False, detail=f"{shown}: {rest.detail}")
        elif possible != 0.0:
            return Check(name, None, f"{shown}: no forces in the document")
        z = self.claim.maybe("no_rest")
        if z is None:
            is_end = possible >= largest
            why = "the largest one searched" if is_end else "but larger ones are not ruled out"
            return Check(name, is_end or None, f"{shown}, {why}")
        step = np.concatenate([self.step, np.zeros(len(z) - len(self.step))])
        beyond = possible + tolerances.BEYOND * max(
            possible, 1.0 / float(np.abs(step / self.bodies.unit).max())
        )
        # The unbalanced load is linear in the magnitude: it grows from here on.
        residual = self.bodies.least_unbalanced_load(z, beyond * step)
        good = residual > max(tolerances.SHARE, self.bodies.least_unbalanced_load(z))
        return holds(
            name, good, f"{shown}; {residual:.2g} of the load unbalanced at {beyond:.6g} N"
        )

    def _failing_checks(self) -> list[Check]:
        """Return the check that the object may or must move at a magnitude, if one is claimed."""
        name, verdict = f"{self.name} is too large", self.claim.maybe("failure")
        if verdict is None and self.claim.maybe("failing") is None:
            return []
        verdict, failing = self.claim["failure"], self.claim["failing"]
        lines = verdict_checks(verdict, self._load_at(failing))
        wrong = [f"{line.name}: {line.detail}" for line in lines if not line.passed]
        status = verdict["status"]
        if status not in ("weak", "none"):
            wrong.append(f"the verdict is {status}; it must be weak or none")
        if not wrong and status == "weak":
            speed = verdict["motion"]["point_acceleration"]
            if speed <= self.limit:
                wrong.append(f"{speed:.6g} m/s^2 is within the limit without disturbance")
        shown = f"at {failing:.6g} N the verdict is {status}"
        return [holds(name, not wrong, wrong[0] if wrong else shown)]


def _rest_check(forces: np.ndarray, own: RestLoad, where: str) -> Check:
    """Check that stated forces balance a load, relative to the load without disturbance."""
    amiss = own.rest_violation(own.local(forces))
    return within(f"rest is an outcome, {where}", amiss, tolerances.SHARE, "of the load")
