"""A solution as a JSON document: all that an outsider needs to check it.

World axes throughout, SI units. Infinite limits and figures that do not exist are null.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from graspless_pin.algorithms.formulation import Objective, formulate
from graspless_pin.drafts import draft_of
from graspless_pin.errors import SceneError
from graspless_pin.modes.enumeration import requirements_of
from graspless_pin.modes.kinematics import VirtualKinematics, Witness
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.multipliers import constraint_multipliers
from graspless_pin.report.provenance import provenance
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution
from graspless_pin.solvers import Outcome


def solution_document(solution: TorqueSolution, scene: Scene | None = None) -> dict[str, Any]:
    """Return the document of a solution.

    Args:
        solution: The solution, found or not.
        scene: The scene that it is of; None for a problem made from arrays, whose points are then
            relative to its own reference point.

    Returns:
        Plain data for `json.dumps`: ``status``, ``found``, ``algorithm``, ``margin`` (N),
        ``max_torque`` (N m), ``gravity``, ``object``, ``hand``, ``joints``, ``contacts``,
        ``certificate``, ``provenance`` and the options. Poses are (4, 4) rows of T_world_object,
        T_world_base.
    """
    found = solution.found
    document: dict[str, Any] = {
        "status": solution.status.name.lower(),
        "message": solution.status.message,
        "found": found,
        "algorithm": str(solution.algorithm),
        "required_margin": solution.required_margin,
        "margin": solution.margin if found else None,
        "max_torque": solution.max_torque if found else None,
        "rules": {
            "sign_rule": str(solution.rules.sign),
            "sliding_rule": str(solution.rules.sliding),
            "static_friction": str(solution.rules.static_friction),
        },
        "external_wrench": solution.problem.external_wrench,
        "cone_edges": solution.problem.cone_edges,
    }
    if scene is not None:
        document |= _scene_part(scene)
    document["joints"] = _joints(solution)
    document["contacts"] = _contacts(solution, scene)
    document["certificate"] = asdict(solution.certificate)
    if solution.found:
        document["certificate"] |= _proof(solution)
    elif solution.explanation:
        document["explanation"] = solution.explanation
    document["provenance"] = provenance(solution.problem, None if scene is None else scene.path)
    return _plain(document)


def write_document(document: dict[str, Any], target: str | Path) -> None:
    """Write a document to a file, or to standard output for ``-``.

    A file is written beside its final name and moved there, so that an interrupted run leaves what
    was there before. A pipe or device is written to as it is.

    Raises:
        SceneError: If the file cannot be written.
    """
    write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", target, kind="JSON")


def write_text(text: str, target: str | Path, *, kind: str) -> None:
    """Write a text as `write_document` does; ``kind`` says in a message what it is.

    Raises:
        SceneError: If the file cannot be written.
    """
    if str(target) == "-":
        sys.stdout.write(text)
        return
    path = Path(target)
    try:
        if path.exists() and not path.is_file():
            path.write_text(text, encoding="utf-8")
            return
        with draft_of(path) as draft:
            draft.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SceneError(
            f"{path}: cannot be written ({error.strerror}); choose another file for the {kind}"
        ) from error


def _scene_part(scene: Scene) -> dict[str, Any]:
    part: dict[str, Any] = {
        "scene": scene.name,
        "gravity": scene.gravity,
        "object": {
            "name": scene.object.name,
            "mass": scene.object.mass,
            "center_of_mass": scene.object.center_of_mass_world,
            "pose": scene.object.T_world_object,
        },
    }
    if scene.hand is not None:
        part["hand"] = {"base_pose": scene.hand.T_world_base, "q": dict(scene.hand.q)}
        if len(scene.hand.base_poses) > 1:
            part["hand"]["base_poses"] = dict(scene.hand.base_poses)
    return part


def _joints(solution: TorqueSolution) -> list[dict[str, Any]]:
    problem = solution.problem
    joints = []
    for index, name in enumerate(problem.joint_names):
        joints.append(
            {
                "name": name,
                "unit": problem.joint_units[index],
                "torque_contact": solution.contact_torques[index] if solution.found else None,
                "torque_gravity": problem.gravity_torques[index],
                "torque": solution.torques[index] if solution.found else None,
                "lower": problem.lower_torque[index],
                "upper": problem.upper_torque[index],
            }
        )
    return joints


def _contacts(solution: TorqueSolution, scene: Scene | None) -> list[dict[str, Any]]:
    problem = solution.problem
    origin = np.zeros(3) if scene is None else scene.object.center_of_mass_world
    contacts = []
    for index in range(problem.contact_count):
        entry: dict[str, Any] = {
            "position": problem.positions[index] + origin,
            "normal": problem.normals[index],
            "tangents": problem.tangents[index].T,
            "force": solution.contact_forces[index] if solution.found else None,
            "friction": problem.friction[index],
            "max_normal_force": problem.max_normal_force[index],
            "sliding": problem.sliding[index],
            "selected": solution.mode.selection[index] if solution.found else None,
            "signs": solution.mode.signs[index] if solution.found else None,
            "jacobian": problem.jacobian[3 * index : 3 * index + 3],
        }
        if scene is not None:
            entry = {"bodies": [scene.contacts.bodies[index], scene.object.name], **entry}
        contacts.append(entry)
    return contacts


def _proof(solution: TorqueSolution) -> dict[str, Any]:
    """The virtual motion behind the mode, and multipliers in the units of the problem."""
    proof: dict[str, Any] = {"scale": "limits" if solution.multipliers.by_limits else "absolute"}
    kinematics = VirtualKinematics(solution.problem)
    verdict = kinematics.solve(requirements_of(solution.mode), solution.rules.sign)
    if isinstance(verdict, Witness):
        motion = kinematics.scale * verdict.motion
        proof["virtual_motion"] = {"object": motion[:6], "joints": motion[6:]}
    if solution.multipliers.is_linear:
        proofs = {"relaxation": solution.multipliers.relaxation, "mode": _mode_proof(solution)}
        for name, (y, z) in proofs.items():
            proof[f"{name}_multipliers"] = asdict(
                constraint_multipliers(
                    solution.problem,
                    y,
                    z,
                    algorithm=str(solution.algorithm),
                    by_limits=solution.multipliers.by_limits,
                )
            )
    return proof


def _mode_proof(solution: TorqueSolution) -> tuple[FloatArray, FloatArray]:
    """Multipliers of the mode's own program.

    Those of the search may belong to a node that asks more, or less, of other contacts.
    """
    if solution.rules.static_friction is StaticFriction.COULOMB:
        return solution.multipliers.mode
    objective = Objective(
        solution.algorithm,
        solution.required_margin,
        by_limits=solution.multipliers.by_limits,
        regularization=0.0,
    )
    formulation = formulate(solution.problem, objective)
    solver = solution.certificate.solver
    answer = formulation.solve(*formulation.bounds_of(solution.mode), solver, cutoff=np.inf)
    if answer.outcome is not Outcome.SOLVED:
        return solution.multipliers.mode
    return answer.y, answer.z


def _plain(value: Any) -> Any:
    """Return plain Python data: arrays as lists, numbers that are not finite as None."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
