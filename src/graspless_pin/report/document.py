"""The JSON document of a solution: all data that an independent check of it needs.

World axes throughout, SI units. Infinite limits and figures that do not exist are null.

`with_proven_claims` withdraws the claims that the checker does not confirm from the document.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspless_pin.algorithms.disturbances import GuaranteedDisturbance
from graspless_pin.algorithms.solution_proof import written_multipliers
from graspless_pin.atomic_write import draft_of
from graspless_pin.errors import SceneError
from graspless_pin.findings import plain_findings
from graspless_pin.holding.stability import undecided_verdict
from graspless_pin.holding.verdict import Stability, StabilityVerdict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.report.proof_data import cone_data, multipliers_data, objective_data, proof_data
from graspless_pin.report.provenance import provenance
from graspless_pin.report.robust import robust_data
from graspless_pin.report.verdict_data import disturbance_data, holding_data, verdict_data
from graspless_pin.report.verify import Check, verify_document
from graspless_pin.report.verify.fields import FORMAT, KNOWN_CONES, record_data
from graspless_pin.report.verify.outcome import Claim
from graspless_pin.report.verify.tree import proven_violation
from graspless_pin.scene import Scene
from graspless_pin.solution import Status, TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.planning import PathProfile
    from graspless_pin.scene.robust_answer import RobustAnswer


_ROW = re.compile(r"\[[-+.\deE,\s]*\]")


def solution_document(
    solution: TorqueSolution,
    scene: Scene | None = None,
    verdict: StabilityVerdict | None = None,
    disturbances: GuaranteedDisturbance | None = None,
    answer: RobustAnswer | None = None,
) -> dict[str, Any]:
    """Return the document of a solution, with its complete proof.

    Solves nothing but what `solution.proof` needs at its first access.

    Args:
        solution: The solution, found or not.
        scene: The solved scene; None for a problem made from arrays, whose points are then relative
            to its own reference point.
        verdict: The verdict on whether the object stays with the solution's torques; None: that of
            the disturbances, else of the solution's guarantee, if there is one.
        disturbances: The guaranteed disturbances of these torques; None: none are written.
        answer: The robust answer over the scene's uncertainty; None: the scene is nominal. The
            solution is then the one under the robust torques or, without these, that of the joined
            problem.

    Returns:
        Plain data for `json.dumps`: ``format``, ``status``, ``found``, the options, ``objective``
        (where it is none of the paper's), ``margin`` (N), ``max_torque`` with its unit,
        ``wrench_matrix`` and ``passive_units`` (where one was given), ``scales``,
        ``findings`` (see `graspless_pin.Finding`),
        ``object_inertia``, ``joint_inertia``, ``gravity``, ``object``, ``loads``, ``acceleration``,
        ``hand``, ``joints``,
        ``contacts``, ``certificate``, ``multipliers``, ``proof``, ``guarantee``
        (best case, gap to it, sets of torques tried), ``stability`` (see `verdict_data`),
        ``holding`` (see `holding_data`), ``disturbances`` (see `disturbance_data`),
        ``uncertainty`` (see `robust_data`, with the document of the joined problem under ``proof``
        where torques were found) and ``provenance``.
        Poses are (4, 4) rows of T_world_object, T_world_base.

    Raises:
        ArgumentError: If no document can hold its objective, see `objective_data`, or its sign rule
            is ``direction``.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report import solution_document
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> solution_document(scene.solve(), scene)["algorithm"]
        <Algorithm.MARGIN: 'margin'>
    """
    solution.rules.need_signs("a document")
    found, coordinates = solution.found, solution.program.coordinates
    document: dict[str, Any] = {
        "format": FORMAT,
        "status": solution.status.name.lower(),
        "message": solution.status.message,
        "found": found,
        "algorithm": solution.algorithm,
        "required_margin": solution.required_margin,
        "scale": "limits" if solution.objective.by_limits else "absolute",
        "regularization": solution.regularization,
        "margin": solution.margin if found else None,
        "max_torque": solution.max_torque if found else None,
        "max_torque_unit": solution.max_torque_unit if found else None,
        "rules": solution.rules.options(),
        "external_wrench": solution.problem.external_wrench,
        "cone": solution.problem.cone,
        "cone_edges": solution.problem.cone_edges,
        **_coordinate_data(solution.problem),
        "scales": {"force": coordinates.force_scale, "length": coordinates.length_scale},
        "object_inertia": solution.problem.object_inertia,
        "joint_inertia": solution.problem.joint_inertia,
    }
    if solution.problem.cone not in KNOWN_CONES:
        document["coulombs_law"] = solution.problem.cone_model.is_coulomb
    if solution.algorithm is None:
        document["objective"] = objective_data(solution)
    uncertainty = None
    if answer is not None:
        uncertainty = robust_data(answer)
        if answer.found:
            uncertainty["proof"] = solution_document(answer.robust.solution)
        elif scene is not None:  # contacts and joints are those of all members
            document["scene"], scene = scene.name, None
    if scene is not None:
        document |= _scene_data(scene)
    document["findings"] = plain_findings(solution.findings)
    document["joints"] = _joint_data(solution)
    document["contacts"] = _contact_data(solution, scene)
    document["certificate"] = _certificate_data(solution)
    if found and solution.evidence.in_mode is not None:
        document["multipliers"] = multipliers_data(solution, *written_multipliers(solution))
    elif solution.explanation:
        document["explanation"] = solution.explanation
    document["proof"] = proof_data(solution)
    guarantee = solution.guarantee
    if disturbances is not None:
        verdict = disturbances.verdict if verdict is None else verdict
        document["disturbances"] = disturbance_data(disturbances)
    if guarantee is not None:
        if verdict is None and (found or not solution.problem.joint_count):
            verdict = guarantee.verdict  # needs torques to be checked with
        document["guarantee"] = record_data("guarantee", guarantee)
    if verdict is not None:
        document["stability"] = verdict_data(verdict)
        document["holding"] = holding_data(verdict)
    if uncertainty is not None:
        document["uncertainty"] = uncertainty
    document["provenance"] = provenance(solution.problem, None if scene is None else scene.path)
    plain: dict[str, Any] = _plain_data(document)
    figures = plain["certificate"]
    if figures["infeasibility"] > 0.0:
        # Negligible multipliers are not written: with them the search may prove slightly more.
        figures["infeasibility"] = min(figures["infeasibility"], proven_violation(plain))
    return plain


def write_document(document: dict[str, Any], target: str | Path) -> None:
    """Write a document to a file, or to standard output for ``-``.

    A file is written under a temporary name beside it and then renamed, so that an interrupted run
    leaves the old one intact. Pipes and devices are written to directly.

    Raises:
        SceneError: If the file cannot be written.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.report import read_document, solution_document, write_document
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "solution.json")
        ...     write_document(solution_document(scene.solve()), file)
        ...     sorted(read_document(file))[:2]
        ['algorithm', 'certificate']
    """
    laid_out = json.dumps(document, indent=2, allow_nan=False)
    # Rows of numbers on one line each.
    laid_out = _ROW.sub(lambda row: f"[{' '.join(row.group()[1:-1].split())}]", laid_out)
    write_text(f"{laid_out}\n", target, kind="JSON")


def write_text(text: str, target: str | Path, *, kind: str) -> None:
    """Write a text as `write_document` does; error messages call it ``kind``.

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


