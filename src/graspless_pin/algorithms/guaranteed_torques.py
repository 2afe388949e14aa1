"""Torques of which rest is the only outcome: guesses, refined by their counterexamples.

The best case may depend on a squeeze between supports that nothing guarantees. Torques that balance
the load with less friction of the supports rely on the fingers, whose loads the torques determine:
the first guesses are optima with that friction reduced. A guess that fails comes with a motion a,
and every outcome a satisfies a^T M a = g(tau).a - sum mu f_n |u_t|. So the next torques are those
with which load and torques do less work along all these motions than the friction: one half-space
of torques for each motion, as in counterexample-guided synthesis. Only the verdict is a guarantee.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.holding.dynamics import contact_jacobian, generalized_load
from graspless_pin.holding.small_motions import LinearizedMotion, RestModel, extreme_forces
from graspless_pin.holding.stability import counterexamples, undecided_verdict
from graspless_pin.holding.verdict import DynamicOutcome, Stability, StabilityVerdict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.analysis_objectives import AtTorques, InsideHalfSpaces
from graspless_pin.programs.objectives import Margin, Objective
from graspless_pin.programs.program import MatrixInequality
from graspless_pin.solution import Evidence, Guarantee, Status, TorqueSolution
from graspless_pin.solvers import least_within
from graspless_pin.tree_search import Limits

_SHARES = (0.75, 0.5, 0.25, 0.0)
"""Factors on the friction of the supports, tried one after the other."""
_FRICTION_LEFT = (0.9, 0.5)
"""Shares of a counterexample's friction power that bound the power of its motion."""
_DEPTH = 0.3
"""Depth inside the half-spaces beyond which more does not count, over the joint scales."""
_STEPS = 12
"""Largest number of candidates from half-spaces of one search."""
_OTHERS = 2
"""Counterexamples to each candidate besides the first: which one is first depends on rounding."""
_HALVINGS = 3
"""Halvings of the line from guaranteed torques to the best case's."""
_SAME = 1e-6
"""Over the joint scales: torques that differ by less count as tried."""
_STILL = 1e-9
"""Power per second of the joint scales along a motion, W/s: joints with less do not take part."""
_GUESSED_GROWTH = 0.05
"""1/s: half of the rate that counts as growing."""
_RESERVE = 0.9
"""Share of the controller's gains with which guesses are stable, as nothing is quite rigid."""
_ROUNDS = 5
"""Largest number of semidefinite programs for one guess."""
FIRST_NODES = 300
"""Sets of outcomes of a first verdict; undecided candidates are asked again with all nodes."""

Optimum = Callable[[QuasistaticProblem, Objective], TorqueSolution]
"""Finds the best case of a problem for an objective."""
Tried = tuple[TorqueSolution, StabilityVerdict]
"""A candidate and the verdict on its torques."""


def guaranteed(
    best: TorqueSolution,
    optimum: Optimum,
    options: SolveOptions,
    limits: Limits,
    rest: RestModel | None = None,
) -> TorqueSolution:
    """Return the best torques found of which rest is the only outcome.

    Where a scene states its controller, small motions must not grow under it either.

    Args:
        best: The best case, found or not.
        optimum: Finds the best case of another problem, for another objective.
        options: Options of the verdicts.
        limits: Limits of the whole call.
        rest: Makes the verdicts, and states which small motions must not grow; None: `stability`
            alone.

    Returns:
        The best case where nothing is found or where its own torques are guaranteed; else a
        solution with status STRONG, or one that says that none was found.
    """
    if not best.found:
        return best
    rest = RestModel() if rest is None else rest
    unknown = rest.unknown or best.problem.cone_model.no_verdict
    if unknown:
        return _not_found(best, [(best, undecided_verdict(best.problem, best.torques, unknown))])
    search = _TorqueSearch(best, optimum, options, limits, rest)
    verdict = search.ask_verdict(best, options.verdict_nodes)
    if rest.is_kept(verdict):
        return _guaranteed_solution(best, best, verdict, 1)
    if verdict.joints_held:
        return _not_found(best, search.tried)
    found = [
        one
        for one in map(
            search.first_guaranteed, (search.half_space_torques(verdict), search.support_guesses())
        )
        if one
    ]
    if not found and options.verdict_nodes > FIRST_NODES:
        open_still = [one for one, known in search.tried[1:] if known.status is Stability.UNDECIDED]
        again = search.first_guaranteed(open_still, options.verdict_nodes)
        found = [] if again is None else [again]
    if not found:
        return _not_found(best, search.tried)
    sign = best.objective.sign
    candidate, verdict = min(found, key=lambda one: sign * one[0].value)
    if not search.motions:  # else they are the best ones with some reserve
        candidate, verdict = search.improved_torques(candidate, verdict)
    return _guaranteed_solution(best, candidate, verdict, len(search.tried))


