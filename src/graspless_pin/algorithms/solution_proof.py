"""The whole proof of a solution, found or not: what its document carries for those who check it."""

from __future__ import annotations

import numpy as np

from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.mode_parts import ModePart
from graspless_pin.algorithms.mode_proof import ModeProver
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.enumeration import requirements_of
from graspless_pin.modes.kinematics import Witness
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.programs.sharpening import sharpened
from graspless_pin.solution import UNDECIDED, Status, TorqueSolution
from graspless_pin.solution.proof import DualVariables, ModeProof, SolutionProof
from graspless_pin.solvers import ANY_SOLVER, Outcome

_OPEN = UNDECIDED | {Status.INFEASIBLE_STRONG}


def proof_of(solution: TorqueSolution) -> SolutionProof:
    """Return the whole proof of a solution.

    Where the relaxation proves the answer, the search has left the multipliers and mostly the
    motion, and nothing is solved. Elsewhere the tree is made here: up to `MOST_LEAVES` programs;
    beyond that the proof says what is missing.

    Args:
        solution: Found or not.

    Raises:
        ArgumentError: If it is under the rule ``direction``.
    """
    solution.rules.need_signs("the proof that a document carries")
    if solution.status in _OPEN:
        return SolutionProof(ModeProof((), solution.status.message))
    try:
        return (_of_found if solution.found else _of_infeasible)(solution)
    except UndecidedMotionError as error:
        return SolutionProof(ModeProof((), str(error)))


def written_multipliers(solution: TorqueSolution) -> DualVariables:
    """Return the multipliers of a found solution's own program as its document states them.

    They prove their bound of forces whose friction has the signs of the solution's.
    """
    formulation = formulate(solution.problem, solution.objective)
    program, columns = formulation.program, formulation.cone_columns[0]
    friction = formulation.coordinates.scaled(solution.contact_forces)[columns]
    lb, ub = program.lb.copy(), program.ub.copy()
    lb[columns[friction >= 0.0]] = ub[columns[friction <= 0.0]] = 0.0
    return sharpened(program.bounded(lb, ub), *solution.scaled_multipliers)


def _of_found(solution: TorqueSolution) -> SolutionProof:
    formulation = formulate(solution.problem, solution.objective)
    target = solution.certificate.bound / formulation.unit
    if not np.isfinite(target):
        missing = ModeProof((), "the search ended without a bound")
        return SolutionProof(missing, solution.motion)
    own = ModePart.one_mode(solution.mode)
    root, known = (
        ModePart.every_mode(solution.problem, solution.rules),
        solution.evidence.relaxation,
    )
    if solution.given_mode is not None:
        root, known = own, solution.evidence.in_mode
    prover = ModeProver(formulation, solution.rules, solution.certificate.solver, target)
    has_modes = _has_modes(solution)
    tree = prover.prove(root if has_modes else None, known)
    in_mode = None
    if not tree.complete and has_modes:
        answer = prover.solved(own, np.inf)
        if answer.outcome is Outcome.SOLVED:
            bounded = formulation.program.bounded(*prover.bounds(own))
            in_mode = sharpened(bounded, answer.y, answer.z)
    return SolutionProof(tree, solution.motion, in_mode=in_mode)


def _of_infeasible(solution: TorqueSolution) -> SolutionProof:
    formulation = formulate(solution.problem, solution.objective)
    prover = ModeProver(formulation, solution.rules, ANY_SOLVER, np.inf)
    if solution.given_mode is not None:
        root = ModePart.one_mode(solution.given_mode)
        return SolutionProof(prover.prove(root, solution.evidence.relaxation), solution.motion)
    if solution.status is Status.INFEASIBLE_FORCES:
        return SolutionProof(prover.prove(None, solution.evidence.relaxation))
    tree = prover.prove(ModePart.every_mode(solution.problem, solution.rules))
    return SolutionProof(tree, forces=solution.evidence.forces)


def _has_modes(solution: TorqueSolution) -> bool:
    given = solution.given_mode is not None
    return given or solution.rules.static_friction is not StaticFriction.COULOMB


def motion_of(solution: TorqueSolution) -> FloatArray | None:
    """Return the virtual motion behind a solution's mode: the search's, or one that is found here.

    Args:
        solution: Found, or infeasible in a given mode.

    Returns:
        (6 + L,) [V; theta_dot], m/s and rad/s; None where none is asked for, or there is none.
    """
    if solution.rules.by_direction:
        return solution.evidence.motion
    mode = solution.mode if solution.found else solution.given_mode
    if mode is None or not _has_modes(solution):
        return None
    kinematics = formulate(solution.problem, solution.objective).kinematics
    wanted, rule, seen = requirements_of(mode), solution.rules.sign, solution.evidence.motion
    if seen is not None and kinematics.counts(
        kinematics.rows @ (seen / kinematics.scale), wanted, rule
    ):
        return seen
    verdict = kinematics.solve(wanted, rule)
    if not isinstance(verdict, Witness):
        return None
    return read_only(kinematics.scale * kinematics.scaled_motion(verdict.coordinates))