def _scene_data(scene: Scene) -> dict[str, Any]:
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
    if scene.loads:
        part["loads"] = [vars(load) for load in scene.loads]
    if scene.acceleration is not None:
        part["acceleration"] = vars(scene.acceleration)
    if scene.hand is not None:
        part["hand"] = {"base_pose": scene.hand.T_world_base, "q": dict(scene.hand.q)}
        if len(scene.hand.base_poses) > 1:
            part["hand"]["base_poses"] = dict(scene.hand.base_poses)
    return part


def _coordinate_data(problem: QuasistaticProblem) -> dict[str, Any]:
    """Return ``wrench_matrix`` and ``passive_units``; empty for one free object."""
    if problem.wrench_matrix is None:
        return {}
    return {"wrench_matrix": problem.wrench_matrix, "passive_units": list(problem.passive_units)}


def _joint_data(solution: TorqueSolution) -> list[dict[str, Any]]:
    problem, found = solution.problem, solution.found
    return [
        {
            "name": name,
            "unit": problem.joint_units[index],
            "torque_contact": solution.contact_torques[index] if found else None,
            "torque_gravity": problem.gravity_torques[index],
            "torque": solution.torques[index] if found else None,
            "lower": problem.lower_torque[index],
            "upper": problem.upper_torque[index],
        }
        for index, name in enumerate(problem.joint_names)
    ]


def _contact_data(solution: TorqueSolution, scene: Scene | None) -> list[dict[str, Any]]:
    problem = solution.problem
    origin = np.zeros(3) if scene is None else scene.object.center_of_mass_world
    mode = solution.mode if solution.found else solution.given_mode
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
            "selected": None if mode is None else mode.selection[index],
            "signs": None if mode is None else mode.signs[index],
            "jacobian": problem.jacobian[3 * index : 3 * index + 3],
        }
        entry |= cone_data(problem, index)
        if scene is not None:
            entry = {"bodies": [scene.contacts.bodies[index], scene.object.name], **entry}
        contacts.append(entry)
    return contacts


def _certificate_data(solution: TorqueSolution) -> dict[str, Any]:
    """Return the figures of the certificate; without an answer those of answers are null."""
    of_answer = () if solution.found else ("primal_residual", "duality_gap", "bound", "gap")
    return record_data("certificate", solution.certificate, **dict.fromkeys(of_answer))