@dataclass
class _TorqueSearch:
    """A search for guaranteed torques, one candidate after the other.

    Attributes:
        best: The best case.
        optimum: Finds the best case of another problem, for another objective.
        options: Options of the verdicts.
        limits: Limits of the whole call.
        rest: See `guaranteed`.
        tried: Each candidate with its verdict.
    """

    best: TorqueSolution
    optimum: Optimum
    options: SolveOptions
    limits: Limits
    rest: RestModel
    tried: list[Tried] = field(default_factory=list)

    def ask_verdict(self, candidate: TorqueSolution, nodes: int = FIRST_NODES) -> StabilityVerdict:
        """Return the verdict on a candidate's torques, with a limit on the sets of outcomes."""
        verdict = self.rest.verdict(
            self.best.problem,
            candidate.torques,
            node_limit=min(nodes, self.options.verdict_nodes),
            time_limit=self.limits.with_time_left(self.options).time_limit,
        )
        self.tried.append((candidate, verdict))
        return verdict

    def first_guaranteed(
        self, candidates: Iterable[TorqueSolution], nodes: int = FIRST_NODES
    ) -> Tried | None:
        """Return the first candidate whose torques are guaranteed."""
        for candidate in candidates:
            verdict = self.ask_verdict(candidate, nodes)
            if self.rest.is_kept(verdict):
                return candidate, verdict
            if self.limits.is_time_over:
                break
        return None

    def half_space_torques(self, verdict: StabilityVerdict) -> Iterator[TorqueSolution]:
        """Yield torques inside the half-spaces that the counterexamples' motions leave.

        Under a declared motion the power of friction has no sign, and there are no half-spaces.
        """
        problem, objective = self.best.problem, self.best.objective
        if problem.is_sliding.any():
            return
        first, scale = verdict, problem.scales.joints
        for share in _FRICTION_LEFT:
            verdict = first
            cuts, last = list[tuple[FloatArray, float]](), self.best.torques
            for _ in range(_STEPS):
                met = [half_space(problem, one, share) for one in counterexamples(verdict, _OTHERS)]
                count = len(cuts)
                cuts += [one for one in met if np.abs(one[0] * scale).max(initial=0.0) > _STILL]
                if len(cuts) == count:
                    break
                normals, sides = (np.array(part) for part in zip(*cuts, strict=True))
                inside = InsideHalfSpaces(normals, sides, _DEPTH, objective.required_margin)
                candidate = self._solution_for(problem, inside)
                if candidate is None:
                    break
                change, last = np.abs(candidate.torques - last), candidate.torques
                if (change <= _SAME * scale).all():
                    break
                yield candidate
                verdict = self.tried[-1][1]

    def support_guesses(self) -> Iterator[TorqueSolution]:
        """Yield optima with less friction at the supports."""
        shares = (1.0, *_SHARES) if self.motions else _SHARES
        for weaker, aim in weaker_supports(self.best.problem, self.best.objective, shares):
            solution = self._solution_for(weaker, aim)
            if solution is not None:
                yield solution

    def improved_torques(self, found: TorqueSolution, verdict: StabilityVerdict) -> Tried:
        """Return guaranteed torques nearer to the best case's, by bisection of the line to them."""
        proven, unproven = found.torques, self.best.torques
        for _ in range(_HALVINGS):
            middle = 0.5 * (proven + unproven)
            candidate = self._solution_at(middle)
            judged = None if candidate is None else self.ask_verdict(candidate)
            if candidate is None or judged is None or not self.rest.is_kept(judged):
                unproven = middle
            else:
                proven, found, verdict = middle, candidate, judged
        return found, verdict

    @cached_property
    def motions(self) -> Sequence[LinearizedMotion]:
        """Linearized motions that must not grow, by model of the surfaces; empty: not modelled."""
        return [motion for motion in self.rest.motions() if len(motion.inertia)]

    def _solution_for(self, problem: QuasistaticProblem, aim: Objective) -> TorqueSolution | None:
        """Return the best case at the torques that are best for another problem and objective.

        If motions are modelled and such torques exist, these are stable torques.
        """
        if self.motions:
            torques = stable_torques(problem, aim, self.motions, self.best.problem)
            if torques is not None:
                return self._solution_at(torques)
        found = self.optimum(problem, aim)
        return self._solution_at(found.torques) if found.found else None

    def _solution_at(self, torques: FloatArray) -> TorqueSolution | None:
        objective = self.best.objective
        solution = self.optimum(self.best.problem, AtTorques(objective, torques))
        return replace(solution, objective=objective) if solution.found else None


