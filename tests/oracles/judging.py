"""Hold what the package answers on a scene of any scale against the exact optimum.

What is judged is the statement, not the way to it: whether forces exist, the value, the forces
themselves, the mode's virtual motion and the proven bound. The unit is the load (docs/limits.md).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache, partial

import numpy as np
from tests.oracles.exact_optimum import Best, ExactScene, Mode, Question
from tests.oracles.outcome import Outcome
from tests.oracles.scale_scenes import Case

from graspless_pin import (
    QuasistaticProblem,
    Status,
    TorqueSolution,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

TOLERANCE = Fraction(1, 10**6)
"""What is asked: forces of the load, or of the value where that is larger."""
THRESHOLD = Fraction(1, 10**6)
"""The share of all contact velocities at which a virtual sliding counts (docs/rules.md)."""
STILL = Fraction(1, 10**8)
"""The share up to which a velocity along a normal is rounding."""
RESOLVED = 1e8
"""Loads up to which a limit may not keep the package from an answer."""
_CARRIED = 1e-6
"""Of the load: what a hand with smaller limits bears may be too little to be resolved."""
DOCUMENTED = 2
"""The documents of every so many scenes are written and checked."""
_FACTORS = (Fraction(1, 10), 10)
ROUNDING = Fraction(1, 10**12)
"""Of the load: what the arrays' own rounding may cost a degenerate scene its exact balance."""


_ROUNDED = (Fraction(0), ROUNDING, STILL)


@dataclass(frozen=True)
class Verdict:
    """An outcome and what it rests on.

    Attributes:
        outcome: How the answer compares.
        detail: Numbers, for outcomes other than agreement.
        error: Relative error of the value where both have one.
        found: Whether the exact problem has a solution.
    """

    outcome: Outcome
    detail: str = ""
    error: float = 0.0
    found: bool = False


def ask(problem: QuasistaticProblem, question: Question, *, search: str = "auto") -> TorqueSolution:
    """Ask the package."""
    if question.algorithm == "margin":
        solve = maximize_margin
    else:
        scale = "limits" if question.by_limits else "absolute"
        solve = partial(minimize_torque, margin=question.margin, scale=scale)
    return solve(
        problem,
        sign_rule=question.sign_rule,
        sliding_rule=question.sliding_rule,
        static_friction=question.static_friction,
        search=search,
    )


@lru_cache(maxsize=16)
def exact_scene(
    problem: QuasistaticProblem,
    question: Question,
    slack: Fraction = Fraction(0),
    still: Fraction = Fraction(0),
) -> ExactScene:
    """Return the exact scene of a problem; what was solved of it is kept for its next answer."""
    return ExactScene(problem, question, slack, still)


def judge(case: Case) -> Verdict:
    """Solve a case both ways and compare."""
    problem = case.problem
    try:
        solution = ask(problem, case.question)
    except ArgumentError as refusal:
        scene = exact_scene(problem, case.question)
        told = f"{spread(scene)}: {refusal}"
        return Verdict(unanswered(scene, Outcome.REFUSED), told, found=bool(scene.optimum()))
    verdict = compare(problem, case.question, solution)
    return verdict if case.seed % DOCUMENTED else documented(case, solution, verdict)


def documented(case: Case, solution: TorqueSolution, verdict: Verdict) -> Verdict:
    """Return the verdict, or that the document of the answer is refused or proves too little.

    That is wrong where all limits are near the load, as an answer that is missing.
    """
    if verdict.outcome in (Outcome.WRONG, Outcome.UNVERIFIED, Outcome.TOO_LARGE):
        return verdict
    document = json.loads(json.dumps(solution_document(solution), allow_nan=False))
    verification = verify_document(document)
    if verification.proven:
        return verdict
    left = [f"{one.name}: {one.detail}" for one in verification.checks if one.passed is not True]
    scene = exact_scene(case.problem, case.question)
    outcome = unanswered(scene, Outcome.UNVERIFIED)
    told = f"its document is not proven: {'; '.join(left)[:300]}; {spread(scene)}"
    return Verdict(outcome, told, verdict.error, verdict.found)


def compare(problem: QuasistaticProblem, question: Question, solution: TorqueSolution) -> Verdict:
    """Hold one answer against the exact optimum."""
    return _Comparison(exact_scene(problem, question), solution).verdict()


def unanswered(scene: ExactScene, outcome: Outcome) -> Outcome:
    """Return an outcome without an answer, which is wrong where all limits are near the load."""
    sizes = _limit_sizes(scene)
    is_near = sizes.max() <= RESOLVED and sizes.min() >= _CARRIED
    return Outcome.WRONG if is_near else outcome


