"""Reading of a solution from its JSON document.

The size of a document is checked before anything is built from it: its program is dense, and grows
with the square of the number of contacts.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from graspless_pin.bounds import (
    LARGEST_STATED,
    MOST_COEFFICIENTS,
    MOST_CONE_EDGES,
    MOST_CONTACTS,
)
from graspless_pin.errors import ArgumentError, GrasplessPinError, SceneError, TextError
from graspless_pin.findings import Finding, FindingCode
from graspless_pin.intake.files import FileKind, kind_of_data, read_text, refuse_other_kind
from graspless_pin.intake.text import fault_of_name, parse_json
from graspless_pin.intake.yaml_text import parse_yaml
from graspless_pin.modes.rules import Rules, SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.derived_inertias import INERTIAS, with_derived_inertias
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare, scaled_program
from graspless_pin.report.proof_data import StatedObjective, cone_data, read_multipliers
from graspless_pin.report.verify.fields import FORMAT, IN_MODE, WHOLE, Part, stacked
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.reading import read_mode, read_origin, read_problem
from graspless_pin.solution import FOUND, Certificate, Evidence, Guarantee, Status, TorqueSolution

_SAME_CORNER = 1e-9
"""Absolute tolerance of equal corners of cones."""
_ROUND_ROWS = 3
"""Rows of a round cone."""
_OWN_ROWS = 3
"""Rows of a contact beside those of its cone."""
_NAMED = ("name", "scene", "solver", "bodies")
"""Keys whose values are names."""


def check_bounds(document: dict[str, Any]) -> None:
    """Refuse a document with too many contacts or joints, too long a name or too large a number.

    Values of wrong types pass here; they are refused where they are read.

    Raises:
        ArgumentError: Naming the key, what was found and what would do.
    """
    contacts, joints = (_list_under_key(document, key) for key in ("contacts", "joints"))
    rows = [(key, _list_under_key(document, key)) for key in ("external_wrench", "wrench_matrix")]
    for key, entries in (("contacts", contacts), ("joints", joints), *rows):
        if len(entries) > MOST_CONTACTS:
            raise ArgumentError(
                "document",
                f"{key}: has {len(entries)} entries; at most {MOST_CONTACTS} are allowed",
            )
    size = _coefficient_count(document, len(contacts), len(joints))
    if size > MOST_COEFFICIENTS:
        raise ArgumentError(
            "document",
            f"contacts: {len(contacts)} contacts with their cones make a program of {size:.2g} "
            f"coefficients; at most {MOST_COEFFICIENTS:.2g} are supported: solve with fewer "
            "cone_edges or points_per_patch",
        )
    waiting = list(document.items())
    while waiting:
        where, item = waiting.pop()
        if isinstance(item, dict):
            waiting += [(f"{where}.{name}", one) for name, one in item.items()]
        elif isinstance(item, list):
            # Numbers and texts are reported under the name of their list.
            waiting += [
                (f"{where}[{place}]" if isinstance(one, dict) else where, one)
                for place, one in enumerate(item)
            ]
        elif isinstance(item, str) and where.rpartition(".")[2] in _NAMED:
            if fault := fault_of_name(item):
                raise ArgumentError("document", f"{where}: {fault}")
        elif isinstance(item, int | float) and LARGEST_STATED < abs(item) < math.inf:
            raise ArgumentError(
                "document",
                f"{where[:100]}: has the number {item!r:.30}; its magnitude must be at most "
                f"{LARGEST_STATED:g}",
            )


def _coefficient_count(document: dict[str, Any], contacts: int, joints: int) -> int:
    """Return an upper estimate of the rows times the columns of a document's program."""
    edges, faces = document.get("cone_edges"), _ROUND_ROWS
    if isinstance(edges, int) and document.get("cone") != "round":
        stated = [
            len(_list_under_key(contact, "cone_corners"))
            for contact in _list_under_key(document, "contacts")
        ]
        faces = max([min(edges, MOST_CONE_EDGES), *stated])
    passive = len(_list_under_key(document, "external_wrench"))
    rows, columns = contacts * (faces + _OWN_ROWS) + 2 * joints + passive, 3 * contacts + 1
    own = document.get("objective")
    if isinstance(own, dict):
        rows += sum(len(_list_under_key(one, "unit")) for one in _list_under_key(own, "rows"))
        columns += sum(len(_list_under_key(one, "unit")) for one in _list_under_key(own, "columns"))
    return rows * columns