def weaker_supports(
    problem: QuasistaticProblem, objective: Objective, shares: Sequence[float] = _SHARES
) -> Iterator[tuple[QuasistaticProblem, Objective]]:
    """Yield problems with less friction at resting contacts that no joint moves, and objectives.

    First the given objective, then the margin: large contact forces make proofs easier.

    Args:
        problem: Contacts, load and joints; without joints there is nothing to choose.
        objective: What is optimised.
        shares: Factors on that friction with the given objective.
    """
    rows = problem.jacobian.reshape(problem.contact_count, 3 * problem.joint_count)
    supports = ~rows.any(axis=1) & ~problem.is_sliding
    aims: list[tuple[Objective, float]] = [(objective, share) for share in shares]
    if not isinstance(objective, Margin):
        aims += [(Margin(), share) for share in (1.0, *_SHARES)]
    for aim, share in aims if problem.joint_count else ():
        friction = np.where(supports, share, 1.0) * problem.friction
        yield problem.with_changes(friction=friction), aim


def stable_torques(
    problem: QuasistaticProblem,
    objective: Objective,
    motions: Sequence[LinearizedMotion],
    whole: QuasistaticProblem,
) -> FloatArray | None:
    """Return the best torques (L,) under which no small motion is expected to grow; None: none.

    By semidefinite programs over the forces of the relaxation. Only the symmetric part of the
    geometric stiffness enters, at the contact forces of the program and at the worst admissible
    ones of earlier rounds: the torques are a guess, N m (N).

    Args:
        problem: Contacts, load and limits.
        objective: What is optimised.
        motions: Small motions under the controller, by model of the surfaces.
        whole: The problem whose admissible contact forces may all result.
    """
    formulation = formulate(problem, objective)
    program, coordinates = formulation.program, formulation.coordinates
    margin = [one.at for one in program.bounded_blocks if one.name == "margin"]
    low = program.lb.copy()
    for columns in margin:
        low[columns] = np.maximum(low[columns], 0.0)
    program = program.with_bounds(low, program.ub)
    basis = coordinates.force_scale * coordinates.basis.T
    offsets = [(motion, np.zeros((problem.contact_count, 3))) for motion in motions]
    torques = None
    for _ in range(_ROUNDS):
        inequalities = []
        for motion, forces in offsets:
            constant, each = motion.inequality(forces, _GUESSED_GROWTH, _RESERVE)
            inequalities.append(MatrixInequality(constant, np.tensordot(basis, each, 1)))
        x = least_within(program, inequalities)
        if x is None:
            break
        forces = coordinates.forces(x)
        torques = problem.gravity_torques + problem.jacobian.T @ forces.ravel()
        count = len(offsets)
        for motion in motions:
            worst = extreme_forces(motion, whole, torques, forces, worst=True)
            if motion.fastest_growth(motion.stiffness(worst))[0] > 0.0:
                offsets.append((motion, worst - forces))
        if len(offsets) == count:
            break
    return torques


