"""Cones, proofs and multipliers as plain data, in the units of the problem."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.assembly import scaled_program
from graspless_pin.programs.marginals import scaled_weights
from graspless_pin.programs.objectives import Objective
from graspless_pin.report.objective_data import added_columns
from graspless_pin.report.verify.reading import KNOWN_CONES
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.proof import (
    BoundLeaf,
    ConflictSplit,
    ContactSplit,
    KinematicLeaf,
    ProofNode,
)


def proof_data(solution: TorqueSolution) -> dict[str, Any]:
    """Return the proof of a solution for its document.

    Args:
        solution: The solution.

    Returns:
        ``complete`` and, if it is not, what is ``missing``; the virtual ``motion`` behind the mode;
        the ``nodes`` of the proof over all modes; ``forces`` and ``mode_multipliers`` where they
        are part of it.
    """
    proof = solution.proof
    motion, passive = proof.motion, solution.problem.passive_count
    data: dict[str, Any] = {
        "complete": proof.tree.complete,
        "missing": proof.tree.missing,
        "motion": None
        if motion is None
        else {"object": motion[:passive], "joints": motion[passive:]},
        "nodes": [_node(solution, node) for node in proof.tree.nodes],
    }
    if proof.forces is not None:
        data["forces"] = proof.forces
        if solution.algorithm is None:
            data["columns"] = added_columns(solution)
    if proof.in_mode is not None:
        data["mode_multipliers"] = multipliers_data(solution, *proof.in_mode)
    return data


def multipliers_data(solution: TorqueSolution, y: FloatArray, z: FloatArray) -> dict[str, Any]:
    """Return multipliers of a solution's program, in SI units.

    Args:
        solution: The solution.
        y: Of the scaled equalities.
        z: Of the scaled rows.

    Returns:
        By the names of their blocks; those of cone faces as ``[contact, face, value]``, those of
        round cones by contact.
    """
    found = solution.named(y, z)
    data: dict[str, Any] = {name: np.zeros(size) for name, size in _sizes(solution).items()}
    data |= found
    if "faces" in found:
        data["faces"] = _entries(found["faces"])
    return data


def cone_data(problem: QuasistaticProblem, contact: int) -> dict[str, FloatArray]:
    """Return the cone of a contact where its normal force is 1, along t1 and t2, by key.

    Checkers know the paper's pyramids and Coulomb's cone by name; of other models they are told the
    ``cone_corners``, (r, 2), and where there is no cone the ``kinetic_friction``, (2,).
    """
    if problem.cone in KNOWN_CONES:
        return {}
    if problem.has_cone[contact]:
        return {"cone_corners": problem.friction[contact] * problem.cone_section.corners}
    return {"kinetic_friction": problem.tangents[contact].T @ problem.kinetic_directions[contact]}


def _sizes(solution: TorqueSolution) -> dict[str, int]:
    """Multipliers that documents of both algorithms have."""
    if solution.algorithm is None:
        return {}
    contacts, joints = solution.problem.contact_count, solution.problem.joint_count
    return {
        "normal_upper": contacts, "normal_lower": contacts,
        "share_upper": joints, "share_lower": joints,
    }  # fmt: skip


def read_multipliers(
    data: dict[str, Any], problem: QuasistaticProblem, objective: Objective
) -> tuple[FloatArray, FloatArray]:
    """Return the multipliers (y, z) of a scaled program from those in a document.

    Args:
        data: As `multipliers_data` gives them.
        problem: The problem.
        objective: What was optimised.

    Raises:
        KeyError, TypeError, ValueError, IndexError: If they are none.
    """
    _, program, unit = scaled_program(problem, objective)
    found = {name: as_numbers(values) for name, values in data.items() if name != "faces"}
    if not problem.cone_model.second_order:
        found["faces"] = _faces(data["faces"], problem)
    weights = scaled_weights(program.blocks, found, unit)
    count = len(program.b)
    return weights[:count], weights[count:]


def _faces(listed: list[Any], problem: QuasistaticProblem) -> FloatArray:
    """(M, r) multipliers of all faces."""
    faces = np.zeros((problem.contact_count, len(problem.cone_section.corners)))
    cones = np.flatnonzero(problem.has_cone).tolist()
    for contact, face, value in listed:
        faces[cones[cones.index(contact)], face] = as_number(value)
    return faces


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