def _plain_data(value: Any) -> Any:
    """Return plain Python data: arrays as lists, numbers that are not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): _plain_data(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain_data(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain_data(item) for item in value]
    if isinstance(value, np.generic):
        return _plain_data(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_path_documents(profile: PathProfile, folder: str | Path) -> tuple[Path, ...]:
    """Write the document of each waypoint's solution, with its proof.

    The files are ``waypoint_0000.json`` and so on, and ``waypoint_0003_arrival.json`` where the
    motion that ends at a waypoint has a solution of its own. A waypoint that was not solved,
    such as one without any contact, has no document.

    Args:
        profile: The profile of a path.
        folder: The folder of the files; it is created where it does not exist.

    Returns:
        The files written.

    Raises:
        SceneError: If a file cannot be written.

    Examples:
        >>> from graspless_pin import Waypoint, evaluate_path, load_scene
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.report import write_path_documents
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> with TemporaryDirectory() as folder:
        ...     len(write_path_documents(profile, folder))
        2
    """
    created = _created_folder(Path(folder))
    files = []
    for k, (leaving, arriving) in enumerate(
        zip(profile.evaluations, profile.arrivals, strict=True)
    ):
        for name, state in (("", leaving), ("_arrival", arriving)):
            if state.has_contacts and (not name or state is not leaving):
                file = created / f"waypoint_{k:04d}{name}.json"
                write_document(solution_document(state.solution, state.scene), file)
                files.append(file)
    return tuple(files)


@dataclass(frozen=True)
class SampleDocuments:
    """Writes the document of each sample of a study: ``sample_000000.json`` and so on.

    Attributes:
        folder: The folder of the files.
    """

    folder: Path

    def __post_init__(self) -> None:
        """Create the folder."""
        _created_folder(self.folder)

    def file(self, number: int) -> Path:
        """Return the file of a sample."""
        return self.folder / f"sample_{number:06d}.json"

    def __call__(self, number: int, scene: Scene, solution: TorqueSolution) -> None:
        """Write the document of a sample."""
        write_document(solution_document(solution, scene), self.file(number))

    def has(self, number: int) -> bool:
        """Return whether a sample has its document."""
        return self.file(number).is_file()


def _created_folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"{folder}: the folder cannot be created ({error.strerror})") from error
    return folder


_CLAIMS = (
    Status.OPTIMAL,
    Status.OPTIMAL_IN_MODE,
    Status.STRONG,
    Status.INFEASIBLE_FORCES,
    Status.INFEASIBLE_MODES,
    Status.INFEASIBLE_IN_MODE,
    Status.INFEASIBLE_MODE,
)


def with_proven_claims(
    solution: TorqueSolution, scene: Scene | None = None, verdict: StabilityVerdict | None = None
) -> tuple[TorqueSolution, StabilityVerdict | None]:
    """Return a solution and a verdict, reduced to the claims that their document proves.

    Args:
        solution: A solution of the scene.
        scene: The scene; None: the problem is of arrays, or of several scenes joined.
        verdict: The verdict on the solution's torques; None: there is none.

    Returns:
        Both unchanged where all checks pass. Otherwise an unproven verdict becomes undecided, an
        answer of which only the optimality is unproven `Status.LIMIT_REACHED`, and any other
        unproven answer `Status.UNVERIFIED` or `Status.STRONG_NOT_FOUND`.
    """
    # Documents cannot hold bounds of directions, nor an own objective with round cones.
    own_round = solution.algorithm is None and solution.problem.cone_model.second_order
    if solution.rules.by_direction or own_round:
        return solution, verdict
    checks = verify_document(solution_document(solution, scene, verdict)).checks
    unproven = [one for one in checks if one.passed is not True]
    rest_failures = [one for one in unproven if one.claim is Claim.REST]
    if rest_failures and verdict is not None and verdict.status is not Stability.UNDECIDED:
        why = f"undecided: its proof fails verification ({_failure_text(rest_failures)})"
        verdict = undecided_verdict(
            verdict.problem,
            verdict.torques,
            why,
            acceleration_resolution=verdict.acceleration_resolution,
        )
    if solution.status in _CLAIMS:
        # In a joined problem each member has its own verdict.
        joined = solution.guarantee is not None and solution.guarantee.verdict is None
        rest_claims = (Claim.REST, Claim.GUARANTEE) if joined else (Claim.REST,)
        refused = [one for one in unproven if one.claim not in rest_claims]
        solution = _without_refused_claims(solution, refused, rest_failures)
    return solution, verdict


def _without_refused_claims(
    solution: TorqueSolution, refused: Sequence[Check], lost: Sequence[Check]
) -> TorqueSolution:
    """Return a solution with the status that remains after its refused claims are withdrawn."""
    if solution.found and refused and all(one.claim is Claim.OPTIMUM for one in refused):
        return replace(solution, status=Status.LIMIT_REACHED)
    if not refused and not (lost and solution.status is Status.STRONG):
        return solution
    status = Status.UNVERIFIED if refused else Status.STRONG_NOT_FOUND
    return replace(
        solution,
        status=status,
        _forces=None,
        _mode=None,
        _explanation=f"Its document fails verification: {_failure_text([*refused, *lost])}.",
    )


def _failure_text(checks: Sequence[Check]) -> str:
    return "; ".join(f"{one.name}: {one.detail}" for one in checks)