def _list_under_key(holder: Any, key: str) -> list[Any]:
    """Return the list under a key of a mapping; empty where there is none."""
    value = holder.get(key) if isinstance(holder, dict) else None
    return value if isinstance(value, list) else []


DOCUMENT = FileKind("JSON document", 32, SceneError)


def read_document(path: Path) -> Any:
    """Read a JSON document of bounded size; its content is not checked yet.

    Raises:
        SceneError: If the file cannot be opened (see `read_bytes`) or is not JSON as
            `parse_json` reads it.

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
    text = read_text(path, DOCUMENT)
    try:
        return parse_json(text)
    except TextError as error:
        if path.suffix.lower() != ".json":
            with suppress(TextError):
                refuse_other_kind(path, DOCUMENT, kind_of_data(parse_yaml(text).data))
        raise SceneError(f"{path}: {error}") from None


@dataclass(frozen=True)
class _StatedFindings:
    """The findings that a document states of its scene."""

    findings: tuple[Finding, ...]


def read_solution(document: dict[str, Any]) -> TorqueSolution:
    """Return the solution that a document of `solution_document` describes.

    The proof over all modes stays in the document: `verify_document` checks it there.

    Raises:
        ArgumentError: If it is no such document, or has too many contacts, joints or coefficients,
            too long a name or too large a number (`graspless_pin.bounds`).

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report import read_solution, solution_document
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> again = read_solution(solution_document(scene.solve()))
        >>> print(f"{again.margin:.4f} N")
        1.6504 N
    """
    if not isinstance(document, dict):
        raise ArgumentError("document", "is not a JSON object; it must be written by solve")
    if "format" not in document:
        raise ArgumentError("document", "lacks the key 'format'; it must be written by solve")
    if document["format"] != FORMAT:
        found = document["format"]
        raise ArgumentError(
            "document", f"has the format {found!r:.20}; it must be {FORMAT}: solve again"
        )
    check_bounds(document)
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            return _stated_solution(document)
    except KeyError as error:
        raise ArgumentError("document", f"lacks the key {error}") from None
    except GrasplessPinError as error:
        raise ArgumentError("document", f"states an invalid problem: {error}") from None
    except (TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        raise ArgumentError("document", f"has an invalid value: {error}") from None


def document_origin(document: dict[str, Any]) -> FloatArray:
    """(3,) the point in world coordinates that the problem's positions are relative to, m."""
    return read_origin(Part("document", document, WHOLE, {}))


def document_bodies(document: dict[str, Any]) -> tuple[str, ...] | None:
    """M names of the bodies that touch the object; None where the document states none."""
    contacts = document["contacts"]
    if not all("bodies" in contact for contact in contacts):
        return None
    return tuple(str(contact["bodies"][0]) for contact in contacts)


def _stated_solution(document: dict[str, Any]) -> TorqueSolution:
    known = read_problem(document)
    stated = known.part(document)
    status, proof = Status[stated["status"].upper()], stated["proof"]
    problem, objective = _stated_problem(stated, known), _stated_objective(stated, known)
    _ = scaled_program(problem, objective)  # raises for an invalid objective
    forces = mode = in_mode = added = balanced = relaxed = None
    if all(contact["selected"] is not None for contact in document["contacts"]):
        mode = SlidingMode(*read_mode(document, known))
    if status in FOUND:
        forces = read_only(stacked(stated["contacts"], "force"))
        if status is not Status.STRONG:
            in_mode = read_multipliers(stated["multipliers"], known, problem, objective)
        own = known.own
        added = (
            _optimal_added_column(problem, objective, forces) if own is None else own.scaled_values
        )
    elif proof.get("forces") is not None:
        balanced = read_only(proof["forces"])
        if known.own is not None:
            added = proof["columns"] / known.own.column_unit
    nodes = proof["nodes"] if document["proof"]["nodes"] else []
    if nodes and nodes[0]["kind"] == "bound":  # a bound at the root holds for every mode
        relaxed = read_multipliers(nodes[0]["multipliers"], known, problem, objective)
    motion, guarantee = proof.get("motion"), stated.get("guarantee")
    if motion is not None:
        motion = read_only(np.concatenate([motion["object"], motion["joints"]]))
    if guarantee is not None:  # its verdict stays in the document
        best, gap, tried = guarantee["best_case"], guarantee.maybe("gap"), guarantee["tried"]
        guarantee = Guarantee(None, best, np.nan if gap is None else gap, tried)
    return TorqueSolution(
        status,
        objective,
        Rules.parse(*(stated["rules"][key] for key in _RULES)),
        _stated_certificate(stated["certificate"]),
        problem,
        mode if stated["status"] in IN_MODE else None,
        _forces=forces,
        _mode=mode,
        evidence=Evidence(relaxed or in_mode, in_mode, added, balanced, motion),
        guarantee=guarantee,
        _explanation=str(document.get("explanation", "")),
        _source=_StatedFindings(tuple(map(_stated_finding, document.get("findings", [])))),
    )


