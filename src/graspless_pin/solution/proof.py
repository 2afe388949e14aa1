"""What proves an answer: what the search leaves of it, and the whole proof over all modes.

The proof is a tree. Each node stands for a part of all modes. A leaf says why nothing in its part
beats the stated bound: by multipliers of its program, or by a combination that excludes every
virtual motion. An inner node says how its part is split, so that no mode is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Brief

DualVariables = tuple[FloatArray, FloatArray]
"""Multipliers y, z of the equalities and of the other rows of a scaled program."""


@dataclass(frozen=True, eq=False, repr=False)
class Evidence(Brief):
    """What a search leaves of the proof of its answer.

    Attributes:
        relaxation: Multipliers of the program without modes, or of the given mode where that has no
            forces: they bound every mode, or prove that there is nothing. None: not at hand.
        in_mode: Multipliers of the program in which the solution was found; None: none was.
        added: Values of the columns that the objective adds to the forces', scaled; None: none.
        forces: (M, 3) forces that balance where friction needs no virtual sliding, N, for a
            solution that is infeasible by its modes alone.
        motion: (P + L,) [V; theta_dot] that may be behind the mode, m/s and rad/s.
    """

    relaxation: DualVariables | None = None
    in_mode: DualVariables | None = None
    added: FloatArray | None = None
    forces: FloatArray | None = None
    motion: FloatArray | None = None


NO_EVIDENCE = Evidence()


@dataclass(frozen=True, eq=False)
class BoundLeaf:
    """Multipliers that prove a part's bound.

    Attributes:
        y: (P,) of the balance, scaled.
        z: Of the rows, scaled.
        objective: Whether they bound the objective; else they prove that there are no forces.
    """

    y: FloatArray
    z: FloatArray
    objective: bool


@dataclass(frozen=True, eq=False)
class KinematicLeaf:
    """A combination that excludes every motion of a part.

    Attributes:
        combination: (M, 3) along n, t1, t2.
    """

    combination: FloatArray


@dataclass(frozen=True, eq=False)
class ConflictSplit:
    """Items that exclude each other: each child presumes those before its own, and breaks its own.

    Attributes:
        items: Contact, component and sign; the sign 0: the contact is selected.
        combinations: (M, 3) why they exclude each other; with `opened`, one for each sign left.
        opened: A component that the items leave no sign; None: they exclude each other alone.
    """

    items: tuple[tuple[int, int, int], ...]
    combinations: tuple[FloatArray, ...]
    opened: tuple[int, int] | None


@dataclass(frozen=True)
class ContactSplit:
    """A contact that is not selected, or has one of the pairs of signs that are left to it.

    Attributes:
        contact: Its index.
    """

    contact: int


ProofNode = BoundLeaf | KinematicLeaf | ConflictSplit | ContactSplit


@dataclass(frozen=True, eq=False)
class ModeProof:
    """A proof over a part of all modes.

    Attributes:
        nodes: Depth first, children in their order.
        missing: Why it is not complete; empty: it is.
    """

    nodes: tuple[ProofNode, ...]
    missing: str = ""

    @property
    def complete(self) -> bool:
        """Whether it is a proof."""
        return not self.missing


@dataclass(frozen=True, eq=False, repr=False)
class SolutionProof(Brief):
    """What proves the statements of a solution.

    Attributes:
        tree: Why nothing is better than the stated bound, or why there is nothing at all.
        motion: (P + L,) [V; theta_dot] behind the mode, m/s and rad/s; None: none is asked for.
        forces: (M, 3) forces that balance where friction needs no virtual sliding, for a solution
            that is infeasible by its modes alone; None elsewhere.
        in_mode: Multipliers (y, z) of the mode's own program where the tree is not complete.
    """

    tree: ModeProof
    motion: FloatArray | None = None
    forces: FloatArray | None = None
    in_mode: DualVariables | None = None
