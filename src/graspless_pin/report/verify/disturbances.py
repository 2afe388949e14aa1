"""Check which disturbances a document claims to be borne for certain, and which are too much.

All loads between two are one span. Forces that balance both, and certificates of both that lean on
normal forces of all outcomes in between, hold for each of them. Else an outcome of one in between
has a power of at most what one of the two loads gives its motion: two trees prove a span, in each
of which the load is any up to the other one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.outcome import Check, holds, within
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.rest import resolution_of, verdict_checks
from graspless_pin.report.verify.rest_load import LARGEST_FORCE, RestLoad, read_load
from graspless_pin.report.verify.rest_tree import certificate, force_limit, stated_loads, tree
from graspless_pin.report.verify.values import MOST, array, entry, items, number

_MOST_SPANS = 100


def disturbance_checks(document: dict[str, Any], problem: Problem) -> list[Check]:
    """Return the checks of what stands under ``disturbances``; none where nothing does.

    Args:
        document: The document, with the motors' torques and the verdict without disturbance.
        problem: What it says of contacts and joints.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    stated, where = document.get("disturbances"), "disturbances"
    if stated is None:
        return []
    length = number(entry(stated, "characteristic_length", where), "characteristic_length")
    largest = number(entry(stated, "largest", where), "largest")
    undisturbed = entry(document, "stability", "the document")
    claims = items(entry(stated, "directions", where), f"directions of {where}", 0, MOST)
    sure = entry(undisturbed, "status", "stability") == "strong"
    checks = [
        holds("rest without disturbance is sure", sure or not claims, f"{len(claims)} directions")
    ]
    bodies = read_load(document, problem)
    resolution = resolution_of(undisturbed, "stability")
    for index, claim in enumerate(claims):
        unit = array(entry(claim, "direction", where), problem.w.shape, f"direction {index}")
        if abs(float(np.linalg.norm(unit)) - 1.0) > tolerances.UNIT or length <= 0.0:
            raise ValueError(f"direction {index} of {where} is no unit of force and moment")
        step = unit * np.where(problem.turns, length, 1.0)
        checks += _Direction(index, claim, bodies, step, bodies.limit(resolution)).run(largest)
    return checks


_FIGURES = "guaranteed", "failing", "possible"
_CLAIMS = (*_FIGURES, "spans", "failure", "forces", "no_rest")


