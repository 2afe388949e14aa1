"""The checks of one document, in the order in which they are shown.

Figures that a status makes nothing of are named, so that none is taken for checked.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.assumptions import taken_as_given
from graspless_pin.report.verify.bounds import proven_bound
from graspless_pin.report.verify.disturbances import disturbance_checks
from graspless_pin.report.verify.forces import (
    against_mode,
    figure_checks,
    force_checks,
    frames_check,
    residual,
)
from graspless_pin.report.verify.outcome import Check, Verification, agrees, given, holds, within
from graspless_pin.report.verify.problem import (
    FOUND_STATES,
    IN_MODE,
    INFEASIBLE,
    MESSAGES,
    OPEN,
    UNGUARANTEED,
    Forces,
    Problem,
)
from graspless_pin.report.verify.reading import (
    CHECKED_FORMAT,
    read_forces,
    read_mode,
    read_problem,
    stated_multipliers,
    stray_multipliers,
)
from graspless_pin.report.verify.rest import rest_checks
from graspless_pin.report.verify.tree import (
    Proof,
    State,
    TreeWalk,
    motion_check,
    root_of,
    velocities,
)
from graspless_pin.report.verify.uncertain import uncertainty_checks
from graspless_pin.report.verify.values import array, entry, number, text, truth, word


def guarantee_checks(document: dict[str, Any], problem: Problem, status: str) -> list[Check]:
    """Return the checks of ``guarantee``; none where there is none. The verdict has its own.

    Args:
        document: The document.
        problem: What it says of contacts and joints.
        status: Of the solution.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    stated, verdict = document.get("guarantee"), document.get("stability")
    if stated is None and status not in ("strong", *UNGUARANTEED):
        return []
    says = None if verdict is None else text(entry(verdict, "status", "stability"), "status")
    if status in FOUND_STATES:
        sure = holds("the torques are guaranteed", says == "strong", f"verdict: {says}")
        return [sure, *_cost(document, entry(document, "guarantee", "the document"), problem)]
    checks = [given("the best case", "of torques that are not stated")]
    if status == "infeasible_strong":
        # Without joints there is one set of torques alone.
        none = not problem.units and says in ("weak", "none")
        detail = f"verdict: {says}, {len(problem.units)} joints"
        checks.append(holds("no torques are guaranteed", none, detail))
    elif status == "strong_not_found":
        why = "no torques were found, and no proof that there are none"
        checks.append(Check("whether there are guaranteed torques", None, why))
    return checks


def unit_of(problem: Problem) -> str:
    """Return the unit of the objective's value."""
    if problem.own is not None or problem.by_limits:
        return ""
    return "N" if problem.is_margin else "N m, N"


def _cost(document: dict[str, Any], stated: Any, problem: Problem) -> list[Check]:
    """Return the checks of the best case, which its bound proves, and of the gap to it."""
    best, gap = (number(entry(stated, key, "guarantee"), key) for key in ("best_case", "gap"))
    certificate = entry(document, "certificate", "the document")
    bound = number(entry(certificate, "bound", "certificate"), "bound")
    rows = [entry(one, "force", "a contact") for one in document["contacts"]]
    columns = None if problem.own is None else problem.own.values
    value = problem.objective(read_forces(rows, problem, "the forces", columns))
    sign, unit = (-1.0 if problem.maximizes else 1.0), unit_of(problem)
    worse, met = value - sign * best, tolerances.objective(problem, best, bound)
    return [
        within("the best case is within its bound", sign * (bound - best), met, unit),
        within("the best case is no worse", -worse, met, unit),
        agrees("gap to the best case as stated", gap, max(worse, 0.0), met, unit),
    ]


def unread_figures(
    document: dict[str, Any], status: str, *, complete: bool, has_modes: bool
) -> list[Check]:
    """Return the line that names the figures which no claim leans on; none where there are none.

    Args:
        document: The document.
        status: Of the answer.
        complete: Whether its proof is.
        has_modes: Whether friction needs a virtual sliding.

    Raises:
        ValueError: If there is no proof.
    """
    proof, found = entry(document, "proof", "the document"), status in FOUND_STATES
    read = {
        "multipliers": found and status != "strong",
        "proof.motion": has_modes and (found or status == "infeasible_in_mode"),
        "proof.nodes": complete,
        "proof.forces": status == "infeasible_modes",
        "proof.columns": status == "infeasible_modes",
        "proof.mode_multipliers": found and not complete,
    }
    stated = {**{f"proof.{key}": one for key, one in proof.items()}, **document}
    unread = [key for key, is_read in read.items() if not is_read and stated.get(key)]
    if not unread:
        return []
    return [given("figures without a claim", f"nothing leans on {', '.join(unread)}")]


