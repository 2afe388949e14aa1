"""The checks of one document, in the order in which they are shown.

Figures that no check uses under a status are named, so that they do not pass for checked.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.assumptions import taken_as_given
from graspless_pin.report.verify.bounds import proven_bound
from graspless_pin.report.verify.disturbances import disturbance_checks
from graspless_pin.report.verify.fields import (
    FIELDS,
    FORMAT,
    FOUND_STATES,
    IN_MODE,
    OPEN,
    UNGUARANTEED,
    Part,
    stacked,
)
from graspless_pin.report.verify.forces import (
    against_mode,
    figure_checks,
    force_checks,
    frames_check,
    residual,
)
from graspless_pin.report.verify.outcome import (
    Check,
    Claim,
    Verification,
    agrees,
    given,
    holds,
    within,
)
from graspless_pin.report.verify.problem import MESSAGES, Forces, Problem
from graspless_pin.report.verify.reading import (
    read_mode,
    read_problem,
    stated_multipliers,
)
from graspless_pin.report.verify.rest import rest_checks
from graspless_pin.report.verify.tree import (
    ModeSet,
    TreeProof,
    TreeWalk,
    contact_velocities,
    motion_check,
    root_state,
)
from graspless_pin.report.verify.uncertain import uncertainty_checks


def guarantee_checks(stated: Part, problem: Problem, status: str) -> list[Check]:
    """Return the checks of ``guarantee``; none where there is none. The verdict has its own.

    Args:
        stated: The document.
        problem: Its problem.
        status: Status of the solution.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    if stated.get("guarantee") is None and status not in ("strong", *UNGUARANTEED):
        return []
    verdict = stated.get("stability")
    strength = verdict and verdict["status"]
    if status in FOUND_STATES:
        detail, sure = f"verdict: {strength}", strength == "strong"
        check = holds("the torques are guaranteed", sure, detail, Claim.GUARANTEE)
        return [check, *_best_case_checks(stated, problem)]
    checks = [given("the best case", "its torques are not in the document")]
    if status == "infeasible_strong":
        # Without joints there is only one set of torques.
        is_proven = not problem.units and strength in ("weak", "none")
        detail = f"verdict: {strength}, {len(problem.units)} joints"
        checks.append(holds("no torques are guaranteed", is_proven, detail))
    elif status == "strong_not_found":
        why = "no such torques were found, and it is not proven that there are none"
        checks.append(Check("whether there are guaranteed torques", None, why))
    return checks


def value_unit(problem: Problem) -> str:
    """Return the unit of the objective's value."""
    if problem.own is not None or problem.by_limits:
        return ""
    return "N" if problem.is_margin else ", ".join(sorted(set(problem.units), reverse=True))


def stated_forces(stated: Part, problem: Problem) -> Forces:
    """Return the stated contact forces, with the columns of an own objective."""
    columns = None if problem.own is None else problem.own.values
    return Forces(problem, stacked(stated["contacts"], "force"), columns)


def _best_case_checks(stated: Part, problem: Problem) -> list[Check]:
    """Return the checks of the best case, which its bound proves, and of the gap to it."""
    best, gap = (stated["guarantee"][key] for key in ("best_case", "gap"))
    bound, value = stated["certificate"]["bound"], problem.objective(stated_forces(stated, problem))
    sign, unit = (-1.0 if problem.maximizes else 1.0), value_unit(problem)
    worse, limit = value - sign * best, tolerances.objective(problem, best, bound)
    return [
        within("the best case is within its bound", sign * (bound - best), limit, unit),
        within("the best case is no worse than the answer", -worse, limit, unit),
        agrees("gap to the best case as stated", gap, max(worse, 0.0), limit, unit),
    ]


def unread_figures(
    document: dict[str, Any], status: str, *, complete: bool, has_modes: bool
) -> list[Check]:
    """Return the line that names the figures that no check uses; none where there are none.

    Args:
        document: The document, with a proof.
        status: Status of the answer.
        complete: Whether its proof is complete.
        has_modes: Whether friction needs a virtual sliding.
    """
    found = status in FOUND_STATES
    read = {
        "multipliers": found and status != "strong",
        "proof.motion": has_modes and (found or status == "infeasible_in_mode"),
        "proof.nodes": complete,
        "proof.forces": status == "infeasible_modes",
        "proof.columns": status == "infeasible_modes",
        "proof.mode_multipliers": found and not complete,
    }
    stated = {**{f"proof.{key}": one for key, one in document["proof"].items()}, **document}
    unread = [key for key, is_read in read.items() if not is_read and stated.get(key)]
    unread += [f"{key!r:.60}" for key in document if key not in FIELDS["document"]]
    words = f"no check uses {', '.join(unread)}"
    return [given("figures without a claim", words)] if unread else []


