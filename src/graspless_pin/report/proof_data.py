"""Proofs and multipliers as plain data, in the units of the problem."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from graspless_pin.algorithms.mode_proof import (
    BoundLeaf,
    ConflictSplit,
    ContactSplit,
    KinematicLeaf,
    ProofNode,
)
from graspless_pin.algorithms.solution_proof import SolutionProof
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.multipliers import (
    ConstraintMultipliers,
    constraint_multipliers,
    scaled_multipliers,
)
from graspless_pin.solution import TorqueSolution


def proof_data(solution: TorqueSolution, proof: SolutionProof) -> dict[str, Any]:
    """Return the proof of a solution for its document.

    Args:
        solution: The solution.
        proof: Its proof.

    Returns:
        ``complete`` and, if it is not, what is ``missing``; the virtual ``motion`` behind the mode;
        the ``nodes`` of the proof over all modes; ``forces`` and ``mode_multipliers`` where they
        are part of it.
    """
    motion = proof.motion
    data: dict[str, Any] = {
        "complete": proof.tree.complete,
        "missing": proof.tree.missing,
        "motion": None if motion is None else {"object": motion[:6], "joints": motion[6:]},
        "nodes": [_node(solution, node) for node in proof.tree.nodes],
    }
    if proof.forces is not None:
        data["forces"] = proof.forces
    if proof.in_mode is not None:
        data["mode_multipliers"] = multipliers_data(solution, *proof.in_mode)
    return data


def multipliers_data(solution: TorqueSolution, y: FloatArray, z: FloatArray) -> dict[str, Any]:
    """Return multipliers of a solution's program, in SI units.

    Args:
        solution: The solution.
        y: (6,) of the scaled balance.
        z: Of the scaled rows.

    Returns:
        The fields of `ConstraintMultipliers`; those of cone faces as ``[contact, face, value]``.
    """
    found = constraint_multipliers(
        solution.problem,
        y,
        z,
        algorithm=str(solution.algorithm),
        by_limits=solution.by_limits,
        margin=solution.required_margin,
    )
    data = dict(vars(found))
    cones = np.flatnonzero(solution.problem.has_cone)
    data["faces"] = [
        [int(cones[cone]), int(face), float(found.faces[cone, face])]
        for cone, face in np.argwhere(found.faces)
    ]
    return data


def read_multipliers(
    data: dict[str, Any],
    problem: QuasistaticProblem,
    *,
    algorithm: str,
    by_limits: bool,
    margin: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the multipliers (y, z) of a scaled program from those in a document.

    Args:
        data: As `multipliers_data` gives them; rows of all faces (version 0.1) are read, too.
        problem: The problem.
        algorithm: ``margin`` or ``torque``.
        by_limits: Whether Algorithm 2 counted shares of the limits.
        margin: Required margin of Algorithm 2, N.

    Raises:
        KeyError, TypeError, ValueError, IndexError: If they are none.
    """
    cones = np.flatnonzero(problem.has_cone).tolist()
    faces = np.zeros((len(cones), problem.cone_edges))
    if data["faces"] and len(data["faces"][0]) != 3:
        faces[:] = as_numbers(data["faces"])
    else:
        for contact, face, value in data["faces"]:
            faces[cones.index(contact), face] = as_number(value)
    others = {
        key: as_numbers(data[key])
        for key in ConstraintMultipliers.__dataclass_fields__
        if key != "faces"
    }
    multipliers = ConstraintMultipliers(faces=faces, **others)
    return scaled_multipliers(
        problem, multipliers, algorithm=algorithm, by_limits=by_limits, margin=margin
    )


def as_number(value: object) -> float:
    """Return a number of a document.

    Raises:
        TypeError: If it is none; true and false are none.
        ValueError: If it is not finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r:.40} is no number")
    if not math.isfinite(value):
        raise ValueError(f"{value} is not finite")
    return float(value)


def as_numbers(values: Any) -> FloatArray:
    """Return nested lists of numbers as an array; the errors are those of `as_number`."""

    def plain(value: Any) -> Any:
        return [plain(one) for one in value] if isinstance(value, list) else as_number(value)

    return np.array(plain(values), dtype=np.float64)


def _node(solution: TorqueSolution, node: ProofNode) -> dict[str, Any]:
    match node:
        case BoundLeaf():
            multipliers = multipliers_data(solution, node.y, node.z)
            return {"kind": "bound", "objective": node.objective, "multipliers": multipliers}
        case KinematicLeaf():
            return {"kind": "kinematic", "combination": _entries(node.combination)}
        case ConflictSplit():
            return {
                "kind": "conflict",
                "items": [list(item) for item in node.items],
                "open": None if node.opened is None else list(node.opened),
                "combinations": [_entries(v) for v in node.combinations],
            }
        case ContactSplit():
            return {"kind": "contact", "contact": node.contact}


def _entries(v: FloatArray) -> list[list[Any]]:
    """[contact, axis, value] of what is not zero."""
    return [[int(c), int(axis), float(v[c, axis])] for c, axis in np.argwhere(v)]