_WITH_GAP = ("limit_reached", "strong")
"""Answers that are not proven to be the best."""


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
        raise ValueError("it is no solution document: not a JSON object")  # noqa: TRY004
    _check_format(document)
    try:
        with np.errstate(all="ignore"):
            return Verification(tuple(_Checker(document).run()))
    except np.linalg.LinAlgError as error:
        raise ValueError(f"the document has figures that cannot be worked with: {error}") from None


def _check_format(document: dict[str, Any]) -> None:
    if "format" not in document:
        raise ValueError("it has no format version: solve again and write it anew")
    if document["format"] != CHECKED_FORMAT or isinstance(document["format"], bool):
        raise ValueError(
            f"its format version is not {CHECKED_FORMAT}, which alone can be checked here"
        )


class _Checker:
    """One document, and what was worked out of it."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.document = document
        self.problem: Problem = read_problem(document)
        self.status = word(
            entry(document, "status", "the document"),
            "status",
            FOUND_STATES + INFEASIBLE + OPEN + UNGUARANTEED,
        )
        self.certificate = entry(document, "certificate", "the document")
        self.proof = entry(document, "proof", "the document")
        self.complete = truth(entry(self.proof, "complete", "proof"), "complete")
        # Friction needs a virtual sliding, unless Coulomb's law is all that is asked for.
        self.has_modes = not self.problem.coulomb or self.status in IN_MODE

    def run(self) -> list[Check]:
        checks = [
            *taken_as_given(self.problem, self.document),
            *unread_figures(
                self.document, self.status, complete=self.complete, has_modes=self.has_modes
            ),
            frames_check(self.problem),
            *self._statements(),
        ]
        if self.status in FOUND_STATES:
            checks += self._found()
        else:
            checks += self._not_found()
        checks += guarantee_checks(self.document, self.problem, self.status)
        checks += rest_checks(self.document, self.problem)
        checks += disturbance_checks(self.document, self.problem)
        joined = uncertainty_checks(self.document, self.problem, lambda one: _Checker(one).run())
        return checks + joined

    def _statements(self) -> list[Check]:
        """Return what is said of the answer as a whole, and the scales."""
        document, problem = self.document, self.problem
        found = truth(entry(document, "found", "the document"), "found")
        message = text(entry(document, "message", "the document"), "message")
        agree = message.startswith(MESSAGES[self.status])
        scales = entry(document, "scales", "the document")
        force, length = (number(entry(scales, key, "scales"), key) for key in ("force", "length"))
        good = problem.force > 0.0 and np.isfinite(problem.force)
        return [
            holds("found and status agree", found == (self.status in FOUND_STATES), self.status),
            holds("message and status agree", agree, message[:60]),
            holds("the load has a size", good, f"{problem.force:.3g} N"),
            agrees("force scale", force, problem.force, tolerances.SAME * problem.force, "N"),
            agrees("length scale", length, problem.length, tolerances.SAME * problem.length, "m"),
            self._reach(),
        ]

    # found

    def _found(self) -> list[Check]:
        problem, document = self.problem, self.document
        rows = [entry(c, "force", f"contact {i}") for i, c in enumerate(document["contacts"])]
        columns = None if problem.own is None else problem.own.values
        forces = read_forces(rows, problem, "the forces", columns)
        checks = force_checks(problem, forces) + figure_checks(problem, forces, document)
        worst = residual(problem, forces)
        stated = number(entry(self.certificate, "primal_residual", "certificate"), "a residual")
        checks.append(
            agrees("primal residual as stated", stated, worst, tolerances.SHARE, "(scaled)")
        )
        selected, signs = read_mode(document, problem)
        if self.has_modes:
            checks += [self._rules(selected, signs), self._motion(selected, signs)]
        else:
            checks.append(self._describes(forces, selected, signs))
        most, reach = float(forces.local[:, 0].max()), self._stated_reach()
        within_reach = most <= (1.0 + tolerances.SHARE) * reach
        checks.append(self._opposes(forces, selected, signs))
        checks.append(holds("the forces are within that reach", within_reach, f"{most:.6g} N"))
        checks.append(self._states_no_violation())
        return checks + self._optimality(forces, selected, signs)

    def _rules(self, selected: np.ndarray, signs: np.ndarray) -> Check:
        """Which contacts may or must be selected, and how many zeros they may have."""
        problem = self.problem
        zeros = (signs == 0).sum(axis=1)
        ok = np.where(selected, zeros <= (problem.sign_rule == "exact"), zeros == 2)
        ok &= ~selected | problem.candidates
        if problem.constrained:
            ok &= selected | ~problem.slides
        detail = f"contacts that do not: {np.flatnonzero(~ok).tolist()}"
        return holds("signs obey the rules", ok.all(), detail)

    def _motion(self, selected: np.ndarray, signs: np.ndarray) -> Check:
        motion = entry(self.proof, "motion", "proof")
        if motion is None:
            u = np.zeros((self.problem.count, 3))
        else:
            twist = array(entry(motion, "object", "motion"), self.problem.w.shape, "a motion")
            rates = entry(motion, "joints", "motion")
            rates = array(rates, (len(self.problem.units),), "a motion")
            u = velocities(self.problem, twist, rates)
        return motion_check(self.problem, u, selected, signs)

    def _describes(self, forces: Forces, selected: np.ndarray, signs: np.ndarray) -> Check:
        """Without any rule the mode only describes the friction."""
        friction = forces.local[:, 1:] * self.problem.cone[:, None]
        with_friction = np.abs(friction) > tolerances.force(self.problem)
        ok = (selected == (signs != 0).any(axis=1)).all() and (signs[with_friction] != 0).all()
        return holds(
            "signs describe the friction", ok, f"{int(with_friction.sum())} components rub"
        )

    def _opposes(self, forces: Forces, selected: np.ndarray, signs: np.ndarray) -> Check:
        worst = against_mode(self.problem, forces, selected, signs)
        met = tolerances.force(self.problem)
        return within("friction opposes the mode (27), (31)", worst, met, "N")

    def _reach(self) -> Check:
        """Return the normal forces up to which bounds are proven: all, or far above the load."""
        problem, reach = self.problem, self._stated_reach()
        wanted = min(tolerances.LONGEST_REACH * problem.force, float(problem.limit.max()))
        detail = f"{reach:.6g} N, wanted {wanted:.6g} N"
        return holds("reach of the proof", reach >= (1.0 - tolerances.SAME) * wanted, detail)

    def _stated_reach(self) -> float:
        return number(entry(self.certificate, "force_reach", "certificate"), "force_reach")

    def _optimality(self, forces: Forces, selected: np.ndarray, signs: np.ndarray) -> list[Check]:
        """Bound and gap from both sides, and what multipliers and tree prove."""
        problem = self.problem
        value = problem.objective(forces)
        bound, gap = (
            number(entry(self.certificate, key, "certificate"), key) for key in ("bound", "gap")
        )
        bound = -bound if problem.maximizes else bound
        # An answer far from the optimum widens no tolerance.
        met = tolerances.objective(problem, value, bound)
        checks, unit = [], unit_of(problem)
        if problem.own is not None:
            own_value = -value if problem.maximizes else value
            stated = problem.own.value
            checks.append(agrees("value as stated", stated, own_value, met, unit))
        checks.append(agrees("gap as stated", gap, value - bound, met, unit))
        if self.status not in _WITH_GAP:
            checks.append(within("gap is closed", abs(value - bound), met, unit))
        reach = min(self._stated_reach(), float(problem.limit.max()))
        if self.status != "strong":
            checks += self._duality(forces, value, reach, unit)
        name = "optimal over all modes"
        if self.status == "optimal_in_mode":
            name = "optimal within its mode"
        elif not self.has_modes:
            name = "optimal over all friction"
        if self.status in _WITH_GAP:
            name = "bound over all modes" if self.has_modes else "bound over all friction"
        if not self.complete:
            return [*checks, self._incomplete(name), self._within_mode(value, selected, signs)]
        proof = TreeWalk(problem, reach).walk(
            entry(self.proof, "nodes", "proof"), root_of(problem, self.status, (selected, signs))
        )
        good = not proof.failure and proof.bound >= bound - met
        shown = proof.failure or f"{_leaves(proof)}, proven gap {value - proof.bound:.1e} {unit}"
        return [*checks, holds(name, good, shown.rstrip())]

    def _duality(self, forces: Forces, value: float, reach: float, unit: str) -> list[Check]:
        """Return what the multipliers of the forces' own program prove."""
        problem = self.problem
        inner = number(entry(self.certificate, "duality_gap", "certificate"), "duality_gap")
        given_ = entry(self.document, "multipliers", "the document")
        m = stated_multipliers(given_, problem, "multipliers")
        strays = stray_multipliers(given_, problem, "multipliers")
        # Friction of the solution's own signs, where there is any.
        friction = forces.local[:, 1:] * problem.cone[:, None]
        least = tolerances.force(problem)
        with_friction = np.stack([friction < -least, friction > least], axis=2)
        bound = proven_bound(problem, m, with_friction, reach)
        own, met = value - bound, tolerances.objective(problem, value, bound)
        shown = f"of no constraint: {', '.join(strays) or 'none'}"
        return [
            holds("each multiplier has a constraint", not strays, shown),
            within("multipliers of these forces", own, met, unit),
            agrees("duality gap as stated", inner * problem.unit, own, met, unit),
        ]

    def _within_mode(self, value: float, selected: np.ndarray, signs: np.ndarray) -> Check:
        problem, name = self.problem, "optimal within its mode"
        given_ = self.proof.get("mode_multipliers")
        if given_ is None:
            return Check(name, passed=None, detail="no multipliers in the document")
        m = stated_multipliers(given_, problem, "mode_multipliers")
        strays = stray_multipliers(given_, problem, "mode_multipliers")
        reach = min(self._stated_reach(), float(problem.limit.max()))
        state = State.one_mode(problem, selected, signs)
        bound = proven_bound(problem, m, state.friction, reach)
        gap, met = value - bound, tolerances.objective(problem, value, bound)
        good = gap <= met and not strays
        return Check(name, passed=good or None, detail=f"proven gap {gap:.1e}")

    # not found

    def _not_found(self) -> list[Check]:
        document = self.document
        stated = [document.get("margin"), document.get("max_torque")]
        stated += [c.get("force") for c in document["contacts"]]
        stated += [j.get(key) for j in document["joints"] for key in ("torque", "torque_contact")]
        empty = all(one is None for one in stated)
        checks = [holds("states no forces", empty, "null" if empty else "some are there")]
        shared = self._stated_violation()
        if self.status in (*OPEN, *UNGUARANTEED):
            checks.append(self._states_no_violation())
            if self.status in OPEN:
                why = "the search did not end"
                checks.append(Check("whether there is an answer", None, why))
            return checks
        name = MESSAGES[self.status].split(":")[0]
        if not self.complete:
            return [*checks, self._incomplete(name)]
        mode = None
        if self.status in IN_MODE:
            mode = read_mode(document, self.problem)
            checks.append(self._rules(*mode))
        root = root_of(self.problem, self.status, mode)
        if self.status == "infeasible_in_mode" and mode:
            checks.append(self._motion(*mode))
        proof = TreeWalk(self.problem, np.inf).walk(entry(self.proof, "nodes", "proof"), root)
        checks.append(self._infeasible(name, proof))
        if self.status == "infeasible_modes":
            checks += self._forces_exist()
        good = shared <= max(proof.violation, 0.0) * (1.0 + tolerances.SAME)
        detail = f"stated {shared:.3g}, proven {max(proof.violation, 0.0):.3g} (scaled)"
        return [*checks, holds("smallest common violation", good, detail)]

    def _stated_violation(self) -> float:
        return number(entry(self.certificate, "infeasibility", "certificate"), "infeasibility")

    def _states_no_violation(self) -> Check:
        shared = self._stated_violation()
        return holds("states no infeasibility", shared <= 0.0, f"{shared:.3g}")

    def _infeasible(self, name: str, proof: Proof) -> Check:
        failure = proof.failure
        if not failure and proof.bound < np.inf:
            failure = "a leaf does not prove that there are no forces"
        if not failure and self.status == "infeasible_mode" and proof.programs:
            failure = "a leaf speaks of forces, not of motions"
        return holds(name, not failure, failure or _leaves(proof))

    def _forces_exist(self) -> list[Check]:
        """Return forces that balance where friction needs no virtual sliding."""
        rows, columns = entry(self.proof, "forces", "proof"), None
        if self.problem.own is not None:
            count = len(self.problem.own.cost)
            columns = array(entry(self.proof, "columns", "proof"), (count,), "columns of the proof")
        forces = read_forces(rows, self.problem, "the forces of the proof", columns)
        worst = residual(self.problem, forces)
        return [within("forces that balance exist", worst, tolerances.SHARE, "(scaled)")]

    # both

    def _incomplete(self, name: str) -> Check:
        reason = text(entry(self.proof, "missing", "proof"), "missing")
        return Check(name, None, reason[:200] or "the document holds no proof")


def _leaves(proof: Proof) -> str:
    return "one leaf" if proof.leaves == 1 else f"{proof.leaves} leaves"