_WITH_GAP = ("limit_reached", "strong")
"""Statuses of answers that are not proven optimal."""


def verify_document(document: dict[str, Any]) -> Verification:
    """Verify a solution from its document, found or not (see `solution_document`).

    See the example of `Verification`.

    Args:
        document: The parsed JSON.

    Returns:
        A check for each figure and statement: what is proven, what is not so, what the document
        holds no proof of, and what is taken as given.

    Raises:
        ValueError: If it is no such document, is one of another format, lacks a key, or has a value
            of a wrong type or size.
    """
    if not isinstance(document, dict):
        raise ValueError("it is not a solution document: it must be a JSON object written by solve")  # noqa: TRY004
    if "format" not in document:
        raise ValueError(
            "it does not state its format version: solve again to write a new document"
        )
    if document["format"] != FORMAT or isinstance(document["format"], bool):
        found = document["format"]
        raise ValueError(f"its format version is {found!r:.20}; it must be {FORMAT}: solve again")
    try:
        with np.errstate(all="ignore"):
            return Verification(tuple(_Checker(document).run()))
    except np.linalg.LinAlgError as error:
        raise ValueError(
            f"the document has numbers that the checks cannot compute with: {error}"
        ) from None


class _Checker:
    """The checks of one document."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.problem: Problem = read_problem(document)
        self.document, self.stated = document, self.problem.part(document)
        self.status = self.stated["status"]
        self.certificate, self.proof = self.stated["certificate"], self.stated["proof"]
        self.complete = self.proof["complete"]
        # Friction needs a virtual sliding, except under plain Coulomb friction.
        self.has_modes = not self.problem.coulomb or self.status in IN_MODE

    def run(self) -> list[Check]:
        document, problem = self.document, self.problem
        unread = unread_figures(
            document, self.status, complete=self.complete, has_modes=self.has_modes
        )
        checks = [*taken_as_given(problem, self.stated), *unread, frames_check(problem)]
        checks += self._statement_checks()
        checks += self._answer_checks() if self.status in FOUND_STATES else self._no_answer_checks()
        checks += guarantee_checks(self.stated, problem, self.status)
        of_rest = rest_checks(document, problem)
        checks += [replace(one, claim=Claim.REST) for one in of_rest]
        checks += disturbance_checks(document, problem)
        return checks + uncertainty_checks(document, problem, lambda one: _Checker(one).run())

    def _statement_checks(self) -> list[Check]:
        """Return the checks of status, message and scales."""
        stated, problem = self.stated, self.problem
        found, message, scales = stated["found"], stated["message"], stated["scales"]
        force, length = scales["force"], scales["length"]
        agree = message.startswith(MESSAGES[self.status])
        good = problem.force > 0.0 and np.isfinite(problem.force)
        return [
            holds("found and status agree", found == (self.status in FOUND_STATES), self.status),
            holds("message and status agree", agree, message[:60]),
            holds("the force scale is positive", good, f"{problem.force:.3g} N"),
            agrees("force scale", force, problem.force, tolerances.SAME * problem.force, "N"),
            agrees("length scale", length, problem.length, tolerances.SAME * problem.length, "m"),
            self._reach_check(),
        ]

    # found

    def _answer_checks(self) -> list[Check]:
        problem, stated = self.problem, self.stated
        forces = stated_forces(stated, problem)
        checks = force_checks(problem, forces) + figure_checks(problem, forces, stated)
        worst, claim = residual(problem, forces), self.certificate["primal_residual"]
        checks += [agrees("primal residual as stated", claim, worst, tolerances.SHARE, "(scaled)")]
        selected, signs = read_mode(self.document, problem)
        if self.has_modes:
            checks += [self._sign_rule_check(selected, signs), self._motion_check(selected, signs)]
        else:
            checks.append(self._sign_match_check(forces, selected, signs))
        most, reach = float(forces.local[:, 0].max()), self.certificate["force_reach"]
        opposing, limit = against_mode(problem, forces, selected, signs), tolerances.force(problem)
        checks += [
            within("friction opposes the mode (27), (31)", opposing, limit, "N"),
            holds("the forces are within the reach of the proof",
                  most <= (1.0 + tolerances.SHARE) * reach, f"{most:.6g} N"),
            self._no_violation_check(),
        ]  # fmt: skip
        return checks + self._optimality_checks(forces, selected, signs)

    def _sign_rule_check(self, selected: np.ndarray, signs: np.ndarray) -> Check:
        """Check which contacts are selected, and how many zero signs they have."""
        problem = self.problem
        zeros = (signs == 0).sum(axis=1)
        ok = np.where(selected, zeros <= (problem.sign_rule == "exact"), zeros == 2)
        ok &= ~selected | problem.candidates
        if problem.constrained:
            ok &= selected | ~problem.slides
        detail = f"contacts that violate them: {np.flatnonzero(~ok).tolist() or 'none'}"
        return holds("signs obey the rules", ok.all(), detail)

    def _motion_check(self, selected: np.ndarray, signs: np.ndarray) -> Check:
        motion, u = self.proof.maybe("motion"), np.zeros((self.problem.count, 3))
        if motion is not None:
            u = contact_velocities(self.problem, motion["object"], motion["joints"])
        return motion_check(self.problem, u, selected, signs)

    def _sign_match_check(self, forces: Forces, selected: np.ndarray, signs: np.ndarray) -> Check:
        """Check that the mode describes the friction, where no rule asks for a sliding."""
        friction = forces.local[:, 1:] * self.problem.has_cone[:, None]
        with_friction = np.abs(friction) > tolerances.force(self.problem)
        ok = (selected == (signs != 0).any(axis=1)).all() and (signs[with_friction] != 0).all()
        detail = f"{int(with_friction.sum())} components of friction are not zero"
        return holds("signs describe the friction", ok, detail)

    def _reach_check(self) -> Check:
        """Check the normal forces up to which bounds are proven: all, or far above the load."""
        problem, reach = self.problem, self.certificate["force_reach"]
        wanted = min(tolerances.LONGEST_REACH * problem.force, float(problem.limit.max()))
        detail = f"{reach:.6g} N, required {wanted:.6g} N"
        return holds("reach of the proof", reach >= (1.0 - tolerances.SAME) * wanted, detail)

    def _optimality_checks(
        self, forces: Forces, selected: np.ndarray, signs: np.ndarray
    ) -> list[Check]:
        """Return the checks of bound and gap, and of the proofs by multipliers and tree."""
        problem, value, unit = (
            self.problem,
            self.problem.objective(forces),
            value_unit(self.problem),
        )
        sign = -1.0 if problem.maximizes else 1.0
        bound, gap = sign * self.certificate["bound"], self.certificate["gap"]
        # An answer far from the optimum widens no tolerance.
        limit, checks = tolerances.objective(problem, value, bound), []
        if problem.own is not None:
            checks.append(agrees("value as stated", problem.own.value, sign * value, limit, unit))
        checks.append(agrees("gap as stated", gap, value - bound, limit, unit))
        if self.status not in _WITH_GAP:
            checks.append(within("gap is closed", abs(value - bound), limit, unit))
        if self.status != "strong":
            checks += self._multiplier_checks(forces, value, unit)
        what, claim = ("bound", None) if self.status in _WITH_GAP else ("optimal", Claim.OPTIMUM)
        name = f"{what} over all modes" if self.has_modes else f"{what} over all friction"
        name = _IN_ITS_MODE if self.status == "optimal_in_mode" else name
        if not self.complete:
            within_mode = self._in_mode_check(value, selected, signs)
            return [*checks, self._missing_proof_check(name, claim), within_mode]
        root = root_state(problem, self.status, (selected, signs))
        proof = TreeWalk(problem, self._proven_reach()).walk(self.proof["nodes"], root)
        good = not proof.failure and proof.bound >= bound - limit
        shown = proof.failure or f"{_leaves(proof)}, proven gap {value - proof.bound:.1e} {unit}"
        return [*checks, holds(name, good, shown.rstrip(), claim)]

    def _proven_reach(self) -> float:
        return min(self.certificate["force_reach"], float(self.problem.limit.max()))

    def _proven_bound(
        self, given: object, where: str, free: np.ndarray
    ) -> tuple[float, tuple[str, ...]]:
        """Return the bound that multipliers prove, and the names of those without a constraint."""
        multipliers = stated_multipliers(given, self.problem, where)
        bound = proven_bound(self.problem, multipliers, free, self._proven_reach())
        return bound, multipliers.strays

    def _multiplier_checks(self, forces: Forces, value: float, unit: str) -> list[Check]:
        """Return the checks of the multipliers of the forces' own program."""
        problem, inner = self.problem, self.certificate["duality_gap"]
        # Friction may have the solution's own signs only.
        friction = forces.local[:, 1:] * problem.has_cone[:, None]
        least = tolerances.force(problem)
        with_friction = np.stack([friction < -least, friction > least], axis=2)
        multipliers = self.stated["multipliers"].stated
        bound, strays = self._proven_bound(multipliers, "multipliers", with_friction)
        own, limit = value - bound, tolerances.objective(problem, value, bound)
        shown = f"without a constraint: {', '.join(strays) or 'none'}"
        return [
            holds("each multiplier has a constraint", not strays, shown),
            within("gap left by the multipliers", own, limit, unit),
            agrees("duality gap as stated", inner * problem.unit, own, limit, unit),
        ]

    def _in_mode_check(self, value: float, selected: np.ndarray, signs: np.ndarray) -> Check:
        stated, good = self.proof.get("mode_multipliers"), False
        detail = "the document does not state its multipliers"
        if stated is not None:
            free = ModeSet.one_mode(self.problem, selected, signs).friction
            bound, strays = self._proven_bound(stated.stated, "mode_multipliers", free)
            gap, limit = value - bound, tolerances.objective(self.problem, value, bound)
            good, detail = gap <= limit and not strays, f"proven gap {gap:.1e}"
        return Check(_IN_ITS_MODE, good or None, detail, claim=Claim.OPTIMUM)

    # not found

    def _no_answer_checks(self) -> list[Check]:
        document = self.document
        stated = [document.get("margin"), document.get("max_torque")]
        stated += [c.get("force") for c in document["contacts"]]
        stated += [j.get(key) for j in document["joints"] for key in ("torque", "torque_contact")]
        empty = all(one is None for one in stated)
        checks = [holds("states no forces", empty, "null" if empty else "some are stated")]
        if self.status in (*OPEN, *UNGUARANTEED):
            checks.append(self._no_violation_check())
            if self.status in OPEN:
                checks.append(
                    Check("whether there is an answer", None, "the search did not decide it")
                )
            return checks
        name, shared = MESSAGES[self.status].split(":")[0], self.certificate["infeasibility"]
        if not self.complete:
            return [*checks, self._missing_proof_check(name)]
        mode = None
        if self.status in IN_MODE:
            mode = read_mode(document, self.problem)
            checks.append(self._sign_rule_check(*mode))
        root = root_state(self.problem, self.status, mode)
        if self.status == "infeasible_in_mode" and mode:
            checks.append(self._motion_check(*mode))
        proof = TreeWalk(self.problem, np.inf).walk(self.proof["nodes"], root)
        checks.append(self._infeasibility_check(name, proof))
        if self.status == "infeasible_modes":  # forces balance where friction needs no sliding
            columns = None if self.problem.own is None else self.proof["columns"]
            worst = residual(self.problem, Forces(self.problem, self.proof["forces"], columns))
            checks.append(within("forces that balance exist", worst, tolerances.SHARE, "(scaled)"))
        most = proof.violation
        detail = f"stated {shared:.3g}, proven {most:.3g} (scaled)"
        good = shared <= most * (1.0 + tolerances.SAME)
        return [*checks, holds("smallest common violation", good, detail)]

    def _no_violation_check(self) -> Check:
        shared = self.certificate["infeasibility"]
        return holds("states no infeasibility", shared <= 0.0, f"{shared:.3g}")

    def _infeasibility_check(self, name: str, proof: TreeProof) -> Check:
        failure = proof.failure
        if not failure and proof.bound < np.inf:
            failure = "a leaf does not prove that no forces are feasible"
        if not failure and self.status == "infeasible_mode" and proof.programs:
            failure = "a leaf rules out contact forces, but it must rule out virtual motions"
        return holds(name, not failure, failure or _leaves(proof))

    # both

    def _missing_proof_check(self, name: str, claim: Claim | None = None) -> Check:
        missing = self.proof["missing"][:200] or "the document holds no proof"
        return Check(name, None, missing, claim=claim)


_IN_ITS_MODE = "optimal within its mode"


def _leaves(proof: TreeProof) -> str:
    return "one leaf" if proof.leaves == 1 else f"{proof.leaves} leaves"
