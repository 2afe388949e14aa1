"""The whole proof of a solution, found or not: what its document carries for those who check it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.algorithms.mode_parts import ModePart
from graspless_pin.algorithms.mode_proof import BoundLeaf, ModeProof, ModeProver
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.enumeration import requirements_of
from graspless_pin.modes.kinematics import Witness
from graspless_pin.modes.rules import SlidingMode, StaticFriction
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.solvers import Outcome

_INFEASIBLE = (
    Status.INFEASIBLE_FORCES,
    Status.INFEASIBLE_MODES,
    Status.INFEASIBLE_IN_MODE,
    Status.INFEASIBLE_MODE,
)
_OPEN = (Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED)


@dataclass(frozen=True, eq=False)
class SolutionProof:
    """What proves the statements of a solution.

    Attributes:
        tree: Why nothing is better than the stated bound, or why there is nothing at all.
        motion: (6 + L,) [V; theta_dot] behind the mode, m/s and rad/s; None: none is asked for.
        forces: (M, 3) forces that balance where friction needs no virtual sliding, for a solution
            that is infeasible by its modes alone; None elsewhere.
        infeasibility: Proven smallest common violation of all constraints, scaled; else 0.
        in_mode: Multipliers (y, z) of the mode's own program where the tree is not complete.
    """

    tree: ModeProof
    motion: FloatArray | None = None
    forces: FloatArray | None = None
    infeasibility: float = 0.0
    in_mode: tuple[FloatArray, FloatArray] | None = None


def prove_solution(solution: TorqueSolution) -> SolutionProof:
    """Return the whole proof of a solution.

    It takes programs of its own: one or none where the relaxation proves the bound, up to
    `MOST_LEAVES` elsewhere; beyond that the proof says what is missing.

    Args:
        solution: Found or not.
    """
    if solution.status in _OPEN:
        return SolutionProof(ModeProof((), solution.status.message))
    formulation = formulate(solution.problem, solution.objective)
    prover = ModeProver(
        formulation,
        solution.rules,
        solution.certificate.solver or "piqp",
        _target(solution, formulation),
    )
    try:
        if solution.found:
            return _of_found(solution, formulation, prover)
        return _of_infeasible(solution, formulation, prover)
    except UndecidedMotionError as error:
        return SolutionProof(ModeProof((), str(error)))


def _target(solution: TorqueSolution, formulation: Formulation) -> float:
    """Return the stated bound, scaled; inf where there is nothing."""
    if solution.status in _INFEASIBLE:
        return np.inf
    return solution.certificate.bound / formulation.unit


def _of_found(
    solution: TorqueSolution, formulation: Formulation, prover: ModeProver
) -> SolutionProof:
    root: ModePart | None = ModePart.every_mode(solution.problem, solution.rules)
    given = solution.status is Status.OPTIMAL_IN_MODE
    has_modes = given or solution.rules.static_friction is not StaticFriction.COULOMB
    if given:
        root = ModePart.one_mode(solution.mode)
    elif not has_modes:
        root = None
    motion = _motion(formulation, solution, solution.mode) if has_modes else None
    if not np.isfinite(prover.target):
        return SolutionProof(ModeProof((), "the search ended without a bound"), motion)
    known = solution.proof.mode if given else solution.proof.relaxation
    tree = prover.prove(root, known)
    in_mode = None
    if not tree.complete and has_modes:
        answer = prover.solved(ModePart.one_mode(solution.mode), np.inf)
        if answer.outcome is Outcome.SOLVED:
            in_mode = answer.y, answer.z
    return SolutionProof(tree, motion, in_mode=in_mode)


def _of_infeasible(
    solution: TorqueSolution, formulation: Formulation, prover: ModeProver
) -> SolutionProof:
    root: ModePart | None = None
    mode, forces = solution.given_mode, None
    if mode is not None:
        root = ModePart.one_mode(mode)
    elif solution.status is Status.INFEASIBLE_MODES:
        root = ModePart.every_mode(solution.problem, solution.rules)
        answer = prover.solved(None)
        if answer.outcome is Outcome.SOLVED:
            forces = formulation.coordinates.forces(answer.x)
    tree = prover.prove(root)
    motion = None
    if mode is not None and solution.status is Status.INFEASIBLE_IN_MODE:
        motion = _motion(formulation, solution, mode)
    violation, first = 0.0, tree.nodes[0] if tree.nodes else None
    if isinstance(first, BoundLeaf):
        program = formulation.program.bounded(*prover.bounds(root))
        violation = max(program.infeasibility_bound(first.y, first.z), 0.0)
    return SolutionProof(tree, motion, forces, violation)


def _motion(
    formulation: Formulation, solution: TorqueSolution, mode: SlidingMode
) -> FloatArray | None:
    """Return the virtual motion behind a mode."""
    kinematics = formulation.kinematics
    verdict = kinematics.solve(requirements_of(mode), solution.rules.sign)
    return kinematics.scale * verdict.motion if isinstance(verdict, Witness) else None
