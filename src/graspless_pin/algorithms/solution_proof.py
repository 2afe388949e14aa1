"""The whole proof of a solution, found or not, that its document states for a checker.

It bounds and splits parts of all modes (`mode_tree`) as the search does, anew for each document:
with the bound known it takes a small part of the search's time, and no solution has to keep the
multipliers of every node. It does not depend on how the optimum was found.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.algorithms.mode_oracle import ModeOracle
from graspless_pin.algorithms.mode_tree import ModePart, ModeTree
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.kinematics import Witness, requirements_of
from graspless_pin.modes.rules import Rules, StaticFriction
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.programs.active_set_polish import certain_bound, refined_multipliers
from graspless_pin.programs.program import Program
from graspless_pin.solution import UNDECIDED, Status, TorqueSolution
from graspless_pin.solution.certificate import (
    BoundLeaf,
    DualVariables,
    KinematicLeaf,
    ModeProof,
    ProofNode,
    SolutionProof,
)
from graspless_pin.solvers import ANY_SOLVER, Answer, Outcome
from graspless_pin.tree_search import TreeSearch

MOST_LEAVES = 1000
"""Proofs with more leaves are not written."""
_BOUND_TOLERANCE = 1e-7
_LEAST_MULTIPLIER = 1e-9
"""Multipliers below this share of the largest are left out where the proof stays valid."""
_LOST_VIOLATION = 1e-6
"""Largest share of the smallest common violation that may be lost without them."""


@dataclass(eq=False)
class ModeProver:
    """Splits the set of all modes until multipliers or a kinematic combination close every part.

    Attributes:
        formulation: The program.
        rules: The reading of the virtual-sliding constraint.
        solver: The solver to ask first.
        target: Bound to prove for every part, scaled; inf: there are no forces.
    """

    formulation: Formulation
    rules: Rules
    solver: str
    target: float

    def __post_init__(self) -> None:
        """Make the tree and the oracle."""
        self.tree = ModeTree(self.formulation, self.rules, for_proof=True)
        self.oracle = ModeOracle(self.formulation, self.rules)

    def prove(self, root: ModePart | None, known: DualVariables | None = None) -> ModeProof:
        """Return the proof over a part of all modes.

        Args:
            root: The part; None: friction needs no virtual sliding at all.
            known: Multipliers that may close it at once; where there are no forces, those of the
                proof of the search.
        """
        leaf = None if known is None else self._leaf(root, *known, refuting=np.isinf(self.target))
        if leaf is not None:
            return ModeProof((leaf,))
        nodes: list[ProofNode] = []
        search, leaves = TreeSearch([root]), 0
        for _, part in search:
            try:
                node, children = self._proof_node(part)
            except UndecidedMotionError as error:
                return ModeProof((), str(error))
            if isinstance(node, str):
                return ModeProof((), node)
            nodes.append(node)
            leaves += isinstance(node, BoundLeaf | KinematicLeaf)
            if leaves > MOST_LEAVES or len(nodes) > 2 * MOST_LEAVES:
                return ModeProof((), f"the proof needs more than {MOST_LEAVES} leaves")
            search.add(reversed(children))
        return ModeProof(tuple(nodes))

    def _proof_node(self, part: ModePart | None) -> tuple[ProofNode | str, list[ModePart]]:
        """Return the proof node of a part with its children, or the reason why there is none."""
        excluded = None if part is None else self.tree.exclusion(part)
        if excluded is not None:
            return excluded, []
        answer = self.solve(part)
        if answer.outcome is Outcome.FAILED:
            return "no solver answered one of the programs", []
        refuting = answer.outcome is Outcome.INFEASIBLE
        leaf = self._leaf(part, answer.y, answer.z, refuting=refuting)
        if leaf is not None:
            return leaf, []
        if refuting:
            return "the multipliers do not prove that a tree node is infeasible", []
        if part is None:
            return "the relaxation does not prove the bound", []
        x = self.tree.without_forbidden_friction(part, answer.x)
        split = self.tree.split(part, x, self.oracle.conflict_for(x, part))
        return split or ("a kinematically feasible mode seems better than the bound", [])

    def solve(self, part: ModePart | None, cutoff: float | None = None) -> Answer:
        """Return the answer to the program of a part.

        Args:
            part: The part.
            cutoff: A proven bound above it is enough; None: the value that closes a part.
        """
        if cutoff is None:
            tolerance = (
                _BOUND_TOLERANCE * max(1.0, abs(self.target)) if np.isfinite(self.target) else 0.0
            )
            cutoff = self.target - 0.5 * tolerance
        return self.formulation.solve(*self.tree.bounds(part), self.solver, cutoff=cutoff)

    def _leaf(
        self, part: ModePart | None, y: FloatArray, z: FloatArray, *, refuting: bool
    ) -> BoundLeaf | None:
        """Return the leaf that closes a part, without needless multipliers; None: it stays open.

        Args:
            part: The part.
            y: Multipliers of the balance.
            z: Multipliers of the rows.
            refuting: Whether the multipliers prove that the part has no forces of interest.
        """
        program = self.formulation.program.with_bounds(*self.tree.bounds(part))
        enough = self.target - _BOUND_TOLERANCE * max(1.0, abs(self.target))
        for kept in (_without_tiny_multipliers(z), z):
            refined = refined_multipliers(program, y, kept)
            if certain_bound(program, *refined) >= enough:
                return BoundLeaf(*refined, objective=True)
        return self._refuting_leaf(program, y, z) if refuting else None

    def _refuting_leaf(self, program: Program, y: FloatArray, z: FloatArray) -> BoundLeaf | None:
        """Return the leaf of an infeasible program; None: the multipliers do not prove it."""
        proven = program.infeasibility_bound(y, z)
        if proven <= 0.0:
            return None
        # Far limits amplify tiny multipliers.
        thin = _without_tiny_multipliers(z)
        enough = program.infeasibility_bound(y, thin) >= (1.0 - _LOST_VIOLATION) * proven
        return BoundLeaf(y, thin if enough else z, objective=False)


def _without_tiny_multipliers(z: FloatArray) -> FloatArray:
    """Return multipliers with negligible ones set to zero."""
    size = np.abs(z)
    return np.where(size > _LEAST_MULTIPLIER * size.max(initial=0.0), z, 0.0)


_OPEN = UNDECIDED | {Status.INFEASIBLE_STRONG}


def proof_of(solution: TorqueSolution) -> SolutionProof:
    """Return the whole proof of a solution.

    Where the relaxation proves the answer, the search has kept the multipliers and mostly the
    motion, and nothing is solved. Otherwise the tree is made here, with up to `MOST_LEAVES` leaves;
    beyond that the proof states that it is incomplete.

    Args:
        solution: Found or not.

    Raises:
        ArgumentError: If it is under the rule ``direction``.
    """
    solution.rules.need_signs("the proof in a document")
    if solution.status in _OPEN:
        return SolutionProof(ModeProof((), solution.status.message))
    try:
        return (_proof_of_found if solution.found else _proof_of_infeasible)(solution)
    except UndecidedMotionError as error:
        return SolutionProof(ModeProof((), str(error)))


def written_multipliers(solution: TorqueSolution) -> DualVariables:
    """Return the multipliers of a found solution's own program as its document states them.

    They prove a bound for all forces whose friction has the signs of the solution's.
    """
    formulation = formulate(solution.problem, solution.objective)
    forces = formulation.coordinates.scaled(solution.contact_forces)
    friction = forces[formulation.cone_columns[0]]
    bounds = formulation.opposing(friction > 0.0, friction < 0.0)
    return refined_multipliers(
        formulation.program.with_bounds(*bounds), *solution.scaled_multipliers
    )


def _proof_of_found(solution: TorqueSolution) -> SolutionProof:
    formulation = formulate(solution.problem, solution.objective)
    target = solution.certificate.bound / formulation.signed_unit
    if not np.isfinite(target):
        return SolutionProof(ModeProof((), "the search ended without a bound"), solution.motion)
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
        answer = prover.solve(own, np.inf)
        if answer.outcome is Outcome.SOLVED:
            bounded = formulation.program.with_bounds(*prover.tree.bounds(own))
            in_mode = refined_multipliers(bounded, answer.y, answer.z)
    return SolutionProof(tree, solution.motion, in_mode=in_mode)


def _proof_of_infeasible(solution: TorqueSolution) -> SolutionProof:
    formulation = formulate(solution.problem, solution.objective)
    prover = ModeProver(formulation, solution.rules, ANY_SOLVER, np.inf)
    if solution.given_mode is not None:
        root = ModePart.one_mode(solution.given_mode)
        return SolutionProof(prover.prove(root, solution.evidence.relaxation), solution.motion)
    if solution.status is Status.INFEASIBLE_FORCES:
        return SolutionProof(prover.prove(None, solution.evidence.relaxation))
    every = ModePart.every_mode(solution.problem, solution.rules)
    return SolutionProof(prover.prove(every), forces=solution.evidence.forces)


def _has_modes(solution: TorqueSolution) -> bool:
    rule = solution.rules.static_friction
    return solution.given_mode is not None or rule is not StaticFriction.COULOMB


def motion_of(solution: TorqueSolution) -> FloatArray | None:
    """Return a virtual motion of a solution's mode: that of the search, or one found here.

    Args:
        solution: Found, or infeasible in a given mode.

    Returns:
        (P + L,) [V; theta_dot], m/s and rad/s; None where none is required, or there is none.
    """
    if solution.rules.by_direction:
        return solution.evidence.motion
    mode = solution.mode if solution.found else solution.given_mode
    if mode is None or not _has_modes(solution):
        return None
    kinematics = formulate(solution.problem, solution.objective).kinematics
    wanted, rule, seen = requirements_of(mode), solution.rules.sign, solution.evidence.motion
    if seen is not None and kinematics.meets_requirements(
        kinematics.rows @ (seen / kinematics.scale), wanted, rule
    ):
        return seen
    verdict = kinematics.solve(wanted, rule)
    if not isinstance(verdict, Witness):
        return None
    return read_only(kinematics.scale * kinematics.scaled_motion(verdict.coordinates))