_RULES = ("sign_rule", "sliding_rule", "static_friction")


def _stated_certificate(stated: Part) -> Certificate:
    """Return the certificate; a figure that is null becomes NaN."""
    figures = {item.name: stated.maybe(item.name) for item in fields(Certificate)}
    optima = figures.pop("threshold_optima")
    known: dict[str, Any] = {key: np.nan if one is None else one for key, one in figures.items()}
    return Certificate(
        **(known | {"solver": stated["solver"]}),
        threshold_optima=None if optima is None else (float(optima[0]), float(optima[1])),
    )


def _stated_finding(stated: dict[str, Any]) -> Finding:
    key = tuple(part if isinstance(part, int) else str(part) for part in stated["key"])
    subject, message, advice = (str(stated[name]) for name in ("subject", "message", "advice"))
    code = FindingCode(stated["code"])
    return Finding(code, subject, message, advice, key, str(stated["place"]))


def _stated_objective(stated: Part, known: Problem) -> Objective:
    """Return the objective that the document states."""
    if known.own is not None:
        name = stated["objective"]["name"]
        return StatedObjective(name, known.own, known.own.maximizes, known.e0)
    if known.is_margin:
        return Margin(known.epsilon)
    return (TorqueShare if known.by_limits else Torque)(known.e0, known.epsilon)


def _optimal_added_column(
    problem: QuasistaticProblem, objective: Objective, forces: FloatArray
) -> FloatArray:
    """(1,) the optimal value of the one column that the objective adds, at given forces, scaled."""
    coordinates, program, _ = scaled_program(problem, objective)
    high, coefficients = program.sides[1], program.rows[:, -1]
    force_terms = program.rows[:, :-1] @ coordinates.scaled(forces)
    # The least value that the rows allow where it is minimised, the largest where maximised.
    rows = coefficients * program.c[-1] < 0.0
    values = (high - force_terms)[rows] / coefficients[rows]
    value = np.maximum(values.max(initial=-np.inf), program.lb[-1])
    if program.c[-1] < 0.0:
        value = np.minimum(values.min(initial=np.inf), program.ub[-1])
    return np.array([value])


def _stated_problem(stated: Part, known: Problem) -> QuasistaticProblem:
    joints, document = stated["joints"], stated.stated
    rows, given = 3 * known.count, known.stated_map
    problem = QuasistaticProblem(
        known.p,
        known.frames[:, 0],
        known.w,
        known.J.reshape(rows, len(joints)),
        friction=known.mu,
        tangents=known.frames[:, 1:].transpose(0, 2, 1),
        sliding=known.v,
        torque_limits=(known.lower, known.upper),
        max_normal_force=known.limit,
        cone_edges=stated["cone_edges"],
        cone=stated["cone"],
        joint_names=[joint["name"] for joint in joints],
        joint_units=known.units,
        gravity_torques=known.gravity,
        wrench_matrix=None if given is None else given.reshape(rows, -1).T,
        passive_units=document.get("passive_units"),
    )
    _check_cones(problem, document["contacts"])
    inertias = {name: stated[name] for name in INERTIAS if stated.get(name) is not None}
    # A URDF may state invalid inertias: solutions do not depend on them.
    return with_derived_inertias(problem, {name: lambda a=a: a for name, a in inertias.items()})


def _check_cones(problem: QuasistaticProblem, contacts: list[dict[str, Any]]) -> None:
    """Refuse a document whose cones differ from those of the installed model of that name."""
    for index, contact in enumerate(contacts):
        for key, own in cone_data(problem, index).items():
            stated = np.array(contact[key])
            if stated.shape != own.shape or not np.allclose(
                stated, own, rtol=0.0, atol=_SAME_CORNER
            ):
                raise ArgumentError(
                    "document",
                    f"contacts[{index}].{key}: differs from the installed cone {problem.cone!r}",
                )