def _advice(verdict: StabilityVerdict) -> str:
    """Return what to try where no torques were found."""
    if verdict.status is Stability.STRONG:
        return "- use the joint feedback that the verdict states, or another grip"
    if verdict.problem.cone_model.no_verdict:
        return "- use the cone 'edges' or 'round': other cones have no verdicts"
    if verdict.joints_held:
        return (
            "- state constant torques, or a stiffness, as controller: then torques have an effect"
        )
    return "- try more friction, larger effort limits, or a larger verdict_nodes"


def half_space(
    problem: QuasistaticProblem, motion: DynamicOutcome, share: float
) -> tuple[FloatArray, float]:
    """Return (L,) normal and side of the half-space of torques too weak to drive a motion.

    Args:
        problem: Contacts, load and joints.
        motion: An outcome.
        share: Share of the power of its friction that load and torques have to stay below.
    """
    a = np.concatenate([motion.object_acceleration, motion.joint_accelerations])
    u = contact_jacobian(problem) @ a
    normal_forces = np.einsum("li,li->l", motion.contact_forces, problem.normals)
    friction = problem.friction * normal_forces @ np.hypot(u[:, 1], u[:, 2])
    load = generalized_load(problem, np.zeros(problem.joint_count))
    return motion.joint_accelerations, share * float(friction) - float(load @ a)


def _guaranteed_solution(
    best: TorqueSolution, found: TorqueSolution, verdict: StabilityVerdict, tried: int
) -> TorqueSolution:
    gap = max(-best.objective.sign * (best.value - found.value), 0.0)
    guarantee = Guarantee(verdict, best.value, gap, tried)
    if found is best:
        return replace(best, guarantee=guarantee)
    return replace(bounded_by(best, found), status=Status.STRONG, guarantee=guarantee)


def bounded_by(best: TorqueSolution, found: TorqueSolution) -> TorqueSolution:
    """Return a solution with the bound and the multipliers that the best case has proven.

    Args:
        best: The best case.
        found: Other torques, of the same problem and objective.
    """
    certificate = replace(
        best.certificate,
        primal_residual=found.certificate.primal_residual,
        duality_gap=np.inf,
        gap=-best.objective.sign * (best.certificate.bound - found.value),
    )
    evidence = Evidence(
        relaxation=best.evidence.relaxation,
        added=found.evidence.added,
        motion=found.evidence.motion,
    )
    return replace(found, certificate=certificate, evidence=evidence)


def _not_found(best: TorqueSolution, tried: list[Tried]) -> TorqueSolution:
    """Return a solution without torques; proven infeasible if torques have no influence."""
    verdict = next(judged for solution, judged in reversed(tried) if solution is best)
    moves = verdict.status in (Stability.WEAK, Stability.NONE)
    proven = moves and (verdict.joints_held or not best.problem.joint_count)
    return replace(
        best,
        status=Status.INFEASIBLE_STRONG if proven else Status.STRONG_NOT_FOUND,
        guarantee=Guarantee(verdict, best.value, np.nan, len(tried)),
        _forces=None,
        _mode=None,
        _explanation=f"Verdict on the best case's torques: {verdict.message}.\n{_advice(verdict)}",
    )