def spread(scene: ExactScene) -> str:
    """Say how many times the load the smallest and the largest finite limit are."""
    sizes = _limit_sizes(scene)
    return f"limits {sizes.min():.2e} to {sizes.max():.2e} of the load"


def _limit_sizes(scene: ExactScene) -> np.ndarray:
    """Finite limits that are not zero, in loads."""
    problem = scene.problem
    levers = np.array([float(lever) for lever in scene.levers])
    torques = np.concatenate([problem.lower_torque / levers, problem.upper_torque / levers])
    sizes = np.abs(np.concatenate([problem.max_normal_force, torques])) / float(scene.load)
    return sizes[np.isfinite(sizes) & (sizes > 0.0)]


@dataclass(eq=False)
class _Comparison:
    """One answer before the exact scene."""

    scene: ExactScene
    solution: TorqueSolution

    def verdict(self) -> Verdict:
        """Return how the answer compares."""
        solution, scene = self.solution, self.scene
        exact = scene.optimum(THRESHOLD)
        found = exact is not None
        if solution.status is Status.LOAD_TOO_LARGE:
            outcome = Outcome.TOO_LARGE if scene.is_overloaded else Outcome.WRONG
            return Verdict(outcome, f"{solution.status.name}; {spread(scene)}", found=found)
        if solution.status in (Status.UNVERIFIED, Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT):
            told = f"{solution.status.name}; {spread(scene)}"
            return Verdict(unanswered(scene, Outcome.UNVERIFIED), told, found=found)
        if solution.found and (fault := self._fault()):
            return Verdict(Outcome.WRONG, f"{fault}; {self._told(exact)}", found=found)
        # What the arrays' rounding takes from coplanar contacts and degenerate balances counts not.
        for meant in (scene, *(self._with(ROUNDING, still) for still in _ROUNDED)):
            best = meant.optimum(THRESHOLD)
            if self._agrees(best, best):
                return self._agreed(meant, best)
        slow = self._with(ROUNDING, STILL).optimum(THRESHOLD / 10)
        if self._agrees(slow, scene.optimum(THRESHOLD * 10)):
            return Verdict(Outcome.THRESHOLD, self._told(exact), found=found)
        loose = self._with(TOLERANCE, STILL).optimum(THRESHOLD / 10)
        tight = self._with(-TOLERANCE).optimum(THRESHOLD * 10)
        if self._agrees(loose, tight):
            return Verdict(Outcome.TOLERANCE, self._told(exact), found=found)
        return Verdict(Outcome.WRONG, self._told(exact), self._error(exact), found)

    def _agreed(self, scene: ExactScene, best: Best | None) -> Verdict:
        """Look at what an answer that agrees says of the threshold."""
        others = [scene.optimum(THRESHOLD * factor) for factor in _FACTORS]
        told = self.solution.certificate.threshold_optima
        apart = max(self._apart(best, other) for other in others)
        if told is None:
            if apart > 3 * TOLERANCE:
                missing = ", ".join(
                    "none" if o is None else f"{float(o.value):.9g}" for o in others
                )
                fault = f"does not say that it hangs on the threshold ({missing})"
                return Verdict(
                    Outcome.WRONG, f"{fault}; {self._told(best)}", found=best is not None
                )
            return Verdict(Outcome.AGREE, "", self._error(best), best is not None)
        for figure, other in zip(told, others, strict=True):
            value = None if np.isnan(figure) else Best(Fraction(figure), (), None)
            if self._apart(value, other) > 3 * TOLERANCE:
                fault = f"says {figure:.9g} of another threshold"
                return Verdict(
                    Outcome.WRONG, f"{fault}; {self._told(other)}", found=best is not None
                )
        if apart < TOLERANCE / 3:
            fault = "says that it hangs on the threshold"
            return Verdict(Outcome.WRONG, f"{fault}; {self._told(best)}", found=best is not None)
        return Verdict(Outcome.THRESHOLD, "as it says", self._error(best), best is not None)

    def _apart(self, one: Best | None, other: Best | None) -> float:
        """How far two optima differ, in loads or of themselves; inf if one is none."""
        if one is None or other is None:
            return 0.0 if one is other else np.inf
        return float(
            abs(one.value - other.value) / max(self._unit, abs(one.value), abs(other.value))
        )

    @property
    def _value(self) -> Fraction:
        solution = self.solution
        if self.scene.question.algorithm == "margin":
            return Fraction(solution.margin)
        if not self.scene.question.by_limits:
            return Fraction(solution.max_torque)
        shares = [Fraction(0)]
        problem = self.scene.problem
        limits = zip(solution.torques, problem.lower_torque, problem.upper_torque, strict=True)
        for torque, low, high in limits:
            if 0.0 < high < np.inf:
                shares.append(Fraction(torque) / Fraction(high))
            if -np.inf < low < 0.0:
                shares.append(Fraction(torque) / Fraction(low))
        return max(shares)

    @property
    def _unit(self) -> Fraction:
        """The load in the unit of the value."""
        scene, question = self.scene, self.scene.question
        if question.algorithm == "margin":
            return scene.load
        torques = [scene.load * lever for lever in scene.levers]
        if not question.by_limits:
            return max(torques, default=scene.load)
        problem = scene.problem
        shares = [
            torque / Fraction(abs(limit))
            for limits in (problem.lower_torque, problem.upper_torque)
            for torque, limit in zip(torques, limits.tolist(), strict=True)
            if limit and np.isfinite(limit)
        ]
        return max(shares, default=Fraction(1))

    def _near(self, first: Fraction, second: Fraction) -> Fraction:
        return TOLERANCE * max(self._unit, abs(first), abs(second))

    def _agrees(self, better: Best | None, worse: Best | None) -> bool:
        """Whether the answer lies between two optima; None is worse than any."""
        if not self.solution.found:
            return worse is None
        if better is None:
            return False
        sign = 1 if self.scene.question.algorithm == "margin" else -1
        value = sign * self._value
        least = sign * better.value
        if value > least + self._near(value, least):
            return False
        if worse is None:
            return True
        return value >= sign * worse.value - self._near(value, worse.value)

    def _error(self, best: Best | None) -> float:
        if best is None or not self.solution.found:
            return 0.0
        return float(abs(self._value - best.value) / max(self._unit, abs(best.value)))

    def _told(self, best: Best | None) -> str:
        own = f"{float(self._value):.9g}" if self.solution.found else self.solution.status.name
        exact = "infeasible" if best is None else f"{float(best.value):.9g}"
        return f"answer {own}, exact {exact}, {spread(self.scene)}"

    def _with(self, slack: Fraction, still: Fraction = Fraction(0)) -> ExactScene:
        return exact_scene(self.scene.problem, self.scene.question, slack, still)

    def _fault(self) -> str:
        """What the solution says of itself that is not so; empty if nothing."""
        solution, scene, question = self.solution, self.scene, self.scene.question
        forces = solution.contact_forces
        if scene.is_overloaded:
            return "found though the load is too large"
        if (beyond := scene.beyond_limits(forces)) > 1:
            return f"a limit is exceeded by {float(beyond):.2g} times what may be"
        if (miss := scene.miss(forces)) > TOLERANCE:
            return f"forces miss a constraint by {float(miss):.2g} of the load"
        least = Fraction(0) if question.algorithm == "margin" else Fraction(question.margin)
        if Fraction(solution.margin) < least - TOLERANCE * scene.load:
            return f"margin {solution.margin:.6g} below {float(least):.6g}"
        bound = solution.certificate.bound
        if not np.isfinite(bound):
            return f"bound {bound}"
        gap = abs(Fraction(bound) - self._value)
        if gap > self._near(self._value, Fraction(bound)):
            return f"value {float(self._value):.9g} but bound {bound:.9g}"
        if question.static_friction == "coulomb":
            return ""
        return self._faulty_mode(forces)

    def _faulty_mode(self, forces: np.ndarray) -> str:
        scene, problem, mode = self.scene, self.scene.problem, self.solution.mode
        assert mode is not None
        plain: Mode = tuple(
            (int(signs[0]), int(signs[1])) if chosen else None
            for chosen, signs in zip(mode.selection, mode.signs, strict=True)
        )
        # A motion that a hair of rounding takes away still counts, and so does a slower one here.
        roundings = (self.scene, self._with(ROUNDING, ROUNDING), self._with(ROUNDING, STILL))
        if not any(one.admits(plain, THRESHOLD / 10) for one in roundings):
            return f"mode {mode} has only a motion of speed {float(scene.speed(plain)):.2g}"
        friction = np.einsum("lij,li->lj", problem.tangents, forces)
        least = float(TOLERANCE * scene.load)
        for contact, signs in enumerate(plain):
            if not problem.has_cone[contact]:
                continue
            for component, sign in enumerate(signs or (0, 0)):
                against = friction[contact, component] * sign
                if against > least or (not sign and abs(friction[contact, component]) > least):
                    return f"friction at contact {contact} is not opposite to the virtual sliding"
        return ""