class _Direction:
    """What is claimed of disturbances along one direction."""

    def __init__(
        self, index: int, claim: Any, bodies: RestLoad, step: np.ndarray, limit: float
    ) -> None:
        self.name, self.claim, self.bodies = f"disturbance {index}", claim, bodies
        self.step, self.limit = step, limit

    def run(self, largest: float) -> list[Check]:
        if self.bodies.problem.slides.any():
            raise ValueError(f"{self.name} is of an object that slides")
        stated = {key: entry(self.claim, key, self.name) for key in _CLAIMS}
        if not any(stated.values()) and all(stated[key] is None for key in _FIGURES):
            return [holds(f"{self.name} was not reached", passed=True, detail="claims nothing")]
        return [self._is_supported(), self._last(largest), *self._failing()]

    def _figure(self, key: str) -> float:
        return number(entry(self.claim, key, self.name), f"{key} of {self.name}")

    def _at(self, magnitude: float) -> RestLoad:
        return self.bodies.changed(magnitude * self.step)

    # what is borne

    def _is_supported(self) -> Check:
        """Check that spans from zero on reach as far as is claimed."""
        name, wanted = f"{self.name} is borne", self._figure("guaranteed")
        spans, reached, shown = entry(self.claim, "spans", self.name), 0.0, f"up to {wanted:.6g} N"
        if spans is None:
            return Check(name, None, f"{shown}: no proof in the document")
        for number_, span in enumerate(items(spans, f"spans of {self.name}", 0, _MOST_SPANS)):
            where = f"span {number_} of {self.name}"
            ends = items(span, where, 2, 2)
            first, last = (number(entry(end, "magnitude", where), where) for end in ends)
            if not first <= reached <= last:
                return holds(name, passed=False, detail=f"{where} is not next to the one before")
            for check in self._span(ends, (first, last), where):
                if not check.passed:
                    return holds(name, passed=False, detail=f"{check.name}: {check.detail}")
            reached = last
        count = f"{len(spans)} span{'s' if len(spans) != 1 else ''}"
        good = 0.0 <= wanted <= reached
        return holds(name, good, f"{shown}, proven up to {reached:.6g} N in {count}")

    def _span(self, ends: list[Any], magnitudes: tuple[float, float], where: str) -> list[Check]:
        """Return the checks of all loads from one magnitude to another."""
        bodies = [self._at(magnitude) for magnitude in magnitudes]
        proofs = [entry(end, "proof", where) for end in ends]
        checks, loads, parts = list[Check](), list[np.ndarray](), []
        for end, proof, own, other in zip(ends, proofs, bodies, reversed(bodies), strict=True):
            checks.append(self._rest("rest_forces", end, own, where))
            limit, reach = force_limit(proof, LARGEST_FORCE * self.bodies.problem.force)
            dynamics = None if own.dynamics is None else own.dynamics.towards(other.dynamics)
            least, shown = stated_loads(proof, own, dynamics, limit)
            checks += [reach, *shown]
            loads.append(least)
            parts.append((own, dynamics, limit))
        if all(entry(proof, "forces", where) is not None for proof in proofs):
            common = np.minimum(*loads)
            for own, proof in zip(bodies, proofs, strict=True):
                forces = own.forces("forces", proof, where)
                normal_forces = np.maximum(own.commanded, common)
                checks.append(certificate(where, own, forces, normal_forces, self.limit))
            return checks
        for proof, least, (own, dynamics, limit) in zip(proofs, loads, parts, strict=True):
            if dynamics is not None:
                checks.append(tree(where, proof, dynamics, least, (self.limit, limit)))
            elif own.inertia is None:
                checks.append(holds(where, passed=False, detail="no inertia is known"))
        return checks

    def _rest(self, key: str, mapping: object, own: RestLoad, where: str) -> Check:
        """Check that stated forces balance a load, relative to the load without disturbance."""
        amiss = own.amiss(own.forces(key, mapping, where))
        return within(f"rest is an outcome, {where}", amiss, tolerances.SHARE, "loads")

    # where it ends

    def _last(self, largest: float) -> Check:
        """Check that forces of rest reach as far as is claimed, and no farther."""
        name, possible = f"{self.name} can be balanced", self._figure("possible")
        shown = f"up to {possible:.6g} N"
        if entry(self.claim, "forces", self.name) is not None:
            rest = self._rest("forces", self.claim, self._at(possible), f"{shown} of {self.name}")
            if not rest.passed:
                return holds(name, passed=False, detail=f"{shown}: {rest.detail}")
        elif possible != 0.0:
            return Check(name, None, f"{shown}: no forces in the document")
        z = entry(self.claim, "no_rest", self.name)
        if z is None:
            is_end = possible >= largest
            why = "as far as was looked" if is_end else "what is beyond is not said"
            return Check(name, is_end or None, f"{shown}, {why}")
        z = array(z, self.bodies.load.shape, f"no_rest of {self.name}")
        step = np.concatenate([self.step, np.zeros(len(z) - len(self.step))])
        beyond = possible + tolerances.BEYOND * max(
            possible, 1.0 / float(np.abs(step / self.bodies.unit).max())
        )
        # What is left is linear in the magnitude: it grows from here on.
        left = self.bodies.left_by_all(z, beyond * step)
        good = left > max(tolerances.SHARE, self.bodies.left_by_all(z))
        return holds(name, good, f"{shown}; {left:.2g} loads are unbalanced at {beyond:.6g} N")

    def _failing(self) -> list[Check]:
        """Return the check that the object may or must move at a magnitude, if one is claimed."""
        name, where = f"{self.name} is too much", f"the failure of {self.name}"
        stated, verdict = (entry(self.claim, key, self.name) for key in ("failing", "failure"))
        if stated is None and verdict is None:
            return []
        failing = number(stated, f"failing of {self.name}")
        wrong = [
            f"{line.name}: {line.detail}"
            for line in verdict_checks(verdict, self._at(failing))
            if not line.passed
        ]
        status = entry(verdict, "status", where)
        if status not in ("weak", "none"):
            wrong.append(f"it is {status}")
        if not wrong and status == "weak":
            motion = entry(verdict, "motion", where)
            speed = number(entry(motion, "point_acceleration", where), where)
            if speed <= self.limit:
                wrong.append(f"{speed:.6g} m/s^2 is no motion without disturbance")
        shown = f"at {failing:.6g} N the verdict is {status}"
        return [holds(name, not wrong, wrong[0] if wrong else shown)]
